"""The plant: an arm with friction, torque limits and joint stops."""

from dataclasses import dataclass, field, replace

import numpy as np

from k1607_pin.arm.arm import Arm

REST = 1e-3  # rad/s (m/s): speed over which Coulomb friction turns round, so that it has a value at rest


def plant_of(plant: "Plant | Arm") -> "Plant":
    """The plant itself, or one of an arm without friction, limits and stops.

    Raises
    ------
    ValueError
        It is neither.
    """
    if isinstance(plant, Plant):
        return plant
    if not isinstance(plant, Arm):
        raise ValueError(f"plant: expected a Plant or an Arm (load_k1607, load_urdf, load_example), got {plant!r:.80}")
    return Plant(plant)


@dataclass(frozen=True)
class Plant:
    """An arm as its motors meet it.

    Raises
    ------
    ValueError
        Friction, limits or stops of wrong shape, negative, or not finite (infinite torque limits are no limits).
    """

    arm: Arm
    viscous: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(n,) N m s: viscous friction; empty for none."""
    coulomb: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(n,) N m: Coulomb friction; empty for none. At rest it chatters by coulomb dt / 2 M unless the step dt is well below
    REST M / coulomb."""
    torque_limit: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(n,) N m: largest torque of each motor; empty for none."""
    stop_stiffness: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(n,) N m/rad of the stops at the arm's joint limits; empty for none. An explicit integrator of step dt needs it well
    below M/dt^2, M being what the joint moves."""
    stop_damping: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(n,) N m s of the stops, while touched; empty for none."""
    _lower: np.ndarray = field(init=False, repr=False, compare=False)
    _upper: np.ndarray = field(init=False, repr=False, compare=False)
    _has_stops: bool = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("viscous", "coulomb", "torque_limit", "stop_stiffness", "stop_damping"):
            default = np.inf if name == "torque_limit" else 0.0
            x = np.array(getattr(self, name), dtype=float)
            x = np.full(self.arm.n, default) if x.size == 0 else x
            finite = np.isfinite(x) | ((x == np.inf) & (name == "torque_limit"))
            if x.shape != (self.arm.n,) or not finite.all() or (x < 0).any():
                raise ValueError(f"{name}: expected ({self.arm.n},) numbers >= 0, got {getattr(self, name)!r}")
            object.__setattr__(self, name, x)
        object.__setattr__(self, "_lower", self.arm.lower)
        object.__setattr__(self, "_upper", self.arm.upper)
        object.__setattr__(self, "_has_stops", bool((self.stop_stiffness > 0).any() or (self.stop_damping > 0).any()))

    @classmethod
    def from_description(cls, arm: Arm, **others: np.ndarray) -> "Plant":
        """The arm with the joint friction that its description writes down (``<dynamics damping friction>`` of a URDF).

        ``others`` : torque limits and stops, as for `Plant`.
        """
        if not isinstance(arm, Arm):
            raise ValueError(f"arm: expected an Arm (load_k1607, load_urdf, load_example), got {arm!r:.80}")
        return cls(arm, **({"viscous": arm.damping, "coulomb": arm.friction} | others))

    def carrying(self, arm: Arm) -> "Plant":
        """The same plant with another arm, the loaded one say."""
        return replace(self, arm=arm)

    def motor_torque(self, tau: np.ndarray) -> np.ndarray:
        """(n,) N m that the motors give when asked for tau (n,)."""
        return np.clip(tau, -self.torque_limit, self.torque_limit)

    def loss_torque(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(n,) N m against the motion that turns energy into heat: friction, Coulomb's part smoothed over `REST`, and the
        stops' damping."""
        friction = self.viscous * v + self.coulomb * np.tanh(v / REST)
        return friction + self._stop_loss(self._beyond(q), v) if self._has_stops else friction

    def spring_torque(self, q: np.ndarray) -> np.ndarray:
        """(n,) N m: the stops' elastic part, towards the range."""
        return -self.stop_stiffness * self._beyond(q)

    def passive_torque(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(n,) N m that friction and stops add to the motors'."""
        torque = -self.loss_torque(q, v)
        return torque + self.spring_torque(q) if self._has_stops else torque

    def acceleration(
        self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, external: np.ndarray | float = 0.0
    ) -> np.ndarray:
        """(n,) rad/s^2 at q, v (n,) when the motors are asked for tau (n,) and the world adds ``external`` (n,) N m."""
        return self.arm.forward_dynamics(q, v, self.motor_torque(tau) + self.passive_torque(q, v) + external)

    def energy(self, q: np.ndarray, v: np.ndarray) -> float:
        """J: kinetic (rotors included), potential, and that of the stops' springs."""
        energy = self.arm.energy(q, v)
        return energy + float(self.stop_stiffness @ self._beyond(q) ** 2) / 2 if self._has_stops else energy

    def _beyond(self, q: np.ndarray) -> np.ndarray:
        """(n,) rad by which each joint is past its range, with its sign; 0 within."""
        return np.maximum(q - self._upper, 0.0) - np.maximum(self._lower - q, 0.0)

    def _stop_loss(self, beyond: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The stop's push less its elastic part; a stop pushes and never pulls."""
        spring = self.stop_stiffness * beyond
        push = spring + self.stop_damping * np.abs(np.sign(beyond)) * v
        return np.where(push * beyond > 0, push, 0.0) - spring
