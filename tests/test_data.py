import re
from importlib.resources import files

import numpy as np
import pytest

from k1607_pin import data
from k1607_pin.description.inertia import assemble

NAMES = sorted(entry.name.removesuffix(".toml") for entry in files(data).iterdir() if entry.name.endswith(".toml"))


def test_the_data_files_are_found():
    assert {"k1607", "k1607_modules", "kraft_hand_controller", "published"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_fact_has_a_standing_and_a_source(name):
    facts = list(data.facts(name))
    assert facts
    for path, _, standing, source in facts:
        assert standing in data.STANDINGS, path
        assert isinstance(source, str), path
        assert len(source) > 20, f"{path}: {source!r} names no source"


@pytest.mark.parametrize("name", NAMES)
def test_facts_leaves_nothing_out(name):
    """Each key of the file's text appears on a path, but for the four words that describe facts."""
    text = re.sub(r"#.*", "", files(data).joinpath(f"{name}.toml").read_text(encoding="utf-8"))
    keys = set(re.findall(r"^(\w+)\s*=", text, flags=re.MULTILINE)) - {"standing", "source", "name", "caveat"}
    assert keys
    assert keys <= {part for path, *_ in data.facts(name) for part in path.split(".")}


def test_a_table_inside_says_otherwise():
    standings = {path: standing for path, _, standing, _ in data.facts("k1607_modules")}
    assert standings["distal_izz.J3_lb_in_s2"] == "published"
    assert standings["distal_izz.suspect.J5_lb_in_s2"] == "suspect"
    assert standings["tool_base.mass_kg"] == "assumed"


def test_table_1_as_printed():
    dh = data.load("k1607")["dh"]
    assert dh["units"] == {"length": "in", "angle": "deg"}
    assert dh["rows"] == [
        [0, 0.000, 0.0],
        [-90, 0.000, 0.0],
        [90, 5.625, 27.0],
        [-90, 4.250, 0.0],
        [90, -4.250, 27.0],
        [-90, 3.125, 0.0],
        [90, -3.125, 0.0],
    ]


def test_every_list_of_the_arm_has_one_entry_a_joint():
    facts = data.load("k1607")
    lists = [facts["limits"][k] for k in ("position_deg", "velocity_deg_s", "effort_N_m")]
    lists += [facts["armature"]["inertia_kg_m2"], *(v for v in facts["friction"].values() if isinstance(v, list))]
    assert [len(x) for x in lists] == [7] * 6


def test_module_assembly_against_the_table_worked_out_by_hand():
    """To half of that table's last digit; its diagonals, sums of parts that were rounded already, to one."""
    check, links = data.load("k1607_modules")["check"], assemble()
    mass = np.array([link.mass for link in links])
    np.testing.assert_allclose(mass, check["mass_kg"], rtol=0, atol=5e-5)
    assert abs(mass.sum() - check["total_kg"]) < 0.06  # printed to 0.1 kg
    np.testing.assert_allclose([link.cg for link in links], check["cg_m"], rtol=0, atol=5e-6)
    diagonal = [np.diag(link.inertia) for link in links]
    np.testing.assert_allclose(diagonal, check["ixx_iyy_izz_kg_m2"], rtol=0, atol=1e-5)
    products = [link.inertia[[0, 0, 1], [1, 2, 2]] for link in links]
    np.testing.assert_allclose(products, check["ixy_ixz_iyz_kg_m2"], rtol=0, atol=5e-6)


def test_modules_weigh_what_the_links_weigh():
    """The tool base moves half a kilogram from one link to the next: nothing is lost or weighed twice."""
    source = data.load("k1607_modules")
    used = [part["module"] for parts in source["assembly"]["links"] for part in parts]
    assert sorted(used) == sorted(source["modules"])
    pounds = sum(module["mass_lb"] for module in source["modules"].values())
    assert sum(link.mass for link in assemble()) == pytest.approx(pounds * 0.45359237, abs=1e-12)


def test_unknown_file():
    with pytest.raises(FileNotFoundError, match=r"no_such\.toml"):
        data.load("no_such")
