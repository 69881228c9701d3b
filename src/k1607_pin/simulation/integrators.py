"""One step of q'' = acceleration(q, q'), over which the joint torques are held."""

from collections.abc import Callable

import numpy as np

State = tuple[np.ndarray, np.ndarray]
Acceleration = Callable[[np.ndarray, np.ndarray], np.ndarray]


def semi_implicit_euler(acceleration: Acceleration, q: np.ndarray, v: np.ndarray, dt: float) -> State:
    """First order: the velocity first, then the position with the new velocity. What most engines do; energy drifts little."""
    v = v + dt * acceleration(q, v)
    return q + dt * v, v


def runge_kutta_4(acceleration: Acceleration, q: np.ndarray, v: np.ndarray, dt: float) -> State:
    """Fourth order, four evaluations."""
    k_1 = acceleration(q, v)
    v_2 = v + dt / 2 * k_1
    k_2 = acceleration(q + dt / 2 * v, v_2)
    v_3 = v + dt / 2 * k_2
    k_3 = acceleration(q + dt / 2 * v_2, v_3)
    v_4 = v + dt * k_3
    k_4 = acceleration(q + dt * v_3, v_4)
    return q + dt / 6 * (v + 2 * v_2 + 2 * v_3 + v_4), v + dt / 6 * (k_1 + 2 * k_2 + 2 * k_3 + k_4)
