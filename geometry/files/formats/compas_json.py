"""Blocks of a JSON file of compas: of an assembly, a model, a list, or one mesh or box by itself.

Transformations compose: an element of a model is moved by its own, by those of the elements above
it in the tree, and by the model's.
Format: `Data` objects of compas as JSON (compas.dev); compas_assembly, compas_model, compas_dem.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from geometry.files.named_surfaces import NamedSurface, by_corners
from geometry.mesh import FloatArray, MeshError

#: Keys below which nothing is a block: joints, and what changes or describes blocks.
_NO_BLOCKS = {"contacts", "edge", "features", "interfaces", "materials", "modifiers"}
#: Types of objects that place or order others.
_PLACES = {
    *("Frame", "Graph", "Group", "Projection", "Reflection", "Rotation", "Scale", "Shear"),
    *("Transformation", "Translation", "Tree"),
}
#: Types of solids that are no meshes.
_SOLIDS = {"Capsule", "Cone", "Cylinder", "Sphere", "Torus"}


def read_compas(path: Path) -> list[NamedSurface]:
    """Every block in a JSON file of compas; objects of other types are named as left out.

    Raises
    ------
    MeshError
        A file that is not JSON, that holds no block, or a solid that is not given by its faces.
    """
    try:
        reader = _Reader()
        data = json.loads(path.read_text(encoding="utf-8"))
        result = list(reader.blocks(data, _Above()))
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise MeshError(f"{path}: cannot be read as JSON of compas ({error!r})") from None
    result += [
        NamedSurface(f"{n} {kind}", np.zeros((0, 3)), (), left_out="no block")
        for kind, n in reader.others.items()
    ]
    if not result:
        raise MeshError(
            f"{path}: got no mesh; expected JSON of compas with meshes, an assembly or a model"
        )
    return result


@dataclass(frozen=True)
class _Above:
    """What the objects around a block say of it."""

    name: str = ""
    held: bool = False
    matrix: FloatArray = field(default_factory=lambda: np.eye(4))

    def inside(self, data: Mapping[str, Any]) -> _Above:
        """The same with the name, support and transformation of one more object."""
        attributes = data.get("attributes") or {}
        moved = data.get("transformation")
        matrix = np.eye(4) if not moved else np.reshape(moved["data"]["matrix"], (4, 4))
        return _Above(
            str(data.get("name") or attributes.get("name") or self.name),
            self.held or any(bool(of.get("is_support")) for of in (data, attributes)),
            self.matrix @ matrix,
        )

    def surface(self, points: Any, faces: Any) -> NamedSurface:
        """Faces in the frame of the file."""
        own = np.array(points, dtype=np.float64).reshape(-1, 3)
        placed = own @ self.matrix[:3, :3].T + self.matrix[:3, 3]
        return NamedSurface(self.name, placed, by_corners(iter(faces)), self.held)


class _Reader:
    """Walks through nested objects, and counts those that are no blocks."""

    def __init__(self) -> None:
        self.others: Counter[str] = Counter()
        """By type."""

    def blocks(self, data: Any, above: _Above) -> Iterator[NamedSurface]:
        """Blocks in an object, a list or a mapping of them."""
        if isinstance(data, list):
            for part in data:
                yield from self.blocks(part, above)
        if not isinstance(data, Mapping):
            return
        kind, above, n = _kind(data), above.inside(data), 0
        if kind in _SOLIDS or kind.endswith("Brep"):
            raise MeshError(
                f"{above.name or 'an object'} is a {kind}, which has no faces in the file; "
                "expected a Mesh, a Box or a Polyhedron: convert it in compas"
            )
        if kind in ("Box", "Polyhedron"):
            yield _shape(data["data"], above)
            return
        n_others = self.others.total()
        for surface in self._inside(data, above):
            n += 1
            yield surface
        if kind and not n and self.others.total() == n_others:
            self._count(data)

    def _inside(self, data: Mapping[str, Any], above: _Above) -> Iterator[NamedSurface]:
        used = {"vertex", "face", "transformation"}
        if isinstance(data.get("vertex"), Mapping) and isinstance(data.get("face"), Mapping):
            yield _mesh(data, above)
        if isinstance(data.get("elements"), Mapping):
            used |= {"elements", "tree"}
            yield from self._model(data, above)
        if isinstance(data.get("assembly"), Mapping) and isinstance(data.get("blocks"), Mapping):
            used |= {"assembly", "blocks"}  # compas_assembly before its version 0.4
            nodes, edges = data["assembly"].get("node", {}), data["assembly"].get("edge", {})
            self._count(edges)
            for key, part in data["blocks"].items():
                yield from self.blocks(part, replace(above, name=key).inside(nodes.get(key, {})))
        for key, part in data.items():
            if key in _NO_BLOCKS:
                self._count(part)
            elif key not in used:
                own = isinstance(part, Mapping) and "block" in part
                yield from self.blocks(part, replace(above, name=str(key)) if own else above)

    def _model(self, data: Mapping[str, Any], above: _Above) -> Iterator[NamedSurface]:
        """Elements in the order of the file, moved by those above them in the tree."""
        elements, places = data["elements"], {}

        def descend(node: Mapping[str, Any], above: _Above) -> None:
            for child in node.get("children") or ():
                key = str(child.get("element"))
                places[key], one = above, elements.get(key, {})
                inner = above.inside(one.get("data", one))
                descend(child, replace(above, matrix=inner.matrix))

        tree = data.get("tree") or {}
        descend(tree.get("data", tree).get("root") or {}, above)
        for key, one in elements.items():
            yield from self._element(one, places.get(key, above))

    def _element(self, one: Mapping[str, Any], above: _Above) -> Iterator[NamedSurface]:
        data = one.get("data", one)
        above = replace(above, name=str(one.get("name") or "")).inside(data)
        if data.get("geometry") is None and _kind(one) != "Group":
            raise MeshError(
                f"element {above.name} ({_kind(one)}) has no mesh in the file; expected one: "
                "store its geometry in compas"
            )
        for surface in self.blocks(data.get("geometry"), above):
            yield replace(surface, name=above.name or surface.name)
        self._count([part for key, part in data.items() if key != "geometry"])

    def _count(self, data: Any) -> None:
        """Count objects as no blocks, by type; not what is inside them."""
        kind = _kind(data) if isinstance(data, Mapping) else ""
        if kind:
            self.others[kind] += kind not in _PLACES
        elif isinstance(data, Mapping | list):
            for part in data.values() if isinstance(data, Mapping) else data:
                self._count(part)
        self.others = +self.others


def _kind(data: Mapping[str, Any]) -> str:
    """Type of an object of compas; empty for plain data."""
    return str(data.get("dtype", "")).rpartition("/")[2]


def _mesh(data: Mapping[str, Any], above: _Above) -> NamedSurface:
    number = {key: place for place, key in enumerate(data["vertex"])}
    common = {"x": 0.0, "y": 0.0, "z": 0.0, **(data.get("default_vertex_attributes") or {})}
    points = [[float(v.get(x, common[x])) for x in "xyz"] for v in data["vertex"].values()]
    faces = [[number[str(corner)] for corner in face] for face in data["face"].values()]
    return above.surface(points, faces)


def _shape(data: Mapping[str, Any], above: _Above) -> NamedSurface:
    """A box in its frame, or a polyhedron."""
    if "vertices" in data:
        return above.surface(data["vertices"], data["faces"])
    frame = data["frame"].get("data", data["frame"])
    # The y axis counts by its part across the x axis, as in `compas.geometry.Frame`.
    z = np.cross(frame["xaxis"], frame["yaxis"])
    axes = np.array(
        [one / np.linalg.norm(one) for one in (frame["xaxis"], np.cross(z, frame["xaxis"]), z)]
    )
    half = 0.5 * np.array([data[f"{axis}size"] for axis in "xyz"])
    corners = half * np.array(list(product((-1.0, 1.0), repeat=3)))
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return above.surface(frame["point"] + corners @ axes, map(list, faces))
