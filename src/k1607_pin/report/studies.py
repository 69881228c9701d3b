"""Parts 1-3 of the report's section 5: the schemes of figures 4 and 9 on one set of test joint trajectories.

Upper loops difference the closed-form forward kinematics from sample to sample; lower loops use the Jacobian. Their
difference is what the report plots, and what decides how fast one must sample.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import brentq

from k1607_pin import data
from k1607_pin.kinematics import closed_form
from k1607_pin.kinematics import orientation as o

COMPONENTS = [f"v_{a}" for a in "xyz"] + [f"omega_{a}" for a in "xyz"]


@dataclass(frozen=True)
class TestTrajectory:
    """theta_i(t) = centre_i + amplitude_i sin(2 pi f t + phase_i): the test joint trajectories, not given in the report."""

    __test__ = False  # not a pytest class

    centre: np.ndarray
    """(7,) rad"""
    amplitude: np.ndarray
    """(7,) rad"""
    phase: np.ndarray
    """(7,) rad"""
    frequency: float
    """Hz, one for all joints"""
    duration: float
    """s"""

    def angles(self, t: np.ndarray) -> np.ndarray:
        """(..., 7) rad at times t (...) s."""
        return self.centre + self.amplitude * np.sin(self._argument(t))

    def velocities(self, t: np.ndarray) -> np.ndarray:
        """(..., 7) rad/s, differentiated by hand."""
        return self.amplitude * 2 * np.pi * self.frequency * np.cos(self._argument(t))

    def _argument(self, t: np.ndarray) -> np.ndarray:
        return 2 * np.pi * self.frequency * np.asarray(t)[..., None] + self.phase


def identified_trajectory() -> TestTrajectory:
    """The committed set: fitted so that every published maximum that can be met is met."""
    facts = data.load("identified")["test_trajectory"]
    centre, amplitude, phase = (np.deg2rad(facts[f"{key}_deg"]) for key in ("centre", "amplitude", "phase"))
    return TestTrajectory(centre, amplitude, phase, facts["timing"]["frequency_hz"], facts["timing"]["duration_s"])


def times(trajectory: TestTrajectory, period: float) -> np.ndarray:
    """Sampling instants 0, T, 2T, ... up to the duration, s.

    Raises
    ------
    ValueError
        period is not positive, or leaves fewer than three samples.
    """
    if not 0 < period <= trajectory.duration / 2:
        raise ValueError(f"period: expected more than 0 and at most {trajectory.duration / 2} s, got {period}")
    return np.arange(round(trajectory.duration / period) + 1) * period


class Scheme(NamedTuple):
    """How the upper loop differences poses: between the samples ``before`` and ``after`` the present one, in periods."""

    before: int
    after: int
    rotation: Callable[[np.ndarray], np.ndarray]
    """Angles of a small rotation, (N, 3, 3) -> (N, 3) rad."""

    def velocity(self, trajectory: TestTrajectory, t: np.ndarray, period: float) -> np.ndarray:
        """(N, 6) m/s and rad/s at times t (N,) s, from poses one or two periods apart; rotation increments as in (38)."""
        first, last = (
            closed_form.forward_kinematics(trajectory.angles(t + k * period)) for k in (self.before, self.after)
        )
        turn = self.rotation(last[:, :3, :3] @ np.swapaxes(first[:, :3, :3], -1, -2))
        return np.concatenate([last[:, :3, 3] - first[:, :3, 3], turn], axis=-1) / ((self.after - self.before) * period)


BACKWARD = Scheme(-1, 0, o.differential_rotation)
"""As the report does: differences over the last period, angles read off the matrix as in (35)."""

SCHEMES = {
    "backward, eq. (35)": BACKWARD,
    "backward, rotation vector": Scheme(-1, 0, o.rotation_vector),
    "central, eq. (35)": Scheme(-1, 1, o.differential_rotation),
    "central, rotation vector": Scheme(-1, 1, o.rotation_vector),
}
"""Central differences are of second order, and known one period late in a running controller."""


def part_1(trajectory: TestTrajectory, period: float, scheme: Scheme = BACKWARD) -> xr.Dataset:
    """Joint to Cartesian velocities, figure 4: differenced forward kinematics (upper loop) against the Jacobian (lower).

    Returns ``differenced``, ``jacobian`` and ``error`` (jacobian - differenced), each (time, component) in m/s and rad/s.
    """
    t = times(trajectory, period)[1:]
    upper, lower = scheme.velocity(trajectory, t, period), jacobian_velocity(trajectory, t)
    dims, units = ("time", "component"), {"units": "m/s (v), rad/s (omega)"}
    return xr.Dataset(
        {"differenced": (dims, upper, units), "jacobian": (dims, lower, units), "error": (dims, lower - upper, units)},
        coords={"time": ("time", t, {"units": "s"}), "component": COMPONENTS},
        attrs={"sampling_period_s": period},
    )


READINGS = {
    "late pseudo-inverse": "J^+ of the previous sample, J and the joint velocity of this one: the inverse is one period behind",
    "differenced angles": "J^+ and J of this sample, joint velocities differenced from the sampled angles",
    "same instant": "J^+, J and the exact joint velocity of this sample: does not depend on the period at all",
}
"""What figure 4's lower loop can mean; the report's contrast between 10 and 100 ms rules out the last one."""


def part_2(trajectory: TestTrajectory, period: float, reading: str = "late pseudo-inverse") -> xr.Dataset:
    """Cartesian to joint velocities, figure 4: the Jacobian's output through the pseudo-inverse (23).

    Returns ``pseudo_inverse``, ``joint_velocity`` and ``error``, each (time, joint) in rad/s, and the attribute
    ``relative_error``: the largest error of joint 1 over the largest speed of joint 1.
    """
    if reading not in READINGS:
        raise ValueError(f"reading: expected one of {', '.join(READINGS)}, got {reading!r}")
    t = times(trajectory, period)
    q, v = trajectory.angles(t), trajectory.velocities(t)
    J = closed_form.jacobian(q)
    inverse = np.linalg.pinv(J)
    used_inverse = inverse[:-1] if reading == "late pseudo-inverse" else inverse[1:]
    used_velocity = np.diff(q, axis=0) / period if reading == "differenced angles" else v[1:]
    back = np.einsum("tij,tjk,tk->ti", used_inverse, J[1:], used_velocity)
    dims, units = ("time", "joint"), {"units": "rad/s"}
    error = back - v[1:]
    return xr.Dataset(
        {
            "pseudo_inverse": (dims, back, units),
            "joint_velocity": (dims, v[1:], units),
            "error": (dims, error, units),
        },
        coords={"time": ("time", t[1:], {"units": "s"}), "joint": np.arange(1, 8)},
        attrs={
            "sampling_period_s": period,
            "reading": reading,
            "relative_error": float(np.abs(error[:, 0]).max() / np.abs(v[:, 0]).max()),
        },
    )


def part_3(trajectory: TestTrajectory, period: float) -> xr.Dataset:
    """Quaternion representation, figure 9: (33)-(34) on (38) against half the Jacobian's rotation in a period, (37).

    Returns ``quaternion``, ``jacobian`` and ``error`` (jacobian - quaternion) of (delta beta, delta gamma, delta xi), each
    (time, component), dimensionless.
    """
    t = times(trajectory, period)
    R = closed_form.forward_kinematics(trajectory.angles(t))[:, :3, :3]
    q = o.quaternion(R)
    upper = o.relative_quaternion_base(q[:-1], q[1:])
    upper = np.where(upper[:, :1] < 0, -upper, upper)[:, 1:]
    lower = jacobian_velocity(trajectory, t[1:])[:, 3:] * period / 2
    dims, units = ("time", "component"), {"units": "1"}
    return xr.Dataset(
        {"quaternion": (dims, upper, units), "jacobian": (dims, lower, units), "error": (dims, lower - upper, units)},
        coords={
            "time": ("time", t[1:], {"units": "s"}),
            "component": ["delta_beta", "delta_gamma", "delta_xi"],
        },
        attrs={"sampling_period_s": period},
    )


def maximum(result: xr.Dataset, component: str) -> float:
    """Largest absolute error of one component."""
    return float(np.abs(result["error"].sel(component=component)).max())


def worst_error(trajectory: TestTrajectory, period: float, scheme: Scheme) -> np.ndarray:
    """(6,) largest Part 1 errors, m/s and rad/s, over 1000 instants of one cycle: independent of where samples happen to fall."""
    t = np.arange(1000) / 1000 / trajectory.frequency
    return np.abs(jacobian_velocity(trajectory, t) - scheme.velocity(trajectory, t, period)).max(axis=0)


def sampling_study(trajectory: TestTrajectory, periods: np.ndarray) -> xr.Dataset:
    """Largest Part 1 error against the sampling period (periods, s), for each way of differencing, and what theory says.

    Returns ``error`` (scheme, period, component), its fitted log-log ``slope`` (scheme, component), the order that it should
    be, ``theoretical_slope`` (scheme), and ``leading_term`` (scheme, period, component): T/2 times the largest acceleration for
    backward, T^2/6 times the largest jerk for central differences. For central omega the axes' turning in a period adds a term of
    the same order, which is left out.
    """
    error = np.array([[worst_error(trajectory, T, scheme) for T in periods] for scheme in SCHEMES.values()])
    log_error = np.log(np.moveaxis(error, 1, 0)).reshape(len(periods), -1)
    slope = np.polynomial.polynomial.polyfit(np.log(periods), log_error, 1)[1].reshape(len(SCHEMES), 6)
    t, h = np.arange(1000) / 1000 / trajectory.frequency, 1e-3
    late, now, early = (jacobian_velocity(trajectory, t + k * h) for k in (1, 0, -1))
    acceleration = np.abs((late - early) / (2 * h)).max(axis=0)
    jerk = np.abs((late - 2 * now + early) / (h * h)).max(axis=0)
    order = [1 if scheme.after == 0 else 2 for scheme in SCHEMES.values()]
    T = periods[:, None]
    leading = np.array([T / 2 * acceleration if k == 1 else T * T / 6 * jerk for k in order])
    units = {"units": "m/s (v), rad/s (omega)"}
    return xr.Dataset(
        {
            "error": (("scheme", "period", "component"), error, units),
            "leading_term": (("scheme", "period", "component"), leading, units),
            "slope": (("scheme", "component"), slope, {"units": "1"}),
            "theoretical_slope": ("scheme", order, {"units": "1"}),
        },
        coords={"scheme": list(SCHEMES), "component": COMPONENTS, "period": ("period", periods, {"units": "s"})},
    )


def largest_period(trajectory: TestTrajectory, component: str, tolerance: float, scheme: Scheme = BACKWARD) -> float:
    """The largest sampling period, s, at which the Part 1 error of ``component`` stays within ``tolerance`` (m/s or rad/s).

    Searched between 0.1 ms and 0.5 s; the ends are returned when it lies beyond.
    """
    which = COMPONENTS.index(component)

    def excess(log_period: float) -> float:
        return float(np.log(worst_error(trajectory, float(np.exp(log_period)), scheme)[which] / tolerance))

    low, high = np.log(1e-4), np.log(0.5)
    if excess(low) > 0:
        return 1e-4
    if excess(high) < 0:
        return 0.5
    return float(np.exp(brentq(excess, low, high, xtol=1e-6)))


class Reading(NamedTuple):
    """One way to read Part 3's published maxima, and what it gives."""

    reading: str
    delta_beta: float
    """Largest error of delta beta at 100 ms, thousandths."""
    delta_gamma: float
    """Largest error of delta gamma at 100 ms, thousandths."""
    remark: str
    """What it would mean elsewhere."""


def delta_beta_readings(trajectory: TestTrajectory, period: float = 0.1) -> list[Reading]:
    """Figure 11's 15 thousandths for delta beta, against every reading that might explain it.

    By (37) the error of delta beta is T/2 times that of omega_x, whatever the trajectory, to third order in the angle turned in a
    period: figure 6's 5 thousandths allow 0.25.
    """
    t = times(trajectory, period)
    q = o.quaternion(closed_form.forward_kinematics(trajectory.angles(t))[:, :3, :3])
    omega = jacobian_velocity(trajectory, t[1:])[:, 3:]
    base = o.relative_quaternion_base(q[:-1], q[1:])[:, 1:]
    body = o.relative_quaternion_body(q[:-1], q[1:])[:, 1:]
    error = base - period / 2 * omega

    def largest(e: np.ndarray) -> tuple[float, float]:
        return float(np.abs(e[:, 0]).max() * 1e3), float(np.abs(e[:, 1]).max() * 1e3)

    xi = float(np.abs(error[:, 2]).max() * 1e3)
    as_printed = largest(error)
    finer = part_3(trajectory, period / 10)
    return [
        Reading("as printed: (33)-(34) against (37)", *as_printed, "agrees with figure 6"),
        Reading(
            "the curve is delta xi, about z", xi, as_printed[1], "agrees with figures 5 to 8 too: a slip of one letter"
        ),
        Reading("delta beta in degrees", *largest(np.rad2deg(error)), "only if delta gamma is in another unit"),
        Reading("per minute", *largest(60 * error), "only if delta gamma is not; no reason for minutes"),
        Reading("a rate, as the printed unit '/sec' says", *largest(error / period), ""),
        Reading(
            "factor 2 of (37) forgotten",
            *largest(base - period * omega),
            "of first order in T: not negligible at 10 ms",
        ),
        Reading(
            "tool frame: R1^T R2, omega in base axes", *largest(body - period / 2 * omega), "of first order in T, too"
        ),
        Reading(
            "15 and 0.15: delta beta at 100 and at 10 ms",
            as_printed[0],
            maximum(finer, "delta_beta") * 1e3,
            "100 times apart, as T^2 has it, but neither by figure 6",
        ),
    ]


def jacobian_velocity(trajectory: TestTrajectory, t: np.ndarray) -> np.ndarray:
    """(N, 6) m/s and rad/s: J q_dot at times t (N,), the lower loop of figures 4 and 9."""
    return np.einsum("tij,tj->ti", closed_form.jacobian(trajectory.angles(t)), trajectory.velocities(t))
