"""Inverse kinematics to a pose, within joint limits, that tells how it went."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares

from k1607_pin.arm.arm import Arm
from k1607_pin.kinematics.orientation import RIGID

NEWTON_STEPS = 10
NEWTON_TOLERANCE = 1e-10  # m, rad: quadratic convergence leaves no reason to stop before


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
    """rad, angle between wanted and reached orientation."""
    at_limit: tuple[str, ...]
    """Joints that ended on a limit, such as "joint4 lower"."""
    sigma_min: float
    """Smallest singular value of the Jacobian at q; 0 for fewer than six joints."""
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
) -> InverseKinematics:
    """Joint angles that bring the tool to ``target``, within joint limits.

    From q0, and then from random postures until one converges: a few Newton steps; where these leave the limits or do not arrive,
    bounded nonlinear least squares on the pose error (p_d - p, log(R_d R^T)) with its exact Jacobian, and Newton steps from
    what that found. Of the redundant arm's many solutions it returns one near its start.

    Parameters
    ----------
    arm : any arm.
    target : T_base_tool, `pinocchio.SE3` or (4, 4) m; its rotation may be off by `RIGID` and is mended to the nearest one.
    q0 : (n,) where to start, rad; clipped to the limits; None takes the middle of the range.
    position_tolerance, orientation_tolerance : m, rad.
    starts : number of starting postures at most; seed : of the random ones.

    Raises
    ------
    ValueError
        target is not a rigid transform, q0 of wrong shape or not finite, starts below one.
    """
    wanted = _pose(target)
    if not isinstance(starts, int) or starts < 1:
        raise ValueError(f"starts: expected a whole number of at least 1, got {starts!r}")
    lower, upper = arm.lower, arm.upper
    low, high = np.where(np.isfinite(lower), lower, -np.pi), np.where(np.isfinite(upper), upper, np.pi)
    start = (low + high) / 2 if q0 is None else np.array(arm.as_vector(q0, "q0"))
    rng = np.random.default_rng(seed)
    best: InverseKinematics | None = None
    for k in range(starts):
        q = newton(arm, wanted, start, NEWTON_TOLERANCE)
        if q is None:
            # trf keeps to the interior: a start exactly on a limit is nudged off it
            inside = np.clip(start, lower + 1e-9, upper - 1e-9)
            solution = least_squares(
                lambda q: pose_error(wanted, arm.forward_kinematics(q)),
                inside,
                lambda q: _error_jacobian(arm, wanted, q),
                bounds=(lower, upper),
                xtol=1e-15,
                ftol=1e-15,
                gtol=1e-15,
                max_nfev=100,
            )
            polished = newton(arm, wanted, solution.x, NEWTON_TOLERANCE)  # next to a limit trf closes in but slowly
            q = solution.x if polished is None else polished
        result = _result(arm, wanted, q, (position_tolerance, orientation_tolerance), k + 1)
        if best is None or _distance(result) < _distance(best):
            best = result
        if result.converged:
            return result
        start = rng.uniform(low, high)
    assert best is not None
    return InverseKinematics(**{**vars(best), "starts": starts})


def newton(arm: Arm, wanted: pin.SE3, q: np.ndarray, tolerance: float) -> np.ndarray | None:
    """(n,) rad: the posture that a few Newton steps of least joint motion lead to from q; None if that is out of the limits, or
    further from ``wanted`` than ``tolerance`` [m, rad]."""
    for _ in range(NEWTON_STEPS):
        error = pose_error(wanted, arm.forward_kinematics(q))
        if np.abs(error).max() < tolerance:
            return q if ((q >= arm.lower) & (q <= arm.upper)).all() else None
        q = q + np.linalg.lstsq(arm.jacobian(q), error, rcond=1e-3)[0]
    return None


def pose_error(wanted: pin.SE3, actual: pin.SE3) -> np.ndarray:
    """(6,): p_wanted - p [m] and the rotation vector of R_wanted R^T [rad], base axes."""
    rotation = pin.log3(wanted.rotation @ actual.rotation.T)
    return np.concatenate([wanted.translation - actual.translation, rotation])


def _error_jacobian(arm: Arm, wanted: pin.SE3, q: np.ndarray) -> np.ndarray:
    """(6, n): d pose_error / dq. R_wanted R^T turns by -R_wanted R^T w about its own axes, hence Jlog3 of the error."""
    J = arm.jacobian(q)
    E = wanted.rotation @ arm.forward_kinematics(q).rotation.T
    return np.vstack([-J[:3], -pin.Jlog3(E) @ J[3:]])


def _result(
    arm: Arm, wanted: pin.SE3, q: np.ndarray, tolerances: tuple[float, float], starts: int
) -> InverseKinematics:
    error = pose_error(wanted, arm.forward_kinematics(q))
    position, orientation = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    limits = [
        f"{name} {side}"
        for name, x, low, high in zip(arm.joint_names, q, arm.lower, arm.upper, strict=True)
        for side, gap in (("lower", x - low), ("upper", high - x))
        if gap < 1e-6
    ]
    sigma = np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1] if arm.n >= 6 else 0.0
    converged = position <= tolerances[0] and orientation <= tolerances[1]
    return InverseKinematics(q, converged, position, orientation, tuple(limits), float(sigma), starts)


def _distance(result: InverseKinematics) -> float:
    return float(np.hypot(result.position_error, result.orientation_error))


def _pose(target: "pin.SE3 | np.ndarray") -> pin.SE3:
    T = target.homogeneous if isinstance(target, pin.SE3) else np.asarray(target, dtype=float)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise ValueError(f"target: expected a pinocchio.SE3 or a finite (4, 4) matrix, got shape {T.shape}")
    R = T[:3, :3]
    if np.abs(R @ R.T - np.eye(3)).max() > RIGID or np.linalg.det(R) < 0 or not np.array_equal(T[3], [0, 0, 0, 1]):
        raise ValueError(f"target: expected a rigid transform (rotation, position, last row 0 0 0 1), got\n{T}")
    U, _, Vt = np.linalg.svd(R)
    return pin.SE3(U @ Vt, T[:3, 3])
