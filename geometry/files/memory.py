"""Solids of meshes in memory: of trimesh, pyvista, compas, or plain arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from operator import index
from typing import Any

import numpy as np

from geometry.files.block_files import millimetres, surface_blocks
from geometry.files.named_surfaces import Y_UP, NamedSurface, by_corners
from geometry.mesh import BoolArray, FloatArray, IntArray, MeshError
from geometry.parts.block_selection import numbers_of
from geometry.parts.placed import AssemblyError
from geometry.polyhedra.polyhedron import Polyhedron

_EXPECTED = (
    "expected a solid of read_blocks, a trimesh.Trimesh, a pyvista.PolyData, a compas Mesh, or a "
    "pair (vertices, faces)"
)


def solids_of(
    blocks: Iterable[Any], names: Sequence[str] | None, *, units: str, repair: bool
) -> list[Polyhedron]:
    """Solids of `geometry.Assembly.from_blocks`, each closed part of a surface one.

    Raises
    ------
    MeshError
        As there.
    """
    scale = millimetres(units)
    if not isinstance(repair, bool):
        raise MeshError(f"repair: got {repair!r}; expected True or False")
    return [
        solid
        for k, (one, name) in enumerate(_named(blocks, names))
        for solid in (
            [replace(one, given_name=name or one.given_name)]
            if isinstance(one, Polyhedron)
            else surface_blocks(
                f"blocks[{k}]", _surface(f"blocks[{k}]", one, name), scale=scale, repair=repair
            )
        )
    ]


def rotation_to_z(up: str) -> FloatArray:
    """Rotation after which an axis, y or z, points up, (3, 3)."""
    if up not in ("y", "z"):
        raise MeshError(f"up: got {up!r}; expected 'y' or 'z'")
    return Y_UP if up == "y" else np.eye(3)


def fixed_among(
    solids: Sequence[Polyhedron], fixed: int | str | Iterable[int | str] | None
) -> BoolArray:
    """Whether each solid is fixed, by its number or name or as a support of its file, (n,)."""
    held = np.array([solid.held for solid in solids], dtype=np.bool_)
    names = [solid.given_name for solid in solids]
    for one in _chosen(fixed):
        held[numbers_of("fixed", one, names)] = True
    return held


def _named(blocks: Any, names: Any) -> list[tuple[Any, str]]:
    """Each block with its name."""
    alone = hasattr(blocks, "faces") or isinstance(blocks, str | Polyhedron)
    if alone or not isinstance(blocks, Iterable):
        raise MeshError(f"blocks: got a {type(blocks).__name__}; expected a list of blocks")
    listed = list(blocks)
    if names is None:
        titles = [""] * len(listed)
    elif isinstance(names, str) or not all(isinstance(name, str) and name for name in names):
        raise AssemblyError(f"names: got {names!r}; expected a list of names, one for each block")
    else:
        titles = list(names)
        if len(titles) != len(listed):
            raise AssemblyError(
                f"names: got {len(titles)} for {len(listed)} blocks; expected one for each"
            )
        twice = [name for name, count in Counter(titles).items() if count > 1]
        if twice:
            raise AssemblyError(
                f"names: {twice[0]!r} is there {titles.count(twice[0])} times; expected each once"
            )
    return list(zip(listed, titles, strict=True))


def _surface(place: str, mesh: Any, name: str) -> NamedSurface:
    if hasattr(mesh, "to_vertices_and_faces"):
        points, faces = mesh.to_vertices_and_faces()
    elif hasattr(mesh, "faces") and (hasattr(mesh, "vertices") or hasattr(mesh, "points")):
        points, faces = getattr(mesh, "vertices", getattr(mesh, "points", None)), mesh.faces
    elif isinstance(mesh, tuple | list) and len(mesh) == 2:
        points, faces = mesh
    else:
        raise MeshError(f"{place}: got a {type(mesh).__name__}; {_EXPECTED}")
    try:
        vertices = np.array(points, dtype=np.float64)
        polygons = _polygons(faces)
    except (ValueError, TypeError) as error:
        raise MeshError(f"{place}: cannot be read ({error}); {_EXPECTED}") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise MeshError(f"{place}: got vertices of shape {vertices.shape}; expected (n, 3)")
    if not polygons:
        raise MeshError(f"{place}: got no faces; expected a closed surface")
    low, high = min(int(p.min()) for p in polygons), max(int(p.max()) for p in polygons)
    if low < 0 or high >= len(vertices):
        raise MeshError(
            f"{place}: a face has vertex {high if high >= len(vertices) else low}; expected "
            f"numbers from 0 to {len(vertices) - 1}"
        )
    return NamedSurface(name, vertices, polygons)


def _polygons(faces: Any) -> tuple[IntArray, ...]:
    """Faces with the same number of corners together; flat arrays count the corners (VTK)."""
    if isinstance(faces, np.ndarray) and faces.ndim == 2 and np.issubdtype(faces.dtype, np.integer):
        return (np.array(faces, dtype=np.int64),) if len(faces) else ()
    if isinstance(faces, np.ndarray) and faces.ndim == 1 and faces.dtype != object:
        flat, rows, first = [index(k) for k in faces], [], 0
        while first < len(flat):
            rows.append(flat[first + 1 : first + 1 + flat[first]])
            first += 1 + flat[first]
    else:
        rows = [[index(k) for k in face] for face in faces]
    short = next((row for row in rows if len(row) < 3), None)
    if short is not None:
        raise ValueError(f"a face of {len(short)} corners")
    return by_corners(iter(rows))


def _chosen(fixed: int | str | Iterable[int | str] | None) -> list[int | str]:
    """Numbers and names of blocks; those of numpy become Python's."""
    if fixed is None:
        return []
    listed = [fixed] if isinstance(fixed, str) or not isinstance(fixed, Iterable) else [*fixed]
    result: list[int | str] = []
    for one in listed:
        if isinstance(one, bool | np.bool_) or not isinstance(one, str | int | np.integer):
            raise AssemblyError(
                f"fixed: got {one!r}; expected numbers or names of blocks, such as fixed=[0] or "
                "fixed=['base']"
            )
        result.append(one if isinstance(one, str) else int(one))
    return result
