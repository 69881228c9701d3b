"""Link inertias of the K-1607, assembled from the published modules."""

from dataclasses import dataclass

import numpy as np

from k1607_pin import data
from k1607_pin.description.dh import DHTable, exact, table_1
from k1607_pin.description.units import DEGREE, INCH, POUND, POUND_INCH_SECOND2


@dataclass(frozen=True)
class LinkInertia:
    """Mass properties of one link, in its own D-H frame."""

    mass: float
    """kg"""
    cg: np.ndarray
    """(3,) m: centre of gravity."""
    inertia: np.ndarray
    """(3, 3) kg m^2 about the centre of gravity."""

    def __add__(self, other: "LinkInertia") -> "LinkInertia":
        """Both as one rigid body: parallel-axis theorem about the common centre of gravity."""
        mass = self.mass + other.mass
        if mass == 0:
            return LinkInertia(0.0, np.zeros(3), self.inertia + other.inertia)
        cg = (self.mass * self.cg + other.mass * other.cg) / mass
        return LinkInertia(mass, cg, _about(self, cg) + _about(other, cg))

    def moved(self, R: np.ndarray, p: np.ndarray) -> "LinkInertia":
        """The same body seen from a frame in which its own frame has orientation R (3, 3) and origin p (3,) m."""
        return LinkInertia(self.mass, R @ self.cg + p, R @ self.inertia @ R.T)

    def is_physical(self) -> bool:
        """Whether a real body can have it: positive mass, positive definite, principal moments meet the triangle inequality."""
        moments = np.linalg.eigvalsh(self.inertia)
        return bool(self.mass > 0 and moments[0] > 0 and moments[0] + moments[1] >= moments[2])


NOTHING = LinkInertia(0.0, np.zeros(3), np.zeros((3, 3)))


def rod(axis: np.ndarray, moment: float) -> LinkInertia:
    """A massless ideal rod on ``axis`` (3,): ``moment`` kg m^2 about every line across the axis, none about it."""
    return LinkInertia(0.0, np.zeros(3), moment * (np.eye(3) - np.outer(axis, axis)))


def assemble() -> list[LinkInertia]:
    """The seven links in the report's frames, as published: links 1, 3, 5 and 7 break the triangle inequality."""
    source = data.load("k1607_modules")
    distal = {key.split("_")[0]: value for key, value in source["distal_izz"].items() if key.endswith("_lb_in_s2")}
    distal |= {
        key.split("_")[0]: value for key, value in source["distal_izz"]["suspect"].items() if key.endswith("_lb_in_s2")
    }
    half_turn = np.diag([-1.0, -1.0, 1.0])  # SAL's frames to the report's
    links = []
    for parts, roll in zip(source["assembly"]["links"], source["assembly"]["distal"], strict=True):
        link = NOTHING
        for part in parts:
            module = source["modules"][part["module"]]
            body = LinkInertia(
                module["mass_lb"] * POUND - part.get("less_kg", 0.0),
                np.array(module["cg_in"]) * INCH,
                np.diag(module["inertia_lb_in_s2"]) * POUND_INCH_SECOND2,
            )
            link += body.moved(_rx(part.get("rx_deg", 0.0) * DEGREE), np.array([part.get("a_in", 0.0) * INCH, 0, 0]))
        if not parts:  # the tool base, at the joint-7 origin
            link += LinkInertia(source["tool_base"]["mass_kg"], np.zeros(3), np.zeros((3, 3)))
        if roll:
            link += LinkInertia(0.0, np.zeros(3), np.diag([0, 0, distal[roll] * POUND_INCH_SECOND2]))
        links.append(link.moved(half_turn, np.zeros(3)))
    return links


def shift_rods(links: list[LinkInertia], table: DHTable) -> list[LinkInertia]:
    """The same arm with every link physical: ideal rods on the roll axes moved from the proximal to the distal link.

    Mass matrix, Coriolis and gravity terms stay as they are, because a rod about a revolute joint's own axis has the same
    kinetic energy and weight on either side of it. What joint 1's rod takes from the base does not move at all.
    """
    source = data.load("k1607_modules")["rod_shift"]
    z = np.array([0.0, 0.0, 1.0])
    shifted = list(links)
    for distal, delta in zip(source["distal_link"], source["delta_kg_m2"], strict=True):
        i = distal - 1
        shifted[i] = _with_rod(shifted[i], rod(z, delta))
        if i > 0:
            axis = np.array([0.0, -table.sin_alpha[i], table.cos_alpha[i]])  # z_i in frame i-1, third column of (2)
            shifted[i - 1] = _with_rod(shifted[i - 1], rod(axis, -delta))
    return shifted


def k1607_links() -> list[LinkInertia]:
    """The seven physical links of the K-1607 in the report's frames."""
    return shift_rods(assemble(), table_1())


def _with_rod(link: LinkInertia, massless: LinkInertia) -> LinkInertia:
    return LinkInertia(link.mass, link.cg, link.inertia + massless.inertia)


def _about(link: LinkInertia, point: np.ndarray) -> np.ndarray:
    r = link.cg - point
    return link.inertia + link.mass * (r @ r * np.eye(3) - np.outer(r, r))


def _rx(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return exact(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]))
