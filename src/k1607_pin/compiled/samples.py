"""Which rollouts a sweep makes: any stretch of them from the numbers of its first and last alone, in any process."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from k1607_pin.arguments import numbers as numbers_of
from k1607_pin.arguments import shown
from k1607_pin.compiled.leaves import numbers

ROLLOUT = "rollout"
"""Dimension of what is neither crossed nor reshaped."""


class Samples(Protocol):
    """What `sweep` takes."""

    @property
    def dims(self) -> dict[str, int]:
        """Name and size of each dimension of the result, the last one changing fastest."""

    @property
    def along(self) -> dict[str, str]:
        """Name of each parameter, and the dimension along which it changes."""

    def values(self, start: int, stop: int) -> dict[str, np.ndarray]:
        """Each parameter's (stop - start, ...) for the rollouts from ``start`` to before ``stop``."""

    def identity(self) -> dict[str, str]:
        """Something short and readable for each parameter and setting that is another one for other values."""


class Distribution(Protocol):
    """Uniform, LogUniform, Normal, Integers; a frozen distribution of scipy.stats does as well."""

    def ppf(self, u: Any) -> Any:
        """Values for shares u (..., shape) of the probability, within (0, 1); shape is that of the parameter."""


@dataclass(frozen=True)
class Uniform:
    """Between two numbers, or arrays of them."""

    lower: Any
    upper: Any

    def __post_init__(self) -> None:
        _require_order(self.lower, self.upper)

    def ppf(self, u: Any) -> Any:
        """See `Distribution`."""
        return self.lower + np.subtract(self.upper, self.lower) * u


@dataclass(frozen=True)
class LogUniform:
    """Between two positive numbers, or arrays of them; the logarithm is uniform."""

    lower: Any
    upper: Any

    def __post_init__(self) -> None:
        _require_order(self.lower, self.upper)
        if not np.all(np.asarray(self.lower) > 0):
            raise ValueError(f"lower: expected positive numbers, got {shown(self.lower)}")

    def ppf(self, u: Any) -> Any:
        """See `Distribution`."""
        return self.lower * np.exp(np.log(np.divide(self.upper, self.lower)) * u)


@dataclass(frozen=True)
class Normal:
    """Of a mean and a standard deviation, or arrays of them."""

    mean: Any
    sigma: Any

    def __post_init__(self) -> None:
        _, sigma = _numbers(mean=self.mean, sigma=self.sigma)
        if not (sigma > 0).all():
            raise ValueError(f"sigma: expected positive numbers, got {shown(self.sigma)}")

    def ppf(self, u: Any) -> Any:
        """See `Distribution`."""
        return self.mean + self.sigma * ndtri(u)


@dataclass(frozen=True)
class Integers:
    """Whole numbers from lower to before upper, seeds of noise say."""

    lower: int
    upper: int

    def __post_init__(self) -> None:
        _require_order(self.lower, self.upper)
        for name, x in (("lower", self.lower), ("upper", self.upper)):
            if (np.asarray(x, dtype=float) % 1).any():
                raise ValueError(f"{name}: expected whole numbers, got {shown(x)}")

    def ppf(self, u: Any) -> Any:
        """See `Distribution`."""
        return np.floor(self.lower + (self.upper - self.lower) * u)


@dataclass(frozen=True, eq=False)
class Scaled:
    """An array times one drawn factor: a matrix of gains, say, which stays what it is but for its size."""

    array: Any
    factor: Distribution

    def ppf(self, u: Any) -> Any:
        """See `Distribution`; of each array's shares the first one counts."""
        array, u = np.asarray(self.array, dtype=float), np.asarray(u)
        first = u[(..., *(0,) * array.ndim)] if u.ndim >= array.ndim and u.ndim else u
        return np.multiply.outer(self.factor.ppf(first), array)


@dataclass(frozen=True, eq=False)
class Entries:
    """An array with some of its entries drawn, each for itself: one gain of a matrix, say."""

    array: Any
    index: Any
    """Which, as NumPy has it: (0, 0), or slice(None) for all"""
    each: Distribution

    def __post_init__(self) -> None:
        array = _array("array", self.array)
        try:
            array[self.index]
        except (IndexError, TypeError, ValueError):
            raise ValueError(f"index: expected an entry of an array {array.shape}, got {self.index!r}") from None

    def ppf(self, u: Any) -> Any:
        """See `Distribution`."""
        array, u = np.asarray(self.array, dtype=float), np.asarray(u)
        u = np.broadcast_to(u, np.broadcast_shapes(u.shape, array.shape))
        out = np.broadcast_to(array, u.shape).copy()
        index = self.index if isinstance(self.index, tuple) else (self.index,)
        out[(..., *index)] = self.each.ppf(u[(..., *index)])
        return out


@dataclass(frozen=True, eq=False)
class Listed:
    """Rollouts one by one: name -> (N, ...) values of each parameter."""

    table: Mapping[str, Any]

    def __post_init__(self) -> None:
        table = {name: _array(name, x) for name, x in self.table.items()}
        counts = {name: len(x) for name, x in table.items()}
        if not table or len(set(counts.values())) > 1:
            raise ValueError(f"parameters: expected as many values of each, at least one, got {counts}")
        object.__setattr__(self, "table", table)

    @property
    def dims(self) -> dict[str, int]:
        """See `Samples`."""
        return {ROLLOUT: len(next(iter(self.table.values())))}

    @property
    def along(self) -> dict[str, str]:
        """See `Samples`."""
        return dict.fromkeys(self.table, ROLLOUT)

    def values(self, start: int, stop: int) -> dict[str, np.ndarray]:
        """See `Samples`."""
        return {name: x[start:stop] for name, x in self.table.items()}

    def identity(self) -> dict[str, str]:
        """See `Samples`."""
        return {name: digest(x) for name, x in self.table.items()}


@dataclass(frozen=True, eq=False)
class Drawn:
    """``count`` rollouts drawn: name -> distribution of each parameter.

    A rollout's values depend on its number and the seed (and on which parameters there are), not on how many are drawn.
    """

    distributions: Mapping[str, Distribution]
    count: int
    seed: int = 0
    points: str = "sobol"
    """"sobol": scrambled points of Sobol's, which fill the space evenly (at most 2^32); or "random": independent ones"""

    def __post_init__(self) -> None:
        for name, value, least in (("count", self.count, 1), ("seed", self.seed, 0)):
            if not isinstance(value, int | np.integer) or value < least:
                raise ValueError(f"{name}: expected a whole number >= {least}, got {value!r}")
        if self.points not in ("sobol", "random") or (self.points == "sobol" and self.count > 2**32):
            raise ValueError(
                f"points: expected 'sobol' (for at most 2^32 of them) or 'random', got {self.points!r} for {self.count}"
            )
        for name, x in self.distributions.items():
            if not hasattr(x, "ppf"):
                raise ValueError(f"{name}: expected a distribution (Uniform, Normal, of scipy.stats, ...), got {x!r}")
        if not self.distributions:
            raise ValueError("distributions: expected at least one, got none")

    @property
    def dims(self) -> dict[str, int]:
        """See `Samples`."""
        return {ROLLOUT: int(self.count)}

    @property
    def along(self) -> dict[str, str]:
        """See `Samples`."""
        return dict.fromkeys(self.distributions, ROLLOUT)

    def values(self, start: int, stop: int) -> dict[str, np.ndarray]:
        """See `Samples`."""
        shapes = {name: np.shape(x.ppf(0.5)) for name, x in self.distributions.items()}
        sizes = [int(np.prod(shape)) for shape in shapes.values()]
        u = (_sobol if self.points == "sobol" else _random)(self.seed, sum(sizes), start, stop)
        parts = np.split(u, np.cumsum(sizes)[:-1], axis=1)
        return {
            name: np.array(x.ppf(np.ascontiguousarray(part).reshape(-1, *shapes[name])), dtype=float)
            for (name, x), part in zip(self.distributions.items(), parts, strict=True)
        }

    def identity(self) -> dict[str, str]:
        """See `Samples`."""
        made = {name: _identity(x) for name, x in self.distributions.items()}
        return {**made, "count": str(self.count), "seed": str(self.seed), "points": self.points}


@dataclass(frozen=True, eq=False)
class Grid:
    """Every combination: name -> (N, ...) values of each parameter; the result has a dimension for each.

    A dimension is called as its parameter, with ".number" after it where the parameter is no single number.
    """

    axes: Mapping[str, Any]
    each: "Listed | Drawn | None" = None
    """What is done at each point of the grid, the same at all of them"""

    def __post_init__(self) -> None:
        axes = {name: _array(name, x) for name, x in self.axes.items()}
        if not axes or (both := set(axes) & set(self.each.along if self.each else ())):
            raise ValueError(
                f"axes: expected at least one, and none of each, got {', '.join(sorted(both)) if axes else 'none'}"
            )
        object.__setattr__(self, "axes", axes)

    @property
    def dims(self) -> dict[str, int]:
        """See `Samples`."""
        mine = {self.along[name]: len(x) for name, x in self.axes.items()}
        return mine | (self.each.dims if self.each else {})

    @property
    def along(self) -> dict[str, str]:
        """See `Samples`."""
        mine = {name: name if x.ndim == 1 else f"{name}.number" for name, x in self.axes.items()}
        return mine | (self.each.along if self.each else {})

    def values(self, start: int, stop: int) -> dict[str, np.ndarray]:
        """See `Samples`."""
        where = np.unravel_index(np.arange(start, stop), tuple(self.dims.values()))
        found = {name: x[i] for (name, x), i in zip(self.axes.items(), where, strict=False)}
        if self.each is None:
            return found
        first, last = int(where[-1].min()), int(where[-1].max())
        return found | {name: x[where[-1] - first] for name, x in self.each.values(first, last + 1).items()}

    def identity(self) -> dict[str, str]:
        """See `Samples`."""
        mine = {name: digest(x) for name, x in self.axes.items()}
        return mine | (self.each.identity() if self.each else {})


def digest(x: Any) -> str:
    """Shape and a hash of an array's numbers."""
    x = np.ascontiguousarray(x, dtype=float)
    return f"{x.shape} {hashlib.sha256(x.tobytes()).hexdigest()[:16]}"


def _identity(x: Distribution) -> str:
    """What it gives at some shares; of what may agree there and not elsewhere, its own numbers too."""
    found = digest(np.stack([x.ppf(u) for u in np.linspace(0, 1, 35)[1:-1]]))
    own = [digest(value) for value in numbers(x).values()]
    return " ".join([type(x).__name__, found, *own])


def _sobol(seed: int, d: int, start: int, stop: int) -> np.ndarray:
    """(stop - start, d) within (0, 1)"""
    bits = 32
    points = qmc.Sobol(d, bits=bits, seed=np.random.default_rng(seed))
    rows = []
    if start == 0:
        rows.append(points.random(1))  # alone: scipy warns of a first batch that is no power of two
    else:
        points.fast_forward(start)
    if stop - max(start, 1) > 0:
        rows.append(points.random(stop - max(start, 1)))
    return np.concatenate(rows) + 2.0 ** -(bits + 1)


def _random(seed: int, d: int, start: int, stop: int) -> np.ndarray:
    """(stop - start, d) within (0, 1)"""
    bits = np.random.PCG64(seed).advance(start * d).random_raw((stop - start) * d)
    return ((bits >> np.uint64(12)).astype(float) * 2.0**-52 + 2.0**-53).reshape(-1, d)


def _array(name: str, x: Any) -> np.ndarray:
    array = numbers_of(name, x)
    if array.ndim == 0 or not array.size:
        raise ValueError(f"{name}: expected (N, ...) finite numbers, at least one, got {shown(x)}")
    return array


def _numbers(**bounds: Any) -> list[np.ndarray]:
    """Each as finite numbers, at least one; of shapes that fit."""
    arrays = [numbers_of(name, x) for name, x in bounds.items()]
    for name, x in zip(bounds, arrays, strict=True):
        if not x.size:
            raise ValueError(f"{name}: expected a finite number, or an array of them, got {shown(bounds[name])}")
    try:
        np.broadcast_shapes(*(x.shape for x in arrays))
    except ValueError:
        shapes = " and ".join(str(x.shape) for x in arrays)
        raise ValueError(f"{', '.join(bounds)}: expected one shape, got {shapes}") from None
    return arrays


def _require_order(lower: Any, upper: Any) -> None:
    low, high = _numbers(lower=lower, upper=upper)
    if not (low < high).all() or not np.isfinite(high - low).all():
        raise ValueError(f"lower, upper: expected lower < upper, got {shown(lower)}, {shown(upper)}")
