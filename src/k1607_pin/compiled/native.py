"""A controller whose update runs natively: the same law, called from Python once a control period."""

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled import emit
from k1607_pin.compiled.build import compiler, library
from k1607_pin.compiled.closed_loop import INPUTS, Setup
from k1607_pin.compiled.kept import kept
from k1607_pin.compiled.kernel import SHARED, resource
from k1607_pin.compiled.leaves import Layout
from k1607_pin.compiled.results import variables_of
from k1607_pin.simulation.integrators import semi_implicit_euler
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.schedule import PayloadSchedule


class Native:
    """Stands in for a controller, in `simulate` and in front of a robot. Not for many threads at once.

    Functions of time are still asked in Python, at every update.

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
        self._n, self._state, self._tables = n, loop.state, loop.law_tables
        sizes = [int(np.prod(shape)) for _, shape in loop.logged]
        ends = np.cumsum([0, *sizes]).tolist()
        self._rows = [(*logged, a, b) for logged, (a, b) in zip(loop.logged, pairwise(ends), strict=True)]
        law = loop.programs["law"]
        text = f"#define W 1\n{resource('lanes.h')}\n{emit.function('law', law, len(INPUTS), (SHARED,))}\n" + _ENTRY
        self._run = library(text, replace(made, lanes=1)).tick
        self._run.restype = None
        self._shared = np.zeros(loop.law_tables.size)
        self._q, self._v, self._in, self._tau = np.zeros(n), np.zeros(n), np.zeros(loop.state.size + 1), np.zeros(n)
        self._out, self._log = np.zeros(loop.state.size + 1), np.zeros(ends[-1] + 1)
        arrays = (self._shared, self._q, self._v, self._in, self._tau, self._out, self._log)
        self._arguments = [ctypes.c_void_p(a.ctypes.data) for a in arrays]
        self._asked: list[tuple[Callable[[float], Any], Layout, slice]] = []
        for table in loop.law_tables.tables:
            first = 1 + table.first
            self._asked.append((table.one, table.layout, slice(first, first + table.layout.size)))

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> Any:
        """The controller's own."""
        return self.controller.start(q, v, duration)

    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: Any) -> tuple[np.ndarray, Any, Mapping[str, Any]]:
        """What the controller's own gives, to rounding."""
        self._shared[0] = t
        for fun, layout, where in self._asked:
            layout.fill(fun(t), self._shared[where])
        self._q[:], self._v[:] = q, v
        self._state.fill(state, self._in)
        self._run(*self._arguments)
        row = self._log.copy()
        log = {name: row[a:b].reshape(shape) if shape else row[a] for name, shape, a, b in self._rows}
        return self._tau.copy(), self._state.rebuilt(self._out.copy()), log


_ENTRY = """
void tick(const double *shared, const V *q, const V *v, const V *state, V *tau, V *after, V *row)
{
  V none[1];
  law(shared, q, v, 0, state, 0, 0, 0, 0, 0, tau, after, none, row);
}
"""
