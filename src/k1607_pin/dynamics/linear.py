"""Linear systems small enough to be written out, for floats and traced symbols."""

from typing import Any

import numpy as np
from scipy.linalg.lapack import dposv


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


def solve_definite(A: Any, B: Any) -> Any:
    """A^-1 B for a symmetric positive definite A (m, m) and B (m,) or (m, k); the upper triangle of A counts."""
    if type(A) is type(B) is np.ndarray:
        _, X, failed = dposv(A, B)  # Cholesky, at a third of np.linalg.solve's cost
        return (
            np.linalg.solve(A, B) if failed else X.reshape(B.shape)
        )  # which takes what rounding has left short of definite
    # Symbols: CasADi's own solve of a full system loses with the square of the condition, 1e-7 at 1e5, and takes twice the steps.
    L = np.linalg.cholesky(A)
    return np.linalg.solve(L.T, np.linalg.solve(L, B))
