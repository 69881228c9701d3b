"""Traced loops kept in the cache folder, so that another process need not trace them: as JSON, by all that tracing depends on.

That is the content of all objects, the versions of the libraries and this package's own code. Where an object's code is not this
package's, a controller of one's own say, nothing can be told of it, and nothing is kept. What is read is what was written, by a
checksum bound to the file's name, and every index in it is looked at: anything else is told, and made again.
"""

import contextlib
import gc
import hashlib
import json
import logging
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from types import FunctionType, MethodType
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import PPoly

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.build import cache_folder
from k1607_pin.compiled.checked import require_same
from k1607_pin.compiled.closed_loop import ClosedLoop, Setup
from k1607_pin.compiled.leaves import Layout, is_ours
from k1607_pin.compiled.program import Node, Program
from k1607_pin.compiled.sound import require_sound
from k1607_pin.compiled.tables import Table, Tables
from k1607_pin.compiled.traced_loop import traced
from k1607_pin.files import write_atomically
from k1607_pin.turns import Turns

logger = logging.getLogger(__name__)

PACKAGE = "k1607_pin"


class _UnknownError(Exception):
    """Something whose code, or content, cannot be told."""


def kept(
    setup: Setup,
    varied: Sequence[str],
    metrics: Mapping[str, Sequence[str]],
    logged: Sequence[str],
    initial_state: Any = None,
) -> ClosedLoop:
    """What `traced` gives for these arguments: from the cache folder if it is there, else made and put there.

    Code of this package that has been replaced at run time is not seen.
    """
    with _no_collection():
        return _kept(setup, varied, metrics, logged, initial_state)


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """Thousands of small objects are made that stay: to look among them for cyclic garbage takes longer than to read them."""
    with _TURNS.taken():
        _was.append(gc.isenabled())
        gc.disable()
        try:
            yield
        finally:
            _put_back()


_was: list[bool] = []


def _put_back() -> None:
    if any(_was):
        gc.enable()
    _was.clear()


_TURNS = Turns(_put_back)


def _kept(setup: Setup, *rest: Any) -> ClosedLoop:
    try:
        key = _key(setup, *rest)
    except (_UnknownError, RecursionError):
        return _made(setup, *rest)
    file = cache_folder() / f"{key}.json"
    try:
        content = file.read_bytes()
    except OSError:
        content = None
    if content is not None:
        try:
            return _read(_unsealed(file.name, content), setup, rest[-1])
        except (ValueError, LookupError, TypeError, AttributeError, RuntimeError) as error:
            logger.warning("%s is damaged, and made again: %s", file, error)
    loop = _made(setup, *rest)
    # not into a home that may not be written, and no functions that are not where their names say
    with contextlib.suppress(OSError, _UnknownError):
        write_atomically(file, _sealed(file.name, _written(loop, setup)))
    return loop


def _sealed(name: str, told: Any) -> bytes:
    """A line with the checksum, and the JSON of what is told."""
    content = json.dumps(told).encode()
    return _checksum(name, content) + b"\n" + content


def _unsealed(name: str, content: bytes) -> Any:
    checksum, _, rest = content.partition(b"\n")
    if checksum != _checksum(name, rest):
        raise ValueError("its checksum is another one")
    return json.loads(rest)


def _checksum(name: str, content: bytes) -> bytes:
    return hashlib.sha256(f"{name}\0".encode() + content).hexdigest().encode()


def _made(setup: Setup, *rest: Any) -> ClosedLoop:
    loop = traced(setup, *rest)
    require_same(setup, loop, rest[-1])
    return loop


# What tracing depends on


def _key(setup: Setup, *rest: Any) -> str:
    made = hashlib.sha256(_code().encode())
    for x in (vars(setup), *rest):
        _describe(x, made.update)
    return made.hexdigest()[:32]


@cache
def _code() -> str:
    """Of this package's code and the versions of what it runs on."""
    made = hashlib.sha256(repr((sys.version_info, *map(version, ("casadi", "numpy", "pin", "scipy")))).encode())
    folders = [files(PACKAGE)]
    while folders:
        for entry in sorted(folders.pop().iterdir(), key=lambda x: x.name):
            if entry.is_dir():
                folders.append(entry)
            elif entry.name.endswith(".py"):
                made.update(entry.read_bytes())
    return made.hexdigest()


def _describe(x: Any, tell: Callable[[bytes], Any]) -> None:
    """Tell all bytes that make x what it is, so that no two things tell the same."""
    kind = f"{type(x).__module__}.{type(x).__qualname__}"
    tell(kind.encode() + b"(")
    if x is None or isinstance(x, bool | int | float | str | np.number):
        tell(repr(x).encode())
    elif isinstance(x, np.ndarray) and x.dtype.kind in "fiub":
        tell(f"{x.dtype.str}{x.shape}".encode() + x.tobytes())
    elif isinstance(x, Arm):
        tell(f"{x.tool_frame!r}{x.model.saveToString()}".encode())
    elif isinstance(x, FunctionType | MethodType):
        owner = getattr(x, "__self__", None)
        found: Any = sys.modules[x.__module__] if owner is None else owner
        for name in (x.__qualname__ if owner is None else x.__name__).split("."):
            found = getattr(found, name, None)
        if x.__module__.partition(".")[0] != PACKAGE or found != x:
            raise _UnknownError(kind)
        tell(f"{x.__module__}.{x.__qualname__}".encode())
        _describe(owner, tell)
    elif type(x) in (tuple, list) or (isinstance(x, tuple) and _ours(x)):
        for item in x:
            _describe(item, tell)
    elif type(x) is dict:
        for name, item in x.items():
            _describe((name, item), tell)
    elif isinstance(x, PPoly) and kind.startswith("scipy."):
        _describe((x.c, x.x, x.extrapolate, x.axis), tell)
    elif _ours(x) and hasattr(x, "__dict__"):
        _describe(vars(x), tell)
    else:
        raise _UnknownError(kind)
    tell(b")")


def _ours(x: Any) -> bool:
    return is_ours(type(x)) and "<locals>" not in type(x).__qualname__


# How it is written


def _written(loop: ClosedLoop, setup: Setup) -> dict[str, Any]:
    return {
        "n": loop.n,
        "programs": {name: _listing(p) for name, p in loop.programs.items()},
        "law_tables": _tables_written(loop.law_tables, setup),
        "physics_tables": _tables_written(loop.physics_tables, setup),
        "parameters": loop.parameters,
        "state_is_given": loop.state_is_given,
        "metrics": loop.metrics,
        "logged": loop.logged,
        "stages": loop.stages,
        "weights": loop.weights,
    }


def _read(found: dict[str, Any], setup: Setup, initial_state: Any) -> ClosedLoop:
    still = np.zeros(found["n"])
    state = initial_state if found["state_is_given"] else setup.controller.initial(still, still)
    loop = ClosedLoop(
        n=found["n"],
        programs={name: _program(x) for name, x in found["programs"].items()},
        law_tables=_tables(found["law_tables"], setup),
        physics_tables=_tables(found["physics_tables"], setup),
        parameters={name: tuple(shape) for name, shape in found["parameters"].items()},
        state=Layout(state, "the controller's state"),
        state_is_given=found["state_is_given"],
        metrics=tuple((name, reducer, tuple(shape)) for name, reducer, shape in found["metrics"]),
        logged=tuple((name, tuple(shape)) for name, shape in found["logged"]),
        stages=found["stages"],
        weights=found["weights"],
    )
    require_sound(loop, setup)
    return loop


def _listing(p: Program) -> str:
    """A line a node, "mul 3 4", "const 0.5" or "input 1 0", and at the end one an output."""
    lines = []
    for node in p.nodes:
        rest = (node.value,) if node.op == "const" else node.place if node.op == "input" else node.args
        lines.append(" ".join((node.op, *map(repr, rest))))
    return "\n".join([*lines, *(" ".join(("output", *map(str, output))) for output in p.outputs)])


def _program(listing: str) -> Program:
    nodes, outputs = [], []
    for line in listing.splitlines():
        op, *rest = line.split(" ")
        if op == "const":
            nodes.append(Node(op, value=float(rest[0])))
        elif op == "output":
            outputs.append(tuple(map(int, rest)))
        elif op == "input":
            nodes.append(Node(op, place=(int(rest[0]), int(rest[1]))))
        else:
            nodes.append(Node(op, tuple(map(int, rest))))
    return Program(tuple(nodes), tuple(outputs))


def _tables_written(tables: Tables, setup: Setup) -> dict[str, Any]:
    for name, x in (*((t.name, t.fun) for t in tables.tables), *((s.rpartition(".")[0], x) for s, x in tables.noise)):
        try:
            there = _named(setup, name)
        except (LookupError, AttributeError, ValueError):
            raise _UnknownError(name) from None
        if not (there is x or (isinstance(x, MethodType) and there == x)):
            raise _UnknownError(name)
    return {
        "tables": [(table.name, table.at and table.at.serialize(), table.first) for table in tables.tables],
        "noise": [seed for seed, _ in tables.noise],
    }


def _tables(found: dict[str, Any], setup: Setup) -> Tables:
    tables = []
    for name, at, first in found["tables"]:
        fun = _named(setup, name)
        tables.append(Table(name, fun, at and ca.Function.deserialize(at), Layout(fun(0.0), name), first))
    return Tables(tuple(tables), tuple((seed, _named(setup, seed.rpartition(".")[0])) for seed in found["noise"]))


def _named(setup: Setup, path: str) -> Any:
    """What stands in the setup under a dotted name such as "controller.path"."""
    x: Any = setup
    for name in path.split("."):
        if isinstance(x, Mapping):
            x = x[name]
        elif isinstance(x, tuple | list) and not hasattr(x, "_fields"):
            x = x[int(name)]
        else:
            x = getattr(x, name)
    return x
