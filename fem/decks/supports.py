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


#: Names of node sets by block and nodes.
Regions = dict[tuple[int, tuple[int, ...]], str]


def holds_on(assembly: Assembly, held: tuple[HeldFace, ...], regions: Regions) -> tuple[Hold, ...]:
    """Supports without springs, components of different ways apart; new regions get a name.

    Raises
    ------
    DeckError
        Directions that are no world axes.
    """
    result: list[Hold] = []
    for support in held:
        if support.spring is not None:
            continue
        nodes, region = None, ""
        if not isinstance(support.face, str):
            nodes = tuple(region_nodes(assembly, support.block, support.face).tolist())
            region = regions.setdefault((support.block, nodes), f"REGION-{len(regions) + 1}")
        base = Hold(
            support.block,
            face=None if region else str(support.face),
            nodes=nodes,
            region=region,
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
    paths = dict.fromkeys(hold.path for hold in deck.every_hold if hold.displacement and hold.path)
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
    """Components that stay from rest on; ``target`` names the nodes of a support."""
    deck = deck.stages[0]
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


def step_support_lines(deck: Deck, target: Callable[[Hold], str]) -> Iterator[str]:
    """Components that move in the step, with their amplitude; all, if others are held than before.

    Components that go are taken back by op=NEW, beside which all others are stated again.
    """
    names, ramp = moving_paths(deck), deck.step.ramp_time > 0.0 and deck.before is None
    known = {} if deck.before is None else _components(deck.before)
    anew: dict[str, str | None] = {}
    if known.keys() - _components(deck).keys():
        anew, known = {"op": "NEW"}, {}
    for hold in deck.holds:
        if deck.before is None and not hold.displacement:
            continue  # among the supports from rest on
        if _components_of(hold).items() <= known.items():
            continue
        name = names.get(hold.path, LOADING if ramp else None)
        yield keyword("Boundary", **anew, **({} if name is None else {"amplitude": name}))
        first, last = hold.components[0] + 1, hold.components[-1] + 1
        value = f", {real(hold.displacement)}" if hold.displacement or deck.before else ""
        yield f"{target(hold)}, {first}, {last}{value}"


def _components_of(hold: Hold) -> dict[tuple[object, ...], tuple[object, ...]]:
    """Where each component of a support will be, by what it holds."""
    nodes = hold.block, hold.face, hold.nodes
    return {(*nodes, k): (hold.displacement, hold.path) for k in hold.components}


def _components(deck: Deck) -> dict[tuple[object, ...], tuple[object, ...]]:
    return {key: value for h in deck.holds for key, value in _components_of(h).items()}


def region_sets(deck: Deck) -> dict[str, Hold]:
    """Node sets of regions without a name, by theirs in the deck."""
    return {hold.region: hold for hold in deck.every_hold if hold.nodes is not None}


def node_entries(nodes: IntArray | tuple[int, ...]) -> Iterator[str]:
    """Data lines of a node set, nodes from 0."""
    return entry_lines(np.asarray(nodes) + 1)
