"""Operations made fewer: what comes out stays the same."""

import casadi as ca
import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled.interpreted import function_of
from k1607_pin.compiled.order import in_order
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


def random_program(rng, count=80):
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
    pool = [*ca.vertsplit(x), *ca.vertsplit(y), ca.SX(2.5)]
    for _ in range(count):
        a, b = (pool[i] for i in rng.integers(len(pool), size=2))
        pool.append([a + b, a * b, ca.sin(a), ca.cos(a), a - b, 1 / (2 + a * a), ca.fmax(a, b)][rng.integers(7)])
    return of([pool[-6:-3], [*pool[-3:], pool[0], pool[-1]]], x, y)


@pytest.mark.parametrize("seed", range(8))
def test_order_changes_no_bit_and_loses_nothing(seed):
    """Random programs: each operation stands once, after what it takes, and every output is the same to the bit."""
    rng = np.random.default_rng(seed)
    p = random_program(rng)
    ordered = in_order(p)
    assert ordered.operations == p.operations
    assert len(ordered.nodes) == len(p.nodes)
    assert all(a < i for i, node in enumerate(ordered.nodes) for a in node.args)
    x, y = rng.normal(size=3), rng.normal(size=2)
    for ours, before in zip(values(ordered, x, y), values(p, x, y), strict=True):
        np.testing.assert_array_equal(ours, before)


def test_the_longest_way_goes_first():
    """Of two chains to one sum the long one begins, and products stand beside the sums that they are for."""
    x = ca.SX.sym("x", 8)
    long = ca.sin(ca.sin(x[0]))
    short = x[1] + x[2]
    p = in_order(of([[short * x[3] + long * x[4]]], x))
    done = [node.op for node in p.nodes if node.op not in ("input", "const")]
    assert done[:2] == ["sin", "sin"]
    assert done[-2:] == ["mul", "add"]


def most_waiting(p):
    """The largest number of results that are still needed, over the program."""
    last = {a: i for i, node in enumerate(p.nodes) for a in node.args}
    alive, most = set(), 0
    for i, node in enumerate(p.nodes):
        alive = {a for a in alive if last.get(a, -1) > i} | ({i} if node.op not in ("input", "const") else set())
        most = max(most, len(alive))
    return most


def test_order_keeps_fewer_values_waiting(monkeypatch):
    """Than the longest way to the end alone, in a program as long as those that matter."""
    p = k1607.batch(k1607.load_k1607(), "forward_dynamics").program
    ours = most_waiting(in_order(p))
    monkeypatch.setattr("k1607_pin.compiled.order.REGISTER", 0.0)
    assert ours < 0.9 * most_waiting(in_order(p))


def test_an_empty_program_has_an_order():
    assert in_order(of([[]], ca.SX.sym("x", 1))).nodes == ()
