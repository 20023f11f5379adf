"""Loads of a deck at the end of its last step: forces, pressures, tractions, gravity."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields

import numpy as np

from fem.decks.read.actions import Actions, Line
from fem.decks.read.blocks import Member
from fem.decks.read.model import path_of, smooth_time
from geometry.assembly import Assembly
from geometry.loads import CircumferentialLoad, PressureLoad, TractionLoad
from geometry.mesh import FloatArray, IntArray
from geometry.parts.regions import NodeForces

#: Gravity of blocks that differs by less is the same.
_SAME = 1e-9


def read_loads(actions: Actions) -> None:
    """Read loads of all steps: what a later step states anew takes the place of the earlier.

    Raises
    ------
    DeckError
        Naming the line of the first that cannot be solved.
    """
    readers = {"CLOAD": _cload, "DLOAD": _dload, "DSLOAD": _dsload}
    rows = actions.acting(set(readers))
    _check_apart(actions, rows)
    for row in rows:
        readers[row.card.keyword](actions, row)


def _members(actions: Actions, stated: Line) -> list[Member]:
    """Nodes or elements that a line names; of gravity without a set in Abaqus all elements."""
    blocks, nodes = actions.blocks, stated.card.keyword == "CLOAD"
    if stated.kind == "GRAV" and not stated.target and not blocks.each_once:
        return blocks.elements
    return blocks.members(stated.card, stated.line, stated.target, nodes=nodes)


def _check_apart(actions: Actions, rows: list[Line]) -> None:
    """Reject sets of several steps that share members: which of them acts is not covered."""
    loaded: dict[tuple[object, ...], int] = {}
    for row in rows if len({row.number for row in rows}) > 1 else ():
        # Loads on surfaces of other names add up.
        for member in () if row.card.keyword == "DSLOAD" else _members(actions, row):
            key = row.card.keyword, row.kind, member
            if loaded.setdefault(key, row.number) != row.number:
                raise row.card.wrong(
                    f"{row.target}, which shares members with a load of an earlier step",
                    "the same set in both, or op=NEW",
                    row.line,
                )


def _value(actions: Actions, stated: Line) -> float:
    """Size of a load at the end of its step."""
    card, row = stated.card, stated.row
    if len(row) < 3:
        raise card.wrong(", ".join(row), "a set or surface, a kind of load, a value", stated.line)
    value = card.number(stated.line, row[2])
    if not stated.step.explicit:
        path = path_of(actions.model, card)
        time = actions.time_in(stated.step)
        return value if path is None else value * float(np.interp(time, *path.T))
    if stated.kind != "GRAV":
        actions.ramp(card, smooth_time(actions.model, card) or 0.0)
    elif card.option("AMPLITUDE"):  # explicit runs have it from the beginning
        raise card.unread("gravity of an explicit step with an amplitude")
    return value


def _cload(actions: Actions, stated: Line) -> None:
    card, line, value = stated.card, stated.line, _value(actions, stated)
    component = card.whole(line, stated.kind)
    if not 1 <= component <= 3:
        raise card.wrong(f"component {component}", "1 to 3", line)
    for block, indices in actions.blocks.located(_members(actions, stated)).items():
        for place in actions.blocks.coordinates(block, indices):
            actions.forces.append((block, place, value * np.eye(3)[component - 1]))


def _dload(actions: Actions, stated: Line) -> None:
    card, line, kind, value = stated.card, stated.line, stated.kind, _value(actions, stated)
    blocks, elements = actions.blocks, _members(actions, stated)
    if kind.startswith("P") and kind[1:].isdigit():
        faces = blocks.facets(card, line, elements, kind)
        _act(actions, faces, f"{stated.target}-{kind}", PressureLoad, value, actions.step.turns)
    elif kind in {"BX", "BY", "BZ"}:
        along = value * np.eye(3)["XYZ".index(kind[1])]
        _add(actions.bodies, blocks.whole(card, line, elements), along)
    elif kind == "GRAV" and len(stated.row) == 6:
        along = np.array([card.number(line, text) for text in stated.row[3:]])
        actions.gravity_at = card.at(line)
        along *= value / (float(np.linalg.norm(along)) or 1.0)
        _add(actions.gravity, blocks.whole(card, line, elements), along)
    else:
        raise card.unread(f"load {kind}", line)


def _add(known: dict[int, FloatArray], blocks: Iterable[int], value: FloatArray) -> None:
    for block in blocks:
        known[block] = known.get(block, np.zeros(3)) + value


def _act(
    actions: Actions,
    faces: dict[int, IntArray],
    name: str,
    kind: type[PressureLoad | TractionLoad | CircumferentialLoad],
    *values: float | bool | FloatArray,
) -> None:
    """Load facets of blocks: the same load of faces of one name is one load."""
    named: dict[str, list[int]] = {}
    for block, rows in faces.items():
        named.setdefault(actions.blocks.face(block, name, rows), []).append(block)
    for face, blocks in named.items():
        last = actions.faces[-1] if actions.faces else None
        if (
            type(last) is kind
            and last.face == face
            and all(map(np.array_equal, [getattr(last, f.name) for f in fields(last)[2:]], values))
            and not np.isin(blocks, last.blocks).any()
        ):
            blocks.extend(last.blocks.tolist())
            actions.faces.pop()
        actions.faces.append(kind(np.array(sorted(blocks)), face, *values))  # type: ignore[arg-type]


def _dsload(actions: Actions, stated: Line) -> None:
    card, line, value = stated.card, stated.line, _value(actions, stated)
    faces = actions.blocks.surface(card, line, stated.target)
    if stated.kind == "P":
        _act(actions, faces, stated.target, PressureLoad, value, actions.step.turns)
        return
    along = np.array([card.number(line, text) for text in stated.row[3:]])
    if stated.kind != "TRVEC" or along.shape != (3,) or not along.any():
        raise card.unread(f"load {stated.kind} along {along.tolist()}", line)
    if card.option("FOLLOWER") != "NO" and actions.step.turns:
        actions.model.note("loads: a traction keeps its direction, blocks turn little")
    along *= value / np.linalg.norm(along)
    if "ORIENTATION" not in card.parameters:
        _act(actions, faces, stated.target, TractionLoad, along)
    elif along[0] == along[2] == 0.0:
        _act(actions, faces, stated.target, CircumferentialLoad, float(along[1]))
    else:
        raise card.unread(f"direction {stated.row[3:]} in an orientation", line)


def orientation_of(actions: Actions) -> tuple[FloatArray, FloatArray]:
    """Axis and a point of it, of the cylinder that tractions go round; else z through 0."""
    for card in (card for step in actions.steps for card in step.cards):
        if card.keyword != "DSLOAD" or "ORIENTATION" not in card.parameters:
            continue
        stated = actions.model.of("ORIENTATION", card.option("ORIENTATION"), card).card
        values = stated.numbers()
        if stated.option("SYSTEM") != "CYLINDRICAL" or len(values) < 6:
            raise stated.unread("but of a cylinder with two points,")
        axis = values[3:6] - values[:3]
        return axis / np.linalg.norm(axis), values[:3]
    return np.array([0.0, 0.0, 1.0]), np.zeros(3)


def gravity_of(actions: Actions, moving: IntArray, densities: FloatArray) -> FloatArray | None:
    """Gravity of all blocks that are not fixed, (3,) [mm/s²]; None: none.

    Where it differs from block to block it is a force per volume of each.

    Raises
    ------
    DeckError
        Materials without a density, gravity of an explicit step that differs from block to block.
    """
    if not actions.gravity:
        return None
    values = {block: actions.gravity.get(block, np.zeros(3)) for block in moving.tolist()}
    for material in actions.model.materials.values():
        if "DENSITY" not in material.parts:
            raise material.card.wrong("no *Density beside gravity", "one")
    every = np.array(list(values.values())).reshape(-1, 3)
    if np.ptp(every, axis=0).max() <= _SAME * np.abs(every).max():
        return np.asarray(every[0])
    if actions.step.explicit:
        raise actions.step.card.unread(f"gravity of some blocks ({actions.gravity_at})")
    for block, value in values.items():
        _add(actions.bodies, [block], densities[block] * value)
    return None


def body_wrenches(actions: Actions, assembly: Assembly) -> FloatArray | None:
    """Forces and moments on blocks of forces per volume, (n_blocks, 6) [N, N mm]; None: none."""
    if not actions.bodies:
        return None
    wrenches = np.zeros((assembly.n_blocks, 6))
    for block, density in actions.bodies.items():
        wrenches[block, :3] = density * assembly.shape(block).volume
    return wrenches


def node_forces(actions: Actions) -> tuple[NodeForces, ...]:
    """Forces on nodes of all blocks."""
    if not actions.forces:
        return ()
    return (NodeForces(*map(np.array, zip(*actions.forces, strict=True))),)
