"""The fastest motion within limits: against the textbook's, and at every limit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin.paths.timing import Limits, NoMotionError, fastest, straight


@given(st.floats(0.5, 5), st.floats(0.2, 2), st.floats(1, 5), st.floats(10, 50))
def test_one_coordinate_from_rest_to_rest_takes_the_known_time(distance, v, a, j):
    """d/v + v/a + a/j, where velocity and acceleration limits are both reached."""
    if distance < v * (v / a + a / j) or v < a * a / j:
        return
    found = fastest(np.zeros(1), np.array([distance]), np.zeros(1), np.zeros(1), Limits(v, a, j))
    assert found.duration == pytest.approx(distance / v + v / a + a / j, rel=1e-9)


@given(st.integers(0, 10_000))
def test_limits_hold_and_ends_are_met(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    v = rng.uniform(0.1, 4, n)
    limits = Limits(v, v * rng.uniform(1, 5, n), v * rng.uniform(10, 50, n))
    start, end = rng.uniform(-3, 3, (2, n))
    v_start, v_end = rng.uniform(0, 0.1, (2, n)) * np.abs(end - start).min() * np.sign(end - start) * v / v.max()
    try:
        found = fastest(start, end, v_start, v_end, limits)
    except NoMotionError:  # it would have to turn back, or is too fast already
        assert v_start.any()
        return
    assert found(0.0) == pytest.approx(start, abs=0)
    # sums of some 50 pieces in units of up to 10
    assert found(found.duration) == pytest.approx(end, abs=1e-11)
    assert found(found.duration, 1) == pytest.approx(v_end, abs=1e-11)
    assert found(found.duration, 2) == pytest.approx(np.zeros(n), abs=1e-9)
    for order, limit in ((1, limits.velocity), (2, limits.acceleration)):
        lowest, highest = found.peaks(order)
        assert (np.maximum(-lowest.value, highest.value) <= limit * (1 + 1e-9)).all()
    assert (np.abs(6 * found.coefficients[0]) <= limits.jerk * (1 + 1e-9)).all()


@given(st.integers(0, 1000))
def test_straight_is_straight_and_reaches_a_limit(seed):
    rng = np.random.default_rng(seed)
    start, end = rng.uniform(-3, 3, (2, 4))
    limits = Limits(rng.uniform(1, 2, 4), rng.uniform(2, 4, 4), 30.0)
    found = straight(start, end, limits)
    share = (found(np.linspace(0, found.duration, 50)) - start) / (end - start)
    assert np.abs(share - share[:, :1]).max() < 1e-14 / np.abs(end - start).min()
    assert (np.diff(share[:, 0]) >= -1e-12).all()
    assert found(found.duration) == pytest.approx(end, abs=1e-14)
    used = []
    for order, limit in ((1, limits.velocity), (2, limits.acceleration)):
        lowest, highest = found.peaks(order)
        used.append((np.maximum(-lowest.value, highest.value) / limit).max())
    used.append(np.abs(6 * found.coefficients[0]).max() / limits.jerk)
    assert max(used) == pytest.approx(1, rel=1e-9)
    assert found.duration >= fastest(start, end, np.zeros(4), np.zeros(4), limits).duration - 1e-9


def test_a_start_beyond_the_velocity_limit_is_refused():
    with pytest.raises(NoMotionError, match="no motion from"):
        fastest(np.zeros(1), np.ones(1), np.array([1.1]), np.zeros(1), Limits(1.0, 2.0, 20.0))
