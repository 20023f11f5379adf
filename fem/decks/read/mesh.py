"""Parts of a deck: nodes, elements and sets by their numbers, and the mesh that they are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fem.decks.keywords import DeckError
from fem.decks.read.cards import Card
from fem.decks.read.elements import HEX_SIDES, TET_SIDES, VOLUMES, Hexahedra, as_hexahedra
from geometry.block import Curve
from geometry.files.named_sets import face_name
from geometry.files.quadratic import quadratic_curve
from geometry.mesh import HEX_EDGES, FloatArray, HexMesh, IntArray, boundary_quads, check_mesh

#: Largest number of entries that a generated set may have.
_MOST = 50_000_000


@dataclass
class DeckPart:
    """Nodes, elements and sets of a part, or of a flat deck."""

    name: str
    index: dict[int, int] = field(default_factory=dict)
    """Position of each node by its number in the deck."""
    places: list[list[float]] = field(default_factory=list)
    """Their coordinates, three each [mm]."""
    element_index: dict[int, int] = field(default_factory=dict)
    """Position of each element by its number in the deck."""
    kind: str = ""
    """Type of the elements."""
    kind_at: str = ""
    volumes: list[list[int]] = field(default_factory=list)
    """Nodes of each element, as numbered in the deck."""
    titles: list[str] = field(default_factory=list)
    """Set that ``*Element`` puts each in."""
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    element_sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, Card] = field(default_factory=dict)
    sections: list[Card] = field(default_factory=list)

    def pieces(self) -> list[DeckPart]:
        """Connected elements, each as a part that has the set of its elements as its name.

        Raises
        ------
        DeckError
            No elements.
        """
        if not self.volumes:
            raise DeckError(f"part {self.name}: got no elements; expected {', '.join(VOLUMES)}")
        corners = self.members[:, : self.sides.max() + 1]
        row = np.repeat(np.arange(len(corners)), corners.shape[1])
        shape = len(corners), len(self.places)
        graph = coo_array((np.ones(corners.size), (row, corners.ravel())), shape=shape).tocsr()
        count, label = connected_components(graph @ graph.T, directed=False)
        numbers, elements = list(self.index), list(self.element_index)
        titles, result = np.array(self.titles), []
        for number in range(count):
            mine = np.flatnonzero(label == number).tolist()
            title = titles[mine[0]]
            own = np.array_equal(np.flatnonzero(titles == title), mine)
            used = np.unique(self.members[mine]).tolist()
            piece = replace(
                self,
                name=str(title) if own and title else f"BLOCK-{number + 1}",
                index={numbers[k]: at for at, k in enumerate(used)},
                places=[self.places[k] for k in used],
                element_index={elements[k]: at for at, k in enumerate(mine)},
                volumes=[self.volumes[k] for k in mine],
            )
            result.append(piece)
        return result

    @cached_property
    def section_of(self) -> dict[int, Card]:
        """Section of elements, the last that names each."""
        result: dict[int, Card] = {}
        for card in self.sections:
            name = card.parameter("ELSET")
            if name not in self.element_sets:
                raise card.wrong(f"elset {name}", "a set of elements that is defined")
            result |= dict.fromkeys(self.element_sets[name], card)
        return result

    # -----------------------------------------------------------------------------------------
    # As a mesh

    @cached_property
    def nodes(self) -> FloatArray:
        """(n, 3) [mm]."""
        return np.array(self.places, dtype=np.float64).reshape(-1, 3)

    @cached_property
    def members(self) -> IntArray:
        """Positions of the nodes of each element, (n_elements, n)."""
        return np.array([[self.index[n] for n in row] for row in self.volumes], dtype=np.int64)

    @property
    def sides(self) -> IntArray:
        """Corners of the sides of an element, (n_sides, k)."""
        return TET_SIDES if VOLUMES[self.kind] in {4, 10} else HEX_SIDES

    @cached_property
    def hexahedra(self) -> Hexahedra:
        """Its elements as hexahedra."""
        return as_hexahedra(self.nodes, self.members)

    @cached_property
    def corners(self) -> IntArray:
        """Nodes of the part at the corners of the mesh, (n,)."""
        return np.unique(self.hexahedra.elements[:, :8])

    @cached_property
    def others(self) -> IntArray:
        """Nodes of the part between corners, of curved elements, (n,)."""
        return np.setdiff1d(self.hexahedra.elements, self.corners)

    @cached_property
    def mesh(self) -> HexMesh:
        """Hexahedra with eight nodes.

        Raises
        ------
        MeshError
            Bad elements.
        """
        elements = np.searchsorted(self.corners, self.hexahedra.elements[:, :8])
        mesh = HexMesh(self.hexahedra.nodes[self.corners], elements)
        check_mesh(mesh, face_name(self.name))
        return mesh

    @property
    def curve(self) -> Curve | None:
        """Exact shape of curved elements."""
        elements = self.hexahedra.elements
        if elements.shape[1] == 8:
            return None
        return quadratic_curve(Path(self.name), self.mesh.elements, self.hexahedra.nodes[elements])

    @property
    def tetrahedra(self) -> float | None:
        """Mean edge of tetrahedra of ten nodes, of volume a³ / (6 √2) [mm]; None: of others."""
        if VOLUMES[self.kind] != 10:
            return None
        return float(np.cbrt(6.0 * np.sqrt(2.0) * self.mesh.extent()[0] / len(self.volumes)))

    @cached_property
    def outer(self) -> IntArray:
        """Facets of the surface, corners of the mesh, (n, 4)."""
        return boundary_quads(self.mesh)

    @cached_property
    def _row(self) -> dict[tuple[int, ...], int]:
        """Facet of the surface by the nodes of the part at its corners."""
        corners = np.sort(self.corners[self.outer], axis=1).tolist()
        return {tuple(row): k for k, row in enumerate(corners)}

    def rows(self, quads: IntArray) -> IntArray:
        """Those of facets, nodes of the part (n, 4), that are on the surface."""
        result = (self._row.get(tuple(quad)) for quad in np.sort(quads, axis=1).tolist())
        return np.unique([row for row in result if row is not None]).astype(np.int64)

    def whole_sides(self, nodes: IntArray) -> IntArray:
        """Rows of the facets of all sides of elements whose corners are among nodes."""
        element, side = np.nonzero(np.isin(self.members[:, self.sides], nodes).all(axis=2))
        return self.rows(self.hexahedra.sides[element, side].reshape(-1, 4))

    def are_edges(self, nodes: IntArray) -> bool:
        """Whether nodes are corners of the surface, and all middles of edges between them."""
        inside, outer = np.intersect1d(nodes, self.corners), self.corners[self.outer]
        elements = self.hexahedra.elements
        ends = np.sort(elements[:, HEX_EDGES], axis=2)
        mine = np.isin(ends, inside).all(axis=2)
        edges = np.sort(np.stack([outer, np.roll(outer, -1, axis=1)], axis=2), axis=2)
        at_surface = set(map(tuple, edges.reshape(-1, 2).tolist()))
        middles = elements[:, 8:20][mine[:, : elements.shape[1] - 8]]
        between = np.setdiff1d(np.intersect1d(nodes, self.others), elements[:, 20:])
        return (
            len(inside) > 0
            and bool(np.isin(inside, outer).all())
            and np.array_equal(between, np.unique(middles))
            and (not len(middles) or at_surface.issuperset(map(tuple, ends[mine].tolist())))
        )


def add_nodes(part: DeckPart, card: Card) -> None:
    """Read ``*Node``: number and coordinates, missing ones are zero."""
    for line, row in card.rows():
        label = card.whole(line, row[0])
        if label in part.index or len(row) > 7:
            got = "twice" if label in part.index else f"with {len(row)} entries"
            raise card.wrong(f"node {label} {got}", "a number of its own, coordinates", line)
        values = [card.number(line, text) if text else 0.0 for text in row[1:4]]
        part.index[label] = len(part.places)
        part.places.append(values + [0.0] * (3 - len(values)))
        if name := card.option("NSET"):
            part.node_sets.setdefault(name, []).append(label)


def add_elements(part: DeckPart, card: Card) -> None:
    """Read ``*Element``: number and nodes; an element may go on over lines."""
    kind, name = card.parameter("TYPE"), card.option("ELSET")
    count = VOLUMES.get(kind)
    if count is None or part.kind not in {"", kind}:
        raise card.unread(f"type={kind}" + (f" beside {part.kind}" if count else ""))
    part.kind, part.kind_at = kind, card.at()
    values = [(line, text) for line, row in card.rows() for text in row if text]
    numbers = [card.whole(line, text) for line, text in values]
    if len(numbers) % (count + 1):
        raise card.wrong(f"{len(numbers)} entries", f"a number and {count} nodes each")
    for k in range(0, len(numbers), count + 1):
        label, *nodes = numbers[k : k + count + 1]
        twice = label in part.element_index or len(set(nodes)) < count
        missing = [node for node in nodes if node not in part.index]
        if twice or missing:
            got = f"with node {missing[0]}" if missing else "twice, or a node of it twice"
            raise card.wrong(f"element {label} {got}", "defined nodes, each once", values[k][0])
        part.element_index[label] = len(part.volumes)
        part.volumes.append(nodes)
        part.titles.append(name)
        if name:
            part.element_sets.setdefault(name, []).append(label)


def set_entries(card: Card) -> Iterator[tuple[int, str | int]]:
    """Lines and entries of a set: numbers, those of a range, or names of others."""
    for line, row in card.rows():
        if "GENERATE" in card.parameters:
            first, last, by = ([*(card.whole(line, text) for text in row), 1, -1, 1])[:3]
            if len(row) not in {2, 3} or by <= 0 or last < first or (last - first) // by > _MOST:
                raise card.wrong(", ".join(row), "a first, a last number and a step", line)
            yield from ((line, number) for number in range(first, last + 1, by))
            continue
        for text in row:
            if text:
                yield line, int(text) if text.isdigit() else text.strip('"').upper()


def add_set(part: DeckPart, card: Card) -> None:
    """Read ``*Nset`` or ``*Elset`` of a part."""
    nodes = card.keyword == "NSET"
    known = part.node_sets if nodes else part.element_sets
    members = known.setdefault(card.parameter(card.keyword), [])
    for line, entry in set_entries(card):
        if isinstance(entry, str):
            if entry not in known:
                raise card.wrong(repr(entry), "a set that is defined before", line)
            members += list(known[entry])
        elif entry in part.index or not nodes:
            members.append(entry)
        elif "GENERATE" not in card.parameters:
            raise card.wrong(f"node {entry}", "one that is defined", line)
