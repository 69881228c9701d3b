"""The joint-space adaptive scheme: Lyapunov's argument for seven joints, the law traced, and the loop closed on four arms."""

from dataclasses import replace

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.arm.payload import Payload
from k1607_pin.compiled.trace import trace
from k1607_pin.control.adaptation import Gains, gain_rates, proportional_derivative
from k1607_pin.control.joint_space import JointAdaptive, gains_from_mass, joint_adaptive, model_from_mass
from k1607_pin.control.practice import Practice, adaptation_rates, relative_size
from k1607_pin.control.reference_model import reference_model
from k1607_pin.control.sampled import pd_growth
from k1607_pin.paths.inverse_path import joint_path
from k1607_pin.report import plots
from k1607_pin.report.cases import study_case
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.simulate import simulate

POSTURE = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
BETA = (3.0, 2.0)


@pytest.mark.parametrize("n", [7, 1, 6])
@pytest.mark.parametrize("seed", range(5))
def test_lyapunov_function_falls_as_63_says(n, seed):
    """M x'' + C x' + G x = tau with constant matrices and q_d = 0; V = z^T P z + sum tr(B_i^T M B_i) / beta_i."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    M, C, G = A @ A.T + np.eye(n), rng.normal(size=(n, n)), rng.normal(size=(n, n))
    half = rng.normal(size=(2 * n, 2 * n))
    model = reference_model(rng.uniform(1, 4, n), rng.uniform(2, 5, n), half @ half.T + np.eye(2 * n))
    gains = Gains(10 * np.eye(n) + rng.normal(size=(n, n)), 10 * np.eye(n) + rng.normal(size=(n, n)))
    z = rng.normal(size=2 * n)  # the error and its rate
    error, rate = z[:n], z[n:]
    acceleration = -np.linalg.solve(M, proportional_derivative(gains, error, rate) + C @ rate + G @ error)
    z_dot, rates = np.concatenate([rate, acceleration]), gain_rates(model.P_2, model.P_3, *BETA, error, rate)

    def at(s):
        moved, K_p, K_d = z + s * z_dot, gains.K_p + s * rates.K_p, gains.K_d + s * rates.K_d
        B_1 = np.linalg.solve(M, G + K_p) + model.Delta[n:, :n]
        B_2 = np.linalg.solve(M, C + K_d) + model.Delta[n:, n:]
        return moved @ model.P @ moved + np.trace(B_1.T @ M @ B_1) / BETA[0] + np.trace(B_2.T @ M @ B_2) / BETA[1]

    h = 1e-6
    v_dot = (at(h) - at(-h)) / (2 * h)
    assert v_dot == pytest.approx(-z @ model.Q @ z, abs=1e-9 * (1 + at(0)))


@pytest.mark.parametrize(
    "practice",
    [
        Practice(),
        Practice(sigma=0.1, gain_bound=0.05, dead_zone=0.01, torque_limit=np.full(7, 3.0)),
    ],
    ids=["report", "practice"],
)
def test_law_traced_equals_floats(practice):
    n, rng = 7, np.random.default_rng(12)
    half = rng.normal(size=(2 * n, 2 * n))
    model = reference_model(2 * np.ones(n), 3 * np.ones(n), half @ half.T + np.eye(2 * n))

    def law(q, v, q_d, v_d, K_p, K_d, K_p0, K_d0, other):
        step = joint_adaptive(
            q, v, q_d, v_d, Gains(K_p, K_d), model.P_2, model.P_3, 5.0, 7.0, 0.01, Gains(K_p0, K_d0), other, practice
        )
        return step.torque, step.gains.K_p, step.gains.K_d, step.error, step.error_rate, step.share + np.zeros(1)

    shapes = [(n,)] * 4 + [(n, n)] * 4 + [(n,)]
    traced = trace(law, "law", shapes)
    for _ in range(10):
        arguments = [rng.normal(size=shape) for shape in shapes]
        arguments[6:8] = [k @ k.T + np.eye(n) for k in arguments[6:8]]
        for a, b in zip(law(*arguments), traced(*(np.ravel(x) for x in arguments)), strict=True):
            assert np.abs(np.array(b).reshape(a.shape) - a).max() < 1e-12 * (1 + np.abs(a).max())


def test_no_error_means_no_torque_and_no_adaptation():
    model, gains, still = reference_model(np.ones(7), np.ones(7)), Gains(np.eye(7), np.eye(7)), np.zeros(7)
    step = joint_adaptive(POSTURE, still, POSTURE, still, gains, model.P_2, model.P_3, 1.0, 1.0, 0.01)
    assert (step.torque == 0).all()
    assert (step.gains.K_p == gains.K_p).all()


def closed(case, period, omega, share, practice=Practice(), duration=1.5, until=None):  # noqa: B008  # frozen
    """A run with the payload picked up and put down; with ``until`` only its beginning, before that."""
    arm = case.plant.arm
    path = joint_path(arm, case.law.path, case.q0, duration, case.law.rotation)
    gains, model = (
        gains_from_mass(arm, path.spline(path.spline.times[::10]), omega),
        model_from_mass(arm, case.q0, omega),
    )
    law = JointAdaptive(arm, path, gains, model, share[0] * omega**2, share[1] * omega**2, period, practice)
    payloads = [] if until else [(duration / 3, case.payload), (duration * 2 / 3, Payload(0.0))]
    return simulate(case.plant, law, case.q0, until or duration, None, period, period, runge_kutta_4, payloads=payloads)


@pytest.mark.parametrize("number", [1, 2])
def test_it_follows_the_study_cases_with_payload_steps(number):
    case = study_case(number, "recommended", control_period=0.002)
    log = closed(case, 0.002, 175.0, (3e5, 1e4))
    distance = np.linalg.norm(log.tool_position.values - case.law.path(log.time.values).position, axis=1)
    assert distance.max() < 7e-4  # m: what gravity leaves, with and without 10 lb
    # the path in joint space is the tool's: the logged error is the true one
    assert np.linalg.norm(log.error.values[:, :3], axis=1) == pytest.approx(distance, abs=1e-6)
    assert np.abs(log.error.values[:, 3:]).max() < 3e-3  # rad
    assert plots.position_errors(log).axes
    assert plots.gains(log).axes


@pytest.mark.parametrize("name", ["k1607", "panda", "ur5", "xarm7"])
def test_the_same_calls_run_any_arm(name):
    """Rates from what a payload does, the same for all: the payload's error shrinks, and the gains move as was asked for."""
    case = study_case(1, "recommended", None if name == "k1607" else k1607.load_example(name))
    arm, duration, period = case.plant.arm, 1.0, 0.001
    path = joint_path(arm, case.law.path, case.q0, duration, case.law.rotation)
    gains, model = (
        gains_from_mass(arm, path.spline(path.spline.times[::10]), 150.0),
        model_from_mass(arm, case.q0, 150.0),
    )
    load = arm.jacobian(case.q0)[:3].T @ np.array([0.0, 0.0, -9.81 * case.payload.mass])

    def run(rate):
        rates, practice = (
            adaptation_rates(gains, model, load, rate),
            Practice(gravity=True, torque_limit=arm.effort_limit),
        )
        law = JointAdaptive(arm, path, gains, model, *rates, period, practice)
        payloads = [(0.3, case.payload), (0.8, Payload(0.0))]
        return simulate(case.plant, law, case.q0, duration, None, period, period, runge_kutta_4, payloads=payloads)

    logs = run(0.0), run(10.0)
    fixed, adaptive = (np.linalg.norm(log.error.values[:, :3], axis=1) for log in logs)
    assert adaptive.max() < 0.3e-3  # m
    assert adaptive[700:800].mean() < 0.8 * fixed[700:800].mean()
    # half a second of a load that asks for 10/s, but less as the error shrinks
    assert 0.5 < relative_size(gains.K_p, logs[1].K_p.values[800] - gains.K_p) < 5.0


def test_one_arm_s_rates_run_another_s_gains_away():
    """Weight unknown to the law: with what the K-1607 bears, in proportion to K(0), the xArm7 is lost; not with its own.

    After 80 ms the gains have grown so that errors nearly double in every period that follows, whatever starts them. How far they
    throw the arm from there on is chaos; that they grow is the spectral radius of the sampled loop.
    """
    case = study_case(1, "recommended", k1607.load_example("xarm7"))
    arm, practice = case.plant.arm, Practice(torque_limit=case.plant.arm.effort_limit)
    gains, model = gains_from_mass(arm, case.q0, 150.0), model_from_mass(arm, case.q0, 150.0)
    own = np.array(adaptation_rates(gains, model, arm.gravity_torque(case.q0), 10.0)) / 150.0**2

    def run(rates, until=None):
        log = closed(case, 0.001, 150.0, rates, practice, 0.9, until)
        samples = zip(log.q.values[::10], log.K_p.values[::10], log.K_d.values[::10], strict=True)
        return log, np.array([pd_growth(arm.mass_matrix(q), Gains(*k), 0.001) for q, *k in samples])

    _, borrowed = run((5e4, 1e4), 0.08)
    assert borrowed[[0, -1]] == pytest.approx([0.897, 1.941], abs=1e-3)
    log, bearable = run(own)
    assert bearable.max() < 0.91
    assert np.abs(log.error[:, :3]).max() < 1e-3  # m
    borne = closed(study_case(1, "recommended", control_period=0.002), 0.002, 175.0, (5e4, 1e4))
    assert np.abs(borne.error[:, :3]).max() < 1e-3


def test_adaptation_makes_up_for_soft_gains():
    case = study_case(1, "recommended", control_period=0.002, gravity=0.0)
    rms = [
        np.sqrt((closed(case, 0.002, 4.0, share, duration=3.0).error.values[:, :3] ** 2).mean())
        for share in ((0.0, 0.0), (3e4, 3e3))
    ]
    assert rms[1] < 0.7 * rms[0]


def test_gravity_is_added_where_it_is_asked_for():
    arm = k1607.load_k1607()
    model, gains = reference_model(np.ones(7), np.ones(7)), Gains(np.eye(7), np.eye(7))
    still = joint_path(arm, lambda t: _at_rest(arm), POSTURE, 1.0)
    for gravity, torque in ((False, np.zeros(7)), (True, arm.gravity_torque(POSTURE))):
        law = JointAdaptive(arm, still, gains, model, 1.0, 1.0, 0.01, Practice(gravity=gravity))
        tau, _, _ = law.update(0.0, POSTURE, np.zeros(7), law.start(POSTURE, np.zeros(7), 1.0))
        assert tau == pytest.approx(torque, abs=1e-6)


def _at_rest(arm):
    from k1607_pin.paths.report_paths import PathPoint

    return PathPoint(arm.forward_kinematics(POSTURE).translation, np.zeros(3), np.zeros(3))


def test_gains_from_mass_answer_alike_and_the_lightest_posture_counts_most():
    arm = k1607.load_k1607()
    M, gains = arm.mass_matrix(POSTURE), gains_from_mass(arm, POSTURE, 3.0, 0.5)
    assert gains.K_p == pytest.approx(9 * M, rel=1e-9)
    assert gains.K_d == pytest.approx(3 * M, rel=1e-9)
    both = np.array([POSTURE, 0.5 * POSTURE])
    mean = np.mean([arm.mass_matrix(q) for q in both], axis=0)
    assert np.linalg.eigvalsh(mean - gains_from_mass(arm, both, 1.0).K_p)[0] > -1e-9


def test_model_from_mass_weighs_errors_by_inertia():
    arm = k1607.load_k1607()
    model, m = model_from_mass(arm, POSTURE, 5.0), np.diag(arm.mass_matrix(POSTURE))
    assert model.P_2 == pytest.approx(np.diag(m), rel=1e-9, abs=1e-9)
    assert model.P_3 == pytest.approx(np.diag(m) / 5, rel=1e-9, abs=1e-9)


GOOD = {
    "gains": Gains(np.eye(7), np.eye(7)),
    "model": reference_model(np.ones(7), np.ones(7)),
    "beta_1": 1.0,
    "beta_2": 1.0,
    "period": 0.01,
}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gains": Gains(np.eye(6), np.eye(7))}, "K_p"),
        ({"gains": Gains(np.eye(7), np.full((7, 7), np.nan))}, "K_d"),
        ({"model": reference_model(np.ones(6), np.ones(6))}, "model: expected one of 7 systems, got 6"),
        ({"beta_1": -1.0}, "beta_1"),
        ({"beta_2": np.nan}, "beta_2"),
        ({"period": 0.0}, "period"),
        ({"practice": Practice(torque_limit=np.ones(6))}, "torque_limit"),
        ({"practice": Practice(dead_zone=np.ones(6))}, "dead_zone"),
    ],
)
def test_a_controller_that_makes_no_sense_is_refused_when_it_is_made(changes, words):
    arm = k1607.load_k1607()
    path = joint_path(arm, lambda t: _at_rest(arm), POSTURE, 1.0)
    law = JointAdaptive(arm, path, **GOOD)
    with pytest.raises(ValueError, match=words):
        replace(law, **changes)


def test_a_path_of_the_tool_is_refused_at_the_start():
    arm = k1607.load_k1607()
    law = JointAdaptive(arm, lambda t: _at_rest(arm), **GOOD)
    with pytest.raises(ValueError, match=r"path\(0\)\.position: expected \(7,\) finite numbers"):
        simulate(arm, law, POSTURE, 1.0)
    with pytest.raises(ValueError, match=r"path: expected points with \.position, got tuple"):
        simulate(arm, replace(law, path=lambda t: (POSTURE, 0 * POSTURE)), POSTURE, 1.0)
