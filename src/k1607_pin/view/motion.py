"""Poses and motions as callers give them: checked once, here."""

from typing import Any

import numpy as np

from k1607_pin.arguments import as_floats
from k1607_pin.arm.arm import Arm

FRAMES_PER_SECOND = 30.0


def pose(arm: Arm, q: Any = None) -> np.ndarray:
    """q as (n,) rad; None gives zero, or the limit nearest to it."""
    if q is None:
        return np.clip(np.zeros(arm.n), arm.lower, arm.upper)
    q = _numbers(q, "q")
    if q.shape != (arm.n,) or not np.isfinite(q).all():
        raise ValueError(f"q: expected ({arm.n},) finite numbers in rad, got {_seen(q)}")
    return q


def motion(arm: Arm, times: Any, Q: Any) -> tuple[np.ndarray, np.ndarray]:
    """Times (N,) s, increasing, and joint angles (N, n) rad, both checked."""
    times, Q = _numbers(times, "times"), _numbers(Q, "Q")
    if times.ndim != 1 or times.size < 2 or not np.isfinite(times).all():
        raise ValueError(f"times: expected (N,) finite numbers in s, at least two, got {_seen(times)}")
    if not (steps := np.diff(times) > 0).all():
        k = int(np.argmin(steps))
        raise ValueError(f"times: expected increasing numbers in s, got {times[k]} s and then {times[k + 1]} s")
    if Q.shape != (times.size, arm.n) or not np.isfinite(Q).all():
        raise ValueError(f"Q: expected ({times.size}, {arm.n}) finite numbers in rad, got {_seen(Q)}")
    return times, Q


def keyframes(times: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evenly spaced times from 0 (M,) s and joint angles (M, n), linear in between.

    Sparse motions gain frames, because the viewer would move the links along straight lines; dense ones lose some.
    """
    duration = times[-1] - times[0]
    even = np.linspace(0.0, duration, int(np.ceil(duration * FRAMES_PER_SECOND)) + 1)
    return even, np.stack([np.interp(even, times - times[0], angles) for angles in Q.T], axis=1)


def _numbers(x: Any, name: str) -> np.ndarray:
    if x is None:
        return np.empty(0)  # nothing, and so of the wrong shape
    return np.array(as_floats(name, x, "numbers"))


def _seen(x: np.ndarray) -> str:
    if x.size > 12:
        return f"shape {x.shape}" + ("" if np.isfinite(x).all() else ", not all finite")
    return repr(x.tolist()) if x.size else "nothing"
