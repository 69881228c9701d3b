"""A planner in Cartesian space: from pose to pose on straight lines, the orientation turning along, as the arm can follow."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import pinocchio as pin

from k1607_pin.arguments import as_floats, shown
from k1607_pin.arm.arm import Arm
from k1607_pin.arm.inverse import require_arm, rigid
from k1607_pin.kinematics.rotations import rotation, rotation_vector
from k1607_pin.kinematics.task import POSE, Task, task_of
from k1607_pin.paths.inverse_path import SINGULAR, JointPath, joint_path
from k1607_pin.paths.joint_plan import require_within_limits
from k1607_pin.paths.s_curve import grid_for
from k1607_pin.paths.slow_down import slow_down
from k1607_pin.paths.spline import Spline, joined
from k1607_pin.paths.timing import Limits, progress

LINEAR = Limits(0.25, 0.5, 5.0)
"""m: ISO 10218-1's reduced speed, reached in half a second as for joints; assumed."""
ANGULAR = Limits(0.5, 1.0, 10.0)
"""rad: assumed"""
SHORTEST, LONGEST = 0.1, 100.0  # s: durations at which `joint_path` takes some ten to some ten thousand samples
SAME = 1e-9  # m, and entries of a rotation matrix


class PosePoint(NamedTuple):
    """The wanted motion of the tool at one time, or many; base axes."""

    position: Any
    """(..., 3) m"""
    velocity: Any
    """(..., 3) m/s"""
    acceleration: Any
    """(..., 3) m/s^2"""
    rotation: Any
    """(..., 3, 3) tool in base"""
    angular_velocity: Any
    """(..., 3) rad/s"""
    angular_acceleration: Any
    """(..., 3) rad/s^2"""


@dataclass(frozen=True, eq=False)
class PosePath:
    """Straight from pose to pose, turning about one axis each time (SLERP); at rest before 0 and after `duration`."""

    positions: np.ndarray
    """(m + 1, 3) m"""
    rotations: np.ndarray
    """(m + 1, 3, 3) tool in base"""
    progress: Spline
    """(1,): k at the k-th pose, k + 1 at the next"""

    @property
    def duration(self) -> float:
        """s"""
        return self.progress.duration

    @property
    def times(self) -> np.ndarray:
        """s: when the jerk jumps."""
        return self.progress.times

    def __call__(self, t: Any) -> PosePoint:
        """The wanted motion at times t (...) s."""
        s, rate, change = (self.progress(t, order) for order in range(3))  # (..., 1)
        k = np.clip(s[..., 0].astype(int), 0, len(self.positions) - 2)
        way = np.diff(self.positions, axis=0)[k]  # (..., 3)
        turn = self._turns[k]  # (..., 3)
        share = s - k[..., None]
        angle = np.linalg.norm(turn, axis=-1, keepdims=True)
        axis = turn / np.where(angle > 0, angle, 1.0)
        half = share * angle / 2
        turned = np.concatenate([np.cos(half), np.sin(half) * axis], axis=-1)  # (..., 4)
        R = rotation(turned) @ self.rotations[k]
        return PosePoint(self.positions[k] + share * way, rate * way, change * way, R, rate * turn, change * turn)

    @cached_property
    def _turns(self) -> np.ndarray:
        """(m, 3) rad: axis times angle, base axes."""
        return rotation_vector(self.rotations[1:] @ np.swapaxes(self.rotations[:-1], 1, 2))

    def slower(self, factor: float) -> Self:
        """The same way in ``factor`` times the time."""
        return replace(self, progress=self.progress.slower(factor))


@dataclass(frozen=True, eq=False)
class PosePlan(PosePath):
    """A path from pose to pose that the arm can follow."""

    joints: JointPath
    """The same motion in joint space."""
    factor: float
    """What the time had to be multiplied by for the joints to keep up."""
    reason: str
    """What asked for that much; empty for nothing."""

    def slower(self, factor: float) -> Self:
        """The same way in ``factor`` times the time, tool and joints."""
        return replace(super().slower(factor), joints=self.joints.slower(factor), factor=self.factor * factor)


def plan_poses(
    arm: Arm,
    poses: "Iterable[pin.SE3 | np.ndarray]",
    q0: np.ndarray,
    linear: Limits = LINEAR,
    angular: Limits = ANGULAR,
    sigma_min: float = SINGULAR,
    period: float = 0.01,
    task: "Task | str" = POSE,
) -> PosePlan:
    """From rest at q0 straight to each pose in turn, with a stop there, as fast as limits and joints allow.

    The tool's origin goes along a straight line while the tool turns about one axis, evenly with it. A stop, because a corner
    cannot be met exactly at speed. Each stretch is the fastest within the limits of its length and its angle; then the whole is
    slowed down evenly as far as the joints' velocity and torque limits ask for (`slow_down`). A pose that repeats the one
    before is passed over. A turn by half a turn may go either way round.

    Parameters
    ----------
    poses : T_base_tool to go to, `pinocchio.SE3` or (4, 4) m; q0 : (n,) rad, where the arm is.
    linear, angular : limits of speed, acceleration and jerk along the line, m, and about the axis, rad.
    sigma_min, period : see `joint_path`.
    task : what of the poses counts. "position": the origin alone, poses may be (3,) m; the plan's ``rotations`` are that at q0
        and mean nothing. "axis", or a `Task`: the direction of one tool axis too, which turns the shortest way; the turn about it
        is free.

    Raises
    ------
    ValueError
        Arguments of wrong shape, a pose that is not rigid, limits that are not positive, no pose other than that at q0.
    TooFewJointsError
        The task has more rows than the arm has joints; it says which task would do.
    UnreachableError, JointLimitError, SingularPathError
        The arm cannot follow: where, when and why; see `joint_path`.
    OverloadError
        A posture on the way is too much to hold; see `slow_down`.
    """
    require_arm(arm)
    q0, task = arm.as_vector(q0, "q0"), task_of(task)
    linear, angular = _limits("linear", linear), _limits("angular", angular)
    if not isinstance(poses, Iterable):
        raise ValueError(f"poses: expected a sequence of poses, got {type(poses).__name__}")
    T = [arm.forward_kinematics(q0).homogeneous]
    for k, pose in enumerate(poses):
        there = _what_counts(rigid(f"poses[{k}]", pose, task), T[-1], task)
        if np.abs(there - T[-1]).max() > SAME:
            T.append(there)
    if len(T) < 2:
        raise ValueError(f"poses: expected one that differs from the tool's at q0, by more than {SAME:.0e}")
    require_within_limits(arm, q0, 0.0, T[0][:3, 3])
    positions, rotations = np.array(T)[:, :3, 3], np.array(T)[:, :3, :3]  # (m + 1, ...)
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    angles = np.linalg.norm(rotation_vector(rotations[1:] @ np.swapaxes(rotations[:-1], 1, 2)), axis=1)
    both = Limits(*(np.array(pair) for pair in zip(linear, angular, strict=True)))
    distances = np.stack([lengths, angles], axis=1)
    grid = grid_for(
        sum(progress(d, both).duration for d in distances)
    )  # one for all: no time is rounded where they join
    path = PosePath(positions, rotations, joined([progress(d, both, k, grid) for k, d in enumerate(distances)]))
    slowed = slow_down(arm, _joints(arm, path, q0, sigma_min, period, task))
    slower = path.progress.slower(slowed.factor)
    return PosePlan(positions, rotations, slower, slowed.plan, slowed.factor, slowed.reason)


def _joints(arm: Arm, path: PosePath, q0: np.ndarray, sigma_min: float, period: float, task: Task) -> JointPath:
    """`joint_path`, whose way does not depend on how fast it is gone: in microseconds or years as in seconds or minutes."""
    scale = min(max(path.duration, SHORTEST), LONGEST) / path.duration
    if scale == 1:
        return joint_path(arm, path, q0, sigma_min=sigma_min, period=period, task=task)
    try:
        return joint_path(arm, path.slower(scale), q0, sigma_min=sigma_min, period=period, task=task).slower(1 / scale)
    except ValueError as error:
        error.add_note(
            f"times are those of the path gone in {scale * path.duration:g} s instead of {path.duration:g} s"
        )
        raise


def _limits(name: str, limits: Limits) -> Limits:
    expected = "Limits of positive velocity, acceleration and jerk, finite"
    x = as_floats(name, limits, expected)
    if x.shape != (3,) or not np.isfinite(x).all() or not (x > 0).all():
        raise ValueError(f"{name}: expected {expected}, got {shown(limits)}")
    return Limits(*x.tolist())


def _what_counts(goal: np.ndarray, now: np.ndarray, task: Task) -> np.ndarray:
    """(4, 4): the goal, turned from where the tool is now no further than the task asks for."""
    if task.name == "pose":
        return goal
    R = now[:3, :3]
    if task.name == "axis":
        about = task.rows(np.eye(6)[:, 3:], R)[3:]  # (2, 3): the two axes that turn the direction, base axes
        half = (
            task.error(goal[:3, 3], goal[:3, :3], now[:3, 3], R)[3:] @ about / 2
        )  # (3,): axis times the sine of half the angle
        R = rotation(np.array([np.sqrt(max(1 - half @ half, 0.0)), *half])) @ R
        U, _, Vt = np.linalg.svd(R)  # rounding
        R = U @ Vt
    there = goal.copy()
    there[:3, :3] = R
    return there
