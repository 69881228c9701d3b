"""Postures in which a force at the tool has no bound: where they are refused, and what to type instead."""

from typing import Any

import numpy as np

from k1607_pin.arm.arm import SQUARED_RANK_TOLERANCE, Arm
from k1607_pin.dynamics.operational_space import singular_values
from k1607_pin.kinematics.differential import SingularJacobianError

DAMPED = "start elsewhere, or give the law damping=Damping(...), with which the tool lags near a singular posture"


def cartesian_inertia(arm: Arm, q: np.ndarray) -> np.ndarray:
    """(6, 6) Lambda at rest in q (n,), for gains in proportion to it.

    Raises
    ------
    SingularJacobianError
        There is none, and what to take instead.
    """
    try:
        return arm.operational_space(q, np.zeros(arm.n)).Lambda
    except SingularJacobianError as error:
        raise SingularJacobianError(error.sigma_min, error.threshold, OTHERS if arm.n >= 6 else FEW) from None


OTHERS = "take other postures for gains, such as k1607_pin.arm.ready.ready_postures(arm), far from singular ones"
FEW = "fewer than six joints do not move a tool in six directions; JointAdaptive with gains_from_mass(arm, q, omega) does without"


def require_regular(J: np.ndarray, remedy: str = DAMPED) -> None:
    """Refuse, by `SingularJacobianError`, a J (m, n) without full row rank, as `Arm.operational_space` does."""
    sigma = singular_values(J)
    sigma_min, needed = float(sigma[-1]) if J.shape[1] >= J.shape[0] else 0.0, SQUARED_RANK_TOLERANCE * float(sigma[0])
    if not sigma_min > needed:
        raise SingularJacobianError(sigma_min, needed, remedy)


def force_for(mobility: Any, acceleration: Any, J: Any) -> Any:
    """(m,) mobility^-1 acceleration: the force at the tool that accelerates it so.

    On floats a force that only a singular mobility can ask for is refused: one larger than acceleration / (tolerance trace),
    as the smallest eigenvalue is then below tolerance times the trace. That costs less than to look at the eigenvalue.

    Parameters
    ----------
    mobility : (m, m) J M^-1 J^T; acceleration : (m,) m/s^2, rad/s^2; J : (m, n), for the message.

    Raises
    ------
    SingularJacobianError
        The force has no bound.
    """
    if type(mobility) is not np.ndarray:
        return np.linalg.solve(mobility, acceleration)
    try:
        force = np.linalg.solve(mobility, acceleration)
    except np.linalg.LinAlgError:
        force = np.full_like(acceleration, np.inf)
    least = SQUARED_RANK_TOLERANCE**2 * np.trace(mobility)
    if np.vdot(acceleration, acceleration) < least * least * np.vdot(force, force):
        sigma = singular_values(J)
        raise SingularJacobianError(float(sigma[-1]), SQUARED_RANK_TOLERANCE * float(sigma[0]), DAMPED)
    return force
