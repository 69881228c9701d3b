"""The error system: batches, symbols and floats alike, rates that are derivatives, and a Lyapunov rate that adds up."""

import numpy as np
import pytest

from k1607_pin.compiled.trace import trace
from k1607_pin.control import error_system as es
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.reference_model import reference_model

SAMPLES = (3, 5)
ROUNDING = 1e-11  # values up to 1e3


def setting(seed=0, shape=SAMPLES):
    """Everything that `lyapunov_rate` takes, of no physical origin, for a batch of samples."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(12, 12))
    model = reference_model(rng.uniform(1, 4, 6), rng.uniform(2, 5, 6), A @ A.T + np.eye(12))
    E, z, w = rng.normal(size=(3, *shape, 12))
    u = rng.normal(size=(*shape, 18))
    root, *matrices = rng.normal(size=(10, *shape, 6, 6))
    Lambda = root @ root.swapaxes(-1, -2) + np.eye(6)
    return model, E, z, u, w, Lambda, matrices


def everything(E, z, u, w, Lambda, Phi, Gamma, K_p, K_d, Lambda_dot, Phi_dot, Gamma_dot, K_p_dot, K_d_dot, model):
    """All functions of the module, one after the other."""
    rates = Gains(K_p_dot, K_d_dot)
    B = es.error_system(Lambda, Phi, Gamma, K_p, K_d)
    exact = es.error_system_rates(Lambda, B, Lambda_dot, Phi_dot, Gamma_dot, rates)
    held = es.held_rates(Lambda, rates)
    Psi, Psi_rates = (es.weights(X, 3.0, 2.0, np.eye(6), 2 * np.eye(6)) for X in (Lambda, Lambda_dot))
    y = es.upsilon_of(model.P, E)
    v = es.lyapunov_function(E, B, model, Psi)
    rate = es.lyapunov_rate(E, z, u, B, exact, model, Psi, held, Psi_rates, w)
    return (
        *B, *exact, *held, *es.system_matrices(B), es.error_rate(E, z, u, B, model.Delta, w), y,
        *es.demanded_rates(y, z, u, Psi), *v, v.total, *rate, rate.driven, rate.total,
    )  # fmt: skip


def test_a_batch_equals_its_samples():
    model, *vectors, Lambda, matrices = setting()
    batch = everything(*vectors, Lambda, *matrices, model)
    for k in np.ndindex(SAMPLES):
        alone = everything(*(x[k] for x in (*vectors, Lambda, *matrices)), model)
        for together, single in zip(batch, alone, strict=True):
            assert together.shape == (*SAMPLES, *np.shape(single))
            assert np.abs(together[k] - single).max() < ROUNDING * (1 + np.abs(single).max())


def test_traced_equals_floats():
    model, *vectors, Lambda, matrices = setting(shape=())
    arguments = [*vectors, Lambda, *matrices]
    traced = trace(lambda *symbols: everything(*symbols, model), "all", [x.shape for x in arguments])
    floats = everything(*arguments, model)
    for symbol, number in zip(traced(*(x.ravel() for x in arguments)), floats, strict=True):
        assert np.abs(np.array(symbol).reshape(np.shape(number)) - number).max() < ROUNDING * (1 + np.abs(number).max())


def test_one_model_of_the_arm_serves_many_samples():
    """A constant Lambda broadcasts over a log of states."""
    model, E, z, u, _, Lambda, matrices = setting()
    B = es.error_system(Lambda[0, 0], *(x[0, 0] for x in matrices[:4]))
    Psi = es.weights(Lambda[0, 0], 3.0, 2.0, np.eye(6), np.eye(6))
    rate = es.lyapunov_rate(E, z, u, B, es.held_rates(Lambda[0, 0], Gains(matrices[4], matrices[5])), model, Psi)
    assert rate.total.shape == SAMPLES
    assert es.lyapunov_function(E, B, model, Psi).total.shape == SAMPLES
    assert es.error_rate(E, z, u, B, model.Delta).shape == (*SAMPLES, 12)


def test_rates_are_the_derivative_of_the_error_system():
    *_, Lambda, matrices = setting()
    Phi, Gamma, K_p, K_d, *dots = matrices
    step = 1e-30j
    moved = (x + step * x_dot for x, x_dot in zip((Lambda, Phi, Gamma, K_p, K_d), dots, strict=True))
    B = es.error_system(Lambda, Phi, Gamma, K_p, K_d)
    rates = es.error_system_rates(Lambda, B, *dots[:3], Gains(*dots[3:]))
    for ours, shifted in zip(rates, es.error_system(*moved), strict=True):
        expected = np.imag(shifted) / 1e-30
        assert np.abs(ours - expected).max() < ROUNDING * (1 + np.abs(expected).max())


def test_the_terms_add_up_to_the_derivative():
    """With everything moving, a disturbance included: v after a complex step along (55)."""
    model, E, z, u, w, Lambda, (Phi, Gamma, K_p, K_d, *dots) = setting(1)
    *_, total = everything(E, z, u, w, Lambda, Phi, Gamma, K_p, K_d, *dots, model)
    B = es.error_system(Lambda, Phi, Gamma, K_p, K_d)
    E_moved = E + 1e-30j * es.error_rate(E, z, u, B, model.Delta, w)
    Lambda, *rest = (x + 1e-30j * x_dot for x, x_dot in zip((Lambda, Phi, Gamma, K_p, K_d), dots, strict=True))
    # Psi_3 and Psi_4 move by themselves in `everything`: their rates are what `weights` was given for Lambda'
    Psi = es.weights(Lambda, 3.0, 2.0, np.eye(6) * (1 + 1e-30j), 2 * np.eye(6) * (1 + 1e-30j))
    v = es.lyapunov_function(E_moved, es.error_system(Lambda, *rest), model, Psi).total
    assert np.abs(total - np.imag(v) / 1e-30).max() < ROUNDING * (1 + np.abs(total).max())


def test_a_disturbance_acts_on_both_halves():
    model, E, z, u, w, Lambda, matrices = setting()
    B = es.error_system(Lambda, *matrices[:4])
    change = es.error_rate(E, z, u, B, model.Delta, w) - es.error_rate(E, z, u, B, model.Delta)
    assert change == pytest.approx(-w, abs=ROUNDING)


def test_terms_that_are_not_there_are_zero():
    model, E, z, u, _, Lambda, matrices = setting()
    B = es.error_system(Lambda, *matrices[:4])
    Psi = es.weights(Lambda, 3.0, 2.0, np.eye(6), np.eye(6))
    held = es.held_rates(Lambda, Gains(*matrices[4:6]))
    rate = es.lyapunov_rate(E, z, 0 * u, B, held, model, Psi)
    for term in (rate.driven, rate.disturbance, rate.variation, rate.weights):
        assert np.abs(term).max() == 0
