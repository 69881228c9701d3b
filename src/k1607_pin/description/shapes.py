"""What the arm looks like: cylinders and boxes, from the data file or, for any other D-H table, from its geometry."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from k1607_pin.description import units
from k1607_pin.description.dh import DHTable

ALONG = {  # rotation that turns a cylinder's own axis, z, to the named one
    "x": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "z": np.eye(3),
}


@dataclass(frozen=True)
class Shape:
    """One primitive, fixed to a link."""

    link: str
    """Name of the link."""
    part: str
    """What it is: the name of its colour."""
    size: tuple[float, ...]
    """m: (radius, length) of a cylinder about its own z, or (x, y, z) of a box."""
    pose: np.ndarray
    """(4, 4): the shape's frame in the link's."""
    rgba: tuple[float, float, float, float]
    """Colour, 0 to 1 each."""

    @property
    def is_cylinder(self) -> bool:
        """Whether it is a cylinder (else a box)."""
        return len(self.size) == 2


def shapes_from(table: Mapping[str, Any]) -> list[Shape]:
    """The shapes of a ``[shapes]`` table of a description file."""
    scale = units.factor(units.LENGTH, table["units"], "shapes")
    shapes = []
    for entry in table["list"]:
        size = tuple(scale * x for x in entry.get("cylinder", entry.get("box")))
        for sign in (1, -1) if "mirror" in entry else (1,):
            centre = np.array(entry["at"]) * scale
            if "mirror" in entry:
                centre["xyz".index(entry["mirror"])] *= sign
            pose = _pose(ALONG[entry.get("along", "z")], centre)
            shapes.append(Shape(entry["link"], entry["part"], size, pose, tuple(table["colours"][entry["part"]])))
    return shapes


def shapes_from_dh(table: DHTable) -> list[Shape]:
    """A plain arm for any table: a drum on each joint axis, a bar to the next joint."""
    next_origins = np.vstack([table.placements()[1:, :3, 3], np.zeros(3)])  # (n, 3), in frame i
    reach = np.linalg.norm(next_origins, axis=1).sum() or 1.0
    drum, bar, grey = (0.04 * reach, 0.1 * reach), 0.025 * reach, (0.8, 0.82, 0.85, 1.0)
    shapes = [Shape("base", "stand", (0.06 * reach, 0.04 * reach), np.eye(4), (0.25, 0.27, 0.3, 1.0))]
    for i, p in enumerate(next_origins, start=1):
        shapes.append(Shape(f"link{i}", "joint", drum, np.eye(4), (0.16, 0.34, 0.56, 1.0)))
        length = float(np.linalg.norm(p))
        if length > bar:
            shapes.append(Shape(f"link{i}", "body", (bar, length), _pose(_turn_z_to(p / length), p / 2), grey))
    return shapes


def _pose(R: np.ndarray, p: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


def _turn_z_to(direction: np.ndarray) -> np.ndarray:
    """(3, 3): some rotation whose third column is the unit vector ``direction``."""
    helper = np.eye(3)[np.abs(direction).argmin()]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(direction, x), direction], axis=1)
