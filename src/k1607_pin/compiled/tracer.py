"""Controllers, plants and the world around them made traceable: arms that take symbols, functions of time as tables."""

import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.layout import Layout
from k1607_pin.compiled.leaves import Seen, opened
from k1607_pin.compiled.limits import require_operations
from k1607_pin.compiled.nest import TracingError as TracingError
from k1607_pin.compiled.nest import is_open, is_traced
from k1607_pin.compiled.program import Program, program
from k1607_pin.compiled.tables import Table, Tables
from k1607_pin.compiled.traced_arm import TracedArm
from k1607_pin.compiled.traced_regressor import TracedRegressor
from k1607_pin.control.baselines import Regressor
from k1607_pin.simulation.noise import WhiteNoise


class Tracer:
    """What one traced function takes besides states and parameters: time, tables of functions of time, noise of its lane."""

    def __init__(self, name: str) -> None:
        self.time = symbol_array(f"{name}_t", (1,))
        self._sx_time = self.time._v
        self.tables: list[Table] = []
        self.table_symbols: list[Any] = []
        self.noise: list[tuple[str, WhiteNoise, Any]] = []
        """Name of its seed, source, and symbols (size,)"""
        self.seen: Seen = {}

    def stand_in(self, x: Any, name: str, symbols: Mapping[str, Any]) -> Any:
        """What `substituted` is to put in the place of x; None for looking inside."""
        if isinstance(x, Arm):
            return TracedArm(x, **{key.rpartition(".")[2]: value for key, value in symbols.items()})
        if isinstance(x, Regressor):
            return TracedRegressor(TracedArm(x.arm))
        if isinstance(x, WhiteNoise) and f"{name}.seed" in symbols:
            values = symbol_array(name, (x.size,))
            self.noise.append((f"{name}.seed", x, values))
            return partial(self.noise_at, name, values)
        if isinstance(x, type) or not (callable(x) or (is_open(x) and hasattr(x, "of_time"))):
            return None
        inside = self.inside(x, name, symbols)
        return OfTime(self, name, x, inside) if callable(x) and not symbols else inside

    def noise_at(self, name: str, values: Any, t: Any) -> Any:
        """Of the sample."""
        if not ca.is_equal(ca.SX(getattr(t, "_v", t)), self._sx_time):
            raise TracingError(
                f"{name}: expected to be asked for the time of the sample, where its seed varies, got {t}"
            )
        return values

    def inside(self, x: Any, name: str, symbols: Mapping[str, Any]) -> Any:
        """A copy of x, an object or a function, with stand-ins for what it holds, and for its methods of time alone.

        Those are the ones that its class names in ``of_time``; they cannot depend on what differs between rollouts.
        """
        made = opened(x, symbols, self.stand_in, name, self.seen)
        if made is not x:
            for key in getattr(x, "of_time", ()):
                object.__setattr__(made, key, OfTime(self, f"{name}.{key}", getattr(x, key), None))
        return made

    def is_time(self, t: Any) -> bool:
        """Whether t is a number, or computed of the sample's time alone."""
        if not isinstance(t, int | float | np.number) and not is_traced(t) and not isinstance(t, ca.SX):
            return False
        if np.size(t) != 1:
            return False
        return not ca.Function("at", [self._sx_time], [ca.SX(getattr(t, "_v", t))], {"allow_free": True}).has_free()

    def table(self, name: str, fun: Callable[[float], Any], t: Any) -> Any:
        """Symbols for fun(t), laid out as fun(0) is."""
        at = ca.Function("at", [self._sx_time], [ca.SX(getattr(t, "_v", t))], {"allow_free": True})
        asked = at(self._sx_time)
        for table, symbols in zip(self.tables, self.table_symbols, strict=True):
            if table.name == name and ca.is_equal(asked, table.at(self._sx_time) if table.at else self._sx_time, 10):
                return table.layout.rebuilt(symbols)
        layout = Layout(fun(0.0), name)
        first = sum(table.layout.size for table in self.tables)
        at_once = bool(ca.is_equal(asked, self._sx_time, 10))
        self.tables.append(Table(name, fun, None if at_once else at, layout, first))
        self.table_symbols.append(symbol_array(name, (layout.size,)))
        return layout.rebuilt(self.table_symbols[-1])

    def shared_inputs(self) -> Any:
        """(1 + k, 1) SX: the time and what all tables give."""
        return ca.vertcat(self._sx_time, *(x._v if hasattr(x, "_v") else x for x in map(_column, self.table_symbols)))

    def collected(self) -> Tables:
        """What of it a run needs."""
        return Tables(tuple(self.tables), tuple((seed, source) for seed, source, _ in self.noise))


@dataclass(frozen=True)
class OfTime:
    """A callable within something traced: a table where it is asked for a time alone, else traced through.

    A function of time is asked on numbers, so that it may do what does not trace.
    """

    tracer: Tracer
    name: str
    fun: Callable[..., Any]
    inside: Any
    """The same with stand-ins for what it holds, or None"""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        if len(arguments) == 1 and not named and self.tracer.is_time(arguments[0]):
            return self.tracer.table(self.name, self.fun, arguments[0])
        with explained(self.name):
            return (self.fun if self.inside is None else self.inside)(*arguments, **named)

    def __getattr__(self, key: str) -> Any:
        if key.startswith("__"):
            raise AttributeError(key)
        return getattr(self.inside if self.inside is not None else self.fun, key)


def symbol_array(name: str, shape: tuple[int, ...]) -> Any:
    """A traced array; in NumPy mode only."""
    return np.reshape(ca.array(ca.SX.sym(name, int(np.prod(shape))))[:, 0], shape)


def column(entries: Any) -> Any:
    """(N, 1) SX of N traced scalars or numbers."""
    return ca.vertcat(*(ca.SX(getattr(x, "_v", x)) for x in entries)) if entries else ca.SX(0, 1)


def _column(x: Any) -> Any:
    return np.reshape(x, (-1, 1)) if np.shape(x)[0] else ca.SX(0, 1)


def program_of(name: str, f: ca.Function) -> Program:
    """The function's program, unless there are too many operations in it, or a NaN.

    Raises
    ------
    TracingError
        It says so.
    """
    require_operations(name, f.n_instructions())
    p = program(f)
    if any(node.op == "const" and node.value != node.value for node in p.nodes):
        raise TracingError(
            f"{name}: expected numbers, got a NaN among its constants: np.nan itself, 0 / 0, or the root of a negative number"
        )
    return p


@contextmanager
def explained(name: str) -> Iterator[None]:
    """What goes wrong with symbols, told with the operation and the line that cannot be traced."""
    try:
        yield
    except TracingError:
        raise
    except Exception as error:
        places = [(f, set(Path(f.filename).parts)) for f in traceback.extract_tb(error.__traceback__)]
        frames = [f for f, parts in places if not LIBRARIES & parts]
        own = [f for f, parts in places if not (LIBRARIES | {PACKAGE}) & parts]
        frames = own or frames
        where = f"{frames[-1].filename}:{frames[-1].lineno}: {frames[-1].line}" if frames else "its code"
        words = f"there is no {error} here" if isinstance(error, KeyError) else str(error)
        reason = words.strip().splitlines()[-1] if words else type(error).__name__
        reason = reason if len(reason) < LONGEST else f"{reason[:LONGEST]}..."
        hint = next((hint for words, hint in HINTS.items() if words in str(error)), "")
        raise TracingError(f"{name}: cannot be compiled: {where}: {reason}{hint}") from error


LIBRARIES, PACKAGE = {"casadi", "numpy"}, "k1607_pin"
LONGEST = 300  # characters of what a library says: it may print all that was traced
HINTS = {
    "truth value": " (a Python condition on a traced number; use np.where)",
    "symbolic SX to a numpy array": " (an array made of traced numbers; use np.stack, np.hstack or np.concatenate)",
    "got ArrayInterface": " (an arm that tracing does not see: keep it as an attribute of the controller, "
    "or of a dataclass, tuple or mapping in one)",
    "unsupported operand type(s) for &": " (use np.logical_and)",
    "unsupported operand type(s) for |": " (use np.logical_or)",
    "bad operand type for unary ~": " (use np.logical_not)",
    "too many indices": " (for another axis use np.reshape)",
    "no implementation found for 'numpy.einsum'": " (two operands, and -> with what comes out)",
    "'Pose' object has no attribute": " (a traced pose has translation and rotation)",
    "ArrayInterfaceSX' object has no attribute": " (use NumPy's function: np.copy(x), np.clip(x, a, b), x @ y)",
    "setting an array element": " (nothing traced into an array of NumPy's; use np.stack for an array of numbers)",
    "out=(array(": " (nothing traced into an array of NumPy's in place; x = x + ...)",
}
"""Words of an error, and what helps"""
