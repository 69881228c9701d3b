"""What the controllers of the adaptive schemes have in common beside their laws."""

from collections.abc import Callable
from typing import Any

import numpy as np

from k1607_pin.arguments import as_floats, shown
from k1607_pin.arm.arm import Arm
from k1607_pin.control.adaptation import Gains, check_adaptation, checked_gains
from k1607_pin.control.posture import Posture, posture_torque
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import ReferenceModel


def checked_scheme(gains: Gains, model: ReferenceModel, beta_1: float, beta_2: float, period: float, m: int) -> Gains:
    """K(0) as floats, when everything fits errors of m entries; else a `ValueError` that says what does not."""
    gains = checked_gains(gains, m)
    if not isinstance(model, ReferenceModel):
        raise ValueError(f"model: expected a ReferenceModel of {m} systems, got {shown(model)}")
    if model.P_2.shape != (m, m):
        raise ValueError(f"model: expected one of {m} systems, got {len(model.P_2)}")
    check_adaptation(beta_1, beta_2, period)
    return gains


def other_torque(
    arm: Arm, t: float, q: np.ndarray, v: np.ndarray, J: np.ndarray, practice: Practice, posture: Posture | None
) -> np.ndarray:
    """(n,) N m beside the law's: gravity's and the posture's, as far as they are asked for.

    t : s; q : (n,) rad; v : (n,) rad/s; J : (6, n).
    """
    torque = arm.gravity_torque(q) if practice.gravity else np.zeros(arm.n)
    if posture is None:
        return torque
    return torque + posture_torque(arm.mass_matrix(q), J, q, v, *posture.path(t), *posture[1:])


def postures_of(arm: Arm, q: Any) -> np.ndarray:
    """(N, n) rad from (n,) or (N, n), N > 0; else a `ValueError`."""
    expected = f"({arm.n},) or (N, {arm.n}) finite numbers in rad"
    postures = np.atleast_2d(as_floats("q", q, expected))
    if postures.ndim != 2 or postures.shape[1] != arm.n or not len(postures) or not np.isfinite(postures).all():
        raise ValueError(f"q: expected {expected}, got {shown(q) if np.size(q) <= arm.n else f'shape {np.shape(q)}'}")
    return postures


def named(name: str, check: Callable[..., Any], *arguments: Any) -> Any:
    """What ``check`` gives; its complaint, which names a field of one loop, is put under the other's name."""
    try:
        return check(*arguments)
    except ValueError as error:
        raise ValueError(f"{name}{error}") from None
