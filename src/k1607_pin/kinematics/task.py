"""Tasks: what part of a pose a goal means, for arms that have too few joints for all six, or goals that leave some free."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from k1607_pin.arguments import numbers, shown
from k1607_pin.kinematics.rotations import orientation_error
from k1607_pin.kinematics.vectors import components, dot, entries, vector

ROWS = {"pose": 6, "position": 3, "axis": 5}


@dataclass(frozen=True)
class Task:
    """What part of a pose a goal means: all of it, its position, or its position and where one axis of the tool points.

    A task of m rows says what counts of a pose's error and of a velocity. Its formulas take numbers and a tracer's symbols.

    >>> Task("axis").rows(np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), np.eye(3))
    array([1., 2., 3., 4., 5.])

    Raises
    ------
    ValueError
        No such name; an axis without direction, or with a name other than "axis".
    """

    name: str = "pose"
    """"pose" (6 rows), "position" (3) or "axis" (5: the rotation about the axis is free)."""
    axis: tuple[float, float, float] | None = None
    """Of the tool, in its own frame, for "axis" only; made a unit vector; None is the tool's z."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or self.name not in ROWS:
            raise ValueError(f"task: expected 'pose', 'position' or 'axis', got {shown(self.name)}")
        if self.name == "axis":
            a = numbers("axis", (0.0, 0.0, 1.0) if self.axis is None else self.axis, (3,))
            if not (largest := np.abs(a).max()) > 0:
                raise ValueError("axis: expected the direction of one of the tool's axes, got zeros")
            a = a / largest  # before it is squared, which may overflow or vanish
            object.__setattr__(self, "axis", tuple((a / np.linalg.norm(a)).tolist()))
        elif self.axis is not None:
            raise ValueError(f"axis: expected none for a task {self.name!r}, got {shown(self.axis)}")

    @property
    def size(self) -> int:
        """m, the number of rows."""
        return ROWS[self.name]

    def error(self, wanted_position: Any, wanted_rotation: Any, position: Any, rotation: Any) -> Any:
        """(..., m): p_wanted - p [m], then what the orientation lacks, as 2 delta s of (37): sound at every angle.

        Positions are (..., 3) m, rotations (..., 3, 3), tool in base. A "pose" turns about base axes, by R_wanted R^T. An "axis"
        turns about the two axes of the tool normal to it, on the shortest way; from opposite to wanted, where all ways are as
        short, about the first of them.
        """
        distance = wanted_position - position
        if self.name == "position":
            return distance
        if self.name == "pose":
            return np.concatenate([distance, orientation_error(wanted_rotation, rotation)], axis=-1)
        a, first, second = self._frame
        there, here = entries(wanted_rotation), entries(rotation)
        in_base = [dot(row, a) for row in there]  # the wanted axis
        d = [dot([here[i][j] for i in range(3)], in_base) for j in range(3)]  # and in the tool
        c, x, y = dot(a, d), dot(first, d), dot(second, d)  # cosine of the angle; its sine times a direction
        sine = np.sqrt(x * x + y * y)
        opposite = sine <= 0
        # 2 sin(angle/2) / sin(angle), by that half angle's cosine or sine, whichever is large
        near = np.sqrt(2 / np.where(c > 0, 1 + c, 1.0))
        far = np.sqrt(np.where(c > 0, 0.0, 2 - 2 * c)) / np.where(opposite, 1.0, sine)
        scale = np.where(c > 0, near, far)
        turn = [np.where(c < 0, np.where(opposite, 2.0, -scale * y), -scale * y), scale * x]
        return vector([*components(distance), *turn])

    def rows(self, J: Any, rotation: Any) -> Any:
        """(m, n) of J (6, n), or (m,) of a velocity or an acceleration (6,), base axes, linear rows first.

        rotation : (3, 3) tool in base. d error / dq = -rows(J) where the error is zero. As the tool's own rotation does not
        turn its angular velocity, rows(J_dot v + J v_dot) is the derivative of rows(J v).
        """
        if self.name == "pose":
            return J
        if self.name == "position":
            return J[:3]
        _, *normal = self._frame
        R = entries(rotation)
        base = [[dot(R[i], b) for i in range(3)] for b in normal]  # the two axes in the base frame
        turn = [b[0] * J[3] + b[1] * J[4] + b[2] * J[5] for b in base]
        return np.stack([J[0], J[1], J[2], *turn])

    @cached_property
    def _frame(self) -> list[list[float]]:
        """The axis and two more that are normal to it, right-handed, in the tool's frame."""
        a = np.array(self.axis)
        unit = np.eye(3)[np.abs(a).argmin()]
        first = unit - a * a[np.abs(a).argmin()]
        first = first / np.linalg.norm(first)
        return [a.tolist(), first.tolist(), np.cross(a, first).tolist()]


POSE, POSITION = Task("pose"), Task("position")


def task_of(task: "Task | str") -> Task:
    """The task itself, or that of a name: "pose", "position", or "axis" for the tool's z."""
    return task if isinstance(task, Task) else Task(task)
