"""Equations (48)-(55): the reference model, and the error system relative to it."""

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from k1607_pin.control import error_system, pose, reference_model
from k1607_pin.report import polynomials_error_system
from k1607_pin.report.equations import Equation
from k1607_pin.report.sample import gap
from k1607_pin.report.sample_loops import LINEAR, ROUNDING, general, loops, system, z_dot

OMEGA = np.array([0.5, 1.0, 2.0, 3.0, 5.0, 8.0])  # 1/s
XI = np.array([0.1, 0.5, 0.9, 1.5, 2.0, 1.2])  # three systems that swing, three that creep
TIMES = (0.1, 0.5, 2.0)  # s
SMALL = 1e-3  # rad, m
WEIGHTS = ((1, 45), (2, -9), (3, 1))  # of the differences over one, two, three steps either way
DIFFERENCES = 1e-10  # roundings of 1e-15, over steps of 1e-3
MODEL = "the scalar solutions, swinging and creeping"


def _model() -> reference_model.ReferenceModel:
    return reference_model.reference_model(OMEGA**2, 2 * XI * OMEGA)


def _start() -> np.ndarray:
    return np.random.default_rng(48).normal(size=12)


def _scalar(t: float) -> np.ndarray:
    """(12,) solutions of (48), from the roots of the characteristic polynomial, one system after the other."""
    z = _start()
    roots = np.array([np.roots([1, 2 * xi * omega, omega**2]) for xi, omega in zip(XI, OMEGA, strict=True)])
    r, s = roots[:, 0], roots[:, 1]
    a = (z[6:] - s * z[:6]) / (r - s)
    b = z[:6] - a
    return np.concatenate([a * np.exp(r * t) + b * np.exp(s * t), a * r * np.exp(r * t) + b * s * np.exp(s * t)]).real


def _uncoupled() -> float:
    return max(gap(_model().response(_start(), t), _scalar(t)) for t in TIMES)


def _rate(model: reference_model.ReferenceModel, t: float) -> np.ndarray:
    """(12,) derivative of the response at t, by central differences of sixth order: h^6/140 of its seventh, 1e-12 here."""
    h = 1e-3  # s
    sums = [
        weight * (model.response(_start(), t + k * h) - model.response(_start(), t - k * h)) for k, weight in WEIGHTS
    ]
    return np.sum(sums, axis=0) / (60 * h)


def _rate_of_response() -> float:
    """(50), (52): the response's derivative by differences, against its components in (48), written out."""
    model, worst = _model(), 0.0
    for t in TIMES:
        z = model.response(_start(), t)
        worst = max(worst, gap(_rate(model, t), _rates(z)))
    return worst


def _halves() -> float:
    """(51): the lower half of the response is the rate of the upper."""
    model = _model()
    return max(gap(model.response(_start(), t)[6:], _rate(model, t)[:6]) for t in TIMES)


def _model_of_the_error() -> float:
    """(52) as printed: x_m is the tracking error of (49), so that z should follow (50). It follows (44)."""
    s = loops()
    return gap(z_dot(s.z, s.u, s.Lambda, s.Phi, s.Gamma, s.gains), s.z @ general().Delta.T)


def _rates(z: np.ndarray) -> np.ndarray:
    """(12,) z_m' by (48), written out."""
    return np.concatenate([z[6:], -(OMEGA**2) * z[:6] - 2 * XI * OMEGA * z[6:]])


def _integrated() -> float:
    path = solve_ivp(lambda _, z: _rates(z), (0, TIMES[-1]), _start(), "DOP853", TIMES, rtol=1e-12, atol=1e-13)
    return max(gap(_model().response(_start(), t), z) for t, z in zip(TIMES, path.y.T, strict=True))


def _standing_still() -> float:
    """(53) as printed: no t on the right side. Whatever constant matrix is read, it is at least this far from (48) somewhere."""
    solutions = np.array([_scalar(t) for t in TIMES])
    return float(np.ptp(solutions, axis=0).max() / 2)


def _one_too_many() -> float:
    """(48) as printed has seven systems; how many x_e has no element for, as the law computes it."""
    return abs(7 - pose.pose_error(np.zeros(3), np.eye(3), np.ones(3), np.eye(3)).size)


def _elements() -> float:
    """(49): six elements, one for each direction that the tool is displaced in, along the base's axes and about them."""
    rng = np.random.default_rng(49)
    R, p = pin.exp3(rng.uniform(-1, 1, 3)), rng.normal(size=3)
    moved = [(p + step[:3], pin.exp3(step[3:]) @ R) for step in SMALL * np.eye(6)]
    return gap([pose.pose_error(p, R, *wanted) for wanted in moved], SMALL * np.eye(6))


def _rate_of_difference() -> float:
    """(54)-(55): z_m' - z', the one from (48), the other from (39)-(41)."""
    s, model = loops(), general()
    z_m_dot = np.concatenate([s.z_m[:, 6:], s.z_m @ model.Delta[6:].T], -1)
    direct = z_m_dot - z_dot(s.z, s.u, s.Lambda, s.Phi, s.Gamma, s.gains)
    return gap(error_system.error_rate(s.z_m - s.z, s.z, s.u, system(), model.Delta), direct)


EQUATIONS: list[Equation] = [
    Equation(
        48,
        "The reference model: uncoupled second-order systems of given natural frequency and damping.",
        "control.reference_model.reference_model",
        MODEL,
        _uncoupled,
        1e-12,
        printed=_one_too_many,
        note="Printed for i = 1 to 7; x_e has six elements, and the text below counts six systems. Printed residual: 7 less the "
        "elements of x_e. "
        "A remnant of the joint-space scheme, like section 7.2's I_7, I_14 and its references to (11), (22), (35) and (36).",
    ),
    Equation(
        49,
        "x_e has the elements x_e1 to x_e6.",
        "control.pose.pose_error",
        f"displacements of {SMALL} along and about each axis; agrees to third order",
        _elements,
        SMALL**3 / 24 * 1.01,
        definition=True,
        note="The text before it counts to 7.",
    ),
    Equation(
        50,
        "The reference model as a state equation.",
        "control.reference_model.reference_model",
        "derivative of the response by differences of sixth order, against (48)",
        _rate_of_response,
        DIFFERENCES,
        note="Delta_1 = diag(omega_i^2), Delta_2 = diag(2 xi_i omega_i).",
    ),
    Equation(
        51,
        "The model's state z_m is x_m and its rate.",
        "control.reference_model.reference_model",
        "derivative of the response by differences of sixth order",
        _halves,
        DIFFERENCES,
        definition=True,
    ),
    Equation(
        52,
        "x_m has six elements.",
        "control.reference_model.reference_model",
        "derivative of the response by differences of sixth order, against (48)",
        _rate_of_response,
        DIFFERENCES,
        definition=True,
        printed=_model_of_the_error,
        note="Printed x_e1 to x_e6, the elements of x_e by (49): E would be 0, and the error obey (50). Should be x_m1 to x_m6.",
    ),
    Equation(
        53,
        "The model's response: the matrix exponential times its initial state.",
        "control.reference_model.reference_model",
        "numerical integration of (48) to 1e-12",
        _integrated,
        1e-10,
        printed=_standing_still,
        note="Printed e^(Delta_t), a subscript: should be e^(Delta t). Printed residual: how far a response that does not depend "
        f"on t is from the solution at {TIMES[0]:g} to {TIMES[-1]:g} s, at the best.",
    ),
    Equation(
        54,
        "The adaptation error is E = z_m - z.",
        "control.error_system.error_rate",
        f"{LINEAR}, z_m' of (48) less z' of (39)-(41)",
        _rate_of_difference,
        ROUNDING,
        definition=True,
    ),
    Equation(
        55,
        "The error system.",
        "control.error_system.error_rate",
        f"{LINEAR}, z_m' of (48) less z' of (39)-(41)",
        _rate_of_difference,
        ROUNDING,
        proof=polynomials_error_system.error_rate_is_exact,
        note="Follows from (50) and (44) with its I_6.",
    ),
]
