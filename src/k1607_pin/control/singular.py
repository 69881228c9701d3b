"""Postures in which a force at the tool has no bound: where they are refused, and what to type instead."""

from typing import Any

import numpy as np

from k1607_pin.arm.arm import SQUARED_RANK_TOLERANCE, Arm
from k1607_pin.dynamics.linear import inverse_definite, solve_definite
from k1607_pin.dynamics.operational_space import singular_values
from k1607_pin.kinematics.differential import SingularJacobianError
from k1607_pin.kinematics.task import POSE, Task

DAMPED = "start elsewhere, or give the law damping=Damping(...), with which the tool lags near a singular posture"


def cartesian_inertia(arm: Arm, q: np.ndarray, task: Task = POSE) -> np.ndarray:
    """(m, m) Lambda in q (n,) of a task of m rows, for gains in proportion to it.

    Raises
    ------
    SingularJacobianError
        There is none, and what to take instead.
    """
    J = task.rows(arm.jacobian(q), arm.forward_kinematics(q).rotation)  # (m, n)
    require_regular(J, OTHERS if arm.n >= task.size else few(arm.n))
    if task == POSE:
        return arm.operational_space(q, np.zeros(arm.n)).Lambda
    return inverse_definite(J @ solve_definite(arm.mass_matrix(q), J.T))


OTHERS = "take other postures for gains, such as k1607_pin.arm.ready.ready_postures(arm), far from singular ones"


def few(n: int) -> str:
    """What n joints can do that do not move a tool in as many directions as were asked for."""
    tasks = [f"task={name!r}" for name, rows in (("axis", 5), ("position", 3)) if n >= rows]
    without = "JointAdaptive with gains_from_mass(arm, q, omega), which controls the joints"
    return f"{n} joint{'s' * (n > 1)} cannot move a tool in so many directions: take {' or '.join([*tasks, without])}"


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
