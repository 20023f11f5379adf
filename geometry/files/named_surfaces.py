"""Surfaces under the names that modelling programs give them: compas, Rhino, glTF, 3MF.

Formats: compas, `Data` objects as JSON (compas.dev); openNURBS through rhino3dm; glTF 2.0 (Khronos,
ISO/IEC 12113) through trimesh; 3MF (3MF Consortium, core specification 1.3 and production
extension).
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

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
    left_out: str = ""
    """Why the file says that it is no block; empty where it is one."""


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
            result.append(_moved(surface, matrix @ placed))
    if not result:
        raise MeshError(f"{path}: got no faces; expected triangles")
    return result


#: What stands before every name in a 3MF file.
_3MF = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
#: Attribute of the production extension: the model file of an object.
_3MF_PATH = "{http://schemas.microsoft.com/3dmanufacturing/production/2015/06}path"
#: Objects within objects that a file may have: more are a circle.
_DEEPEST = 64


def read_3mf(path: Path) -> list[NamedSurface]:
    """Surfaces of the build items of a 3MF file, in their order [mm].

    Raises
    ------
    MeshError
        A file that cannot be read, or that builds nothing.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            models = {
                f"/{name.lstrip('/')}": ElementTree.fromstring(archive.read(name))
                for name in archive.namelist()
                if name.lower().endswith(".model")
            }
        start = next(name for name in models if "3dmodel.model" in name.lower())
        objects = {
            (name, one.attrib["id"]): one
            for name, model in models.items()
            for one in model.iter(f"{_3MF}object")
        }
        scale = _of_unit(path, models[start].attrib.get("unit", "millimeter"))
        used: dict[str, int] = {}
        result = [
            replace(surface, name=_unused(surface.name, used))
            for item in models[start].iterfind(f"{_3MF}build/{_3MF}item")
            for surface in _3mf_surfaces(objects, start, item, scale * np.eye(4))
        ]
    except MeshError:
        raise
    except Exception as error:  # whatever a broken archive, broken XML or missing numbers raise
        raise MeshError(f"{path}: cannot be read as 3MF ({error!r})") from None
    if not result:
        raise MeshError(f"{path}: builds no mesh; expected build items of objects with triangles")
    return result


def _3mf_surfaces(
    objects: Mapping[tuple[str, str], ElementTree.Element],
    model: str,
    item: ElementTree.Element,
    above: FloatArray,
    depth: int = 0,
) -> Iterator[NamedSurface]:
    """Meshes of an item or a component, moved by the matrices of all above it (4, 4)."""
    if depth > _DEEPEST:
        raise ValueError("its components contain each other")
    model = item.attrib.get(_3MF_PATH, model)
    one, matrix = objects[model, item.attrib["objectid"]], np.eye(4)
    if "transform" in item.attrib:
        numbers = [float(word) for word in item.attrib["transform"].split()]
        matrix[:3] = np.reshape(numbers, (4, 3)).T
    for part in one.iterfind(f"{_3MF}components/{_3MF}component"):
        yield from _3mf_surfaces(objects, model, part, above @ matrix, depth + 1)
    mesh = one.find(f"{_3MF}mesh")
    if mesh is None:
        return
    kind = one.attrib.get("type", "model")
    points = [[float(v.attrib[x]) for x in "xyz"] for v in mesh.iter(f"{_3MF}vertex")]
    faces = [[int(t.attrib[k]) for k in ("v1", "v2", "v3")] for t in mesh.iter(f"{_3MF}triangle")]
    surface = NamedSurface(
        one.attrib.get("name") or f"object {one.attrib['id']}",
        np.array(points).reshape(-1, 3),
        by_corners(iter(faces)),
        left_out="" if kind == "model" else f"its type is {kind}",
    )
    if faces and not 0 <= np.min(faces) <= np.max(faces) < len(points):
        raise ValueError(f"a triangle of {surface.name} names a vertex that is not there")
    yield _moved(surface, above @ matrix)


def _unused(name: str, used: dict[str, int]) -> str:
    """Return the name, with a number where it was used before."""
    used[name] = used.get(name, 0) + 1
    return name if used[name] == 1 else f"{name} {used[name]}"


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
    scale = _of_unit(path, str(file.Settings.ModelUnitSystem).rpartition(".")[2])
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
        if depth > _DEEPEST:
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
        name = _unused(str((not depth and one.Attributes.Name) or unnamed), self._used)
        if hidden:
            yield NamedSurface(name, np.zeros((0, 3)), (), left_out=hidden)
            return
        if any(mesh is None for mesh in meshes):
            raise MeshError(
                f"{self._path}: {name} was saved without its render mesh; expected meshes: in "
                "Rhino, use the command Mesh, or save without 'Save small'"
            )
        yield _moved(_joined(name, meshes), above)

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


#: Readers by suffix of formats whose files name their surfaces.
READERS: Mapping[str, Callable[[Path], list[NamedSurface]]] = {
    ".json": read_compas,
    ".glb": read_scene_graph,
    ".gltf": read_scene_graph,
    ".3mf": read_3mf,
    ".3dm": read_rhino,
}
#: Suffixes of files that say in which unit they are, beside STEP; read in mm.
OWN_UNITS = {".glb", ".gltf", ".3mf", ".3dm"}


def read_named(path: Path) -> list[NamedSurface]:
    """Surfaces of a file of one of the formats in `READERS`, without those in `left_out`.

    Raises
    ------
    MeshError
        As the readers; the file is not there, or nothing of it is a block.
    """
    why = unreadable(path)
    if why is not None:
        raise MeshError(f"{path}: {why}; expected a file of surfaces")
    every = READERS[path.suffix.lower()](path)
    result = [one for one in every if not one.left_out]
    if not result:
        raise MeshError(f"{path}: got no block that is shown; left out: {', '.join(_words(every))}")
    return result


def left_out(path: Path) -> list[str]:
    """Objects that a file says are no blocks, and why: hidden, on a layer that is off, a support.

    Raises
    ------
    MeshError
        As `read_named`.
    """
    reader = READERS.get(path.suffix.lower())
    return [] if reader is None else _words(reader(path))


def _words(surfaces: list[NamedSurface]) -> list[str]:
    return [f"{one.name} ({one.left_out})" for one in surfaces if one.left_out]
