"""Any number of rollouts, in chunks, on whatever executes them; what is done is kept."""

import math
import os
import pickle
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import closing
from functools import lru_cache, partial
from numbers import Integral
from typing import Any

import numpy as np
import xarray as xr

from k1607_pin.compiled.chunks import Cut
from k1607_pin.compiled.lanes import processors
from k1607_pin.compiled.rollout import Rollouts
from k1607_pin.compiled.samples import Drawn, Grid, Listed, digest
from k1607_pin.compiled.store import InMemory, InStore, Variable
from k1607_pin.compiled.workers import Task, Workers, go_on_unless
from k1607_pin.turns import Turns

Samples = Grid | Listed | Drawn

IN_MEMORY = 2**30
"""Bytes of results above which a store is asked for"""
LEAST, MOST, CHUNKS, CHUNK_BYTES, CHUNK_STEPS = 64, 16384, 64, 2**24, 2**24
"""The default chunk: no fewer and no more rollouts, so small that there are so many chunks, no more bytes and physics steps: an
interruption loses a second or so of each worker's time"""

Progress = Callable[[int, int, float, float], None]
"""Rollouts done and wanted, rollouts per second of this call, seconds left"""


def sweep(
    run: Rollouts | Callable[[], Rollouts],
    parameters: Samples,
    q0: Any = None,
    v0: Any = None,
    executor: Executor | Callable[[], Executor] | None = None,
    chunk: int | None = None,
    store: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
    ahead: int | None = None,
) -> xr.Dataset:
    """Rollouts over a grid, a list, or distributions of parameters: any number of them, on one machine or many.

    Results depend neither on the executor nor on the chunks, nor on interruptions.

    Parameters
    ----------
    run : of `rollouts`; or a module's function that makes them, for what cannot be sent to other processes.
    parameters : for all that ``run`` varies, and for "q0" or "v0" if you like.
    q0, v0 : (n,) rad, rad/s where the parameters do not say; v0 None for rest.
    executor : of `concurrent.futures`, dask's ``Client.get_executor()``, mpi4py.futures; or a function that makes one, called
        again when its workers die. None for as many threads as there are processors.
    chunk : rollouts given out at once, at most; None for one that suits the results' size.
    store : a folder (or URL) for zarr, which then holds the results. Called again after an interruption, the sweep goes on.
    progress : see `Progress`; called after each chunk, and first with what an earlier call has done.
    ahead : chunks given out before one is back, which bounds memory; None for twice the workers, or 128.

    Returns
    -------
    Dataset as of `rollout`, with the parameters' dimensions for ``rollout``, and their values; of a store, not yet read. What
    has run away is told by ``failed_at``.

    Raises
    ------
    ValueError
        Names or shapes that do not fit, results too large for memory without a store, the store of another sweep, what cannot
        be sent to processes; see `rollout` as well.
    WorkersLostError
        A chunk has lost its workers three times, or the executor is broken for good. What was done is in the store.
    """
    if not isinstance(run, Rollouts) and not callable(run):
        raise ValueError(f"run: expected what `rollouts` makes, or a function that makes it, got {run!r:.80}")
    if not isinstance(parameters, Samples):
        raise ValueError(f"parameters: expected a Grid, Listed or Drawn, got {parameters!r:.80}")
    loop = run if isinstance(run, Rollouts) else run()
    fixed = {name: x for name, x in (("q0", q0), ("v0", v0)) if name not in parameters.along}
    _require(loop, parameters, q0, v0, chunk, ahead, executor)
    begins = loop.run if {"q0", "v0"} & set(parameters.along) else loop  # where all begin alike, its start is asked
    sample = _rollouts(begins, fixed, parameters.values(0, 1))
    variables = _variables(sample, parameters)
    count = math.prod(parameters.dims.values())
    size = sum(x.size for x in variables.values())
    if store is None and size > IN_MEMORY:
        raise ValueError(f"store: expected a folder for results of {size / 2**30:.1f} GiB, got None")
    cut = Cut.of(parameters.dims, int(chunk) if chunk else _chunk(count, size // count, loop.samples * loop.substeps))
    frame = sample.drop_vars(list(sample.data_vars))
    if store is None:
        kept: InMemory | InStore = InMemory(frame, variables, parameters.along, cut)
    else:
        identity = {
            "closed loop": loop.fingerprint(),
            "engine": sample.attrs["engine"],
            "first rollout": digest(np.concatenate([x.values.ravel() for x in sample.data_vars.values()])),
            "dimensions": str(parameters.dims),
            "chunk": str(cut.box),
            **{name: "rest" if x is None else digest(x) for name, x in fixed.items()},
            **parameters.identity(),
        }
        kept = InStore(os.fspath(store), frame, variables, parameters.along, cut, identity)
    told = _Told(progress, count, sum(cut.size(int(k)) for k in np.flatnonzero(kept.done)))
    try:
        with Workers(executor or partial(ThreadPoolExecutor, processors())) as workers:
            work = (None if isinstance(parameters, Listed) else parameters), fixed
            sent = (loop, *work) if workers.in_threads else _packed((run, *work))
            tasks = _tasks(cut, kept.done, sent, parameters, workers.halt)
            with closing(workers.results(_computed, tasks, ahead)) as results:
                for k, arrays in results:
                    kept.write(k, arrays)
                    told(cut.size(k))
    except KeyboardInterrupt as interruption:
        where = (
            f"are in {store}, and the same call goes on from there" if store is not None else "are lost: give a store"
        )
        interruption.add_note(f"sweep: stopped; {told.done:,} of {count:,} rollouts are done. They {where}")
        raise
    return kept.opened()


class _Told:
    """Progress, and how fast it is."""

    def __init__(self, progress: Progress | None, total: int, done: int) -> None:
        self._progress, self._total, self._before, self.done = progress, total, done, done
        self._start = time.monotonic()
        if done:
            self(0)

    def __call__(self, more: int) -> None:
        self.done += more
        rate = (self.done - self._before) / max(time.monotonic() - self._start, 1e-9)
        missing = self._total - self.done
        left = missing / rate if rate else math.inf if missing else 0.0
        if self._progress:
            self._progress(self.done, self._total, rate, left)


def _tasks(cut: Cut, done: np.ndarray, sent: Any, parameters: Samples, halt: str) -> Iterator[Task]:
    for k in range(cut.count):
        if not done[k]:
            start, stop = cut.stretch(k)
            # of a list, only the stretch: a long one is not to be sent again and again
            listed = parameters.values(start, stop) if isinstance(parameters, Listed) else None
            yield k, (sent, start, stop, listed, halt)


def _computed(
    sent: Any, start: int, stop: int, listed: Mapping[str, np.ndarray] | None, halt: str
) -> dict[str, np.ndarray]:
    """Parameters and results of a chunk; runs in the worker."""
    loop, parameters, fixed = _unpacked(sent) if isinstance(sent, bytes) else sent
    values = parameters.values(start, stop) if listed is None else listed
    found = _rollouts(loop.run, fixed, values, lambda _: go_on_unless(halt))
    return {**values, **{str(name): x.values for name, x in found.data_vars.items()}}


def _rollouts(
    loop: Callable[..., xr.Dataset], fixed: Mapping[str, Any], values: Mapping[str, np.ndarray], piece_done: Any = None
) -> xr.Dataset:
    given = {**fixed, **values}
    q0, v0 = given.pop("q0"), given.pop("v0")
    return loop(q0, v0, given, threads=1, progress=piece_done)


def _packed(work: Any) -> bytes:
    try:
        from cloudpickle import dumps  # lambdas and what a script defines, too
    except ImportError:
        from pickle import dumps
    try:
        return dumps(work)
    except Exception as error:
        raise ValueError(
            "executor: expected a closed loop that can be sent to other processes (with cloudpickle, functions within functions "
            f"too), or for run a module's function that makes it, got {type(error).__name__}: {error}"
        ) from error


_TURNS = Turns()


def _unpacked(work: bytes) -> Any:
    with _TURNS.taken():  # a worker of many threads makes the closed loop once
        return _made(work)


@lru_cache(maxsize=4)
def _made(work: bytes) -> Any:
    run, *rest = pickle.loads(work)
    return run if isinstance(run, Rollouts) else run(), *rest


def _variables(sample: xr.Dataset, parameters: Samples) -> dict[str, Variable]:
    """What there will be: the parameters, and the results of one rollout for all of them."""
    dims = parameters.dims
    made: dict[str, Variable] = {}
    for name, x in parameters.values(0, 1).items():
        own = tuple(f"{name}_{k}" for k in range(x.ndim - 1))
        made[name] = Variable((parameters.along[name], *own), (dims[parameters.along[name]], *x.shape[1:]), {})
    if both := set(made) & set(map(str, sample.data_vars)):
        raise ValueError(f"parameters: expected names other than the results', got {', '.join(sorted(both))} as both")
    for result, found in sample.data_vars.items():
        rest = tuple(str(dim) for dim in found.dims[1:])
        made[str(result)] = Variable((*dims, *rest), (*dims.values(), *found.shape[1:]), found.attrs)
    return made


def _chunk(count: int, size: int, steps: int) -> int:
    """Rollouts of a chunk, where there are ``count``, of ``size`` bytes and so many physics ``steps`` each."""
    return max(1, min(max(LEAST, -(-count // CHUNKS)), MOST, CHUNK_BYTES // size, max(LEAST, CHUNK_STEPS // steps)))


def _require(
    loop: Rollouts, parameters: Samples, q0: Any, v0: Any, chunk: int | None, ahead: int | None, executor: Any
) -> None:
    wanted, given = set(loop.varied), set(parameters.along)
    if wanted != given - {"q0", "v0"}:
        raise ValueError(
            f"parameters: expected {', '.join(loop.varied) or 'nothing'} and q0, v0 at will, got {', '.join(given)}"
        )
    for name, x in (("q0", q0), ("v0", v0)):
        if name in given and x is not None:
            raise ValueError(f"{name}: expected none beside the parameters', got {x!r}")
        if x is not None and np.shape(x) != (loop.loop.n,):
            raise ValueError(
                f"{name}: expected ({loop.loop.n},), got shape {np.shape(x)}; many of them go to parameters"
            )
    if "q0" not in given and q0 is None:
        raise ValueError("q0: expected where the rollouts start, got None, and parameters do not say")
    for name, x in (("chunk", chunk), ("ahead", ahead)):
        if x is not None and (not isinstance(x, Integral) or x < 1):
            raise ValueError(f"{name}: expected a whole number from 1 on, got {x!r}")
    if executor is not None and not isinstance(executor, Executor) and not callable(executor):
        raise ValueError(f"executor: expected one of concurrent.futures or a function that makes it, got {executor!r}")
