"""Supports of a problem as decks state them: nodes along world axes, at rest, moved or on springs.

A deck names faces and node sets. A region without a name is a set of the nodes that lie in it; a
bed of springs is one spring to the ground at each node, ∫ k N_a dA.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from fem.decks.keywords import DeckError, entry_lines, keyword, real, reals
from fem.decks.statement import FRAME, LOADING, Deck, Flavour, GroundSpring, Hold, Procedure
from fem.element.lagrange_mesh import SerendipityMesh
from fem.problem.loads import traction_forces
from geometry.assembly import Assembly
from geometry.mesh import IntArray
from geometry.parts.regions import Points, region_nodes, region_quads
from geometry.parts.supports import HeldFace

#: Directions that lean from a world axis by less lie along it [-].
_ALONG = 1e-9
#: Name of a spring to the ground along one component, in Abaqus and CalculiX.
_SPRING = "SPRING1"


def holds_on(assembly: Assembly, held: tuple[HeldFace, ...]) -> tuple[Hold, ...]:
    """Supports without springs, components of different ways apart.

    Raises
    ------
    DeckError
        Directions that are no world axes.
    """
    result: list[Hold] = []
    for number, support in enumerate(held, start=1):
        if support.spring is not None:
            continue
        region = not isinstance(support.face, str)
        nodes = region_nodes(assembly, support.block, support.face).tolist() if region else None
        base = Hold(
            support.block,
            face=None if region else str(support.face),
            nodes=None if nodes is None else tuple(nodes),
            region=f"REGION-{number}" if region else "",
            path=support.path if support.moves else (),
        )
        result += _by_components(base, support)
    return tuple(result)


def _by_components(base: Hold, support: HeldFace) -> Iterator[Hold]:
    """One hold for each component, or for all three where they stay."""
    axes = _world_axes(support)
    if axes == (0, 1, 2) and not support.moves:
        yield base
        return
    moved = np.zeros(3) if support.displacement is None else support.displacement
    for axis in axes:
        yield Hold(
            base.block,
            base.face,
            (axis,),
            nodes=base.nodes,
            region=base.region,
            displacement=float(moved[axis]),
            path=base.path,
        )


def _world_axes(support: HeldFace) -> tuple[int, ...]:
    """Components that its directions are."""
    largest = np.abs(support.axes).argmax(axis=1)
    if np.abs(np.abs(support.axes) - np.eye(3)[largest]).max() > _ALONG:
        raise DeckError(
            f"support {support.title}: got the directions {support.axes.tolist()}; decks hold "
            "components along world axes: expected x, y or z, or turn the blocks"
        )
    return tuple(sorted(largest.tolist()))


def springs_on_ground(
    assembly: Assembly, held: tuple[HeldFace, ...], flavour: Flavour
) -> tuple[GroundSpring, ...]:
    """Springs of beds at their nodes.

    Raises
    ------
    DeckError
        Springs in an explicit step, of quadratic elements, or along no world axis.
    """
    result: list[GroundSpring] = []
    for support in held:
        if support.spring is None:
            continue
        mesh = assembly.shape(support.block).mesh
        if flavour is Flavour.GENERAL:
            raise DeckError(
                f"support {support.title}: got springs, which Abaqus/Explicit does not have to the "
                "ground (SPRING1); expected --flavour standard or calculix, a static step"
            )
        if isinstance(mesh, SerendipityMesh):
            raise DeckError(
                f"support {support.title}: got springs below C3D20, whose corners have negative "
                "shares of an area; expected fem.degree = 1"
            )
        if isinstance(support.face, Points):
            share = np.zeros(mesh.n_nodes)
            share[region_nodes(assembly, support.block, support.face)] = support.spring
        else:
            quads = mesh.facet_nodes(region_quads(assembly, support.block, support.face))
            share = traction_forces(mesh.nodes, quads, np.array([support.spring, 0.0, 0.0]))[:, 0]
        for axis in _world_axes(support):
            for node in np.flatnonzero(share).tolist():
                result.append(GroundSpring(support.block, node, axis, float(share[node])))
    return tuple(result)


def spring_lines(
    springs: tuple[GroundSpring, ...], first: int, place: Callable[[int, int], str]
) -> Iterator[str]:
    """Elements and stiffness of springs, those alike in one set.

    ``first`` is the number of the first element, ``place`` names a node of a block.
    """
    kinds: dict[tuple[int, str], list[GroundSpring]] = {}
    for spring in springs:
        kinds.setdefault((spring.component, f"{spring.stiffness:.12g}"), []).append(spring)
    for number, ((component, stiffness), alike) in enumerate(kinds.items(), start=1):
        name = f"GROUND-{number}"
        yield keyword("Element", type=_SPRING, elset=name)
        for spring in alike:
            yield f"{first}, {place(spring.block, spring.node)}"
            first += 1
        yield keyword("Spring", elset=name)
        yield f"{component + 1}"
        yield real(float(stiffness))


def moving_paths(deck: Deck) -> dict[tuple[tuple[float, float], ...], str]:
    """Tables by which supports move, and the names of their amplitudes."""
    paths = dict.fromkeys(hold.path for hold in deck.holds if hold.displacement and hold.path)
    return {path: f"MOTION-{number}" for number, path in enumerate(paths, start=1)}


def path_lines(deck: Deck) -> Iterator[str]:
    """Amplitudes of supports that move: in seconds, or over the length of a static step."""
    for path, name in moving_paths(deck).items():
        static = deck.step.procedure is Procedure.STATIC
        scale = deck.step.end_time / path[-1][0] if static else 1.0
        yield keyword("Amplitude", name=name)
        flat = [number for time, share in path for number in (scale * time, share)]
        for start in range(0, len(flat), 8):
            yield reals(flat[start : start + 8])


def holds_frame(deck: Deck) -> bool:
    """Whether all fixed blocks are held with all their nodes, and no others."""
    return FRAME in deck.sets and np.array_equal(deck.held_blocks, deck.sets[FRAME])


def held_lines(deck: Deck, target: Callable[[Hold], str]) -> Iterator[str]:
    """Components that stay where they are; ``target`` names the nodes of a support."""
    still = [hold for hold in deck.holds if not hold.displacement]
    if still:
        yield "**"
        yield "** Boundary conditions"
        yield keyword("Boundary")
    if holds_frame(deck):
        yield f"{FRAME}, 1, 3"
        still = [hold for hold in still if not hold.whole]
    for hold in still:
        yield f"{target(hold)}, {hold.components[0] + 1}, {hold.components[-1] + 1}"


def moved_lines(deck: Deck, target: Callable[[Hold], str]) -> Iterator[str]:
    """Components that move in the step, with their amplitude."""
    names = moving_paths(deck)
    for hold in deck.holds:
        if not hold.displacement:
            continue
        name = names.get(hold.path, LOADING if deck.step.ramp_time > 0.0 else None)
        yield keyword("Boundary", **({} if name is None else {"amplitude": name}))
        component = hold.components[0] + 1
        yield f"{target(hold)}, {component}, {component}, {real(hold.displacement)}"


def region_sets(deck: Deck) -> dict[str, Hold]:
    """Node sets of regions without a name, by theirs in the deck."""
    return {hold.region: hold for hold in deck.holds if hold.nodes is not None}


def node_entries(nodes: IntArray | tuple[int, ...]) -> Iterator[str]:
    """Data lines of a node set, nodes from 0."""
    return entry_lines(np.asarray(nodes) + 1)
