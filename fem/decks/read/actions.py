"""Supports of the last step of a deck: what holds, moves and springs its nodes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fem.decks.keywords import DeckError
from fem.decks.read.bodies import Blocks
from fem.decks.read.cards import Card
from fem.decks.read.model import ModelLines, Step, path_of, smooth_time
from geometry.files.named_sets import face_name
from geometry.loads import FaceLoad
from geometry.mesh import FloatArray, IntArray
from geometry.parts.forces import NodeForces
from geometry.parts.regions import Edges, Points, Where
from geometry.parts.supports import HeldFace

#: Displacement of a component [mm], and times [s] and shares of it; (): with the loads.
Moved = tuple[float, tuple[tuple[float, float], ...]]
_STILL: Moved = (0.0, ())


@dataclass
class Actions:
    """What supports and loads the blocks of a deck at the end of its last step."""

    blocks: Blocks
    model: ModelLines
    steps: tuple[Step, ...]
    time: float | None = None
    """In the last step; None: at its end."""
    held: dict[tuple[int, int], dict[int, Moved]] = field(default_factory=dict)
    """Components of each block and node of its part."""
    axes: dict[tuple[int, int], FloatArray] = field(default_factory=dict)
    """Local axes of nodes that *Transform turns, unit vectors, each (3, 3)."""
    names: dict[tuple[int, int, int], str] = field(default_factory=dict)
    """Of the set that first holds a component of a node."""
    faces: list[FaceLoad] = field(default_factory=list)
    forces: list[tuple[int, FloatArray, FloatArray]] = field(default_factory=list)
    """Block, place and force."""
    gravity: dict[int, FloatArray] = field(default_factory=dict)
    """Acceleration of each block."""
    gravity_at: str = ""
    bodies: dict[int, FloatArray] = field(default_factory=dict)
    """Force per volume of each block."""
    ramp_time: float | None = None
    """Smooth step of an explicit run [s]."""

    @property
    def step(self) -> Step:
        """The last step."""
        return self.steps[-1]

    def time_in(self, step: Step) -> float:
        """Time in a step at which its loads and motions count: its end, but in the last one [s]."""
        return self.time if step is self.step and self.time is not None else step.duration

    @property
    def nodes(self) -> tuple[NodeForces, ...]:
        """Forces on nodes."""
        if not self.forces:
            return ()
        block, places, forces = zip(*self.forces, strict=True)
        return (NodeForces(np.array(block), np.array(places), np.array(forces)),)

    def ramp(self, card: Card, ramp: float) -> None:
        """Keep the smooth step of an explicit run.

        Raises
        ------
        DeckError
            A second one.
        """
        if self.ramp_time not in {None, ramp}:
            raise DeckError(
                f"{card.at()}: loads of an explicit step have several amplitudes; expected one"
            )
        self.ramp_time = ramp


def read_supports(actions: Actions) -> None:
    """Read supports of the model data and of all steps, each after the one before.

    Raises
    ------
    DeckError
        Naming the line of the first that cannot be solved.
    """
    _transforms(actions)
    for card in actions.model.other:
        if card.keyword == "BOUNDARY":
            _boundary(actions, card, None)
    for step in actions.steps:
        for number, card in enumerate(c for c in step.cards if c.keyword == "BOUNDARY"):
            if card.option("OP") == "NEW" and not number:
                actions.held.clear()
            _boundary(actions, card, step)


def _transforms(actions: Actions) -> None:
    """Read *Transform: axes of the components of nodes."""
    for card in actions.model.other:
        if card.keyword != "TRANSFORM":
            continue
        kind, values = card.option("TYPE") or "R", card.numbers()
        a, b = values[:3], values[3:6]
        turned = np.cross(a, b) if kind == "R" else b - a
        if kind not in {"R", "C"} or len(values) != 6 or not turned.any():
            raise DeckError(
                f"{card.at()}: *Transform of type {kind} with {len(values)} numbers; expected R "
                "or C with two points that are apart"
            )
        nodes = actions.blocks.places.members(card, card.line, card.parameter("NSET"), nodes=True)
        for block, indices in actions.blocks.located(nodes).items():
            places = actions.blocks.coordinates(block, indices)
            for node, place in zip(indices.tolist(), places, strict=True):
                # R: x through the first point, the second beside it; C: radius, around, along.
                along = b - a
                first = (
                    a
                    if kind == "R"
                    else place - a - along * ((place - a) @ along) / (along @ along)
                )
                third = turned
                if not first.any():
                    raise DeckError(
                        f"{card.at()}: a node lies on the axis of *Transform; expected none there"
                    )
                x, z = first / np.linalg.norm(first), third / np.linalg.norm(third)
                actions.axes[block, node] = np.array([x, np.cross(z, x), z])


def _boundary(actions: Actions, card: Card, step: Step | None) -> None:
    if card.option("TYPE") not in {"", "DISPLACEMENT"}:
        raise DeckError(
            f"{card.at()}: *Boundary of type {card.option('TYPE')} is not covered; expected "
            "displacements"
        )
    for line, row in card.rows():
        components, moved = _moved(actions, card, line, row, step or actions.steps[0])
        nodes = actions.blocks.places.members(card, line, row[0], nodes=True)
        name = row[0].strip('"').lower()
        if name.isdigit():
            name = f"boundary-{card.line}"
        in_solids = [k for k in components if k < 3]
        for block, indices in actions.blocks.located(nodes).items():
            for index in indices.tolist():
                for component in in_solids:
                    actions.names.setdefault((block, index, component), name)
                held = actions.held.setdefault((block, index), {})
                held.update(dict.fromkeys(in_solids, moved))


def _moved(
    actions: Actions, card: Card, line: int, row: list[str], step: Step
) -> tuple[list[int], Moved]:
    """Components of a line and where they go in a step."""
    components, value = _components(card, line, row)
    if not value:
        return components, _STILL
    path = path_of(actions.model, card)
    smooth = smooth_time(actions.model, card) if step.explicit else None
    if smooth is not None:
        actions.ramp(card, smooth)
        path = None
    if path is None:
        return components, (value, ())
    times = _path(step, path)
    if step.explicit or (len(actions.steps) == 1 and actions.time is None):
        return components, (value, times)
    at = np.interp(actions.time_in(step), *np.array(times).T)
    return components, (value * float(at), ())


def _path(step: Step, path: FloatArray) -> tuple[tuple[float, float], ...]:
    """Times and shares up to the end of a step."""
    end = step.duration
    inside = path[path[:, 0] < end]
    rows = [*inside.tolist(), [end, float(np.interp(end, path[:, 0], path[:, 1]))]]
    if rows[0][0] > 0.0:
        rows.insert(0, [0.0, rows[0][1]])
    return tuple((time, share) for time, share in rows)


#: Components of supports that Abaqus names, from 1: u1 to u3, ur1 to ur3.
_WORDS = {
    "ENCASTRE": (1, 2, 3, 4, 5, 6),
    "PINNED": (1, 2, 3),
    "XSYMM": (1, 5, 6),
    "YSYMM": (2, 4, 6),
    "ZSYMM": (3, 4, 5),
    "XASYMM": (2, 3, 4),
    "YASYMM": (1, 3, 5),
    "ZASYMM": (1, 2, 6),
}


def _components(card: Card, line: int, row: list[str]) -> tuple[list[int], float]:
    """Components, from 0, and value of a line of *Boundary; rotations of solids do nothing."""
    word = row[1].upper() if len(row) > 1 else ""
    if word in _WORDS and len(row) == 2:
        return [number - 1 for number in _WORDS[word]], 0.0
    if not word.isdigit():
        raise DeckError(
            f"{card.at(line)}: got {', '.join(row)}; expected a node or a set, a first component, "
            f"a last one and a displacement, or one of {', '.join(_WORDS)}"
        )
    first = card.whole(line, word)
    last = card.whole(line, row[2]) if len(row) > 2 and row[2] else first
    value = card.number(line, row[3]) if len(row) > 3 and row[3] else 0.0
    if not 1 <= first <= last <= 6 or (last > 3 and value):
        raise DeckError(
            f"{card.at(line)}: got components {first} to {last}; expected 1 to 3: solids have no "
            "rotations at nodes"
        )
    return list(range(first - 1, last)), value


# ---------------------------------------------------------------------------------------------
# As supports of blocks


def fixed_blocks(actions: Actions) -> set[int]:
    """Blocks of which every node stays."""
    result = set()
    for block in range(len(actions.blocks.owners)):
        solid = actions.blocks.solid(block)
        every = np.concatenate([solid.nodes, solid.others])
        local = actions.blocks.places.instances[actions.blocks.owners[block][0]].part
        own = every[every < len(local.places)].tolist()
        still = dict.fromkeys(range(3), _STILL)
        if all(actions.held.get((block, node)) == still for node in own):
            result.add(block)
    return result


def held_faces(actions: Actions, fixed: set[int]) -> list[HeldFace]:
    """Parts of blocks that are not fixed which are held, moved or on springs."""
    free = (block for block in range(len(actions.blocks.owners)) if block not in fixed)
    return [face for block in free for face in _held_faces(actions, block)] + _springs(actions)


def _held_faces(actions: Actions, block: int) -> list[HeldFace]:
    """Supports of a block: for each direction the nodes held alike, then directions of the same.

    Nodes at edges are held along more directions than others. Together they make faces, of which
    elements that are split, or of degree 2, have nodes that the deck does not have.
    """
    alike: dict[tuple[bytes, Moved], list[int]] = {}
    names: dict[tuple[bytes, Moved], str] = {}
    for (number, node), stated in actions.held.items():
        if number != block:
            continue
        still = stated == dict.fromkeys(range(3), _STILL)
        axes = None if still else actions.axes.get((block, node))
        for component, value in stated.items():
            along = np.eye(3)[component] if axes is None else np.round(axes[component], 12) + 0.0
            alike.setdefault((along.tobytes(), value), []).append(node)
            names.setdefault((along.tobytes(), value), actions.names[block, node, component])
    together: dict[
        tuple[tuple[int, ...], str, tuple[tuple[float, float], ...]],
        list[tuple[FloatArray, float]],
    ] = {}
    for (direction, (moved, path)), members in alike.items():
        along = np.frombuffer(direction)
        key = tuple(sorted(members)), names[direction, (moved, path)], path if moved else ()
        together.setdefault(key, []).append((along / np.linalg.norm(along), moved))
    result = []
    for (nodes, name, path), parts in together.items():
        rows = np.array([along for along, _ in parts])
        way = np.array([moved for _, moved in parts]) @ rows
        where = _where(actions.blocks, block, np.array(nodes), name)
        held = None if len(rows) == 3 else rows
        there = way if way.any() else None
        result.append(HeldFace(block, where, held, there, path, name=name))
    return result


def _where(blocks: Blocks, block: int, nodes: IntArray, name: str) -> Where:
    """A face where nodes are all those of whole facets, edges where they are those; else nodes."""
    solid, rows = blocks.solid(block), blocks.whole_sides(block, nodes)
    corners = solid.nodes[np.unique(solid.outer[rows])]
    if np.isin(np.setdiff1d(nodes, solid.others), corners).all():
        face = face_name(_of_block(blocks.name(block), name))
        while not np.array_equal(blocks.faces[block].get(face, rows), rows):
            face += "x"
        blocks.add_face(block, face, rows)
        return face
    if blocks.are_edges(block, nodes):
        return Edges(blocks.coordinates(block, np.intersect1d(nodes, solid.nodes)))
    return Points(blocks.coordinates(block, np.union1d(nodes, corners)))


def _of_block(block: str, name: str) -> str:
    """Name of nodes without that of their block, as the sets of our decks have it."""
    own = name.removeprefix(f"{block.lower()}.").removeprefix(f"{block.lower()}_")
    return own.removesuffix("-nodes")


def _springs(actions: Actions) -> list[HeldFace]:
    """Springs between nodes and the ground: SPRING1, a component and a stiffness of each set."""
    nodes: dict[str, list[tuple[int, int]]] = {}
    places, result, known = actions.blocks.places, list[HeldFace](), set[str]()
    for card in actions.model.other:
        if card.keyword == "ELEMENT":
            for line, row in card.rows():
                numbers = [row[0], *(text.rpartition(".")[2] for text in row[1:])]
                if len(row) != 2 or not all(map(str.isdigit, numbers)) or row[0] in known:
                    raise DeckError(
                        f"{card.at(line)}: got {', '.join(row)}; expected a number of its own and "
                        "a node"
                    )
                known.add(row[0])
                found = places.members(card, line, row[1], nodes=True)
                nodes.setdefault(card.parameter("ELSET"), []).extend(found)
    for card in actions.model.other:
        if card.keyword != "SPRING":
            continue
        name = card.parameter("ELSET")
        rows = [(line, [text for text in row if text]) for line, row in card.rows()]
        if [len(row) for _, row in rows] != [1, 1] or name not in nodes:
            raise DeckError(
                f"{card.at()}: *Spring of the set {name}; expected a set of SPRING1, a line with a "
                "component and one with a stiffness"
            )
        component = card.whole(rows[0][0], rows[0][1][0])
        stiffness = card.number(rows[1][0], rows[1][1][0])
        if component not in {1, 2, 3} or stiffness <= 0.0:
            raise DeckError(
                f"{card.at()}: got component {component} and {stiffness:g} N/mm; expected 1, 2 or "
                "3 and a positive stiffness"
            )
        along = np.eye(3)[[component - 1]]
        for block, indices in actions.blocks.located(nodes.pop(name)).items():
            where = Points(actions.blocks.coordinates(block, indices))
            result.append(HeldFace(block, where, along, spring=stiffness, name=name.lower()))
    if nodes:
        raise DeckError(f"SPRING1 elements of the set {next(iter(nodes))} have no *Spring")
    return result
