"""What practice needs and the report's laws lack: off by default, and the same for every scheme.

Without them the gains of (76)-(77) grow for as long as there is any error, that of noise and of gravity included.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.control.adaptation import Gains, adapted


@dataclass(frozen=True)
class Practice:
    """Options of an adaptive scheme; each is off at its default.

    Raises
    ------
    ValueError
        Negative numbers, NaN, a torque limit that is not positive.
    """

    sigma: float = 0.0
    """1/s: leak of the gains towards K(0), sigma-modification (Ioannou and Kokotovic, 1983)"""
    gain_bound: float = np.inf
    """Largest distance of a gain matrix from its K(0), in multiples of the Frobenius norm of K(0): projection"""
    dead_zone: Any = 0.0
    """(m,) or one number: adaptation rests while every error is below it; units of the error"""
    torque_limit: Any = None
    """(n,) N m: a torque vector beyond it is scaled down, and adaptation rests for that period; None for none"""
    velocity_cutoff: float = np.inf
    """rad/s, of a first-order low-pass on the joint velocities"""
    gravity: bool = False
    """Whether the model's gravity torque is added; the arm's, without payload"""

    def __post_init__(self) -> None:
        for name in ("sigma", "gain_bound", "dead_zone"):
            if not np.all(np.asarray(getattr(self, name), dtype=float) >= 0):
                raise ValueError(f"{name}: expected numbers >= 0, got {getattr(self, name)!r}")
        if not self.velocity_cutoff > 0:
            raise ValueError(f"velocity_cutoff: expected a positive number in rad/s, got {self.velocity_cutoff!r}")
        if self.torque_limit is not None:
            limit = np.array(self.torque_limit, dtype=float)
            if limit.ndim != 1 or not (limit > 0).all():
                raise ValueError(f"torque_limit: expected (n,) positive numbers in N m, got {self.torque_limit!r}")
            object.__setattr__(self, "torque_limit", limit)

    def check(self, n: int, m: int) -> None:
        """Refuse, by `ValueError`, a torque limit that is not (n,) or a dead zone that is neither one number nor (m,)."""
        if self.torque_limit is not None and self.torque_limit.shape != (n,):
            raise ValueError(f"torque_limit: expected ({n},), got {self.torque_limit.shape}")
        if np.shape(self.dead_zone) not in ((), (m,)):
            raise ValueError(f"dead_zone: expected one number or ({m},), got {np.shape(self.dead_zone)}")


OFF = Practice()


class AdaptiveState(NamedTuple):
    """What an adaptive scheme carries from one control period to the next."""

    gains: Gains
    velocity: Any
    """(n,) rad/s, filtered"""


def filtered(before: Any, v: Any, period: float, practice: Practice) -> Any:
    """(n,) rad/s: the filtered velocity from the filter's last output (n,) and the measured v (n,), one period [s] on."""
    if practice.velocity_cutoff == np.inf:
        return v
    return before + (1 - np.exp(-practice.velocity_cutoff * period)) * (v - before)


def limited(torque: Any, practice: Practice) -> tuple[Any, Any]:
    """(n,) N m within the limits and in the direction of ``torque`` (n,), and the share of it, at most 1, that is left."""
    if practice.torque_limit is None:
        return torque, 1.0
    share = np.min(practice.torque_limit / np.maximum(np.abs(torque), practice.torque_limit))
    return share * torque, share


def next_gains(
    start: Gains, gains: Gains, rates: Gains, error: Any, share: Any, period: Any, practice: Practice
) -> Gains:
    """The gains one period [s] later, from those at work and the rates that the law asks for.

    Parameters
    ----------
    start : K(0); error : (m,) what the dead zone looks at; share : of the torque, see `limited`.
    """
    new = [
        _bounded(k0, adapted_one, practice.gain_bound)
        for k0, adapted_one in zip(
            start, adapted(gains, _leaking(start, gains, rates, practice.sigma), period), strict=True
        )
    ]
    rests = practice.torque_limit is not None or np.any(np.asarray(practice.dead_zone) > 0)
    if not rests:
        return Gains(*new)
    at_work = np.where(np.max(np.abs(error) - practice.dead_zone) > 0, np.where(share < 1, 0.0, 1.0), 0.0)
    return Gains(*(old + at_work * (k - old) for old, k in zip(gains, new, strict=True)))


def _leaking(start: Gains, gains: Gains, rates: Gains, sigma: float) -> Gains:
    if sigma == 0:
        return rates
    return Gains(*(rate - sigma * (k - k0) for k0, k, rate in zip(start, gains, rates, strict=True)))


def _bounded(start: Any, k: Any, bound: float) -> Any:
    """k, or the point towards ``start`` where the distance to it is ``bound`` of start's own norm."""
    if bound == np.inf:
        return k
    away = k - start
    reach = bound * np.sqrt(np.sum(start * start))
    norm = np.sqrt(np.sum(away * away))
    return start + away * (reach / np.maximum(np.maximum(norm, reach), TINY))


TINY = 1e-300  # where start is zero and nothing has moved: 0 / 0
