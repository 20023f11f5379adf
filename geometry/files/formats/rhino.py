"""Surfaces of Rhino files.

Format: openNURBS, read by rhino3dm.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from geometry.files.named_surfaces import (
    DEEPEST,
    NamedSurface,
    by_corners,
    millimetres_of,
    moved_surface,
    unused_name,
)
from geometry.mesh import FloatArray, MeshError


def read_rhino(path: Path) -> list[NamedSurface]:
    """Meshes of a Rhino file, and the render meshes of its solids; open surfaces are passed over.

    Instances of block definitions are placed, those inside definitions too.

    Raises
    ------
    MeshError
        A file that cannot be read, rhino3dm that is not installed, or a solid that was saved
        without its render mesh.
    """
    try:
        import rhino3dm
    except ImportError:
        raise MeshError(
            f"{path}: needs rhino3dm, which is not installed: pip install 'tubelock[formats]', or "
            "export the model as OBJ"
        ) from None
    file = rhino3dm.File3dm.Read(str(path))
    if file is None:
        raise MeshError(f"{path}: cannot be read as a Rhino file: is it cut short?")
    scale = millimetres_of(path, str(file.Settings.ModelUnitSystem).rpartition(".")[2])
    model = _RhinoModel(path, rhino3dm, file)
    result = [
        surface
        for one, number in model.outer
        for surface in model.surfaces(one, f"object {number}", scale * np.eye(4), "")
    ]
    if not result:
        raise MeshError(f"{path}: got no meshes or solids; expected at least one closed surface")
    return result


class _RhinoModel:
    """Objects of a Rhino file, and the block definitions that its instances place."""

    def __init__(self, path: Path, rhino3dm: Any, file: Any) -> None:
        self._path, self._rhino3dm = path, rhino3dm
        objects = list(file.Objects)
        by_id = {one.Attributes.Id: one for one in objects}
        self._definitions = {
            one.Id: (str(one.Name), [by_id[k] for k in one.GetObjectIds() if k in by_id])
            for one in file.InstanceDefinitions
        }
        inner = {one.Attributes.Id for _, parts in self._definitions.values() for one in parts}
        self.outer = [
            (one, number)
            for number, one in enumerate(objects)
            if not (one.Attributes.IsInstanceDefinitionObject or one.Attributes.Id in inner)
        ]
        self._layers = list(file.Layers)
        self._used: dict[str, int] = {}

    def surfaces(
        self, one: Any, unnamed: str, above: FloatArray, hidden: str, depth: int = 0
    ) -> Iterator[NamedSurface]:
        """Surfaces of an object, or of all that an instance places, moved by a matrix (4, 4)."""
        if depth > DEEPEST:
            raise MeshError(f"{self._path}: its block definitions contain each other")
        hidden = hidden or self._hidden(one)
        if isinstance(one.Geometry, self._rhino3dm.InstanceReference):
            title, parts = self._definitions.get(one.Geometry.ParentIdefId, ("", []))
            name = str(one.Attributes.Name or title or unnamed)
            turn = above @ np.reshape(one.Geometry.Xform.ToFloatArray(True), (4, 4))
            for part in parts:
                yield from self.surfaces(part, name, turn, hidden, depth + 1)
            return
        meshes = list(_rhino_meshes(one.Geometry, self._rhino3dm))
        if not meshes:
            return
        name = unused_name(str((not depth and one.Attributes.Name) or unnamed), self._used)
        if hidden:
            yield NamedSurface(name, np.zeros((0, 3)), (), left_out=hidden)
            return
        if any(mesh is None for mesh in meshes):
            raise MeshError(
                f"{self._path}: {name} was saved without its render mesh; expected meshes: in "
                "Rhino, use the command Mesh, or save without 'Save small'"
            )
        yield moved_surface(_joined(name, meshes), above)

    def _hidden(self, one: Any) -> str:
        """Why an object is not seen: hidden itself, or on a layer that is off; empty else."""
        if one.Attributes.Mode == self._rhino3dm.ObjectMode.Hidden:
            return "hidden"
        index = one.Attributes.LayerIndex
        layer = next((layer for layer in self._layers if layer.Index == index), None)
        while layer is not None:
            if not layer.Visible:
                return f"layer {layer.Name} is off"
            above = layer.ParentLayerId
            layer = next((other for other in self._layers if other.Id == above), None)
        return ""


def _rhino_meshes(geometry: Any, rhino3dm: Any) -> Iterator[Any]:
    """Meshes of an object; None where a face has none; nothing for curves, points and texts."""
    if isinstance(geometry, rhino3dm.Mesh):
        yield geometry
    elif isinstance(geometry, rhino3dm.Extrusion) and geometry.IsSolid:
        yield geometry.GetMesh(rhino3dm.MeshType.Any)
    elif isinstance(geometry, rhino3dm.Brep) and geometry.IsSolid:
        for face in geometry.Faces:
            yield face.GetMesh(rhino3dm.MeshType.Any)


def _joined(name: str, meshes: list[Any]) -> NamedSurface:
    """Surface of several meshes of rhino3dm; a face whose last two corners agree is a triangle."""
    points: list[list[float]] = []
    faces: list[list[int]] = []
    for mesh in meshes:
        first = len(points)
        points += [[v.X, v.Y, v.Z] for v in mesh.Vertices]
        for a, b, c, d in mesh.Faces:
            faces.append([first + k for k in ((a, b, c) if c == d else (a, b, c, d))])
    return NamedSurface(name, np.array(points), by_corners(iter(faces)))
