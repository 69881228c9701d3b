"""A sweep cut into chunks: boxes of its dimensions, each an unbroken stretch of rollouts."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Cut:
    """Chunks of up to so many of each dimension: 1 of the first ones, some of one, all of those after it."""

    dims: Mapping[str, int]
    """Name and size, the last one changing fastest"""
    box: tuple[int, ...]
    """Sizes of a chunk; at the end of a dimension it is smaller"""

    @classmethod
    def of(cls, dims: Mapping[str, int], rollouts: int) -> "Cut":
        """The largest chunks of at most so many rollouts."""
        box: list[int] = []
        left = rollouts
        for size in reversed(list(dims.values())):
            box.append(max(1, min(size, left)))
            left = left // size if box[-1] == size else 0
        return cls(dims, tuple(reversed(box)))

    @property
    def count(self) -> int:
        """How many"""
        return math.prod(self._along)

    @property
    def _along(self) -> tuple[int, ...]:
        return tuple(-(-size // b) for size, b in zip(self.dims.values(), self.box, strict=True))

    def index(self, k: int) -> dict[str, int]:
        """Which one along each dimension chunk k is."""
        return dict(zip(self.dims, map(int, np.unravel_index(k, self._along)), strict=True))

    def region(self, k: int) -> dict[str, slice]:
        """Of chunk k, by dimension."""
        return {
            name: slice(i * b, min((i + 1) * b, self.dims[name]))
            for (name, i), b in zip(self.index(k).items(), self.box, strict=True)
        }

    def size(self, k: int) -> int:
        """Rollouts of chunk k."""
        return math.prod(s.stop - s.start for s in self.region(k).values())

    def stretch(self, k: int) -> tuple[int, int]:
        """First rollout of chunk k, and the one after its last."""
        first = 0
        for name, s in self.region(k).items():
            first = first * self.dims[name] + s.start
        return first, first + self.size(k)

    def write(self, k: int, target: Any, dims: Sequence[str], x: np.ndarray) -> None:
        """Chunk k's x (rollouts, ...) into the whole's array over ``dims``, which may lack some of the sweep's."""
        region = self.region(k)
        box = x.reshape(*(s.stop - s.start for s in region.values()), *x.shape[1:])
        target[tuple(s for name, s in region.items() if name in dims)] = box[
            tuple(slice(None) if name in dims else 0 for name in region)
        ]
