"""Paths as thin tubes: WebGL draws lines one pixel wide, whatever one asks for."""

import meshcat.geometry as mg
import numpy as np

_SIDES = 6
INDICES = 6 * _SIDES
"""Vertex indices of one straight piece of tube: how much of a tube is drawn is counted in these."""


def far_apart(points: np.ndarray, step: float) -> np.ndarray:
    """Indices of the first of points (M, 3), of each that is a step [m] or more from the one chosen before, and the last."""
    chosen = [0]
    for i, point in enumerate(points):
        if np.linalg.norm(point - points[chosen[-1]]) >= step:
            chosen.append(i)
    if np.any(points[-1] != points[chosen[-1]]):
        chosen.append(len(points) - 1)
    return np.array(chosen)


def dashed(points: np.ndarray, dash: float, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends (P, 3) m of the straight pieces of a dashed path through points (M, 3); dash and gap: their lengths, m.

    A dash bends where the path does, in as many pieces as that takes.
    """
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    starts = np.arange(0.0, along[-1], dash + gap)
    cuts = np.unique(np.clip(np.concatenate([along, starts, starts + dash]), 0.0, along[-1]))
    cuts = cuts[np.diff(cuts, prepend=-1.0) > 1e-9 * along[-1]]  # a bend where a dash ends, but for rounding
    on_path = np.stack([np.interp(cuts, along, x) for x in points.T], axis=1)
    drawn = (cuts[:-1] + cuts[1:]) / 2 % (dash + gap) < dash
    return on_path[:-1][drawn], on_path[1:][drawn]


def tubes(starts: np.ndarray, ends: np.ndarray, radius: float) -> mg.TriangularMeshGeometry:
    """Open tubes of a radius [m] from each start to its end, (P, 3) each and apart; `INDICES` indices a piece, in order."""
    along = ends - starts
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    least = np.eye(3)[np.argmin(np.abs(along), axis=1)]  # the axis farthest from the tube's: never parallel to it
    across = np.cross(along, least)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    ring = radius * (
        np.cos(angles)[:, None] * across[:, None] + np.sin(angles)[:, None] * np.cross(along, across)[:, None]
    )  # (P, sides, 3)
    vertices = np.concatenate([starts[:, None] + ring, ends[:, None] + ring], axis=1).reshape(-1, 3)
    i = np.arange(_SIDES)
    j = (i + 1) % _SIDES
    faces = np.stack([np.stack([i, j, i + _SIDES]), np.stack([j, j + _SIDES, i + _SIDES])]).transpose(2, 0, 1)
    faces = faces.reshape(-1, 3) + 2 * _SIDES * np.arange(len(starts))[:, None, None]
    return mg.TriangularMeshGeometry(vertices, faces.reshape(-1, 3))
