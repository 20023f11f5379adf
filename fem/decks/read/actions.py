"""Supports and loads that act at the end of the last step of a deck; its supports."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np

from fem.decks.read.blocks import Blocks
from fem.decks.read.cards import Card
from fem.decks.read.model import ModelLines, Step, path_of, smooth_time
from geometry.loads import FaceLoad
from geometry.mesh import FloatArray, IntArray
from geometry.parts.regions import HeldFace

#: Displacement of a component [mm], and times [s] and shares of it; (): with the loads.
Moved = tuple[float, tuple[tuple[float, float], ...]]
_STILL: Moved = (0.0, ())


@dataclass(frozen=True)
class Line:
    """A line of a support or a load."""

    number: int
    """Of its step, from 1; 0: of the model data."""
    step: Step
    card: Card
    line: int
    row: list[str]

    @property
    def target(self) -> str:
        """Set or surface that it names, upper case."""
        return self.row[0].strip('"').upper()

    @property
    def kind(self) -> str:
        """Second entry, upper case: kind of a load, first component or word of a support."""
        return self.row[1].upper() if len(self.row) > 1 else ""

    @property
    def key(self) -> tuple[str, ...]:
        """What a later step states anew: the load, or the same components."""
        last = self.row[2:3] if self.card.keyword == "BOUNDARY" else ()
        return self.card.keyword, self.target, self.kind, *last


@dataclass
class Actions:
    """What supports and loads the blocks of a deck at the end of its last step."""

    blocks: Blocks
    model: ModelLines
    steps: tuple[Step, ...]
    time: float
    """In the last step [s]."""
    at_end: bool = False
    """Whether supports are where they are at that time, else on their way."""
    held: list[HeldFace] = field(default_factory=list)
    fixed: list[int] = field(default_factory=list)
    """Blocks of which every node stays."""
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
        return self.time if step is self.step else step.duration

    def acting(self, words: set[str], before: Iterable[Card] = ()) -> list[Line]:
        """Lines of keywords that act at the end of the last step.

        ``before`` are cards of the model data.

        Raises
        ------
        DeckError
            Body forces that op=NEW takes back: CalculiX (2.20) takes back pressures alone.
        """
        result: list[Line] = []
        for number, step in enumerate((self.steps[0], *self.steps)):
            cards = [c for c in (step.cards if number else before) if c.keyword in words]
            new = {card.keyword for card in cards if card.option("OP") == "NEW"}
            rows = [Line(number, step, card, *row) for card in cards for row in card.rows()]
            anew = {row.key for row in rows}
            result = [row for row in result if row.key not in anew]
            for row in (row for row in result if row.card.keyword in new):
                if row.kind.startswith(("B", "GRAV")) and self.blocks.each_once:
                    raise row.card.unread(f"{row.kind} that op=NEW of a later step ends", row.line)
            result = [row for row in result if row.card.keyword not in new] + rows
        return result

    def ramp(self, card: Card, ramp: float) -> None:
        """Keep the smooth step of an explicit run.

        Raises
        ------
        DeckError
            A second one.
        """
        if self.ramp_time not in {None, ramp}:
            raise card.unread("several amplitudes of loads in an explicit step")
        self.ramp_time = ramp


def read_supports(actions: Actions) -> None:
    """Read supports of the model data and of all steps, each after the one before.

    Raises
    ------
    DeckError
        Naming the line of the first that cannot be solved.
    """
    blocks, sets = actions.blocks, dict[str, tuple[Line, dict[int, Moved]]]()
    for stated in actions.acting({"BOUNDARY"}, actions.model.other):
        components, moved = _moved(actions, stated)
        _, known = sets.setdefault(stated.target, (stated, {}))
        known.update(dict.fromkeys(components, moved))
    number = {_STILL: 0}
    way_of = [np.full((len(one.part.places), 3), -1) for one in blocks.instances]
    located = {}
    for target, (stated, ways) in sets.items():
        card, line = stated.card, stated.line
        if target.rpartition(".")[2].isdigit():
            raise card.unread(f"node {target} by its number, without a set,", line)
        nodes = blocks.members(card, line, target, nodes=True)
        located[target] = blocks.located(nodes)
        for block, rows in located[target].items():
            for component, moved in ways.items():
                known, own = way_of[block][rows, component], number.setdefault(moved, len(number))
                if ((known >= 0) & (known != own)).any():
                    raise card.wrong(f"{target}, which another set moves otherwise", "one", line)
                way_of[block][rows, component] = own
    of_blocks = enumerate(zip(way_of, blocks.instances, strict=True))
    actions.fixed = [b for b, (of, one) in of_blocks if not of[one.part.members].any()]
    for target, (stated, ways) in sets.items():
        for block, rows in located[target].items():
            if ways and block not in actions.fixed:
                actions.held += _held_faces(blocks, stated, ways, block, rows)


def _held_faces(
    blocks: Blocks, stated: Line, ways: dict[int, Moved], block: int, nodes: IntArray
) -> Iterable[HeldFace]:
    """Support of nodes of a block, for each path of its motions."""
    name = stated.target.lower()
    where = blocks.where(stated.card, stated.line, block, nodes, name)
    alike = sorted(ways.items(), key=lambda way: way[1][1])
    for path, parts in groupby(alike, key=lambda way: way[1][1]):
        moved = {component: value for component, (value, _) in parts}
        rows, way = np.eye(3)[sorted(moved)], np.zeros(3)
        way[list(moved)] = list(moved.values())
        held = None if len(moved) == 3 else rows
        yield HeldFace(block, where, held, way if way.any() else None, path, name=name)


def _moved(actions: Actions, stated: Line) -> tuple[list[int], Moved]:
    """Components of a line and where they go in a step."""
    components, value = _components(stated)
    card, step = stated.card, stated.step
    if not value:
        return components, _STILL
    path = path_of(actions.model, card)
    smooth = smooth_time(actions.model, card) if step.explicit else None
    if smooth is not None:
        actions.ramp(card, smooth)
        path = None
    if path is None:
        return components, (value, ())
    if actions.at_end:
        return components, (value * float(np.interp(actions.time_in(step), *path.T)), ())
    return components, (value, _path(step, path))


def _path(step: Step, path: FloatArray) -> tuple[tuple[float, float], ...]:
    """Times and shares up to the end of a step."""
    end = step.duration
    inside = path[path[:, 0] < end]
    rows = [*inside.tolist(), [end, float(np.interp(end, path[:, 0], path[:, 1]))]]
    if rows[0][0] > 0.0:
        rows.insert(0, [0.0, rows[0][1]])
    return tuple((time, share) for time, share in rows)


#: Components of supports that Abaqus names, from 0; solids have no others.
_WORDS = {"ENCASTRE": [0, 1, 2], "PINNED": [0, 1, 2], "XSYMM": [0], "YSYMM": [1], "ZSYMM": [2]}


def _components(stated: Line) -> tuple[list[int], float]:
    """Components, from 0, and value of a line of ``*Boundary``; rotations of solids do nothing."""
    card, line, row = stated.card, stated.line, stated.row
    if stated.kind in _WORDS and len(row) == 2:
        return _WORDS[stated.kind], 0.0
    first = card.whole(line, stated.kind)
    last = card.whole(line, row[2]) if len(row) > 2 and row[2] else first
    value = card.number(line, row[3]) if len(row) > 3 and row[3] else 0.0
    if not 1 <= first <= last <= 6 or (last > 3 and value):
        raise card.wrong(f"components {first} to {last}", "1 to 3: solids do not rotate", line)
    return list(range(first - 1, min(last, 3))), value
