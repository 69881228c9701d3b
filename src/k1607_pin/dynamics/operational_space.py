"""The arm's dynamics seen from its tool: F = Lambda x_ddot + Phi x_dot + Gamma x, eq. (39), for any number of joints."""

from typing import Any, NamedTuple

import numpy as np


class OperationalSpace(NamedTuple):
    """Cartesian dynamics at one state; base axes, linear components first, SI."""

    Lambda: Any
    """(6, 6) (J M^-1 J^T)^-1: Cartesian mass matrix, symmetric positive definite."""
    Phi: Any
    """(6, 6) (J_bar^T C - Lambda J_dot) J_bar: Coriolis and centrifugal; Lambda_dot - 2 Phi is skew."""
    Gamma: Any
    """(6, 6) with Gamma x = J_bar^T g. Not unique: this is the one of least Frobenius norm, p x^T / (x^T x)."""
    jacobian: Any
    """(6, n)"""
    jacobian_bar: Any
    """(n, 6) M^-1 J^T Lambda: the dynamically consistent inverse of J."""
    bias_nullspace: Any
    """(6,) (J_bar^T C - Lambda J_dot)(I - J_bar J) v: what motion in the null space adds to the force; zero for n = 6."""
    gravity: Any
    """(6,) J_bar^T g: what the tool must be held with."""
    sigma_min: Any
    """Smallest singular value of J; None when traced."""
    damping: float
    """lambda of (J M^-1 J^T + lambda^2 I / m)^-1, in the units of J; 0 means exact."""


def operational_space(
    M: Any, C: Any, g: Any, J: Any, J_dot: Any, x: Any, v: Any, sigma_min: Any = None, damping: float = 0.0
) -> OperationalSpace:
    """Lambda, Phi, Gamma and J_bar from joint-space quantities.

    Parameters
    ----------
    M, C : (n, n) mass and Coriolis matrix, the latter with M_dot - 2 C skew; g : (n,) gravity torque.
    J, J_dot : (6, n); x : (6,) tool position [m] and rotation vector [rad]; v : (n,) joint velocity.
    sigma_min : passed through; damping : lambda, in the units of J.
    """
    n = J.shape[1]
    M_inverse_JT = np.linalg.solve(M, J.T)  # (n, 6)
    mobility = J @ M_inverse_JT  # (6, 6)
    if damping:
        # 1/m = tr(J M^-1 J^T) / tr(J J^T) carries lambda over from J J^T + lambda^2 I, where it is a share of J's own scale.
        mobility = mobility + damping * damping * np.trace(mobility) / np.trace(J @ J.T) * np.eye(6)
    Lambda = np.linalg.solve(mobility, np.eye(6))
    Lambda = (Lambda + Lambda.T) / 2
    J_bar = M_inverse_JT @ Lambda  # (n, 6)
    velocity_force = J_bar.T @ C - Lambda @ J_dot  # (6, n)
    p = J_bar.T @ g
    return OperationalSpace(
        Lambda=Lambda,
        Phi=velocity_force @ J_bar,
        Gamma=np.outer(p, x) / (x @ x),
        jacobian=J,
        jacobian_bar=J_bar,
        bias_nullspace=velocity_force @ ((np.eye(n) - J_bar @ J) @ v),
        gravity=p,
        sigma_min=sigma_min,
        damping=damping,
    )
