"""What to do with the joints that the tool's task leaves over: hold a posture, without a force at the tool."""

from typing import Any, NamedTuple

import numpy as np


class Posture(NamedTuple):
    """A posture to hold as far as the tool's task allows."""

    q: np.ndarray
    """(n,) rad"""
    omega: float
    """1/s, of the critically damped approach; well below 2 / T for torques held a period T"""


def posture_torque(M: Any, J: Any, q: Any, v: Any, q_wanted: Any, omega: Any) -> Any:
    """(n,) N m that draws q to ``q_wanted`` in the null space of J, critically damped.

    (I - J^T J_bar^T) M (omega^2 (q_wanted - q) - 2 omega v), with J_bar = M^-1 J^T (J M^-1 J^T)^-1: dynamically consistent
    (Khatib, 1987), so that the tool is not accelerated as far as M is the arm's. Zero for as many joints as directions.

    Parameters
    ----------
    M (n, n), J (6, n), q, v, q_wanted (n,) rad, rad/s; omega : 1/s.
    """
    wish = omega * omega * (q_wanted - q) - 2 * omega * v  # (n,) rad/s^2
    M_inverse_JT = np.linalg.solve(M, J.T)  # (n, 6)
    force = np.linalg.solve(J @ M_inverse_JT, J @ wish)  # (6,) N, J_bar^T M wish
    return M @ wish - J.T @ force
