import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yourdfpy
from hypothesis import example, given, settings
from hypothesis import strategies as st

from k1607_pin.arm.load import k1607_urdf
from k1607_pin.description import description
from k1607_pin.description.dh import DHTable, table_1
from k1607_pin.description.urdf import read_dh, to_urdf
from k1607_pin.kinematics import product

COMMITTED = Path(__file__).parents[2] / "urdf" / "k1607.urdf"
RIGHT_ANGLE = st.integers(-2, 2).map(lambda k: k * np.pi / 2)
ANGLE = st.one_of(RIGHT_ANGLE, st.floats(-np.pi, np.pi))
LENGTH = st.floats(-5, 5)
ROWS = st.lists(st.tuples(ANGLE, LENGTH, LENGTH, ANGLE), min_size=1, max_size=9)


def arm_of(rows):
    return description.from_mapping({"dh": {"rows": rows, "units": {"length": "m", "angle": "rad"}}})


def wrapped(angle):
    return np.arctan2(np.sin(angle), np.cos(angle))


@pytest.fixture(scope="module")
def text():
    return to_urdf(description.k1607())


def test_the_committed_file_is_not_stale(text):
    assert COMMITTED.read_bytes() == text.encode()


def test_the_file_that_is_loaded_is_the_committed_one():
    assert k1607_urdf().read_bytes() == COMMITTED.read_bytes()


def test_table_1_comes_back_exactly(text, tmp_path):
    """To 1 ulp of its entries, from text and from a file."""
    (tmp_path / "arm.urdf").write_text(text)
    for source in (text, tmp_path / "arm.urdf", str(tmp_path / "arm.urdf")):
        table = read_dh(source)
        for column in ("alpha", "a", "d", "theta_offset"):
            np.testing.assert_allclose(getattr(table, column), getattr(table_1(), column), rtol=0, atol=1e-15)


@settings(max_examples=40)
@given(rows=ROWS)
@example(rows=[(np.pi / 2, 0.0, 1.0, np.pi / 2)] * 9)
@example(rows=[(np.pi / 2, 0.0, 1.0, np.pi / 2 - 1e-8)])  # roll, pitch, yaw near their own singularity
@example(rows=[(np.pi / 2, 0.0, 1.0, np.pi / 2 - 1e-5)])
def test_any_table_comes_back(rows):
    arm = arm_of(rows)
    table = read_dh(to_urdf(arm))
    for column in ("alpha", "theta_offset"):
        np.testing.assert_allclose(wrapped(getattr(table, column) - getattr(arm.dh, column)), 0, atol=1e-12)
    for column in ("a", "d"):
        np.testing.assert_allclose(getattr(table, column), getattr(arm.dh, column), rtol=0, atol=1e-12)


@settings(max_examples=20)
@given(rows=ROWS, seed=st.integers(0, 2**32 - 1))
def test_pinocchio_reads_the_same_arm(rows, seed):
    arm = arm_of(rows)
    model = pin.buildModelFromXML(to_urdf(arm))
    workspace = model.createData()
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, arm.dh.n)
    pin.framesForwardKinematics(model, workspace, q)
    T = workspace.oMf[model.getFrameId("tool")].homogeneous
    np.testing.assert_allclose(T, product.forward_kinematics(arm.dh, q), rtol=0, atol=1e-11)  # up to 90 m of arm


@pytest.mark.parametrize("axis", ["1 0 0", "0 0 -1", "0 1 0"])
def test_an_axis_that_is_not_z_is_named(text, axis):
    third = text.index('<joint name="joint3"')
    there = text.index('xyz="0.0 0.0 1.0"', text.index("<axis", third))
    with pytest.raises(ValueError, match="'joint3'"):
        read_dh(text[:there] + f'xyz="{axis}"' + text[there + len('xyz="0.0 0.0 1.0"') :])


def test_a_placement_that_is_no_dh_row_is_named(text):
    second = text.index("rpy=", text.index('<joint name="joint2"'))
    end = text.index('"', second + 5) + 1
    with pytest.raises(ValueError, match="joint 2"):
        read_dh(text[:second] + 'rpy="0.1 0.2 0.3"' + text[end:])


def test_links_joints_limits_and_frames_are_those_described(text):
    arm = description.k1607()
    model = pin.buildModelFromXML(text)
    assert list(model.names)[1:] == [f"joint{i}" for i in range(1, 8)]
    np.testing.assert_array_equal(model.lowerPositionLimit, arm.lower)
    np.testing.assert_array_equal(model.upperPositionLimit, arm.upper)
    np.testing.assert_array_equal(model.velocityLimit, arm.velocity)
    np.testing.assert_array_equal(model.effortLimit, arm.effort)
    tool, plate = (model.frames[model.getFrameId(name)].placement for name in ("tool", "tool_plate"))
    np.testing.assert_array_equal((tool.inverse() * plate).homogeneous[:3, 3], [0, 0, arm.frames["tool_plate"]])
    for inertia, link in zip(list(model.inertias)[1:], arm.links, strict=True):
        assert inertia.mass == link.mass
        # the file has twelve digits of the largest entry
        np.testing.assert_allclose(inertia.lever, link.cg, rtol=0, atol=1e-11 * np.abs(link.cg).max())
        np.testing.assert_allclose(inertia.inertia, link.inertia, rtol=0, atol=1e-11 * np.abs(link.inertia).max())


def test_shapes_are_those_described(text):
    arm = description.k1607()
    robot = yourdfpy.URDF.load(_stream(text), build_scene_graph=False, load_meshes=False).robot
    visuals = [visual for link in robot.links for visual in link.visuals]
    collisions = [collision for link in robot.links for collision in link.collisions]
    assert len(visuals) == len(arm.shapes)
    assert len(collisions) == sum(shape.is_cylinder for shape in arm.shapes)
    drawn = {(v.name, tuple(np.round(v.origin[:3, 3], 9))) for v in visuals}
    assert len(drawn) == len(arm.shapes)


def test_yourdfpy_walks_the_same_chain(text):
    robot = yourdfpy.URDF.load(_stream(text), load_meshes=False)
    assert robot.validate()
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, 7)
    robot.update_cfg(q)
    T = robot.get_transform("tool", "base")
    np.testing.assert_allclose(T, product.forward_kinematics(table_1(), q), rtol=0, atol=1e-12)


@pytest.fixture(scope="module")
def in_pinocchio(text):
    return pin.buildModelFromXML(text)


@pytest.fixture(scope="module")
def in_mujoco():
    """Compiled by MuJoCo, its own inertia checks on: it refuses A + B < C and masses that are not positive."""
    return mujoco.MjModel.from_xml_path(str(COMMITTED))


def mujoco_mass_matrix(model, q):
    workspace = mujoco.MjData(model)
    workspace.qpos[:] = q
    mujoco.mj_forward(model, workspace)
    M = np.zeros((model.nv, model.nv))
    for column, unit in zip(M, np.eye(model.nv), strict=True):  # mj_fullM has a new signature in MuJoCo 4
        mujoco.mj_mulM(model, workspace, column, unit)
    return M.T, workspace.qfrc_bias.copy()


@given(seed=st.integers(0, 2**32 - 1))
def test_mujoco_and_pinocchio_have_the_same_dynamics(in_mujoco, in_pinocchio, seed):
    """MuJoCo stores principal inertias and a quaternion for each link: that costs digits, hence 1e-9 of 50 kg m^2."""
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, 7)
    M, bias = mujoco_mass_matrix(in_mujoco, q)
    model, workspace = in_pinocchio, in_pinocchio.createData()
    expected = pin.crba(model, workspace, q, pin.Convention.WORLD)
    np.testing.assert_allclose(M, expected, rtol=0, atol=1e-9 * 50)
    np.testing.assert_allclose(bias, pin.computeGeneralizedGravity(model, workspace, q), rtol=0, atol=1e-9 * 1000)


def test_mujoco_refuses_the_links_as_published(tmp_path):
    """So its checks are on: without the rods, the file does not compile."""
    from k1607_pin.description.inertia import assemble

    path = tmp_path / "published.urdf"
    path.write_text(to_urdf(dataclasses.replace(description.k1607(), links=assemble())))
    with pytest.raises(ValueError, match="inertia"):
        mujoco.MjModel.from_xml_path(str(path))


def test_an_arm_without_masses_has_no_inertials():
    assert "<inertial" not in to_urdf(arm_of([(0.0, 0.1, 0.2), (np.pi / 2, 0.1, 0.0)]))


def test_writing_does_not_change_the_description():
    arm = description.k1607()
    before = dataclasses.asdict(arm)
    assert to_urdf(arm) == to_urdf(arm)
    after = dataclasses.asdict(arm)
    np.testing.assert_equal(after, before)


def test_table_and_urdf_agree_on_the_number_of_joints():
    for n in range(1, 10):
        assert read_dh(to_urdf(arm_of([(0.0, 0.1, 0.2)] * n))).n == n
    assert DHTable.from_rows([(0, 0, 0)]).n == 1


def _stream(text):
    import io

    return io.BytesIO(text.encode())


def test_rounding_of_another_processor_does_not_change_the_file():
    """Inertias and centres of gravity off by a few last digits give the same text."""
    from dataclasses import replace

    arm = description.k1607()
    off = [replace(l, cg=l.cg * (1 + 4e-16), inertia=l.inertia * (1 - 4e-16)) for l in arm.links]
    assert to_urdf(replace(arm, links=off)) == to_urdf(arm)
