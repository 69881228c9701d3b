"""What part of a pose a goal means: all of it, the position, or the position and the direction of one axis of the tool.

An arm of five joints cannot hold every orientation, and one of four (a SCARA) or three not even every direction; drilling, gluing
or pointing leave the turn about the tool free anyway. A `Task` picks the rows that count, of the error and of the Jacobian.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from k1607_pin.arguments import shown
from k1607_pin.kinematics.rotations import orientation_error
from k1607_pin.kinematics.vectors import components, cross, dot

ROWS = {"pose": 6, "position": 3, "axis": 5}
NEXT = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}
"""The two other axes and the axis itself, right-handed in this order."""


@dataclass(frozen=True)
class Task:
    """The rows of a pose that a goal means; m of them: 6, 3 or 5.

    An orientation's rows are about base axes for "pose"; for "axis" about the two tool axes that turn the named one. All formulas
    take floats and traced symbols.

    >>> Task("position").rows, Task("axis").rows, Task("axis", "x")
    (3, 5, Task(kind='axis', axis='x'))
    """

    kind: str = "pose"
    """ "pose", "position" or "axis": position and the direction of one tool axis, the turn about which is free."""
    axis: str | None = None
    """Of the tool: "x", "y" or "z"; for "axis" alone, which takes "z" unless told."""

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str) or self.kind not in ROWS:
            raise ValueError(f'task: expected "pose", "position" or "axis", got {shown(self.kind)}')
        if self.kind == "axis" and self.axis is None:
            object.__setattr__(self, "axis", "z")
        allowed = tuple(NEXT) if self.kind == "axis" else (None,)
        if not isinstance(self.axis, str | None) or self.axis not in allowed:
            expected = '"x", "y" or "z"' if self.kind == "axis" else f'none for "{self.kind}"'
            raise ValueError(f"axis: expected {expected}, got {shown(self.axis)}")

    @property
    def rows(self) -> int:
        """m"""
        return ROWS[self.kind]

    @property
    def column(self) -> int:
        """Of the rotation matrix: the named axis."""
        return self.order[2]

    def error(self, position: Any, rotation: Any, wanted_position: Any, wanted_rotation: Any) -> Any:
        """(m,) wanted less actual: position [m], and orientation [rad] as 2 delta s of (37), sound at half a turn.

        Parameters
        ----------
        position, wanted_position : (3,) m; rotation, wanted_rotation : (3, 3) tool in base. "position" looks at neither rotation,
        "axis" at the named column of the wanted one.
        """
        distance = wanted_position - position
        if self.kind == "position":
            return distance
        if self.kind == "pose":
            return np.concatenate([distance, orientation_error(wanted_rotation, rotation)])
        columns = self._columns(rotation)
        direction = components(wanted_rotation[:, self.order[2]])
        return np.concatenate([distance, np.stack(direction_error(*(dot(c, direction) for c in columns)))])

    def rows_of(self, rotation: Any, twist: Any) -> Any:
        """(m,) or (m, n): the task's rows of a twist (6,) or of a Jacobian (6, n), linear rows first, base axes."""
        if self.kind == "position":
            return twist[:3]
        if self.kind == "pose":
            return twist
        return np.concatenate([twist[:3], self._about(self._columns(rotation), twist)])

    def jacobian(self, rotation: Any, J: Any) -> Any:
        """(m, n): the task's rows of J (6, n) at the tool's orientation (3, 3): minus the derivative of an error that is 0."""
        return self.rows_of(rotation, J)

    def jacobian_rate(self, rotation: Any, J: Any, J_dot: Any, v: Any) -> Any:
        """(m, n): d/dt of `jacobian` along joint velocities v (n,), from J and J_dot (6, n): the tool's axes turn too."""
        rate = self.rows_of(rotation, J_dot)
        if self.kind != "axis":
            return rate
        return rate + self.turning(rotation, (J @ v)[3:], J)

    def turning(self, rotation: Any, angular_velocity: Any, twist: Any) -> Any:
        """(m,) or (m, n): what `rows_of` of a fixed twist (6,) or (6, n) change by as the tool turns at (3,) rad/s, base axes."""
        if self.kind != "axis":
            return 0 * self.rows_of(rotation, twist)
        turn = components(angular_velocity)
        moved = self._about([cross(turn, c) for c in self._columns(rotation)], twist)
        return np.concatenate([0 * twist[:3], moved])

    def wrench(self, rotation: Any, force: Any) -> Any:
        """(6,) N, N m in base axes: what forces (m,) along the task's rows are, so that J^T wrench = jacobian^T force."""
        if self.kind == "pose":
            return force
        if self.kind == "position":
            return np.concatenate([force, np.zeros(3)])
        one, other, _ = self._columns(rotation)
        return np.concatenate(
            [force[:3], np.stack([a * force[3] + b * force[4] for a, b in zip(one, other, strict=True)])]
        )

    @property
    def order(self) -> tuple[int, int, int]:
        """Columns of the rotation matrix: the two axes that the rows are about, and the named one."""
        return NEXT[self.axis or "z"]

    def _columns(self, rotation: Any) -> list[list[Any]]:
        """The tool's axes in base axes, three entries each, the named one last."""
        return [components(rotation[:, k]) for k in self.order]

    @staticmethod
    def _about(columns: list[list[Any]], twist: Any) -> Any:
        """(2,) or (2, n): the turning rows of ``twist`` along the first two columns."""
        return np.stack([dot(c, [twist[3], twist[4], twist[5]]) for c in columns[:2]])


POSE, POSITION, AXIS = Task("pose"), Task("position"), Task("axis")


def as_task(task: Any) -> Task:
    """A `Task`, or one by its name: "pose", "position", "axis" (the tool's z); `ValueError` for anything else."""
    return task if isinstance(task, Task) else Task(task)


def direction_error(x: Any, y: Any, z: Any) -> list[Any]:
    """About x and about y: 2 delta s of the smallest turn that takes (0, 0, 1) to the unit vector (x, y, z).

    The axis is (-y, x, 0) / sin, its length 2 sin(angle/2). Up to a right angle, where the sine may be nothing, the quotient is
    1 / cos(angle/2); beyond, where that cosine may be nothing, it is divided out. At half a turn any axis does: the first.
    """
    sine = np.sqrt(x * x + y * y)
    opposite = np.where(z < 0, sine, 1.0) < 1e-150  # whose square is nothing
    double = np.sqrt(2 * (1 + np.abs(z)))  # 2 cos(angle/2), or 2 sin(angle/2) beyond a right angle
    scale = np.where(z < 0, double / np.where(opposite, 1.0, np.where(z < 0, sine, 1.0)), 2 / double)
    return [np.where(opposite, 2.0, -scale * y), scale * x]
