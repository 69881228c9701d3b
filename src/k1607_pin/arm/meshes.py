"""Geometry that travels light: meshes by the files they came from, everything else as it is."""

import logging
import os
from pathlib import Path
from typing import Any, NamedTuple

import coal
import pinocchio as pin

logger = logging.getLogger(__name__)


class Packed(NamedTuple):
    """A `pinocchio.GeometryModel` without the vertices of meshes that lie in files."""

    objects: tuple[Any, ...]
    """Constructor arguments; None stands for a geometry that is read from the mesh path again."""
    flags: tuple[bool, ...]
    """`disableCollision` of each."""
    pairs: tuple[tuple[int, int], ...]


def packed(geometry: pin.GeometryModel) -> Packed:
    """What is sent in place of ``geometry``: kilobytes for an arm."""
    objects, flags = [], []
    for g in geometry.geometryObjects:
        shape = None if isinstance(g.geometry, coal.BVHModelBase) and Path(g.meshPath).is_file() else g.geometry
        path = g.meshPath if os.path.isabs(g.meshPath) or shape is not None else os.path.abspath(g.meshPath)
        look = (path, g.meshScale.copy(), g.overrideMaterial, g.meshColor.copy(), g.meshTexturePath)
        material = None if isinstance(g.meshMaterial, pin.GeometryNoMaterial) else g.meshMaterial
        objects.append((g.name, g.parentJoint, g.parentFrame, pin.SE3(g.placement), shape, *look, material))
        flags.append(g.disableCollision)
    return Packed(tuple(objects), tuple(flags), tuple((p.first, p.second) for p in geometry.collisionPairs))


def unpacked(geometry: Packed) -> pin.GeometryModel:
    """The geometry again, its meshes read from their files; those that are missing are named in the log and left out."""
    made, places, missing = pin.GeometryModel(), {}, []
    loader = coal.CachedMeshLoader()
    for i, ((*who, shape, path, scale, override, colour, texture, material), off) in enumerate(
        zip(geometry.objects, geometry.flags, strict=True)
    ):
        if shape is None:
            if not Path(path).is_file():
                missing.append(path)
                continue
            shape = loader.load(path, scale)
        rest = () if material is None else (material,)
        g = pin.GeometryObject(*who, shape, path, scale, override, colour, texture, *rest)
        g.disableCollision = off
        places[i] = made.addGeometryObject(g)
    for first, second in geometry.pairs:
        if first in places and second in places:
            made.addCollisionPair(pin.CollisionPair(places[first], places[second]))
    if missing:
        logger.warning(
            "%d meshes are missing on this machine and are left out, %s the first: install the robot's files there",
            len(missing), missing[0],
        )  # fmt: skip
    return made


class Geometry:
    """An arm's geometry, shared by its copies: whole where it was made, packed where it was sent."""

    def __init__(self, whole: pin.GeometryModel | None, light: Packed | None = None) -> None:
        self._whole, self._light = whole, light

    @property
    def whole(self) -> pin.GeometryModel | None:
        """The geometry; meshes that were not sent are read now, once."""
        if self._whole is None and self._light is not None:
            self._whole = unpacked(self._light)
        return self._whole

    def __reduce__(self) -> tuple[Any, ...]:
        if self._light is None and self._whole is not None:
            self._light = packed(self._whole)
        return Geometry, (None, self._light)

    def __deepcopy__(self, memo: object) -> "Geometry":
        return self
