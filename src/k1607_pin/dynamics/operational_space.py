"""The arm's dynamics seen from its tool: F = Lambda x_ddot + Phi x_dot + Gamma x, eq. (39), for any number of joints."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.lapack import dgesvd

from k1607_pin.dynamics.linear import inverse_definite, solve_definite
from k1607_pin.dynamics.rigid_body import (
    Body,
    coriolis_matrix,
    inverse_dynamics,
    mass_matrix,
    point_jacobian,
    point_jacobian_rate,
    point_pose,
)


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

    @property
    def nullspace_projector(self) -> Any:
        """(n, n) N = I - J_bar J: N v leaves the tool at rest, and joint torques N^T tau do not accelerate it.

        Zero for n = 6. Damped, it is no projector: N v then moves the tool.
        """
        return np.eye(self.jacobian.shape[1]) - self.jacobian_bar @ self.jacobian


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
    # np.dot and not @: on matrices this small it saves an eighth of all that `Arm.operational_space` takes.
    M_inverse_JT = solve_definite(M, J.T)  # (n, 6)
    mobility = np.dot(J, M_inverse_JT)  # (6, 6)
    if damping:
        # 1/m = tr(J M^-1 J^T) / tr(J J^T) carries lambda over from J J^T + lambda^2 I, where it is a share of J's own scale.
        mobility = mobility + damping * damping * np.trace(mobility) / np.trace(np.dot(J, J.T)) * _I6
    Lambda = inverse_definite(mobility)
    J_bar = np.dot(M_inverse_JT, Lambda)  # (n, 6)
    velocity_force = np.dot(J_bar.T, C) - np.dot(Lambda, J_dot)  # (6, n)
    p = np.dot(J_bar.T, g)
    return OperationalSpace(
        Lambda=Lambda,
        Phi=np.dot(velocity_force, J_bar),
        Gamma=np.outer(p, x / np.dot(x, x)),
        jacobian=J,
        jacobian_bar=J_bar,
        bias_nullspace=np.dot(velocity_force, v - np.dot(J_bar, np.dot(J, v))),
        gravity=p,
        sigma_min=sigma_min,
        damping=damping,
    )


def operational_space_of_bodies(
    bodies: Sequence[Body], q: Any, v: Any, last: int, offset: Any, rotation: Any, gravity: Any, damping: float = 0.0
) -> OperationalSpace:
    """The same of a tree of bodies, with the tool on any of them: without Pinocchio, so that the whole can be traced.

    Parameters
    ----------
    q, v : (n,) joint positions and velocities.
    last : index of the body that carries the tool, at least six joints from the base for an undamped Lambda.
    offset : (3,) m; rotation : (3, 3): the tool frame in that body's joint frame.
    gravity : (3,) m/s^2 in the base.
    damping : lambda, in the units of J. A singular J is not looked for: ``sigma_min`` is None.
    """
    rest = np.zeros(len(bodies))
    return operational_space(
        mass_matrix(bodies, q),
        coriolis_matrix(bodies, q, v),
        inverse_dynamics(bodies, q, rest, rest, gravity),
        point_jacobian(bodies, q, last, offset),
        point_jacobian_rate(bodies, q, v, last, offset),
        point_pose(bodies, q, last, offset, rotation),
        v,
        damping=damping,
    )


def singular_values(J: np.ndarray) -> np.ndarray:
    """Of J (m, n), largest first; NaN where J is not finite. np.linalg.svd takes twice as long over matrices this small."""
    # LAPACK would look for them without end; a finite sum of squares, cheaper than np.isfinite, rules that out
    if not math.isfinite(np.vdot(J, J)) and not np.isfinite(J).all():
        return np.full(min(J.shape), np.nan)
    return dgesvd(J, compute_uv=0)[1]


_I6 = np.eye(6)
