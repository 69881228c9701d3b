"""Random linear loops, on which section 7's algebra is checked, and derivatives by complex steps."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.control import adaptation, error_system
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.error_system import ErrorSystem, Weights
from k1607_pin.control.reference_model import ReferenceModel, reference_model

LOOPS = 200
BETA = (3.0, 2.0)  # of the linear loops; nothing is published
PSI = 5.0  # Psi_3 = Psi_4 = PSI I unless said otherwise
ROUNDING = 1e-10  # values up to 1e4 as sums of some hundred products: 1e4 x 2e-16 x 50
LINEAR = f"{LOOPS} random linear loops"


class Loops(NamedTuple):
    """Linear systems (39) with constant matrices under the law (40), at random states; not to be taken for an arm's."""

    Lambda: np.ndarray
    """(LOOPS, 6, 6) symmetric positive definite"""
    Phi: np.ndarray
    """(LOOPS, 6, 6)"""
    Gamma: np.ndarray
    """(LOOPS, 6, 6)"""
    gains: Gains
    """(LOOPS, 6, 6) each"""
    z: np.ndarray
    """(LOOPS, 12) x_e and its rate"""
    z_m: np.ndarray
    """(LOOPS, 12) of the reference model"""
    u: np.ndarray
    """(LOOPS, 18) x_d and its two derivatives"""


@cache
def loops() -> Loops:
    """The random linear loops."""
    rng = np.random.default_rng(39)
    A, Phi, Gamma, K_p, K_d = rng.normal(size=(5, LOOPS, 6, 6))
    Lambda = A @ A.swapaxes(-1, -2) + np.eye(6)
    gains = Gains(10 * np.eye(6) + K_p, 10 * np.eye(6) + K_d)
    return Loops(Lambda, Phi, Gamma, gains, *(rng.normal(size=(LOOPS, k)) for k in (12, 12, 18)))


@cache
def design() -> ReferenceModel:
    """Section 7.2's: characteristic roots -1 and -2, Q the identity."""
    return reference_model(2 * np.ones(6), 3 * np.ones(6))


@cache
def general() -> ReferenceModel:
    """Six different systems and a full Q, so that P_2 is not symmetric."""
    rng = np.random.default_rng(60)
    A = rng.normal(size=(12, 12))
    return reference_model(rng.uniform(1, 4, 6), rng.uniform(2, 5, 6), A @ A.T + np.eye(12))


def slope(function: Callable[[complex], Any]) -> Any:
    """The derivative at 0 of an analytic function of one number, by a complex step: no difference, so no cancellation."""
    return np.imag(function(1e-30j)) / 1e-30


def z_dot(z: Any, u: Any, Lambda: Any, Phi: Any, Gamma: Any, gains: Gains) -> Any:
    """(..., 12) rate of z, from (39)-(41) themselves: the force of the gains moves the mass, and x = x_d - x_e."""
    x_e, v_e = z[..., :6], z[..., 6:]
    x_d, v_d, a_d = u[..., :6], u[..., 6:12], u[..., 12:]
    force = np.einsum("...ij,...j", gains.K_p, x_e) + np.einsum("...ij,...j", gains.K_d, v_e)
    force = force - np.einsum("...ij,...j", Phi, v_d - v_e) - np.einsum("...ij,...j", Gamma, x_d - x_e)
    return np.concatenate([v_e, a_d - np.einsum("...ij,...j", np.linalg.inv(Lambda), force)], -1)


def system(gains: Gains | None = None) -> ErrorSystem:
    """(LOOPS, 6, 6) each: (45)-(46) of the loops, with their own gains or others."""
    s = loops()
    return error_system.error_system(s.Lambda, s.Phi, s.Gamma, *(gains or s.gains))


def law_weights(Psi: float = PSI) -> Weights:
    """Psi_1 and Psi_2 for the law with BETA; Psi_3 = Psi_4 = Psi I."""
    return error_system.weights(loops().Lambda, *BETA, Psi * np.eye(6), Psi * np.eye(6))


def upsilon(model: ReferenceModel) -> np.ndarray:
    """(LOOPS, 6) Upsilon for E = -z, entry by entry of P."""
    return -loops().z @ model.P[:, 6:]


def rates_under(gain_rates: Gains) -> ErrorSystem:
    """(LOOPS, 6, 6) each: rates of (45)-(46) as the gains move, all else at rest, by a complex step."""
    gains = loops().gains
    moved = slope(
        lambda step: np.array(system(Gains(*(K + step * K_dot for K, K_dot in zip(gains, gain_rates, strict=True)))))
    )
    return ErrorSystem(*moved)


def adapted_rates(model: ReferenceModel, beta: tuple[float, float] = BETA) -> Gains:
    """(LOOPS, 6, 6) each: the gains' rates of the law in the loops, for E = -z."""
    s = loops()
    rows = [adaptation.gain_rates(model.P_2, model.P_3, *beta, z[:6], z[6:]) for z in s.z]
    return Gains(np.array([row.K_p for row in rows]), np.array([row.K_d for row in rows]))


def driven_by(name: str, model: ReferenceModel) -> np.ndarray:
    """(LOOPS, 6, 6) derivative of (E^T P E)', E = -z, by each entry of one of B_1 to B_4: complex steps along (55).

    It is what the term of (56) with that matrix has to make up for, (61)-(62).
    """
    s, B, derivative = loops(), system(), np.empty((LOOPS, 6, 6))
    for i, j in np.ndindex(6, 6):
        unit = np.zeros((6, 6))
        unit[i, j] = 1

        def rate(step: complex, unit: np.ndarray = unit) -> Any:
            moved = B._replace(**{name: getattr(B, name) + step * unit})
            E_dot = error_system.error_rate(-s.z, s.z, s.u, moved, model.Delta)
            return 2 * np.einsum("ki,ij,kj->k", E_dot, model.P, -s.z)

        derivative[:, i, j] = slope(rate)
    return derivative


def lyapunov_slope(model: ReferenceModel, gains: Gains, gain_rates: Gains, Psi: Weights, u: np.ndarray) -> np.ndarray:
    """(LOOPS,) v' of (56) with E = -z, by a complex step along (39)-(41) and the gains' rates."""
    s = loops()
    rate = z_dot(s.z, u, s.Lambda, s.Phi, s.Gamma, gains)

    def v(step: complex) -> Any:
        moved = (K + step * K_dot for K, K_dot in zip(gains, gain_rates, strict=True))
        return error_system.lyapunov_function(-(s.z + step * rate), system(Gains(*moved)), model, Psi).total

    return slope(v)


def claimed(model: ReferenceModel) -> np.ndarray:
    """(LOOPS,) -E^T Q E for E = -z."""
    return -np.einsum("ki,ij,kj->k", loops().z, model.Q, loops().z)
