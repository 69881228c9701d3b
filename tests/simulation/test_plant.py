"""Joint stops: outside the range they push back, keep what is elastic, and never pull."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.simulate import simulate


class Limp:
    """No torque at all."""

    def start(self, q, v, duration):
        return None

    def update(self, t, q, v, state):
        return np.zeros_like(q), None, {}


def near_upper(arm):
    """A posture in which joint 1, turning without gravity, is soon at its upper limit; and the velocity."""
    q, v = np.clip(np.full(arm.n, 0.3), arm.lower, arm.upper), np.zeros(arm.n)
    q[0], v[0] = arm.upper[0] - 0.05, 0.5
    return q, v


@pytest.fixture(scope="module")
def weightless():
    return k1607.load_k1607(gravity=(0, 0, 0))


def test_elastic_stop_gives_back_what_it_took(weightless):
    plant = Plant(weightless, stop_stiffness=np.full(7, 2000.0))
    q0, v0 = near_upper(weightless)
    log = simulate(plant, Limp(), q0, 0.6, v0, physics_step=0.0005, step=runge_kutta_4)
    assert log.q.values[:, 0].max() > weightless.upper[0]
    assert log.q.values[-1, 0] < weightless.upper[0]
    assert log.v.values[-1, 0] < -0.05
    # the force's kink at contact spoils the order: what is left is a step's work of it
    assert abs(float(log.energy_residual[-1])) < 1e-4 * float(log.energy[0])
    assert float(log.dissipated[-1]) == 0


def test_damped_stop_turns_energy_to_heat_and_the_account_closes(weightless):
    plant = Plant(weightless, stop_stiffness=np.full(7, 2000.0), stop_damping=np.full(7, 100.0))
    q0, v0 = near_upper(weightless)
    log = simulate(plant, Limp(), q0, 0.6, v0, physics_step=0.0005, step=runge_kutta_4)
    start = float(log.energy[0])
    assert float(log.dissipated[-1]) > 0.3 * start
    assert float(log.energy[-1]) < 0.7 * start
    assert abs(float(log.energy_residual[-1])) < 2e-3 * start


def test_a_stop_pushes_inwards_and_never_pulls(weightless):
    plant = Plant(weightless, stop_stiffness=np.full(7, 1e3), stop_damping=np.full(7, 1e3))
    rng = np.random.default_rng(3)
    for _ in range(200):
        q = rng.uniform(1.2 * weightless.lower, 1.2 * weightless.upper)
        v = rng.normal(size=7)
        torque = plant.spring_torque(q) - plant.loss_torque(q, v)
        assert (torque[q > weightless.upper] <= 0).all()
        assert (torque[q < weightless.lower] >= 0).all()
        assert (torque[(q >= weightless.lower) & (q <= weightless.upper)] == 0).all()


def test_joints_without_limits_have_no_stops():
    arm = k1607.load_example("ur5")
    model = arm.model
    model.lowerPositionLimit, model.upperPositionLimit = np.full(6, -np.inf), np.full(6, np.inf)
    free = Plant(k1607.Arm(model, arm.tool_frame), stop_stiffness=np.ones(6), stop_damping=np.ones(6))
    assert (free.spring_torque(np.full(6, 50.0)) == 0).all()
    assert (free.loss_torque(np.full(6, 50.0), np.ones(6)) == 0).all()


@pytest.mark.parametrize("name", ["viscous", "coulomb", "torque_limit", "stop_stiffness", "stop_damping"])
@pytest.mark.parametrize("value", [np.ones(6), -np.ones(7), np.full(7, np.nan)])
def test_bad_plants_are_refused(weightless, name, value):
    with pytest.raises(ValueError, match=name):
        Plant(weightless, **{name: value})
