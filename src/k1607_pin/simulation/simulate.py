"""One closed-loop rollout at Python speed: any controller, payloads on a schedule, forces from outside, and an energy account."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
import xarray as xr

from k1607_pin.arguments import as_floats, number, shown
from k1607_pin.arm.arm import Arm
from k1607_pin.arm.payload import velocity_after_gripping, with_payload
from k1607_pin.arm.wrench import Wrench, wrench_at_tool, wrench_torque
from k1607_pin.control.finite import NotFiniteError
from k1607_pin.kinematics.differential import SingularJacobianError
from k1607_pin.simulation import torques
from k1607_pin.simulation.account import work_rule
from k1607_pin.simulation.integrators import Acceleration, State, semi_implicit_euler
from k1607_pin.simulation.names import DIRECTIONS, VARIABLES, Variables, require_names
from k1607_pin.simulation.plant import Plant, plant_of
from k1607_pin.simulation.schedule import NOTHING, PayloadSchedule

External = Callable[[float, np.ndarray, np.ndarray], Wrench | None]
"""Time [s], q, v (n,) -> what the world does to the arm."""

Observer = Callable[[Arm, np.ndarray, np.ndarray], Mapping[str, Any]]
"""The arm with what it carries, q, v (n,) -> named arrays to log."""


class Controller(Protocol):
    """What `simulate` runs: a state and a pure update of it.

    It may have an attribute ``variables``, `Variables` of what it logs; so may an observer. One with a ``period`` [s] of its
    own is only run at that.
    """

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> Any:
        """The controller's state at time 0, for joint angles and velocities (n,).

        Raises `ValueError` for what cannot be done from there within ``duration`` [s].
        """

    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: Any) -> tuple[np.ndarray, Any, Mapping[str, Any]]:
        """Torque (n,) N m to hold from t on, the next state, and named arrays to log; changes nothing in place."""


def require_controller(controller: Any) -> None:
    """Refuse, by `ValueError`, what is no `Controller`."""
    missing = [name for name in ("start", "update") if not callable(getattr(controller, name, None))]
    if missing or isinstance(controller, type):
        raise ValueError(
            f"controller: expected an object with start(q, v, duration) and update(t, q, v, state), got {shown(controller)}"
        )


MOST_STEPS = 10**12  # a year of computing; more is a slip
RUNAWAY = 1e4  # rad/s (m/s): no arm moves like that; well before the numbers overflow


class SimulationError(RuntimeError):
    """A rollout that ran away: the time [s] and state of the last good physics step, and the log until then."""

    def __init__(
        self, time: float, q: np.ndarray, v: np.ndarray, log: xr.Dataset, what: str = "the state has run away"
    ) -> None:
        self.time, self.q, self.v, self.log, self._what = time, q, v, log, what
        super().__init__(
            f"{what} after t = {time:.4g} s; the last good one is q = {np.round(q, 4).tolist()}, "
            f"v = {np.round(v, 4).tolist()}; .log holds {log.sizes['time']} samples"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.time, self.q, self.v, self.log, self._what)


def simulate(
    plant: "Plant | Arm",
    controller: Controller,
    q0: np.ndarray,
    duration: float,
    v0: np.ndarray | None = None,
    control_period: float = 0.01,
    physics_step: float = 0.001,
    step: Callable[[Acceleration, np.ndarray, np.ndarray, float], State] = semi_implicit_euler,
    payloads: Sequence[Any] = (),
    from_rest: bool = False,
    external: External | None = None,
    observe: Observer | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Run a controller on an arm and log every control period.

    Parameters
    ----------
    plant : what to control; an `Arm` alone has neither friction nor torque limits nor joint stops.
    q0, v0 : (n,) rad, rad/s at the start; v0 None for rest.
    duration, control_period, physics_step : s; torque is held for a control period, a whole number of physics steps.
    step : `semi_implicit_euler` or `runge_kutta_4`.
    payloads : (time [s], payload) or (time, payload, ramp [s]), see `PayloadChange`: carried from that time on, or growing
        until ramp later; `Payload(0.0)` for none. Taken up at the nearest control sample.
    from_rest : whether a payload that is picked up was at rest, so that the arm gives it momentum; else it moved along. One
        payload after another: the first is let go, the second gripped.
    external : what the world does to the arm, a `Wrench` with its frame, as a function of time, q and v; the time is held at
        the physics step's beginning, so that of a force that changes in time any integrator is of first order.
    observe : logs what it finds at every control sample of the arm with its payload, `ObserveOperationalSpace` say.
    progress : told the share done, 0 to 1, now and then.

    Returns
    -------
    Dataset over ``time`` (s, control samples 0 to duration): ``q``, ``v``, ``tau`` (time, joint), the torque held from that time
    on; ``passive_torque`` (time, joint), what friction, stops and the world add to it at the sample; ``tool_position`` (time,
    axis) m; with ``external`` only, ``contact_force`` N and ``contact_moment`` N m (time, axis), the world's on the body that
    carries the tool, about the tool's origin, base axes, zero while it acts on another link; ``payload`` kg, ``payload_changes``
    how often it has changed; and in J ``energy``, ``work`` done by the motors, ``external_work``, ``dissipated`` by friction and
    stops, ``payload_energy`` brought or taken by payloads, and ``energy_residual`` = energy - energy at 0 - work - external_work
    + dissipated - payload_energy: what the integrator made or lost. The account is of the integrator's order, fourth with
    `runge_kutta_4`, where forces are smooth over a step; Coulomb friction that turns round within one is not. And what controller
    and observer log, dimensions named after it where they do not say otherwise. Of a prismatic joint read m for rad and N for
    N m.

    Raises
    ------
    ValueError
        Wrong shapes, the controller's torque included; non-finite or out-of-order times; periods that do not fit.
    SimulationError
        A joint is faster than `RUNAWAY`, or the controller's torque is not finite, or a law stops as what it is given is not, or
        as the posture is singular; it carries the log so far.
    NotFiniteError, SingularJacobianError
        A law stops at the first sample, where there is no log.
    """
    plant = plant_of(plant)
    require_controller(controller)
    bare = plant.arm
    q = bare.as_vector(q0, "q0").copy()
    v = np.zeros(bare.n) if v0 is None else bare.as_vector(v0, "v0").copy()
    samples, substeps = grid(duration, control_period, physics_step)
    if (period := getattr(controller, "period", control_period)) != control_period:
        raise ValueError(
            f"control_period: expected the controller's own period, {period!r} s, got {control_period!r} s"
        )
    schedule = PayloadSchedule(payloads, duration)
    variables = VARIABLES | dict(getattr(controller, "variables", {})) | dict(getattr(observe, "variables", {}))
    state = controller.start(q.copy(), v.copy(), duration)  # its own: what it writes into them is not where the arm is
    carried, work_of = NOTHING, work_rule(step)
    changes, work, from_outside, dissipated, brought = 0, 0.0, 0.0, 0.0, 0.0
    records: list[dict[str, Any]] = []
    start_energy = plant.energy(q, v)
    for k in range(samples + 1):
        t = k * control_period
        payload = schedule.at(t + control_period / 2)
        if payload is not carried:
            loaded = plant.carrying(with_payload(bare, payload))
            before = plant.energy(q, v)
            gripped = schedule.gripped(t - control_period / 2, t + control_period / 2)
            if from_rest and gripped.mass > 0:
                v = velocity_after_gripping(bare, loaded.arm, gripped, q, v)
            changes += payload.mass > 0 or carried.mass > 0
            plant, carried = loaded, payload
            brought += plant.energy(q, v) - before
        try:
            asked, state, log = _answer(controller.update(t, q.copy(), v.copy(), state), bare.n)
            if observe:
                seen = observe(plant.arm, q, v)
                if both := log.keys() & seen.keys():
                    raise ValueError(
                        f"observe: expected other names than the controller's, got {', '.join(sorted(both))}"
                    )
                log = {**log, **seen}
        except (NotFiniteError, SingularJacobianError) as error:  # the law stops: what was until then is told
            if not records:
                raise
            raise SimulationError(t, q, v, _dataset(records, control_period, bare, variables), str(error)) from error
        except Exception as error:
            error.add_note(f"in simulate, at t = {t:.6g} s, q = {q.tolist()}, v = {v.tolist()}")
            raise
        _require_names(log, records)
        tau = torques.motor(plant, asked)
        energy = plant.energy(q, v)
        pushed, contact = _contact(plant.arm, external, t, q, v)
        records.append(
            {
                "q": q,
                "v": v,
                "tau": tau,
                "passive_torque": torques.passive(plant, q, v) + pushed,
                "tool_position": bare.forward_kinematics(q).translation,
                "payload": carried.mass,
                "payload_changes": changes,
                "energy": energy,
                "work": work,
                "external_work": from_outside,
                "dissipated": dissipated,
                "payload_energy": brought,
                "energy_residual": energy - start_energy - work - from_outside + dissipated - brought,
                **contact,
                **log,
            }
        )
        if not np.isfinite(asked).all():
            what = "the controller asks for a torque that is not finite"
            raise SimulationError(t, q, v, _dataset(records, control_period, bare, variables), what)
        if progress and (k % max(1, samples // 100) == 0 or k == samples):
            progress(k / samples)
        if k == samples:
            break
        for i in range(substeps):
            push = _push(plant.arm, external, t + i * physics_step)
            q_next, v_next = _step(plant, step, q, v, tau, push, physics_step)
            if not np.abs(v_next).max() < RUNAWAY:  # NaN included; a finite v gives a finite q
                log_so_far = _dataset(records, control_period, bare, variables)
                raise SimulationError(t + i * physics_step, q, v, log_so_far)
            work += float(tau @ (q_next - q))  # exact: the torque is held
            dissipated += work_of(partial(torques.loss, plant), (q, v), (q_next, v_next), physics_step)
            if push:
                from_outside += work_of(push, (q, v), (q_next, v_next), physics_step)
            q, v = q_next, v_next
    return _dataset(records, control_period, bare, variables)


def _require_names(log: Mapping[str, Any], records: list[dict[str, Any]]) -> None:
    """Refuse a log whose names are taken, or that names others than the tick before."""
    require_names("log", log)
    if records and (changed := sorted((set(records[-1]) - set(VARIABLES)) ^ set(log))):
        raise ValueError(f"log: expected the same names at every tick, got a change of {', '.join(changed)}")


def _contact(
    arm: Arm, external: External | None, t: float, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray | float, dict[str, np.ndarray]]:
    """What the world does at a control sample: torque (n,) N m on the joints, and what is logged of its wrench on the tool."""
    if external is None:
        return 0.0, {}
    wrench = external(t, q, v) or Wrench()
    on_tool = wrench_at_tool(arm, q, wrench)
    return wrench_torque(arm, q, wrench), {"contact_force": on_tool[:3], "contact_moment": on_tool[3:]}


Push = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""q, v (n,) -> torque (n,) N m of the world on the joints."""


def _push(arm: Arm, external: External | None, t: float) -> Push | None:
    if external is None:
        return None

    def push(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        wrench = external(t, q, v)
        return np.zeros(arm.n) if wrench is None else wrench_torque(arm, q, wrench)

    return push


def _step(
    plant: Plant, step: Any, q: np.ndarray, v: np.ndarray, tau: np.ndarray, push: Push | None, dt: float
) -> State:
    """One physics step; NaN where the plant refuses numbers that have run away."""

    def acceleration(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        if not (np.isfinite(q).all() and np.isfinite(v).all()):  # an intermediate state
            return np.full_like(q, np.nan)
        return torques.acceleration(plant, q, v, tau, push(q, v) if push else 0.0)

    with np.errstate(over="ignore", invalid="ignore"):
        return step(acceleration, q, v, dt)


def _answer(given: Any, n: int) -> tuple[np.ndarray, Any, Mapping[str, Any]]:
    """Of a controller's update, as `Controller` says."""
    if not isinstance(given, tuple | list) or len(given) != 3 or not isinstance(given[2], Mapping):
        raise ValueError(
            "controller.update: expected three things back, a torque, the next state and a mapping of arrays to log "
            f"({{}} for none), got {shown(given)}"
        )
    asked = as_floats("controller", given[0], f"a torque of shape ({n},)")
    if asked.shape != (n,):
        raise ValueError(f"controller: expected a torque of shape ({n},), got {asked.shape}")
    return asked, given[1], given[2]


def grid(duration: float, control_period: float, physics_step: float) -> tuple[int, int]:
    for name, value in (("duration", duration), ("control_period", control_period), ("physics_step", physics_step)):
        number(name, value, above=0, unit="s")
    if not (duration / control_period < MOST_STEPS and control_period / physics_step < MOST_STEPS):
        raise ValueError(
            f"duration, control_period, physics_step: expected at most {MOST_STEPS:.0e} steps, got {shown(duration)} s "
            f"in periods of {shown(control_period)} s in steps of {shown(physics_step)} s"
        )
    samples, substeps = round(duration / control_period), round(control_period / physics_step)
    if samples < 1 or abs(samples * control_period - duration) > 1e-9 * duration:
        raise ValueError(
            f"duration: expected a whole number of control periods of {control_period} s, got {duration!r}"
        )
    if substeps < 1 or abs(substeps * physics_step - control_period) > 1e-9 * control_period:
        raise ValueError(
            f"physics_step: expected a whole part of the control period {control_period} s, got {physics_step!r}"
        )
    if samples * substeps > MOST_STEPS:
        raise ValueError(
            f"duration, physics_step: expected at most {MOST_STEPS:.0e} physics steps, got {float(samples) * substeps:.1e}"
        )
    return samples, substeps


def _dataset(records: list[dict[str, Any]], period: float, arm: Arm, variables: Variables) -> xr.Dataset:
    logged = {}
    for name in records[0]:
        values = np.array([record[name] for record in records])
        dims, unit = variables.get(name, (tuple(f"{name}_{k}" for k in range(values.ndim - 1)), ""))
        logged[name] = (("time", *dims), values, {"units": unit})
    coordinates = {"joint": list(arm.joint_names), "axis": ["x", "y", "z"], "direction": list(DIRECTIONS)}
    used = {dim for dims, _, _ in logged.values() for dim in dims}
    return xr.Dataset(
        logged,
        coords={
            "time": ("time", np.arange(len(records)) * period, {"units": "s"}),
            **{name: labels for name, labels in coordinates.items() if name in used},
        },
    )
