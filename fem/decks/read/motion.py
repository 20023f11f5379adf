"""What an explicit step of a deck has beside loads: initial velocities, masses that are scaled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.decks.keywords import DeckError
from fem.decks.read.bodies import Blocks
from fem.decks.read.cards import Card
from fem.decks.read.model import ModelLines, Step, effects_of
from fem.decks.read.words import IDLE, Dialect
from fem.problem import Motion, Problem
from fem.system.time_step import characteristic_time_step
from geometry.assembly import Assembly
from geometry.mesh import FloatArray

#: Displacement of a component [mm], and times [s] and shares of it; (): with the loads.
Moved = tuple[float, tuple[tuple[float, float], ...]]
#: Velocities that differ from those of a rigid motion by less, relative to the largest, are its.
_SAME = 1e-6
#: Share of the least time step of an element that CalculiX takes for stable without scaling.
_STABLE = 0.5


def initial_motion(model: ModelLines, blocks: Blocks, assembly: Assembly) -> Motion | None:
    """Motion of all blocks at time 0.

    Raises
    ------
    DeckError
        Velocities that are no rigid motion, the same for all blocks that may move.
    """
    cards = [card for card in model.other if card.keyword == "INITIAL CONDITIONS"]
    moving: dict[tuple[int, int], FloatArray] = {}
    for card in cards:
        kind = card.option("TYPE")
        if kind not in {"VELOCITY", "ROTATING VELOCITY"}:
            raise DeckError(
                f"{card.at()}: *Initial Conditions of type {kind} is not covered; expected "
                "velocities"
            )
        (_velocities if kind == "VELOCITY" else _rotating)(card, blocks, moving)
    if not moving:
        return None
    motions = []
    for block in np.flatnonzero(~assembly.fixed).tolist():
        solid = blocks.solid(block)
        part = blocks.instance(block).part
        nodes = solid.nodes[solid.nodes < len(part.places)]
        places = blocks.coordinates(block, nodes)
        values = np.array([moving.get((block, n), np.zeros(3)) for n in nodes.tolist()])
        centre = assembly.nodes(block).mean(axis=0)
        motions.append(_rigid(cards[-1], places - centre, values))
    first = motions[0]
    size = max(float(np.abs(one).max()) for one in motions)
    if any(np.abs(one - first).max() > _SAME * size for one in motions):
        raise DeckError(
            f"{cards[-1].at()}: blocks move at several velocities; expected one for all"
        )
    return Motion(first[:3], first[3:])


def _velocities(card: Card, blocks: Blocks, moving: dict[tuple[int, int], FloatArray]) -> None:
    """Read a component on nodes: a set, a component and a velocity."""
    for line, row in card.rows():
        component = card.whole(line, row[1]) if len(row) > 2 else 0
        if component not in {1, 2, 3}:
            raise DeckError(f"{card.at(line)}: expected a set, a component and a velocity")
        value = card.number(line, row[2])
        nodes = blocks.places.members(card, line, row[0], nodes=True)
        for block, indices in blocks.located(nodes).items():
            for node in indices.tolist():
                moving.setdefault((block, node), np.zeros(3))[component - 1] = value


def _rotating(card: Card, blocks: Blocks, moving: dict[tuple[int, int], FloatArray]) -> None:
    """Read a spin and a velocity of nodes, and the two points of the axis of the spin."""
    rows = list(card.rows())
    if len(rows) % 2 or any(len(row) != (5, 6)[k % 2] for k, (_, row) in enumerate(rows)):
        raise DeckError(
            f"{card.at()}: expected lines with a set, a spin and a velocity, each before one with "
            "two points of the axis"
        )
    for (line, row), (below, points) in zip(rows[::2], rows[1::2], strict=True):
        spin, *velocity = (card.number(line, text) for text in row[1:])
        ends = np.array([card.number(below, text) for text in points]).reshape(2, 3)
        along = ends[1] - ends[0]
        length = float(np.linalg.norm(along))
        if length == 0.0:
            raise DeckError(f"{card.at(below)}: the axis has no length; expected two points")
        nodes = blocks.places.members(card, line, row[0], nodes=True)
        for block, indices in blocks.located(nodes).items():
            arms = blocks.coordinates(block, indices) - ends[0]
            values = np.array(velocity) + np.cross(spin / length * along, arms)
            for node, value in zip(indices.tolist(), values, strict=True):
                moving[block, node] = value


def _rigid(card: Card, arms: FloatArray, values: FloatArray) -> FloatArray:
    """Velocity of the mean of a block's nodes and spin, (6,), of nodes at arms from it."""
    # v = v0 + w x r: three columns of the velocity, three of the spin.
    rows = np.zeros((*arms.shape, 6))
    rows[:, :, :3] = np.eye(3)
    for k, axis in enumerate(np.eye(3)):
        rows[:, :, 3 + k] = np.cross(axis, arms)
    result, *_ = np.linalg.lstsq(rows.reshape(-1, 6), values.ravel(), rcond=None)
    size = float(np.abs(values).max())
    result[np.abs(result) <= _SAME * np.abs(result).max()] = 0.0
    if np.abs(rows @ result - values).max() > _SAME * size:
        raise DeckError(
            f"{card.at()}: nodes of a block do not move as a rigid block; expected one velocity "
            "and one spin on all its nodes"
        )
    return np.asarray(result)


def mass_scaling(model: ModelLines, step: Step, problem: Problem) -> float | None:
    """Time step that every element is to allow, over the least; None: no element gets mass.

    Raises
    ------
    DeckError
        Scaling of another kind, or beside gravity.
    """
    cards = [card for card in step.cards if card.keyword == "FIXED MASS SCALING"]
    if not cards:
        _check_minimum(model, step, problem)
        return None
    card = cards[-1]
    kind = card.option("TYPE")
    if len(cards) > 1 or kind != "BELOW MIN" or set(card.parameters) != {"TYPE", "DT"}:
        raise DeckError(
            f"{card.at()}: got *Fixed Mass Scaling of type {kind or 'none'} with "
            f"{', '.join(map(str.lower, card.parameters))}; expected type=BELOW MIN and dt for all "
            "elements, once"
        )
    if problem.gravity is not None:
        raise DeckError(
            f"{card.at()}: *Fixed Mass Scaling beside gravity: added mass would weigh; expected "
            "one of the two"
        )
    factor = card.number(card.line, card.parameters["DT"]) / _least(model, step, problem)
    return factor if factor > 1.0 else None


def _least(model: ModelLines, step: Step, problem: Problem) -> float:
    """Least time step of an element of blocks that deform [s]."""
    viscosity = effects_of(model, step).bulk_viscosity
    linear = 0.0 if viscosity is None else viscosity.linear_bulk_viscosity
    blocks, materials = problem.blocks, problem.materials
    return min(
        characteristic_time_step(blocks.shape(b).mesh, materials[b], linear_bulk_viscosity=linear)
        for b in np.flatnonzero(problem.deforming).tolist()
    )


def _check_minimum(model: ModelLines, step: Step, problem: Problem) -> None:
    """Reject a minimum increment for which CalculiX scales masses."""
    rows = list(step.procedure.rows())
    row = rows[0][1] if rows and step.explicit and model.dialect is Dialect.CALCULIX else []
    if len(row) < 3 or not row[2] or "DIRECT" in step.procedure.parameters:
        return
    minimum, least = step.procedure.number(rows[0][0], row[2]), _least(model, step, problem)
    if minimum > _STABLE * least:
        raise DeckError(
            f"{step.procedure.at(rows[0][0])}: for a minimum increment of {minimum:g} s CalculiX "
            f"scales masses where elements allow less ({least:.2g} s here), in a way that is not "
            "covered; expected a shorter one, or none"
        )


#: What a later explicit step may have: motions of supports, and what is without influence.
_LATER = {"BOUNDARY", "DYNAMIC", "BULK VISCOSITY"}


def in_one_run(steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """Explicit steps one after the other, with the time at which each begins.

    Loads are those of the first; later ones move supports, or only last.

    Raises
    ------
    DeckError
        Later ones with other loads, contact, masses or viscosity.
    """
    if len(steps) < 2 or not all(step.explicit for step in steps):
        return steps
    viscosity = [_viscosity(step) for step in steps]
    result = list(steps[:1])
    for step, own in zip(steps[1:], viscosity[1:], strict=True):
        for card in step.cards:
            anew = card.keyword == "BOUNDARY" and card.option("OP") == "NEW"
            if (card.keyword not in _LATER and card.keyword not in IDLE) or anew:
                raise DeckError(
                    f"{card.at()}: {card.title}{', op=NEW' * anew} in a later explicit step is not "
                    "covered; expected loads and contact in the first, and motions of supports "
                    "that are held from the first on"
                )
        if own != viscosity[0]:
            raise DeckError(
                f"{step.card.at()}: another *Bulk Viscosity than in the first step is not covered; "
                "expected the same"
            )
        result.append(replace(step, begin=result[-1].end))
    return tuple(result)


def _viscosity(step: Step) -> tuple[float, ...] | None:
    cards = [card for card in step.cards if card.keyword == "BULK VISCOSITY"]
    return tuple(cards[-1].numbers().tolist()) if cards else None


def continued(before: Moved | None, after: Moved, begin: float, at: str) -> Moved:
    """Motion of a component over explicit steps: what it did before, then that of a later step.

    Raises
    ------
    DeckError
        Components that are free before, motions that jump or that no table has.
    """
    if before is None or any(moved and not times for moved, times in (before, after)):
        raise DeckError(
            f"{at}: a support of a later explicit step is free before, or one of its motions has "
            "no tabular amplitude; expected supports that are held from the first step on, and "
            "tables for all their motions"
        )
    rows = [(time, before[0] * share) for time, share in before[1]] or [(0.0, 0.0)]
    rows += [(begin, rows[-1][1])] * (rows[-1][0] < begin)
    own = [(begin + time, after[0] * share) for time, share in after[1]] or [(begin, 0.0)]
    if own[0][1] != rows[-1][1]:
        raise DeckError(
            f"{at}: the support jumps at the beginning of the step; expected an amplitude that "
            "begins where the step before ends"
        )
    rows += own[1:]
    size = max(abs(moved) for _, moved in rows)
    return (size, tuple((time, moved / size) for time, moved in rows)) if size else (0.0, ())
