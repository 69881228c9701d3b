"""The numbers inside controllers, plants and payloads, found and replaced by their dotted names."""

import copy
import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import partial
from types import CellType, FunctionType, MethodType
from typing import Any

import numpy as np
from pinocchio import SE3

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.layout import Layout, named_numbers, paths
from k1607_pin.compiled.nest import attributes, functions_within, is_named_tuple, is_number, is_open, parts, remade

__all__ = [
    "Layout", "apart", "children", "is_named_tuple", "is_number", "is_ours", "lasts", "named_numbers", "numbers", "opened",
    "paths", "replaced", "substituted",
]  # fmt: skip

logger = logging.getLogger(__name__)


def children(x: Any) -> Iterator[tuple[str, Any]]:
    """Names and values of what x is made of; nothing for what this package does not look into."""
    if is_named_tuple(x):
        yield from zip(x._fields, x, strict=True)
    elif isinstance(x, tuple | list):
        yield from ((str(k), item) for k, item in enumerate(x))
    elif isinstance(x, Mapping):
        yield from x.items()
    elif is_dataclass(x) and not isinstance(x, type):
        yield from ((field.name, getattr(x, field.name)) for field in fields(x) if field.init)


def numbers(x: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """All numbers below x by their dotted names."""
    found: dict[str, np.ndarray] = {}
    for name, child in children(x):
        if is_number(child):
            found[prefix + name] = np.asarray(child, dtype=float)
        else:
            found.update(numbers(child, f"{prefix}{name}."))
    return found


def lasts(x: Any) -> bool:
    """Whether x cannot become another thing but by changing its `numbers`: what was made from it may be kept."""
    if type(x) is tuple or (isinstance(x, tuple) and is_ours(type(x))):
        return all(map(lasts, x))
    if is_dataclass(x) and is_ours(type(x)):
        frozen: bool = getattr(type(x), "__dataclass_params__").frozen  # noqa: B009  not known to the type checker
        return frozen and all(lasts(child) for _, child in children(x))
    if isinstance(x, FunctionType):
        return is_ours(x)
    return x is None or is_number(x) or isinstance(x, Arm | bool | str)


def is_ours(made: Any) -> bool:
    """Whether a class or function is this package's: one's own may read what changes, a variable around it, a global one."""
    return str(made.__module__).partition(".")[0] == __name__.partition(".")[0]


def replaced(x: Any, values: Mapping[str, Any]) -> Any:
    """x with some of its numbers others, made anew, so that its own checks are run on them.

    Raises
    ------
    ValueError
        What x itself refuses.
    """
    if not values:
        return x
    here: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        first, _, rest = name.partition(".")
        here.setdefault(first, {})[rest] = value
    parts = dict(children(x))
    new = {name: below[""] if "" in below else replaced(parts[name], below) for name, below in here.items()}
    if is_named_tuple(x):
        return x._replace(**new)
    if isinstance(x, tuple | list):
        return type(x)(new.get(name, item) for name, item in parts.items())
    if isinstance(x, Mapping):
        return {**x, **new}
    return replace(x, **new)


StandIn = Callable[[Any, str, Mapping[str, Any]], Any]
Seen = dict[int, tuple[Any, Any]]
"""Objects by their id, and what stands for them: so that what is one object remains one, and what holds itself has an end"""


def substituted(x: Any, symbols: Mapping[str, Any], stand_in: StandIn, path: str = "", seen: Seen | None = None) -> Any:
    """A copy of x with symbols for some of its numbers, made without asking x: what it checks, symbols would not pass.

    Parameters
    ----------
    symbols : by dotted name.
    stand_in : of an object, its dotted name and the symbols below it, what to put in its place; None to look inside.
    """
    if path in symbols:
        return symbols[path]
    below = {name: s for name, s in symbols.items() if name.startswith(f"{path}." if path else "")}
    seen = {} if seen is None else seen
    if not below and id(x) in seen:
        return seen[id(x)][1]
    if (other := stand_in(x, path, below)) is not None:
        if not below:
            seen[id(x)] = x, other
        return other
    return opened(x, below, stand_in, path, seen)


def opened(x: Any, symbols: Mapping[str, Any], stand_in: StandIn, path: str, seen: Seen) -> Any:
    """`substituted` for what x is made of, and of functions for what they hold; x itself where there is nothing inside."""

    def go(name: str, child: Any) -> Any:
        return substituted(child, symbols, stand_in, f"{path}.{name}" if path else name, seen)

    if isinstance(x, FunctionType | MethodType | partial):
        return _function_opened(x, go)
    if is_open(x):
        try:
            made = copy.copy(x)
        except Exception as error:  # one of a kind: a connection, say
            logger.debug("copy of %r: %r", type(x), error)
            return x
        if made is x:
            return x
        if not symbols:
            seen[id(x)] = x, made
        for name, child in attributes(x).items():
            object.__setattr__(made, name, go(name, child))
        return made
    here = None if isinstance(x, SE3) else parts(x)
    return x if here is None else remade(x, [go(name, child) for name, child in here])


def _function_opened(x: Any, go: Callable[[str, Any], Any]) -> Any:
    """A function that holds others, by its closure or as defaults; itself where nothing in it is another."""
    if isinstance(x, MethodType):
        owner = go("owner", x.__self__)
        return x if owner is x.__self__ else MethodType(x.__func__, owner)
    if isinstance(x, partial):
        args, keywords = go("args", x.args), go("keywords", x.keywords)
        fun = _function_opened(x.func, go) if isinstance(x.func, FunctionType | MethodType | partial) else x.func
        return partial(fun, *args, **keywords)
    held = dict(functions_within(x))
    new = {name: child if child is x else go(name, child) for name, child in held.items()}  # it may call itself
    if all(new[name] is child for name, child in held.items()):
        return x
    names = zip(x.__code__.co_freevars, x.__closure__ or (), strict=True)
    cells = tuple(CellType(new[name]) if name in new else cell for name, cell in names)
    made = FunctionType(x.__code__, x.__globals__, x.__name__, new["defaults"], cells)
    made.__kwdefaults__ = new["keywords"]
    made.__dict__.update(x.__dict__)
    return made


def apart(x: Any) -> Any:
    """A copy that may be changed, where one can be made."""
    try:
        return copy.deepcopy(x)
    except Exception as error:  # a lock, a connection: it is asked itself then
        logger.debug("copy of %r: %r", type(x), error)
        return x
