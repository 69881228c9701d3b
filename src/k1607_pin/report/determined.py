"""How well the 16 published errors determine each unknown of a set that meets them."""

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.report.candidates import Candidates, accepted
from k1607_pin.report.unknowns import DURATION, LOWER, NAMES, UPPER, from_steps, to_steps, values_of

AWAY = np.geomspace(0.01, 8.0, 16)  # steps of the search by which one unknown is moved, the others held
TILT = 0.02  # steps for the differences that correlations come from
TOLERANCE = 0.1  # of each number: what the correlations take for a standard deviation
PRIOR = 3.0  # steps: of each unknown, so that what has no effect has a spread at all
STRONG = 0.8


class Determined(NamedTuple):
    """Of a set's unknowns, in the order of `NAMES`."""

    lower: np.ndarray
    upper: np.ndarray
    """(unknowns,) each moved alone: how far it goes with all 16 within 25 % and what is negligible so; a search bound where
    nothing stops it before"""
    pairs: list[tuple[str, str, float]]
    """Pairs that can trade for each other and the correlation of their estimates, the strongest first"""
    rollouts: int


def determined(choice: dict[str, Any], threads: int | None = None) -> Determined:
    """Of a table like "report" of `study_cases.toml`, at its own physics step."""
    candidates = Candidates(choice, threads=threads)
    here = to_steps(values_of(choice))
    n = len(here)
    moved = np.array([here + sign * away * np.eye(n)[k] for k in range(n) for sign in (-1, 1) for away in AWAY])
    values = from_steps(moved)
    good = accepted(candidates(values), choice["choices"]["joint_limits"]).reshape(n, 2, len(AWAY))
    ends = np.empty((2, n))
    values = values.reshape(n, 2, len(AWAY), n)
    for k in range(n):
        for side in (0, 1):
            bad = np.flatnonzero(~good[k, side])
            last = bad[0] - 1 if len(bad) else len(AWAY) - 1
            ends[side, k] = values_of(choice)[k] if last < 0 else values[k, side, last, k]
    return Determined(
        np.maximum(ends[0], LOWER), np.minimum(ends[1], UPPER), _pairs(candidates, here), candidates.count
    )


def _pairs(candidates: Candidates, here: np.ndarray) -> list[tuple[str, str, float]]:
    n = len(here)
    tilt = np.diag(np.where(np.arange(n) == DURATION, 10 * TILT, TILT))  # whole seconds
    values = from_steps(np.concatenate([here - tilt, here + tilt]))
    apart = np.diag(to_steps(values[n:]) - to_steps(values[:n]))
    ratios = candidates(values).ratios
    G = np.nan_to_num((np.log(ratios[n:]) - np.log(ratios[:n])).T / apart)
    covariance = np.linalg.inv(G.T @ G / TOLERANCE**2 + np.eye(n) / PRIOR**2)
    spread = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(spread, spread)
    pairs = [(NAMES[i], NAMES[j], float(correlation[i, j])) for i, j in combinations(range(n), 2)]
    return sorted((p for p in pairs if abs(p[2]) > STRONG), key=lambda p: -abs(p[2]))
