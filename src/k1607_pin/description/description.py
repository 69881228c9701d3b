"""All that is needed to write an arm down: geometry, inertias, limits, looks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from k1607_pin import data
from k1607_pin.arguments import as_floats, shown
from k1607_pin.description.bounds import LARGEST
from k1607_pin.description.dh import DHTable, check_keys
from k1607_pin.description.inertia import LinkInertia, k1607_links
from k1607_pin.description.shapes import Shape, shapes_from, shapes_from_dh
from k1607_pin.description.units import DEGREE, INCH

PROVENANCE = ("standing", "source", "identity", "posture")  # what a data file may hold beside


@dataclass(frozen=True)
class ArmDescription:
    """A fixed-base serial arm of n revolute joints, ready to be written as URDF."""

    name: str
    dh: DHTable
    lower: np.ndarray
    """(n,) rad"""
    upper: np.ndarray
    """(n,) rad"""
    velocity: np.ndarray
    """(n,) rad/s"""
    effort: np.ndarray
    """(n,) N m"""
    links: Sequence[LinkInertia] | None = None
    """n links in their D-H frames; None for kinematics alone."""
    shapes: Sequence[Shape] = ()
    frames: Mapping[str, float] = field(default_factory=lambda: {"tool": 0.0})
    """Frames fixed to the last link: name -> offset along its z, m."""


def k1607() -> ArmDescription:
    """The K-1607: Table 1, published masses, assumed limits."""
    facts = data.load("k1607")
    table = DHTable.from_mapping(facts["dh"])
    return ArmDescription(
        name=facts["name"],
        dh=table,
        **_limits(facts["limits"], table.n),
        links=k1607_links(),
        shapes=shapes_from(facts["shapes"]),
        frames={"tool": 0.0, "tool_plate": facts["tool_plate"]["offset_in"] * INCH},
    )


def from_mapping(table: Mapping[str, Any]) -> ArmDescription:
    """An arm from a description file's content.

    Keys: ``dh`` (`DHTable.from_mapping`); optional ``name``; ``limits`` with ``position_deg``, ``velocity_deg_s``,
    ``effort_N_m``; ``link``, a list of one table a joint with ``mass_kg``, ``cg_m`` (3) and ``inertia_kg_m2``
    (ixx, iyy, izz, ixy, ixz, iyz about the centre of gravity, in the link's D-H frame).

    Raises
    ------
    ValueError
        Anything missing, of wrong length, not finite, or impossible; row and column are named.
    """
    check_keys("arm description", table, required=("dh",), optional=("name", "limits", "link", *PROVENANCE))
    dh = DHTable.from_mapping(table["dh"])
    return ArmDescription(
        name=_name(table.get("name", "arm")),
        dh=dh,
        **_limits(table.get("limits", {}), dh.n),
        links=_links(table["link"], dh.n) if "link" in table else None,
        shapes=shapes_from_dh(dh),
    )


def _name(name: Any) -> str:
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        raise ValueError(f"name: expected a text of printable characters, got {name!r}")
    return name


def _limits(table: Mapping[str, Any], n: int) -> dict[str, Any]:
    check_keys("limits", table, optional=("position_deg", "velocity_deg_s", "effort_N_m", *PROVENANCE))
    position = _numbers(table.get("position_deg", [[-180.0, 180.0]] * n), (n, 2), "limits", "position_deg")
    velocity = _numbers(table.get("velocity_deg_s", [180.0] * n), (n,), "limits", "velocity_deg_s")
    effort = _numbers(table.get("effort_N_m", [100.0] * n), (n,), "limits", "effort_N_m")
    for i, (low, high) in enumerate(position, start=1):
        if low >= high:
            raise ValueError(f"limits, row {i}, column 'position_deg': expected lower < upper, got {low} and {high}")
    for column, values, unit in (("velocity_deg_s", velocity, DEGREE), ("effort_N_m", effort, 1.0)):
        for i, value in enumerate(values, start=1):
            if value * unit <= 0:
                raise ValueError(f"limits, row {i}, column {column!r}: expected a positive number, got {value}")
    lower, upper = position.T * DEGREE
    return {"lower": lower, "upper": upper, "velocity": velocity * DEGREE, "effort": effort}


def _links(rows: Sequence[Mapping[str, Any]], n: int) -> list[LinkInertia]:
    if not isinstance(rows, list) or len(rows) != n:
        raise ValueError(
            f"link: expected {n} tables [[link]], one a joint, got {len(rows) if isinstance(rows, list) else rows!r}"
        )
    links = []
    for i, row in enumerate(rows, start=1):
        where = f"link, row {i}"
        check_keys(where, row, required=("mass_kg", "cg_m", "inertia_kg_m2"), optional=PROVENANCE)
        mass = float(_numbers(row["mass_kg"], (), where, "mass_kg"))
        if mass <= 0:
            raise ValueError(f"{where}, column 'mass_kg': expected a positive mass in kg, got {mass}")
        ixx, iyy, izz, ixy, ixz, iyz = _numbers(row["inertia_kg_m2"], (6,), where, "inertia_kg_m2")
        inertia = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
        link = LinkInertia(mass, _numbers(row["cg_m"], (3,), where, "cg_m"), inertia)
        if not link.is_physical():
            raise ValueError(
                f"{where}, column 'inertia_kg_m2': no body has it (principal moments {np.linalg.eigvalsh(inertia)} "
                "must be positive and meet the triangle inequality)"
            )
        links.append(link)
    return links


def _numbers(value: Any, shape: tuple[int, ...], table: str, column: str) -> np.ndarray:
    array = as_floats(f"{table}, column {column!r}", value, "numbers")
    if isinstance(value, bool):
        raise ValueError(f"{table}, column {column!r}: expected numbers, got {value!r}")
    if array.shape != shape:
        raise ValueError(f"{table}, column {column!r}: expected shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        row = "" if not shape or table.startswith("link") else f", row {np.argwhere(~np.isfinite(array))[0][0] + 1}"
        raise ValueError(f"{table}{row}, column {column!r}: expected finite numbers, got {value!r}")
    if (np.abs(array) > LARGEST).any():
        raise ValueError(f"{table}, column {column!r}: expected numbers up to {LARGEST:g}, got {shown(value)}")
    return array
