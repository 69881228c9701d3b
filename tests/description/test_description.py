import copy
import tomllib
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin import data
from k1607_pin.description.description import from_mapping, k1607
from k1607_pin.kinematics import product

BODY = {"mass_kg": 2.0, "cg_m": [0.0, 0.1, 0.0], "inertia_kg_m2": [0.02, 0.03, 0.04, 0.0, 0.001, 0.0]}
GOOD = {
    "name": "two",
    "dh": {"rows": [[0, 0, 0.1], [90, 0.2, 0]], "units": {"length": "m", "angle": "deg"}},
    "limits": {"position_deg": [[-90, 90], [0, 120]], "velocity_deg_s": [90, 180], "effort_N_m": [10, 5]},
    "link": [dict(BODY), dict(BODY)],
}


def changed(path, value):
    """GOOD with the entry at ``path`` replaced."""
    table = copy.deepcopy(GOOD)
    *way, last = path
    inner = table
    for key in way:
        inner = inner[key]
    inner[last] = value
    return table


def without(path):
    table = changed(path, None)
    *way, last = path
    inner = table
    for key in way:
        inner = inner[key]
    del inner[last]
    return table


def test_a_good_table():
    arm = from_mapping(GOOD)
    assert (arm.name, arm.dh.n) == ("two", 2)
    np.testing.assert_allclose(arm.lower, [-np.pi / 2, 0], rtol=1e-15)
    np.testing.assert_allclose(arm.upper, [np.pi / 2, 2 * np.pi / 3], rtol=1e-15)
    np.testing.assert_allclose(arm.velocity, [np.pi / 2, np.pi], rtol=1e-15)
    np.testing.assert_array_equal(arm.effort, [10, 5])
    np.testing.assert_array_equal(arm.links[1].inertia, [[0.02, 0, 0.001], [0, 0.03, 0], [0.001, 0, 0.04]])
    assert {shape.link for shape in arm.shapes} <= {"base", "link1", "link2"}


def test_geometry_alone_is_enough():
    arm = from_mapping({"dh": GOOD["dh"]})
    assert arm.links is None
    assert (arm.lower < arm.upper).all()
    assert arm.frames == {"tool": 0.0}


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("table", "row", "column"),
    [
        (changed(["link", 1, "mass_kg"], -2.0), "row 2", "mass_kg"),
        (changed(["link", 1, "mass_kg"], 0.0), "row 2", "mass_kg"),
        (changed(["link", 0, "mass_kg"], NAN), "row 1", "mass_kg"),
        (changed(["link", 0, "mass_kg"], "heavy"), "row 1", "mass_kg"),
        (changed(["link", 0, "mass_kg"], [1.0]), "row 1", "mass_kg"),
        (changed(["link", 1, "cg_m"], [0.0, 0.0]), "row 2", "cg_m"),
        (changed(["link", 1, "cg_m"], [0.0, INF, 0.0]), "row 2", "cg_m"),
        (changed(["link", 0, "inertia_kg_m2"], [0.01, 0.01, 0.03, 0, 0, 0]), "row 1", "inertia_kg_m2"),
        (changed(["link", 1, "inertia_kg_m2"], [0.02, 0.03, -0.04, 0, 0, 0]), "row 2", "inertia_kg_m2"),
        (changed(["link", 1, "inertia_kg_m2"], [0.02, 0.03, 0.04, 0.1, 0, 0]), "row 2", "inertia_kg_m2"),
        (changed(["link", 1, "inertia_kg_m2"], [0.02, 0.03, 0.04]), "row 2", "inertia_kg_m2"),
        (changed(["link", 1, "inertia_kg_m2"], [0.02, 0.03, NAN, 0, 0, 0]), "row 2", "inertia_kg_m2"),
        (changed(["limits", "position_deg", 1], [120, 0]), "row 2", "position_deg"),
        (changed(["limits", "position_deg", 1], [90, 90]), "row 2", "position_deg"),
        (changed(["limits", "position_deg", 1], [NAN, 90]), "row 2", "position_deg"),
        (changed(["limits", "velocity_deg_s", 0], 0.0), "row 1", "velocity_deg_s"),
        (changed(["limits", "velocity_deg_s", 1], INF), "row 2", "velocity_deg_s"),
        (changed(["limits", "effort_N_m", 1], -5.0), "row 2", "effort_N_m"),
        (without(["link", 1, "mass_kg"]), "row 2", "mass_kg"),
        (without(["link", 0, "cg_m"]), "row 1", "cg_m"),
        (without(["link", 0, "inertia_kg_m2"]), "row 1", "inertia_kg_m2"),
        (changed(["dh", "rows", 1], [90, NAN, 0]), "row 2", "a"),
    ],
)
def test_what_is_wrong_is_named_with_row_and_column(table, row, column):
    with pytest.raises(ValueError, match=f"{row}.*'{column}'"):
        from_mapping(table)


@pytest.mark.parametrize(
    ("table", "named"),
    [
        (without(["dh"]), "'dh'"),
        ({}, "'dh'"),
        (changed(["limits", "position_deg"], [[-90, 90]]), "position_deg"),
        (changed(["limits", "position_deg"], [[-90, 90], [0]]), "position_deg"),
        (changed(["limits", "velocity_deg_s"], [90]), "velocity_deg_s"),
        (changed(["limits", "effort_N_m"], [1, 2, 3]), "effort_N_m"),
        (changed(["link"], [BODY]), "expected 2 tables"),
        (changed(["dh", "units", "length"], "furlong"), "furlong"),
    ],
)
def test_what_is_missing_or_of_wrong_length_is_named(table, named):
    with pytest.raises(ValueError, match=named):
        from_mapping(table)


def test_the_k1607():
    arm = k1607()
    assert arm.name == "k1607"
    assert arm.frames["tool"] == 0
    assert arm.frames["tool_plate"] == pytest.approx(6.6 * 0.0254, rel=1e-15)
    assert len(arm.links) == arm.dh.n == 7
    assert (arm.lower < arm.upper).all()
    assert (arm.velocity > 0).all()
    assert (arm.effort > 0).all()
    # SAL 1.70: the roll modules stand mid-range in the zero pose, and the elbow and wrist pitch at full extension
    np.testing.assert_array_equal(arm.lower[[0, 2, 4, 6]], -arm.upper[[0, 2, 4, 6]])
    np.testing.assert_array_equal(arm.lower[[3, 5]], 0)


@pytest.fixture(scope="module")
def kraft():
    return tomllib.loads(files(data).joinpath("kraft_hand_controller.toml").read_text(encoding="utf-8"))


def test_kraft_hand_controller(kraft):
    """Its nominal posture puts the handle where the source has it, and lies within the limits."""
    arm = from_mapping(kraft)
    assert (arm.name, arm.dh.n, arm.links) == ("kraft_hand_controller", 6, None)
    q = np.deg2rad(kraft["posture"]["nominal_deg"])
    handle = product.forward_kinematics(arm.dh, q)[:3, 3]
    np.testing.assert_allclose(handle, kraft["posture"]["handle_at_nominal_m"], rtol=0, atol=1e-15)
    assert ((arm.lower < q) & (q < arm.upper)).all()


@given(row=st.integers(0, 5), column=st.integers(0, 2), step=st.floats(1e-3, 1))
def test_kraft_handle_depends_on_every_length(kraft, row, column, step):
    """Or the test above would miss a wrong number: only lengths along the last axes leave the handle's height alone."""
    table = copy.deepcopy(kraft)
    table["dh"]["rows"][row][column] += step
    q = np.deg2rad(kraft["posture"]["nominal_deg"])
    handle = product.forward_kinematics(from_mapping(table).dh, q)[:3, 3]
    moved = np.linalg.norm(handle - kraft["posture"]["handle_at_nominal_m"])
    if column:
        assert moved == pytest.approx(step, abs=1e-14)
