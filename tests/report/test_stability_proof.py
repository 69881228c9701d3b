"""What is wrong with section 7's signs and argument, shown by numbers: each test is one sentence of docs/errata.md."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import k1607_pin as k1607
from k1607_pin.arm.payload import Payload, with_payload
from k1607_pin.control import error_system
from k1607_pin.control.adaptation import Gains, adapted, gain_rates, proportional_derivative
from k1607_pin.control.pose import pose_error
from k1607_pin.description.units import POUND
from k1607_pin.paths.report_paths import Line
from k1607_pin.report import equations_stability, polynomials_error_system, sample_loops, sample_motion
from k1607_pin.report.equations import check_all
from k1607_pin.report.sample_loops import (
    BETA,
    Loops,
    adapted_rates,
    claimed,
    design,
    general,
    law_weights,
    loops,
    lyapunov_slope,
    system,
    upsilon,
    z_dot,
)

H = 1e-5


def norm(X):
    return np.linalg.norm(X, axis=(-2, -1))


# Signs


def test_with_the_printed_72_and_73_v_is_indefinite():
    """Zero error, gains off the model's: v is negative; errors alone: positive."""
    Psi = law_weights(0.0)
    printed = Psi._replace(Psi_1=-Psi.Psi_1, Psi_2=-Psi.Psi_2)
    at_rest = error_system.lyapunov_function(0 * loops().z, system(), design(), printed)
    assert (at_rest.total < 0).all()
    assert (at_rest.state + error_system.lyapunov_function(-loops().z, system(), design(), printed).state > 0).all()
    assert (error_system.lyapunov_function(-loops().z, system(), design(), Psi).total > 0).all()


def test_the_two_printed_signs_hide_each_other():
    """-Lambda / beta with +beta Upsilon x_e^T gives -E^T Q E again: both wrong look right."""
    s, Psi = loops(), law_weights()
    printed = Psi._replace(Psi_1=-Psi.Psi_1, Psi_2=-Psi.Psi_2)
    rates = Gains(*(-K_dot for K_dot in adapted_rates(design())))
    slope = lyapunov_slope(design(), s.gains, rates, printed, 0 * s.u)
    assert np.abs(slope - claimed(design())).max() < sample_loops.ROUNDING


def one_loop(beta, sign, duration=20.0):
    """x_e over time of one linear loop, too soft to be stable without adaptation, the law's sign as given."""
    rng = np.random.default_rng(74)
    A = rng.normal(size=(6, 6))
    Lambda, Phi, Gamma = A @ A.T + np.eye(6), np.zeros((6, 6)), -np.eye(6)

    def flow(_, state):
        z, gains = state[:12], Gains(*state[12:].reshape(2, 6, 6))
        rates = gain_rates(design().P_2, design().P_3, beta, beta, z[:6], z[6:])
        rate = z_dot(z, np.zeros(18), Lambda, Phi, Gamma, gains)
        return np.concatenate([rate, sign * rates.K_p.ravel(), sign * rates.K_d.ravel()])

    start = np.concatenate([rng.normal(size=12), 0.5 * np.eye(6).ravel(), 0.5 * np.eye(6).ravel()])
    run = solve_ivp(flow, (0, duration), start, rtol=1e-8, atol=1e-8, events=_runaway)
    return run, Lambda, Gamma


def _runaway(_, state):
    return 1e3 - np.abs(state[:12]).max()


_runaway.terminal = True


def test_with_the_printed_74_and_75_the_error_runs_away_and_with_the_mended_ones_it_dies_out():
    wrong, *_ = one_loop(100.0, sign=-1.0)
    assert wrong.status == 1  # past 1000 times its start, and stopped
    right, *_ = one_loop(100.0, sign=+1.0, duration=60.0)
    assert right.status == 0
    assert np.abs(right.y[:12, -1]).max() < 0.01 * np.abs(right.y[:12, 0]).max()


def test_gains_need_not_settle_at_the_model_s():
    """v' <= 0 only: the error is gone, B_1 is not Delta_1."""
    run, Lambda, Gamma = one_loop(100.0, sign=+1.0, duration=60.0)
    B_1 = np.linalg.solve(Lambda, Gamma + run.y[12:48, -1].reshape(6, 6))
    assert np.abs(B_1 + design().Delta[6:, :6]).max() > 0.1


def test_58_s_halves_contradict_each_other():
    z, P = loops().z, general().P
    lower = -z @ P[:, 6:]  # of P E
    assert np.abs(z @ P[:, 6:] + upsilon(general())).max() < 1e-12  # [P_2^T P_3] z is its negative
    assert np.abs(lower - upsilon(general())).max() == 0


def test_with_a_full_Q_the_law_needs_P_2_transposed():
    s, model = loops(), general()
    rows = [gain_rates(model.P_2.T, model.P_3, *BETA, z[:6], z[6:]) for z in s.z]  # P_2 itself, as printed
    as_printed = Gains(np.array([r.K_p for r in rows]), np.array([r.K_d for r in rows]))
    gaps = [
        np.abs(lyapunov_slope(model, s.gains, rates, law_weights(), 0 * s.u) - claimed(model)).max()
        for rates in (as_printed, adapted_rates(model))
    ]
    assert gaps[0] > 1
    assert gaps[1] < sample_loops.ROUNDING


# The argument


def test_57_lacks_the_term_of_the_wanted_acceleration_and_no_other():
    (checked,) = check_all([57])
    dropped = 2 * (upsilon(general()) * loops().u[:, 12:]).sum(-1)
    assert checked.printed_residual == pytest.approx(np.abs(dropped).max(), rel=1e-12)


def test_what_63_leaves_out_has_either_sign_and_wins_near_the_goal():
    """Linear in the error, where -E^T Q E is quadratic."""
    s, still, rises = loops(), error_system.held_rates(loops().Lambda, Gains(np.zeros((6, 6)), np.zeros((6, 6)))), []
    for share in (1.0, 0.1, 0.01, 0.001):
        z = share * s.z
        rate = error_system.lyapunov_rate(-z, z, s.u, system(), still, design(), law_weights())
        assert 0.4 < (rate.driven > 0).mean() < 0.6
        rises.append((rate.claimed + rate.driven > 0).mean())
    assert rises == sorted(rises)
    assert rises[-1] > 0.4


def test_large_Psi_3_and_Psi_4_change_v_and_not_its_rate():
    """(71): over twelve decades."""
    s, rates = loops(), adapted_rates(design())
    slopes, values = [], []
    for size in (1e-3, 1.0, 1e9):
        slopes.append(lyapunov_slope(design(), s.gains, rates, law_weights(size), s.u))
        values.append(error_system.lyapunov_function(-s.z, system(), design(), law_weights(size)).total)
    assert np.abs(np.diff(slopes, axis=0)).max() < sample_loops.ROUNDING
    assert (values[2] > 1e9).all()


def test_v_does_not_vanish_at_the_goal():
    """(56): no error, gains at the model's, and v still as large as B_3 and B_4 make it."""
    s, Delta = loops(), design().Delta
    gains = Gains(-s.Lambda @ Delta[6:, :6] - s.Gamma, -s.Lambda @ Delta[6:, 6:] - s.Phi)
    v = error_system.lyapunov_function(0 * s.z, system(gains), design(), law_weights())
    assert np.abs(v.state + v.B_1 + v.B_2).max() < 1e-10
    assert (v.total > 0.1).all()


def test_orientation_errors_do_not_change_at_the_rate_that_43_takes():
    """(41), (43): off by the product of error and angular velocity; half the error, half the gap."""
    w, w_d = np.array([0.3, -0.5, 0.8]), np.array([0.5, -0.4, 0.2])  # rad/s
    still, gaps = np.zeros(3), []
    for size in (0.2, 0.1, 0.05):
        R = pin.exp3(np.array([0.4, -1.0, 0.7]))
        R_d = pin.exp3(size * np.array([0.6, 0.0, 0.8])) @ R

        def error(t, R=R, R_d=R_d):
            return pose_error(still, pin.exp3(t * w) @ R, still, pin.exp3(t * w_d) @ R_d)[3:]

        gaps.append(np.linalg.norm((error(H) - error(-H)) / (2 * H) - (w_d - w)))
    assert 0.01 < gaps[2] < 0.05
    assert gaps[0] / gaps[1] == pytest.approx(2, rel=0.1)
    assert gaps[1] / gaps[2] == pytest.approx(2, rel=0.1)


def test_slow_against_a_sampling_period_is_not_slow_against_the_gains():
    """(66): Lambda changes by less than 4 % in any 10 ms; yet what is neglected is more than what is kept."""
    m, ((Lambda, _, _), (Lambda_dot, _, _)) = sample_motion.motion(), sample_motion.arm_matrices()
    assert (norm(Lambda_dot) * 0.010 / norm(Lambda)).max() < 0.04
    assert check_all([66])[0].printed_residual > 1
    assert (np.abs(m.v).max() < 5) & (np.abs(m.z[:, :3]).max() < 0.1)  # rad/s, m


def test_lambda_dot_is_phi_and_its_transpose():
    """Lambda' - 2 Phi skew: the differences that (66)-(68) are judged by are right."""
    (_, Phi, _), (Lambda_dot, _, _) = sample_motion.arm_matrices()
    assert norm(Lambda_dot - Phi - Phi.swapaxes(-1, -2)).max() < 1e-7 * norm(Lambda_dot).max()


def test_a_payload_s_step_is_no_slow_variation():
    """Section 7.2's 10 lb change Lambda at once; the tool's frame is where they sit."""
    arm = k1607.load_k1607()
    before, after = (
        a.operational_space(sample_motion.POSTURE, np.zeros(7)).Lambda
        for a in (arm, with_payload(arm, Payload(10 * POUND)))
    )
    assert norm(after - before) / norm(before) == pytest.approx(0.12, abs=0.01)


def on_the_arm(model=None):
    """(T,) terms of v' along the motion, and v' itself by central differences of (56)."""
    arm, m, model = k1607.load_k1607(), sample_motion.motion(), model or design()
    matrices, rates = sample_motion.arm_matrices()
    start = arm.forward_kinematics(sample_motion.POSTURE)
    line, beta = Line(start.translation), sample_motion.ARM_BETA
    zero = np.zeros((6, 6))

    def v(shift):
        q, speed = m.q + shift * m.v + shift**2 / 2 * m.a, m.v + shift * m.a
        gains = Gains(*(K + shift * K_dot for K, K_dot in zip(m.gains, m.gain_rates, strict=True)))
        z, moved = [], []
        for t, angles, rate in zip(m.time + shift, q, speed, strict=True):
            T, wanted = arm.forward_kinematics(angles), line(t)
            v_e = np.concatenate([wanted.velocity, np.zeros(3)]) - arm.jacobian(angles) @ rate
            z.append(np.concatenate([pose_error(T.translation, T.rotation, wanted.position, start.rotation), v_e]))
            space = sample_motion.space(arm, angles, rate)
            moved.append([space.Lambda, space.Phi, space.Gamma])
        Lambda, Phi, Gamma = np.array(moved).swapaxes(0, 1)
        B = error_system.error_system(Lambda, Phi, Gamma, *gains)
        return error_system.lyapunov_function(
            -np.array(z), B, model, error_system.weights(Lambda, beta, beta, zero, zero)
        ).total

    B = error_system.error_system(*matrices, *m.gains)
    Psi, Psi_rates = (error_system.weights(X, beta, beta, zero, zero) for X in (matrices[0], rates[0]))
    poses = np.array([sample_motion.pose(arm, q) for q in m.q])
    u = np.concatenate([poses + m.z[:, :6], m.wanted], axis=1)  # x_d = x + x_e
    spaces = [sample_motion.space(arm, q, speed) for q, speed in zip(m.q, m.v, strict=True)]
    null_space = [np.linalg.solve(s.Lambda, s.bias_nullspace) for s in spaces]
    # The rate of 2 delta s is eta (w_d - w) + (w_d + w) x delta s, from the quaternion's own kinematics
    w_e, w_sum, s = m.z[:, 9:], 2 * m.wanted[:, 3:6] - m.z[:, 9:], m.z[:, 3:6] / 2
    turning = (np.sqrt(1 - (s * s).sum(1, keepdims=True)) - 1) * w_e + np.cross(w_sum, s)
    w = np.concatenate([np.zeros((len(u), 3)), turning, null_space], axis=1)
    exact = error_system.error_system_rates(matrices[0], B, *rates, m.gain_rates)
    held = error_system.held_rates(matrices[0], m.gain_rates)
    terms = error_system.lyapunov_rate(-m.z, m.z, u, B, exact, model, Psi, held, Psi_rates, w)
    return terms, (v(H) - v(-H)) / (2 * H)


def test_on_the_arm_v_changes_as_the_terms_add_up_and_not_as_63_claims():
    terms, measured = on_the_arm()
    assert terms.total == pytest.approx(measured, rel=1e-5, abs=1e-5)
    assert np.abs(terms.gains).max() < 1e-8  # the law does what it is for
    assert (np.abs(measured - terms.claimed) > 10 * np.abs(terms.claimed)).mean() > 0.5
    assert (measured > 0).mean() > 0.5  # v rises, mostly


def test_null_space_and_orientation_are_part_of_it():
    """Leave the disturbance out, and the sum misses."""
    terms, measured = on_the_arm()
    assert np.abs(terms.total - terms.disturbance - measured).max() > 0.01


def test_gains_adapted_by_samples_can_lose_what_continuous_time_keeps():
    """(76)-(77): the same linear loop and rates; with 10 ms between samples and a large beta it runs away."""
    rng = np.random.default_rng(76)
    A = rng.normal(size=(6, 6))
    Lambda, z = 0.1 * (A @ A.T + np.eye(6)), rng.normal(size=12)
    beta, period = 3e4, 0.01

    def continuous(_, state):
        gains = Gains(*state[12:].reshape(2, 6, 6))
        rates = gain_rates(design().P_2, design().P_3, beta, beta, state[:6], state[6:12])
        rate = z_dot(state[:12], np.zeros(18), Lambda, 0 * Lambda, 0 * Lambda, gains)
        return np.concatenate([rate, rates.K_p.ravel(), rates.K_d.ravel()])

    start = np.concatenate([z, np.eye(6).ravel(), np.eye(6).ravel()])
    end = solve_ivp(continuous, (0, 5), start, "LSODA", rtol=1e-6, atol=1e-9).y[:12, -1]
    assert np.abs(end).max() < np.abs(z).max()

    gains = Gains(np.eye(6), np.eye(6))
    for _ in range(500):
        force = proportional_derivative(gains, z[:6], z[6:])
        rates = gain_rates(design().P_2, design().P_3, beta, beta, z[:6], z[6:])
        gains, a = adapted(gains, rates, period), -np.linalg.solve(Lambda, force)
        z = np.concatenate([z[:6] + period * z[6:] + period**2 / 2 * a, z[6:] + period * a])  # exact for a held force
        if np.abs(z).max() > 1e6:
            break
    assert np.abs(z).max() > 1e6


def test_under_a_constant_load_the_gains_grow_for_ever():
    """(76): an error that a load F keeps at F / K_p makes K_p' = beta P_2 (F / K_p)^2, so that K_p grows as t^(1/3)."""
    times = np.array([20.0, 160.0, 1280.0])
    identity = np.eye(6)
    u = np.concatenate([np.ones(6), np.zeros(12)])  # Gamma x_d is the load

    def flow(_, state):
        gains = Gains(*state[12:].reshape(2, 6, 6))
        rates = gain_rates(design().P_2, design().P_3, 1.0, 1.0, state[:6], state[6:12])
        rate = z_dot(state[:12], u, identity, 0 * identity, identity, gains)
        return np.concatenate([rate, rates.K_p.ravel(), rates.K_d.ravel()])

    start = np.concatenate([np.zeros(12), identity.ravel(), 3 * identity.ravel()])
    run = solve_ivp(flow, (0, times[-1]), start, "RK45", times, rtol=1e-5, atol=1e-8)
    along = run.y[12:48].reshape(6, 6, -1).sum((0, 1)) / 6  # of (1, ..., 1), the load's direction
    assert along[1] / along[0] == pytest.approx(2, rel=0.2)
    assert along[2] / along[1] == pytest.approx(2, rel=0.1)


# The checks themselves


def test_a_wrong_sign_in_the_rate_would_be_noticed(monkeypatch):
    """Turn Upsilon in the code that is proved: the exact proof and the numbers must see it."""
    right = error_system.upsilon_of
    monkeypatch.setattr(error_system, "upsilon_of", lambda P, E: -right(P, E))
    (checked,) = check_all([57])
    assert checked.verdict == "fails"
    assert checked.exact is False
    assert checked.residual > 1


def test_a_second_zero_block_would_be_noticed(monkeypatch):
    right = error_system.system_matrices

    def printed(B):
        A, B_u = right(B)
        A = A.copy()
        A[..., :6, 6:] = 0
        return A, B_u

    monkeypatch.setattr(error_system, "system_matrices", printed)
    assert not polynomials_error_system.state_space_is_exact()
    assert {c.verdict for c in check_all([44, 54, 55])} == {"fails"}


def test_the_samples_are_what_they_say():
    s = loops()
    assert isinstance(s, Loops)
    assert np.linalg.eigvalsh(s.Lambda).min() > 0
    assert np.abs(general().P_2 - general().P_2.T).max() > 0.1
    assert np.abs(equations_stability.upsilon(design()) + 0.25 * (s.z[:, :6] + s.z[:, 6:])).max() < 1e-13  # section 7.2
