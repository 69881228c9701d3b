"""The operational space of bodies, as floats and traced, against Pinocchio and against `Arm`."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import k1607_pin as k1607
from k1607_pin.arm.bodies import bodies
from k1607_pin.compiled.trace import trace
from k1607_pin.dynamics.operational_space import operational_space_of_bodies

NAMES = ("Lambda", "Phi", "Gamma", "jacobian", "jacobian_bar", "bias_nullspace", "gravity", "nullspace_projector")


def of(robot, q, v, damping=0.0):
    return operational_space_of_bodies(robot.bodies, q, v, *robot.tool, robot.gravity, damping)


def states(robot, count):
    """Away from singularities by 0.1, where the mobility's condition is some 1e3: that leaves 1e-13."""
    rng, data = np.random.default_rng(7), robot.model.createData()
    while count:
        q, v = rng.uniform(-2, 2, (2, robot.model.nv))
        J = pin.computeFrameJacobian(robot.model, data, q, robot.frame, pin.LOCAL_WORLD_ALIGNED)
        if np.linalg.svd(J, compute_uv=False)[5] > 0.1:
            count -= 1
            yield q, v


def by_inverses(robot, q, v):
    """Term by term as the definitions have it, from Pinocchio's matrices: what is expected, and the scale of each."""
    model, frame = robot.model, robot.frame
    data = model.createData()
    M = pin.crba(model, data, q).copy()
    C = pin.computeCoriolisMatrix(model, data, q, v).copy()
    g = pin.computeGeneralizedGravity(model, data, q)
    J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    J_dot = pin.getFrameJacobianTimeVariation(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
    T = pin.updateFramePlacement(model, data, frame)
    x = np.concatenate([T.translation, Rotation.from_matrix(T.rotation).as_rotvec()])
    Lambda = np.linalg.inv(J @ np.linalg.inv(M) @ J.T)
    J_bar = np.linalg.inv(M) @ J.T @ Lambda
    N = np.eye(model.nv) - J_bar @ J
    forces = J_bar.T @ C - Lambda @ J_dot
    p = J_bar.T @ g
    expected = (Lambda, forces @ J_bar, np.outer(p, x) / (x @ x), J, J_bar, forces @ N @ v, p, N)
    scales = [np.abs(e).max() for e in expected]
    scales[5] = (
        np.abs(forces).max() * np.abs(v).max()
    )  # what the null space's part is a difference of; nothing for n = 6
    scales[7] = 1.0
    return expected, scales


def check(found, expected, scales):
    for name, ours, theirs, scale in zip(NAMES, found, expected, scales, strict=True):
        assert np.abs(np.asarray(ours).reshape(theirs.shape) - theirs).max() < 1e-12 * scale, name


def test_floats_against_pinocchio(robot):
    for q, v in states(robot, 10):
        space = of(robot, q, v)
        check([getattr(space, name) for name in NAMES], *by_inverses(robot, q, v))


def test_traced_against_pinocchio(robot):
    def everything(q, v):
        space = of(robot, q, v)
        return tuple(getattr(space, name) for name in NAMES)

    traced = trace(everything, "operational_space", [(robot.model.nv,)] * 2)
    for q, v in states(robot, 10):
        check(traced(q, v), *by_inverses(robot, q, v))


@pytest.mark.parametrize("damping", [0.0, 0.03])
def test_arm_computes_the_same(arm, damping):
    """And damps the same: it does so where it is asked to, below the threshold."""
    frame = arm.model.frames[arm.model.getFrameId(arm.tool_frame)]
    place = frame.parentJoint - 1, frame.placement.translation, frame.placement.rotation
    constants, gravity, rng = bodies(arm.model), arm.model.gravity.linear, np.random.default_rng(3)

    def damped(q, v):
        return operational_space_of_bodies(constants, q, v, *place, gravity, damping).Lambda

    traced = trace(damped, "Lambda", [(arm.n,)] * 2)
    for _ in range(10):
        q, v = arm.random_configuration(rng), rng.normal(size=arm.n)
        law = k1607.differential.Damping(threshold=1e9, maximum=damping) if damping else None
        space = arm.operational_space(q, v, law)
        assert space.damping == pytest.approx(damping, rel=1e-12)
        # postures as they come, near singularities too: the error of a solution grows with the condition
        slack = 1e-15 * np.linalg.cond(space.Lambda) * np.abs(space.Lambda).max()
        assert np.abs(damped(q, v) - space.Lambda).max() < 1e-12 * np.abs(space.Lambda).max() + slack
        assert np.abs(np.array(traced(q, v)) - space.Lambda).max() < 1e-12 * np.abs(space.Lambda).max() + slack
