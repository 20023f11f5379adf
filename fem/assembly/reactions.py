"""Forces of supports, and what supports that move need along their way."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.problem.loads import TabularAmplitude
from fem.problem.model import Model, Support
from geometry.mesh import FloatArray, ReadOnlyArrays

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
    found: dict[str, FloatArray] = {}
    places = [group.reference_positions() for group in model.groups]
    for support in model.supports:
        force = _along(support, forces)
        at = places[support.group][support.copies, support.nodes]
        both = np.concatenate([force.sum(axis=0), np.cross(at, force).sum(axis=0)])
        found[support.name] = found.get(support.name, np.zeros(6)) + both
    return {
        name: {"force": both[:3].tolist(), "moment": both[3:].tolist()}
        for name, both in found.items()
    }


def spring_reactions(model: Model, displacements: Forces) -> dict[str, dict[str, list[float]]]:
    """Resultant force of each bed of springs on the blocks by its name, world axes [N]."""
    found: dict[str, FloatArray] = {}
    for group, moved in zip(model.groups, displacements, strict=True):
        if group.springs is None:
            continue
        for turn, u in zip(group.rotations, moved, strict=True):
            for name, force in group.springs.reactions(u @ turn).items():
                found[name] = found.get(name, np.zeros(3)) + turn @ force
    return {name: {"force": force.tolist()} for name, force in found.items()}


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
        """Force over way of the first step [N/mm]."""
        return float((self.forces[1] - self.forces[0]) / self.displacements[1])

    @cached_property
    def work(self) -> float:
        """Of the force along the way, by trapezia [N mm]."""
        means = 0.5 * (self.forces[1:] + self.forces[:-1])
        return float(means @ np.diff(self.displacements))


def push_curves(model: Model, steps: tuple[tuple[float, Forces], ...]) -> tuple[PushCurve, ...]:
    """Curve of each support that moves, from the forces of the supports after each step.

    Before the first step of a motion without loads nothing acts.
    """
    found = []
    for name in dict.fromkeys(s.name for s in model.supports if s.displacement.any()):
        mine = [s for s in model.supports if s.name == name and s.displacement.any()]
        largest = max(mine, key=lambda s: float(np.abs(s.displacement).max()))
        k = int(np.argmax(np.abs(largest.displacement)))
        way = float(abs(largest.displacement[k]))
        unit = largest.directions[k] * np.sign(largest.displacement[k])
        share = largest.amplitude
        assert isinstance(share, TabularAmplitude)
        at = {0.0: 0.0}
        for time, forces in steps:
            at[time] = float(sum((_along(s, forces) @ unit).sum() for s in mine))
        times = np.array(list(at))
        ways = way * np.array([share(time) for time in times.tolist()])
        found.append(PushCurve(name, times, ways, np.array(list(at.values()))))
    return tuple(found)
