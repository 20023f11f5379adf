"""Forces through a plane: what elements and contacts across it transmit.

A node i lies behind the plane with a weight w_i: 1 behind it, 0 ahead of it, and on it the share of
the volume of its elements that lies behind. With the nodal forces K u of the elements and f of the
contacts, the part ahead acts on the part behind with

    F = Σ w_i (f_i - (K u)_i),      M = Σ w_i (x_i - c) × (f_i - (K u)_i).

Only elements and contacts with nodes on both sides contribute, and in equilibrium the sums are
minus those of loads and reactions behind the plane, to the residual. Loads count where their nodal
shares act, so a distributed load is cut between nodes.

Contact forces are those of the points that were solved, friction included.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from fem.state import State
from fem.stresses.recovery import block_displacements
from fem.system.contact_state import corner_displacements
from geometry.assembly import Assembly
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.measures import Planes, SectionError, SectionForces, nothing_cut, section_rows

#: Nodes at this share of the size of a block from a plane lie on it.
_ON_PLANE = 1e-7
#: Six tetrahedra of a hexahedron, round the diagonal from corner 0 to corner 6.
_TETRAHEDRA = np.array([[0, a, b, 6] for a, b in pairwise((1, 2, 3, 7, 4, 5, 1))], dtype=np.int64)


class _Nodes:
    """Nodes of all blocks of a state, and forces on them."""

    def __init__(self, state: State) -> None:
        self.state, self.whole = state, state.whole
        assembly, facets = self.whole.assembly, state.contact_state.surfaces
        blocks = range(assembly.n_blocks)
        sizes = [assembly.shape(b).mesh.n_nodes for b in blocks]
        #: First node of each block, (n_blocks + 1,).
        self.starts = np.cumsum([0, *sizes])
        #: Before the load acts, (n_nodes, 3) [mm].
        self.positions = np.concatenate([self.whole.positions(b) for b in blocks])
        #: Where nodal forces act, (n_nodes, 3) [mm]: moved by finite rotations only.
        self.places = self.positions.copy()
        if state.finite_rotation:
            for block in self.whole.deformable_blocks.tolist():
                self.places[self.of(block)] += state.displacement_of(block)
        #: Displacements in block frames, and the frames, of each body.
        self.local = [
            block_displacements(g, u, finite_rotation=state.finite_rotation)
            for g, u in zip(self.whole.bodies, state.displacements, strict=True)
        ]
        sides = (facets.block_m, facets.quads_m), (facets.block_s, facets.quads_s)
        #: Nodes of both facets of all pairs, m's first, (n, nodes of both).
        self.ends = np.concatenate(
            [self.starts[of][:, None] + quads for of, quads in sides], axis=1
        )

    def of(self, block: int) -> slice:
        """Nodes of a block."""
        return slice(int(self.starts[block]), int(self.starts[block + 1]))

    def element_forces(self, block: int, some: IntArray) -> FloatArray:
        """K u of some elements of a block, world axes, (m, nodes of an element, 3) [N].

        Springs to the ground are no part of the block.
        """
        body, copy = int(self.whole.body_number[block]), int(self.whole.copy_of[block])
        (local, frames), model = self.local[body], self.whole.bodies[body]
        moved = local[copy][model.mesh.connectivity[some]]
        stiffness = model.element_stiffness(some, springs=False)
        result = np.einsum("eij,ej->ei", stiffness, moved.reshape(len(some), -1))
        return result.reshape(moved.shape) @ frames[copy].T

    def contact_forces(self, rows: IntArray) -> FloatArray:
        """Contact forces on some `ends`, world axes, (n, nodes of both, 3) [N]."""
        contact = self.state.contact_state
        some, frictions = contact.surfaces.subset(rows), contact.frictions
        moved = corner_displacements(self.whole, self.state.displacements, some)
        law = self.whole.contact.law.on(some.block_m, some.block_s)
        pressures = law.pressure(some.overclosures(moved))
        return some.nodal_forces(moved, pressures, None if frictions is None else frictions[rows])


def section_forces(state: State, cut: Planes) -> SectionForces:
    """Sum what elements and contacts of a state transmit through planes.

    Of an explicit run those of its end; what viscosity and damping do is not counted.

    Raises
    ------
    SectionError
        A plane that cuts nothing, or a periodic cell.
    """
    check_planes(state.whole.assembly, cut, state.whole.body_number < 0)
    nodes = _Nodes(state)
    return section_rows(cut, [_Section(nodes, cut, k).row() for k in range(len(cut.points))])


def check_planes(assembly: Assembly, cut: Planes, rigid: BoolArray) -> None:
    """Reject planes before any solution."""
    if assembly.image_of is not None:
        raise SectionError("section: a periodic cell is a part of a section; cut the tube")
    n_blocks = assembly.n_blocks
    for k, (point, normal) in enumerate(zip(cut.points, cut.normals, strict=True)):
        among = cut.among(k, n_blocks)
        tolerance = _ON_PLANE * assembly.characteristic_length
        away = [(assembly.nodes(b) - point) @ normal for b in among.tolist()]
        least, most = np.array([a.min() for a in away]), np.array([a.max() for a in away])
        if not (least.min() < -tolerance and most.max() > -tolerance):
            raise nothing_cut(cut, k, "blocks lie behind it, against its normal, and ahead of it")
        through = among[rigid[among] & (least < -tolerance) & (most > tolerance)]
        if len(through):
            raise SectionError(
                f"section {cut.names[k]}: the plane cuts block {through[0]}, which is rigid, so "
                "there are no stresses in it; expected a plane through deformable blocks or "
                "joints, or the `blocks` of this section, all of them deformable"
            )


class _Section:
    """One plane through a state."""

    def __init__(self, nodes: _Nodes, cut: Planes, row: int) -> None:
        self.all = nodes
        assembly = nodes.whole.assembly
        every, chosen = np.arange(assembly.n_blocks), cut.blocks[row]
        self.blocks = every if chosen is None else chosen
        self.tolerance = _ON_PLANE * assembly.characteristic_length
        self.away = (nodes.positions - cut.points[row]) @ cut.normals[row]
        self.behind = (self.away < -self.tolerance).astype(np.float64)
        polygons = [self._cut_block(block) for block in self.blocks.tolist()]
        self.area = sum(area for area, _ in polygons)
        if not self.area > 0.0:
            raise nothing_cut(cut, row, "it passes through blocks")
        self.centroid: FloatArray = np.sum([moment for _, moment in polygons], axis=0) / self.area
        self.force, self.moment = np.zeros(3), np.zeros(3)

    def row(self) -> tuple[float, FloatArray, FloatArray, FloatArray]:
        """Area, centroid, force and moment about it."""
        for block in self.blocks.tolist():
            self._add_elements(block)
        surfaces, ends = self.all.state.contact_state.surfaces, self.all.ends
        ours = np.isin(surfaces.block_m, self.blocks) & np.isin(surfaces.block_s, self.blocks)
        rows = np.flatnonzero(ours & (np.ptp(self.behind[ends], axis=1) > 0.0))
        if len(rows):
            self._add(ends[rows], self.all.contact_forces(rows))
        return self.area, self.centroid, self.force, self.moment

    def _add(self, nodes: IntArray, forces: FloatArray) -> None:
        """Count forces on nodes, (..., 3) [N], by how far these lie behind the plane."""
        counted = self.behind[nodes][..., None] * forces
        arms = self.all.places[nodes] - self.centroid
        self.force += counted.reshape(-1, 3).sum(axis=0)
        self.moment += np.cross(arms, counted).reshape(-1, 3).sum(axis=0)

    def _add_elements(self, block: int) -> None:
        """Count what elements across the plane do to their nodes."""
        whole, nodes = self.all.whole, self.all.of(block)
        if whole.body_number[block] < 0:
            return
        members = whole.body_of(block).mesh.connectivity
        some = np.flatnonzero(np.ptp(self.behind[nodes][members], axis=1) > 0.0)
        if len(some):
            self._add(members[some] + nodes.start, -self.all.element_forces(block, some))

    def _cut_block(self, block: int) -> tuple[float, FloatArray]:
        """Area of a block in the plane [mm²] and its first moment (3,) [mm³]; weights on it."""
        nodes = self.all.of(block)
        away = self.away[nodes]
        if away.min() > self.tolerance or away.max() < -self.tolerance:
            return 0.0, np.zeros(3)
        elements = self.all.whole.drawn.shape(block).mesh.elements
        corners, there = self.all.positions[nodes][elements], away[elements]
        on = np.flatnonzero(np.abs(away) <= self.tolerance)
        if len(on):
            self._share(block, elements, corners, there)
        across = np.flatnonzero(
            (there.min(axis=1) < -self.tolerance) & (there.max(axis=1) >= -self.tolerance)
        )
        tetrahedra = corners[across][:, _TETRAHEDRA].reshape(-1, 4, 3)
        distance = there[across][:, _TETRAHEDRA].reshape(-1, 4)
        distance[np.abs(distance) <= self.tolerance] = 0.0
        return _cut_tetrahedra(tetrahedra, distance)

    def _share(
        self, block: int, elements: IntArray, corners: FloatArray, there: FloatArray
    ) -> None:
        """Weights of nodes on the plane: the share of their elements' volume behind it."""
        arms = corners[:, _TETRAHEDRA]
        edges = arms[:, :, 1:] - arms[:, :, :1]
        volume = np.abs(np.linalg.det(edges)).sum(axis=1)
        behind = volume * (there.mean(axis=1) < 0.0)
        nodes = self.all.of(block)
        count = nodes.stop - nodes.start
        total, own = (
            np.bincount(elements.ravel(), np.repeat(v, 8), minlength=count)
            for v in (volume, behind)
        )
        on = np.abs(self.away[nodes]) <= self.tolerance
        self.behind[nodes][on] = (own / np.maximum(total, 1e-300))[on]


def _cut_tetrahedra(corners: FloatArray, away: FloatArray) -> tuple[float, FloatArray]:
    """Area in the plane [mm²] and its first moment (3,) [mm³] of tetrahedra (n, 4, 3) [mm].

    ``away`` are the distances of the corners from the plane, (n, 4); those on it are ahead of it.
    """
    order = np.argsort(away, axis=1)
    corners = np.take_along_axis(corners, order[..., None], axis=1)
    away = np.take_along_axis(away, order, axis=1)
    below = (away < 0.0).sum(axis=1)
    area, moment = 0.0, np.zeros(3)
    rings = {1: ((0, 1), (0, 2), (0, 3)), 2: ((0, 2), (0, 3), (1, 3), (1, 2))}
    rings[3] = ((0, 3), (1, 3), (2, 3))
    for count, ring in rings.items():
        x, d = corners[below == count], away[below == count]
        points = [
            x[:, a] + (d[:, a] / (d[:, a] - d[:, b]))[:, None] * (x[:, b] - x[:, a])
            for a, b in ring
        ]
        for second, third in pairwise(points[1:]):
            vectors = np.cross(second - points[0], third - points[0])
            parts = 0.5 * np.linalg.norm(vectors, axis=1)
            area += float(parts.sum())
            moment += parts @ (points[0] + second + third) / 3.0
    return area, moment
