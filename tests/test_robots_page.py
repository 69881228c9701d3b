"""docs/robots.md says what happens: a part of its rows made again, and no robot of example-robot-data left out."""

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LINES = (ROOT / "docs" / "robots.md").read_text(encoding="utf-8").splitlines()


@pytest.fixture(scope="module")
def robots():
    spec = importlib.util.spec_from_file_location("robots", ROOT / "benchmarks" / "robots.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["double_pendulum", "finger_edu", "solo8", "talos_arm", "ur10_limited"])
def test_an_examples_row(robots, name):
    (row,) = robots.examples([name])
    assert str(row) in LINES


def test_every_example_has_its_row():
    from example_robot_data.robots_loader import ROBOTS

    listed = [line.split("`")[1] for line in LINES if line.startswith("| `")]
    assert listed == sorted(ROBOTS)


@pytest.mark.parametrize("kind", ["urdfs", "tables"])
def test_rows_of_shapes(robots, kind):
    rows = [str(row) for row in getattr(robots, kind)()]
    assert len(rows) == len(robots.URDFS if kind == "urdfs" else robots.TABLES)
    assert [row for row in rows if row not in LINES] == []


def test_no_folder_of_a_machine_is_in_it():
    assert not [line for line in LINES if "/tmp/" in line or "site-packages" in line or "share/" in line]
