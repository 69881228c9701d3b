"""The Robotics Research K-1607 and its 1990 NASA/CUA report, on Pinocchio.

import k1607_pin as k1607
arm = k1607.load_k1607()
arm.forward_kinematics(q), arm.jacobian(q), arm.mass_matrix(q)
k1607.closed_form.forward_kinematics(q)
"""

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.inverse import InverseKinematics, inverse_kinematics
from k1607_pin.arm.load import load_example, load_k1607, load_urdf
from k1607_pin.arm.payload import Payload, with_payload
from k1607_pin.arm.wrench import Wrench
from k1607_pin.compiled.batch import batch
from k1607_pin.compiled.export import export
from k1607_pin.compiled.rollout import rollout, rollouts
from k1607_pin.compiled.samples import Drawn, Entries, Grid, Integers, Listed, LogUniform, Normal, Scaled, Uniform
from k1607_pin.compiled.sweep import sweep
from k1607_pin.compiled.tracer import TracingError
from k1607_pin.compiled.tune import Tuned, tune
from k1607_pin.control.cartesian import CartesianAdaptive
from k1607_pin.control.finite import NotFiniteError
from k1607_pin.kinematics import closed_form, differential, nullspace, orientation
from k1607_pin.kinematics.task import Task
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.simulate import SimulationError, simulate

__all__ = [
    "Arm",
    "CartesianAdaptive",
    "Drawn",
    "Entries",
    "Grid",
    "Integers",
    "InverseKinematics",
    "Listed",
    "LogUniform",
    "Normal",
    "NotFiniteError",
    "Payload",
    "Plant",
    "Scaled",
    "SimulationError",
    "Task",
    "TracingError",
    "Tuned",
    "Uniform",
    "Wrench",
    "batch",
    "closed_form",
    "differential",
    "export",
    "inverse_kinematics",
    "load_example",
    "load_k1607",
    "load_urdf",
    "nullspace",
    "orientation",
    "rollout",
    "rollouts",
    "simulate",
    "sweep",
    "tune",
    "with_payload",
]
__version__ = "0.1.0"
