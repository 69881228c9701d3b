"""The Cartesian adaptive scheme, figure 13: PD on the tool's pose error with adapted gains, through J^T to the joints."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.control.adaptation import Gains, adapted, gain_rates, proportional_derivative
from k1607_pin.control.reference_model import ReferenceModel
from k1607_pin.kinematics.orientation import orientation_error


class Step(NamedTuple):
    """One control period's outcome."""

    torque: Any
    """(n,) N m, held until the next period"""
    gains: Gains
    """Gains for the next period"""
    error: Any
    """(6,) x_e: position [m] and orientation [rad], base axes"""
    error_rate: Any
    """(6,) m/s, rad/s"""


def pose_error(position: Any, rotation: Any, wanted_position: Any, wanted_rotation: Any) -> Any:
    """(6,) x_e of (41): wanted less actual position [m], and 2 delta s of R_d R^T [rad]."""
    return np.concatenate([wanted_position - position, orientation_error(wanted_rotation, rotation)])


def cartesian_adaptive(
    position: Any,
    rotation: Any,
    J: Any,
    v: Any,
    wanted_position: Any,
    wanted_rotation: Any,
    wanted_velocity: Any,
    gains: Gains,
    P_2: Any,
    P_3: Any,
    beta_1: Any,
    beta_2: Any,
    period: Any,
) -> Step:
    """One step of the scheme: torque from the present gains, then the gains adapted, (40)-(41) and (76)-(77).

    Parameters
    ----------
    position (3,) m, rotation (3, 3) : the tool's pose; J (6, n) : its Jacobian; v (n,) rad/s.
    wanted_position (3,) m, wanted_rotation (3, 3), wanted_velocity (6,) m/s and rad/s : base axes.
    gains : `Gains` of 6 by 6; P_2, P_3 (6, 6) : see `reference_model`; beta_1, beta_2 : adaptation rates.
    period : s.
    """
    error = pose_error(position, rotation, wanted_position, wanted_rotation)
    error_rate = wanted_velocity - J @ v
    force = proportional_derivative(gains, error, error_rate)
    rates = gain_rates(P_2, P_3, beta_1, beta_2, error, error_rate)
    return Step(J.T @ force, adapted(gains, rates, period), error, error_rate)


@dataclass(frozen=True)
class CartesianAdaptive:
    """The scheme as a controller for `simulate`: follows a path of the tool's origin, its orientation held.

    The report publishes neither the initial gains nor beta_1 and beta_2.
    """

    arm: Arm
    """Kinematics alone are used: the law knows no masses."""
    path: Callable[[float], Any]
    """Time [s] -> wanted .position (3,) m and .velocity (3,) m/s"""
    rotation: np.ndarray
    """(3, 3) wanted orientation, tool in base"""
    gains: Gains
    """K_p(0), K_d(0), (6, 6) each"""
    model: ReferenceModel
    """of six systems; gives P_2 and P_3"""
    beta_1: float
    beta_2: float
    period: float
    """s, the control period"""

    def start(self, q: np.ndarray, v: np.ndarray) -> Gains:
        """The initial gains."""
        return self.gains

    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: Gains) -> tuple[np.ndarray, Gains, dict[str, Any]]:
        """Torque (n,), adapted gains, and the log: errors and gains."""
        tool, wanted = self.arm.forward_kinematics(q), self.path(t)
        step = cartesian_adaptive(
            tool.translation,
            tool.rotation,
            self.arm.jacobian(q),
            v,
            wanted.position,
            self.rotation,
            np.concatenate([wanted.velocity, np.zeros(3)]),
            state,
            self.model.P_2,
            self.model.P_3,
            self.beta_1,
            self.beta_2,
            self.period,
        )
        log = {"error": step.error, "error_rate": step.error_rate, "K_p": state.K_p, "K_d": state.K_d}
        return step.torque, step.gains, log


def gains_from_inertia(arm: Arm, q: np.ndarray, omega: float, damping: float = 1.0) -> Gains:
    """K_p = omega^2 Lambda(q), K_d = 2 damping omega Lambda(q): initial gains that answer alike in all six directions.

    omega : 1/s; stable with torques held for a period T only while 2 damping omega T stays well below 2.
    """
    Lambda = arm.operational_space(q, np.zeros(arm.n)).Lambda
    return Gains(omega**2 * Lambda, 2 * damping * omega * Lambda)
