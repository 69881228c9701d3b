"""Equations (56)-(65): the Lyapunov function, its derivative, and what the report sets to zero in it."""

from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import quad_vec
from scipy.linalg import expm

from k1607_pin import data
from k1607_pin.control import adaptation, error_system, reference_model
from k1607_pin.control.error_system import ErrorSystem, Weights
from k1607_pin.report import polynomials_error_system
from k1607_pin.report.equations import Equation
from k1607_pin.report.sample import gap
from k1607_pin.report.sample_loops import (
    LINEAR,
    LOOPS,
    ROUNDING,
    adapted_rates,
    claimed,
    driven_by,
    general,
    law_weights,
    loops,
    lyapunov_slope,
    rates_under,
    slope,
    system,
    upsilon,
    z_dot,
)
from k1607_pin.report.sample_motion import DURATION, arm_matrices, motion


@cache
def _anything() -> tuple[ErrorSystem, Weights, Weights]:
    """Rates of B_1 to B_4, weights and rates of the weights, (LOOPS, 6, 6) each, of no origin: (57) holds for any."""
    rates, roots, turns = np.random.default_rng(57).normal(size=(3, 4, LOOPS, 6, 6))
    return (
        ErrorSystem(*rates),
        Weights(*(A @ A.swapaxes(-1, -2) + np.eye(6) for A in roots)),
        Weights(*(A + A.swapaxes(-1, -2) for A in turns)),
    )


def _outer(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(LOOPS, 6, 6) a b^T"""
    return a[:, :, None] * b[:, None, :]


def _v_by_kronecker() -> float:
    """(56) as quadratic forms: tr[X^T Psi X] = vec(X)^T (I x Psi) vec(X)."""
    s, model, (_, Psi, _) = loops(), general(), _anything()
    B = system()
    shifted = (B.B_1 + model.Delta[6:, :6], B.B_2 + model.Delta[6:, 6:], B.B_3, B.B_4)
    v = np.array([sum(model.P[i, j] * E[i] * E[j] for i in range(12) for j in range(12)) for E in s.z_m - s.z])
    for X, psi in zip(shifted, Psi, strict=True):
        v += [x.ravel("F") @ np.kron(np.eye(6), p) @ x.ravel("F") for x, p in zip(X, psi, strict=True)]
    return gap(error_system.lyapunov_function(s.z_m - s.z, B, model, Psi).total, v)


def _slope_of_v(Psi_moves: bool, z_m: np.ndarray) -> np.ndarray:
    """v' of (56), by a complex step along (48), (39)-(41) and given rates of everything else."""
    s, model, (rates, Psi, Psi_rates) = loops(), general(), _anything()
    E_dot = z_m @ model.Delta.T - z_dot(s.z, s.u, s.Lambda, s.Phi, s.Gamma, s.gains)

    def v(step: complex) -> Any:
        B = ErrorSystem(*(X + step * X_dot for X, X_dot in zip(system(), rates, strict=True)))
        psi = Weights(*(X + Psi_moves * step * X_dot for X, X_dot in zip(Psi, Psi_rates, strict=True)))
        return error_system.lyapunov_function(z_m - s.z + step * E_dot, B, model, psi).total

    return slope(v)


def _v_dot() -> float:
    s, (rates, Psi, Psi_rates) = loops(), _anything()
    ours = error_system.lyapunov_rate(s.z_m - s.z, s.z, s.u, system(), rates, general(), Psi, Psi_rates=Psi_rates)
    return gap(ours.total, _slope_of_v(Psi_moves=True, z_m=s.z_m))


def _v_dot_as_printed() -> float:
    """(57) as it stands, read kindly: z_m = 0, constant weights, Upsilon of P E, x_d' where the x is lost."""
    s, model, (rates, Psi, _) = loops(), general(), _anything()
    B, y, (x_e, v_e), (x_d, v_d, _) = system(), upsilon(general()), np.split(s.z, 2, -1), np.split(s.u, 3, -1)
    terms = [
        (B.B_1 + model.Delta[6:, :6], _outer(y, x_e) + Psi.Psi_1 @ rates.B_1),
        (B.B_2 + model.Delta[6:, 6:], _outer(y, v_e) + Psi.Psi_2 @ rates.B_2),
        (-B.B_3, _outer(y, x_d) - Psi.Psi_3 @ rates.B_3),
        (-B.B_4, _outer(y, v_d) - Psi.Psi_4 @ rates.B_4),
    ]
    printed = np.einsum("ki,ij,kj->k", s.z, model.P @ model.Delta + model.Delta.T @ model.P, s.z)
    printed += sum(2 * np.einsum("kij,kij->k", X, Y) for X, Y in terms)
    return gap(printed, _slope_of_v(Psi_moves=False, z_m=0 * s.z_m))


def _upsilon(as_printed: bool) -> float:
    """(58) against the lower half of P E, E = -z, summed entry by entry; the printed first half is [P_2 P_3] z."""
    model, worst = general(), 0.0
    for z in loops().z:
        lower = [sum(model.P[i, j] * -z[j] for j in range(12)) for i in range(6, 12)]
        printed = np.hstack([model.P_2.T, model.P_3]) @ z
        ours = adaptation.upsilon(model.P_2, model.P_3, z[:6], z[6:])
        worst = max(worst, gap(printed if as_printed else ours, lower))
    return worst


def _by_linear_equations() -> tuple[reference_model.ReferenceModel, np.ndarray]:
    """A model of six different systems with a full Q, and its P from (60) as 144 linear equations."""
    g = general()
    model = reference_model.reference_model(-g.Delta[6:, :6], -g.Delta[6:, 6:], g.Q)
    equations = np.kron(g.Delta.T, np.eye(12)) + np.kron(np.eye(12), g.Delta.T)
    return model, np.linalg.solve(equations, -g.Q.ravel()).reshape(12, 12)


def _blocks(as_printed: bool) -> float:
    model, P = _by_linear_equations()
    lower_left = model.P_2 if as_printed else model.P_2.T
    return gap(np.block([[P[:6, :6], model.P_2], [lower_left, model.P_3]]), P)


def _lyapunov_equation() -> float:
    """(60): against the integral of e^(Delta^T t) Q e^(Delta t), the linear equations, and section 7.2's P_2 = P_3 = 0.25 I."""
    facts = data.load("published")["design"]
    model = reference_model.reference_model(
        facts["delta_1"] * np.ones(6), facts["delta_2"] * np.ones(6), facts["Q"] * np.eye(12)
    )
    integral, _ = quad_vec(lambda t: expm(model.Delta.T * t) @ model.Q @ expm(model.Delta * t), 0, 20, epsabs=1e-13)
    other, P = _by_linear_equations()
    published = [facts["P2"] * np.eye(6), facts["P3"] * np.eye(6)]
    return max(gap(model.P, integral), gap(other.P, P), gap([model.P_2, model.P_3], published))


def _gains_cancel() -> float:
    """(61), left sides, under the law."""
    Psi, rates, y = law_weights(), rates_under(adapted_rates(general())), upsilon(general())
    x_e, v_e = np.split(loops().z, 2, -1)
    return max(gap(_outer(y, x_e) + Psi.Psi_1 @ rates.B_1, 0), gap(_outer(y, v_e) + Psi.Psi_2 @ rates.B_2, 0))


def _demand_met() -> float:
    """(62), if B_3 and B_4 could be made to move as it asks, against what it is to cancel: (E^T P E)' by their entries."""
    s, Psi, model = loops(), _anything()[1], general()
    rates = error_system.demanded_rates(upsilon(model), s.z, s.u, Psi)
    return max(
        gap(2 * Psi.Psi_3 @ rates.B_3, -driven_by("B_3", model)),
        gap(2 * Psi.Psi_4 @ rates.B_4, -driven_by("B_4", model)),
    )


def _out_of_reach() -> float:
    """(62) on the moving arm: the share of B_4' that no Psi_4 whatever makes equal to what it asks for, median of the motion.

    It asks for Psi_4^-1 Upsilon x_d'^T, rows along x_d'; what B_4' has across is out of every Psi_4's reach.
    """
    m, ((Lambda, Phi, Gamma), (Lambda_dot, Phi_dot, Gamma_dot)) = motion(), arm_matrices()
    B = error_system.error_system(Lambda, Phi, Gamma, *m.gains)
    B_4_dot = error_system.error_system_rates(Lambda, B, Lambda_dot, Phi_dot, Gamma_dot, m.gain_rates).B_4
    along = m.wanted[:, :6] / np.linalg.norm(m.wanted[:, :6], axis=1, keepdims=True)
    across = B_4_dot - (B_4_dot @ along[:, :, None]) * along[:, None, :]
    return float(np.median(np.linalg.norm(across, axis=(1, 2)) / np.linalg.norm(B_4_dot, axis=(1, 2))))


def _slope_under_law(u: np.ndarray) -> np.ndarray:
    return lyapunov_slope(general(), loops().gains, adapted_rates(general()), law_weights(), u)


def _v_dot_under_law() -> float:
    """(63) with what it lacks, and, without input, as it stands."""
    s, model, B, Psi, rates = loops(), general(), system(), law_weights(), rates_under(adapted_rates(general()))
    ours = error_system.lyapunov_rate(-s.z, s.z, s.u, B, rates, model, Psi)
    free = error_system.lyapunov_rate(-s.z, s.z, 0 * s.u, B, rates, model, Psi)
    return max(gap(ours.claimed + ours.driven, _slope_under_law(s.u)), gap(free.claimed, _slope_under_law(0 * s.u)))


def _as_demanded(u: np.ndarray) -> float:
    """(64), (65): v' with B_1 to B_4 moving as asked, by a complex step, against -E^T Q E."""
    s, model, Psi = loops(), general(), _anything()[1]
    rates = error_system.demanded_rates(upsilon(model), s.z, u, Psi)
    rate = z_dot(s.z, u, s.Lambda, s.Phi, s.Gamma, s.gains)

    def v(step: complex) -> Any:
        B = ErrorSystem(*(X + step * X_dot for X, X_dot in zip(system(), rates, strict=True)))
        return error_system.lyapunov_function(-s.z - step * rate, B, model, Psi).total

    return gap(slope(v), claimed(model))


def _position_and_velocity() -> np.ndarray:
    """(LOOPS, 18) u without x_d'', which no B multiplies."""
    return loops().u * np.repeat([1, 1, 0], 6)


EQUATIONS: list[Equation] = [
    Equation(
        56,
        "The Lyapunov function: squares of the adaptation error and of the distances from the model.",
        "control.error_system.lyapunov_function",
        f"{LINEAR}, quadratic forms with Kronecker products",
        _v_by_kronecker,
        ROUNDING,
        definition=True,
        note="The Psi_i must be symmetric too.",
        gap="It does not vanish at the goal: B_3 and B_4 belong to the arm, and nothing takes them to zero.",
    ),
    Equation(
        57,
        "The Lyapunov function's time derivative.",
        "control.error_system.lyapunov_rate",
        f"{LINEAR}, derivative of (56) along (48) and (39)-(41) by complex steps",
        _v_dot,
        ROUNDING,
        printed=_v_dot_as_printed,
        proof=polynomials_error_system.lyapunov_rate_is_exact,
        note="Lost in the last term: x_d'. The proof is of the whole derivative, any Delta_1, Delta_2, rates and symmetric P.",
        gap="The term of (55) with x_d'' is dropped, -2 Upsilon^T x_d'', and so are those of the rates of the Psi_i.",
    ),
    Equation(
        58,
        "Upsilon is the lower half of P E.",
        "control.adaptation.upsilon",
        f"{LINEAR}, P E summed entry by entry",
        lambda: _upsilon(as_printed=False),
        ROUNDING,
        printed=lambda: _upsilon(as_printed=True),
        note="Printed [P_2 P_3] z = -P_2 x_e - P_3 x_e': the signs differ. Should be [P_2^T P_3] E, with E = -z; the right side "
        "is right for a symmetric P_2. Some Upsilons are transcribed Y.",
    ),
    Equation(
        59,
        "The blocks of P.",
        "control.reference_model.reference_model",
        "(60) as 144 linear equations, a full Q",
        lambda: _blocks(as_printed=False),
        ROUNDING,
        definition=True,
        printed=lambda: _blocks(as_printed=True),
        note="Lower left block: printed P_2, should be P_2^T, in (58) and (76)-(77) too. No difference for section 7.2's 0.25 I.",
    ),
    Equation(
        60,
        "The Lyapunov equation, which gives P for any Q.",
        "control.reference_model.reference_model",
        "integral of e^(Delta^T t) Q e^(Delta t); 144 linear equations; the published 0.25 I",
        _lyapunov_equation,
        1e-11,
        note="Section 7.2 calls it (22), and writes I_7 and I_14 for I_6 and I_12.",
    ),
    Equation(
        61,
        "What the gains are to cancel.",
        "control.adaptation.gain_rates",
        f"{LINEAR}, rates of (45) under the law by complex steps",
        _gains_cancel,
        ROUNDING,
        note="Met by the mended law (74)-(75), as far as (66)-(67) hold.",
    ),
    Equation(
        62,
        "What is to cancel the terms of the wanted motion.",
        "control.error_system.demanded_rates",
        f"{LINEAR}, rates as it demands, derivative of (E^T P E)' by the entries of B_3 and B_4, complex steps",
        _demand_met,
        ROUNDING,
        printed=_out_of_reach,
        note="Printed residual, a ratio: the share of the arm's own B_4' that no Psi_4 whatever makes fit, median over the "
        f"K-1607's first {DURATION} s on its line.",
        gap="No gain enters B_3 = Lambda^-1 Gamma and B_4 = Lambda^-1 Phi: nothing moves them as it demands.",
    ),
    Equation(
        63,
        "The Lyapunov function falls by E^T Q E.",
        "control.error_system.lyapunov_rate",
        f"{LINEAR} under the law, derivative of (56) by complex steps",
        _v_dot_under_law,
        ROUNDING,
        printed=lambda: gap(claimed(general()), _slope_under_law(loops().u)),
        note="True for constant Lambda, Phi, Gamma and u = 0. Even then v' is only semidefinite, as v depends on the gains too: "
        "that E goes to zero takes Barbalat's lemma, and the gains need not settle at the model's.",
        gap="With a wanted motion or gravity, -2 Upsilon^T (B_3 x_d + B_4 x_d' + x_d'') remains: of either sign, linear in E "
        "where E^T Q E is quadratic, so that it wins near the goal.",
    ),
    Equation(
        64,
        "The rates of B_1 and B_2 that follow from (61).",
        "control.error_system.demanded_rates",
        f"{LINEAR} without input, derivative of (56) by complex steps equals -E^T Q E",
        lambda: _as_demanded(0 * loops().u),
        ROUNDING,
    ),
    Equation(
        65,
        "The rates of B_3 and B_4 that follow from (62).",
        "control.error_system.demanded_rates",
        f"{LINEAR} with x_d and x_d', derivative of (56) by complex steps equals -E^T Q E",
        lambda: _as_demanded(_position_and_velocity()),
        ROUNDING,
        note="It follows; but nothing makes B_3 and B_4 obey, see (62).",
    ),
]
