"""Linear systems small enough to be written out, for floats and traced symbols."""

from typing import Any

import numpy as np


def solve_symmetric(A: Any, b: Any) -> Any:
    """x (n,) of A x = b for a symmetric positive definite A (n, n), as L D L^T: n divisions and no root."""
    n = len(b)
    L: list[list[Any]] = [[None] * n for _ in range(n)]
    scaled: list[list[Any]] = [[None] * n for _ in range(n)]  # L D
    inverse: list[Any] = []  # of D
    for j in range(n):
        inverse.append(1 / (A[j, j] - sum(scaled[j][k] * L[j][k] for k in range(j))))
        for i in range(j + 1, n):
            scaled[i][j] = A[i, j] - sum(scaled[i][k] * L[j][k] for k in range(j))
            L[i][j] = scaled[i][j] * inverse[j]
    y: list[Any] = []
    for i in range(n):
        y.append(b[i] - sum(L[i][k] * y[k] for k in range(i)))
    x: list[Any] = [None] * n
    for i in reversed(range(n)):
        x[i] = y[i] * inverse[i] - sum(L[k][i] * x[k] for k in range(i + 1, n))
    return np.stack(x)
