"""COLLADA files as one coloured mesh.

meshcat's viewer shows such files itself, but leaves out every part that has more than one material (most of a UR5).
"""

from pathlib import Path

import collada
import meshcat.geometry as mg
import numpy as np

_PLAIN = np.array([0.8, 0.8, 0.8])


def collada_mesh(path: str | Path) -> mg.Mesh:
    """The triangles of a ``.dae`` file in metres, in the colours of their materials; textures become light grey."""
    document = collada.Collada(str(path), ignore=[collada.common.DaeUnsupportedError, collada.common.DaeBrokenRefError])
    vertices, faces, colours, count = [], [], [], 0
    for shape in document.scene.objects("geometry"):
        for primitive in shape.primitives():
            triangles = primitive.triangleset() if hasattr(primitive, "triangleset") else primitive
            if not isinstance(triangles, collada.triangleset.BoundTriangleSet) or not len(triangles):
                continue  # lines
            positions = triangles.vertex[triangles.vertex_index].reshape(-1, 3)  # m, three per triangle
            # One vertex for each pair of position and normal: the viewer then shades edges sharp where the file does.
            normals = np.zeros_like(positions) if triangles.normal is None else triangles.normal[triangles.normal_index]
            corners = np.hstack([positions, normals.reshape(-1, 3)]).astype(np.float32)
            unique, index = np.unique(corners, axis=0, return_inverse=True)
            vertices.append(unique[:, :3])
            faces.append(index.reshape(-1, 3) + count)
            colours.append(np.broadcast_to(_diffuse(triangles.material), (len(unique), 3)))
            count += len(unique)
    if not vertices:
        raise ValueError(f"{path}: no triangles")
    scale = document.assetInfo.unitmeter or 1.0
    geometry = mg.TriangularMeshGeometry(scale * np.vstack(vertices), np.vstack(faces), np.vstack(colours))
    return mg.Mesh(geometry, mg.MeshPhongMaterial(vertexColors=True))


def _diffuse(material: collada.material.Material | None) -> np.ndarray:
    colour = getattr(getattr(material, "effect", None), "diffuse", None)
    return np.array(colour[:3]) if isinstance(colour, tuple) else _PLAIN
