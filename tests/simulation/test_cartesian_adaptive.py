"""The Cartesian adaptive scheme closed around an arm: it follows the report's line, and adaptation is why; paths that turn."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import k1607_pin as k1607
from k1607_pin.arm.payload import Payload
from k1607_pin.arm.reach import UnreachableError
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.baselines import OperationalSpaceControl
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.hybrid import HybridAdaptive, Mode, hybrid_gains
from k1607_pin.control.posture import Posture, damp, hold
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.description.units import INCH, POUND
from k1607_pin.paths.cartesian_plan import PosePoint, plan_poses
from k1607_pin.paths.report_paths import Line
from k1607_pin.paths.timing import Limits
from k1607_pin.simulation.simulate import SimulationError, simulate

MODEL = reference_model(2 * np.ones(6), 3 * np.ones(6))  # section 7.2
POSTURE = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])


def run(arm, q0, period, beta, extent, omega, payloads=()):
    start = arm.forward_kinematics(q0)
    controller = CartesianAdaptive(
        arm,
        Line(start.translation, extent),
        start.rotation,
        gains_from_inertia(arm, q0, omega),
        MODEL,
        beta,
        beta,
        period,
    )
    return simulate(arm, controller, q0, 3.0, control_period=period, payloads=payloads)


@pytest.fixture(scope="module")
def line_with_payload():
    """Study case 1's line, weightless, 10 lb for the middle second, soft initial gains: without and with adaptation."""
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    payloads = [(1.0, Payload(10 * POUND)), (2.0, Payload(0.0))]
    extent = np.array([9.0, 18.0, 0.0]) * INCH
    return {beta: run(arm, POSTURE, 0.01, beta, extent, 2.0, payloads) for beta in (0.0, 1e6)}


def position_error(log):
    return log.error.values[:, :3]


def test_adaptation_halves_the_error_of_soft_gains(line_with_payload):
    fixed, adaptive = (np.sqrt((position_error(log) ** 2).mean()) for log in line_with_payload.values())
    assert adaptive < 0.6 * fixed
    assert (
        np.abs(position_error(line_with_payload[1e6])).max() < 0.02
    )  # m, of a line of half a metre started with a jolt


def test_orientation_is_held(line_with_payload):
    for log in line_with_payload.values():
        assert np.abs(log.error.values[:, 3:]).max() < 0.01  # rad


def test_gains_move_with_beta_and_not_without(line_with_payload):
    fixed, adapted = (log.K_p.values for log in line_with_payload.values())
    assert (fixed == fixed[0]).all()
    assert np.abs(adapted[-1] - adapted[0]).max() > 0.1 * np.abs(adapted[0]).max()


@pytest.mark.parametrize(
    ("name", "q0"),
    [
        ("panda", [0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.5]),
        ("ur5", [0.3, -1.2, 1.4, -0.9, -1.2, 0.2]),
        ("xarm7", [0.2, -0.4, 0.3, 1.2, 0.2, 1.3, 0.1]),
    ],
)
def test_the_same_calls_run_another_arm(name, q0):
    arm = k1607.load_example(name, armature=np.full(len(q0), 0.1), gravity=(0, 0, 0))
    log = run(arm, np.array(q0), 0.002, 10.0, np.array([0.05, 0.1, 0.0]), 10.0)
    assert np.abs(log.error.values[:, :3]).max() < 0.02
    assert np.abs(log.error.values[-1]).max() < 0.01


TURN = np.deg2rad([20.0, 0.0, 65.0])


@pytest.fixture(scope="module", params=["k1607", "panda"])
def turning(request):
    """A law on a planned path of 0.1 m along which the tool turns by 68 deg within a second or so."""
    arm = k1607.load_k1607() if request.param == "k1607" else k1607.load_example("panda")
    q0 = POSTURE if request.param == "k1607" else np.array([0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.5])
    T = arm.forward_kinematics(q0)
    end = pin.SE3(T.rotation @ pin.exp3(TURN), T.translation + np.array([0.0, 0.1, 0.05]))
    plan = plan_poses(arm, [end], q0, angular=Limits(2.0, 8.0, 80.0))
    posture = Posture(lambda t: plan.joints(t)[:2], 10.0)
    gains, practice = gains_from_inertia(arm, q0, 100.0), Practice(gravity=True)
    return q0, CartesianAdaptive(arm, plan, None, gains, MODEL, 1e3, 1e3, 0.001, posture, practice)


def worst(law, q0):
    """m, rad; infinite where the arm is lost."""
    try:
        duration = np.ceil(1e3 * law.path.duration) / 1e3
        error = simulate(law.arm, law, q0, duration, control_period=0.001).error.values
    except SimulationError:
        return np.inf, np.inf
    return np.abs(error[:, :3]).max(), np.abs(error[:, 3:]).max()


class Altered:
    """A path whose points' angular velocity, or acceleration, is multiplied by a factor."""

    def __init__(self, path, name, factor):
        self.path, self.name, self.factor, self.duration = path, name, factor, path.duration

    def __call__(self, t):
        point = self.path(t)
        return point._replace(**{self.name: self.factor * getattr(point, self.name)})


def test_it_turns_with_a_path_that_turns(turning):
    q0, law = turning
    position, orientation = worst(law, q0)
    assert position < 0.5e-3
    assert orientation < 4e-3
    for factor in (0.0, -1.0):  # the wanted angular velocity left out, and with the wrong sign
        assert worst(replace(law, path=Altered(law.path, "angular_velocity", factor)), q0)[1] > 20 * orientation


def test_operational_space_control_turns_with_it_too(turning):
    q0, adaptive = turning
    law = OperationalSpaceControl(adaptive.arm, adaptive.path, None, 100.0, adaptive.posture)
    orientation = worst(law, q0)[1]
    assert orientation < 1e-3
    for name, share in (("angular_velocity", 20), ("angular_acceleration", 1.3)):
        assert worst(replace(law, path=Altered(law.path, name, -1.0)), q0)[1] > share * orientation


def test_the_hybrid_scheme_without_a_force_asks_for_the_same_torque_on_the_way(turning):
    q0, law = turning
    gains, force_gains = hybrid_gains(law.arm, q0, 1e4, 100.0, 100.0)
    hybrid = HybridAdaptive(
        law.arm, law.path, None, Mode(np.zeros(6)), lambda t, q, v: np.zeros(6), 1e4, gains, force_gains, MODEL, MODEL,
        law.beta_1, law.beta_2, 0.0, 0.0, law.period, posture=law.posture, practice=law.practice,
    )  # fmt: skip
    q, v = law.path.joints(0.5)[:2]
    torques = [one.update(0.5, q + 0.01, v, one.start(q0, 0 * v, 1.0))[0] for one in (law, hybrid)]
    assert torques[1] == pytest.approx(torques[0], rel=1e-9)


def test_a_path_s_own_rotation_counts_and_one_without_needs_another(turning):
    q0, law = turning
    tool = law.arm.forward_kinematics(q0)
    held = replace(law, rotation=np.eye(3))
    at = 0.5, q0, np.zeros(law.arm.n)
    assert np.array_equal(
        held.update(*at, held.start(q0, at[2], 1.0))[0], law.update(*at, law.start(q0, at[2], 1.0))[0]
    )
    for changes, words in (
        (
            {"path": Line(tool.translation)},
            r"rotation: expected \(3, 3\), as the path's point at t = 0 s has none of its own",
        ),
        ({"path": Altered(law.path, "angular_velocity", np.nan)}, r"path: expected a finite \(3,\) angular_velocity"),
        ({"path": Altered(law.path, "rotation", 2.0)}, r"path\(0\)\.rotation: expected a \(3, 3\) rotation matrix"),
    ):
        with pytest.raises(ValueError, match=words):
            replace(law, **changes).start(q0, np.zeros(law.arm.n), 1.0)


def test_a_turn_out_of_reach_is_refused_where_the_place_alone_is_not():
    """The UR5's tool turned over at the far end of its reach."""
    arm, q0 = k1607.load_example("ur5"), np.array([0.3, -0.2, 0.4, -0.3, -1.2, 0.2])
    start, turn = arm.forward_kinematics(q0), pin.exp3(np.array([np.pi, 0.0, 0.0]))

    def path(t, R):
        still = np.zeros(3)
        return PosePoint(start.translation, still, still, R, still, still)

    law = CartesianAdaptive(
        arm, lambda t: path(t, start.rotation), None, Gains(np.eye(6), np.eye(6)), MODEL, 1.0, 1.0, 0.01
    )
    law.start(q0, np.zeros(6), 1.0)
    with pytest.raises(UnreachableError):
        replace(law, path=lambda t: path(t, turn @ start.rotation)).start(q0, np.zeros(6), 1.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rotation": np.ones((3, 3))}, "rotation"),
        ({"rotation": -np.eye(3)}, "rotation"),
        ({"rotation": np.eye(4)}, "rotation"),
        ({"gains": Gains(np.eye(3), np.eye(6))}, "K_p"),
        ({"gains": Gains(np.eye(6), np.full((6, 6), np.nan))}, "K_d"),
        ({"model": reference_model(np.ones(7), np.ones(7))}, "model"),
        ({"beta_1": -1.0}, "beta_1"),
        ({"beta_2": np.nan}, "beta_2"),
        ({"period": 0.0}, "period"),
    ],
)
def test_a_controller_that_makes_no_sense_is_refused_when_it_is_made(changes, words):
    arm = k1607.load_k1607()
    start = arm.forward_kinematics(POSTURE)
    good = {
        "arm": arm, "path": Line(start.translation), "rotation": start.rotation, "gains": Gains(np.eye(6), np.eye(6)),
        "model": MODEL, "beta_1": 1.0, "beta_2": 1.0, "period": 0.01,
    }  # fmt: skip
    CartesianAdaptive(**good)
    with pytest.raises(ValueError, match=words):
        CartesianAdaptive(**(good | changes))


def test_a_controller_is_only_run_at_its_own_period():
    arm = k1607.load_k1607()
    start = arm.forward_kinematics(POSTURE)
    law = CartesianAdaptive(
        arm, Line(start.translation), start.rotation, Gains(np.eye(6), np.eye(6)), MODEL, 1.0, 1.0, 0.002
    )
    with pytest.raises(ValueError, match=r"control_period: expected the controller's own period, 0\.002 s"):
        simulate(arm, law, POSTURE, 1.0, control_period=0.01)


def test_the_transposed_jacobian_alone_leaves_the_seventh_joint_free_to_drift():
    """The same line, weightless: the tool follows in both, and only with damping in the null space does the elbow rest."""
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    start = arm.forward_kinematics(POSTURE)
    gains = gains_from_inertia(arm, POSTURE, 20.0)
    law = CartesianAdaptive(arm, Line(start.translation), start.rotation, gains, MODEL, 0.0, 0.0, 0.01)
    speed = {}
    for name, posture in (("free", None), ("damped", damp(7, 5.0)), ("held", hold(POSTURE, 5.0))):
        log = simulate(arm, replace(law, posture=posture), POSTURE, 6.0)
        J = arm.jacobian(log.q.values[-1])
        null = np.linalg.svd(J)[2][6]
        speed[name] = abs(null @ log.v.values[-1])
        assert np.linalg.norm(position_error(log)[-1]) < 1e-3
    assert speed["free"] > 0.1  # rad/s, six seconds on, with the tool at rest
    assert speed["damped"] < 0.1 * speed["free"]
    assert speed["held"] < 0.1 * speed["free"]
