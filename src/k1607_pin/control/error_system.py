"""The error system of the adaptive loop and its Lyapunov function, (42)-(73): the report's stability proof, made measurable.

Every function takes one sample or many: vectors (..., m), matrices (..., m, m), leading dimensions broadcast, so that a log over
time goes in as it is. m is 6 for the Cartesian scheme.

With E = z_m - z and y the lower half of P E, the derivative of (56) along (55) is, exactly,

    v' = -E^T Q E                                                                                claimed, (63)
         + 2 tr[(B_1 - Delta_1)^T (y x_e^T + Psi_1 Lambda^-1 K_p')] + the same of B_2, K_d      gains: 0 under (74)-(75), mended
         - 2 y^T B_3 x_d - 2 y^T B_4 x_d' - 2 y^T x_d''                                          driven: nothing cancels them
         - 2 E^T P w                                                                             disturbance: what (44) leaves out
         + 2 sum of tr[.^T Psi_i (B_i' - its share from the gains)] + sum of tr[.^T Psi_i' .]    variation, weights: slow motion

(57) has the first line, the second, and the third without its last term; (61)-(68) take all but the first line for zero.
"""

from typing import Any, NamedTuple

import numpy as np

from k1607_pin.control.adaptation import Gains


class ErrorSystem(NamedTuple):
    """The matrices of (45)-(46), or their time derivatives."""

    B_1: Any
    """(..., m, m) Lambda^-1 (Gamma + K_p), 1/s^2"""
    B_2: Any
    """(..., m, m) Lambda^-1 (Phi + K_d), 1/s"""
    B_3: Any
    """(..., m, m) Lambda^-1 Gamma, 1/s^2"""
    B_4: Any
    """(..., m, m) Lambda^-1 Phi, 1/s"""


class Weights(NamedTuple):
    """Psi_1 to Psi_4 of (56), symmetric, or their time derivatives."""

    Psi_1: Any
    """(..., m, m)"""
    Psi_2: Any
    """(..., m, m)"""
    Psi_3: Any
    """(..., m, m)"""
    Psi_4: Any
    """(..., m, m)"""


class LyapunovFunction(NamedTuple):
    """The five terms of (56)."""

    state: Any
    """(...) E^T P E"""
    B_1: Any
    """(...) tr[(B_1 - Delta_1)^T Psi_1 (B_1 - Delta_1)]"""
    B_2: Any
    """(...) tr[(B_2 - Delta_2)^T Psi_2 (B_2 - Delta_2)]"""
    B_3: Any
    """(...) tr[B_3^T Psi_3 B_3]: no gain enters it"""
    B_4: Any
    """(...) tr[B_4^T Psi_4 B_4]: no gain enters it"""

    @property
    def total(self) -> Any:
        """(...) v"""
        return self.state + self.B_1 + self.B_2 + self.B_3 + self.B_4


class LyapunovRate(NamedTuple):
    """The time derivative of (56), by what causes it; each (...), 1/s times the unit of v."""

    claimed: Any
    """-E^T Q E: all that (63) leaves"""
    gains: Any
    """What the gains' rates do, zero when they follow the mended (74)-(75)"""
    driven_position: Any
    """-2 y^T B_3 x_d: gravity at the wanted position"""
    driven_velocity: Any
    """-2 y^T B_4 x_d'"""
    driven_acceleration: Any
    """-2 y^T x_d'': in (55), not in (57)"""
    disturbance: Any
    """-2 E^T P w: what (44) leaves out"""
    variation: Any
    """From rates of the B_i that are not the gains' doing: Lambda, Phi and Gamma change along the motion"""
    weights: Any
    """From rates of the Psi_i: Psi_1 and Psi_2 are multiples of Lambda"""

    @property
    def driven(self) -> Any:
        """(...) the three terms of u"""
        return self.driven_position + self.driven_velocity + self.driven_acceleration

    @property
    def total(self) -> Any:
        """(...) v'"""
        return self.claimed + self.gains + self.driven + self.disturbance + self.variation + self.weights


def error_system(Lambda: Any, Phi: Any, Gamma: Any, K_p: Any, K_d: Any) -> ErrorSystem:
    """B_1 to B_4 of (45)-(46) from the matrices of (39) and the gains of (40), (..., m, m) each."""
    return ErrorSystem(
        np.linalg.solve(Lambda, Gamma + K_p),
        np.linalg.solve(Lambda, Phi + K_d),
        np.linalg.solve(Lambda, Gamma),
        np.linalg.solve(Lambda, Phi),
    )


def error_system_rates(
    Lambda: Any, B: ErrorSystem, Lambda_dot: Any, Phi_dot: Any, Gamma_dot: Any, gain_rates: Gains
) -> ErrorSystem:
    """Time derivatives of B_1 to B_4, exact: of Lambda B_1 = Gamma + K_p and its like.

    Parameters
    ----------
    Lambda, Lambda_dot, Phi_dot, Gamma_dot : (..., m, m) of (39), along the motion; B : (45)-(46) there.
    gain_rates : K_p' and K_d', (..., m, m) each.
    """
    return ErrorSystem(
        np.linalg.solve(Lambda, Gamma_dot + gain_rates.K_p - Lambda_dot @ B.B_1),
        np.linalg.solve(Lambda, Phi_dot + gain_rates.K_d - Lambda_dot @ B.B_2),
        np.linalg.solve(Lambda, Gamma_dot - Lambda_dot @ B.B_3),
        np.linalg.solve(Lambda, Phi_dot - Lambda_dot @ B.B_4),
    )


def held_rates(Lambda: Any, gain_rates: Gains) -> ErrorSystem:
    """Time derivatives of B_1 to B_4 if the arm's dynamics stood still, (66)-(68): exact then, and only then."""
    B_1_dot, B_2_dot = np.linalg.solve(Lambda, gain_rates.K_p), np.linalg.solve(Lambda, gain_rates.K_d)
    return ErrorSystem(B_1_dot, B_2_dot, 0 * B_1_dot, 0 * B_2_dot)


def demanded_rates(y: Any, z: Any, u: Any, Psi: Weights) -> ErrorSystem:
    """Time derivatives of B_1 to B_4 that (61)-(62) ask for, (64)-(65).

    Those of B_1 and B_2 the gains can give; B_3 and B_4 belong to the arm.

    Parameters
    ----------
    y : (..., m) see `upsilon_of`; z : (..., 2m) of (43); u : (..., 3m) of (47); Psi : (..., m, m) each.
    """
    (x_e, v_e), (x_d, v_d, _) = _parts(z, 2), _parts(u, 3)
    return ErrorSystem(
        -np.linalg.solve(Psi.Psi_1, _outer(y, x_e)),
        -np.linalg.solve(Psi.Psi_2, _outer(y, v_e)),
        np.linalg.solve(Psi.Psi_3, _outer(y, x_d)),
        np.linalg.solve(Psi.Psi_4, _outer(y, v_d)),
    )


def weights(Lambda: Any, beta_1: Any, beta_2: Any, Psi_3: Any, Psi_4: Any) -> Weights:
    """Psi_1 = Lambda / beta_1 and Psi_2 = Lambda / beta_2, (72)-(73) without their minus sign; Psi_3, Psi_4 as given.

    Positive definite as Lambda is, for beta_1, beta_2 > 0. They change with Lambda: see `LyapunovRate.weights`.
    """
    return Weights(Lambda / beta_1, Lambda / beta_2, Psi_3, Psi_4)


def system_matrices(B: ErrorSystem) -> tuple[Any, Any]:
    """(..., 2m, 2m) and (..., 2m, 3m) of z' = A z + B_u u, (44), with the identity where the report has a second zero.

    z = (x_e, x_e') of (43) and u = (x_d, x_d', x_d'') of (47).
    """
    zero = 0 * B.B_1
    identity = zero + np.eye(B.B_1.shape[-1], dtype=int)
    A = np.block([[zero, identity], [-B.B_1, -B.B_2]])
    B_u = np.block([[zero, zero, zero], [B.B_3, B.B_4, identity]])
    return A, B_u


def error_rate(E: Any, z: Any, u: Any, B: ErrorSystem, Delta: Any, disturbance: Any = 0) -> Any:
    """(..., 2m) E' of (55).

    Parameters
    ----------
    E : (..., 2m) z_m - z, (54); z : (..., 2m) of (43); u : (..., 3m) of (47).
    Delta : (2m, 2m) of (50).
    disturbance : (..., 2m) w, what z' has beyond (44). Its upper half is the derivative of x_e less x_e', which orientations
        have; its lower half an acceleration, such as Lambda^-1 times the force of (39) that null-space motion adds.
    """
    A, B_u = system_matrices(B)
    return _times(Delta, E) + _times(Delta - A, z) - _times(B_u, u) - disturbance


def upsilon_of(P: Any, E: Any) -> Any:
    """(..., m) P_2^T E_1 + P_3 E_2, the lower half of P E: (58) for any z_m and any P."""
    return _parts(_times(P, E), 2)[1]


def lyapunov_function(E: Any, B: ErrorSystem, model: Any, Psi: Weights) -> LyapunovFunction:
    """The terms of v, (56).

    Parameters
    ----------
    E : (..., 2m) of (54); B : (..., m, m) each; model : `ReferenceModel` of m systems; Psi : (..., m, m) each.
    """
    X_1, X_2 = _distances(B, model)
    return LyapunovFunction(
        _dot(E, _times(model.P, E)),
        _trace(X_1, Psi.Psi_1 @ X_1),
        _trace(X_2, Psi.Psi_2 @ X_2),
        _trace(B.B_3, Psi.Psi_3 @ B.B_3),
        _trace(B.B_4, Psi.Psi_4 @ B.B_4),
    )


def lyapunov_rate(
    E: Any,
    z: Any,
    u: Any,
    B: ErrorSystem,
    rates: ErrorSystem,
    model: Any,
    Psi: Weights,
    held: ErrorSystem | None = None,
    Psi_rates: Weights | None = None,
    disturbance: Any = None,
) -> LyapunovRate:
    """The time derivative of (56) along (55), exact, by what causes it.

    Parameters
    ----------
    E, z, u, B, model, Psi, disturbance : as for `error_rate` and `lyapunov_function`.
    rates : time derivatives of B, see `error_system_rates`.
    held : the gains' share of them, see `held_rates`; None counts all of B_1' and B_2' as the gains'.
    Psi_rates : time derivatives of Psi; None for constant ones.
    """
    (x_e, v_e), (x_d, v_d, a_d) = _parts(z, 2), _parts(u, 3)
    X_1, X_2 = _distances(B, model)
    y, held = upsilon_of(model.P, E), held or rates
    gains = _dot(y, _times(X_1, x_e) + _times(X_2, v_e))
    gains = gains + _trace(X_1, Psi.Psi_1 @ held.B_1) + _trace(X_2, Psi.Psi_2 @ held.B_2)
    variation = (
        _trace(X_1, Psi.Psi_1 @ (rates.B_1 - held.B_1))
        + _trace(X_2, Psi.Psi_2 @ (rates.B_2 - held.B_2))
        + _trace(B.B_3, Psi.Psi_3 @ rates.B_3)
        + _trace(B.B_4, Psi.Psi_4 @ rates.B_4)
    )
    claimed = -_dot(E, _times(model.Q, E))
    return LyapunovRate(
        claimed=claimed,
        gains=2 * gains,
        driven_position=-2 * _dot(y, _times(B.B_3, x_d)),
        driven_velocity=-2 * _dot(y, _times(B.B_4, v_d)),
        driven_acceleration=-2 * _dot(y, a_d),
        disturbance=0 * claimed if disturbance is None else -2 * _dot(_times(model.P, E), disturbance),
        variation=2 * variation,
        weights=0 * claimed if Psi_rates is None else lyapunov_function(0 * E, B, model, Psi_rates).total,
    )


def _distances(B: ErrorSystem, model: Any) -> tuple[Any, Any]:
    """B_1 - Delta_1 and B_2 - Delta_2."""
    m = model.Delta.shape[0] // 2
    return B.B_1 + model.Delta[m:, :m], B.B_2 + model.Delta[m:, m:]


# Written so that floats, batches, complex numbers, polynomials and CasADi's arrays, which know neither an ellipsis for one axis
# nor einsum, all pass.


def _parts(x: Any, count: int) -> list[Any]:
    """Vectors (..., count m) cut into count times (..., m)."""
    if len(x.shape) == 1:
        m = x.shape[0] // count
        return [x[k * m : (k + 1) * m] for k in range(count)]
    m = x.shape[-1] // count
    return [x[..., k * m : (k + 1) * m] for k in range(count)]


def _times(M: Any, x: Any) -> Any:
    """(..., m) M x for M (..., m, k) and x (..., k)."""
    return M @ x if len(x.shape) == 1 else (M @ x[..., None])[..., 0]


def _dot(a: Any, b: Any) -> Any:
    return np.sum(a * b, axis=-1)


def _outer(a: Any, b: Any) -> Any:
    return np.outer(a, b) if len(a.shape) == len(b.shape) == 1 else a[..., :, None] * b[..., None, :]


def _trace(X: Any, Y: Any) -> Any:
    """(...) tr[X^T Y]"""
    return np.sum(X * Y, axis=(-2, -1))
