"""The Cartesian adaptive scheme, figure 13: PD on the tool's pose error with adapted gains, through J^T to the joints."""

from typing import Any, NamedTuple

import numpy as np

from k1607_pin.control.adaptation import Gains, adapted, gain_rates, proportional_derivative
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
