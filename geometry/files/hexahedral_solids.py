"""Hexahedra of blocks from files: read from mesh files, or made where the geometry allows.

A solid with six flat sides of four corners each (a box, a voussoir, a truncated wedge) has a grid,
the trilinear image of a cube. STEP solids whose faces all have three or four sides go through
gmsh's transfinite meshing. Blocks that share such a side get the same nodes there. gmsh fills any
other solid with tetrahedra and splits each into four hexahedra.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from geometry.assembly import Assembly
from geometry.block import Block, Curve
from geometry.files.block_files import (
    STEP_SUFFIXES,
    SURFACES_ALONE,
    UNITS,
    gmsh_session,
    hexahedra_in,
    step_hexahedra,
)
from geometry.files.mesh_io import HEXAHEDRA, hexahedra_of, read_any_mesh
from geometry.files.named_sets import NamedSets, named_sets
from geometry.files.quadratic import quadratic_curve
from geometry.mesh import (
    CUBE,
    FloatArray,
    HexMesh,
    IntArray,
    MeshError,
    boundary_quads,
    check_mesh,
    connected_parts,
    grid_points,
    structured_hexahedra,
)
from geometry.polyhedra.assembly import (
    PolyhedralAssembly,
    as_polyhedral,
    contact_distance,
)
from geometry.polyhedra.near_joints import unmatched_joints
from geometry.polyhedra.overlap import check_assembly
from geometry.polyhedra.polyhedron import Polyhedron

#: Face of a block made of hexahedra without names: its whole surface.
SURFACE = "surface"
#: Largest distance of a solid's centroid from that of its hexahedra, in block sizes: the faces of
#: curved hexahedra are straightened there.
_SAME_PLACE = 0.1
#: Largest sine of the angle at a corner that still counts as a straight side.
_STRAIGHT = 1e-6
#: Digits of the places that gmsh gets: more than tolerances see, fewer than rounding far from the
#: origin changes.
_DIGITS = 11


def hexahedral_block(name: str, mesh: HexMesh, curve: Curve | None = None) -> Block:
    """Block whose whole surface can meet other blocks.

    Raises
    ------
    MeshError
        Bad hexahedra.
    """
    check_mesh(mesh, name)
    return Block(name, mesh, {SURFACE: boundary_quads(mesh)}, (SURFACE,), curve)


def file_blocks(
    path: Path,
    solids: list[Polyhedron],
    *,
    units: str,
    divisions: int,
    size: float | None = None,
) -> list[Block]:
    """Hexahedra of each solid of a file, curved where the file gives 20 or 27 nodes.

    Parameters
    ----------
    path
        The file.
    solids
        What `read_blocks` finds in it.
    units
        Unit of a mesh file: mm, cm, m or inch.
    divisions, size
        Of a solid that has no hexahedra in the file, as in `solid_block`.

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
        if not meshes:
            return [solid_block(solid, divisions, size) for solid in solids]
        return _of_solids([hexahedral_block("part", mesh) for mesh in meshes], solids)
    if path.suffix.lower() in SURFACES_ALONE:
        return [solid_block(solid, divisions, size) for solid in solids]
    read = read_any_mesh(path)
    if not any(cells.type in HEXAHEDRA for cells in read.cells):
        return [solid_block(solid, divisions, size) for solid in solids]
    mesh, members = hexahedra_of(read, path)
    scaled = HexMesh(UNITS[units] * mesh.nodes, mesh.elements)
    return _of_solids(connected_solids(path, scaled, members, named_sets(path, read)), solids)


def connected_solids(
    path: Path, mesh: HexMesh, members: IntArray, sets: NamedSets | None = None
) -> list[Block]:
    """Parts of a mesh that share no corner, in the order of their first elements.

    ``members`` are all nodes of each element, (n_elements, 8, 20 or 27); messages name the file.
    Sets of the file are faces and edges of the parts.
    """
    check_mesh(mesh, str(path))
    n = mesh.n_elements
    label = connected_parts(n + mesh.n_nodes, np.repeat(np.arange(n), 8), n + mesh.elements.ravel())
    label = label[:n]
    parts = []
    for number in range(int(label.max()) + 1):
        mine = label == number
        nodes, renumbered = np.unique(mesh.elements[mine], return_inverse=True)
        part = HexMesh(mesh.nodes[nodes], renumbered.reshape(-1, 8).astype(np.int64))
        curve = None
        if members.shape[1] > 8:
            curve = quadratic_curve(path, part.elements, mesh.nodes[members[mine]])
        block = hexahedral_block("part", part, curve)
        if sets is not None:
            outer = block.faces[SURFACE]
            named, corners = sets.faces(outer, nodes), sets.edges(outer, nodes)
            edges = {name: part.nodes[k] for name, k in corners.items() if name not in named}
            block = replace(block, faces=block.faces | named, edge_sets=edges)
        parts.append(block)
    return parts


def _of_solids(blocks: list[Block], solids: list[Polyhedron]) -> list[Block]:
    """Assign to each solid the hexahedra that fill it: a ring and its core have one centre."""
    places = np.array([_place(block.centroid, block.mesh.nodes) for block in blocks])
    result = []
    for solid in solids:
        away = np.linalg.norm(places - _place(solid.centroid, solid.points), axis=2)
        nearest = int(np.argmin(away.sum(axis=1)))
        if away[nearest, 0] > _SAME_PLACE * float(np.cbrt(solid.volume)):
            raise MeshError(f"{solid.name}: no hexahedra of the file fill this solid")
        result.append(replace(blocks[nearest], name=solid.name))
    return result


def _place(centre: FloatArray, points: FloatArray) -> FloatArray:
    """Centre, least and largest coordinates, (3, 3) [mm]."""
    return np.array([centre, points.min(axis=0), points.max(axis=0)])


def with_hexahedra(
    solids: PolyhedralAssembly,
    divisions: int,
    size: float | None,
    supported: Callable[[Assembly], IntArray],
) -> Assembly:
    """Solids as blocks with hexahedra, those that their files have or others.

    Parameters
    ----------
    solids
        As placed.
    divisions, size
        Of solids without hexahedra, as in `solid_block`.
    supported
        Numbers of the blocks that supports hold, of the blocks with hexahedra.

    Raises
    ------
    MeshError
        A solid for which there are no hexahedra.
    AssemblyError
        As `check_assembly`, of the surfaces of the hexahedra.
    """
    blocks = Assembly(
        **solids.as_placed,
        shapes=_of_shapes(solids.shapes, divisions, size),
        layer=np.where(solids.fixed, 0, 1),
        unmatched_allowed=True,
        detection=solids.detection,
    )
    surfaces = as_polyhedral(blocks, solids.detection)
    check_assembly(surfaces, supported(blocks), solids)
    unmatched = unmatched_joints(blocks, surfaces)
    return replace(blocks, layer=contact_distance(surfaces), unmatched=unmatched)


def _of_shapes(
    solids: tuple[Polyhedron, ...], divisions: int, size: float | None
) -> tuple[Block, ...]:
    """Hexahedra of each solid; files are read once."""
    result: dict[int, Block] = {}
    for source in dict.fromkeys(solid.source for solid in solids):
        own = [k for k, solid in enumerate(solids) if solid.source == source]
        shapes = [solids[k] for k in own]
        if source is None:
            blocks = [solid_block(solid, divisions, size) for solid in shapes]
        else:
            path, units = source
            blocks = file_blocks(path, shapes, units=units, divisions=divisions, size=size)
        result |= dict(zip(own, blocks, strict=True))
    return tuple(result[k] for k in range(len(solids)))


def solid_block(solid: Polyhedron, divisions: int, size: float | None = None) -> Block:
    """Hexahedra of any solid.

    Parameters
    ----------
    solid
        What is meshed.
    divisions
        Elements along each edge of a solid with six flat sides of four corners.
    size
        Edge of the tetrahedra of any other solid [mm]; None: ∛V.

    Raises
    ------
    MeshError
        A solid that gmsh cannot fill.
    """
    mesh = six_sided_hexahedra(solid, divisions)
    if mesh is not None:
        anew = partial(solid_block, solid)
        return replace(hexahedral_block(solid.name, mesh), divided=anew)
    size = size or float(np.cbrt(solid.volume))
    split = split_tetrahedra(solid, size)
    return replace(hexahedral_block(solid.name, split), tetrahedra=size)


# ---------------------------------------------------------------------------------------------
# Any flat sides


def split_tetrahedra(solid: Polyhedron, size: float) -> HexMesh:
    """Fill a solid with tetrahedra of a size [mm], each split into four hexahedra, by gmsh.

    Every flat side stays flat, and every edge stays an edge: triangles of the surface that are
    smaller than the size are kept as they are. A solid has the same mesh wherever it stands: gmsh
    gets places relative to its first point, without digits that rounding decides.

    Raises
    ------
    MeshError
        Where gmsh finds no mesh.
    """
    why, origin = "its mesh is empty", solid.points[0]
    kept = _DIGITS - math.ceil(math.log10(np.ptp(solid.points, axis=0).max()))
    local = replace(solid, points=np.round(solid.points - origin, kept))
    for whole_sides in (True, False):
        with gmsh_session(solid.name) as gmsh:
            options = {"MeshSizeMin": size, "MeshSizeMax": size, "SubdivisionAlgorithm": 2}
            for name, value in options.items():
                gmsh.option.setNumber(f"Mesh.{name}", value)
            volume = _gmsh_solid(gmsh, local, whole_sides=whole_sides)
            try:
                gmsh.model.mesh.generate(3)
                mesh = hexahedra_in(gmsh, volume)
            except Exception as error:  # gmsh raises bare exceptions
                why = str(error)
                continue
        if mesh.n_elements:
            return replace(mesh, nodes=mesh.nodes + origin)
    raise MeshError(
        f"{solid.name}: gmsh finds no tetrahedra ({why}); expected another `size` than "
        f"{size:.3g} mm, or a file of hexahedra (.vtu, .inp)"
    )


def _gmsh_solid(gmsh: Any, solid: Polyhedron, *, whole_sides: bool) -> int:
    """A solid in gmsh: a face for each flat side, or for each triangle, as of one with holes."""
    geo = gmsh.model.geo
    points = [geo.addPoint(*point) for point in solid.points]
    lines: dict[tuple[int, int], int] = {}
    faces = []
    for plane in range(int(solid.plane_of.max()) + 1):
        side = solid.outline(plane) if whole_sides else None
        for loop in [side] if side else solid.triangles[solid.plane_of == plane].tolist():
            curve = []
            for a, b in zip(loop, loop[1:] + loop[:1], strict=True):
                if (b, a) not in lines and (a, b) not in lines:
                    lines[a, b] = geo.addLine(points[a], points[b])
                curve.append(lines[a, b] if (a, b) in lines else -lines[b, a])
            faces.append(geo.addPlaneSurface([geo.addCurveLoop(curve)]))
    volume = geo.addVolume([geo.addSurfaceLoop(faces)])
    geo.synchronize()
    return int(volume)


# ---------------------------------------------------------------------------------------------
# Six flat sides


def six_sided_hexahedra(solid: Polyhedron, divisions: int) -> HexMesh | None:
    """Divide a solid with six flat four-cornered sides into divisions³ hexahedra.

    None for a solid of another kind, and where the sides are so oblique that hexahedra fold.
    """
    if int(solid.plane_of.max()) != 5:
        return None
    sides = [flat_side(solid, plane) for plane in range(6)]
    if any(len(corners) != 4 for corners in sides):
        return None
    cube = _cube_corners(sides)
    if cube is None:
        return None
    mesh = _trilinear(solid.points[cube], divisions)
    try:
        check_mesh(mesh, solid.name)
    except MeshError:
        return None
    return mesh


def flat_side(solid: Polyhedron, plane: int) -> list[int]:
    """Corners of one flat side in order round it; empty where it is no simple polygon."""
    loop = solid.outline(plane)
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
