"""The closed loop that is timed, and the same arm in MuJoCo."""

import mujoco
import numpy as np

import k1607_pin as k1607
from k1607_pin.arm.load import k1607_urdf
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.report_paths import Line

START = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
PERIOD, STEP = 0.01, 0.001  # s


def the_law(arm: k1607.Arm, q0: np.ndarray = START) -> CartesianAdaptive:
    """The Cartesian adaptive scheme on the report's line."""
    start = arm.forward_kinematics(q0)
    model = reference_model(2 * np.ones(6), 3 * np.ones(6))
    gains = gains_from_inertia(arm, q0, omega=2.0)
    return CartesianAdaptive(arm, Line(start.translation), start.rotation, gains, model, 1e6, 1e6, period=PERIOD)


def in_mujoco(arm: k1607.Arm) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The same URDF, armature and integrator, weightless, without contacts and limits."""
    model = mujoco.MjModel.from_xml_path(str(k1607_urdf()))
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_EULER
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.opt.gravity[:], model.dof_armature[:] = 0, arm.armature
    return model, mujoco.MjData(model)
