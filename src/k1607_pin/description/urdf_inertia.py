"""Inertias of a URDF that no body has: refused where motion would run away, told where it is only wrong."""

from typing import Any

import numpy as np

from k1607_pin.description.urdf_file import UrdfFile

OFF = 1e-3
"""Share of the largest principal moment by which written digits, or a careless tool, may miss what a body can have."""
ACCEPT = "; check_inertia=False takes the file as it is"


def look_at_inertias(file: UrdfFile) -> list[str]:
    """What is doubtful about the links that move, a sentence each.

    Raises
    ------
    ValueError
        A negative mass or a negative principal moment; link and line are named.
    """
    told, moving = [], _moving_links(file)
    for link in file.root.iterchildren("link"):
        inertial = link.find("inertial")
        if inertial is None or link.get("name") not in moving:
            continue
        mass = float(inertial.find("mass").get("value"))
        where = file.where(inertial.find("mass"))
        if mass < 0:
            raise ValueError(f"path: {where}: expected a mass >= 0 in kg, got {mass:g}{ACCEPT}")
        moments = np.linalg.eigvalsh(_tensor(inertial.find("inertia")))
        largest = np.abs(moments).max()
        where = file.where(inertial.find("inertia"))
        shown = ", ".join(f"{moment:.4g}" for moment in moments)
        if moments[0] < -OFF * largest:
            raise ValueError(
                f"path: {where}: no body has the principal moments {shown} kg m^2: one is negative{ACCEPT}"
            )
        if moments[0] + moments[1] < (1 - OFF) * moments[2]:
            told.append(
                f"{where}: no body has the principal moments {shown} kg m^2: the largest exceeds the sum of the others"
            )
        elif mass == 0 and largest > 0:
            told.append(f"{where}: no body has an inertia and no mass")
    return told


def _tensor(inertia: Any) -> np.ndarray:
    """(3, 3) kg m^2"""
    xx, xy, xz, yy, yz, zz = (float(inertia.get(name)) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _moving_links(file: UrdfFile) -> set[str]:
    """Links that some joint carries along."""
    children: dict[str, list[tuple[str, bool]]] = {}
    for joint in file.root.iterchildren("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            children.setdefault(parent.get("link", ""), []).append(
                (child.get("link", ""), joint.get("type") != "fixed")
            )
    moving: set[str] = set()
    waiting = [child for pairs in children.values() for child, moves in pairs if moves]
    while waiting:
        link = waiting.pop()
        if link not in moving:
            moving.add(link)
            waiting += [child for child, _ in children.get(link, ())]
    return moving
