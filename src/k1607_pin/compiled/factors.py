"""Numbers of a controller that are free, as factors on what they are: signs and positive definiteness stay."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from k1607_pin.compiled.leaves import numbers

KINDS = ("scale", "axes")
FACTORS = (0.1, 10.0)
"""Between which a number may change where nothing else is said"""


@dataclass
class Factors:
    """x = x_0 exp(A z) for all free numbers x, in terms of p log factors z.

    Parameters
    ----------
    free : as `tune` takes it.

    Raises
    ------
    ValueError
        Names that there are not, numbers that are 0, factors that are not positive, or of wrong shape or order.
    """

    controller: Any
    free: Mapping[str, Any]

    def __post_init__(self) -> None:
        there = {f"controller.{name}": x for name, x in numbers(self.controller).items()}
        if not self.free:
            raise ValueError("free: expected at least one name, got none")
        self.start: dict[str, np.ndarray] = {}
        self.count: dict[str, int] = {}
        blocks, lower, upper = [], [], []
        for name, asked in self.free.items():
            if name not in there:
                raise ValueError(f"free: expected some of {', '.join(there)}, got {name!r}")
            x = self.start[name] = there[name]
            if not x.any():
                raise ValueError(f"free: expected numbers that a factor changes, got {name} = 0")
            low, high = self._range(name, asked, x)
            self.count[name] = len(low)
            blocks.append(_mixing(x.shape, len(low)))
            lower.append(np.log(low))
            upper.append(np.log(high))
        self.lower, self.upper = np.concatenate(lower), np.concatenate(upper)
        self.A = block_diag(*blocks)
        self.x_0 = np.concatenate([x.ravel() for x in self.start.values()])

    @staticmethod
    def _range(name: str, asked: Any, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        m = x.shape[0] if x.ndim else 1
        if isinstance(asked, str) and asked in KINDS:
            low, high = (np.full(m if asked == "axes" else 1, f) for f in FACTORS)
            return low, high
        try:
            low, high = (np.atleast_1d(np.array(side, dtype=float)) for side in asked)
            good = (
                low.shape == high.shape and low.shape in ((1,), (m,)) and bool((0 < low).all() and (low <= high).all())
            )
            good = good and bool(np.isfinite(high).all())
        except (TypeError, ValueError):
            good = False
        if not good:
            raise ValueError(
                f"free[{name!r}]: expected 'scale', 'axes', or (lowest, highest) factors, positive, one or ({m},), got {asked!r}"
            )
        return low, high

    def flat(self, z: Any, exp: Any = np.exp) -> Any:
        """All free numbers, arrays row by row, at log factors z (p,); ``exp`` CasADi's for its symbols."""
        return self.x_0 * exp(self.A @ z)

    def values(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Each free number at z (..., p), its own shape last."""
        flat, out, k = self.x_0 * np.exp(z @ self.A.T), {}, 0
        for name, x in self.start.items():
            out[name] = flat[..., k : k + x.size].reshape((*z.shape[:-1], *x.shape))
            k += x.size
        return out

    def named(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """The factors of each free number."""
        parts = np.split(np.exp(z), np.cumsum(list(self.count.values()))[:-1])
        return {name: part if len(part) > 1 else part[0] for name, part in zip(self.start, parts, strict=True)}


def _mixing(shape: tuple[int, ...], count: int) -> np.ndarray:
    """(numbers, count): which log factors make up each number's; entry ij of a matrix has half of those of axes i and j."""
    if count == 1 or len(shape) == 1:
        return np.ones((int(np.prod(shape)), 1)) if count == 1 else np.eye(count)
    one = np.eye(count)
    return ((one[:, None] + one[None]) / 2).reshape(-1, count)
