"""Joint angles along a path: exact, least motion, within limits, or refused with the place."""

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import k1607_pin as k1607
from k1607_pin.arm.reach import UnreachableError
from k1607_pin.paths.cartesian_plan import PosePoint
from k1607_pin.paths.follower import MARGIN, SingularPathError, TooFewJointsError
from k1607_pin.paths.inverse_path import joint_path
from k1607_pin.paths.joint_plan import JointLimitError, plan_joints
from k1607_pin.paths.report_paths import Circle, Line, PathPoint
from k1607_pin.report.cases import study_case


def tool_errors(arm, path, rotation, found, n=300):
    """Largest deviations at random times: position [m] and orientation [rad], velocity, acceleration of the tool."""
    times = np.random.default_rng(1).uniform(0, found.duration, n)
    worst = np.zeros(4)
    for t in times:
        wanted, (q, v, a) = path(t), found(t)
        T, J = arm.forward_kinematics(q), arm.jacobian(q)
        R = getattr(wanted, "rotation", rotation)
        x_dot = np.append(wanted.velocity, getattr(wanted, "angular_velocity", np.zeros(3)))
        x_ddot = np.append(wanted.acceleration, getattr(wanted, "angular_acceleration", np.zeros(3)))
        errors = (
            T.translation - wanted.position,
            pin.log3(R @ T.rotation.T),
            J @ v - x_dot,
            J @ a + arm.jacobian_time_variation(q, v) @ v - x_ddot,
        )
        worst = np.maximum(worst, [np.linalg.norm(error) for error in errors])
    return worst


@pytest.mark.parametrize("number", [1, 2])
def test_between_samples_the_tool_keeps_to_the_reports_paths(number):
    """Line and circle, sampled at 10 ms as the report's simulations are; both start with a jolt, and the circle has two more."""
    case = study_case(number, "recommended")
    arm, path, rotation = case.law.arm, case.law.path, case.law.rotation
    found = joint_path(arm, path, case.q0, case.duration, rotation)
    assert len(found.spline.times) == round(case.duration / 0.01) + 1
    position, orientation, velocity, acceleration = tool_errors(arm, path, rotation, found, 1000)
    # quintics: h^6/46080 times sixth derivatives of up to some 1e5 rad/s^6
    assert position < 1e-8
    assert orientation < 1e-8
    assert velocity < 1e-5
    assert acceleration < 1e-2  # rounded off next to a jump of 0.4 m/s^2, over nanoseconds that no sample lies in
    assert found.position_error < 1e-8
    assert found(0.0).position == pytest.approx(case.q0, abs=1e-9)
    assert found.sigma_min.min() > 0.1


def test_samples_are_exact_in_position_velocity_and_acceleration(arm, q0):
    start = arm.forward_kinematics(q0)
    path = Line(start.translation, np.array([0.05, 0.1, 0.0]))
    found = joint_path(arm, path, q0, 2.0, period=0.05)
    assert (found(0.0).position == q0).all()
    for t in found.spline.times[:-1]:
        wanted, (q, v, a) = path(t), found(t)
        T, J = arm.forward_kinematics(q), arm.jacobian(q)
        assert np.abs(T.translation - wanted.position).max() < 1e-11
        assert np.abs(T.rotation - start.rotation).max() < 1e-11
        assert np.abs(J @ v - np.append(wanted.velocity, np.zeros(3))).max() < 1e-11
        x_ddot = J @ a + arm.jacobian_time_variation(q, v) @ v
        assert np.abs(x_ddot - np.append(wanted.acceleration, np.zeros(3))).max() < 1e-8  # taken 1e-9 s later


def test_position_velocity_and_acceleration_belong_together(arm, q0, clear_of):
    start = arm.forward_kinematics(q0)
    found = joint_path(arm, Line(start.translation, np.array([0.05, 0.1, 0.0])), q0, 2.0)
    t, h = clear_of(found.spline.times, found.duration), 1e-5
    here, after, before = found(t), found(t + h), found(t - h)
    assert np.abs((after.position - before.position) / (2 * h) - here.velocity).max() < 2e-9
    assert np.abs((after.velocity - before.velocity) / (2 * h) - here.acceleration).max() < 2e-9
    ends = found.spline.times[1:-1]
    for order, bound in ((0, 1e-8), (1, 1e-8), (2, 1e-7)):  # 2e-9 s apart
        assert np.abs(found.spline(ends + 1e-9, order) - found.spline(ends - 1e-9, order)).max() < bound


def test_joint_motion_is_the_least_there_is_in_mid_range(arm, q0):
    start = arm.forward_kinematics(q0)
    path = Line(start.translation, np.array([0.05, 0.1, 0.0]))
    found = joint_path(arm, path, q0, 2.0)
    room = np.minimum(found.spline(found.spline.times) - arm.lower, arm.upper - found.spline(found.spline.times))
    assert (room > MARGIN * (arm.upper - arm.lower)).all()
    for t in found.spline.times[::20]:
        q, v, _ = found(t)
        least = np.linalg.pinv(arm.jacobian(q)) @ np.append(path(t).velocity, np.zeros(3))
        assert v == pytest.approx(least, abs=1e-10)


@given(st.integers(0, 30))
@settings(max_examples=8)
def test_speed_does_not_change_the_way(seed):
    arm, rng = k1607.load_k1607(), np.random.default_rng(seed)
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    path = Line(arm.forward_kinematics(q0).translation, rng.uniform(-0.1, 0.1, 3))
    slow = Line(path.start, path.extent, path.rate / 3)
    once, thrice = joint_path(arm, path, q0, 1.0), joint_path(arm, slow, q0, 3.0)
    t = np.linspace(0, 1, 40)
    assert thrice(3 * t).position == pytest.approx(once(t).position, abs=1e-8)
    assert 3 * thrice(3 * t).velocity == pytest.approx(once(t).velocity, abs=1e-7)


class ToolOfJoints(NamedTuple):
    """The way of the tool that goes with a plan in joint space."""

    arm: Any
    plan: Any

    def __call__(self, t):
        q, v, a = self.plan(t)
        T, J = self.arm.forward_kinematics(q), self.arm.jacobian(q)
        x_dot, x_ddot = J @ v, J @ a + self.arm.jacobian_time_variation(q, v) @ v
        return PosePoint(T.translation, x_dot[:3], x_ddot[:3], T.rotation, x_dot[3:], x_ddot[3:])

    @property
    def duration(self):
        return self.plan.duration

    @property
    def times(self):
        return self.plan.spline.times


def test_six_joints_get_back_the_plan_that_moved_the_tool():
    arm, rng = k1607.load_example("ur5"), np.random.default_rng(5)
    q0 = np.array([0.3, -1.2, 1.4, -0.9, -1.2, 0.2])
    plan = plan_joints(arm, q0 + rng.uniform(-0.3, 0.3, (2, 6)), q0)
    found = joint_path(arm, ToolOfJoints(arm, plan), q0)
    t = np.linspace(0, plan.duration, 100)
    assert found(t).position == pytest.approx(plan(t).position, abs=1e-8)
    assert found(t).velocity == pytest.approx(plan(t).velocity, abs=1e-5)


@pytest.mark.parametrize(
    ("name", "q0", "way"),
    [
        ("k1607", [2.8, 0.03, -2.28, 1.72, -3.04, 2.36, -2.23], [0.25, -0.06, 0.24]),
        ("k1607", [-0.82, 1.63, -2.49, 0.4, -2.93, 1.43, 1.3], [-0.13, 0.02, -0.33]),
        ("panda", [-0.59, 1.49, -0.24, -2.49, -0.2, 1.47, 2.62], [-0.33, -0.07, -0.09]),
        ("panda", [2.39, 1.34, -2.24, -1.67, -2.57, 3.11, 1.97], [0.15, 0.15, -0.27]),
    ],
)
def test_redundancy_keeps_joints_off_their_limits(name, q0, way, monkeypatch):
    """Least joint motion alone runs into a limit on the way; held back in time, the joint does not."""
    arm = k1607.load_k1607() if name == "k1607" else k1607.load_example(name)
    q0 = np.array(q0)
    path = Line(arm.forward_kinematics(q0).translation, np.array(way))
    q = joint_path(arm, path, q0, 2.5).spline
    lowest, highest = q.peaks()
    assert (lowest.value > arm.lower).all()
    assert (highest.value < arm.upper).all()
    monkeypatch.setattr(
        "k1607_pin.paths.follower.Follower.weights", lambda self, q: (np.ones(len(q)), np.zeros(len(q)))
    )
    with pytest.raises(JointLimitError, match="expected within its limits") as caught:
        joint_path(arm, path, q0, 2.5)
    i = arm.joint_names.index(caught.value.joint)
    assert not arm.lower[i] <= caught.value.value <= arm.upper[i]


def test_steps_are_of_third_order_where_a_joint_is_held_back_too():
    """Half the step, an eighth of the error: which an acceleration that is not the velocity's derivative would spoil."""
    arm = k1607.load_example("panda")
    q0 = np.array([-0.59, 1.49, -0.24, -2.49, -0.2, 1.47, 2.62])
    path = Line(arm.forward_kinematics(q0).translation, np.array([-0.33, -0.07, -0.09]))
    t = np.linspace(0, 2.5, 26)
    fine, *coarse = (joint_path(arm, path, q0, 2.5, period=h)(t).position for h in (0.0025, 0.05, 0.025, 0.0125))
    errors = [np.abs(q - fine).max() for q in coarse]
    assert errors[0] < 1e-4
    assert errors[1] < errors[0] / 7
    assert errors[2] < errors[1] / 7


def test_out_of_reach_is_refused_with_the_place(arm, q0):
    start = arm.forward_kinematics(q0).translation
    path = Line(start, np.array([0.0, 2.0, 0.0]))
    with pytest.raises(UnreachableError, match=r"cannot bring .* t = ") as caught:
        joint_path(arm, path, q0, 3.0)
    error = caught.value
    assert error.position == pytest.approx(path(error.time).position)
    # the place is where the reach ends, not somewhere behind: it is missed by a few millimetres at most
    assert 1e-6 < error.closest.position_error < 5e-3


class Through(NamedTuple):
    """The UR5's wrist turned through its singularity, q5 = 0, in a second, evenly."""

    arm: Any
    q0: np.ndarray

    def __call__(self, t):
        v = np.array([0, 0, 0, 0, 0.6, 0])
        q = self.q0 + v * t
        T, x_dot, J_dot = (
            self.arm.forward_kinematics(q),
            self.arm.jacobian(q) @ v,
            self.arm.jacobian_time_variation(q, v),
        )
        return PosePoint(T.translation, x_dot[:3], (J_dot @ v)[:3], T.rotation, x_dot[3:], (J_dot @ v)[3:])


@pytest.mark.parametrize("period", [0.001, 0.01, 0.2])
def test_a_singularity_is_refused_with_place_time_and_sigma(period):
    arm = k1607.load_example("ur5")
    path = Through(arm, np.array([0.3, -1.2, 1.4, -0.9, -0.31, 0.2]))
    with pytest.raises(
        SingularPathError, match=r"singular, or close to it, at \[.*\] m, t = .*: smallest singular"
    ) as caught:
        joint_path(arm, path, path.q0, 1.0, period=period)
    error = caught.value
    assert error.time == pytest.approx(0.31 / 0.6, abs=0.1)
    assert error.position == pytest.approx(path(error.time).position)
    assert 0 <= error.sigma_min < error.threshold == 0.01


def test_a_singularity_between_samples_is_found():
    """The last sample before it and the first one after are both clear of it."""
    arm = k1607.load_example("ur5")
    path = Through(arm, np.array([0.3, -1.2, 1.4, -0.9, -0.303, 0.2]))
    threshold = 0.0005
    with pytest.raises(SingularPathError) as caught:
        joint_path(arm, path, path.q0, 1.0, period=0.01, sigma_min=threshold)
    samples = np.linspace(0, 1, 101)
    sigma = [np.linalg.svd(arm.jacobian(path.q0 + np.array([0, 0, 0, 0, 0.6 * t, 0])))[1][-1] for t in samples]
    assert min(sigma) > threshold
    assert caught.value.time == pytest.approx(0.505, abs=1e-3)
    assert caught.value.sigma_min < 1e-4


def test_fewer_joints_than_rows_are_told_which_task_they_can_have():
    arm = k1607.load_example("ur5", locked=["wrist_3_joint"])
    q0 = np.array([0.3, -1.2, 1.4, -0.9, -1.2])
    with pytest.raises(
        TooFewJointsError, match=r'expected one that the 5 joints .* pass task="position" or task="axis"'
    ):
        joint_path(arm, Line(arm.forward_kinematics(q0).translation), q0, 1.0)


def test_a_jump_is_refused_with_the_place():
    arm, q0 = k1607.load_k1607(), np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    start = arm.forward_kinematics(q0).translation

    def path(t):
        return PathPoint(start + (np.array([0.0, 0.2, 0.0]) if t > 0.5 else 0.0), np.zeros(3), np.zeros(3))

    with pytest.raises(ValueError, match=r"path: expected .*, but .*t = 0\.5"):
        joint_path(arm, path, q0, 1.0)


def test_velocity_that_is_not_the_derivative_is_refused():
    arm, q0 = k1607.load_k1607(), np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    line = Line(arm.forward_kinematics(q0).translation)
    with pytest.raises(ValueError, match="path: expected velocity and acceleration to be derivatives"):
        joint_path(arm, lambda t: line(t)._replace(velocity=np.zeros(3)), q0, 1.0)


def test_a_start_that_is_looked_for_is_on_the_path():
    arm, q0 = k1607.load_k1607(), np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    circle = Circle(0.3)
    R = arm.forward_kinematics(q0).rotation
    found = joint_path(arm, circle, q0, 0.5, R)
    T = arm.forward_kinematics(found(0.0).position)
    assert T.translation == pytest.approx(circle(0.0).position, abs=1e-8)
    assert R == pytest.approx(T.rotation, abs=1e-8)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"q0": np.zeros(3)}, "q0"),
        ({"duration": None}, "duration: expected a positive number"),
        ({"duration": -1.0}, "duration"),
        ({"period": 0.0}, "period"),
        ({"sigma_min": 0.0}, "sigma_min"),
        ({"rotation": np.ones((3, 3))}, "rotation: expected a"),
        ({"rotation": np.full((3, 3), np.nan)}, "rotation: expected a"),
        ({"rotation": np.eye(4)}, "rotation: expected a"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(reference, change, words):
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    path = Line(reference.forward_kinematics(q0).translation)
    with pytest.raises(ValueError, match=words):
        joint_path(reference, path, **{"q0": q0, "duration": 1.0, **change})
