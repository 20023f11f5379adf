"""Supports of a problem in the words of decks: sets of nodes, their axes, springs, motions.

Rows of supports are those of the solvers. Nodes that make up faces are held by the names of these,
others as a set of nodes; a bed of springs is one spring to the ground at each node, ∫ k N_a dA.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fem.decks.deck import ALL, FRAME, LOADING, Deck, Flavour
from fem.decks.keywords import DeckError, keyword, label, real, reals, table_lines
from fem.problem import Frames, Problem
from fem.system.build import support_rows
from fem.system.rows import ALL_THE_WAY, HeldRows, TabularAmplitude, traction_forces
from geometry.block import Block
from geometry.mesh import FloatArray
from geometry.parts.regions import HeldFace, region_quads

#: Directions that lean from a world axis by less lie along it [-].
_ALONG = 1e-9
#: Name of a spring to the ground along one component, in Abaqus and CalculiX.
_SPRING = "SPRING1"


@dataclass(frozen=True)
class HeldNodes:
    """Nodes of one block that are held alike: a set of a deck."""

    block: int
    """Their block."""
    face: str | None = None
    """Face whose nodes they are; None: `nodes`."""
    nodes: tuple[int, ...] | None = None
    """Nodes in the block's mesh, of a region without a name; None: those of the face, or all."""
    axes: tuple[float, ...] | None = None
    """First and second axis of their components, six numbers; None: world axes."""

    @property
    def whole(self) -> bool:
        """Whether they are all nodes of the block."""
        return self.face is None and self.nodes is None

    @property
    def frame(self) -> FloatArray:
        """Axes of their components as rows, (3, 3)."""
        if self.axes is None:
            return np.eye(3)
        pair = np.reshape(self.axes, (2, 3))
        return np.vstack([pair, np.cross(*pair)])


#: Way of a component [mm], and times [s] and shares of it, (): with the loads.
Way = tuple[float, tuple[tuple[float, float], ...]]
_STAYS: Way = (0.0, ())
#: Ways of the held components of sets of nodes.
Supports = dict[HeldNodes, dict[int, Way]]


def supports_of(problem: Problem) -> Supports:
    """What holds nodes of a problem, without springs: blocks that do not deform, and its rows.

    Raises
    ------
    ModelError
        Two supports that move one node by different lengths along one direction.
    """
    blocks, fixed = problem.blocks, np.flatnonzero(~problem.deforming).tolist()
    result: Supports = {HeldNodes(block): dict.fromkeys(range(3), _STAYS) for block in fixed}
    rows = support_rows(blocks, problem.load_case, rigid=problem.frames is Frames.RIGID)
    for block in dict.fromkeys(rows.block.tolist()):
        result |= _of_block(block, blocks.shape(block), blocks.rotations[block], rows)
    return result


def _of_block(block: int, shape: Block, turn: FloatArray, rows: HeldRows) -> Supports:
    """Faces of a block that are held alike along world axes, else nodes that are."""
    at: dict[int, tuple[list[FloatArray], list[Way]]] = {}
    for k in np.flatnonzero(rows.block == block).tolist():
        axes, ways = at.setdefault(int(rows.node[k]), ([], []))
        axes.append(turn @ rows.direction[k])
        ways.append(_way(rows, k))
    level: dict[tuple[int, Way], list[int]] = {}
    leaning: dict[tuple[tuple[float, ...], tuple[tuple[int, Way], ...]], list[int]] = {}
    for node, (axes, ways) in at.items():
        framed, components = _framed(axes, ways)
        if framed is not None:
            leaning.setdefault((framed, components), []).append(node)
        for component in components if framed is None else ():
            level.setdefault(component, []).append(node)
    result: Supports = {}
    for (axis, way), nodes in sorted(level.items(), key=lambda item: item[0][0]):
        for held in _sets(block, shape, set(nodes)):
            result.setdefault(held, {})[axis] = way
    for (framed, components), nodes in leaning.items():
        result[HeldNodes(block, nodes=tuple(sorted(nodes)), axes=framed)] = dict(components)
    return result


def _way(rows: HeldRows, k: int) -> Way:
    """Way of a row of supports, and the table that moves it."""
    value, table = float(rows.value[k]), int(rows.table[k])
    if not value:
        return _STAYS
    share = rows.tables[table]
    if share is ALL_THE_WAY or not isinstance(share, TabularAmplitude):
        return value, ()
    return value, tuple(zip(share.times, share.values, strict=True))


def _sets(block: int, shape: Block, nodes: set[int]) -> list[HeldNodes]:
    """Faces that have these nodes of a block together, the largest first; else the nodes."""
    left, result = set(nodes), []
    faces = {name: set(np.unique(quads).tolist()) for name, quads in shape.faces.items()}
    for name, face in sorted(faces.items(), key=lambda item: -len(item[1])):
        if face <= nodes and face & left:
            result.append(HeldNodes(block, name))
            left -= face
    return [HeldNodes(block, nodes=tuple(sorted(nodes)))] if left else result


def _world_axes(support: HeldFace) -> tuple[int, ...] | None:
    """Components that its directions are; None: some lean."""
    largest = np.abs(support.axes).argmax(axis=1)
    if np.abs(np.abs(support.axes) - np.eye(3)[largest]).max() > _ALONG:
        return None
    return tuple(sorted(largest.tolist()))


def _framed(
    axes: list[FloatArray], ways: list[Way]
) -> tuple[tuple[float, ...] | None, tuple[tuple[int, Way], ...]]:
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


class DeckSupports:
    """Supports of all steps of a deck, and the names of their sets and amplitudes."""

    def __init__(self, deck: Deck) -> None:
        self.deck = deck
        self.stages = [supports_of(problem) for problem in deck.stages]
        every = [item for stage in self.stages for item in stage.items()]
        #: Sets of nodes of all steps.
        self.sets = list(dict.fromkeys(nodes for nodes, _ in every))
        #: Names of regions that have none.
        self.regions: dict[tuple[int, tuple[int, ...]], str] = {}
        for held in self.sets:
            if held.nodes is not None:
                key = held.block, held.nodes
                self.regions.setdefault(key, f"REGION-{len(self.regions) + 1}")
        paths = dict.fromkeys(
            path for _, ways in every for value, path in ways.values() if value and path
        )
        #: Names of the amplitudes by which supports move.
        self.paths = {path: f"MOTION-{number}" for number, path in enumerate(paths, start=1)}

    def name(self, held: HeldNodes) -> str:
        """Name of a set of nodes."""
        if held.nodes is None:
            of = ALL if held.face is None else f"{label(held.face)}-NODES"
            return self.deck.of_block(held.block, of)
        region = self.regions[held.block, held.nodes]
        return self.deck.of_block(held.block, region) if self.deck.is_flat else region

    def in_own_axes(self, block: int, forces: FloatArray) -> FloatArray:
        """Forces on the nodes of a block along the axes that these have, (n_nodes, 3)."""
        result = forces.copy()
        for held in self.sets:
            if held.block == block and held.axes is not None:
                nodes = list(held.nodes or ())
                result[nodes] = forces[nodes] @ held.frame.T
        return result

    @property
    def leaning(self) -> list[HeldNodes]:
        """Sets of nodes that have axes of their own."""
        return [held for held in self.sets if held.axes is not None]

    def transform_lines(self) -> Iterator[str]:
        """Axes of nodes that have their own."""
        for held in self.leaning:
            yield keyword("Transform", nset=self.name(held), type="R")
            yield reals(held.axes or ())

    def path_lines(self) -> Iterator[str]:
        """Amplitudes of supports that move: in seconds, or over the length of a static step."""
        for path, name in self.paths.items():
            scale = self.deck.end_time / path[-1][0] if self.deck.in_time is None else 1.0
            yield keyword("Amplitude", name=name)
            yield from table_lines((scale * time, share) for time, share in path)

    @property
    def hold_frame(self) -> bool:
        """Whether all fixed blocks are held with all their nodes, and no others."""
        held = np.flatnonzero(~self.deck.problem.deforming)
        return FRAME in self.deck.sets and np.array_equal(held, self.deck.sets[FRAME])

    def still_lines(self) -> Iterator[str]:
        """Components that stay from rest on."""
        still = [
            f"{self.name(held)}, {first + 1}, {last + 1}"
            for held, ways in self.stages[0].items()
            if not (self.hold_frame and held.whole)
            for first, last, (value, _) in _ranges(ways)
            if not value
        ]
        frame = [f"{FRAME}, 1, 3"] * self.hold_frame
        if frame or still:
            yield "**"
            yield "** Boundary conditions"
            yield keyword("Boundary")
            yield from (*frame, *still)

    def step_lines(self, number: int) -> Iterator[str]:
        """Components that move in a step, with their amplitude; all, if some are held no more.

        These are taken back by op=NEW, beside which all others are stated again.
        """
        later, supports = number > 0, self.stages[number]
        known = self.stages[number - 1] if later else {}
        anew: dict[str, str | None] = {}
        if any(ways.keys() - supports.get(held, {}).keys() for held, ways in known.items()):
            anew, known = {"op": "NEW"}, {}
        ramp = None if later or not self.deck.ramp_time else LOADING
        for held, ways in supports.items():
            for first, last, (value, path) in _ranges(ways):
                if not later and not value:
                    continue  # among the supports from rest on
                before = known.get(held, {})
                if all(before.get(k) == (value, path) for k in range(first, last + 1)):
                    continue
                name = self.paths.get(path, ramp)
                yield keyword("Boundary", **anew, **({} if name is None else {"amplitude": name}))
                way = f", {real(value)}" if value or later else ""
                yield f"{self.name(held)}, {first + 1}, {last + 1}{way}"


def _ranges(ways: dict[int, Way]) -> list[tuple[int, int, Way]]:
    """First and last component, and their way: all three where they stay, else each by itself."""
    if len(ways) == 3 and all(way == _STAYS for way in ways.values()):
        return [(0, 2, _STAYS)]
    return [(axis, axis, way) for axis, way in ways.items()]


def spring_lines(deck: Deck, first: int) -> Iterator[str]:
    """Elements and stiffness of springs of beds at their nodes, those alike in one set.

    ``first`` is the number of the first element.

    Raises
    ------
    DeckError
        Springs in an explicit step, or along no world axis.
    """
    kinds: dict[tuple[int, str], list[str]] = {}
    for support in deck.problem.load_case.held:
        if support.spring is not None:
            for node, share in enumerate(_shares(deck, support).tolist()):
                for axis in _world_axes(support) or () if share else ():
                    alike = kinds.setdefault((axis, f"{share:.12g}"), [])
                    alike.append(deck.node(support.block, node))
    for number, ((axis, stiffness), nodes) in enumerate(kinds.items(), start=1):
        name = f"GROUND-{number}"
        yield keyword("Element", type=_SPRING, elset=name)
        yield from (f"{element}, {node}" for element, node in enumerate(nodes, start=first))
        first += len(nodes)
        yield keyword("Spring", elset=name)
        yield f"{axis + 1}"
        yield real(float(stiffness))


def _shares(deck: Deck, support: HeldFace) -> FloatArray:
    """Stiffness of the spring at each node of the block of a bed, (n_nodes,) [N/mm]."""
    mesh = deck.assembly.shape(support.block).mesh
    quads = region_quads(deck.assembly, support.block, support.face)
    return traction_forces(mesh.nodes, quads, np.array([support.spring, 0.0, 0.0]))[:, 0]


def check_springs(deck: Deck) -> None:
    """Reject springs that the program does not have."""
    for support in deck.problem.load_case.held:
        if support.spring is None:
            continue
        if deck.flavour is Flavour.GENERAL:
            raise DeckError(
                f"support {support.title}: got springs, which Abaqus/Explicit does not have to the "
                "ground (SPRING1); expected --flavour standard or calculix, a static step"
            )
        if _world_axes(support) is None:
            raise DeckError(
                f"support {support.title}: got springs along {support.axes.tolist()}; decks have "
                "them along world axes: expected x, y or z, or turn the blocks"
            )
