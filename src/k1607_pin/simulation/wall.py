"""A compliant wall: a plane that pushes back, with stiffness and damping that may change in time, and Coulomb friction."""

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.wrench import Wrench
from k1607_pin.simulation.torques import REST


@dataclass(frozen=True)
class Wall:
    """A plane that the tool's origin may lean on: a point contact, so that no moment acts about the tool.

    While the tool is behind the plane by d > 0, the wall pushes along its normal by N = max(k d + c d', 0), never pulls, and rubs
    by mu N tanh(|v_t| / `REST`) against the tangential velocity v_t: at rest it does not hold, what is pushed along it creeps.

    Energy: `energy` is the spring's, k d^2 / 2. Damping and friction only take. A stiffness that changes while the wall is
    pressed in changes that energy without any motion, which somebody else pays for; and where damping alone would pull, the
    force is cut to zero, so that a fast retreat leaves some of the spring's energy in the wall.

    An explicit integrator of step dt needs k well below m / dt^2, and c and mu N / `REST` below m / dt, m the arm's effective
    mass at the tool.

    Raises
    ------
    ValueError
        Wrong shapes, a normal of no length, numbers that are negative or not finite, times out of order.
    """

    point: np.ndarray
    """(3,) m, any point of the plane, base axes"""
    normal: np.ndarray
    """(3,) out of the wall, towards the free side, base axes; any length, made a unit vector"""
    stiffness: Any
    """N/m: a number, or changes (time [s], value) and (time, value, ramp [s]) in order of time, the first value before them"""
    damping: Any = 0.0
    """N s/m, likewise"""
    friction: float = 0.0
    """mu, Coulomb's coefficient"""
    _stiffness: "Profile" = field(init=False, repr=False, compare=False)
    _damping: "Profile" = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("point", "normal"):
            x = np.array(getattr(self, name), dtype=float)
            if x.shape != (3,) or not np.isfinite(x).all():
                raise ValueError(f"{name}: expected (3,) finite numbers, got {getattr(self, name)!r}")
            object.__setattr__(self, name, x)
        length = np.linalg.norm(self.normal)
        if not length > 0:
            raise ValueError("normal: expected a vector that is not zero, got zero")
        object.__setattr__(self, "normal", self.normal / length)
        if not 0 <= self.friction < np.inf:
            raise ValueError(f"friction: expected a number >= 0, got {self.friction!r}")
        object.__setattr__(self, "_stiffness", Profile("stiffness", "N/m", self.stiffness))
        object.__setattr__(self, "_damping", Profile("damping", "N s/m", self.damping))

    of_time: ClassVar = ("stiffness_at", "damping_at")
    """Methods of time alone, for who traces the others"""

    def stiffness_at(self, t: float) -> float:
        """N/m at time t [s]."""
        return self._stiffness.at(t)

    def damping_at(self, t: float) -> float:
        """N s/m at time t [s]."""
        return self._damping.at(t)

    def depth(self, position: Any) -> Any:
        """m by which the position (3,) m, base axes, is behind the plane; negative on the free side."""
        return self.normal @ (self.point - position)

    def force(self, t: float, position: Any, velocity: Any) -> Any:
        """(3,) N of the wall on a point at ``position`` (3,) m moving at ``velocity`` (3,) m/s, base axes, at time t [s]."""
        depth, along_normal = self.depth(position), self.normal @ velocity
        push = np.maximum(self.stiffness_at(t) * depth - self.damping_at(t) * along_normal, 0.0)
        push = np.where(depth > 0, push, 0.0)
        sliding = velocity - along_normal * self.normal
        speed = np.sqrt(sliding @ sliding)
        rests = speed < 1e-6 * REST  # tanh(s / REST) / s has a limit at rest
        rub = self.friction * push * np.where(rests, 1 / REST, np.tanh(speed / REST) / np.where(rests, 1.0, speed))
        return push * self.normal - rub * sliding

    def energy(self, t: float, position: np.ndarray) -> float:
        """J in the wall's spring, with the tool at ``position`` (3,) m at time t [s]."""
        return self._stiffness.at(t) * max(float(self.depth(position)), 0.0) ** 2 / 2

    def wrench(self, arm: Arm, t: float, q: Any, v: Any) -> Any:
        """(6,) N, N m of the wall on the arm at its tool, base axes, at time t [s] and q, v (n,)."""
        force = self.force(t, arm.forward_kinematics(q).translation, arm.jacobian(q)[:3] @ v)
        return np.concatenate([force, np.zeros(3)])

    def sensor(self, arm: Arm) -> "WallPush":
        """`wrench` as a function of t, q, v: an ideal force sensor between tool and wall."""
        return WallPush(self, arm)

    def external(self, arm: Arm) -> "WallOn":
        """What `simulate` and `rollout` take as ``external``, for this arm's tool; None while it is off the wall."""
        return WallOn(self, arm)


@dataclass(frozen=True)
class WallPush:
    """Time [s], q, v (n,) -> (6,) N, N m of a wall on an arm at its tool, base axes."""

    wall: Wall
    arm: Arm

    def __call__(self, t: float, q: Any, v: Any) -> Any:
        """See `Wall.wrench`."""
        return self.wall.wrench(self.arm, t, q, v)


@dataclass(frozen=True)
class WallOn:
    """Time [s], q, v (n,) -> what a wall does to an arm's tool, or None."""

    wall: Wall
    arm: Arm

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> Wrench | None:
        """As `simulate` asks."""
        if self.wall.depth(self.arm.forward_kinematics(q).translation) <= 0:
            return None
        return Wrench(self.wrench(t, q, v)[:3])

    def wrench(self, t: float, q: Any, v: Any) -> Any:
        """(6,) N, N m at the tool, base axes; as `rollout` asks."""
        return self.wall.wrench(self.arm, t, q, v)


class Profile:
    """A number >= 0 over time: constant, or stepping and ramping linearly."""

    def __init__(self, name: str, unit: str, value: Any) -> None:
        """``value``: a number, or (time [s], value) and (time, value, ramp [s]), none before the one before is complete."""
        wanted = f"{name}: expected a number >= 0 in {unit}, or (time [s], value[, ramp >= 0 [s]]) in order of time"
        try:
            entries: list[Any] = [(0.0, value)] if np.isscalar(value) else list(value)
            changes = [tuple(float(x) for x in (*e, 0.0)[:3]) for e in entries]
            numbers = np.array(changes).reshape(-1, 3)
        except (TypeError, ValueError):
            raise ValueError(f"{wanted}, got {value!r}") from None
        in_order = (numbers[1:, 0] >= numbers[:-1, 0] + numbers[:-1, 2]).all()
        if not changes or not np.isfinite(numbers).all() or (numbers[:, 1:] < 0).any() or not in_order:
            raise ValueError(f"{wanted}, got {value!r}")
        self._changes = changes

    def at(self, t: float) -> float:
        """The value at time t [s]."""
        now = self._changes[0][1]
        for time, value, ramp in self._changes:
            if t < time:
                break
            share = 1.0 if ramp == 0 else min(1.0, (t - time) / ramp)
            now = now + share * (value - now)
        return now
