"""Read back what `fem.abaqus_write` writes.

The reader takes from the cards what a `Deck` holds, then writes the deck anew and compares: a
card that would not come out again is refused by its line, so nothing is dropped silently.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import zip_longest

import numpy as np

from fem.abaqus_keywords import Card, DeckError, name_of, read_cards
from fem.abaqus_placement import placement, rounded
from fem.abaqus_write import ALL, CONTACT, ELEMENT_NAMES, abaqus_lines
from fem.contact_law import ContactLaw, ContactLawError, ExponentialLaw, LinearPenalty
from fem.deck import (
    BodyForceLoad,
    CircumferentialLoad,
    Deck,
    DeckLoad,
    DeckStep,
    Flavour,
    Hold,
    Joint,
    Motion,
    PressureLoad,
    Procedure,
    TractionLoad,
)
from fem.effects import BulkViscosity, EffectError, Effects, RayleighDamping
from fem.hexahedron import ElementType
from fem.material import Material, MaterialError
from geometry.assembly import Assembly, AssemblyError
from geometry.block import Block
from geometry.mesh import HEX_FACES, FloatArray, HexMesh, IntArray, MeshError, check_mesh

#: Keywords that are read; everything else is refused by name.
SUPPORTED = (
    *("HEADING", "PART", "NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "SOLID SECTION"),
    *("END PART", "ASSEMBLY", "INSTANCE", "END INSTANCE", "ORIENTATION", "END ASSEMBLY"),
    *("SECTION CONTROLS", "MATERIAL", "DENSITY", "ELASTIC", "DAMPING", "SURFACE INTERACTION"),
    *("SURFACE BEHAVIOR", "FRICTION", "AMPLITUDE", "INITIAL CONDITIONS", "CONTACT"),
    *("CONTACT INCLUSIONS", "CONTACT PROPERTY ASSIGNMENT", "CONTACT PAIR", "BOUNDARY", "STEP"),
    *("STATIC", "DYNAMIC", "BULK VISCOSITY", "DSLOAD", "DLOAD", "OUTPUT", "NODE OUTPUT"),
    *("ELEMENT OUTPUT", "CONTACT OUTPUT", "ENERGY OUTPUT", "END STEP"),
)

_ELEMENT_TYPES = {name: element for element, name in ELEMENT_NAMES.items()}


def read_deck(lines: Iterable[str]) -> Deck:
    """Read a deck of flavour general or pairs.

    Parameters
    ----------
    lines
        Of the file, without or with line ends.

    Raises
    ------
    DeckError
        Naming the line: a keyword that is not read, a value that makes no sense, a file that
        ends early, or anything that would be lost.
    """
    cards = read_cards(lines)
    _check_keywords(cards)
    heading = _heading(cards)
    _check_complete(cards)
    try:
        deck = _build(cards, heading)
        _check_nothing_lost(cards, deck)
    except (MeshError, MaterialError, EffectError, ContactLawError, AssemblyError) as error:
        raise DeckError(str(error)) from None
    return deck


def _check_keywords(cards: list[Card]) -> None:
    for card in cards:
        if card.keyword not in SUPPORTED:
            raise DeckError(
                f"line {card.line}: *{card.keyword.title()} is not supported; import reads the "
                "keywords that `export` writes"
            )


def _check_complete(cards: list[Card]) -> None:
    """Refuse a file that ends early."""
    open_at: list[Card] = []
    for card in cards:
        if card.keyword in {"PART", "ASSEMBLY", "INSTANCE", "STEP"}:
            open_at.append(card)
        elif card.keyword.startswith("END "):
            if not open_at or card.keyword != f"END {open_at[-1].keyword}":
                raise DeckError(f"line {card.line}: *{card.keyword.title()} ends nothing")
            open_at.pop()
    last = cards[-1].data_line[-1] if cards[-1].data_line else cards[-1].line
    if open_at:
        start = open_at[-1]
        name = start.parameters.get("NAME", "")
        raise DeckError(
            f"line {last}: the file ends inside *{start.keyword.title()} {name} (line "
            f"{start.line}); expected *End {start.keyword.title()}: the file is truncated"
        )
    if cards[-1].keyword != "END STEP":
        raise DeckError(f"line {last}: the file ends without a step: it is truncated")


# ---------------------------------------------------------------------------------------------
# Heading


@dataclass
class _Heading:
    """What the heading says."""

    name: str
    values: dict[str, str] = field(default_factory=dict)
    places: list[FloatArray] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def _heading(cards: list[Card]) -> _Heading:
    first = cards[0] if cards else Card(1, "", {})
    match = re.match(r"tubelock \S+, scene (.*)", first.data[0]) if first.data else None
    if first.keyword != "HEADING" or match is None:
        raise DeckError(
            f"line {first.line}: this deck was not written by `export` (its heading would say "
            "so); import reads those decks, and files with a mesh alone"
        )
    heading = _Heading(match.group(1))
    for number, text in zip(first.data_line[1:], first.data[1:], strict=True):
        key, colon, value = text.partition(": ")
        if not colon:
            raise DeckError(f"line {number}: got {text[:40]!r}, expected a line 'name: value'")
        if key == "note":
            heading.notes.append(value)
        elif key == "place without clearance":
            heading.places.append(_numbers(number, value.partition(" ")[2], 3))
        else:
            heading.values[key] = value
    if heading.values.get("flavour") not in {Flavour.GENERAL, Flavour.PAIRS}:
        raise DeckError(
            f"line {first.line}: got a deck of flavour {heading.values.get('flavour')}; expected "
            "general or pairs: a CalculiX deck has lost instances and load definitions, import "
            "the general deck of the same scene"
        )
    return heading


def _numbers(line: int, text: str, count: int) -> FloatArray:
    try:
        values = np.array(text.split(","), dtype=np.float64)
    except ValueError:
        values = np.zeros(0)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise DeckError(f"line {line}: got {text!r}, expected {count} numbers")
    return values


def _value(heading: _Heading, key: str, count: int, part: int = 0) -> FloatArray:
    if key not in heading.values:
        raise DeckError(f"line 1: the heading has no line '{key}: …'")
    return _numbers(1, heading.values[key].split(" through ")[part], count)


# ---------------------------------------------------------------------------------------------
# Sections


@dataclass
class _Sections:
    """Cards by where they stand."""

    parts: list[list[Card]] = field(default_factory=list)
    assembly: list[Card] = field(default_factory=list)
    model: list[Card] = field(default_factory=list)
    step: list[Card] = field(default_factory=list)

    def all(self, keyword: str) -> list[Card]:
        """Cards of the model and the step with a keyword."""
        return [card for card in self.model + self.step if card.keyword == keyword]

    def one(self, keyword: str) -> Card:
        """The only card with a keyword."""
        found = self.all(keyword)
        if len(found) != 1:
            where = f"line {found[1].line}: " if found else ""
            raise DeckError(f"{where}got {len(found)} cards *{keyword.title()}, expected one")
        return found[0]

    def maybe(self, keyword: str) -> Card | None:
        """The only card with a keyword, if there is one."""
        return self.one(keyword) if self.all(keyword) else None


def _sections(cards: list[Card]) -> _Sections:
    sections = _Sections()
    current = sections.model
    for card in cards[1:]:
        if card.keyword == "PART":
            current = []
            sections.parts.append(current)
        elif card.keyword == "ASSEMBLY":
            current = sections.assembly
        elif card.keyword == "STEP":
            current = sections.step
        current.append(card)
        if card.keyword in {"END PART", "END ASSEMBLY"}:
            current = sections.model
    return sections


def _build(cards: list[Card], heading: _Heading) -> Deck:
    sections = _sections(cards)
    parts = [_part(part) for part in sections.parts]
    if not parts or not sections.assembly:
        raise DeckError(f"line {cards[-1].line}: the deck has no part or no assembly")
    shapes = {shape.name: shape for shape, _ in parts}
    elements = {element for _, element in parts}
    if len(elements) != 1:
        raise DeckError(f"line {sections.parts[-1][0].line}: parts have different elements")
    assembly, blocks = _assembly(sections.assembly, shapes, heading)
    behavior = sections.maybe("SURFACE BEHAVIOR")
    return Deck(
        name=heading.name,
        flavour=Flavour(heading.values["flavour"]),
        assembly=assembly,
        material=_material(sections),
        element=elements.pop(),
        step=_step(sections),
        holds=tuple(_holds(sections, blocks)),
        loads=tuple(_loads(sections, blocks)),
        joint=None if behavior is None else _joint(sections, behavior),
        effects=_effects(sections),
        motion=_motion(sections),
        initial_clearance=float(_value(heading, "initial clearance", 1)[0]),
        notes=tuple(heading.notes),
    )


def _part(cards: list[Card]) -> tuple[Block, ElementType]:
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
    quads: IntArray = mesh.elements[elements][:, HEX_FACES[int(row[1][1]) - 1]]
    return quads


def _assembly(
    cards: list[Card], shapes: dict[str, Block], heading: _Heading
) -> tuple[Assembly, dict[str, int]]:
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
        rows = [_floats(line, row) for line, row in card.rows()]
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
        axis=_value(heading, "axis", 3),
        origin=_value(heading, "axis", 3, part=1),
        unmatched_allowed=heading.values.get("open faces") == "allowed",
    )
    return assembly, blocks


def _floats(line: int, row: list[str]) -> list[float]:
    return [float(x) for x in _numbers(line, ",".join(row), len(row))]


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
            _block(line, entry, blocks)[0] for line, fields in card.rows() for entry in fields
        ]
        match = re.fullmatch(r"LAYER-(\d+)", name)
        if match:
            layer[members] = int(match.group(1))
        elif name == "FRAME":
            fixed[members] = True
    return layer, fixed


def _block(line: int, entry: str, blocks: dict[str, int]) -> tuple[int, str]:
    """Block and label of an entry ``INSTANCE.LABEL``."""
    instance, dot, rest = entry.upper().partition(".")
    if not dot or instance not in blocks:
        raise DeckError(
            f"line {line}: got {entry!r}, which names no instance; expected INSTANCE.SET"
        )
    return blocks[instance], rest


# ---------------------------------------------------------------------------------------------
# Model data


def _material(sections: _Sections) -> Material:
    density = sections.one("DENSITY").numbers()
    elastic = sections.one("ELASTIC").numbers()
    if len(density) != 1 or len(elastic) != 2:
        raise DeckError(
            f"line {sections.one('MATERIAL').line}: expected one density, a modulus and a ratio"
        )
    return Material(float(density[0]), float(elastic[0]), float(elastic[1]))


def _joint(sections: _Sections, behavior: Card) -> Joint:
    kind = behavior.parameter("PRESSURE-OVERCLOSURE").upper()
    values = behavior.numbers().tolist()
    law: ContactLaw
    if kind == "EXPONENTIAL" and len(values) in {2, 3}:
        law = ExponentialLaw(values[0], values[1], values[2] if len(values) == 3 else np.inf)
    elif kind == "LINEAR" and len(values) == 1:
        law = LinearPenalty(values[0])
    else:
        raise DeckError(
            f"line {behavior.line}: got {kind} with {len(values)} values; expected EXPONENTIAL "
            "with 2 or 3, or LINEAR with 1"
        )
    pairs = sections.all("CONTACT PAIR")
    finite = any("TYPE" in p.parameters and "SMALL SLIDING" not in p.parameters for p in pairs)
    friction = sections.maybe("FRICTION")
    if friction is None:
        return Joint(law, finite_sliding=finite)
    slope = friction.parameters.get("SHEAR TRACTION SLOPE")
    stick = None if slope is None else _floats(friction.line, [slope])[0]
    return Joint(law, float(friction.numbers()[0]), stick, finite)


def _effects(sections: _Sections) -> Effects:
    damping, viscosity = sections.maybe("DAMPING"), sections.maybe("BULK VISCOSITY")
    rayleigh = None
    if damping is not None:
        given = {
            name: _floats(damping.line, [damping.parameters[word]])[0]
            for word, name in (
                ("ALPHA", "mass_proportional"),
                ("BETA", "stiffness_proportional"),
            )
            if word in damping.parameters
        }
        rayleigh = RayleighDamping(**given)
    bulk = None
    if viscosity is not None and viscosity.numbers().any():
        bulk = BulkViscosity(*viscosity.numbers().tolist())
    return Effects(rayleigh=rayleigh, bulk_viscosity=bulk, gravity=_gravity(sections))


def _gravity(sections: _Sections) -> FloatArray | None:
    """Sum of the components given for the first block; all blocks have the same."""
    gravity: FloatArray | None = None
    for card in sections.all("DLOAD"):
        for line, row in card.rows():
            if len(row) == 6 and row[1].upper() == "GRAV":
                value, *direction = _floats(line, row[2:])
                gravity = np.zeros(3) if gravity is None else gravity
                gravity[int(np.argmax(direction))] = value
    return gravity


def _motion(sections: _Sections) -> Motion | None:
    card = sections.maybe("INITIAL CONDITIONS")
    if card is None:
        return None
    velocity, angular = np.zeros(3), np.zeros(3)
    rows = list(card.rows())
    if card.parameter("TYPE").upper() == "VELOCITY":
        for line, row in rows:
            component, value = _floats(line, row[1:3])
            if component not in {1.0, 2.0, 3.0}:
                raise DeckError(f"line {line}: got component {component:g}, expected 1, 2 or 3")
            velocity[int(component) - 1] = value
    elif len(rows) > 1:
        (line, first), (next_line, second) = rows[0], rows[1]
        spin, *linear = _floats(line, first[1:])
        points = _floats(next_line, second)
        if len(linear) != 3 or len(points) != 6:
            raise DeckError(f"line {line}: expected a speed, a velocity and two points")
        velocity = np.array(linear)
        direction = np.array(points[3:]) - np.array(points[:3])
        angular = rounded(spin * direction / np.linalg.norm(direction))
    return Motion(velocity, angular)


def _holds(sections: _Sections, blocks: dict[str, int]) -> Iterable[Hold]:
    for card in sections.all("BOUNDARY"):
        for line, row in card.rows():
            block, nodes = _block(line, row[0], blocks)
            first, last = (int(x) for x in _floats(line, row[1:3]))
            face = None if nodes == ALL else name_of(nodes.removesuffix("-NODES"))
            yield Hold(block, face, tuple(range(first - 1, last)))


# ---------------------------------------------------------------------------------------------
# Step


def _step(sections: _Sections) -> DeckStep:
    amplitude = sections.maybe("AMPLITUDE")
    ramp = 0.0 if amplitude is None else _ramp(amplitude)
    large = sections.step[0].parameters.get("NLGEOM", "").upper() != "NO"
    static = sections.maybe("STATIC")
    if static is not None:
        values = static.numbers()
        if len(values) != 4:
            raise DeckError(f"line {static.line}: expected four times under *Static")
        return DeckStep(Procedure.STATIC, float(values[1]), ramp, large_rotations=large)
    dynamic = sections.one("DYNAMIC")
    row = next(iter(dynamic.rows()), (dynamic.line, []))[1]
    if len(row) != 2:
        raise DeckError(f"line {dynamic.line}: expected a time step (or nothing) and an end time")
    end_time = _floats(dynamic.line, row[1:])[0]
    factor = dynamic.parameters.get("SCALE FACTOR")
    fields, history = _output_intervals(sections, end_time)
    return DeckStep(
        Procedure.EXPLICIT,
        end_time,
        ramp,
        time_step=_floats(dynamic.line, row[:1])[0] if row[0] else None,
        safety_factor=None if factor is None else _floats(dynamic.line, [factor])[0],
        large_rotations=large,
        field_intervals=fields,
        history_intervals=history,
    )


def _ramp(card: Card) -> float:
    values = card.numbers()
    kind = card.parameters.get("DEFINITION", "").upper()
    if (
        kind != "SMOOTH STEP"
        or values.shape != (4,)
        or (values[[0, 1, 3]] != (0.0, 0.0, 1.0)).any()
    ):
        raise DeckError(f"line {card.line}: expected a smooth step from 0 at time 0 to 1")
    return float(values[2])


def _output_intervals(sections: _Sections, end_time: float) -> tuple[int, int]:
    fields, history = 20, 200
    for card in sections.all("OUTPUT"):
        if "NUMBER INTERVAL" in card.parameters:
            fields = int(_floats(card.line, [card.parameters["NUMBER INTERVAL"]])[0])
        if "TIME INTERVAL" in card.parameters:
            interval = _floats(card.line, [card.parameters["TIME INTERVAL"]])[0]
            history = round(end_time / interval) if interval > 0.0 else 0
    return fields, history


def _loads(sections: _Sections, blocks: dict[str, int]) -> Iterable[DeckLoad]:
    for card in sections.step:
        rows = list(card.rows()) if card.keyword in {"DSLOAD", "DLOAD"} else []
        if not rows:
            continue
        line, row = rows[0]
        kind = row[1].upper() if len(row) > 1 else ""
        if card.keyword == "DLOAD" and kind == "GRAV":
            continue
        where = [_block(number, r[0], blocks) for number, r in rows]
        loaded = np.array(list(dict.fromkeys(block for block, _ in where)), dtype=np.int64)
        face = name_of(where[0][1])
        if card.keyword == "DLOAD" and kind in {"BX", "BY", "BZ"}:
            yield _body_force(rows, loaded, blocks)
        elif card.keyword == "DSLOAD" and kind == "P":
            yield PressureLoad(loaded, face, _floats(line, row[2:3])[0])
        elif card.keyword == "DSLOAD" and kind == "TRVEC" and "ORIENTATION" in card.parameters:
            yield CircumferentialLoad(loaded, face, _floats(line, row[2:3])[0])
        elif card.keyword == "DSLOAD" and kind == "TRVEC":
            yield _traction(rows, loaded, face)
        else:
            raise DeckError(
                f"line {line}: got load {kind!r}; expected P or TRVEC under *Dsload, GRAV, BX, BY "
                "or BZ under *Dload"
            )


def _body_force(
    rows: list[tuple[int, list[str]]], loaded: IntArray, blocks: dict[str, int]
) -> BodyForceLoad:
    density = np.zeros((len(loaded), 3))
    position = {block: k for k, block in enumerate(loaded.tolist())}
    for line, row in rows:
        block, _ = _block(line, row[0], blocks)
        axis = "XYZ".find(row[1].upper()[1:])
        density[position[block], axis] = _floats(line, row[2:3])[0]
    return BodyForceLoad(loaded, density)


def _traction(rows: list[tuple[int, list[str]]], loaded: IntArray, face: str) -> TractionLoad:
    traction = np.zeros(3)
    for line, row in rows:
        if len(row) != 6:
            raise DeckError(f"line {line}: expected a surface, TRVEC, a magnitude and a direction")
        value, *direction = _floats(line, row[2:])
        traction[int(np.argmax(direction))] = value
    return TractionLoad(loaded, face, traction)


# ---------------------------------------------------------------------------------------------
# Nothing is lost


def _check_nothing_lost(cards: list[Card], deck: Deck) -> None:
    """Write the deck anew and compare, card by card."""
    again = read_cards(abaqus_lines(deck))
    for card, other in zip_longest(cards, again):
        if card is None:
            missing = other.keyword.title()
            raise DeckError(f"line {cards[-1].line}: the deck has no *{missing} where one belongs")
        if other is None or card.keyword != other.keyword:
            expected = "nothing more" if other is None else f"*{other.keyword.title()}"
            raise DeckError(
                f"line {card.line}: *{card.keyword.title()} is not supported here, it would be "
                f"lost; expected {expected}, as `export` writes it"
            )
        _compare(card, other)


def _compare(card: Card, other: Card) -> None:
    if _parameters(card) != _parameters(other):
        raise DeckError(
            f"line {card.line}: *{card.keyword.title()} has the parameters {_parameters(card)}; "
            f"import would keep {_parameters(other)}"
        )
    first = 1 if card.keyword == "HEADING" else 0
    pairs = zip_longest(card.data[first:], other.data[first:], fillvalue="")
    for position, (text, kept) in enumerate(pairs, start=first):
        if text != kept and _normal(text) != _normal(kept):
            line = card.data_line[position] if position < len(card.data) else card.line
            raise DeckError(
                f"line {line}: got {text[:60]!r} under *{card.keyword.title()}; import would keep "
                f"{kept[:60]!r}"
            )


def _parameters(card: Card) -> dict[str, str]:
    return {name: " ".join(_normal(value)) for name, value in sorted(card.parameters.items())}


def _normal(text: str) -> list[str]:
    """Entries with numbers in one spelling and labels in upper case."""
    result = []
    for entry in text.split(","):
        word = entry.strip().upper()
        try:
            result.append(repr(float(word)))
        except ValueError:
            result.append(word)
    while result and not result[-1]:
        result.pop()
    return result
