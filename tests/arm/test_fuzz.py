"""Thousands of descriptions with something wrong: each is an arm with finite numbers, or a ValueError."""

import copy
import random
import warnings
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.description import description
from k1607_pin.description.urdf import to_urdf

INERTIAL = (
    '<inertial><origin xyz="0.1 0 0.05" rpy="0 0.2 0"/><mass value="1.5"/>'
    '<inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
)
SOUND = f"""<?xml version="1.0"?>
<robot name="sound">
<link name="base">{INERTIAL}</link>
<link name="upper">{INERTIAL}<visual><geometry><cylinder radius="0.1" length="0.5"/></geometry></visual></link>
<link name="fore">{INERTIAL}<collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision></link>
<link name="hand">{INERTIAL}</link>
<link name="finger">{INERTIAL}</link>
<link name="tip"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.3" rpy="0 1.57 0"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="50" velocity="2"/><dynamics damping="0.3" friction="0.1"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.4"/>
<axis xyz="0 1 0"/><limit effort="50" velocity="2"/></joint>
<joint name="wrist" type="prismatic"><parent link="fore"/><child link="hand"/><origin xyz="0.2 0 0"/>
<axis xyz="0.6 0 0.8"/><limit lower="0" upper="0.5" effort="50" velocity="2"/></joint>
<joint name="grip" type="revolute"><parent link="upper"/><child link="finger"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1" effort="5" velocity="1"/><mimic joint="shoulder" multiplier="0.5" offset="0.1"/></joint>
<joint name="mount" type="fixed"><parent link="hand"/><child link="tip"/><origin xyz="0 0 0.1"/></joint>
</robot>
"""
WORDS = (
    "0", "-1", "1e-320", "1e300", "1e9", "-1e-9", "nan", "inf", "1,5", "", " ", "0 0 0", "1 2", "0x1", "1e", "+.5", "--1",
    "base", "tip", "shoulder", "nobody", "fixed", "planar", "floating", "revolute", "prismatic", "continuous", "spherical",
    "&lt;", "&x;", "é", "\t1", "1 ", "true", "9" * 400, "package://x/y.stl", "../../x",
)  # fmt: skip
NUMBERS = ("0", "1", "-1", "0.3", "2e-3", "1e-12", "1e-320", "1e5", "999999999", "1e9", "-1e-9", "3.14159265358979")
PIECES = (
    "<", ">", '"', "/>", "</link>", "</joint>", "<link name='x'/>", "<mimic joint='elbow'/>", "\x00", "<!--", "]]>", "<?x",
    "<!DOCTYPE a [<!ENTITY x 'y'>]>", "<a:b c:d='1'/>", INERTIAL, "<mass value='2'/>", "<axis xyz='0 0 0'/>", "<robot>", "\ufffe",
    "<mass>3.0</mass>", "encoding='klingon'",
)  # fmt: skip


def urdf_mutants(count: int, seed: int) -> Iterator[str]:
    """Texts of URDFs, each with one to three things changed."""
    rng = random.Random(seed)
    for _ in range(count):
        text = SOUND
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            kind = rng.random()
            if kind < 0.75:  # another value of an attribute
                parts = text.split('"')
                i = rng.randrange(len(parts) // 2) * 2 + 1
                i = min(i, len(parts) - 1)
                numbers = [rng.choice(NUMBERS) for _ in parts[i].split()]
                parts[i] = " ".join(numbers) if kind < 0.5 else rng.choice(WORDS)
                text = '"'.join(parts)
            elif kind < 0.85:  # a line more or less
                lines = text.splitlines(keepends=True)
                i = rng.randrange(len(lines))
                lines[i : i + 1] = rng.choice([[], [lines[i]] * 2])
                text = "".join(lines)
            elif kind < 0.93:  # a piece put in
                i = rng.randrange(len(text) + 1)
                text = text[:i] + rng.choice(PIECES) + text[i:]
            else:  # a stretch taken out
                i = rng.randrange(len(text) + 1)
                text = text[:i] + text[i + rng.randint(1, 30) :]
        yield text


TABLE: dict[str, Any] = {
    "name": "two",
    "dh": {"units": {"length": "m", "angle": "deg"}, "rows": [[0, 0, 0.3], [-90, 0.1, 0, 15.0]]},
    "limits": {"position_deg": [[-90, 90], [-120, 10]], "velocity_deg_s": [90, 100], "effort_N_m": [50, 20]},
    "link": [
        {"mass_kg": 2.0, "cg_m": [0, 0.1, 0], "inertia_kg_m2": [0.1, 0.1, 0.1, 0, 0, 0]},
        {"mass_kg": 1.0, "cg_m": [0.1, 0, 0], "inertia_kg_m2": [0.01, 0.02, 0.02, 0, 0, 0.001]},
    ],
}
VALUES = (
    0, -0.0, 5e-324, 1e-300, 1e-160, 1e-20, 1e-9, 1e8, 1e9, 1e10, 1e16, 1e154, 1e155, 1e300, -1e300, -1, 3, 2**63, 10**400,
    float("nan"), float("inf"), True, None, "1", "x", "../../e", "\x00", "\ud800", "é", [], {}, [1], [[1]],
)  # fmt: skip


def dh_mutants(count: int, seed: int) -> Iterator[dict[str, Any]]:
    """Contents of D-H files, each with one to three things changed."""
    rng = random.Random(seed)
    for _ in range(count):
        table = copy.deepcopy(TABLE)
        for _ in range(rng.randint(1, 3)):
            *path, key = rng.choice(list(_places(table)))
            holder = table
            for step in path:
                holder = holder[step]
            kind = rng.random()
            if kind < 0.75:
                holder[key] = copy.deepcopy(rng.choice(VALUES))
            elif kind < 0.85:
                del holder[key]
            elif isinstance(holder, list):
                holder.append(copy.deepcopy(holder[key]))
        yield table


def _places(x: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    entries = x.items() if isinstance(x, dict) else enumerate(x) if isinstance(x, list) else ()
    for key, value in entries:
        yield (*path, key)
        yield from _places(value, (*path, key))


def has_finite_numbers(arm):
    q = np.clip(np.full(arm.n, 0.3), arm.lower, arm.upper)
    v = np.linspace(-1, 1, arm.n)
    found = [arm.forward_kinematics(q).homogeneous, arm.jacobian(q), arm.mass_matrix(q), arm.bias_torque(q, v)]
    found += [arm.damping, arm.friction]
    if arm._has_inertia:
        found.append(arm.forward_dynamics(q, v, v))
    return all(np.isfinite(x).all() for x in found)


def outcome(load, shown):
    """Whether ``load()`` gives an arm, or one of our refusals; anything else fails here, and ``shown`` is printed."""
    refusal = arm = None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            arm = load()
    except ValueError as error:
        refusal = error
    except BaseException:
        print(shown)
        raise
    if arm is not None:
        assert has_finite_numbers(arm), shown
        return "arm"
    ours = type(refusal) is ValueError or type(refusal).__module__.startswith("k1607_pin")
    assert ours, f"{refusal!r}: {shown}"  # and no LinAlgError or UnicodeError, which are ValueErrors too
    return "refused"


@pytest.mark.parametrize("seed", range(3))
def test_urdfs(tmp_path, seed, capfd):
    def load(text):
        path.write_text(text, encoding="utf-8", errors="surrogatepass")
        return k1607.load_urdf(path)

    path = tmp_path / "mutant.urdf"
    assert outcome(lambda: load(SOUND), SOUND) == "arm"
    counts = Counter(outcome(lambda text=text: load(text), text) for text in urdf_mutants(400, seed))
    assert min(counts["arm"], counts["refused"]) > 70
    assert "urdf_parser" not in capfd.readouterr().err


@pytest.mark.parametrize("seed", range(3))
def test_dh_tables(tmp_path, seed):
    def load(table):
        path.write_text(to_urdf(description.from_mapping(table)), encoding="utf-8")
        return k1607.load_urdf(path, "tool")

    path = tmp_path / "mutant.urdf"
    assert outcome(lambda: load(TABLE), TABLE) == "arm"
    counts = Counter(outcome(lambda table=table: load(table), table) for table in dh_mutants(1200, seed))
    assert min(counts["arm"], counts["refused"]) > 70
