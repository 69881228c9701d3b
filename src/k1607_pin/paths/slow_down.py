"""Time scaling: a planned motion in as much more time as the joints' velocity and torque limits ask for."""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from k1607_pin.arguments import as_floats, shown
from k1607_pin.arm.arm import Arm
from k1607_pin.paths.joint_plan import JointPlan
from k1607_pin.paths.spline import MOMENT

PERIOD = 0.005  # s, at which torques are looked at
LOOKS = 20_000  # instants at most: a plan of more than 100 s is looked at less often
Plan = TypeVar("Plan", bound=JointPlan)


class OverloadError(ValueError):
    """A posture on the way that the joints cannot even hold, at whatever speed."""

    def __init__(self, joint: str, time: float, torque: float, limit: float) -> None:
        self.joint, self.time, self.torque, self.limit = joint, time, torque, limit
        super().__init__(
            f"plan: joint {joint!r} would have to hold {torque:.4g} N m at t = {time:.4g} s, expected less than its limit of "
            f"{limit:.4g} N m; no slower motion changes that"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.joint, self.time, self.torque, self.limit)


@dataclass(frozen=True, eq=False)
class Slowed(Generic[Plan]):
    """A motion that the joints can follow."""

    plan: Plan
    factor: float
    """What the time was multiplied by, at least 1."""
    reason: str
    """What asked for that much; empty for nothing."""


def slow_down(
    arm: Arm,
    plan: Plan,
    velocity: np.ndarray | float | None = None,
    effort: np.ndarray | float | None = None,
) -> Slowed[Plan]:
    """The same way in the least time, but not less than planned, that keeps velocities and torques within their limits.

    The time is stretched evenly. By a factor c, velocities fall to 1/c, and of the torque what is not gravity to 1/c^2
    (Hollerbach, J. Dynamic Systems, Measurement and Control 106(1), 1984), so that the factor follows without a search: from
    velocities at any time, and from torques at instants 5 ms apart (further in plans of over 100 s) and on either side of the
    plan's own.

    Parameters
    ----------
    arm : with the payload it carries, if any; velocity, effort : (n,) or one number, rad/s and N m; default to the arm's own.
        A joint whose limit is zero or infinite, which is how a URDF leaves it open, has none.

    Raises
    ------
    ValueError
        Limits of wrong shape, negative or NaN; a plan that is none.
    OverloadError
        Gravity alone asks for more than the effort limit.
    """
    if not isinstance(plan, JointPlan):
        raise ValueError(
            f"plan: expected a JointPlan (plan_joints, joint_path, a PosePlan's .joints), got {shown(plan)}"
        )
    of_velocity = _limit(arm, "velocity", arm.velocity_limit if velocity is None else velocity)
    of_effort = _limit(arm, "effort", arm.effort_limit if effort is None else effort)
    (factor, reason), (other, why) = _for_velocity(arm, plan, of_velocity), _for_torque(arm, plan, of_effort)
    if other > factor:
        factor, reason = other, why
    return Slowed(plan.slower(factor), factor, reason) if factor > 1 else Slowed(plan, 1.0, "")


def _for_velocity(arm: Arm, plan: JointPlan, limit: np.ndarray) -> tuple[float, str]:
    lowest, highest = plan.spline.peaks(1)
    factors = np.maximum(-lowest.value, highest.value) / limit
    i = int(factors.argmax())
    t = (lowest if -lowest.value[i] > highest.value[i] else highest).time[i]
    return float(factors[i]), f"velocity of joint {arm.joint_names[i]!r} at t = {t:.4g} s of the plan"


def _for_torque(arm: Arm, plan: JointPlan, limit: np.ndarray) -> tuple[float, str]:
    ends = plan.spline.times
    even = np.linspace(0.0, plan.duration, min(int(np.ceil(plan.duration / PERIOD)), LOOKS) + 1)
    moment = min(MOMENT, float(np.diff(ends).min()) / 1000)
    times = np.clip(np.concatenate([even, ends - moment, ends + moment]), 0.0, plan.duration)
    q, v, a = plan(times)
    held = np.array([arm.gravity_torque(x) for x in q])  # (N, n)
    if (np.abs(held) >= limit).any():
        k, i = np.unravel_index((np.abs(held) / limit).argmax(), held.shape)
        raise OverloadError(arm.joint_names[i], float(times[k]), float(held[k, i]), float(limit[i]))
    moving = np.array([arm.inverse_dynamics(*one) for one in zip(q, v, a, strict=True)]) - held
    squares = np.maximum(moving / (limit - held), -moving / (limit + held))
    k, i = np.unravel_index(squares.argmax(), squares.shape)
    factor = float(np.sqrt(max(squares[k, i], 0.0)))
    return factor, f"torque of joint {arm.joint_names[i]!r} at t = {times[k]:.4g} s of the plan"


def _limit(arm: Arm, name: str, x: np.ndarray | float) -> np.ndarray:
    expected = f"one or ({arm.n},) limits"
    limit = as_floats(name, x, expected)
    if limit.shape not in ((), (arm.n,)) or np.isnan(limit).any() or (limit < 0).any():
        raise ValueError(f"{name}: expected {expected} >= 0, got {shown(x)}")
    return np.broadcast_to(np.where(limit > 0, limit, np.inf), arm.n)
