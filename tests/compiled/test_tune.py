"""Tuned gains, held against `simulate` and, one method against the other, against themselves."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import k1607_pin as k1607
from k1607_pin.compiled.factors import Factors
from k1607_pin.compiled.tune import _by_search
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.hybrid import HybridAdaptive, Mode, hybrid_gains
from k1607_pin.control.joint_space import JointAdaptive, gains_from_mass, model_from_mass
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.inverse_path import joint_path
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.wall import Wall

GAINS = ("controller.gains.K_p", "controller.gains.K_d")
DURATION = 0.3
PICK_UP = [(0.1, k1607.Payload(4.5))]
GRAVITY = Practice(gravity=True)


def cartesian_case(arm, law, q0):
    return replace(law, practice=GRAVITY), {"payloads": PICK_UP}, "error"


def joint_case(arm, law, q0):
    joints = joint_path(arm, law.path, q0, DURATION, law.rotation)
    gains, model = gains_from_mass(arm, q0, 8.0), model_from_mass(arm, q0, 8.0)
    return JointAdaptive(arm, joints, gains, model, 1e4, 1e4, 0.01, GRAVITY), {"payloads": PICK_UP}, "joint_error"


def hybrid_case(arm, law, q0):
    start = arm.forward_kinematics(q0)
    wall = Wall(start.translation, (-1.0, 0, 0), 1e4, damping=5.0)
    stiffest = np.array([1e4] * 3 + [1e3] * 3)
    gains, force_gains = hybrid_gains(arm, q0, stiffest, omega=20, force_omega=200, force_damping=0.7)
    model = reference_model(2 * np.ones(6), 3 * np.ones(6))
    controller = HybridAdaptive(
        arm, Line(start.translation, np.array([0.0, 0.1, 0.05])), start.rotation,
        (Mode((1, 0, 0, 0, 0, 0), (20.0, 0, 0, 0, 0, 0)),), wall.sensor(arm), stiffest, gains, force_gains, model, model,
        1e3, 1e3, 1e-6, 1e-10, period=0.002, practice=GRAVITY,
    )  # fmt: skip
    return controller, {"external": wall.external(arm), "payloads": PICK_UP}, "error"


CASES = {"Cartesian": cartesian_case, "joint-space": joint_case, "hybrid": hybrid_case}


@pytest.mark.parametrize("scheme", CASES)
@pytest.mark.parametrize("method", ["gradient", "search"])
def test_bounds_that_the_start_misses_are_met(arm, law, q0, scheme, method):
    controller, settings, error = CASES[scheme](arm, law, q0)
    period = controller.period
    before = k1607.simulate(arm, controller, q0, DURATION, control_period=period, **settings)
    largest = np.abs(before[error].values).max(axis=0)
    bound = np.where(
        largest > 0.2 * largest.max(), 0.7 * largest, np.inf
    )  # of an error in newtons or along a wall, say, none
    torque = 1.3 * np.abs(before.tau.values).max()
    free = dict.fromkeys(GAINS, "scale")
    found = k1607.tune(arm, controller, q0, DURATION, free, bound, torque, method, error, **settings)
    assert found.met
    assert found.worst <= 1
    for name in GAINS:
        start = getattr(controller.gains, name[-3:])
        np.testing.assert_allclose(found.values[name], found.factors[name] * start)
        np.testing.assert_array_equal(getattr(found.controller.gains, name[-3:]), found.values[name])
    after = k1607.simulate(arm, found.controller, q0, DURATION, control_period=period, **settings)
    assert (np.abs(after[error].values).max(axis=0) <= bound).all()
    assert np.abs(after.tau.values).max() <= torque
    np.testing.assert_array_equal(found.error, np.abs(after[error].values).max(axis=0))


def test_the_two_methods_find_the_same(arm, law, q0):
    """A load picked up makes a smooth compromise: stiff gains ask for torque, soft ones leave an error."""
    found = [
        k1607.tune(arm, replace(law, practice=GRAVITY), q0, DURATION, dict.fromkeys(GAINS, "scale"), 2e-3, 300.0, method,
                   payloads=PICK_UP, budget=budget)
        for method, budget in (("gradient", 60), ("search", 1000))
    ]  # fmt: skip
    assert found[0].worst == pytest.approx(found[1].worst, rel=2e-3)


def test_axes_leave_gains_positive_definite_and_fixed_axes_alone(arm, law, q0):
    low, high = np.array([0.2, 0.2, 0.2, 1, 1, 1]), np.array([5.0, 5, 5, 1, 1, 1])
    found = k1607.tune(
        arm, replace(law, practice=GRAVITY), q0, DURATION, {GAINS[0]: (low, high), "controller.beta_1": "scale"}, 1e-3, 500.0,
        "search", budget=200, payloads=PICK_UP,
    )  # fmt: skip
    d = np.sqrt(found.factors[GAINS[0]])
    K = found.controller.gains.K_p
    np.testing.assert_allclose(K, d[:, None] * law.gains.K_p * d)
    np.testing.assert_allclose(K[3:, 3:], law.gains.K_p[3:, 3:])
    assert not np.allclose(K[:3, :3], law.gains.K_p[:3, :3])
    assert np.linalg.eigvalsh(K)[0] > 0
    assert isinstance(found.controller.beta_1, float)


@pytest.mark.parametrize("method", ["gradient", "search"])
def test_bounds_that_cannot_be_met_are_told(arm, law, q0, method):
    found = k1607.tune(arm, law, q0, 0.1, {GAINS[0]: (0.5, 2.0)}, torque_bound=1e-3, method=method, budget=64)
    assert not found.met
    assert found.worst == pytest.approx(found.torque.max() / 1e-3)
    assert np.isfinite(found.worst)


def test_a_search_begins_where_its_seed_says_and_a_gradient_ends_with_its_budget(arm, law, q0):
    law = replace(law, practice=GRAVITY)
    free, settings = dict.fromkeys(GAINS, (2.0, 5.0)), {"payloads": PICK_UP, "error_bound": 1e-4}
    one, other = (k1607.tune(arm, law, q0, 0.1, free, method="search", budget=64, seed=k, **settings) for k in (1, 2))
    assert one.factors != other.factors
    few, more = (k1607.tune(arm, law, q0, 0.1, free, budget=k, **settings) for k in (1, 60))
    assert few.rollouts < more.rollouts
    for found in (one, few, more):
        assert all(2 <= factor <= 5 for factor in found.factors.values())
    assert more.worst <= few.worst


def test_what_is_lost_later_counts_less():
    class Lost:
        duration = 1.0

        def __call__(self, q0, v0, vary):
            x = vary["controller.gains.K_p"][:, 0, 0]
            lost = np.where(x < 1, 0.5 * (1 + x / x.max()), 0.1)  # the smaller the gain, the sooner
            return xr.Dataset({"error_max": ("rollout", 0 * x), "failed_at": ("rollout", lost)})

    class Factors:
        lower, upper = np.array([-1.0]), np.array([0.5])

        def values(self, z):
            return {"controller.gains.K_p": np.exp(z)[:, :, None]}

    z, _ = _by_search(Lost(), Factors(), {"error": np.ones(1)}, None, None, 400, 0)
    assert -0.2 < z[0] < 0


def test_from_gains_that_run_away_a_search_finds_others_and_the_gradient_refuses(arm, law, q0):
    wild = replace(law, gains=Gains(1e3 * law.gains.K_p, 1e3 * law.gains.K_d), practice=GRAVITY)
    free = dict.fromkeys(GAINS, (1e-4, 1.0))
    found = k1607.tune(arm, wild, q0, DURATION, free, 0.05, method="search", budget=500)
    assert found.met
    with pytest.raises(ValueError, match="controller: expected one whose rollout does not run away"):
        k1607.tune(arm, wild, q0, DURATION, free, 0.05)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"method": "guess"}, "method: expected one of gradient, search, got 'guess'"),
        ({"budget": 0}, "budget: expected a whole number"),
        ({"external": object()}, "external: expected a function"),
        ({"free": {}}, "free: expected at least one name"),
        ({"free": {"controller.gains.K": "scale"}}, "free: expected some of controller.*got 'controller.gains.K'"),
        ({"free": {"controller.practice.sigma": "scale"}}, "sigma = 0"),
        ({"free": {GAINS[0]: "row"}}, "expected 'scale', 'axes'"),
        ({"free": {GAINS[0]: (2.0, 1.0)}}, "expected 'scale', 'axes'"),
        ({"free": {GAINS[0]: (np.ones(5), np.ones(5))}}, "expected 'scale', 'axes'"),
        ({"error_bound": None}, "error_bound, torque_bound: expected at least one bound"),
        ({"error_bound": -1.0}, "error_bound: expected one positive number"),
        ({"torque_bound": np.ones(6)}, r"torque_bound: expected one positive number or \(7,\)"),
        ({"error_bound": np.inf}, "expected at least one bound"),
        ({"error": "misfit"}, "got 'misfit'"),
        ({"error": "tau"}, "error: expected what the controller logs"),
        ({"every": 2}, "settings: expected some of control_period.*got every"),
        ({"metrics": {}, "threads": 1}, "got metrics, threads"),
        ({"free": {"controller.rotation": "scale"}}, "rotation: expected"),
    ],
)
def test_what_does_not_fit_is_refused(arm, law, q0, changed, words):
    given = {"free": {GAINS[0]: "scale"}, "error_bound": 1e-3} | changed
    with pytest.raises(ValueError, match=words):
        k1607.tune(arm, law, q0, 0.1, **given)


def test_factors_are_the_numbers_that_symbols_stand_for(law):
    """Row by row, as the traced loop takes them."""
    factors = Factors(law, {GAINS[1]: "axes", "controller.beta_2": (0.5, 2.0)})
    z = np.random.default_rng(1).normal(size=(3, 7))
    values = factors.values(z)
    for k in range(3):
        np.testing.assert_allclose(
            np.append(values[GAINS[1]][k].ravel(), values["controller.beta_2"][k]), factors.flat(z[k])
        )
    d = np.exp(z[0, :6] / 2)
    np.testing.assert_allclose(values[GAINS[1]][0], d[:, None] * law.gains.K_d * d)
