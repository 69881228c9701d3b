"""Small arms of fewer than six joints, written out as URDF."""

from pathlib import Path

import k1607_pin as k1607

KINDS = {
    # axis, offset to the next joint [m]
    "scara": [("revolute", "0 0 1", "0.35 0 0"), ("revolute", "0 0 1", "0.3 0 0"), ("prismatic", "0 0 1", "0 0 -0.1"),
              ("revolute", "0 0 1", "0.02 0 -0.05")],
    "five": [("revolute", "0 0 1", "0 0 0.3"), ("revolute", "0 1 0", "0.4 0 0"), ("revolute", "0 1 0", "0.3 0 0"),
             ("revolute", "1 0 0", "0.1 0 0"), ("revolute", "0 1 0", "0.12 0 0")],
    "three": [("revolute", "0 0 1", "0 0 0.3"), ("revolute", "0 1 0", "0.4 0 0"), ("revolute", "0 1 0", "0.3 0 0")],
    "two": [("revolute", "0 0 1", "0 0 0.3"), ("revolute", "0 1 0", "0.4 0 0")],
}  # fmt: skip
POSTURES = {
    "scara": [0.3, 0.9, 0.05, -0.4],
    "five": [0.2, -0.6, 1.1, 0.5, 0.7],
    "three": [0.2, -0.6, 1.1],
    "two": [0.1, 0.4],
}
"""Away from limits and from singularities of the tasks that the arm can have."""


def urdf(kind: str) -> str:
    """The description of an arm of that kind."""
    joints = KINDS[kind]
    inertial = (
        '<inertial><origin xyz="0.1 0 0.02"/><mass value="1"/>'
        '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    links = ['<link name="base"/>', *(f'<link name="link{k + 1}">{inertial}</link>' for k in range(len(joints)))]
    parts, offset = [], "0 0 0"
    for k, (joint, axis, following) in enumerate(joints):
        parts.append(
            f'<joint name="joint{k + 1}" type="{joint}"><parent link="{f"link{k}" if k else "base"}"/><child link="link{k + 1}"/>'
            f'<origin xyz="{offset}"/><axis xyz="{axis}"/><limit lower="-2.8" upper="2.8" effort="200" velocity="3"/></joint>'
        )
        offset = following
    parts.append(
        f'<joint name="flange" type="fixed"><parent link="link{len(joints)}"/><child link="tool"/>'
        f'<origin xyz="{offset}"/></joint>'
    )
    return f'<robot name="{kind}">{"".join(links)}<link name="tool"/>{"".join(parts)}</robot>'


def load(kind: str, folder: Path) -> k1607.Arm:
    """The arm, by way of a file."""
    path = folder / f"{kind}.urdf"
    path.write_text(urdf(kind))
    return k1607.load_urdf(path, tool_frame="tool")
