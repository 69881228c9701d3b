"""Functions of time alone, and noise: what a closed loop takes besides states and parameters."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from k1607_pin.compiled.leaves import Layout
from k1607_pin.compiled.nest import TracingError
from k1607_pin.simulation.noise import WhiteNoise

AGAIN = 1e-9  # of the values: what a path that begins at its last result may leave


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
        """(len(times), size)

        Raises
        ------
        TracingError
            Asked again for the first time it gives something else: not a function of time alone.
        """
        asked = times if self.at is None else self.at(times[None, :]).full().ravel()
        rows = np.array([self.layout.flat(self.fun(float(t))) for t in asked], dtype=float)
        rows = rows.reshape(len(times), self.layout.size)
        again = np.array(self.layout.flat(self.fun(float(asked[0]))), dtype=float)
        if not np.allclose(again, rows[0], AGAIN, AGAIN * np.abs(rows[0]).max(initial=0.0), equal_nan=True):
            raise TracingError(
                f"{self.name}: expected a function of time alone, got another value when asked again for t = {asked[0]:g} s; "
                "what a law must remember is part of its state, and noise is simulation.noise.WhiteNoise"
            )
        return rows


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
