"""The report's two test paths in the x-y plane, (78)-(83), with exact velocity and acceleration."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arguments import number, numbers
from k1607_pin.description.units import INCH
from k1607_pin.kinematics.vectors import vector


class PathPoint(NamedTuple):
    """The wanted motion of the tool's origin at one time, or many; base axes."""

    position: Any
    """(..., 3) m"""
    velocity: Any
    """(..., 3) m/s"""
    acceleration: Any
    """(..., 3) m/s^2"""


@dataclass(frozen=True)
class Line:
    """Study case 1: from rest towards start + extent along a straight line, exponentially, (78)-(79).

    Raises
    ------
    ValueError
        Wrong shapes, numbers that are not finite, a rate that is not positive.
    """

    start: np.ndarray
    """(3,) m"""
    extent: np.ndarray = field(default_factory=lambda: np.array([9.0, 18.0, 0.0]) * INCH)
    """(3,) m: 9 in along x, 18 in along y; approached, never quite reached."""
    rate: float = 3.5
    """1/s: the exponents are -rate t/3 and -rate t/4."""

    def __post_init__(self) -> None:
        for name in ("start", "extent"):
            object.__setattr__(self, name, np.array(numbers(name, getattr(self, name), (3,), "m")))
        number("rate", self.rate, above=0, unit="1/s")

    def __call__(self, t: Any) -> PathPoint:
        """The wanted motion at times t (...) s, from 0 on."""
        a, b = self.rate / 3, self.rate / 4
        third, fourth = np.exp(-a * t), np.exp(-b * t)
        share = 1 + 3 * third - 4 * fourth
        rate = 3 * -a * third - 4 * -b * fourth
        curvature = 3 * a * a * third - 4 * b * b * fourth
        return PathPoint(
            vector([self.start[i] + self.extent[i] * share for i in range(3)]),
            vector([self.extent[i] * rate for i in range(3)]),
            vector([self.extent[i] * curvature for i in range(3)]),
        )


@dataclass(frozen=True)
class Circle:
    """Study case 2: once round a circle about the base's z axis, up to speed, at speed, and to rest, (80)-(83).

    Raises
    ------
    ValueError
        Numbers that are not finite, radius, omega or beta not positive, or a turn over before it is up to speed.
    """

    height: float
    """m, of the circle's plane over the base; not published."""
    radius: float = 24.32 * INCH
    """m"""
    omega: float = 2 * np.pi / 9
    """rad/s, at speed"""
    beta: float = 2 * np.pi / 9
    """rad/s^2, up to speed and down again"""
    phi_0: float = 0.0
    """rad, where it starts and ends"""

    def __post_init__(self) -> None:
        for name, unit in (("radius", "m"), ("omega", "rad/s"), ("beta", "rad/s^2")):
            number(name, getattr(self, name), above=0, unit=unit)
        for name, unit in (("height", "m"), ("phi_0", "rad")):
            number(name, getattr(self, name), unit=unit)
        if self.omega**2 / self.beta > 2 * np.pi:
            raise ValueError(
                f"beta: expected at least omega^2 / 2 pi = {self.omega**2 / (2 * np.pi):.3g} rad/s^2, so that speeding up and "
                f"slowing down fit into one turn, got {self.beta:.3g}"
            )

    @property
    def times(self) -> tuple[float, float, float]:
        """t1, t2, t3 [s]: up to speed, speed kept, at rest again after one turn; by continuity of (81)-(83)."""
        t_1 = self.omega / self.beta
        t_2 = 2 * np.pi / self.omega  # the ramps together turn as far as t_1 at speed
        return t_1, t_2, t_2 + t_1

    def __call__(self, t: Any) -> PathPoint:
        """The wanted motion at times t (...) s; at rest before 0 and after t3."""
        t_1, t_2, t_3 = self.times
        t = np.clip(t, 0.0, t_3)
        up, level = t < t_1, t < t_2
        phi_1 = self.phi_0 + self.beta / 2 * t_1 * t_1
        left = t_3 - t
        first = self.phi_0 + self.beta / 2 * t * t  # (81)
        second = phi_1 + self.omega * (t - t_1)  # (82)
        third = self.phi_0 - self.beta / 2 * left * left + 2 * np.pi  # (83), one turn further on: the same point
        phi = np.where(up, first, np.where(level, second, third))
        rate = np.where(up, self.beta * t, np.where(level, self.omega + 0 * t, self.beta * left))
        change = np.where(up, self.beta + 0 * t, np.where(level, 0 * t, -self.beta + 0 * t))
        change = np.where(t > 0.0, np.where(t < t_3, change, 0 * t), 0 * t)
        c, s, zero = self.radius * np.cos(phi), self.radius * np.sin(phi), 0 * t
        return PathPoint(  # (80)
            vector([c, s, zero + self.height]),
            vector([-s * rate, c * rate, zero]),
            vector([-c * rate * rate - s * change, -s * rate * rate + c * change, zero]),
        )
