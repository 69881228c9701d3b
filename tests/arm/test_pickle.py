"""Arms that travel: to other processes and back, as kilobytes, the same to the last bit."""

import copy
import logging
import pickle
import shutil
import struct
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pinocchio as pin
import pytest

import k1607_pin as k1607
from k1607_pin.arm import meshes
from k1607_pin.arm.payload import Payload, with_payload

ROUND_TRIPS = {"pickle": lambda arm: pickle.loads(pickle.dumps(arm)), "deepcopy": copy.deepcopy, "copy": copy.copy}


@pytest.mark.parametrize("trip", ROUND_TRIPS)
def test_a_copy_answers_the_same_numbers(arm, trip):
    twin = ROUND_TRIPS[trip](arm)
    rng = np.random.default_rng(7)
    q, v, tau = arm.random_configuration(rng), rng.normal(size=arm.n), rng.normal(size=arm.n)
    for one in ("lower", "upper", "velocity_limit", "effort_limit", "armature", "damping", "friction"):
        np.testing.assert_array_equal(getattr(twin, one), getattr(arm, one))
    np.testing.assert_array_equal(twin.forward_kinematics(q).homogeneous, arm.forward_kinematics(q).homogeneous)
    np.testing.assert_array_equal(twin.mass_matrix(q), arm.mass_matrix(q))
    np.testing.assert_array_equal(twin.forward_dynamics(q, v, tau), arm.forward_dynamics(q, v, tau))
    assert (twin.name, twin.tool_frame, twin.joint_names) == (arm.name, arm.tool_frame, arm.joint_names)
    assert twin.model == arm.model


def test_meshes_stay_where_they_are(arm):
    assert len(pickle.dumps(arm)) < 150_000
    assert len(pickle.dumps(with_payload(arm, Payload(1.0)))) < 150_000


def test_no_mesh_is_read_before_somebody_looks(monkeypatch):
    panda = k1607.load_example("panda")
    sent = pickle.dumps(with_payload(panda, Payload(1.0)))
    read = []
    unpacked = meshes.unpacked
    monkeypatch.setattr(meshes, "unpacked", lambda light: read.append(light) or unpacked(light))
    twin = with_payload(pickle.loads(sent), Payload(2.0))
    twin.mass_matrix(np.zeros(7))
    pickle.dumps(copy.deepcopy(twin))
    assert not read
    assert twin.visual_model is not None
    assert len(read) == 1
    twin.visual_model  # noqa: B018
    assert len(read) == 1


def test_a_copys_geometry_is_the_arms(arm):
    twin = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(arm))))
    for mine, other in ((arm.visual_model, twin.visual_model), (arm.collision_model, twin.collision_model)):
        assert len(mine.geometryObjects) == len(other.geometryObjects) > 0
        assert [(p.first, p.second) for p in mine.collisionPairs] == [(p.first, p.second) for p in other.collisionPairs]
        for a, b in zip(mine.geometryObjects, other.geometryObjects, strict=True):
            assert (a.name, a.parentJoint, a.parentFrame, a.meshPath, a.overrideMaterial, a.disableCollision) == (
                b.name, b.parentJoint, b.parentFrame, b.meshPath, b.overrideMaterial, b.disableCollision
            )  # fmt: skip
            np.testing.assert_array_equal(a.placement.homogeneous, b.placement.homogeneous)
            np.testing.assert_array_equal(a.meshColor, b.meshColor)
            np.testing.assert_array_equal(a.meshScale, b.meshScale)
            assert type(a.geometry) is type(b.geometry)
            a.geometry.computeLocalAABB()
            b.geometry.computeLocalAABB()
            np.testing.assert_array_equal(a.geometry.aabb_local.max_, b.geometry.aabb_local.max_)


@pytest.fixture
def meshed(tmp_path):
    """An arm of one joint with a mesh in a file: one triangle."""
    triangle = struct.pack("<12fH", *(0, 0, 1), *(0, 0, 0), *(0.1, 0, 0), *(0, 0.1, 0), 0)
    (tmp_path / "part.stl").write_bytes(bytes(80) + struct.pack("<I", 1) + triangle)
    visual = '<visual><geometry><mesh filename="part.stl" scale="2 2 2"/></geometry></visual>'
    box = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
    body = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    (tmp_path / "arm.urdf").write_text(
        f'<robot name="meshed"><link name="base"/><link name="a">{body}{visual}{box}</link><joint name="j" type="revolute">'
        '<parent link="base"/><child link="a"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    return k1607.load_urdf(tmp_path / "arm.urdf")


def test_meshes_that_are_missing_are_named_when_looked_for(meshed, tmp_path, caplog):
    sent = pickle.dumps(meshed)
    assert len(pickle.loads(sent).visual_model.geometryObjects) == 2
    shutil.move(tmp_path / "part.stl", tmp_path / "elsewhere.stl")
    with caplog.at_level(logging.WARNING):
        twin = pickle.loads(sent)
        assert not caplog.text
        objects = twin.visual_model.geometryObjects
    assert "part.stl" in caplog.text
    assert [o.name for o in objects] == [
        o.name for o in meshed.visual_model.geometryObjects if "part" not in o.meshPath
    ]


def test_a_mesh_without_a_file_travels_along(meshed, tmp_path):
    (tmp_path / "part.stl").unlink()
    twin = pickle.loads(pickle.dumps(meshed))
    assert len(twin.visual_model.geometryObjects) == 2


def test_an_arm_without_looks():
    arm = k1607.load_k1607()
    bare = k1607.Arm(arm.model, "tool")
    assert pickle.loads(pickle.dumps(bare)).visual_model is None
    assert copy.deepcopy(bare).collision_model is None


def test_geometry_is_a_copy(meshed):
    meshed.visual_model.geometryObjects[0].name = "mine"
    assert meshed.visual_model.geometryObjects[0].name != "mine"


def test_an_arm_of_another_model_keeps_its_looks(meshed):
    model = meshed.model
    model.inertias[1] = pin.Inertia(2.0, np.zeros(3), np.eye(3))
    heavier = meshed.with_model(model)
    model.inertias[1] = pin.Inertia(3.0, np.zeros(3), np.eye(3))
    assert heavier.model.inertias[1].mass == 2
    assert len(heavier.visual_model.geometryObjects) == 2


def test_there_and_back_through_a_process():
    arm = k1607.load_k1607()
    q = np.linspace(-1, 1, 7)
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        twin = pool.submit(copy.copy, arm).result()
        M = pool.submit(k1607.Arm.mass_matrix, arm, q).result()
    np.testing.assert_array_equal(M, arm.mass_matrix(q))
    np.testing.assert_array_equal(twin.mass_matrix(q), arm.mass_matrix(q))
