"""Operations made fewer: what comes out stays the same."""

import casadi as ca
import numpy as np
import pytest

from k1607_pin.compiled.interpreted import function_of
from k1607_pin.compiled.program import hoisted, program


def of(outputs, *inputs):
    return program(ca.Function("f", list(inputs), [ca.densify(ca.vertcat(*out)) for out in outputs], {"cse": True}))


def values(p, *inputs):
    """Outputs of a program for numbers, padded to the inputs that a kernel's functions have."""
    f, taken = function_of("f", p, [f"i{k}" for k in range(len(inputs))])
    arguments = [np.asarray(x)[: f.size1_in(k)] if f"i{k}" in taken else 0 for k, x in enumerate(inputs)]
    found = f(*arguments)
    return [x.full().ravel() for x in (found if isinstance(found, tuple) else (found,))]


def test_one_division_serves_many():
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y")
    p = of([[x[0] / y, x[1] / y, x[2] / y, 1 / y]], x, y)
    assert p.operations["div"] == 0
    assert p.operations["inv"] == 1
    np.testing.assert_allclose(values(p, [1.0, 2.0, 3.0], [7.0])[0], np.array([1, 2, 3, 1]) / 7, rtol=2e-16)


def test_a_single_division_stays_one():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    assert of([[x / y]], x, y).operations == {"div": 1}


def test_what_is_not_used_goes():
    x = ca.SX.sym("x", 2)
    p = of([[ca.sin(x[0])]], x)
    assert [node.op for node in p.nodes] == ["input", "sin"]


@pytest.mark.parametrize("seed", range(5))
def test_hoisting_changes_nothing_and_takes_all_it_can(seed):
    """Random programs of fast and slow inputs: what is left of them has no operation on slow inputs alone."""
    rng = np.random.default_rng(seed)
    fast, slow, more = ca.SX.sym("fast", 3), ca.SX.sym("slow", 3), ca.SX.sym("more", 0)
    pool = [*ca.vertsplit(fast), *ca.vertsplit(slow), ca.SX(2.5)]
    for _ in range(60):
        a, b = (pool[i] for i in rng.integers(len(pool), size=2))
        pool.append([a + b, a * b, ca.sin(a), a - b, ca.fmax(a, b)][rng.integers(5)])
    first = of([pool[-6:-3]], fast, slow, more)
    second = of([pool[-3:]], fast, slow, more)
    before, rest = hoisted([first, second], [[1], [1]], [2, 2])
    x, y = rng.normal(size=(2, 3))
    shared = values(before, y)[0]
    for whole, part in zip((first, second), rest, strict=True):
        np.testing.assert_array_equal(values(part, x, y, shared)[0], values(whole, x, y, [])[0])
        slow_nodes = set()
        for i, node in enumerate(part.nodes):
            from_slow = node.op == "const" or (node.op == "input" and node.place[0] != 0)
            if from_slow or (node.args and all(a in slow_nodes for a in node.args)):
                slow_nodes.add(i)
                assert node.op in ("const", "input")
