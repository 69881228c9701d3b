"""Inverse kinematics to a pose, or to the part of one that a task means, within joint limits, that tells how it went."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares

from k1607_pin.arguments import number, numbers, shown, whole
from k1607_pin.arm.arm import Arm
from k1607_pin.kinematics.orientation import RIGID as RIGID
from k1607_pin.kinematics.task import POSE, Task, task_of

NEWTON_STEPS = 10
NEWTON_TOLERANCE = 1e-10  # m, rad: quadratic convergence leaves no reason to stop before
FAR = 1e9  # m: no arm reaches that far, and squares of it are finite


@dataclass(frozen=True)
class InverseKinematics:
    """What `inverse_kinematics` found: the solution, or the closest it came."""

    q: np.ndarray
    """(n,) joint angles within the limits, rad."""
    converged: bool
    """Whether both errors are within tolerance."""
    position_error: float
    """m, distance between wanted and reached origin."""
    orientation_error: float
    """rad, angle between wanted and reached orientation; of the axis alone, or none, where the task looks at no more."""
    at_limit: tuple[str, ...]
    """Joints that ended on a limit, such as "joint4 lower"."""
    sigma_min: float
    """Smallest singular value of the task's rows of the Jacobian at q; 0 for fewer joints than rows."""
    starts: int
    """How many starting postures were tried."""


def inverse_kinematics(
    arm: Arm,
    target: "pin.SE3 | np.ndarray",
    q0: np.ndarray | None = None,
    position_tolerance: float = 1e-8,
    orientation_tolerance: float = 1e-8,
    starts: int = 30,
    seed: int = 0,
    task: "Task | str" = POSE,
) -> InverseKinematics:
    """Joint angles that bring the tool to ``target``, within joint limits.

    From q0, and then from random postures until one converges: a few Newton steps; where these leave the limits or do not arrive,
    bounded nonlinear least squares on the pose error (p_d - p, log(R_d R^T)) with its exact Jacobian, and Newton steps from
    what that found. Of the redundant arm's many solutions it returns one near its start, each joint in the turn nearest to q0
    that the limits allow.

    Parameters
    ----------
    arm : any arm.
    target : T_base_tool, `pinocchio.SE3` or (4, 4) m; its rotation may be off by `RIGID` and is mended to the nearest one. For
        ``task="position"`` (3,) m as well.
    q0 : (n,) where to start, rad; clipped to the limits; None takes the middle of the range.
    position_tolerance, orientation_tolerance : m, rad.
    starts : number of starting postures at most; seed : of the random ones.
    task : what of the target counts: "pose", "position", "axis" (position and the direction of the tool's z), or a `Task`.

    Raises
    ------
    ValueError
        target is not a rigid transform, q0 of wrong shape or not finite, starts below one, no such task.
    """
    require_arm(arm)
    task = task_of(task)
    wanted = pin.SE3(rigid("target", target, task))
    tolerances = (
        number("position_tolerance", position_tolerance, above=0, unit="m"),
        number("orientation_tolerance", orientation_tolerance, above=0, unit="rad"),
    )
    starts, seed = whole("starts", starts, 1), whole("seed", seed, 0)
    lower, upper = arm.lower, arm.upper
    low, high = np.where(np.isfinite(lower), lower, -np.pi), np.where(np.isfinite(upper), upper, np.pi)
    start = (low + high) / 2 if q0 is None else np.array(arm.as_vector(q0, "q0"))
    near = start
    rng = np.random.default_rng(seed)
    best: InverseKinematics | None = None
    for k in range(starts):
        q = newton(arm, wanted, start, NEWTON_TOLERANCE, task)
        if q is None:
            q = _least_squares(arm, wanted, start, task)
            polished = newton(arm, wanted, q, NEWTON_TOLERANCE, task)  # next to a limit trf closes in but slowly
            q = q if polished is None else polished
        result = _result(arm, wanted, nearest_turn(arm, q, near), tolerances, k + 1, task)
        if best is None or _distance(result) < _distance(best):
            best = result
        if result.converged:
            return result
        start = rng.uniform(low, high)
    assert best is not None
    return InverseKinematics(**{**vars(best), "starts": starts})


def newton(arm: Arm, wanted: pin.SE3, q: np.ndarray, tolerance: float, task: Task = POSE) -> np.ndarray | None:
    """(n,) rad: the posture that a few Newton steps of least joint motion lead to from q; None if that is out of the limits, or
    further from ``wanted`` than ``tolerance`` [m, rad]."""
    for _ in range(NEWTON_STEPS):
        actual = arm.forward_kinematics(q)
        error = pose_error(wanted, actual, task)
        if np.abs(error).max() < tolerance:
            return q if ((q >= arm.lower) & (q <= arm.upper)).all() else None
        q = q + np.linalg.lstsq(task.rows(arm.jacobian(q), actual.rotation), error, rcond=1e-3)[0]
    return None


def pose_error(wanted: pin.SE3, actual: pin.SE3, task: Task = POSE) -> np.ndarray:
    """(m,): p_wanted - p [m] and the rotation vector of R_wanted R^T [rad], base axes; for other tasks their error."""
    if task.name != "pose":
        error: np.ndarray = task.error(wanted.translation, wanted.rotation, actual.translation, actual.rotation)
        return error
    rotation = pin.log3(wanted.rotation @ actual.rotation.T)
    return np.concatenate([wanted.translation - actual.translation, rotation])


def nearest_turn(arm: Arm, q: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(n,) rad: the same posture as q, each revolute joint in the turn nearest to ``near`` (n,) that its limits allow."""
    turn = 2 * np.pi
    if np.abs(near - q).max() <= np.pi:
        return q
    revolute = np.linalg.norm(arm.jacobian(q)[3:], axis=0) > 0.5  # a unit axis; none for a prismatic joint
    fewest, most = np.ceil((arm.lower - q) / turn), np.floor((arm.upper - q) / turn)
    turns = np.where(revolute, np.clip(np.round((near - q) / turn), np.minimum(fewest, 0), np.maximum(most, 0)), 0)
    return np.where(turns == 0, q, np.clip(q + turn * turns, arm.lower, arm.upper))


def sigma_min_of(J: np.ndarray) -> float:
    """Smallest singular value of a task's rows J (m, n); 0 for fewer joints than rows."""
    return float(np.linalg.svd(J, compute_uv=False)[-1]) if J.shape[1] >= J.shape[0] else 0.0


def _least_squares(arm: Arm, wanted: pin.SE3, start: np.ndarray, task: Task) -> np.ndarray:
    """(n,) rad: within the limits, the closest that is found from ``start``."""
    lower, upper = arm.lower, arm.upper
    q: np.ndarray = least_squares(
        lambda q: _residual(wanted, arm.forward_kinematics(q), task),
        # trf keeps to the interior: a start exactly on a limit is nudged off it
        np.clip(start, lower + 1e-9, upper - 1e-9),
        lambda q: _residual_jacobian(arm, wanted, q, task),
        bounds=(lower, upper),
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
        max_nfev=100,
    ).x
    return q


def _residual(wanted: pin.SE3, actual: pin.SE3, task: Task) -> np.ndarray:
    """(6,) or (3,): as long as `pose_error`, with a simple derivative: directions' difference is 2 sin(angle/2) long."""
    if task.name != "axis":
        return pose_error(wanted, actual, task)
    directions = (wanted.rotation - actual.rotation) @ np.array(task.axis)
    return np.concatenate([wanted.translation - actual.translation, directions])


def _residual_jacobian(arm: Arm, wanted: pin.SE3, q: np.ndarray, task: Task) -> np.ndarray:
    """d residual / dq. R_wanted R^T turns by -R_wanted R^T w about its own axes, hence Jlog3; a direction by w x d."""
    J, R = arm.jacobian(q), arm.forward_kinematics(q).rotation
    if task.name == "position":
        return -J[:3]
    if task.name == "axis":
        return np.vstack([-J[:3], np.cross(R @ np.array(task.axis), J[3:], axisb=0, axisc=0)])
    return np.vstack([-J[:3], -pin.Jlog3(wanted.rotation @ R.T) @ J[3:]])


def _result(
    arm: Arm, wanted: pin.SE3, q: np.ndarray, tolerances: tuple[float, float], starts: int, task: Task
) -> InverseKinematics:
    actual = arm.forward_kinematics(q)
    error = pose_error(wanted, actual, task)
    position, orientation = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    if task.name == "axis":
        orientation = 2 * float(np.arcsin(min(orientation / 2, 1.0)))
    limits = [
        f"{name} {side}"
        for name, x, low, high in zip(arm.joint_names, q, arm.lower, arm.upper, strict=True)
        for side, gap in (("lower", x - low), ("upper", high - x))
        if gap < 1e-6
    ]
    sigma = sigma_min_of(task.rows(arm.jacobian(q), actual.rotation))
    converged = position <= tolerances[0] and orientation <= tolerances[1]
    return InverseKinematics(q, converged, position, orientation, tuple(limits), sigma, starts)


def _distance(result: InverseKinematics) -> float:
    return float(np.hypot(result.position_error, result.orientation_error))


def require_arm(arm: Any) -> None:
    """Refuse what is no `Arm`."""
    if not isinstance(arm, Arm):
        raise ValueError(f"arm: expected an Arm, such as load_k1607() gives, got {shown(arm)}")


def rigid(name: str, pose: Any, task: Task = POSE) -> np.ndarray:
    """(4, 4): ``pose`` with its rotation mended to the nearest; a position (3,) alone where the task asks for no more."""
    x = pose.homogeneous if isinstance(pose, pin.SE3) else pose
    kinds = "a pinocchio.SE3 or a finite (4, 4) matrix"
    if task.name == "position":
        kinds += ", or a position (3,) in m"
    try:
        T = numbers(name, x)
    except ValueError:
        raise ValueError(f"{name}: expected {kinds}, got {shown(pose)}") from None
    if task.name == "position" and T.shape == (3,):
        T = np.vstack([np.column_stack([np.eye(3), T]), [0.0, 0, 0, 1]])
    if T.shape != (4, 4):
        raise ValueError(f"{name}: expected {kinds}, got shape {T.shape}")
    R = np.clip(T[:3, :3], -2, 2)  # what is further off would only overflow
    if np.abs(R @ R.T - np.eye(3)).max() > RIGID or np.linalg.det(R) < 0 or not np.array_equal(T[3], [0, 0, 0, 1]):
        raise ValueError(f"{name}: expected a rigid transform (rotation, position, last row 0 0 0 1), got\n{T}")
    if np.abs(T[:3, 3]).max() > FAR:
        raise ValueError(f"{name}: expected a position within {FAR:g} m, got {T[:3, 3].tolist()}")
    U, _, Vt = np.linalg.svd(R)
    T = T.copy()
    T[:3, :3] = U @ Vt
    return T
