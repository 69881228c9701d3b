"""Functions of time alone, and noise: what a closed loop takes besides states and parameters."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from k1607_pin.compiled.leaves import Layout
from k1607_pin.simulation.noise import WhiteNoise


@dataclass(frozen=True)
class Table:
    """A function of time that symbols stand for: evaluated at every sample before a run, the same for all lanes."""

    name: str
    fun: Callable[[float], Any]
    at: ca.Function | None
    """Time of the sample [s] -> the time that the function is asked for; None for the time of the sample itself"""
    layout: Layout
    first: int
    """Of its symbols among those of all tables"""

    def one(self, t: float) -> Any:
        """What the function gives at the sample at time t [s]."""
        return self.fun(t if self.at is None else float(self.at(t)))

    def values(self, times: np.ndarray) -> np.ndarray:
        """(len(times), size)"""
        asked = times if self.at is None else self.at(times[None, :]).full().ravel()
        rows = [self.layout.flat(self.fun(float(t))) for t in asked]
        return np.array(rows, dtype=float).reshape(len(times), self.layout.size)


@dataclass(frozen=True)
class Tables:
    """All those of the law, or of the physics."""

    tables: tuple[Table, ...]
    noise: tuple[tuple[str, WhiteNoise], ...]
    """Name of its seed, and source"""

    @property
    def size(self) -> int:
        """How many numbers `shared_values` are at a time: the time itself, and what all tables give."""
        return 1 + sum(table.layout.size for table in self.tables)

    def shared_values(self, times: np.ndarray) -> np.ndarray:
        """(len(times), size), what `Tracer.shared_inputs` stands for."""
        return np.concatenate([times[:, None], *(table.values(times) for table in self.tables)], axis=1)
