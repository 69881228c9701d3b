"""Equations (78)-(83): the two test paths."""

from fractions import Fraction
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import expm

from k1607_pin import data
from k1607_pin.compiled.trace import trace
from k1607_pin.description.units import INCH
from k1607_pin.paths import report_paths
from k1607_pin.report.equations import Equation
from k1607_pin.report.sample import gap

TIMES = np.linspace(0.05, 9.95, 100)  # s
ROUNDING = 1e-13  # metres and radians up to 7, a few dozen roundings
HEIGHT = 0.5  # m


def _line() -> report_paths.Line:
    case = data.load("published")["case1"]
    return report_paths.Line(np.array([case["x0_in"], case["y0_in"], 0.0]) * INCH)


def _lags(t: float) -> float:
    """Share of the way at time t: the step response of two lags in series, of 3/3.5 s and 4/3.5 s, from rest."""
    a, b = 3.5 / 3, 3.5 / 4
    return float((expm(np.array([[0, 1, 0], [-a * b, -a - b, a * b], [0, 0, 0]]) * t) @ [0, 0, 1])[0])


def _along(axis: int) -> float:
    """(78), (79): against the lags; the published end points; at rest at the start; rates by automatic differentiation."""
    case, line = data.load("published")["case1"], _line()
    first, last = (np.array([case[f"x{k}_in"], case[f"y{k}_in"]])[axis] * INCH for k in ("0", "f"))
    shares = np.array([_lags(t) for t in TIMES])
    ends = [line(0.0).position[axis], line(60.0).position[axis], line(0.0).velocity[axis]]
    return max(
        gap(line(TIMES).position[:, axis], first + (last - first) * shares),
        gap(ends, [first, last, 0]),
        _differentiated(line),
    )


def _differentiated(path: Any) -> float:
    """The path's velocity and acceleration against CasADi's derivatives of its position."""
    traced, t = trace(lambda s: tuple(path(s[0])), "path", [(1,)]), ca.SX.sym("t")
    position, velocity, acceleration = traced(t)
    gaps = ca.vertcat(ca.jacobian(position, t) - velocity, ca.jacobian(velocity, t) - acceleration)
    worst = ca.Function("worst", [t], [ca.norm_inf(gaps)])
    return max(float(worst(s)) for s in TIMES)


@cache
def _meeting_times() -> tuple[Fraction, Fraction, Fraction]:
    """t1, t2, t3 [s]: where angle and rate of (81)-(83) meet, one turn from start to end.

    Rates: beta t1 = omega = beta (t3 - t2), beta = omega. Angles in turns, omega = 1/9 a second: t1^2/18 + (t2 - t1)/9 =
    1 - (t3 - t2)^2/18.
    """
    t_1 = Fraction(1)
    t_2 = t_1 + 9 * (1 - Fraction(1, 18) - t_1**2 / 18)
    return t_1, t_2, t_2 + 1


def _angle(t: np.ndarray) -> np.ndarray:
    """The angle turned at times t: the integral of a speed that rises, stays and falls between the meeting times."""
    knots = np.array([0, *map(float, _meeting_times())])
    fine = np.union1d(knots, t)  # with the knots among its points the trapezoidal rule is exact
    speed = np.interp(fine, knots, 2 * np.pi / 9 * np.array([0, 1, 1, 0]))
    return cumulative_trapezoid(speed, fine, initial=0)[np.searchsorted(fine, t)]


def _on_circle() -> float:
    circle, angle = report_paths.Circle(HEIGHT), _angle(TIMES)
    radius = data.load("published")["case2"]["radius_in"] * INCH
    xy = circle(TIMES).position[:, :2]
    return max(gap(xy, radius * np.column_stack([np.cos(angle), np.sin(angle)])), _differentiated(circle))


def _segment(number: int) -> float:
    """(81)-(83): the angle on one segment, its ends included, against the integral of the speed; and when it ends."""
    circle = report_paths.Circle(HEIGHT)
    begins, ends = (0.0, *map(float, _meeting_times()))[number - 1 : number + 1]
    t = np.linspace(begins, ends, 50)
    x, y = circle(t).position[:, :2].T
    turned = np.angle((x + 1j * y) * np.exp(-1j * _angle(t)))
    return max(gap(turned, 0), gap(circle.times[number - 1], ends))


def _back_to_the_start() -> float:
    """(83) as printed, phi_0 and no turn: the points that (80) makes of it."""
    circle = report_paths.Circle(HEIGHT)
    _, t_2, t_3 = map(float, _meeting_times())
    t = np.linspace(t_2, t_3, 50)
    phi = circle.phi_0 - circle.beta / 2 * (t_3 - t) ** 2
    return gap(circle(t).position[:, :2], circle.radius * np.column_stack([np.cos(phi), np.sin(phi)]))


EQUATIONS: list[Equation] = [
    Equation(
        78,
        "The line along x: exponentially from rest.",
        "paths.report_paths.Line",
        "step response of two lags in series by matrix exponential; published end points; automatic differentiation",
        lambda: _along(0),
        ROUNDING,
        note="It starts with a jump of acceleration, and approaches its end without reaching it.",
    ),
    Equation(
        79,
        "The line along y: twice as far.",
        "paths.report_paths.Line",
        "step response of two lags in series by matrix exponential; published end points; automatic differentiation",
        lambda: _along(1),
        ROUNDING,
    ),
    Equation(
        80,
        "The circle, in three segments.",
        "paths.report_paths.Circle",
        "integral of the speed; automatic differentiation",
        _on_circle,
        ROUNDING,
        note="t1, t2, t3 are not published: that angle and rate are continuous makes them 1, 9 and 10 s.",
    ),
    Equation(
        81,
        "First segment: up to speed.",
        "paths.report_paths.Circle",
        "integral of the speed",
        lambda: _segment(1),
        ROUNDING,
        note="The text gives phi_0 = 0 in inches: 0 rad. Its beta is an angular acceleration, not an adaptation rate.",
    ),
    Equation(
        82,
        "Second segment: at speed.",
        "paths.report_paths.Circle",
        "integral of the speed",
        lambda: _segment(2),
        ROUNDING,
    ),
    Equation(
        83,
        "Third segment: down to rest where it started.",
        "paths.report_paths.Circle",
        "integral of the speed",
        lambda: _segment(3),
        ROUNDING,
        printed=_back_to_the_start,
        note="As an angle it falls back by 2 pi at t2, a whole turn: the points are the same, and exactly one turn is made.",
    ),
]
