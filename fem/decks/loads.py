"""Loads of a problem in the words of decks: on faces where the program has words, else on nodes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import ceil, log10

import numpy as np

from fem.decks.deck import CYLINDRICAL, EVERY_ELEMENT, LOADING, Deck, Flavour
from fem.decks.keywords import DeckError, keyword, real, reals
from fem.decks.supports import DeckSupports
from fem.problem import Problem
from fem.system.build import block_load_forces
from geometry.loads import CircumferentialLoad, FaceLoad, LoadCase, PressureLoad, TractionLoad
from geometry.mesh import FloatArray

#: Loads on faces that decks of a flavour have. Converters know no traction around an axis.
_KINDS: dict[Flavour, tuple[type[FaceLoad], ...]] = {
    Flavour.GENERAL: (PressureLoad, TractionLoad, CircumferentialLoad),
    Flavour.STANDARD: (PressureLoad, TractionLoad),
    Flavour.CALCULIX: (PressureLoad,),
}
#: Digits of forces, counted from the largest, so that what is read and written again is the same.
_DIGITS = 13


def on_faces(load: LoadCase, flavour: Flavour) -> tuple[FaceLoad, ...]:
    """Loads that a deck states on faces with names; all others act on nodes."""
    if load.without_couple:
        return ()
    kinds = _KINDS[flavour]
    return tuple(one for one in load.faces if isinstance(one, kinds) and isinstance(one.face, str))


def check_loads(load: LoadCase) -> None:
    """Reject loads that no deck can carry.

    Raises
    ------
    DeckError
        Moments, pressures that turn with their blocks on regions without a name.
    """
    if load.body_wrenches is not None:
        raise DeckError(
            f"load {load.name!r}: got forces and moments on whole blocks; expected loads on faces "
            "(a deck has gravity and body forces, no moment on a solid block)"
        )
    if any(
        isinstance(one, PressureLoad) and one.follows_block and not isinstance(one.face, str)
        for one in load.faces
    ):
        raise DeckError(
            f"load {load.name!r}: got a pressure that turns with its block on a region without a "
            "name; expected a named face, or a dead load"
        )


def step_load_lines(deck: Deck, supports: DeckSupports, number: int) -> Iterator[str]:
    """Loads of a step where they differ from those of the step before."""
    amplitude = {"amplitude": LOADING} if deck.ramp_time and not number else {}
    every = list(_load_lines(deck, supports, deck.stages[number], amplitude))
    if not number:
        yield from every
        return
    old = list(_load_lines(deck, supports, deck.stages[number - 1], amplitude))
    if every != old:
        yield from every
        yield from _taken_back(old, {_target(line) for line in every})


def _load_lines(
    deck: Deck, supports: DeckSupports, problem: Problem, amplitude: dict[str, str]
) -> Iterator[str]:
    load, gravity = problem.load_case, problem.acceleration
    stated = on_faces(load, deck.flavour)
    for one in stated:
        yield from _on_face(deck, one, amplitude)
    others = tuple(one for one in load.faces if not any(one is other for other in stated))
    rest = replace(load, faces=others)
    if len(rest.block):
        yield keyword("Cload", **amplitude)
        size = float(np.abs(rest.facet_forces).max(initial=0.0)) or 1.0
        for block in np.unique(rest.block).tolist():
            local = block_load_forces(deck.assembly, rest, block)
            assert local is not None
            world = local @ deck.assembly.rotations[block].T
            rounded = np.round(world, _DIGITS - ceil(log10(size))) + 0.0
            yield from nodal_lines(deck, block, supports.in_own_axes(block, rounded))
    if gravity is not None:
        yield keyword("Dload")
        for target in [EVERY_ELEMENT] if deck.is_flat else deck.sets:
            yield from _components(f"{target}, GRAV", gravity)


def _on_face(deck: Deck, load: FaceLoad, amplitude: dict[str, str]) -> Iterator[str]:
    """A load on a face of some blocks."""
    surfaces = [deck.face(block, str(load.face)) for block in load.blocks.tolist()]
    if isinstance(load, PressureLoad):
        yield keyword("Dsload", **amplitude)
        yield from (f"{surface}, P, {real(load.pressure)}" for surface in surfaces)
    elif isinstance(load, CircumferentialLoad):
        yield keyword("Dsload", **amplitude, orientation=CYLINDRICAL, follower="NO")
        yield from (
            f"{surface}, TRVEC, {real(load.traction)}, 0.0, 1.0, 0.0" for surface in surfaces
        )
    else:
        yield keyword("Dsload", **amplitude, follower="NO")
        for surface in surfaces:
            yield from _components(f"{surface}, TRVEC", load.traction)


def _components(start: str, vector: FloatArray) -> Iterator[str]:
    """Magnitude and direction of each component of a vector: exact, unlike those of the whole."""
    for direction, value in zip(np.eye(3), vector.tolist(), strict=True):
        if value != 0.0:
            yield f"{start}, {real(value)}, {reals(direction)}"


def nodal_lines(deck: Deck, block: int, values: FloatArray) -> Iterator[str]:
    """Values at the nodes of a block, (n_nodes, 3), zeros left out."""
    for node in np.flatnonzero(values.any(axis=1)).tolist():
        yield from component_lines(deck.node(block, node), values[node])


def component_lines(target: str, vector: FloatArray) -> Iterator[str]:
    """Number and value of each component of a vector on nodes, zeros left out."""
    for component, value in enumerate(vector.tolist(), start=1):
        if value != 0.0:
            yield f"{target}, {component}, {real(value)}"


def _taken_back(old: list[str], stated: set[tuple[str, ...]]) -> Iterator[str]:
    """Loads that are not stated anew, as zero: CalculiX keeps body forces with op=NEW."""
    card = ""
    for line in old:
        if line.startswith("*"):
            card = line
        elif _target(line) not in stated:
            what, kind, _, *along = line.split(", ")
            yield from (card, ", ".join([what, kind, "0.0", *along]))


def _target(line: str) -> tuple[str, ...]:
    """What a line of a load acts on, without its value."""
    return tuple(line.split(", ")[:2])
