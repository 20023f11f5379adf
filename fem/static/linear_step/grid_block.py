"""A structured block of elements of higher degree seen from the points of its contact faces.

A block follows from the forces q on its contact points, pushed inwards along the normals ν, and
from its loads f up to a rigid motion,

    ν · u = -F q + h + b α      with  F = B G Bᵀ,  h = B G f,  b = B R,

where B takes nodes to points, G is a flexibility for forces in balance and R are its rigid motions.
All congruent blocks share F and b, and nothing else of a block appears in the contact problem.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.sparse import csr_array, vstack

from fem.element.functions import TensorPoints, gauss_functions
from fem.element.lagrange import Lagrange
from fem.element.material import Material
from fem.static.linear_step.columns import ColumnBlock, flexible_block
from fem.system.body import rigid_motions
from fem.system.system import Sector
from geometry.mesh import CUBE, BoolArray, FloatArray, HexMesh, IntArray, structured_hexahedra

#: Sides of a grid by direction and end: the lower and the upper one first, then the ends round it.
_SIDES = ((2, 0), (2, 1), (1, 0), (1, 1))


def grid_counts(mesh: HexMesh) -> tuple[int, int, int] | None:
    """Elements of a mesh in three directions where it is a structured grid; None: it is not."""
    first = mesh.elements[0]
    corner = {tuple(place): int(node) for place, node in zip(CUBE.tolist(), first, strict=True)}
    line = corner[0, 1, 0] - corner[0, 0, 0]
    plane = corner[1, 0, 0] - corner[0, 0, 0]
    n_w = line - 1
    if n_w < 1 or plane <= 0 or plane % line:
        return None
    n_v = plane // line - 1
    n_u, rest = divmod(mesh.n_elements, max(n_v * n_w, 1))
    if n_v < 1 or rest or not np.array_equal(structured_hexahedra(n_u, n_v, n_w), mesh.elements):
        return None
    return n_u, n_v, n_w


@dataclass(frozen=True)
class GridBlock:
    """Elements of a structured block, without contact on the two sides of the first direction."""

    numbers: IntArray
    """Number in the mesh of each node of the grid, (n_1, n_2, n_3); right-handed."""
    nodes: FloatArray
    """Positions of the mesh's nodes, (n_nodes, 3) [mm]."""
    element: Lagrange
    material: Material

    @property
    def counts(self) -> tuple[int, int, int]:
        """Elements in each direction."""
        n_1, n_2, n_3 = ((n - 1) // self.element.degree for n in self.numbers.shape)
        return n_1, n_2, n_3

    @cached_property
    def sides(self) -> tuple[_SidePoints, ...]:
        """Points of integration of the sides that can be in contact."""
        degree = self.element.degree
        at = gauss_functions(degree, degree + 2, 2)
        return tuple(self._side(direction, end, at) for direction, end in _SIDES)

    def _side(self, direction: int, end: int, at: TensorPoints) -> _SidePoints:
        degree = self.element.degree
        numbers = np.take(np.arange(self.numbers.size).reshape(self.numbers.shape), -end, direction)
        counts = tuple(c for k, c in enumerate(self.counts) if k != direction)
        quads = windows(numbers, counts, degree)
        corners = self.nodes[self.numbers.ravel()[quads]]
        tangents = np.einsum("qai,pak->qpki", corners, at.slopes, optimize=True)
        outward = np.cross(tangents[:, :, 0], tangents[:, :, 1])
        # The two directions of a side in their order turn with the third, but for the middle one.
        outward *= (1.0 if end else -1.0) * (-1.0 if direction == 1 else 1.0)
        outward /= np.linalg.norm(outward, axis=2, keepdims=True)
        positions = np.einsum("pa,qai->qpi", at.values, corners, optimize=True)
        return _SidePoints(quads, at.values, positions, outward)

    @cached_property
    def outward(self) -> csr_array:
        """B: ν · u of all points on the nodes of the grid, (n_points, 3 n_nodes)."""
        rows = [side.outward(self.numbers.size) for side in self.sides]
        return csr_array(vstack(rows))

    @cached_property
    def positions(self) -> FloatArray:
        """Of all points, (n_points, 3) [mm]."""
        return np.concatenate([side.positions.reshape(-1, 3) for side in self.sides])

    @cached_property
    def rigid(self) -> FloatArray:
        """R: translations, and rotations about the middle over the size, (3 n_nodes, 6)."""
        positions = self.nodes[self.numbers.ravel()]
        arm = (positions - positions.mean(axis=0)) / np.ptp(positions, axis=0).max()
        return rigid_motions(arm).reshape(-1, 6)

    @cached_property
    def columns(self) -> ColumnBlock:
        """Elements and points as columns along the second direction."""
        return self._columns(self.outward, self.element.degree + 2, vectors=False)

    @cached_property
    def side_nodes(self) -> IntArray:
        """Nodes of the grid of all quads that can be in contact, shared ones each time, (n,)."""
        return np.concatenate([side.quads.ravel() for side in self.sides])

    @property
    def node_columns(self) -> ColumnBlock:
        """The same with the displacements of `side_nodes` in place of the points."""
        unknowns = (3 * self.side_nodes[:, None] + np.arange(3)).ravel()
        n = len(unknowns)
        rows = csr_array((np.ones(n), unknowns, np.arange(n + 1)), (n, 3 * self.numbers.size))
        return self._columns(rows, self.element.degree + 1, vectors=True)

    def _columns(self, rows: csr_array, per_line: int, *, vectors: bool) -> ColumnBlock:
        return ColumnBlock(
            self.nodes[self.numbers],
            self.element.degree,
            partial(self.element.stiffness, material=self.material),
            rows,
            per_line,
            vectors,
        )


@dataclass(frozen=True)
class _SidePoints:
    """Points of integration on one side of a block."""

    quads: IntArray
    """Nodes of the grid of each facet, (n_quads, n_functions)."""
    values: FloatArray
    """Functions at the points of a facet, (n_points, n_functions)."""
    positions: FloatArray
    """(n_quads, n_points, 3) [mm]"""
    normals: FloatArray
    """Outward, (n_quads, n_points, 3)."""

    def outward(self, n_nodes: int) -> csr_array:
        """ν · u of all points as a matrix on nodal displacements, (n, 3 n_nodes)."""
        n_quads, n_functions = self.quads.shape
        n_points = len(self.values)
        entries = np.einsum("pa,qpi->qpai", self.values, self.normals)
        columns = 3 * self.quads[:, None, :, None] + np.arange(3)
        columns = np.broadcast_to(columns, (n_quads, n_points, n_functions, 3))
        pointer = 3 * n_functions * np.arange(n_quads * n_points + 1)
        return csr_array(
            (entries.ravel(), columns.ravel(), pointer), (n_quads * n_points, 3 * n_nodes)
        )


def windows(numbers: IntArray, counts: tuple[int, ...], degree: int) -> IntArray:
    """Nodes of structured elements of a grid of numbers, last direction fastest."""
    dimension = len(counts)
    result = np.lib.stride_tricks.sliding_window_view(numbers, (degree + 1,) * dimension)
    chosen = result[tuple(slice(None, None, degree) for _ in range(dimension))]
    return np.ascontiguousarray(chosen.reshape(int(np.prod(counts)), -1))


def grid_block(mesh: HexMesh, material: Material, contact_quads: IntArray) -> GridBlock | None:
    """Structured block whose facets in contact (n, 4) leave two opposite sides free; else None."""
    counts = grid_counts(mesh) if mesh.degree > 1 else None
    if counts is None:
        return None
    numbers = _node_grid(mesh, counts)
    ends = np.moveaxis(np.indices(numbers.shape), 0, -1)
    places = np.empty((mesh.n_nodes, 3), dtype=np.int64)
    places[numbers.ravel()] = ends.reshape(-1, 3)
    corners = places[contact_quads]
    last = np.array(numbers.shape) - 1
    on_side = (corners == 0).all(axis=1) | (corners == last).all(axis=1)
    free = [k for k in range(3) if not on_side[:, k].any()]
    if not free or not on_side.any(axis=1).all():
        return None
    # Columns follow each other in the direction with the most elements of the two in contact.
    first = free[0]
    second, third = sorted((k for k in range(3) if k != first), key=lambda k: -counts[k])
    order = (first, second, third)
    turned = numbers.transpose(order)
    if np.linalg.det(np.eye(3)[list(order)]) < 0.0:
        turned = turned[::-1]
    return GridBlock(np.ascontiguousarray(turned), mesh.nodes, Lagrange(mesh.degree), material)


def _node_grid(mesh: HexMesh, counts: tuple[int, int, int]) -> IntArray:
    """Numbers of the nodes of a structured mesh as a grid."""
    p = mesh.degree
    n_u, n_v, n_w = counts
    grid = np.empty((n_u * p + 1, n_v * p + 1, n_w * p + 1), dtype=np.int64)
    members = mesh.connectivity.reshape(n_u, n_v, n_w, p + 1, p + 1, p + 1)
    for i in range(p + 1):
        for j in range(p + 1):
            for k in range(p + 1):
                grid[i::p, j::p, k::p][:n_u, :n_v, :n_w] = members[:, :, :, i, j, k]
    return grid


class BlockFlexibility:
    """A block that moves under any forces, but for its rigid motions."""

    def __init__(self, block: GridBlock, columns: ColumnBlock, asked: BoolArray) -> None:
        self.block = block
        self._flexible = flexible_block(columns, asked, block.rigid)

    def displacements(self, forces: FloatArray) -> FloatArray:
        """G of nodal forces on the grid, (n_cases, n_nodes, 3) [N], [mm]."""
        return self._flexible.displacements(forces)

    def motion_in(self, displacement: FloatArray) -> FloatArray:
        """Rigid motion in a displacement (n_nodes, 3) [mm]: G of balanced forces has none, (6,)."""
        held = self._flexible.held
        rigid, moved = self.block.rigid[held], displacement.ravel()[held]
        motion: FloatArray = np.linalg.lstsq(rigid, moved, rcond=None)[0]
        return motion


class NodeFlexibility(BlockFlexibility):
    """G between nodes on the sides of a block, by their numbers in the mesh (n,)."""

    def __init__(self, block: GridBlock, nodes: IntArray) -> None:
        on_mesh = block.numbers.ravel()[block.side_nodes]
        found, first = np.unique(on_mesh, return_index=True)
        asked = np.zeros((len(on_mesh), 3), dtype=np.bool_)
        asked[first[np.isin(found, nodes)]] = True
        super().__init__(block, block.node_columns, asked.ravel())
        rows = self._flexible.points
        unknowns = 3 * on_mesh[rows // 3] + rows % 3
        order = np.argsort(unknowns)
        self.degrees_of_freedom: IntArray = unknowns[order]
        """Of the nodes in the mesh, ascending, (3 n,)."""
        self.inverse: FloatArray = self._flexible.flexibility[np.ix_(order, order)]
        """(3 n, 3 n) [mm/N]"""
        self._flexible = replace(self._flexible, points=rows[order], flexibility=self.inverse)
        at = 3 * block.side_nodes[rows // 3] + rows % 3
        self.rigid: FloatArray = block.rigid[at[order]]
        """R there, (3 n, 6)."""


class PointFlexibility(BlockFlexibility):
    """F between the points that were asked for so far, grown where more are."""

    def __init__(self, block: GridBlock, asked: IntArray) -> None:
        wanted = np.zeros(len(block.positions), dtype=np.bool_)
        wanted[asked] = True
        super().__init__(block, block.columns, wanted)
        self.motions: FloatArray = block.outward @ block.rigid
        self._asked = self._flexible.points
        self._row = np.full(len(self.motions), -1, dtype=np.int64)
        self._row[self._asked] = np.arange(len(self._asked))
        self._flexibility = self._flexible.flexibility

    def between(self, points: IntArray, others: IntArray) -> FloatArray:
        """F of points that `include` was given, (n, m) [mm/N]."""
        return self._flexibility[np.ix_(self._row[points], self._row[others])]

    def include(self, points: IntArray) -> None:
        """Compute the response to forces on points."""
        new = np.unique(points[self._row[points] < 0])
        if not len(new):
            return
        outward = self.block.outward
        forces = outward[new].toarray().reshape(len(new), -1, 3)
        moved = self.displacements(forces).reshape(len(new), -1).T
        before, after = len(self._asked), len(self._asked) + len(new)
        self._asked = np.concatenate([self._asked, new])
        self._row[new] = np.arange(before, after)
        grown = np.empty((after, after))
        grown[:before, :before] = self._flexibility
        grown[:, before:] = outward[self._asked] @ moved
        grown[before:, :before] = grown[:before, before:].T
        self._flexibility = grown


def grids_of(system: Sector, grids: Sequence[GridBlock]) -> list[GridBlock]:
    """Grid of each slot, of those of all bodies."""
    return [grids[int(system.whole.body_number[block])] for block in system.blocks]


class GridBodies:
    """Blocks of all slots, each seen from the nodes of its grid."""

    def __init__(self, system: Sector, blocks: Sequence[BlockFlexibility]) -> None:
        self._system, self._blocks = system, blocks

    def _on_grid(self, slot: int, nodal: FloatArray) -> FloatArray:
        """Values of all nodes (n_nodes, 3) at those of the grid of a slot."""
        return nodal[self._system.nodes_of(slot)][self._blocks[slot].block.numbers.ravel()]

    def _to_nodes(self, on_grids: Sequence[FloatArray]) -> FloatArray:
        """Values at the nodes of the grids of all slots as those of all nodes, (n_nodes, 3)."""
        nodal = np.empty((self._system.n_nodes, 3))
        for slot, (own, values) in enumerate(zip(self._blocks, on_grids, strict=True)):
            nodal[self._system.nodes_of(slot)][own.block.numbers.ravel()] = values.reshape(-1, 3)
        return nodal

    def displacements(self, forces: FloatArray) -> FloatArray:
        """G of nodal forces, (n_nodes, 3) [mm], of congruent blocks at once."""
        on_grids = [np.empty(0)] * len(self._blocks)
        for block in set(self._blocks):
            slots = [slot for slot, other in enumerate(self._blocks) if other is block]
            moved = block.displacements(np.stack([self._on_grid(s, forces) for s in slots]))
            for slot, own in zip(slots, moved, strict=True):
                on_grids[slot] = own
        return self._to_nodes(on_grids)

    def motions_in(self, displacement: FloatArray) -> FloatArray:
        """Motions of the blocks in displacements (n_nodes, 3) [mm], (n_slots, 6)."""
        pairs = enumerate(self._blocks)
        return np.stack([b.motion_in(self._on_grid(s, displacement)) for s, b in pairs])

    def in_motions(self, forces: FloatArray) -> FloatArray:
        """Rᵀ f of nodal forces (n_nodes, 3) [N], (n_slots, 6)."""
        each = enumerate(self._blocks)
        return np.stack([b.block.rigid.T @ self._on_grid(s, forces).ravel() for s, b in each])

    def of_motions(self, motions: Sequence[FloatArray] | FloatArray) -> FloatArray:
        """R α of motions of each slot (6,), (n_nodes, 3) [mm]."""
        each = zip(self._blocks, motions, strict=True)
        return self._to_nodes([own.block.rigid @ motion for own, motion in each])
