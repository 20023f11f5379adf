"""Supports: rows of prescribed displacements, and the components of nodes that they prescribe.

A row prescribes direction · u at a node of a block. Directions of one node may have any angles
between them, and may repeat each other: eigenvectors of Σ d dᵀ are axes of which those with an
eigenvalue are prescribed, and u = axes v makes every prescribed component one variable. Static and
explicit solvers and decks read the same rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import bsr_array, csr_array

from fem.system.body import ModelError
from fem.system.forces import ALL_THE_WAY, Amplitude
from geometry.mesh import BoolArray, FloatArray, IntArray

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
