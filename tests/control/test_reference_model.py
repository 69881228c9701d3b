"""(48)-(60): the model, its Lyapunov equation, and the report's own numbers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin import data
from k1607_pin.control.reference_model import reference_model


def test_the_report_s_design_gives_its_P():
    design = data.load("published")["design"]
    model = reference_model(design["delta_1"] * np.ones(6), design["delta_2"] * np.ones(6), design["Q"] * np.eye(12))
    assert model.P_2 == pytest.approx(design["P2"] * np.eye(6), abs=1e-14)
    assert model.P_3 == pytest.approx(design["P3"] * np.eye(6), abs=1e-14)
    assert sorted(set(np.round(np.linalg.eigvals(model.Delta).real, 9))) == [-2, -1]


@given(
    frequency=st.lists(st.floats(0.1, 30), min_size=1, max_size=6),
    damping=st.floats(0.05, 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_P_solves_the_lyapunov_equation_and_is_positive_definite(frequency, damping, seed):
    omega = np.array(frequency)
    A = np.random.default_rng(seed).normal(size=(2 * len(omega), 2 * len(omega)))
    model = reference_model(omega**2, 2 * damping * omega, A @ A.T + np.eye(len(A)))
    residual = model.P @ model.Delta + model.Delta.T @ model.P + model.Q
    assert np.abs(residual).max() < 1e-11 * np.abs(model.P).max() * np.abs(model.Delta).max()
    assert np.linalg.eigvalsh(model.P)[0] > 0


def test_response_follows_the_differential_equation():
    model = reference_model([2.0, 5.0], [3.0, 1.0])
    z, t, h = np.array([1.0, -1, 0.5, 2]), 0.7, 1e-5
    rate = (model.response(z, t + h) - model.response(z, t - h)) / (2 * h)
    assert rate == pytest.approx(model.Delta @ model.response(z, t), abs=1e-8)
    assert np.abs(model.response(z, 100.0)).max() < 1e-15


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([-1.0], [1.0]), "stable"),
        (([1.0], [0.0]), "stable"),
        (([1.0, 2.0], [1.0]), "Delta_2: expected"),
        (([np.nan], [1.0]), "Delta_1: expected finite"),
        (([1.0], [1.0], np.eye(3)), r"Q: expected \(2, 2\) finite numbers"),
        (([1.0], [1.0], -np.eye(2)), "positive definite"),
        (([1.0], [1.0], np.array([[1.0, 0.5], [0, 1]])), "symmetric"),
    ],
)
def test_bad_designs_are_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        reference_model(*arguments)
