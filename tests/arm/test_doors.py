"""What is handed to an arm's own methods: numbers of the right shape, or a ValueError that names the argument."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.arm.payload import Payload, blend, velocity_after_gripping
from k1607_pin.arm.wrench import Wrench, wrench_at_tool, wrench_torque

GOOD = np.linspace(-0.5, 0.7, 7)
METHODS = {
    "forward_kinematics": ("q",),
    "frames": ("q",),
    "jacobian": ("q",),
    "mass_matrix": ("q",),
    "gravity_torque": ("q",),
    "bias_torque": ("q", "v"),
    "coriolis_matrix": ("q", "v"),
    "forward_dynamics": ("q", "v", "tau"),
    "inverse_dynamics": ("q", "v", "a"),
    "energy": ("q", "v"),
    "jacobian_time_variation": ("q", "v"),
    "operational_space": ("q", "v"),
}
masked = np.ma.masked_array(GOOD, [0, 0, 1, 0, 0, 0, 0])
BAD = {
    "NaN": np.where(np.arange(7) == 3, np.nan, GOOD),
    "infinite": np.where(np.arange(7) == 3, np.inf, GOOD),
    "two infinities": np.array([np.inf, -np.inf, 0, 0, 0, 0, 0]),
    "short": GOOD[:6],
    "column": GOOD[:, None],
    "scalar": 0.3,
    "complex": GOOD + 0j,
    "complex list": [0, 0, 0, 1j, 0, 0, 0],
    "masked": masked,
    "None": None,
    "a None in it": [None, 0, 0, 0, 0, 0, 0],
    "text": "0 0 0 0 0 0 0",
    "texts": ["0"] * 7,
    "ragged": [[0, 0, 0], [0, 0, 0, 0]],
    "huge": [10**400, 0, 0, 0, 0, 0, 0],
    "dict": {"q": 0},
    "function": np.sin,
    "dates": np.zeros(7, "datetime64[s]"),
}


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize(("method", "name"), [(method, name) for method, names in METHODS.items() for name in names])
def test_it_is_refused_by_name(reference, method, name, kind):
    arguments = {key: GOOD for key in METHODS[method]} | {name: BAD[kind]}
    with pytest.raises(ValueError, match=rf"^{name}: expected \((7|\.\.\., 7)"):
        getattr(reference, method)(**arguments)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("make", [list, tuple, np.float32, lambda x: x.astype(object), lambda x: np.ma.masked_array(x)])
def test_other_numbers_will_do(reference, method, make):
    single = GOOD.astype(np.float32).astype(float)  # the same number in every type
    arguments = [make(single)] * len(METHODS[method])
    one, two = (getattr(reference, method)(*x) for x in (arguments, [single] * len(arguments)))
    if method in ("forward_kinematics", "frames"):
        one, two = (np.array([T.homogeneous for T in (x if isinstance(x, list) else [x])]) for x in (one, two))
    if method == "operational_space":
        one, two = one.Lambda, two.Lambda
    np.testing.assert_array_equal(one, two)


def test_other_arguments_of_methods(reference):
    with pytest.raises(ValueError, match=r"^damping: expected a Damping or None"):
        reference.operational_space(GOOD, GOOD, 0.1)
    for rng in (None, 1, np.random):
        with pytest.raises(ValueError, match=r"^rng: expected a numpy\.random\.Generator"):
            reference.random_configuration(rng)
    for size in (-1, 1.5, None, "3", (2, -1)):
        with pytest.raises(ValueError, match=r"^size: expected a whole number"):
            reference.random_configuration(np.random.default_rng(1), size)


THREE = {kind: x for kind, x in BAD.items() if kind not in ("short", "column")} | {
    "seven": GOOD,
    "column": [[1], [2], [3]],
}


@pytest.mark.parametrize("kind", THREE)
@pytest.mark.parametrize("name", ["force", "moment"])
def test_a_wrench_is_six_numbers(name, kind):
    with pytest.raises(ValueError, match=rf"^{name}: expected \(3,\) finite numbers in N"):
        Wrench(**{name: THREE[kind]})


def test_a_wrench_keeps_its_own_numbers():
    force = np.ones(3)
    wrench = Wrench(force)
    force[0] = 9
    np.testing.assert_array_equal(wrench.force, 1)


@pytest.mark.parametrize("axes", ["tool", None, 3, ["base"]])
def test_a_wrenchs_axes(axes):
    with pytest.raises(ValueError, match=r"^axes: expected one of base, frame"):
        Wrench(axes=axes)


@pytest.mark.parametrize("frame", [3, ["tool"]])
def test_a_wrenchs_frame(frame):
    with pytest.raises(ValueError, match=r"^frame: expected the name of a frame"):
        Wrench(frame=frame)


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("function", [wrench_torque, wrench_at_tool])
def test_a_wrench_acts_at_angles(reference, function, kind):
    if function is wrench_torque or kind != "column":
        with pytest.raises(ValueError, match=r"^q: expected "):
            function(reference, BAD[kind], Wrench(np.ones(3), frame="link6", axes="frame"))


@pytest.mark.parametrize("mass", [np.nan, np.inf, -1, None, "1", 1j, [1.0], np.ma.masked, True])
def test_a_payloads_mass(mass):
    with pytest.raises(ValueError, match=r"^mass: expected a number >= 0 in kg"):
        Payload(mass)


@pytest.mark.parametrize("kind", THREE)
def test_a_payloads_places(kind):
    with pytest.raises(ValueError, match=r"^cg: expected \(3,\) finite numbers in m"):
        Payload(1.0, THREE[kind])
    with pytest.raises(ValueError, match=r"^inertia: expected \(3, 3\) finite numbers in kg m\^2"):
        Payload(1.0, inertia=THREE[kind])


def test_what_is_done_with_payloads(reference):
    with pytest.raises(ValueError, match=r"^payload: expected a Payload"):
        k1607.with_payload(reference, 3.0)
    for share in (np.nan, -0.1, 1.5, None, 1j):
        with pytest.raises(ValueError, match=r"^share: expected a number"):
            blend(Payload(1.0), Payload(2.0), share)
    with pytest.raises(ValueError, match=r"^v: expected \(7,\)"):
        velocity_after_gripping(reference, reference, Payload(1.0), GOOD, GOOD[:3])
    with pytest.raises(ValueError, match=r"^q: expected \(7,\)"):
        velocity_after_gripping(reference, reference, Payload(1.0), BAD["NaN"], GOOD)
