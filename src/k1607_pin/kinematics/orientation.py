"""Orientation for users: the formulas of `k1607_pin.kinematics.rotations`, (24)-(38), behind a check of their arguments.

Single values or batches, (..., 3, 3) and (..., 4); a tracer's symbols and polynomials pass as they are. What is of another shape,
not finite, or a matrix that is no rotation raises a `ValueError` that names the argument. Quaternions are taken as they are, of
length one or not.
"""

from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import Any, ParamSpec, TypeVar

import numpy as np

from k1607_pin.arguments import as_floats, is_symbolic, shown
from k1607_pin.kinematics import rotations

RIGID = 1e-4  # deviation of R R^T from the identity that passes as rounding, of digits copied by hand say

P = ParamSpec("P")
Result = TypeVar("Result")


def finite(name: str, x: Any, shape: tuple[int, ...]) -> Any:
    """x as (..., *shape) finite floats; symbols as they are."""
    if is_symbolic(x):
        return x
    expected = f"(..., {', '.join(map(str, shape))}) finite numbers"
    array = as_floats(name, x, expected)
    if array.shape[array.ndim - len(shape) :] != shape:
        raise ValueError(f"{name}: expected {expected}, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: expected {expected}, got {shown(array)}")
    return array


def rotation_matrix(name: str, R: Any) -> Any:
    """R as (..., 3, 3) rotation matrices, off by `RIGID` at most; symbols as they are."""
    R = finite(name, R, (3, 3))
    if isinstance(R, np.ndarray) and R.dtype != object:
        # what is far off would only overflow
        near = np.clip(R, -2, 2)
        off = np.abs(near @ np.swapaxes(near, -1, -2) - np.eye(3))
        if not (off < RIGID).all() or not (np.linalg.det(near) > 0).all():
            raise ValueError(f"{name}: expected (..., 3, 3) rotation matrices, got {shown(R)}")
    return R


def quaternion_numbers(name: str, q: Any) -> Any:
    """(..., 4)"""
    return finite(name, q, (4,))


def small_rotation(name: str, R: Any) -> Any:
    """(..., 3, 3): to first order a rotation, so that it need not be one."""
    return finite(name, R, (3, 3))


def triple(name: str, s: Any) -> Any:
    """(..., 3)"""
    return finite(name, s, (3,))


def _door(formula: Callable[P, Result], check: Callable[[str, Any], Any]) -> Callable[P, Result]:
    """``formula`` behind a check of each of its arguments."""
    names = tuple(signature(formula).parameters)

    @wraps(formula)
    def door(*arguments: P.args, **named: P.kwargs) -> Result:
        checked = (check(name, x) for name, x in zip(names, arguments, strict=False))
        rest = arguments[len(names) :]  # too many: Python says so
        return formula(*checked, *rest, **{name: check(name, x) for name, x in named.items()})  # type: ignore[arg-type]

    door.__module__ = __name__
    return door


quaternion_by_division = _door(rotations.quaternion_by_division, rotation_matrix)
quaternion = _door(rotations.quaternion, rotation_matrix)
rotation = _door(rotations.rotation, quaternion_numbers)
cross_matrix = _door(rotations.cross_matrix, triple)
conjugate = _door(rotations.conjugate, quaternion_numbers)
product = _door(rotations.product, quaternion_numbers)
relative_quaternion_base = _door(rotations.relative_quaternion_base, quaternion_numbers)
relative_quaternion_body = _door(rotations.relative_quaternion_body, quaternion_numbers)
rotation_vector = _door(rotations.rotation_vector, rotation_matrix)
differential_rotation = _door(rotations.differential_rotation, small_rotation)
orientation_error = _door(rotations.orientation_error, rotation_matrix)
