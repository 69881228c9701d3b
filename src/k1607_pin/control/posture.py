"""What to do with the joints that the tool's task leaves over: keep to postures, without a force at the tool."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from k1607_pin.arguments import number, numbers, shown
from k1607_pin.dynamics.linear import solve_definite


class Posture(NamedTuple):
    """Postures to keep to as far as the tool's task allows; see `hold` and `along`."""

    path: Callable[[float], tuple[np.ndarray, np.ndarray]]
    """Time [s] -> wanted joint angles (n,) rad and velocities (n,) rad/s"""
    omega: float
    """1/s, of the approach; well below 2 / T for torques held a period T"""
    damping: float | None = None
    """1/s, by which velocities other than the wanted ones are slowed; None for critical damping, 2 omega"""


def check_posture(posture: Posture | None, n: int) -> None:
    """Refuse, by `ValueError`, what is neither None nor a path of n joints with an omega and a damping >= 0."""
    if posture is None:
        return
    if not isinstance(posture, Posture) or not callable(posture.path):
        raise ValueError(f"posture: expected what hold, along or damp give, or None, got {shown(posture)}")
    number("posture.omega", posture.omega, at_least=0, unit="1/s")
    if posture.damping is not None:
        number("posture.damping", posture.damping, at_least=0, unit="1/s")
    wanted = posture.path(0.0)
    if not isinstance(wanted, tuple) or len(wanted) != 2:
        raise ValueError(f"posture.path(0): expected joint angles and velocities, got {shown(wanted)}")
    numbers("posture.path(0), angles", wanted[0], (n,), "rad")
    numbers("posture.path(0), velocities", wanted[1], (n,), "rad/s")


def hold(q: np.ndarray, omega: float) -> Posture:
    """One posture (n,) rad, at omega [1/s]."""
    return Posture(Still(numbers("q", q, (None,), "rad").copy()), number("omega", omega, 0, unit="1/s"))


def damp(n: int, rate: float) -> Posture:
    """No posture of n joints: what the task leaves over comes to rest as exp(-rate t), rate in 1/s, wherever it is."""
    if not isinstance(n, int | np.integer) or n < 1:
        raise ValueError(f"n: expected a whole number of joints > 0, got {shown(n)}")
    return Posture(Still(np.zeros(n)), 0.0, number("rate", rate, 0, unit="1/s"))


def along(times: np.ndarray, postures: np.ndarray, omega: float) -> Posture:
    """Postures (N, n) rad at times (N,) s, smoothly in between and at rest at both ends, at omega [1/s].

    Raises
    ------
    ValueError
        Other shapes, numbers that are not finite, fewer than two times, or times that do not rise; omega not positive.
    """
    times = numbers("times", times, (None,), "s")
    if len(times) < 2 or not (np.diff(times) > 0).all():
        raise ValueError(f"times: expected two or more numbers in s that rise, got {shown(times)}")
    postures, omega = numbers("postures", postures, (len(times), None), "rad"), number("omega", omega, 0, unit="1/s")
    spline = CubicSpline(times, postures, bc_type="clamped")
    return Posture(Through(spline, spline.derivative(), times[0], times[-1]), omega)


@dataclass(frozen=True, eq=False)
class Still:
    """One posture at all times."""

    q: np.ndarray
    """(n,) rad"""

    def __call__(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Joint angles and velocities at time t [s]."""
        return self.q, 0 * self.q


@dataclass(frozen=True, eq=False)
class Through:
    """A curve of postures, at rest before it and after it."""

    angles: PPoly
    rates: PPoly
    first: float
    """s"""
    last: float
    """s"""

    def __call__(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Joint angles and velocities at time t [s]."""
        inside = min(max(t, self.first), self.last)
        return self.angles(inside), self.rates(inside)


LEAST = 1e-9  # of the mean of J M^-1 J^T's eigenvalues: added to all, so that a singular posture has an answer too


def posture_torque(
    M: Any, J: Any, q: Any, v: Any, q_wanted: Any, v_wanted: Any, omega: Any, damping: Any = None
) -> Any:
    """(n,) N m that draws q to ``q_wanted`` in the null space of J, critically damped unless told otherwise.

    (I - J^T J_bar^T) M (omega^2 (q_wanted - q) + damping (v_wanted - v)), damping = 2 omega, J_bar = M^-1 J^T (J M^-1 J^T)^-1:
    dynamically consistent (Khatib, 1987), so that the tool is not accelerated as far as M is the arm's. Zero for six joints.

    Parameters
    ----------
    M (n, n), J (6, n), q, q_wanted (n,) rad, v, v_wanted (n,) rad/s; omega, damping : 1/s.
    """
    damping = 2 * omega if damping is None else damping
    wish = omega * omega * (q_wanted - q) + damping * (v_wanted - v)  # (n,) rad/s^2
    M_inverse_JT = solve_definite(M, J.T)  # (n, 6)
    mobility = J @ M_inverse_JT
    mobility = mobility + LEAST * np.trace(mobility) / J.shape[0] * np.eye(J.shape[0])
    force = solve_definite(mobility, J @ wish)  # (6,) N, J_bar^T M wish
    return M @ wish - J.T @ force
