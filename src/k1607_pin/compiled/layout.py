"""How a nest of numbers lies in one vector: a controller's state, a point of its path."""

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from k1607_pin.arguments import shown
from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.nest import TracingError, is_number, is_traced, parts, remade, same_whole

DEEPEST = 50
"""Nests in nests; a nest that holds itself has no end"""
_ANYTHING = object()


class Layout:
    """Of the nests that are built as ``sample`` is; ``name`` is what messages call them.

    Anything may be flattened by ``Layout(None)``.
    """

    def __init__(self, sample: Any, name: str = "it") -> None:
        self._sample, self._name = sample, name
        self._like = _ANYTHING
        self.size = len(self.flat(sample))
        self._like = _ANYTHING if sample is None and name == "it" else sample
        shapes = [np.shape(x) for _, x in named_numbers(sample)]
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)]).tolist()
        self._leaves = [(slice(a, b), shape) for (a, b), shape in zip(pairwise(ends), shapes, strict=True)]

    def flat(self, x: Any) -> list[Any]:
        """All numbers of x, in order; those of arrays row by row, those of mappings in the sample's order.

        Raises
        ------
        TracingError
            x is built otherwise than the sample, or differs from it in what is no number.
        """
        out: list[Any] = []
        self._flatten(x, self._like, out, "", 0)
        return out

    def _flatten(self, x: Any, like: Any, out: list[Any], path: str, depth: int) -> None:
        if depth > DEEPEST:
            raise TracingError(
                f"{self._name}: expected at most {DEEPEST} levels of nesting, {path[:80]}... goes deeper: it may contain itself"
            )
        if is_number(x) or is_traced(x):
            entries = _entries(x)
            if like is not _ANYTHING:
                self._require_number(x, len(entries), like, path)
            out.extend(entries)
            return
        if isinstance(x, Arm):
            raise TracingError(f"{self._name}: expected numbers, got an Arm{_at(path)}")
        here = parts(x)
        if like is _ANYTHING:
            for key, item in here or ():
                self._flatten(item, like, out, f"{path}.{key}" if path else key, depth + 1)
            return
        there = parts(like)
        if here is None or there is None:
            self._require_same(x, like, path)
            return
        if isinstance(x, Mapping):  # an update may give a state in another order
            given = dict(here)
            here = [(key, given[key]) for key, _ in there] if given.keys() == dict(there).keys() else here
        if len(here) != len(there) or any(a != b for (a, _), (b, _) in zip(here, there, strict=True)):
            wanted, got = (", ".join(key for key, _ in one) or "nothing" for one in (there, here))
            raise TracingError(
                f"{self._name}: expected what it was at first{_at(path)}, of {wanted}, always, got one of {got}"
            )
        for (key, item), (_, other) in zip(here, there, strict=True):
            self._flatten(item, other, out, f"{path}.{key}" if path else key, depth + 1)

    def _require_number(self, x: Any, count: int, like: Any, path: str) -> None:
        if not is_number(like):
            raise TracingError(
                f"{self._name}: expected {shown(like)}{_at(path)} always, as at first, got a number or an array: what differs "
                "from time to time is to be a number from the first, a flag 0.0 or 1.0"
            )
        shape = np.shape(like)
        if count != int(np.prod(shape)) or (is_number(x) and np.shape(x) != shape and count != 1):
            got = f"{count} numbers" if is_traced(x) else f"shape {np.shape(x)}"
            raise TracingError(
                f"{self._name}: expected numbers of shape {shape}{_at(path)} always, as at first, got {got}"
            )

    def _require_same(self, x: Any, like: Any, path: str) -> None:
        if is_number(like) or not same_whole(x, like):
            raise TracingError(
                f"{self._name}: expected {shown(like)}{_at(path)} always, as at first, got {shown(x)}: what differs from time to "
                "time must be numbers, a flag 0.0 or 1.0"
            )

    def fill(self, x: Any, vector: np.ndarray) -> None:
        """Put all numbers of x, floats and arrays, into ``vector`` (size or more,)."""
        vector[: self.size] = self.flat(x)

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
            there = parts(x)
            return x if there is None else remade(x, [rebuild(item) for _, item in there])

        return rebuild(self._sample)


def named_numbers(x: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted names and the numbers and arrays themselves of a nest, in the order of `Layout`."""
    if is_number(x):
        yield path, x
    for name, item in parts(x) or ():
        yield from named_numbers(item, f"{path}.{name}" if path else name)


def paths(x: Any) -> list[str]:
    """Dotted names of all numbers of a nest, with their shapes where they are arrays."""
    return [f"{name or 'it'}{list(np.shape(number)) or ''}" for name, number in named_numbers(x)]


def _at(path: str) -> str:
    return f" for {path}" if path else ""


def _entries(x: Any) -> list[Any]:
    if isinstance(x, np.ndarray):
        return x.ravel().tolist()
    flat = np.reshape(x, (-1,)) if np.ndim(x) else [x]
    return [flat[k] for k in range(len(flat))]
