"""Functions of a state on batches of states, against Pinocchio one by one."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled import build
from k1607_pin.compiled.batch import METHODS, Batch, batch
from k1607_pin.compiled.tracer import TracingError

ARMS = {
    "k1607": k1607.load_k1607,
    "panda": lambda: k1607.load_example("panda"),
    "ur5": lambda: k1607.load_example("ur5"),
}


@pytest.fixture(scope="module", params=ARMS)
def robot(request):
    return ARMS[request.param]()


@pytest.mark.parametrize("method", METHODS)
def test_methods_of_an_arm(robot, method):
    """To 1e-11 of the largest entry, times what the condition of the posture takes away; an odd number of states."""
    rng = np.random.default_rng(0)
    states = rng.uniform(0.4, 1.2, size=(METHODS[method], 3, 7, robot.n))  # clear of singularities
    found = batch(robot, method)(*states)
    for i in np.ndindex(3, 7):
        state = [x[i] for x in states]
        theirs = getattr(robot, method)(*state)
        condition = np.linalg.cond(robot.jacobian(state[0])) ** 2 if method == "operational_space" else 1.0
        for name in ("Lambda", "Phi", "Gamma", "jacobian_bar", "gravity") if method == "operational_space" else (None,):
            if method == "forward_kinematics":
                pairs = [(found.translation[i], theirs.translation), (found.rotation[i], theirs.rotation)]
            else:
                pairs = [(getattr(found, name)[i], getattr(theirs, name))] if name else [(found[i], theirs)]
            for ours, reference in pairs:
                assert np.abs(ours - reference).max() < 1e-14 * max(condition, 1e3) * max(1.0, np.abs(reference).max())


def test_the_same_bits_whatever_the_batch_and_threads():
    f = batch(k1607.load_k1607(), "forward_dynamics")
    q, v, tau = np.random.default_rng(0).normal(size=(3, 5003, 7))
    whole = f(q, v, tau, threads=2)
    np.testing.assert_array_equal(f(q, v, tau, threads=1), whole)
    np.testing.assert_array_equal(f(q[17], v[17], tau[17]), whole[17])
    np.testing.assert_array_equal(f(q[::-1], v[::-1], tau[::-1]), whole[::-1])


def test_any_function():
    f = Batch(lambda A, b: (A @ b, np.sum(b)), [(2, 3), (3,)])
    A, b = np.arange(24.0).reshape(4, 2, 3), np.arange(12.0).reshape(4, 3)
    product, total = f(A, b)
    np.testing.assert_allclose(product, np.einsum("kij,kj->ki", A, b), rtol=1e-15)
    np.testing.assert_allclose(total, b.sum(axis=1), rtol=1e-15)


def test_without_a_compiler(monkeypatch):
    arm, (q, v) = k1607.load_k1607(), np.random.default_rng(0).normal(size=(2, 5, 7))
    native = batch(arm, "bias_torque")(q, v)
    monkeypatch.setenv("K1607_COMPILER", "none")
    build.compiler.cache_clear()
    try:
        with pytest.warns(RuntimeWarning, match="no C compiler"):
            np.testing.assert_allclose(batch(arm, "bias_torque")(q, v), native, rtol=1e-12, atol=1e-12)
    finally:
        build.compiler.cache_clear()


def test_memory_may_be_used_again():
    f = batch(k1607.load_k1607(), "jacobian")
    q = np.random.default_rng(0).normal(size=(40, 7))
    out = f.empty(40)
    J = f(q, out=out)
    assert np.shares_memory(J, out)
    np.testing.assert_array_equal(J, f(q))
    with pytest.raises(ValueError, match="out: expected"):
        f(q[:3], out=out)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((np.zeros((5, 6)), np.zeros((5, 7))), "q: expected"),
        ((np.zeros((5, 7)), np.zeros((4, 7))), "v: expected"),
        ((np.zeros((5, 7)),), "expected 2 arguments, got 1"),
        ((np.zeros((5, 7)), np.full((5, 7), np.nan)), "v: expected finite numbers, got 35 that are not"),
        ((np.zeros((5, 7)), np.zeros((5, 7)) + 1j), "v: expected real numbers"),
        ((np.ma.masked_greater(np.ones((5, 7)), 0), np.zeros((5, 7))), "q: expected real numbers, got a masked array"),
        (
            (np.broadcast_to(0.0, (10**8, 7)), np.broadcast_to(0.0, (10**8, 7))),
            r"at most 4 GiB at once, got 100000000 states of",
        ),
    ],
)
def test_bad_input(arguments, said):
    with pytest.raises(ValueError, match=said):
        batch(k1607.load_k1607(), "bias_torque")(*arguments)


def test_large_numbers_are_finite():
    arm, q = k1607.load_k1607(), np.zeros((3, 7))
    v = np.full((3, 7), 1.5e308)  # whose sum is not
    assert batch(arm, "jacobian_time_variation")(q, v).shape == (3, 6, 7)


def test_unknown_methods_are_refused():
    with pytest.raises(ValueError, match="method: expected one of forward_kinematics"):
        batch(k1607.load_k1607(), "fly")


def test_bad_threads_and_no_arguments_are_refused():
    f = batch(k1607.load_k1607(), "jacobian")
    for threads in (0, -1, 2.5):
        with pytest.raises(ValueError, match="threads: expected"):
            f(np.zeros((5, 7)), threads=threads)
    with pytest.raises(ValueError, match="shapes: expected"):
        Batch(lambda: 1.0, [])


def test_no_states_one_state_and_numbers():
    f = batch(k1607.load_k1607(), "jacobian")
    assert f(np.zeros((0, 7))).shape == (0, 6, 7)
    assert f(np.zeros((3, 0, 7))).shape == (3, 0, 6, 7)
    assert f(np.zeros(7)).shape == (6, 7)
    assert f(np.zeros((2, 3, 7)), threads=np.int64(1)).shape == (2, 3, 6, 7)
    doubled = Batch(lambda x: 2 * x, [()])
    assert doubled(3.0).shape == ()
    assert doubled(3.0) == 6.0
    np.testing.assert_array_equal(doubled(np.arange(11.0)), 2 * np.arange(11.0))


@pytest.mark.parametrize("native", [True, False])
@pytest.mark.parametrize(
    "fun",
    [lambda x: np.maximum(x, 0.0), lambda x: np.minimum(0.0, x), lambda x: np.clip(x, -1.0, 1.0), np.sign, np.abs],
    ids=["maximum", "minimum", "clip", "sign", "abs"],
)
@pytest.mark.filterwarnings("ignore:no C compiler")
def test_what_is_no_number_stays_none(monkeypatch, fun, native):
    """As in NumPy, and unlike C's fmin and fmax."""
    x = np.array([np.nan, -np.inf, np.inf, -0.5, 0.0, 2.0])
    if not native:
        monkeypatch.setenv("K1607_COMPILER", "none")
    build.compiler.cache_clear()
    try:
        np.testing.assert_array_equal(Batch(fun, [()])(x), fun(x))
    finally:
        build.compiler.cache_clear()


def test_angles_too_large_have_no_sine():
    sine = Batch(np.sin, [()])
    if build.compiler():
        assert np.isnan(sine(np.array([1e6, -1e20, np.inf, np.nan]))).all()
    assert sine(9.9e5) == pytest.approx(np.sin(9.9e5), abs=1e-9)


def test_a_function_that_traces_into_another_is_refused():
    with pytest.raises(TracingError, match="on numbers"):
        Batch(lambda x: np.sum(x) if isinstance(x, np.ndarray) else 2 * np.sum(x), [(3,)])
    with pytest.raises(TracingError):
        Batch(lambda x: x * (1.0 if float(x[0]) > 0 else 2.0), [(3,)])
