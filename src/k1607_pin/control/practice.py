"""What practice needs and the report's laws lack: off by default, and the same for every scheme.

Without them the gains of (76)-(77) grow for as long as there is any error, that of noise and of gravity included.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arguments import as_floats, number, numbers, shown
from k1607_pin.control.adaptation import Gains, adapted, checked_gains, gain_rates
from k1607_pin.control.reference_model import ReferenceModel


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
    """Largest `relative_size` of what a gain may move from K(0): projection. Below 1 it stays positive definite."""
    dead_zone: Any = 0.0
    """(m,) or one number: adaptation rests while every error is below it; units of the error"""
    torque_limit: Any = None
    """(n,) N m: a torque vector beyond it is scaled down, and adaptation rests for that period; None for none"""
    velocity_cutoff: float = np.inf
    """rad/s, of a first-order low-pass on the joint velocities"""
    gravity: bool = False
    """Whether the model's gravity torque is added; the arm's, without payload"""

    def __post_init__(self) -> None:
        number("sigma", self.sigma, at_least=0, unit="1/s")
        number("gain_bound", self.gain_bound, at_least=0, finite=False)
        number("velocity_cutoff", self.velocity_cutoff, 0, unit="rad/s", finite=False)
        expected = "one number >= 0 or (m,) of them"
        zone = as_floats("dead_zone", self.dead_zone, expected)
        if zone.ndim > 1 or not (zone >= 0).all():
            raise ValueError(f"dead_zone: expected {expected}, got {shown(self.dead_zone)}")
        if self.torque_limit is not None:
            expected = "(n,) positive numbers in N m"
            limit = as_floats("torque_limit", self.torque_limit, expected)
            if limit.ndim != 1 or not (limit > 0).all():
                raise ValueError(f"torque_limit: expected {expected}, got {shown(self.torque_limit)}")
            object.__setattr__(self, "torque_limit", limit.copy())

    def check(self, n: int, m: int, start: Gains) -> None:
        """Refuse, by `ValueError`, a torque limit that is not (n,), a dead zone that is neither one number nor (m,), and a gain
        bound where K(0), (m, m), is no measure: where its symmetric part is not positive definite.
        """
        if self.torque_limit is not None and self.torque_limit.shape != (n,):
            raise ValueError(f"torque_limit: expected ({n},), got {self.torque_limit.shape}")
        if np.shape(self.dead_zone) not in ((), (m,)):
            raise ValueError(f"dead_zone: expected one number or ({m},), got {np.shape(self.dead_zone)}")
        for name, k in zip(Gains._fields, start, strict=True) if self.gain_bound < np.inf else ():
            if not (least := np.linalg.eigvalsh(k + k.T)[0] / 2) > 0:
                raise ValueError(
                    f"gain_bound: expected a positive definite {name}(0) to measure by, got an eigenvalue of {least:.3g}"
                )


OFF = Practice()


def check_practice(name: str, practice: Any, n: int, m: int, start: Gains) -> None:
    """Refuse, by `ValueError`, what is no `Practice`, or one that does not `Practice.check` for n joints and m errors."""
    if not isinstance(practice, Practice):
        raise ValueError(f"{name}: expected a Practice, got {shown(practice)}")
    try:
        practice.check(n, m, start)
    except ValueError as error:
        raise ValueError(f"{name}.{error}") from None


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


def relative_size(start: Any, change: Any) -> Any:
    """How large a change of a gain is against K(0), both (m, m): |L^-1 change L^-T| (Frobenius), L L^T K(0)'s symmetric part.

    The same in any coordinates x of the error, where a gain turns into T^T K T: in metres or centimetres, in axes turned anyhow.
    As no eigenvalue exceeds the norm, x^T change x is at most this share of x^T K(0) x, for every x.
    """
    inverse = np.linalg.inv(np.linalg.cholesky((start + start.T) / 2))
    scaled = inverse @ change @ inverse.T
    return np.sqrt(np.sum(scaled * scaled))


def adaptation_rates(gains: Gains, model: ReferenceModel, disturbance: Any, rate: float) -> tuple[float, float]:
    """beta_1 and beta_2 with which each gain moves by ``rate`` [1/s] of itself, see `relative_size`, under a disturbance.

    beta multiplies squares of errors, and those that a load makes are as its force over K(0): of gains in proportion to a light
    wrist's own inertia, a hundred times those of an arm with heavy rotors. A number that suits one arm runs another one's gains
    away; a rate suits both. K_p is taken with the error that the disturbance holds against it, K_d with its rate against K_d.

    Parameters
    ----------
    gains : K(0), (m, m) each, positive definite; disturbance : (m,) N m of joints, or N, N m at the tool: J^T of a payload's
        weight, or that weight.

    Raises
    ------
    ValueError
        A disturbance that is zero or not (m,) finite numbers, a negative rate, gains that are not positive definite.
    """
    if not isinstance(model, ReferenceModel):
        raise ValueError(f"model: expected a ReferenceModel, got {shown(model)}")
    gains = checked_gains(gains, len(model.P_2))
    for name, k in zip(Gains._fields, gains, strict=True):
        if not (least := np.linalg.eigvalsh(k + k.T)[0] / 2) > 0:
            raise ValueError(f"gains: expected a positive definite {name}, got an eigenvalue of {least:.3g}")
    still = np.zeros(len(gains.K_p))
    if not (d := numbers("disturbance", disturbance, still.shape)).any():
        raise ValueError(f"disturbance: expected ({len(still)},) finite numbers, not all zero, got {disturbance!r}")
    rate = number("rate", rate, at_least=0, unit="1/s")
    P_2, P_3 = model.P_2, model.P_3
    of_K_p = gain_rates(P_2, P_3, 1.0, 1.0, np.linalg.solve(gains.K_p, d), still).K_p
    of_K_d = gain_rates(P_2, P_3, 1.0, 1.0, still, np.linalg.solve(gains.K_d, d)).K_d
    pairs = ((gains.K_p, of_K_p), (gains.K_d, of_K_d))
    beta_1, beta_2 = (rate / float(relative_size(k, speed)) for k, speed in pairs)
    return beta_1, beta_2


def _bounded(start: Any, k: Any, bound: float) -> Any:
    """k, or the point on the way to it from ``start`` where the bound is."""
    if bound == np.inf:
        return k
    away = k - start
    return start + away * (bound / np.maximum(np.maximum(relative_size(start, away), bound), TINY))


TINY = 1e-300  # where nothing may move and nothing has: 0 / 0
