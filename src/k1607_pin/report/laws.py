"""Eleven control laws made for one closed loop, so that they can be compared: the adaptive schemes and the textbook's.

What is made equal: every law gets the same model, the same path, measurements and torque limits, and gains for the same closed
loop, (D + omega)^2 e = 0 with omega = `OMEGA_T` / T: K_p(0) = omega^2 M and K_d(0) = 2 omega M for the joints, the same with
Lambda at the tool, computed torque and operational space by definition, and Slotine and Li's law by K_D = omega M and its sliding
variable's pole at omega. Rates of adaptation are as in the recommended settings, carried over to other omega by the errors that
they act on, which go as omega^-2.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from k1607_pin import data
from k1607_pin.arm.arm import Arm
from k1607_pin.control.baselines import ComputedTorque, GravityPD, OperationalSpaceControl, SlotineLi, parameter_rates
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.joint_space import JointAdaptive, gains_from_mass, model_from_mass
from k1607_pin.control.posture import Posture
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.inverse_path import JointPath
from k1607_pin.report.cases import StudyCase
from k1607_pin.simulation.simulate import Controller

OMEGA_T = 0.35  # as in the recommended settings, of the 1 that is stable
LEARNING = 0.1  # of omega: Slotine and Li's rate
LEAK = 5.0  # 1/s, of the gains towards their start
FITTED = 20  # postures of the path that gains are made for


class Setting(NamedTuple):
    """What laws are made from: see `LAWS`."""

    arm: Arm
    """as the law is told it is"""
    path: Callable[[float], Any]
    """of the tool's origin"""
    rotation: np.ndarray
    """(3, 3)"""
    joints: JointPath
    posture: Posture
    omega: float
    period: float
    rates: tuple[float, float]
    """beta_1 and beta_2 as a share of K_p(0), 1/(m^2 s) or 1/(rad^2 s)"""
    limit: np.ndarray
    """(n,) N m"""

    @property
    def postures(self) -> np.ndarray:
        """(FITTED, n) rad"""
        return self.joints.spline(np.linspace(0.0, self.joints.duration, FITTED))


Law = Callable[[Setting], Controller]


def cartesian_adaptive(s: Setting, adapting: bool = True, **options: Any) -> CartesianAdaptive:
    """The report's scheme at the tool; options : of `Practice`, beside the torque limits."""
    six, omega = np.ones(6), s.omega
    gains = gains_from_inertia(s.arm, s.postures, omega)
    model = reference_model(omega**2 * six, 2 * omega * six, np.diag([2 * omega**2] * 6 + [2.0] * 6))
    beta_1, beta_2 = (adapting * rate * np.linalg.eigvalsh(gains.K_p)[0] for rate in s.rates)
    practice = Practice(torque_limit=s.limit, **options)
    return CartesianAdaptive(
        s.arm, s.path, s.rotation, gains, model, beta_1, beta_2, s.period, s.posture, practice=practice
    )


def joint_adaptive(s: Setting, adapting: bool = True, **options: Any) -> JointAdaptive:
    """The report's scheme in the joints; options : of `Practice`, beside the torque limits."""
    beta_1, beta_2 = (adapting * rate * s.omega**2 for rate in s.rates)
    gains, model = gains_from_mass(s.arm, s.postures, s.omega), model_from_mass(s.arm, s.postures, s.omega)
    practice = Practice(torque_limit=s.limit, **options)
    return JointAdaptive(s.arm, s.joints, gains, model, beta_1, beta_2, s.period, practice)


def _gravity_pd(s: Setting) -> Controller:
    return GravityPD(s.arm, s.joints, gains_from_mass(s.arm, s.postures, s.omega))


def _computed_torque(s: Setting) -> Controller:
    return ComputedTorque(s.arm, s.joints, s.omega)


def _operational_space(s: Setting) -> Controller:
    return OperationalSpaceControl(s.arm, s.path, s.rotation, s.omega, s.posture)


def _slotine_li(s: Setting) -> Controller:
    K_D = gains_from_mass(s.arm, s.postures, s.omega).K_d / 2
    rates = parameter_rates(s.arm, s.postures[0], K_D, LEARNING * s.omega)
    return SlotineLi(s.arm, s.joints, K_D, s.omega, rates, s.period)


# named functions and their partials, since what another process is to run must have a name
LAWS: dict[str, Law] = {
    "Cartesian, gains fixed": partial(cartesian_adaptive, adapting=False),
    "Cartesian adaptive": cartesian_adaptive,
    "Cartesian adaptive + g": partial(cartesian_adaptive, gravity=True),
    "Cartesian adaptive + g + leak": partial(cartesian_adaptive, gravity=True, sigma=LEAK),
    "joint adaptive": joint_adaptive,
    "joint adaptive + g": partial(joint_adaptive, gravity=True),
    "joint adaptive + g + leak": partial(joint_adaptive, gravity=True, sigma=LEAK),
    "PD + g": _gravity_pd,
    "computed torque": _computed_torque,
    "operational space": _operational_space,
    "Slotine-Li": _slotine_li,
}
"""Add your own: a function of a `Setting`."""
NOTHING_TO_ADD = ("Cartesian adaptive + g", "joint adaptive + g")  # weightless, they are what they are without


def setting(case: StudyCase, joints: JointPath, period: float, omega_T: float = OMEGA_T, model: float = 1.0) -> Setting:
    """What a law is made from, for a study case with recommended settings; model : see `Trouble`."""
    recommended = data.load("study_cases")["recommended"]
    omega = omega_T / period
    slower = omega * recommended["control_period_s"] / recommended["omega_T"]
    rates = recommended["beta_1_share"] * slower**4, recommended["beta_2_share"] * slower**2
    posture = case.law.posture
    assert posture is not None
    kept = Posture(posture.path, min(posture.omega, omega))
    arm = case.plant.arm
    told = with_masses(arm, model)
    return Setting(told, case.law.path, case.law.rotation, joints, kept, omega, period, rates, arm.effort_limit)


def with_masses(arm: Arm, factor: float) -> Arm:
    """The arm with all masses and inertias, rotors excepted, multiplied by a positive number."""
    if not 0 < factor < np.inf:
        raise ValueError(f"factor: expected a positive number, got {factor!r}")
    model = arm.model
    for i in range(1, model.njoints):
        Y = model.inertias[i]
        model.inertias[i] = pin.Inertia(factor * Y.mass, Y.lever, factor * Y.inertia)
    return Arm(model, arm.tool_frame)
