"""Whether an arm can follow a path at all: asked before the first step, answered with the place where it cannot."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from k1607_pin.arguments import number
from k1607_pin.arm.arm import Arm
from k1607_pin.arm.inverse import InverseKinematics, inverse_kinematics, newton, require_arm, sigma_min_of
from k1607_pin.kinematics.task import POSE, POSITION, Task, task_of

CLOSE = 1e-6  # m, rad: near enough to say that a point is reached
LOOKS = 40  # points of a path that are looked at, at least
LOOK_EVERY = 0.25  # s between them, at most: what leaves the workspace and comes back faster is not seen
JUMP = 1.0  # rad (m): more than any joint moves between two of them, unless it takes another posture


class UnreachableError(ValueError):
    """A point of a path that the arm has no posture for."""

    def __init__(self, arm: Arm, time: float, position: np.ndarray, closest: InverseKinematics) -> None:
        self.time, self.position, self.closest, self._arm = time, position, closest, arm
        at_limit = f"; at its limits there: {', '.join(closest.at_limit)}" if closest.at_limit else ""
        super().__init__(
            f"path: {arm.name!r} cannot bring {arm.tool_frame!r} to {np.round(position, 4).tolist()} m as wanted, "
            f"t = {time:.4g} s: of {closest.starts} attempts the closest misses by {closest.position_error:.3g} m and "
            f"{closest.orientation_error:.3g} rad{at_limit}"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self._arm, self.time, self.position, self.closest)


class Followed(NamedTuple):
    """Postures along a path."""

    times: np.ndarray
    """(N,) s"""
    postures: np.ndarray
    """(N, n) rad, within the limits"""
    jumps: tuple[float, ...]
    """s: when a posture is not a continuation of the one before, because that would leave the limits"""
    sigma_min: np.ndarray
    """(N,) smallest singular value of the task's rows of J; 0 for fewer joints than rows"""


def rotation_of(point: Any, held: Any) -> Any:
    """(3, 3) wanted orientation, tool in base: the path's point's own ``rotation``, or where it has none the one held."""
    own = getattr(point, "rotation", None)
    return held if own is None else own


def follow(
    arm: Arm, path: Callable[[float], Any], rotation: Any, q: np.ndarray, duration: float, task: "Task | str" = POSE
) -> Followed:
    """A posture within the limits for points of the path, evenly spaced in time, each found from the one before.

    Parameters
    ----------
    path : time [s] -> wanted .position (3,) m, and .rotation (3, 3) tool in base if it turns.
    rotation : (3, 3) held by a path without, else not looked at; q : (n,) where to start looking, rad.
    task : what of the pose counts; "position" needs no rotation.

    Raises
    ------
    UnreachableError
        There is none for a point; it says which, when, and how close the arm comes.
    """
    require_arm(arm)
    task, q, duration = task_of(task), arm.as_vector(q, "q"), number("duration", duration, above=0, unit="s")
    if task == POSITION and rotation is None:
        rotation = np.eye(3)  # not looked at
    times = np.linspace(0.0, duration, max(LOOKS, int(np.ceil(duration / LOOK_EVERY)) + 1))
    postures: list[np.ndarray] = []
    jumps: list[float] = []
    sigma: list[float] = []
    for t in times:
        point = path(t)
        R = np.asarray(rotation_of(point, rotation), dtype=float)
        wanted = pin.SE3(R, np.asarray(point.position, dtype=float))
        near = newton(arm, wanted, q, CLOSE, task)
        if near is None:
            found = inverse_kinematics(arm, wanted, q, CLOSE, CLOSE, task=task)
            if not found.converged:
                raise UnreachableError(arm, float(t), wanted.translation, found)
            near = found.q
            if postures and np.abs(near - q).max() > JUMP:
                jumps.append(float(t))
        postures.append(q := near)
        sigma.append(sigma_min_of(task.rows(arm.jacobian(q), arm.forward_kinematics(q).rotation)))
    return Followed(times, np.array(postures), tuple(jumps), np.array(sigma))
