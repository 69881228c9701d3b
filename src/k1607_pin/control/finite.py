"""What is not finite neither enters a law nor leaves it: one decorator for the ``update`` of every law.

A traced law cannot raise. There a sample that is not finite is flagged, by the rollout and by the exported C.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from functools import wraps
from typing import Any

import numpy as np

from k1607_pin.arguments import is_symbolic, number, numbers, seen_through, shown


class NotFiniteError(ValueError):
    """Something that is not finite came to a law, or would have left it. The law's state is what it was."""

    def __init__(self, name: str, value: Any, reason: str = "") -> None:
        self.name, self.value, self._reason = name, value, reason
        """What is not finite, ``q`` or ``state.gains.K_p`` say, and its value"""
        super().__init__(f"{name}: expected finite numbers, got {shown(value)}{reason}")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.name, self.value, self._reason)


Update = Callable[..., tuple[Any, Any, Mapping[str, Any]]]


def finite_only(update: Update) -> Update:
    """``update(law, t, q, v, state)`` that refuses what is not finite, and hands nothing out that is not; symbols pass.

    The law has an ``arm``. What its ``path``, ``sensor`` and ``posture`` give is looked at when nothing finite comes of it.

    Raises
    ------
    NotFiniteError
        t, q, v, the state, what a path or a sensor gives, or, when all of them are finite, the torque or the next state is not.
    ValueError
        q or v of another shape than (n,), t that is no number.
    """

    @wraps(update)
    def checked(law: Any, t: Any, q: Any, v: Any, state: Any) -> tuple[Any, Any, Mapping[str, Any]]:
        q, v = entering(law.arm.n, t, q, v, state)
        try:
            torque, after, log = update(law, t, q, v, state)
        except Exception as error:
            if found := next(_not_finite_in_sources(law, t, q, v), None):
                raise NotFiniteError(*found) from error
            raise
        if not is_finite((torque, after)):
            for found in _not_finite_in_sources(law, t, q, v):
                raise NotFiniteError(*found)
            leaving(torque, after)
        return torque, after, log

    return checked


def entering(n: int, t: Any, q: Any, v: Any, state: Any) -> tuple[Any, Any]:
    """q and v as (n,) floats, when they, the time and the state are finite; symbols as they are.

    Raises
    ------
    NotFiniteError
        It names what is not.
    ValueError
        Wrong shapes, or no real numbers.
    """
    is_plain = isinstance(t, float) and type(q) is type(v) is np.ndarray and q.dtype == v.dtype == FLOAT
    if is_plain and q.shape == v.shape == (n,) and math.isfinite(sum(q.tolist(), t) + sum(v.tolist()) + _total(state)):
        return q, v
    _time(t)
    q, v = _vector("q", q, (n,)), _vector("v", v, (n,))
    for found in not_finite("state", state):
        raise NotFiniteError(*found)
    return q, v


def leaving(torque: Any, state: Any) -> None:
    """Refuse, by `NotFiniteError`, a torque or a next state that is not finite."""
    for found in (*not_finite("torque", torque), *not_finite("next state", state)):
        raise NotFiniteError(*found, "; what came in was finite: the gains or the errors have run away")


FLOAT = np.dtype(float)
SHORT = 16  # entries, up to which Python adds faster


def is_finite(x: Any) -> bool:
    """Whether all numbers in x are finite: a number, an array, or tuples, lists and mappings of them.

    Symbols, and what is no number, count as finite.
    """
    return math.isfinite(_total(x)) or not any(True for _ in not_finite("", x))


def _total(x: Any) -> float:
    """A finite number if all of x are, short of an overflow: a third of the cost of looking at each."""
    if type(x) is np.ndarray and x.dtype == FLOAT:
        return sum(x.tolist()) if x.ndim == 1 and len(x) < SHORT else float(np.vdot(x, x))
    if x is None:
        return 0.0
    if isinstance(x, tuple):
        total = 0.0
        for part in x:
            total += _total(part)
        return total
    return 0.0 if not any(True for _ in not_finite("", x)) else math.nan


def not_finite(name: str, x: Any) -> Iterator[tuple[str, Any]]:
    """Name and value of each part of x that `is_finite` does not take."""
    if isinstance(x, tuple | list | Mapping):
        keys = x if isinstance(x, Mapping) else getattr(x, "_fields", range(len(x)))
        values = x.values() if isinstance(x, Mapping) else x
        for key, part in zip(keys, values, strict=True):
            yield from not_finite(f"{name}.{key}" if hasattr(x, "_fields") else f"{name}[{key!r}]", part)
    elif (
        isinstance(x, float | np.ndarray | np.number) and np.asarray(x).dtype.kind in "fc" and not np.isfinite(x).all()
    ):
        yield name, x


def _time(t: Any) -> None:
    if isinstance(t, float | np.floating) and not math.isfinite(t):
        raise NotFiniteError("t", t)
    seen_through("t", t, lambda name, x: number(name, x, unit="s"))


def _vector(name: str, x: Any, shape: tuple[int]) -> Any:
    if is_symbolic(x):
        return x
    x = numbers(name, x, shape, finite=False)
    if not np.isfinite(x).all():
        raise NotFiniteError(name, x)
    return x


POINT = ("position", "rotation", "velocity", "angular_velocity", "acceleration", "angular_acceleration")


def _not_finite_in_sources(law: Any, t: Any, q: Any, v: Any) -> Iterator[tuple[str, Any]]:
    """Of what the law asks: its path, its posture's path, its sensor."""
    if is_symbolic(t) or is_symbolic(q):
        return
    if callable(path := getattr(law, "path", None)):
        point = path(t)
        for field in POINT:
            yield from not_finite(f"path({t:g}).{field}", _as_array(getattr(point, field, None)))
    if callable(path := getattr(getattr(law, "posture", None), "path", None)):
        for name, x in zip(("angles", "velocities"), path(t), strict=False):
            yield from not_finite(f"posture.path({t:g}), {name}", _as_array(x))
    if callable(sensor := getattr(law, "sensor", None)):
        yield from not_finite(f"sensor({t:g}, q, v)", _as_array(sensor(t, q, v)))


def _as_array(x: Any) -> Any:
    return x if x is None or is_symbolic(x) else np.asarray(x)
