"""Initial gains of the hybrid scheme, and the limit up to which its sampled loop holds them, (H8) and (H12) of docs/hybrid.md."""

from collections.abc import Callable
from typing import Any

import numpy as np

from k1607_pin.arguments import as_floats, number, numbers
from k1607_pin.arm.arm import Arm
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.modes import checked_selection
from k1607_pin.control.pose import checked_rotation
from k1607_pin.control.sampled import Sampled, growth
from k1607_pin.control.singular import cartesian_inertia


class UnstableGainsError(ValueError):
    """Gains with which the sampled loop runs away, by what factor a period, and what to change."""

    def __init__(self, growth: float, message: str) -> None:
        self.growth, self._message = growth, message
        super().__init__(message)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.growth, self._message)


def hybrid_gains(
    arm: Arm,
    q: np.ndarray,
    stiffness: Any,
    omega: float,
    force_omega: float,
    damping: float = 1.0,
    force_damping: float = 1.0,
    compliance: Any = None,
    period: float | None = None,
    selection: Any = None,
) -> tuple[Gains, Gains]:
    """Initial gains of both loops, compliance axes: each a system of its omega [1/s] and damping, (H8).

    The force loop's on a contact of ``stiffness``: K_p = omega^2 Lambda, K_d = 2 damping omega Lambda;
    K_pf = force_omega^2 Lambda K^-1 - 1, K_df = 2 force_damping force_omega Lambda K^-1.

    How fast they may be is a matter of the selection S, which takes the coupling between both loops' directions out of K_d:
    Lambda^-1 (S K_d S + (1 - S) K_d (1 - S)) exceeds 2 damping omega, and a torque held for a period T needs less than 2 / T
    of it, far less omega than 1 / T where the compliance axes lie askew to the arm. (H12) is exact; it is looked at here where
    ``period`` and ``selection`` are given, and always by `HybridAdaptive.start`.

    Parameters
    ----------
    q : (n,) rad; stiffness : N/m, N m/rad, one number or (6,), compliance axes; compliance : (3, 3), None for the base's axes.
        On a contact softer by s the force loop's omega falls with the root of s, and its damping rises so.
    period : s, of the control; selection : (6,) or (6, 6), as of a `Mode`.

    Raises
    ------
    ValueError
        A stiffness or an omega that is not positive, a damping that is negative, a compliance that is no rotation; a period
        without a selection; fewer than six joints.
    SingularJacobianError
        A singular posture.
    UnstableGainsError
        The sampled loop runs away; the largest omega is named.
    """
    if arm.n < 6:
        raise ValueError(
            f"arm: expected six joints or more, as the scheme controls the tool in six directions, got {arm.n}; "
            "CartesianAdaptive takes task='axis' or task='position'"
        )
    q, K = numbers("q", q, (arm.n,), "rad"), checked_stiffness(stiffness)
    omega, force_omega = number("omega", omega, 0, unit="1/s"), number("force_omega", force_omega, 0, unit="1/s")
    damping, force_damping = number("damping", damping, at_least=0), number("force_damping", force_damping, at_least=0)
    C = np.eye(3) if compliance is None else checked_rotation("compliance", compliance)
    turn = np.kron(np.eye(2), C)
    Lambda = turn.T @ cartesian_inertia(arm, q) @ turn
    Lambda_K = Lambda / K  # (6, 6) Lambda K^-1, s^2
    gains = Gains(omega**2 * Lambda, 2 * damping * omega * Lambda)
    force_gains = Gains(force_omega**2 * Lambda_K - np.eye(6), 2 * force_damping * force_omega * Lambda_K)
    if period is not None or selection is not None:
        period = number("period", period, 0, unit="s")
        S = checked_selection("selection", selection)
        require_stable(np.linalg.inv(Lambda), gains, force_gains, K, S, period)
    return gains, force_gains


def hybrid_loop(
    mobility: np.ndarray,
    gains: Gains,
    force_gains: Gains,
    stiffness: np.ndarray,
    selection: np.ndarray,
    contact: float = 0.0,
    smoothing: float = 1.0,
    force_integral: float = 0.0,
) -> Sampled:
    """The linear model of both loops under fixed gains, (H12), compliance axes.

    Parameters
    ----------
    mobility : (6, 6) J M^-1 J^T; gains, force_gains : (6, 6) each; stiffness : (6,) assumed; selection : (6,) 0 or 1.
    contact : stiffness that is met in the selected directions, a share of the assumed one; 0 off the wall.
    smoothing : share of the velocity filter in a period; force_integral : 1/s.
    """
    s, free = np.asarray(selection, dtype=float), 1 - np.asarray(selection, dtype=float)
    met = contact * stiffness * s  # (6,) K_e S
    return Sampled(
        mobility,
        free[:, None] * gains.K_p * free + s[:, None] * force_gains.K_p * met,
        free[:, None] * gains.K_d * free + s[:, None] * force_gains.K_d * stiffness * s,
        np.diag(met),
        np.diag(force_integral * met),
        smoothing,
    )


def require_stable(
    mobility: np.ndarray,
    gains: Gains,
    force_gains: Gains,
    stiffness: np.ndarray,
    selection: np.ndarray,
    period: float,
    smoothing: Callable[[float], float] = lambda period: 1.0,
    force_integral: float = 0.0,
) -> None:
    """Refuse gains with which the sampled loop runs away, off the wall or on a contact as stiff as assumed.

    Parameters
    ----------
    As for `hybrid_loop`; period : s; smoothing : of a period.

    Raises
    ------
    UnstableGainsError
        It names the largest omega, or the longest period.
    """

    def at(period: float, share: float = 1.0, force_share: float = 1.0) -> float:
        """Growth with the loops' omegas scaled."""
        position = Gains(share**2 * gains.K_p, share * gains.K_d)
        force = Gains(force_share**2 * (np.eye(6) + force_gains.K_p) - np.eye(6), force_share * force_gains.K_d)
        rest = smoothing(period), force_integral
        loops = (hybrid_loop(mobility, position, force, stiffness, selection, c, *rest) for c in (0.0, 1.0))
        return max(growth(loop, period) for loop in loops)

    if (grows := at(period)) <= STEADY:
        return
    axes = ", ".join(str(k) for k in np.flatnonzero(selection)) or "none"
    omega = np.sqrt(max(float(np.trace(mobility @ gains.K_p)) / 6, 0.0))  # of gains such as `hybrid_gains` makes
    remedies = []
    if (share := largest(lambda share: at(period, share) <= STEADY)) > 0:
        remedies.append(f"omega of at most {share * omega:.4g} 1/s in place of {omega:.4g}")
    elif (share := largest(lambda share: at(period, share, share) <= STEADY)) > 0:
        remedies.append(f"omega and force_omega of at most {share:.3g} times as much")
    if (share := largest(lambda share: at(share * period) <= STEADY)) > 0:
        remedies.append(f"a control period of at most {share * period:.3g} s")
    raise UnstableGainsError(
        grows,
        f"gains, force_gains: errors grow {grows:.4g} times in each control period of {period:g} s where the force-controlled "
        f"axes are: {axes}; expected {' or '.join(remedies) or 'other gains'}, see (H12) of docs/hybrid.md",
    )


STEADY = 1 + 1e-6  # a period: what no loop holds stays where it is, a factor of 1 but for rounding


def largest(holds: Callable[[float], bool]) -> float:
    """The largest share below 1 up to which ``holds`` does, to 1e-6 of it; 0 if not even at a thousandth."""
    low, high = 1e-3, 1.0
    if not holds(low):
        return 0.0
    while high - low > 1e-6 * low:
        middle = np.sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return float(low)


def checked_stiffness(stiffness: Any) -> np.ndarray:
    """(6,) positive numbers, from one or six."""
    expected = "one or (6,) positive numbers in N/m, N m/rad"
    x = as_floats("stiffness", stiffness, expected)
    if x.shape not in ((), (6,)) or not ((x > 0) & np.isfinite(x)).all():
        raise ValueError(f"stiffness: expected {expected}, got {stiffness!r}")
    return np.broadcast_to(x, (6,)).copy()
