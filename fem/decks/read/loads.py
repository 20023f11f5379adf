"""Loads of a deck at the end of its last step: forces, pressures, tractions, gravity."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

from fem.decks.keywords import DeckError
from fem.decks.read.actions import Actions
from fem.decks.read.cards import Card
from fem.decks.read.model import Step, path_of, smooth_time
from fem.decks.read.words import Dialect
from geometry.assembly import Assembly
from geometry.loads import CircumferentialLoad, PressureLoad, TractionLoad
from geometry.mesh import FloatArray, IntArray

#: Gravity of blocks that differs by less is the same.
_SAME = 1e-9


@dataclass(frozen=True)
class _Row:
    """A line of a load that acts at the end of the last step."""

    number: int
    """Of its step."""
    step: Step
    card: Card
    line: int
    row: list[str]
    position: tuple[int, int]
    """Of its card among those of all loads, and among the lines of its card."""

    @property
    def key(self) -> tuple[str, ...]:
        """What a later step states anew."""
        target, kind, *_ = (word.strip('"').upper() for word in (*self.row, "", ""))
        return self.card.keyword, target, kind

    @property
    def name(self) -> str:
        """Of the face it acts on."""
        card, line = self.position
        return f"load-{card + 1}-{line + 1}"


def read_loads(actions: Actions) -> None:
    """Read loads of all steps: what a later step states anew takes the place of the earlier.

    Raises
    ------
    DeckError
        Naming the line of the first that cannot be solved.
    """
    readers = {"CLOAD": _cload, "DLOAD": _dload, "DSLOAD": _dsload}
    acting: list[_Row] = []
    count = 0
    for number, step in enumerate(actions.steps):
        cards = [card for card in step.cards if card.keyword in readers]
        new = {card.keyword for card in cards if card.option("OP") == "NEW"}
        rows = [
            _Row(number, step, card, line, row, (of, position))
            for of, card in enumerate(cards, start=count)
            for position, (line, row) in enumerate(card.rows())
        ]
        count += len(cards)
        anew = {row.key for row in rows}
        if actions.blocks.places.each_once:
            _check_gone(row for row in acting if row.card.keyword in new and row.key not in anew)
        acting = [r for r in acting if r.card.keyword not in new and r.key not in anew] + rows
    _check_apart(actions, acting)
    for row in acting:
        readers[row.card.keyword](actions, row)


def _check_gone(rows: Iterable[_Row]) -> None:
    """Reject body forces that op=NEW takes back: CalculiX (2.20) takes back pressures alone."""
    for row in rows:
        if row.key[2].startswith(("B", "GRAV")):
            raise DeckError(
                f"{row.card.at(row.line)}: op=NEW of a later step does not take back "
                f"{', '.join(row.row[:2])} in CalculiX; expected it there with the value 0"
            )


def _check_apart(actions: Actions, rows: list[_Row]) -> None:
    """Reject sets of several steps that share members: which of them acts is not covered."""
    if len({row.number for row in rows}) < 2:
        return
    loaded: dict[tuple[object, ...], int] = {}
    for row in rows:
        if row.card.keyword == "DSLOAD":
            continue  # loads on surfaces of other names add up
        nodes = row.card.keyword == "CLOAD"
        members = actions.blocks.places.members(row.card, row.line, row.row[0], nodes=nodes)
        for member in members:
            if loaded.setdefault((row.key[0], row.key[2], member), row.number) != row.number:
                raise DeckError(
                    f"{row.card.at(row.line)}: {row.row[0]} shares members with a load of an "
                    "earlier step; expected the same set in both, or op=NEW"
                )


def _share(actions: Actions, row: _Row) -> float:
    """Share of a load at the end of its step."""
    if row.step.explicit:
        actions.ramp(row.card, smooth_time(actions.model, row.card) or 0.0)
        return 1.0
    path = path_of(actions.model, row.card)
    if path is None:
        return 1.0
    return float(np.interp(actions.time_in(row.step), path[:, 0], path[:, 1]))


def _cload(actions: Actions, stated: _Row) -> None:
    share, card, line, row = _share(actions, stated), stated.card, stated.line, stated.row
    component = card.whole(line, row[1]) if len(row) > 2 else 0
    if not 1 <= component <= 3:
        raise DeckError(
            f"{card.at(line)}: got {', '.join(row)}; expected a node or a set, a component "
            "from 1 to 3 and a force"
        )
    value = share * card.number(line, row[2])
    nodes = actions.blocks.places.members(card, line, row[0], nodes=True)
    located = actions.blocks.located(nodes)
    if not located:
        raise DeckError(f"{card.at(line)}: no node of {row[0]!r} is of an element; expected one")
    for block, indices in located.items():
        places = actions.blocks.coordinates(block, indices)
        for node, place in zip(indices.tolist(), places, strict=True):
            axes = actions.axes.get((block, node), np.eye(3))
            actions.forces.append((block, place, value * axes[component - 1]))


def _dload(actions: Actions, stated: _Row) -> None:
    card, line, row = stated.card, stated.line, stated.row
    kind = row[1].upper() if len(row) > 2 else ""
    share = _gravity_share(actions, stated) if kind == "GRAV" else _share(actions, stated)
    value = share * card.number(line, row[2]) if kind else 0.0
    places = actions.blocks.places
    whole = kind == "GRAV" and not row[0] and actions.model.dialect is Dialect.ABAQUS
    elements = places.elements if whole else places.members(card, line, row[0], nodes=False)
    if kind.startswith("P") and kind[1:].isdigit():
        faces = actions.blocks.sides(card, line, elements, kind)
        _act(actions, faces, stated.name, PressureLoad, value, actions.step.large_rotations)
    elif kind in {"BX", "BY", "BZ"}:
        force = np.zeros(3)
        force["XYZ".index(kind[1])] = value
        for block in actions.blocks.whole(card, line, elements):
            actions.bodies[block] = actions.bodies.get(block, np.zeros(3)) + force
    elif kind == "GRAV" and len(row) == 6:
        along = np.array([card.number(line, text) for text in row[3:]])
        length = float(np.linalg.norm(along))
        actions.gravity_at = card.at(line)
        for block in actions.blocks.whole(card, line, elements):
            here = actions.gravity.get(block, np.zeros(3))
            actions.gravity[block] = here + value * along / (length or 1.0)
    else:
        raise DeckError(
            f"{card.at(line)}: got load {kind or ', '.join(row)!r}; expected P1 to P6, "
            "GRAV, BX, BY or BZ"
        )


def _gravity_share(actions: Actions, stated: _Row) -> float:
    """Share of gravity, which explicit runs have from the beginning."""
    if not stated.step.explicit:
        return _share(actions, stated)
    if stated.card.option("AMPLITUDE"):
        raise DeckError(
            f"{stated.card.at()}: gravity of an explicit step has an amplitude; expected it from "
            "the beginning, without one"
        )
    return 1.0


def _act(
    actions: Actions,
    faces: dict[int, IntArray],
    name: str,
    kind: type[PressureLoad | TractionLoad | CircumferentialLoad],
    *values: float | bool | FloatArray,
) -> None:
    """Load facets of blocks: the same load of one card on many blocks is one load."""
    blocks = sorted(faces)
    last = actions.faces[-1] if actions.faces else None
    if (
        type(last) is kind
        and all(map(np.array_equal, [getattr(last, f.name) for f in fields(last)[2:]], values))
        and str(last.face).rpartition("-")[0] == name.rpartition("-")[0]
        and not np.isin(blocks, last.blocks).any()
    ):
        name, blocks = str(last.face), sorted([*last.blocks.tolist(), *blocks])
        actions.faces.pop()
    for block, rows in faces.items():
        actions.blocks.add_face(block, name, rows)
    actions.faces.append(kind(np.array(blocks), name, *values))  # type: ignore[arg-type]


def _dsload(actions: Actions, stated: _Row) -> None:
    share, card, line, row = _share(actions, stated), stated.card, stated.line, stated.row
    kind = row[1].upper() if len(row) > 2 else ""
    value = share * card.number(line, row[2]) if kind else 0.0
    faces = actions.blocks.surface(card, line, row[0])
    if kind == "P":
        _act(actions, faces, stated.name, PressureLoad, value, actions.step.large_rotations)
        return
    along = np.array([card.number(line, text) for text in row[3:]])
    if kind != "TRVEC" or along.shape != (3,) or not along.any():
        raise DeckError(
            f"{card.at(line)}: got load {kind or ', '.join(row)!r}; expected P, or TRVEC "
            "with a direction"
        )
    if card.option("FOLLOWER") != "NO" and actions.step.large_rotations:
        actions.model.note("loads: a traction keeps its direction, blocks turn little")
    along *= value / np.linalg.norm(along)
    if "ORIENTATION" not in card.parameters:
        _act(actions, faces, stated.name, TractionLoad, along)
    elif along[0] == along[2] == 0.0:
        _act(actions, faces, stated.name, CircumferentialLoad, float(along[1]))
    else:
        raise DeckError(
            f"{card.at(line)}: got the direction {row[3:]} in an orientation; expected the "
            "second one of a cylinder, 0., 1., 0."
        )


def orientation_of(actions: Actions) -> tuple[FloatArray, FloatArray]:
    """Axis and a point of it, of the cylinder that tractions go round; else z through 0."""
    for card in (card for step in actions.steps for card in step.cards):
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
    without = [m for m in actions.model.materials.values() if m.density is None]
    if without:
        raise DeckError(f"{without[0].card.at()}: gravity needs *Density; expected one")
    every = np.array(list(values.values())).reshape(-1, 3)
    if np.ptp(every, axis=0).max() <= _SAME * np.abs(every).max():
        return np.asarray(every[0])
    if actions.step.explicit:
        raise DeckError(
            f"{actions.gravity_at}: gravity of an explicit step differs from block to block; "
            "expected it on all"
        )
    for block, value in values.items():
        there = actions.bodies.get(block, np.zeros(3))
        actions.bodies[block] = there + densities[block] * value
    return None


def body_wrenches(actions: Actions, assembly: Assembly) -> FloatArray | None:
    """Forces and moments on blocks of forces per volume, (n_blocks, 6) [N, N mm]; None: none."""
    if not actions.bodies:
        return None
    wrenches = np.zeros((assembly.n_blocks, 6))
    for block, density in actions.bodies.items():
        wrenches[block, :3] = density * assembly.shape(block).volume
    return wrenches
