"""Plans in joint space: waypoints met, limits kept, rest at both ends, refusals that name the joint."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin.paths.joint_plan import JointLimitError, joint_limits, plan_joints

ROUNDING = 1e-9


def random_ways(arm, seed):
    """(m + 1, n): anywhere within the limits, step by step onward, or in steps of very different sizes."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 8))
    if seed % 3 == 0:
        return arm.random_configuration(rng, m + 1)
    sizes = rng.uniform(-0.1, 0.4, (m + 1, arm.n))
    if seed % 3 == 1:
        sizes = rng.uniform(0, 1, (m + 1, 1)) ** 4 * rng.uniform(-1, 1, arm.n)
    ways = np.clip(arm.random_configuration(rng) / 2 + np.cumsum(sizes, axis=0), arm.lower, arm.upper)
    return ways if np.ptp(ways, axis=0).max() > 0 else arm.random_configuration(rng, m + 1)


def times_of_visits(plan, ways):
    """When each waypoint is met: every joint within rounding of it, in turn."""
    times, t = [], 0.0
    for way in ways:
        found = [x for x in plan.spline.times if x >= t and np.abs(plan(x).position - way).max() < ROUNDING]
        assert found, f"not met: {way}"
        t = found[0]
        times.append(t)
    return times


@given(st.integers(0, 10_000), st.booleans())
def test_waypoints_are_met_from_rest_to_rest_within_all_limits(arm, seed, stop):
    q0, *ways = random_ways(arm, seed)
    plan, limits = plan_joints(arm, ways, q0, stop=stop), joint_limits(arm)
    start, end = plan(0.0), plan(plan.duration)
    assert (start.position == q0).all()
    assert end.position == pytest.approx(ways[-1], abs=1e-11)
    for point in (start, end):
        assert np.abs(point.velocity).max() < 1e-11
        assert np.abs(point.acceleration).max() < 1e-9
    times_of_visits(plan, ways)
    for order, limit in ((1, limits.velocity), (2, limits.acceleration)):
        lowest, highest = plan.spline.peaks(order)
        assert (np.maximum(-lowest.value, highest.value) <= limit * (1 + 1e-9)).all()
    assert (np.abs(6 * plan.spline.coefficients[0]) <= limits.jerk * (1 + 1e-9)).all()
    t = np.linspace(0, plan.duration, 500)
    assert ((plan(t).position > arm.lower - ROUNDING) & (plan(t).position < arm.upper + ROUNDING)).all()


@given(st.integers(0, 10_000))
def test_position_velocity_and_acceleration_belong_together(arm, clear_of, seed):
    q0, *ways = random_ways(arm, seed)
    plan, h = plan_joints(arm, ways, q0), 1e-5
    t = clear_of(plan.spline.times, plan.duration)
    here, after, before = plan(t), plan(t + h), plan(t - h)
    # h^2/6 times a jerk of up to 65 rad/s^3; positions of some 6 rad x eps / h; acceleration is linear in between
    assert np.abs((after.position - before.position) / (2 * h) - here.velocity).max() < 2e-9
    assert np.abs((after.velocity - before.velocity) / (2 * h) - here.acceleration).max() < 2e-9
    # and nothing but jerk jumps where pieces meet
    ends = plan.spline.times
    for order, bound in ((0, 4e-9 * 4), (1, 4e-9 * 10), (2, 4e-9 * 100)):
        assert np.abs(plan.spline(ends + 1e-9, order) - plan.spline(ends - 1e-9, order)).max() < bound


@given(st.integers(0, 10_000))
def test_no_joint_overshoots_and_passing_is_no_slower_than_stopping(arm, seed):
    q0, *ways = random_ways(arm, seed)
    plan = plan_joints(arm, ways, q0)
    ends = [0.0, *times_of_visits(plan, ways)]
    corners = np.vstack([q0, ways])
    for k in range(len(ways)):
        q = plan(np.linspace(ends[k], ends[k + 1], 100)).position
        low, high = corners[k : k + 2].min(axis=0), corners[k : k + 2].max(axis=0)
        assert ((q >= low - 2 * ROUNDING) & (q <= high + 2 * ROUNDING)).all()
    assert plan.duration <= plan_joints(arm, ways, q0, stop=True).duration + 1e-9


def test_waypoints_on_a_line_are_passed_at_speed(reference):
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    ways = q0 + np.linspace(0, 1, 5)[1:, None] * np.array([0.5, 0.3, -0.4, 0.5, 0.2, -0.3, 1.0])
    plan, stopping = plan_joints(reference, ways, q0), plan_joints(reference, ways, q0, stop=True)
    for t in times_of_visits(plan, ways)[:-1]:
        assert np.abs(plan(t).velocity).max() > 0.5
    for t in times_of_visits(stopping, ways):
        assert np.abs(stopping(t).velocity).max() < 1e-11
    assert plan.duration < 0.7 * stopping.duration


def test_a_waypoint_twice_is_once(reference):
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    once = plan_joints(reference, [q0 + 0.1, q0 + 0.3], q0)
    twice = plan_joints(reference, [q0, q0 + 0.1, q0 + 0.1 + 1e-14, q0 + 0.3], q0)
    assert twice.duration == pytest.approx(once.duration, rel=1e-9)


def test_a_waypoint_out_of_the_limits_is_refused_by_joint_time_and_value(arm, q0):
    ways = np.array([q0 + 0.1, q0 + 0.2, q0])
    ways[1, 3] = arm.upper[3] + 0.05
    with pytest.raises(JointLimitError, match=f"joint '{arm.joint_names[3]}' would be at .* at t = ") as caught:
        plan_joints(arm, ways, q0)
    error = caught.value
    assert error.joint == arm.joint_names[3]
    assert error.value == pytest.approx(arm.upper[3] + 0.05, abs=1e-9)
    assert 0 < error.time < plan_joints(arm, ways[[0, 2]], q0).duration + 10


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"waypoints": np.zeros(7)}, r"waypoints: expected \(m, 7\)"),
        ({"waypoints": np.zeros((2, 6))}, r"waypoints: expected \(m, 7\)"),
        ({"waypoints": [["a"] * 7]}, "waypoints"),
        ({"waypoints": np.full((1, 7), np.nan)}, "waypoints"),
        ({"q0": np.zeros(3)}, "q0"),
        ({"velocity": 0.0}, "velocity: expected one or"),
        ({"velocity": np.ones(3)}, "velocity"),
        ({"acceleration": -1.0}, "acceleration"),
        ({"jerk": np.inf}, "jerk"),
        ({"waypoints": [np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])]}, "waypoints: expected one that differs"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(reference, change, words):
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    with pytest.raises(ValueError, match=words):
        plan_joints(reference, **{"waypoints": [q0 + 0.1], "q0": q0, **change})
