import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from k1607_pin.compiled.trace import trace
from k1607_pin.description.dh import DHTable, table_1
from k1607_pin.kinematics import product

ANGLE = st.one_of(st.integers(-2, 2).map(lambda k: k * np.pi / 2), st.floats(-np.pi, np.pi))
LENGTH = st.floats(-1, 1)
ROWS = st.lists(st.tuples(ANGLE, LENGTH, LENGTH, ANGLE), min_size=1, max_size=9)
SEED = st.integers(0, 2**32 - 1)


def model_of(table):
    """The same arm, written for Pinocchio without a URDF in between."""
    model = pin.Model()
    for i, T in enumerate(table.placements()):
        # eq. (2) puts the joint's own turn last, and its offset along z commutes with that turn
        model.addJoint(i, pin.JointModelRZ(), pin.SE3(T), f"joint{i + 1}")
    return model


@given(rows=ROWS, seed=SEED)
def test_frames_and_jacobian_of_any_table_agree_with_pinocchio(rows, seed):
    """Nine links of at most 1.4 m: rounding stays below 1e-13 m."""
    table = DHTable.from_rows(rows)
    model = model_of(table)
    workspace = model.createData()
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, table.n)
    pin.computeJointJacobians(model, workspace, q)
    J = pin.getJointJacobian(model, workspace, table.n, pin.LOCAL_WORLD_ALIGNED).reshape(6, table.n)  # (6,) for n = 1
    frames = product.frame_transforms(table, *product.cosines_and_sines(q + table.theta_offset))
    for T, expected in zip(frames, list(workspace.oMi)[1:], strict=True):
        np.testing.assert_allclose(T, expected.homogeneous, rtol=0, atol=1e-13)
    np.testing.assert_allclose(product.forward_kinematics(table, q), frames[-1], rtol=0, atol=0)
    np.testing.assert_allclose(product.jacobian(table, q), J, rtol=0, atol=1e-13)


@given(rows=ROWS, seed=SEED)
def test_batches_equal_single_calls(rows, seed):
    """Sines in a batch may round otherwise than single ones: 1 ulp each, through at most nine links."""
    table = DHTable.from_rows(rows)
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (2, 3, table.n))
    T, J = product.forward_kinematics(table, q), product.jacobian(table, q)
    assert T.shape == (2, 3, 4, 4)
    assert J.shape == (2, 3, 6, table.n)
    for index in np.ndindex(2, 3):
        np.testing.assert_allclose(T[index], product.forward_kinematics(table, q[index]), rtol=0, atol=5e-14)
        np.testing.assert_allclose(J[index], product.jacobian(table, q[index]), rtol=0, atol=5e-14)


@settings(max_examples=15)
@given(rows=ROWS, seed=SEED)
def test_traced_equals_floats_for_any_table(rows, seed):
    table = DHTable.from_rows(rows)
    fk = trace(lambda q: product.forward_kinematics(table, q), "fk", [(table.n,)])
    jacobian = trace(lambda q: product.jacobian(table, q), "jacobian", [(table.n,)])
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, table.n)
    np.testing.assert_allclose(fk(q).full(), product.forward_kinematics(table, q), rtol=0, atol=5e-14)
    np.testing.assert_allclose(jacobian(q).full(), product.jacobian(table, q), rtol=0, atol=5e-14)


@given(seed=SEED)
def test_each_column_is_a_screw(seed):
    """(13): the joint's axis is a unit vector, and the tool moves at a right angle to it."""
    J = product.jacobian(table_1(), np.random.default_rng(seed).uniform(-np.pi, np.pi, 7))
    linear, angular = J[:3], J[3:]
    np.testing.assert_allclose(np.linalg.norm(angular, axis=0), 1, rtol=1e-14)
    np.testing.assert_allclose(np.einsum("ik,ik->k", linear, angular), 0, atol=1e-14)
    np.testing.assert_allclose(linear[:, -1], 0, atol=0)  # the last joint's axis goes through the tool


def test_offsets_shift_the_joint_angles():
    rng = np.random.default_rng(8)
    q, offset = rng.normal(size=7), rng.normal(size=7)
    table = table_1()
    shifted = DHTable(table.alpha, table.a, table.d, offset)
    expected = product.forward_kinematics(table, q + offset)
    np.testing.assert_array_equal(product.forward_kinematics(shifted, q), expected)


def test_a_joint_count_that_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="shape"):
        product.forward_kinematics(table_1(), np.zeros(6))
