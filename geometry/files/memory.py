"""Blocks of meshes in memory: of trimesh, pyvista, compas, or plain arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from operator import index
from typing import Any, Literal

import numpy as np

from geometry.assembly import AssemblyError, check_size
from geometry.files.block_files import millimetres, surface_blocks
from geometry.files.named_surfaces import Y_UP, NamedSurface, by_corners
from geometry.mesh import IntArray, MeshError
from geometry.parts.chosen import numbers_of
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.options import DetectionOptions
from geometry.polyhedra.overlap import check_assembly

_EXPECTED = (
    "expected a trimesh.Trimesh, a pyvista.PolyData, a compas Mesh, or a pair (vertices, faces)"
)


def blocks(
    meshes: Iterable[Any],
    *,
    names: Sequence[str] | None = None,
    fixed: int | str | Iterable[int | str] | None = (),
    units: str = "mm",
    up: Literal["y", "z"] = "z",
    repair: bool = False,
    detection: DetectionOptions | None = None,
) -> PolyhedralAssembly:
    """Blocks of closed surface meshes, with the checks and repairs of blocks from files.

    Parameters
    ----------
    meshes
        Closed surfaces: objects with ``vertices`` or ``points`` and ``faces`` (trimesh, pyvista),
        with ``to_vertices_and_faces`` (compas), or pairs of vertices (n, 3) and faces, triangles or
        polygons. Each closed part of a mesh is a block; a surface that faces inward is turned.
    names
        Of the meshes; by default they have none.
    fixed
        Blocks that do not move: their numbers, counted from 0, or names. None: no block is, for
        supports of the load hold parts of free blocks.
    units
        Of the vertices: mm, cm, m or inch.
    up
        Axis of the vertices that points up; y becomes z.
    repair
        Whether to drop triangles that are there twice, to turn those that face the wrong way and to
        close flat holes.
    detection
        Tolerances of contact detection.

    Raises
    ------
    MeshError
        What is no mesh, or a surface that bounds no solid: open, folded, cutting through itself.
    AssemblyError
        Names that are there twice, blocks to fix that are not there, nothing fixed or everything,
        blocks of an implausible size, that overlap, or that touch no other.
    OptionError
        Tolerances that cannot be used.
    """
    scale, surfaces = millimetres(units), _surfaces(meshes, names)
    if up not in ("y", "z"):
        raise MeshError(f"up: got {up!r}; expected 'y' or 'z'")
    solids = [
        block
        for place, surface in enumerate(surfaces)
        for block in surface_blocks(f"meshes[{place}]", surface, scale=scale, repair=repair)
    ]
    given = tuple(solid.given_name for solid in solids)
    held = np.zeros(len(solids), dtype=np.bool_)
    for one in _chosen(fixed):
        held[numbers_of("fixed", one, given)] = True
    turn = Y_UP if up == "y" else np.eye(3)
    assembly = polyhedral_assembly(
        "own blocks",
        [(solid, turn, np.zeros(3)) for solid in solids],
        held,
        detection,
        given if any(given) else (),
        supported=fixed is None,
    )
    check_size(assembly)
    check_assembly(assembly, np.arange(len(solids)) if fixed is None else None)
    return assembly


def _surfaces(meshes: Any, names: Any) -> list[NamedSurface]:
    """Surface of each mesh, under its name."""
    if not isinstance(meshes, Iterable) or hasattr(meshes, "faces") or isinstance(meshes, str):
        raise MeshError(f"meshes: got a {type(meshes).__name__}; expected a list of meshes")
    listed = list(meshes)
    if names is None:
        titles = [""] * len(listed)
    elif isinstance(names, str) or not all(isinstance(name, str) and name for name in names):
        raise AssemblyError(f"names: got {names!r}; expected a list of names, one for each mesh")
    else:
        titles = list(names)
        if len(titles) != len(listed):
            raise AssemblyError(
                f"names: got {len(titles)} for {len(listed)} meshes; expected one for each"
            )
        twice = [name for name, count in Counter(titles).items() if count > 1]
        if twice:
            raise AssemblyError(
                f"names: {twice[0]!r} is there {titles.count(twice[0])} times; expected each once"
            )
    return [
        _surface(f"meshes[{k}]", *one) for k, one in enumerate(zip(listed, titles, strict=True))
    ]


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
