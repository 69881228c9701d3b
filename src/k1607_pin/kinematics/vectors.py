"""Vectors and matrices taken apart into entries and put together again, for numbers, batches, symbols and polynomials."""

from typing import Any

import numpy as np


def components(x: Any) -> list[Any]:
    """The entries of the last axis of x (..., n): n times (...)."""
    first = np.moveaxis(x, -1, 0)
    return [first[i] for i in range(first.shape[0])]


def entries(M: Any) -> list[list[Any]]:
    """The rows of M (..., m, k) as lists: m times k times (...)."""
    first = np.moveaxis(M, (-2, -1), (0, 1))
    return [[first[i, j] for j in range(first.shape[1])] for i in range(first.shape[0])]


def vector(entries: list[Any]) -> Any:
    """(..., n) from n entries (...)."""
    return np.stack(entries, axis=-1)


def cross(a: list[Any], b: list[Any]) -> list[Any]:
    """Vector product of two triples of entries."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a: list[Any], b: list[Any]) -> Any:
    """Scalar product of two triples of entries."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
