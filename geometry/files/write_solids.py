"""Solids as other programs read them: OBJ with an object for each block, assemblies of compas."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from geometry.machine.system import write_whole
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.polyhedron import Polyhedron

#: Suffixes of the formats.
SOLID_SUFFIXES = {".obj", ".json"}


def flat_faces(block: Polyhedron) -> list[list[int]]:
    """Flat faces as polygons, counter-clockwise seen from outside; triangles where they have holes.

    Corners are numbers of the block's points.
    """
    faces: list[list[int]] = []
    for plane in np.unique(block.plane_of):
        loop = block.outline(plane)
        faces += [loop] if loop else block.triangles[block.plane_of == plane].tolist()
    return faces


def write_solids(path: Path, assembly: PolyhedralAssembly) -> None:
    """Write the blocks where they stand [mm], with names and, in JSON, supports.

    Parameters
    ----------
    path
        .obj (one object for each block) or .json (`compas_assembly.datastructures.Assembly`).
    assembly
        The blocks.
    """
    faces = [flat_faces(shape) for shape in assembly.shapes]
    blocks = [
        (
            assembly.names[b] if assembly.names else "",
            assembly.points(b),
            faces[assembly.shape_of[b]],
        )
        for b in range(assembly.n_blocks)
    ]
    if path.suffix.lower() == ".obj":
        text = "\n".join(_obj_lines(blocks)) + "\n"
    else:
        held = assembly.fixed.tolist()
        nodes = {
            str(k): {"block": _compas_block(name, points, polygons), "is_support": held[k]}
            for k, (name, points, polygons) in enumerate(blocks)
        }
        text = json.dumps(_compas_assembly(assembly.name, nodes))
    write_whole(path, lambda partial: partial.write_text(text, encoding="utf-8"))


_Block = tuple[str, FloatArray, list[list[int]]]


def _obj_lines(blocks: list[_Block]) -> Iterator[str]:
    """Lengths in mm."""
    first = 1
    for k, (name, points, polygons) in enumerate(blocks):
        yield f"o {name or f'block {k}'}"
        yield from (f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist())
        yield from ("f " + " ".join(str(first + corner) for corner in face) for face in polygons)
        first += len(points)


def _compas_block(name: str, points: FloatArray, polygons: list[list[int]]) -> dict[str, Any]:
    return {
        "dtype": "compas_assembly.datastructures/Block",
        "data": {
            "attributes": {"name": name} if name else {},
            "default_vertex_attributes": {"x": 0.0, "y": 0.0, "z": 0.0},
            "default_edge_attributes": {},
            "default_face_attributes": {},
            "vertex": {
                str(k): dict(zip("xyz", point, strict=True))
                for k, point in enumerate(points.tolist())
            },
            "face": {str(k): face for k, face in enumerate(polygons)},
            "facedata": {},
            "edgedata": {},
            "max_vertex": len(points) - 1,
            "max_face": len(polygons) - 1,
        },
    }


def _compas_assembly(name: str, nodes: dict[str, Any]) -> dict[str, Any]:
    graph = {
        "attributes": {},
        "default_node_attributes": {"block": None, "is_support": False},
        "default_edge_attributes": {"interfaces": None},
        "node": nodes,
        "edge": {node: {} for node in nodes},
        "max_node": len(nodes) - 1,
    }
    return {
        "dtype": "compas_assembly.datastructures/Assembly",
        "data": {
            "attributes": {"name": name},
            "graph": {"dtype": "compas.datastructures/Graph", "data": graph},
        },
    }
