"""What is no number, not finite, or of another shape is refused at every door of the room, by the argument's name."""

from dataclasses import fields

import numpy as np
import pytest

from k1607_pin.arm.ready import ready_postures
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.baselines import ComputedTorque, GravityPD, OperationalSpaceControl, SlotineLi, parameter_rates
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.hybrid import HybridAdaptive, Mode, hybrid_gains
from k1607_pin.control.joint_space import JointAdaptive, gains_from_mass, model_from_mass
from k1607_pin.control.modes import checked_modes
from k1607_pin.control.posture import Posture, along, damp, hold
from k1607_pin.control.practice import Practice, adaptation_rates
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.joint_plan import JointPoint
from k1607_pin.paths.report_paths import Line

MODEL = reference_model(2 * np.ones(6), 3 * np.ones(6))
JOINT_MODEL = reference_model(2 * np.ones(7), 3 * np.ones(7))
SIX, SEVEN = Gains(10 * np.eye(6), np.eye(6)), Gains(10 * np.eye(7), np.eye(7))
POSITIVE, NOT_NEGATIVE, MAY_BE_INFINITE = {0.0, -1.0}, {-1.0}, {"inf"}


def doors(arm):
    """Name -> function, good arguments, and for each numeric one what else it refuses."""
    q = ready_postures(arm)[0]
    tool = arm.forward_kinematics(q)
    line, R = Line(tool.translation), tool.rotation
    still = lambda t: JointPoint(q, 0 * q, 0 * q)  # noqa: E731
    omega, sensor = {"omega": POSITIVE}, lambda t, q, v: np.zeros(6)
    rates = {"beta_1": NOT_NEGATIVE, "beta_2": NOT_NEGATIVE, "period": POSITIVE}
    adaptive = {"beta_1": 1.0, "beta_2": 1.0, "period": 0.001}
    hybrid = {
        "arm": arm, "path": line, "rotation": R, "modes": Mode(np.zeros(6)), "sensor": sensor, "stiffness": 1e4, "gains": SIX,
        "force_gains": SIX, "model": MODEL, "force_model": MODEL, "force_beta_1": 1.0, "force_beta_2": 1.0,
        "compliance": np.eye(3), "transition": 0.1, "force_integral": 1.0, "touch": 0.1, **adaptive,
    }  # fmt: skip
    of_hybrid = {
        "rotation": {}, "stiffness": POSITIVE, "force_beta_1": NOT_NEGATIVE, "force_beta_2": NOT_NEGATIVE, "compliance": {},
        "transition": POSITIVE, "force_integral": NOT_NEGATIVE, "touch": NOT_NEGATIVE, **rates,
    }  # fmt: skip
    gains = {"arm": arm, "q": q, "omega": 5.0, "damping": 1.0}
    of_gains = {"q": {}, "damping": NOT_NEGATIVE, **omega}
    return {
        "JointAdaptive": (
            JointAdaptive,
            {"arm": arm, "path": still, "gains": SEVEN, "model": JOINT_MODEL, **adaptive},
            rates,
        ),
        "CartesianAdaptive": (
            CartesianAdaptive,
            {"arm": arm, "path": line, "rotation": R, "gains": SIX, "model": MODEL, **adaptive},
            {"rotation": {}, **rates},
        ),
        "HybridAdaptive": (HybridAdaptive, hybrid, of_hybrid),
        "ComputedTorque": (ComputedTorque, {"arm": arm, "path": still, "omega": 5.0}, omega),
        "OperationalSpaceControl": (
            OperationalSpaceControl,
            {"arm": arm, "path": line, "rotation": R, "omega": 5.0},
            {"rotation": {}, **omega},
        ),
        "SlotineLi": (
            SlotineLi,
            {"arm": arm, "path": still, "K_D": np.eye(7), "omega": 5.0, "rates": np.ones(70), "period": 0.01},
            {"K_D": {}, "rates": {}, "period": POSITIVE, **omega},
        ),
        "parameter_rates": (
            parameter_rates,
            {"arm": arm, "q": q, "K_D": np.eye(7), "rate": 5.0, "length": 0.1},
            {"q": {}, "K_D": {}, "rate": POSITIVE, "length": POSITIVE},
        ),
        "gains_from_inertia": (gains_from_inertia, gains, of_gains),
        "gains_from_mass": (gains_from_mass, gains, of_gains),
        "model_from_mass": (model_from_mass, {"arm": arm, "q": q, "omega": 5.0}, {"q": {}, **omega}),
        "hybrid_gains": (
            hybrid_gains,
            {**gains, "stiffness": 1e4, "force_omega": 20.0, "force_damping": 1.0, "compliance": np.eye(3)},
            {
                **of_gains,
                "stiffness": POSITIVE,
                "force_omega": POSITIVE,
                "force_damping": NOT_NEGATIVE,
                "compliance": {},
            },
        ),
        "reference_model": (
            reference_model,
            {"Delta_1": np.ones(2), "Delta_2": np.ones(2), "Q": np.eye(4)},
            {"Delta_1": {}, "Delta_2": {}, "Q": {}},
        ),
        "adaptation_rates": (
            adaptation_rates,
            {"gains": SIX, "model": MODEL, "disturbance": np.ones(6), "rate": 1.0},
            {"disturbance": {}, "rate": NOT_NEGATIVE},
        ),
        "Practice": (
            Practice,
            {"sigma": 0.1, "gain_bound": 0.5, "dead_zone": 0.1, "torque_limit": np.ones(7), "velocity_cutoff": 100.0},
            {
                "sigma": NOT_NEGATIVE,
                "gain_bound": NOT_NEGATIVE | MAY_BE_INFINITE,
                "dead_zone": NOT_NEGATIVE | MAY_BE_INFINITE,
                "torque_limit": POSITIVE | {5.0} | MAY_BE_INFINITE,
                "velocity_cutoff": POSITIVE | MAY_BE_INFINITE,
            },
        ),
        "hold": (hold, {"q": q, "omega": 5.0}, {"q": {0.5}, **omega}),
        "damp": (damp, {"n": 7, "rate": 5.0}, {"n": {0, 0.5}, "rate": POSITIVE}),
        "along": (
            along,
            {"times": np.arange(3.0), "postures": np.zeros((3, 7)), "omega": 5.0},
            {"times": {0.5}, "postures": {0.5}, **omega},
        ),
    }


DOORS = (
    "JointAdaptive", "CartesianAdaptive", "HybridAdaptive", "ComputedTorque", "OperationalSpaceControl", "SlotineLi",
    "parameter_rates", "gains_from_inertia", "gains_from_mass", "model_from_mass", "hybrid_gains", "reference_model",
    "adaptation_rates", "Practice", "hold", "damp", "along",
)  # fmt: skip


def bad_for(good, other):
    """What no argument like ``good`` may be: of its shape, with a last entry that is no finite real number, and more."""
    x = np.array(good, dtype=float)
    for last in [np.nan] + [np.inf, -np.inf] * ("inf" not in other) + [1j]:
        y = x.astype(complex if last == 1j else float)
        y.flat[-1] = last
        yield y if y.ndim else y.item()
    yield np.ma.masked_array(x, np.ones(x.shape, dtype=bool))
    yield "much"
    yield object()
    yield np.ones((2, 3, 5))
    yield from (value for value in other if value != "inf")


@pytest.mark.parametrize("name", DOORS)
def test_bad_numbers_are_refused_by_name(reference, name):
    make, good, numeric = doors(reference)[name]
    make(**good)
    for argument, other in numeric.items():
        for bad in bad_for(good[argument], set(other)):
            with pytest.raises(ValueError, match=argument):
                make(**good | {argument: bad})


@pytest.mark.parametrize("name", ["JointAdaptive", "CartesianAdaptive", "HybridAdaptive", "adaptation_rates"])
def test_bad_gains_and_models_are_refused_by_name(reference, name):
    make, good, _ = doors(reference)[name]
    K_p, K_d = good["gains"]
    for bad in ((K_p,), K_p, None, Gains(K_p[1:], K_d), *(Gains(K_p, bad) for bad in bad_for(K_d, set()))):
        with pytest.raises(ValueError, match="gains"):
            make(**good | {"gains": bad})
    for bad in (None, np.eye(6)):
        with pytest.raises(ValueError, match="model: expected "):
            make(**good | {"model": bad})
    if name == "adaptation_rates":
        with pytest.raises(ValueError, match="gains: expected a positive definite K_d"):
            make(**good | {"gains": Gains(K_p, 0 * K_d)})


@pytest.mark.parametrize("name", DOORS[:3])
def test_practice(reference, name):
    make, good, _ = doors(reference)[name]
    for bad in (None, 0.1, {}):
        with pytest.raises(ValueError, match="practice: expected a Practice, got"):
            make(**good | {"practice": bad})
    for bad in (Practice(torque_limit=np.ones(3)), Practice(dead_zone=np.ones(2))):
        with pytest.raises(ValueError, match=r"torque_limit|dead_zone"):
            make(**good | {"practice": bad})


def test_gravity_pd_s_gains(reference):
    for bad in (None, SIX, *(Gains(bad, np.eye(7)) for bad in bad_for(np.eye(7), set()))):
        with pytest.raises(ValueError, match="gains"):
            GravityPD(reference, lambda t: None, bad)


def still_posture(t):
    return np.zeros(7), np.zeros(7)


@pytest.mark.parametrize("name", ["CartesianAdaptive", "HybridAdaptive", "OperationalSpaceControl"])
def test_postures(reference, name):
    make, good, _ = doors(reference)[name]
    bad_numbers = list(bad_for(1.0, NOT_NEGATIVE))
    postures = [Posture(still_posture, bad) for bad in bad_numbers] + [
        Posture(still_posture, 1.0, bad) for bad in bad_numbers
    ]
    shapes = [hold(np.zeros(6), 1.0), Posture(lambda t: np.zeros(7), 1.0), Posture(lambda t: (np.zeros(7), None), 1.0)]
    for bad in (0.5, np.zeros(7), Posture(None, 1.0), *postures, *shapes):
        with pytest.raises(ValueError, match="posture"):
            make(**good | {"posture": bad})


def test_modes():
    for bad in bad_for(np.zeros(6), {0.5}):
        with pytest.raises(ValueError, match="modes"):
            checked_modes(Mode(bad))
        with pytest.raises(ValueError, match="modes"):
            checked_modes(Mode(np.ones(6), bad))
    for bad in bad_for(0.0, {1.0}):
        with pytest.raises(ValueError, match="modes"):
            checked_modes(Mode(np.ones(6), time=bad))


@pytest.mark.parametrize(
    "name", ["JointAdaptive", "CartesianAdaptive", "HybridAdaptive", "OperationalSpaceControl", "ComputedTorque"]
)
def test_starts(reference, name):
    """Of q, v and duration, and of what is no path."""
    make, good, _ = doors(reference)[name]
    law, q, v = make(**good), ready_postures(reference)[0], np.zeros(7)
    for argument, arguments in (("q", (..., v, 1.0)), ("v", (q, ..., 1.0)), ("duration", (q, v, ...))):
        for bad in bad_for(1.0 if argument == "duration" else q, set()):
            with pytest.raises(ValueError, match=argument):
                law.start(*(bad if x is ... else x for x in arguments))
    with pytest.raises(ValueError, match="path: expected a function of time"):
        make(**good | {"path": 3}).start(q, v, 1.0)


def test_every_number_of_a_law_has_its_door(reference):
    """So that a new one is not forgotten here."""
    other = {"arm", "path", "modes", "sensor", "gains", "force_gains", "model", "force_model", "posture", "practice",
             "force_practice", "damping", "task"}  # fmt: skip
    for name in DOORS[:6]:
        make, _, numeric = doors(reference)[name]
        assert {field.name for field in fields(make)} - other == set(numeric)
