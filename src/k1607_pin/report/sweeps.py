"""Sweeps of the study cases, asked for in words."""

import math
import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from k1607_pin.compiled.samples import Distribution, Drawn, Entries, Grid, LogUniform, Normal, Scaled, Uniform

DISTRIBUTIONS: dict[str, Callable[..., Distribution]] = {
    "uniform": Uniform,
    "loguniform": LogUniform,
    "normal": Normal,
}
SHOWN = 10**6
QUANTILES = (0.05, 0.5, 0.95, 1.0)
QUANTITIES = (
    ("largest position error, mm", "error_max", ["x", "y", "z"], 1e3),
    ("largest orientation error, deg", "error_max", ["rx", "ry", "rz"], 180 / np.pi),
    ("RMS position error, mm", "error_rms", ["x", "y", "z"], 1e3),
    ("RMS orientation error, deg", "error_rms", ["rx", "ry", "rz"], 180 / np.pi),
)
"""Of a rollout, its worst axis"""


def names_of(texts: Sequence[str]) -> tuple[str, ...]:
    """The parameters that the texts of `parameters_of` are about."""
    return tuple(re.split(r"[=~*\[]", text)[0] for text in texts)


def parameters_of(texts: Sequence[str], count: int, seed: int, now: Mapping[str, np.ndarray]) -> Grid | Drawn:
    """What ``texts`` say: "name=lower:upper:count" for a grid, "name~normal:mean:sigma" and the like for what is drawn.

    An array is scaled, "name*=0.5:2:7" or "name*~uniform:0.5:2", or some of its entries are named, "name[0,0]=500:5000:3", all
    of them by "name[:]", the others staying what they are. A vector without either is drawn entry by entry; everything else is
    refused, as it is where values are arrays.

    Parameters
    ----------
    count : rollouts drawn, at each point of the grid if there is one; by Sobol's points of ``seed``.
    now : each parameter as it is where it is not varied.

    Raises
    ------
    ValueError
        A text that says something else.
    """
    if not texts:
        raise ValueError("vary: expected at least one parameter, got none")
    if double := {name for name in names_of(texts) if names_of(texts).count(name) > 1}:
        raise ValueError(f"vary: expected each parameter once, got {', '.join(sorted(double))} twice")
    axes: dict[str, np.ndarray] = {}
    drawn: dict[str, Distribution] = {}
    for text, name in zip(texts, names_of(texts), strict=True):
        found = TEXT.fullmatch(text[len(name) :])
        try:
            if found is None:
                raise ValueError("no = or ~")
            first, *rest = found["rest"].split(":")
            if found["sign"] == "=":
                upper, points = rest
                x = np.linspace(float(first), float(upper), int(points))
                axes[name] = _which(name, found, now[name]).at(x)
            else:
                kind, two = DISTRIBUTIONS[first], [float(number) for number in rest]
                drawn[name] = _which(name, found, now[name]).drawn(kind, *two)
        except _NamedError:
            raise
        except (ValueError, KeyError, TypeError, MemoryError) as error:
            raise ValueError(
                f"vary: expected name=lower:upper:count, or name~{'|'.join(DISTRIBUTIONS)}:number:number, got {text!r} ({error})"
            ) from None
    each = Drawn(drawn, count, seed) if drawn else None
    return Grid(axes, each) if axes else Drawn(drawn, count, seed)


TEXT = re.compile(r"(?P<which>\*|\[[^\]]*\])?(?P<sign>[=~])(?P<rest>.*)")


class _NamedError(ValueError):
    """What is wrong with which numbers of an array are meant."""


class _Varied:
    """A number or an array ``now``, of which some entries (None: all, scaled) become others."""

    def __init__(self, now: np.ndarray, index: tuple[int | slice, ...] | None) -> None:
        self._now, self._index = now, index

    def at(self, x: np.ndarray) -> np.ndarray:
        """(N, ...) for the values x (N,)."""
        if self._index is None:
            return np.multiply.outer(x, self._now)
        out = np.repeat(self._now[None], len(x), axis=0)
        out[(slice(None), *self._index)] = x.reshape(-1, *[1] * self._now[self._index].ndim)
        return out

    def drawn(self, kind: Callable[..., Distribution], *numbers: float) -> Distribution:
        """Scaled by one draw, or each entry by its own."""
        if self._index is None:
            return Scaled(self._now, kind(*numbers))
        return Entries(self._now, self._index, kind(*numbers)) if self._now.ndim else kind(*numbers)


def _which(name: str, found: re.Match[str], now: np.ndarray) -> _Varied:
    which, sign, rest = found["which"], found["sign"], found["rest"]
    scale = f"{name}*=0.5:2:{rest.rpartition(':')[2]}" if sign == "=" else f"{name}*~uniform:0.5:2"
    one = ",".join(["0"] * now.ndim)
    told = f"type {scale} to scale it"
    if now.ndim:
        told += f", {name}[{one}]{sign}{rest} for one entry, {name}[:]{sign}{rest} for all of them"
    if which == "*":
        if not now.any():
            raise _NamedError(f"vary: {name} is zero, which no factor changes")
        return _Varied(now, None)
    if which is None:
        if now.ndim == 0:
            return _Varied(now, ())
        if now.ndim == 1 and sign == "~":
            return _Varied(now, (slice(None),))
        raise _NamedError(f"vary: {name} is an array {now.shape}, not a number: {told}")
    try:
        texts = which[1:-1].split(",")
        texts *= now.ndim if texts == [":"] else 1  # of a matrix too: all of it
        index = tuple(slice(None) if x.strip() == ":" else int(x) for x in texts)
        if len(index) != now.ndim:
            raise ValueError
        now[index]
    except (ValueError, IndexError):
        what = f"an array {now.shape}" if now.ndim else "a number"
        raise _NamedError(f"vary: expected an entry of {name}, {what}, got {name}{which}: {told}") from None
    return _Varied(now, index)


def summary(found: xr.Dataset) -> tuple[dict[str, list[float]], float, int]:
    """Quantiles (`QUANTILES`) of each of `QUANTITIES` among rollouts that were not lost, the share lost, and of how many.

    Of more than a million rollouts some are left out, at equal distances along the longest dimension, so that memory is bounded.
    """
    total = found.failed_at.size
    longest = max(found.failed_at.dims, key=lambda dim: found.sizes[dim])
    some = found.isel({longest: slice(None, None, math.ceil(total / SHOWN))})
    kept = np.isnan(some.failed_at.values)
    rows = {}
    for label, name, directions, scale in QUANTITIES:
        worst = some[name].sel(direction=directions).max("direction").values[kept]
        rows[label] = (scale * np.quantile(worst, QUANTILES)).tolist() if worst.size else [math.nan] * len(QUANTILES)
    return rows, float(1 - kept.mean()), int(kept.size)
