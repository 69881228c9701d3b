"""Piecewise polynomials: derivatives, extremes, time scaling."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin.paths.spline import Spline, joined, of_jerk, through


def random_spline(seed, degree=5, pieces=4, n=3):
    """Smooth: a polynomial of the degree, cut into pieces."""
    rng = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.5, pieces))])
    whole = [np.polynomial.Polynomial(rng.uniform(-1, 1, degree + 1)) for _ in range(n)]
    coefficients = np.array(
        [[[p.deriv(k)(t) / np.prod(range(1, k + 1)) for p in whole] for t in times[:-1]] for k in range(degree, -1, -1)]
    )
    return Spline(times, coefficients), whole


@given(st.integers(0, 1000))
def test_derivatives_are_those_of_the_polynomial(seed):
    spline, whole = random_spline(seed)
    t = np.random.default_rng(seed).uniform(0, spline.duration, 20)
    for order in range(4):
        expected = np.stack([(p.deriv(order) if order else p)(t) for p in whole], axis=-1)
        assert spline(t, order) == pytest.approx(expected, abs=1e-10)  # third derivatives up to some 100, x eps x terms


@given(st.integers(0, 1000))
def test_peaks_are_met_and_not_exceeded(seed):
    spline, _ = random_spline(seed)
    t = np.linspace(0, spline.duration, 1000)
    for order in (0, 1):
        lowest, highest = spline.peaks(order)
        values = spline(t, order)
        assert (values >= lowest.value - 1e-9).all()
        assert (values <= highest.value + 1e-9).all()
        for i in range(3):
            assert spline(lowest.time[i], order)[i] == pytest.approx(lowest.value[i], abs=1e-9)
            assert spline(highest.time[i], order)[i] == pytest.approx(highest.value[i], abs=1e-9)


@given(st.integers(0, 1000), st.floats(0.5, 20))
def test_slower_goes_the_same_way(seed, factor):
    spline, _ = random_spline(seed)
    slow, t = spline.slower(factor), np.linspace(0.01, 0.99, 17) * spline.duration
    assert slow.duration == pytest.approx(factor * spline.duration)
    for order in range(3):
        assert slow(factor * t, order) * factor**order == pytest.approx(spline(t, order), abs=1e-9)


def test_rests_before_and_after():
    spline, _ = random_spline(0)
    for t, end in ((-1.0, 0.0), (spline.duration + 1, spline.duration)):
        assert (spline(t) == spline(end)).all()
        assert not spline(t, 1).any()
        assert not spline(t, 2).any()


def test_single_times_equal_batches_and_pickles():
    spline, _ = random_spline(1)
    t = np.linspace(-0.1, spline.duration + 0.1, 12).reshape(3, 4)
    together = spline(t, 1)
    assert together.shape == (3, 4, 3)
    for index in np.ndindex(3, 4):
        assert (spline(float(t[index]), 1) == together[index]).all()
    assert (pickle.loads(pickle.dumps(spline))(t, 1) == together).all()


@given(st.integers(0, 1000))
def test_quintics_through_the_states_of_a_quintic_are_it(seed):
    spline, _ = random_spline(seed)
    states = [spline(spline.times, order) for order in range(3)]
    a = states[2]
    found = through(spline.times, states[0], states[1], a, a)
    t = np.linspace(0, spline.duration, 30)
    for order in range(3):
        # rounding of the states, 1e-15, over the cube of the shortest piece, 1e-3
        assert found(t, order) == pytest.approx(spline(t, order), abs=1e-10)


def test_a_jump_of_the_acceleration_is_kept():
    times, a = np.array([0.0, 1.0, 2.0]), np.array([[2.0], [-2.0], [-2.0]])
    before = np.array([[2.0], [2.0], [-2.0]])
    found = through(times, np.array([[0.0], [1.0], [2.0]]), np.array([[0.0], [2.0], [0.0]]), a, before)
    assert found(0.7) == pytest.approx([0.49])
    assert found(0.999999, 2) == pytest.approx([2.0], abs=1e-5)
    assert found(1.0, 2) == pytest.approx([-2.0])


def test_jerk_held_piece_by_piece():
    jerk = np.array([[1.0, -2.0], [0.0, 3.0]])
    spline = of_jerk(np.array([0.0, 0.5, 1.0]), jerk, np.array([1.0, 2.0]), np.array([0.1, 0.0]))
    assert spline(0.25, 3) == pytest.approx(jerk[0])
    assert spline(0.75, 3) == pytest.approx(jerk[1])
    assert spline(0.5, 2) == pytest.approx([0.5, -1.0])
    assert spline(0.5) == pytest.approx([1 + 0.05 + 1 / 48, 2 - 2 / 48])


def test_joined_runs_one_after_the_other():
    a, b = random_spline(2)[0], random_spline(3)[0]
    both = joined([a, b])
    assert both.duration == pytest.approx(a.duration + b.duration)
    assert both(0.3) == pytest.approx(a(0.3))
    assert both(a.duration + 0.3) == pytest.approx(b(0.3))
