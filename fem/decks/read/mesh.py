"""Nodes, elements, sets and surfaces of parts, and instances of parts: everything by its number."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fem.decks.keywords import DeckError
from fem.decks.placement import rotation_matrix
from fem.decks.read.cards import Card
from fem.decks.read.elements import VOLUMES
from geometry.mesh import FloatArray

#: Largest number of entries that a generated set may have.
_MOST = 50_000_000


@dataclass
class Part:
    """Nodes, elements and sets of a part, or of a flat deck."""

    name: str
    index: dict[int, int] = field(default_factory=dict)
    """Position of each node by its number in the deck."""
    places: list[FloatArray] = field(default_factory=list)
    """Their coordinates, each (3,) [mm]."""
    element_index: dict[int, int] = field(default_factory=dict)
    """Position of each element with volume by its number in the deck."""
    kind: str = ""
    """Type of the elements with volume."""
    kind_at: str = ""
    volumes: list[list[int]] = field(default_factory=list)
    """Nodes of each, as numbered in the deck."""
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    element_sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, Card] = field(default_factory=dict)
    sections: list[Card] = field(default_factory=list)

    @cached_property
    def nodes(self) -> FloatArray:
        """(n, 3) [mm]."""
        return np.array(self.places, dtype=np.float64).reshape(-1, 3)


def add_nodes(part: Part, card: Card) -> None:
    """Read *Node: number and coordinates, missing ones are zero."""
    members = []
    for line, row in card.rows():
        label = card.whole(line, row[0])
        if label in part.index or len(row) > 7:
            raise DeckError(
                f"{card.at(line)}: got node {label} "
                + ("twice" if label in part.index else f"with {len(row)} entries")
                + "; expected a number of its own and up to three coordinates"
            )
        values = [card.number(line, text) if text else 0.0 for text in row[1:4]]
        part.index[label] = len(part.places)
        part.places.append(np.array(values + [0.0] * (3 - len(values))))
        members.append(label)
    if name := card.option("NSET"):
        part.node_sets.setdefault(name, []).extend(members)


def add_elements(part: Part, card: Card) -> None:
    """Read *Element: number and nodes; an element may go on over lines."""
    kind = card.parameter("TYPE")
    count = VOLUMES.get(kind)
    if count is None:
        raise DeckError(
            f"{card.at()}: elements of type {kind} are not covered; expected "
            f"{', '.join(VOLUMES)}, or SPRING1"
        )
    values = [(line, text) for line, row in card.rows() for text in row if text]
    numbers = [card.whole(line, text) for line, text in values]
    if len(numbers) % (count + 1):
        raise DeckError(
            f"{card.at(values[-1][0])}: got {len(numbers)} entries in elements of type {kind}; "
            f"expected a number and {count} nodes each"
        )
    table = [numbers[k : k + count + 1] for k in range(0, len(numbers), count + 1)]
    name = card.option("ELSET")
    if part.kind not in {"", kind}:
        raise DeckError(
            f"{card.at()}: got elements of type {kind} beside {part.kind} ({part.kind_at}); "
            "expected one type in a part"
        )
    part.kind, part.kind_at = kind, card.at()
    for k, (label, *nodes) in enumerate(table):
        line = values[k * (count + 1)][0]
        missing = [node for node in nodes if node not in part.index]
        if label in part.element_index or missing or len(set(nodes)) < count:
            raise DeckError(
                f"{card.at(line)}: element {label} "
                + ("is there twice" if label in part.element_index else f"has {_wrong(missing)}")
                + "; expected a number of its own and nodes of the part, each once"
            )
        part.element_index[label] = len(part.volumes)
        part.volumes.append(nodes)
    if name:
        part.element_sets.setdefault(name, []).extend(row[0] for row in table)


def _wrong(missing: list[int]) -> str:
    return f"node {missing[0]}, which is not defined" if missing else "a node twice"


def set_entries(card: Card) -> Iterator[tuple[int, str | int]]:
    """Lines and entries of a set: numbers, those of a range, or names of others."""
    for line, row in card.rows():
        if "GENERATE" in card.parameters:
            if len(row) not in {2, 3}:
                raise DeckError(
                    f"{card.at(line)}: got {len(row)} entries; expected a first number, a last one "
                    "and a step"
                )
            first, last, *step = (card.whole(line, text) for text in row)
            by = step[0] if step else 1
            if by <= 0 or last < first or (last - first) // by > _MOST:
                raise DeckError(
                    f"{card.at(line)}: got {', '.join(row)}; expected a first number, a last one "
                    "and a positive step"
                )
            yield from ((line, number) for number in range(first, last + 1, by))
            continue
        for text in row:
            if text:
                yield line, int(text) if text.isdigit() else text.strip('"').upper()


def add_set(part: Part, card: Card) -> None:
    """Read *Nset or *Elset of a part."""
    nodes = card.keyword == "NSET"
    known = part.node_sets if nodes else part.element_sets
    index = part.index if nodes else part.element_index
    members = known.setdefault(card.parameter(card.keyword), [])
    if nodes and "ELSET" in card.parameters:
        of = set(_named(card, part.element_sets, card.option("ELSET"), card.line))
        rows = [part.volumes[part.element_index[e]] for e in of if e in part.element_index]
        members += sorted({node for row in rows for node in row})
    for line, entry in set_entries(card):
        if isinstance(entry, str):
            members += _named(card, known, entry, line)
        elif entry in index or not nodes:
            members.append(entry)
        elif "GENERATE" not in card.parameters:
            raise DeckError(f"{card.at(line)}: node {entry} is not defined; expected one that is")


def _named(card: Card, known: dict[str, list[int]], name: str, line: int) -> list[int]:
    if name not in known:
        raise DeckError(
            f"{card.at(line)}: got {name!r}, which names no set; expected one of "
            f"{', '.join(list(known)[:6]) or 'those defined before'}"
        )
    return list(known[name])


@dataclass(frozen=True)
class Instance:
    """A part at its place."""

    name: str
    """Empty: of a flat deck."""
    part: Part
    rotation: FloatArray
    translation: FloatArray


def placed(card: Card, part: Part) -> Instance:
    """Read *Instance: a translation, then a rotation about an axis through two points [degrees].

    Raises
    ------
    DeckError
        Numbers that are no such motion.
    """
    rows = [[card.number(line, text) for text in row if text] for line, row in card.rows()]
    if [len(row) for row in rows] not in ([], [3], [3, 7]):
        raise DeckError(
            f"{card.at()}: *Instance has lines of {[len(row) for row in rows]} numbers; expected a "
            "translation of 3, then a rotation of 7"
        )
    shift = np.array(rows[0]) if rows else np.zeros(3)
    turn = np.eye(3)
    if len(rows) == 2:
        a, b = np.array(rows[1][:3]), np.array(rows[1][3:6])
        if np.linalg.norm(b - a) == 0.0:
            raise DeckError(f"{card.at()}: the axis of rotation has no length; expected two points")
        turn = rotation_matrix(b - a, rows[1][6])
        shift = turn @ (shift - a) + a
    return Instance(card.parameter("NAME"), part, turn, shift)


@dataclass
class Places:
    """Instances, with sets and surfaces of the assembly: nodes and elements by instance."""

    instances: list[Instance]
    node_sets: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    """Instance and number of each node."""
    element_sets: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    surfaces: dict[str, Card] = field(default_factory=dict)
    by_name: dict[str, int] = field(default_factory=dict)
    """Position of each instance."""
    each_once: bool = False
    """Whether sets of loads and surfaces may have members once alone: CalculiX loads those that are
    there twice twice, Abaqus once."""

    def members(self, card: Card, line: int, text: str, *, nodes: bool) -> list[tuple[int, int]]:
        """Instance and number of the nodes or elements that an entry names.

        Raises
        ------
        DeckError
            Naming the line: what names none.
        """
        result = self._members(card, line, text, nodes=nodes)
        acts = self.each_once and card.keyword in {"CLOAD", "DLOAD", "SURFACE"}
        if acts and len(set(result)) < len(result):
            raise DeckError(
                f"{card.at(line)}: {text} has a member twice, which CalculiX loads twice; expected "
                "each once"
            )
        return result

    @property
    def elements(self) -> list[tuple[int, int]]:
        """Instance and number of all elements."""
        return [(k, of) for k, one in enumerate(self.instances) for of in one.part.element_index]

    def _members(self, card: Card, line: int, text: str, *, nodes: bool) -> list[tuple[int, int]]:
        entry = text.strip('"').upper()
        known = self.node_sets if nodes else self.element_sets
        if entry in known:
            return known[entry]
        first, dot, rest = entry.rpartition(".")
        if not dot:
            first, rest = "", entry
        number = self.by_name.get(first)
        if number is None:
            raise self._missing(card, line, text, nodes=nodes)
        part = self.instances[number].part
        sets = part.node_sets if nodes else part.element_sets
        index = part.index if nodes else part.element_index
        if rest in sets:
            return [(number, label) for label in sets[rest] if label in index]
        if rest.isdigit() and int(rest) in index:
            return [(number, int(rest))]
        raise self._missing(card, line, text, nodes=nodes)

    def _missing(self, card: Card, line: int, text: str, *, nodes: bool) -> DeckError:
        word = "node" if nodes else "element"
        return DeckError(
            f"{card.at(line)}: got {text!r} under {card.title}, which names no {word} and no set "
            f"of {word}s; expected a number or a set that is defined"
        )

    def add_set(self, card: Card) -> None:
        """Read *Nset or *Elset of the assembly."""
        nodes = card.keyword == "NSET"
        known = self.node_sets if nodes else self.element_sets
        members = known.setdefault(card.parameter(card.keyword), [])
        instance = card.option("INSTANCE")
        for line, entry in set_entries(card):
            text = f"{instance}.{entry}" if instance else str(entry)
            members += self.members(card, line, text, nodes=nodes)
