"""The adaptation: Lyapunov's argument on the linear system that it is made for, and the law traced."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled.trace import trace
from k1607_pin.control.adaptation import Gains, gain_rates, proportional_derivative, upsilon
from k1607_pin.control.cartesian import cartesian_adaptive
from k1607_pin.control.reference_model import reference_model

BETA = (3.0, 2.0)


def setting(seed):
    """A linear system Lambda x'' + Phi x' + Gamma x = F with constant matrices and x_d = 0, adapted from random gains."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, 6))
    Lambda, Phi, Gamma = A @ A.T + np.eye(6), rng.normal(size=(6, 6)), rng.normal(size=(6, 6))
    half = rng.normal(size=(12, 12))  # a full Q: its P_2 is not symmetric
    model = reference_model(rng.uniform(1, 4, 6), rng.uniform(2, 5, 6), half @ half.T + np.eye(12))
    gains = Gains(10 * np.eye(6) + rng.normal(size=(6, 6)), 10 * np.eye(6) + rng.normal(size=(6, 6)))
    return Lambda, Phi, Gamma, model, gains, rng.normal(size=12)


def lyapunov(z, gains, Lambda, Phi, Gamma, model):
    """(56) with E = -z, Psi_i = Lambda / beta_i: symmetric positive definite, so that the trace form measures."""
    B_1 = np.linalg.solve(Lambda, Gamma + gains.K_p) + model.Delta[6:, :6]
    B_2 = np.linalg.solve(Lambda, Phi + gains.K_d) + model.Delta[6:, 6:]
    return z @ model.P @ z + np.trace(B_1.T @ Lambda @ B_1) / BETA[0] + np.trace(B_2.T @ Lambda @ B_2) / BETA[1]


def flow(z, gains, Lambda, Phi, Gamma, model):
    """z' and the gains' rates of the adjustable system (44) without reference input, x_e = -x."""
    error, rate = z[:6], z[6:]
    force = proportional_derivative(gains, error, rate)
    acceleration = -np.linalg.solve(Lambda, force + Phi @ rate + Gamma @ error)
    return np.concatenate([rate, acceleration]), gain_rates(model.P_2, model.P_3, *BETA, error, rate)


@pytest.mark.parametrize("seed", range(10))
def test_lyapunov_function_falls_as_63_says(seed):
    Lambda, Phi, Gamma, model, gains, z = setting(seed)
    z_dot, rates = flow(z, gains, Lambda, Phi, Gamma, model)
    h = 1e-6

    def at(s):
        moved = Gains(gains.K_p + s * rates.K_p, gains.K_d + s * rates.K_d)
        return lyapunov(z + s * z_dot, moved, Lambda, Phi, Gamma, model)

    v_dot = (at(h) - at(-h)) / (2 * h)
    # v is quadratic in s: the difference is exact but for rounding, eps v / h
    assert v_dot == pytest.approx(-z @ model.Q @ z, abs=1e-9 * (1 + at(0)))


def test_the_printed_sign_of_74_would_not_fall():
    Lambda, Phi, Gamma, model, gains, z = setting(0)
    z_dot, rates = flow(z, gains, Lambda, Phi, Gamma, model)
    h = 1e-6

    def at(s):
        moved = Gains(gains.K_p - s * rates.K_p, gains.K_d - s * rates.K_d)  # beta Upsilon x_e^T, no minus sign
        return lyapunov(z + s * z_dot, moved, Lambda, Phi, Gamma, model)

    assert abs((at(h) - at(-h)) / (2 * h) + z @ model.Q @ z) > 1.0


def test_58_is_the_lower_half_of_P_E():
    *_, model, _, z = setting(3)
    P = np.block([[model.P[:6, :6], model.P_2], [model.P_2.T, model.P_3]])
    assert np.allclose(P, model.P)
    assert upsilon(model.P_2, model.P_3, z[:6], z[6:]) == pytest.approx(-(model.P @ z)[6:], abs=1e-12)


def test_cartesian_law_traced_equals_floats(arm):
    rng = np.random.default_rng(58)
    model = reference_model(2 * np.ones(6), 3 * np.ones(6))

    def law(p, R, J, v, p_d, R_d, v_d, K_p, K_d):
        step = cartesian_adaptive(p, R, J, v, p_d, R_d, v_d, Gains(K_p, K_d), model.P_2, model.P_3, 5.0, 7.0, 0.01)
        return step.torque, step.gains.K_p, step.gains.K_d, step.error, step.error_rate

    shapes = [(3,), (3, 3), (6, arm.n), (arm.n,), (3,), (3, 3), (6,), (6, 6), (6, 6)]
    traced = trace(law, "law", shapes)
    for _ in range(10):
        here, there = (arm.forward_kinematics(arm.random_configuration(rng)) for _ in range(2))
        q, v = arm.random_configuration(rng), rng.normal(size=arm.n)
        K_p, K_d, v_d = rng.normal(size=(6, 6)), rng.normal(size=(6, 6)), rng.normal(size=6)
        arguments = [
            here.translation,
            here.rotation,
            arm.jacobian(q),
            v,
            there.translation,
            there.rotation,
            v_d,
            K_p,
            K_d,
        ]
        floats = law(*arguments)
        symbols = traced(*(np.ravel(a) for a in arguments))
        for a, b in zip(floats, symbols, strict=True):
            assert np.abs(np.array(b).reshape(a.shape) - a).max() < 1e-12 * (1 + np.abs(a).max())


def test_no_error_means_no_torque_and_no_adaptation():
    arm = k1607.load_k1607()
    q = np.deg2rad([20, -30, 10, 80, 0, 60, 0])
    T, gains = arm.forward_kinematics(q), Gains(np.eye(6), np.eye(6))
    model = reference_model(2 * np.ones(6), 3 * np.ones(6))
    pose = (T.translation, T.rotation)
    step = cartesian_adaptive(
        *pose, arm.jacobian(q), np.zeros(7), *pose, np.zeros(6), gains, model.P_2, model.P_3, 1.0, 1.0, 0.01
    )
    assert np.abs(step.torque).max() < 1e-14
    assert step.gains.K_p == pytest.approx(gains.K_p, abs=1e-15)
