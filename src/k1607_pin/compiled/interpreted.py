"""Without a compiler: the same programs, run by CasADi's own interpreter for all rollouts at once. Correct, and slow."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from k1607_pin.compiled.closed_loop import INPUTS, ClosedLoop, start_of
from k1607_pin.compiled.emit import COMPARISONS
from k1607_pin.compiled.plan import Plan
from k1607_pin.compiled.program import TRIVIAL, Program
from k1607_pin.simulation.noise import standard_normal

WARNING = "no C compiler was found: rollouts run in CasADi's interpreter, some hundred times slower; see `k1607 doctor`"


class Interpreter:
    """Stands in for a `Kernel`."""

    lanes = 1
    piece = 100_000
    """Physics steps that one call does: a second or so, which Ctrl-C waits for"""

    def __init__(self, loop: ClosedLoop, rounded_anew: np.random.Generator | None = None) -> None:
        """``rounded_anew``: every operation that rounds gives its result a last place up or down, as this says."""
        self._loop = loop
        self.programs = loop.programs
        anew = {name: None if rounded_anew is None else off(p, rounded_anew) for name, p in loop.programs.items()}
        self._functions = {name: function_of(name, p, INPUTS, anew[name]) for name, p in loop.programs.items()}

    def __str__(self) -> str:
        return "CasADi's interpreter"

    def __call__(self, plan: Plan, inputs: np.ndarray, seeds: np.ndarray, results: np.ndarray, log: np.ndarray) -> None:
        """As `Kernel`, for arrays of one lane."""
        with np.errstate(all="ignore"):
            self._run(plan, inputs[:, :, 0].T, seeds[:, :, 0], results, log)

    def _run(self, plan: Plan, x: np.ndarray, seeds: np.ndarray, results: np.ndarray, log: np.ndarray) -> None:
        loop, n, count = self._loop, self._loop.n, x.shape[1]
        sizes = dict(zip(INPUTS, loop.input_sizes, strict=True))
        now = {name: np.zeros((size, count)) for name, size in sizes.items()}
        now["q"], now["v"] = x[:n].copy(), x[n : 2 * n].copy()
        now["parameters"] = x[2 * n : 2 * n + sizes["parameters"]]
        now["shared"] = plan.law_shared[0]
        now["state"] = x[2 * n + sizes["parameters"] :] if loop.state_is_given else self._one("initial", now)
        metrics = np.repeat(start_of(loop.reducers)[:, None], count, axis=1)
        alive, failed, work = np.ones(count, bool), np.full(count, np.nan), np.zeros(count)
        counted = np.zeros(count)
        now["hoisted"] = self._one("hoist", now)
        for k in range(plan.ticks + 1):
            if change := plan.change[k]:
                now["shared"] = plan.weights[abs(change) - 1]
                now["payload"] = self._one("payload", now) if "payload" in self._functions else now["payload"]
                if change < 0 and "grip" in self._functions:
                    now["v"] = np.where(alive, self._one("grip", now), now["v"])
                now["hoisted"] = self._one("hoist", now)
            now["noise"] = self._noise(seeds, k, count)
            now["shared"], now["more"] = plan.law_shared[k], metrics
            tau, after, new_metrics, row = self.call("law", now)
            finite = np.isfinite(tau).all(axis=0)
            failed[alive & ~finite] = k * plan.period
            alive &= finite
            counted += alive
            metrics = np.where(alive, new_metrics, metrics)
            now["tau"], now["state"] = tau, after
            if plan.rows and k % plan.every == 0:
                log[:, k // plan.every, :, 0] = np.where(alive, row, np.nan).T
            if k == plan.ticks:
                break
            before, moving = now["q"], alive
            for s in range(plan.substeps):
                now["shared"] = plan.physics_shared[k * plan.substeps + s]
                q, v = self.advance(now)
                ok = (np.abs(v) < plan.runaway).all(axis=0) & alive
                failed[alive & ~ok] = k * plan.period + s * plan.physics_step
                alive = ok
                now["q"], now["v"] = np.where(alive, q, now["q"]), np.where(alive, v, now["v"])
            work += np.where(moving, np.sum(tau * (now["q"] - before), axis=0), 0.0)
        results[:, :, 0] = np.concatenate([now["q"], now["v"], metrics, counted[None], work[None], failed[None]]).T

    def advance(self, now: dict[str, np.ndarray]) -> list[np.ndarray]:
        """q and v (n, rollouts) a physics step on."""
        stages = self._loop.stages
        if stages == 1:
            return self.call("motion", now)
        k = np.zeros((stages * self._loop.n, now["q"].shape[1]))
        for i in range(stages):
            here = dict(now)
            if i:
                here["q"], here["v"] = self.call(f"stage{i}", {**now, "more": k})
            k[i * self._loop.n : (i + 1) * self._loop.n] = self._one("acceleration", here)
        return self.call("finish", {**now, "more": k})

    def _noise(self, seeds: np.ndarray, sample: int, count: int) -> np.ndarray:
        sources = [source.size for _, source in self._loop.law_tables.noise]
        columns = [
            np.concatenate(
                [standard_normal(int(seed), sample, size) for seed, size in zip(seeds[i], sources, strict=True)]
            )
            for i in range(count if sources else 0)
        ]
        return np.array(columns).T if columns else np.zeros((0, count))

    def _one(self, name: str, now: dict[str, np.ndarray]) -> np.ndarray:
        return self.call(name, now)[0]

    def call(self, name: str, now: dict[str, np.ndarray]) -> list[np.ndarray]:
        """Outputs of a program for inputs by name, (size, rollouts), or (size,) the same for all."""
        f, takes = self._functions[name]
        count = now["q"].shape[1]
        arguments = []
        for i, key in enumerate(INPUTS):
            x = now[key][: f.size1_in(i)] if key in takes else np.zeros(1)
            arguments.append(np.repeat(x[:, None], count, axis=1) if x.ndim == 1 else x)
        found = f.map(count)(*arguments)
        return [x.full() for x in (found if isinstance(found, tuple | list) else (found,))]


EXACT = {
    *TRIVIAL, *COMPARISONS, "neg", "twice", "not", "and", "or", "if_else_zero", "floor", "ceil", "fabs", "sign", "fmin", "fmax",
    "copysign", "assign",
}  # fmt: skip
"""Operations that do not round"""


def off(p: Program, rng: np.random.Generator) -> list[float]:
    """Of each node, the factor by which its result is another last place: 1 where the operation is exact."""
    signs = rng.choice((-1.0, 1.0), len(p.nodes))
    return [1.0 if node.op in EXACT else 1.0 + x * EPSILON for node, x in zip(p.nodes, signs, strict=True)]


EPSILON = float(np.finfo(float).eps)


def function_of(
    name: str, p: Program, inputs: Sequence[str], factors: Sequence[float] | None = None
) -> tuple[ca.Function, set[str]]:
    """The program as a CasADi function again, and which of the inputs it takes; ``factors`` for the results of its nodes."""
    taken: dict[int, int] = {}  # input -> how many of its elements, up to the last that is used
    for node in p.nodes:
        if node.op == "input":
            taken[node.place[0]] = max(taken.get(node.place[0], 0), node.place[1] + 1)
    symbols = [ca.SX.sym(key, taken.get(k, 1)) for k, key in enumerate(inputs)]
    values: list[ca.SX] = []
    for node in p.nodes:
        if node.op == "const":
            values.append(ca.SX(node.value))
        elif node.op == "input":
            values.append(symbols[node.place[0]][node.place[1]])
        else:
            code, a = getattr(ca, f"OP_{node.op.upper()}"), [values[i] for i in node.args]
            value = ca.SX.unary(code, *a) if len(a) == 1 else ca.SX.binary(code, *a)
            values.append(_with_nan(value, *a) if node.op in ("fmin", "fmax") else value)
        if factors is not None and factors[len(values) - 1] != 1:
            values[-1] = values[-1] * factors[len(values) - 1]
    outputs = [ca.vertcat(*(ca.densify(values[i]) for i in output)) if output else ca.SX(0, 1) for output in p.outputs]
    return ca.Function(name, symbols, outputs), {inputs[k] for k in taken}


def _with_nan(value: ca.SX, a: ca.SX, b: ca.SX) -> ca.SX:
    """``value``, but NaN where a or b is: C's fmin and fmax, which CasADi calls, take the other one."""
    for x in (a, b):
        number = x * x >= -1  # which CasADi does not take for granted, and NaN is not
        value = ca.if_else(number, value, x)
    return value
