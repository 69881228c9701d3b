"""The numbers inside controllers, plants and payloads, found and replaced by their dotted names."""

import copy
import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from itertools import pairwise
from types import FunctionType
from typing import Any

import numpy as np

from k1607_pin.arm.arm import Arm

logger = logging.getLogger(__name__)


def is_named_tuple(x: Any) -> bool:
    """Whether x is an instance of a NamedTuple."""
    return isinstance(x, tuple) and hasattr(x, "_fields")


def is_number(x: Any) -> bool:
    """Whether x is a float, an int (bool apart) or an array of them."""
    if isinstance(x, np.ndarray):
        return x.dtype.kind in "fiu"
    return isinstance(x, int | float | np.number) and not isinstance(x, bool)


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


def substituted(x: Any, symbols: Mapping[str, Any], stand_in: StandIn, path: str = "") -> Any:
    """A copy of x with symbols for some of its numbers, made without asking x: what it checks, symbols would not pass.

    Parameters
    ----------
    symbols : by dotted name.
    stand_in : of an object, its dotted name and the symbols below it, what to put in its place; None to look inside.
    """
    if path in symbols:
        return symbols[path]
    below = {name: s for name, s in symbols.items() if name.startswith(f"{path}." if path else "")}
    if (other := stand_in(x, path, below)) is not None:
        return other

    def go(name: str, child: Any) -> Any:
        return substituted(child, symbols, stand_in, f"{path}.{name}" if path else name)

    if is_named_tuple(x):
        return type(x)(*(go(name, child) for name, child in children(x)))
    if isinstance(x, tuple | list):
        return type(x)(go(name, child) for name, child in children(x))
    if isinstance(x, Mapping):
        return {name: go(name, child) for name, child in children(x)}
    if is_dataclass(x) and not isinstance(x, type):
        made = copy.copy(x)
        for name, child in vars(x).items():
            object.__setattr__(made, name, go(name, child))
        return made
    return x


class Layout:
    """How a nest of numbers lies in one vector: of a controller's state, of a path's point."""

    def __init__(self, sample: Any) -> None:
        self._sample = sample
        self.size = len(self.flat(sample))
        shapes: list[tuple[int, ...]] = []
        self.mapped(lambda x: shapes.append(np.shape(x)))
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)]).tolist()
        self._leaves = [(slice(a, b), shape) for (a, b), shape in zip(pairwise(ends), shapes, strict=True)]

    def flat(self, x: Any) -> list[Any]:
        """All numbers of x, in order; those of arrays row by row, those of mappings in the sample's order."""
        out: list[Any] = []
        _flatten(x, out, self._sample)
        return out

    def fill(self, x: Any, vector: np.ndarray) -> None:
        """Put all numbers of x, floats and arrays, into ``vector`` (size or more,)."""
        taken = 0

        def put(x: Any, like: Any) -> None:
            nonlocal taken
            if isinstance(x, np.ndarray):
                vector[taken : taken + x.size] = x.ravel()
                taken += x.size
            elif is_number(x):
                vector[taken] = x
                taken += 1
            elif isinstance(x, Mapping):
                for key in _keys(x, like):
                    put(x[key], like[key] if isinstance(like, Mapping) and key in like else None)
            elif isinstance(x, tuple | list):
                for item, other in zip(x, _items(like, len(x)), strict=True):
                    put(item, other)
            elif is_dataclass(x) and not isinstance(x, type):
                for key, item in vars(x).items():
                    put(item, getattr(like, key, None))

        put(x, self._sample)

    def rebuilt(self, vector: Any) -> Any:
        """The nest of the entries of ``vector`` (size,)."""
        leaves = iter(self._leaves)

        def number(_: Any) -> Any:
            where, shape = next(leaves)
            return np.reshape(vector[where], shape) if shape else vector[where.start]

        return self.mapped(number)

    def mapped(self, number: Callable[[Any], Any]) -> Any:
        """The nest with something else for each number or array of numbers, asked for in order."""

        def rebuild(x: Any) -> Any:
            if is_number(x):
                return number(x)
            if is_named_tuple(x):
                return type(x)(*(rebuild(item) for item in x))
            if isinstance(x, tuple | list):
                return type(x)(rebuild(item) for item in x)
            if isinstance(x, Mapping):
                return {name: rebuild(item) for name, item in x.items()}
            if is_dataclass(x) and not isinstance(x, type):
                made = copy.copy(x)
                for name, item in vars(x).items():
                    object.__setattr__(made, name, rebuild(item))
                return made
            return x

        return rebuild(self._sample)


def named_numbers(x: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted names and the numbers and arrays themselves of a nest, in the order of `Layout`."""
    if is_number(x):
        yield path, x
        return
    items: Any = ()
    if is_named_tuple(x):
        items = zip(x._fields, x, strict=True)
    elif isinstance(x, tuple | list):
        items = enumerate(x)
    elif isinstance(x, Mapping):
        items = x.items()
    elif is_dataclass(x) and not isinstance(x, type):
        items = vars(x).items()
    for name, item in items:
        yield from named_numbers(item, f"{path}.{name}" if path else str(name))


def paths(x: Any) -> list[str]:
    """Dotted names of all numbers of a nest, with their shapes where they are arrays."""
    return [f"{name or 'it'}{list(np.shape(number)) or ''}" for name, number in named_numbers(x)]


def apart(x: Any) -> Any:
    """A copy that may be changed, where one can be made."""
    try:
        return copy.deepcopy(x)
    except Exception as error:  # a lock, a connection: it is asked itself then
        logger.debug("copy of %r: %r", type(x), error)
        return x


def _flatten(x: Any, out: list[Any], like: Any = None) -> None:
    if is_number(x) or hasattr(x, "_v"):  # a traced array too
        out.extend(_entries(x))
    elif isinstance(x, Mapping):
        for key in _keys(x, like):
            _flatten(x[key], out, like[key] if isinstance(like, Mapping) and key in like else None)
    elif isinstance(x, tuple | list):
        for item, other in zip(x, _items(like, len(x)), strict=True):
            _flatten(item, out, other)
    elif is_dataclass(x) and not isinstance(x, type):
        for key, item in vars(x).items():
            _flatten(item, out, getattr(like, key, None))
    elif isinstance(x, Arm):
        raise TypeError("expected numbers, got an Arm")


def _keys(x: Mapping[Any, Any], like: Any) -> Any:
    """Of x, in the order that ``like`` has them in: an update may give a state in another."""
    return like if isinstance(like, Mapping) and like.keys() == x.keys() else x


def _items(like: Any, count: int) -> Any:
    return like if isinstance(like, tuple | list) and len(like) == count else (None,) * count


def _entries(x: Any) -> list[Any]:
    flat = np.reshape(x, (-1,)) if np.ndim(x) else [x]
    return [flat[k] for k in range(len(flat))]
