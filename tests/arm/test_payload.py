"""Payloads: nothing for nothing, the right inertia, momentum kept."""

import numpy as np
import pinocchio as pin
import pytest

from k1607_pin.arm.payload import Payload, velocity_after_gripping, with_payload

BOX = Payload(4.5, np.array([0.02, -0.01, 0.1]), np.diag([0.03, 0.04, 0.05]))


def states(arm, count=10):
    rng = np.random.default_rng(10)
    return [(arm.random_configuration(rng), rng.normal(size=arm.n)) for _ in range(count)]


def test_no_payload_is_the_arm_itself(arm):
    assert with_payload(arm, Payload(0.0)) is arm


def test_picking_up_and_laying_down_leaves_the_arm_bit_for_bit(arm):
    before = [arm.mass_matrix(q) for q, _ in states(arm)]
    loaded = with_payload(arm, BOX)
    assert all((loaded.mass_matrix(q) != M).any() for (q, _), M in zip(states(arm), before, strict=True))
    assert all(np.array_equal(arm.mass_matrix(q), M) for (q, _), M in zip(states(arm), before, strict=True))


def test_a_point_mass_adds_its_own_kinetic_energy_and_weight(arm):
    mass = 4.5
    loaded = with_payload(arm, Payload(mass))
    for q, _ in states(arm):
        J = arm.jacobian(q)[:3]
        expected = arm.mass_matrix(q) + mass * J.T @ J
        assert np.abs(loaded.mass_matrix(q) - expected).max() < 1e-12 * np.abs(expected).max()
        weight = arm.gravity_torque(q) + J.T @ np.array([0, 0, 9.81 * mass])
        assert np.abs(loaded.gravity_torque(q) - weight).max() < 1e-12 * (1 + np.abs(weight).max())


def test_a_body_with_extent_against_its_own_equations(arm):
    """Wrench that the payload needs, by Newton and Euler about its centre of gravity, against the difference of torques."""
    loaded, h = with_payload(arm, BOX), 1e-5
    a = np.linspace(-1, 1, arm.n)
    for q, v in states(arm, 5):
        T, J = arm.forward_kinematics(q), arm.jacobian(q)
        r = T.rotation @ BOX.cg
        x_dot = J @ v
        x_ddot = J @ a + (arm.jacobian(q + h * v) - arm.jacobian(q - h * v)) / (2 * h) @ v
        omega, alpha = x_dot[3:], x_ddot[3:]
        acceleration = x_ddot[:3] + np.cross(alpha, r) + np.cross(omega, np.cross(omega, r))
        force = BOX.mass * (acceleration + np.array([0, 0, 9.81]))
        I = T.rotation @ BOX.inertia @ T.rotation.T
        moment = I @ alpha + np.cross(omega, I @ omega) + np.cross(r, force)
        expected = arm.inverse_dynamics(q, v, a) + J.T @ np.concatenate([force, moment])
        # the difference quotient of J is good to about 1e-9
        assert np.abs(loaded.inverse_dynamics(q, v, a) - expected).max() < 1e-7 * (1 + np.abs(expected).max())


def test_gripping_a_resting_payload_keeps_momentum_and_loses_energy(arm):
    loaded = with_payload(arm, BOX)
    for q, v in states(arm):
        M, M_loaded = arm.mass_matrix(q), loaded.mass_matrix(q)
        after = velocity_after_gripping(arm, loaded, BOX, q, v)
        assert np.abs(M_loaded @ after - M @ v).max() < 1e-11 * np.abs(M @ v).max()
        assert after @ M_loaded @ after < v @ M @ v
        # Carnot: the energy lost is that of the lost velocity, on both sides
        lost = (v - after) @ M @ (v - after) + after @ (M_loaded - M) @ after
        assert v @ M @ v - after @ M_loaded @ after == pytest.approx(lost, rel=1e-9)


def test_pinocchio_agrees_where_the_tool_is_turned_and_offset():
    import k1607_pin as k1607

    arm = k1607.load_example("panda")  # its tool frame is offset and turned against joint 7
    model = arm.model
    tool = model.frames[model.getFrameId("panda_hand_tcp")]
    model.appendBodyToJoint(tool.parentJoint, pin.Inertia(BOX.mass, BOX.cg, BOX.inertia), tool.placement)
    q, v = states(arm)[0]
    expected = pin.nonLinearEffects(model, model.createData(), q, v).copy()
    assert np.abs(with_payload(arm, BOX).bias_torque(q, v) - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((-1.0,), "mass"),
        ((np.nan,), "mass"),
        ((1.0, np.zeros(2)), "cg"),
        ((1.0, np.zeros(3), np.diag([1.0, 1, 5])), "principal moments"),
        ((1.0, np.zeros(3), -np.eye(3)), "principal moments"),
        ((1.0, np.zeros(3), np.array([[1.0, 0.1, 0], [0, 1, 0], [0, 0, 1]])), "symmetric"),
        ((0.0, np.zeros(3), np.eye(3)), "without mass"),
    ],
)
def test_impossible_payloads_are_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        Payload(*arguments)
