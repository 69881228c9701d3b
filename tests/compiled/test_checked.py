"""Controllers that trace into something else are refused; those that do not are as they are simulated."""

import copy
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import k1607_pin as k1607
from k1607_pin.compiled.checked import _require_close
from k1607_pin.compiled.interpreted import function_of, off
from k1607_pin.compiled.program import program
from k1607_pin.compiled.tracer import TracingError
from k1607_pin.report.cases import study_case
from k1607_pin.simulation.plant import Plant

COUNT = [0]


class Law:
    """Damping, and something on top of it."""

    def start(self, q, v, duration):
        return None

    def update(self, t, q, v, state):
        return -v, state, {}


class FloatOfTheState(Law):
    def update(self, t, q, v, state):
        return -v + (5.0 if float(v[0]) > 0 else -5.0), state, {}


class FloatOfTime(Law):
    def update(self, t, q, v, state):
        return -v + (5.0 if float(t) < 0.1 else -5.0), state, {}


class PythonsMax(Law):
    def update(self, t, q, v, state):
        return -v + max(0.0, float(v[0])), state, {}


class StateOfTruth(Law):
    def start(self, q, v, duration):
        return {"first": True, "x": 0.0}

    def update(self, t, q, v, state):
        return -v + (5.0 if state["first"] else 0.0), {"first": False, "x": 0.0}, {}


class StateOfWords(Law):
    def start(self, q, v, duration):
        return {"mode": "push", "x": 0.0}

    def update(self, t, q, v, state):
        return -v + (5.0 if state["mode"] == "push" else 0.0), {"mode": "hold", "x": 0.0}, {}


class Counter(Law):
    def __init__(self):
        self.n = 0

    def update(self, t, q, v, state):
        self.n += 1
        return -v + (5.0 if self.n > 1000 else 0.0), state, {}


class GlobalCounter(Law):
    def update(self, t, q, v, state):
        COUNT[0] += 1
        return -v + (5.0 if COUNT[0] % 20 > 10 else 0.0), state, {}


class Integrator(Law):
    def __init__(self):
        self.I = np.zeros(7)

    def update(self, t, q, v, state):
        self.I = self.I + 0.1 * v
        return -v - self.I, state, {}


class Random(Law):
    def __init__(self):
        self.rng = np.random.default_rng(0)

    def update(self, t, q, v, state):
        return -v + self.rng.normal(size=7), state, {}


class Caught(Law):
    def update(self, t, q, v, state):
        try:
            sign = 1.0 if v[0] > 0 else -1.0
        except Exception:
            sign = 0.0
        return -v + sign, state, {}


class AsksForTheKind(Law):
    def update(self, t, q, v, state):
        return -v if isinstance(q, np.ndarray) else -2 * v, state, {}


class Mask(Law):
    def update(self, t, q, v, state):
        return -v + np.sum(v[np.array([True, False] * 3 + [True])]), state, {}


class OtherOrder(Law):
    def start(self, q, v, duration):
        return {"a": np.zeros(7), "b": np.ones(7)}

    def update(self, t, q, v, state):
        return -v - state["a"], {"b": state["b"], "a": state["a"] + v}, {}


class OtherName(Law):
    def start(self, q, v, duration):
        return {"a": np.zeros(7)}

    def update(self, t, q, v, state):
        return -v, {"b": v}, {}


class Scalar(Law):
    def update(self, t, q, v, state):
        return -v[0], state, {}


class LogOfTheKind(Law):
    @property
    def variables(self):
        return {"kind": ((), "")}

    def update(self, t, q, v, state):
        return -v, state, {"kind": np.sum(v) if isinstance(q, np.ndarray) else 2 * np.sum(v)}


WRONG = [
    FloatOfTheState, FloatOfTime, PythonsMax, StateOfTruth, StateOfWords, Counter, GlobalCounter, Integrator, Random, Caught,
    AsksForTheKind, Mask, OtherName, Scalar,
]  # fmt: skip


@pytest.mark.parametrize("kind", WRONG, ids=lambda kind: kind.__name__)
def test_what_traces_into_something_else_is_refused(arm, q0, kind):
    law = kind()
    before = copy.deepcopy(vars(law))
    with pytest.raises(TracingError):
        k1607.rollout(arm, law, q0, 0.1, metrics={"tau": "max"})
    for name, x in before.items():
        if not isinstance(x, np.random.Generator):
            assert np.array_equal(vars(law)[name], x), "a controller is left as it was"


def test_a_log_that_is_another_one_is_refused(arm, q0):
    with pytest.raises(TracingError, match="on numbers"):
        k1607.rollout(arm, LogOfTheKind(), q0, 0.1, metrics={"tau": "max"}, log=("kind",))


class Push:
    """A world that remembers."""

    calls = 0

    def wrench(self, t, q, v):
        self.calls += 1
        return np.array([0.0, 0, 5.0 * self.calls, 0, 0, 0])


def test_a_world_that_is_another_one_is_refused(arm, law, q0):
    with pytest.raises(TracingError, match="plant, external, step"):
        k1607.rollout(arm, law, q0, 0.1, external=Push())


class Asked(Law):
    """A torque as a list, a state as a tuple of unlike things."""

    def start(self, q, v, duration):
        return (0.0, {"x": np.zeros((2, 2))}, [np.zeros(7), 1.0])

    def update(self, t, q, v, state):
        n, more, (x, one) = state
        tau = -v - x + more["x"][0, 1] * one
        return [tau[i] for i in range(7)], (n + 1.0, {"x": more["x"] + n}, [x + 0.1 * v, one]), {}


def test_what_traces_well_is_what_is_simulated(arm, q0, agrees):
    v0 = np.linspace(-0.5, 0.5, 7)
    run = k1607.rollout(arm, Asked(), q0, 0.2, v0, log=("q", "tau"))
    agrees(run, k1607.simulate(arm, Asked(), q0, 0.2, v0), ("q", "tau"))


class NotANumber(Law):
    """What comes out of it at once, or after a while."""

    def __init__(self, kind, since):
        self.kind, self.since = kind, since

    def update(self, t, q, v, state):
        bad = np.where(
            t < self.since, 1.0, np.sqrt(-1.0 - q[0] ** 2) if self.kind == "nan" else np.exp(1e4 * (1 + q[0] ** 2))
        )
        return -v + 0.1 * bad, state, {}


@pytest.mark.parametrize("limit", [np.inf, 30.0])
@pytest.mark.parametrize("since", [0.0, 0.05])
@pytest.mark.parametrize("kind", ["nan", "inf"])
@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")
def test_a_torque_that_is_not_finite_is_never_limited_to_one(arm, q0, kind, since, limit):
    """It ends the loop, as in `simulate`; what the metrics say of one that never began is nothing."""
    plant, law = Plant(arm, torque_limit=np.full(7, limit)), NotANumber(kind, since)
    with pytest.raises(k1607.SimulationError) as failed, np.errstate(all="ignore"):
        k1607.simulate(plant, law, q0, 0.2)
    run = k1607.rollout(plant, law, q0, 0.2, metrics={"tau": ("max", "min", "rms", "last"), "q": "mean"})
    assert run.failed_at.values[0] == pytest.approx(failed.value.time)
    np.testing.assert_allclose(run.q_end.values[0], failed.value.q, atol=1e-12)
    assert np.isfinite(run.work.values).all()
    for name in ("tau_max", "tau_min", "tau_rms", "tau_last", "q_mean"):
        assert np.isfinite(run[name].values).all() == (since > 0), name


class ClippedItself(Law):
    def update(self, t, q, v, state):
        return np.clip(np.sqrt(q - 10.0), -5.0, 5.0) - v, state, {}


@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")
def test_clipping_does_not_make_numbers_of_what_is_none(arm, q0):
    assert k1607.rollout(arm, ClippedItself(), q0, 0.1, metrics={"tau": "max"}).failed_at.values[0] == 0.0


@pytest.mark.parametrize("number", [1, 2])
def test_states_that_run_away_are_no_false_alarm(number):
    """The recommended settings at made-up states, up to 100 s late: their gains reach 1e25, and rounding passes 1e-9 of it."""
    case = study_case(number, "recommended")
    case.rollouts(["controller.beta_1", "controller.gains.K_p"])
    fast = replace(case, law=replace(case.law, beta_1=1e6 * case.law.beta_1))
    fast.rollouts(["controller.beta_1"])


class RunsAway(Law):
    """Its torque reaches 1e200 at the made-up states; before that it is another one on symbols."""

    def __init__(self, on_symbols):
        self.on_symbols = on_symbols

    def start(self, q, v, duration):
        return np.array([1e-8])

    def update(self, t, q, v, state):
        damping = 0.1 if isinstance(q, np.ndarray) else self.on_symbols
        return -damping * v + state[0], 1e8 * state * (1 + 1e-3 * np.sin(q[0])), {}


def test_what_runs_away_later_does_not_hide_what_is_wrong_before(arm, q0):
    k1607.rollout(arm, RunsAway(0.1), q0, 0.1, metrics={"tau": "max"})
    with pytest.raises(TracingError, match="on numbers"):
        k1607.rollout(arm, RunsAway(0.2), q0, 0.1, metrics={"tau": "max"})


class Cancels(RunsAway):
    """Two large numbers, whose difference is the torque: rounded to 1e-4."""

    def update(self, t, q, v, state):
        damping = 0.1 if isinstance(q, np.ndarray) else self.on_symbols
        return (1e12 - damping * v * (1 + state[0])) - 1e12, state, {}


def test_its_own_rounding_does_not_hide_what_is_wrong(arm, q0):
    k1607.rollout(arm, Cancels(0.1), q0, 0.1, metrics={"tau": "max"})
    with pytest.raises(TracingError, match="on numbers"):
        k1607.rollout(arm, Cancels(0.2), q0, 0.1, metrics={"tau": "max"})


def no_rounding():
    return np.zeros((5, 3))


@given(
    wanted=arrays(float, (5, 3), elements=st.floats(-1e9, 1e9)),
    exponent=arrays(float, (5, 3), elements=st.floats(-16, 3)),
)
@settings(max_examples=100)
def test_what_is_off_by_more_than_the_largest_entry_allows_is_never_passed(wanted, exponent):
    """By a billionth of the largest of a column, or a billionth of a millionth of all, and more: refused at any time."""
    off = 10.0**exponent
    largest = np.maximum(np.abs(wanted).max(axis=0), max(1e-6 * np.abs(wanted).max(), 1e-3))
    traced = wanted + off
    if (np.abs(traced - wanted) > 1e-9 * largest).any():
        with pytest.raises(TracingError, match="on numbers"):
            _require_close("it", np.arange(5.0), traced, wanted, no_rounding, str)
    _require_close("it", np.arange(5.0), wanted, wanted, no_rounding, str)


def test_rounding_is_measured_operation_by_operation():
    """A sum of n numbers rounds by n last places at most, and by some; what is exact does not round."""
    f = ca.Function("f", [x := ca.SX.sym("x", 50)], [ca.sum1(x), ca.fmax(-x[0], x[1])])
    p = program(f)
    x = np.random.default_rng(0).uniform(1, 2, 50)
    exact, *others = (
        function_of("f", p, ["x"], factors)[0](x)
        for factors in (None, *(off(p, np.random.default_rng(seed)) for seed in range(4)))
    )
    shift = max(abs(float(other[0]) - float(exact[0])) for other in others)
    assert 0 < shift <= 50 * np.finfo(float).eps * float(exact[0])
    assert {float(other[1]) for other in others} == {float(exact[1])}


class SmallBesideLarge(Law):
    """A state of 1e9, beside which the torque is nothing, and a torque that is another one on symbols."""

    def start(self, q, v, duration):
        return np.array([1e9])

    def update(self, t, q, v, state):
        return -v + (0.1 if isinstance(q, np.ndarray) else 0.2), state, {}


def test_a_small_torque_is_not_hidden_by_a_large_state(arm, q0):
    with pytest.raises(TracingError, match="on numbers"):
        k1607.rollout(arm, SmallBesideLarge(), q0, 0.1, metrics={"tau": "max"})
