"""Frames as one sees them: three coloured bars and a label, drawn through whatever stands before them."""

import base64
from typing import Any
from xml.sax.saxutils import escape

import meshcat.geometry as mg
import numpy as np

_BAR = np.array([[x, y, z] for x in (0.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])  # x along, y and z across
_QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
_FACES = np.vstack([_QUADS[:, [0, 1, 2]], _QUADS[:, [0, 2, 3]]])
_COLOURS = np.array([[0.86, 0.10, 0.10], [0.05, 0.60, 0.10], [0.10, 0.25, 0.95]])
_THROUGH = {"depthTest": False, "depthWrite": False, "transparent": True}  # joint frames lie inside the drums


def triad(length: float) -> mg.Object:
    """Axes x red, y green, z blue of the given length [m]."""
    bar = _BAR * [length, 0.022 * length, 0.022 * length]
    vertices = np.vstack([np.roll(bar, axis, axis=1) for axis in range(3)])  # (24, 3)
    faces = np.vstack([_FACES + 8 * axis for axis in range(3)])
    geometry = mg.TriangularMeshGeometry(vertices, faces, np.repeat(_COLOURS, 8, axis=0))
    return mg.Mesh(geometry, mg.MeshBasicMaterial(vertexColors=True, **_THROUGH))


class Label(mg.Object):
    """A short text that always faces the camera.

    Parameters
    ----------
    height : m, of the line of text.
    at : (3,) m, its centre in the frame it is drawn in.
    """

    _type = "Sprite"

    def __init__(self, text: str, height: float, at: np.ndarray) -> None:
        super().__init__(None, _SpriteMaterial(map=mg.ImageTexture(_SvgText(text)), **_THROUGH))
        self.matrix = np.diag([4.0 * height, height, 1.0, 1.0])
        self.matrix[:3, 3] = at

    def lower(self) -> dict[str, Any]:
        """The three.js object that meshcat sends."""
        data: dict[str, Any] = {"metadata": {"version": 4.5, "type": "Object"}}
        material = self.material.lower_in_object(data)
        matrix = self.matrix.T.flatten().tolist()
        data["object"] = {"uuid": self.uuid, "type": self._type, "material": material, "matrix": matrix}
        return data


class _SpriteMaterial(mg.GenericMaterial):
    _type = "SpriteMaterial"


class _SvgText(mg.Image):
    """Dark text with a light rim, four times as wide as high."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.svg = (
            '<svg xmlns="http://www.w3.org/2000/svg" width="256" height="64"><text x="128" y="48" font-size="46" '
            'font-family="sans-serif" font-weight="bold" text-anchor="middle" fill="#1a1a1a" stroke="#ffffff" '
            f'stroke-width="9" stroke-linejoin="round" paint-order="stroke">{escape(text)}</text></svg>'
        )

    def lower(self, _: dict[str, Any]) -> dict[str, str]:
        data = base64.b64encode(self.svg.encode()).decode()
        return {"uuid": self.uuid, "url": f"data:image/svg+xml;base64,{data}"}
