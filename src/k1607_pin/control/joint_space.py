"""The joint-space adaptive scheme, figure 12: PD on the joint errors with adapted gains."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.control.adaptation import Gains, gain_rates, proportional_derivative
from k1607_pin.control.finite import finite_only
from k1607_pin.control.pose import pose_error
from k1607_pin.control.practice import OFF, AdaptiveState, Practice, filtered, limited, next_gains
from k1607_pin.control.reference_model import ReferenceModel, reference_model
from k1607_pin.control.scheme import checked_scheme

JointPath = Callable[[float], Any]
"""Time [s] -> wanted .position (n,) rad and .velocity (n,) rad/s; .acceleration (n,) rad/s^2 for laws that feed it forward."""


class JointStep(NamedTuple):
    """One control period's outcome."""

    torque: Any
    """(n,) N m, held until the next period"""
    gains: Gains
    """Gains for the next period"""
    error: Any
    """(n,) rad: wanted less actual"""
    error_rate: Any
    """(n,) rad/s"""
    share: Any
    """Of the torque asked for that the limit lets through, at most 1"""


def joint_adaptive(
    q: Any,
    v: Any,
    wanted_q: Any,
    wanted_v: Any,
    gains: Gains,
    P_2: Any,
    P_3: Any,
    beta_1: Any,
    beta_2: Any,
    period: Any,
    start: Gains | None = None,
    other_torque: Any = 0.0,
    practice: Practice = OFF,
) -> JointStep:
    """One step of the scheme of section 6.1: torque from the present gains, then the gains adapted.

    The report prints no law for it and refers to its [6]; the adaptation is (76)-(77), whose derivation (42)-(75) holds for joint
    errors as it stands, the mass matrix in Lambda's place.

    Parameters
    ----------
    q, wanted_q : (n,) rad; v, wanted_v : (n,) rad/s.
    gains : `Gains` of n by n; P_2, P_3 (n, n) : see `reference_model`; beta_1, beta_2 : adaptation rates.
    period : s.
    start : K(0), for a practice that refers to it; None for the present gains.
    other_torque : (n,) N m, added to the law's before the limit: gravity's.
    practice : options beyond the report.
    """
    error, error_rate = wanted_q - q, wanted_v - v
    rates = gain_rates(P_2, P_3, beta_1, beta_2, error, error_rate)
    torque, share = limited(proportional_derivative(gains, error, error_rate) + other_torque, practice)
    after = next_gains(start or gains, gains, rates, error, share, period, practice)
    return JointStep(torque, after, error, error_rate, share)


@dataclass(frozen=True)
class JointAdaptive:
    """The scheme as a controller for `simulate`: follows joint angles, such as `joint_path` finds for a path of the tool.

    Raises
    ------
    ValueError
        Wrong shapes, numbers that are not finite, negative beta, a period that is not positive; when it starts, also a path whose
        points are no (n,) joint angles and velocities.
    """

    arm: Arm
    """Its kinematics serve the log alone, and its masses only gravity's torque if `practice` asks for it"""
    path: JointPath
    gains: Gains
    """K_p(0) [N m/rad], K_d(0) [N m s/rad], (n, n) each"""
    model: ReferenceModel
    """of n systems; gives P_2 and P_3"""
    beta_1: float
    beta_2: float
    period: float
    """s, the control period"""
    practice: Practice = OFF
    """What the report's law lacks; its dead zone is in rad"""

    variables: ClassVar[dict[str, tuple[tuple[str, ...], str]]]
    """What it logs: dimensions and units."""

    def __post_init__(self) -> None:
        n = self.arm.n
        gains = checked_scheme(self.gains, self.model, self.beta_1, self.beta_2, self.period, n)
        object.__setattr__(self, "gains", gains)
        self.practice.check(n, n, gains)

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> AdaptiveState:
        """The initial gains, when the path's points from 0 to ``duration`` [s] are what they should be."""
        check_path(self.arm, self.path, duration)
        return self.initial(q, v)

    def initial(self, q: Any, v: Any) -> AdaptiveState:
        """The initial gains, whatever the path; q : (n,) rad; v : (n,) rad/s."""
        return AdaptiveState(self.gains, v)

    @finite_only
    def update(
        self, t: float, q: np.ndarray, v: np.ndarray, state: AdaptiveState
    ) -> tuple[np.ndarray, AdaptiveState, dict[str, Any]]:
        """Torque (n,), the next state, and the log: errors of the joints and of the tool, and the gains at work."""
        wanted = self.path(t)
        v = filtered(state.velocity, v, self.period, self.practice)
        other = self.arm.gravity_torque(q) if self.practice.gravity else np.zeros(self.arm.n)
        step = joint_adaptive(
            q,
            v,
            wanted.position,
            wanted.velocity,
            state.gains,
            self.model.P_2,
            self.model.P_3,
            self.beta_1,
            self.beta_2,
            self.period,
            self.gains,
            other,
            self.practice,
        )
        log = {
            **errors(self.arm, q, v, wanted),
            "K_p": state.gains.K_p,
            "K_d": state.gains.K_d,
            "torque_share": step.share,
        }
        return step.torque, AdaptiveState(step.gains, v), log


ERRORS: dict[str, tuple[tuple[str, ...], str]] = {
    "joint_error": (("joint",), "rad"),
    "joint_error_rate": (("joint",), "rad/s"),
    "error": (("direction",), "m, rad"),
    "error_rate": (("direction",), "m/s, rad/s"),
    "wanted_position": (("axis",), "m"),
    "wanted_velocity": (("axis",), "m/s"),
}
"""What `errors` gives: dimensions and units."""

JointAdaptive.variables = ERRORS | {
    "K_p": (("row", "column"), "N m/rad"),
    "K_d": (("row", "column"), "N m s/rad"),
    "torque_share": ((), ""),
}


def errors(arm: Arm, q: np.ndarray, v: np.ndarray, wanted: Any) -> dict[str, np.ndarray]:
    """Errors of the joints, and of the tool under the names that the Cartesian laws log, so that the same plots serve.

    Where the tool should be is where the wanted joint angles put it.

    q : (n,) rad; v : (n,) rad/s; wanted : a point of a `JointPath`.
    """
    here, there = arm.forward_kinematics(q), arm.forward_kinematics(wanted.position)
    twist, wanted_twist = arm.jacobian(q) @ v, arm.jacobian(wanted.position) @ wanted.velocity  # (6,)
    return {
        "joint_error": wanted.position - q,
        "joint_error_rate": wanted.velocity - v,
        "error": pose_error(here.translation, here.rotation, there.translation, there.rotation),
        "error_rate": wanted_twist - twist,
        "wanted_position": there.translation,
        "wanted_velocity": wanted_twist[:3],
    }


def check_path(arm: Arm, path: JointPath, duration: float, needed: tuple[str, ...] = ("position", "velocity")) -> None:
    """Refuse a path whose points at 0 and ``duration`` [s] lack what is ``needed``, or have it in another shape than (n,).

    Raises
    ------
    ValueError
        It says which, and when.
    """
    for t in (0.0, duration):
        point = path(t)
        for name in needed:
            if not hasattr(point, name):
                raise ValueError(f"path: expected points with .{name}, got {type(point).__name__} at t = {t:g} s")
            arm.as_vector(getattr(point, name), f"path({t:g}).{name}")


def gains_from_mass(arm: Arm, q: np.ndarray, omega: float, damping: float = 1.0) -> Gains:
    """K_p = omega^2 M(q), K_d = 2 damping omega M(q): initial gains that answer alike in all joint directions.

    Parameters
    ----------
    q : (n,) rad, or (N, n) postures along the path, for which M is the harmonic mean: a direction that is light in one of them,
        where the loop is fastest, counts most.
    omega : 1/s; stable with torques held for a period T only while omega T stays below 1 where damping is 1.
    """
    mobility = [np.linalg.inv(arm.mass_matrix(one)) for one in np.atleast_2d(q)]
    M = np.linalg.inv(np.mean(mobility, axis=0))
    return Gains(omega**2 * M, 2 * damping * omega * M)


def model_from_mass(arm: Arm, q: np.ndarray, omega: float) -> ReferenceModel:
    """The reference model that the gains of `gains_from_mass` make the errors behave as, for n joints.

    Q is such that P_2 = diag M and P_3 = diag M / omega: errors and rates weigh alike at omega, and each joint by its inertia.
    With P_2 = I one beta has to serve a shoulder and a wrist of a thousandth of its inertia, whose gains then run away. How
    large beta may be still depends on the arm: `adaptation_rates` finds it.

    q : (n,) rad, or (N, n) postures along the path; omega : 1/s.
    """
    m, ones = np.diag(gains_from_mass(arm, q, 1.0).K_p), np.ones(arm.n)
    weights = np.diag(np.concatenate([2 * omega**2 * m, 2 * m]))
    return reference_model(omega**2 * ones, 2 * omega * ones, weights)
