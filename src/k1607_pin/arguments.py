"""What a public function asks of its arguments, in one place: each check names the argument, what it expected, what came.

Values that are not numbers (a tracer's symbols, polynomials, arrays of objects) pass `seen_through` functions untouched.
"""

from collections.abc import Callable
from contextlib import suppress
from numbers import Real
from typing import Any

import numpy as np

NUMERIC = "biuf"  # dtype kinds whose entries are real numbers
HUGE = 1e150  # squares of more overflow


def shown(x: Any, most: int = 120) -> str:
    """x as a message shows it: on one line, cut where it is long."""
    try:
        text = " ".join(repr(x).split())
    except Exception:  # a broken __repr__ must not hide the message it stands in
        text = f"an object of type {type(x).__name__}"
    return text if len(text) <= most else f"{text[:most]}..."


def is_symbolic(x: Any) -> bool:
    """Whether x is a tracer's symbol, or holds some: of no NumPy dtype that has numbers."""
    if isinstance(x, bool | int | float | complex | str | bytes | np.generic) or x is None:
        return False
    if isinstance(x, np.ndarray):
        if x.dtype != object:
            return False
        return not any(entry is None or isinstance(entry, str | bytes | dict) for entry in x.flat)
    if isinstance(x, list | tuple):
        return any(is_symbolic(entry) for entry in x)
    return hasattr(x, "__array_ufunc__") or hasattr(x, "__array_function__")


def as_floats(name: str, x: Any, expected: str = "real numbers") -> np.ndarray:
    """x as an array of float64: complex numbers, masked entries, text and objects are refused, not made to fit."""
    if np.ma.isMaskedArray(x) and np.ma.getmaskarray(x).any():
        raise ValueError(f"{name}: expected {expected}, got a masked array; fill it first, with x.filled(value)")
    try:
        array = np.asarray(x)
    except (ValueError, TypeError):  # rows of several lengths, an object that is no array
        array = np.asarray(None)
    if array.dtype == object and all(isinstance(entry, Real) for entry in array.flat):
        with suppress(OverflowError):  # a whole number beyond any float: refused below
            array = array.astype(float)
    if array.dtype.kind not in NUMERIC:
        raise ValueError(f"{name}: expected {expected}, got {shown(x)}")
    return array.astype(float, copy=False)


def numbers(
    name: str, x: Any, shape: tuple[int | None, ...] | None = None, unit: str = "", finite: bool = True
) -> np.ndarray:
    """x as float64 of ``shape`` (None: any length there; no shape: any at all), finite unless ``finite`` is False.

    >>> numbers("q", [0.1, 0.2], (2,), "rad")
    array([0.1, 0.2])
    """
    expected = described(shape, unit, finite)
    array = as_floats(name, x, expected)
    if shape is not None and not _fits(array.shape, shape):
        raise ValueError(f"{name}: expected {expected}, got shape {array.shape}")
    if finite and not np.isfinite(array).all():
        raise ValueError(f"{name}: expected {expected}, got {shown(array)}")
    return array


def number(
    name: str,
    x: Any,
    above: float | None = None,
    at_least: float | None = None,
    unit: str = "",
    finite: bool = True,
) -> float:
    """x as a float, within the bounds that are given.

    >>> number("period", 0.01, above=0, unit="s")
    0.01
    """
    bound = "a number" if above is None and at_least is None else ""
    if above is not None:
        bound = "a positive number" if above == 0 else f"a number > {above:g}"
    if at_least is not None:
        bound = f"a number >= {at_least:g}"
    expected = f"{bound} in {unit}" if unit else bound
    try:
        array = as_floats(name, x, expected)
    except ValueError:
        raise ValueError(f"{name}: expected {expected}, got {shown(x)}") from None
    good = array.ndim == 0 and not isinstance(x, bool | np.bool_)
    if good:
        value = float(array)
        good = not np.isnan(value) and (abs(value) < HUGE or not finite)
        good = good and (above is None or value > above) and (at_least is None or value >= at_least)
    if not good:
        size = f", of size below {HUGE:.0e}" if finite and array.ndim == 0 and HUGE <= abs(array) < np.inf else ""
        raise ValueError(f"{name}: expected {expected}{size}, got {shown(x)}")
    return value


def whole(name: str, x: Any, at_least: int) -> int:
    """x as a whole number; what counts is one that says so: 3, not 3.0 or True.

    >>> whole("starts", 3, 1)
    3
    """
    if not isinstance(x, int | np.integer) or isinstance(x, bool) or x < at_least:
        raise ValueError(f"{name}: expected a whole number of at least {at_least}, got {shown(x)}")
    return int(x)


def seen_through(name: str, x: Any, check: Callable[..., Any], *arguments: Any) -> Any:
    """``check(name, x, ...)``, or x as it is where it is a tracer's: symbols have no values to look at."""
    return x if is_symbolic(x) else check(name, x, *arguments)


def described(shape: tuple[int | None, ...] | None, unit: str, finite: bool) -> str:
    """ "(7,) finite numbers in rad"."""
    words = []
    if shape is not None:
        inside = ", ".join("n" if n is None else str(n) for n in shape)
        words.append(f"({inside},)" if len(shape) == 1 else f"({inside})")
    words.append("finite numbers" if finite else "numbers")
    if unit:
        words.append(f"in {unit}")
    return " ".join(words)


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(shape) == len(wanted) and all(n in (None, m) for n, m in zip(wanted, shape, strict=True))
