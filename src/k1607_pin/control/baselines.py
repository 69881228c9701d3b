"""Laws from the textbooks to compare the adaptive schemes with; all but the first need the arm's masses.

Each is a controller for `simulate`. ``omega`` [1/s] means the same in all of them: where the model is right, every error dies out
as (D + omega)^2 e = 0, critically damped. With torques held for a period T that is stable while omega T < 1.
"""

import threading
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from k1607_pin.arguments import number, numbers, shown
from k1607_pin.arm.arm import Arm
from k1607_pin.arm.reach import rotation_of
from k1607_pin.control import pose
from k1607_pin.control.adaptation import Gains, checked_gains, proportional_derivative
from k1607_pin.control.finite import entering, finite_only
from k1607_pin.control.joint_space import ERRORS, JointPath, check_path, errors
from k1607_pin.control.posture import Posture, check_posture, posture_torque
from k1607_pin.control.singular import DAMPED, few, force_for, require_regular
from k1607_pin.dynamics.linear import smallest_eigenvalue
from k1607_pin.kinematics.differential import Damping
from k1607_pin.kinematics.task import POSE, task_of

Log = dict[str, Any]
NEEDED = ("position", "velocity", "acceleration")


@dataclass(frozen=True)
class GravityPD:
    """tau = K_p e + K_d e' + g(q): PD with gravity compensation (Takegaki and Arimoto, 1981).

    Raises
    ------
    ValueError
        Gains that are not finite (n, n); when it starts, a path whose points are no joint angles and velocities.
    """

    arm: Arm
    path: JointPath
    gains: Gains
    """(n, n) N m/rad, N m s/rad; see `gains_from_mass`"""

    variables: ClassVar = ERRORS

    def __post_init__(self) -> None:
        object.__setattr__(self, "gains", checked_gains(self.gains, self.arm.n))

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> None:
        """No state."""
        q, v = entering(self.arm.n, 0.0, q, v, None)
        check_path(self.arm, self.path, duration)

    @finite_only
    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: None) -> tuple[np.ndarray, None, Log]:
        """Torque (n,) N m, and the errors."""
        wanted = self.path(t)
        force = proportional_derivative(self.gains, wanted.position - q, wanted.velocity - v)
        return force + self.arm.gravity_torque(q), None, errors(self.arm, q, v, wanted)


@dataclass(frozen=True)
class ComputedTorque:
    """tau = M(q)(q_d'' + 2 omega e' + omega^2 e) + C(q, q') q' + g(q): linear and decoupled where the model is right.

    Raises
    ------
    ValueError
        omega not positive; when it starts, a path whose points lack angles, velocities or accelerations (n,).
    """

    arm: Arm
    path: JointPath
    omega: float
    """1/s"""

    variables: ClassVar = ERRORS

    def __post_init__(self) -> None:
        number("omega", self.omega, 0, unit="1/s")

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> None:
        """No state."""
        q, v = entering(self.arm.n, 0.0, q, v, None)
        check_path(self.arm, self.path, duration, NEEDED)

    @finite_only
    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: None) -> tuple[np.ndarray, None, Log]:
        """Torque (n,) N m, and the errors."""
        wanted, omega = self.path(t), self.omega
        error, error_rate = wanted.position - q, wanted.velocity - v
        wish = wanted.acceleration + 2 * omega * error_rate + omega**2 * error  # (n,) rad/s^2
        return self.arm.inverse_dynamics(q, v, wish), None, errors(self.arm, q, v, wanted)


@dataclass(frozen=True)
class OperationalSpaceControl:
    """tau = J^T Lambda (x_d'' + 2 omega x_e' + omega^2 x_e - J_dot q') + C q' + g, and a posture in the null space.

    Khatib, IEEE J. Robotics and Automation 3(1), 1987. C q' + g is cancelled in joint space, which cancels it at the tool and in
    the null space alike. Lambda has no bound at a singular posture: there the law stops, or, with ``damping``, lets the tool lag.

    Raises
    ------
    ValueError
        omega not positive, a rotation that is none; when it starts, a path whose points lack what `PosePath` says.
    SingularJacobianError
        When it starts in a singular posture, or comes to one that blows its force up, without damping. A compiled rollout, which
        cannot raise, gives that torque.
    """

    arm: Arm
    path: pose.PosePath
    rotation: Any
    """(3, 3) wanted orientation, tool in base, held by a path whose points have no rotation: theirs counts. None if they do."""
    omega: float
    """1/s"""
    posture: Posture | None = None
    """What the null space is to keep to; None leaves it to itself"""
    damping: Damping | None = None
    """Of Lambda near singular postures, by the smallest singular value of J, as in `Arm.operational_space`; None for none"""

    task: Any = POSE
    """`Task` or its name: what part of the path's poses counts, "pose", "position" or "axis"; Lambda is of its rows. That the
    tool's spin about an axis turns its rows is left out."""

    @property
    def variables(self) -> pose.Variables:
        """What it logs: dimensions and units."""
        return pose.logged_of(self.task, pose.ERRORS)

    def __post_init__(self) -> None:
        object.__setattr__(self, "task", task_of(self.task))
        number("omega", self.omega, 0, unit="1/s")
        if self.damping is not None and not isinstance(self.damping, Damping):
            raise ValueError(f"damping: expected a Damping or None, got {shown(self.damping)}")
        check_posture(self.posture, self.arm.n)
        if self.rotation is not None:
            object.__setattr__(self, "rotation", pose.checked_rotation("rotation", self.rotation))

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> None:
        """No state; refuses a singular posture."""
        q, v = entering(self.arm.n, 0.0, q, v, None)
        task = self.task
        pose.check_path(self.path, self.rotation, duration, NEEDED, task)
        if self.damping is None:
            J, R = self.arm.jacobian(q), self.arm.forward_kinematics(q).rotation
            require_regular(task.rows(J, R), few(self.arm.n) if self.arm.n < task.size else DAMPED)

    def initial(self, q: Any, v: Any) -> None:
        """No state, whatever the posture."""

    @finite_only
    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: None) -> tuple[np.ndarray, None, Log]:
        """Torque (n,) N m, and the errors."""
        arm, task, wanted = self.arm, self.task, self.path(t)
        tool, M = arm.forward_kinematics(q), arm.mass_matrix(q)
        here, R = tool.rotation, rotation_of(wanted, self.rotation)
        J = task.rows(arm.jacobian(q), here)  # (m, n)
        error = task.error(wanted.position, R, tool.translation, here)
        error_rate = task.rows(pose.wanted_velocity(wanted), here) - J @ v
        wish = task.rows(pose.wanted_acceleration(wanted), here) + 2 * self.omega * error_rate + self.omega**2 * error
        mobility = J @ np.linalg.solve(M, J.T)  # (m, m) Lambda^-1
        if self.damping:
            JJT = J @ J.T
            share = self.damping.squared(smallest_eigenvalue(JJT)) / np.trace(JJT)
            mobility = mobility + share * np.trace(mobility) * np.eye(task.size)
        force = force_for(mobility, wish - task.rows(arm.jacobian_time_variation(q, v) @ v, here), J)
        torque = J.T @ force + arm.bias_torque(q, v)
        if self.posture:
            torque = torque + posture_torque(M, J, q, v, *self.posture.path(t), *self.posture[1:])
        return torque, None, pose.errors(error, error_rate, wanted)


@dataclass(frozen=True)
class SlotineLi:
    """tau = Y(q, q', v_r, v_r') theta + K_D s, theta' = Gamma Y^T s: adapts the ten inertial parameters of each link.

    With e = q_d - q: v_r = q_d' + omega e, s = v_r - q', and V = (s^T M s + d^T Gamma^-1 d)/2 falls as V' = -s^T K_D s, d being
    the parameters' error. Slotine and Li, Int. J. Robotics Research 6(3), 1987. Rotor inertia is taken as known.

    Raises
    ------
    ValueError
        Wrong shapes, omega or period not positive, negative rates.
    """

    arm: Arm
    """Gives the first estimate, `parameters`"""
    path: JointPath
    K_D: np.ndarray
    """(n, n) N m s/rad; omega M for the others' double pole"""
    omega: float
    """1/s"""
    rates: np.ndarray
    """(10 n,) Gamma's diagonal; see `parameter_rates`"""
    period: float
    """s, the control period"""

    variables: ClassVar = ERRORS | {"parameters": (("parameter",), "kg, kg m, kg m^2"), "s": (("joint",), "rad/s")}

    def __post_init__(self) -> None:
        n = self.arm.n
        number("omega", self.omega, 0, unit="1/s")
        number("period", self.period, 0, unit="s")
        object.__setattr__(self, "K_D", numbers("K_D", self.K_D, (n, n), "N m s/rad").copy())
        object.__setattr__(self, "rates", numbers("rates", self.rates, (10 * n,)).copy())
        if (self.rates < 0).any():
            raise ValueError(f"rates: expected ({10 * n},) numbers >= 0, got one of {self.rates.min():g}")
        object.__setattr__(self, "_regressor", Regressor(self.arm))

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> np.ndarray:
        """(10 n,) the arm's parameters."""
        q, v = entering(self.arm.n, 0.0, q, v, None)
        check_path(self.arm, self.path, duration, NEEDED)
        return parameters(self.arm)

    @finite_only
    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray, Log]:
        """Torque (n,) N m, the next estimate, and the errors."""
        wanted = self.path(t)
        error, error_rate = wanted.position - q, wanted.velocity - v
        reference = wanted.velocity + self.omega * error  # (n,) rad/s
        reference_rate = wanted.acceleration + self.omega * error_rate
        s = reference - v
        Y = self._regressor(q, v, reference, reference_rate)  # type: ignore[attr-defined]
        torque = Y @ state + self.arm.armature * reference_rate + self.K_D @ s
        after = state + self.period * self.rates * (Y.T @ s)
        return torque, after, {**errors(self.arm, q, v, wanted), "parameters": state, "s": s}


class Regressor(threading.local):
    """Y (n, 10 n) of M(q) a + C(q, v) w + g(q) = Y(q, v, w, a) theta, without rotor inertia.

    Pinocchio's regressor is that of the inverse dynamics, quadratic in one velocity. C of Christoffel's symbols is bilinear and
    symmetric, so that C(q, v) w = (c(v + w) - c(v - w))/4 with c(v) = C(q, v) v; and for it M_dot - 2 C is skew. It is the C
    that Pinocchio gives for serial arms.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm, self._model = arm, arm.model
        self._data = self._model.createData()

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.arm,)

    def __call__(self, q: np.ndarray, v: np.ndarray, w: np.ndarray, a: np.ndarray) -> np.ndarray:
        """q (n,) rad; v, w (n,) rad/s; a (n,) rad/s^2."""
        still = np.zeros_like(q)
        plus, minus = self._of(q, v + w, still), self._of(q, v - w, still)
        return self._of(q, still, a) + (plus - minus) / 4

    def _of(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        return pin.computeJointTorqueRegressor(self._model, self._data, q, v, a).copy()


def parameters(arm: Arm) -> np.ndarray:
    """(10 n,) of each link in its joint's frame: m [kg], m c [kg m], and I_xx, I_xy, I_yy, I_xz, I_yz, I_zz about the origin."""
    inertias = arm.model.inertias
    return np.concatenate([inertias[i].toDynamicParameters() for i in range(1, arm.n + 1)])


def parameter_rates(arm: Arm, q: np.ndarray, K_D: np.ndarray, rate: float, length: float = 0.1) -> np.ndarray:
    """(10 n,) Gamma's diagonal that makes what gravity shows at q known within 1/rate [s], and all parameters alike in size.

    With K_D s = Y d, d' = -Gamma Y^T K_D^-1 Y d; the largest eigenvalue of K_D^-1 Y Gamma Y^T under 9.81 m/s^2 is made ``rate``,
    in any gravity.

    Parameters
    ----------
    q : (n,) rad; K_D : (n, n) N m s/rad; rate : 1/s.
    length : m, within which a mass is looked for: m weighs as 1, m c as length, I as length^2.

    Raises
    ------
    ValueError
        Wrong shapes, a singular K_D, rate or length not positive, or an arm of whose parameters gravity shows none at q.
    """
    q, K_D = numbers("q", q, (arm.n,), "rad"), numbers("K_D", K_D, (arm.n, arm.n), "N m s/rad")
    rate, length = number("rate", rate, 0, unit="1/s"), number("length", length, 0, unit="m")
    if not np.linalg.cond(K_D) < 1 / np.finfo(float).eps:
        raise ValueError("K_D: expected an invertible matrix, got a singular one")
    model = arm.model
    model.gravity = pin.Motion(np.array([0.0, 0.0, -9.81]), np.zeros(3))
    still = np.zeros(arm.n)
    Y = Regressor(Arm(model, arm.tool_frame))(q, still, still, still)
    shape = np.tile(np.array([1.0] + [length] * 3 + [length**2] * 6), arm.n) ** 2
    fastest = np.linalg.eigvals(np.linalg.solve(K_D, (Y * shape) @ Y.T)).real.max()
    if not fastest > 0:
        raise ValueError(f"q: expected a posture in which gravity shows some of the parameters, got {q.tolist()}")
    return rate / fastest * shape
