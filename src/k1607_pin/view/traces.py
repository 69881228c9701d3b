"""A run drawn beside its arm: the path that was wanted, the path that came of it, the payload, and the contact."""

from xml.sax.saxutils import escape

import meshcat
import meshcat.geometry as mg
import numpy as np
from meshcat.animation import AnimationClip
from meshcat.path import Path

from k1607_pin.view import contact
from k1607_pin.view.camera import NARROWEST
from k1607_pin.view.run import Run, payload_keys
from k1607_pin.view.sprites import OnTop, Sprite
from k1607_pin.view.tracks import Track, clip, object_path
from k1607_pin.view.tubes import INDICES, dashed, far_apart, tubes

ACTUAL, WANTED, PAYLOAD = 0x14213D, 0xF07C00, 0x8E3BB0
DENSITY = 4000.0
"""kg/m^3 of the ball that stands for the payload."""
_THIN, _THICK, _POINT = 0.0022, 0.0042, 0.009  # of the arm's size: radii of the paths and of their present points
_STEP, _DASH = 0.003, 0.011  # of the arm's size
_GAP = 1.5  # of a dash: the actual path, thinner and often in the same place, shows in the gaps
_MAX_DASHES = 500


def draw(
    viewer: meshcat.Visualizer, run: Run, seconds: np.ndarray, tool: np.ndarray, size: float
) -> dict[Path, AnimationClip]:
    """Draw the parts of a run that the arm is not, and return how they change.

    Parameters
    ----------
    viewer : where to, in metres in the arm's base frame.
    seconds : (M,) of the frames shown, from 0; tool : (M, 3) m, the tool's origin in each.
    size : m, of the arm: what thickness is measured by.
    """
    clips: dict[Path, AnimationClip] = {}
    wanted = _wanted(run, seconds)
    if wanted is not None:
        path = wanted[far_apart(wanted, _STEP * size)]
        if len(path) > 1:
            length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
            dash = max(_DASH * size, length / _MAX_DASHES / (1 + _GAP))
            pieces = dashed(path, dash, _GAP * dash)
            viewer["wanted"].set_object(tubes(*pieces, _THICK * size), mg.MeshBasicMaterial(color=WANTED))
        clips |= _moving_point(viewer["wanted now"], WANTED, 1.4 * _POINT * size, 2, seconds, wanted)

    kept = far_apart(tool, _STEP * size)
    if len(kept) > 1:
        geometry = tubes(tool[kept[:-1]], tool[kept[1:]], _THIN * size)
        viewer["actual"].set_object(geometry, mg.MeshBasicMaterial(color=ACTUAL))
        keys = np.union1d(kept, len(tool) - 1)
        pieces_there = np.searchsorted(kept, keys, side="right") - 1  # the piece that ends where the tool is, is there
        # three.js draws so many indices of a geometry
        grown = Track("geometry[drawRange].count", "number", seconds[keys], INDICES * pieces_there, steps=True)
        clips[object_path(viewer["actual"])] = clip(grown)
    clips |= _moving_point(viewer["actual now"], ACTUAL, _POINT * size, 3, seconds, tool)

    if run.payload.any():
        times, mass = payload_keys(run)
        radius = np.cbrt(3 * np.where(mass > 0, mass, run.payload.max()) / (4 * np.pi * DENSITY))  # m
        # One side only: through the front one would see the back.
        ball = OnTop(mg.Sphere(1.0), mg.MeshPhongMaterial, 0, color=PAYLOAD, opacity=0.65, side=0)
        viewer["payload"].set_object(ball)
        clips[viewer["payload"].path] = clip(Track("position", "vector3", seconds, tool))
        clips[object_path(viewer["payload"])] = clip(
            Track("visible", "bool", times, mass > 0),
            Track("scale", "vector3", times, np.repeat(radius[:, None], 3, axis=1), steps=True),
        )
    return clips | contact.draw(viewer, run, seconds, tool, size, 1)


def extent(run: Run, seconds: np.ndarray, tool: np.ndarray, size: float) -> np.ndarray:
    """(K, 3) m: points that bound what `draw` draws."""
    radius = float(np.cbrt(3 * run.payload.max() / (4 * np.pi * DENSITY)))
    wanted = _wanted(run, seconds)
    corners = tool[:, None] + radius * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    touched = contact.extent(run, seconds, tool, size)
    return np.vstack([corners.reshape(-1, 3), touched, *([] if wanted is None else [wanted])])


def legend(run: Run, half_height: float) -> Sprite:
    """What is what, in one line at the lower edge of a window, 1 m before the camera; half_height [m] of the picture there."""
    entries = [("line", ACTUAL, "actual path")]
    if run.wanted is not None:
        entries.append(("dashes", WANTED, "desired path"))
    if run.payload.any():
        varies = len(np.unique(run.payload[run.payload > 0])) > 1
        entries.append(("ball", PAYLOAD, f"payload, {'up to ' if varies else ''}{run.payload.max():.3g} kg"))
    if run.contact.any():
        largest, full = np.linalg.norm(run.contact, axis=1).max(), contact.full_scale(run.contact)
        beyond = f" (arrow up to {full:.3g} N)" if full < largest else ""
        entries.append(("arrow", contact.FORCE, f"contact force, up to {largest:.3g} N{beyond}"))
    if run.wall is not None:
        entries.append(("wall", contact.WALL, "wall"))
    parts, x = [], 10
    for swatch, colour, text in entries:
        width = sum(12 if c in " fijlrt,." else 22 for c in text)
        parts.append(_SWATCHES[swatch].format(x=x, middle=x + 38, end=x + 76, colour=f"#{colour:06x}"))
        # The length is given: no two browsers have the same fonts.
        parts.append(
            f'<text x="{x + 90}" y="45" textLength="{width}" font-size="38" font-family="sans-serif" fill="#1a1a1a" '
            f'stroke="#ffffff" stroke-width="7" stroke-linejoin="round" paint-order="stroke">{escape(text)}</text>'
        )
        x += 90 + width + 50
    width = x - 40
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="64">{"".join(parts)}</svg>'
    height = min(0.085, 1.9 * NARROWEST * 64 / width) * half_height  # m
    return Sprite(svg, (height * width / 64, height), np.array([0.0, -0.93 * half_height, -1.0]))


_SWATCHES = {
    "line": '<path d="M{x} 32H{end}" stroke="{colour}" stroke-width="10"/>',
    "dashes": '<path d="M{x} 32H{end}" stroke="{colour}" stroke-width="18" stroke-dasharray="16 14"/>',
    "ball": '<circle cx="{middle}" cy="32" r="25" fill="{colour}" fill-opacity="0.65"/>',
    "arrow": '<path d="M{x} 27H{middle}V12L{end} 32L{middle} 52V37H{x}Z" fill="{colour}"/>',
    "wall": '<path d="M{x} 9H{end}V55H{x}Z" fill="{colour}" fill-opacity="0.2" stroke="{colour}" stroke-width="5"/>',
}


def _wanted(run: Run, seconds: np.ndarray) -> np.ndarray | None:
    """(M, 3) m at the frames shown."""
    if run.wanted is None:
        return None
    return np.stack([np.interp(seconds, run.times - run.times[0], x) for x in run.wanted.T], axis=1)


def _moving_point(
    viewer: meshcat.Visualizer, colour: int, radius: float, order: int, seconds: np.ndarray, points: np.ndarray
) -> dict[Path, AnimationClip]:
    viewer.set_object(OnTop(mg.Sphere(radius), mg.MeshBasicMaterial, order, color=colour))
    return {viewer.path: clip(Track("position", "vector3", seconds, points))}
