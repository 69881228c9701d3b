"""A planner in joint space: through waypoints without a stop, within limits of velocity, acceleration and jerk."""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from k1607_pin.arguments import as_floats, shown
from k1607_pin.arm.arm import Arm
from k1607_pin.paths.s_curve import grid_for
from k1607_pin.paths.spline import Spline, joined
from k1607_pin.paths.timing import EXCESS, Limits, NoMotionError, fastest, shares, straight

UP_TO_SPEED = 0.5  # s, from rest to the velocity limit: what acceleration defaults to; assumed, as no arm's URDF says
UP_TO_ACCELERATION = 0.1  # s, from none to the acceleration limit: what jerk defaults to; assumed
ROUNDING = 1e-9  # rad (m): no motion, no excess
HALVINGS = 5  # of a velocity, before it is given up
GAIN = 0.995  # of the time: less is not worth another round


class JointPoint(NamedTuple):
    """The wanted motion of the joints at one time, or many."""

    position: Any
    """(..., n) rad"""
    velocity: Any
    """(..., n) rad/s"""
    acceleration: Any
    """(..., n) rad/s^2"""


class JointLimitError(ValueError):
    """A planned motion that takes a joint out of its limits."""

    def __init__(
        self, joint: str, time: float, value: float, lower: float, upper: float, position: np.ndarray | None = None
    ) -> None:
        self.joint, self.time, self.value, self.lower, self.upper = joint, time, value, lower, upper
        self.position = position
        place = "" if position is None else f", the tool at {np.round(position, 4).tolist()} m"
        super().__init__(
            f"path: joint {joint!r} would be at {value:.5f} at t = {time:.4g} s{place}; expected within its limits, "
            f"{lower:.5f} to {upper:.5f} (rad or m)"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.joint, self.time, self.value, self.lower, self.upper, self.position)


@dataclass(frozen=True, eq=False)
class JointPlan:
    """Joint angles over time; at rest before 0 and after `duration`."""

    spline: Spline

    @property
    def duration(self) -> float:
        """s"""
        return self.spline.duration

    def __call__(self, t: Any) -> JointPoint:
        """The wanted motion at times t (...) s."""
        return JointPoint(self.spline(t), self.spline(t, 1), self.spline(t, 2))

    def slower(self, factor: float) -> Self:
        """The same way in ``factor`` times the time."""
        return replace(self, spline=self.spline.slower(factor))


def plan_joints(
    arm: Arm,
    waypoints: np.ndarray,
    q0: np.ndarray,
    velocity: np.ndarray | float | None = None,
    acceleration: np.ndarray | float | None = None,
    jerk: np.ndarray | float | None = None,
    stop: bool = False,
) -> JointPlan:
    """From rest at q0 through the waypoints in turn, to rest at the last.

    From rest to rest a stretch is straight in joint space, in closed form; at speed it is the fastest that Ruckig finds for the
    velocities at its ends, all joints in one common time, and where that would break a limit the joints stop instead.
    The velocities are ours: the harmonic mean of the mean velocities before and after, none for a
    joint that turns back (Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5(2), 1984), halved for as long as a joint leaves the
    range between its two waypoints. So no joint overshoots a waypoint, but the whole is not the fastest of all. A waypoint that
    repeats the one before is no stop. Torques are not looked at; `slow_down` does.

    Parameters
    ----------
    waypoints : (m, n) rad; q0 : (n,) rad, where it starts.
    velocity, acceleration, jerk : limits, (n,) or one number for all, rad/s, rad/s^2, rad/s^3. Velocity defaults to the arm's
        own; acceleration to what reaches it in 0.5 s, jerk to what reaches that in 0.1 s, which is assumed.
    stop : to rest at each waypoint.

    Raises
    ------
    ValueError
        Wrong shapes, limits that are not positive and finite, no waypoint other than q0.
    JointLimitError
        A waypoint is out of the joint limits; it says which joint, when and by how much.
    """
    ways = [arm.as_vector(q0, "q0")]
    for waypoint in _waypoints(arm, waypoints):
        if np.abs(waypoint - ways[-1]).max() > ROUNDING:
            ways.append(waypoint)
    if len(ways) < 2:
        raise ValueError(f"waypoints: expected one that differs from q0, by more than {ROUNDING:.0e}")
    q, limits = np.array(ways), joint_limits(arm, velocity, acceleration, jerk)
    stretches = [straight(*ends, limits) for ends in pairwise(q)]
    grid = grid_for(_duration(stretches))  # one for all, so that no time is rounded where they join
    spline = joined([straight(*ends, limits, grid) for ends in pairwise(q)])
    if not stop and len(stretches) > 1:
        onward = joined(_without_stops(q, stretches, limits))
        if max(shares(onward, limits)) <= 1 + EXCESS:
            spline = onward
    require_joint_limits(arm, spline)
    return JointPlan(spline)


def joint_limits(
    arm: Arm,
    velocity: np.ndarray | float | None = None,
    acceleration: np.ndarray | float | None = None,
    jerk: np.ndarray | float | None = None,
) -> Limits:
    """(n,) each, as for `plan_joints`, whose errors are raised here."""
    v = _limit(arm, "velocity", arm.velocity_limit if velocity is None else velocity)
    a = _limit(arm, "acceleration", v / UP_TO_SPEED if acceleration is None else acceleration)
    return Limits(v, a, _limit(arm, "jerk", a / UP_TO_ACCELERATION if jerk is None else jerk))


def require_within_limits(arm: Arm, q: np.ndarray, time: Any, position: np.ndarray | None = None) -> None:
    """Refuse joint angles (n,) out of the limits, where they are furthest out; time [s] of all, or (n,) of each."""
    excess = np.maximum(arm.lower - q, q - arm.upper)
    if excess.max() > ROUNDING:
        i = int(excess.argmax())
        when = float(np.broadcast_to(time, q.shape)[i])
        raise JointLimitError(arm.joint_names[i], when, float(q[i]), float(arm.lower[i]), float(arm.upper[i]), position)


def require_joint_limits(arm: Arm, spline: Spline) -> None:
    """Refuse a motion that leaves the joint limits at any time."""
    for peak in spline.peaks():
        require_within_limits(arm, peak.value, peak.time)


def _without_stops(q: np.ndarray, stretches: list[Spline], limits: Limits) -> list[Spline]:
    """Faster and faster through the waypoints, from stretches that stop there, for as long as it gains time."""
    best, shortest = stretches, np.inf
    while (duration := _duration(best)) < GAIN * shortest:
        shortest = duration
        faster = _in_range(q, _velocities(q, best), limits)
        if _duration(faster) < shortest:
            best = faster
    return best


def _velocities(q: np.ndarray, stretches: list[Spline]) -> np.ndarray:
    """(m, n) at the waypoints: the harmonic mean of the mean velocities before and after."""
    slope = np.diff(q, axis=0) / np.array([[stretch.duration] for stretch in stretches])
    before, after = slope[:-1], slope[1:]
    onward = before * after > 0
    v = np.zeros_like(q)
    v[1:-1] = np.where(onward, 2 * before * after / np.where(onward, before + after, 1.0), 0.0)
    return v


def _in_range(q: np.ndarray, v: np.ndarray, limits: Limits) -> list[Spline]:
    """Stretches with velocities lowered where a joint would otherwise leave the range between two waypoints."""
    v, halved = v.copy(), np.zeros(len(q), dtype=int)
    while True:
        found = [_stretch(q[k : k + 2], v[k : k + 2], limits) for k in range(len(q) - 1)]
        missing = [k for k, stretch in enumerate(found) if stretch is None]
        if not missing:
            return [stretch for stretch in found if stretch]
        ends = list({end for k in missing for end in (k, k + 1)})
        halved[ends] += 1
        v[ends] /= 2
        v[halved > HALVINGS] = 0.0


def _stretch(ends: np.ndarray, v: np.ndarray, limits: Limits) -> Spline | None:
    """Between two waypoints (2, n), within their range, with velocities (2, n) there; None if Ruckig finds none."""
    if not v.any():
        return straight(ends[0], ends[1], limits)
    try:
        found = fastest(ends[0], ends[1], v[0], v[1], limits)
    except NoMotionError:
        return None
    lowest, highest = found.peaks()
    beyond = np.maximum(ends.min(axis=0) - lowest.value, highest.value - ends.max(axis=0))
    return found if beyond.max() < ROUNDING else None


def _duration(stretches: list[Spline]) -> float:
    return sum(stretch.duration for stretch in stretches)


def _waypoints(arm: Arm, waypoints: np.ndarray) -> np.ndarray:
    expected = f"(m, {arm.n}) finite joint angles in rad, m >= 1"
    q = as_floats("waypoints", waypoints, expected)
    if q.ndim != 2 or q.shape[0] < 1 or q.shape[1] != arm.n:
        raise ValueError(f"waypoints: expected {expected}, got shape {q.shape}")
    if not np.isfinite(q).all():
        raise ValueError(f"waypoints: expected {expected}, got {shown(q)}")
    return q


def _limit(arm: Arm, name: str, x: np.ndarray | float) -> np.ndarray:
    expected = f"one or ({arm.n},) positive limits"
    limit = as_floats(name, x, expected)
    if limit.shape not in ((), (arm.n,)) or not np.isfinite(limit).all() or not (limit > 0).all():
        raise ValueError(f"{name}: expected {expected}, got {shown(x)}")
    return np.broadcast_to(limit, arm.n)
