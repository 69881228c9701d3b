"""The report's paths: end points, continuity, exact derivatives, floats and traced alike."""

import numpy as np
import pytest

from k1607_pin import data
from k1607_pin.compiled.trace import trace
from k1607_pin.description.units import INCH
from k1607_pin.paths.report_paths import Circle, Line

FACTS = data.load("published")
PATHS = {"line": Line(np.array([33.996, 0.0, 20.0]) * INCH), "circle": Circle(0.5)}


@pytest.fixture(params=list(PATHS))
def path(request):
    return PATHS[request.param]


def times(path):
    """(200,) s, clear of the circle's changes of acceleration by more than a difference's step."""
    t = np.random.default_rng(78).uniform(0.01, 9.99, 200)
    joints = np.array(getattr(path, "times", ()))
    return t[np.abs(t[:, None] - joints).min(axis=1, initial=1.0) > 1e-3]


def test_velocity_and_acceleration_are_derivatives(path):
    t, h = times(path), 1e-5
    here, after, before = path(t), path(t + h), path(t - h)
    # central differences: h^2/6 times a third derivative below 10 m/s^3, rounding 1 m x 2e-16 / h
    assert np.abs((after.position - before.position) / (2 * h) - here.velocity).max() < 5e-10
    assert np.abs((after.velocity - before.velocity) / (2 * h) - here.acceleration).max() < 5e-10


def test_line_runs_between_the_published_points():
    case = FACTS["case1"]
    line = Line(np.array([case["x0_in"], case["y0_in"], 0.0]) * INCH)
    assert np.abs(line(0.0).position[:2] / INCH - [case["x0_in"], case["y0_in"]]).max() < 1e-12
    assert np.abs(line(0.0).velocity).max() < 1e-15
    assert np.abs(line(60.0).position[:2] / INCH - [case["xf_in"], case["yf_in"]]).max() < 1e-9
    assert np.abs(line(0.0).acceleration).max() > 0.1  # it starts with a jolt, as (78) has it


def test_circle_is_the_published_one_and_closed():
    circle = Circle(0.5)
    assert circle.times == pytest.approx((1.0, 9.0, 10.0), rel=1e-15)
    assert circle.times[-1] == pytest.approx(FACTS["case2"]["duration"]["duration_s"])
    start, end = circle(0.0), circle(10.0)
    assert start.position == pytest.approx([FACTS["case2"]["radius_in"] * INCH, 0, 0.5])
    assert end.position == pytest.approx(start.position, abs=1e-15)
    assert np.abs(np.concatenate([start.velocity, end.velocity])).max() < 1e-15
    t = np.linspace(0, 10, 500)
    assert np.hypot(*circle(t).position[:, :2].T) == pytest.approx(np.full(500, circle.radius))
    assert np.linalg.norm(circle(5.0).velocity) == pytest.approx(circle.radius * circle.omega)


def test_circle_is_smooth_where_its_segments_meet():
    circle, h = Circle(0.5), 1e-9
    for t in circle.times[:2]:
        before, after = circle(t - h), circle(t + h)
        assert np.abs(after.position - before.position).max() < 3 * h  # speed 0.43 m/s
        assert np.abs(after.velocity - before.velocity).max() < 3 * h  # acceleration 0.5 m/s^2


def test_circle_rests_before_and_after():
    circle = Circle(0.5)
    for t in (-1.0, 11.0):
        point = circle(t)
        assert point.position == pytest.approx(circle(0.0).position, abs=1e-15)
        assert np.abs(np.concatenate([point.velocity, point.acceleration])).max() < 1e-15


def test_batches_equal_single_times_and_traced(path):
    t = times(path)
    batch = path(t)
    traced = trace(lambda s: tuple(path(s[0])), "path", [(1,)])
    for k, s in enumerate(t[:30]):
        for together, alone, symbolic in zip(batch, path(s), traced(s), strict=True):
            assert together[k] == pytest.approx(alone, abs=1e-15)
            assert np.array(symbolic)[:, 0] == pytest.approx(alone, abs=1e-15)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Line(np.zeros(2)), "start"),
        (lambda: Line(np.zeros(3), np.full(3, np.nan)), "extent"),
        (lambda: Line(np.zeros(3), rate=0.0), "rate"),
        (lambda: Circle(np.inf), "height"),
        (lambda: Circle(0.0, radius=-1.0), "radius"),
        (lambda: Circle(0.0, omega=np.nan), "omega"),
        (lambda: Circle(0.0, omega=2.0, beta=0.1), "fit into one turn"),
    ],
)
def test_paths_that_make_no_sense_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
