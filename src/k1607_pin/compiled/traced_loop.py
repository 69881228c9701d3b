"""A closed loop traced: controller, plant, world and integrator become `ClosedLoop`'s programs."""

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from k1607_pin.arm.payload import velocity_after_gripping_of
from k1607_pin.arm.wrench import wrench_torque
from k1607_pin.compiled.closed_loop import INPUTS, REDUCERS, ClosedLoop, Setup, is_of_arm, shape_of
from k1607_pin.compiled.leaves import Layout, apart, numbers, replaced, substituted
from k1607_pin.compiled.limits import require_state
from k1607_pin.compiled.order import in_order
from k1607_pin.compiled.program import Program, hoisted
from k1607_pin.compiled.trace import numpy_mode
from k1607_pin.compiled.traced_arm import TracedArm
from k1607_pin.compiled.tracer import Tracer, TracingError, column, explained, program_of, symbol_array
from k1607_pin.dynamics.rigid_body import inertia_from, rigidly_carried
from k1607_pin.simulation import torques
from k1607_pin.simulation.names import require_names
from k1607_pin.simulation.plant import Plant

SOMEWHERE = 0.1
"""rad, times 1, 2, ...: where a controller is asked what shapes its log has"""


def traced(
    setup: Setup,
    varied: Sequence[str],
    metrics: Mapping[str, Sequence[str]],
    logged: Sequence[str],
    initial_state: Any = None,
) -> ClosedLoop:
    """The closed loop with the numbers named in ``varied`` as parameters.

    Parameters
    ----------
    varied : dotted names below "plant", "controller", "external" and "payloads".
    metrics : variable -> reducers; logged : variables; see `Setup.signals` for those there are.
    initial_state : such as a controller without ``initial`` starts from.

    Raises
    ------
    TracingError
        Something cannot be traced.
    ValueError
        A name that there is not.
    """
    with numpy_mode():
        return _Tracing(setup, varied).loop(metrics, logged, initial_state)


class _Tracing:
    def __init__(self, setup: Setup, varied: Sequence[str]) -> None:
        self.setup = setup
        self.n = setup.plant.arm.n
        self.shapes = {name: shape_of(setup, name) for name in varied}
        self.symbols = {name: symbol_array(name, shape) for name, shape in self.shapes.items()}
        self.q, self.v, self.tau = (symbol_array(name, (self.n,)) for name in ("q", "v", "tau"))

    def below(self, root: str) -> dict[str, Any]:
        return {name: x for name, x in self.symbols.items() if name.partition(".")[0] == root}

    def stand_in(self, tracer: Tracer, root: str, x: Any) -> Any:
        return tracer.inside(x, root, self.below(root))

    def loop(self, metrics: Mapping[str, Sequence[str]], logged: Sequence[str], initial_state: Any) -> ClosedLoop:
        setup = self.setup
        tracer, physics = Tracer("law"), Tracer("physics")
        controller = self.stand_in(tracer, "controller", setup.controller)
        plant = self.stand_in(physics, "plant", setup.plant)
        payload = self.payload(plant.arm)

        given = not hasattr(setup.controller, "initial")
        first = initial_state if given else setup.controller.initial(np.zeros(self.n), np.zeros(self.n))
        self.state = Layout(first, "the controller's state")
        require_state("controller", self.state)
        with explained("controller.initial"):
            state_0 = initial_state if given else controller.initial(np.copy(self.q), np.copy(self.v))
        functions: dict[str, tuple[list[Any], Any, Any]] = {}  # outputs, shared symbols, further input
        state = symbol_array("state", (self.state.size,))
        functions["law"], metric_list, log_list = self.law(controller, plant, tracer, state, metrics, logged)
        if not given:  # after the law, so that the tables of both are known
            functions["initial"] = [self.state.flat(state_0)], tracer.shared_inputs(), None
        motion, stages = self.motion(plant, physics, payload)
        functions |= motion
        functions |= self.payload_change(plant.arm, payload)
        noise = [x for _, _, values in tracer.noise for x in _entries(values)]
        slow = ["parameters", "payload"]
        programs = {}
        for name, (outputs, shared, more) in functions.items():
            inputs = {
                "shared": shared, "q": self.q, "v": self.v, "tau": self.tau, "state": state, "noise": noise,
                "parameters": [x for s in self.symbols.values() for x in _entries(s)], "payload": payload,
                "hoisted": None, "more": more,
            }  # fmt: skip
            programs[name] = _program(name, inputs, outputs)
        self.require_effect(programs, {seed for seed, _, _ in tracer.noise}, given)
        hot = [name for name in programs if name not in ("initial", "payload", "grip")]
        numbers_of_slow = [INPUTS.index(name) for name in slow]
        hoist, rest = hoisted(
            [programs[name] for name in hot], [numbers_of_slow] * len(hot), [INPUTS.index("hoisted")] * len(hot)
        )
        programs |= dict(zip(hot, rest, strict=True))
        programs["hoist"] = _renumbered(hoist, numbers_of_slow)
        programs = {name: in_order(p) for name, p in programs.items()}
        return ClosedLoop(
            self.n, programs, tracer.collected(), physics.collected(), self.shapes, self.state, given, tuple(metric_list),
            tuple(log_list), stages, 2 * len(self.changes),
        )  # fmt: skip

    def require_effect(self, programs: Mapping[str, Program], seeds: set[str], given: bool) -> None:
        """Refuse what would be varied in vain."""
        number = INPUTS.index("parameters")
        used = {n.place[1] for p in programs.values() for n in p.nodes if n.op == "input" and n.place[0] == number}
        first = 0
        for name, shape in self.shapes.items():
            last = first + int(np.prod(shape))
            asked = given and name.startswith("controller.") and self.acts_at_start(name)
            if name not in seeds and not asked and not used.intersection(range(first, last)):
                raise ValueError(
                    f"vary: expected numbers that the loop depends on, got {name!r}; what only a function of time depends on, a "
                    "table that all rollouts share, cannot differ"
                )
            first = last

    def acts_at_start(self, name: str) -> bool:
        """Whether what the controller's ``start`` gives depends on a number of its own, as far as can be told."""
        controller, rest = self.setup.controller, name.partition(".")[2]
        if is_of_arm(name) or not self.state.size:
            return False
        x, q, v = numbers(controller)[rest], SOMEWHERE * np.arange(1.0, self.n + 1), np.zeros(self.n)
        try:
            moved = replaced(controller, {rest: 1.1 * x + 0.1 if x.ndim else float(1.1 * x + 0.1)})
            one, other = (self.state.flat(each.start(q.copy(), v.copy(), 1.0)) for each in (controller, moved))
        except Exception:  # it refuses the number, or where it would start
            return True
        return bool(one != other)

    def law(
        self,
        controller: Any,
        plant: Any,
        tracer: Tracer,
        state: Any,
        metrics: Mapping[str, Sequence[str]],
        logged: Sequence[str],
    ) -> Any:
        with explained("controller.update"):
            asked, after, log = controller.update(
                tracer.time[0], np.copy(self.q), np.copy(self.v), self.state.rebuilt(state)
            )
            asked = np.stack(asked) if isinstance(asked, list | tuple) else asked
        if (count := len(_entries(asked))) != self.n:
            raise TracingError(f"controller.update: expected a torque of shape ({self.n},), got {count} numbers")
        tau = torques.motor(plant, asked)
        may_limit = "plant.torque_limit" in self.shapes or np.isfinite(self.setup.plant.torque_limit).any()
        if may_limit:  # what is not finite must not become a limit, and look well
            tau = np.where(np.abs(asked) < np.inf, tau, np.inf)
        require_names("log", log)
        if both := sorted(set(log).intersection(self.setup.signals)):
            raise ValueError(f"signals: expected names other than the controller's, got {', '.join(both)}")
        log = {
            **log, "t": tracer.time[0], "q": self.q, "v": self.v, "tau": tau,
            "tool_position": plant.arm.forward_kinematics(self.q).translation,
        }  # fmt: skip
        for name, signal in self.setup.signals.items():
            with explained(f"signals[{name!r}]"):
                log[name] = tracer.inside(signal, f"signals.{name}", {})(log)
        for name in (*metrics, *logged):
            if name not in log:
                raise ValueError(f"metrics, log: expected some of {', '.join(sorted(log))}, got {name!r}")
        flat_after = self.state.flat(after)
        shapes = self.shapes_logged()
        for name in (*metrics, *logged):
            if len(_entries(log[name])) != int(np.prod(shapes[name])):
                raise TracingError(
                    f"log: expected numbers, and as many traced, got {name!r} = {log[name]!r:.80}; a flag as 0.0 or 1.0"
                )
        metric_list = [(name, reducer, shapes[name]) for name, reducers in metrics.items() for reducer in reducers]
        size = sum(int(np.prod(shape)) for _, _, shape in metric_list)
        so_far = symbol_array("metrics", (size,))
        new, k = [], 0
        for name, reducer, _ in metric_list:
            for x in _entries(log[name]):
                new.append(_reduced(reducer, so_far[k], x))
                k += 1
        rows = [x for name in logged for x in _entries(log[name])]
        log_list = [(name, shapes[name]) for name in logged]
        outputs = [_entries(tau), flat_after, new, rows]
        return (outputs, tracer.shared_inputs(), so_far), metric_list, log_list

    def shapes_logged(self) -> dict[str, tuple[int, ...]]:
        """Of all that is logged, by running the controller once on numbers: traced arrays keep no more than two dimensions."""
        setup, n = self.setup, self.n
        q, v = SOMEWHERE * np.arange(1.0, n + 1), np.zeros(n)
        controller = apart(setup.controller)
        state = controller.initial(q, v) if hasattr(controller, "initial") else controller.start(q, v, 1.0)
        tau, _, log = controller.update(0.0, q, v, state)
        log = {**log, "t": 0.0, "q": q, "v": v, "tau": tau, "tool_position": np.zeros(3)}
        for name, signal in setup.signals.items():
            log[name] = signal(log)
        return {name: np.shape(x) for name, x in log.items()}

    def motion(self, plant: Any, physics: Tracer, payload: Any) -> tuple[dict[str, Any], int]:
        """The integrator's step: whole where it evaluates one acceleration, else cut at each."""
        external = self.setup.external
        if external is not None:
            external = self.stand_in(physics, "external", external)
        loaded = plant.arm if payload is None else plant.arm.carrying(self.full_payload)
        loaded_plant = Plant.__new__(Plant)
        loaded_plant.__dict__.update(plant.__dict__)
        for name, x in (
            ("arm", loaded),
            ("torque_limit", np.full(self.n, np.inf)),
        ):  # limited once, by the law's sample
            object.__setattr__(loaded_plant, name, x)

        def acceleration(q: Any, v: Any) -> Any:
            push: Any = 0.0
            if external is not None:
                with explained("external"):
                    push = torque_of(external, plant.arm, physics.time[0], q, v)
            return torques.acceleration(loaded_plant, q, v, self.tau, push)

        asked: list[tuple[Any, Any]] = []
        results: list[Any] = []

        def recorded(q: Any, v: Any) -> Any:
            asked.append((q, v))
            results.append(symbol_array(f"k{len(asked)}", (self.n,)))
            return results[-1]

        h = self.setup.physics_step
        with explained("step"):
            end = self.setup.step(recorded, self.q, self.v, h)
            if len(asked) == 1:
                whole = self.setup.step(acceleration, self.q, self.v, h)
                return {"motion": ([_entries(x) for x in whole], physics.shared_inputs(), None)}, 1
        stages: dict[str, Any] = {}
        k = [x for result in results for x in _entries(result)]
        for i, state in enumerate(asked[1:], 1):
            stages[f"stage{i}"] = [_entries(x) for x in state], None, k
        a = acceleration(self.q, self.v)
        stages["acceleration"] = [_entries(a)], physics.shared_inputs(), None
        stages["finish"] = [_entries(x) for x in end], None, k
        return stages, len(asked)

    def payload(self, arm: TracedArm) -> Any:
        """Symbols for what of the carried body's ten parameters is not always zero; None for never any payload."""
        changes = self.setup.schedule.changes
        below = self.below("payloads")
        changes = substituted(changes, below, lambda x, name, symbols: None, "payloads")
        self.changes = [_parameters_of(change.payload, arm) for change in changes]
        if not self.changes or not any(_matters(x) for one in self.changes for x in one):
            return None
        self.present = [k for k in range(10) if any(_matters(one[k]) for one in self.changes)]
        symbols = symbol_array("payload", (len(self.present),))
        self.full_payload = [0.0] * 10
        for i, k in enumerate(self.present):
            self.full_payload[k] = symbols[i]
        return _entries(symbols)

    def payload_change(self, arm: TracedArm, payload: Any) -> dict[str, Any]:
        """ "payload": what the hand carries, from each change's share; "grip": velocities when something at rest is gripped."""
        if payload is None:
            return {}
        weights = symbol_array("weights", (2 * len(self.changes),))  # of what is carried, then of what is new
        carried, new = (
            [sum((weights[offset + i] * one[k] for i, one in enumerate(self.changes)), 0.0) for k in range(10)]
            for offset in (0, len(self.changes))
        )
        functions: dict[str, Any] = {"payload": ([[carried[k] for k in self.present]], weights, None)}
        if self.setup.from_rest:
            newcomer = [b - a for a, b in zip(_flat_mass(arm, None, self.q), _flat_mass(arm, new, self.q), strict=True)]
            M = arm.carrying(self.full_payload).mass_matrix(self.q)
            added = np.reshape(np.stack(newcomer), (self.n, self.n))
            functions["grip"] = [_entries(velocity_after_gripping_of(M, added, self.v))], weights, None
        return functions


def torque_of(external: Any, arm: Any, t: Any, q: Any, v: Any) -> Any:
    """(n,) N m on the joints, of an object with ``wrench`` at the tool or of a function that gives a `Wrench` or None."""
    if hasattr(external, "wrench"):
        return arm.jacobian(q).T @ external.wrench(t, q, v)
    wrench = external(t, q, v)
    return 0.0 if wrench is None else wrench_torque(arm, q, wrench)


def _flat_mass(arm: TracedArm, payload: Any, q: Any) -> list[Any]:
    return _entries((arm if payload is None else arm.carrying(payload)).mass_matrix(q))


def _parameters_of(payload: Any, arm: TracedArm) -> list[Any]:
    """Ten inertial parameters, in the joint frame that carries the tool."""
    _, offset, rotation = arm._place(None)
    mass, moment, second = rigidly_carried(payload.mass, payload.cg, payload.inertia, offset, rotation)
    inertia = inertia_from(second)
    upper = [inertia[0, 0], inertia[0, 1], inertia[1, 1], inertia[0, 2], inertia[1, 2], inertia[2, 2]]
    return [mass, moment[0], moment[1], moment[2], *upper]


def _matters(x: Any) -> bool:
    if isinstance(x, float | int | np.number):
        return bool(x != 0)
    x = ca.SX(getattr(x, "_v", x))
    return not x.is_zero()


def _entries(x: Any) -> list[Any]:
    return Layout(None).flat(x) if not isinstance(x, list) else x


def _reduced(reducer: str, so_far: Any, x: Any) -> Any:
    if reducer == "max":
        return np.maximum(so_far, np.abs(x))
    if reducer == "min":
        return np.minimum(so_far, np.abs(x))
    if reducer == "rms":
        return so_far + x * x
    if reducer == "mean":
        return so_far + x
    if reducer == "last":
        return x + 0 * so_far
    raise ValueError(f"metrics: expected reducers of {', '.join(REDUCERS)}, got {reducer!r}")


def _vertical(x: Any) -> Any:
    if x is None or isinstance(x, list):
        return column(x)
    return ca.vec(ca.SX(getattr(x, "_v", x)))


def _program(name: str, inputs: Mapping[str, Any], outputs: Any) -> Program:
    symbols = []
    for key in INPUTS:
        x = _vertical(inputs[key])
        symbols.append(x if x.numel() else ca.SX.sym(key, 0))
    if isinstance(outputs[0], list):
        out = [ca.densify(_vertical(list(x))) if len(x) else ca.SX(0, 1) for x in outputs]
    else:
        out = [ca.densify(_vertical(x)) for x in outputs]
    f = ca.Function(name, symbols, out, {"cse": True})
    return program_of(name, f)


def _renumbered(p: Program, inputs: Sequence[int]) -> Program:
    nodes = tuple(
        node._replace(place=(inputs[node.place[0]], node.place[1])) if node.op == "input" else node for node in p.nodes
    )
    return p._replace(nodes=nodes)
