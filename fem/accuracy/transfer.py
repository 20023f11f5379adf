"""A state of one mesh on another of the same blocks: a start to go on from, and means over facets.

Points of a block keep their chart and parameters on every mesh (`geometry.block`), so
values there are those of the functions of the elements in which they lie.

Means over facets have the size of the facets in their definition: those of the paper are over the
facets of a stated mesh, whatever elements were solved. A facet is cut into equal parts that are no
longer than the elements that were solved. On each part displacements are polynomials of the degree
of these elements. Means over elements' own facets are therefore exactly those of the solver.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from fem.contact.normals import ContactNormals
from fem.contact.surfaces import MatchedFacets, facet_pressures, matched_facets
from fem.element.functions import (
    FACET_CORNERS,
    FacetBasis,
    bilinear,
    facet_basis,
    facet_values,
    lobatto_points,
)
from fem.element.kinds import element_of
from fem.state import State
from fem.system.sector import representatives
from fem.system.system import System
from geometry.assembly import Assembly
from geometry.block import Block, Charts, Places, facet_elements, located, places_in
from geometry.mesh import (
    CORNERS,
    HEX_FACES,
    BoolArray,
    FloatArray,
    HexMesh,
    IntArray,
    grid_points,
    row_keys,
)
from geometry.parts.rows import Row
from geometry.refinement import charts_as, charts_of

#: Points on facets that are evaluated at a time: what a cache holds.
_AT_ONCE = 1 << 16


def node_places(block: Block) -> Places:
    """Places of all nodes of a block; of several elements that have a node, one counts."""
    mesh = block.mesh
    known, first = np.unique(mesh.connectivity.ravel(), return_index=True)
    element, local = np.divmod(first, mesh.connectivity.shape[1])
    at = np.zeros((mesh.n_nodes, 3))
    of = np.zeros(mesh.n_nodes, dtype=np.int64)
    at[known], of[known] = element_of(mesh).nodes[local], element
    return places_in(charts_of(block), of, at)


def interpolation(block: Block, places: Places) -> csr_array:
    """Values at places from those at the nodes of a block, (n, n_nodes)."""
    mesh = block.mesh
    element, natural = located(charts_of(block), places)
    result = _sums(mesh, element_of(mesh).values(natural), mesh.connectivity[element])
    result.eliminate_zeros()  # on a face all but its own nodes
    return result


def interpolation_on_faces(block: Block, places: Places) -> csr_array:
    """`interpolation` at places on faces of elements, where only the nodes of the face count."""
    mesh, kind = block.mesh, element_of(block.mesh)
    element, natural = located(charts_of(block), places)
    corners = CORNERS[HEX_FACES]
    face = (natural @ corners.mean(axis=1).T).argmax(axis=1)
    along = 0.5 * (corners[:, [1, 3]] - corners[:, :1])
    xi = (along[face] @ natural[:, :, None])[:, :, 0]
    members = mesh.connectivity[element[:, None], kind.face_nodes(HEX_FACES)[face]]
    return _sums(mesh, facet_values(xi, members.shape[1]), members)


def _sums(mesh: HexMesh, values: FloatArray, members: IntArray) -> csr_array:
    """Sums of functions (n, m) times values at their nodes (n, m), (n, n_nodes)."""
    pointer = values.shape[1] * np.arange(len(values) + 1)
    return csr_array((values.ravel(), members.ravel(), pointer), (len(values), mesh.n_nodes))


def transferred(
    displacements: tuple[FloatArray, ...], source: System, target: System
) -> tuple[FloatArray, ...]:
    """Displacements of each body at the nodes of another mesh of the same blocks.

    Parameters
    ----------
    displacements
        Of each body of the source, world axes, (n_copies, n_nodes, 3) [mm].
    source, target
        The same blocks on two meshes.

    Returns
    -------
    tuple[FloatArray, ...]
        The same of the target.
    """
    result = []
    for number, u in enumerate(displacements):
        to = interpolation(_shape(source, number), node_places(_shape(target, number)))
        moved = to @ np.concatenate(u, axis=1)
        result.append(np.stack(np.split(moved, len(u), axis=1)))
    return tuple(result)


def _shape(system: System, body: int) -> Block:
    block = int(np.flatnonzero(system.body_number == body)[0])
    return system.assembly.shape(block)


def unique_rows(rows: IntArray) -> tuple[IntArray, IntArray]:
    """Position of the first of the rows that differ, in their order, and which each row is."""
    _, first, number = np.unique(row_keys(rows), return_index=True, return_inverse=True)
    return first, np.asarray(number).ravel()


# ---------------------------------------------------------------------------------------------
# Means over facets


class MeshFacets(NamedTuple):
    """Facets of the mesh that was stated, on which a state of a finer one is averaged."""

    assembly: Assembly
    """The mesh."""
    pressures: FloatArray
    """Mean pressure on each of its `interfaces`, (n,) [MPa]."""

    @property
    def size(self) -> float:
        """Square root of the mean area [mm]."""
        return float(np.sqrt(self.assembly.interfaces.areas.mean()))

    @property
    def rows(self) -> list[Row]:
        """Their size."""
        words = f"those of [mesh], {self.size:.3g} mm (square root of the mean area)"
        return [Row("facets of p_eff, p_max", words, self.size, "mm", "model")]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {"size": self.size, "n": len(self.pressures)}


def means_on(blocks: Assembly, state: State) -> MeshFacets | None:
    """Means of a state over the facets of another mesh of the same blocks, where facets match."""
    solved, order = state.whole, state.system.orbits.order
    if not solved.meets or solved.contact.finite_sliding:
        return None
    means = pressures_on_facets(blocks, solved, state.displacements, symmetry=order)
    return MeshFacets(blocks, means)


def pressures_on_facets(
    facets: Assembly,
    solved: System,
    displacements: tuple[FloatArray, ...],
    *,
    symmetry: int = 1,
) -> FloatArray:
    """Mean pressure of every contact facet of a mesh, (n_contacts,) [MPa].

    Parameters
    ----------
    facets
        The blocks on the mesh whose facets are asked for, in the order of its interfaces.
    solved
        The same blocks on the mesh that was solved.
    displacements
        Of each body, world axes, (n_copies, n_nodes, 3) [mm].
    symmetry
        Order of a turn about the axis after which the state is the same: facets that it maps onto
        each other are evaluated once.
    """
    result = facets.interfaces
    alike = representatives(solved, symmetry)
    quads = unique_rows(result.quads_m)[1], unique_rows(result.quads_s)[1]
    # The same facets of all blocks stand together: those at a time share their interpolation.
    kinds = *quads, alike[result.block_m], alike[result.block_s]
    chosen, which = unique_rows(np.stack(kinds, axis=1))
    degree = max(shape.mesh.degree for shape in solved.assembly.shapes)
    at = _nodes_of_parts(_parts(facets, solved.assembly), degree)
    state = solved, displacements, alike
    bodies = np.array_split(chosen, math.ceil(len(chosen) * len(at) / _AT_ONCE) or 1)
    pressures = [_pressures(facets, state, body, (at, degree)) for body in bodies]
    return np.concatenate(pressures)[which]


def _pressures(
    facets: Assembly,
    state: tuple[System, tuple[FloatArray, ...], IntArray],
    chosen: IntArray,
    parts: tuple[FloatArray, int],
) -> FloatArray:
    """Mean pressures of some facets, (n,) [MPa], from the nodes of parts of a degree on each."""
    (solved, _, _), result, (at, degree) = state, facets.interfaces, parts
    basis = facet_basis(degree)
    n_parts = len(at) // len(basis.values[0])
    blocks = result.block_m[chosen], result.block_s[chosen]
    sides = zip(blocks, (result.quads_m[chosen], result.quads_s[chosen]), strict=True)
    shape = (len(chosen) * n_parts, -1, 3)
    (nodes_m, u_m), (nodes_s, u_s) = (
        tuple(values.reshape(shape) for values in _at_facets(facets, state, side, at))
        for side in sides
    )
    of_parts = np.repeat(blocks[0], n_parts), np.repeat(blocks[1], n_parts)
    surfaces = _surfaces(solved, basis, of_parts, (nodes_m, nodes_s))
    moved = np.concatenate([u_m, u_s], axis=1)
    overclosures = surfaces.overclosures(moved)
    law = solved.contact.law.on(surfaces.block_m, surfaces.block_s)
    of_part = facet_pressures(surfaces, law.pressure(overclosures))
    areas = surfaces.areas.reshape(-1, n_parts)
    return np.asarray(np.average(of_part.reshape(-1, n_parts), axis=1, weights=areas))


def _parts(facets: Assembly, solved: Assembly) -> int:
    """Parts of each edge of a facet that are no longer than the elements that were solved.

    By the number of elements in the directions in which contact facets extend.
    """
    ratios = [1.0]
    for shape, meshed in zip(facets.shapes, solved.shapes, strict=True):
        charts = charts_of(meshed)
        stated = charts_as(shape, charts)
        extends = _extent_of_facets(shape, stated)
        ratios += (np.array(charts.counts) / np.array(stated.counts))[extends].tolist()
    return math.ceil(max(ratios))


def _extent_of_facets(shape: Block, charts: Charts) -> BoolArray:
    """Whether any contact facet of a block extends in each direction of its charts, (3,)."""
    quads = shape.contact_quads
    if not len(quads):
        return np.zeros(3, dtype=bool)
    _, corners = facet_elements(shape.mesh, quads)
    extends: BoolArray = (np.ptp(corners, axis=1) > 0.0).any(axis=0)
    return extends[list(charts.natural)]


def _nodes_of_parts(n: int, degree: int) -> FloatArray:
    """Natural coordinates of the nodes of n by n equal parts of a facet, part by part, (m, 2)."""
    line = lobatto_points(degree)
    of_part = FACET_CORNERS if degree == 1 else grid_points(line, line)
    centres = (2.0 * np.arange(n) + 1.0) / n - 1.0
    return np.reshape(grid_points(centres, centres)[:, None] + of_part / n, (-1, 2))


def _at_facets(
    facets: Assembly,
    state: tuple[System, tuple[FloatArray, ...], IntArray],
    side: tuple[IntArray, IntArray],
    at: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """World positions and displacements at points of facets, (n_facets, n_points, 3) [mm].

    The points have natural coordinates (n_points, 2).
    """
    (solved, displacements, alike), (blocks, quads) = state, side
    positions = np.empty((len(quads), len(at), 3))
    moved = np.empty_like(positions)
    assembly = solved.assembly
    for number, shape in enumerate(facets.shapes):
        rows = np.flatnonzero(facets.shape_of[blocks] == number)
        if not len(rows):
            continue
        first, which = unique_rows(quads[rows])
        known = quads[rows[first]]
        element, corners = facet_elements(shape.mesh, known)
        natural = bilinear(at)[0] @ corners
        charts = charts_as(shape, charts_of(assembly.shapes[number]))
        places = places_in(charts, np.repeat(element, len(at)), natural.reshape(-1, 3))
        # Blocks that are alike have moved alike in their own frames.
        stands, field = np.unique(alike[blocks[rows]], return_inverse=True)
        fields = [assembly.shapes[number].mesh.nodes]
        for block in stands:
            body, u = int(solved.body_number[block]), np.zeros_like(fields[0])
            if body >= 0:
                u = displacements[body][solved.copy_of[block]] @ assembly.rotations[block]
            fields.append(u)
        to = interpolation_on_faces(assembly.shapes[number], places)
        values = to @ np.concatenate(fields, axis=1)
        values = np.reshape(values, (len(known), len(at), len(fields), 3))
        turns = np.swapaxes(assembly.rotations[blocks[rows]], 1, 2)
        positions[rows] = values[which, :, 0] @ turns
        positions[rows] += assembly.translations[blocks[rows], None]
        moved[rows] = values[which, :, 1 + field] @ turns
    return positions, moved


def _surfaces(
    solved: System,
    basis: FacetBasis,
    blocks: tuple[IntArray, IntArray],
    nodes: tuple[FloatArray, FloatArray],
) -> MatchedFacets:
    """Facets between nodes of two blocks that coincide."""
    block_m, block_s = blocks
    numbers = np.zeros(nodes[0].shape[:2], dtype=np.int64)
    apart = solved.offsets[block_s] - solved.offsets[block_m]
    facets = matched_facets(
        blocks, (numbers, numbers), nodes, basis, apart=apart, clearance=solved.surfaces.clearance
    )
    current = solved.contact.normals is ContactNormals.CURRENT
    return facets if current else facets.with_reference_normals
