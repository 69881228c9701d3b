"""A contact drawn beside the arm: the wall as a translucent patch, and the force of the world on the tool as an arrow."""

import meshcat
import meshcat.geometry as mg
import numpy as np
import pinocchio as pin
from meshcat.animation import AnimationClip
from meshcat.path import Path

from k1607_pin.simulation.wall import Wall
from k1607_pin.view.run import Run, contact_keys
from k1607_pin.view.sprites import OnTop
from k1607_pin.view.tracks import Track, clip, object_path
from k1607_pin.view.tubes import tubes

FORCE, WALL = 0xD0103A, 0x0F8B7E
OPACITY = 0.16
"""Of the wall: the arm is seen through it."""
LONGEST = 0.26
"""Of the arm's size: the longest arrow."""
USUAL, PEAK = 90, 2.0
"""%, factor: the longest arrow stands for at most PEAK times what USUAL % of the samples in contact stay below."""
_SHAFT, _HEAD, _HEAD_LENGTH = 0.0055, 0.016, 0.05  # of the arm's size: radii, length
_RIM, _FRAME = 0.14, 0.0025  # of the arm's size: from the path to the wall's edge, radius of the frame


def draw(
    viewer: meshcat.Visualizer, run: Run, seconds: np.ndarray, tool: np.ndarray, size: float, order: int
) -> dict[Path, AnimationClip]:
    """Draw the wall of a run and the force in it, and return how they change; as `traces.draw`.

    order : of the arrow among the things that nothing hides.
    """
    if run.wall is not None:
        corners = patch(run.wall, tool, size)
        face = mg.TriangularMeshGeometry(corners, np.array([[0, 1, 2], [0, 2, 3]]))
        look = mg.MeshBasicMaterial(color=WALL, opacity=OPACITY, transparent=True, depthWrite=False)
        viewer["wall"]["patch"].set_object(face, look)
        edge = tubes(corners, np.roll(corners, -1, axis=0), _FRAME * size)
        viewer["wall"]["frame"].set_object(edge, mg.MeshBasicMaterial(color=WALL))
    return _arrow(viewer["contact"], run, seconds, tool, size, order) if run.contact.any() else {}


def extent(run: Run, seconds: np.ndarray, tool: np.ndarray, size: float) -> np.ndarray:
    """(K, 3) m: points that bound what `draw` draws."""
    times, force = contact_keys(run)
    there = np.stack([np.interp(times, seconds, x) for x in tool.T], axis=1)
    tails = there - arrows(force, full_scale(run.contact), size)
    return np.vstack([tails, *([] if run.wall is None else [patch(run.wall, tool, size)])])


def patch(wall: Wall, tool: np.ndarray, size: float) -> np.ndarray:
    """(4, 3) m: corners of a square in the wall, around where tool (M, 3) m is opposite to it, for an arm of that size [m]."""
    across = np.cross([0.0, 0.0, 1.0], wall.normal)  # level, so that the square does not look tilted
    if np.linalg.norm(across) < 1e-3:  # a floor
        across = np.cross([0.0, 1.0, 0.0], wall.normal)
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(wall.normal, across)])
    opposite = (tool - wall.point) @ axes.T  # (M, 2)
    middle = (opposite.min(axis=0) + opposite.max(axis=0)) / 2
    half = np.ptp(opposite, axis=0).max() / 2 + _RIM * size
    return wall.point + (middle + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])) @ axes


def full_scale(contact: np.ndarray) -> float:
    """N that the longest arrow stands for, of forces (N, 3) N: the largest of them, but for a peak far above the rest.

    Such a peak, of an impact say, is drawn as the longest arrow too: in proportion to it the rest would not be seen.
    """
    strength = np.linalg.norm(contact, axis=1)
    touching = strength[strength > 0]
    return float(min(strength.max(), PEAK * np.percentile(touching, USUAL))) if touching.size else 0.0


def arrows(force: np.ndarray, full: float, size: float) -> np.ndarray:
    """(K, 3) m, from tail to tip, for forces (K, 3) N, where the longest stands for ``full`` [N] and more."""
    strength = np.linalg.norm(force, axis=1, keepdims=True)
    return LONGEST * size * force / np.maximum(np.maximum(strength, full), np.finfo(float).tiny)


def _arrow(
    viewer: meshcat.Visualizer, run: Run, seconds: np.ndarray, tool: np.ndarray, size: float, order: int
) -> dict[Path, AnimationClip]:
    """Its tip at the tool: the world pushes there, and beyond the tip the hand is seen. Cylinders are along y."""
    times, force = contact_keys(run)
    length = np.linalg.norm(arrows(force, full_scale(run.contact), size), axis=1)
    head = _HEAD_LENGTH * size
    share = np.minimum(1.0, length / (2 * head))  # an arrow shorter than two heads is smaller as a whole
    cone = mg.Cylinder(head, radiusTop=0.0, radiusBottom=_HEAD * size)
    rod = mg.Cylinder(1.0, _SHAFT * size)
    parts = {
        "head": (cone, -head * share / 2, share),
        "shaft": (rod, -(length + head * share) / 2, length - head * share),
    }
    clips = {
        viewer.path: clip(
            Track("position", "vector3", seconds, tool), Track("quaternion", "quaternion", times, _turned(force))
        )
    }
    for name, (geometry, along, stretch) in parts.items():
        viewer[name].set_object(OnTop(geometry, mg.MeshBasicMaterial, order, color=FORCE))
        clips[object_path(viewer[name])] = clip(
            Track("visible", "bool", times, length > 0),
            Track("position", "vector3", times, along[:, None] * [0.0, 1.0, 0.0]),
            Track("scale", "vector3", times, np.stack([share, stretch, share], axis=1)),
        )
    return clips


def _turned(force: np.ndarray) -> np.ndarray:
    """(K, 4) quaternions, scalar last, that turn y into the directions of forces (K, 3), each by the shortest way from the last.

    Where there is no force, the direction stays.
    """
    quaternions, now, pointing = [], pin.Quaternion.Identity(), np.array([0.0, 1.0, 0.0])
    for f in force:
        if f.any():
            direction = f / np.linalg.norm(f)
            now = pin.Quaternion.FromTwoVectors(pointing, direction) * now
            pointing = direction
        quaternions.append(now.coeffs())
    return np.array(quaternions)
