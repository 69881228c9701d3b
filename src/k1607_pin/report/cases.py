"""Study cases 1 and 2, ready to run: what the report gives of them, and what it does not, from `data/study_cases.toml`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
import xarray as xr

from k1607_pin import data
from k1607_pin.arm.arm import Arm
from k1607_pin.arm.inverse import inverse_kinematics
from k1607_pin.arm.load import load_k1607
from k1607_pin.arm.payload import Payload
from k1607_pin.arm.reach import Followed, UnreachableError, follow
from k1607_pin.arm.ready import ready_postures
from k1607_pin.compiled.rollout import Rollouts, rollouts
from k1607_pin.control import posture
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.reference_model import ReferenceModel, reference_model
from k1607_pin.description.units import INCH, POUND
from k1607_pin.paths.report_paths import Circle, Line
from k1607_pin.report.starts import rotation as tool_rotation
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.simulate import Observer, simulate

SETTINGS = ("report", "recommended")
STARTS = 20  # postures of an unknown arm that are tried
CLEAR = 0.4  # of the start's smallest singular value: what must be left of it all along the path


@dataclass(frozen=True)
class StudyCase:
    """All that a run needs; change what you like with `dataclasses.replace`."""

    number: int
    """1, the straight line, or 2, the circle."""
    plant: Plant
    law: CartesianAdaptive
    q0: np.ndarray
    """(n,) rad at the start, at rest on the path"""
    duration: float
    """s"""
    payload: Payload
    """carried from a third of the duration to two thirds"""
    from_rest: bool
    """whether it was at rest when gripped"""
    physics_step: float
    """s, of fourth-order Runge-Kutta: short enough that a shorter one changes nothing that is shown"""

    @property
    def payloads(self) -> list[tuple[float, Payload]]:
        """What is carried from when on [s]."""
        T = self.law.period
        thirds = [round(k * self.duration / 3 / T) * T for k in (1, 2)]
        return [(thirds[0], self.payload), (thirds[1], Payload(0.0))]

    def rollouts(self, varied: Sequence[str], metrics: Mapping[str, Sequence[str]] | None = None) -> Rollouts:
        """The case for many runs at once: see `k1607_pin.rollouts`."""
        return rollouts(
            self.plant,
            self.law,
            self.duration,
            self.law.period,
            self.physics_step,
            runge_kutta_4,
            self.payloads,
            self.from_rest,
            varied=varied,
            metrics=metrics,
        )

    def run(self, progress: Callable[[float], None] | None = None, observe: Observer | None = None) -> xr.Dataset:
        """The run's log, as of `simulate`, whose errors it raises."""
        return simulate(
            self.plant,
            self.law,
            self.q0,
            self.duration,
            control_period=self.law.period,
            physics_step=self.physics_step,
            step=runge_kutta_4,
            payloads=self.payloads,
            from_rest=self.from_rest,
            observe=observe,
            progress=progress,
        )


def study_case(
    number: int,
    settings: str = "report",
    arm: Arm | None = None,
    q0: np.ndarray | None = None,
    payload: float | None = None,
    gravity: float | None = None,
    control_period: float | None = None,
) -> StudyCase:
    """Study case 1 (line) or 2 (circle).

    Parameters
    ----------
    settings : "report", which reproduces the published errors at 10 ms; or "recommended", ours for 1 kHz and full gravity.
    arm : None for the K-1607; any other takes the recommended settings, its paths in proportion to its own length.
    q0 : (n,) rad where to start, recommended settings only; None takes the case's own start, for another arm one far from a
        singularity from which the path can be followed.
    payload : kg; None for the report's 10 lb, in proportion to its mass for another arm.
    gravity : m/s^2 downwards; None for the settings' own. Not with ``arm``, which brings its own.
    control_period : s; None for the settings' own. The physics step follows.

    Raises
    ------
    ValueError
        No such case or settings; what does not go together; a start or path out of the arm's reach.
    """
    if number not in (1, 2):
        raise ValueError(f"number: expected study case 1 or 2, got {number!r}")
    if settings not in SETTINGS:
        raise ValueError(f"settings: expected one of {', '.join(SETTINGS)}, got {settings!r}")
    if settings == "report" and (arm is not None or q0 is not None):
        raise ValueError("settings: the report's are for the K-1607 and its own start; take settings='recommended'")
    if arm is not None and gravity is not None:
        raise ValueError("gravity: expected none beside an arm, which brings its own")
    for name, value in (("payload", payload), ("gravity", gravity)):
        if value is not None and not 0 <= value < np.inf:
            raise ValueError(f"{name}: expected a number >= 0, got {value!r}")
    if control_period is not None and not 0 < control_period < np.inf:
        raise ValueError(f"control_period: expected a positive time in s, got {control_period!r}")
    if settings == "report":
        return as_published(number, data.load("study_cases")["report"], payload, gravity, control_period)
    return _recommended(number, arm, q0, payload, gravity, control_period)


def section_7_2() -> ReferenceModel:
    """The reference model of section 7.2, with P_2 = P_3 = I/4."""
    design = data.load("published")["design"]
    six = np.ones(6)
    return reference_model(design["delta_1"] * six, design["delta_2"] * six, design["Q"] * np.eye(12))


def as_published(
    number: int,
    choice: dict[str, Any],
    payload: float | None = None,
    gravity: float | None = None,
    period: float | None = None,
) -> StudyCase:
    """A study case with what `study_cases.toml` has in its table "report", or the like of it; the rest as for `study_case`."""
    start, gains, choices = choice["start"], choice["gains"], choice["choices"]
    g = choices["gravity_m_s2"] if gravity is None else gravity
    arm = load_k1607(gravity=(0.0, 0.0, 0.0 - g), armature=choice["plant"]["armature_scale"] * load_k1607().armature)
    if not choices["joint_limits"]:
        arm = _without_limits(arm)
    rotation = tool_rotation(start["elevation_deg"], start["azimuth_deg"], start["roll_deg"])
    path, duration = _k1607_path(number, start["z0_in"], choice["line"]["duration_s"])
    q0 = _posture_at(arm, path(0.0).position, rotation, np.deg2rad(start[f"case{number}_deg"]))
    T = choices["control_period_s"] if period is None else period
    six = [
        np.diag([gains[f"{K}_{axis}_{units[0]}"] for axis in "xyz"] + [gains[f"{K}_{units[1]}"]] * 3)
        for K, units in (("K_p", ("N_m", "N_m_rad")), ("K_d", ("N_s_m", "N_m_s_rad")))
    ]
    law = CartesianAdaptive(arm, path, rotation, Gains(*six), section_7_2(), gains["beta_1"], gains["beta_2"], T)
    mass = data.load("published")["payload_lb"] * POUND if payload is None else payload
    plant = Plant(arm, viscous=np.full(arm.n, choice["plant"]["viscous_N_m_s"]))
    _require_whole(duration, T)
    held = Payload(mass, np.array([0.0, 0.0, choice["plant"]["payload_offset_in"] * INCH]))
    return StudyCase(number, plant, law, q0, duration, held, choices["from_rest"], _step(T, choices["physics_step_s"]))


def _recommended(number: int, arm: Any, q0: Any, payload: Any, gravity: Any, period: Any) -> StudyCase:
    facts, choice = data.load("published"), data.load("study_cases")["recommended"]
    mass = facts["payload_lb"] * POUND if payload is None else payload
    if arm is None and q0 is None:
        arm = load_k1607(gravity=(0.0, 0.0, 0.0 - (choice["gravity_m_s2"] if gravity is None else gravity)))
        rotation = np.diag([1.0, -1.0, -1.0])  # the tool points down
        path, duration = _k1607_path(number, choice["z0_in"], choice["line_duration_s"])
        q0 = _posture_at(arm, path(0.0).position, rotation, np.deg2rad(choice[f"case{number}_deg"]))
        way = follow(arm, path, rotation, q0, duration)
    else:
        arm = arm or load_k1607(gravity=(0.0, 0.0, 0.0 - (choice["gravity_m_s2"] if gravity is None else gravity)))
        q0, rotation, path, duration, way = _somewhere(number, arm, q0, choice["line_duration_s"])
        if payload is None:
            mass *= _mass(arm) / _mass(load_k1607())
    T = choice["control_period_s"] if period is None else period
    omega = choice["omega_T"] / T
    _require_whole(duration, T)
    six = np.ones(6)
    # Delta as the initial gains make the error behave; Q so that P_2 = I and P_3 = I / omega: both errors weigh alike at omega
    model = reference_model(omega**2 * six, 2 * omega * six, np.diag([2 * omega**2] * 6 + [2.0] * 6))
    gains = gains_from_inertia(arm, way.postures, omega)
    lightest = np.linalg.eigvalsh(gains.K_p)[0]  # one beta serves all directions: the softest bears least
    # errors are as 1 / omega^2, their rates as 1 / omega: so much must beta grow for the gains to move by the same share
    faster = omega * choice["control_period_s"] / choice["omega_T"]
    beta_1, beta_2 = choice["beta_1_share"] * faster**4 * lightest, choice["beta_2_share"] * faster**2 * lightest
    law = CartesianAdaptive(
        arm,
        path,
        rotation,
        gains,
        model,
        beta_1,
        beta_2,
        T,
        posture.along(way.times, way.postures, choice["posture_omega"]),
    )
    return StudyCase(number, Plant(arm), law, q0, duration, Payload(mass), False, _step(T, choice["physics_step_s"]))


def _somewhere(
    number: int, arm: Arm, q0: np.ndarray | None, line_duration: float
) -> tuple[np.ndarray, np.ndarray, Line | Circle, float, Followed]:
    """A start, its orientation, a path in proportion to the arm, its duration, and postures along it.

    The first of the candidates that can follow within its limits and well clear of singularities.
    """
    candidates = ready_postures(arm)[:STARTS] if q0 is None else [arm.as_vector(q0, "q0")]
    extent = _length(arm) / _length(load_k1607()) * np.array([9.0, 18.0, 0.0]) * INCH
    trouble: Exception | None = None
    for q in candidates:
        T = arm.forward_kinematics(q)
        x = T.translation
        path: Line | Circle = Line(x, extent)
        if number == 2:
            path = Circle(float(x[2]), float(np.hypot(x[0], x[1])), phi_0=float(np.arctan2(x[1], x[0])))
        duration = path.times[2] if isinstance(path, Circle) else line_duration
        try:
            way = follow(arm, path, T.rotation, q, duration)
        except UnreachableError as error:
            trouble = trouble or error
            continue
        if not way.jumps and way.sigma_min.min() > CLEAR * way.sigma_min[0]:
            return q, T.rotation, path, duration, way
    raise trouble or ValueError(
        f"path: of {len(candidates)} starts {arm.name!r} follows case {number}'s from none within its joint limits and clear of "
        "singularities"
    )


def _k1607_path(number: int, z0_in: float, line_duration: float) -> tuple[Line | Circle, float]:
    facts = data.load("published")
    if number == 1:
        case = facts["case1"]
        start, end = (np.array([case[f"x{k}_in"], case[f"y{k}_in"], z0_in]) * INCH for k in "0f")
        return Line(start, end - start), line_duration
    circle = Circle(z0_in * INCH, facts["case2"]["radius_in"] * INCH)
    return circle, circle.times[2]


def _without_limits(arm: Arm) -> Arm:
    """The arm with every joint free to turn once round either way."""
    model = arm.model
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -2 * np.pi, 2 * np.pi
    return arm.with_model(model)


def _posture_at(arm: Arm, position: np.ndarray, rotation: np.ndarray, near: np.ndarray) -> np.ndarray:
    found = inverse_kinematics(arm, pin.SE3(rotation, position), near)
    if not found.converged:
        raise ValueError(f"start: {arm.name!r} cannot hold its tool at {np.round(position, 4).tolist()} m as wanted")
    return found.q


def _require_whole(duration: float, period: float) -> None:
    if abs(round(duration / period) * period - duration) > 1e-9 * duration:
        raise ValueError(f"control_period: expected a whole part of the case's {duration:g} s, got {period!r} s")


def _step(period: float, longest: float) -> float:
    """s: a whole part of the period, no longer than ``longest``."""
    return period / np.ceil(period / longest - 1e-9)


def _length(arm: Arm) -> float:
    """m from the base along the joints' origins to the tool: what an arm measures in all."""
    q = np.zeros(arm.n)
    points = [np.zeros(3), *(T.translation for T in arm.frames(q)), arm.forward_kinematics(q).translation]
    return float(sum(np.linalg.norm(b - a) for a, b in pairwise(points)))


def _mass(arm: Arm) -> float:
    """kg that move"""
    return float(sum(arm.model.inertias[i].mass for i in range(1, arm.n + 1)))
