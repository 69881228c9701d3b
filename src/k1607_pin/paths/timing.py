"""The fastest motion from one state to the next within limits: in closed form from rest to rest, at speed by Ruckig.

Ruckig: L. Berscheid and T. Kröger, Jerk-limited Real-time Trajectory Generation with Arbitrary Target States, RSS 2021. Its
community version knows no intermediate waypoints, so that each stretch between two of them is a call of its own.
"""

from typing import NamedTuple

import numpy as np
import ruckig

from k1607_pin.arguments import numbers, shown
from k1607_pin.paths.s_curve import duration_of, s_curve
from k1607_pin.paths.spline import Spline, of_jerk

SPARE = 1e-6  # of the limits
EXCESS = 1e-12  # of the limits, that rounding may add
TOGETHER = 1e-9  # of a motion's duration: times that are closer are one time
MOST = (
    1e3,
    1e4,
    1e6,
)  # velocity, acceleration and jerk that Ruckig is given, in units of the distance and the duration


LEAST = 1e-75  # cubes and products of smaller limits, and of larger ones than its inverse, are no numbers


class Limits(NamedTuple):
    """What a motion keeps to: numbers, or one each for n coordinates, in units of the coordinate."""

    velocity: np.ndarray | float
    """per s"""
    acceleration: np.ndarray | float
    """per s^2"""
    jerk: np.ndarray | float
    """per s^3"""


class NoMotionError(ValueError):
    """No motion is found from one state to the other."""


def fastest(start: np.ndarray, end: np.ndarray, v_start: np.ndarray, v_end: np.ndarray, limits: Limits) -> Spline:
    """All n coordinates from ``start`` to ``end`` in one common time, the shortest that is found.

    start, end, v_start, v_end : (n,); accelerations there are zero. Ruckig looks for roots to 1e-8 of the distance, which shows
    in a few motions of a thousand that start or end at speed. What is missing is spread over the way, for which such motions
    leave a millionth of the limits. From rest to rest, what Ruckig does not find is `straight`.

    Raises
    ------
    ValueError
        Wrong shapes, limits that are not positive.
    NoMotionError
        v_start or v_end is beyond the limits, or Ruckig finds no motion that keeps them, which happens: where it has to turn
        back to end at v_end, say. Never from rest to rest.
    """
    start = numbers("start", start, (None,))
    end, v_start, v_end = (
        numbers(name, x, start.shape) for name, x in (("end", end), ("v_start", v_start), ("v_end", v_end))
    )
    limits = each(limits, start.shape)
    at_rest = not (v_start.any() or v_end.any())
    if at_rest and np.count_nonzero(end - start) < 2:
        return straight(start, end, limits)
    try:
        return _by_ruckig(start, end, v_start, v_end, limits)
    except NoMotionError:
        if at_rest:
            return straight(start, end, limits)
        raise


def each(limits: Limits, shape: tuple[int, ...]) -> Limits:
    """Limits of ``shape`` each; refuses what is not positive and finite."""
    if not isinstance(limits, tuple | list) or len(limits) != 3:
        raise ValueError(f"limits: expected Limits of velocity, acceleration and jerk, got {shown(limits)}")
    found = []
    for name, x in zip(Limits._fields, limits, strict=True):
        limit = numbers(name, x)
        if limit.shape not in ((), shape) or not (limit > 0).all():
            raise ValueError(f"{name}: expected one or {shape} positive limits, got {shown(x)}")
        if limit.size and not (LEAST <= limit.min() and limit.max() <= 1 / LEAST):
            raise ValueError(f"{name}: expected limits from {LEAST:.0e} to {1 / LEAST:.0e}, got {shown(x)}")
        found.append(np.broadcast_to(limit, shape))
    return Limits(*found)


def shares(spline: Spline, limits: Limits) -> tuple[float, float, float]:
    """The largest shares of the limits of velocity, acceleration and jerk that a motion of cubic pieces takes."""
    peaks = (spline.peaks(order) for order in (1, 2))
    largest = [np.maximum(-lowest.value, highest.value) for lowest, highest in peaks]
    largest.append(np.abs(6 * spline.coefficients[0]).max(axis=0))
    return tuple(float((x / limit).max()) for x, limit in zip(largest, limits, strict=True))  # type: ignore[return-value]


def _by_ruckig(start: np.ndarray, end: np.ndarray, v_start: np.ndarray, v_end: np.ndarray, limits: Limits) -> Spline:
    """`fastest` in units of each coordinate's distance and of the slowest one's time from rest to rest."""
    n, distance = len(start), end - start
    moved = np.abs(distance) > 0
    if not moved.any():
        raise NoMotionError("no motion found: no coordinate has a distance to go, and not all are at rest")
    second = max(
        duration_of(*(float(np.asarray(x)[i] / abs(distance[i])) for x in limits)) for i in np.flatnonzero(moved)
    )
    unit = np.where(moved, np.abs(distance), limits.velocity * second)  # of length, each coordinate's own
    wanted = ruckig.InputParameter(n)
    wanted.current_position, wanted.target_position = np.zeros(n), distance / unit
    wanted.current_velocity, wanted.target_velocity = v_start / unit * second, v_end / unit * second
    share = 1 - SPARE if v_start.any() or v_end.any() else 1.0
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = (
        np.minimum(share * x / unit * second**power, most)
        for power, (x, most) in enumerate(zip(limits, MOST, strict=True), 1)
    )
    wanted.synchronization = ruckig.Synchronization.Phase
    planner, found = ruckig.Ruckig(n), ruckig.Trajectory(n)
    try:
        planner.validate_input(wanted, True, True)  # else it would brake first, outside the seven phases
        planner.calculate(wanted, found)
    except ruckig.RuckigError:
        raise NoMotionError(_no_motion(start, end, v_start, v_end)) from None
    T = found.duration
    switches = [np.cumsum(profile.t) for profile in found.profiles[0]]  # n times (7,), in the unit of time
    times = _apart(np.concatenate([[0.0, T / 4, T / 2, 3 * T / 4, T], *switches]), T)
    middles = (times[:-1] + times[1:]) / 2
    jerk = np.array(
        [
            np.append(profile.j, 0.0)[np.searchsorted(switch, middles)] * scale / second**3
            for profile, switch, scale in zip(found.profiles[0], switches, unit, strict=True)
        ]
    ).T
    times, middles, T = times * second, middles * second, T * second
    missing = end - of_jerk(times, jerk, start, v_start)(T)
    # a push and a pull of the jerk, and back: displaces by 1, without a trace in velocity and acceleration
    displace = np.where(np.abs(middles - T / 2) > T / 4, 32.0, -32.0) / T**3
    motion = of_jerk(times, jerk + displace[:, None] * missing, start, v_start)
    # Ruckig has been seen to leave its limits; and the ends are to be met
    off = np.abs(motion(T) - end).max() > TOGETHER * np.abs(distance).max()
    off |= bool((np.abs(motion(T, 1) - v_end) > TOGETHER * limits.velocity).any())
    if off or not max(shares(motion, limits)) <= 1 + EXCESS:
        raise NoMotionError(_no_motion(start, end, v_start, v_end))
    return motion


def _no_motion(start: np.ndarray, end: np.ndarray, v_start: np.ndarray, v_end: np.ndarray) -> str:
    i = int(np.argmax(np.maximum(np.abs(v_start), np.abs(v_end))))
    return (
        f"no motion from one state to the other is found within the limits; the fastest coordinate, {i}, should go from "
        f"{start[i]:.6g} at {v_start[i]:.4g} to {end[i]:.6g} at {v_end[i]:.4g}. Lower velocities at the ends may help"
    )


def _apart(times: np.ndarray, T: float) -> np.ndarray:
    """Times from 0 to T in order, without those that only rounding keeps from the one before."""
    inside = np.unique(times[(times > TOGETHER * T) & (times < (1 - TOGETHER) * T)])
    first = np.diff(inside, prepend=0.0) > TOGETHER * T
    return np.concatenate([[0.0], inside[first], [T]])


def progress(distances: np.ndarray, limits: Limits, start: float = 0.0, grid: float = 0.0) -> Spline:
    """(1,): from ``start`` to one more, from rest to rest, the fastest at which no share of the distances exceeds its limits.

    distances : (k,) >= 0, not all zero; limits : (k,) each, or numbers; grid : see `s_curve`.

    Raises
    ------
    ValueError
        Wrong shapes, negative distances or none at all, limits that are not positive and finite.
    """
    distances = numbers("distances", distances, (None,))
    if not (distances >= 0).all() or not distances.any():
        raise ValueError(f"distances: expected numbers >= 0, not all zero, got {shown(distances)}")
    moved = distances > 0
    velocity, acceleration, jerk = (
        float((np.asarray(x)[moved] / distances[moved]).min()) for x in each(limits, distances.shape)
    )
    share = s_curve(velocity, acceleration, jerk, grid)
    return shifted(share, start)


def shifted(spline: Spline, by: "np.ndarray | float") -> Spline:
    """The same motion from elsewhere."""
    coefficients = spline.coefficients.copy()
    coefficients[-1] += by
    return Spline(spline.times, coefficients)


def straight(start: np.ndarray, end: np.ndarray, limits: Limits, grid: float = 0.0) -> Spline:
    """All n coordinates from ``start`` to ``end`` (n,), from rest to rest, on the straight line between them.

    Raises
    ------
    ValueError
        Wrong shapes, no distance to go, limits that are not positive and finite.
    """
    start = numbers("start", start, (None,))
    end = numbers("end", end, start.shape)
    if not (end - start).any():
        raise ValueError("end: expected one that differs from start")
    share = progress(np.abs(end - start), limits, grid=grid)
    return shifted(Spline(share.times, share.coefficients * (end - start)), start)
