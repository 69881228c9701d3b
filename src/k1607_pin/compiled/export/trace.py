"""A controller on symbols: what it takes, what it gives, and what of that is an argument of the exported code."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.export.words import output_names
from k1607_pin.compiled.leaves import Layout, named_numbers, numbers
from k1607_pin.compiled.limits import require_state
from k1607_pin.compiled.program import Program
from k1607_pin.compiled.trace import numpy_mode
from k1607_pin.compiled.tracer import OfTime, Tracer, TracingError, explained, program_of, symbol_array
from k1607_pin.control.adaptation import Gains

ROOT = "controller"
ROLES = ("parameters", "reference", "q", "v", "measured", "state")
"""In the order of the arguments"""


class Leaf(NamedTuple):
    """One number or array of those that a controller takes."""

    role: str
    """One of `ROLES`"""
    path: str
    """Dotted name within the controller, or within the state"""
    symbols: Any
    """(size,) SX"""
    shape: tuple[int, ...]
    source: str = ""
    """Of a reference, the function of time that gives it, or "" for the time itself"""

    @property
    def key(self) -> tuple[str, str]:
        """What tells it from the others."""
        return self.role, self.path


class TracedLaw:
    """``leaves`` and, as functions of them, ``tau``, ``after`` and ``initial`` (lists of symbols) and ``logged`` (by name)."""

    def __init__(self, arm: Arm, controller: Any) -> None:
        with numpy_mode():
            self._trace(arm, controller)

    def _trace(self, arm: Arm, controller: Any) -> None:
        tracer, n = _Inputs(), arm.n
        own = {name: numbers(controller)[name].shape for name in _own(controller)}
        parameters = {name: symbol_array(name, shape) for name, shape in own.items()}
        law = tracer.inside(controller, ROOT, {f"{ROOT}.{name}": x for name, x in parameters.items()})
        q, v = symbol_array("q", (n,)), symbol_array("v", (n,))
        somewhere, still = 0.1 * np.arange(1.0, n + 1), np.zeros(n)
        sample = controller.initial(somewhere, still)
        self.layout = Layout(sample, "the controller's state")
        require_state("controller", self.layout)
        state = symbol_array("state", (self.layout.size,)) if self.layout.size else None
        with explained("controller.initial"):
            self.initial = self.layout.flat(law.initial(np.copy(q), np.copy(v)))
        tracer.at_start = False
        with explained("controller.update"):
            state_now = sample if state is None else self.layout.rebuilt(state)
            tau, after, log = law.update(tracer.time[0], np.copy(q), np.copy(v), state_now)
        if (count := len(Layout(None).flat(tau))) != n:
            raise TracingError(f"controller.update: expected a torque of shape ({n},), got {count} numbers")
        self.tau, self.after = Layout(None).flat(tau), self.layout.flat(after)
        if len(self.after) != self.layout.size:
            raise TracingError(
                f"controller.update: expected a state of {self.layout.size} numbers, got {len(self.after)}"
            )
        self.keys = output_names(log)
        """Name -> the controller's, of what is given beside the torque"""
        self.logged = {name: Layout(None).flat(log[key]) for name, key in self.keys.items()}
        on_numbers = controller.update(0.0, somewhere, still, sample)[2]
        self.shapes = {name: np.shape(on_numbers[key]) for name, key in self.keys.items()}
        tables = zip(tracer.tables, tracer.table_symbols, strict=True)
        self.leaves = [
            *(Leaf("parameters", name, column(x), own[name]) for name, x in parameters.items()),
            Leaf("reference", "t", column(tracer.time), ()),
            *(leaf for table, x in tables for leaf in _split(table.fun(0.0), "reference", _within(table.name), x)),
            Leaf("q", "q", column(q), (n,)),
            Leaf("v", "v", column(v), (n,)),
            *(Leaf("measured", _within(name), column(x), shape) for name, (x, shape) in tracer.measured.items()),
            *(_split(sample, "state", "", state) if state is not None else ()),
        ]

    def program(self, outputs: Sequence[Sequence[Any]], order: Sequence[Leaf]) -> Program:
        """What gives the outputs, its inputs the leaves in this order."""
        with numpy_mode():
            columns = [ca.densify(ca.vertcat(*map(column, output))) for output in outputs]
        made = ca.Function("f", [leaf.symbols for leaf in order], columns, {"cse": True})
        return program_of("controller", made)


class _Inputs(Tracer):
    """Takes what depends on time, q and v as measured. All else is asked for the time of the sample, at the start for 0."""

    def __init__(self) -> None:
        super().__init__("law")
        self.measured: dict[str, tuple[Any, tuple[int, ...]]] = {}
        """Symbols, and their shape on numbers: traced arrays keep no more than two dimensions"""
        self.at_start = True

    def stand_in(self, x: Any, name: str, symbols: Mapping[str, Any]) -> Any:
        made = super().stand_in(x, name, symbols)
        return _Measurable(self, made) if isinstance(made, OfTime) else made

    def table(self, name: str, fun: Any, t: Any) -> Any:
        asked = column(t)
        if not (asked.is_zero() if self.at_start else ca.is_equal(asked, column(self.time))):
            wanted = "0 at the start" if self.at_start else "the time of the sample"
            raise TracingError(f"{name}: expected to be asked for {wanted}, got {asked}")
        return super().table(name, fun, self.time[0])


@dataclass(frozen=True)
class _Measurable:
    """A callable: a measurement where it is asked for time, q and v."""

    tracer: _Inputs
    of_time: OfTime

    def __call__(self, t: Any, *rest: Any) -> Any:
        if len(rest) != 2:
            return self.of_time(t, *rest)
        name, n = self.of_time.name, len(rest[0])
        if name not in self.tracer.measured:
            sample = np.asarray(self.of_time.fun(0.0, np.zeros(n), np.zeros(n)), dtype=float)
            self.tracer.measured[name] = symbol_array(name, sample.shape), sample.shape
        return self.tracer.measured[name][0]

    def __getattr__(self, key: str) -> Any:
        if key.startswith("__"):
            raise AttributeError(key)
        return getattr(self.of_time, key)


def _own(controller: Any) -> list[str]:
    """Numbers of the controller itself, of its gains, and of how fast it keeps to a posture; its options are part of the code."""
    if not is_dataclass(controller):
        return []
    kinds = {field.name: field.type for field in fields(controller)}

    def is_own(name: str, x: np.ndarray) -> bool:
        first, *rest = name.split(".")
        if rest:
            return isinstance(getattr(controller, first), Gains) or name == "posture.omega"
        return kinds[first] in (float, "float") or not isinstance(getattr(controller, first), int)

    return [name for name, x in numbers(controller).items() if is_own(name, x)]


def _split(sample: Any, role: str, source: str, symbols: Any) -> list[Leaf]:
    """A leaf for each number or array of a nest whose `Layout` the symbols are for."""
    found, first = [], 0
    for name, x in named_numbers(sample, source):
        size = int(np.size(x))
        if size:
            found.append(Leaf(role, name, column(symbols)[first : first + size], np.shape(x), source))
        first += size
    return found


def _within(name: str) -> str:
    return name.removeprefix(f"{ROOT}.")


def column(x: Any) -> Any:
    """As SX, row by row of what has two dimensions; in NumPy mode only."""
    return ca.SX(getattr(x if np.ndim(x) < 2 else np.reshape(x, (-1, 1)), "_v", x))
