"""Supports and loads of a step as those of a problem."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fem.decks.keywords import DeckError
from fem.decks.read.bodies import Blocks
from fem.decks.read.cards import Card
from fem.decks.read.model import ModelLines, Step, path_of
from geometry.files.named_sets import face_name
from geometry.loads import CircumferentialLoad, FaceLoad, PressureLoad, TractionLoad
from geometry.mesh import FloatArray, IntArray
from geometry.parts.forces import NodeForces
from geometry.parts.regions import Points, Where
from geometry.parts.supports import HeldFace

#: Displacement of a component, and times and shares of it.
_Value = tuple[float, tuple[tuple[float, float], ...]]


@dataclass
class Actions:
    """What supports and loads the blocks of a deck."""

    blocks: Blocks
    model: ModelLines
    step: Step
    held: dict[tuple[int, int], dict[int, _Value]] = field(default_factory=dict)
    """Components of each block and node of its part."""
    names: dict[tuple[int, int], str] = field(default_factory=dict)
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
    def nodes(self) -> tuple[NodeForces, ...]:
        """Forces on nodes."""
        if not self.forces:
            return ()
        block, places, forces = zip(*self.forces, strict=True)
        return (NodeForces(np.array(block), np.array(places), np.array(forces)),)


def read_actions(blocks: Blocks, model: ModelLines, step: Step) -> Actions:
    """Read supports and loads of the model data and of the step.

    Raises
    ------
    DeckError
        Naming the line of the first that cannot be solved.
    """
    actions = Actions(blocks, model, step)
    for card in [*model.other, *step.cards]:
        if card.option("OP") == "NEW" and card in step.cards and card.keyword == "BOUNDARY":
            actions.held.clear()
        reader = {"BOUNDARY": _boundary, "CLOAD": _cload, "DLOAD": _dload, "DSLOAD": _dsload}
        if card.keyword in reader:
            reader[card.keyword](actions, card)
    return actions


def _share(actions: Actions, card: Card) -> float:
    """Share of a load at the end of the step."""
    step = actions.step
    path = path_of(actions.model, card, explicit=step.explicit)
    if path is None:
        ramp = 0.0 if step.explicit else None
    else:
        ramp = float(path[1, 0]) if step.explicit else None
    if step.explicit:
        if actions.ramp_time not in {None, ramp}:
            raise DeckError(
                f"{card.at()}: loads of an explicit step have several amplitudes; expected one"
            )
        actions.ramp_time = ramp
    if path is None or step.explicit:
        return 1.0
    return float(np.interp(step.duration, path[:, 0], path[:, 1]))


def _boundary(actions: Actions, card: Card) -> None:
    if card.option("TYPE") not in {"", "DISPLACEMENT"}:
        raise DeckError(
            f"{card.at()}: *Boundary of type {card.option('TYPE')} is not covered; expected "
            "displacements"
        )
    path = path_of(actions.model, card, explicit=actions.step.explicit)
    for line, row in card.rows():
        first, last, value = _components(card, line, row)
        nodes = actions.blocks.places.members(card, line, row[0], nodes=True)
        times: tuple[tuple[float, float], ...] = ()
        if path is not None and value:
            times = _path(actions.step, path)
        name = row[0].strip('"').lower()
        if name.isdigit():
            name = f"boundary-{card.line}"
        for block, indices in actions.blocks.located(nodes).items():
            for node in indices.tolist():
                here = actions.held.setdefault((block, node), {})
                actions.names.setdefault((block, node), name)
                here.update(dict.fromkeys(range(first - 1, last), (value, times)))


def _path(step: Step, path: FloatArray) -> tuple[tuple[float, float], ...]:
    """Times and shares up to the end of a step."""
    end = step.duration
    inside = path[path[:, 0] < end]
    rows = [*inside.tolist(), [end, float(np.interp(end, path[:, 0], path[:, 1]))]]
    if rows[0][0] > 0.0:
        rows.insert(0, [0.0, rows[0][1]])
    return tuple((time, share) for time, share in rows)


#: What Abaqus calls some supports, by their components.
_WORDS = {"ENCASTRE": (1, 3), "PINNED": (1, 3)}


def _components(card: Card, line: int, row: list[str]) -> tuple[int, int, float]:
    """First and last component and value of a line of *Boundary."""
    word = row[1].upper() if len(row) > 1 else ""
    if word in _WORDS and len(row) == 2:
        return *_WORDS[word], 0.0
    if not word.isdigit():
        raise DeckError(
            f"{card.at(line)}: got {', '.join(row)}; expected a node or a set, a first component, "
            "a last one and a displacement, or ENCASTRE"
        )
    first = card.whole(line, word)
    last = card.whole(line, row[2]) if len(row) > 2 and row[2] else first
    value = card.number(line, row[3]) if len(row) > 3 and row[3] else 0.0
    if not 1 <= first <= last or (last > 3 and value):
        raise DeckError(
            f"{card.at(line)}: got components {first} to {last}; expected 1 to 3: solids have no "
            "rotations at nodes"
        )
    return first, min(last, 3), value


def held_blocks(actions: Actions) -> tuple[list[int], list[HeldFace]]:
    """Blocks of which every node stays, and parts of the others that are held or moved."""
    fixed, faces = [], []
    for block in range(len(actions.blocks.owners)):
        solid = actions.blocks.solid(block)
        every = np.concatenate([solid.nodes, solid.others])
        local = actions.blocks.places.instances[actions.blocks.owners[block][0]].part
        own = every[every < len(local.places)].tolist()
        still: dict[int, _Value] = dict.fromkeys(range(3), (0.0, ()))
        if all(actions.held.get((block, node)) == still for node in own):
            fixed.append(block)
        else:
            faces += _held_faces(actions, block)
    return fixed, faces


def _held_faces(actions: Actions, block: int) -> list[HeldFace]:
    """Supports of a block: nodes that are held alike in one."""
    alike: dict[tuple[str, tuple[tuple[int, _Value], ...]], list[int]] = {}
    for (number, node), stated in actions.held.items():
        if number == block and stated:
            key = (actions.names[block, node], tuple(sorted(stated.items())))
            alike.setdefault(key, []).append(node)
    result = []
    for (name, components), nodes in alike.items():
        by_path: dict[tuple[tuple[float, float], ...], list[tuple[int, float]]] = {}
        for component, (value, path) in components:
            by_path.setdefault(path if value else (), []).append((component, value))
        where = _where(actions.blocks, block, np.array(sorted(nodes)), name)
        for path, parts in by_path.items():
            moved = np.zeros(3)
            for component, value in parts:
                moved[component] = value
            axes = np.eye(3)[sorted(component for component, _ in parts)]
            result.append(
                HeldFace(
                    block,
                    where,
                    None if len(axes) == 3 else axes,
                    moved if moved.any() else None,
                    path,
                    name=name,
                )
            )
    return result


def _where(blocks: Blocks, block: int, nodes: IntArray, name: str) -> Where:
    """A face where nodes are all those of whole facets; else the nodes themselves."""
    solid, rows = blocks.solid(block), blocks.whole_sides(block, nodes)
    corners = solid.nodes[np.unique(solid.outer[rows])]
    if np.isin(np.setdiff1d(nodes, solid.others), corners).all():
        face = face_name(f"{name}-{block + 1}")
        while face in blocks.faces[block]:
            face += "x"
        blocks.add_face(block, face, rows)
        return face
    return Points(blocks.coordinates(block, np.union1d(nodes, corners)))


# ---------------------------------------------------------------------------------------------
# Loads


def _cload(actions: Actions, card: Card) -> None:
    share = _share(actions, card)
    for line, row in card.rows():
        component = card.whole(line, row[1]) if len(row) > 2 else 0
        if not 1 <= component <= 3:
            raise DeckError(
                f"{card.at(line)}: got {', '.join(row)}; expected a node or a set, a component "
                "from 1 to 3 and a force"
            )
        force = np.zeros(3)
        force[component - 1] = share * card.number(line, row[2])
        nodes = actions.blocks.places.members(card, line, row[0], nodes=True)
        located = actions.blocks.located(nodes)
        if not located:
            raise DeckError(
                f"{card.at(line)}: no node of {row[0]!r} is of an element; expected one"
            )
        for block, indices in located.items():
            for place in actions.blocks.coordinates(block, indices):
                actions.forces.append((block, place, force))


def _dload(actions: Actions, card: Card) -> None:
    for number, (line, row) in enumerate(card.rows()):
        kind = row[1].upper() if len(row) > 2 else ""
        share = _gravity_share(actions, card) if kind == "GRAV" else _share(actions, card)
        value = share * card.number(line, row[2]) if kind else 0.0
        elements = actions.blocks.places.members(card, line, row[0], nodes=False)
        name = f"load-{card.line}-{number + 1}"
        if kind.startswith("P") and kind[1:].isdigit():
            faces = actions.blocks.sides(card, line, elements, kind)
            _press(actions, faces, name, value)
        elif kind in {"BX", "BY", "BZ"}:
            force = np.zeros(3)
            force["XYZ".index(kind[1])] = value
            for block in _whole(actions, card, line, elements):
                actions.bodies[block] = actions.bodies.get(block, np.zeros(3)) + force
        elif kind == "GRAV" and len(row) == 6:
            along = np.array([card.number(line, text) for text in row[3:]])
            length = float(np.linalg.norm(along))
            actions.gravity_at = card.at(line)
            for block in _whole(actions, card, line, elements):
                here = actions.gravity.get(block, np.zeros(3))
                actions.gravity[block] = here + value * along / (length or 1.0)
        else:
            raise DeckError(
                f"{card.at(line)}: got load {kind or ', '.join(row)!r}; expected P1 to P6, "
                "GRAV, BX, BY or BZ"
            )


def _gravity_share(actions: Actions, card: Card) -> float:
    """Share of gravity, which explicit runs have from the beginning."""
    if not actions.step.explicit:
        return _share(actions, card)
    if card.option("AMPLITUDE"):
        raise DeckError(
            f"{card.at()}: gravity of an explicit step has an amplitude; expected it from the "
            "beginning, without one"
        )
    return 1.0


def _whole(actions: Actions, card: Card, line: int, elements: list[tuple[int, int]]) -> list[int]:
    """Blocks of elements, all of each."""
    count: dict[int, int] = {}
    for instance, label in dict.fromkeys(elements):
        body = actions.blocks.bodies[instance]
        element = actions.blocks.places.instances[instance].part.element_index[label]
        block = actions.blocks.numbers[instance, int(body.solid_of[element])]
        count[block] = count.get(block, 0) + 1
    for block, n in count.items():
        instance, solid = actions.blocks.owners[block]
        if n != int((actions.blocks.bodies[instance].solid_of == solid).sum()):
            raise DeckError(
                f"{card.at(line)}: the load acts on part of a block; expected whole blocks"
            )
    return list(count)


def _press(actions: Actions, faces: dict[int, IntArray], name: str, pressure: float) -> None:
    turns = actions.step.large_rotations
    last = actions.faces[-1] if actions.faces else None
    blocks = list(faces)
    if (
        isinstance(last, PressureLoad)
        and last.pressure == pressure
        and str(last.face).rpartition("-")[0] == name.rpartition("-")[0]
        and not np.isin(blocks, last.blocks).any()
    ):
        # The same pressure on many blocks is one load.
        name, blocks = str(last.face), [*last.blocks.tolist(), *blocks]
        actions.faces.pop()
    for block, rows in faces.items():
        actions.blocks.add_face(block, name, rows)
    actions.faces.append(PressureLoad(np.array(sorted(blocks)), name, pressure, turns))


def _dsload(actions: Actions, card: Card) -> None:
    share = _share(actions, card)
    for number, (line, row) in enumerate(card.rows()):
        kind = row[1].upper() if len(row) > 2 else ""
        value = share * card.number(line, row[2]) if kind else 0.0
        faces = actions.blocks.surface(card, line, row[0])
        name = f"load-{card.line}-{number + 1}"
        if kind == "P":
            _press(actions, faces, name, value)
            continue
        along = np.array([card.number(line, text) for text in row[3:]])
        if kind != "TRVEC" or along.shape != (3,) or not along.any():
            raise DeckError(
                f"{card.at(line)}: got load {kind or ', '.join(row)!r}; expected P, or TRVEC "
                "with a direction"
            )
        if card.option("FOLLOWER") != "NO" and actions.step.large_rotations:
            actions.model.note("loads: a traction keeps its direction, blocks turn little")
        for block, rows in faces.items():
            actions.blocks.add_face(block, name, rows)
        along *= value / np.linalg.norm(along)
        chosen = np.array(sorted(faces))
        if "ORIENTATION" not in card.parameters:
            actions.faces.append(TractionLoad(chosen, name, along))
        elif along[0] == along[2] == 0.0:
            actions.faces.append(CircumferentialLoad(chosen, name, float(along[1])))
        else:
            raise DeckError(
                f"{card.at(line)}: got the direction {row[3:]} in an orientation; expected the "
                "second one of a cylinder, 0., 1., 0."
            )


def orientation_of(actions: Actions) -> tuple[FloatArray, FloatArray]:
    """Axis and a point of it, of the cylinder that tractions go round; else z through 0."""
    for card in actions.step.cards:
        if card.keyword != "DSLOAD" or "ORIENTATION" not in card.parameters:
            continue
        stated = actions.model.orientations.get(card.option("ORIENTATION"))
        values = np.zeros(0) if stated is None else stated.numbers()
        if stated is None or stated.option("SYSTEM") != "CYLINDRICAL" or len(values) < 6:
            raise DeckError(
                f"{card.at()}: got orientation {card.option('ORIENTATION')}; expected a "
                "cylindrical one with two points"
            )
        axis = values[3:6] - values[:3]
        return axis / np.linalg.norm(axis), values[:3]
    return np.array([0.0, 0.0, 1.0]), np.zeros(3)
