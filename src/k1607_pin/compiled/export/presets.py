"""Controllers to export for an arm of which no more is known: ours for full gravity, with gains for a posture far from singular.

What is made up here (path, modes, sensor) is an argument of the exported functions; it shapes them and makes states to test at.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from k1607_pin import data
from k1607_pin.arm.arm import Arm
from k1607_pin.arm.ready import ready_postures
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.hybrid import HybridAdaptive, Mode, hybrid_gains
from k1607_pin.control.joint_space import JointAdaptive, gains_from_mass, model_from_mass
from k1607_pin.control.posture import Posture, hold
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import ReferenceModel, reference_model
from k1607_pin.paths.joint_plan import JointPoint
from k1607_pin.paths.report_paths import Line

STIFFEST = np.array([1e5] * 3 + [1e3] * 3)  # N/m, N m/rad: contact that the hybrid law's gains are made for
FORCE_OMEGA = 200.0  # 1/s, at most; and 0.2 / period, which (H12) of docs/hybrid.md holds on all arms that were tried
GAIN_BOUND = 0.8
SWAY = 0.3  # rad
OFF_TOOL = np.array([0.01] * 3 + [0.05] * 3)  # m, rad: off by so much, the torques stay within their limits
OFF_JOINT = 0.02  # rad (m), likewise


@dataclass(frozen=True)
class Swaying:
    """A joint path about a posture (n,) rad, so that position and velocity are not constant."""

    middle: np.ndarray

    def __call__(self, t: float) -> JointPoint:
        """At time t [s]."""
        s, c = SWAY * np.sin(t) * np.ones(len(self.middle)), SWAY * np.cos(t) * np.ones(len(self.middle))
        return JointPoint(self.middle + s, c, -s)


def stand_in_for_sensor(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(6,) N, N m, some wrench or other at time t [s] and q, v (n,)."""
    return 10.0 * np.sin(t + np.arange(6.0) + np.sum(q) + np.sum(v))


def cartesian(arm: Arm, period: float) -> CartesianAdaptive:
    """The Cartesian scheme, with gravity compensated, torques limited and, where joints are left over, a posture kept."""
    q = ready_postures(arm)[0]
    omega = _omega(period, _loads(arm, q, _tool_unit_torques(arm, q)))
    start, gains = arm.forward_kinematics(q), gains_from_inertia(arm, q, omega)
    beta_1, beta_2 = (rate * np.linalg.eigvalsh(gains.K_p)[0] for rate in _rates(omega))
    return CartesianAdaptive(
        arm, Line(start.translation), start.rotation, gains, _model(omega), beta_1, beta_2, period, _posture(arm, q),
        practice=_practice(arm),
    )  # fmt: skip


def joint(arm: Arm, period: float) -> JointAdaptive:
    """The joint-space scheme, with gravity compensated and torques limited."""
    q = ready_postures(arm)[0]
    omega = _omega(period, _loads(arm, q, OFF_JOINT * arm.mass_matrix(q)))
    beta_1, beta_2 = (rate * omega**2 for rate in _rates(omega))
    return JointAdaptive(
        arm, Swaying(q), gains_from_mass(arm, q, omega), model_from_mass(arm, q, omega), beta_1, beta_2, period,
        _practice(arm),
    )  # fmt: skip


def hybrid(arm: Arm, period: float) -> HybridAdaptive:
    """The hybrid scheme, likewise; gains of examples/wall.py."""
    q = ready_postures(arm)[0]
    start = arm.forward_kinematics(q)
    omega = min(0.06 / period, _omega(period, _loads(arm, q, _tool_unit_torques(arm, q))))
    force_omega = min(FORCE_OMEGA, 0.2 / period)
    gains, force_gains = hybrid_gains(arm, q, STIFFEST, omega=omega, force_omega=force_omega)
    push = Mode(selection=(1, 0, 0, 0, 0, 0), force=(20.0, 0, 0, 0, 0, 0), time=0.1)
    force_model = reference_model(
        force_omega**2 * np.ones(6), 2 * force_omega * np.ones(6), np.diag([force_omega**2] * 6 + [0.2] * 6)
    )
    return HybridAdaptive(
        arm, Line(start.translation), start.rotation, (Mode(np.zeros(6)), push), stand_in_for_sensor, STIFFEST, gains,
        force_gains, reference_model(2 * np.ones(6), 3 * np.ones(6)), force_model, 1e5, 1e5, 1e-5, 1e-10, period,
        posture=_posture(arm, q), practice=_practice(arm), force_practice=Practice(gain_bound=GAIN_BOUND),
    )  # fmt: skip


LAWS: dict[str, Callable[[Arm, float], Any]] = {"cartesian": cartesian, "joint": joint, "hybrid": hybrid}


def law_of(arm: Arm, name: str, period: float) -> Any:
    """One of `LAWS` for an arm and a control period [s].

    Raises
    ------
    ValueError
        There is none of that name, a period that is not positive, an arm of fewer than six joints for a law of the tool.
    """
    if name not in LAWS:
        raise ValueError(f"law: expected one of {', '.join(LAWS)}, got {name!r}")
    if not 0 < period < np.inf:
        raise ValueError(f"period: expected a positive time in s, got {period!r}")
    if name != "joint" and arm.n < 6:
        raise ValueError(f"law: expected six joints or more for the {name} scheme, {arm.name!r} has {arm.n}")
    return LAWS[name](arm, period)


def _recommended() -> dict[str, Any]:
    return data.load("study_cases")["recommended"]


def _omega(period: float, loads: float) -> float:
    """1/s: as fast as the period allows, and so slow that what is off at the start asks for no more torque than there is."""
    return float(min(_recommended()["omega_T"] / period, np.sqrt(1 / loads) if loads > 0 else np.inf))


def _tool_unit_torques(arm: Arm, q: np.ndarray) -> np.ndarray:
    """(n, 6) N m s^2: torques per omega^2 for the tool off by `OFF_TOOL` along and about each axis."""
    J = arm.jacobian(q)
    Lambda = np.linalg.inv(J @ np.linalg.solve(arm.mass_matrix(q), J.T))
    return J.T @ Lambda * OFF_TOOL


def _loads(arm: Arm, q: np.ndarray, torques: np.ndarray) -> float:
    """s^2: the largest of the torques (n, m) over what the motors have left beside gravity, half of their limit at least."""
    left = np.maximum(arm.effort_limit - np.abs(arm.gravity_torque(q)), arm.effort_limit / 2)
    return float(np.max(np.abs(torques) / left[:, None])) if _limits_known(arm) else 0.0


def _limits_known(arm: Arm) -> bool:
    return bool(np.isfinite(arm.effort_limit).all() and (arm.effort_limit > 0).all())


def _rates(omega: float) -> tuple[float, float]:
    """beta_1 and beta_2 as a share of K_p(0): errors are as omega^-2, their rates as omega^-1."""
    choice = _recommended()
    faster = omega * choice["control_period_s"] / choice["omega_T"]
    return choice["beta_1_share"] * faster**4, choice["beta_2_share"] * faster**2


def _model(omega: float) -> ReferenceModel:
    six = np.ones(6)
    return reference_model(omega**2 * six, 2 * omega * six, np.diag([2 * omega**2] * 6 + [2.0] * 6))


def _posture(arm: Arm, q: np.ndarray) -> Posture | None:
    return hold(q, _recommended()["posture_omega"]) if arm.n > 6 else None


def _practice(arm: Arm) -> Practice:
    limit = arm.effort_limit if _limits_known(arm) else None
    return Practice(gravity=True, torque_limit=limit, gain_bound=GAIN_BOUND)
