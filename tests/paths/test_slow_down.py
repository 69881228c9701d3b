"""Time scaling: as much as the joints' limits ask for, and not more."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import k1607_pin as k1607
from k1607_pin.paths.inverse_path import joint_path
from k1607_pin.paths.joint_plan import plan_joints
from k1607_pin.paths.report_paths import Circle
from k1607_pin.paths.slow_down import OverloadError, slow_down
from k1607_pin.report.cases import study_case


def largest(arm, plan, n=3000):
    """(velocity, torque), each as a share of its limit, at many instants."""
    t = np.linspace(0, plan.duration, n)
    q, v, a = plan(t)
    torque = np.array([arm.inverse_dynamics(*one) for one in zip(q, v, a, strict=True)])
    return (np.abs(v) / arm.velocity_limit).max(), (np.abs(torque) / arm.effort_limit).max()


def hasty(arm, q0, seed, factor):
    """A plan within reach of the arm's limits when ``factor`` is 1; above, faster than that."""
    rng = np.random.default_rng(seed)
    ways = q0 + rng.uniform(-0.3, 0.3, (3, arm.n))
    v = factor * arm.velocity_limit
    return plan_joints(arm, ways, q0, velocity=v, acceleration=4 * v, jerk=60 * v)


@given(st.integers(0, 1000), st.floats(0.5, 8))
def test_limits_hold_afterwards_and_would_not_one_percent_faster(arm, q0, seed, factor):
    plan = hasty(arm, q0, seed, factor)
    slowed = slow_down(arm, plan)
    velocity, torque = largest(arm, slowed.plan)
    # torques are looked at every 5 ms of the plan: in between they can be larger by h^2/8 of their second derivative
    assert velocity <= 1 + 1e-9
    assert torque <= 1.005
    assert slowed.plan.duration == pytest.approx(slowed.factor * plan.duration)
    if slowed.factor == 1:
        assert slowed.plan is plan
        assert slowed.reason == ""
    else:
        assert slowed.factor > 1
        assert max(largest(arm, plan.slower(0.99 * slowed.factor), 6000)) > 1.002
        assert "of joint" in slowed.reason


def test_torque_can_be_what_decides(arm, q0):
    plan = hasty(arm, q0, 3, 1.0)
    weak = (
        np.abs(arm.gravity_torque(q0)).max()
        + 1e-3
        + 0.5
        * max(
            np.abs(arm.inverse_dynamics(*one) - arm.gravity_torque(one[0])).max()
            for one in zip(*plan(np.linspace(0, plan.duration, 300)), strict=True)
        )
    )
    try:
        slowed = slow_down(arm, plan, effort=weak)
    except OverloadError:  # another posture of the way holds more by itself
        return
    if slowed.factor > 1:
        q, v, a = slowed.plan(np.linspace(0, slowed.plan.duration, 3000))
        torque = np.array([arm.inverse_dynamics(*one) for one in zip(q, v, a, strict=True)])
        assert np.abs(torque).max() <= 1.005 * weak
        assert slowed.reason.startswith("torque")


def test_torque_decides_for_a_panda_in_a_hurry():
    arm, q0 = k1607.load_example("panda"), np.array([0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.5])
    v = arm.velocity_limit
    plan = plan_joints(
        arm, [q0 + np.array([0.0, 1.0, 0.0, 0.8, 0.0, 0.0, 0.0])], q0, acceleration=20 * v, jerk=1000 * v
    )
    slowed = slow_down(arm, plan)
    assert slowed.factor > 1.05
    assert slowed.reason.startswith("torque of joint 'panda_joint")
    assert largest(arm, slowed.plan)[1] == pytest.approx(1, abs=0.005)
    assert largest(arm, plan.slower(0.99 * slowed.factor))[1] > 1.002


def test_velocity_decides_by_its_exact_peak(reference):
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    plan = plan_joints(reference, [q0 + 0.8], q0)
    slowed = slow_down(reference, plan, velocity=0.5)
    lowest, highest = slowed.plan.spline.peaks(1)
    assert np.maximum(-lowest.value, highest.value).max() == pytest.approx(0.5, rel=1e-12)
    assert slowed.reason.startswith("velocity")


def test_the_reports_circle_turned_too_fast_is_slowed_down():
    """Case 2's circle in a fifth of the time, its jumps of acceleration and all."""
    case = study_case(2, "recommended")
    arm, path = case.law.arm, case.law.path
    fast = Circle(path.height, path.radius, 5 * path.omega, 25 * path.beta, path.phi_0)
    plan = joint_path(arm, fast, case.q0, fast.times[-1], case.law.rotation)
    slowed = slow_down(arm, plan)
    assert slowed.factor > 1.5
    velocity, torque = largest(arm, slowed.plan, 10_000)
    assert velocity <= 1 + 1e-9
    assert torque <= 1.005
    assert slowed.plan.position_error == plan.position_error  # it is a joint path still


def test_limits_that_are_left_open_are_none(reference):
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    plan = plan_joints(reference, [q0 + 0.8], q0, velocity=100.0, acceleration=1e4, jerk=1e6)
    assert slow_down(reference, plan, velocity=np.inf, effort=0.0).factor == 1


def test_what_gravity_alone_exceeds_is_refused_by_joint_time_and_torque(reference):
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    plan = plan_joints(reference, [q0 + 0.3], q0)
    effort = reference.effort_limit
    effort[1] = 5.0
    with pytest.raises(OverloadError, match="joint 'joint2' would have to hold") as caught:
        slow_down(reference, plan, effort=effort)
    error = caught.value
    assert error.limit == 5
    assert abs(error.torque) >= 5
    assert reference.gravity_torque(plan(error.time).position)[1] == pytest.approx(error.torque)
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


@pytest.mark.parametrize(("name", "value"), [("velocity", np.ones(3)), ("effort", -1.0), ("velocity", np.nan)])
def test_limits_that_make_no_sense_are_refused(reference, name, value):
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    plan = plan_joints(reference, [q0 + 0.3], q0)
    with pytest.raises(ValueError, match=f"{name}: expected one or"):
        slow_down(reference, plan, **{name: value})
