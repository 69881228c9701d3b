"""Sweeps of the study cases, asked for in words."""

import math
import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from k1607_pin.compiled.samples import Distribution, Drawn, Grid, LogUniform, Normal, Uniform

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
    return tuple(re.split("[=~]", text)[0] for text in texts)


def parameters_of(texts: Sequence[str], count: int, seed: int, shapes: Mapping[str, tuple[int, ...]]) -> Grid | Drawn:
    """What ``texts`` say: "name=lower:upper:count" for a grid, "name~normal:mean:sigma" and the like for what is drawn.

    Parameters
    ----------
    count : rollouts drawn, at each point of the grid if there is one; by Sobol's points of ``seed``.
    shapes : of the parameters. All numbers of an array are the same on a grid, and drawn each for itself.

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
        try:
            sign, numbers = text[len(name) : len(name) + 1], text[len(name) + 1 :].split(":")
            if sign == "=":
                lower, upper, points = numbers
                axes[name] = np.multiply.outer(
                    np.linspace(float(lower), float(upper), int(points)), np.ones(shapes[name])
                )
            else:
                kind, *two = numbers
                drawn[name] = DISTRIBUTIONS[kind](*(np.full(shapes[name], float(x)) for x in two))
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(
                f"vary: expected name=lower:upper:count, or name~{'|'.join(DISTRIBUTIONS)}:number:number, got {text!r} ({error})"
            ) from None
    each = Drawn(drawn, count, seed) if drawn else None
    return Grid(axes, each) if axes else Drawn(drawn, count, seed)


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
