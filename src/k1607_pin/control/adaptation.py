"""The adaptation of PD gains, (74)-(77): one definition for the joint-space, the Cartesian and the hybrid scheme.

From (61) on the report's signs do not agree with each other. Worked out from (55)-(56), with Upsilon = -P_2^T x_e - P_3 x_e',
the lower half of P E (printed without the transposition, which matters when P_2 is not symmetric):

    (57) + (61):  B_1' = -Psi_1^-1 Upsilon x_e^T                       as printed in (64)
    (66):         Lambda^-1 K_p' = -Psi_1^-1 Upsilon x_e^T             as printed in (69)
    (72):         Psi_1 = Lambda / beta_1, positive definite           printed with a minus sign, which would not be
    (74):         K_p' = -beta_1 Upsilon x_e^T                         printed without the minus sign
    (76):         K_p' = +beta_1 (P_2^T x_e + P_3 x_e') x_e^T          as printed, but for the transposition

so that the signs of (76)-(77) are right: (74)-(75) follow from the slip in (72)-(73), and the step to (76)-(77) drops it again.
"""

from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arguments import number, numbers, shown


class Gains(NamedTuple):
    """State of the adaptation."""

    K_p: Any
    """(m, m) proportional gains"""
    K_d: Any
    """(m, m) derivative gains"""


def upsilon(P_2: Any, P_3: Any, error: Any, error_rate: Any) -> Any:
    """(m,) -P_2^T x_e - P_3 x_e', (58) for z_m = 0; P_2 is the upper right block of P, and symmetric for section 7.2's Q = I."""
    return -(P_2.T @ error) - P_3 @ error_rate


def gain_rates(P_2: Any, P_3: Any, beta_1: Any, beta_2: Any, error: Any, error_rate: Any) -> Gains:
    """K_p' and K_d' of (74)-(75), signs mended: (m, m) each from the error (m,) and its rate (m,)."""
    y = -upsilon(P_2, P_3, error, error_rate)
    return Gains(beta_1 * np.outer(y, error), beta_2 * np.outer(y, error_rate))


def adapted(gains: Gains, rates: Gains, period: Any) -> Gains:
    """The gains one control period [s] later: (76)-(77), the integral taken at the sample."""
    return Gains(gains.K_p + period * rates.K_p, gains.K_d + period * rates.K_d)


def proportional_derivative(gains: Gains, error: Any, error_rate: Any) -> Any:
    """(m,) force K_p x_e + K_d x_e', (40)."""
    return gains.K_p @ error + gains.K_d @ error_rate


def checked_gains(gains: Gains, m: int) -> Gains:
    """The gains as finite (m, m) floats.

    Raises
    ------
    ValueError
        They are not; the message names which.
    """
    if not isinstance(gains, tuple) or len(gains) != len(Gains._fields):
        raise ValueError(f"gains: expected Gains(K_p, K_d), got {shown(gains)}")
    return Gains(*(numbers(f"gains.{name}", k, (m, m)).copy() for name, k in zip(Gains._fields, gains, strict=True)))


def check_adaptation(beta_1: float, beta_2: float, period: float) -> None:
    """Refuse rates that are negative or not finite, and a period [s] that is not positive, by `ValueError`."""
    number("beta_1", beta_1, at_least=0)
    number("beta_2", beta_2, at_least=0)
    number("period", period, 0, unit="s")
