"""The fastest motion from one state to the next within limits of velocity, acceleration and jerk, by Ruckig.

Ruckig: L. Berscheid and T. Kröger, Jerk-limited Real-time Trajectory Generation with Arbitrary Target States, RSS 2021. Its
community version knows no intermediate waypoints, so that each stretch between two of them is a call of its own.
"""

from typing import NamedTuple

import numpy as np
import ruckig

from k1607_pin.paths.spline import Spline, of_jerk

SPARE = 1e-6  # of the limits
LEAST = 1e-9  # rad (m)
TOGETHER = 1e-9  # of a motion's duration: times that are closer are one time


class Limits(NamedTuple):
    """What a motion keeps to: numbers, or one each for n coordinates, in units of the coordinate."""

    velocity: np.ndarray | float
    """per s"""
    acceleration: np.ndarray | float
    """per s^2"""
    jerk: np.ndarray | float
    """per s^3"""


class NoMotionError(ValueError):
    """Ruckig finds no motion from one state to the other."""


def fastest(start: np.ndarray, end: np.ndarray, v_start: np.ndarray, v_end: np.ndarray, limits: Limits) -> Spline:
    """All n coordinates from ``start`` to ``end`` in one common time, the shortest there is.

    start, end, v_start, v_end : (n,); accelerations there are zero. Ruckig looks for roots to 1e-8 of the distance, which shows
    in a few motions of a thousand that start or end at speed. What is missing is spread over the way, for which such motions
    leave a millionth of the limits.

    Raises
    ------
    NoMotionError
        v_start or v_end is beyond the limits, or Ruckig finds no motion, which happens: where it has to turn back to end at
        v_end, say, or where one coordinate goes a millionth of another's way. Never to a single one from rest to rest.
    """
    n, distance = len(start), end - start
    unit = np.maximum(np.abs(distance), LEAST)  # of length, each coordinate's own: Ruckig's 1e-8 are of it
    wanted = ruckig.InputParameter(n)
    wanted.current_position, wanted.target_position = np.zeros(n), distance / unit
    wanted.current_velocity, wanted.target_velocity = v_start / unit, v_end / unit
    share = 1 - SPARE if v_start.any() or v_end.any() else 1.0
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = (share * x / unit for x in limits)
    wanted.synchronization = ruckig.Synchronization.Phase
    planner, found = ruckig.Ruckig(n), ruckig.Trajectory(n)
    try:
        planner.validate_input(wanted, True, True)  # else it would brake first, outside the seven phases
        planner.calculate(wanted, found)
    except ruckig.RuckigError as error:
        raise NoMotionError(f"no motion from {start.tolist()} to {end.tolist()}: {error}") from None
    T = found.duration
    switches = [np.cumsum(profile.t) for profile in found.profiles[0]]  # n times (7,) s
    times = _apart(np.concatenate([[0.0, T / 4, T / 2, 3 * T / 4, T], *switches]), T)
    middles = (times[:-1] + times[1:]) / 2
    jerk = np.array(
        [
            np.append(profile.j, 0.0)[np.searchsorted(switch, middles)] * scale
            for profile, switch, scale in zip(found.profiles[0], switches, unit, strict=True)
        ]
    ).T
    missing = end - of_jerk(times, jerk, start, v_start)(T)
    # a push and a pull of the jerk, and back: displaces by 1, without a trace in velocity and acceleration
    displace = np.where(np.abs(middles - T / 2) > T / 4, 32.0, -32.0) / T**3
    return of_jerk(times, jerk + displace[:, None] * missing, start, v_start)


def _apart(times: np.ndarray, T: float) -> np.ndarray:
    """Times from 0 to T in order, without those that only rounding keeps from the one before."""
    inside = np.unique(times[(times > TOGETHER * T) & (times < (1 - TOGETHER) * T)])
    first = np.diff(inside, prepend=0.0) > TOGETHER * T
    return np.concatenate([[0.0], inside[first], [T]])


def progress(distances: np.ndarray, limits: Limits, start: float = 0.0) -> Spline:
    """(1,): from ``start`` to one more, from rest to rest, the fastest at which no share of the distances exceeds its limits.

    distances : (k,) >= 0, not all zero; limits : (k,) each.
    """
    moved = distances > 0
    rates = (float((np.broadcast_to(x, len(distances))[moved] / distances[moved]).min()) for x in limits)
    still = np.zeros(1)
    return fastest(still + start, still + start + 1, still, still, Limits(*rates))


def straight(start: np.ndarray, end: np.ndarray, limits: Limits) -> Spline:
    """All n coordinates from ``start`` to ``end`` (n,), from rest to rest, on the straight line between them."""
    share = progress(np.abs(end - start), limits)
    coefficients = share.coefficients * (end - start)
    coefficients[-1] += start
    return Spline(share.times, coefficients)
