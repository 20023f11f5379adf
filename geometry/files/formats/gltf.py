"""Surfaces of glTF files.

Format: glTF 2.0 (Khronos, ISO/IEC 12113), read by trimesh.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geometry.files.named_surfaces import Y_UP, NamedSurface, moved_surface
from geometry.mesh import MeshError


def read_scene_graph(path: Path) -> list[NamedSurface]:
    """Surfaces of a glTF file [mm]; its y axis points up and becomes z.

    Raises
    ------
    MeshError
        A file that trimesh cannot read.
    """
    try:
        import trimesh
    except ImportError:
        raise MeshError(
            f"{path}: needs trimesh, which is not installed: pip install 'tubelock[formats]', or "
            "export the model as OBJ"
        ) from None
    try:
        scene = trimesh.load_scene(path, process=False)
    except Exception as error:  # trimesh raises whatever its readers meet
        raise MeshError(f"{path}: cannot be read ({error})") from None
    matrix = np.eye(4)
    matrix[:3, :3] = 1000.0 * Y_UP  # metres
    result = []
    for node in scene.graph.nodes_geometry:
        placed, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        faces = np.asarray(getattr(mesh, "faces", np.zeros((0, 3))), dtype=np.int64)
        if len(faces):
            surface = NamedSurface(str(node), np.asarray(mesh.vertices, np.float64), (faces,))
            result.append(moved_surface(surface, matrix @ placed))
    if not result:
        raise MeshError(f"{path}: got no faces; expected triangles")
    return result
