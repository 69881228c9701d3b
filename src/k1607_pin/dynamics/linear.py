"""Linear systems small enough to be written out, for floats and traced symbols."""

from typing import Any

import numpy as np
from scipy.linalg.lapack import dposv


def solve_symmetric(A: Any, B: Any) -> Any:
    """A^-1 B for a symmetric positive definite A (n, n) and B (n,) or (n, k), as L^T D L: n divisions and no root.

    From the last row up, so that a mass matrix's zeros between branches stay zeros in L (Featherstone, 2008, section 6.5), and
    so do those of B's last rows in the first sweep.
    """
    n = len(B)
    L, inverse = _factors(A)
    y: list[Any] = [None] * n
    for i in reversed(range(n)):
        y[i] = B[i] - sum(L[k][i] * y[k] for k in range(i + 1, n))
    x: list[Any] = [None] * n
    for i in range(n):
        x[i] = y[i] * inverse[i] - sum(L[i][k] * x[k] for k in range(i))
    return np.stack(x)


def solve_definite(A: Any, B: Any) -> Any:
    """A^-1 B for a symmetric positive definite A (n, n) and B (n,) or (n, k), by LAPACK for floats; the upper triangle counts."""
    if not type(A) is type(B) is np.ndarray:
        return solve_symmetric(A, B)
    _, X, failed = dposv(A, B)  # Cholesky, at a third of np.linalg.solve's cost
    # which takes what rounding has left short of definite
    return np.linalg.solve(A, B) if failed else X.reshape(B.shape)


def inverse_definite(A: Any) -> Any:
    """A^-1, symmetric to the bit, of a symmetric positive definite A (n, n)."""
    n = len(A)
    if type(A) is np.ndarray:
        X = solve_definite(A, np.eye(n))
        return (X + X.T) / 2
    L, inverse = _factors(A)
    N: list[list[Any]] = [[None] * n for _ in range(n)]  # L^-1, below its ones
    for j in range(n):
        for i in range(j + 1, n):
            N[i][j] = -(L[i][j] + sum(L[i][k] * N[k][j] for k in range(j + 1, i)))
    scaled = [[inverse[j] * N[i][j] for j in range(i)] for i in range(n)]
    # A^-1 = L^-1 D^-1 L^-T: row i, column j, j <= i
    X = [[inverse[i] if i == j else scaled[i][j] for j in range(i + 1)] for i in range(n)]
    for i in range(n):
        for j in range(i + 1):
            X[i][j] = X[i][j] + sum(scaled[i][k] * N[j][k] for k in range(j))
    return np.stack([np.stack([X[max(i, j)][min(i, j)] for j in range(n)]) for i in range(n)])


def smallest_eigenvalue(A: Any) -> Any:
    """Of a symmetric A (n, n), to rounding of its largest; for symbols by Jacobi's rotations, written out."""
    if type(A) is np.ndarray:
        return np.linalg.eigvalsh(A)[0]
    n = A.shape[0]
    a = [[A[i, j] for j in range(n)] for i in range(n)]
    for _ in range(SWEEPS):
        for p in range(n):
            for q in range(p + 1, n):
                # tan of the angle that takes a[p][q] away, the smaller one; TINY where there is nothing to take away
                half, off = (a[q][q] - a[p][p]) / 2, a[p][q]
                side = np.where(half < 0, -1.0, 1.0)
                t = side * off / (np.abs(half) + np.sqrt(half * half + off * off) + TINY)
                c = 1 / np.sqrt(1 + t * t)
                s = t * c
                a[p][p], a[q][q] = a[p][p] - t * off, a[q][q] + t * off
                a[p][q] = a[q][p] = 0.0
                for k in range(n):
                    if k not in (p, q):
                        a[p][k], a[q][k] = c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]
                        a[k][p], a[k][q] = a[p][k], a[q][k]
    least = a[0][0]
    for k in range(1, n):
        least = np.minimum(least, a[k][k])
    return least


SWEEPS = 6  # of Jacobi's method, which converges quadratically: 6 x 6 is at rounding after five
TINY = 1e-300


def _factors(A: Any) -> tuple[list[list[Any]], list[Any]]:
    """L, whose rows i have entries for k < i below ones on the diagonal, and the inverse of the diagonal D: A = L^T D L."""
    n = len(A)
    L: list[list[Any]] = [[None] * i for i in range(n)]
    scaled: list[list[Any]] = [[None] * i for i in range(n)]  # D L
    inverse: list[Any] = [None] * n
    for j in reversed(range(n)):
        inverse[j] = 1 / (A[j, j] - sum(scaled[k][j] * L[k][j] for k in range(j + 1, n)))
        for i in range(j):
            scaled[j][i] = A[i, j] - sum(scaled[k][i] * L[k][j] for k in range(j + 1, n))
            L[j][i] = scaled[j][i] * inverse[j]
    return L, inverse
