"""The hybrid position/force scheme, figure 14: adaptive PD on positions where S is 0, on contact forces where it is 1.

A reconstruction: the report cites its force law and does not print it. docs/hybrid.md derives this one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.inverse import RIGID
from k1607_pin.control.adaptation import Gains, check_adaptation, checked_gains, gain_rates, proportional_derivative
from k1607_pin.control.cartesian import pose_error
from k1607_pin.control.posture import Posture, posture_torque
from k1607_pin.control.practice import OFF, Practice, filtered, limited, next_gains
from k1607_pin.control.reference_model import ReferenceModel


class Mode(NamedTuple):
    """What is controlled from a time on."""

    selection: Any
    """(6,) or the (6, 6) diagonal S of figure 14, compliance axes: 1 force-controlled, 0 position-controlled"""
    force: Any = (0.0,) * 6
    """(6,) N, N m that the tool is to exert on the world, compliance axes, or a function of time [s]; 0 where S is 0"""
    time: float = 0.0
    """s, from which it holds; ignored when modes are given as a function of time"""


class Loop(NamedTuple):
    """Weights and rates of one loop's adaptation."""

    P_2: Any
    """(6, 6) of a `ReferenceModel`"""
    P_3: Any
    """(6, 6)"""
    beta_1: Any
    beta_2: Any


class HybridState(NamedTuple):
    """What the scheme carries from one control period to the next."""

    position: Gains
    """(6, 6) each, compliance axes: N/m, N s/m and their angular likes"""
    force: Gains
    """(6, 6) each, compliance axes: 1 (N per N), s"""
    velocity: Any
    """(n,) rad/s, filtered"""
    selection: Any
    """(6,) diagonal of S at the last sample"""
    wanted_force: Any
    """(6,) N, N m at the last sample, compliance axes"""
    offset: Any
    """(6,) of the reference, compliance axes: m, rad where S is 0, N, N m where it is 1; brings a newly chosen direction over"""
    offset_rate: Any
    """(6,) per s"""
    transfer: Any
    """(6,) N, N m, compliance axes: what the last switch would have made the command jump by, fading"""


class HybridStep(NamedTuple):
    """One control period's outcome."""

    torque: Any
    """(n,) N m, held until the next period"""
    state: HybridState
    error: Any
    """(6,) m, rad: wanted less actual pose, compliance axes, all six; what S selects is not acted on"""
    force: Any
    """(6,) N, N m of the tool on the world, measured, compliance axes"""
    force_error: Any
    """(6,) N, N m: wanted less measured, compliance axes; 0 where S is 0"""
    command: Any
    """(6,) N, N m: the two loops' force on the tool, compliance axes"""
    share: Any
    """Of the torque asked for that the limit lets through, at most 1"""


def hybrid_adaptive(
    position: Any,
    rotation: Any,
    J: Any,
    v: Any,
    wrench: Any,
    wanted_position: Any,
    wanted_rotation: Any,
    wanted_velocity: Any,
    selection: Any,
    wanted_force: Any,
    state: HybridState,
    compliance: Any,
    stiffness: Any,
    position_loop: Loop,
    force_loop: Loop,
    transition: Any,
    period: Any,
    start: tuple[Gains, Gains] | None = None,
    other_torque: Any = 0.0,
    practice: Practice = OFF,
    force_practice: Practice = OFF,
) -> HybridStep:
    """One step of the scheme: torque from the present gains, then the gains adapted; docs/hybrid.md, (H1)-(H8).

    Parameters
    ----------
    position (3,) m, rotation (3, 3) : the tool's pose; J (6, n) : its Jacobian; v (n,) rad/s.
    wrench : (6,) N, N m of the world on the tool, base axes.
    wanted_position (3,) m, wanted_rotation (3, 3), wanted_velocity (6,) m/s and rad/s : base axes.
    selection : (6,) 0 or 1; wanted_force : (6,) N, N m of the tool on the world; both in compliance axes.
    compliance : (3, 3) the compliance axes, columns, in the base.
    stiffness : (6,) N/m, N m/rad assumed of the contact, compliance axes: at least the stiffest to be met.
    transition : s, in which what a switch leaves behind fades; period : s.
    start : K(0) of the position loop and of the force loop, for a practice that refers to them; None for the present gains.
    other_torque : (n,) N m, added to the law's before the limit.
    practice : options beyond the report; of ``force_practice`` only sigma, gain_bound and dead_zone count, for the force loop.
    """
    error = _turned(compliance, pose_error(position, rotation, wanted_position, wanted_rotation))
    twist = _turned(compliance, J @ v)
    error_rate = _turned(compliance, wanted_velocity) - twist
    measured = -_turned(compliance, wrench)
    force_error, force_rate = wanted_force - measured, -stiffness * twist
    both = (1 - selection) * error + selection * force_error
    both_rate = (
        1 - selection
    ) * error_rate  # a force's reference starts at rest: its rate would be the stiffness' guess

    old, is_new = state.selection, np.abs(selection - state.selection)
    offset = state.offset + is_new * (-both - state.offset)
    offset_rate = state.offset_rate + is_new * (-both_rate - state.offset_rate)

    def command(selection: Any, wanted_force: Any, offset: Any, offset_rate: Any) -> tuple[Any, ...]:
        x, x_rate = (1 - selection) * (error + offset), (1 - selection) * (error_rate + offset_rate)
        f, f_rate = selection * (wanted_force - measured + offset), selection * (force_rate + offset_rate)
        by_position = (1 - selection) * proportional_derivative(state.position, x, x_rate)
        by_force = selection * (wanted_force + offset + proportional_derivative(state.force, f, f_rate))
        return by_position + by_force, x, x_rate, f, f_rate

    after, x, x_rate, f, f_rate = command(selection, wanted_force, offset, offset_rate)
    before = command(old, state.wanted_force, state.offset, state.offset_rate)[0]  # as if nothing had been switched
    switches = np.where(np.sum(is_new) > 0, 1.0, 0.0)
    transfer = state.transfer + switches * (before - after)
    force = after + transfer
    torque, share = limited(J.T @ _back(compliance, force) + other_torque, practice)

    starts = start or (state.position, state.force)
    rates = gain_rates(*position_loop, x, x_rate)
    in_touch = np.where(np.sum((selection * measured) ** 2) > 0, 1.0, 0.0)
    # Rows weighted by the stiffness: only then is Psi_1 symmetric for force directions of unlike stiffness, (H6).
    rows = in_touch * np.reshape(stiffness, (6, 1))
    force_rates = gain_rates(
        force_loop.P_2, force_loop.P_3, force_loop.beta_1 * rows, force_loop.beta_2 * rows, f, f_rate
    )
    next_offset, next_offset_rate = _faded(offset, offset_rate, transition, period)
    following = HybridState(
        next_gains(starts[0], state.position, rates, x, share, period, practice),
        next_gains(starts[1], state.force, force_rates, f, share, period, force_practice),
        v,
        selection,
        wanted_force,
        next_offset,
        next_offset_rate,
        transfer * np.exp(-period / transition),
    )
    return HybridStep(torque, following, error, measured, selection * force_error, force, share)


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
        a position-controlled axis, negative beta, a stiffness, transition or period that is not positive.
    """

    arm: Arm
    """Without a posture to keep to, its kinematics alone are used: the law knows no masses."""
    path: Callable[[float], Any]
    """Time [s] -> wanted .position (3,) m and .velocity (3,) m/s, base axes; what S selects of it is not looked at"""
    rotation: np.ndarray
    """(3, 3) wanted orientation, tool in base"""
    modes: "Mode | Sequence[Mode] | Callable[[float], Mode]"
    """What is force-controlled: for good, from times on, or as a function of time [s]"""
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

    variables: ClassVar[dict[str, tuple[tuple[str, ...], str]]] = {
        "error": (("direction",), "m, rad"),
        "force": (("direction",), "N, N m"),
        "wanted_force": (("direction",), "N, N m"),
        "force_error": (("direction",), "N, N m"),
        "command": (("direction",), "N, N m"),
        "selection": (("direction",), ""),
        "K_p": (("row", "column"), "N/m, N/rad; N, N m/rad"),
        "K_d": (("row", "column"), "N s/m, N s/rad; N s, N m s/rad"),
        "force_K_p": (("row", "column"), "1"),
        "force_K_d": (("row", "column"), "s"),
        "torque_share": ((), ""),
    }
    """What it logs: dimensions and units. Directions are the compliance axes here."""

    def __post_init__(self) -> None:
        for name in ("rotation", "compliance"):
            R = np.array(getattr(self, name), dtype=float)
            if R.shape != (3, 3) or not np.abs(R @ R.T - np.eye(3)).max() < RIGID or np.linalg.det(R) < 0:
                raise ValueError(f"{name}: expected a (3, 3) rotation matrix, got\n{getattr(self, name)!r}")
            object.__setattr__(self, name, R)
        for name in ("gains", "force_gains"):
            object.__setattr__(self, name, _named(name, checked_gains, getattr(self, name), 6))
        for name in ("model", "force_model"):
            if getattr(self, name).P_2.shape != (6, 6):
                raise ValueError(f"{name}: expected one of 6 systems, got {len(getattr(self, name).P_2)}")
        check_adaptation(self.beta_1, self.beta_2, self.period)
        _named("force", check_adaptation, self.force_beta_1, self.force_beta_2, self.period)
        stiffness = np.array(self.stiffness, dtype=float)
        if stiffness.shape not in ((), (6,)) or not ((stiffness > 0) & np.isfinite(stiffness)).all():
            raise ValueError(
                f"stiffness: expected one or (6,) positive numbers in N/m, N m/rad, got {self.stiffness!r}"
            )
        object.__setattr__(self, "stiffness", np.broadcast_to(stiffness, (6,)).copy())
        if not 0 < self.transition < np.inf:
            raise ValueError(f"transition: expected a positive time in s, got {self.transition!r}")
        if not callable(self.modes):
            object.__setattr__(self, "modes", _checked_modes(self.modes))
        self.practice.check(self.arm.n, 6)
        self.force_practice.check(self.arm.n, 6)
        # Adaptation rests in both loops when the motors are at their limits.
        object.__setattr__(
            self, "force_practice", replace(self.force_practice, torque_limit=self.practice.torque_limit)
        )

    def mode(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """The diagonal of S and the wanted force, (6,) each, compliance axes, at time t [s].

        Raises
        ------
        ValueError
            A mode given as a function of time is not one, or wants a force on a position-controlled axis.
        """
        modes: Any = self.modes
        if callable(modes):
            now = _checked_mode(f"modes({t:g})", modes(t))
        else:
            index = np.searchsorted([mode.time for mode in modes], t + self.period / 2, "right") - 1
            now = modes[max(int(index), 0)]
        return now.selection, _wanted(now, t)

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> HybridState:
        """The initial gains in the first mode, with nothing to fade. Whether the arm can follow the path is not looked at."""
        selection, force = self.mode(0.0)
        return HybridState(self.gains, self.force_gains, v, selection, force, *np.zeros((3, 6)))

    def update(
        self, t: float, q: np.ndarray, v: np.ndarray, state: HybridState
    ) -> tuple[np.ndarray, HybridState, dict[str, Any]]:
        """Torque (n,), the next state, and the log: errors, forces, and the gains at work."""
        tool, J, wanted = self.arm.forward_kinematics(q), self.arm.jacobian(q), self.path(t)
        wrench = np.asarray(self.sensor(t, q, v), dtype=float)
        if wrench.shape != (6,):
            raise ValueError(f"sensor: expected (6,) force and moment in N, N m, got shape {wrench.shape}")
        selection, wanted_force = self.mode(t)
        v = filtered(state.velocity, v, self.period, self.practice)
        other = self.arm.gravity_torque(q) if self.practice.gravity else np.zeros(self.arm.n)
        if self.posture:
            other = other + posture_torque(self.arm.mass_matrix(q), J, q, v, *self.posture.path(t), self.posture.omega)
        step = hybrid_adaptive(
            tool.translation,
            tool.rotation,
            J,
            v,
            wrench,
            wanted.position,
            self.rotation,
            np.concatenate([wanted.velocity, np.zeros(3)]),
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
        )
        log = {
            "error": step.error,
            "force": step.force,
            "wanted_force": wanted_force,
            "force_error": step.force_error,
            "command": step.command,
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
    selection: Any = (1.0,) * 6,
) -> tuple[Gains, Gains]:
    """Initial gains of both loops, compliance axes: each a system of its omega [1/s] and damping, (H8).

    The force loop's on a contact of ``stiffness``: K_p = omega^2 Lambda, K_d = 2 damping omega Lambda;
    K_pf = force_omega^2 Lambda K^-1 - 1, K_df = 2 force_damping force_omega Lambda K^-1.

    Parameters
    ----------
    q : (n,) rad; stiffness : N/m, N m/rad, one number or (6,), compliance axes; compliance : (3, 3), None for the base's axes.
        On a contact softer by s the force loop's omega falls with the root of s, and its damping rises so.
    selection : (6,) 1 for directions that are ever force-controlled; the others get no force gains, so that a gain bound, a
        multiple of the norm of all, is one for those at work.
    """
    C = np.kron(np.eye(2), np.eye(3) if compliance is None else compliance)
    Lambda = C.T @ arm.operational_space(q, np.zeros(arm.n)).Lambda @ C
    per_stiffness = Lambda / np.broadcast_to(stiffness, (6,))  # (6, 6) Lambda K^-1, s^2
    at_work = np.outer(selection, selection)
    return (
        Gains(omega**2 * Lambda, 2 * damping * omega * Lambda),
        Gains(
            at_work * (force_omega**2 * per_stiffness - np.eye(6)),
            at_work * (2 * force_damping * force_omega * per_stiffness),
        ),
    )


def _turned(compliance: Any, x: Any) -> Any:
    """(6,) from base axes to compliance axes."""
    return np.concatenate([compliance.T @ x[:3], compliance.T @ x[3:]])


def _back(compliance: Any, x: Any) -> Any:
    return np.concatenate([compliance @ x[:3], compliance @ x[3:]])


def _faded(offset: Any, rate: Any, transition: Any, period: Any) -> tuple[Any, Any]:
    """The offset and its rate one period on, critically damped towards zero: exact, and the rate has no jump."""
    slope, left = rate + offset / transition, np.exp(-period / transition)
    return (offset + slope * period) * left, (rate - slope * (period / transition)) * left


def _checked_modes(modes: Any) -> tuple[Mode, ...]:
    listed = [modes] if isinstance(modes, Mode) else list(modes)
    checked = tuple(_checked_mode(f"modes[{k}]", mode) for k, mode in enumerate(listed))
    times = [mode.time for mode in checked]
    if not times or times[0] != 0 or not (np.diff(times) > 0).all():
        raise ValueError(f"modes: expected times in s that rise from 0, got {times}")
    return checked


def _checked_mode(name: str, mode: Any) -> Mode:
    """The mode with S as its diagonal and a constant force as an array; a force on a position-controlled axis is refused."""
    if not isinstance(mode, Mode):
        raise ValueError(f"{name}: expected a Mode, got {mode!r}")
    S = np.array(mode.selection, dtype=float)
    diagonal = np.diag(S) if S.shape == (6, 6) else S
    is_diagonal = S.shape == (6,) or (S.shape == (6, 6) and bool((np.diag(diagonal) == S).all()))
    if not is_diagonal or not np.isin(diagonal, (0.0, 1.0)).all():
        raise ValueError(
            f"{name}: expected a selection of (6,) or diagonal (6, 6) zeros and ones, got {mode.selection!r}"
        )
    if not np.isfinite(mode.time):
        raise ValueError(f"{name}: expected a time in s, got {mode.time!r}")
    force = mode.force if callable(mode.force) else _checked_force(name, mode.force, diagonal)
    return Mode(diagonal, force, float(mode.time))


def _wanted(mode: Mode, t: float) -> np.ndarray:
    if not callable(mode.force):
        return np.asarray(mode.force)
    return _checked_force(f"force({t:g})", mode.force(t), np.asarray(mode.selection))


def _checked_force(name: str, force: Any, selection: np.ndarray) -> np.ndarray:
    f = np.array(force, dtype=float)
    if f.shape != (6,) or not np.isfinite(f).all():
        raise ValueError(f"{name}: expected a force of (6,) finite numbers in N, N m, got {force!r}")
    if (wrong := (f != 0) & (selection == 0)).any():
        got = ", ".join(f"{f[k]:g} on axis {k}" for k in np.flatnonzero(wrong))
        raise ValueError(f"{name}: expected no force on position-controlled axes, got {got}")
    return f


def _named(name: str, check: Callable[..., Any], *arguments: Any) -> Any:
    """What ``check`` gives; its complaint, which does not know the field, gets the field's name."""
    try:
        return check(*arguments)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
