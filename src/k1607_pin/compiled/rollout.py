"""Many closed loops at once, natively: the same definitions as `simulate`, traced and compiled."""

import hashlib
import logging
import re
import warnings
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from itertools import pairwise
from numbers import Integral
from typing import Any

import numpy as np
import xarray as xr

from k1607_pin.arguments import as_floats
from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.build import compiler
from k1607_pin.compiled.closed_loop import ClosedLoop, Setup, Signals, value_of
from k1607_pin.compiled.interpreted import WARNING, Interpreter
from k1607_pin.compiled.kept import kept
from k1607_pin.compiled.kernel import Kernel, source
from k1607_pin.compiled.lane_values import given_states, require_values
from k1607_pin.compiled.lanes import batches, by_rollout, in_lanes, processors, rows_of
from k1607_pin.compiled.leaves import lasts, numbers
from k1607_pin.compiled.limits import require_rollouts, require_steps
from k1607_pin.compiled.plan import Plan
from k1607_pin.compiled.results import REST, dataset, variables_of
from k1607_pin.simulation.integrators import semi_implicit_euler
from k1607_pin.simulation.names import require_names
from k1607_pin.simulation.plant import Plant, plant_of
from k1607_pin.simulation.schedule import PayloadSchedule
from k1607_pin.simulation.simulate import RUNAWAY, grid, require_controller
from k1607_pin.turns import Turns

logger = logging.getLogger(__name__)

DEFAULT_METRICS = {"error": ("max", "rms"), "joint_error": ("max", "rms"), "tau": ("max",)}
"""Of these, what the controller logs."""


def rollout(
    plant: "Plant | Arm",
    controller: Any,
    q0: np.ndarray,
    duration: float,
    v0: np.ndarray | None = None,
    control_period: float = 0.01,
    physics_step: float = 0.001,
    step: Callable[..., Any] = semi_implicit_euler,
    payloads: Sequence[Any] = (),
    from_rest: bool = False,
    external: Any = None,
    vary: Mapping[str, Any] | None = None,
    metrics: Mapping[str, Sequence[str]] | None = None,
    log: Sequence[str] = (),
    every: int = 1,
    signals: Signals | None = None,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Closed loops side by side, one a lane of a native function: what `simulate` does, at some hundred times its speed.

    The first call for a controller traces and compiles it, a second or so; the library is kept in the user's cache folder. A
    later call with the same objects does not trace again, if they are such as do not change: frozen dataclasses of numbers, and
    this package's functions; for functions of one's own `rollouts` is made once and called again and again.
    What a controller's ``start`` refuses is refused here too, where all rollouts begin alike and no number of the controller
    varies. What it and the plant say of numbers that vary is asked for the first rollout and for those with the smallest and the
    largest ones.

    Parameters
    ----------
    plant, controller, duration, control_period, physics_step, step, payloads, from_rest : as for `simulate`. The controller must
        trace: NumPy's functions on arrays, np.where for conditions on numbers. Functions of time alone need not.
    q0, v0 : (n,) or (N, n) rad, rad/s, for N rollouts; v0 None for rest.
    external : None, or what pushes the arm: a function of time, q and v that gives a `Wrench`, as for `simulate`, in NumPy's
        functions; or an object with ``wrench(t, q, v)`` (6,) at the tool, `Wall.external` of an arm say.
    vary : name -> (N, ...) of numbers that differ between rollouts: "controller.beta_1", "controller.gains.K_p", "plant.viscous",
        "payloads.0.payload.mass", "controller.noise.seed" of `with_noise`; "plant.arm.inertial" (N, n, 10), "plant.arm.armature"
        (N, n) and "plant.arm.gravity" (N, 3) as for `TracedArm`. Other values of the same names compile nothing anew.
    metrics : variable -> reducers of "max" and "min" (of the magnitude), "rms", "mean", "last", over the control samples until
        the end or the failure; None for `DEFAULT_METRICS`. Variables are what the controller logs, and "t", "q", "v", "tau" and
        "tool_position".
    log : variables to return over time, every so many samples; after a failure NaN.
    signals : see `Signals`: more variables, computed of the others.
    threads : None for as many as there are processors. Results do not depend on it.
    progress : told the share done, 0 to 1.

    Returns
    -------
    Dataset over ``rollout`` (and ``time`` s): ``<variable>_<reducer>``; logged variables; ``q_end``, ``v_end``; ``work`` J of the
    motors; ``failed_at`` s, the time of the last good physics step of a rollout that ran away, NaN for one that did not.
    Attribute ``engine`` says what ran.

    Raises
    ------
    ValueError
        Wrong shapes, names that there are not, numbers that are not finite.
    TracingError
        A controller that cannot be traced; the operation is named.
    """
    return rollouts(
        plant, controller, duration, control_period, physics_step, step, payloads, from_rest, external,
        tuple(vary or ()), metrics, log if isinstance(log, str) else tuple(log), every, signals,
    )(q0, v0, vary, threads, progress)  # fmt: skip


def rollouts(
    plant: "Plant | Arm",
    controller: Any,
    duration: float,
    control_period: float = 0.01,
    physics_step: float = 0.001,
    step: Callable[..., Any] = semi_implicit_euler,
    payloads: Sequence[Any] = (),
    from_rest: bool = False,
    external: Any = None,
    varied: Sequence[str] = (),
    metrics: Mapping[str, Sequence[str]] | None = None,
    log: Sequence[str] = (),
    every: int = 1,
    signals: Signals | None = None,
) -> "Rollouts":
    """What `rollout` runs, made once: call it with q0, v0, and values of the names ``varied``. Parameters as there."""
    bare = plant_of(plant)
    require_controller(controller)
    grid(duration, control_period, physics_step)
    if not callable(step):
        raise ValueError(f"step: expected a function such as semi_implicit_euler or runge_kutta_4, got {step!r:.80}")
    for name, given in (("metrics", metrics), ("signals", signals)):
        if given is not None and not isinstance(given, Mapping):
            raise ValueError(f"{name}: expected a mapping by name, got {given!r:.80}")
    if (period := getattr(controller, "period", control_period)) != control_period:
        raise ValueError(
            f"control_period: expected the controller's own period, {period!r} s, got {control_period!r} s"
        )
    if not isinstance(every, Integral) or every < 1:
        raise ValueError(f"every: expected a whole number of samples from 1 on, got {every!r}")
    every, log = int(every), (log,) if isinstance(log, str) else log
    if metrics is None:
        metrics = {name: kinds for name, kinds in DEFAULT_METRICS.items() if name in variables_of(controller)}
    metrics = {name: (kinds,) if isinstance(kinds, str) else tuple(kinds) for name, kinds in metrics.items()}
    require_names("signals", signals or ())
    results = {f"{name}_{kind}" for name, kinds in metrics.items() for kind in kinds}
    if both := sorted(results.intersection(log)):
        raise ValueError(f"log: expected none that is called as a metric's result is, got {', '.join(both)}")
    if double := {name for name in varied if list(varied).count(name) > 1}:
        raise ValueError(f"vary: expected each name once, got {', '.join(sorted(double))} twice")
    if wrong := [name for name in varied if TIMES.fullmatch(name)]:
        raise ValueError(f"vary: expected no period and no time, which all rollouts share, got {wrong[0]!r}")
    objects = (plant, controller, step, external, *payloads, *(signals or {}).values())
    times = (duration, control_period, physics_step, from_rest, every, tuple(signals or ()))
    content = tuple((name, x.shape, x.tobytes()) for one in objects for name, x in numbers(one).items())
    key = (tuple(map(id, objects)), content, times, tuple(varied), tuple(metrics.items()), tuple(log))
    with _TURNS.taken():
        found = _recent.get(key)
        if found and all(map(lasts, objects)):
            _recent.move_to_end(key)
            return found[0]
        schedule = PayloadSchedule(payloads, duration)
        setup = Setup(bare, controller, external, schedule, from_rest, step, physics_step, signals or {})
        made = Rollouts(setup, duration, control_period, tuple(varied), metrics, tuple(log), every)
        _recent[key] = made, objects  # which stay alive, so that their ids stay theirs
        _recent.move_to_end(key)
        while len(_recent) > RECENT:
            _recent.popitem(last=False)
        return made


TIMES = re.compile(r"controller\.(.*\.)?period|payloads\.\d+\.(time|ramp)")
RECENT = 8  # traced loops that are kept for the next call
_recent: OrderedDict[Any, tuple["Rollouts", Any]] = OrderedDict()
_TURNS = Turns()


def forget() -> None:
    """Let go of what has been traced."""
    _recent.clear()


@dataclass
class Rollouts:
    """A closed loop ready to run, for any number of rollouts. Made by `rollouts`."""

    setup: Setup
    duration: float
    period: float
    varied: tuple[str, ...]
    metrics: Mapping[str, Sequence[str]]
    logged: tuple[str, ...]
    every: int
    loop: ClosedLoop = field(init=False)
    engine: Any = field(init=False)

    def __post_init__(self) -> None:
        self.samples, self.substeps = grid(self.duration, self.period, self.setup.physics_step)
        controller = self.setup.controller
        self._state, self._begun = None, b""
        if not hasattr(controller, "initial"):
            still = np.zeros(self.setup.plant.arm.n)
            self._state = controller.start(still, still.copy(), self.duration)
        self.loop = kept(self.setup, self.varied, self.metrics, self.logged, self._state)
        for name, noise in self.loop.law_tables.noise:
            if noise.period != self.period:
                raise ValueError(
                    f"vary: expected noise of the control period, {self.period} s, where {name} varies, got {noise.period} s"
                )
        made = compiler()
        if made is None:
            warnings.warn(WARNING, RuntimeWarning, stacklevel=2)
        self.engine = Kernel(self.loop, made) if made else Interpreter(self.loop)
        size = self.samples * (self.loop.law_tables.size + self.substeps * self.loop.physics_tables.size)
        require_steps(self.samples, self.substeps, size)
        times = np.arange(self.samples + 1) * self.period
        self._law_shared = self.loop.law_tables.shared_values(times)
        steps = (times[:-1, None] + np.arange(self.substeps) * self.setup.physics_step).ravel()
        self._physics_shared = self.loop.physics_tables.shared_values(steps)
        self._weights, self._change = self._payload_plan(times)

    def __reduce__(self) -> tuple[Any, ...]:
        """Its recipe: made anew where it is unpickled, with the library from that machine's cache."""
        return type(self), (
            self.setup, self.duration, self.period, self.varied, self.metrics, self.logged, self.every
        )  # fmt: skip

    def fingerprint(self) -> str:
        """Another one for every closed loop that computes something else."""
        made = hashlib.sha256(source(self.loop, 1).encode())
        for x in (self._law_shared, self._physics_shared, self._weights, self._change):
            made.update(np.ascontiguousarray(x).tobytes())
        made.update(repr((self.samples, self.substeps, self.every, self.period, self.setup.physics_step)).encode())
        return made.hexdigest()[:32]

    def __call__(
        self,
        q0: np.ndarray,
        v0: np.ndarray | None = None,
        vary: Mapping[str, Any] | None = None,
        threads: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> xr.Dataset:
        """As `rollout`, for the names that it was made for."""
        start = self._one_start(q0, v0)
        varies = any(
            name.startswith("controller.") for name in self.varied
        )  # then none is the controller as it is here
        if start and not self.loop.state_is_given and not varies:
            begun = b"".join(x.tobytes() for x in start)
            if begun != self._begun:  # asked once: it may look at a whole path
                self.setup.controller.start(*start, self.duration)
                self._begun = begun
        return self.run(q0, v0, vary, threads, progress)

    def _one_start(self, q0: Any, v0: Any) -> tuple[np.ndarray, np.ndarray] | None:
        """q and v, copies, where all rollouts begin alike."""
        n = self.loop.n
        q, v = (as_floats(name, x) for name, x in (("q0", q0), ("v0", np.zeros(n) if v0 is None else v0)))
        good = all(x.size == n and np.isfinite(x).all() for x in (q, v))
        return (q.ravel().copy(), v.ravel().copy()) if good else None

    def run(
        self,
        q0: np.ndarray,
        v0: np.ndarray | None = None,
        vary: Mapping[str, Any] | None = None,
        threads: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> xr.Dataset:
        """As `rollout`, without asking the controller's ``start`` whether it can begin there."""
        vary = dict(vary or {})
        if threads is not None and (not isinstance(threads, Integral) or threads < 1):
            raise ValueError(f"threads: expected a whole number from 1 on, got {threads!r}")
        if set(vary) != set(self.varied):
            raise ValueError(
                f"vary: expected values of {', '.join(self.varied) or 'nothing'}, got {', '.join(vary) or 'nothing'}"
            )
        n = self.loop.n
        given: dict[str, tuple[Any, tuple[int, ...]]] = {
            "q0": (q0, (n,)),
            "v0": (np.zeros(n) if v0 is None else v0, (n,)),
        }
        given |= {name: (vary[name], self.loop.parameters[name]) for name in self.varied}
        values, count = batches(given)
        require_values(self.setup, self.loop, {name: values[name] for name in self.varied})
        W = self.engine.lanes
        self._require_memory(count)
        blocks = -(-count // W)
        columns = [rows_of(values[name], count) for name in ("q0", "v0", *self.varied)]
        if self.loop.state_is_given:
            columns.append(given_states(self.setup, self.loop, self.varied, values, count, self.duration))
        inputs = in_lanes(columns, blocks, W)
        seeds = np.zeros((blocks, len(self.loop.law_tables.noise), W), dtype=np.int64)
        for k, (name, _) in enumerate(self.loop.law_tables.noise):
            seeds[:, k] = in_lanes([rows_of(values[name], count)], blocks, W)[:, 0]
        plan = self.plan()
        results = np.empty((blocks, 2 * n + len(self.loop.reducers) + REST, W))
        log = np.empty((blocks, plan.rows, sum(int(np.prod(shape)) for _, shape in self.loop.logged), W))
        self._in_threads(plan, (inputs, seeds, results, log), threads, progress)
        found = dataset(
            self.loop, self.setup.plant.arm, variables_of(self.setup.controller), by_rollout(results, count),
            by_rollout(log, count), self.every * self.period,
        )  # fmt: skip
        return found.assign_attrs(engine=str(self.engine))

    def _require_memory(self, count: int) -> None:
        """Refuse more rollouts than memory: of what goes in, and of what comes out twice, as it is put in order."""
        n, rows = self.loop.n, self.samples // self.every + 1 if self.logged else 0
        taken = 2 * n + sum(int(np.prod(shape)) for shape in self.loop.parameters.values()) + self.loop.state.size
        given = (
            2 * n + len(self.loop.reducers) + REST + rows * sum(int(np.prod(shape)) for _, shape in self.loop.logged)
        )
        require_rollouts(count, 8 * (taken + 2 * given))

    def now(self) -> dict[str, np.ndarray]:
        """What it varies, as it is where it is not varied."""
        return {name: value_of(self.setup, name) for name in self.varied}

    def plan(self) -> Plan:
        """What all rollouts share."""
        rows = self.samples // self.every + 1 if self.logged else 0
        return Plan(
            self.samples, self.substeps, self.every, rows, self.period, self.setup.physics_step, RUNAWAY,
            self._law_shared, self._physics_shared, self._weights, self._change,
        )  # fmt: skip

    def _in_threads(self, plan: Plan, arrays: tuple[np.ndarray, ...], threads: int | None, progress: Any) -> None:
        blocks = len(arrays[0])
        threads = threads or processors()
        steps = blocks * plan.ticks * plan.substeps * self.loop.stages
        # so that nobody waits long for the last one, nor for Ctrl-C
        count = max(4 * threads if threads > 1 else 1, -(-steps // self.engine.piece))
        edges = np.unique(np.linspace(0, blocks, min(blocks, count) + 1).astype(int))
        pieces = [slice(a, b) for a, b in pairwise(edges)]
        if threads == 1 or len(pieces) == 1:
            for k, piece in enumerate(pieces):
                self.engine(plan, *(a[piece] for a in arrays))
                if progress:
                    progress((k + 1) / len(pieces))
            return
        with ThreadPoolExecutor(threads) as pool:  # the native function leaves the interpreter to others
            running = [pool.submit(self.engine, plan, *(a[piece] for a in arrays)) for piece in pieces]
            try:
                for k, done in enumerate(as_completed(running)):
                    done.result()
                    if progress:
                        progress((k + 1) / len(pieces))
            except BaseException:
                for one in running:
                    one.cancel()
                raise

    def _payload_plan(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weights of the payloads, one row a change, and for each sample which row; negative where something is gripped."""
        schedule, half = self.setup.schedule, self.period / 2
        change = np.zeros(len(times), dtype=np.int32)
        rows: list[np.ndarray] = []
        before = np.zeros(len(schedule.changes))
        for k, t in enumerate(times):
            shares = schedule.shares(t + half)
            if (shares != before).any():
                new = schedule.gripped_shares(t - half, t + half)
                rows.append(np.concatenate([shares, new]))
                change[k] = -len(rows) if self.setup.from_rest and new.any() else len(rows)
                before = shares
        return np.array(rows, dtype=float).reshape(len(rows), 2 * len(schedule.changes)), change
