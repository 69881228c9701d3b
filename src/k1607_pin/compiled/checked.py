"""A traced closed loop held against controller, plant and world on numbers: what a trace cannot see is found by what it does.

A counter in the controller, a random number, a state of words, an error that is caught: all of these trace, and into something
else.
"""

import contextlib
import copy
import functools
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from k1607_pin.compiled import nest
from k1607_pin.compiled.closed_loop import INPUTS, ClosedLoop, Setup, is_of_arm, start_of
from k1607_pin.compiled.interpreted import Interpreter
from k1607_pin.compiled.leaves import apart, is_number, numbers, paths, replaced
from k1607_pin.compiled.reasons import reason
from k1607_pin.compiled.traced_arm import inertial_parameters
from k1607_pin.compiled.traced_loop import torque_of
from k1607_pin.compiled.tracer import TracingError
from k1607_pin.simulation import torques

logger = logging.getLogger(__name__)

TIMES = np.concatenate([np.arange(13) * 0.01, np.geomspace(0.2, 100.0, 13)])  # s
AGREE = 1e-9  # of the largest entry so far: rounding is a millionth of it, where nothing has run away
SHARE = 1e-6
MIDDLE, SWING, SPEED = 0.1, 0.05, 0.1  # rad times 1, 2, ...; rad; rad/s


def require_same(setup: Setup, loop: ClosedLoop, initial_state: Any = None) -> None:
    """Run the controller on numbers at some states and times, one after the other, and the traced loop beside it.

    As it is, and with other numbers where they may vary.

    Raises
    ------
    TracingError
        They differ, a state is built otherwise than the one before, or the controller keeps something to itself.
    """
    _require_same(setup, loop, initial_state)
    if (moved := _moved(setup, loop)) is not setup:
        try:
            _require_same(moved, loop, initial_state)
        except TracingError as error:
            raise TracingError(
                f"{error}. So with other values of what varies ({', '.join(loop.parameters)}): what an object derives of its "
                "numbers when it is made, in __post_init__ or a cached_property, is not derived anew; derive it where it is used"
            ) from None


def _moved(setup: Setup, loop: ClosedLoop) -> Setup:
    """With the numbers that may vary a tenth larger, and those that are zero a tenth, as far as their owners allow it."""
    seeds = {name for name, _ in loop.law_tables.noise}
    for name in loop.parameters:
        root, _, rest = name.partition(".")
        if root in ROOTS and name not in seeds and not is_of_arm(name):
            x = numbers(getattr(setup, root))[rest]
            for moved in (np.where(x == 0, TENTH, (1 + TENTH) * x), (1 + TENTH) * x):
                with contextlib.suppress(Exception):  # a rotation, say, would be none
                    changed = replaced(getattr(setup, root), {rest: moved if x.ndim else float(moved)})
                    setup = replace(setup, **{root: changed})
                    break
    return setup


ROOTS = ("plant", "controller", "external")
TENTH = 0.1


def _require_same(setup: Setup, loop: ClosedLoop, initial_state: Any) -> None:
    n, controller = loop.n, apart(setup.controller)
    k = np.arange(len(TIMES))[:, None]
    Q = MIDDLE * np.arange(1.0, n + 1) + SWING * np.sin(k + np.arange(n))
    V = SPEED * np.cos(1.7 * k + np.arange(n))
    state = apart(initial_state) if loop.state_is_given else controller.initial(Q[0], V[0])
    built, own = paths(state), attributes(controller)
    states, nests, rows = [], [], []
    for t, q, v in zip(TIMES, Q, V, strict=True):
        before = loop.state.flat(state)
        try:
            with np.errstate(all="ignore"):
                kept = apart(state)
                asked, state, log = controller.update(float(t), q.copy(), v.copy(), state)
        except Exception as error:  # at a state that was made up: nothing can be told from there on
            logger.debug("controller.update at t = %s: %r", t, error)
            break
        if np.shape(asked) != (n,):
            raise TracingError(f"controller.update: expected a torque of shape ({n},), got {np.shape(asked)}")
        require_built(paths(state), built)
        states.append(before)
        nests.append(kept)
        rows.append(_outputs(setup, loop, asked, state, log, float(t), q, v))
    require_unchanged(controller, own)
    if rows:
        count = len(rows)
        _compare(
            setup,
            loop,
            TIMES[:count],
            Q[:count],
            V[:count],
            np.array(states, dtype=float).reshape(count, -1),
            rows,
            nests,
        )


def _compare(
    setup: Setup,
    loop: ClosedLoop,
    times: np.ndarray,
    Q: np.ndarray,
    V: np.ndarray,
    states: np.ndarray,
    rows: Sequence[Any],
    nests: Sequence[Any],
) -> None:
    held = np.array([torques.motor(setup.plant, x[: loop.n]) for x in rows])
    tau = np.where(np.isfinite(held).all(axis=1)[:, None], held, 0.0)
    wanted = {"controller.update": np.array(rows, dtype=float)}
    if "initial" in loop.programs:
        wanted = {"controller.initial": _initial_states(setup, loop, Q, V)} | wanted
    steps = [_stepped(setup, float(t), q, v, x) for t, q, v, x in zip(times, Q, V, tau, strict=True)]
    wanted["plant, external, step"] = np.array(steps)
    parameters, noise = _parameters(setup, loop.parameters), _noise(loop, times)

    def found(run: Interpreter) -> dict[str, np.ndarray]:
        return _found(run, loop, times, Q, V, states, tau, parameters, noise)

    @functools.cache
    def rounded_anew() -> list[dict[str, np.ndarray]]:
        return [found(Interpreter(loop, np.random.default_rng(seed))) for seed in range(RUNS)]

    traced = found(Interpreter(loop))
    for what, expected in wanted.items():
        at = np.zeros(len(times)) if what == "controller.initial" else times
        count = len(expected)

        def rounding(what: str = what, count: int = count) -> np.ndarray:
            return rounding_of(traced[what][:count], [run[what][:count] for run in rounded_anew()])

        def why(k: int, what: str = what) -> str:
            t, q, v = float(times[k]), Q[k], V[k]
            holder = {"controller": setup.controller, "signals": setup.signals, "external": setup.external}
            ask: dict[str, Callable[[Any], Any]] = {
                "controller.update": lambda x: _asked(setup, x["controller"], x["signals"], t, q, v, apart(nests[k])),
                "controller.initial": lambda x: x["controller"].initial(q.copy(), v.copy()),
                "plant, external, step": lambda x: _stepped(replace(setup, external=x["external"]), t, q, v, tau[k]),
            }
            return reason(holder, ask[what])

        _require_close(what, at, traced[what][:count], expected, rounding, why)


def _asked(
    setup: Setup, controller: Any, signals: Mapping[str, Any], t: float, q: np.ndarray, v: np.ndarray, state: Any
) -> Any:
    """All that a sample gives, signals included."""
    tau, after, log = controller.update(t, q.copy(), v.copy(), state)
    log = {**log, "t": t, "q": q, "v": v, "tau": np.asarray(tau)}
    log["tool_position"] = setup.plant.arm.forward_kinematics(q).translation
    for name, signal in signals.items():
        log[name] = signal(log)
    return tau, after, log


RUNS = 4
ROUNDINGS, FEW_ROUNDINGS = 100, 10
"""Times its own rounding, as `RUNS` show it, that an entry may be off, as NumPy and Pinocchio add up in another order: where the
loop has run away, or the entry is small beside later ones; and elsewhere"""
RUN_AWAY = 1e6  # times what there was at first


def rounding_of(x: np.ndarray, others: Sequence[np.ndarray]) -> np.ndarray:
    """By how much other last places of all results in between move each entry of x; 0 where that is not finite."""
    with np.errstate(all="ignore"):
        apart = np.max([np.abs(other - x) for other in others], axis=0, initial=0.0)
    return np.where(np.isfinite(apart), apart, 0.0)


def _found(
    run: Interpreter,
    loop: ClosedLoop,
    times: np.ndarray,
    Q: np.ndarray,
    V: np.ndarray,
    states: np.ndarray,
    tau: np.ndarray,
    parameters: np.ndarray,
    noise: np.ndarray,
) -> dict[str, np.ndarray]:
    """What the programs give at all times, a row each."""
    count = len(times)
    now = {name: np.zeros((size, count)) for name, size in zip(INPUTS, loop.input_sizes, strict=True)}
    now |= {"q": Q.T, "v": V.T, "state": states.T, "more": np.repeat(start_of(loop.reducers)[:, None], count, axis=1)}
    now |= {"noise": noise, "parameters": np.repeat(parameters[:, None], count, axis=1), "shared": np.zeros((1, count))}
    now["hoisted"] = run.call("hoist", now)[0]
    begin = loop.law_tables.shared_values(np.zeros(count)).T
    made = (
        {"controller.initial": run.call("initial", now | {"shared": begin})[0].T} if "initial" in run.programs else {}
    )
    now["shared"] = loop.law_tables.shared_values(times).T
    made["controller.update"] = np.concatenate(run.call("law", now)).T
    now |= {"tau": tau.T, "shared": loop.physics_tables.shared_values(times).T}
    with np.errstate(all="ignore"):
        made["plant, external, step"] = np.concatenate(run.advance(now)).T
    return made


def _noise(loop: ClosedLoop, times: np.ndarray) -> np.ndarray:
    return np.array([[x for _, source in loop.law_tables.noise for x in source(float(t))] for t in times]).T


def _initial_states(setup: Setup, loop: ClosedLoop, Q: np.ndarray, V: np.ndarray) -> np.ndarray:
    """(at most all, size): what the controller begins with, until it refuses a state that was made up."""
    controller, rows = apart(setup.controller), []
    for q, v in zip(Q, V, strict=True):
        try:
            with np.errstate(all="ignore"):
                rows.append(loop.state.flat(controller.initial(q.copy(), v.copy())))
        except Exception as error:
            logger.debug("controller.initial at q = %s: %r", q, error)
            break
    return np.array(rows, dtype=float).reshape(len(rows), loop.state.size)


def _require_close(
    what: str,
    times: np.ndarray,
    traced: np.ndarray,
    wanted: np.ndarray,
    rounding: Callable[[], np.ndarray],
    why: Callable[[int], str],
) -> None:
    """Each column by its largest entry so far, or by `SHARE` of the largest of all so far, of which it may be a difference.

    Rows are times. What has grown by then does not excuse what is off before. Beyond that an entry may be off by what its
    ``rounding`` makes of it: at states that were made up, a loop may run away until little is left but rounding.
    """
    size = np.maximum.accumulate(np.where(np.isfinite(wanted), np.abs(wanted), 0.0))
    largest = size.max(axis=1, initial=0.0, keepdims=True)
    scale = np.maximum(size, np.maximum(SHARE * largest, 1e-3))
    with np.errstate(invalid="ignore"):
        off = np.abs(traced - wanted)
        same = (off <= AGREE * scale) | (traced == wanted) | (np.isnan(traced) & np.isnan(wanted))
        if not same.all():
            has_run_away = largest > RUN_AWAY * np.maximum(largest[:1], 1.0)
            many = has_run_away | (off <= AGREE * scale[-1])
            same |= off <= np.where(many, ROUNDINGS, FEW_ROUNDINGS) * rounding()
    if not same.all():
        k, i = np.argwhere(~same)[0]
        raise TracingError(
            f"{what}: traced it gives {traced[k, i]:.6g} where on numbers it gives {wanted[k, i]:.6g}, at t = {times[k]:g} s. "
            f"{why(int(k))}"
        )


def _outputs(
    setup: Setup,
    loop: ClosedLoop,
    asked: Any,
    after: Any,
    log: Mapping[str, Any],
    t: float,
    q: np.ndarray,
    v: np.ndarray,
) -> np.ndarray:
    """Limited torque, next state, metrics after one sample, and what is logged, in a row as the law's program gives them."""
    asked = np.asarray(asked, dtype=float)
    limited = "plant.torque_limit" in loop.parameters or np.isfinite(setup.plant.torque_limit).any()
    tau = torques.motor(setup.plant, asked)
    if limited:
        tau = np.where(np.isfinite(asked), tau, np.inf)
    if loop.logged or loop.metrics:
        log = {
            **log,
            "t": t,
            "q": q,
            "v": v,
            "tau": tau,
            "tool_position": setup.plant.arm.forward_kinematics(q).translation,
        }
        for name, signal in setup.signals.items():
            log[name] = signal(log)

    def row(name: str, shape: tuple[int, ...]) -> np.ndarray:
        x = np.asarray(log[name], dtype=float)
        if x.shape != shape:
            raise TracingError(f"log: expected {name!r} of shape {shape} always, got {x.shape} at t = {t:g} s")
        return np.ravel(x)

    first: dict[str, Any] = {"max": np.abs, "min": np.abs, "rms": np.square, "mean": np.copy, "last": np.copy}
    metrics = [first[reducer](row(name, shape)) for name, reducer, shape in loop.metrics]
    rows = [row(name, shape) for name, shape in loop.logged]
    return np.concatenate([tau, np.array(loop.state.flat(after), dtype=float), *metrics, *rows])


def _stepped(setup: Setup, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """(2 n,) where a physics step ends."""
    arm, external = setup.plant.arm, setup.external

    def acceleration(q: np.ndarray, v: np.ndarray) -> Any:
        push = 0.0 if external is None else torque_of(external, arm, t, q, v)
        return torques.acceleration(setup.plant, q, v, tau, push)

    return np.concatenate(setup.step(acceleration, q, v, setup.physics_step))


def _parameters(setup: Setup, names: Mapping[str, Any]) -> np.ndarray:
    """What the setup itself has for what may be varied."""
    roots = {
        "plant": setup.plant,
        "controller": setup.controller,
        "external": setup.external,
        "payloads": setup.schedule.changes,
    }
    arm = setup.plant.arm
    of_arm = {"inertial": inertial_parameters(arm), "armature": arm.armature, "gravity": arm.model.gravity.linear}
    there = {f"{root}.{name}": x for root, whole in roots.items() for name, x in numbers(whole).items()}
    values = [there[name] if name in there else of_arm[name.rpartition(".")[2]] for name in names]
    return np.concatenate([np.zeros(0), *(np.ravel(x) for x in values)])


def require_built(after: Sequence[str], first: Sequence[str]) -> None:
    """That a next state has the `paths` of the first, in whatever order.

    Raises
    ------
    TracingError
        It has not.
    """
    if sorted(after) != sorted(first):
        raise TracingError(
            f"controller.update: expected a next state as the first, {', '.join(first) or 'no number'}, got "
            f"{', '.join(after) or 'no number'}; the first is to have all that the later ones have, a flag as 0.0 or 1.0"
        )


def attributes(controller: Any) -> dict[str, Any]:
    """Its plain ones: numbers, arrays, words; not what it computes when it is first asked, of itself alone."""
    own = {name: x for name, x in nest.attributes(controller).items() if not nest.is_cached(controller, name)}
    return {name: copy.copy(x) for name, x in own.items() if is_number(x) or isinstance(x, bool | str)}


def require_unchanged(controller: Any, before: Mapping[str, Any]) -> None:
    """That it has the `attributes` that it had.

    Raises
    ------
    TracingError
        It has changed some.
    """
    now = attributes(controller)
    if changed := [name for name, x in now.items() if name not in before or not np.array_equal(x, before[name])]:
        raise TracingError(
            f"controller.update: expected a function of its arguments, it changes its own {', '.join(changed)}; what it is to "
            "remember belongs into the state that it returns"
        )
