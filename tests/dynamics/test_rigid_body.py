"""Our Newton-Euler, mass and Coriolis matrix against Pinocchio: serial arms, a tree with sliding joints, floats and traced."""

import numpy as np
import pinocchio as pin
import pytest

import k1607_pin as k1607
from k1607_pin.arm.bodies import bodies
from k1607_pin.compiled.trace import trace
from k1607_pin.dynamics.rigid_body import coriolis_matrix, inverse_dynamics, mass_matrix, point_jacobian


def random_tree(seed: int, n: int = 9) -> pin.Model:
    """A tree of revolute and prismatic joints, depth first, as Pinocchio's algorithms need it."""
    pin.seed(seed)
    rng = np.random.default_rng(seed)
    kinds = [pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ, pin.JointModelPX, pin.JointModelPZ]
    model, parent = pin.Model(), 0
    while model.nv < n:
        axis = rng.normal(size=3)
        unaligned = [pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))]
        joint = rng.choice([*(k() for k in kinds), *unaligned])
        parent = model.addJoint(parent, joint, pin.SE3.Random(), f"joint{model.nv}")
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
        if model.nv % 3 == 0:
            parent = int(
                rng.choice([j for j in model.supports[parent]])
            )  # back up the branch, so the order stays depth first
    model.armature = rng.uniform(0, 1, n)
    return model


MODELS = {
    "k1607": lambda: k1607.load_k1607().model,
    "panda": lambda: k1607.load_example("panda").model,
    "ur5": lambda: k1607.load_example("ur5").model,
    "tree": lambda: random_tree(1),
    "another tree": lambda: random_tree(2),
}


@pytest.fixture(scope="module", params=list(MODELS))
def model(request):
    return MODELS[request.param]()


def states(model, count=10):
    return np.random.default_rng(4).normal(size=(count, 3, model.nv))


def close(ours, theirs):
    """To 1e-12 of the largest entry: a few hundred roundings."""
    assert np.abs(np.asarray(ours) - theirs).max() < 1e-12 * max(1.0, np.abs(theirs).max())


def test_against_pinocchio(model):
    data, constants, g = model.createData(), bodies(model), model.gravity.linear
    for q, v, a in states(model):
        close(inverse_dynamics(constants, q, v, a, g), pin.rnea(model, data, q, v, a))
        close(mass_matrix(constants, q), pin.crba(model, data, q))
        close(coriolis_matrix(constants, q, v), pin.computeCoriolisMatrix(model, data, q, v))
        close(point_jacobian(constants, q, model.nv - 1, OFFSET), jacobian_of_offset(model, q))


OFFSET = np.array([0.1, -0.2, 0.3])  # m, in the last body


def jacobian_of_offset(model, q):
    with_frame = pin.Model(model)
    frame = with_frame.addFrame(pin.Frame("end", model.nv, 0, pin.SE3(np.eye(3), OFFSET), pin.OP_FRAME))
    return pin.computeFrameJacobian(with_frame, with_frame.createData(), q, frame, pin.LOCAL_WORLD_ALIGNED)


def test_traced_equals_floats(model):
    constants, g, n = bodies(model), model.gravity.linear, model.nv
    functions = [
        (lambda q, v, a: inverse_dynamics(constants, q, v, a, g), 3),
        (lambda q: mass_matrix(constants, q), 1),
        (lambda q, v: coriolis_matrix(constants, q, v), 2),
    ]
    for fun, arguments in functions:
        traced = trace(fun, "f", [(n,)] * arguments)
        for state in states(model, 5):
            floats = fun(*state[:arguments])
            close(np.array(traced(*state[:arguments])).reshape(floats.shape), floats)


def test_mass_matrix_rate_minus_twice_coriolis_is_skew(model):
    constants, h = bodies(model), 1e-6
    for q, v, _ in states(model, 5):
        rate = (mass_matrix(constants, q + h * v) - mass_matrix(constants, q - h * v)) / (2 * h)
        S = rate - 2 * coriolis_matrix(constants, q, v)
        assert np.abs(S + S.T).max() < 1e-7 * max(1.0, np.abs(S).max())  # rounding over the step of the difference
