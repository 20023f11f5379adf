"""Blocks of a deck: connected elements of each instance, their facets, and nodes by place."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fem.decks.keywords import DeckError
from fem.decks.read.cards import Card
from fem.decks.read.elements import (
    HEX_SIDES,
    TET_SIDES,
    TETRAHEDRA,
    Hexahedra,
    as_hexahedra,
)
from fem.decks.read.mesh import Instance, Part, Places
from geometry.assembly import Assembly
from geometry.block import Block, Curve
from geometry.files.hexahedral_solids import SURFACE
from geometry.files.named_sets import face_name
from geometry.files.quadratic import quadratic_curve
from geometry.mesh import HEX_EDGES, FloatArray, HexMesh, IntArray, boundary_quads, check_mesh

#: Face of what can meet other blocks.
CONTACT = "contact"


@dataclass(frozen=True)
class Solid:
    """Connected elements of a part."""

    name: str
    mesh: HexMesh
    curve: Curve | None
    nodes: IntArray
    """The part's node of each node of the mesh, (n,)."""
    others: IntArray
    """The part's nodes between corners, of curved elements, (n,)."""
    material: str
    tetrahedra: float | None = None
    """Mean edge of the tetrahedra of ten nodes that its hexahedra were split from [mm]."""

    @cached_property
    def outer(self) -> IntArray:
        """Facets of the surface, corners of the mesh, (n, 4)."""
        return boundary_quads(self.mesh)

    @cached_property
    def rows(self) -> dict[tuple[int, ...], int]:
        """Facet of the surface by the part's nodes at its corners."""
        corners = np.sort(self.nodes[self.outer], axis=1).tolist()
        return {tuple(row): k for k, row in enumerate(corners)}


@dataclass(frozen=True)
class Body:
    """Solids of a part and where its elements went."""

    members: IntArray
    """The part's nodes of each of its elements, (n_elements, n_nodes)."""
    hexahedra: Hexahedra
    solids: tuple[Solid, ...]
    solid_of: IntArray
    """Solid of each element, (n_elements,)."""
    solid_at: IntArray
    """Solid of each node of the part, -1: of none, (n_nodes,)."""

    @cached_property
    def corners(self) -> IntArray:
        """The part's nodes at the corners of the sides of elements, (n_elements, n_sides, k)."""
        split = self.members.shape[1] in TETRAHEDRA
        return np.asarray(self.members[:, TET_SIDES if split else HEX_SIDES])


def body_of(part: Part, materials: list[str], path: str) -> Body:
    """Divide a part into connected solids of one material each.

    Parameters
    ----------
    part
        The part.
    materials
        Of each of its elements.
    path
        Of the deck, for messages.

    Raises
    ------
    DeckError, MeshError
        A solid of several materials, bad elements.
    """
    members = np.array([[part.index[n] for n in row] for row in part.volumes], dtype=np.int64)
    hexahedra = as_hexahedra(part.nodes, members)
    corners = hexahedra.elements[:, :8]
    n_hexes, n_nodes = len(corners), len(hexahedra.nodes)
    rows = np.repeat(np.arange(n_hexes), 8)
    ends = rows, corners.ravel()
    graph = coo_array((np.ones(8 * n_hexes), ends), shape=(n_hexes, n_nodes)).tocsr()
    _, label = connected_components(graph @ graph.T, directed=False)
    at = np.full(n_nodes, -1)
    at[hexahedra.elements] = label[:, None]
    kinds = np.array(materials)[hexahedra.owner]
    solids = []
    for number in range(int(label.max()) + 1):
        mine = label == number
        names = np.unique(kinds[mine])
        if len(names) > 1:
            raise DeckError(
                f"{part.kind_at}: connected elements have the materials {', '.join(names)}; "
                "expected one material in a block"
            )
        title = part.name or "block"
        title = face_name(title if int(label.max()) == 0 else f"{title}-{number + 1}")
        split = members.shape[1] == 10
        solids.append(_solid(title, hexahedra, mine, str(names[0]), path, split=split))
    solid_of = np.zeros(len(members), dtype=np.int64)
    solid_of[hexahedra.owner] = label
    return Body(members, hexahedra, tuple(solids), solid_of, at)


def _solid(
    name: str, hexahedra: Hexahedra, mine: IntArray, material: str, path: str, *, split: bool
) -> Solid:
    elements = hexahedra.elements[mine]
    nodes, renumbered = np.unique(elements[:, :8], return_inverse=True)
    mesh = HexMesh(hexahedra.nodes[nodes], renumbered.reshape(-1, 8).astype(np.int64))
    check_mesh(mesh, name)
    curve = None
    if elements.shape[1] > 8:
        places = hexahedra.nodes[elements]
        curve = quadratic_curve(path, mesh.elements, places)  # type: ignore[arg-type]
    # Four hexahedra of a regular tetrahedron of edge a have the volume a³ / (6 √2).
    edge = float(np.cbrt(6.0 * np.sqrt(2.0) * 4.0 * mesh.extent()[0] / mesh.n_elements))
    others = np.setdiff1d(elements, nodes)
    return Solid(name, mesh, curve, nodes, others, material, edge if split else None)


@dataclass
class Blocks:
    """All blocks of a deck: which solid of which instance, and their faces."""

    places: Places
    bodies: list[Body]
    """Of each instance."""
    faces: list[dict[str, IntArray]] = field(default_factory=list)
    """Rows of the surface's facets of each face of each block."""

    def __post_init__(self) -> None:
        self.faces = [{} for _ in self.owners]

    @cached_property
    def owners(self) -> list[tuple[int, int]]:
        """Instance and solid of each block."""
        return [(i, s) for i, body in enumerate(self.bodies) for s in range(len(body.solids))]

    @cached_property
    def numbers(self) -> dict[tuple[int, int], int]:
        """Block by its instance and solid."""
        return {owner: block for block, owner in enumerate(self.owners)}

    def solid(self, block: int) -> Solid:
        """Solid of a block."""
        instance, number = self.owners[block]
        return self.bodies[instance].solids[number]

    def instance(self, block: int) -> Instance:
        """Instance of a block."""
        return self.places.instances[self.owners[block][0]]

    def name(self, block: int) -> str:
        """Name of a block, for people."""
        instance = self.instance(block)
        alone = len(self.bodies[self.owners[block][0]].solids) == 1
        return instance.name if instance.name and alone else self.solid(block).name

    # -----------------------------------------------------------------------------------------
    # Nodes

    def located(self, nodes: list[tuple[int, int]]) -> dict[int, IntArray]:
        """The part's nodes in each block, of instances and numbers of nodes; others are in none."""
        result: dict[int, list[int]] = {}
        for instance, label in dict.fromkeys(nodes):
            body, index = self.bodies[instance], self.places.instances[instance].part.index[label]
            solid = int(body.solid_at[index])
            if solid >= 0:
                result.setdefault(self.numbers[instance, solid], []).append(index)
        return {block: np.array(sorted(rows)) for block, rows in result.items()}

    def coordinates(self, block: int, nodes: IntArray) -> FloatArray:
        """World coordinates of nodes of a part, (n, 3) [mm]."""
        instance = self.instance(block)
        local = self.bodies[self.owners[block][0]].hexahedra.nodes[nodes]
        return np.asarray(local @ instance.rotation.T + instance.translation)

    def whole_sides(self, block: int, nodes: IntArray) -> IntArray:
        """Rows of the facets of all sides of elements whose corners are among nodes of the part."""
        instance, number = self.owners[block]
        body, part = self.bodies[instance], self.places.instances[instance].part
        mine = np.flatnonzero(body.solid_of == number)
        wanted = np.zeros(len(part.places), dtype=np.bool_)
        wanted[nodes] = True
        table = body.corners[mine]
        element, side = np.nonzero(wanted[table].all(axis=2))
        quads = body.hexahedra.sides[mine[element], side].reshape(-1, 4)
        return self._rows(block, quads)

    def are_edges(self, block: int, nodes: IntArray) -> bool:
        """Whether nodes of the part are those of whole edges of the surface, of curved elements."""
        instance, number = self.owners[block]
        body, solid = self.bodies[instance], self.solid(block)
        elements = body.hexahedra.elements[body.solid_of[body.hexahedra.owner] == number]
        if elements.shape[1] == 8:
            return False
        outer = solid.nodes[solid.outer]
        edges = np.sort(np.stack([outer, np.roll(outer, -1, axis=1)], axis=2), axis=2)
        outer_edges = set(map(tuple, edges.reshape(-1, 2).tolist()))
        ends = np.sort(elements[:, HEX_EDGES], axis=2)
        inside = np.isin(ends, nodes).all(axis=2)
        between = np.setdiff1d(np.intersect1d(nodes, solid.others), elements[:, 20:])
        return outer_edges.issuperset(map(tuple, ends[inside].tolist())) and np.array_equal(
            between, np.unique(elements[:, 8:20][inside])
        )

    def _rows(self, block: int, quads: IntArray) -> IntArray:
        known = self.solid(block).rows
        result = (known.get(tuple(quad)) for quad in np.sort(quads, axis=1).tolist())
        return np.unique([row for row in result if row is not None]).astype(np.int64)

    def whole(self, card: Card, line: int, elements: list[tuple[int, int]]) -> list[int]:
        """Blocks of elements, all of each.

        Raises
        ------
        DeckError
            Elements that are part of a block.
        """
        count: dict[int, int] = {}
        for instance, label in dict.fromkeys(elements):
            body = self.bodies[instance]
            element = self.places.instances[instance].part.element_index[label]
            block = self.numbers[instance, int(body.solid_of[element])]
            count[block] = count.get(block, 0) + 1
        for block, n in count.items():
            instance, solid = self.owners[block]
            if n != int((self.bodies[instance].solid_of == solid).sum()):
                raise DeckError(
                    f"{card.at(line)}: {card.title} has part of a block; expected whole blocks"
                )
        return list(count)

    # -----------------------------------------------------------------------------------------
    # Surfaces

    def sides(
        self, card: Card, line: int, elements: list[tuple[int, int]], side: str
    ) -> dict[int, IntArray]:
        """Facets of one side, such as S3, of elements; of all their outer sides where it is empty.

        Raises
        ------
        DeckError
            No such side, or none of them on the surface.
        """
        quads: dict[int, list[IntArray]] = {}
        for instance, label in elements:
            body = self.bodies[instance]
            element = self.places.instances[instance].part.element_index[label]
            sides = body.hexahedra.sides[element]
            number = int(side[1:]) - 1 if side[1:].isdigit() and side[0] in "SP" else -1
            if side and not 0 <= number < len(sides):
                raise DeckError(
                    f"{card.at(line)}: got side {side!r} of element {label}; expected S1 to "
                    f"S{len(sides)}"
                )
            block = self.numbers[instance, int(body.solid_of[element])]
            chosen = sides[number] if side else sides.reshape(-1, 4)
            quads.setdefault(block, []).append(chosen)
        rows = {block: self._rows(block, np.concatenate(of)) for block, of in quads.items()}
        result = {block: of for block, of in rows.items() if len(of)}
        if not result:
            raise DeckError(
                f"{card.at(line)}: no side {side} of these elements is on the surface of a block; "
                "expected outer sides"
            )
        return result

    def surface(self, card: Card, line: int, text: str) -> dict[int, IntArray]:
        """Facets of a surface by its name, by block.

        Raises
        ------
        DeckError
            No surface of that name, or one without facets.
        """
        entry = text.strip('"').upper()
        first, _, rest = entry.rpartition(".")
        prefix = ""
        stated = self.places.surfaces.get(entry)
        number = self.places.by_name.get(first)
        if stated is None and number is not None:
            stated, prefix = self.places.instances[number].part.surfaces.get(rest), first
        if stated is None:
            raise DeckError(
                f"{card.at(line)}: got {text!r}, which names no surface; expected one of "
                f"{', '.join(list(self.places.surfaces)[:6]) or 'those of *Surface'}"
            )
        return self._facets(stated, f"{prefix}." if prefix else "")

    def _facets(self, card: Card, prefix: str) -> dict[int, IntArray]:
        result: dict[int, IntArray] = {}
        of_nodes = card.option("TYPE") == "NODE"
        nodes: list[tuple[int, int]] = []
        for line, row in card.rows():
            members = self.places.members(card, line, f"{prefix}{row[0]}", nodes=of_nodes)
            if of_nodes:
                nodes += members
                continue
            side = row[1].upper() if len(row) > 1 else ""
            if self.places.each_once and not side:
                raise DeckError(
                    f"{card.at(line)}: no side, which CalculiX needs; expected S1 to S6"
                )
            for block, rows in self.sides(card, line, members, side).items():
                if self.places.each_once and np.isin(rows, result.get(block, [])).any():
                    raise DeckError(
                        f"{card.at(line)}: a side is in the surface already, and CalculiX loads it "
                        "twice; expected it once"
                    )
                result[block] = np.union1d(result.get(block, rows), rows)
        for block, indices in self.located(nodes).items():
            result[block] = self.whole_sides(block, indices)
        result = {block: rows for block, rows in result.items() if len(rows)}
        if not result:
            raise DeckError(
                f"{card.at()}: the surface {card.option('NAME')} has no facets; expected sides of "
                "elements, or all nodes of some"
            )
        return result

    def add_face(self, block: int, name: str, rows: IntArray) -> None:
        """Add facets to a face of a block."""
        known = self.faces[block].get(name, rows)
        self.faces[block][name] = np.union1d(known, rows)

    # -----------------------------------------------------------------------------------------
    # Assembly

    def assembly(
        self, name: str, fixed: list[int], axis: FloatArray, origin: FloatArray
    ) -> Assembly:
        """Blocks with their faces; those that are alike share a shape."""
        shapes: dict[tuple[int, bytes], Block] = {}
        keys = []
        for block, faces in enumerate(self.faces):
            solid = self.solid(block)
            key = id(solid), b"|".join(f.encode() + faces[f].tobytes() for f in sorted(faces))
            keys.append(key)
            if key not in shapes:
                alike = sum(shape.mesh is solid.mesh for shape in shapes.values())
                shapes[key] = Block(
                    f"{solid.name}-{alike + 1}" if alike else solid.name,
                    solid.mesh,
                    {SURFACE: solid.outer}
                    | {face: solid.outer[rows] for face, rows in faces.items()},
                    (CONTACT,) if CONTACT in faces else (),
                    solid.curve,
                    tetrahedra=solid.tetrahedra,
                )
        order = {key: k for k, key in enumerate(shapes)}
        held = np.zeros(len(keys), dtype=np.bool_)
        held[fixed] = True
        instances = [self.instance(block) for block in range(len(keys))]
        return Assembly(
            name=name,
            shapes=tuple(shapes.values()),
            shape_of=np.array([order[key] for key in keys], dtype=np.int64),
            rotations=np.array([one.rotation for one in instances]),
            translations=np.array([one.translation for one in instances]),
            fixed=held,
            layer=np.where(held, 0, 1),
            axis=axis,
            origin=origin,
            names=tuple(self.name(block) for block in range(len(keys))),
            unmatched_allowed=True,
            unmatched=(),
        )
