"""Ready choices of z in (21): what a redundant arm does with the motion that its end-effector does not see.

Each returns a joint velocity (n,) rad/s to pass to `joint_velocity(..., z=...)`.
"""

from typing import Any

import numpy as np

from k1607_pin.arguments import number, numbers, seen_through
from k1607_pin.kinematics.differential import jacobian_derivative


def limit_centring(q: np.ndarray, lower: np.ndarray, upper: np.ndarray, gain: float = 1.0) -> np.ndarray:
    """Down the gradient of the mean squared distance from mid-range, in units of the range (Liegeois, 1977).

    q, lower, upper : (n,) rad; joints without limits (infinite range), or without a range, are left alone; gain : 1/s.
    """
    q = numbers("q", q, (None,), "rad")
    lower, upper = (numbers(name, x, q.shape, "rad", finite=False) for name, x in (("lower", lower), ("upper", upper)))
    gain = number("gain", gain, unit="1/s")
    if not (lower <= upper).all():  # NaN too
        raise ValueError(
            f"lower, upper: expected lower limits below upper ones, got {lower.tolist()} and {upper.tolist()}"
        )
    limited = np.isfinite(lower) & np.isfinite(upper) & (lower < upper)
    z = np.zeros(len(q))
    if limited.any():
        low, high = lower[limited], upper[limited]
        span = high - low
        z[limited] = -gain * (q[limited] - (low + high) / 2) / (span * span) * np.mean(span * span)
    return z


def preferred_posture(q: Any, posture: Any, gain: float = 1.0) -> Any:
    """Towards a posture (n,) rad at gain [1/s] times the distance."""
    q = seen_through("q", q, numbers, (None,), "rad")
    posture = seen_through("posture", posture, numbers, (q.shape[0],), "rad")
    return seen_through("gain", gain, number) * (posture - q)


MOST = 1e300


def _moderate(J: np.ndarray, most: float) -> np.ndarray:
    """J, refused where products of its entries would overflow."""
    if J.size and np.abs(J).max() > most:
        raise ValueError(f"J: expected entries up to {most:.0e}, got {np.abs(J).max():.1e}")
    return J


def manipulability(J: np.ndarray) -> float:
    """sqrt(det(J J^T)): volume of the velocity ellipsoid of J (m, n), zero at a singularity (Yoshikawa, 1985).

    All six rows, or those of a task. Zero for fewer joints than rows.
    """
    J = _moderate(numbers("J", J, (None, None)), MOST ** (1 / 6))
    return float(np.prod(np.linalg.svd(J, compute_uv=False))) if J.shape[1] >= J.shape[0] else 0.0


def manipulability_ascent(J: np.ndarray, gain: float = 1.0) -> np.ndarray:
    """Up the gradient of log manipulability, away from singularities: gain [rad^2/s] times tr(J^+ dJ/dq_k).

    J (6, n) of full rank, in base axes. The logarithm keeps the step finite in units of the distance to the singularity.
    """
    J, gain = _moderate(numbers("J", J, (6, None)), MOST**0.5), number("gain", gain)
    if np.abs(J).max() < 1 / MOST**0.5:
        raise ValueError(f"J: expected a Jacobian of full rank, got none with an entry above {1 / MOST**0.5:.0e}")
    return gain * np.einsum("ia,aik->k", np.linalg.pinv(J), jacobian_derivative(J))
