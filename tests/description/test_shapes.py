import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin import data
from k1607_pin.description.description import k1607
from k1607_pin.description.dh import DHTable
from k1607_pin.description.shapes import shapes_from, shapes_from_dh

ROWS = st.lists(
    st.tuples(st.floats(-np.pi, np.pi), st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=9
)  # fmt: skip


def assert_drawable(shapes, links):
    for shape in shapes:
        assert shape.link in links
        assert min(shape.size) > 0
        assert all(0 <= x <= 1 for x in shape.rgba)
        R = shape.pose[:3, :3]
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(R) == pytest.approx(1, abs=1e-14)


def test_the_k1607_is_drawable():
    shapes = k1607().shapes
    assert_drawable(shapes, {"base", *(f"link{i}" for i in range(1, 8))})
    assert {shape.link for shape in shapes} == {"base", *(f"link{i}" for i in range(1, 8))}
    reach = max(np.linalg.norm(shape.pose[:3, 3]) for shape in shapes)
    assert 0.3 < reach < 1.0  # metres, not inches


def test_mirror_repeats_on_the_other_side():
    table = data.load("k1607")["shapes"]
    mirrored = sum("mirror" in entry for entry in table["list"])
    assert len(shapes_from(table)) == len(table["list"]) + mirrored
    entry = {"part": "p", "link": "l", "box": [1.0, 2.0, 3.0], "at": [0.1, 0.2, 0.3], "mirror": "y"}
    one, other = shapes_from({"units": "m", "list": [entry], "colours": {"p": [0, 0, 0, 1]}})
    np.testing.assert_array_equal(one.pose[:3, 3], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(other.pose[:3, 3], [0.1, -0.2, 0.3])


@pytest.mark.parametrize(("along", "axis"), [("x", 0), ("y", 1), ("z", 2)])
def test_a_cylinder_lies_along_its_axis(along, axis):
    entry = {"part": "p", "link": "l", "cylinder": [1.0, 2.0], "along": along, "at": [0, 0, 0]}
    (shape,) = shapes_from({"units": "m", "list": [entry], "colours": {"p": [0, 0, 0, 1]}})
    assert shape.is_cylinder
    np.testing.assert_array_equal(shape.pose[:3, 2], np.eye(3)[axis])


@given(rows=ROWS)
def test_any_table_is_drawable(rows):
    table = DHTable.from_rows(rows)
    shapes = shapes_from_dh(table)
    assert_drawable(shapes, {"base", *(f"link{i}" for i in range(1, table.n + 1))})
    # a bar runs from its joint to the next: its two ends, along its own z, are the two origins
    origins = table.placements()[:, :3, 3]
    for shape in shapes:
        if shape.part == "body":
            i = int(shape.link.removeprefix("link"))
            half = shape.pose[:3, 2] * shape.size[1] / 2
            np.testing.assert_allclose(shape.pose[:3, 3] - half, 0, atol=1e-14)
            np.testing.assert_allclose(shape.pose[:3, 3] + half, origins[i], atol=1e-14)
