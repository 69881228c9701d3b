"""Exact proofs of section 7: the error system's own code run on polynomials, for six directions and any matrices."""

from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from sympy import QQ
from sympy.polys.orderings import lex
from sympy.polys.rings import ring

from k1607_pin.control import error_system
from k1607_pin.control.error_system import ErrorSystem, Weights

M = 6
LOWER = np.tril_indices(M)


class Symbols(NamedTuple):
    """Letters for everything that enters (55)-(57)."""

    E: Any
    """(12,)"""
    z: Any
    """(12,)"""
    u: Any
    """(18,)"""
    w: Any
    """(12,) disturbance"""
    Lambda: Any
    """(6, 6)"""
    B: ErrorSystem
    rates: ErrorSystem
    """of B, any"""
    Psi: Weights
    """symmetric"""
    Psi_rates: Weights
    """symmetric, any"""
    model: Any
    """.P symmetric, .Delta of (50), .Q = -(P Delta + Delta^T P), which is (60)"""


@cache
def symbols() -> Symbols:
    """The letters, as polynomials with rational coefficients."""
    n, triangle = 2 * M, M * (M + 1) // 2
    sizes = [n, n, 3 * M, n, M * M] + 8 * [M * M] + 8 * [triangle] + [n * (n + 1) // 2, M * n]
    _, *letters = ring([f"x{k}" for k in range(sum(sizes))], QQ, lex)
    cut = np.split(np.array(letters, dtype=object), np.cumsum(sizes)[:-1])
    E, z, u, w, Lambda, *rest = cut
    squares = [x.reshape(M, M) for x in [Lambda, *rest[:8]]]
    Psi = [_symmetric(x, M) for x in rest[8:16]]
    P = _symmetric(rest[16], n)
    Delta = np.concatenate([np.eye(n, dtype=int)[M:], rest[17].reshape(M, n)]).astype(object)
    model = SimpleNamespace(P=P, Delta=Delta, Q=-(P @ Delta + Delta.T @ P))
    B, rates = ErrorSystem(*squares[1:5]), ErrorSystem(*squares[5:])
    return Symbols(E, z, u, w, squares[0], B, rates, Weights(*Psi[:4]), Weights(*Psi[4:]), model)


def state_space_is_exact() -> bool:
    """(44) against (42): Lambda times the lower half of z', with Gamma, Phi, K_p, K_d from (45)-(46)."""
    s = symbols()
    A, B_u = error_system.system_matrices(s.B)
    z_dot = A @ s.z + B_u @ s.u
    (x_e, v_e), (x_d, v_d, a_d) = np.split(s.z, 2), np.split(s.u, 3)
    Gamma, Phi = s.Lambda @ s.B.B_3, s.Lambda @ s.B.B_4
    K_p, K_d = s.Lambda @ s.B.B_1 - Gamma, s.Lambda @ s.B.B_2 - Phi
    left = s.Lambda @ z_dot[M:] + (Phi + K_d) @ v_e + (Gamma + K_p) @ x_e
    right = s.Lambda @ a_d + Phi @ v_d + Gamma @ x_d
    return _is_zero(left - right) and _is_zero(z_dot[:M] - v_e)


def error_rate_is_exact() -> bool:
    """(55): Delta z_m less z' of (44), for E = z_m - z."""
    s = symbols()
    A, B_u = error_system.system_matrices(s.B)
    z_m = s.E + s.z
    direct = s.model.Delta @ z_m - (A @ s.z + B_u @ s.u + s.w)
    return _is_zero(error_system.error_rate(s.E, s.z, s.u, s.B, s.model.Delta, s.w) - direct)


def lyapunov_rate_is_exact() -> bool:
    """(57), mended: (56) differentiated by every letter that moves, times that letter's rate."""
    s = symbols()
    v = error_system.lyapunov_function(s.E, s.B, s.model, s.Psi).total
    E_dot = error_system.error_rate(s.E, s.z, s.u, s.B, s.model.Delta, s.w)
    moving = [(s.E, E_dot), *((np.ravel(B), np.ravel(rate)) for B, rate in zip(s.B, s.rates, strict=True))]
    moving += [(Psi[LOWER], rate[LOWER]) for Psi, rate in zip(s.Psi, s.Psi_rates, strict=True)]
    direct = 0
    for letters, rates in moving:
        for x, x_dot in zip(letters, rates, strict=True):
            direct = direct + v.diff(x) * x_dot
    rate = error_system.lyapunov_rate(
        s.E, s.z, s.u, s.B, s.rates, s.model, s.Psi, Psi_rates=s.Psi_rates, disturbance=s.w
    )
    return _is_zero([rate.total - direct])


def _symmetric(letters: np.ndarray, size: int) -> np.ndarray:
    matrix = np.empty((size, size), dtype=object)
    lower = np.tril_indices(size)
    matrix[lower] = letters
    matrix.T[lower] = letters
    return matrix


def _is_zero(x: Any) -> bool:
    return all(entry == 0 for entry in np.ravel(x))
