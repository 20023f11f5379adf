"""Hexahedra of blocks from files: read from mesh files, or made where the geometry allows.

A solid that is drawn as a surface has hexahedra where it has six flat sides with four corners
each (a box, a voussoir, a truncated wedge): the grid is the trilinear image of a cube. STEP solids
with curved sides go through gmsh's transfinite meshing. Blocks that share a side get the same
nodes there.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from geometry.block import Block
from geometry.files.block_files import STEP_SUFFIXES, UNITS, step_hexahedra
from geometry.files.mesh_io import read_any_mesh, read_hex_mesh
from geometry.mesh import (
    FloatArray,
    HexMesh,
    IntArray,
    MeshError,
    boundary_quads,
    check_mesh,
    structured_hexahedra,
)
from geometry.polyhedra.polyhedron import Polyhedron

#: Face of a block made of hexahedra without names: its whole surface.
SURFACE = "surface"
#: Largest distance of a solid's centroid from that of its hexahedra, in block sizes.
_SAME_PLACE = 1e-2
#: Largest sine of the angle at a corner that still counts as a straight side.
_STRAIGHT = 1e-6


def hexahedral_block(name: str, mesh: HexMesh) -> Block:
    """Block whose whole surface can meet other blocks.

    Raises
    ------
    MeshError
        Bad hexahedra.
    """
    check_mesh(mesh, name)
    return Block(name, mesh, {SURFACE: boundary_quads(mesh)}, (SURFACE,))


def file_hexahedra(
    path: Path, solids: list[Polyhedron], *, units: str, divisions: int
) -> list[HexMesh]:
    """Hexahedra of each solid of a file.

    Parameters
    ----------
    path
        The file.
    solids
        What `read_blocks` finds in it.
    units
        Unit of a mesh file: mm, cm, m or inch.
    divisions
        Elements along each edge of a solid that has no hexahedra in the file.

    Returns
    -------
    list[HexMesh]
        In the order of the solids [mm].

    Raises
    ------
    MeshError
        Naming the solid for which there are no hexahedra, and why.
    """
    suffix = path.suffix.lower()
    if suffix in STEP_SUFFIXES:
        return _of_solids(step_hexahedra(path, divisions=divisions), solids)
    if _has_hexahedra(path):
        mesh = read_hex_mesh(path)
        scaled = HexMesh(UNITS[units] * mesh.nodes, mesh.elements)
        return _of_solids(connected_solids(scaled), solids)
    return [six_sided_hexahedra(solid, divisions) for solid in solids]


def _has_hexahedra(path: Path) -> bool:
    return any(cells.type == "hexahedron" for cells in read_any_mesh(path).cells)


def connected_solids(mesh: HexMesh) -> list[HexMesh]:
    """Parts of a mesh that share no node, in the order of their first elements."""
    rows = np.repeat(np.arange(mesh.n_elements), 8)
    graph = coo_array(
        (np.ones(8 * mesh.n_elements), (rows, mesh.elements.ravel())),
        shape=(mesh.n_elements, mesh.n_nodes),
    ).tocsr()
    _, label = connected_components(graph @ graph.T, directed=False)
    parts = []
    for number in range(int(label.max()) + 1):
        nodes, renumbered = np.unique(mesh.elements[label == number], return_inverse=True)
        parts.append(HexMesh(mesh.nodes[nodes], renumbered.reshape(-1, 8).astype(np.int64)))
    return parts


def _of_solids(meshes: list[HexMesh], solids: list[Polyhedron]) -> list[HexMesh]:
    """Assign to each solid the hexahedra that fill it."""
    centres = np.array([Block("part", m, {}).mass_properties.centroid for m in meshes])
    found = []
    for solid in solids:
        mass = solid.mass_properties
        away = np.linalg.norm(centres - mass.centroid, axis=1)
        nearest = int(np.argmin(away))
        if away[nearest] > _SAME_PLACE * float(np.cbrt(mass.volume)):
            raise MeshError(f"{solid.name}: no hexahedra of the file fill this solid")
        found.append(meshes[nearest])
    return found


# ---------------------------------------------------------------------------------------------
# Six flat sides


def six_sided_hexahedra(solid: Polyhedron, divisions: int) -> HexMesh:
    """Divide a solid with six flat four-cornered sides into divisions³ hexahedra.

    Parameters
    ----------
    solid
        Closed surface.
    divisions
        Elements along each edge.

    Raises
    ------
    MeshError
        A solid of another kind: how many sides it has, or which side has not four corners.
    """
    sides = [_side(solid, plane) for plane in range(int(solid.plane_of.max()) + 1)]
    why = "expected six flat sides with four corners each, or a file of hexahedra (.vtu, .inp)"
    if len(sides) != 6:
        raise MeshError(f"{solid.name}: got a solid with {len(sides)} flat sides; {why}")
    for plane, corners in enumerate(sides):
        if len(corners) != 4:
            normal = solid.normals[solid.plane_of == plane][0]
            raise MeshError(
                f"{solid.name}: the side that faces {np.round(normal, 3).tolist()} has "
                f"{len(corners)} corners; {why}"
            )
    cube = _cube_corners(sides)
    if cube is None:
        raise MeshError(f"{solid.name}: its six sides are not joined like those of a cube; {why}")
    mesh = _trilinear(solid.points[cube], divisions)
    check_mesh(mesh, solid.name)
    return mesh


def _side(solid: Polyhedron, plane: int) -> list[int]:
    """Corners of one flat side in order round it; empty where it is no simple polygon."""
    triangles = solid.triangles[solid.plane_of == plane]
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    known = {(a, b) for a, b in edges.tolist()}
    following = {a: b for a, b in known if (b, a) not in known}
    if not following:
        return []
    loop = [next(iter(following))]
    while following.get(loop[-1], loop[0]) != loop[0] and len(loop) <= len(following):
        loop.append(following[loop[-1]])
    if len(loop) != len(following):
        return []
    points = solid.points[loop]
    after, before = np.roll(points, -1, axis=0) - points, points - np.roll(points, 1, axis=0)
    turn = np.linalg.norm(np.cross(before, after), axis=1)
    size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    return [node for node, bent in zip(loop, turn > _STRAIGHT * size, strict=True) if bent]


def _cube_corners(sides: list[list[int]]) -> list[int] | None:
    """Eight points in VTK order, from six sides that run counter-clockwise seen from outside."""
    first = sides[0]
    above = {}
    for corner in first:
        neighbours = {
            other
            for side in sides[1:]
            for a, b in zip(side, side[1:] + side[:1], strict=True)
            for other in ((b,) if a == corner else (a,) if b == corner else ())
        }
        up = neighbours - set(first)
        if len(up) != 1:
            return None
        above[corner] = up.pop()
    if len(set(above.values())) != 4:
        return None
    bottom = first[::-1]  # seen from inside: counter-clockwise about the upward direction
    return [*bottom, *(above[corner] for corner in bottom)]


def _trilinear(corners: FloatArray, divisions: int) -> HexMesh:
    """Grid of a cube mapped on eight corners in VTK order."""
    s = np.linspace(0.0, 1.0, divisions + 1)
    u, v, w = (g.ravel() for g in np.meshgrid(s, s, s, indexing="ij"))
    where = np.array(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    )
    weights = np.ones((len(u), 8))
    for axis, value in enumerate((u, v, w)):
        weights *= np.where(where[:, axis] == 1, value[:, None], 1.0 - value[:, None])
    elements: IntArray = structured_hexahedra(divisions, divisions, divisions)
    return HexMesh(weights @ corners, elements)
