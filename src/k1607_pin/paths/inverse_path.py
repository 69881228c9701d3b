"""Joint angles along a path of the tool: continuous, with least joint motion, within limits, or refused with the place.

The joints' velocity is the report's (22), q_dot = W J^T [J W J^T]^-1 x_dot, with a diagonal W that is 1 in a joint's mid-range
and falls to (almost) none at its limits: there the others do the work, by the arm's redundancy (Chan and Dubey, IEEE Trans.
Robotics and Automation 11(2), 1995). No velocity is added in the null space. So where the tool rests the joints rest, and the
joints' way does not depend on how fast it is gone.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from k1607_pin.arguments import as_floats, number, shown
from k1607_pin.arm.arm import Arm
from k1607_pin.kinematics.task import POSE, Task, task_of
from k1607_pin.paths.follower import Follower, SingularPathError, joined
from k1607_pin.paths.joint_plan import JointLimitError, JointPlan, require_joint_limits

SINGULAR = 0.01  # sigma_min, in the units of the Jacobian, m and rad mixed
TOLERANCE = 1e-7  # m, rad: off the path between samples
FINEST = 1 / 64  # of the period


@dataclass(frozen=True, eq=False)
class JointPath(JointPlan):
    """Joint angles along a path of the tool."""

    sigma_min: np.ndarray
    """(m + 1,) smallest singular value of the task's rows of J at `spline.times`"""
    position_error: float
    """m: how far off its path the tool is on a third of the way between samples, at most"""
    orientation_error: float
    """rad, likewise"""


def joint_path(
    arm: Arm,
    path: Callable[[float], Any],
    q0: np.ndarray,
    duration: float | None = None,
    rotation: np.ndarray | None = None,
    period: float = 0.01,
    sigma_min: float = SINGULAR,
    task: "Task | str" = POSE,
) -> JointPath:
    """Joint angles that take the tool along a path: exact at samples, quintic polynomials in between.

    Position, velocity and acceleration agree with the path's at every sample. In between, on a third of the way, the tool is no
    more than 1e-7 m and rad off it, for which samples are taken more densely where that is needed. Where the path's acceleration
    jumps, at its `.times` [s] if it has such, a sample is taken on either side.

    Parameters
    ----------
    path : time [s] -> .position (3,), .velocity (3,), .acceleration (3,), base axes; also .rotation (3, 3) tool in base,
        .angular_velocity (3,) and .angular_acceleration (3,) base axes, if the orientation is to change.
    q0 : (n,) rad, where it starts; if the tool is elsewhere then, where to look for a start.
    duration : s; defaults to the path's own.
    rotation : (3, 3) tool in base, held by a path without rotation; defaults to that at q0.
    period : s, between samples at most; no less than 1/64 of it.
    sigma_min : what the smallest singular value of the task's rows of J must not fall below.
    task : what of the pose the tool is to follow: "pose", "position", "axis" or a `Task`.

    Raises
    ------
    ValueError
        Arguments of wrong shape; a path that jumps, or whose velocity and acceleration are not its derivatives.
    UnreachableError
        The arm has no posture within its limits for a point of the path.
    JointLimitError
        There is one, but the way there leads out of the limits.
    SingularPathError
        The path comes too close to a singularity of the task, if only between samples.
    TooFewJointsError
        The task has more rows than the arm has joints.
    """
    q = arm.as_vector(q0, "q0")
    duration = number("duration", getattr(path, "duration", None) if duration is None else duration, above=0, unit="s")
    period, sigma_min = number("period", period, above=0, unit="s"), number("sigma_min", sigma_min, above=0)
    if not callable(path):
        raise ValueError(f"path: expected a function of time in s that gives a point of the path, got {shown(path)}")
    follower = Follower(arm, path, _rotation(arm, q, rotation), sigma_min, task_of(task))
    ahead = _samples(duration, period, getattr(path, "times", ()))[:0:-1].tolist()  # the next one last
    times, states, errors = [0.0], [follower.start(q)], []
    while ahead:
        before, t = times[-1], ahead[-1]
        try:
            state, error = follower.step(states[-1], before, t)
        except (SingularPathError, JointLimitError):
            follower.require_reach(t, duration, states[-1].q)  # the better reason, if it is one
            raise
        if error.max() < TOLERANCE:
            times.append(ahead.pop())
            states.append(state)
            errors.append(error)
        elif t - before > FINEST * period:
            ahead.append((before + t) / 2)
        else:
            follower.refuse(t, error, states[-1].q)
    spline = joined(np.array(times), states)
    sigma = np.array([state.sigma for state in states])
    require_joint_limits(arm, spline)
    follower.require_regular(spline, sigma)
    return JointPath(spline, sigma, *np.max(errors, axis=0).tolist())


def _samples(duration: float, period: float, breaks: Any) -> np.ndarray:
    """(m + 1,) s: even steps of at most ``period`` between 0, the breaks within and the duration."""
    ends = [0.0]
    for t in sorted(float(t) for t in breaks):
        if min(t - ends[-1], duration - t) > period / 10:  # closer together, rounding would show in the quintics
            ends.append(t)
    ends.append(duration)
    steps = [np.linspace(a, b, int(np.ceil((b - a) / period - 1e-9)), endpoint=False) for a, b in pairwise(ends)]
    return np.concatenate([*steps, [duration]])


def _rotation(arm: Arm, q: np.ndarray, rotation: np.ndarray | None) -> np.ndarray:
    if rotation is None:
        return arm.forward_kinematics(q).rotation
    R = as_floats("rotation", rotation, "a (3, 3) rotation matrix")
    if R.shape != (3, 3) or not np.abs(R @ R.T - np.eye(3)).max() < 1e-9 or np.linalg.det(R) < 0:
        raise ValueError(f"rotation: expected a (3, 3) rotation matrix, got {shown(rotation)}")
    return R
