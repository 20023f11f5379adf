"""Forces of supports, and what supports that move need along their way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.system.rows import Amplitude
from fem.system.system import System
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.balance import Reactions, of_supports, outward_thrust

#: Share of a way from which its stiffness is taken: a smooth step begins with none.
_FIRST = 0.01

#: Forces of supports on the nodes of each body, (n_copies, n_nodes, 3) [N].
Forces = tuple[FloatArray, ...]


def reactions(system: System, forces: Forces, displacements: Forces) -> Reactions:
    """Resultant of each support and bed of springs on the blocks, by its name.

    Parameters
    ----------
    system
        What is held, and what has springs.
    forces
        Of the supports; () where nothing is held.
    displacements
        Of each body, world axes, (n_copies, n_nodes, 3) [mm]: springs follow them.
    """
    acting: dict[str, list[tuple[FloatArray, FloatArray, IntArray]]] = {}
    bodies, rows = system.bodies, system.supports
    places = [body.reference_positions() for body in bodies]
    starts = np.cumsum([0, *(body.n_copies * body.n_nodes for body in bodies)])
    if forces:
        directions = _in_world(system, slice(None))
        nodes = system.first_nodes[rows.block] + rows.node
        along = _along(forces, nodes, directions)[:, None] * directions
        at, block = _flat(places)[nodes], rows.block
        for number, name in enumerate(rows.names):
            mine = rows.support == number
            acting.setdefault(name, []).append((at[mine], along[mine], block[mine]))
    for start, group, at, moved in zip(starts, bodies, places, displacements, strict=False):
        if group.springs is None:
            continue
        blocks = system.block_of_node[start :: group.n_nodes]
        for k, (turn, here, u) in enumerate(zip(group.rotations, at, moved, strict=True)):
            on_nodes = group.springs.forces(u @ turn) @ turn.T
            for name, nodes, force in zip(
                group.springs.names, group.springs.nodes, on_nodes, strict=True
            ):
                acting.setdefault(name, []).append(
                    (here[nodes], force, np.full(len(nodes), blocks[k]))
                )
    wrenches, middles, outward = {}, {}, {}
    for name, parts in acting.items():
        at, force, block = (np.concatenate(of) for of in zip(*parts, strict=True))
        if not len(at):  # of nodes that another support holds
            continue
        wrenches[name] = np.concatenate([force.sum(axis=0), np.cross(at, force).sum(axis=0)])
        middles[name] = at.mean(axis=0)
        outward[name] = _outward(at, force, block)
    return of_supports(wrenches, middles, outward)


def _outward(at: FloatArray, forces: FloatArray, block: IntArray) -> float:
    """Outward thrust of a support, from the places and sums of forces of its blocks [N]."""
    blocks, which = np.unique(block, return_inverse=True)
    sums, middles = np.zeros((2, len(blocks), 3))
    np.add.at(sums, which, forces)
    np.add.at(middles, which, at)
    return outward_thrust(middles / np.bincount(which)[:, None], sums)


def _flat(of_bodies: Sequence[FloatArray]) -> FloatArray:
    """Vectors of the nodes of all copies, body after body, (n_nodes, 3)."""
    return np.concatenate([of.reshape(-1, 3) for of in of_bodies])


def _in_world(system: System, rows: IntArray | slice) -> FloatArray:
    """Directions of some rows of the supports in world axes, (n, 3)."""
    turns = system.assembly.rotations[system.supports.block[rows]]
    return np.einsum("nij,nj->ni", turns, system.supports.direction[rows])


def _along(forces: Forces, nodes: IntArray, directions: FloatArray) -> FloatArray:
    """Force along a direction at each of some nodes, (n,) [N]."""
    return np.einsum("ni,ni->n", _flat(forces)[nodes], directions)


@dataclass(frozen=True)
class PushCurve(ReadOnlyArrays):
    """Force of a support that moves over its way."""

    name: str
    """Of the support."""
    times: FloatArray
    """Of its table, (n,) [s]."""
    displacements: FloatArray
    """Way along its direction, (n,) [mm]."""
    forces: FloatArray
    """Force on the blocks along the same direction, (n,) [N]."""

    @property
    def peak(self) -> tuple[float, float]:
        """Largest force [N] and the way at which it acts [mm]."""
        k = int(np.argmax(self.forces))
        return float(self.forces[k]), float(self.displacements[k])

    @cached_property
    def stiffness(self) -> float:
        """Force over displacement of the first step of a hundredth of the way or more [N/mm]."""
        way = np.abs(self.displacements)
        k = int(np.argmax(way >= _FIRST * way.max()))
        return float((self.forces[k] - self.forces[0]) / self.displacements[k])

    @property
    def free_after(self) -> float | None:
        """Displacement after which nothing resists, to the end [mm]; None: something does."""
        acts = np.flatnonzero(self.forces)
        if len(acts) and acts[-1] == len(self.forces) - 1:
            return None
        return float(self.displacements[acts[-1]]) if len(acts) else 0.0

    @cached_property
    def work(self) -> float:
        """Of the force along the way, by trapezia [N mm]."""
        return self._by_trapezia(np.arange(len(self.forces)))

    @property
    def work_error(self) -> float:
        """Change of the work with every second step [N mm]; of one step its size."""
        half = np.unique(np.append(np.arange(0, len(self.forces), 2), len(self.forces) - 1))
        if len(half) == len(self.forces):
            return abs(self.work)
        return abs(self.work - self._by_trapezia(half))

    def _by_trapezia(self, steps: IntArray) -> float:
        """Work over some of the steps [N mm]."""
        forces, ways = self.forces[steps], self.displacements[steps]
        return float(0.5 * (forces[1:] + forces[:-1]) @ np.diff(ways))


@dataclass(frozen=True)
class MovingSupport:
    """A support that moves: the rows of its name that do."""

    name: str
    amplitude: Amplitude
    """Share of its way as a function of time [s]."""
    nodes: IntArray
    """Node of each row, (n,), the row that moves farthest first."""
    directions: FloatArray
    """World axes, (n, 3)."""
    way: float
    """Along the first direction [mm]."""

    def force(self, forces: Forces) -> float:
        """Force on the blocks along its way, from those on all nodes [N]."""
        along = _along(forces, self.nodes, self.directions)
        return float(along @ self.directions @ self.directions[0] * np.sign(self.way))

    def place(self, displacements: Forces) -> float:
        """Displacement of the first row along its direction [mm]."""
        return float(_along(displacements, self.nodes[:1], self.directions[:1])[0])

    def curve(self, at: dict[float, float]) -> PushCurve:
        """Curve from its forces [N] by time [s]."""
        times = np.array(list(at))
        ways = abs(self.way) * np.array([self.amplitude(time) for time in times.tolist()])
        return PushCurve(self.name, times, ways, np.array(list(at.values())))


def moving_supports(system: System) -> tuple[MovingSupport, ...]:
    """Supports that move, by name."""
    rows, result = system.supports, list[MovingSupport]()
    for number, name in enumerate(rows.names):
        mine = np.flatnonzero((rows.support == number) & (rows.table >= 0))
        if len(mine):
            farthest = np.abs(rows.value[mine]).argmax()
            mine = np.concatenate([mine[[farthest]], np.delete(mine, farthest)])
            table, way = rows.tables[rows.table[mine[0]]], float(rows.value[mine[0]])
            nodes = system.first_nodes[rows.block[mine]] + rows.node[mine]
            result.append(MovingSupport(name, table, nodes, _in_world(system, mine), way))
    return tuple(result)


def push_curves(system: System, steps: tuple[tuple[float, Forces], ...]) -> tuple[PushCurve, ...]:
    """Curve of each support that moves, from the forces of the supports after each step.

    Before the first step of a motion without loads nothing acts.
    """
    return tuple(
        moving.curve({0.0: 0.0} | {time: moving.force(forces) for time, forces in steps})
        for moving in moving_supports(system)
    )
