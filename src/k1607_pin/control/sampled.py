"""How a loop with fixed gains and held torques grows from one control period to the next: its linear model's spectral radius."""

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm

from k1607_pin.control.adaptation import Gains


class Sampled(NamedTuple):
    """m directions that accelerate by ``mobility`` times a force that is held for a period: -(K x + D w) + z.

    w is the filtered velocity, z the integral.
    """

    mobility: Any
    """(m, m) M^-1 of joints, J M^-1 J^T of a tool"""
    K: Any
    """(m, m) force per error"""
    D: Any
    """(m, m) force per velocity"""
    contact: Any = 0.0
    """(m, m) stiffness of what is leaned on; it pushes all the time, not held"""
    integral: Any = 0.0
    """(m, m) rate of z per error, 1/s times the unit of K"""
    smoothing: float = 1.0
    """Share of the way to the measured velocity that w goes in a period; 1 without a filter"""


def transition(loop: Sampled, period: float) -> np.ndarray:
    """(4m, 4m) of (x, x', w, z) from one sample to the next, exact; period : s."""
    m = len(loop.mobility)
    O, I, a = np.zeros((m, m)), np.eye(m), loop.smoothing
    drift = np.block([[O, I, O], [-loop.mobility @ (loop.contact + O), O, loop.mobility], [O, O, O]])
    held = expm(period * drift)[: 2 * m]  # (2m, 3m) of (x, x', force) to (x, x')
    w = np.hstack([O, a * I, (1 - a) * I, O])
    force = np.hstack([-loop.K, O, O, I]) - loop.D @ w
    return np.vstack(
        [
            held[:, : 2 * m] @ np.eye(2 * m, 4 * m) + held[:, 2 * m :] @ force,
            w,
            np.hstack([-period * (loop.integral + O), O, O, I]),
        ]
    )


def growth(loop: Sampled, period: float) -> float:
    """The factor by which the fastest growing motion grows in a period [s]: above 1 the loop runs away, whatever starts it.

    What no force draws anywhere, and an integral that nothing feeds, stay as they are: a factor of 1.
    """
    return float(np.abs(np.linalg.eigvals(transition(loop, period))).max())


def pd_growth(mass: Any, gains: Gains, period: float) -> float:
    """`growth` of a (m, m) mass matrix under K_p e + K_d e' alone, so that it is below 1 where errors die out.

    For K_p = omega^2 mass and K_d = 2 omega mass they do while omega period < 1.
    """
    loop = Sampled(np.linalg.inv(mass), *gains)
    moving = slice(2 * len(mass))  # without filter and integral (x, x') are all there is
    return float(np.abs(np.linalg.eigvals(transition(loop, period)[moving, moving])).max())
