"""Blocks of a deck: the part of each instance at its place, with sets and surfaces as its faces."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from fem.decks.placement import rotation_matrix
from fem.decks.read.cards import Card
from fem.decks.read.mesh import DeckPart, set_entries
from geometry.assembly import Assembly
from geometry.block import Block
from geometry.files.hexahedral_solids import SURFACE
from geometry.files.named_sets import face_name
from geometry.mesh import FloatArray, IntArray
from geometry.parts.regions import Edges, Where

#: Surface of our decks that is all contact faces of a part.
_TAKEN = "contact"
#: Instance and number of a node or an element.
Member = tuple[int, int]


@dataclass(frozen=True)
class Instance:
    """A part at its place."""

    name: str
    part: DeckPart
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    translation: FloatArray = field(default_factory=lambda: np.zeros(3))


def placed(card: Card, part: DeckPart) -> Instance:
    """Read ``*Instance``: a translation, then a rotation about an axis of two points [degrees].

    Raises
    ------
    DeckError
        Numbers that are no such motion.
    """
    rows = [[card.number(line, text) for text in row if text] for line, row in card.rows()]
    lengths = [len(row) for row in rows]
    turned = rows[1] if lengths == [3, 7] else [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    a, b = np.array(turned[:3]), np.array(turned[3:6])
    if lengths not in ([], [3], [3, 7]) or (a == b).all():
        raise card.wrong(f"lines of {lengths} numbers", "a translation, two points and an angle")
    turn, shift = rotation_matrix(b - a, turned[6]), np.array(rows[0]) if rows else np.zeros(3)
    return Instance(card.parameter("NAME"), part, turn, turn @ (shift - a) + a)


@dataclass
class Blocks:
    """All blocks of a deck, one for each instance, with their sets, surfaces and faces."""

    instances: list[Instance] = field(default_factory=list)
    by_name: dict[str, int] = field(default_factory=dict)
    """Position of each instance of a part."""
    owner: tuple[dict[int, int], dict[int, int]] = field(default_factory=lambda: ({}, {}))
    """Instance of each element, and of each node, of a flat deck."""
    sets: tuple[dict[str, list[Member]], dict[str, list[Member]]] = field(
        default_factory=lambda: ({}, {})
    )
    """Sets of elements, and of nodes, of the assembly or of a flat deck."""
    surfaces: dict[str, Card] = field(default_factory=dict)
    each_once: bool = False
    """Whether sets of loads and surfaces may have members once alone: CalculiX loads those that are
    there twice twice, Abaqus once."""
    faces: dict[int, dict[str, IntArray]] = field(default_factory=lambda: defaultdict(dict))
    """Rows of the surface's facets of each face of each block."""
    contact: dict[int, dict[str, IntArray]] = field(default_factory=lambda: defaultdict(dict))
    """The same of faces that can meet others: no facet is in two of them."""

    def add_flat(self, flat: DeckPart) -> None:
        """Add connected elements of a flat deck, each as an instance, and all sets."""
        for number, piece in enumerate(flat.pieces()):
            self.instances.append(Instance(piece.name, piece))
            self.owner[False].update(dict.fromkeys(piece.element_index, number))
            self.owner[True].update(dict.fromkeys(piece.index, number))
        sets = zip(self.owner, self.sets, (flat.element_sets, flat.node_sets), strict=True)
        for of, own, known in sets:
            own |= {name: [(of[k], k) for k in row if k in of] for name, row in known.items()}
        self.surfaces = flat.surfaces

    def add_set(self, card: Card) -> None:
        """Read ``*Nset`` or ``*Elset`` of the assembly."""
        nodes, instance = card.keyword == "NSET", card.option("INSTANCE")
        members = self.sets[nodes].setdefault(card.parameter(card.keyword), [])
        for line, entry in set_entries(card):
            text = f"{instance}.{entry}" if instance else str(entry)
            members += self.members(card, line, text, nodes=nodes)

    # -----------------------------------------------------------------------------------------
    # Nodes and elements

    def members(self, card: Card, line: int, text: str, *, nodes: bool) -> list[Member]:
        """Instance and number of the nodes or elements that an entry names.

        Raises
        ------
        DeckError
            Naming the line: what names none.
        """
        entry = text.strip('"').upper()
        result = self.sets[nodes].get(entry) or self._of_instance(entry, nodes=nodes)
        if not result:
            what = "nodes of elements" if nodes else "elements"
            raise card.wrong(repr(text), f"a set of {what} that is defined", line)
        acts = self.each_once and card.keyword in {"CLOAD", "DLOAD", "SURFACE"}
        if acts and len(set(result)) < len(result):
            raise card.wrong(
                f"{text} with a member twice, which is loaded twice", "each once", line
            )
        return result

    def _of_instance(self, entry: str, *, nodes: bool) -> list[Member]:
        """Members of a set of an instance, INSTANCE.SET, or one by its number."""
        first, _, rest = entry.rpartition(".")
        label = int(rest) if rest.isdigit() else -1
        number = self.by_name.get(first) if first else self.owner[nodes].get(label)
        if number is None:
            return []
        part = self.instances[number].part
        sets = part.node_sets if nodes else part.element_sets
        index = part.index if nodes else part.element_index
        return [(number, one) for one in sets.get(rest, [label]) if one in index]

    @property
    def elements(self) -> list[Member]:
        """Instance and number of all elements."""
        return [(k, of) for k, one in enumerate(self.instances) for of in one.part.element_index]

    @property
    def parts(self) -> list[DeckPart]:
        """Of each block."""
        return [one.part for one in self.instances]

    def part(self, block: int) -> DeckPart:
        """Part of a block."""
        return self.instances[block].part

    def name(self, block: int) -> str:
        """Name of a block."""
        return self.instances[block].name

    def located(self, nodes: list[Member]) -> dict[int, IntArray]:
        """Nodes of the part in each block, of instances and numbers of nodes."""
        result: dict[int, list[int]] = {}
        for block, label in dict.fromkeys(nodes):
            result.setdefault(block, []).append(self.part(block).index[label])
        used = {b: np.intersect1d(rows, self.part(b).members) for b, rows in result.items()}
        return {block: rows for block, rows in used.items() if len(rows)}

    def coordinates(self, block: int, nodes: IntArray) -> FloatArray:
        """World coordinates of nodes of a part, (n, 3) [mm]."""
        one = self.instances[block]
        return np.asarray(one.part.nodes[nodes] @ one.rotation.T + one.translation)

    def where(self, card: Card, line: int, block: int, nodes: IntArray, name: str) -> Where:
        """A face where nodes are all those of whole facets, else edges.

        Raises
        ------
        DeckError
            Nodes that are neither.
        """
        part = self.part(block)
        rows = part.whole_sides(nodes)
        corners = part.corners[np.unique(part.outer[rows])]
        if len(rows) and np.isin(np.setdiff1d(nodes, part.others), corners).all():
            return self.face(block, name, rows)
        if not part.are_edges(nodes):
            raise card.unread(f"{name}, nodes of no whole faces or edges of the surface,", line)
        return Edges(self.coordinates(block, np.intersect1d(nodes, part.corners)))

    def whole(self, card: Card, line: int, elements: list[Member]) -> list[int]:
        """Blocks of elements, all of each.

        Raises
        ------
        DeckError
            Elements that are part of a block.
        """
        blocks, count = np.unique([block for block, _ in set(elements)], return_counts=True)
        if any(n != len(self.part(b).volumes) for b, n in zip(blocks, count, strict=True)):
            raise card.unread("part of a block,", line)
        return [int(block) for block in blocks]

    # -----------------------------------------------------------------------------------------
    # Surfaces

    def facets(
        self, card: Card, line: int, elements: list[Member], side: str
    ) -> dict[int, IntArray]:
        """Rows of one side, such as S3, of elements; of all their outer sides where it is empty.

        Raises
        ------
        DeckError
            No such side, or none of them on the surface.
        """
        quads: dict[int, list[IntArray]] = {}
        for block, label in elements:
            part = self.part(block)
            sides = part.hexahedra.sides[part.element_index[label]]
            number = int(side[1:]) - 1 if side[1:].isdigit() and side[0] in "SP" else -1
            if side and not 0 <= number < len(sides):
                raise card.wrong(f"side {side!r} of element {label}", f"S1 to S{len(sides)}", line)
            quads.setdefault(block, []).append(sides[number] if side else sides.reshape(-1, 4))
        rows = {block: self.part(block).rows(np.concatenate(of)) for block, of in quads.items()}
        result = {block: of for block, of in rows.items() if len(of)}
        if not result:
            raise card.wrong(f"side {side} inside of blocks", "sides at their surface", line)
        return result

    def surface(self, card: Card, line: int, text: str) -> dict[int, IntArray]:
        """Rows of a surface by its name, by block.

        Raises
        ------
        DeckError
            No surface of that name, or one without facets.
        """
        entry = text.strip('"').upper()
        first, _, rest = entry.rpartition(".")
        stated, prefix = self.surfaces.get(entry), ""
        if stated is None and first in self.by_name:
            stated, prefix = self.part(self.by_name[first]).surfaces.get(rest), f"{first}."
        if stated is None:
            raise card.wrong(repr(text), "a surface that is defined", line)
        if stated.option("TYPE") not in {"", "ELEMENT"}:
            raise stated.unread(f"type={stated.option('TYPE')}")
        result: dict[int, IntArray] = {}
        for number, row in stated.rows():
            members = self.members(stated, number, f"{prefix}{row[0]}", nodes=False)
            side = row[1].upper() if len(row) > 1 else ""
            if self.each_once and not side:
                raise stated.wrong("no side, which CalculiX needs", "S1 to S6", number)
            for block, rows in self.facets(stated, number, members, side).items():
                if self.each_once and np.isin(rows, result.get(block, [])).any():
                    raise stated.wrong("a side twice, which is loaded twice", "it once", number)
                result[block] = np.union1d(result.get(block, rows), rows)
        if not result:
            raise stated.wrong("no facets", "sides of elements")
        return result

    def face(self, block: int, name: str, rows: IntArray) -> str:
        """Name of a face of a block: that of a set or surface of the deck, as far as it is free."""
        name = face_name(self._of_block(block, name))
        while name == _TAKEN or not np.array_equal(self.faces[block].setdefault(name, rows), rows):
            name += "x"
        return name

    def named(self) -> Iterator[tuple[str, dict[int, IntArray]]]:
        """Surfaces of parts, of each instance; those that our decks add are none."""
        for name, block in self.by_name.items():
            for title, card in self.part(block).surfaces.items():
                stated = card.option("TYPE") in {"", "ELEMENT"} and title != _TAKEN.upper()
                if stated and "-PATCH-" not in title:
                    yield title, self.surface(card, card.line, f"{name}.{title}")

    def _of_block(self, block: int, name: str) -> str:
        """Name without what our decks add: that of the block, -NODES, and numbers of patches."""
        title = self.name(block).upper()
        own = name.upper().removeprefix(f"{title}.").removeprefix(f"{title}_")
        return own.removesuffix("-NODES").partition("-PATCH-")[0]

    def meet(self, name: str, facets: dict[int, IntArray]) -> None:
        """Let facets of blocks meet others."""
        for block, rows in facets.items():
            known, title = self.contact[block], self._of_block(block, name)
            left = np.setdiff1d(rows, np.concatenate([np.zeros(0, np.int64), *known.values()]))
            if len(left):
                known[title] = np.union1d(known.get(title, left), left)

    # -----------------------------------------------------------------------------------------
    # Assembly

    def assembly(
        self, name: str, fixed: list[int], axis: FloatArray, origin: FloatArray
    ) -> Assembly:
        """Blocks with their faces; those that are alike share a shape."""
        for title, facets in self.named():
            for block, rows in facets.items():
                self.face(block, title, rows)
        n, shapes, number = len(self.instances), list[Block](), dict[object, int]()
        shape_of = []
        for block, part in enumerate(self.parts):
            contact = sorted(self.face(block, *one) for one in self.contact[block].items())
            covered = np.concatenate([np.zeros(0, np.int64), *self.faces[block].values()])
            if len(np.unique(covered)) < len(part.outer):
                self.face(block, SURFACE, np.arange(len(part.outer)))
            faces = self.faces[block]
            rows_of = frozenset((face, rows.tobytes()) for face, rows in faces.items())
            key = id(part), rows_of, tuple(contact)
            shape_of.append(number.setdefault(key, len(shapes)))
            if shape_of[-1] == len(shapes):
                alike = sum(shape.mesh is part.mesh for shape in shapes)
                title = face_name(part.name) + (f"-{alike + 1}" if alike else "")
                quads = {face: part.outer[faces[face]] for face in sorted(faces)}
                shape = Block(title, part.mesh, quads, tuple(contact), part.curve)
                shapes.append(replace(shape, tetrahedra=part.tetrahedra))
        held = np.isin(np.arange(n), fixed)
        return Assembly(
            name=name,
            shapes=tuple(shapes),
            shape_of=np.array(shape_of, dtype=np.int64),
            rotations=np.array([one.rotation for one in self.instances]),
            translations=np.array([one.translation for one in self.instances]),
            fixed=held,
            layer=np.where(held, 0, 1),
            axis=axis,
            origin=origin,
            names=tuple(one.name for one in self.instances),
            unmatched_allowed=True,
            unmatched=(),
        )
