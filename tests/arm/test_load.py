import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import k1607_pin as k1607
from k1607_pin import data
from k1607_pin.arm.load import TOOL_FRAMES, k1607_urdf

HEAD = '<?xml version="1.0"?><robot name="test">'
BODY = '<inertial><origin xyz="0 0.3 0.2"/><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def joint(name, parent, child, kind="revolute"):
    limit = "" if kind == "continuous" else '<limit lower="0.5" upper="1" effort="1" velocity="1"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 1"/><axis xyz="1 0 0"/>{limit}</joint>'
    )


def links(*names):
    return "".join(f'<link name="{name}">{BODY}</link>' for name in names)


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "robot.urdf"
        path.write_text(text)
        return path

    return write


@pytest.fixture(scope="module")
def plate():
    return k1607.load_k1607("tool_plate")


@pytest.fixture(scope="module")
def panda():
    return k1607.load_example("panda")


def same_arm(one, two):
    q = one.random_configuration(np.random.default_rng(1))
    np.testing.assert_array_equal(one.forward_kinematics(q).homogeneous, two.forward_kinematics(q).homogeneous)
    np.testing.assert_array_equal(one.mass_matrix(q), two.mass_matrix(q))
    np.testing.assert_array_equal(one.gravity_torque(q), two.gravity_torque(q))


class TestK1607:
    def test_is_its_urdf_with_the_assumed_armature(self):
        armature = data.load("k1607")["armature"]["inertia_kg_m2"]
        same_arm(k1607.load_k1607(), k1607.load_urdf(k1607_urdf(), "tool", armature=armature))

    @given(seed=st.integers(0, 2**32 - 1))
    def test_the_tool_plate_lies_6_6_inches_along_z7(self, reference, plate, seed):
        q = np.random.default_rng(seed).uniform(-np.pi, np.pi, 7)
        T, P = reference.forward_kinematics(q), plate.forward_kinematics(q)
        np.testing.assert_allclose(P.rotation, T.rotation, rtol=0, atol=1e-15)
        offset = 6.6 * 0.0254 * T.rotation[:, 2]
        np.testing.assert_allclose(P.translation, T.translation + offset, rtol=0, atol=1e-15)
        lever = np.cross(reference.jacobian(q)[3:].T, offset).T
        np.testing.assert_allclose(plate.jacobian(q)[:3], reference.jacobian(q)[:3] + lever, rtol=0, atol=1e-14)
        np.testing.assert_array_equal(plate.mass_matrix(q), reference.mass_matrix(q))

    def test_frame_7_is_the_tool(self, reference):
        q = np.random.default_rng(2).uniform(-np.pi, np.pi, 7)
        np.testing.assert_array_equal(reference.forward_kinematics(q).homogeneous, reference.frames(q)[-1].homogeneous)

    def test_placements_are_free_of_rounding(self, reference):
        for placement in list(reference.model.jointPlacements)[1:]:
            assert np.isin(placement.rotation, (-1.0, 0.0, 1.0)).all()

    def test_gravity(self):
        arm = k1607.load_k1607(gravity=(0, 0, 0))
        q, v = np.random.default_rng(3).normal(size=(2, 7))
        assert not arm.gravity_torque(q).any()
        down, up = k1607.load_k1607(), k1607.load_k1607(gravity=[0, 0, 9.81])
        np.testing.assert_allclose(up.gravity_torque(q), -down.gravity_torque(q), rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            arm.bias_torque(q, v), down.bias_torque(q, v) - down.gravity_torque(q), rtol=0, atol=1e-11
        )

    def test_armature(self):
        given = np.arange(7.0)
        arm = k1607.load_k1607(armature=given)
        given[:] = 99
        np.testing.assert_array_equal(arm.armature, np.arange(7.0))
        np.testing.assert_array_equal(arm.model.armature, np.arange(7.0))

    @pytest.mark.parametrize(
        "armature", [np.zeros(6), 1.0, np.full(7, -1.0), np.full(7, np.nan), np.full(7, np.inf), ["a"] * 7]
    )
    def test_bad_armature_is_named(self, armature):
        with pytest.raises(ValueError, match=r"^armature: expected \(7,\)"):
            k1607.load_k1607(armature=armature)

    @pytest.mark.parametrize("gravity", [9.81, (0, 0), (0, 0, 0, 9.81), (0, 0, np.nan), None, "down"])
    def test_bad_gravity_is_named(self, gravity):
        with pytest.raises(ValueError, match=r"^gravity: expected \(3,\)"):
            k1607.load_k1607(gravity=gravity)

    @pytest.mark.parametrize("frame", ["flange", "tool_", "joint8"])
    def test_an_unknown_frame_is_named_with_those_there_are(self, frame):
        with pytest.raises(ValueError, match=f"no frame '{frame}'.*link7, tool, tool_plate"):
            k1607.load_k1607(frame)


class TestUrdf:
    def test_no_such_file(self, tmp_path):
        for path in (tmp_path / "none.urdf", str(tmp_path / "none.urdf"), tmp_path):
            with pytest.raises(ValueError, match="path: no URDF file"):
                k1607.load_urdf(path)

    @pytest.mark.parametrize("text", ["", "not xml", "<html/>", HEAD, HEAD + "</robot>", "<robot><link></robot>"])
    def test_not_a_urdf(self, write, text):
        with pytest.raises(ValueError, match=r"path: Pinocchio cannot read .*robot\.urdf"):
            k1607.load_urdf(write(text))

    def test_the_last_link_is_the_default_tool(self, write):
        path = write(HEAD + links("a", "b", "c") + joint("j1", "a", "b") + joint("j2", "b", "c") + "</robot>")
        arm = k1607.load_urdf(str(path))
        assert (arm.n, arm.tool_frame, arm.joint_names) == (2, "c", ("j1", "j2"))
        np.testing.assert_array_equal(arm.armature, 0)

    def test_a_link_is_meant_where_a_joint_has_its_name_too(self, write):
        fixed = '<joint name="tip" type="fixed"><parent link="c"/><child link="tip"/><origin xyz="0 0 5"/></joint>'
        text = HEAD + links("a", "b", "c", "tip") + joint("j1", "a", "b") + joint("c", "b", "c") + fixed + "</robot>"
        q = np.zeros(2)
        assert k1607.load_urdf(write(text), "c").forward_kinematics(q).translation[2] == 2
        assert k1607.load_urdf(write(text), "tip").forward_kinematics(q).translation[2] == 7

    def test_nothing_that_moves(self, write):
        with pytest.raises(ValueError, match="no movable joint"):
            k1607.load_urdf(write(HEAD + links("only") + "</robot>"))

    def test_a_joint_of_two_coordinates_is_named(self, write):
        path = write(HEAD + links("a", "b") + joint("wheel", "a", "b", "planar") + "</robot>")
        with pytest.raises(ValueError, match=r"joint 'wheel': expected one degree of freedom and one coordinate"):
            k1607.load_urdf(path)

    @pytest.mark.parametrize("kind", ["revolute", "continuous"])
    def test_a_locked_joint_stands_at_its_angle_whatever_its_kind(self, write, kind):
        """A continuous joint's two coordinates are the cosine and sine of its angle."""
        text = HEAD + links("a", "b", "c") + joint("wheel", "a", "b", kind) + joint("arm", "b", "c") + "</robot>"
        arm = k1607.load_urdf(write(text), "c", locked={"wheel": 0.6})
        assert arm.joint_names == ("arm",)
        c, s = np.cos(0.6), np.sin(0.6)
        tool = arm.forward_kinematics([0.0])
        np.testing.assert_allclose(tool.rotation, [[1, 0, 0], [0, c, -s], [0, s, c]], rtol=0, atol=1e-15)
        np.testing.assert_allclose(tool.translation, [0, -s, 1 + c], rtol=0, atol=1e-15)

    def test_what_does_not_carry_the_tool_is_locked(self, write):
        """At zero, or at the limit nearest to it: 0.5 here."""
        fork = joint("left", "a", "b") + joint("right", "b", "c") + joint("other", "b", "d")
        path = write(HEAD + links("a", "b", "c", "d") + fork + "</robot>")
        arm = k1607.load_urdf(path, "c")
        assert arm.joint_names == ("left", "right")
        model = pin.buildModelFromUrdf(str(path))
        q = np.zeros(3)
        for name, angle in (("left", 0.6), ("right", 0.7), ("other", 0.5)):
            q[model.joints[model.getJointId(name)].idx_q] = angle
        workspace = model.createData()
        M = pin.crba(model, workspace, q, pin.Convention.WORLD)
        keep = [model.joints[model.getJointId(name)].idx_v for name in arm.joint_names]
        np.testing.assert_allclose(arm.mass_matrix([0.6, 0.7]), M[np.ix_(keep, keep)], rtol=0, atol=1e-14)

    def test_a_tree_is_refused_by_the_arm_itself(self, write):
        fork = joint("left", "a", "b") + joint("right", "b", "c") + joint("other", "b", "d")
        model = pin.buildModelFromUrdf(str(write(HEAD + links("a", "b", "c", "d") + fork + "</robot>")))
        with pytest.raises(
            ValueError, match=r"joint '(right|other)': expected a serial chain, but its parent is 'left'"
        ):
            k1607.Arm(model, "c")

    def test_a_prismatic_joint_is_one_degree_of_freedom(self, write):
        path = write(
            HEAD + links("a", "b", "c") + joint("turn", "a", "b") + joint("slide", "b", "c", "prismatic") + "</robot>"
        )
        arm = k1607.load_urdf(path)
        np.testing.assert_allclose(arm.jacobian([0.0, 0.7])[:, 1], [1, 0, 0, 0, 0, 0], atol=1e-15)


class TestExamples:
    def test_an_unknown_robot_is_named_with_those_there_are(self):
        with pytest.raises(ValueError, match=r"name: no robot 'robby'.*panda"):
            k1607.load_example("robby")

    def test_a_robot_that_is_not_bolted_down_is_refused(self):
        with pytest.raises(ValueError, match="'root_joint': expected a fixed base"):
            k1607.load_example("solo8")

    @pytest.mark.parametrize("name", sorted(set(TOOL_FRAMES) - {"panda", "ur5"}))
    def test_every_robot_whose_tool_frame_we_name_loads(self, name):
        arm = k1607.load_example(name)
        assert arm.tool_frame == TOOL_FRAMES[name]
        assert arm.n in (6, 7)

    def test_the_pandas_fingers_are_locked_unasked(self, panda):
        arm = panda
        assert arm.joint_names == tuple(f"panda_joint{i}" for i in range(1, 8))
        assert arm.tool_frame == "panda_hand_tcp"
        import example_robot_data

        model = example_robot_data.load("panda").model
        workspace = model.createData()
        q = np.concatenate([arm.random_configuration(np.random.default_rng(4)), [0.0, 0.0]])
        M = pin.crba(model, workspace, q, pin.Convention.WORLD)[:7, :7]
        np.testing.assert_allclose(arm.mass_matrix(q[:7]), M, rtol=0, atol=1e-14)
        g = pin.computeGeneralizedGravity(model, workspace, q)[:7]
        np.testing.assert_allclose(arm.gravity_torque(q[:7]), g, rtol=0, atol=1e-13)
        pin.framesForwardKinematics(model, workspace, q)
        T = workspace.oMf[model.getFrameId("panda_hand_tcp")].homogeneous
        np.testing.assert_allclose(arm.forward_kinematics(q[:7]).homogeneous, T, rtol=0, atol=1e-15)

    @pytest.mark.parametrize("angle", [0.5, -2.0])
    def test_a_joint_is_locked_at_the_angle_that_is_given(self, panda, angle):
        whole = panda
        arm = k1607.load_example("panda", locked={"panda_joint3": angle})
        assert arm.joint_names == tuple(f"panda_joint{i}" for i in (1, 2, 4, 5, 6, 7))
        q = arm.random_configuration(np.random.default_rng(5))
        full = np.insert(q, 2, angle)
        T, expected = arm.forward_kinematics(q).homogeneous, whole.forward_kinematics(full).homogeneous
        np.testing.assert_allclose(T, expected, rtol=0, atol=1e-14)
        np.testing.assert_allclose(arm.jacobian(q), np.delete(whole.jacobian(full), 2, axis=1), rtol=0, atol=1e-14)
        M = np.delete(np.delete(whole.mass_matrix(full), 2, axis=0), 2, axis=1)
        np.testing.assert_allclose(arm.mass_matrix(q), M, rtol=0, atol=1e-13)

    def test_names_alone_lock_at_zero(self):
        one = k1607.load_urdf(k1607_urdf(), "tool", locked=["joint3", "joint5"])
        two = k1607.load_urdf(k1607_urdf(), "tool", locked={"joint3": 0.0, "joint5": 0.0})
        assert one.joint_names == ("joint1", "joint2", "joint4", "joint6", "joint7")
        same_arm(one, two)

    def test_an_unknown_joint_is_named_with_those_there_are(self):
        with pytest.raises(ValueError, match=r"locked: no joint 'elbow'.*panda_joint1"):
            k1607.load_example("panda", locked=["elbow"])

    @pytest.mark.parametrize("angle", [np.nan, np.inf, "half", None])
    def test_an_angle_to_lock_at_that_is_no_number_is_named(self, angle):
        with pytest.raises(ValueError, match=r"^locked: .*joint3"):
            k1607.load_urdf(k1607_urdf(), "tool", locked={"joint3": angle})

    def test_everything_locked(self):
        with pytest.raises(ValueError, match="no movable joint"):
            k1607.load_urdf(k1607_urdf(), "tool", locked=[f"joint{i}" for i in range(1, 8)])

    def test_a_tool_frame_half_way_up_leaves_the_joints_below(self):
        arm = k1607.load_example("ur5", tool_frame="forearm_link")
        assert arm.joint_names == ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint")

    def test_armature_counts_the_joints_that_are_left(self):
        arm = k1607.load_example("panda", armature=np.full(7, 0.1))
        np.testing.assert_array_equal(arm.armature, 0.1)
        with pytest.raises(ValueError, match=r"armature: expected \(6,\)"):
            k1607.load_urdf(k1607_urdf(), "tool", locked=["joint3"], armature=np.full(7, 0.1))

    def test_loading_twice_gives_two_arms(self):
        """Without an armature leaking from one to the other through a shared model."""
        heavy, plain = k1607.load_example("ur5", armature=np.ones(6)), k1607.load_example("ur5")
        assert not plain.armature.any()
        assert heavy.armature.all()
