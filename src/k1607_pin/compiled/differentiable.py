"""A rollout as one CasADi function of numbers of the loop: with exact derivatives, forward and in reverse."""

from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from k1607_pin.compiled.closed_loop import INPUTS, ClosedLoop
from k1607_pin.compiled.interpreted import function_of
from k1607_pin.compiled.rollout import Rollouts


def differentiable(run: Rollouts, q0: np.ndarray, v0: np.ndarray) -> ca.Function:
    """What ``run`` logs, every sample of it, as a function of the numbers that it varies.

    The same programs as the kernel's, one after the other: the law at a sample, then the physics steps. A rollout that runs away
    is not stopped; its numbers grow until they are not finite.

    Parameters
    ----------
    q0, v0 : (n,) rad, rad/s.

    Returns
    -------
    Function of one vector, the varied numbers in order, arrays row by row: (numbers logged, samples), variables in order.

    Raises
    ------
    ValueError
        A controller without ``initial``, whose start cannot be differentiated; noise whose seed is varied.
    """
    loop = run.loop
    if loop.state_is_given or loop.law_tables.noise:
        raise ValueError(
            f"controller: expected one with `initial` and without noise of varied seed, got {run.setup.controller!r:.80}; "
            "a search does without derivatives"
        )
    programs = _Programs(loop)
    plan = run.plan()
    numbers = ca.MX.sym("numbers", programs.sizes["parameters"])
    now = programs.nothing() | {"q": ca.DM(q0), "v": ca.DM(v0), "parameters": numbers, "shared": plan.law_shared[0]}
    now["state"] = programs(now, "initial")[0]
    now["hoisted"] = programs(now, "hoist")[0]
    tick = _tick(programs, plan.substeps, plan.physics_shared.shape[1])
    steps = plan.physics_shared.reshape(plan.ticks, -1)
    rows = []
    starts = [0, *(k for k in range(1, plan.ticks) if plan.change[k]), plan.ticks]
    for k, end in pairwise(starts):
        _take_up(programs, now, plan, k)
        fixed = ca.vertcat(*(now[name] for name in SLOW))
        shared = np.concatenate([plan.law_shared[k:end], steps[k:end]], axis=1).T
        state, row = tick.mapaccum(end - k)(ca.vertcat(*(now[name] for name in STATE)), shared, fixed)
        now |= programs.cut(STATE, state[:, -1])
        rows.append(row)
    _take_up(programs, now, plan, plan.ticks)
    rows.append(_sampled(programs, now | {"shared": plan.law_shared[-1]})[2])
    return ca.Function("rollout", [numbers], [ca.horzcat(*rows)])


STATE = ("q", "v", "state")
SLOW = ("parameters", "payload", "hoisted")
"""Inputs that stay while the payload does"""


class _Programs:
    """The loop's programs, called by the names of their inputs."""

    def __init__(self, loop: ClosedLoop) -> None:
        self.n, self.stages = loop.n, loop.stages
        self._functions = {name: function_of(name, p, INPUTS) for name, p in loop.programs.items()}
        self.sizes = dict(zip(INPUTS, loop.input_sizes, strict=True))
        self.sizes |= {"shared": loop.law_tables.size, "more": len(loop.reducers)}

    def __contains__(self, name: str) -> bool:
        return name in self._functions

    def nothing(self) -> dict[str, Any]:
        return {name: ca.DM.zeros(size) for name, size in self.sizes.items()}

    def cut(self, names: tuple[str, ...], vector: Any) -> dict[str, Any]:
        ends = np.cumsum([0, *(self.sizes[name] for name in names)]).tolist()
        return {name: vector[a:b] for name, (a, b) in zip(names, pairwise(ends), strict=True)}

    def __call__(self, now: dict[str, Any], name: str) -> list[Any]:
        f, takes = self._functions[name]
        sizes = [f.size1_in(i) for i in range(len(INPUTS))]
        given = [now[key][:k] if key in takes else ca.DM.zeros(k) for key, k in zip(INPUTS, sizes, strict=True)]
        return list(f.call(given))

    def advanced(self, now: dict[str, Any]) -> list[Any]:
        """q, v a physics step on."""
        if self.stages == 1:
            return self(now, "motion")
        k: list[Any] = []
        for i in range(self.stages):
            more = ca.vertcat(*k, ca.DM.zeros(self.n * (self.stages - i)))
            q, v = self({**now, "more": more}, f"stage{i}") if i else (now["q"], now["v"])
            k.append(self({**now, "q": q, "v": v}, "acceleration")[0])
        return self({**now, "more": ca.vertcat(*k)}, "finish")


def _take_up(programs: _Programs, now: dict[str, Any], plan: Any, k: int) -> None:
    """What changes with the payload at sample k."""
    if not plan.change[k]:
        return
    now["shared"] = plan.weights[abs(plan.change[k]) - 1]
    if "payload" in programs:
        now["payload"] = programs(now, "payload")[0]
    if plan.change[k] < 0 and "grip" in programs:
        now["v"] = programs(now, "grip")[0]
    now["hoisted"] = programs(now, "hoist")[0]


def _sampled(programs: _Programs, now: dict[str, Any]) -> tuple[Any, Any, Any]:
    """Torque, the law's next state, and what is logged."""
    tau, after, _, row = programs(now, "law")
    return tau, after, row


def _tick(programs: _Programs, steps: int, shared: int) -> ca.Function:
    """A control period, for `mapaccum`: state; the sample's and then each step's shared numbers; slow -> next state, row."""
    size = programs.sizes
    x = ca.MX.sym("x", sum(size[name] for name in STATE))
    tables = ca.MX.sym("tables", size["shared"] + steps * shared)
    slow = ca.MX.sym("slow", sum(size[name] for name in SLOW))
    now = programs.nothing() | programs.cut(STATE, x) | programs.cut(SLOW, slow) | {"shared": tables[: size["shared"]]}
    now["tau"], after, row = _sampled(programs, now)
    for i in range(steps):
        now["shared"] = tables[size["shared"] + i * shared :][:shared]
        now["q"], now["v"] = programs.advanced(now)
    return ca.Function("tick", [x, tables, slow], [ca.vertcat(now["q"], now["v"], after), row])
