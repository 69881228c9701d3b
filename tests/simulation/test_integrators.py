"""Integrators of the order they claim, on arms; and step for step as another engine takes them."""

import mujoco
import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.arm.load import k1607_urdf
from k1607_pin.simulation.integrators import runge_kutta_4, semi_implicit_euler
from k1607_pin.simulation.plant import Plant


def swing(plant, step, dt, duration=0.4):
    """Let the arm fall from rest near the middle of its range, unpowered."""
    arm = plant.arm
    q = 0.5 * (np.maximum(arm.lower, -1) + np.minimum(arm.upper, 1)) + 0.3
    v, zero = np.zeros(arm.n), np.zeros(arm.n)
    for _ in range(round(duration / dt)):
        q, v = step(lambda q, v: plant.acceleration(q, v, zero), q, v, dt)
    return q, v


@pytest.mark.parametrize(("step", "order", "dt"), [(semi_implicit_euler, 1, 4e-3), (runge_kutta_4, 4, 2e-2)])
def test_error_falls_by_the_order_when_the_step_halves(step, order, dt):
    plant = Plant(k1607.load_k1607())
    exact = np.concatenate(swing(plant, runge_kutta_4, 1e-3))
    errors = [np.linalg.norm(np.concatenate(swing(plant, step, dt / k)) - exact) for k in (1, 2, 4)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(np.full(2, order), abs=0.25)  # the next term of the expansion still shows


def test_energy_is_conserved_without_friction_and_torque(arm):
    plant = Plant(arm)
    start = 0.5 * (np.maximum(arm.lower, -1) + np.minimum(arm.upper, 1)) + 0.3
    before = plant.energy(start, np.zeros(arm.n))
    drift = [abs(plant.energy(*swing(plant, runge_kutta_4, dt)) - before) for dt in (4e-3, 2e-3)]
    assert drift[1] < 1e-4 * abs(before)
    assert drift[1] < drift[0] / 10  # fourth order: by 16 and more


def test_power_of_friction_is_what_energy_loses(arm):
    viscous = np.linspace(0.1, 1, arm.n)
    plant = Plant(arm, viscous=viscous, coulomb=0.1 * viscous)
    rng, h = np.random.default_rng(0), 1e-6
    q, v = arm.random_configuration(rng), rng.normal(size=arm.n)
    a = plant.acceleration(q, v, np.zeros(arm.n))
    change = (plant.energy(q + h * v, v + h * a) - plant.energy(q - h * v, v - h * a)) / (2 * h)
    lost = v @ plant.loss_torque(q, v)
    assert lost > 0
    assert change == pytest.approx(-lost, rel=1e-6, abs=1e-6)  # rounding of the energy, some 100 J, over the step


def test_motors_give_no_more_than_they_can():
    plant = Plant(k1607.load_k1607(), torque_limit=np.array([10.0] * 6 + [np.inf]))
    assert plant.motor_torque(np.full(7, 50.0)).tolist() == [10.0] * 6 + [50.0]
    assert plant.motor_torque(np.full(7, -50.0)).tolist() == [-10.0] * 6 + [-50.0]


@pytest.mark.parametrize("name", ["viscous", "coulomb", "torque_limit"])
@pytest.mark.parametrize("value", [np.full(7, -1.0), np.zeros(6), np.full(7, np.nan)])
def test_bad_plants_are_refused(name, value):
    with pytest.raises(ValueError, match=f"{name}: expected"):
        Plant(k1607.load_k1607(), **{name: value})


def test_one_second_as_mujoco_computes_it():
    """The same URDF, rotors, torques and semi-implicit Euler in an independent engine: joint angles to 1e-6 rad after 1 s."""
    arm = k1607.load_k1607()
    model = mujoco.MjModel.from_xml_path(str(k1607_urdf()))
    model.opt.timestep, model.opt.integrator = 1e-3, mujoco.mjtIntegrator.mjINT_EULER
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.dof_armature[:] = arm.armature
    data = mujoco.MjData(model)
    q, v = np.deg2rad([20.0, -30, 10, 80, 0, 60, 0]), np.zeros(7)
    data.qpos[:] = q
    plant = Plant(arm)
    for k in range(1000):
        tau = arm.effort_limit * 0.05 * np.sin(2 * np.pi * k * 1e-3 + np.arange(7))
        data.qfrc_applied[:] = tau
        mujoco.mj_step(model, data)
        q, v = semi_implicit_euler(lambda q, v, tau=tau: plant.acceleration(q, v, tau), q, v, 1e-3)
    assert np.abs(v).max() > 0.5  # it has moved
    assert np.abs(q - data.qpos).max() < 1e-6
