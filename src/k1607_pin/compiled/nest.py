"""What a nest of numbers is made of: tuples, lists, mappings, and objects by their attributes."""

import copy
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from enum import Enum
from functools import cached_property, partial
from types import FunctionType, MethodType, SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
from casadi.casadi import ArrayInterface

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.traced_arm import Pose


class TracingError(TypeError):
    """Something that cannot be compiled, and which operation stands in the way."""


def is_named_tuple(x: Any) -> bool:
    """Whether x is an instance of a NamedTuple."""
    return isinstance(x, tuple) and hasattr(x, "_fields")


def is_number(x: Any) -> bool:
    """Whether x is a float, an int (bool apart) or an array of them."""
    if isinstance(x, np.ndarray):
        return x.dtype.kind in "fiu"
    return isinstance(x, int | float | np.number) and not isinstance(x, bool | complex | np.complexfloating)


OPAQUE = sys.stdlib_module_names | {"numpy", "casadi", "pinocchio", "scipy", "xarray", "pandas", "coal", "hppfcl"}
"""Packages into whose objects nobody looks"""


def is_open(x: Any) -> bool:
    """Whether x is an object that is what its attributes are: of a dataclass, or of any class written in Python."""
    kind = type(x)
    if isinstance(x, type | Arm | Enum | BaseException | np.ndarray | np.generic) or is_traced(x):
        return False
    if kind is SimpleNamespace or hasattr(kind, "__dataclass_fields__"):
        return True
    return kind.__module__.partition(".")[0] not in OPAQUE and bool(hasattr(x, "__dict__") or _slots(kind))


def is_traced(x: Any) -> bool:
    """Whether x is an array of symbols."""
    return isinstance(x, ArrayInterface)


def attributes(x: Any) -> dict[str, Any]:
    """Of an object that `is_open`: in its dictionary, and in slots."""
    there = {name: getattr(x, name) for name in _slots(type(x)) if hasattr(x, name)}
    return {**there, **getattr(x, "__dict__", {})}


def _slots(kind: type) -> list[str]:
    found = []
    for one in reversed(kind.__mro__):
        names = one.__dict__.get("__slots__", ())
        for name in (names,) if isinstance(names, str) else names:
            if not (name.startswith("__") and name.endswith("__")):
                found.append(f"_{one.__name__.lstrip('_')}{name}" if name.startswith("__") else name)
    return found


def is_cached(x: Any, name: str) -> bool:
    """Whether an attribute is what an object computes when it is first asked, of the others alone."""
    return isinstance(getattr(type(x), name, None), cached_property)


def parts(x: Any) -> list[tuple[str, Any]] | None:
    """Names and values of what x is made of, in order; None for a number, and for what is taken as a whole."""
    if is_number(x) or isinstance(x, str):
        return None
    if is_named_tuple(x):
        return list(zip(x._fields, x, strict=True))
    if isinstance(x, tuple | list | deque):
        return [(str(k), item) for k, item in enumerate(x)]
    if isinstance(x, Mapping):
        return [(str(name), item) for name, item in x.items()]
    if isinstance(x, pin.SE3):
        return [("translation", x.translation.copy()), ("rotation", x.rotation.copy())]
    if is_open(x):
        return [(name, item) for name, item in attributes(x).items() if not is_cached(x, name)]
    return None


def remade(x: Any, values: Sequence[Any]) -> Any:
    """x with other values of its `parts`, made without asking x: what it checks, symbols would not pass."""
    if is_named_tuple(x):
        return type(x)._make(values)
    if isinstance(x, deque):
        return type(x)(values, x.maxlen)
    if isinstance(x, tuple | list):
        return type(x)(values)
    if isinstance(x, Mapping):
        found = dict(zip(x, values, strict=True))
        if not isinstance(x, dict) or type(x) is dict:
            return found
        made = copy.copy(x)  # with what a class of its own, or a default, adds to it
        made.update(found)
        return made
    if isinstance(x, pin.SE3):
        position, rotation = values
        return pin.SE3(rotation, position) if isinstance(position, np.ndarray) else Pose(position, rotation)
    made = copy.copy(x)
    for (name, _), value in zip(parts(x) or (), values, strict=True):
        object.__setattr__(made, name, value)
    for name in [name for name in getattr(made, "__dict__", {}) if is_cached(x, name)]:
        del made.__dict__[name]
    return made


def same_whole(a: Any, b: Any) -> bool:
    """Whether two things that are no nests and no numbers are the same: functions by their code and what they hold."""
    if a is b:
        return True
    if type(a) is not type(b):
        return False
    if isinstance(a, FunctionType | MethodType | partial):
        one, other = _content(a), _content(b)
        return len(one) == len(other) and all(same(x, y) for x, y in zip(one, other, strict=True))
    try:
        return bool(np.all(a == b))
    except Exception:  # an object that cannot be compared
        return False


def same(a: Any, b: Any) -> bool:
    """Whether two nests are the same, numbers and all."""
    if a is b:
        return True
    one, other = parts(a), parts(b)
    if one is None or other is None:
        return type(a) is type(b) and (np.array_equal(a, b, equal_nan=True) if is_number(a) else same_whole(a, b))
    return [k for k, _ in one] == [k for k, _ in other] and all(
        same(x, y) for (_, x), (_, y) in zip(one, other, strict=True)
    )


def functions_within(x: Any) -> list[tuple[str, Any]]:
    """Names and values of what a function holds beside its code."""
    if isinstance(x, MethodType):
        return [("owner", x.__self__)]
    if isinstance(x, partial):
        return [("function", x.func), ("args", x.args), ("keywords", x.keywords)]
    if not isinstance(x, FunctionType):
        return []
    cells = zip(x.__code__.co_freevars, x.__closure__ or (), strict=True)
    held = []
    for name, cell in cells:
        with suppress(ValueError):  # not bound yet
            held.append((name, cell.cell_contents))
    return [*held, ("defaults", x.__defaults__), ("keywords", x.__kwdefaults__)]


def _content(x: Any) -> list[Any]:
    code = x.__func__.__code__ if isinstance(x, MethodType) else getattr(x, "__code__", None)
    return [code, *(value for _, value in functions_within(x))]
