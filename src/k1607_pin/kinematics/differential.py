"""From Cartesian to joint velocities: weighted pseudo-inverse, null space, explicit damping, (20)-(23)."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arguments import number, numbers, seen_through, shown


class SingularJacobianError(ValueError):
    """The Jacobian has lost rank and no damping was asked for."""

    def __init__(
        self,
        sigma_min: float,
        threshold: float,
        remedy: str = "pass damping=Damping(...) to go through a singularity at the price of tracking error",
    ) -> None:
        self.sigma_min = sigma_min
        """Smallest singular value of the weighted Jacobian."""
        self.threshold = threshold
        """The value it had to exceed."""
        self.remedy = remedy
        """What to type."""
        super().__init__(f"J: smallest singular value {sigma_min:.3e}, expected more than {threshold:.1e}; {remedy}")

    def __reduce__(self) -> tuple[type, tuple[float, float, str]]:
        return type(self), (self.sigma_min, self.threshold, self.remedy)


@dataclass(frozen=True)
class Damping:
    """Damping that starts at a singular value and grows smoothly to its maximum at rank loss.

    lambda^2 = maximum^2 (1 - (sigma_min / threshold)^2) below the threshold, none above
    (Maciejewski and Klein, J. Robotic Systems 5(6), 1988).
    """

    threshold: float = 0.05
    """sigma_min below which damping acts; units of the Jacobian (m and rad mixed)."""
    maximum: float = 0.05
    """lambda at sigma_min = 0, same units."""

    def __post_init__(self) -> None:
        for name in ("threshold", "maximum"):
            number(name, getattr(self, name), above=0)

    def at(self, sigma_min: float) -> float:
        """lambda for the given smallest singular value."""
        if not (type(sigma_min) is float and sigma_min >= 0):
            sigma_min = number("sigma_min", sigma_min, at_least=0)
        ratio = sigma_min / self.threshold
        return 0.0 if ratio >= 1 else self.maximum * float(np.sqrt(1 - ratio * ratio))

    def squared(self, sigma_squared: Any) -> Any:
        """lambda^2 from sigma_min^2, the smallest eigenvalue of J J^T: for symbols too."""
        return self.maximum**2 * np.maximum(0.0, 1 - sigma_squared / self.threshold**2)


class PseudoInverse(NamedTuple):
    """A weighted pseudo-inverse and what was done to get it."""

    matrix: np.ndarray
    """(n, 6)"""
    sigma_min: float
    """Smallest singular value of J W^(1/2): that of J when W = I."""
    damping: float
    """lambda used; 0 means the exact (22)."""


class JointVelocity(NamedTuple):
    """A joint velocity that realises a Cartesian one, and how well."""

    velocity: np.ndarray
    """(n,) rad/s"""
    residual: np.ndarray
    """(6,): x_dot - J q_dot, m/s and rad/s; zero but for damping."""
    sigma_min: float
    """Smallest singular value of J W^(1/2)."""
    damping: float
    """lambda used; 0 means the exact (21)."""


RANK_TOLERANCE = 1e-9  # sigma_min / sigma_max at which double precision has lost half its digits in J J^T


def weighted_pseudo_inverse(
    J: np.ndarray, W: np.ndarray | None = None, damping: Damping | None = None
) -> PseudoInverse:
    """W J^T [J W J^T + lambda^2 I]^-1, (n, 6): (22), with W = I (23); lambda = 0 unless ``damping`` says otherwise.

    Parameters
    ----------
    J : (6, n), linear rows first.
    W : (n, n) symmetric positive definite, or (n,) its diagonal; q_dot^T W^-1 q_dot is what the inverse minimises.
        The report asks for symmetry only; without definiteness the minimum does not exist.
    damping : when and how much to damp; None refuses a singular J.

    Raises
    ------
    ValueError
        Wrong shapes, entries that are not finite, W not symmetric positive definite.
    SingularJacobianError
        J without full row rank, and no damping.
    """
    J = _jacobian(J)
    L = _square_root(W, J.shape[1])
    # The pseudo-inverse of J L, by singular values: J J^T, whose condition is the square of J's, is never formed.
    U, sigma, Vt = np.linalg.svd(_weighted(J, L), full_matrices=False)
    sigma_min = float(sigma[-1]) if J.shape[1] >= J.shape[0] else 0.0
    lam = _damping(damping).at(sigma_min) if damping is not None else 0.0
    if lam == 0 and sigma_min <= RANK_TOLERANCE * sigma[0]:
        raise SingularJacobianError(sigma_min, RANK_TOLERANCE * float(sigma[0]))
    _, power = np.frexp(max(sigma[0], lam))  # squares of what is very large or small would be infinite or nothing
    s, l = np.ldexp(sigma, -power), np.ldexp(lam, -power)
    with np.errstate(all="ignore"):
        inverse = L @ (Vt.T * np.ldexp(s / (s * s + l * l), -power)) @ U.T
    return PseudoInverse(numbers("inverse of J", inverse), sigma_min, lam)


def joint_velocity(
    J: np.ndarray,
    x_dot: np.ndarray,
    z: np.ndarray | None = None,
    W: np.ndarray | None = None,
    damping: Damping | None = None,
) -> JointVelocity:
    """q_dot = J_W^+ x_dot + (I - J_W^+ J) z: (21).

    Parameters
    ----------
    J : (6, n); x_dot : (6,) m/s and rad/s; z : (n,) rad/s, any joint velocity, of which the part that leaves the
    end-effector at rest is added (`k1607_pin.kinematics.nullspace` has ready choices); W, damping : see
    `weighted_pseudo_inverse`, whose errors are raised here too.
    """
    J = _jacobian(J)
    n = J.shape[1]
    x_dot = numbers("x_dot", x_dot, (6,), "m/s and rad/s")
    inverse = weighted_pseudo_inverse(J, W, damping)
    velocity = inverse.matrix @ x_dot
    if z is not None:
        # Projected with the exact pseudo-inverse even where (22) is damped: the null space needs no damping.
        velocity = velocity + nullspace_projector(J, W) @ numbers("z", z, (n,), "rad/s")
    return JointVelocity(velocity, x_dot - J @ velocity, inverse.sigma_min, inverse.damping)


def nullspace_projector(J: np.ndarray, W: np.ndarray | None = None) -> np.ndarray:
    """I - J_W^+ J, (n, n): joint velocities that do not move the end-effector; exact at every rank of J."""
    J = _jacobian(J)
    L = _square_root(W, J.shape[1])
    _, sigma, Vt = np.linalg.svd(_weighted(J, L), full_matrices=True)
    rank = int((sigma > RANK_TOLERANCE * sigma[0]).sum())
    N = Vt[rank:].T  # (n, n - rank) orthonormal, in the coordinates L^-1 q_dot
    with np.errstate(all="ignore"):
        return numbers("null space of J", L @ N @ N.T @ np.linalg.inv(L))


def jacobian_derivative(J: Any) -> Any:
    """(..., 6, n, n): the derivative of column i with respect to joint k, at [..., i, k], from J (..., 6, n) alone.

    For a serial arm and a Jacobian of its end-effector in base axes, a joint k before i turns the axis and the lever of
    column i; one after it moves the end-effector only:
    dJ_i / dq_k = [w_k x v_i; w_k x w_i] for k <= i, [w_i x v_k; 0] for k > i. Revolute and prismatic joints alike.

    Raises
    ------
    ValueError
        J is not (..., 6, n), or not finite.
    """
    J = seen_through("J", J, numbers)
    if J.ndim < 2 or J.shape[-2] != 6:
        raise ValueError(f"J: expected a (..., 6, n) Jacobian, got shape {J.shape}")
    n = J.shape[-1]
    v, w = J[..., :3, :], J[..., 3:, :]
    out = np.zeros((*J.shape, n))
    for i in range(n):
        for k in range(n):
            if k <= i:
                out[..., :3, i, k] = np.cross(w[..., k], v[..., i])
                out[..., 3:, i, k] = np.cross(w[..., k], w[..., i])
            else:
                out[..., :3, i, k] = np.cross(w[..., i], v[..., k])
    return out


def _jacobian(J: Any) -> np.ndarray:
    J = numbers("J", J, (6, None))
    if not J.size:
        raise ValueError(f"J: expected a (6, n) Jacobian of at least one joint, got shape {J.shape}")
    return J


def _damping(damping: Any) -> Damping:
    if not isinstance(damping, Damping):
        raise ValueError(f"damping: expected Damping(threshold, maximum) or None, got {shown(damping)}")
    return damping


def _weighted(J: np.ndarray, L: np.ndarray) -> np.ndarray:
    """J L, finite: LAPACK would search for singular values of what is not, without end."""
    with np.errstate(over="ignore", invalid="ignore"):
        return numbers("J W^(1/2)", J @ L)


def _square_root(W: Any, n: int) -> np.ndarray:
    """L with L L^T = W."""
    if W is None:
        return np.eye(n)
    W = numbers("W", W)
    if W.shape == (n,):
        W = np.diag(W)
    if W.shape != (n, n):
        raise ValueError(f"W: expected ({n}, {n}) or ({n},), got shape {W.shape}")
    with np.errstate(over="ignore"):
        off = np.abs(W - W.T).max()
    if off > 1e-12 * np.abs(W).max():
        raise ValueError(f"W: expected a symmetric matrix, got one off by {off:.1e}")
    try:
        return numbers("W^(1/2)", np.linalg.cholesky(W))
    except np.linalg.LinAlgError:
        raise ValueError(f"W: expected a positive definite matrix, got eigenvalues {np.linalg.eigvalsh(W)}") from None
