"""Robots on the command line: which frame is the tool, which joints stand still, and files that are written where they belong."""

import os

import pytest
from typer.testing import CliRunner

from k1607_pin.cli import app
from k1607_pin.cli.app import robot_called
from k1607_pin.files import plain_name

FORK = """<robot name="fork"><link name="base"/><link name="a"/><link name="left"/><link name="right"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="l" type="prismatic"><parent link="a"/><child link="left"/><axis xyz="0 1 0"/>
<limit lower="0.01" upper="0.04" effort="1" velocity="1"/></joint>
<joint name="r" type="prismatic"><parent link="a"/><child link="right"/><axis xyz="0 1 0"/>
<limit lower="0.01" upper="0.04" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture
def fork(tmp_path):
    (tmp_path / "fork.urdf").write_text(FORK)
    return str(tmp_path / "fork.urdf")


def run(*arguments):
    return CliRunner().invoke(app, list(arguments))


class TestRobotCalled:
    def test_tool_frame_and_locks(self, fork):
        arm = robot_called(fork, tool_frame="left", lock=["turn=30deg"])
        assert arm.joint_names == ("l",)
        assert arm.jacobian([0.02])[0, 0] == pytest.approx(-0.5, rel=1e-15)

    @pytest.mark.parametrize(("text", "y"), [("l", 0.01), ("l=30mm", 0.03), ("l=0.02m", 0.02), ("l=1.5cm", 0.015)])
    def test_values_have_units(self, fork, text, y):
        arm = robot_called(fork, tool_frame="left", lock=[text])
        assert arm.forward_kinematics([0.0]).translation[1] == pytest.approx(y, rel=1e-15)

    @pytest.mark.parametrize("text", ["turn=30", "turn=", "turn=deg", "turn=1e", "turn=1,5deg", "turn=5mi", "=", ""])
    def test_values_without_are_refused(self, fork, text):
        with pytest.raises(ValueError, match=r"^(--lock: expected NAME|locked: no joint)"):
            robot_called(fork, tool_frame="left", lock=[text])

    def test_the_k1607_keeps_its_armature(self):
        whole, arm = robot_called("k1607"), robot_called("k1607", tool_frame="tool_plate", lock=["joint3=10deg"])
        assert arm.tool_frame == "tool_plate"
        assert list(arm.armature) == [x for i, x in enumerate(whole.armature) if i != 2]


@pytest.mark.parametrize("command", [["view"], ["export", "out"], ["bench"], ["simulate"]])
class TestCommands:
    def test_candidates_are_listed(self, fork, command):
        done = run(*command, "--robot", fork)
        assert isinstance(done.exception, ValueError)
        assert "several ends beyond 'l', 'r': left, right" in str(done.exception)
        assert "before them: a. " in str(done.exception)

    def test_options_are_heard(self, fork, command):
        done = run(*command, "--robot", fork, "--tool-frame", "left", "--lock", "l=5deg")
        assert "joint 'l': expected a value within its limits, 0.01 to 0.04" in str(done.exception)


def test_a_page_of_a_named_tool(fork, tmp_path):
    done = run("view", "--robot", fork, "--tool-frame", "left", "--lock", "l", "--html", str(tmp_path / "a.html"))
    assert done.exit_code == 0, done.exception
    assert (tmp_path / "a.html").exists()


DH = '[dh]\nunits = { length = "m", angle = "deg" }\nrows = [[0, 0, 0.3], [-90, 0.1, 0]]\n'


@pytest.mark.parametrize(
    "name",
    [
        "../../escaped",
        "/tmp/escaped",
        "a/b",
        "..",
        ".hidden",
        "a\\\\b",
        " ",
        "",
        "a\\u0000b",
        "a\\nb",
        "x" * 300,
        "C:x",
    ],
)
def test_a_name_in_a_file_names_no_other_place(tmp_path, monkeypatch, name):
    (tmp_path / "deep" / "er").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "deep" / "er")
    (tmp_path / "deep" / "er" / "a.toml").write_text(f'name = "{name}"\n{DH}')
    before = sorted(path for path in tmp_path.rglob("*"))
    done = run("urdf", "--dh", "a.toml")
    assert isinstance(done.exception, ValueError)
    assert "name" in str(done.exception)
    assert sorted(path for path in tmp_path.rglob("*")) == before


def test_a_plain_name_is_one_in_any_language(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text(f'name = "Bögli 2.0"\n{DH}', encoding="utf-8")
    assert run("urdf", "--dh", "a.toml").exit_code == 0
    assert "Bögli 2.0.urdf" in os.listdir(tmp_path)
    assert plain_name("a.b") == "a.b"


@pytest.mark.parametrize("content", [b"\xff\xfe", b"a = " + b"[" * 5000, b"name = ", b"dh = 3", None])
def test_a_table_that_cannot_be_read_is_named(tmp_path, content):
    if content is None:
        (tmp_path / "a.toml").mkdir()
    else:
        (tmp_path / "a.toml").write_bytes(content)
    done = run("urdf", "--dh", str(tmp_path / "a.toml"))
    assert isinstance(done.exception, ValueError)
    assert str(done.exception).startswith(("--dh: ", "D-H table: expected a table"))
