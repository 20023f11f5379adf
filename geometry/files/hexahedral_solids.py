"""Hexahedra of blocks from files: read from mesh files, or made where the geometry allows.

A solid that is drawn as a surface has hexahedra where it has six flat sides with four corners
each (a box, a voussoir, a truncated wedge): the grid is the trilinear image of a cube. STEP solids
with curved sides go through gmsh's transfinite meshing. Blocks that share a side get the same
nodes there.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from geometry.block import Block, Curve
from geometry.files.block_files import STEP_SUFFIXES, UNITS, step_hexahedra
from geometry.files.mesh_io import HEXAHEDRA, hexahedra_of, read_any_mesh
from geometry.files.quadratic import quadratic_curve
from geometry.mesh import (
    CUBE,
    FloatArray,
    HexMesh,
    IntArray,
    MeshError,
    boundary_quads,
    check_mesh,
    grid_points,
    structured_hexahedra,
)
from geometry.polyhedra.polyhedron import Polyhedron

#: Face of a block made of hexahedra without names: its whole surface.
SURFACE = "surface"
#: Largest distance of a solid's centroid from that of its hexahedra, in block sizes: the faces of
#: curved hexahedra are straightened there.
_SAME_PLACE = 0.1
#: Largest sine of the angle at a corner that still counts as a straight side.
_STRAIGHT = 1e-6


def hexahedral_block(name: str, mesh: HexMesh, curve: Curve | None = None) -> Block:
    """Block whose whole surface can meet other blocks.

    Raises
    ------
    MeshError
        Bad hexahedra.
    """
    check_mesh(mesh, name)
    return Block(name, mesh, {SURFACE: boundary_quads(mesh)}, (SURFACE,), curve)


def file_blocks(path: Path, solids: list[Polyhedron], *, units: str, divisions: int) -> list[Block]:
    """Hexahedra of each solid of a file, curved where the file gives 20 or 27 nodes.

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
    list[Block]
        In the order of the solids [mm].

    Raises
    ------
    MeshError
        Naming the solid for which there are no hexahedra, and why.
    """
    if path.suffix.lower() in STEP_SUFFIXES:
        meshes = step_hexahedra(path, divisions=divisions)
        return _of_solids([hexahedral_block("part", mesh) for mesh in meshes], solids)
    read = read_any_mesh(path)
    if not any(cells.type in HEXAHEDRA for cells in read.cells):
        return [hexahedral_block(s.name, six_sided_hexahedra(s, divisions)) for s in solids]
    mesh, members = hexahedra_of(read, path)
    scaled = HexMesh(UNITS[units] * mesh.nodes, mesh.elements)
    return _of_solids(connected_solids(path, scaled, members), solids)


def connected_solids(path: Path, mesh: HexMesh, members: IntArray) -> list[Block]:
    """Parts of a mesh that share no corner, in the order of their first elements.

    ``members`` are all nodes of each element, (n_elements, 8, 20 or 27); messages name the file.
    """
    check_mesh(mesh, str(path))
    rows = np.repeat(np.arange(mesh.n_elements), 8)
    graph = coo_array(
        (np.ones(8 * mesh.n_elements), (rows, mesh.elements.ravel())),
        shape=(mesh.n_elements, mesh.n_nodes),
    ).tocsr()
    _, label = connected_components(graph @ graph.T, directed=False)
    parts = []
    for number in range(int(label.max()) + 1):
        mine = label == number
        nodes, renumbered = np.unique(mesh.elements[mine], return_inverse=True)
        part = HexMesh(mesh.nodes[nodes], renumbered.reshape(-1, 8).astype(np.int64))
        curve = None
        if members.shape[1] > 8:
            curve = quadratic_curve(path, part.elements, mesh.nodes[members[mine]])
        parts.append(hexahedral_block("part", part, curve))
    return parts


def _of_solids(blocks: list[Block], solids: list[Polyhedron]) -> list[Block]:
    """Assign to each solid the hexahedra that fill it."""
    centres = np.array([block.centroid for block in blocks])
    found = []
    for solid in solids:
        mass = solid.mass_properties
        away = np.linalg.norm(centres - mass.centroid, axis=1)
        nearest = int(np.argmin(away))
        if away[nearest] > _SAME_PLACE * float(np.cbrt(mass.volume)):
            raise MeshError(f"{solid.name}: no hexahedra of the file fill this solid")
        found.append(replace(blocks[nearest], name=solid.name))
    return found


# ---------------------------------------------------------------------------------------------
# Six flat sides


def six_sided_hexahedra(solid: Polyhedron, divisions: int) -> HexMesh:
    """Divide a solid with six flat four-cornered sides into divisions³ hexahedra.

    Raises
    ------
    MeshError
        A solid of another kind: how many sides it has, or which side has not four corners.
    """
    sides = [flat_side(solid, plane) for plane in range(int(solid.plane_of.max()) + 1)]
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


def flat_side(solid: Polyhedron, plane: int) -> list[int]:
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
    places = grid_points(s, s, s)
    weights = np.where(CUBE == 1, places[:, None], 1.0 - places[:, None]).prod(axis=2)
    elements: IntArray = structured_hexahedra(divisions, divisions, divisions)
    return HexMesh(weights @ corners, elements)
