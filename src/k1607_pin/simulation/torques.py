"""What motors, friction and stops of a plant do: formulas, for numbers that were looked at and for symbols.

`Plant`'s methods are their checked doors. In: q, v, tau (n,) rad, rad/s, N m; out: (n,) N m.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from k1607_pin.simulation.plant import Plant

REST = 1e-3  # rad/s (m/s): speed over which Coulomb friction turns round, so that it has a value at rest


def motor(plant: "Plant", tau: Any) -> Any:
    """Within the motors' limits."""
    return np.clip(tau, -plant.torque_limit, plant.torque_limit)


def loss(plant: "Plant", q: Any, v: Any) -> Any:
    """Against the motion, turning energy into heat: friction, Coulomb's part smoothed over `REST`, and the stops' damping."""
    friction = plant.viscous * v + plant.coulomb * np.tanh(v / REST)
    return friction + _stop_loss(plant, beyond(plant, q), v) if plant._has_stops else friction


def spring(plant: "Plant", q: Any) -> Any:
    """Of the stops, towards the range."""
    return -plant.stop_stiffness * beyond(plant, q)


def passive(plant: "Plant", q: Any, v: Any) -> Any:
    """What friction and stops add to the motors' torque."""
    torque = -loss(plant, q, v)
    return torque + spring(plant, q) if plant._has_stops else torque


def acceleration(plant: "Plant", q: Any, v: Any, tau: Any, external: Any = 0.0) -> Any:
    """(n,) rad/s^2 when the motors are asked for tau and the world adds ``external``."""
    return plant.arm.forward_dynamics(q, v, motor(plant, tau) + passive(plant, q, v) + external)


def beyond(plant: "Plant", q: Any) -> Any:
    """(n,) rad by which each joint is past its range, with its sign; 0 within."""
    return np.maximum(q - plant._upper, 0.0) - np.maximum(plant._lower - q, 0.0)


def _stop_loss(plant: "Plant", past: Any, v: Any) -> Any:
    """The stop's push less its elastic part; a stop pushes and never pulls."""
    elastic = plant.stop_stiffness * past
    push = elastic + plant.stop_damping * np.abs(np.sign(past)) * v
    return np.where(push * past > 0, push, 0.0) - elastic
