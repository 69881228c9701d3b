"""Piecewise polynomials of time: what planned motions are made of."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from k1607_pin.arguments import as_floats, number, numbers, shown

MOMENT = 1e-9  # s: just before and just after, where something jumps


class Peak(NamedTuple):
    """Where a coordinate is largest or smallest."""

    value: np.ndarray
    """(n,)"""
    time: np.ndarray
    """(n,) s"""


@dataclass(frozen=True, eq=False)
class Spline:
    """n coordinates as polynomials of time, one piece after the other from 0 s on; at rest before and after."""

    times: np.ndarray
    """(m + 1,) s, where pieces start, and where the last one ends"""
    coefficients: np.ndarray
    """(degree + 1, m, n): highest power first, of the time since the piece's start"""

    def __post_init__(self) -> None:
        times = numbers("times", self.times, (None,), "s")
        if len(times) < 2 or (np.diff(times) < 0).any():
            raise ValueError(f"times: expected at least two in s that never fall, got {shown(times)}")
        coefficients = numbers("coefficients", self.coefficients, (None, len(times) - 1, None))
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "coefficients", coefficients)

    @property
    def duration(self) -> float:
        """s"""
        return float(self.times[-1])

    @cached_property
    def _polynomials(self) -> PPoly:
        return PPoly(self.coefficients, self.times)

    def __call__(self, t: Any, order: int = 0) -> Any:
        """(..., n): the derivative of that order at times t (...) s; where it jumps, its value just after."""
        t = as_floats("t", t, "times in s")
        if np.isnan(t).any():
            raise ValueError(f"t: expected times in s, got {shown(t)}")
        within = np.clip(t, 0.0, self.duration)
        value = self._polynomials(within, order)
        return value if order == 0 else np.where(np.expand_dims(within == t, -1), value, 0.0)

    def slower(self, factor: float) -> "Spline":
        """The same motion in ``factor`` times the time."""
        factor = number("factor", factor, above=0)
        if not 1e-75 < factor < 1e75:
            raise ValueError(f"factor: expected a number from 1e-75 to 1e75, got {shown(factor)}")
        powers = np.arange(len(self.coefficients))[::-1]
        return Spline(self.times * factor, self.coefficients / factor ** powers[:, None, None])

    def peaks(self, order: int = 0) -> tuple[Peak, Peak]:
        """The smallest and the largest value of a continuous derivative: among pieces' ends and stationary points, exactly."""
        stationary = self._polynomials.derivative(order + 1).roots(discontinuity=False, extrapolate=False)
        lowest, highest = [], []
        for i, roots in enumerate(stationary):
            t = np.concatenate([self.times, roots[np.isfinite(roots)]])  # NaN marks a piece that is constant
            values = self._polynomials(t, order)[:, i]
            lowest.append((values.min(), t[values.argmin()]))
            highest.append((values.max(), t[values.argmax()]))
        return tuple(Peak(*np.array(found).T) for found in (lowest, highest))  # type: ignore[return-value]


def of_jerk(times: np.ndarray, jerk: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> Spline:
    """Cubic pieces: jerk (m, n) held from one of the times (m + 1,) to the next, from a start without acceleration.

    position, velocity : (n,) at the start.
    """
    acceleration = np.zeros_like(position)
    pieces = []
    for h, j in zip(np.diff(times), jerk, strict=True):
        pieces.append([j / 6, acceleration / 2, velocity, position])
        position = position + h * (velocity + h * (acceleration / 2 + h * j / 6))
        velocity = velocity + h * (acceleration + h * j / 2)
        acceleration = acceleration + h * j
    return Spline(times, np.moveaxis(np.array(pieces), 1, 0))


def through(times: np.ndarray, q: np.ndarray, v: np.ndarray, after: np.ndarray, before: np.ndarray) -> Spline:
    """Quintic pieces through given positions, velocities and accelerations.

    Parameters
    ----------
    times : (m + 1,) s; q, v : (m + 1, n) positions and velocities there.
    after, before : (m + 1, n) accelerations just after and just before, which differ where the acceleration jumps.
    """
    h = np.diff(times)[:, None]
    a = after[:-1]
    # what is left when the start's Taylor polynomial is taken off the end
    left = q[1:] - (q[:-1] + h * (v[:-1] + h * a / 2))
    left_v = (v[1:] - (v[:-1] + h * a)) * h
    left_a = (before[1:] - a) * h * h
    fifth = (6 * left - 3 * left_v + left_a / 2) / h**5
    fourth = (-15 * left + 7 * left_v - left_a) / h**4
    third = (10 * left - 4 * left_v + left_a / 2) / h**3
    return Spline(times, np.stack([fifth, fourth, third, a / 2, v[:-1], q[:-1]]))


def joined(splines: list[Spline]) -> Spline:
    """One after the other; all of one degree."""
    starts = np.cumsum([0.0, *(spline.duration for spline in splines)])
    times = [spline.times[:-1] + start for spline, start in zip(splines, starts, strict=False)]
    return Spline(
        np.concatenate([*times, starts[-1:]]), np.concatenate([spline.coefficients for spline in splines], axis=1)
    )
