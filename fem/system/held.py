"""Supports: rows of prescribed displacements, and the basis they leave.

A row prescribes direction · u at a node. Directions of one node may have any angles between them,
and may repeat each other: eigenvectors of Σ d dᵀ are axes of which those with an eigenvalue are
prescribed, and u = axes v makes every prescribed component one variable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

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
class Held:
    """Prescribed displacements: direction · u = start + share of its way · (value - start)."""

    row: IntArray
    """Node of each, (n,): of all blocks (`System.first_nodes`), or of a solver (`on`)."""
    direction: FloatArray
    """In the block frame, (n, 3)."""
    value: FloatArray
    """Where it has gone all its way, (n,) [mm]."""
    table: IntArray
    """Which of the tables moves it, (n,); -1: it is there always."""
    tables: tuple[Amplitude, ...] = ()
    """Share of their way as functions of time [s]."""
    start: FloatArray | float = 0.0
    """Where rows that move begin, (n,) [mm]."""
    support: IntArray | int = 0
    """Which of the names each has, (n,)."""
    names: tuple[str, ...] = ("support",)
    """In tables of reactions; rows of one name are one support."""

    def on(self, number: IntArray) -> Held:
        """The rows of a solver that gives each node a number (n_nodes,), -1 to what it leaves out.

        Raises
        ------
        ModelError
            Rows of one node that contradict each other.
        """
        row = number[self.row]
        mine = row >= 0
        of_rows = {name: getattr(self, name)[mine] for name in ("direction", "value", "table")}
        support = np.broadcast_to(self.support, len(mine))[mine]
        return replace(self, row=row[mine], support=support, **of_rows)._checked()

    def _checked(self) -> Held:
        there = np.einsum("rti,ri->rt", self.ways[self._number], self.direction)
        for table, value in self._parts:
            there[np.arange(len(self.row)), table] -= value
        wrong = np.abs(there).max(axis=1, initial=0.0)
        size = max(np.abs(of).max(initial=0.0) for of in (self.value, self.start))
        if wrong.max(initial=0.0) > _SAME * size:
            raise ModelError(
                f"supports: node {int(self.row[wrong.argmax()])} is moved in two ways along one "
                "direction; expected one of them"
            )
        return self

    @cached_property
    def nodes(self) -> IntArray:
        """Nodes with at least one prescribed component, (n_held,)."""
        return np.unique(self.row)

    @cached_property
    def _number(self) -> IntArray:
        """Position of the node of each row in `nodes`, (n,)."""
        return np.searchsorted(self.nodes, self.row)

    @cached_property
    def _eigen(self) -> tuple[FloatArray, FloatArray]:
        """Eigenvalues (n_held, 3), largest first, and axes of each node, (n_held, 3, 3)."""
        product = np.zeros((len(self.nodes), 3, 3))
        np.add.at(product, self._number, self.direction[:, :, None] * self.direction[:, None])
        # The same axes for congruent blocks, whose directions differ by rounding.
        size, axes = np.linalg.eigh(np.round(product, 12))
        return size[:, ::-1], axes[:, :, ::-1]

    @cached_property
    def held(self) -> BoolArray:
        """Which components of v are prescribed, (n_held, 3)."""
        return self._eigen[0] > _SAME

    @cached_property
    def axes(self) -> FloatArray:
        """Orthonormal axes of each node in the block frame as columns, (n_held, 3, 3).

        Where all components are prescribed those of the block, to the bit.
        """
        fixed = self.held.all(axis=1)[:, None, None]
        return np.where(fixed, np.eye(3), self._eigen[1])

    @property
    def _parts(self) -> tuple[tuple[IntArray, FloatArray], ...]:
        """Ways of the rows by their tables, and what none moves, (n,) and (n,) [mm] each."""
        still = np.where(self.table < 0, 0.0, self.start)
        return (self.table, self.value - still), (np.full_like(self.table, -1), still)

    @cached_property
    def ways(self) -> FloatArray:
        """Displacements by each table, then of what none moves, (n_held, n_tables + 1, 3) [mm]."""
        pulled = np.zeros((len(self.nodes), len(self.tables) + 1, 3))
        for table, value in self._parts:
            np.add.at(pulled, (self._number, table), value[:, None] * self.direction)
        size, axes = self._eigen
        softness = np.divide(1.0, size, out=np.zeros_like(size), where=self.held)
        return ((pulled @ axes) * softness[:, None]) @ axes.transpose(0, 2, 1)

    @property
    def moving(self) -> tuple[tuple[Amplitude, FloatArray], ...]:
        """Tables and the ways that they move the nodes, block frames, (n_held, 3) [mm]."""
        return tuple(zip(self.tables, np.moveaxis(self.ways, 1, 0), strict=False))

    def at(self, time: float | None) -> FloatArray:
        """Prescribed displacements at a time [s], block frames, (n_held, 3) [mm].

        None: every support has moved all its way.
        """
        shares = [1.0 if time is None else table(time) for table in self.tables]
        return np.einsum("t,nti->ni", [*shares, 1.0], self.ways)

    def beginning_at(self, moved: FloatArray) -> Held:
        """The same on a way from displacements of all nodes, (n_nodes, 3) [mm], to its end."""
        ends = np.array([*(table(np.inf) for table in self.tables), 1.0])
        last = self.value * ends[self.table]
        first = (self.direction * moved[self.row]).sum(axis=1)
        goes = np.abs(first - last) > _ROUNDING * np.abs(moved).max()
        table, tables = np.where(goes, 0, -1), (ALL_THE_WAY,) if goes.any() else ()
        return replace(self, value=last, table=table, tables=tables, start=first)._checked()

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
        value[self.nodes] = np.einsum("nij,ni->nj", self.axes, self.at(time)) * self.held
        return value.ravel()

    def part(self, force: FloatArray) -> FloatArray:
        """Components of a force along prescribed directions, (n_nodes, 3) [N]."""
        result = np.zeros_like(force)
        along = np.einsum("nij,ni->nj", self.axes, force[self.nodes]) * self.held
        result[self.nodes] = np.einsum("nij,nj->ni", self.axes, along)
        return result

    def met(self, displacement: FloatArray, time: float | None = None) -> bool:
        """Whether displacements (n_nodes, 3) [mm] are those prescribed at a time, to rounding."""
        values = self.at(time)
        away = np.einsum("nij,ni->nj", self.axes, displacement[self.nodes] - values) * self.held
        size = max(np.abs(a).max(initial=0.0) for a in (values, displacement))
        return bool(np.abs(away).max(initial=0.0) <= _ROUNDING * size)


def held_at(
    nodes: IntArray,
    directions: FloatArray,
    values: FloatArray | float = 0.0,
    *,
    amplitude: Amplitude | None = None,
    name: str = "support",
) -> Held:
    """Hold nodes (n,), or move them by values (n,) [mm], along directions of their blocks, (n, 3).

    What moves has an amplitude, the share of its way as a function of time.

    Raises
    ------
    ModelError
        A displacement or direction that is not finite, or one that jumps at time 0.
    """
    value = np.zeros(len(nodes)) + values
    if not (np.isfinite(value).all() and np.isfinite(directions).all()):
        raise ModelError(f"{name}: got a displacement or direction that is not finite")
    if not value.any():
        return Held(nodes, directions, value, np.full(len(nodes), -1), names=(name,))
    if amplitude is None or abs(amplitude(0.0)) > _ROUNDING:
        raise ModelError(
            f"{name}: the prescribed displacement jumps at time 0; expected an amplitude "
            "that starts from zero, such as a smooth step"
        )
    return Held(nodes, directions, value, np.zeros_like(nodes), (amplitude,), names=(name,))


def joined_rows(parts: Sequence[Held]) -> Held:
    """Rows of several supports; tables and names that are the same come once."""
    none = np.zeros(0, np.int64)
    parts = [Held(none, np.zeros((0, 3)), np.zeros(0), none, names=()), *parts]
    tables = {_key(table): table for part in parts for table in part.tables}
    names = list(dict.fromkeys(name for part in parts for name in part.names))
    rows = [
        (
            part.row,
            part.direction,
            part.value,
            np.array([*(list(tables).index(_key(of)) for of in part.tables), -1])[part.table],
            np.array([*map(names.index, part.names), -1])[part.support] + np.zeros_like(part.row),
        )
        for part in parts
    ]
    row, direction, value, table, support = (np.concatenate(of) for of in zip(*rows, strict=True))
    every = tuple(tables.values())
    return Held(row, direction, value, table, every, support=support, names=tuple(names))


def _key(table: Amplitude) -> tuple[bool, Amplitude]:
    """The way of a support without a table is none of its tables: runs in time replace it."""
    return table is ALL_THE_WAY, table


NOT_HELD = joined_rows(())
"""Without supports."""
