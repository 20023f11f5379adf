"""Forces of supports, and what supports that move need along their way."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.problem.model import Model, Support
from geometry.mesh import FloatArray, ReadOnlyArrays

#: Share of a way from which its stiffness is taken: a smooth step begins with none.
_FIRST = 0.01

#: Forces of supports on the nodes of each group, (n_copies, n_nodes, 3) [N].
Forces = tuple[FloatArray, ...]


def reactions(model: Model, forces: Forces) -> dict[str, dict[str, list[float]]]:
    """Resultant of each support on the blocks, by its name.

    Returns
    -------
    dict
        ``force`` [N] and ``moment`` about the origin [N mm], world axes, three numbers each. Those
        of springs are in `spring_reactions`.
    """
    result: dict[str, FloatArray] = {}
    places = [group.reference_positions() for group in model.groups]
    for support in model.supports:
        force = _along(support, forces)
        at = places[support.group][support.copies, support.nodes]
        both = np.concatenate([force.sum(axis=0), np.cross(at, force).sum(axis=0)])
        result[support.name] = result.get(support.name, np.zeros(6)) + both
    return {
        name: {"force": both[:3].tolist(), "moment": both[3:].tolist()}
        for name, both in result.items()
    }


def spring_reactions(model: Model, displacements: Forces) -> dict[str, dict[str, list[float]]]:
    """Resultant force of each bed of springs on the blocks by its name, world axes [N]."""
    result: dict[str, FloatArray] = {}
    for group, moved in zip(model.groups, displacements, strict=True):
        if group.springs is None:
            continue
        for turn, u in zip(group.rotations, moved, strict=True):
            for name, force in group.springs.reactions(u @ turn).items():
                result[name] = result.get(name, np.zeros(3)) + turn @ force
    return {name: {"force": force.tolist()} for name, force in result.items()}


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
        means = 0.5 * (self.forces[1:] + self.forces[:-1])
        return float(means @ np.diff(self.displacements))


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


def moving_supports(model: Model) -> tuple[MovingSupport, ...]:
    """Supports of a model that move, by name."""
    result: dict[str, tuple[Support, ...]] = {}
    for support in model.supports:
        if support.displacement.any():
            result[support.name] = (*result.get(support.name, ()), support)
    return tuple(map(MovingSupport, result.values()))


def push_curves(model: Model, steps: tuple[tuple[float, Forces], ...]) -> tuple[PushCurve, ...]:
    """Curve of each support that moves, from the forces of the supports after each step.

    Before the first step of a motion without loads nothing acts.
    """
    return tuple(
        moving.curve({0.0: 0.0} | {time: moving.force(forces) for time, forces in steps})
        for moving in moving_supports(model)
    )
