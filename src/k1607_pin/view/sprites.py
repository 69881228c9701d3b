"""Drawn through whatever stands before them: pictures that always face the camera, and things."""

import base64
from typing import Any

import meshcat.geometry as mg
import numpy as np

THROUGH = {"depthTest": False, "depthWrite": False, "transparent": True}
"""Material options of what nothing hides."""


class Sprite(mg.Object):
    """An SVG picture in the scene.

    Parameters
    ----------
    svg : the picture, with its width and height in pixels.
    size : m, width and height.
    at : (3,) m, its centre in the frame it is drawn in.
    """

    _type = "Sprite"

    def __init__(self, svg: str, size: tuple[float, float], at: np.ndarray) -> None:
        super().__init__(None, _SpriteMaterial(map=mg.ImageTexture(_SvgImage(svg)), **THROUGH))
        self.matrix = np.diag([*size, 1.0, 1.0])
        self.matrix[:3, 3] = at

    def lower(self) -> dict[str, Any]:
        """The three.js object that meshcat sends."""
        data: dict[str, Any] = {"metadata": {"version": 4.5, "type": "Object"}}
        material = self.material.lower_in_object(data)
        matrix = self.matrix.T.flatten().tolist()
        data["object"] = {"uuid": self.uuid, "type": self._type, "material": material, "matrix": matrix}
        return data


class OnTop(mg.Mesh):
    """A thing that nothing hides but things of a higher order, whatever stands in front."""

    def __init__(self, geometry: mg.Geometry, material: type[mg.GenericMaterial], order: int, **look: Any) -> None:
        super().__init__(geometry, material(**look, **THROUGH))
        self.order = order

    def lower(self) -> dict[str, Any]:
        """The three.js object that meshcat sends."""
        data = super().lower()
        data["object"]["renderOrder"] = self.order
        return data


class _SpriteMaterial(mg.GenericMaterial):
    _type = "SpriteMaterial"


class _SvgImage(mg.Image):
    def __init__(self, svg: str) -> None:
        super().__init__()
        self.svg = svg

    def lower(self, _: dict[str, Any]) -> dict[str, str]:
        data = base64.b64encode(self.svg.encode()).decode()
        return {"uuid": self.uuid, "url": f"data:image/svg+xml;base64,{data}"}
