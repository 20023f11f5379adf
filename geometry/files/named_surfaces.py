"""Surfaces under the names that modelling programs give them: compas, Rhino, glTF, 3MF.

Formats: compas, `Data` objects as JSON (compas.dev); openNURBS through rhino3dm; glTF 2.0 (Khronos,
ISO/IEC 12113) and 3MF through trimesh.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from geometry.errors import unreadable
from geometry.mesh import FloatArray, IntArray, MeshError

#: Millimetres in the units that files state by name.
_MILLIMETRES = {
    "millimeters": 1.0,
    "millimeter": 1.0,
    "centimeters": 10.0,
    "centimeter": 10.0,
    "meters": 1000.0,
    "meter": 1000.0,
    "inches": 25.4,
    "inch": 25.4,
    "feet": 304.8,
    "foot": 304.8,
    "micron": 1e-3,
}
#: Rotation of a file whose y axis points up into one whose z axis does, (3, 3).
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class NamedSurface:
    """Faces that a file puts together."""

    name: str
    """Empty where the file has none."""
    points: FloatArray
    """(n_points, 3), in the unit of the file."""
    faces: tuple[IntArray, ...]
    """Polygons with the same number of corners together, (n_faces, n_corners) each."""
    held: bool = False
    """Whether the file says that it is a support."""


def by_corners(faces: Iterator[list[int]]) -> tuple[IntArray, ...]:
    """Polygons with the same number of corners together."""
    groups: dict[int, list[list[int]]] = {}
    for face in faces:
        groups.setdefault(len(face), []).append(face)
    return tuple(np.array(group, dtype=np.int64) for group in groups.values())


def read_compas(path: Path) -> list[NamedSurface]:
    """Every mesh in a JSON file of compas: of an assembly, a model, a list or by itself.

    Raises
    ------
    MeshError
        A file that is not JSON, or that holds no mesh.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        result = list(_compas_meshes(data, "", held=False))
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise MeshError(f"{path}: cannot be read as JSON of compas ({error!r})") from None
    if not result:
        raise MeshError(
            f"{path}: got no mesh; expected JSON of compas with meshes, an assembly or a model"
        )
    return result


def _compas_meshes(data: Any, name: str, *, held: bool) -> Iterator[NamedSurface]:
    """Walk through nested objects; a name or a support is that of what is inside."""
    if isinstance(data, list):
        for part in data:
            yield from _compas_meshes(part, name, held=held)
    if not isinstance(data, Mapping):
        return
    attributes = data.get("attributes") or {}
    name = str(data.get("name") or attributes.get("name") or name)
    held = held or any(bool(of.get("is_support")) for of in (data, attributes))
    if isinstance(data.get("vertex"), Mapping) and isinstance(data.get("face"), Mapping):
        yield _compas_mesh(data, name, held=held)
        return
    moved = data.get("transformation")
    turn = None if not moved else np.array(moved["data"]["matrix"], dtype=np.float64)
    for key, part in data.items():
        inner = str(key) if isinstance(part, Mapping) and "block" in part else name
        for surface in _compas_meshes(part, inner, held=held):
            yield surface if turn is None else _moved(surface, turn)


def _compas_mesh(data: Mapping[str, Any], name: str, *, held: bool) -> NamedSurface:
    number = {key: place for place, key in enumerate(data["vertex"])}
    points = [[float(v.get(x, 0.0)) for x in "xyz"] for v in data["vertex"].values()]
    faces = ([number[str(corner)] for corner in face] for face in data["face"].values())
    return NamedSurface(name, np.array(points).reshape(-1, 3), by_corners(faces), held)


def _moved(surface: NamedSurface, matrix: FloatArray) -> NamedSurface:
    """The same surface, moved by a matrix (4, 4)."""
    return replace(surface, points=surface.points @ matrix[:3, :3].T + matrix[:3, 3])


def read_scene_graph(path: Path) -> list[NamedSurface]:
    """Surfaces of a glTF or 3MF file [mm]; the y axis of glTF points up and becomes z.

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
    is_gltf = path.suffix.lower() in {".glb", ".gltf"}
    matrix = np.eye(4)
    matrix[:3, :3] = 1000.0 * Y_UP if is_gltf else _of_unit(path, str(scene.units)) * np.eye(3)
    result = []
    for node in scene.graph.nodes_geometry:
        placed, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        faces = np.asarray(getattr(mesh, "faces", np.zeros((0, 3))), dtype=np.int64)
        if len(faces):
            surface = NamedSurface(str(node), np.asarray(mesh.vertices, np.float64), (faces,))
            result.append(_moved(surface, matrix @ placed))
    if not result:
        raise MeshError(f"{path}: got no faces; expected triangles")
    return result


def _of_unit(path: Path, unit: str) -> float:
    """Millimetres in a unit that a file states."""
    try:
        return _MILLIMETRES[unit.lower()]
    except KeyError:
        raise MeshError(
            f"{path}: its unit is {unit}; expected one of {', '.join(sorted(_MILLIMETRES))}: "
            "set it in the program that made it"
        ) from None


def read_rhino(path: Path) -> list[NamedSurface]:
    """Meshes of a Rhino file, and the render meshes of its solids; open surfaces are passed over.

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
    scale = _of_unit(path, str(file.Settings.ModelUnitSystem).rpartition(".")[2])
    result = []
    objects: Any = file.Objects
    for number, one in enumerate(objects):
        meshes = list(_rhino_meshes(one.Geometry, rhino3dm))
        name = str(one.Attributes.Name or f"object {number}")
        if any(mesh is None for mesh in meshes):
            raise MeshError(
                f"{path}: {name} was saved without its render mesh; expected meshes: in Rhino, use "
                "the command Mesh, or save without 'Save small'"
            )
        if meshes:
            result.append(_joined(name, scale, meshes))
    if not result:
        raise MeshError(f"{path}: got no meshes or solids; expected at least one closed surface")
    return result


def _rhino_meshes(geometry: Any, rhino3dm: Any) -> Iterator[Any]:
    """Meshes of an object; None where a face has none; nothing for curves, points and texts."""
    if isinstance(geometry, rhino3dm.Mesh):
        yield geometry
    elif isinstance(geometry, rhino3dm.Extrusion) and geometry.IsSolid:
        yield geometry.GetMesh(rhino3dm.MeshType.Any)
    elif isinstance(geometry, rhino3dm.Brep) and geometry.IsSolid:
        for face in geometry.Faces:
            yield face.GetMesh(rhino3dm.MeshType.Any)


def _joined(name: str, scale: float, meshes: list[Any]) -> NamedSurface:
    """Surface of several meshes of rhino3dm; a face whose last two corners agree is a triangle."""
    points: list[list[float]] = []
    faces: list[list[int]] = []
    for mesh in meshes:
        first = len(points)
        points += [[v.X, v.Y, v.Z] for v in mesh.Vertices]
        for a, b, c, d in mesh.Faces:
            faces.append([first + k for k in ((a, b, c) if c == d else (a, b, c, d))])
    return NamedSurface(name, scale * np.array(points), by_corners(iter(faces)))


#: Readers by suffix of formats whose files name their surfaces.
READERS: Mapping[str, Callable[[Path], list[NamedSurface]]] = {
    ".json": read_compas,
    ".glb": read_scene_graph,
    ".gltf": read_scene_graph,
    ".3mf": read_scene_graph,
    ".3dm": read_rhino,
}
#: Suffixes of files that say in which unit they are, beside STEP; read in mm.
OWN_UNITS = {".glb", ".gltf", ".3mf", ".3dm"}


def read_named(path: Path) -> list[NamedSurface]:
    """Surfaces of a file of one of the formats in `READERS`.

    Raises
    ------
    MeshError
        As the readers; the file is not there.
    """
    why = unreadable(path)
    if why is not None:
        raise MeshError(f"{path}: {why}; expected a file of surfaces")
    return READERS[path.suffix.lower()](path)
