"""The K-1607 on its way along the report's line, under gravity and the Cartesian adaptive law."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.load import load_k1607
from k1607_pin.control.adaptation import Gains, gain_rates, proportional_derivative
from k1607_pin.control.cartesian import gains_from_inertia
from k1607_pin.control.pose import pose_error
from k1607_pin.dynamics import operational_space as dynamics
from k1607_pin.paths.report_paths import Line
from k1607_pin.report.sample_loops import design


class Motion(NamedTuple):
    """The arm at T times, and the loop around it; or at one, without the leading dimension."""

    time: Any
    """(T,) s"""
    q: Any
    """(T, 7) rad"""
    v: Any
    """(T, 7) rad/s"""
    a: Any
    """(T, 7) rad/s^2, Pinocchio's forward dynamics"""
    force: Any
    """(T, 6) F of (40): N, N m"""
    gains: Gains
    """(T, 6, 6) each"""
    gain_rates: Gains
    """(T, 6, 6) each"""
    z: Any
    """(T, 12) x_e, and its rate as the wanted less the actual twist"""
    wanted: Any
    """(T, 12) wanted twist and its rate"""


POSTURE = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
STIFFNESS = 8.0  # 1/s, of the initial gains
ARM_BETA = 1e5  # K_p' = ARM_BETA (P_2 x_e + P_3 x_e') x_e^T; not published
DURATION = 0.6  # s; the law holds the tool alone, and the elbow falls


@cache
def motion() -> Motion:
    """The motion, its gains adapted in continuous time, as the proof has it."""
    arm, model = load_k1607(), design()
    start = arm.forward_kinematics(POSTURE)
    line = Line(start.translation)
    J = arm.jacobian(POSTURE)
    v_0 = (np.eye(arm.n) - np.linalg.pinv(J) @ J) @ np.ones(arm.n)
    first = gains_from_inertia(arm, POSTURE, STIFFNESS)

    def at(t: float, state: np.ndarray) -> Motion:
        q, v, gains = state[:7], state[7:14], Gains(*state[14:].reshape(2, 6, 6))
        tool, J, point = arm.forward_kinematics(q), arm.jacobian(q), line(t)
        wanted = np.concatenate([point.velocity, np.zeros(3), point.acceleration, np.zeros(3)])
        x_e = pose_error(tool.translation, tool.rotation, point.position, start.rotation)
        v_e = wanted[:6] - J @ v
        force = proportional_derivative(gains, x_e, v_e)
        rates = gain_rates(model.P_2, model.P_3, ARM_BETA, ARM_BETA, x_e, v_e)
        a = arm.forward_dynamics(q, v, J.T @ force)
        return Motion(t, q, v, a, force, gains, rates, np.concatenate([x_e, v_e]), wanted)

    def flow(t: float, state: np.ndarray) -> np.ndarray:
        now = at(t, state)
        return np.concatenate([now.v, now.a, *map(np.ravel, now.gain_rates)])

    state = np.concatenate([POSTURE, v_0, *map(np.ravel, first)])
    times = np.linspace(0.02, DURATION, 30)
    states = solve_ivp(flow, (0, DURATION), state, "DOP853", times, rtol=1e-7, atol=1e-8).y.T
    return Motion(*(_stacked(x) for x in zip(*map(at, times, states), strict=True)))


def _stacked(samples: Any) -> Any:
    return Gains(*map(np.array, zip(*samples, strict=True))) if isinstance(samples[0], Gains) else np.array(samples)


def pose(arm: Arm, q: np.ndarray) -> np.ndarray:
    """(6,) x of (39): position and rotation vector."""
    T = arm.forward_kinematics(q)
    return np.concatenate([T.translation, pin.log3(T.rotation)])


def space(arm: Arm, q: np.ndarray, v: np.ndarray) -> dynamics.OperationalSpace:
    """(39) at one state, by the function that the registry names."""
    return dynamics.operational_space(
        arm.mass_matrix(q),
        arm.coriolis_matrix(q, v),
        arm.gravity_torque(q),
        arm.jacobian(q),
        arm.jacobian_time_variation(q, v),
        pose(arm, q),
        v,
    )


@cache
def arm_matrices() -> tuple[np.ndarray, np.ndarray]:
    """(3, T, 6, 6) Lambda, Phi, Gamma along the motion, and their rates by central differences."""
    arm, m, h = load_k1607(), motion(), 1e-5

    def matrices(shift: float) -> np.ndarray:
        states = zip(m.q + shift * m.v + shift**2 / 2 * m.a, m.v + shift * m.a, strict=True)
        spaces = [space(arm, q, v) for q, v in states]
        return np.array([[s.Lambda for s in spaces], [s.Phi for s in spaces], [s.Gamma for s in spaces]])

    return matrices(0.0), (matrices(h) - matrices(-h)) / (2 * h)
