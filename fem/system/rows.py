"""Rows of what acts on nodes: forces, prescribed displacements, and their courses in time.

Forces come from pressures, tractions and body forces. Facets are quadrilaterals, counter-clockwise
seen from outside, named by all their nodes (`geometry.mesh.HexMesh.facet_nodes`). Coordinates are
(n_nodes, 3) or, for copies of one block, (n_copies, n_nodes, 3): pass the current ones for a load
that follows the surface, the reference ones for a dead load.

A row of a support prescribes direction · u at a node of a block. Directions of one node may have
any angles between them, and may repeat each other: eigenvectors of Σ d dᵀ are axes of which those
with an eigenvalue are prescribed, and u = axes v makes every prescribed component one variable.
Static and explicit solvers and decks read the same rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import bsr_array, csr_array

from fem.element.functions import (
    FACET_CORNERS,
    basis_of,
    facet_area_vectors,
    facet_functions,
    gauss_line,
)
from fem.system.body import ModelError
from geometry.errors import RefusedError
from geometry.mesh import BoolArray, FloatArray, HexMesh, IntArray, ReadOnlyArrays

Amplitude = Callable[[float], float]
"""Factor of a load or a displacement as a function of time [s]."""


class LoadError(RefusedError):
    """A load that cannot be applied: got, expected, what to do."""


@dataclass(frozen=True)
class ForceRows(ReadOnlyArrays):
    """Forces on nodes, amplitude(t) · force, in the frames of their blocks.

    Raises
    ------
    LoadError
        A force that is not finite.
    """

    block: IntArray
    """Block of each, (n,)."""
    node: IntArray
    """Node in the mesh of the block, (n,)."""
    force: FloatArray
    """(n, 3) [N] at amplitude one."""
    amplitude: Amplitude | None = None
    """None: constant in time from the first step on."""
    follows_block: bool = False
    """Whether the forces turn with the frame of their block (needs finite rotation)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.isfinite(self.force).all():
            raise LoadError("load: got a force that is not finite")

    def on(self, first: IntArray) -> tuple[IntArray, FloatArray]:
        """Nodes and forces of a solver that gives blocks a first node (n_blocks,), -1 to others.

        (n,) and (n, 3) [N].
        """
        mine = first[self.block] >= 0
        return (first[self.block] + self.node)[mine], self.force[mine]


def scatter_to_nodes(corner_forces: FloatArray, quads: IntArray, n_nodes: int) -> FloatArray:
    """Sum forces on nodes of facets (..., n_facets, m, 3) at the nodes, (..., n_nodes, 3)."""
    lead = corner_forces.shape[:-3]
    corners = np.arange(quads.size)
    gather = csr_array((np.ones(quads.size), (quads.ravel(), corners)), (n_nodes, quads.size))
    columns = np.moveaxis(corner_forces.reshape(-1, quads.size, 3), 0, 1).reshape(quads.size, -1)
    forces = np.asarray(gather @ columns, dtype=np.float64).reshape(n_nodes, -1, 3)
    return np.ascontiguousarray(np.moveaxis(forces, 0, 1)).reshape(*lead, n_nodes, 3)


def pressure_forces(nodes: FloatArray, quads: IntArray, pressure: float | FloatArray) -> FloatArray:
    """Consistent nodal forces of a pressure, f_a = -∫ p N_a n dA.

    The rule is exact, so the total is -p times the vector area, and zero on a closed surface.

    Parameters
    ----------
    nodes
        (n_nodes, 3) or (n_copies, n_nodes, 3) [mm].
    quads
        Loaded facets, (n_facets, n_nodes of one), counter-clockwise seen from outside.
    pressure
        Positive pushes inward; one number or (n_facets,) [MPa].

    Returns
    -------
    FloatArray
        (n_nodes, 3) or (n_copies, n_nodes, 3) [N].

    Raises
    ------
    LoadError
        Pressure not finite, or neither one number nor one per facet.
    """
    value = _checked(pressure, "pressure", (), (len(quads),))
    area = facet_area_vectors(nodes, quads)
    corner = -np.einsum("f,pa,...fpi->...fai", value, basis_of(quads).values, area)
    return scatter_to_nodes(corner, quads, nodes.shape[-2])


def traction_forces(nodes: FloatArray, quads: IntArray, traction: FloatArray) -> FloatArray:
    """Consistent nodal forces of a traction, f_a = ∫ t N_a dA.

    On planar facets the total is t times the area; on warped ones the area is that of the
    points of integration.

    Parameters
    ----------
    nodes
        (n_nodes, 3) or (n_copies, n_nodes, 3) [mm].
    quads
        Loaded facets, (n_facets, n_nodes of one).
    traction
        One vector (3,), or one at each of `facet_points`, (n_facets, n_points, 3) [MPa].

    Returns
    -------
    FloatArray
        (n_nodes, 3) or (n_copies, n_nodes, 3) [N].

    Raises
    ------
    LoadError
        Traction not finite, or neither one vector nor one at each point.
    """
    values = basis_of(quads).values
    value = _checked(traction, "traction", (3,), (len(quads), len(values), 3))
    area = np.linalg.norm(facet_area_vectors(nodes, quads), axis=-1)
    corner = np.einsum("fpi,pa,...fp->...fai", value, values, area)
    return scatter_to_nodes(corner, quads, nodes.shape[-2])


def edge_forces(
    nodes: FloatArray, corners: IntArray, side: IntArray, mesh: HexMesh, force: FloatArray
) -> FloatArray:
    """Consistent nodal forces of a force per length along edges of facets, f_a = ∫ q N_a ds.

    Parameters
    ----------
    nodes
        (n_nodes, 3) [mm].
    corners, side
        Corners of a facet that has each edge, (n, 4), and the one at which it begins, (n,).
    mesh
        Of the block: which nodes lie between corners.
    force
        (3,) [N/mm].

    Returns
    -------
    FloatArray
        (n_nodes, 3) [N].
    """
    quads = mesh.facet_nodes(corners)
    result = np.zeros_like(nodes)
    line, weights = gauss_line(math.isqrt(quads.shape[1]))
    for first in range(4):
        begin, end = FACET_CORNERS[first], FACET_CORNERS[(first + 1) % 4]
        way = 0.5 * (end - begin)
        values, slopes = facet_functions(0.5 * (begin + end) + np.outer(line, way), quads.shape[1])
        mine = quads[side == first]
        tangent = np.einsum("pak,k,fai->fpi", slopes, way, nodes[mine])
        length = np.linalg.norm(tangent, axis=2) * weights
        np.add.at(result, mine, np.einsum("fp,pa,i->fai", length, values, force))
    return result


def facet_points(nodes: FloatArray, quads: IntArray) -> FloatArray:
    """Points of integration of facets, (n_facets, n_points, 3) [mm]."""
    points: FloatArray = basis_of(quads).values @ nodes[quads]
    return points


def _checked(
    value: float | FloatArray, name: str, one: tuple[int, ...], each: tuple[int, ...]
) -> FloatArray:
    """Broadcast one value of a load to all, rejecting what is not finite or does not fit."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape not in (one, each):
        raise LoadError(f"{name}: got shape {array.shape}; expected {one} or {each}")
    if not np.isfinite(array).all():
        raise LoadError(f"{name}: got a value that is not finite; expected finite values in MPa")
    return np.broadcast_to(array, each)


@dataclass(frozen=True)
class SmoothStepAmplitude:
    """Abaqus' smooth step: xi³ (10 - 15 xi + 6 xi²), flat in slope and curvature at both ends."""

    duration: float
    """[s]"""
    start: float = 0.0
    """[s]"""

    def __post_init__(self) -> None:
        good = math.isfinite(self.duration) and self.duration > 0.0 and math.isfinite(self.start)
        if not good:
            raise LoadError(
                f"amplitude: got duration = {self.duration} s from {self.start} s; expected a "
                "positive duration (for a load at once give no amplitude)"
            )

    def __call__(self, time: float) -> float:
        """Return the factor at ``time`` [s]."""
        xi = min(max((time - self.start) / self.duration, 0.0), 1.0)
        return xi**3 * (10.0 - 15.0 * xi + 6.0 * xi**2)


@dataclass(frozen=True)
class TabularAmplitude:
    """Linear between the points of a table, constant outside it: ramps, cycles."""

    times: tuple[float, ...]
    """Strictly increasing [s]."""
    values: tuple[float, ...]
    """[-]"""

    def __post_init__(self) -> None:
        if len(self.times) != len(self.values) or not self.times:
            raise LoadError(
                f"amplitude: got {len(self.times)} times and {len(self.values)} values; "
                "expected as many of each, at least one"
            )
        if not np.isfinite([*self.times, *self.values]).all():
            raise LoadError("amplitude: the table has a value that is not finite")
        if (np.diff(self.times) <= 0.0).any():
            raise LoadError(f"amplitude: got times {self.times}; expected strictly increasing ones")

    def __call__(self, time: float) -> float:
        """Return the factor at ``time`` [s]."""
        return float(np.interp(time, self.times, self.values))


#: Share of the displacement of a support without a table: static steps take equal parts of it, and
#: explicit runs the smooth step of their loads.
ALL_THE_WAY = TabularAmplitude((0.0, 1.0), (0.0, 1.0))


def wrench_forces(
    points: FloatArray, shares: FloatArray, force: FloatArray, moment: FloatArray
) -> FloatArray:
    """Spread a force and a moment over a body like the inertia of a rigid acceleration.

    f_i = m_i (F / M + α × r_i), with r_i from the centroid of the masses and α by the moment about
    it: statically equivalent to the force and the moment about the origin of the points.

    Parameters
    ----------
    points
        Nodes, (n, 3) [mm].
    shares
        Their masses, in any unit, (n,).
    force, moment
        (3,) [N] and (3,) [N mm], the moment about the origin.

    Returns
    -------
    FloatArray
        (n, 3) [N].
    """
    weight = shares / shares.sum()
    centroid = weight @ points
    arm = points - centroid
    second = np.einsum("n,ni,nj->ij", weight, arm, arm)
    couple = moment - np.cross(centroid, force)
    angular = np.linalg.solve(np.trace(second) * np.eye(3) - second, couple)
    return weight[:, None] * (force + np.cross(angular, arm))


#: Prescribed displacements are met to this share of the largest displacement.
_ROUNDING = 1e-12
#: Directions and displacements that differ by this share are the same.
_SAME = 1e-9


@dataclass(frozen=True)
class HeldRows:
    """Prescribed displacements: direction · u = share of its way · value."""

    block: IntArray
    """Block of each, (n,)."""
    node: IntArray
    """Node in the mesh of the block, (n,)."""
    direction: FloatArray
    """In the block frame, (n, 3)."""
    value: FloatArray
    """Where it has gone all its way, (n,) [mm]."""
    table: IntArray
    """Which of the tables moves it, (n,); -1: it is there always."""
    tables: tuple[Amplitude, ...]
    """Share of their way as functions of time [s]."""
    support: IntArray
    """Which of the names each has, (n,)."""
    names: tuple[str, ...]
    """In tables of reactions; rows of one name are one support."""

    def on(self, first: IntArray) -> Held:
        """What they prescribe to a solver that gives blocks a first node (n_blocks,), -1 to others.

        Raises
        ------
        ModelError
            Rows of one node that contradict each other.
        """
        mine = np.flatnonzero(first[self.block] >= 0)
        direction, value, table = self.direction[mine], self.value[mine], self.table[mine]
        row = first[self.block[mine]] + self.node[mine]
        nodes, number = np.unique(row, return_inverse=True)
        product = np.zeros((len(nodes), 3, 3))
        np.add.at(product, number, direction[:, :, None] * direction[:, None])
        # The same axes for congruent blocks, whose directions differ by rounding.
        size, axes = (of[..., ::-1] for of in np.linalg.eigh(np.round(product, 12)))
        held = size > _SAME
        pulled = np.zeros((len(nodes), len(self.tables) + 1, 3))
        np.add.at(pulled, (number, table), value[:, None] * direction)
        softness = np.divide(1.0, size, out=np.zeros_like(size), where=held)
        ways = ((pulled @ axes) * softness[:, None]) @ axes.transpose(0, 2, 1)
        there = np.einsum("rti,ri->rt", ways[number], direction)
        there[np.arange(len(mine)), table] -= value
        wrong = np.abs(there).max(axis=1, initial=0.0)
        if wrong.max(initial=0.0) > _SAME * np.abs(value).max(initial=0.0):
            k = mine[wrong.argmax()]
            raise ModelError(
                f"supports: node {int(self.node[k])} of block {int(self.block[k])} is moved in two "
                "ways along one direction; expected one of them"
            )
        # Where all components are prescribed the axes are those of the block, to the bit.
        axes = np.where(held.all(axis=1)[:, None, None], np.eye(3), axes)
        return Held(nodes, axes, held, ways, self.tables)


@dataclass(frozen=True)
class Held:
    """Prescribed components of the nodes of a solver, and their ways."""

    nodes: IntArray
    """Nodes with at least one prescribed component, (n_held,)."""
    axes: FloatArray
    """Orthonormal axes of each node in the block frame as columns, (n_held, 3, 3)."""
    held: BoolArray
    """Which components along them are prescribed, (n_held, 3)."""
    ways: FloatArray
    """Displacements by each table, then of what none moves, (n_held, n_tables + 1, 3) [mm]."""
    tables: tuple[Amplitude, ...]
    """Share of their way as functions of time [s]."""

    def at(self, time: float | None) -> FloatArray:
        """Prescribed displacements at a time [s], block frames, (n_held, 3) [mm].

        None: every support has moved all its way.
        """
        shares = [1.0 if time is None else table(time) for table in self.tables]
        return np.einsum("t,nti->ni", [*shares, 1.0], self.ways)

    def along(self, vectors: FloatArray) -> FloatArray:
        """Prescribed components of vectors at the nodes, zero at the others, both (n_held, 3)."""
        return np.einsum("nij,ni->nj", self.axes, vectors) * self.held

    def beginning_at(self, moved: FloatArray) -> Held:
        """The same on a way from displacements of all nodes, (n_nodes, 3) [mm], to its end."""
        last = self.at(np.inf)
        left = self.along(moved[self.nodes] - last)
        left[np.abs(left) <= _ROUNDING * np.abs(moved).max()] = 0.0
        way = -np.einsum("nij,nj->ni", self.axes, left)
        if not left.any():
            return replace(self, ways=last[:, None], tables=())
        ways = np.stack([way, last - way], axis=1)
        return replace(self, ways=ways, tables=(ALL_THE_WAY,))

    def transform(self, n_nodes: int) -> tuple[csr_array, IntArray]:
        """T of u = T v with every prescribed component one variable, and the free variables.

        (3 n_nodes, 3 n_nodes) and (n_free,).
        """
        axes, is_held = np.tile(np.eye(3), (n_nodes, 1, 1)), np.zeros((n_nodes, 3), dtype=np.bool_)
        axes[self.nodes], is_held[self.nodes] = self.axes, self.held
        node = np.arange(n_nodes + 1)
        transform = csr_array(bsr_array((axes, node[:-1], node), (3 * n_nodes, 3 * n_nodes)))
        transform.eliminate_zeros()
        return transform, np.flatnonzero(~is_held.ravel())

    def variables(self, n_nodes: int, time: float | None = None) -> FloatArray:
        """Prescribed variables v at a time [s], zero at the others, (3 n_nodes,) [mm]."""
        value = np.zeros((n_nodes, 3))
        value[self.nodes] = self.along(self.at(time))
        return value.ravel()

    def part(self, force: FloatArray) -> FloatArray:
        """Components of a force along prescribed directions, (n_nodes, 3) [N]."""
        result = np.zeros_like(force)
        result[self.nodes] = np.einsum("nij,nj->ni", self.axes, self.along(force[self.nodes]))
        return result

    def met(self, displacement: FloatArray, time: float | None = None) -> bool:
        """Whether displacements (n_nodes, 3) [mm] are those prescribed at a time, to rounding."""
        values = self.at(time)
        away = self.along(displacement[self.nodes] - values)
        size = max(np.abs(a).max(initial=0.0) for a in (values, displacement))
        return bool(np.abs(away).max(initial=0.0) <= _ROUNDING * size)


def held_at(
    block: IntArray | int,
    nodes: IntArray,
    directions: FloatArray,
    values: FloatArray | float = 0.0,
    *,
    amplitude: Amplitude | None = None,
    name: str = "support",
) -> HeldRows:
    """Hold nodes (n,) of blocks, or move them by values (n,) [mm], along directions (n, 3) of them.

    What moves has an amplitude, the share of its way as a function of time.

    Raises
    ------
    ModelError
        A displacement or direction that is not finite, or one that jumps at time 0.
    """
    of, value = np.zeros_like(nodes) + block, np.zeros(len(nodes)) + values
    if not (np.isfinite(value).all() and np.isfinite(directions).all()):
        raise ModelError(f"{name}: got a displacement or direction that is not finite")
    moves = value.any()
    if moves and (amplitude is None or abs(amplitude(0.0)) > _ROUNDING):
        raise ModelError(
            f"{name}: the prescribed displacement jumps at time 0; expected an amplitude "
            "that starts from zero, such as a smooth step"
        )
    table, none = np.zeros_like(nodes) - (not moves), np.zeros_like(nodes)
    tables = (amplitude,) if moves and amplitude else ()
    return HeldRows(of, nodes, directions, value, table, tables, none, (name,))


def joined_rows(parts: Sequence[HeldRows]) -> HeldRows:
    """Rows of several supports; tables and names that are the same come once."""
    none = np.zeros(0, np.int64)
    parts = [HeldRows(none, none, np.zeros((0, 3)), np.zeros(0), none, (), none, ()), *parts]
    tables = {_key(table): table for part in parts for table in part.tables}
    names = list(dict.fromkeys(name for part in parts for name in part.names))
    rows = [
        (
            part.block,
            part.node,
            part.direction,
            part.value,
            np.array([*(list(tables).index(_key(of)) for of in part.tables), -1])[part.table],
            np.array([*map(names.index, part.names), -1])[part.support],
        )
        for part in parts
    ]
    columns = map(np.concatenate, zip(*rows, strict=True))
    block, node, direction, value, table, support = columns
    every = tuple(tables.values())
    return HeldRows(block, node, direction, value, table, every, support, tuple(names))


def _key(table: Amplitude) -> tuple[bool, Amplitude]:
    """The way of a support without a table is none of its tables: runs in time replace it."""
    return table is ALL_THE_WAY, table


NOT_HELD = joined_rows(())
"""Without supports."""
