"""A controller whose update runs natively: the same law, called from Python once a control period."""

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled import emit
from k1607_pin.compiled.build import compiler, library
from k1607_pin.compiled.closed_loop import INPUTS, Setup
from k1607_pin.compiled.kept import kept
from k1607_pin.compiled.kernel import SHARED, resource
from k1607_pin.compiled.leaves import Layout, is_ours
from k1607_pin.compiled.order import in_order
from k1607_pin.compiled.program import Program, program
from k1607_pin.compiled.results import variables_of
from k1607_pin.compiled.tables import Table, Tables
from k1607_pin.compiled.trace import numpy_mode
from k1607_pin.compiled.tracer import column, symbol_array
from k1607_pin.control.finite import entering, leaving
from k1607_pin.simulation.integrators import semi_implicit_euler
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.schedule import PayloadSchedule


class Native:
    """Stands in for a controller, in `simulate` and in front of a robot. Not for many threads at once.

    Functions of time are native where they trace; else they are asked in Python, at every update. Of the log it gives what the
    controller's ``variables`` name.

    Raises
    ------
    TracingError
        The controller does not trace; the operation is named.
    RuntimeError
        There is no C compiler.
    """

    def __init__(self, controller: Any, arm: Arm | None = None) -> None:
        """``arm``: None for the controller's own ``arm``."""
        made = compiler()
        if made is None:
            raise RuntimeError("no C compiler was found; `k1607 doctor` tells more")
        self.controller = controller
        self.variables: Mapping[str, Any] = getattr(controller, "variables", {})
        if hasattr(controller, "period"):
            self.period: float = controller.period
        plant = Plant(arm or controller.arm)
        setup = Setup(plant, controller, None, PayloadSchedule([], 1.0), False, semi_implicit_euler, 1e-3, {})
        n = plant.arm.n
        logged = [name for name in variables_of(controller) if name in self.variables]
        state = None if hasattr(controller, "initial") else controller.start(np.zeros(n), np.zeros(n), 1.0)
        loop = kept(setup, (), {}, logged, state)
        self._n, self._state = n, loop.state
        self._strict = is_ours(type(controller))  # a law of one's own may keep what is not finite in its state
        sizes = [int(np.prod(shape)) for _, shape in loop.logged]
        ends = np.cumsum([0, *sizes]).tolist()
        self._rows = [(*logged, a, b) for logged, (a, b) in zip(loop.logged, pairwise(ends), strict=True)]
        native, self._asked = _functions_of_time(loop.law_tables)
        constants = len(loop.programs["hoist"].outputs[0])
        passed = {"shared": loop.law_tables.size, "q": n, "v": n, "state": loop.state.size, "hoisted": constants}
        sizes = [passed.get(name, 0) for name in INPUTS]
        functions = [emit.function("hoist", loop.programs["hoist"], [0] * len(INPUTS), (SHARED,))]
        functions += [emit.function("law", loop.programs["law"], sizes, (SHARED,))]
        functions += [emit.function(f"table{first}", p, (1,)) for first, p in native]
        calls = "\n".join(f"  table{first}(shared, shared + {1 + first});" for first, _ in native)
        text = "\n".join(["#define W 1", resource("lanes.h"), *functions, _ENTRY % (constants + 1, calls)])
        self._run = library(text, replace(made, lanes=1)).tick
        self._run.restype = None
        self._shared = np.zeros(loop.law_tables.size)
        self._q, self._v, self._in, self._tau = np.zeros(n), np.zeros(n), np.zeros(loop.state.size + 1), np.zeros(n)
        self._out, self._log = np.zeros(loop.state.size + 1), np.zeros(ends[-1] + 1)
        arrays = (self._shared, self._q, self._v, self._in, self._tau, self._out, self._log)
        self._arguments = [ctypes.c_void_p(a.ctypes.data) for a in arrays]

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> Any:
        """The controller's own."""
        return self.controller.start(q, v, duration)

    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: Any) -> tuple[np.ndarray, Any, Mapping[str, Any]]:
        """What the controller's own gives, to rounding.

        Raises
        ------
        NotFiniteError
            t, q, v or, of this package's laws, the state is not finite, or what comes of them is not.
        ValueError
            q or v of another shape than (n,), a state that is built otherwise than the controller's.
        """
        q, v = entering(self._n, t, q, v, state if self._strict else None)
        self._shared[0] = t
        for fun, layout, where in self._asked:
            layout.fill(fun(t), self._shared[where])
        self._q[:], self._v[:] = q, v
        self._state.fill(state, self._in)
        self._run(*self._arguments)
        if not np.isfinite(self._tau).all() or (self._strict and not np.isfinite(self._out[:-1]).all()):
            leaving(self._tau.copy(), self._state.rebuilt(self._out.copy()) if self._strict else None)
        row = self._log.copy()
        log = {name: row[a:b].reshape(shape) if shape else row[a] for name, shape, a, b in self._rows}
        return self._tau.copy(), self._state.rebuilt(self._out.copy()), log


def _functions_of_time(
    tables: Tables,
) -> tuple[list[tuple[int, Program]], list[tuple[Callable[[float], Any], Layout, slice]]]:
    """Place among all tables and program of time, of those that trace; function, layout and place of the others."""
    native: list[tuple[int, Program]] = []
    asked: list[tuple[Callable[[float], Any], Layout, slice]] = []
    for table in tables.tables:
        found = _traced(table)
        if found:
            native.append((table.first, found))
        else:
            asked.append((table.one, table.layout, slice(1 + table.first, 1 + table.first + table.layout.size)))
    return native, asked


def _traced(table: Table) -> Program | None:
    """The function as a program of time, if it traces, and then gives what it gives on numbers."""
    with numpy_mode():
        t = symbol_array("t", (1,))
        try:
            flat = column(table.layout.flat(table.fun(t[0])))
        except Exception:  # whatever stands in the way: it is asked in Python then
            return None
    of_time = ca.Function("f", [t._v], [ca.densify(flat)], {"cse": True})
    asked = TIMES if table.at is None else table.at(TIMES[None]).full().ravel()
    found, wanted = of_time(asked[None]).full().T, table.values(TIMES)
    if found.shape != wanted.shape or not np.allclose(found, wanted, 1e-13, 1e-13 * np.abs(wanted).max(initial=0.0)):
        return None
    at = ca.SX.sym("t")
    return in_order(program(ca.Function("f", [at], [of_time(table.at(at) if table.at else at)], {"cse": True})))


TIMES = np.concatenate([np.linspace(0.0, 100.0, 1009), np.geomspace(1e-6, 1e4, 200)])
"""s: where a function of time must give the same traced as on numbers"""

_ENTRY = """
void tick(double *shared, const V *q, const V *v, const V *state, V *tau, V *after, V *row)
{
  V none[1], constants[%d];
%s
  hoist(0, 0, 0, 0, 0, 0, 0, 0, 0, 0, constants);
  law(shared, q, v, 0, state, 0, 0, 0, constants, 0, tau, after, none, row);
}
"""
