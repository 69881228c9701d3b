"""Frames as one sees them: three coloured bars and a label, drawn through whatever stands before them."""

from xml.sax.saxutils import escape

import meshcat.geometry as mg
import numpy as np

from k1607_pin.view.sprites import THROUGH, Sprite

_BAR = np.array([[x, y, z] for x in (0.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])  # x along, y and z across
_QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
_FACES = np.vstack([_QUADS[:, [0, 1, 2]], _QUADS[:, [0, 2, 3]]])
_COLOURS = np.array([[0.86, 0.10, 0.10], [0.05, 0.60, 0.10], [0.10, 0.25, 0.95]])


def triad(length: float) -> mg.Object:
    """Axes x red, y green, z blue of the given length [m]."""
    bar = _BAR * [length, 0.022 * length, 0.022 * length]
    vertices = np.vstack([np.roll(bar, axis, axis=1) for axis in range(3)])  # (24, 3)
    faces = np.vstack([_FACES + 8 * axis for axis in range(3)])
    geometry = mg.TriangularMeshGeometry(vertices, faces, np.repeat(_COLOURS, 8, axis=0))
    return mg.Mesh(geometry, mg.MeshBasicMaterial(vertexColors=True, **THROUGH))  # joint frames lie inside the drums


class Label(Sprite):
    """A short text: dark with a light rim, four times as wide as high.

    Parameters
    ----------
    height : m, of the line of text.
    at : (3,) m, its centre in the frame it is drawn in.
    """

    def __init__(self, text: str, height: float, at: np.ndarray) -> None:
        svg = (
            '<svg xmlns="http://www.w3.org/2000/svg" width="256" height="64"><text x="128" y="48" font-size="46" '
            'font-family="sans-serif" font-weight="bold" text-anchor="middle" fill="#1a1a1a" stroke="#ffffff" '
            f'stroke-width="9" stroke-linejoin="round" paint-order="stroke">{escape(text)}</text></svg>'
        )
        super().__init__(svg, (4.0 * height, height), at)
