"""Ready choices of z in (21): what a redundant arm does with the motion that its end-effector does not see.

Each returns a joint velocity (n,) rad/s to pass to `joint_velocity(..., z=...)`.
"""

import numpy as np

from k1607_pin.kinematics.differential import jacobian_derivative


def limit_centring(q: np.ndarray, lower: np.ndarray, upper: np.ndarray, gain: float = 1.0) -> np.ndarray:
    """Down the gradient of the mean squared distance from mid-range, in units of the range (Liegeois, 1977).

    q, lower, upper : (n,) rad; joints without limits (infinite range) are left alone; gain : 1/s.
    """
    q, lower, upper = (np.asarray(x, dtype=float) for x in (q, lower, upper))
    limited = np.isfinite(lower) & np.isfinite(upper)
    z = np.zeros(len(q))
    if limited.any():
        low, high = lower[limited], upper[limited]
        span = high - low
        z[limited] = -gain * (q[limited] - (low + high) / 2) / (span * span) * np.mean(span * span)
    return z


def preferred_posture(q: np.ndarray, posture: np.ndarray, gain: float = 1.0) -> np.ndarray:
    """Towards a posture (n,) rad at gain [1/s] times the distance."""
    return gain * (np.asarray(posture) - q)


def manipulability(J: np.ndarray) -> float:
    """sqrt(det(J J^T)): volume of the velocity ellipsoid of J (6, n), zero at a singularity (Yoshikawa, 1985)."""
    return float(np.prod(np.linalg.svd(J, compute_uv=False)))


def manipulability_ascent(J: np.ndarray, gain: float = 1.0) -> np.ndarray:
    """Up the gradient of log manipulability, away from singularities: gain [rad^2/s] times tr(J^+ dJ/dq_k).

    J (6, n) of full rank, in base axes. The logarithm keeps the step finite in units of the distance to the singularity.
    """
    return gain * np.einsum("ia,aik->k", np.linalg.pinv(J), jacobian_derivative(J))
