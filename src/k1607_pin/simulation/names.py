"""Names of what is logged: what `simulate` and `rollout` call their own results, no controller, observer or signal may log."""

from collections.abc import Iterable, Mapping
from typing import Any

Variables = Mapping[str, tuple[tuple[str, ...], str]]
"""Name of a logged variable -> dimensions after time, unit."""

VARIABLES: dict[str, tuple[tuple[str, ...], str]] = {
    "q": (("joint",), "rad"),
    "v": (("joint",), "rad/s"),
    "tau": (("joint",), "N m"),
    "passive_torque": (("joint",), "N m"),
    "tool_position": (("axis",), "m"),
    "contact_force": (("axis",), "N"),
    "contact_moment": (("axis",), "N m"),
    "payload": ((), "kg"),
    "payload_changes": ((), ""),
    "energy": ((), "J"),
    "work": ((), "J"),
    "external_work": ((), "J"),
    "dissipated": ((), "J"),
    "payload_energy": ((), "J"),
    "energy_residual": ((), "J"),
}
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
"""Of Cartesian errors and forces: along and about the base's axes."""
ENDS: dict[str, tuple[tuple[str, ...], str]] = {
    "q_end": (("joint",), "rad"),
    "v_end": (("joint",), "rad/s"),
    "failed_at": ((), "s"),
}
"""Of a rollout, beside its ``work``"""
COORDINATES = ("time", "rollout", "joint", "axis", "direction", "task_row")
RESERVED = frozenset({"t", *VARIABLES, *ENDS, *COORDINATES})
"""What no controller, observer or signal may call what it logs, in `simulate` and in `rollout` alike"""


def require_names(what: str, names: Iterable[Any]) -> None:
    """Refuse names of a log that are `RESERVED`, or that a file of results cannot have.

    Raises
    ------
    ValueError
        It names ``what`` gives them, and them.
    """
    names = list(names)
    if taken := sorted(RESERVED.intersection(names)):
        raise ValueError(
            f"{what}: every run logs {', '.join(taken)} already; choose another name, for example my_{taken[0]}"
        )
    if wrong := [x for x in names if not isinstance(x, str) or not x or "/" in x]:
        raise ValueError(f"{what}: expected names without /, and no empty ones, got {wrong[0]!r}")
