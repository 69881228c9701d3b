"""The plant: an arm with friction, torque limits and joint stops."""

from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

import numpy as np

from k1607_pin.arguments import as_floats, numbers, seen_through, shown
from k1607_pin.arm.arm import UNITS, Arm
from k1607_pin.simulation import torques

FLOAT = np.dtype(float)


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
        raise ValueError(f"plant: expected a Plant or an Arm (load_k1607, load_urdf, load_example), got {shown(plant)}")
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
    `torques.REST` M / coulomb."""
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
        _require_arm(self.arm)
        n = self.arm.n
        for name in ("viscous", "coulomb", "torque_limit", "stop_stiffness", "stop_damping"):
            default = np.inf if name == "torque_limit" else 0.0
            x = np.array(as_floats(name, getattr(self, name), f"({n},) numbers >= 0"))
            x = np.full(n, default) if x.size == 0 else x
            finite = np.isfinite(x) | ((x == np.inf) & (name == "torque_limit"))
            if x.shape != (n,) or not finite.all() or (x < 0).any():
                raise ValueError(f"{name}: expected ({n},) numbers >= 0, got {shown(getattr(self, name))}")
            object.__setattr__(self, name, x)
        object.__setattr__(self, "_lower", self.arm.lower)
        object.__setattr__(self, "_upper", self.arm.upper)
        object.__setattr__(self, "_has_stops", bool((self.stop_stiffness > 0).any() or (self.stop_damping > 0).any()))

    @classmethod
    def from_description(cls, arm: Arm, **others: np.ndarray) -> "Plant":
        """The arm with the joint friction that its description writes down (``<dynamics damping friction>`` of a URDF).

        ``others`` : torque limits and stops, as for `Plant`.
        """
        _require_arm(arm)
        return cls(arm, **({"viscous": arm.damping, "coulomb": arm.friction} | others))

    def carrying(self, arm: Arm) -> "Plant":
        """The same plant with another arm, the loaded one say."""
        return replace(self, arm=arm)

    def motor_torque(self, tau: np.ndarray) -> np.ndarray:
        """(n,) N m that the motors give when asked for tau (n,)."""
        return torques.motor(self, *self._vectors(("tau",), tau))

    def loss_torque(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(n,) N m against the motion that turns energy into heat: friction, Coulomb's part smoothed over `torques.REST`, and the
        stops' damping."""
        return torques.loss(self, *self._vectors(("q", "v"), q, v))

    def spring_torque(self, q: np.ndarray) -> np.ndarray:
        """(n,) N m: the stops' elastic part, towards the range."""
        return torques.spring(self, *self._vectors(("q",), q))

    def passive_torque(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(n,) N m that friction and stops add to the motors'."""
        return torques.passive(self, *self._vectors(("q", "v"), q, v))

    def acceleration(
        self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, external: np.ndarray | float = 0.0
    ) -> np.ndarray:
        """(n,) rad/s^2 at q, v (n,) when the motors are asked for tau (n,) and the world adds ``external`` N m, (n,) or 0."""
        q, v, tau = self._vectors(("q", "v", "tau"), q, v, tau)
        if type(external) is not float:
            (external,) = self._vectors(("external",), external)
        return torques.acceleration(self, q, v, tau, external)

    def energy(self, q: np.ndarray, v: np.ndarray) -> float:
        """J: kinetic (rotors included), potential, and that of the stops' springs."""
        q, v = self._vectors(("q", "v"), q, v)
        energy = self.arm.energy(q, v)
        return energy + float(self.stop_stiffness @ torques.beyond(self, q) ** 2) / 2 if self._has_stops else energy

    def _vectors(self, names: tuple[str, ...], *vectors: Any) -> tuple[Any, ...]:
        """Each as (n,) finite floats, or a tracer's symbols as they are; one look at all where they are floats already."""
        shape, squares = self._lower.shape, 0.0
        for x in vectors:
            if type(x) is not np.ndarray or x.dtype is not FLOAT or x.shape != shape:
                break
            squares += x.dot(x)  # finite only of what is finite; of huge numbers it is not, which are looked at below
        else:
            if isfinite(squares):
                return vectors
        return tuple(
            seen_through(name, x, numbers, shape, UNITS.get(name, "N m"))
            for name, x in zip(names, vectors, strict=True)
        )


def _require_arm(arm: Any) -> None:
    if not isinstance(arm, Arm):
        raise ValueError(f"arm: expected an Arm (load_k1607, load_urdf, load_example), got {shown(arm)}")
