"""A plant's arguments: what is no (n,) finite numbers is refused by its name, symbols pass."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled.trace import trace
from k1607_pin.simulation.simulate import simulate

N = 7
BAD = {
    "NaN": np.array([np.nan] + [0.0] * 6),
    "infinite": np.array([0.0] * 6 + [-np.inf]),
    "complex": np.zeros(N) + 1j,
    "masked": np.ma.array(np.zeros(N), mask=[True] + [False] * 6),
    "short": np.zeros(N - 1),
    "long": np.zeros(N + 1),
    "one": 0.5,
    "column": np.zeros((N, 1)),
    "text": "1234567",
    "nothing": None,
    "texts": ["1"] * N,
}
CALLS = {
    "motor_torque": ("tau",),
    "loss_torque": ("q", "v"),
    "spring_torque": ("q",),
    "passive_torque": ("q", "v"),
    "acceleration": ("q", "v", "tau", "external"),
    "energy": ("q", "v"),
}
PLACES = [(method, name) for method, names in CALLS.items() for name in names]


@pytest.fixture(scope="module")
def plant():
    arm = k1607.load_k1607()
    return k1607.Plant(arm, np.ones(N), np.ones(N), np.full(N, 50.0), np.full(N, 1e3), np.full(N, 5.0))


@pytest.mark.parametrize(("method", "name"), PLACES)
@pytest.mark.parametrize("kind", BAD)
def test_what_is_no_vector_is_refused_by_name(plant, method, name, kind):
    if name == "external" and kind == "one":
        return  # a float is for every joint
    given = {other: np.zeros(N) for other in CALLS[method]} | {name: BAD[kind]}
    with pytest.raises(ValueError, match=rf"^{name}: expected \({N},\) finite numbers"):
        getattr(plant, method)(**given)


@pytest.mark.parametrize("method", CALLS)
def test_lists_are_vectors(plant, method):
    values = np.random.default_rng(3).uniform(-4, 4, (4, N))  # beyond the stops, too
    vectors = values[: len(CALLS[method])]
    function = getattr(plant, method)
    np.testing.assert_array_equal(function(*vectors), function(*map(list, vectors)))


@pytest.mark.parametrize("method", ["motor_torque", "loss_torque", "spring_torque", "passive_torque"])
def test_symbols_pass(plant, method):
    vectors = np.random.default_rng(4).uniform(-4, 4, (len(CALLS[method]), N))
    function = getattr(plant, method)
    f = trace(function, method, [(N,)] * len(vectors))
    np.testing.assert_allclose(f(*vectors).full().ravel(), function(*vectors), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("name", ["q0", "v0"])
def test_a_start_is_refused_by_name(plant, name, kind):
    if name == "v0" and kind == "nothing":
        return  # at rest
    with pytest.raises(ValueError, match=rf"^{name}: expected \({N},\) finite numbers"):
        simulate(plant, Idle(), **({"q0": np.zeros(N), "v0": np.zeros(N)} | {name: BAD[kind]}), duration=0.1)


@pytest.mark.parametrize("name", ["duration", "control_period", "physics_step"])
@pytest.mark.parametrize("value", [np.nan, np.inf, 0, -1, None, "1", 1j, [0.1, 0.2], np.array([0.1]), True])
def test_a_time_is_refused_by_name(plant, name, value):
    with pytest.raises(ValueError, match=rf"^{name}: expected a positive number in s, got "):
        simulate(plant, Idle(), np.zeros(N), **({"duration": 0.1} | {name: value}))


@pytest.mark.parametrize("times", [{"physics_step": 1e-300}, {"duration": 1e100}, {"duration": 1e11}])
def test_steps_without_end_are_refused(plant, times):
    with pytest.raises(ValueError, match=r"physics_step: expected at most 1e\+12"):
        simulate(plant, Idle(), np.zeros(N), **({"duration": 0.1} | times))


@pytest.mark.parametrize("given", [None, 5, "arm", object(), k1607.Plant])
def test_a_plant_is_of_an_arm(given):
    with pytest.raises(ValueError, match=r"^arm: expected an Arm"):
        k1607.Plant(given)


@pytest.mark.parametrize("name", ["viscous", "coulomb", "torque_limit", "stop_stiffness", "stop_damping"])
@pytest.mark.parametrize("kind", [kind for kind in BAD if kind != "text"] + ["negative"])
def test_its_own_numbers_are_refused_by_name(name, kind):
    arm = k1607.load_k1607()
    with pytest.raises(ValueError, match=rf"^{name}: expected \({N},\) numbers >= 0, got "):
        k1607.Plant(arm, **{name: -np.ones(N) if kind == "negative" else BAD[kind]})


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (None, "controller.update: expected three things back"),
        (np.zeros(N), "controller.update: expected three things back"),
        ((np.zeros(N), ()), "controller.update: expected three things back"),
        ((np.zeros(N), (), None), "controller.update: expected three things back"),
        ((np.zeros(N) + 1j, (), {}), "controller: expected a torque of shape"),
        ((BAD["masked"], (), {}), "controller: expected a torque of shape"),
        ((None, (), {}), "controller: expected a torque of shape"),
        ((np.zeros(6), (), {}), "controller: expected a torque of shape"),
    ],
)
def test_a_controller_s_answer_is_looked_at(plant, answer, words):
    law = Idle()
    law.update = lambda *_: answer
    with pytest.raises(ValueError, match=words):
        simulate(plant, law, np.zeros(N), 0.1)


class Idle:
    """Asks for nothing."""

    def start(self, q, v, duration):
        return ()

    def update(self, t, q, v, state):
        return np.zeros(len(q)), state, {}
