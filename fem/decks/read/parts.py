"""Read parts and instances: block shapes, named faces, and the assembly."""

from __future__ import annotations

import re

import numpy as np

from fem.decks.keywords import DeckError, name_of
from fem.decks.placement import placement
from fem.decks.read.cards import Card, Heading, block_entry, floats, heading_value
from fem.decks.statement import CONTACT, ELEMENT_NAMES
from fem.element.hexahedron import ElementType
from geometry.assembly import Assembly
from geometry.block import Block
from geometry.mesh import HEX_FACES, HexMesh, IntArray, check_mesh

_ELEMENT_TYPES = {name: element for element, name in ELEMENT_NAMES.items()}


def read_part(cards: list[Card]) -> tuple[Block, ElementType]:
    """Read one part: a block shape with its named faces, and its element."""
    by_keyword = {card.keyword: card for card in cards}
    for needed in ("NODE", "ELEMENT"):
        if needed not in by_keyword:
            raise DeckError(f"line {cards[0].line}: the part has no *{needed.title()}")
    nodes = by_keyword["NODE"].table(4)
    card = by_keyword["ELEMENT"]
    kind = card.parameter("TYPE").upper()
    if kind not in _ELEMENT_TYPES:
        raise DeckError(
            f"line {card.line}: got element {kind}, expected {', '.join(_ELEMENT_TYPES)}"
        )
    elements = card.table(9)
    name = name_of(cards[0].parameter("NAME"))
    for rows, owner in ((nodes, by_keyword["NODE"]), (elements, card)):
        wrong = np.flatnonzero(rows[:, 0] != np.arange(1, len(rows) + 1))
        if len(wrong):
            raise DeckError(
                f"line {owner.data_line[int(wrong[0])]}: got number {rows[wrong[0], 0]:g}, "
                f"expected {wrong[0] + 1}: numbers must run from 1 without gaps"
            )
    mesh = HexMesh(nodes[:, 1:].copy(), elements[:, 1:].astype(np.int64) - 1)
    check_mesh(mesh, name)
    faces, contact = _faces(cards, mesh)
    return Block(name, mesh, faces, contact), _ELEMENT_TYPES[kind]


def _faces(cards: list[Card], mesh: HexMesh) -> tuple[dict[str, IntArray], tuple[str, ...]]:
    """Named faces of a part, and which of them can meet another block."""
    sets = {c.parameter("ELSET").upper(): c for c in cards if c.keyword == "ELSET"}
    faces: dict[str, IntArray] = {}
    contact: list[str] = []
    for card in cards:
        if card.keyword != "SURFACE":
            continue
        name = card.parameter("NAME").upper()
        if name == CONTACT:
            contact = [re.sub(r"-S\d$", "", row[0].upper()) for _, row in card.rows()]
        elif not re.search(r"-PATCH-\d+$", name):
            quads = [_facets(line, row, sets, mesh) for line, row in card.rows()]
            faces[name_of(name)] = np.concatenate(quads)
    return faces, tuple(dict.fromkeys(name_of(name) for name in contact))


def _facets(line: int, row: list[str], sets: dict[str, Card], mesh: HexMesh) -> IntArray:
    """Facets of one data line of a surface: an element set and a side."""
    if len(row) != 2 or row[0].upper() not in sets or not re.fullmatch(r"[sS][1-6]", row[1]):
        raise DeckError(f"line {line}: got {', '.join(row)}; expected an element set and S1 … S6")
    entries = [e for _, fields in sets[row[0].upper()].rows() for e in fields]
    try:
        elements = np.array(entries, dtype=np.int64) - 1
    except ValueError:
        raise DeckError(
            f"line {sets[row[0].upper()].line}: expected element numbers on the data lines"
        ) from None
    if len(elements) and not (elements.min() >= 0 and elements.max() < mesh.n_elements):
        raise DeckError(
            f"line {sets[row[0].upper()].line}: got an element number outside 1 to "
            f"{mesh.n_elements}"
        )
    return mesh.elements[elements][:, HEX_FACES[int(row[1][1]) - 1]]


def read_assembly(
    cards: list[Card], shapes: dict[str, Block], heading: Heading
) -> tuple[Assembly, dict[str, int]]:
    """Read instances, layers and frame: the assembly, and block numbers by instance."""
    instances = [card for card in cards if card.keyword == "INSTANCE"]
    names = list(shapes)
    blocks: dict[str, int] = {}
    shape_of, rotations, translations = [], [], []
    for card in instances:
        part = name_of(card.parameter("PART"))
        if part not in shapes:
            raise DeckError(f"line {card.line}: got part {part!r}, which is not defined")
        blocks[card.parameter("NAME").upper()] = len(blocks)
        shape_of.append(names.index(part))
        rows = [floats(line, row) for line, row in card.rows()]
        if [len(row) for row in rows] not in ([], [3], [3, 7]):
            raise DeckError(
                f"line {card.line}: expected a translation (3 numbers) and a rotation (7 numbers)"
            )
        rotation, translation = placement(rows)
        rotations.append(rotation)
        translations.append(translation)
    if len(blocks) != len(instances) or not instances:
        raise DeckError(f"line {cards[0].line}: instances are missing or share a name")
    if heading.places:
        if len(heading.places) != len(blocks):
            raise DeckError(f"line 1: got places of {len(heading.places)} of {len(blocks)} blocks")
        translations = heading.places
    layer, fixed = _element_sets(cards, blocks)
    assembly = Assembly(
        name=name_of(cards[0].parameter("NAME")),
        shapes=tuple(shapes.values()),
        shape_of=np.array(shape_of, dtype=np.int64),
        rotations=np.array(rotations),
        translations=np.array(translations),
        layer=layer,
        fixed=fixed,
        axis=heading_value(heading, "axis", 3),
        origin=heading_value(heading, "axis", 3, part=1),
        unmatched_allowed=heading.values.get("open faces") == "allowed",
    )
    return assembly, blocks


def _element_sets(
    cards: list[Card], blocks: dict[str, int]
) -> tuple[IntArray, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """Layer of each block and whether it belongs to the frame."""
    layer = np.zeros(len(blocks), dtype=np.int64)
    fixed = np.zeros(len(blocks), dtype=np.bool_)
    for card in cards:
        if card.keyword != "ELSET":
            continue
        name = card.parameter("ELSET").upper()
        members = [
            block_entry(line, entry, blocks)[0] for line, fields in card.rows() for entry in fields
        ]
        match = re.fullmatch(r"LAYER-(\d+)", name)
        if match:
            layer[members] = int(match.group(1))
        elif name == "FRAME":
            fixed[members] = True
    return layer, fixed
