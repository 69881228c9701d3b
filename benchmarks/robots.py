"""docs/robots.md: what becomes of every robot of example-robot-data, and of every shape of description.

python benchmarks/robots.py            # prints the page; some minutes and 2 GB for all meshes
python benchmarks/robots.py docs/robots.md
"""

import logging
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import k1607_pin as k1607
from k1607_pin.arm import load
from k1607_pin.arm.arm import Arm
from k1607_pin.description import description
from k1607_pin.description.urdf import to_urdf

INERTIA = '<inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/>'
BODY = f'<inertial><origin xyz="0.1 0 0"/><mass value="1"/>{INERTIA}</inertial>'


class Row(NamedTuple):
    """One line of a table."""

    what: str
    verdict: str
    """loads, needs a tool, or refused."""
    said: str
    """Joints and tool, and what the log says; or the message."""

    def __str__(self) -> str:
        return "| " + " | ".join(x.replace("|", "\\|") for x in self) + " |"


class _Heard(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.said.append(record.getMessage())


def outcome(what: str, make: Callable[[], Arm]) -> Row:
    """What becomes of one description."""
    heard, logger = _Heard(), logging.getLogger("k1607_pin")
    load.SAID_ONCE.clear()
    logger.addHandler(heard)
    try:
        arm = make()
    except ValueError as error:
        return Row(what, "needs a tool" if "several ends" in str(error) else "refused", _plain(str(error)))
    finally:
        logger.removeHandler(heard)
    joints = f"{arm.n} joint{'s' if arm.n > 1 else ''}, tool `{arm.tool_frame}`"
    more = [f"and {len(heard.said) - 3} more of the kind"] if len(heard.said) > 3 else []
    return Row(what, "loads", ". ".join([joints, *map(_plain, heard.said[:3]), *more]))


def _plain(text: str) -> str:
    """A message without the folders of this machine, and not longer than a table can hold."""
    text = re.sub(r"[^\s']*/([^/\s']+\.(?:urdf|sdf|stl|dae|obj|STL|DAE))", r"\1", " ".join(text.split()))
    text = text.replace("<", "&lt;").replace(">", "&gt;")
    return text if len(text) <= 700 else f"{text[:700]} ..."


def examples(names: list[str] | None = None) -> Iterator[Row]:
    """Every robot of example-robot-data, or those that are named."""
    from example_robot_data.robots_loader import ROBOTS

    for name in sorted(ROBOTS) if names is None else names:
        yield outcome(f"`{name}`", lambda name=name: k1607.load_example(name))


def link(name: str, inside: str = BODY) -> str:
    """A link of a URDF, one line."""
    return f'<link name="{name}">{inside}</link>\n'


def joint(name: str, parent: str, child: str, kind: str = "revolute", more: str = "") -> str:
    """A joint of a URDF, one line."""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="0 .1 .3"/>'
        f'<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="10" velocity="2"/>{more}</joint>\n'
    )


ARM = link("base") + "".join(
    link(f"link{i}") + joint(f"joint{i}", f"link{i - 1}" if i > 1 else "base", f"link{i}") for i in range(1, 4)
)
FINGERS = (
    link("left") + link("right") + joint("l", "link3", "left") + joint("r", "link3", "right", more='<mimic joint="l"/>')
)
HAND = (
    '<link name="camera"/><link name="hand"/>'
    + joint("c", "link3", "camera", "fixed")
    + joint("h", "link3", "hand", "fixed")
)
SECOND = "".join(
    link(f"other{i}") + joint(f"second{i}", f"other{i - 1}" if i > 1 else "base", f"other{i}") for i in range(1, 4)
)
DH: dict[str, Any] = {"dh": {"units": {"length": "m", "angle": "deg"}, "rows": [[0, 0, 0.3], [-90, 0.1, 0]]}}


def _first(old: str, new: str) -> str:
    """The arm with the first ``old`` made ``new``."""
    if old not in ARM:
        raise ValueError(old)
    return ARM.replace(old, new, 1)


def _last(old: str, new: str) -> str:
    """The arm with the last ``old`` made ``new``."""
    return new.join(ARM.rsplit(old, 1))


def _moving(old: str, new: str) -> str:
    """The arm with ``old`` made ``new`` in links 1 to 3."""
    head, rest = ARM.split("\n", 1)
    return f"{head}\n{rest.replace(old, new)}"


def _chain(n: int, kind: str) -> str:
    return link("l0") + "".join(link(f"l{i}") + joint(f"j{i}", f"l{i - 1}", f"l{i}", kind) for i in range(1, n + 1))


URDFS: dict[str, tuple[Any, ...]] = {  # shape -> body of <robot>, options, what stands before
    "a chain of three joints": (ARM,),
    "a joint named like a link, another locked": (ARM.replace('"joint2"', '"link2"'), {"locked": ["joint1"]}),
    "two links of one name": (ARM + link("link1"),),
    "a piston on the first link": (ARM + link("a_rod") + joint("a_piston", "link1", "a_rod", "prismatic"),),
    "a camera on the base": (ARM + '<link name="z_camera"/>' + joint("z", "base", "z_camera", "fixed"),),
    "a camera and a hand on the last link": (ARM + HAND,),
    "a gripper with two fingers": (ARM + FINGERS,),
    "the same, the hand named": (ARM + FINGERS, {"tool_frame": "link3"}),
    "the same, its driver locked open": (ARM + FINGERS, {"tool_frame": "link3", "locked": {"l": 0.5}}),
    "two arms of the same length": (ARM + SECOND,),
    "a tool frame that there is not": (ARM, {"tool_frame": "gripper"}),
    "a link alone": (link("base"),),
    "a moving joint that mimics another": (_last("</joint>", '<mimic joint="joint1"/></joint>'),),
    "a joint whose lower limit is the upper one": (_first('lower="-1" upper="1"', 'lower="0.5" upper="0.5"'),),
    "limits apart by rounding": (_first('lower="-1" upper="1"', 'lower="1.5707963" upper="1.5707964"'),),
    "limits the wrong way round": (_first('lower="-1" upper="1"', 'lower="1" upper="-1"'),),
    "no lower and upper limit at all": (_first('lower="-1" upper="1"', ""),),
    "a locked value beyond the limits": (ARM, {"locked": {"joint2": 2.0}}),
    "a locked joint that there is not": (ARM, {"locked": ["elbow"]}),
    "continuous joints": (ARM.replace("revolute", "continuous"),),
    "a sliding joint": (_first("revolute", "prismatic"),),
    "a planar joint": (_first("revolute", "planar"),),
    "an axis without direction": (_first('xyz="0 0 1"', 'xyz="0 0 0"'),),
    "an axis of another length": (_first('xyz="0 0 1"', 'xyz="1 1 2"'),),
    "a decimal comma in a limit": (_first('lower="-1"', 'lower="-1,0"'),),
    "a limit without effort": (_first('effort="10"', ""),),
    "joint friction": (_first("</joint>", '<dynamics damping="0.3" friction="0.2"/></joint>'),),
    "a negative mass": (_moving('<mass value="1"/>', '<mass value="-1"/>'),),
    "the same, as it is": (_moving('<mass value="1"/>', '<mass value="-1"/>'), {"check_inertia": False}),
    "a decimal comma in a mass": (_moving('<mass value="1"/>', '<mass value="3,0"/>'),),
    "a mass between tags": (_moving('<mass value="1"/>', "<mass>3.0</mass>"),),
    "a mass that is NaN": (_moving('<mass value="1"/>', '<mass value="nan"/>'),),
    "no mass in an inertial": (_moving('<mass value="1"/>', ""),),
    "an inertia without mass": (_moving('<mass value="1"/>', '<mass value="0"/>'),),
    "a negative moment of inertia": (_moving('ixx=".1"', 'ixx="-.1"'),),
    "moments that break the triangle": (_moving('izz=".1"', 'izz=".3"'),),
    "a point mass": (_moving(INERTIA, INERTIA.replace(".1", "0")),),
    "no inertia at all": (_moving(BODY, ""),),
    "a mesh that is not there": (_moving(BODY, BODY + '<visual><geometry><mesh filename="package://a/b.stl"/></geometry></visual>'),),
    "a length of 1e300 m": (_first('xyz="0 .1 .3"', 'xyz="0 .1 1e300"'),),
    "prefixes that nobody declared": (ARM + '<gazebo:plugin x:y="1"/>\n',),
    "an encoding that Python knows": (ARM, {}, '<?xml version="1.0" encoding="latin-1"?>'),
    "an encoding that nobody knows": (ARM, {}, '<?xml version="1.0" encoding="klingon"?>'),
    "entities": (ARM, {}, '<!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]>'),
    "an entity from outside": (ARM, {}, '<!DOCTYPE robot [<!ENTITY a SYSTEM "file:///etc/passwd">]>'),
    "elements 200 deep": (ARM + "<a>" * 200 + "</a>" * 200,),
    "an element that is not closed": (ARM + "<link>",),
    "400 joints": (_chain(400, "revolute"),),
    "5,000 links": (_chain(5000, "fixed"),),
}  # fmt: skip
TABLES: dict[str, dict[str, Any]] = {
    "two rows": DH,
    "a length of 1e300 m in row 2": {"dh": DH["dh"] | {"rows": [[0, 0, 0.3], [-90, 1e300, 0]]}},
    "NaN in row 2": {"dh": DH["dh"] | {"rows": [[0, 0, 0.3], [-90, float("nan"), 0]]}},
    "a unit that nobody knows": {"dh": DH["dh"] | {"units": {"length": "league", "angle": "deg"}}},
    "a thousand rows": {"dh": DH["dh"] | {"rows": [[0, 0, 0.3]] * 1000}},
    "an inertia that no body has": DH | {"link": [{"mass_kg": 1, "cg_m": [0, 0, 0], "inertia_kg_m2": [1, 1, 3, 0, 0, 0]}] * 2},
    "limits the wrong way round": DH | {"limits": {"position_deg": [[-90, 90], [10, -10]]}},
    "a name that does not print": DH | {"name": "a\nb"},
}  # fmt: skip


def urdfs() -> Iterator[Row]:
    """Every shape of URDF."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        for what, (body, *more) in URDFS.items():
            options, head = (more[0] if more else {}), (more[1] if len(more) > 1 else "")
            path.write_text(f'{head}<robot name="robot">\n{body}</robot>\n')
            yield outcome(what, lambda options=options: k1607.load_urdf(path, **options))


def tables() -> Iterator[Row]:
    """Every shape of D-H file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        for what, table in TABLES.items():

            def made(table: dict[str, Any] = table) -> Arm:
                path.write_text(to_urdf(description.from_mapping(table)))
                return k1607.load_urdf(path, "tool")

            yield outcome(what, made)


TOOL = """Where no `tool_frame` is given, the tool is the one link at the end of the longest chain of joints that move.
Where there is not one, the message lists the candidates: give `tool_frame=` in Python, `--tool-frame` on the command line.
Joints beside that chain, and joints whose limits leave no range, are locked; `locked=` and `--lock` lock more.
What a file says and an arm does not do (joint friction, missing meshes) is a warning in the log, here behind the tool."""
SHAPES = """`k1607.load_urdf(path)`, with options where the first column says so.
The arm is a chain of three joints but for what is named."""


def page() -> str:
    """docs/robots.md."""
    found = list(examples())
    loads, needs, refused = (sum(row.verdict == v for row in found) for v in ("loads", "needs a tool", "refused"))
    parts = [
        "# Robots: what loads, and what is said of what does not",
        "Made by `python benchmarks/robots.py docs/robots.md`; a test makes a part of it again.",
        TOOL,
        f"## example-robot-data\n\n`k1607.load_example(name)` without options: of {len(found)} robots "
        f"{loads} load, {needs} need a tool, and {refused} are refused, most of them for a base that moves.",
        _table(found),
        f"## Shapes of URDFs\n\n{SHAPES}",
        _table(urdfs()),
        '## Shapes of D-H files\n\nWhat `k1607 urdf --dh` reads, loaded with `tool_frame="tool"`.',
        _table(tables()),
    ]
    return "\n\n".join(parts) + "\n"


def _table(rows: Any) -> str:
    return "\n".join(["| | | |", "|---|---|---|", *map(str, rows)])


if __name__ == "__main__":
    text = page()
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(text, encoding="utf-8")
    else:
        print(text)
