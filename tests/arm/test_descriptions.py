"""URDFs as people write them: what loads, with which tool and which joints, and what is refused in which words."""

import logging
import os
import subprocess
import sys

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.simulation.plant import Plant

INERTIA = '<inertia ixx="{0}" ixy="0" ixz="0" iyy="{1}" iyz="0" izz="{2}"/>'.format
BODY = '<origin xyz="0.1 0 0"/><mass value="1"/>' + INERTIA(0.1, 0.1, 0.1)


def link(name, inertial=BODY):
    return f'<link name="{name}">\n<inertial>{inertial}</inertial>\n</link>\n'


def joint(name, parent, child, kind="revolute", lower=-1, upper=1, axis="0 0 1", extra=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0.1 0.3"/><axis xyz="{axis}"/>'
        f'<limit lower="{lower}" upper="{upper}" effort="10" velocity="2"/>{extra}</joint>\n'
    )


def chain(n=3, first="base", prefix="j", **changed):
    """n joints one after another, and their links without the first."""
    names = [first, *(f"{prefix}link{i}" for i in range(1, n + 1))]
    return "".join(link(name) + joint(f"{prefix}{i}", names[i - 1], name) for i, name in enumerate(names[1:], 1))


@pytest.fixture
def load(tmp_path):
    def load(body, head='<robot name="robot">', **options):
        path = tmp_path / "robot.urdf"
        text = f"{head}\n{body}</robot>"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return k1607.load_urdf(path, **options)

    return load


ARM = link("base") + chain(3)


class TestTool:
    @pytest.mark.parametrize("prefix", ["a", "z"])
    def test_a_piston_on_the_second_link_is_no_arm(self, load, prefix):
        """Whatever its names sort like: Pinocchio orders joints by them."""
        piston = link(f"{prefix}_rod") + joint(f"{prefix}_piston", "jlink2", f"{prefix}_rod", "prismatic")
        arm = load(link("base") + chain(6) + piston)
        assert arm.joint_names == tuple(f"j{i}" for i in range(1, 7))
        assert arm.tool_frame == "jlink6"

    @pytest.mark.parametrize("name", ["aaa", "zzz"])
    @pytest.mark.parametrize("on", ["base", "jlink1"])
    def test_a_camera_or_pedestal_is_no_tool(self, load, name, on):
        fixed = f'<link name="{name}"/>' + joint(f"{name}_mount", on, name, "fixed")
        assert load(ARM + fixed).tool_frame == "jlink3"

    def test_the_tool_is_the_leaf_beyond_fixed_joints(self, load):
        flange = '<link name="flange"/><link name="a"/>' + joint("f", "jlink3", "flange", "fixed")
        assert load(ARM + flange + joint("g", "flange", "a", "fixed")).tool_frame == "a"

    def test_two_leaves_are_listed_with_what_to_type(self, load):
        hand = '<link name="camera"/><link name="hand"/>' + joint("c", "jlink3", "camera", "fixed")
        hand += joint("h", "jlink3", "hand", "fixed")
        with pytest.raises(
            ValueError, match=r"^tool_frame: 'robot' has several ends beyond 'j3': camera, hand\. .*--tool-frame"
        ):
            load(ARM + hand)
        assert load(ARM + hand, tool_frame="hand").n == 3

    def test_two_fingers_are_listed(self, load):
        fingers = link("left") + link("right") + joint("l", "jlink3", "left") + joint("r", "jlink3", "right")
        with pytest.raises(ValueError, match=r"several ends beyond 'l', 'r': left, right"):
            load(ARM + fingers)
        with pytest.raises(ValueError, match=r"several ends beyond 'j3': left, right"):
            load(ARM + fingers, locked=["l", "r"])
        assert load(ARM + fingers, tool_frame="jlink3").joint_names == ("j1", "j2", "j3")

    def test_of_two_arms_the_longer_one(self, load):
        assert load(ARM + chain(2, prefix="other")).tool_frame == "jlink3"
        with pytest.raises(ValueError, match="several ends"):
            load(ARM + chain(3, prefix="other"))
        assert load(ARM + chain(3, prefix="other"), locked=["j1"]).joint_names == ("other1", "other2", "other3")

    def test_a_locked_wrist_still_carries_the_tool(self, load):
        arm = load(ARM, locked=["j3"])
        assert (arm.tool_frame, arm.joint_names) == ("jlink3", ("j1", "j2"))

    @pytest.mark.parametrize("frame", [3, None, ["hand"], "nowhere"])
    def test_frames_that_are_none(self, load, frame):
        arm = load(ARM)
        if frame is not None:
            with pytest.raises(ValueError, match=r"^frame: (no frame|expected the name of a link or joint, got)"):
                arm.jacobian(np.zeros(3), frame)
            with pytest.raises(ValueError, match=r"^tool_frame: (no frame|expected the name of a link or joint, got)"):
                load(ARM, tool_frame=frame)


class TestNames:
    @pytest.mark.parametrize("lock", ["j1", "elbow", "j3"])
    def test_a_joint_may_have_a_links_name(self, load, lock):
        def robot(name):
            return (
                link("base") + link("l1") + link("elbow") + link("l3")
                + joint("j1", "base", "l1") + joint(name, "l1", "elbow", axis="0 1 0") + joint("j3", "elbow", "l3")
            )  # fmt: skip

        arm = load(robot("elbow"), locked={lock: 0.3})
        other = load(robot("j2"), locked={lock if lock != "elbow" else "j2": 0.3})
        assert [name.replace("elbow", "j2") for name in arm.joint_names] == list(other.joint_names)
        q = np.array([0.2, -0.4])
        np.testing.assert_array_equal(arm.mass_matrix(q), other.mass_matrix(q))
        np.testing.assert_array_equal(
            arm.forward_kinematics(q, "elbow").homogeneous, other.forward_kinematics(q, "elbow").homogeneous
        )

    def test_two_of_one_name_are_named_with_both_lines(self, load):
        with pytest.raises(ValueError, match=r"lines \d+ and \d+: two links are called 'jlink1'"):
            load(ARM + link("jlink1"))


class TestLimits:
    @pytest.mark.parametrize(
        ("lower", "upper"), [(0.5, 0.5), (0, 0), (-0.0, 0.0), (1.5707963, 1.5707964), (0.5, 0.5 + 1e-16)]
    )
    def test_no_range_is_a_joint_that_is_locked_there_and_named(self, load, caplog, lower, upper):
        text = ARM.replace('lower="-1" upper="1"', f'lower="{lower!r}" upper="{upper!r}"', 1)
        with caplog.at_level(logging.WARNING):
            arm = load(text)
        assert arm.joint_names == ("j2", "j3")
        assert "locked, since their limits leave no range: 'j1'" in caplog.text
        free = load(ARM.replace('lower="-1" upper="1"', 'lower="-4" upper="4"', 1))
        expected = free.forward_kinematics([lower, 0.1, 0.2]).homogeneous
        np.testing.assert_allclose(arm.forward_kinematics([0.1, 0.2]).homogeneous, expected, rtol=0, atol=1e-14)

    def test_no_joint_with_a_range(self, load):
        with pytest.raises(ValueError, match="no movable joint: the limits of 'j1', 'j2', 'j3' leave no range"):
            load(ARM.replace('lower="-1" upper="1"', ""))

    def test_an_arm_of_ones_own_is_refused(self, load):
        model = load(ARM).model
        model.upperPositionLimit[1] = model.lowerPositionLimit[1]
        with pytest.raises(
            ValueError, match=r"joint 'j2': expected a lower limit below the upper one, got -1 and -1; lock it"
        ):
            k1607.Arm(model, "jlink3")

    def test_locked_values_keep_to_the_limits(self, load):
        with pytest.raises(
            ValueError, match=r"locked: joint 'j2': expected a value within its limits, -1 to 1, got 1\.5"
        ):
            load(ARM, locked={"j2": 1.5})
        text = ARM.replace('lower="-1" upper="1"', 'lower="0.25" upper="1"', 1)
        at_limit, given = load(text, locked=["j1"]), load(text, locked={"j1": 0.25})
        np.testing.assert_array_equal(at_limit.frames([0, 0])[0].homogeneous, given.frames([0, 0])[0].homogeneous)

    @pytest.mark.parametrize("locked", [3, [3], {3: 0.0}, {"j1": 1j}, {"j1": [0.1]}, "nobody"])
    def test_what_cannot_be_locked(self, load, locked):
        with pytest.raises(ValueError, match=r"^locked: "):
            load(ARM, locked=locked)

    def test_one_name_needs_no_list(self, load):
        assert load(ARM, locked="j2").joint_names == ("j1", "j3")


class TestMimics:
    GRIPPER = (
        link("left") + link("right") + link("tip")
        + joint("left", "jlink3", "left", axis="1 0 0")
        + joint("right", "jlink3", "right", axis="1 0 0", extra='<mimic joint="left" multiplier="-2" offset="0.1"/>')
        + joint("tip", "right", "tip", axis="0 1 0", extra='<mimic joint="right"/>')
    )  # fmt: skip

    @pytest.mark.parametrize("angle", [0.0, 0.3, -0.2])
    def test_a_locked_gripper_follows_its_driver(self, load, angle):
        arm = load(ARM + self.GRIPPER, tool_frame="jlink3", locked={"left": angle})
        right = -2 * angle + 0.1
        plain = ARM + self.GRIPPER.replace("<mimic", "<no_mimic").replace("'mimic", "'no_mimic")
        expected = load(plain, tool_frame="jlink3", locked={"left": angle, "right": right, "tip": right})
        q = np.array([0.3, -0.2, 0.5])
        np.testing.assert_allclose(arm.mass_matrix(q), expected.mass_matrix(q), rtol=0, atol=1e-15)
        np.testing.assert_allclose(arm.gravity_torque(q), expected.gravity_torque(q), rtol=0, atol=1e-15)

    def test_beyond_its_limits_a_follower_is_held_there_and_named(self, load, caplog):
        with caplog.at_level(logging.WARNING):
            load(ARM + self.GRIPPER, tool_frame="jlink3", locked={"left": 0.9})
        assert "joint 'right' follows 'left' to -1.7, beyond its limits: held at -1" in caplog.text

    @pytest.mark.parametrize("driver", ["nobody", "right", "tip"])
    def test_a_follower_of_nobody_or_in_a_circle_stands_at_zero(self, load, driver):
        gripper = self.GRIPPER.replace('joint="left" multiplier="-2" offset="0.1"', f'joint="{driver}"')
        assert load(ARM + gripper, tool_frame="jlink3").n == 3


class TestInertias:
    @pytest.mark.parametrize(
        ("inertial", "said"),
        [
            ('<mass value="-1"/>' + INERTIA(1, 1, 1), "expected a mass >= 0 in kg, got -1"),
            ('<mass value="1"/>' + INERTIA(-1, 1, 1), "no body has the principal moments -1, 1, 1"),
            ('<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="2" ixz="0" iyz="0"/>', "one is negative"),
            ('<mass value="3,0"/>' + INERTIA(1, 1, 1), "<mass value>: expected a finite number, got '3,0'; write a point"),
            ("<mass>3.0</mass>" + INERTIA(1, 1, 1), '<mass> needs the attribute \'value\', as in <mass value="3.0"/>'),
            ('<mass value="nan"/>' + INERTIA(1, 1, 1), "expected a finite number, got 'nan'"),
            ('<mass value="1e400"/>' + INERTIA(1, 1, 1), "expected a finite number, got '1e400'"),
            ('<mass value="1e12"/>' + INERTIA(1, 1, 1), "expected a finite number up to 1e+09"),
            ('<mass value="1"/>' + INERTIA(1, "inf", 1), "expected a finite number, got 'inf'"),
            ('<mass value="1"/><inertia ixx="1" iyy="1" izz="1"/>', "<inertia> needs the attribute 'ixy'"),
            ('<mass value="1"/>', "expected one <inertia> in <inertial>, got 0"),
            (INERTIA(1, 1, 1), "expected one <mass> in <inertial>, got 0"),
            ('<origin xyz="0 0"/><mass value="1"/>' + INERTIA(1, 1, 1), "<origin xyz>: expected 3 finite numbers, got '0 0'"),
        ],
    )  # fmt: skip
    def test_what_no_body_has_is_refused_with_link_and_line(self, load, inertial, said):
        text = ARM.replace(BODY, "ELBOW", 3).replace("ELBOW", BODY, 2).replace("ELBOW", inertial)
        with pytest.raises(ValueError, match="path: ") as error:
            load(text)
        assert said in str(error.value)
        assert "robot.urdf, line 10, link 'jlink2'" in str(error.value)

    def test_as_it_is(self, load):
        """Then Pinocchio has the file as it stands, and leaves out what it cannot read."""
        text = ARM.replace('<mass value="1"/>', "<mass>3.0</mass>")
        assert load(text, check_inertia=False).n == 3
        heavy = load(ARM.replace('<mass value="1"/>', '<mass value="-1"/>'), check_inertia=False)
        assert heavy.model.inertias[1].mass == -1

    @pytest.mark.parametrize(
        ("moments", "told"), [((1, 1, 3), True), ((1, 1, 2.1), True), ((1, 1, 2.0005), False), ((0, 1, 1), False)]
    )
    def test_moments_that_break_the_triangle_are_told(self, load, caplog, moments, told):
        text = ARM.replace(INERTIA(0.1, 0.1, 0.1), INERTIA(*moments))
        with caplog.at_level(logging.WARNING):
            load(text)
        assert ("line 6, link 'jlink1': no body has the principal moments" in caplog.text) == told
        assert "'base'" not in caplog.text  # which does not move
        caplog.clear()
        load(text, check_inertia=False)
        assert not caplog.text

    def test_what_does_not_move_may_weigh_what_it_likes(self, load):
        assert load(ARM.replace('<mass value="1"/>', '<mass value="-1"/>', 1)).n == 3

    def test_an_inertia_without_mass_is_told(self, load, caplog):
        load(ARM.replace('<mass value="1"/>', '<mass value="0"/>'))
        assert "no body has an inertia and no mass" in caplog.text


class TestJoints:
    @pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
    def test_an_axis_without_direction_is_refused_with_joint_and_line(self, load, kind):
        text = link("base") + link("a") + joint("turn", "base", "a", kind, axis="0 0 0")
        with pytest.raises(ValueError, match=r"line 8, joint 'turn': expected an axis with a direction, got '0 0 0'"):
            load(text)

    def test_a_fixed_joints_axis_is_nobodys_business(self, load):
        assert load(ARM + '<link name="end"/>' + joint("end", "jlink3", "end", "fixed", axis="0 0 0")).n == 3

    @pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
    @pytest.mark.parametrize("axis", ["0 0 2", "1 1 2", "1e-3 0 0", "0.577 0.577 0.577", "0 -1 0"])
    def test_an_axis_of_any_length_is_a_direction(self, load, kind, axis):
        arm = load(link("base") + link("a") + joint("j", "base", "a", kind, axis=axis))
        direction = np.array(axis.split(), dtype=float)
        direction /= np.linalg.norm(direction)
        part = slice(0, 3) if kind == "prismatic" else slice(3, 6)
        np.testing.assert_allclose(arm.jacobian([0.3])[part, 0], direction, rtol=0, atol=1e-15)
        R = arm.forward_kinematics([0.3]).rotation
        np.testing.assert_allclose(R @ R.T, np.eye(3), rtol=0, atol=1e-15)

    @pytest.mark.parametrize(
        ("old", "new", "said"),
        [
            ('lower="-1"', 'lower="-1,0"', "<limit lower>: expected a finite number, got '-1,0'; write a point"),
            ('velocity="2"', 'velocity="fast"', "<limit velocity>: expected a finite number, got 'fast'"),
            ('xyz="0 0.1 0.3"', 'xyz="0 0.1 nan"', "<origin xyz>: expected 3 finite numbers"),
            ('xyz="0 0.1 0.3"', 'xyz="0 0.1 1e300"', "<origin xyz>: expected 3 finite numbers up to 1e+09"),
            ('<axis xyz="0 0 1"/>', '<axis xyz="0,0,1"/>', "<axis xyz>: expected 3 finite numbers"),
        ],
    )
    def test_numbers_that_are_none_are_named_with_joint_and_line(self, load, old, new, said):
        with pytest.raises(ValueError, match=r"robot\.urdf, line 8, joint 'j1': ") as error:
            load(ARM.replace(old, new, 1))
        assert said in str(error.value)

    def test_a_link_that_two_joints_carry(self, load):
        with pytest.raises(
            ValueError, match=r"line 17, joint 'again': the link 'jlink2' is carried .* 'j2' already, in line 12"
        ):
            load(ARM + joint("again", "base", "jlink2"))

    def test_links_that_carry_each_other(self, load):
        loop = joint("there", "a", "b") + joint("back", "b", "a")
        with pytest.raises(ValueError, match=r"joint '(there|back)': links carry each other in a circle"):
            load(ARM + '<link name="a"/><link name="b"/>' + loop)

    @pytest.mark.parametrize("name", ["damping", "friction"])
    def test_friction_that_drives_is_refused(self, load, name):
        with pytest.raises(ValueError, match=rf"line 8, joint 'j1': expected {name} >= 0, got '-0.1'"):
            load(ARM.replace("</joint>", f'<dynamics {name}="-0.1"/></joint>', 1))

    @pytest.mark.parametrize("look", ["<visual/>", '<collision><geometry><box size="1,0 1 1"/></geometry></collision>'])
    def test_looks_that_cannot_be_read_are_told(self, load, caplog, look):
        with caplog.at_level(logging.WARNING):
            assert load(ARM.replace("</link>", f"{look}</link>")).model == load(ARM).model
        assert "a part is left out: " in caplog.text

    @pytest.mark.parametrize("folders", [3, [3], None])
    def test_folders_that_are_none(self, load, folders, tmp_path):
        with pytest.raises(ValueError, match="package_dirs: expected folders"):
            load(ARM, package_dirs=folders)
        assert load(ARM, package_dirs=str(tmp_path)).n == 3

    def test_what_urdfdom_says_is_in_the_message(self, load, capfd):
        with pytest.raises(ValueError, match=r"path: Pinocchio cannot read .*joint \[j1\]: limit has no effort"):
            load(ARM.replace('effort="10"', "", 1))
        assert not capfd.readouterr().err

    def test_friction_is_the_plants_and_the_load_says_so_once(self, load, caplog):
        text = ARM.replace("</joint>", '<dynamics damping="0.3" friction="0.2"/></joint>', 2).replace(
            "robot", "rubbing"
        )
        arm = load(text, '<robot name="rubbing">')
        load(text, '<robot name="rubbing">')
        assert caplog.text.count("Plant.from_description(arm)") == 1
        plant = Plant.from_description(arm, torque_limit=np.full(3, 5.0))
        np.testing.assert_array_equal(plant.viscous, [0.3, 0.3, 0])
        np.testing.assert_array_equal(plant.coulomb, [0.2, 0.2, 0])
        np.testing.assert_array_equal(plant.torque_limit, 5)
        v = np.array([1.0, -2.0, 3.0])
        np.testing.assert_allclose(plant.loss_torque(np.zeros(3), v), [0.5, -0.8, 0], rtol=0, atol=1e-15)
        assert not Plant(arm).viscous.any()
        with pytest.raises(ValueError, match="arm: expected an Arm"):
            Plant.from_description(plant)

    @pytest.mark.parametrize("locked", [(), ("j1",)])
    def test_friction_stays_with_its_joint(self, load, locked):
        text = ARM.replace("</joint>", '<dynamics damping="0.3" friction="0.2"/></joint>').replace(
            '0.3" f', '0.4" f', 1
        )
        text = text.replace('"revolute"', '"continuous"')
        np.testing.assert_array_equal(load(text, locked=locked).damping, [0.4, 0.3, 0.3][len(locked) :])


class TestText:
    def test_prefixes_that_nobody_declared(self, load):
        assert load(ARM + '<gazebo:plugin sensor:type="x"><a:b/></gazebo:plugin>').n == 3

    def test_a_namespace_by_default(self, load):
        """Pinocchio's parser reads names, not namespaces; what stands there is looked at all the same."""
        head = '<robot name="r" xmlns="http://a.b/c" xmlns:x="http://d.e">'
        assert load(ARM + "<x:link/>", head).n == 3
        with pytest.raises(ValueError, match="link 'jlink1': expected a mass >= 0"):
            load(ARM.replace('<mass value="1"/>', '<mass value="-1"/>'), head)

    @pytest.mark.parametrize("encoding", ["utf-8", "UTF-8", "iso-8859-1", "utf-16", "us-ascii", "cp1252"])
    def test_encodings_that_python_knows(self, tmp_path, encoding):
        path = tmp_path / "robot.urdf"
        name = "arm" if encoding == "us-ascii" else "Bögli"
        text = f'<?xml version="1.0" encoding="{encoding}"?>\n<robot name="{name}">{ARM}</robot>'
        path.write_bytes(text.encode(encoding))
        assert k1607.load_urdf(path).name == name

    @pytest.mark.parametrize("encoding", ["utf-9", "klingon", "", "rot13", "base64"])
    def test_encodings_that_nobody_knows(self, load, encoding):
        with pytest.raises(ValueError, match=r"path: Pinocchio cannot read .*(unknown encoding|not an encoding)"):
            load(ARM, f'<?xml version="1.0" encoding="{encoding}"?><robot name="r">')

    def test_bytes_that_are_no_text(self, tmp_path):
        (tmp_path / "a.urdf").write_bytes(b'<robot name="\xff\xfe\xfa">')
        with pytest.raises(ValueError, match=r"path: Pinocchio cannot read .*it is not utf-8"):
            k1607.load_urdf(tmp_path / "a.urdf")

    def test_entities_are_not_expanded(self, load):
        laughs = '<!DOCTYPE r [<!ENTITY a "ha">' + "".join(
            f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(12)
        )
        for entities in (laughs + "]>", '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]>'):
            with pytest.raises(ValueError, match="declares the entity 'a': write out what it stands for"):
                load(ARM + "<b>&a;</b>", f'{entities}<robot name="r">')
        with pytest.raises(ValueError, match="path: Pinocchio cannot read"):
            load(ARM + "<b>&nobody;</b>")

    @pytest.mark.parametrize("depth", [200, 10_000])
    def test_depth_is_bounded(self, load, depth):
        with pytest.raises(ValueError, match=r"path: Pinocchio cannot read .*(at most 100 elements within|depth)"):
            load(ARM + "<a>" * depth + "</a>" * depth)

    @pytest.mark.parametrize(
        ("n", "kind", "said"),
        [(400, "revolute", "at most 150 movable joints"), (5000, "fixed", "at most 1,000 links")],
    )
    def test_size_is_bounded(self, load, n, kind, said):
        text = link("l0") + "".join(link(f"l{i}") + joint(f"j{i}", f"l{i - 1}", f"l{i}", kind) for i in range(1, n + 1))
        with pytest.raises(ValueError, match=said):
            load(text)

    @pytest.mark.parametrize(
        "text", [b"", b"\x00", b"<", b"<robot", b"<?xml?>", b"<!DOCTYPE robot>", b"\xff\xfe", b"<!-- -->"]
    )
    def test_no_urdf_at_all(self, tmp_path, text):
        (tmp_path / "a.urdf").write_bytes(text)
        with pytest.raises(ValueError, match="path: Pinocchio cannot read"):
            k1607.load_urdf(tmp_path / "a.urdf")

    @pytest.mark.parametrize("path", [None, 3, ["a.urdf"], "a\0b"])
    def test_no_path(self, path):
        with pytest.raises(ValueError, match=r"^path: "):
            k1607.load_urdf(path)

    def test_standard_error_of_others_is_passed_on_and_a_closed_one_is_no_obstacle(self, load, tmp_path):
        load(ARM)
        script = f"import os, k1607_pin; os.close(2); print(k1607_pin.load_urdf({str(tmp_path / 'robot.urdf')!r}).n)"
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        assert done.stdout.strip() == "3"

    def test_a_child_of_a_fork_loads_while_another_thread_of_the_parent_does(self, load, tmp_path):
        load(ARM)
        script = f"""
import os, threading, warnings
import k1607_pin
from k1607_pin.arm.urdfdom import heard
warnings.simplefilter("ignore")
inside, done = threading.Event(), threading.Event()
thread = threading.Thread(target=heard, args=(lambda: (inside.set(), done.wait()),))
thread.start()
inside.wait()
child = os.fork()
if child == 0:
    os.write(2, b"heard from the child")
    os._exit(k1607_pin.load_urdf({str(tmp_path / "robot.urdf")!r}).n)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
done.set()
thread.join()
"""
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        assert done.stdout.strip() == "3"
        assert "heard from the child" in done.stderr

    def test_what_others_say_meanwhile_is_passed_on(self, capfd):
        from k1607_pin.arm.urdfdom import heard

        result, said = heard(lambda: os.write(2, b"Error:   lost\n         at line 3 in x.cpp\nmine\nWarning: odd\n"))
        assert said == ["lost", "odd"]
        assert capfd.readouterr().err == "mine\n"
        assert result > 0
