"""Controllers as people write them: what may be done is as simulated, what may not says what to do instead."""

import copy
import gc
import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled import rollout as rollout_module
from k1607_pin.compiled.layout import Layout
from k1607_pin.compiled.limits import (
    AT_ONCE,
    MOST_OPERATIONS,
    MOST_STATE,
    require_operations,
    require_rollouts,
    require_state,
)
from k1607_pin.compiled.native import Native
from k1607_pin.compiled.samples import Grid
from k1607_pin.compiled.tracer import TracingError
from k1607_pin.simulation.noise import WhiteNoise
from k1607_pin.simulation.plant import Plant

STIFFNESS = 20.0


class Law:
    """Damping."""

    def start(self, q, v, duration):
        return None

    def update(self, t, q, v, state):
        return -20 * v, state, {}


@pytest.fixture(scope="module")
def free():
    """Weightless."""
    return k1607.load_k1607(gravity=(0, 0, 0))


@pytest.fixture
def same(free, q0):
    """That rollouts of a law, with each of the values, end where `simulate` does."""

    def check(law, **vary):
        found = k1607.rollout(free, law, q0, 0.1, vary={f"controller.{k}": x for k, x in vary.items()}, metrics={})
        for i in range(found.sizes["rollout"]):
            own = replace(law, **{name: x[i] for name, x in vary.items()}) if vary else law
            np.testing.assert_allclose(found.q_end[i], k1607.simulate(free, own, q0, 0.1).q[-1], atol=1e-12)

    return check


@dataclass(frozen=True)
class Derived(Law):
    stiffness: float = 20.0
    damping: float = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "damping", 2 * np.sqrt(self.stiffness))

    def update(self, t, q, v, state):
        return -self.stiffness * q - self.damping * v, state, {}


@dataclass(frozen=True)
class Cached(Law):
    stiffness: float = 20.0

    @cached_property
    def damping(self):
        return 2 * np.sqrt(self.stiffness)

    def update(self, t, q, v, state):
        return -self.stiffness * q - self.damping * v, state, {}


@pytest.mark.parametrize("kind", [Derived, Cached])
def test_what_is_derived_of_a_number_that_varies_is_not_left_as_it_was(free, q0, same, kind):
    law = kind()
    assert law.damping
    same(law)
    with pytest.raises(TracingError, match=r"derived anew; derive it where it is used"):
        k1607.rollout(free, law, q0, 0.1, vary={"controller.stiffness": [20.0, 30.0]}, metrics={})


@dataclass(frozen=True)
class Where(Law):
    stiffness: float = 20.0

    def update(self, t, q, v, state):
        return -self.stiffness * q - 2 * np.sqrt(self.stiffness) * v, state, {}


def test_what_is_derived_where_it_is_used_varies(same):
    same(Where(), stiffness=[20.0, 30.0])


@dataclass(frozen=True)
class Global(Law):
    stiffness: float = 1.0

    def update(self, t, q, v, state):
        return -STIFFNESS * self.stiffness * q - 5 * v, state, {}


def test_a_law_of_one_s_own_is_traced_anew_as_it_may_read_what_changes(monkeypatch, same):
    law = Global()
    same(law)
    monkeypatch.setitem(globals(), "STIFFNESS", 40.0)
    same(law)
    monkeypatch.setattr(Global, "update", Where.update)
    same(law)


def test_a_subclass_of_a_scheme_may_be_run_again(arm, law, q0):
    class Mine(type(law)):
        def update(self, t, q, v, state):
            tau, state, log = super().update(t, q, v, state)
            return 0.5 * tau, state, log

    mine = copy.copy(law)
    object.__setattr__(mine, "__class__", Mine)
    first, second = (k1607.rollout(arm, mine, q0, 0.05) for _ in range(2))
    np.testing.assert_array_equal(first.q_end, second.q_end)


@dataclass(frozen=True)
class Started(Law):
    """Its number is in the state alone; called as one of an arm's own numbers."""

    gravity: float = 20.0

    def start(self, q, v, duration):
        return {"k": np.full(7, self.gravity)}

    def update(self, t, q, v, state):
        return -state["k"] * q - 20 * v, state, {}


def test_a_number_that_acts_through_the_start_alone_may_vary(same):
    same(Started(), gravity=[20.0, 50.0])


class OtherOrder(Law):
    def start(self, q, v, duration):
        return {"a": np.zeros(7), "b": np.ones(2), "c": (0.0, {"x": 1.0, "y": 2.0})}

    def update(self, t, q, v, state):
        n, more = state["c"]
        after = {"c": (n + 1, {"y": more["y"] + v[0], "x": more["x"]}), "b": state["b"], "a": state["a"] + v}
        return -v - state["a"] - more["y"], after, {}


@dataclass(frozen=True)
class InVain(Started):
    unused: float = 1.0


@dataclass(frozen=True)
class WithAnArm(Law):
    arm: k1607.Arm


@dataclass(frozen=True)
class DerivedOfNothing(Law):
    bias: float = 0.0
    push: float = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "push", self.bias)

    def update(self, t, q, v, state):
        return self.push + self.bias - v, state, {}


def test_what_varies_in_vain_is_refused_and_zeros_are_no_exception(free, q0):
    for law, name, x in (
        (InVain(), "controller.unused", [1.0, 2.0]),
        (WithAnArm(free), "controller.arm.gravity", np.ones((2, 3))),
    ):
        with pytest.raises(ValueError, match="numbers that the loop depends on"):
            k1607.rollout(free, law, q0, 0.1, vary={name: x}, metrics={})
    with pytest.raises(TracingError, match="derived anew"):
        k1607.rollout(free, DerivedOfNothing(), q0, 0.1, vary={"controller.bias": [0.0, 5.0]}, metrics={})


def test_a_state_in_another_order_is_the_same_state(free, q0, same):
    same(OtherOrder())
    native = k1607.simulate(free, Native(OtherOrder(), free), q0, 0.1)
    np.testing.assert_allclose(native.q, k1607.simulate(free, OtherOrder(), q0, 0.1).q, atol=1e-12)


class WritesIntoWhatItMeasures(Law):
    def start(self, q, v, duration):
        q *= 0
        return None

    def update(self, t, q, v, state):
        q -= 1.0
        v *= -20
        tau = -q + v
        q[3] = 0.0
        v[2] = q[1]
        return tau, state, {}


def test_what_a_law_writes_into_its_arguments_moves_no_arm(free, q0):
    class Clean(Law):
        def update(self, t, q, v, state):
            return -(q - 1.0) - 20 * v, state, {}

    found, wanted = (k1607.simulate(free, law, q0, 0.1) for law in (WritesIntoWhatItMeasures(), Clean()))
    np.testing.assert_array_equal(found.q, wanted.q)
    np.testing.assert_array_equal(found.q[0], q0)
    rolled = k1607.rollout(free, WritesIntoWhatItMeasures(), q0, 0.1, log=("q",), metrics={})
    np.testing.assert_allclose(rolled.q[0], wanted.q, atol=1e-12)
    native = k1607.simulate(free, Native(WritesIntoWhatItMeasures(), free), q0, 0.1)
    np.testing.assert_allclose(native.q, wanted.q, atol=1e-12)


class Fast(Law):
    """A condition that is rarely met."""

    def update(self, t, q, v, state):
        return -20 * v if float(np.linalg.norm(v)) < 8.0 else 0 * v, state, {}


class Written(Law):
    def update(self, t, q, v, state):
        tau = np.zeros(7)
        tau[2] = -5 * q[2]
        return tau, state, {}


class Added(Law):
    def update(self, t, q, v, state):
        tau = np.zeros(7)
        tau += 3 * v
        return tau, state, {}


class Both(Law):
    def update(self, t, q, v, state):
        return np.where((q > 0) & (v > 0), q, v), state, {}


class Copied(Law):
    def update(self, t, q, v, state):
        return -q.copy(), state, {}


class HiddenArm(Law):
    def __init__(self, arm):
        class Helper:
            model = arm

        self.helper = Helper()

    def update(self, t, q, v, state):
        return self.helper.model.gravity_torque(q), state, {}


class Posed(Law):
    def __init__(self, arm):
        self.arm = arm

    def update(self, t, q, v, state):
        return -v * self.arm.forward_kinematics(q).inverse().translation[0], state, {}


@pytest.mark.parametrize(
    ("law", "line", "help"),
    [
        (lambda arm: Fast(), "float(np.linalg.norm(v))", "np.where for conditions"),
        (lambda arm: Written(), "tau[2] = -5", "np.stack for an array"),
        (lambda arm: Added(), "tau += 3", "x = x +"),
        (lambda arm: Both(), "(q > 0) & (v > 0)", "np.logical_and"),
        (lambda arm: Copied(), "q.copy()", "np.copy"),
        (HiddenArm, "gravity_torque(q)", "as an attribute of the controller"),
        (Posed, "inverse()", "translation and rotation"),
    ],
)
def test_what_does_not_trace_is_named_with_its_line_and_what_helps(free, q0, law, line, help):
    with pytest.raises(TracingError) as caught:
        k1607.rollout(free, law(free), q0, 0.1, metrics={})
    assert line in str(caught.value)
    assert help in str(caught.value)
    assert "test_own.py" in str(caught.value)
    assert len(str(caught.value)) < 800


class OtherStart(Law):
    """What it begins with is not what it traces to."""

    def __init__(self):
        self.calls = 0

    def start(self, q, v, duration):
        return self.initial(q, v)

    def initial(self, q, v):
        self.calls += 1
        return float(self.calls) * q

    def update(self, t, q, v, state):
        return -state, state, {}


class Costed(Law):
    def __init__(self):
        self.rng = np.random.default_rng(0)

    def update(self, t, q, v, state):
        return -v, state, {"cost": self.rng.normal()}


class Counter:
    calls = 0

    def __call__(self, log):
        self.calls += 1
        return self.calls


def test_where_it_begins_and_what_only_metrics_ask_for_is_looked_at_too(free, q0):
    with pytest.raises(TracingError, match="initial"):
        k1607.rollout(free, OtherStart(), q0, 0.1, metrics={})
    with pytest.raises(TracingError, match="on numbers"):
        k1607.rollout(free, Costed(), q0, 0.1, metrics={"cost": "max"})
    with pytest.raises(TracingError, match="on numbers"):
        k1607.rollout(free, Law(), q0, 0.1, metrics={"n": "max"}, signals={"n": Counter()})


class Words(Law):
    def update(self, t, q, v, state):
        return -v, state, {"flag": False, "none": None, "word": "push"}


@pytest.mark.parametrize("name", ["flag", "none", "word"])
def test_a_log_that_is_no_number_is_told(free, q0, name):
    with pytest.raises((TracingError, ValueError), match=name):
        k1607.rollout(free, Words(), q0, 0.1, metrics={}, log=(name,))


class Picky(Law):
    """Begins nowhere far from its start."""

    def start(self, q, v, duration):
        return self.initial(q, v)

    def initial(self, q, v):
        if isinstance(q, np.ndarray) and q[6] > 0.72:
            raise ValueError("too far")
        return 2 * q

    def update(self, t, q, v, state):
        return -state - 5 * v, state, {}


def test_a_start_that_is_refused_at_a_state_that_is_made_up_is_no_obstacle(same):
    same(Picky())


@dataclass(frozen=True)
class Noisy(Law):
    noise: Any
    begins: bool = False

    def initial(self, q, v):
        return self.noise(0.0) if self.begins else np.zeros(7)

    def start(self, q, v, duration):
        return self.initial(q, v)

    def update(self, t, q, v, state):
        return -q + self.noise(t) + state, state, {}


def test_noise_whose_seed_varies_is_that_of_the_samples(free, q0):
    seeds = {"controller.noise.seed": [3, 4]}
    law = Noisy(WhiteNoise(3, 7, 0.01))
    found = k1607.rollout(free, law, q0, 0.1, vary=seeds, metrics={})
    np.testing.assert_allclose(found.q_end[0], k1607.simulate(free, law, q0, 0.1).q[-1], atol=1e-12)
    with pytest.raises(ValueError, match="noise of the control period"):
        k1607.rollout(free, Noisy(WhiteNoise(3, 7, 0.02)), q0, 0.1, vary=seeds, metrics={})
    with pytest.raises(TracingError, match="the time of the sample"):
        k1607.rollout(free, Noisy(WhiteNoise(3, 7, 0.01), True), q0, 0.1, vary=seeds, metrics={})


@dataclass(frozen=True)
class Infinite(Law):
    def update(self, t, q, v, state):
        return np.where(t > 0.025, np.inf, 1.0) * np.ones(7), state, {}


def test_an_infinite_torque_is_no_limit_where_the_limit_varies(free, q0):
    found = k1607.rollout(free, Infinite(), q0, 0.1, vary={"plant.torque_limit": np.full((2, 7), 5.0)})
    np.testing.assert_allclose(found.failed_at, 0.03)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"varied": ("plant.viscous", "plant.viscous")}, "each name once, got plant.viscous twice"),
        (
            {"signals": {"work": lambda log: log["t"]}},
            "signals: every run logs work already",
        ),
        (
            {"signals": {"tau_max": lambda log: log["t"]}, "metrics": {"tau": "max"}, "log": ("tau_max",)},
            "log: expected none that is called as a metric's result is, got tau_max",
        ),
        ({"varied": ("payloads.0.time",), "payloads": [(0.1, k1607.Payload(1.0))]}, "no period and no time"),
    ],
)
def test_what_would_be_misunderstood_is_refused(free, settings, words):
    with pytest.raises(ValueError, match=words):
        k1607.rollouts(free, Law(), 0.1, **settings)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"plant": "panda"}, "plant: expected a Plant or an Arm"),
        ({"controller": Law}, "controller: expected an object with start"),
        ({"controller": lambda q: q}, "controller: expected an object with start"),
        ({"duration": "1"}, "duration: expected"),
        ({"metrics": ["error"]}, "metrics: expected a mapping"),
        ({"step": "rk4"}, "step: expected a function"),
        ({"signals": {"zz": lambda log: log["zz"]}}, "there is no 'zz' here"),
    ],
)
def test_arguments_of_another_kind_are_told(free, q0, given, words):
    with pytest.raises((ValueError, TracingError), match=words):
        k1607.rollout(**{"plant": free, "controller": Law(), "q0": q0, "duration": 0.1, **given})


def test_arguments_of_another_kind_are_told_by_sweep_and_batch(free):
    made = k1607.rollouts(free, Law(), 0.1, metrics={})
    with pytest.raises(ValueError, match="parameters: expected a Grid, Listed or Drawn"):
        k1607.sweep(made, {"q0": np.zeros((2, 7))})
    with pytest.raises(ValueError, match="run: expected what `rollouts` makes"):
        k1607.sweep(3, k1607.Listed({"q0": np.zeros((2, 7))}))
    with pytest.raises(ValueError, match="arm: expected an Arm"):
        k1607.batch("panda", "jacobian")


def test_loops_that_differ_in_any_setting_are_others_and_few_are_kept(free, law):
    settings = [
        {}, {"from_rest": True}, {"physics_step": 5e-4}, {"every": 2}, {"metrics": {"tau": "max"}}, {"log": ("q",)},
        {"duration": 0.2}, {"payloads": [(0.0, k1607.Payload(1.0))]}, {"external": pushed}, {"signals": {"n": counted}},
    ]  # fmt: skip
    made = [k1607.rollouts(**{"plant": free, "controller": law, "duration": 0.1, **more}) for more in settings]
    assert len(set(map(id, made))) == len(settings)
    assert len(rollout_module._recent) <= rollout_module.RECENT


def pushed(t, q, v):
    return None


def counted(log):
    return log["t"]


def test_a_wrong_number_in_the_middle_is_found(free, law, q0):
    for values in ([0.1, 0.2, -0.5, 0.3], np.linspace(-0.5, 1, 65), np.linspace(0.5, -1, 65)):
        with pytest.raises(ValueError, match="beta_1: expected a number >= 0"):
            k1607.rollout(free, law, q0, 0.1, vary={"controller.beta_1": values})


def test_of_a_rollout_that_is_lost_at_once_no_metric_is_told(free, q0):
    class Lost(Law):
        def update(self, t, q, v, state):
            return np.inf + 0 * v, state, {}

    found = k1607.rollout(free, Lost(), q0, 0.1, metrics={"tau": ("max", "rms", "last")})
    assert found.failed_at == 0
    assert all(np.isnan(found[f"tau_{kind}"]).all() for kind in ("max", "rms", "last"))


@dataclass(frozen=True)
class TwiceNoisy(Law):
    three: Any
    four: Any

    def update(self, t, q, v, state):
        return np.concatenate([self.three(t), self.four(t)]) - q, state, {}


def test_two_sources_of_noise_are_each_their_own(free, q0):
    law = TwiceNoisy(WhiteNoise(3, 3, 0.01), WhiteNoise(4, 4, 0.01))
    seeds = {"controller.three.seed": [3, 5, 6], "controller.four.seed": [4, 3, 2]}
    found = k1607.rollout(free, law, q0, 0.1, vary=seeds, metrics={})
    for i, (a, b) in enumerate(zip(*seeds.values(), strict=True)):
        wanted = k1607.simulate(free, TwiceNoisy(WhiteNoise(a, 3, 0.01), WhiteNoise(b, 4, 0.01)), q0, 0.1)
        np.testing.assert_allclose(found.q_end[i], wanted.q[-1], atol=1e-12)


def test_the_collector_of_garbage_is_as_it_was(free):
    assert gc.isenabled()
    k1607.rollouts(free, Law(), 0.05, metrics={})
    assert gc.isenabled()


def test_threads_may_make_rollouts_at_once(free, q0):
    def run(k):
        return k1607.rollout(free, Law(), q0, 0.01 * (1 + k % 12), metrics={}).sizes["rollout"]

    with ThreadPoolExecutor(6) as pool:
        assert list(pool.map(run, range(36))) == [1] * 36


@dataclass(frozen=True)
class Large(Law):
    """As many numbers of state, and operations."""

    size: int = 0
    turns: int = 0

    def start(self, q, v, duration):
        return np.zeros(self.size)

    def initial(self, q, v):
        return np.zeros(self.size)

    def update(self, t, q, v, state):
        x = q
        for _ in range(self.turns):
            x = np.cos(x) + 0.1 * q
        return -v + x, state, {}


TOO_LARGE = [
    (Large(size=4097), "controller: expected at most 4,096 numbers of state, got 4,097"),
    (Large(turns=4500), r"law: expected at most 60,000 operations, got 6\d,\d\d\d"),
]


@pytest.mark.parametrize(("law", "words"), TOO_LARGE, ids=["state", "operations"])
def test_what_a_compiler_would_take_minutes_for_is_told(free, q0, tmp_path, law, words):
    with pytest.raises(TracingError, match=words):
        k1607.rollouts(free, law, 0.1, metrics={})
    with pytest.raises(TracingError, match=words.replace("law:", "controller:")):
        k1607.export(free, tmp_path, {"large": law})
    k1607.simulate(free, law, q0, 0.01)


def test_as_much_as_is_said_is_taken():
    require_state("it", Layout(np.zeros(MOST_STATE)))
    require_operations("it", MOST_OPERATIONS)
    require_rollouts(10, AT_ONCE // 10)


def test_more_rollouts_than_memory_are_told_and_what_to_do(free, q0):
    run = k1607.rollouts(free, Law(), 0.1, log=("q",), metrics={})
    many = np.broadcast_to(q0, (10**7, 7))
    with pytest.raises(
        ValueError, match=r"expected at most [\d,]+ rollouts at once, 4 GiB, got 10,000,000 of 15.1 GiB; sweep"
    ):
        run(many)


def test_more_steps_than_memory_are_told(free):
    with pytest.raises(
        ValueError, match=r"duration, physics_step: expected at most 4 GiB .* got \d+\.\d GiB for 100,000,000 periods"
    ):
        k1607.rollouts(free, Law(), 1e6, metrics={})


class Careful(Law):
    """Begins below an angle of one only, and counts who asks."""

    asked = 0

    def initial(self, q, v):
        return None

    def start(self, q, v, duration):
        type(self).asked += 1
        if q[0] > 1 or duration > 1:
            raise ValueError(f"q0: expected to start below 1, within 1 s, got {q[0]}, {duration}")
        q[:] = 0.0
        return None


def test_what_start_refuses_is_refused_where_all_begin_alike(free, q0):
    far = q0 + 2.0
    for begin in (k1607.simulate, k1607.rollout):
        with pytest.raises(ValueError, match="q0: expected to start below 1"):
            begin(free, Careful(), far, 0.1)
        with pytest.raises(ValueError, match="q0: expected to start below 1"):
            begin(free, Careful(), q0, 1.5)
    run = k1607.rollouts(free, Careful(), 0.1, metrics={}, varied=("plant.viscous",))
    with pytest.raises(ValueError, match="q0: expected to start below 1"):
        k1607.sweep(run, Grid({"plant.viscous": np.zeros((3, 7))}), far)
    Careful.asked = 0
    for _ in range(3):
        found = run(q0, vary={"plant.viscous": np.ones(7)})
    assert Careful.asked == 1
    np.testing.assert_allclose(
        found.q_end[0], k1607.simulate(Plant(free, viscous=np.ones(7)), Careful(), q0, 0.1).q[-1]
    )


def test_of_many_starts_each_is_on_its_own(free, q0):
    """One of them does not end the others; what becomes of it is seen."""
    starts = np.stack([q0 + 2.0, q0])
    run = k1607.rollouts(free, Careful(), 0.1, metrics={})
    assert run(starts).sizes["rollout"] == 2
    assert k1607.sweep(run, Grid({"q0": starts}), chunk=1).sizes["q0.number"] == 2


def test_a_start_is_asked_of_the_controller_that_runs():
    """What is varied is not asked as it was: nobody runs that."""
    arm = k1607.load_k1607()
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])

    @dataclass(frozen=True)
    class Careful:
        limit: float

        def start(self, q, v, duration):
            if self.limit > 1:
                raise ValueError("limit: expected at most 1")
            return ()

        def initial(self, q, v):
            return ()

        def update(self, t, q, v, state):
            return -self.limit * v, state, {}

    found = k1607.rollout(arm, Careful(2.0), q0, 0.02, vary={"controller.limit": [0.5, 0.7]}, metrics={})
    assert np.isnan(found.failed_at).all()
    with pytest.raises(ValueError, match="limit: expected at most 1"):
        k1607.rollout(arm, Careful(2.0), q0, 0.02, metrics={})


@pytest.mark.parametrize("kind", ["counts", "random", "global"])
def test_what_is_no_function_of_time_alone_is_refused(free, q0, kind):
    """`simulate` asks it once a sample, a table once a sample and again: what comes out would be something else."""
    asked, rng = [], np.random.default_rng(0)

    def counts(t):
        asked.append(t)
        return np.full(7, len(asked) / 100)

    def drawn(t):
        return rng.normal(size=7)

    path = {"counts": counts, "random": drawn, "global": lambda t: np.full(7, COUNTER.__next__() / 100)}[kind]

    @dataclass(frozen=True)
    class Follows:
        path: object

        def start(self, q, v, duration):
            return ()

        def update(self, t, q, v, state):
            return 20 * (self.path(t) - q) - 5 * v, state, {}

    with pytest.raises(
        TracingError, match=r"path: expected a function of time alone, got another value when asked again"
    ):
        k1607.rollout(free, Follows(path), q0, 0.05, metrics={})


COUNTER = itertools.count()
