"""White noise of what a controller measures: a function of seed and time, so that any sample can be had without those before."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

_ODD = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio


def _mixed(x: Any) -> Any:
    """A 64-bit number well mixed (Stafford's variant 13, as in SplitMix64: Steele, Lea and Flood, OOPSLA 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def standard_normal(seed: int, sample: int, size: int) -> np.ndarray:
    """(size,) independent normal numbers of mean 0 and deviation 1, of one seed (0 to 2^53) at one sample.

    Box and Muller's pairs of two uniform numbers each, from a counter: the same on every machine to the last digits of a
    logarithm and a sine.
    """
    pairs = np.arange((size + 1) // 2, dtype=np.uint64)
    with np.errstate(over="ignore"):
        stream = _mixed(_mixed(np.uint64(seed) + _ODD) + np.uint64(sample) * _ODD)
        bits = [_mixed(stream + (np.uint64(2) * pairs + np.uint64(k + 1)) * _ODD) for k in range(2)]
    first, second = ((b >> np.uint64(12)).astype(float) * 2.0**-52 + 2.0**-53 for b in bits)  # within (0, 1)
    radius = np.sqrt(-2 * np.log(first))
    angle = 2 * np.pi * second
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1).ravel()[:size]


@dataclass(frozen=True)
class WhiteNoise:
    """A function of time: (size,) standard normal numbers, others at every sample.

    Raises
    ------
    ValueError
        A seed that is no whole number from 0 to 2^53, a size or period that is not positive.
    """

    seed: int
    size: int
    period: float
    """s between samples"""

    def __post_init__(self) -> None:
        if not (0 <= self.seed <= 2**53 and int(self.seed) == self.seed):
            raise ValueError(f"seed: expected a whole number from 0 to 2^53, got {self.seed!r}")
        if not self.size > 0 or not 0 < self.period < np.inf:
            raise ValueError(f"size, period: expected positive numbers, got {self.size!r}, {self.period!r}")

    def __call__(self, t: float) -> np.ndarray:
        """(size,) at time t [s]."""
        return standard_normal(int(self.seed), round(t / self.period), self.size)


@dataclass(frozen=True)
class NoisyMeasurement:
    """A controller that is told joint angles and velocities with white noise; see `with_noise`."""

    law: Any
    noise: WhiteNoise
    """of 2 n numbers"""
    sigma_q: float
    """rad, standard deviation"""
    sigma_v: float
    """rad/s"""

    @property
    def variables(self) -> Mapping[str, Any]:
        """The law's own."""
        return getattr(self.law, "variables", {})

    @property
    def period(self) -> float:
        """s"""
        return self.noise.period

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> Any:
        """The law's state."""
        return self.law.start(q, v, duration)

    @property
    def initial(self) -> Any:
        """The law's own, if it has one: q, v (n,) -> its state, unchecked."""
        return self.law.initial

    def update(self, t: Any, q: Any, v: Any, state: Any) -> tuple[Any, Any, Mapping[str, Any]]:
        """The law's; what it logs is what it saw."""
        n, noise = len(q), self.noise(t)
        return self.law.update(t, q + self.sigma_q * noise[:n], v + self.sigma_v * noise[n:], state)


def with_noise(law: Any, n: int, period: float, sigma_q: float, sigma_v: float, seed: int = 0) -> NoisyMeasurement:
    """The law, measuring n joints every ``period`` [s] with noise of deviation sigma_q [rad] and sigma_v [rad/s].

    Raises
    ------
    ValueError
        Deviations that are negative or not finite; see `WhiteNoise`.
    """
    for name, sigma in (("sigma_q", sigma_q), ("sigma_v", sigma_v)):
        if not 0 <= sigma < np.inf:
            raise ValueError(f"{name}: expected a number >= 0, got {sigma!r}")
    return NoisyMeasurement(law, WhiteNoise(seed, 2 * n, period), sigma_q, sigma_v)
