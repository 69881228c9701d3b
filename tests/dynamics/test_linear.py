"""Small symmetric systems, as floats and as symbols, against NumPy."""

import casadi as ca
import numpy as np
import pytest

from k1607_pin.compiled.trace import numpy_mode, trace
from k1607_pin.dynamics.linear import inverse_definite, solve_definite, solve_symmetric

CONDITION = 1e4


def definite(rng, n):
    """(n, n) symmetric, with eigenvalues from 1 to `CONDITION`."""
    Q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    A = Q @ np.diag(np.geomspace(1, CONDITION, n)) @ Q.T
    return (A + A.T) / 2


def traced(fun, *arguments):
    """fun on symbols, evaluated at the arguments."""
    f = trace(fun, "f", [np.shape(x) for x in arguments])
    return f(*map(np.ravel, arguments)).full()


@pytest.mark.parametrize("n", [1, 2, 6, 7])
@pytest.mark.parametrize("columns", [None, 1, 5])
def test_solutions(n, columns):
    rng = np.random.default_rng(n)
    A, B = definite(rng, n), rng.normal(size=n if columns is None else (n, columns))
    wanted = np.linalg.solve(A, B)
    bound = 20 * n * CONDITION * np.finfo(float).eps * np.abs(wanted).max()
    for found in (solve_symmetric(A, B), solve_definite(A, B), traced(solve_definite, A, B)):
        assert np.abs(np.reshape(found, wanted.shape) - wanted).max() < bound


@pytest.mark.parametrize("n", [1, 2, 6, 7])
def test_inverse_is_symmetric_to_the_bit(n):
    A = definite(np.random.default_rng(n), n)
    wanted = np.linalg.inv(A)
    for found in (inverse_definite(A), traced(inverse_definite, A)):
        assert np.array_equal(found, found.T)
        assert np.abs(found - wanted).max() < 20 * n * CONDITION * np.finfo(float).eps * np.abs(wanted).max()


def test_only_the_upper_triangle_counts():
    rng = np.random.default_rng(0)
    A, B = definite(rng, 5), rng.normal(size=5)
    other = np.triu(A) + np.tril(rng.normal(size=(5, 5)), -1)
    assert np.array_equal(solve_symmetric(other, B), solve_symmetric(A, B))
    assert np.array_equal(solve_definite(other, B), solve_definite(A, B))


def test_branches_cost_nothing_between_them():
    """Two branches of three on a trunk of one: as many operations as the systems of four apiece, less one trunk."""
    pattern = np.ones((7, 7))
    pattern[1:4, 4:] = pattern[4:, 1:4] = 0
    symbols = ca.SX.sym("A", 7, 7) * pattern

    def operations(A, b):
        with numpy_mode():
            out = ca.SX(solve_symmetric(ca.array(ca.sparsify(A)), ca.array(b)[:, 0])._v)
        f = ca.Function("f", [ca.vertcat(*ca.symvar(A)), b], [ca.densify(out)], {"cse": True})
        return f.n_instructions() - f.nnz_in() - f.nnz_out()

    tree = operations(symbols, ca.SX.sym("b", 7))
    branch = operations(ca.SX.sym("A", 4, 4), ca.SX.sym("b", 4))
    full = operations(ca.SX.sym("A", 7, 7), ca.SX.sym("b", 7))
    assert tree < 2 * branch < 0.7 * full
