"""The tool's pose against the one that a path wants: held, or turning along with the path's points."""

import logging
from collections.abc import Callable
from typing import Any

import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.inverse import RIGID
from k1607_pin.arm.reach import follow, rotation_of
from k1607_pin.kinematics.orientation import orientation_error

logger = logging.getLogger(__name__)

PosePath = Callable[[float], Any]
"""Time [s] -> wanted .position, .velocity, .acceleration (3,) of the tool's origin, and, where the tool is to turn, .rotation
(3, 3) tool in base, .angular_velocity and .angular_acceleration (3,); base axes, SI. Accelerations where a law asks for them."""

ERRORS: dict[str, tuple[tuple[str, ...], str]] = {
    "error": (("direction",), "m, rad"),
    "error_rate": (("direction",), "m/s, rad/s"),
    "wanted_position": (("axis",), "m"),
    "wanted_velocity": (("axis",), "m/s"),
    "wanted_acceleration": (("axis",), "m/s^2"),
    "wanted_angular_velocity": (("axis",), "rad/s"),
    "wanted_angular_acceleration": (("axis",), "rad/s^2"),
}
"""What `errors` gives: dimensions and units."""


def pose_error(position: Any, rotation: Any, wanted_position: Any, wanted_rotation: Any) -> Any:
    """(6,) x_e of (41): wanted less actual position [m], and 2 delta s of R_d R^T [rad]."""
    return np.concatenate([wanted_position - position, orientation_error(wanted_rotation, rotation)])


def wanted_velocity(point: Any) -> Any:
    """(6,) m/s, rad/s of a point of a `PosePath`; one without a rotation does not turn."""
    return np.concatenate([point.velocity, _turning(point, "angular_velocity")])


def wanted_acceleration(point: Any) -> Any:
    """(6,) m/s^2, rad/s^2, likewise."""
    return np.concatenate([point.acceleration, _turning(point, "angular_acceleration")])


def _turning(point: Any, name: str) -> Any:
    return np.zeros(3) if rotation_of(point, None) is None else getattr(point, name)


def errors(error: Any, error_rate: Any, wanted: Any) -> dict[str, Any]:
    """What the laws of the tool log: errors (6,), and what the path's point wanted."""
    return {
        "error": error,
        "error_rate": error_rate,
        "wanted_position": wanted.position,
        "wanted_velocity": wanted.velocity,
        "wanted_acceleration": wanted.acceleration,
        "wanted_angular_velocity": _turning(wanted, "angular_velocity"),
        "wanted_angular_acceleration": _turning(wanted, "angular_acceleration"),
    }


def checked_rotation(name: str, rotation: Any) -> np.ndarray:
    """(3, 3) float; refused by `ValueError` if it is no rotation matrix."""
    R = np.array(rotation, dtype=float)
    if R.shape != (3, 3) or not np.abs(R @ R.T - np.eye(3)).max() < RIGID or np.linalg.det(R) < 0:
        raise ValueError(f"{name}: expected a (3, 3) rotation matrix, got\n{rotation!r}")
    return R


def check_path(path: PosePath, held: Any, duration: float, needed: tuple[str, ...]) -> None:
    """Refuse a path whose points at 0 and ``duration`` [s] are not what a law needs.

    Parameters
    ----------
    held : (3, 3) orientation for a path without; None for one with its own.
    needed : of position, velocity, acceleration; of the angular ones as much, if the points have a rotation.

    Raises
    ------
    ValueError
        It says which, and when.
    """
    for t in (0.0, duration):
        point = path(t)
        if (R := rotation_of(point, held)) is None:
            raise ValueError(
                f"rotation: expected (3, 3), as the path's point at t = {t:g} s has none of its own, got None"
            )
        checked_rotation(f"path({t:g}).rotation", R)
        turns = rotation_of(point, None) is not None
        for name in (*needed, *(f"angular_{name}" for name in needed if turns and name != "position")):
            x = np.asarray(getattr(point, name, None), dtype=float)
            if x.shape != (3,) or not np.isfinite(x).all():
                raise ValueError(f"path: expected a finite (3,) {name} at t = {t:g} s, got {x!r}")


def check_reach(arm: Arm, path: PosePath, held: Any, q: np.ndarray, duration: float) -> None:
    """Refuse a path that the arm has no posture for, by `UnreachableError`; tell in the log if it can follow only out of limits.

    q : (n,) rad, where it starts; the rest as for `check_path`.
    """
    if jumps := follow(arm, path, held, q, duration).jumps:
        logger.warning("%s follows this path only out of its joint limits, from t = %.3g s on", arm.name, jumps[0])
