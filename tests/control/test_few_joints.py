"""Laws of the tool for arms of three to five joints: goals of position and axis, simulated, compiled, and refused with advice."""

import numpy as np
import pinocchio as pin
import pytest

import k1607_pin as k1607
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.baselines import OperationalSpaceControl
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.hybrid import hybrid_gains
from k1607_pin.control.posture import hold
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.kinematics.differential import SingularJacobianError
from k1607_pin.kinematics.task import POSE, Task
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.simulate import simulate

READY = np.array([0.3, -1.2, 1.4, -0.9, 0.8, 0.2])
CASES = [(7, "position"), (6, "axis"), (5, "axis"), (5, "position"), (4, "position"), (3, "position")]


@pytest.fixture(scope="module")
def arms():
    """By their number of joints: a UR5 whose last ones are locked, and the K-1607."""
    ur5 = k1607.load_example("ur5")
    made = {6: ur5, 7: k1607.load_k1607()}
    for n in (5, 4, 3, 2):
        model = pin.buildReducedModel(ur5.model, list(range(n + 1, 7)), READY)
        made[n] = k1607.Arm(model, ur5.tool_frame)
    return made


def posture_of(arm):
    return np.deg2rad([20.0, -30, 10, 80, 0, 60, 0]) if arm.n == 7 else READY[: arm.n]


def laws(arm, task, omega=25.0, period=0.002, kind=None):
    """The adaptive scheme and Khatib's, along 3 cm."""
    q = posture_of(arm)
    tool = arm.forward_kinematics(q)
    R, m = None if task == "position" else tool.rotation, {"position": 3, "axis": 5, "pose": 6}[task]
    line = Line(tool.translation, extent=np.array([0.01, 0.02, -0.02]), rate=3.0)
    keep = hold(q, 5.0) if arm.n > m else None
    gains, model = gains_from_inertia(arm, q, omega, task=task), reference_model(2 * np.ones(m), 3 * np.ones(m))
    made = {
        "adaptive": lambda: CartesianAdaptive(
            arm, line, R, gains, model, 10.0, 10.0, period, keep, Practice(gravity=True, gain_bound=0.5), task
        ),
        "operational space": lambda: OperationalSpaceControl(arm, line, R, omega, keep, task=task),
    }
    return made[kind]() if kind else [make() for make in made.values()]


@pytest.mark.parametrize(("n", "task"), CASES)
def test_they_follow(arms, n, task):
    """What Lambda's own direction of an error leaves: acceleration over omega^2 for the one without feedforward."""
    arm = arms[n]
    for law, within in zip(laws(arm, task), (2e-3, 1e-4), strict=True):
        log = simulate(arm, law, posture_of(arm), 1.0, control_period=0.002, step=runge_kutta_4)
        distance = np.linalg.norm(log.tool_position.values - law.path(log.time.values).position, axis=1)
        assert distance.max() < within  # m
        assert np.linalg.norm(log.error.values[:, :3], axis=1) == pytest.approx(distance, abs=1e-9)
        if task == "axis":  # the tool's z stays where it was
            z = [arm.forward_kinematics(q).rotation[:, 2] for q in log.q.values]
            assert np.abs(z - z[0]).max() < 10 * within
        assert log.error.dims == ("time", "task_row")


@pytest.mark.parametrize(("n", "task"), CASES)
def test_gains_are_lambda_s_of_the_task(arms, n, task):
    """J M^-1 J^T of the rows, by its definition; and as `Arm.operational_space` has it where it is the whole pose."""
    arm, q = arms[n], posture_of(arms[n])
    which = Task(task)
    J = which.rows(arm.jacobian(q), arm.forward_kinematics(q).rotation)
    Lambda = np.linalg.inv(J @ np.linalg.solve(arm.mass_matrix(q), J.T))
    gains = gains_from_inertia(arm, q, 5.0, 0.7, task)
    assert gains.K_p == pytest.approx(25 * Lambda, rel=1e-9)
    assert gains.K_d == pytest.approx(7 * Lambda, rel=1e-9)
    if n >= 6:
        Lambda = arm.operational_space(q, 0 * q).Lambda
        assert np.array_equal(gains_from_inertia(arm, q, 5.0).K_p, 25 * np.linalg.inv(np.linalg.inv(Lambda)))


@pytest.mark.parametrize("kind", ["adaptive", "operational space"])
@pytest.mark.parametrize(("n", "task"), [(5, "axis"), (4, "position")])
def test_compiled_as_simulated(arms, n, task, kind):
    arm = arms[n]
    law, q = laws(arm, task, omega=15.0, period=0.01, kind=kind), posture_of(arm)
    names = ("q", "tau", "error", *(("K_p", "K_d") if kind == "adaptive" else ()))
    run, wanted = k1607.rollout(arm, law, q, 0.5, log=names), simulate(arm, law, q, 0.5)
    for name in names:
        assert run[name].dims[1:] == wanted[name].dims
        scale = np.abs(wanted[name].values).max()
        assert run[name].values[0] == pytest.approx(wanted[name].values, abs=1e-9 * scale)


@pytest.mark.parametrize(
    ("n", "task", "words"),
    [
        (5, "pose", r"5 joints cannot .* take task='axis' or task='position' or JointAdaptive with gains_from_mass"),
        (4, "pose", r"4 joints cannot .* take task='position' or JointAdaptive with gains_from_mass"),
        (4, "axis", r"4 joints cannot .* take task='position' or JointAdaptive with gains_from_mass"),
        (2, "position", r"2 joints cannot .* take JointAdaptive with gains_from_mass"),
    ],
)
def test_advice_can_be_typed(arms, n, task, words):
    arm = arms[n]
    q, tool = posture_of(arm), arm.forward_kinematics(posture_of(arm))
    with pytest.raises(SingularJacobianError, match=words):
        gains_from_inertia(arm, q, 5.0, task=task)
    law = OperationalSpaceControl(arm, Line(tool.translation), tool.rotation, 5.0, task=task)
    with pytest.raises(SingularJacobianError, match=words):
        law.start(q, 0 * q, 1.0)


def test_the_hybrid_scheme_needs_six_joints(arms):
    with pytest.raises(
        ValueError, match=r"arm: expected six joints or more, .* got 5; CartesianAdaptive takes task='axis'"
    ):
        hybrid_gains(arms[5], READY[:5], 1e4, 5.0, 20.0)


def test_a_whole_pose_is_what_it_was(arms):
    arm, q = arms[6], READY
    tool, model = arm.forward_kinematics(q), reference_model(np.ones(6), np.ones(6))
    gains = gains_from_inertia(arm, q, 5.0)
    arguments = arm, Line(tool.translation), tool.rotation, gains, model, 1.0, 1.0, 0.01
    law = CartesianAdaptive(*arguments)
    assert law.task == POSE
    assert law.variables["error"][0] == ("direction",)
    for task in ("pose", POSE, Task("pose")):
        same = CartesianAdaptive(*arguments, task=task)
        for a, b in zip(
            same.update(0.1, q, q, law.initial(q, q))[:1], law.update(0.1, q, q, law.initial(q, q))[:1], strict=True
        ):
            assert np.array_equal(a, b)


@pytest.mark.parametrize("bad", ["posture", None, 3, "Axis"])
def test_no_such_task(arms, bad):
    arm, q = arms[6], READY
    tool = arm.forward_kinematics(q)
    with pytest.raises(ValueError, match="task: expected 'pose', 'position' or 'axis', got"):
        gains_from_inertia(arm, q, 5.0, task=bad)
    with pytest.raises(ValueError, match="task: expected 'pose', 'position' or 'axis', got"):
        OperationalSpaceControl(arm, Line(tool.translation), tool.rotation, 5.0, task=bad)


def test_gains_of_another_size_than_the_task_are_refused(arms):
    arm, q = arms[4], posture_of(arms[4])
    six, model = Gains(np.eye(6), np.eye(6)), reference_model(np.ones(3), np.ones(3))
    line = Line(arm.forward_kinematics(q).translation)
    with pytest.raises(ValueError, match=r"gains\.K_p: expected \(3, 3\) finite numbers"):
        CartesianAdaptive(arm, line, None, six, model, 1.0, 1.0, 0.01, task="position")
    axis = gains_from_inertia(arms[5], READY[:5], 5.0, task="axis")
    with pytest.raises(ValueError, match="model: expected one of 5 systems, got 3"):
        CartesianAdaptive(arms[5], line, np.eye(3), axis, model, 1.0, 1.0, 0.01, task="axis")


def test_only_a_position_does_without_an_orientation(arms):
    arm, q = arms[5], READY[:5]
    line = Line(arm.forward_kinematics(q).translation)
    OperationalSpaceControl(arm, line, None, 5.0, task="position").start(q, 0 * q, 1.0)
    with pytest.raises(ValueError, match="rotation: expected"):
        OperationalSpaceControl(arm, line, None, 5.0, task="axis").start(q, 0 * q, 1.0)
