"""How fast compiled rollouts are on this machine, beside Pinocchio's C++ in the same run."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.ready import ready_postures
from k1607_pin.compiled.batch import Batch, batch
from k1607_pin.compiled.build import compiler
from k1607_pin.compiled.export.presets import law_of
from k1607_pin.compiled.lanes import processors
from k1607_pin.compiled.native import Native
from k1607_pin.compiled.program import Program
from k1607_pin.compiled.rollout import rollouts

PERIOD, STEP = 0.01, 0.001  # s
ROUNDS = 9
ABA = "Pinocchio's abaInParallel, C++, a state"


class Measured(NamedTuple):
    """One line of what `bench` finds."""

    work: str
    seconds: float
    """of one piece of it, median"""
    operations: int | None
    """floating-point operations of one piece, where it is compiled"""
    beside: str
    """what was done in turn with it"""
    ratio: float | None
    """how many times as long that takes, median of the rounds"""


def bench(
    arm: Arm, count: int = 4096, rounds: int = ROUNDS, done: Callable[[str], Any] = lambda work: None
) -> list[Measured]:
    """Time rollouts, dynamics and a control tick of an arm: some seconds.

    Parameters
    ----------
    count : rollouts a round, and a sixteenth of the states; rounds : of which medians are taken.
    done : told each piece of work that has been timed.

    Raises
    ------
    RuntimeError
        There is no C compiler, or the arm's control law does not hold it.
    """
    found: list[Measured] = []

    def add(*line: Any) -> None:
        found.append(Measured(*line))
        done(found[-1].work)

    if compiler() is None:
        raise RuntimeError("no C compiler was found; `k1607 doctor` tells more")
    rng = np.random.default_rng(0)
    q = ready_postures(arm)[0] + 1e-3 * rng.normal(size=(16 * count, arm.n))
    v, tau = 1e-3 * rng.normal(size=(2, 16 * count, arm.n))
    theirs = _aba(arm, q, v, tau)

    law = law_of(arm, "cartesian" if arm.n >= 6 else "joint", PERIOD)
    run = rollouts(arm, law, 0.1, PERIOD, STEP, metrics={})
    start = q[:count]
    if (lost := int(np.isfinite(run(start).failed_at).sum())) > 0:
        raise RuntimeError(f"{lost} of {count} loops ran away: what they take means nothing")
    steps = round(0.1 / STEP)
    loop, other = in_turn(rounds, lambda: run(start, threads=1), theirs)
    tick = _operations(run.loop.programs["law"]) * STEP / PERIOD
    add(
        "closed loop, a physics step, one core", _median(loop) / count / steps,
        round(_operations(run.loop.programs["motion"]) + tick), ABA, float(np.median(other / 16 * steps / loop)),
    )  # fmt: skip
    if (threads := processors()) > 1:
        one, many = in_turn(rounds, lambda: run(start, threads=1), lambda: run(start, threads=threads))
        ratio = float(np.median(one / many))
        add(f"the same, {threads} threads", _median(many) / count / steps, None, "one thread", ratio)
    forward = batch(arm, "forward_dynamics")
    memory = forward.empty(len(q))
    ours, other = in_turn(rounds, lambda: forward(q, v, tau, threads=1, out=memory), theirs)
    operations = _operations(forward.program)
    add("forward dynamics, a state, one core", _median(ours) / len(q), operations, ABA, _ratio(other, ours))
    if arm.n >= 6:
        space: Batch = batch(arm, "operational_space")
        memory = space.empty(len(q))
        (ours,) = in_turn(rounds, lambda: space(q, v, threads=1, out=memory))
        add("Λ, Φ, Γ, J of a state, one core", _median(ours) / len(q), _operations(space.program), "", None)
    native, state = Native(law), law.start(q[0], v[0], 1.0)
    ours, other = in_turn(
        rounds,
        lambda: [native.update(0.5, q[0], v[0], state) for _ in range(100)],
        lambda: [law.update(0.5, q[0], v[0], state) for _ in range(100)],
    )
    add("control tick from Python, natively", _median(ours) / 100, None, "the law in NumPy", _ratio(other, ours))
    return found


def in_turn(rounds: int, *functions: Callable[[], Any]) -> np.ndarray:
    """(len(functions), rounds) s of each, called one after the other, round after round, after one that is not counted."""
    times = np.empty((rounds + 1, len(functions)))
    for row in times:
        for k, f in enumerate(functions):
            start = time.perf_counter()
            f()
            row[k] = time.perf_counter() - start
    return times[1:].T


def _aba(arm: Arm, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> Callable[[], Any]:
    pool, out = pin.ModelPool(arm.model, 1), np.empty((arm.n, len(q)), order="F")
    columns = [np.asfortranarray(x.T) for x in (q, v, tau)]

    def run() -> None:
        pin.abaInParallel(1, pool, *columns, out)

    return run


def _median(x: np.ndarray) -> float:
    return float(np.median(x))


def _ratio(theirs: np.ndarray, ours: np.ndarray) -> float:
    return float(np.median(theirs / ours))


def _operations(p: Program) -> int:
    return sum(p.operations.values())
