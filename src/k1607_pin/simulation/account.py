"""The energy account over one physics step: the work of torques that change on the way, to the integrator's order."""

from collections.abc import Callable
from typing import Any

import numpy as np

from k1607_pin.simulation.integrators import State, runge_kutta_4

Torque = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""q, v (n,) -> (n,) N m."""
Work = Callable[[Torque, State, State, float], float]
"""A torque, the state before and after a step, the step [s] -> J."""


def trapezoid(torque: Torque, start: State, end: State, dt: float) -> float:
    """Second order: the mean of the torque at both ends, times the way."""
    return float((torque(*start) + torque(*end)) / 2 @ (end[0] - start[0]))


def simpson(torque: Torque, start: State, end: State, dt: float) -> float:
    """Fourth order: Simpson's rule of the power, halfway on the cubic (Hermite's) through both states."""
    (q_0, v_0), (q_1, v_1) = start, end
    halfway = (q_0 + q_1) / 2 + dt / 8 * (v_0 - v_1), 1.5 / dt * (q_1 - q_0) - (v_0 + v_1) / 4
    return float(dt / 6 * (torque(*start) @ v_0 + 4 * (torque(*halfway) @ halfway[1]) + torque(*end) @ v_1))


def work_rule(step: Any) -> Work:
    """The rule that is as good as the integrator: of `runge_kutta_4` Simpson's, of any other the trapezoid's."""
    return simpson if step is runge_kutta_4 else trapezoid
