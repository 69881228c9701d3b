"""The Cartesian adaptive scheme closed around an arm: it follows the report's line, and adaptation is why."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.arm.payload import Payload
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.reference_model import reference_model
from k1607_pin.description.units import INCH, POUND
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.simulate import simulate

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
