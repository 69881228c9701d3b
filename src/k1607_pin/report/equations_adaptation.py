"""Equations (66)-(77): slow motion, and the adaptation law."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import quad_vec

from k1607_pin.control import adaptation, error_system
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.error_system import Weights
from k1607_pin.report.equations import Equation
from k1607_pin.report.sample import gap
from k1607_pin.report.sample_loops import (
    BETA,
    LINEAR,
    ROUNDING,
    adapted_rates,
    claimed,
    driven_by,
    general,
    law_weights,
    loops,
    lyapunov_slope,
    rates_under,
    upsilon,
)
from k1607_pin.report.sample_motion import ARM_BETA, DURATION, arm_matrices, motion

HUGE = 1e15  # of Psi_3 and Psi_4 in (71)
PERIOD = 1e-3  # s, of (76)-(77)
SLOPE = Gains(700.0, 1200.0)  # of the integrands of (76) and (77), by how much it changes in 1 s at the most


def _held(*names: str) -> float:
    """(66)-(68) where nothing but the gains moves."""
    gain_rates = adapted_rates(general())
    ours, moved = error_system.held_rates(loops().Lambda, gain_rates), rates_under(gain_rates)
    return max(gap(getattr(ours, name), getattr(moved, name)) for name in names)


def _neglected(*names: str) -> float:
    """(66)-(68) on the moving arm: the rates that they neglect over those that they keep, the median of the motion.

    B_3 and B_4, of which they keep nothing, are held against B_1 and B_2.
    """
    m, ((Lambda, Phi, Gamma), (Lambda_dot, Phi_dot, Gamma_dot)) = motion(), arm_matrices()
    B = error_system.error_system(Lambda, Phi, Gamma, *m.gains)
    exact = error_system.error_system_rates(Lambda, B, Lambda_dot, Phi_dot, Gamma_dot, m.gain_rates)
    ours = error_system.held_rates(Lambda, m.gain_rates)
    norm = {name: np.linalg.norm(getattr(exact, name) - getattr(ours, name), axis=(-2, -1)) for name in names}
    kept = {"B_1": ours.B_1, "B_2": ours.B_2, "B_3": ours.B_1, "B_4": ours.B_2}
    return max(float(np.median(norm[name] / np.linalg.norm(kept[name], axis=(-2, -1)))) for name in names)


def _cancels(name: str) -> float:
    """(69)-(70): Psi B' by the law against what it must make up for, the derivative of (E^T P E)' by every entry of B."""
    gain_rates = adapted_rates(general())
    weight, K_dot = {"B_1": (law_weights().Psi_1, gain_rates.K_p), "B_2": (law_weights().Psi_2, gain_rates.K_d)}[name]
    return gap(2 * weight @ np.linalg.solve(loops().Lambda, K_dot), -driven_by(name, general()))


def _vanishing() -> float:
    """(71): what (65) asks of B_3 and B_4 falls as 1/Psi, from Psi_3 = Psi_4 = I to HUGE I, and so vanishes in the limit.

    Psi times the demand is held against what it must make up for, which knows no Psi.
    """
    s, model = loops(), general()
    needed = {name: -driven_by(name, model) / 2 for name in ("B_3", "B_4")}
    worst = 0.0
    for Psi in np.geomspace(1, HUGE, 6):
        rates = error_system.demanded_rates(upsilon(model), s.z, s.u, law_weights(Psi))
        worst = max(worst, *(gap(Psi * getattr(rates, name), wanted) for name, wanted in needed.items()))
    return worst


def _left_over(Psi: float) -> float:
    """What v' has beyond -E^T Q E in the loops under the law, with x_d and x_d' and Psi_3 = Psi_4 = Psi I."""
    s, model = loops(), general()
    u = s.u * np.repeat([1, 1, 0], 6)
    return gap(lyapunov_slope(model, s.gains, adapted_rates(model), law_weights(Psi), u), claimed(model))


def _one_gain(which: str) -> Gains:
    """Gains with the other one at the model's, so that v' has the terms of this one alone."""
    s, Delta = loops(), general().Delta
    K_p, K_d = -s.Lambda @ Delta[6:, :6] - s.Gamma, -s.Lambda @ Delta[6:, 6:] - s.Phi
    return Gains(s.gains.K_p, K_d) if which == "K_p" else Gains(K_p, s.gains.K_d)


def _falls(which: str, law: float = 1.0, weight: float = 1.0) -> float:
    """v' against -E^T Q E, without input, with the given signs of the law and of Psi_1, Psi_2."""
    s, model, Psi = loops(), general(), law_weights()
    rates = Gains(*(law * K_dot for K_dot in adapted_rates(model)))
    signed = Weights(weight * Psi.Psi_1, weight * Psi.Psi_2, Psi.Psi_3, Psi.Psi_4)
    return gap(lyapunov_slope(model, _one_gain(which), rates, signed, 0 * s.u), claimed(model))


def _error(t: float) -> tuple[np.ndarray, np.ndarray]:
    """A swinging error and its rate."""
    k = np.arange(1, 7)
    return np.cos(k * t), -k * np.sin(k * t)


def _summed(period: float) -> Gains:
    """Gains after 1 s, sample by sample."""
    model, gains = general(), Gains(np.eye(6), np.eye(6))
    for k in range(round(1 / period)):
        rates = adaptation.gain_rates(model.P_2, model.P_3, *BETA, *_error(k * period))
        gains = adaptation.adapted(gains, rates, period)
    return gains


def _integrals(as_printed: bool) -> Gains:
    """(76)-(77) after 1 s by quadrature: printed with P_2, where P_2^T is meant."""
    P_2, P_3 = general().P_2 if as_printed else general().P_2.T, general().P_3

    def integral(beta: float, of: Callable[[float], np.ndarray]) -> np.ndarray:
        def integrand(t: float) -> np.ndarray:
            x_e, v_e = _error(t)
            return np.outer(P_2 @ x_e + P_3 @ v_e, of(t))

        return np.eye(6) + beta * quad_vec(integrand, 0, 1, epsabs=1e-12)[0]

    return Gains(integral(BETA[0], lambda t: _error(t)[0]), integral(BETA[1], lambda t: _error(t)[1]))


def _integrated(which: str, as_printed: bool = False) -> float:
    """Sums over samples extrapolated to period zero, 2 K(T/2) - K(T), against the integral.

    What is left is T^2/24 times the change of the integrand's slope, below SLOPE for these errors and this P.
    """
    fine, coarse = getattr(_summed(PERIOD / 2), which), getattr(_summed(PERIOD), which)
    return gap(2 * fine - coarse, getattr(_integrals(as_printed), which))


SLOW = (
    "Slow against a sampling period is not slow against the gains: the arm's own share in the rate can exceed theirs."
)
ON_THE_ARM = (
    "Exact where the arm's matrices stand still. Printed residual, a ratio: what is neglected over what is kept, median over the "
    f"K-1607's first {DURATION} s on its line with beta = {ARM_BETA:g}."
)
SAMPLED = (
    "The proof is in continuous time, but gains and torque are held for a period. And nothing bounds the gains: under a "
    "constant load they grow for ever."
)

EQUATIONS: list[Equation] = [
    Equation(
        66,
        "In slow motion B_1 moves as K_p does.",
        "control.error_system.held_rates",
        f"{LINEAR}, rates of (45) by complex steps",
        lambda: _held("B_1"),
        ROUNDING,
        printed=lambda: _neglected("B_1"),
        note=ON_THE_ARM,
        gap=SLOW,
    ),
    Equation(
        67,
        "In slow motion B_2 moves as K_d does.",
        "control.error_system.held_rates",
        f"{LINEAR}, rates of (45) by complex steps",
        lambda: _held("B_2"),
        ROUNDING,
        printed=lambda: _neglected("B_2"),
        note="As (66).",
        gap=SLOW,
    ),
    Equation(
        68,
        "In slow motion B_3 and B_4 stand still.",
        "control.error_system.held_rates",
        f"{LINEAR}, rates of (46) by complex steps",
        lambda: _held("B_3", "B_4"),
        ROUNDING,
        printed=lambda: _neglected("B_3", "B_4"),
        note=ON_THE_ARM
        + " Kept is the gains' share of B_1', B_2'. A payload's step, as in section 7.2, is slow by no measure.",
        gap="It contradicts (65), which has B_3 and B_4 move so that (62) holds.",
    ),
    Equation(
        69,
        "What K_p has to do.",
        "control.adaptation.gain_rates",
        f"{LINEAR}, derivative of (E^T P E)' by the entries of B_1, complex steps",
        lambda: _cancels("B_1"),
        ROUNDING,
        note="With the positive Psi_1 of (72), mended.",
    ),
    Equation(
        70,
        "What K_d has to do.",
        "control.adaptation.gain_rates",
        f"{LINEAR}, derivative of (E^T P E)' by the entries of B_2, complex steps",
        lambda: _cancels("B_2"),
        ROUNDING,
        note="With the positive Psi_2 of (73), mended.",
    ),
    Equation(
        71,
        "Large Psi_3 and Psi_4 reconcile (65) with (68).",
        "control.error_system.demanded_rates",
        f"{LINEAR}, Psi times the demand, Psi_3 = Psi_4 = I to {HUGE:g} I, derivative of (E^T P E)' by the entries of B_3, B_4",
        _vanishing,
        ROUNDING,
        printed=lambda: _left_over(HUGE),
        note="Printed residual: what v' has beyond -E^T Q E with Psi_3, Psi_4 as large.",
        gap="What vanishes is the demand, not the term: -2 Upsilon^T (B_3 x_d + B_4 x_d') is the same for any Psi.",
    ),
    Equation(
        72,
        "Psi_1 is a multiple of the Cartesian mass.",
        "control.error_system.weights",
        f"{LINEAR}, v' by complex steps equals -E^T Q E under the law for K_p",
        lambda: _falls("K_p"),
        ROUNDING,
        printed=lambda: _falls("K_p", weight=-1.0),
        note="Printed -Lambda / beta_1, negative definite, though called positive definite below: should be +Lambda / beta_1. "
        "With the printed signs of (72) and (74) together v' comes out right, but of a v that is indefinite: it proves nothing.",
    ),
    Equation(
        73,
        "Psi_2 is a multiple of the Cartesian mass.",
        "control.error_system.weights",
        f"{LINEAR}, v' by complex steps equals -E^T Q E under the law for K_d",
        lambda: _falls("K_d"),
        ROUNDING,
        printed=lambda: _falls("K_d", weight=-1.0),
        note="Printed -Lambda / beta_2: as (72).",
    ),
    Equation(
        74,
        "The rate of K_p.",
        "control.adaptation.gain_rates",
        f"{LINEAR}, v' by complex steps equals -E^T Q E",
        lambda: _falls("K_p"),
        ROUNDING,
        printed=lambda: _falls("K_p", law=-1.0),
        note="Printed +beta_1 Upsilon x_e^T, should be -beta_1 Upsilon x_e^T = +beta_1 (P_2 x_e + P_3 x_e') x_e^T, as in (76). "
        "As printed, errors would weaken the gains.",
    ),
    Equation(
        75,
        "The rate of K_d.",
        "control.adaptation.gain_rates",
        f"{LINEAR}, v' by complex steps equals -E^T Q E",
        lambda: _falls("K_d"),
        ROUNDING,
        printed=lambda: _falls("K_d", law=-1.0),
        note="Printed +beta_2 Upsilon x_e'^T, should be -beta_2 Upsilon x_e'^T, as in (77).",
    ),
    Equation(
        76,
        "K_p is its initial value and an integral over errors.",
        "control.adaptation.adapted",
        f"quadrature; samples {PERIOD:g} s apart extrapolated to zero, agree to second order",
        lambda: _integrated("K_p"),
        SLOPE.K_p * PERIOD**2 / 24,
        printed=lambda: _integrated("K_p", as_printed=True),
        slip=True,
        note="Printed P_2, should be P_2^T, as in (58)-(59); no difference for section 7.2's 0.25 I. The sign is right: it is "
        "that of the mended (72) and (74). Section 7.2 calls it (35).",
        gap=SAMPLED,
    ),
    Equation(
        77,
        "K_d is its initial value and an integral over errors and rates.",
        "control.adaptation.adapted",
        f"quadrature; samples {PERIOD:g} s apart extrapolated to zero, agree to second order",
        lambda: _integrated("K_d"),
        SLOPE.K_d * PERIOD**2 / 24,
        printed=lambda: _integrated("K_d", as_printed=True),
        slip=True,
        note="As (76). Section 7.2 calls it (36).",
        gap=SAMPLED,
    ),
]
