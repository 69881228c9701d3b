"""An arm on its way along a path of its tool, step by step: posture, velocity and acceleration that continue the ones before."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize_scalar

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.inverse import InverseKinematics, inverse_kinematics, pose_error, sigma_min_of
from k1607_pin.arm.reach import CLOSE, UnreachableError
from k1607_pin.kinematics.task import POSE, ROWS, Task
from k1607_pin.paths.joint_plan import require_within_limits
from k1607_pin.paths.spline import MOMENT, Spline, through

MARGIN = 0.1  # of a joint's range, in which it is held back
LEAST = 1e-4  # what is left of W at a limit, so that a joint that starts there can leave it
NEWTON_STEPS = 8
NEWTON_TOLERANCE = 1e-12  # m, rad
LEAP = 0.3  # rad (m): a correction by more is another posture
NEAR = 10  # times the threshold: more than sigma_min changes between two samples, on its way to a singularity
LOOKS = 20  # points ahead that are looked at for being out of reach
BISECTIONS = 5  # between the first that is and the one before
STARTS = 10  # postures that a point is tried from


class SingularPathError(ValueError):
    """A path that leads through a singularity, or too close to one."""

    def __init__(self, time: float, position: np.ndarray, sigma_min: float, threshold: float) -> None:
        self.time, self.position, self.sigma_min, self.threshold = time, position, sigma_min, threshold
        super().__init__(
            f"path: singular, or close to it, at {np.round(position, 4).tolist()} m, t = {time:.4g} s: smallest singular value "
            f"of J {sigma_min:.3g}, expected at least {threshold:.3g}"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.time, self.position, self.sigma_min, self.threshold)


class TooFewJointsError(SingularPathError):
    """A task of more rows than the arm has joints."""

    def __init__(self, arm: Arm, task: Task, position: np.ndarray) -> None:
        self.time, self.position, self.sigma_min, self.threshold = 0.0, position, 0.0, 0.0
        self._arm, self._task = arm, task
        fits = [f'task="{kind}"' for kind, rows in sorted(ROWS.items(), key=lambda x: x[1]) if rows <= arm.n]
        advice = f"pass {' or '.join(fits)}" if fits else "plan its joints instead, with plan_joints"
        ValueError.__init__(
            self,
            f"task: expected one that the {arm.n} joints of {arm.name!r} can follow, "
            f'got "{task.name}" of {task.size} rows; {advice}',
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self._arm, self._task, self.position)


class Wanted(NamedTuple):
    """The tool at one sample."""

    time: float
    pose: pin.SE3
    velocity: np.ndarray  # (6,)
    after: np.ndarray  # (6,) acceleration just after
    before: np.ndarray  # (6,) and just before


class State(NamedTuple):
    """The joints at one sample."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    a_before: np.ndarray  # the acceleration on arrival
    sigma: float


class Follower:
    """An arm on its way along a path."""

    def __init__(
        self, arm: Arm, path: Callable[[float], Any], rotation: np.ndarray, threshold: float, task: Task = POSE
    ) -> None:
        self.arm, self.path, self.rotation, self.threshold, self.task = arm, path, rotation, threshold, task
        self.lower, self.upper = arm.lower, arm.upper
        span = self.upper - self.lower
        self.margin = MARGIN * np.where(np.isfinite(span), span, 2 * np.pi)

    def start(self, q0: np.ndarray) -> State:
        wanted = self.wanted(0.0)
        if self.arm.n < self.task.size:
            raise TooFewJointsError(self.arm, self.task, wanted.pose.translation)
        found = inverse_kinematics(self.arm, wanted.pose, q0, task=self.task)
        if not found.converged:
            raise UnreachableError(self.arm, 0.0, wanted.pose.translation, found)
        return self.motion(wanted, found.q)

    def step(self, last: State, before: float, t: float) -> tuple[State, np.ndarray]:
        """The next state, and by how much, (2,) m and rad, the tool is off the path in between; infinitely if there is none.

        Taylor's polynomial, corrected once by Hermite's rule: of third order in all, and each time onto the exact pose.
        """
        h, wanted = t - before, self.wanted(t)
        q = self.onto(wanted.pose, last.q + h * (last.v + h / 2 * last.a))
        if q is not None:
            state = self.motion(wanted, q)
            q = self.onto(wanted.pose, last.q + h / 2 * (last.v + state.v) + h * h / 12 * (last.a - state.a_before))
        if q is None:
            return last, np.full(2, np.inf)
        state = self.motion(wanted, q)
        require_within_limits(self.arm, q, t, wanted.pose.translation)
        # at a third: halfway, errors of the two ends' velocities cancel
        between = joined(np.array([0.0, h]), [last, state])(h / 3)
        error = pose_error(self.pose(before + h / 3), self.arm.forward_kinematics(between), self.task)
        return state, np.array([np.linalg.norm(error[:3]), np.linalg.norm(error[3:])])

    def onto(self, wanted: pin.SE3, guess: np.ndarray) -> np.ndarray | None:
        """(n,): the posture next to ``guess`` that is exactly on the path."""
        q = guess
        for _ in range(NEWTON_STEPS):
            actual = self.arm.forward_kinematics(q)
            error = pose_error(wanted, actual, self.task)
            if np.abs(error).max() < NEWTON_TOLERANCE:
                return q
            J = self.task.rows(self.arm.jacobian(q), actual.rotation)
            K = self.weights(q)[0][:, None] * J.T
            try:
                q = q + K @ np.linalg.solve(J @ K, error)
            except np.linalg.LinAlgError:
                return None
            if not np.abs(q - guess).max() <= LEAP:  # NaN too
                return None
        return None

    def motion(self, wanted: Wanted, q: np.ndarray) -> State:
        """Velocity by (22), and acceleration as its derivative, the change of W and J included."""
        J, sigma = self.jacobian(wanted.time, q)
        R, task = self.arm.forward_kinematics(q).rotation, self.task
        share, slope = self.weights(q)
        K = share[:, None] * J.T  # (n, m)
        A = J @ K  # (m, m)
        force = np.linalg.solve(A, task.rows(wanted.velocity, R))  # (m,)
        v = K @ force
        J_dot = task.rows(self.arm.jacobian_time_variation(q, v), R)
        if task.name == "axis":  # its rows turn with the tool
            whole = self.arm.jacobian(q)
            R_dot = np.cross((whole @ v)[3:], R, axisb=0, axisc=0)
            J_dot = J_dot + turned(task, whole, R_dot)
        drift = slope * v * (J.T @ force) + share * (J_dot.T @ force)  # (n,): the acceleration, were `force` to stay
        bias = J_dot @ v + J @ drift
        if task.name == "axis":
            bias = bias - turned(task, wanted.velocity, R_dot)
        a, a_before = (
            drift + K @ np.linalg.solve(A, task.rows(x_ddot, R) - bias) for x_ddot in (wanted.after, wanted.before)
        )
        return State(q, v, a, a_before, sigma)

    def weights(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) each: the diagonal of W, and its derivative; twice differentiable."""
        to_lower, to_upper = q - self.lower, self.upper - q
        s = np.clip(np.minimum(to_lower, to_upper) / self.margin, 0.0, 1.0)
        share = LEAST + (1 - LEAST) * s**3 * (10 - 15 * s + 6 * s * s)
        slope = (1 - LEAST) * 30 * (s * (1 - s)) ** 2 / self.margin
        return share, np.where(to_lower < to_upper, slope, -slope)

    def jacobian(self, t: float, q: np.ndarray) -> tuple[np.ndarray, float]:
        """(m, n) the task's rows, and their smallest singular value, which is not below the threshold."""
        J = self.rows(q)
        sigma = sigma_min_of(J)
        if not sigma >= self.threshold:
            raise SingularPathError(t, self.pose(t).translation, sigma, self.threshold)
        return J, sigma

    def rows(self, q: np.ndarray) -> np.ndarray:
        """(m, n)"""
        rows: np.ndarray = self.task.rows(self.arm.jacobian(q), self.arm.forward_kinematics(q).rotation)
        return rows

    def pose(self, t: float) -> pin.SE3:
        return self.pose_of(self.path(t))

    def pose_of(self, point: Any) -> pin.SE3:
        R = getattr(point, "rotation", self.rotation)
        return pin.SE3(np.asarray(R, dtype=float), np.asarray(point.position, dtype=float))

    def wanted(self, t: float) -> Wanted:
        point, none = self.path(t), np.zeros(3)
        velocity = np.concatenate([point.velocity, getattr(point, "angular_velocity", none)])
        after, before = (
            np.concatenate([p.acceleration, getattr(p, "angular_acceleration", none)])
            for p in (self.path(t + MOMENT), self.path(max(t - MOMENT, 0.0)))
        )
        return Wanted(t, self.pose_of(point), velocity, after, before)

    def require_reach(self, first: float, last: float, q: np.ndarray) -> None:
        """Refuse a path of which a point from ``first`` to ``last`` [s] is out of reach, where it is first."""
        reached = first
        for t in np.linspace(first, last, LOOKS) if last > first else [first]:
            found = self.inverse(t, q)
            if not found.converged:
                break
            reached, q = t, found.q
        else:
            return
        for _ in range(BISECTIONS if t > first else 0):
            middle = (reached + t) / 2
            closer = self.inverse(middle, q)
            if closer.converged:
                reached, q = middle, closer.q
            else:
                t, found = middle, closer
        raise UnreachableError(self.arm, float(t), self.pose(t).translation, found)

    def inverse(self, t: float, q: np.ndarray) -> InverseKinematics:
        return inverse_kinematics(self.arm, self.pose(t), q, CLOSE, CLOSE, starts=STARTS, task=self.task)

    def refuse(self, t: float, error: np.ndarray, q: np.ndarray) -> None:
        """A point that the posture before does not lead on to."""
        self.require_reach(t, t, q)
        place = f"at {np.round(self.pose(t).translation, 4).tolist()} m, t = {t:.4g} s"
        if np.isfinite(error).all():
            raise ValueError(
                f"path: expected velocity and acceleration to be derivatives of the pose, but {place} they lead {error[0]:.2g} m "
                f"and {error[1]:.2g} rad away from it"
            )
        raise ValueError(f"path: expected a continuous one, but {self.arm.name!r} finds no way on {place}")

    def require_regular(self, spline: Spline, sigma: np.ndarray) -> None:
        """Refuse a path on which J is singular between two samples; sigma : at these."""
        times = spline.times
        for k in range(1, len(times) - 1):
            if sigma[k - 1] > sigma[k] <= sigma[k + 1] and sigma[k] < NEAR * self.threshold:
                closest = minimize_scalar(
                    lambda t: sigma_min_of(self.rows(spline(t))),
                    bounds=(times[k - 1], times[k + 1]),
                    method="bounded",
                    options={"xatol": 1e-6},
                )
                self.jacobian(float(closest.x), spline(closest.x))


def turned(task: Task, twist: np.ndarray, R_dot: np.ndarray) -> np.ndarray:
    """(m,) or (m, n): what the rows of ``twist`` (6,) or (6, n) change by as the tool's rotation does; they are linear in it."""
    rates: np.ndarray = task.rows(twist, R_dot)
    rates[:3] = 0
    return rates


def joined(times: np.ndarray, states: list[State]) -> Spline:
    """Through states at the given times."""
    q, v, a, a_before = (np.array(x) for x in list(zip(*states, strict=True))[:4])
    return through(times, q, v, a, a_before)
