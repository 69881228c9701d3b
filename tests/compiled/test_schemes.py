"""The three schemes and the baselines, with all that practice adds: compiled as they are simulated, to 1e-9 over a second."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.control.baselines import ComputedTorque, GravityPD, OperationalSpaceControl, SlotineLi, parameter_rates
from k1607_pin.control.hybrid import HybridAdaptive, Mode, hybrid_gains
from k1607_pin.control.joint_space import JointAdaptive, gains_from_mass, model_from_mass
from k1607_pin.control.posture import hold
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.inverse_path import joint_path
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.wall import Wall

PAYLOADS = [(0.3, k1607.Payload(4.5)), (0.6, k1607.Payload(0.0))]
OMEGA = 20.0


@pytest.fixture(scope="module")
def joints(arm, law, q0):
    return joint_path(arm, law.path, q0, 1.0, law.rotation)


def joint_law(arm, joints, q0, **more):
    gains, model = gains_from_mass(arm, q0, OMEGA), model_from_mass(arm, q0, OMEGA)
    return JointAdaptive(arm, joints, gains, model, 1e5, 1e5, 0.01, **more)


OPTIONS = {
    "none": Practice(),
    "leak": Practice(sigma=0.5),
    "bound": Practice(gain_bound=0.05),
    "dead zone": Practice(dead_zone=2e-3),
    "limit": Practice(torque_limit=np.full(7, 60.0)),
    "filter": Practice(velocity_cutoff=100.0),
    "gravity": Practice(gravity=True),
    "all": Practice(0.5, 0.2, 1e-3, np.full(7, 200.0), 200.0, True),
}


@pytest.mark.parametrize("option", OPTIONS)
def test_joint_space(arm, joints, q0, agrees, option):
    law = joint_law(arm, joints, q0, practice=OPTIONS[option])
    names = ("q", "v", "tau", "joint_error", "error", "K_p", "K_d", "torque_share")
    run = k1607.rollout(arm, law, q0, 1.0, payloads=PAYLOADS, log=names)
    agrees(run, k1607.simulate(arm, law, q0, 1.0, payloads=PAYLOADS), names)


def test_cartesian_with_posture_and_options(arm, cartesian, q0, agrees):
    law = cartesian(arm, posture=hold(q0, 5.0), practice=OPTIONS["all"])
    names = ("q", "v", "tau", "error", "K_p", "K_d", "torque_share")
    run = k1607.rollout(arm, law, q0, 1.0, payloads=PAYLOADS, log=names)
    agrees(run, k1607.simulate(arm, law, q0, 1.0, payloads=PAYLOADS), names)


def test_hybrid_on_a_wall_that_changes_and_lets_go(arm, q0, agrees):
    start = arm.forward_kinematics(q0)
    wall = Wall(start.translation, (-1.0, 0, 0), [(0.0, 1e3), (0.2, 1e4, 0.3)], damping=5.0, friction=0.3)
    modes = (Mode((1, 0, 0, 0, 0, 0), (20.0, 0, 0, 0, 0, 0)), Mode(np.zeros(6), time=0.7))
    stiffest = np.array([1e4] * 3 + [1e3] * 3)
    gains, force_gains = hybrid_gains(arm, q0, stiffest, omega=60, force_omega=200, force_damping=0.7)
    force_model = reference_model(200.0**2 * np.ones(6), 400.0 * np.ones(6), np.diag([200.0**2] * 6 + [0.2] * 6))
    law = HybridAdaptive(
        arm, Line(start.translation, np.array([0.0, 0.1, 0.05])), start.rotation, modes, wall.sensor(arm), stiffest, gains,
        force_gains, reference_model(2 * np.ones(6), 3 * np.ones(6)), force_model, 1e5, 1e5, 1e-5, 1e-10, period=0.001,
        posture=hold(q0, 10.0), practice=Practice(gravity=True),
    )  # fmt: skip
    names = ("q", "v", "tau", "force", "error", "K_p", "force_K_p", "selection")
    settings = {"control_period": 0.001, "physics_step": 0.0005, "external": wall.external(arm)}
    reference = k1607.simulate(arm, law, q0, 1.0, **settings)
    assert (reference.force[:, 0] > 5).any()
    agrees(k1607.rollout(arm, law, q0, 1.0, log=names, **settings), reference, names)
    with pytest.raises(ValueError, match=r"got 'controller\.modes\.0\.force'; what only a function of time"):
        k1607.rollout(arm, law, q0, 0.5, vary={"controller.modes.0.force": np.ones((3, 6))}, **settings)
    rubbed = k1607.rollout(
        arm, law, q0, 0.5, vary={"external.wall.friction": [0.0, 0.3, 0.6]}, log=("force",), **settings
    )
    assert len(np.unique(rubbed.force[:, -1, 1])) == 3
    with pytest.raises(ValueError, match="friction: expected a number >= 0"):
        k1607.rollout(arm, law, q0, 0.5, vary={"external.wall.friction": [0.3, -1.0]}, **settings)


LAWS = {
    "PD + g": lambda arm, joints, law, q0: GravityPD(arm, joints, gains_from_mass(arm, q0, OMEGA)),
    "computed torque": lambda arm, joints, law, q0: ComputedTorque(arm, joints, OMEGA),
    "operational space": lambda arm, joints, law, q0: OperationalSpaceControl(
        arm, law.path, law.rotation, OMEGA, hold(q0, 5.0)
    ),
    "Slotine-Li": lambda arm, joints, law, q0: SlotineLi(
        arm, joints, K_D := gains_from_mass(arm, q0, OMEGA).K_d / 2, OMEGA, parameter_rates(arm, q0, K_D, 2.0), 0.01
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_baselines(arm, joints, law, q0, agrees, name):
    baseline = LAWS[name](arm, joints, law, q0)
    run = k1607.rollout(arm, baseline, q0, 1.0, payloads=PAYLOADS, log=("q", "v", "tau", "error"))
    agrees(run, k1607.simulate(arm, baseline, q0, 1.0, payloads=PAYLOADS), ("q", "v", "tau", "error"))
