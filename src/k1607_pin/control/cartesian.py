"""The Cartesian adaptive scheme, figure 13: PD on the tool's pose error with adapted gains, through J^T to the joints."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arguments import number
from k1607_pin.arm.arm import Arm
from k1607_pin.arm.reach import rotation_of
from k1607_pin.control.adaptation import Gains, gain_rates, proportional_derivative
from k1607_pin.control.finite import entering, finite_only
from k1607_pin.control.pose import (
    ERRORS,
    PosePath,
    Variables,
    check_path,
    check_reach,
    checked_rotation,
    errors,
    logged_of,
    wanted_velocity,
)
from k1607_pin.control.posture import Posture, check_posture
from k1607_pin.control.practice import OFF, AdaptiveState, Practice, check_practice, filtered, limited, next_gains
from k1607_pin.control.reference_model import ReferenceModel
from k1607_pin.control.scheme import checked_scheme, other_torque, postures_of
from k1607_pin.control.singular import cartesian_inertia
from k1607_pin.kinematics.task import POSE, Task, task_of


class Step(NamedTuple):
    """One control period's outcome."""

    torque: Any
    """(n,) N m, held until the next period"""
    gains: Gains
    """Gains for the next period"""
    error: Any
    """(m,) x_e: position [m] and orientation [rad], base axes; of a `Task` its rows"""
    error_rate: Any
    """(m,) m/s, rad/s"""
    share: Any
    """Of the torque asked for that the limit lets through, at most 1"""


def cartesian_adaptive(
    position: Any,
    rotation: Any,
    J: Any,
    v: Any,
    wanted_position: Any,
    wanted_rotation: Any,
    wanted_velocity: Any,
    gains: Gains,
    P_2: Any,
    P_3: Any,
    beta_1: Any,
    beta_2: Any,
    period: Any,
    start: Gains | None = None,
    other_torque: Any = 0.0,
    practice: Practice = OFF,
    task: Task = POSE,
) -> Step:
    """One step of the scheme: torque from the present gains, then the gains adapted, (40)-(41) and (76)-(77).

    Parameters
    ----------
    position (3,) m, rotation (3, 3) : the tool's pose; J (6, n) : its Jacobian; v (n,) rad/s.
    wanted_position (3,) m, wanted_rotation (3, 3), wanted_velocity (6,) m/s and rad/s : base axes.
    gains : `Gains` of m by m; P_2, P_3 (m, m) : see `reference_model`; beta_1, beta_2 : adaptation rates.
    period : s.
    start : K(0), for a practice that refers to it; None for the present gains.
    other_torque : (n,) N m, added to the law's before the limit: gravity's, a posture's.
    practice : options beyond the report.
    task : what part of the pose it acts on, with m rows: all six, unless told otherwise.
    """
    error = task.error(wanted_position, wanted_rotation, position, rotation)
    error_rate = task.rows(wanted_velocity - J @ v, rotation)
    force = proportional_derivative(gains, error, error_rate)
    rates = gain_rates(P_2, P_3, beta_1, beta_2, error, error_rate)
    torque, share = limited(task.rows(J, rotation).T @ force + other_torque, practice)
    after = next_gains(start or gains, gains, rates, error, share, period, practice)
    return Step(torque, after, error, error_rate, share)


@dataclass(frozen=True)
class CartesianAdaptive:
    """The scheme as a controller for `simulate`: follows a path of the tool, which turns where the path does.

    The report publishes neither the initial gains nor beta_1 and beta_2.

    Raises
    ------
    ValueError
        Wrong shapes, numbers that are not finite, a rotation that is none, negative beta, a period that is not positive.
    """

    arm: Arm
    """Without a posture to keep to, its kinematics alone are used: the law knows no masses."""
    path: PosePath
    """Its accelerations are logged, not used."""
    rotation: Any
    """(3, 3) wanted orientation, tool in base, held by a path whose points have no rotation: theirs counts. None if they do."""
    gains: Gains
    """K_p(0), K_d(0), (m, m) each, m = 6 for a whole pose"""
    model: ReferenceModel
    """of m systems; gives P_2 and P_3"""
    beta_1: float
    beta_2: float
    period: float
    """s, the control period"""
    posture: Posture | None = None
    """What the null space is to keep to; None leaves it to itself, as the report does. Uses the arm's mass matrix."""
    practice: Practice = OFF
    """What the report's law lacks"""
    task: Any = POSE
    """`Task` or its name: what part of the path's poses counts, "pose" (m = 6), "position" (3) or "axis" (5). For arms of fewer
    joints, or to leave the rest to the posture."""

    @property
    def variables(self) -> Variables:
        """What it logs: dimensions and units."""
        return logged_of(self.task, LOGGED)

    def __post_init__(self) -> None:
        object.__setattr__(self, "task", task_of(self.task))
        m = self.task.size
        if self.rotation is not None:
            object.__setattr__(self, "rotation", checked_rotation("rotation", self.rotation))
        gains = checked_scheme(self.gains, self.model, self.beta_1, self.beta_2, self.period, m)
        object.__setattr__(self, "gains", gains)
        check_posture(self.posture, self.arm.n)
        check_practice("practice", self.practice, self.arm.n, m, gains)

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> AdaptiveState:
        """The initial gains, when there is a posture for every point of the path up to ``duration`` [s].

        That the arm can only follow by leaving its joint limits is told in the log.

        Raises
        ------
        ValueError
            The path's points at the start or the end are not what `PosePath` says, or no orientation is given at all.
        UnreachableError
            The arm has no posture within its limits for a point of the path; looked at some four times a second.
        """
        q, v = entering(self.arm.n, 0.0, q, v, None)
        check_path(self.path, self.rotation, duration, ("position", "velocity", "acceleration"), self.task)
        if self.task == POSE:
            check_reach(self.arm, self.path, self.rotation, q, duration)
        return self.initial(q, v)

    def initial(self, q: Any, v: Any) -> AdaptiveState:
        """The initial gains, whatever the path; q : (n,) rad; v : (n,) rad/s."""
        return AdaptiveState(self.gains, v)

    @finite_only
    def update(
        self, t: float, q: np.ndarray, v: np.ndarray, state: AdaptiveState
    ) -> tuple[np.ndarray, AdaptiveState, dict[str, Any]]:
        """Torque (n,), the next state, and the log: errors, what was wanted, and the gains at work."""
        tool, J, wanted = self.arm.forward_kinematics(q), self.arm.jacobian(q), self.path(t)
        v = filtered(state.velocity, v, self.period, self.practice)
        task = self.task
        other = other_torque(self.arm, t, q, v, task.rows(J, tool.rotation), self.practice, self.posture)
        step = cartesian_adaptive(
            tool.translation,
            tool.rotation,
            J,
            v,
            wanted.position,
            rotation_of(wanted, self.rotation),
            wanted_velocity(wanted),
            state.gains,
            self.model.P_2,
            self.model.P_3,
            self.beta_1,
            self.beta_2,
            self.period,
            self.gains,
            other,
            self.practice,
            task,
        )
        log = {
            **errors(step.error, step.error_rate, wanted),
            "K_p": state.gains.K_p,
            "K_d": state.gains.K_d,
            "torque_share": step.share,
        }
        return step.torque, AdaptiveState(step.gains, v), log


LOGGED = ERRORS | {
    "K_p": (("row", "column"), "N/m, N/rad; N, N m/rad"),
    "K_d": (("row", "column"), "N s/m, N s/rad; N s, N m s/rad"),
    "torque_share": ((), ""),
}
"""What `CartesianAdaptive` logs: dimensions and units."""


def gains_from_inertia(arm: Arm, q: np.ndarray, omega: float, damping: float = 1.0, task: Task | str = POSE) -> Gains:
    """K_p = omega^2 Lambda(q), K_d = 2 damping omega Lambda(q): initial gains that answer alike in all directions of a task.

    Parameters
    ----------
    q : (n,) rad, or (N, n) postures along the path, for which Lambda is the harmonic mean: a direction that is light in one of
        them, where the loop is fastest, counts most.
    task : what part of a pose the gains are for, m rows: "pose", "position", "axis" or a `Task`; gives (m, m) gains.
    omega : 1/s; stable with torques held for a period T only while omega T stays below 1 where damping is 1.

    Raises
    ------
    ValueError
        q of another shape, omega that is not positive, a negative damping, no such task.
    SingularJacobianError
        A posture that is singular for the task, or fewer joints than its rows; it says what to take instead.
    """
    task = task_of(task)
    omega, damping = number("omega", omega, 0, unit="1/s"), number("damping", damping, at_least=0)
    mobility = [np.linalg.inv(cartesian_inertia(arm, one, task)) for one in postures_of(arm, q)]
    Lambda = np.linalg.inv(np.mean(mobility, axis=0))
    return Gains(omega**2 * Lambda, 2 * damping * omega * Lambda)
