"""URDFs as they come: continuous, mimicking and prismatic joints, missing meshes, several ends, no masses."""

import copy
import logging
import pickle

import numpy as np
import pinocchio as pin
import pytest

import k1607_pin as k1607

LINK = (
    '<link name="{}"><inertial><mass value="1"/><origin xyz="0.1 0 0.2"/>'
    '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>{}</link>'
)
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="0 0.1 0.3"/><axis xyz="{4}"/>'
    '<limit lower="-1" upper="1" effort="10" velocity="2"/>{5}</joint>'
)


def urdf(folder, joints, visual=""):
    """A file with base and the links that the joints (name, type, parent, child, axis[, extra]) mention."""
    links = {"base"} | {joint[3] for joint in joints}
    text = "".join(LINK.format(name, visual if name != "base" else "") for name in sorted(links))
    text += "".join(JOINT.format(*joint, *([""] if len(joint) == 5 else [])) for joint in joints)
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{text}</robot>')
    return path


def test_continuous_joints_are_angles_without_limits(tmp_path):
    axis = np.array([0.6, 0.0, 0.8])
    path = urdf(tmp_path, [("a", "continuous", "base", "1", "0 0 1"), ("b", "continuous", "1", "2", "0.6 0 0.8")])
    arm = k1607.load_urdf(path)
    assert arm.n == 2
    assert np.isinf(arm.lower).all()
    assert np.isinf(arm.upper).all()
    q = np.array([0.3, 2 * np.pi + 0.4])
    expected = pin.exp3(np.array([0, 0, 0.3])) @ pin.exp3(0.4 * axis)
    assert np.abs(arm.forward_kinematics(q).rotation - expected).max() < 1e-14
    original = pin.buildModelFromUrdf(str(path))  # cosines and sines
    M = pin.crba(original, original.createData(), np.array([np.cos(0.3), np.sin(0.3), np.cos(0.4), np.sin(0.4)]))
    assert np.abs(arm.mass_matrix(q) - M).max() < 1e-14


def test_a_robot_with_continuous_joints_and_fingers():
    arm = k1607.load_example("kinova")
    assert arm.n == 6
    q = np.array([0.1, 2, 2, 0.3, 0.4, 0.5])
    assert k1607.inverse_kinematics(arm, arm.forward_kinematics(q)).converged


def test_a_single_sliding_joint(tmp_path):
    arm = k1607.load_urdf(urdf(tmp_path, [("a", "prismatic", "base", "1", "1 0 0")]))
    assert np.abs(arm.forward_kinematics(np.array([0.5])).translation - [0.5, 0.1, 0.3]).max() < 1e-15
    assert arm.jacobian(np.array([0.5])).shape == (6, 1)
    assert arm.mass_matrix(np.array([0.5])) == pytest.approx(np.array([[1.0]]))


def test_a_mimicking_joint_is_refused_unless_locked(tmp_path):
    joints = [
        ("a", "revolute", "base", "1", "0 0 1"),
        ("b", "revolute", "1", "2", "0 1 0", '<mimic joint="a" multiplier="1"/>'),
    ]
    path = urdf(tmp_path, joints)
    with pytest.raises(ValueError, match="'b' mimics"):
        k1607.load_urdf(path)
    assert k1607.load_urdf(path, locked=["b"]).n == 1


def test_several_ends_need_a_tool_frame(tmp_path):
    joints = [
        ("a", "revolute", "base", "1", "0 0 1"),
        ("left", "revolute", "1", "2", "0 1 0"),
        ("right", "revolute", "1", "3", "0 1 0"),
    ]
    path = urdf(tmp_path, joints)
    with pytest.raises(ValueError, match="several ends"):
        k1607.load_urdf(path)
    assert k1607.load_urdf(path, "1").joint_names == ("a",)


def test_a_missing_mesh_is_a_warning_not_the_end(tmp_path, caplog):
    visual = '<visual><geometry><mesh filename="package://nowhere/part.stl"/></geometry></visual>'
    path = urdf(tmp_path, [("a", "revolute", "base", "1", "0 0 1")], visual)
    with caplog.at_level(logging.WARNING, logger="k1607_pin"):
        arm = k1607.load_urdf(path)
    assert arm.n == 1
    assert "package_dirs" in caplog.text


def test_an_arm_without_masses_has_kinematics_only(tmp_path):
    from k1607_pin.description import description
    from k1607_pin.description.urdf import to_urdf

    table = {"dh": {"units": {"length": "m", "angle": "deg"}, "rows": [[0, 0, 0.3], [-90, 0.1, 0]]}}
    (tmp_path / "bare.urdf").write_text(to_urdf(description.from_mapping(table)))
    arm = k1607.load_urdf(tmp_path / "bare.urdf", "tool")
    assert arm.jacobian(np.zeros(2)).shape == (6, 2)
    with pytest.raises(ValueError, match="kinematics only"):
        arm.forward_dynamics(np.zeros(2), np.zeros(2), np.zeros(2))
    with_rotors = k1607.load_urdf(tmp_path / "bare.urdf", "tool", armature=np.ones(2))
    assert with_rotors.forward_dynamics(np.zeros(2), np.zeros(2), np.array([1.0, 2.0])) == pytest.approx([1.0, 2.0])


def test_pickled_and_copied_arms_are_the_same_arm(arm):
    q = 0.5 * (np.maximum(arm.lower, -1) + np.minimum(arm.upper, 1))
    for twin in (pickle.loads(pickle.dumps(arm)), copy.deepcopy(arm)):
        assert (twin.tool_frame, twin.joint_names) == (arm.tool_frame, arm.joint_names)
        assert np.array_equal(twin.jacobian(q), arm.jacobian(q))
        assert np.array_equal(twin.mass_matrix(q), arm.mass_matrix(q))


def test_a_massless_last_link_is_no_arm_for_dynamics(tmp_path):
    """Its mass matrix is singular, but an eigenvalue may come out as 1e-17 instead of 0."""
    joints = [("a", "revolute", "base", "1", "0.6 0 0.8"), ("b", "revolute", "1", "2", "0.36 0.48 0.8")]
    path = urdf(tmp_path, joints)
    text = path.read_text()
    path.write_text(text.replace(LINK.format("2", ""), '<link name="2"/>'))
    arm = k1607.load_urdf(path, "2")
    with pytest.raises(ValueError, match="kinematics only"):
        arm.forward_dynamics(np.zeros(2), np.zeros(2), np.ones(2))


def test_eigenvalues_within_rounding_of_zero_count_as_zero(monkeypatch, reference):
    monkeypatch.setattr(np.linalg, "eigvalsh", lambda M: np.array([1e-17, 1.0]))
    arm = k1607.Arm(reference.model, "tool")
    with pytest.raises(ValueError, match="kinematics only"):
        arm.forward_dynamics(np.zeros(7), np.zeros(7), np.zeros(7))
