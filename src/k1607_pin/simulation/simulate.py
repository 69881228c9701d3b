"""One closed-loop rollout at Python speed: any controller, payloads on a schedule, and an energy account."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import xarray as xr

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.payload import Payload, velocity_after_pickup, with_payload
from k1607_pin.simulation.integrators import Acceleration, State, semi_implicit_euler
from k1607_pin.simulation.plant import Plant


class Controller(Protocol):
    """What `simulate` runs: a state and a pure update of it."""

    def start(self, q: np.ndarray, v: np.ndarray) -> Any:
        """The controller's state at time 0, for joint angles and velocities (n,)."""

    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: Any) -> tuple[np.ndarray, Any, Mapping[str, Any]]:
        """Torque (n,) N m to hold from t on, the next state, and named arrays to log; changes nothing in place."""


class SimulationError(RuntimeError):
    """A rollout that left the finite numbers."""

    def __init__(self, time: float, q: np.ndarray, v: np.ndarray, log: xr.Dataset) -> None:
        self.time, self.q, self.v, self.log = time, q, v, log
        super().__init__(
            f"the state is no longer finite after t = {time:.4g} s; the last finite one is q = {np.round(q, 4).tolist()}, "
            f"v = {np.round(v, 4).tolist()}; .log holds {log.sizes['time']} samples"
        )


def simulate(
    plant: "Plant | Arm",
    controller: Controller,
    q0: np.ndarray,
    duration: float,
    v0: np.ndarray | None = None,
    control_period: float = 0.01,
    physics_step: float = 0.001,
    step: Callable[[Acceleration, np.ndarray, np.ndarray, float], State] = semi_implicit_euler,
    payloads: Sequence[tuple[float, Payload]] = (),
    from_rest: bool = False,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Run a controller on an arm and log every control period.

    Parameters
    ----------
    plant : what to control; an `Arm` alone has neither friction nor torque limits.
    q0, v0 : (n,) rad, rad/s at the start; v0 None for rest.
    duration, control_period, physics_step : s; torque is held for a control period, a whole number of physics steps.
    step : `semi_implicit_euler` or `runge_kutta_4`.
    payloads : (time [s], payload) from that time on, in order of time; `Payload(0.0)` for none. Taken up at control samples.
    from_rest : whether a payload that is picked up was at rest, so that the arm gives it momentum; else it moved along.
    progress : told the share done, 0 to 1, now and then.

    Returns
    -------
    Dataset over ``time`` (s, control samples 0 to duration): ``q``, ``v``, ``tau`` (time, joint), the torque held from that time
    on; ``tool_position`` (time, axis) m; ``payload`` kg; and in J ``energy``, ``work`` done by the motors, ``dissipated`` by
    friction, ``payload_energy`` brought or taken by payloads, and ``energy_residual`` = energy - energy at 0 - work + dissipated
    - payload_energy: what the integrator made or lost. And what the controller logs, dimensions named after it.

    Raises
    ------
    ValueError
        Wrong shapes, the controller's torque included; non-finite or out-of-order times; periods that do not fit.
    SimulationError
        The state is no longer finite; it carries the log so far.
    """
    plant = Plant(plant) if isinstance(plant, Arm) else plant
    bare = plant.arm
    q = bare.as_vector(q0, "q0").copy()
    v = np.zeros(bare.n) if v0 is None else bare.as_vector(v0, "v0").copy()
    samples, substeps = _grid(duration, control_period, physics_step)
    schedule = _schedule(payloads)
    state = controller.start(q, v)
    carried = Payload(0.0)
    work = dissipated = brought = 0.0
    records: list[dict[str, Any]] = []
    start_energy = plant.energy(q, v)
    for k in range(samples + 1):
        t = k * control_period
        while schedule and schedule[0][0] <= t + control_period / 2:
            carried = schedule.pop(0)[1]
            loaded = Plant(with_payload(bare, carried), plant.viscous, plant.coulomb, plant.torque_limit)
            before = plant.energy(q, v)
            if from_rest and carried.mass > 0:
                v = velocity_after_pickup(plant.arm, loaded.arm, q, v)
            plant = loaded
            brought += plant.energy(q, v) - before
        tau, state, log = controller.update(t, q, v, state)
        tau = np.asarray(tau, dtype=float)
        if tau.shape != (bare.n,):
            raise ValueError(f"controller: expected a torque of shape ({bare.n},), got {tau.shape}")
        tau = plant.motor_torque(tau)
        energy = plant.energy(q, v)
        records.append(
            {
                "q": q,
                "v": v,
                "tau": tau,
                "tool_position": bare.forward_kinematics(q).translation,
                "payload": carried.mass,
                "energy": energy,
                "work": work,
                "dissipated": dissipated,
                "payload_energy": brought,
                "energy_residual": energy - start_energy - work + dissipated - brought,
                **log,
            }
        )
        if progress and k % max(1, samples // 100) == 0:
            progress(k / max(1, samples))
        if k == samples:
            break
        if not np.isfinite(tau).all():
            raise SimulationError(t, q, v, _dataset(records, control_period, bare))
        for _ in range(substeps):
            q_next, v_next = _step(plant, step, q, v, tau, physics_step)
            if not (np.isfinite(q_next).all() and np.isfinite(v_next).all()):
                raise SimulationError(t, q, v, _dataset(records, control_period, bare))
            moved = q_next - q
            work += float(tau @ moved)  # exact: the torque is held
            dissipated += float((plant.friction(v) + plant.friction(v_next)) / 2 @ moved)
            q, v = q_next, v_next
    return _dataset(records, control_period, bare)


def _step(plant: Plant, step: Any, q: np.ndarray, v: np.ndarray, tau: np.ndarray, dt: float) -> State:
    """One physics step; NaN where the plant refuses numbers that have run away."""
    with np.errstate(over="ignore", invalid="ignore"):
        try:
            return step(lambda q, v: plant.acceleration(q, v, tau), q, v, dt)
        except ValueError:  # an intermediate state that is not finite
            return np.full_like(q, np.nan), np.full_like(v, np.nan)


def _grid(duration: float, control_period: float, physics_step: float) -> tuple[int, int]:
    for name, value in (("duration", duration), ("control_period", control_period), ("physics_step", physics_step)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name}: expected a positive time in s, got {value!r}")
    samples, substeps = round(duration / control_period), round(control_period / physics_step)
    if samples < 1 or abs(samples * control_period - duration) > 1e-9 * duration:
        raise ValueError(
            f"duration: expected a whole number of control periods of {control_period} s, got {duration!r}"
        )
    if substeps < 1 or abs(substeps * physics_step - control_period) > 1e-9 * control_period:
        raise ValueError(
            f"physics_step: expected a whole part of the control period {control_period} s, got {physics_step!r}"
        )
    return samples, substeps


def _schedule(payloads: Sequence[tuple[float, Payload]]) -> list[tuple[float, Payload]]:
    times = [time for time, _ in payloads]
    if not np.isfinite(times).all() or sorted(times) != times or (times and times[0] < 0):
        raise ValueError(f"payloads: expected times >= 0 s in order, got {times}")
    return list(payloads)


UNITS = {
    "q": "rad", "v": "rad/s", "tau": "N m", "tool_position": "m", "payload": "kg", "energy": "J", "work": "J",
    "dissipated": "J", "payload_energy": "J", "energy_residual": "J",
}  # fmt: skip
DIMENSIONS = {"q": ("joint",), "v": ("joint",), "tau": ("joint",), "tool_position": ("axis",)}


def _dataset(records: list[dict[str, Any]], period: float, arm: Arm) -> xr.Dataset:
    variables = {}
    for name in records[0]:
        values = np.array([record[name] for record in records])
        dims = DIMENSIONS.get(name, tuple(f"{name}_{k}" for k in range(values.ndim - 1)))
        variables[name] = (("time", *dims), values, {"units": UNITS.get(name, "")})
    return xr.Dataset(
        variables,
        coords={
            "time": ("time", np.arange(len(records)) * period, {"units": "s"}),
            "joint": list(arm.joint_names),
            "axis": ["x", "y", "z"],
        },
    )
