"""Our Newton-Euler, mass and Coriolis matrix against Pinocchio: serial arms, trees with sliding joints, floats and traced."""

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from k1607_pin.compiled.trace import trace
from k1607_pin.dynamics.base_parameters import base_parameters
from k1607_pin.dynamics.rigid_body import (
    coriolis_matrix,
    forward_dynamics,
    inverse_dynamics,
    mass_matrix,
    point_jacobian,
    point_jacobian_rate,
    point_pose,
)


def states(robot, count=10):
    return np.random.default_rng(4).normal(size=(count, 3, robot.model.nv))


def close(ours, theirs):
    """To 1e-12 of the largest entry: a few hundred roundings."""
    assert np.abs(np.asarray(ours) - theirs).max() < 1e-12 * max(1.0, np.abs(theirs).max())


def ours(robot):
    """Functions of q, v and a, and how many of them they take."""
    constants, g, (last, offset, rotation) = robot.bodies, robot.gravity, robot.tool
    return [
        (lambda q, v, a: inverse_dynamics(constants, q, v, a, g), 3),
        (lambda q: mass_matrix(constants, q), 1),
        (lambda q, v: coriolis_matrix(constants, q, v), 2),
        (lambda q: point_jacobian(constants, q, last, offset), 1),
        (lambda q, v: point_jacobian_rate(constants, q, v, last, offset), 2),
        (lambda q: point_pose(constants, q, last, offset, rotation), 1),
    ]


def by_pinocchio(robot, q, v, a):
    model, frame = robot
    data = model.createData()
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    J_dot = pin.getFrameJacobianTimeVariation(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
    T = pin.updateFramePlacement(model, data, frame)
    return [
        pin.rnea(model, data, q, v, a).copy(),
        pin.crba(model, data, q).copy(),
        pin.computeCoriolisMatrix(model, data, q, v).copy(),
        pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED),
        J_dot,
        # not pin.log3, which loses five digits a hundredth of a radian from a half turn
        np.concatenate([T.translation, Rotation.from_matrix(T.rotation).as_rotvec()]),
    ]


def test_against_pinocchio(robot):
    for state in states(robot):
        for (fun, arguments), theirs in zip(ours(robot), by_pinocchio(robot, *state), strict=True):
            close(fun(*state[:arguments]), theirs)


def test_traced_against_pinocchio(robot):
    n = robot.model.nv
    traced = [(trace(fun, "f", [(n,)] * arguments), arguments) for fun, arguments in ours(robot)]
    for state in states(robot, 5):
        for (fun, arguments), theirs in zip(traced, by_pinocchio(robot, *state), strict=True):
            close(np.array(fun(*state[:arguments])).reshape(theirs.shape), theirs)


def test_every_body_may_carry_the_point(robot):
    """Joints that do not carry it have no part in it."""
    model, offset, (q, v, _) = robot.model, np.array([0.1, -0.2, 0.3]), states(robot, 1)[0]
    for last in range(model.nv):
        with_frame = pin.Model(model)
        frame = with_frame.addFrame(pin.Frame("point", last + 1, 0, pin.SE3(np.eye(3), offset), pin.OP_FRAME))
        *_, J, J_dot, _ = by_pinocchio((with_frame, frame), q, v, v)
        close(point_jacobian(robot.bodies, q, last, offset), J)
        close(point_jacobian_rate(robot.bodies, q, v, last, offset), J_dot)


def test_mass_matrix_rate_minus_twice_coriolis_is_skew(robot):
    constants, h = robot.bodies, 1e-6
    for q, v, _ in states(robot, 5):
        rate = (mass_matrix(constants, q + h * v) - mass_matrix(constants, q - h * v)) / (2 * h)
        S = rate - 2 * coriolis_matrix(constants, q, v)
        assert np.abs(S + S.T).max() < 1e-7 * max(1.0, np.abs(S).max())  # rounding over the step of the difference


def test_forward_dynamics_against_pinocchio(robot):
    for q, v, tau in states(robot):
        theirs = pin.aba(robot.model, robot.model.createData(), q, v, tau)
        ours = forward_dynamics(robot.bodies, q, v, tau, robot.gravity)
        # the mass matrix is solved: its condition multiplies the rounding
        condition = np.linalg.cond(mass_matrix(robot.bodies, q))
        assert np.abs(ours - theirs).max() < 1e-15 * max(condition, 1e3) * max(1.0, np.abs(theirs).max())


def test_base_parameters_are_as_good_and_fewer(robot):
    """Joint forces and mass matrix stay, to rounding; and every revolute body loses three numbers, every sliding one six."""
    less, g = base_parameters(robot.bodies), robot.gravity
    for q, v, a in states(robot):
        close(inverse_dynamics(less, q, v, a, g), inverse_dynamics(robot.bodies, q, v, a, g))
        close(mass_matrix(less, q), mass_matrix(robot.bodies, q))
    for body in less:
        if body.revolute:
            assert body.mass == 0
            assert abs(body.axis @ body.moment) < 1e-14
            assert abs(body.axis @ body.second @ body.axis) < 1e-14
        else:
            np.testing.assert_allclose(body.second, 0, atol=1e-13)


def test_base_parameters_take_symbols(robot):
    """The regrouping itself is traced: parameters that differ from one simulated arm to the next are inputs."""
    numbers, (q, v, a) = robot.bodies, states(robot, 1)[0]

    def torques(mass, moment, second):
        last = numbers[-1]._replace(mass=mass[0], moment=moment, second=second)
        return inverse_dynamics(base_parameters([*numbers[:-1], last]), q, v, a, robot.gravity)

    last = numbers[-1]
    found = trace(torques, "torques", [(1,), (3,), (3, 3)])(last.mass, last.moment, last.second.ravel())
    close(found.full().ravel(), pin.rnea(robot.model, robot.model.createData(), q, v, a))
