"""The report's Lyapunov function on the arm: its rate accounted for term by term, and falling where the premise holds."""

import logging

import numpy as np
import pinocchio as pin
import pytest

import k1607_pin as k1607
from k1607_pin.arm.payload import Payload
from k1607_pin.arm.wrench import Wrench
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.lyapunov import NEEDED, _disturbance, lyapunov
from k1607_pin.control.posture import hold
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.cartesian_plan import plan_poses
from k1607_pin.paths.report_paths import Line
from k1607_pin.paths.timing import Limits
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.observe import ObserveOperationalSpace
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.simulate import simulate

MODEL = reference_model(2 * np.ones(6), 3 * np.ones(6))  # section 7.2
POSTURES = {
    "k1607": np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10]),
    "ur5": np.array([0.3, -1.2, 1.4, -0.9, -1.2, 0.2]),
}
OBSERVE = ObserveOperationalSpace()


def run(arm, q0, *, period=0.001, duration=1.0, beta=1e6, omega=2**0.5, damping=1.5 / 2**0.5, offset=(0.02, -0.01, 0.01),
        extent=(0.0, 0.0, 0.0), payloads=(), posture=None):  # fmt: skip
    """By default: gains that give the reference model itself at the start, and a small error to start with."""
    start = arm.forward_kinematics(q0)
    law = CartesianAdaptive(
        arm, Line(start.translation + offset, np.array(extent)), start.rotation, gains_from_inertia(arm, q0, omega, damping),
        MODEL, beta, beta, period, posture,
    )  # fmt: skip
    log = simulate(arm, law, q0, duration, control_period=period, physics_step=period, step=runge_kutta_4,
                   payloads=payloads, observe=OBSERVE)  # fmt: skip
    return log, lyapunov(log, MODEL, beta, beta)


def load(name, gravity):
    g = (0.0, 0.0, -9.81 if gravity else 0.0)
    return (
        k1607.load_k1607(gravity=g)
        if name == "k1607"
        else k1607.load_example(name, armature=np.full(6, 0.1), gravity=g)
    )


@pytest.mark.parametrize("name", list(POSTURES))
@pytest.mark.parametrize("gravity", [False, True])
def test_rate_s_terms_add_up_to_what_v_does(name, gravity):
    """In motion along a line, gravity or not, seven joints or six, the null space held or not: measured rate against the sum
    of terms. The terms know no held torque and no sampling, so that the gap is first order in the period."""
    arm, q0 = load(name, gravity), POSTURES[name]

    def gap(period):
        posture = hold(q0, 5.0) if gravity else None
        _, v = run(
            arm,
            q0,
            period=period,
            duration=0.4,
            omega=10.0,
            damping=1.0,
            extent=(0.1, 0.2, 0.0),
            beta=1e4,
            posture=posture,
        )
        rate = v.v_rate.values
        apart = np.abs(v.v_rate_measured.values[:-1] - (rate[:-1] + rate[1:]) / 2)
        return apart.max() / np.abs(rate).max()

    coarse, fine = gap(0.002), gap(0.001)
    assert fine < 0.01
    assert coarse / fine > 1.6


@pytest.mark.parametrize("kind", ["friction", "limits", "push", "swing"])
def test_disturbances_are_in_the_account(kind):
    """Friction, motors at their limits, a push from outside, a swinging elbow."""
    arm, q0 = load("k1607", gravity=False), POSTURES["k1607"]
    start = arm.forward_kinematics(q0)
    plant = Plant(arm, viscous=np.full(7, 18.0 if kind == "friction" else 0.0),
                  torque_limit=np.full(7, 2.0 if kind == "limits" else np.inf))  # fmt: skip
    # an elbow that swings shows only where the gains are the model's, and the other terms small
    gains = gains_from_inertia(arm, q0, 2**0.5, 1.5 / 2**0.5) if kind == "swing" else gains_from_inertia(arm, q0, 10.0)
    extent = np.zeros(3) if kind == "swing" else np.array([0.1, 0.2, 0.0])
    law = CartesianAdaptive(arm, Line(start.translation, extent), start.rotation,
                            gains, MODEL, 1e4, 1e4, 0.001)  # fmt: skip
    push = Wrench(np.array([5.0, -3.0, 2.0])) if kind == "push" else None
    J = arm.jacobian(q0)
    v0 = 2.0 * (np.eye(7) - np.linalg.pinv(J) @ J)[0] if kind == "swing" else None
    log = simulate(plant, law, q0, 0.4, v0, 0.001, 0.001, runge_kutta_4, external=lambda t, q, v: push, observe=OBSERVE)
    v = lyapunov(log, MODEL, 1e4, 1e4)
    rate = v.v_rate.values
    apart = np.abs(v.v_rate_measured.values[:-1] - (rate[:-1] + rate[1:]) / 2)
    assert apart.max() < 0.02 * np.abs(rate).max()
    # and without the term it would not close
    assert np.abs(v.disturbance).max() > 5 * apart.max()


def test_the_account_closes_along_a_path_that_turns():
    """68 deg in a second; without the wanted angular velocity and acceleration it would not."""
    arm, q0 = load("k1607", gravity=False), POSTURES["k1607"]
    T = arm.forward_kinematics(q0)
    end = pin.SE3(T.rotation @ pin.exp3(np.deg2rad([20.0, 0, 65])), T.translation + np.array([0.0, 0.1, 0.05]))
    plan = plan_poses(arm, [end], q0, angular=Limits(2.0, 8.0, 80.0))
    law = CartesianAdaptive(arm, plan, None, gains_from_inertia(arm, q0, 10.0), MODEL, 1e4, 1e4, 0.001)
    log = simulate(arm, law, q0, 0.6, None, 0.001, 0.001, runge_kutta_4, observe=OBSERVE)

    def gap(log):
        v = lyapunov(log, MODEL, 1e4, 1e4)
        rate = v.v_rate.values
        return np.abs(v.v_rate_measured.values[:-1] - (rate[:-1] + rate[1:]) / 2).max() / np.abs(rate).max()

    assert gap(log) < 5e-4
    for name in ("wanted_angular_velocity", "wanted_angular_acceleration"):
        assert gap(log.assign({name: 0 * log[name]})) > 10 * gap(log)


def test_a_turned_tool_s_error_changes_by_more_than_its_rate():
    """2 delta s of a large error, differenced along the run, against x_e' and what the disturbance adds to it."""
    arm, q0 = load("k1607", gravity=False), POSTURES["k1607"]
    start = arm.forward_kinematics(q0)
    turned = pin.exp3(np.array([0.6, -0.3, 0.4])) @ start.rotation
    law = CartesianAdaptive(
        arm,
        Line(start.translation, np.array([0.1, 0.2, 0.0])),
        turned,
        gains_from_inertia(arm, q0, 10.0),
        MODEL,
        1.0,
        1.0,
        1e-3,
    )
    log = simulate(arm, law, q0, 0.3, None, 1e-3, 1e-3, runge_kutta_4, observe=OBSERVE)
    added = _disturbance({name: log[name].values for name in NEEDED})[:, 3:6]
    rate = np.diff(log.error.values[:, 3:], axis=0) / 1e-3
    expected = log.error_rate.values[:, 3:] + added
    middle = (expected[1:] + expected[:-1]) / 2
    assert np.abs(rate - middle).max() < 1e-4 * np.abs(rate).max()  # a trapezoid's T^2/12 of the third derivative
    assert np.abs(added).max() > 0.02 * np.abs(rate).max()


def test_premise_ratios_are_those_of_finite_differences():
    arm, q0 = load("k1607", gravity=False), POSTURES["k1607"]
    log, v = run(arm, q0, duration=0.5, omega=10.0, damping=1.0, extent=(0.1, 0.2, 0.0), beta=1e4)
    inverse = np.linalg.inv(log.Lambda.values)
    for name, gain, part in (("premise_66", "K_p", "Gamma"), ("premise_67", "K_d", "Phi")):
        B = inverse @ (log[part].values + log[gain].values)
        kept = inverse[1:-1] @ ((log[gain].values[2:] - log[gain].values[:-2]) / 0.002)
        rate = (B[2:] - B[:-2]) / 0.002
        ratio = np.linalg.norm(rate - kept, axis=(1, 2)) / np.linalg.norm(kept, axis=(1, 2))
        assert v[name].values[100:-1:50] == pytest.approx(ratio[99::50][: len(v[name].values[100:-1:50])], rel=0.05)
    change = np.linalg.norm(np.diff(log.Lambda.values, axis=0), axis=(1, 2)) / np.linalg.norm(
        log.Lambda.values[1:], axis=(1, 2)
    )
    assert v.change_of_Lambda.values[50:-1:50] == pytest.approx(
        change[50::50][: len(v.change_of_Lambda.values[50:-1:50])], rel=0.05
    )


def test_v_falls_where_the_premise_holds():
    """Weightless, at rest but for a small error, the gains' adaptation fast against the arm's changes."""
    arm = load("k1607", gravity=False)
    _, v = run(arm, POSTURES["k1607"], duration=4.0)
    assert v.premise_holds.all()
    assert (np.diff(v.v) < 0).all()
    share = v.v_rate_measured[:-1] / v.claimed[:-1]
    assert np.abs(share[:2000] - 1).max() < 0.02
    assert np.abs(v.gains).max() < 1e-12 * np.abs(v.claimed).max()  # the mended laws cancel these terms


def test_v_rises_where_slow_adaptation_lets_the_premise_fail_and_that_is_told(caplog):
    arm = load("k1607", gravity=False)
    with caplog.at_level(logging.WARNING):
        _, v = run(arm, POSTURES["k1607"], duration=2.0, beta=1e2)
    assert not v.premise_holds.all()
    assert (np.diff(v.v) > 0).any()
    assert "slow motion, (66)-(68), fails" in caplog.text
    first = float(v.time[int(np.argmin(v.premise_holds.values))])
    assert f"first at {first:.4g} s" in caplog.text


def test_at_a_change_of_payload_there_is_no_rate():
    arm = load("k1607", gravity=False)
    log, v = run(arm, POSTURES["k1607"], period=0.01, duration=0.3, payloads=[(0.1, Payload(4.5)), (0.2, Payload(0.0))])
    nowhere = np.isnan(v.v_rate.values)
    assert np.flatnonzero(nowhere).tolist() == [9, 10, 19, 20]
    assert not v.premise_holds.values[nowhere].any()
    assert np.isfinite(v.v).all()
    loaded = k1607.with_payload(arm, Payload(4.5)).operational_space(log.q.values[10], log.v.values[10])
    assert np.array_equal(log.Lambda.values[10], loaded.Lambda)


def test_runs_that_cannot_be_judged_are_refused():
    arm = load("k1607", gravity=False)
    log, _ = run(arm, POSTURES["k1607"], period=0.01, duration=0.1)
    with pytest.raises(ValueError, match="observe=ObserveOperationalSpace"):
        lyapunov(log.drop_vars("Lambda"), MODEL, 1.0, 1.0)
    with pytest.raises(ValueError, match="at least 3 samples"):
        lyapunov(log.isel(time=slice(0, 2)), MODEL, 1.0, 1.0)
    with pytest.raises(ValueError, match="beta_1: expected a positive number"):
        lyapunov(log, MODEL, 0.0, 1.0)


def test_a_singular_posture_is_logged_as_what_it_is():
    from k1607_pin.kinematics.differential import Damping

    arm = load("k1607", gravity=False)
    q, v = np.zeros(7), np.ones(7)
    there = OBSERVE(arm, q, v)
    assert there["sigma_min"] < 1e-12
    assert np.isnan(there["Lambda"]).all()
    damped = ObserveOperationalSpace(Damping(0.1, 0.05))(arm, q, v)
    assert np.isfinite(damped["Lambda"]).all()
