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

from fem.contact.normals import ContactNormals
from fem.contact.surfaces import facet_pressures, matched_facets
from fem.element.functions import (
    FACET_CORNERS,
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
    IntArray,
    grid_points,
    row_keys,
    run_starts,
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


class Interpolation(NamedTuple):
    """Values at places from those at the nodes of a block, element by element."""

    values: FloatArray
    """Functions of the element, or of its face, at each place, (n, n_functions)."""
    members: IntArray
    """Nodes of some elements or faces, (n_parts, n_functions)."""
    rows: list[IntArray]
    """Places on each of these."""

    def __matmul__(self, nodal: FloatArray) -> FloatArray:
        """Values at the places, (n_nodes, …) to (n, …)."""
        result = np.empty((len(self.values), *nodal.shape[1:]))
        for rows, members in zip(self.rows, self.members, strict=True):
            result[rows] = self.values[rows] @ nodal[members]
        return result


def interpolation(block: Block, places: Places) -> Interpolation:
    """Values at places from those at the nodes of a block."""
    element, natural = located(charts_of(block), places)
    parts, rows = _grouped(element)
    values = element_of(block.mesh).values(natural)
    return Interpolation(values, block.mesh.connectivity[parts], rows)


def interpolation_on_faces(block: Block, places: Places) -> Interpolation:
    """`interpolation` at places on faces of elements, where only the nodes of the face count."""
    mesh, kind = block.mesh, element_of(block.mesh)
    element, natural = located(charts_of(block), places)
    corners = CORNERS[HEX_FACES]
    of_face = (natural @ corners.mean(axis=1).T).argmax(axis=1)
    parts, rows = _grouped(len(HEX_FACES) * element + of_face)
    element, face = np.divmod(parts, len(HEX_FACES))
    members = mesh.connectivity[element[:, None], kind.face_nodes(HEX_FACES)[face]]
    along = 0.5 * (corners[:, [1, 3]] - corners[:, :1])
    xi = np.einsum("nij,nj->ni", along[of_face], natural)
    return Interpolation(facet_values(xi, members.shape[1]), members, rows)


def _grouped(keys: IntArray) -> tuple[IntArray, list[IntArray]]:
    """Keys that differ, and the positions of each."""
    order = np.argsort(keys, kind="stable")
    starts = run_starts(keys[order])[:-1]
    return keys[order[starts]], np.split(order, starts[1:])


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
    result, alike = facets.interfaces, representatives(solved, symmetry)
    first = result.pair_start[:-1]
    blocks = np.stack([result.block_m[first], result.block_s[first]], axis=1)
    chosen, which = unique_rows(np.column_stack([result.pair_class, alike[blocks]]))
    degree = max(shape.mesh.degree for shape in solved.assembly.shapes)
    at = _nodes_of_parts(_parts(facets, solved.assembly), degree)
    pressures = np.empty(result.n_contacts)
    # Congruent pairs share their interpolation.
    for pairs in np.split(chosen, run_starts(result.pair_class[chosen])[1:-1]):
        rows = first[pairs][:, None] + np.arange(result.pair_start[pairs[0] + 1] - first[pairs[0]])
        for some in np.array_split(rows, math.ceil(rows.size * len(at) / _AT_ONCE), axis=1):
            pressures[some] = _pressures(facets, (solved, displacements, alike), some, (at, degree))
    stands = np.repeat(first[chosen][which] - first, np.diff(result.pair_start))
    return pressures[np.arange(result.n_contacts) + stands]


def _pressures(
    facets: Assembly,
    state: tuple[System, tuple[FloatArray, ...], IntArray],
    rows: IntArray,
    parts: tuple[FloatArray, int],
) -> FloatArray:
    """Mean pressures of some facets of congruent pairs of blocks, (n_pairs, n_facets) [MPa].

    Each from the nodes of parts of a degree on it, in the frame of block m. ``rows`` are their
    positions in the interfaces, (n_pairs, n_facets).
    """
    (solved, displacements, alike), (at, degree) = state, parts
    result, assembly, basis = facets.interfaces, solved.assembly, facet_basis(degree)
    blocks_m, turn = result.block_m[rows[:, 0]], assembly.rotations[result.block_m[rows[0, 0]]]
    sides = (blocks_m, result.quads_m), (result.block_s[rows[:, 0]], result.quads_s)
    on_sides = []
    for blocks, quads in sides:
        stated, meshed = facets.shape(blocks[0]), assembly.shape(blocks[0])
        own = assembly.rotations[blocks[0]].T @ turn
        place = (assembly.translations[blocks[0]] - assembly.translations[blocks_m[0]]) @ turn
        to = _on_facets(stated, meshed, quads[rows[0]], at)
        nodes, members = np.unique(to.members, return_inverse=True)
        fields = [meshed.mesh.nodes[nodes] @ own + place]
        apart = (solved.offsets[blocks] - solved.offsets[blocks_m]) @ turn
        for block, shift in zip(alike[blocks], apart, strict=True):
            body, moved = int(solved.body_number[block]), np.tile(shift, (len(nodes), 1))
            if body >= 0:
                u = displacements[body][solved.copy_of[block], nodes]
                moved += u @ (assembly.rotations[block] @ own)
            fields.append(moved)
        to = to._replace(members=members.reshape(to.members.shape))
        values = to @ np.concatenate(fields, axis=1)
        on_sides.append(values.reshape(-1, basis.values.shape[1], len(fields), 3))
    none = np.zeros(on_sides[0].shape[:2], dtype=np.int64)
    points = matched_facets(
        (none[:, 0], none[:, 0]),
        (none, none),
        (on_sides[0][:, :, 0], on_sides[1][:, :, 0]),
        basis,
        clearance=solved.surfaces.clearance,
    )
    if solved.contact.normals is not ContactNormals.CURRENT:
        points = points.with_reference_normals
    both, areas = np.concatenate(on_sides, axis=1), points.areas.reshape(rows.shape[1], -1)
    pressures = np.empty(rows.shape)
    for k, row in enumerate(rows[:, :1]):
        law = solved.contact.law.on(result.block_m[row], result.block_s[row])
        of_parts = facet_pressures(points, law.pressure(points.overclosures(both[:, :, 1 + k])))
        pressures[k] = np.average(of_parts.reshape(areas.shape), axis=1, weights=areas)
    return pressures


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


def _on_facets(stated: Block, solved: Block, quads: IntArray, at: FloatArray) -> Interpolation:
    """Values at points of facets of a block from those at the nodes of another mesh of it.

    The points have natural coordinates (n_points, 2); facet by facet.
    """
    element, corners = facet_elements(stated.mesh, quads)
    charts = charts_as(stated, charts_of(solved))
    ends = places_in(charts, np.repeat(element, 4), corners.reshape(-1, 3))
    between = bilinear(at)[0] @ ends.parameters.reshape(-1, 4, 3)
    places = Places(np.repeat(ends.chart[::4], len(at)), between.reshape(-1, 3))
    return interpolation_on_faces(solved, places)
