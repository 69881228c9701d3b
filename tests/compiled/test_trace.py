import os
import signal
import subprocess
import sys
import threading
import traceback
from contextlib import contextmanager

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from k1607_pin.compiled import rollout
from k1607_pin.compiled.trace import numpy_mode, trace

SHAPES = st.lists(
    st.one_of(st.tuples(st.integers(1, 4)), st.tuples(st.integers(1, 4), st.integers(1, 4))), min_size=1, max_size=3
)


@pytest.fixture(autouse=True)
def mode_is_left_as_it_was():
    before = ca.GlobalOptions.getNumpyMode()
    yield
    after = ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(before)
    assert after == before


@contextmanager
def held_by_a_thread(block):
    """Another thread is within ``block`` as long as this is."""
    inside, leave = threading.Event(), threading.Event()

    def hold():
        with block:
            inside.set()
            leave.wait()

    thread = threading.Thread(target=hold)
    thread.start()
    inside.wait()
    try:
        yield
    finally:
        leave.set()
        thread.join()


def in_a_fork(does):
    """Whether a forked process does it; one that hangs is ended."""
    if (child := os.fork()) == 0:
        signal.alarm(60)
        try:
            does()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
        os._exit(1)
    return os.waitpid(child, 0)[1] == 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
class TestForks:
    def test_a_fork_does_not_wait_for_a_thread_that_it_has_not_got(self):
        def traces():
            assert ca.GlobalOptions.getNumpyMode() == 0
            assert np.isnan(float(ca.SX.sym("x")))  # as CasADi has it outside
            assert trace(lambda x: 2 * x, "f", [(2,)])([1, 2]).full().ravel().tolist() == [2.0, 4.0]
            assert ca.GlobalOptions.getNumpyMode() == 0

        with held_by_a_thread(numpy_mode()):
            assert in_a_fork(traces)
        assert ca.GlobalOptions.getNumpyMode() == 0

    def test_nor_for_one_that_makes_a_rollout(self):
        def turns():
            with rollout._TURNS.taken(), rollout._TURNS.taken():
                pass

        with held_by_a_thread(rollout._TURNS.taken()):
            assert in_a_fork(turns)

    def test_who_forks_within_goes_on_within(self):
        def leaves():
            assert ca.GlobalOptions.getNumpyMode() == 1

        with numpy_mode():
            assert in_a_fork(leaves)

        with numpy_mode():
            if (child := os.fork()) == 0:
                pass
            else:
                assert os.waitpid(child, 0)[1] == 0
        if child == 0:
            os._exit(ca.GlobalOptions.getNumpyMode())


class TestNumpyMode:
    def test_is_on_inside_and_off_outside(self):
        assert ca.GlobalOptions.getNumpyMode() == 0
        with numpy_mode():
            assert ca.GlobalOptions.getNumpyMode() == 1
        assert ca.GlobalOptions.getNumpyMode() == 0

    def test_is_put_back_after_an_exception(self):
        with pytest.raises(RuntimeError, match="inside"), numpy_mode():
            raise RuntimeError("inside")
        assert ca.GlobalOptions.getNumpyMode() == 0

    def test_is_put_back_after_a_function_that_cannot_be_traced(self):
        with pytest.raises(ZeroDivisionError):
            trace(lambda x: 1 / 0, "bad", [(3,)])
        assert ca.GlobalOptions.getNumpyMode() == 0

    def test_nests(self):
        with numpy_mode():
            with numpy_mode():
                assert ca.GlobalOptions.getNumpyMode() == 1
            assert ca.GlobalOptions.getNumpyMode() == 1
        assert ca.GlobalOptions.getNumpyMode() == 0

    def test_keeps_a_user_setting(self):
        ca.GlobalOptions.setNumpyMode(1)
        try:
            with numpy_mode():
                pass
            assert ca.GlobalOptions.getNumpyMode() == 1
        finally:
            ca.GlobalOptions.setNumpyMode(0)

    def test_two_threads_do_not_disturb_each_other(self):
        """The setting is global. One thread leaves the block while another is inside: its mode must hold until it leaves,
        and then be off."""
        inside, left, seen = threading.Event(), threading.Event(), []

        def second():
            with numpy_mode():
                inside.set()
                left.wait(5)
                seen.append(ca.GlobalOptions.getNumpyMode())

        other = threading.Thread(target=second)
        with numpy_mode():
            other.start()
            inside.wait(0.3)  # in vain where threads take turns
        left.set()
        other.join()
        assert seen == [1]
        assert ca.GlobalOptions.getNumpyMode() == 0

    def test_importing_the_package_changes_nothing(self):
        script = """
import casadi as ca
before = ca.GlobalOptions.getNumpyMode()
import k1607_pin, k1607_pin.compiled.trace
assert ca.GlobalOptions.getNumpyMode() == before == 0
print("unchanged")
"""
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        assert done.stdout == "unchanged\n"


@settings(max_examples=30)
@given(shapes=SHAPES, seed=st.integers(0, 2**32 - 1))
def test_arguments_arrive_in_their_shapes(shapes, seed):
    """Row-major in, own shape out: each output tells where every entry went."""
    rng = np.random.default_rng(seed)
    values = [rng.normal(size=shape) for shape in shapes]
    fun = trace(lambda *xs: tuple(2.0 * x for x in xs), "double", shapes)
    found = fun.call([x.ravel() for x in values])
    for value, out in zip(values, found, strict=True):
        matrix = value.reshape(-1, 1) if value.ndim == 1 else value
        assert out.shape == matrix.shape
        np.testing.assert_array_equal(out.full(), 2.0 * matrix)


def formula(A, x):
    """A bit of everything that a law may use."""
    y = A @ x + np.sin(x) * np.linalg.norm(x)
    z = np.where(y > 0, y, 0.1 * y)
    stacked = np.concatenate([np.cross(z, x), np.clip(y, -1, 1)])
    return np.outer(z, x), np.stack([stacked, np.sqrt(1 + stacked**2)], axis=1), np.linalg.solve(A + 5 * np.eye(3), x)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), cse=st.booleans())
def test_numpy_formulas_equal_their_traces(seed, cse):
    rng = np.random.default_rng(seed)
    A, x = rng.uniform(-1, 1, (3, 3)), rng.normal(size=3)
    fun = trace(formula, "formula", [(3, 3), (3,)], cse=cse)
    for found, expected in zip(fun(A.ravel(), x), formula(A, x), strict=True):
        np.testing.assert_allclose(found.full().reshape(expected.shape), expected, rtol=0, atol=1e-13)


def test_outputs_are_dense():
    """Structural zeros would leave holes in what C and NumPy read."""
    fun = trace(lambda x: np.stack([np.stack([x[0], 0 * x[0]]), np.stack([0 * x[0], x[1]])]), "diagonal", [(2,)])
    assert fun.sparsity_out(0).is_dense()
    np.testing.assert_array_equal(fun([3.0, 4.0]).full(), [[3, 0], [0, 4]])


def test_constants_scalars_and_one_output():
    fun = trace(lambda x: (np.arange(6.0).reshape(2, 3), x[0] * x[1], 7.0), "constants", [(2,)])
    constant, scalar, number = fun([3.0, 4.0])
    np.testing.assert_array_equal(constant.full(), np.arange(6.0).reshape(2, 3))
    assert (float(scalar), float(number)) == (12.0, 7.0)
    assert fun.sparsity_out(0).is_dense()
    assert trace(lambda x: x, "same", [(2,)]).n_out() == 1


def test_cse_shares_what_is_common():
    def wasteful(x):
        return np.stack([np.sin(x[0]) * np.cos(x[1]), np.sin(x[0]) * np.cos(x[1]) + 1])

    shared, plain = (trace(wasteful, "wasteful", [(2,)], cse=cse) for cse in (True, False))
    assert shared.n_instructions() < plain.n_instructions()
    np.testing.assert_array_equal(shared([0.3, 0.4]).full(), plain([0.3, 0.4]).full())


def test_name_is_kept():
    assert trace(lambda x: x, "forward_kinematics", [(7,)]).name() == "forward_kinematics"
