"""Any object of plain Python may be a controller, its state, or what a path gives: it traces, or is told why not."""

import collections
import copy
import enum
import functools
import itertools
from dataclasses import dataclass
from functools import cached_property, partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import k1607_pin as k1607
from k1607_pin.compiled import nest
from k1607_pin.compiled.leaves import Layout, substituted
from k1607_pin.compiled.tracer import TracingError

TAU = np.linspace(1.0, 2.0, 7)


@pytest.fixture(scope="module")
def free():
    """Weightless."""
    return k1607.load_k1607(gravity=(0, 0, 0))


class Point(NamedTuple):
    x: Any
    push: Any


class Slotted:
    __slots__ = ("__hidden", "push", "x")

    def __init__(self, x, push):
        self.x, self.push, self.__hidden = x, push, 2.0 * push

    @property
    def hidden(self):
        return self.__hidden


class More(Slotted):
    __slots__ = ("z",)


@dataclass(frozen=True, slots=True)
class FrozenSlots:
    x: Any
    push: Any


class Plain:
    def __init__(self, x, push):
        self.x, self.push = x, push


class Computed:
    """Its push is computed of another number."""

    def __init__(self, x, push):
        self.x, self.half = x, push / 2

    @property
    def push(self):
        return 2 * self.half


class Remembered(Computed):
    @cached_property
    def push(self):
        return 2 * self.half


class Dictionary(dict):
    __getattr__ = dict.__getitem__


class Ordered(collections.OrderedDict):
    __getattr__ = dict.__getitem__


MAKERS = {
    "namespace": lambda x, push: SimpleNamespace(x=x, push=push),
    "named tuple": Point,
    "slots": Slotted,
    "frozen slots": FrozenSlots,
    "plain": Plain,
    "property": Computed,
    "cached": Remembered,
    "dict with attributes": lambda x, push: Dictionary(x=x, push=push),
    "ordered dict": lambda x, push: Ordered(x=x, push=push),
    "nested": lambda x, push: SimpleNamespace(x=x, deep=[Plain((x,), {"p": push})], push=push),
}


class Law:
    """Damping and a push along a path."""

    def __init__(self, path=None):
        self.path = path

    def start(self, q, v, duration):
        return None

    def update(self, t, q, v, state):
        point = self.path(t)
        return -v + TAU * point.push + point.x, state, {}


def is_simulated(free, q0, make, **settings):
    """A rollout ends where `simulate` does."""
    found = k1607.rollout(free, make(), q0, 0.1, metrics={}, **settings)
    np.testing.assert_allclose(found.q_end[0], k1607.simulate(free, make(), q0, 0.1, **settings).q[-1], atol=1e-12)


@pytest.mark.parametrize("kind", MAKERS)
def test_what_a_path_gives(free, q0, kind):
    """Each would have stayed what it was at t = 0."""
    is_simulated(free, q0, lambda: Law(lambda t: MAKERS[kind](np.full(7, np.sin(9 * t)), 1.0 + (t > 0.05) * 5.0)))


def test_a_pose_of_pinocchio_s(free, q0):
    def path(t):
        return pin.SE3(pin.exp3(np.array([t, 0, 0])), np.array([0.0, t, 1.0]))

    class Posed(Law):
        def update(self, t, q, v, state):
            pose = self.path(t)
            return -v + pose.translation[1] + TAU * pose.rotation[1, 2], state, {}

    is_simulated(free, q0, lambda: Posed(path))


class Stateful(Law):
    def __init__(self, make):
        self.make = make

    def start(self, q, v, duration):
        return self.make(np.zeros(7), 1.0)

    def update(self, t, q, v, state):
        after = copy.copy(state)
        x, push = state.x + 0.1 * q, state.push + 1.0
        if isinstance(after, dict):
            after.update(x=x, push=push)
        elif isinstance(after, tuple):
            after = after._replace(x=x, push=push)
        else:
            object.__setattr__(after, "x", x)
            object.__setattr__(after, "push", push)
        return -v - state.x + TAU * state.push, after, {}


@pytest.mark.parametrize("kind", ["namespace", "named tuple", "slots", "frozen slots", "plain", "dict with attributes"])
def test_what_a_state_is(free, q0, kind):
    is_simulated(free, q0, lambda: Stateful(MAKERS[kind]))


class Delay(Law):
    """A line of the last three velocities."""

    def start(self, q, v, duration):
        return collections.deque([0.0 * v] * 3, maxlen=3)

    def update(self, t, q, v, state):
        oldest, after = state[0], state.copy()
        after.append(1.0 * v)
        return -5 * oldest + TAU, after, {}


def test_a_line_of_old_values(free, q0):
    is_simulated(free, q0, Delay)


class SlottedLaw:
    __slots__ = ("arm", "gain", "path")

    def __init__(self, arm, path):
        self.arm, self.gain, self.path = arm, 3.0, path

    def start(self, q, v, duration):
        return None

    def update(self, t, q, v, state):
        return self.arm.bias_torque(q, v) - self.gain * v + self.path(t), state, {}


class NamedLaw(NamedTuple):
    arm: Any
    gain: Any

    def start(self, q, v, duration):
        return None

    def update(self, t, q, v, state):
        return self.arm.bias_torque(q, v) - self.gain * v + TAU, state, {}


def steps(t):
    """A function of time that does not trace."""
    return TAU if t < 0.05 else -TAU


class Deep(Law):
    """The arm is in a helper's helper, which knows its owner."""

    def __init__(self, arm):
        self.helpers = {"one": [SimpleNamespace(model=arm, owner=self)]}

    def update(self, t, q, v, state):
        helper = self.helpers["one"][0]
        return helper.model.bias_torque(q, v) - 3 * v + TAU * len(helper.owner.helpers), state, {}


class Method:
    def __init__(self, arm):
        self.arm = arm

    def torque(self, gain, q, v):
        return self.arm.bias_torque(q, v) - gain * v


class Calls(Law):
    def __init__(self, fun):
        self.fun = fun

    def update(self, t, q, v, state):
        return self.fun(q=q, v=v) + TAU * self.fun.__class__.__name__.count("zzz") + TAU, state, {}


def closure(arm, gain=2.0):
    gains = [gain]

    def torque(q, v, more=arm):
        return arm.bias_torque(q, v) - gains[0] * v + more.gravity_torque(q)

    return torque


CONTROLLERS = {
    "slots": lambda arm: SlottedLaw(arm, steps),
    "named tuple": lambda arm: NamedLaw(arm, 3.0),
    "namespace": lambda arm: SimpleNamespace(
        start=lambda q, v, T: None, update=lambda t, q, v, s: (arm.bias_torque(q, v) - v + TAU, s, {})
    ),
    "deep": Deep,
    "bound method": lambda arm: Calls(partial(Method(arm).torque, 2.0)),
    "partial of a function": lambda arm: Calls(partial(lambda arm, q, v: arm.bias_torque(q, v) - v, arm)),
    "closure": lambda arm: Calls(closure(arm)),
    "function of the state": lambda arm: Applies(np.tanh),
}


class Applies(Law):
    """A function of one argument that is no time."""

    def __init__(self, fun):
        self.fun = fun

    def update(self, t, q, v, state):
        return -5 * self.fun(v) + TAU, state, {}


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_what_a_controller_is(free, q0, kind):
    is_simulated(free, q0, lambda: CONTROLLERS[kind](free))


def test_a_world_and_a_signal_that_hold_an_arm(free, q0):
    def pushed(t, q, v):
        return k1607.Wrench(10 * free.forward_kinematics(q).translation)

    def height(log):
        return free.forward_kinematics(log["q"]).translation[2]

    is_simulated(free, q0, lambda: Law(lambda t: Point(0.0, 1.0)), external=pushed)
    found = k1607.rollout(
        free,
        Law(lambda t: Point(0.0, 1.0)),
        q0,
        0.1,
        metrics={},
        signals={"height": height},
        log=("height", "tool_position"),
    )
    np.testing.assert_allclose(found.height, found.tool_position[..., 2], atol=1e-12)


class Mode(enum.Enum):
    PUSH = 1
    HOLD = 2


class Fresh:
    """One that cannot be compared."""

    __slots__ = ()


LATE = 0.05
REFUSED = {
    "a flag": (lambda t: Point(t > LATE, 1.0), "expected False for x always"),
    "a flag of NumPy's": (lambda t: Point(np.array([t > LATE] * 7), 1.0), "for x always"),
    "a word": (
        lambda t: SimpleNamespace(x=0.0, push=1.0, mode="push" if t < LATE else "hold"),
        "'push' for mode always",
    ),
    "an enumeration": (lambda t: SimpleNamespace(x=0.0, push=1.0, mode=Mode(1 + (t > LATE))), "Mode.PUSH: 1> for mode"),
    "nothing at first": (lambda t: Point(None if t < LATE else t, 1.0), "expected None for x always"),
    "nothing later": (lambda t: Point(0.0 if t < LATE else None, 1.0), "for x always, as at first, got None"),
    "another length": (lambda t: Point(np.zeros(7 if t < LATE else 1) + t, np.ones(1 if t < LATE else 7)), "of shape"),
    "other names": (lambda t: {"x": t} if t < LATE else {"y": t}, "of x, always, got one of y"),
    "complex": (lambda t: Point(1j * t, 1.0), "for x always"),
    "a function made anew": (lambda t: Point(lambda: t, 1.0), "for x always"),
    "deep inside": (lambda t: Point([{"a": (0.0, "b" if t < LATE else "c")}], 1.0), "'b' for x.0.a.1 always"),
}


class Tolerant(Law):
    """Takes whatever a path gives, as long as it is asked for nothing of it."""

    def update(self, t, q, v, state):
        self.path(t)
        return -v + t, state, {}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_changes_and_is_no_number_is_named(free, q0, kind):
    path, words = REFUSED[kind]
    with pytest.raises(TracingError) as caught:
        k1607.rollout(free, Tolerant(path), q0, 0.1, metrics={})
    assert str(caught.value).startswith("controller.path: expected ")
    assert words in str(caught.value)
    assert "Python condition" not in str(caught.value)


def test_what_is_no_number_and_stays_may_be_there(free, q0):
    for x in (None, "word", Mode.PUSH, {1, 2}, (), [], np.zeros(0), True, functools.reduce, steps):
        is_simulated(free, q0, lambda x=x: Tolerant(lambda t: SimpleNamespace(x=x, push=1.0)))


class StateOf(Law):
    def __init__(self, first, later):
        self.first, self.later = first, later

    def start(self, q, v, duration):
        return SimpleNamespace(x=0.0, what=self.first)

    def update(self, t, q, v, state):
        return -v, SimpleNamespace(x=state.x + 1.0, what=self.later), {}


@pytest.mark.parametrize(
    ("first", "later"), [("a", "b"), (True, False), (None, 1.0), (Mode.PUSH, Mode.HOLD), ([], [1.0])]
)
def test_a_state_that_is_no_number_and_changes_is_named(free, q0, first, later):
    with pytest.raises(TracingError, match=r"the controller's state: expected .* for what.* always") as caught:
        k1607.rollout(free, StateOf(first, later), q0, 0.1, metrics={})
    assert "Python condition" not in str(caught.value)


def test_a_flag_that_depends_on_numbers_is_told(free, q0):
    class Flag(StateOf):
        def update(self, t, q, v, state):
            return -v, SimpleNamespace(x=state.x, what=q[0] > 0.1), {}

    with pytest.raises(
        TracingError, match=r"expected False for what always, as at first, got a number.* a flag 0\.0 or 1\.0"
    ):
        k1607.rollout(free, Flag(False, None), q0, 0.1, metrics={})


class Counting:
    def __init__(self):
        self.inner = SimpleNamespace(calls=0)

    def __call__(self, t, q):
        self.inner.calls += 1
        return 0.1 * self.inner.calls


def counting():
    calls = 0

    def count(t, q):
        nonlocal calls
        calls += 1
        return 0.1 * calls

    return count


class Shaken:
    def __init__(self):
        self.rng = np.random.default_rng(0)

    def __call__(self, t, q):
        return self.rng.normal()


class Iterating:
    def __init__(self):
        self.k = itertools.count()

    def __call__(self, t, q):
        return float(next(self.k))


class KindOf:
    def __call__(self, t, q):
        return 1.0 if isinstance(q, np.ndarray) else 2.0


class AsksTwo(Law):
    def update(self, t, q, v, state):
        return -v + self.path(t, q), state, {}


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (Counting, "changes its own controller.path.inner.calls"),
        (counting, "changes its own controller.path.calls"),
        (Shaken, "changes its own controller.path.rng"),
        (Iterating, "Called twice with the same arguments it returns different results"),
        (KindOf, "A Python condition"),
    ],
    ids=["inner counter", "closure's counter", "random", "iterator", "kind"],
)
def test_the_true_reason_is_told(free, q0, path, words):
    with pytest.raises(TracingError, match=words) as caught:
        k1607.rollout(free, AsksTwo(path()), q0, 0.1, metrics={})
    assert "on numbers" in str(caught.value)


def test_nothing_of_a_controller_is_changed_by_tracing_it(free, q0):
    """Symbols written into a helper stay in the copy."""

    class Writes(Law):
        def __init__(self):
            self.helper = SimpleNamespace(last=np.zeros(7))

        def update(self, t, q, v, state):
            self.helper.last = v
            return -v, state, {}

    law = Writes()
    k1607.rollout(free, law, q0, 0.1, metrics={})
    assert type(law.helper.last) is np.ndarray
    assert Mode.PUSH.value == 1


def test_a_nest_that_holds_itself_is_told(free, q0):
    def path(t):
        point = SimpleNamespace(x=0.0, push=1.0)
        point.owner = point
        return point

    with pytest.raises(
        TracingError, match=r"controller\.path: expected at most 50 levels of nesting.* it may contain itself"
    ):
        k1607.rollout(free, Law(path), q0, 0.1, metrics={})


LEAVES = st.one_of(
    st.floats(-9, 9), st.integers(-9, 9), st.lists(st.floats(-9, 9), max_size=3).map(np.array), st.none(), st.text(max_size=2),
    st.booleans(), st.sampled_from(Mode),
)  # fmt: skip


def nests(inner):
    pair = st.tuples(inner, inner)
    return st.one_of(
        pair, st.lists(inner, max_size=3), st.lists(inner, max_size=3).map(collections.deque),
        st.dictionaries(st.sampled_from("abc"), inner, max_size=3),
        *(pair.map(lambda p, make=make: make(*p)) for make in (Point, Pair, Plain, lambda a, b: SimpleNamespace(a=a, b=b))),
    )  # fmt: skip


class Pair:
    __slots__ = ("a", "b")

    def __init__(self, a, b):
        self.a, self.b = a, b


@given(st.recursive(LEAVES, nests, max_leaves=12))
def test_a_nest_is_what_is_made_of_its_numbers(x):
    """Flattened and rebuilt it is the same; with one number more it is flattened to that; a copy is the same and another."""
    layout = Layout(x, "nest")
    numbers = np.array(layout.flat(x), dtype=float)
    again = layout.rebuilt(numbers)
    assert np.array_equal(layout.flat(again), numbers)
    assert [name for name, _ in nest.parts(x) or ()] == [name for name, _ in nest.parts(again) or ()]
    assert np.array_equal(layout.flat(layout.rebuilt(numbers + 1)), numbers + 1)
    made = substituted(x, {}, lambda x, name, symbols: None)
    assert nest.same(x, made)
