"""The plant: an arm with friction and torque limits."""

from dataclasses import dataclass, field

import numpy as np

from k1607_pin.arm.arm import Arm

REST = 1e-3  # rad/s (m/s): speed over which Coulomb friction turns round, so that it has a value at rest


@dataclass(frozen=True)
class Plant:
    """An arm as its motors meet it.

    Raises
    ------
    ValueError
        Friction or limits of wrong shape, negative, or not finite (infinite limits are no limits).
    """

    arm: Arm
    viscous: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(n,) N m s: viscous friction; empty for none."""
    coulomb: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(n,) N m: Coulomb friction; empty for none."""
    torque_limit: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(n,) N m: largest torque of each motor; empty for none."""

    def __post_init__(self) -> None:
        for name, default in (("viscous", 0.0), ("coulomb", 0.0), ("torque_limit", np.inf)):
            x = np.array(getattr(self, name), dtype=float)
            x = np.full(self.arm.n, default) if x.size == 0 else x
            finite = np.isfinite(x) | ((x == np.inf) & (name == "torque_limit"))
            if x.shape != (self.arm.n,) or not finite.all() or (x < 0).any():
                raise ValueError(f"{name}: expected ({self.arm.n},) numbers >= 0, got {getattr(self, name)!r}")
            object.__setattr__(self, name, x)

    def friction(self, v: np.ndarray) -> np.ndarray:
        """(n,) N m against the motion at joint velocities v (n,); Coulomb's part smoothed over `REST`."""
        return self.viscous * v + self.coulomb * np.tanh(v / REST)

    def motor_torque(self, tau: np.ndarray) -> np.ndarray:
        """(n,) N m that the motors give when asked for tau (n,)."""
        return np.clip(tau, -self.torque_limit, self.torque_limit)

    def acceleration(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """(n,) rad/s^2 at q, v (n,) when the motors are asked for tau (n,) N m."""
        return self.arm.forward_dynamics(q, v, self.motor_torque(tau) - self.friction(v))

    def energy(self, q: np.ndarray, v: np.ndarray) -> float:
        """J: kinetic (rotors included) and potential energy."""
        return self.arm.energy(q, v)
