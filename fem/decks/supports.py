"""Supports of a problem as decks state them: nodes along axes, at rest, moved or on springs.

A deck names faces and node sets. A region without a name is a set of the nodes that lie in it; a
bed of springs is one spring to the ground at each node, ∫ k N_a dA.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from fem.decks.keywords import DeckError, entry_lines, keyword, real, reals
from fem.decks.meshes import SerendipityMesh
from fem.decks.statement import FRAME, LOADING, Deck, Flavour, GroundSpring, Hold, Procedure
from fem.system.forces import traction_forces
from geometry.assembly import Assembly
from geometry.mesh import FloatArray, IntArray
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
        Motions along directions of one node that are not orthogonal.
    """
    fast = [support for support in held if support.spring is None]
    leaning = {support.block for support in fast if _world_axes(support) is None}
    result = [
        hold for one in fast if one.block not in leaning for hold in _along(assembly, one, regions)
    ]
    for block in sorted(leaning):
        mine = [support for support in fast if support.block == block]
        result += _leaning_holds(assembly, block, mine, regions)
    return tuple(result)


def _region(block: int, nodes: tuple[int, ...], regions: Regions) -> str:
    """Name of a set of nodes, a new one where there is none."""
    return regions.setdefault((block, nodes), f"REGION-{len(regions) + 1}")


def _along(assembly: Assembly, support: HeldFace, regions: Regions) -> Iterator[Hold]:
    """One hold for each component along a world axis, or for all three where they stay."""
    nodes, region, face = None, "", None
    if isinstance(support.face, str):
        face = support.face
    else:
        nodes = tuple(region_nodes(assembly, support.block, support.face).tolist())
        region = _region(support.block, nodes, regions)
    base = Hold(support.block, face, nodes=nodes, region=region)
    axes = _world_axes(support) or ()
    if axes == (0, 1, 2) and not support.moves:
        yield base
        return
    moved = np.zeros(3) if support.displacement is None else support.displacement
    path = support.path if support.moves else ()
    for axis in axes:
        yield replace(base, components=(axis,), displacement=float(moved[axis]), path=path)


def _world_axes(support: HeldFace) -> tuple[int, ...] | None:
    """Components that its directions are; None: some lean."""
    largest = np.abs(support.axes).argmax(axis=1)
    if np.abs(np.abs(support.axes) - np.eye(3)[largest]).max() > _ALONG:
        return None
    return tuple(sorted(largest.tolist()))


#: Way of a component and times and shares of it.
_Way = tuple[float, tuple[tuple[float, float], ...]]


def _leaning_holds(
    assembly: Assembly, block: int, supports: list[HeldFace], regions: Regions
) -> Iterator[Hold]:
    """Supports of a block of which some lean: nodes that are held alike, along their own axes."""
    at: dict[int, tuple[list[FloatArray], list[_Way]]] = {}
    for support in sorted(supports, key=lambda one: not one.moves):
        moved = np.zeros(3) if support.displacement is None else support.displacement
        for node in region_nodes(assembly, block, support.face).tolist():
            axes, ways = at.setdefault(node, ([], []))
            for along in support.axes:
                left = along - sum((axis * (axis @ along) for axis in axes), np.zeros(3))
                size, way = float(np.linalg.norm(left)), float(along @ moved)
                if size <= _ALONG:
                    continue
                if size < 1.0 - _ALONG and (way or any(value for value, _ in ways)):
                    raise DeckError(
                        f"support {support.title}: a node moves along directions that are not "
                        "orthogonal; expected such, or supports that stay"
                    )
                axes.append(left / size)
                ways.append((way, support.path if support.moves else ()))
    alike: dict[tuple[tuple[float, ...] | None, tuple[tuple[int, _Way], ...]], list[int]] = {}
    for node, (axes, ways) in at.items():
        alike.setdefault(_framed(axes, ways), []).append(node)
    for (pair, components), nodes in alike.items():
        chosen = tuple(sorted(nodes))
        base = Hold(block, nodes=chosen, region=_region(block, chosen, regions), axes=pair)
        for component, (way, path) in components:
            yield replace(base, components=(component,), displacement=way, path=path)


def _framed(
    axes: list[FloatArray], ways: list[_Way]
) -> tuple[tuple[float, ...] | None, tuple[tuple[int, _Way], ...]]:
    """Axes of a node, None for those of the world, and the way of each component that is held."""
    largest = [int(np.abs(axis).argmax()) for axis in axes]
    if all(abs(axis[k]) >= 1.0 - _ALONG for axis, k in zip(axes, largest, strict=True)):
        signed = zip(largest, axes, ways, strict=True)
        return None, tuple(
            sorted((k, (float(np.sign(a[k])) * w, path)) for k, a, (w, path) in signed)
        )
    first = axes[0]
    second = axes[1] if len(axes) > 1 else np.eye(3)[np.abs(first).argmin()]
    second = second - first * (first @ second)
    if len(axes) == 3 and np.cross(first, second) @ axes[2] < 0.0:
        ways = [*ways[:2], (-ways[2][0], ways[2][1])]
    pair = np.concatenate([first, second / np.linalg.norm(second)])
    return tuple((pair.round(14) + 0.0).tolist()), tuple(enumerate(ways))


def in_own_axes(deck: Deck, block: int, forces: dict[int, FloatArray]) -> dict[int, FloatArray]:
    """Forces on nodes of a block along the axes that the nodes have, (3,) each."""
    result = dict(forces)
    for hold in deck.leaning:
        if hold.block == block:
            pair = np.reshape(hold.axes or (), (2, 3))
            frame = np.vstack([pair, np.cross(*pair)])
            result |= {n: frame @ forces[n] for n in hold.nodes or () if n in forces}
    return result


def transform_lines(deck: Deck, target: Callable[[Hold], str]) -> Iterator[str]:
    """Axes of the nodes of supports that lean; ``target`` names their set."""
    for hold in {hold.region: hold for hold in deck.leaning}.values():
        yield keyword("Transform", nset=target(hold), type="R")
        yield reals(hold.axes or ())


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
        axes = _world_axes(support)
        if axes is None:
            raise DeckError(
                f"support {support.title}: got springs along {support.axes.tolist()}; decks have "
                "them along world axes: expected x, y or z, or turn the blocks"
            )
        for axis in axes:
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
    nodes = hold.block, hold.face, hold.nodes, hold.axes
    return {(*nodes, k): (hold.displacement, hold.path) for k in hold.components}


def _components(deck: Deck) -> dict[tuple[object, ...], tuple[object, ...]]:
    return {key: value for h in deck.holds for key, value in _components_of(h).items()}


def region_sets(deck: Deck) -> dict[str, Hold]:
    """Node sets of regions without a name, by theirs in the deck."""
    return {hold.region: hold for hold in deck.every_hold if hold.nodes is not None}


def node_entries(nodes: IntArray | tuple[int, ...]) -> Iterator[str]:
    """Data lines of a node set, nodes from 0."""
    return entry_lines(np.asarray(nodes) + 1)
