"""The hybrid position/force scheme of figure 14 as a controller; `hybrid_law` is its law, `modes` say what it controls when.

A reconstruction: the report cites its force law and does not print it. docs/hybrid.md derives this one.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from k1607_pin.arguments import as_floats, number, numbers, shown
from k1607_pin.arm.arm import Arm
from k1607_pin.arm.reach import UnreachableError, rotation_of
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.finite import entering, finite_only
from k1607_pin.control.hybrid_gains import UnstableGainsError, checked_stiffness, hybrid_gains, require_stable
from k1607_pin.control.hybrid_law import HybridState, HybridStep, Loop, hybrid_adaptive, per_stiffness
from k1607_pin.control.modes import Mode, Modes, checked_modes, mode_at
from k1607_pin.control.pose import PosePath, check_path, check_reach, checked_rotation, wanted_velocity
from k1607_pin.control.posture import Posture, check_posture
from k1607_pin.control.practice import OFF, Practice, check_practice, filtered
from k1607_pin.control.reference_model import ReferenceModel
from k1607_pin.control.scheme import checked_scheme, named, other_torque

__all__ = [
    "HybridAdaptive", "HybridState", "HybridStep", "Loop", "Mode", "UnstableGainsError", "hybrid_adaptive", "hybrid_gains",
]  # fmt: skip

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
        force_gains = named("force_", checked_scheme, *force)
        object.__setattr__(self, "gains", gains)
        object.__setattr__(self, "force_gains", force_gains)
        object.__setattr__(self, "stiffness", checked_stiffness(self.stiffness))
        number("transition", self.transition, 0, unit="s")
        number("force_integral", self.force_integral, at_least=0, unit="1/s")
        expected = "one or (6,) numbers >= 0 in N, N m"
        touch = as_floats("touch", self.touch, expected)
        if touch.shape not in ((), (6,)) or not ((touch >= 0) & np.isfinite(touch)).all():
            raise ValueError(f"touch: expected {expected}, got {shown(self.touch)}")
        object.__setattr__(self, "modes", checked_modes(self.modes))
        if not callable(self.sensor):
            raise ValueError(f"sensor: expected a function of time, q and v, got {shown(self.sensor)}")
        check_posture(self.posture, self.arm.n)
        check_practice("practice", self.practice, self.arm.n, 6, gains)
        per = per_stiffness(force_gains, self.stiffness)
        check_practice("force_practice", self.force_practice, self.arm.n, 6, per)
        closing = per.K_p
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
        """The initial gains in the first mode, with nothing to fade, when the arm can follow where it has to and the loop holds.

        The sampled loop of the initial gains is looked at in the start posture, for every listed selection, (H12).

        A point of the path that is out of reach is refused if all is position-controlled there. If not, the force may lead the
        tool to where it is in reach: that is told in the log, and the path after it not looked at.

        Raises
        ------
        ValueError
            The path's points at the start or the end are not what `PosePath` says, or no orientation is given at all.
        UnreachableError
            The arm has no posture within its limits for a point that it has to follow.
        UnstableGainsError
            The loop of the initial gains runs away; the largest omega is named.
        """
        q, v = entering(self.arm.n, 0.0, q, v, None)
        check_path(self.path, self.rotation, duration, ("position", "velocity"))
        try:
            check_reach(self.arm, self.path, self.rotation, q, duration)
        except UnreachableError as error:
            if not self.mode(error.time)[0].any():
                raise
            logger.warning("%s; whether what is force-controlled there makes up for it is not known", error)
        numbers("sensor", self.sensor(0.0, q, v), (6,), "N, N m")
        self._require_stable(q)
        return self.initial(q, v)

    def _require_stable(self, q: np.ndarray) -> None:
        M, J = self.arm.mass_matrix(q), self.arm.jacobian(q)
        inertias = np.linalg.eigvalsh(M)
        if not inertias[0] > len(M) * np.finfo(float).eps * inertias[-1]:
            return  # links without inertia: kinematics alone, whose loop nobody knows
        turn = np.kron(np.eye(2), self.compliance)
        mobility = turn.T @ J @ np.linalg.solve(M, J.T) @ turn
        modes: Any = self.modes
        selections = [self.mode(0.0)[0]] if callable(modes) else [mode.selection for mode in modes]

        def smoothing(period: float) -> float:
            return float(1 - np.exp(-self.practice.velocity_cutoff * period))

        for S in np.unique(selections, axis=0):
            require_stable(
                mobility, self.gains, self.force_gains, self.stiffness, S, self.period, smoothing, self.force_integral
            )

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
