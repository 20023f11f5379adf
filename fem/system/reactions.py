"""Forces of supports, and what supports that move need along their way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.system.body import Body
from fem.system.model import Support
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.balance import Reactions, of_supports, outward_thrust

#: Share of a way from which its stiffness is taken: a smooth step begins with none.
_FIRST = 0.01

#: Forces of supports on the nodes of each group, (n_copies, n_nodes, 3) [N].
Forces = tuple[FloatArray, ...]


def reactions(
    bodies: Sequence[Body], supports: Sequence[Support], forces: Forces, displacements: Forces
) -> Reactions:
    """Resultant of each support and bed of springs on the blocks, by its name.

    Parameters
    ----------
    bodies, supports
        What has springs, and what is held.
    forces
        Of the supports; () where nothing is held.
    displacements
        Of each group, world axes, (n_copies, n_nodes, 3) [mm]: springs follow them.
    """
    acting: dict[str, list[tuple[FloatArray, FloatArray, IntArray]]] = {}
    places = [group.reference_positions() for group in bodies]
    first = np.cumsum([0, *(group.n_copies for group in bodies)])
    for support in supports if forces else ():
        at = places[support.group][support.copies, support.nodes]
        block = np.broadcast_to(first[support.group] + support.copies, len(at))
        acting.setdefault(support.name, []).append((at, _along(support, forces), block))
    for number, group, at, moved in zip(first[:-1], bodies, places, displacements, strict=True):
        if group.springs is None:
            continue
        for k, (turn, here, u) in enumerate(zip(group.rotations, at, moved, strict=True)):
            on_nodes = group.springs.forces(u @ turn) @ turn.T
            for name, nodes, force in zip(
                group.springs.names, group.springs.nodes, on_nodes, strict=True
            ):
                acting.setdefault(name, []).append(
                    (here[nodes], force, np.full(len(nodes), number + k))
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


def _along(support: Support, forces: Forces) -> FloatArray:
    """Force along each prescribed component, (n, 3) [N]."""
    at = forces[support.group][support.copies, support.nodes]
    size = np.einsum("ni,ni->n", at, support.directions)
    along: FloatArray = size[:, None] * support.directions
    return along


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
    """A support that moves, all its parts together."""

    parts: tuple[Support, ...]
    """Supports of its name that move."""

    @cached_property
    def largest(self) -> tuple[Support, int]:
        """Part and component that move farthest."""
        result = max(self.parts, key=lambda s: float(np.abs(s.displacement).max()))
        return result, int(np.argmax(np.abs(result.displacement)))

    def force(self, forces: Forces) -> float:
        """Force on the blocks along its way, from those on all nodes [N]."""
        part, k = self.largest
        unit = part.directions[k] * np.sign(part.displacement[k])
        return float(sum((_along(s, forces) @ unit).sum() for s in self.parts))

    def curve(self, at: dict[float, float]) -> PushCurve:
        """Curve from its forces [N] by time [s]."""
        part, k = self.largest
        times = np.array(list(at))
        share = part.amplitude
        shares = [1.0 if share is None else share(time) for time in times.tolist()]
        ways = float(abs(part.displacement[k])) * np.array(shares)
        return PushCurve(part.name, times, ways, np.array(list(at.values())))


def moving_supports(supports: Sequence[Support]) -> tuple[MovingSupport, ...]:
    """Supports that move, by name."""
    result: dict[str, tuple[Support, ...]] = {}
    for support in supports:
        if support.displacement.any():
            result[support.name] = (*result.get(support.name, ()), support)
    return tuple(map(MovingSupport, result.values()))


def push_curves(
    supports: Sequence[Support], steps: tuple[tuple[float, Forces], ...]
) -> tuple[PushCurve, ...]:
    """Curve of each support that moves, from the forces of the supports after each step.

    Before the first step of a motion without loads nothing acts.
    """
    return tuple(
        moving.curve({0.0: 0.0} | {time: moving.force(forces) for time, forces in steps})
        for moving in moving_supports(supports)
    )
