"""Sensors that are not exact: white noise on what a controller is told."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

NOISE = (2e-5, 2e-3)  # rad, an encoder of 18 bits; rad/s (assumed)


@dataclass(frozen=True)
class Noisy:
    """A controller that is told joint angles and velocities with white noise; the same on every run."""

    law: Any
    period: float
    """s"""
    noise: tuple[float, float]
    """Standard deviation, rad and rad/s"""
    seed: int = 0

    @property
    def variables(self) -> Mapping[str, Any]:
        """The law's own."""
        return getattr(self.law, "variables", {})

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> tuple[Any, np.ndarray]:
        """The law's state, and all the noise there will be."""
        shape = (round(duration / self.period) + 1, 2, len(q))
        noise = np.random.default_rng(self.seed).normal(size=shape) * np.array(self.noise)[:, None]
        return self.law.start(q, v, duration), noise

    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: Any) -> tuple[np.ndarray, Any, Mapping[str, Any]]:
        """The law's; what it logs is what it saw."""
        inner, noise = state
        of_q, of_v = noise[round(t / self.period)]
        torque, inner, log = self.law.update(t, q + of_q, v + of_v, inner)
        return torque, (inner, noise), log
