"""The hybrid position/force scheme of figure 14 as a controller; `hybrid_law` is its law, `modes` say what it controls when.

A reconstruction: the report cites its force law and does not print it. docs/hybrid.md derives this one.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.reach import UnreachableError, rotation_of
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.finite import finite_only
from k1607_pin.control.hybrid_law import HybridState, HybridStep, Loop, hybrid_adaptive, per_stiffness
from k1607_pin.control.modes import Mode, Modes, checked_modes, mode_at
from k1607_pin.control.pose import PosePath, check_path, check_reach, checked_rotation, wanted_velocity
from k1607_pin.control.posture import Posture
from k1607_pin.control.practice import OFF, Practice, filtered
from k1607_pin.control.reference_model import ReferenceModel
from k1607_pin.control.scheme import checked_scheme, named, other_torque

__all__ = ["HybridAdaptive", "HybridState", "HybridStep", "Loop", "Mode", "hybrid_adaptive", "hybrid_gains"]

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class HybridAdaptive:
    """The scheme as a controller for `simulate`: follows a path where S is 0, exerts forces where it is 1.

    A change of S is bumpless: the torque is at that sample what it would have been without, and what the new mode asks for
    comes in over ``transition``. A newly position-controlled direction starts from where it is and as fast as it goes; a newly
    force-controlled one from the force it feels; the gains are carried on.

    Raises
    ------
    ValueError
        Wrong shapes, numbers that are not finite, a rotation that is none, S that is not diagonal of 0 and 1, a wanted force on
        a position-controlled axis, negative beta, force_integral or touch, a stiffness, transition or period that is not
        positive; a gain bound without positive definite K_p(0) and K_d(0), of the force loop I + K_p(0) and K_d(0) over the
        stiffness.
    """

    arm: Arm
    """Without a posture to keep to, its kinematics alone are used: the law knows no masses."""
    path: PosePath
    """Without accelerations; what S selects of it is not looked at."""
    rotation: Any
    """(3, 3) wanted orientation, tool in base, held by a path whose points have no rotation: theirs counts. None if they do."""
    modes: Modes
    """What is force-controlled"""
    sensor: Callable[[float, np.ndarray, np.ndarray], np.ndarray]
    """Time [s], q, v (n,) -> (6,) N, N m of the world on the arm at its tool, base axes; of a `Wall`, its ``sensor(arm)``"""
    stiffness: Any
    """N/m, N m/rad assumed of the contact: one number or (6,) in compliance axes, at least the stiffest to be met. With K_d of
    ``force_gains`` it makes the damping, which is there off the wall as well."""
    gains: Gains
    """K_p(0), K_d(0) of the position loop, (6, 6) each, compliance axes"""
    force_gains: Gains
    """K_p(0) [N per N], K_d(0) [s] of the force loop, (6, 6) each, compliance axes"""
    model: ReferenceModel
    """of six systems, for the position loop"""
    force_model: ReferenceModel
    """of six systems, for the force loop"""
    beta_1: float
    beta_2: float
    force_beta_1: float
    """1/(N m s), times N/m, N and N of the reference model's y"""
    force_beta_2: float
    period: float
    """s, the control period"""
    compliance: np.ndarray = field(default_factory=lambda: np.eye(3))
    """(3, 3) the compliance axes, columns, in the base; for forces and moments alike"""
    transition: float = 0.1
    """s, time constant with which what a change of S leaves behind fades"""
    posture: Posture | None = None
    """What the null space is to keep to; None leaves it to itself. Uses the arm's mass matrix."""
    practice: Practice = OFF
    """What the report's law lacks"""
    force_practice: Practice = OFF
    """Of this, sigma, gain_bound and dead_zone [N, N m] for the force loop"""
    force_integral: float = 0.0
    """1/s: a steady force error dies out as exp(-force_integral t / (1 + K_p)); stable well below 2 damping omega (1 + K_p)"""
    touch: Any = 0.0
    """N, N m, one number or (6,), compliance axes: what a selected force must exceed for the force loop to learn; a few times the
    sensor's noise"""

    variables: ClassVar[dict[str, tuple[tuple[str, ...], str]]] = {
        "error": (("direction",), "m, rad"),
        "force": (("direction",), "N, N m"),
        "wanted_force": (("direction",), "N, N m"),
        "force_error": (("direction",), "N, N m"),
        "command": (("direction",), "N, N m"),
        "integral": (("direction",), "N, N m"),
        "selection": (("direction",), ""),
        "K_p": (("row", "column"), "N/m, N/rad; N, N m/rad"),
        "K_d": (("row", "column"), "N s/m, N s/rad; N s, N m s/rad"),
        "force_K_p": (("row", "column"), "1"),
        "force_K_d": (("row", "column"), "s"),
        "torque_share": ((), ""),
    }
    """What it logs: dimensions and units. Directions are the compliance axes here."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "compliance", checked_rotation("compliance", self.compliance))
        if self.rotation is not None:
            object.__setattr__(self, "rotation", checked_rotation("rotation", self.rotation))
        gains = checked_scheme(self.gains, self.model, self.beta_1, self.beta_2, self.period, 6)
        force = self.force_gains, self.force_model, self.force_beta_1, self.force_beta_2, self.period, 6
        force_gains = named("force", checked_scheme, *force)
        object.__setattr__(self, "gains", gains)
        object.__setattr__(self, "force_gains", force_gains)
        object.__setattr__(self, "stiffness", _checked_stiffness(self.stiffness))
        if not 0 < self.transition < np.inf:
            raise ValueError(f"transition: expected a positive time in s, got {self.transition!r}")
        for name, value, shapes in (("force_integral", self.force_integral, ((),)), ("touch", self.touch, ((), (6,)))):
            x = np.array(value, dtype=float)
            if x.shape not in shapes or not ((x >= 0) & np.isfinite(x)).all():
                raise ValueError(f"{name}: expected finite numbers >= 0 of shape {shapes}, got {value!r}")
        object.__setattr__(self, "modes", checked_modes(self.modes))
        self.practice.check(self.arm.n, 6, gains)
        named("force", self.force_practice.check, self.arm.n, 6, per_stiffness(force_gains, self.stiffness))
        closing = per_stiffness(force_gains, self.stiffness).K_p
        if not np.linalg.eigvalsh((closing + closing.T) / 2)[0] > 0:
            raise ValueError(
                "force_gains: expected K^-1 (1 + K_p) with a positive definite symmetric part, K the stiffness; else the loop "
                f"pushes away from the wanted force; got K_p =\n{force_gains.K_p}"
            )
        # Adaptation rests in both loops when the motors are at their limits.
        object.__setattr__(
            self, "force_practice", replace(self.force_practice, torque_limit=self.practice.torque_limit)
        )

    of_time: ClassVar = ("mode",)
    """Methods of time alone, for who traces the others"""

    def mode(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """The diagonal of S and the wanted force, (6,) each, compliance axes, at time t [s].

        Raises
        ------
        ValueError
            A mode given as a function of time is not one, or wants a force on a position-controlled axis.
        """
        return mode_at(self.modes, t, self.period)

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> HybridState:
        """The initial gains in the first mode, with nothing to fade, when the arm can follow where it has to.

        A point of the path that is out of reach is refused if all is position-controlled there. If not, the force may lead the
        tool to where it is in reach: that is told in the log, and the path after it not looked at.

        Raises
        ------
        ValueError
            The path's points at the start or the end are not what `PosePath` says, or no orientation is given at all.
        UnreachableError
            The arm has no posture within its limits for a point that it has to follow.
        """
        check_path(self.path, self.rotation, duration, ("position", "velocity"))
        try:
            check_reach(self.arm, self.path, self.rotation, q, duration)
        except UnreachableError as error:
            if not self.mode(error.time)[0].any():
                raise
            logger.warning("%s; whether what is force-controlled there makes up for it is not known", error)
        if np.shape(wrench := self.sensor(0.0, q, v)) != (6,):
            raise ValueError(f"sensor: expected (6,) force and moment in N, N m, got shape {np.shape(wrench)}")
        return self.initial(q, v)

    def initial(self, q: Any, v: Any) -> HybridState:
        """The initial gains in the first mode, whatever the path; q : (n,) rad; v : (n,) rad/s."""
        selection, force = self.mode(0.0)
        return HybridState(self.gains, self.force_gains, v, selection, force, *np.zeros((4, 6)))

    @finite_only
    def update(
        self, t: float, q: np.ndarray, v: np.ndarray, state: HybridState
    ) -> tuple[np.ndarray, HybridState, dict[str, Any]]:
        """Torque (n,), the next state, and the log: errors, forces, and the gains at work."""
        tool, J, wanted = self.arm.forward_kinematics(q), self.arm.jacobian(q), self.path(t)
        wrench = self.sensor(t, q, v)
        selection, wanted_force = self.mode(t)
        v = filtered(state.velocity, v, self.period, self.practice)
        other = other_torque(self.arm, t, q, v, J, self.practice, self.posture)
        step = hybrid_adaptive(
            tool.translation,
            tool.rotation,
            J,
            v,
            wrench,
            wanted.position,
            rotation_of(wanted, self.rotation),
            wanted_velocity(wanted),
            selection,
            wanted_force,
            state,
            self.compliance,
            self.stiffness,
            Loop(self.model.P_2, self.model.P_3, self.beta_1, self.beta_2),
            Loop(self.force_model.P_2, self.force_model.P_3, self.force_beta_1, self.force_beta_2),
            self.transition,
            self.period,
            (self.gains, self.force_gains),
            other,
            self.practice,
            self.force_practice,
            self.force_integral,
            self.touch,
        )
        log = {
            "error": step.error,
            "force": step.force,
            "wanted_force": wanted_force,
            "force_error": step.force_error,
            "command": step.command,
            "integral": state.integral,
            "selection": selection,
            "K_p": state.position.K_p,
            "K_d": state.position.K_d,
            "force_K_p": state.force.K_p,
            "force_K_d": state.force.K_d,
            "torque_share": step.share,
        }
        return step.torque, step.state, log


def hybrid_gains(
    arm: Arm,
    q: np.ndarray,
    stiffness: Any,
    omega: float,
    force_omega: float,
    damping: float = 1.0,
    force_damping: float = 1.0,
    compliance: Any = None,
) -> tuple[Gains, Gains]:
    """Initial gains of both loops, compliance axes: each a system of its omega [1/s] and damping, (H8).

    The force loop's on a contact of ``stiffness``: K_p = omega^2 Lambda, K_d = 2 damping omega Lambda;
    K_pf = force_omega^2 Lambda K^-1 - 1, K_df = 2 force_damping force_omega Lambda K^-1.

    Parameters
    ----------
    q : (n,) rad; stiffness : N/m, N m/rad, one number or (6,), compliance axes; compliance : (3, 3), None for the base's axes.
        On a contact softer by s the force loop's omega falls with the root of s, and its damping rises so.

    Raises
    ------
    ValueError
        A stiffness or an omega that is not positive, a damping that is negative, a compliance that is no rotation.
    """
    stiffness = _checked_stiffness(stiffness)
    for name, value in (("omega", omega), ("force_omega", force_omega)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name}: expected a positive number in 1/s, got {value!r}")
    for name, value in (("damping", damping), ("force_damping", force_damping)):
        if not 0 <= value < np.inf:
            raise ValueError(f"{name}: expected a number >= 0, got {value!r}")
    if compliance is not None:
        compliance = checked_rotation("compliance", compliance)
    C = np.kron(np.eye(2), np.eye(3) if compliance is None else compliance)
    Lambda = C.T @ arm.operational_space(q, np.zeros(arm.n)).Lambda @ C
    Lambda_K = Lambda / stiffness  # (6, 6) Lambda K^-1, s^2
    return (
        Gains(omega**2 * Lambda, 2 * damping * omega * Lambda),
        Gains(force_omega**2 * Lambda_K - np.eye(6), 2 * force_damping * force_omega * Lambda_K),
    )


def _checked_stiffness(stiffness: Any) -> np.ndarray:
    """(6,) positive numbers, from one or six."""
    try:
        x = np.array(stiffness, dtype=float)
    except (TypeError, ValueError):
        x = np.empty(0)
    if x.shape not in ((), (6,)) or not ((x > 0) & np.isfinite(x)).all():
        raise ValueError(f"stiffness: expected one or (6,) positive numbers in N/m, N m/rad, got {stiffness!r}")
    return np.broadcast_to(x, (6,)).copy()
