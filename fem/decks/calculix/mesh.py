"""The flat mesh of a CalculiX deck: nodes, elements, sets and surfaces of all blocks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fem.decks.abaqus.deck import surface_lines
from fem.decks.faces import ElementFaces, Patches, element_faces
from fem.decks.keywords import element_lines, entry_lines, keyword, label, node_lines
from fem.decks.model import block_nodes
from fem.decks.names import block_label, element_name
from fem.decks.statement import Deck, Hold
from fem.element.hexahedron import ELEMENTS
from geometry.loads.case import PressureLoad
from geometry.mesh import BoolArray

#: CalculiX' name of each element that has one.
CALCULIX_ELEMENTS = {kind: found.calculix for kind, found in ELEMENTS.items() if found.calculix}


EVERY_NODE = "NALL"


EVERY_ELEMENT = "EALL"


class Starts:
    """First node and element of each block in the flat numbering, from 0."""

    def __init__(self, deck: Deck) -> None:
        shapes = [deck.assembly.shape(b).mesh for b in range(deck.assembly.n_blocks)]
        self.node = _running([mesh.n_nodes for mesh in shapes])
        self.element = _running([mesh.n_elements for mesh in shapes])


def _running(counts: list[int]) -> list[int]:
    return [0, *np.cumsum(counts).tolist()]


def mesh_lines(deck: Deck, starts: Starts) -> Iterator[str]:
    """Nodes of all blocks in world coordinates, elements block by block, sets of blocks."""
    assembly = deck.assembly
    yield keyword("Node", nset=EVERY_NODE)
    for block in range(assembly.n_blocks):
        yield from node_lines(block_nodes(deck, block) + 0.0, starts.node[block] + 1)
    for block in range(assembly.n_blocks):
        name = block_label(deck, block)
        yield keyword("Element", type=element_name(deck, CALCULIX_ELEMENTS), elset=name)
        first = starts.element[block] + 1, starts.node[block] + 1
        yield from element_lines(assembly.shape(block).mesh.connectivity, *first)
    yield keyword("Elset", elset=EVERY_ELEMENT, generate=None)
    yield f"1, {starts.element[-1]}, 1"
    for layer in np.unique(assembly.layer).tolist():
        yield from _block_set(deck, f"LAYER-{layer:02d}", assembly.layer == layer, starts)
    if assembly.fixed.any():
        yield from _block_set(deck, "FRAME", assembly.fixed, starts)


def _block_set(deck: Deck, name: str, chosen: BoolArray, starts: Starts) -> Iterator[str]:
    """Elements of some blocks: a range where the blocks follow each other, else a set of sets.

    Ranges are what every reader understands.
    """
    blocks = np.flatnonzero(chosen).tolist()
    if blocks == list(range(blocks[0], blocks[-1] + 1)):
        yield keyword("Elset", elset=name, generate=None)
        yield f"{starts.element[blocks[0]] + 1}, {starts.element[blocks[-1] + 1]}, 1"
    else:
        yield keyword("Elset", elset=name)
        yield from entry_lines(block_label(deck, block) for block in blocks)


def held_name(deck: Deck, hold: Hold) -> str:
    """Name of the set of nodes that a support holds."""
    nodes = "ALL" if hold.face is None else f"{label(hold.face)}-NODES"
    return f"{block_label(deck, hold.block)}_{nodes}"


def held_set_lines(deck: Deck, starts: Starts) -> Iterator[str]:
    """Sets of held nodes."""
    written = set()
    for hold in deck.holds:
        name = held_name(deck, hold)
        if name in written:
            continue
        written.add(name)
        first, end = starts.node[hold.block], starts.node[hold.block + 1]
        if hold.face is None:
            yield keyword("Nset", nset=name, generate=None)
            yield f"{first + 1}, {end}, 1"
        else:
            yield keyword("Nset", nset=name)
            shape = deck.assembly.shape(hold.block)
            held = shape.mesh.facet_nodes(shape.faces[hold.face])
            yield from entry_lines(np.unique(held) + first + 1)


def flat_surface_lines(deck: Deck, starts: Starts, patches: Patches | None) -> Iterator[str]:
    """Surfaces that pressures and contact pairs name."""
    assembly = deck.assembly
    known = [_shape_surfaces(deck, number, patches) for number in range(len(assembly.shapes))]
    for block, needed in enumerate(_needed_surfaces(deck, patches)):
        for name, faces in known[int(assembly.shape_of[block])].items():
            if name in needed:
                yield from surface_lines(
                    name,
                    faces,
                    prefix=f"{block_label(deck, block)}_",
                    first_element=starts.element[block] + 1,
                )


def _shape_surfaces(deck: Deck, number: int, patches: Patches | None) -> dict[str, ElementFaces]:
    """All surfaces that blocks of one shape can have."""
    shape = deck.assembly.shapes[number]
    whole = {name: element_faces(shape, quads) for name, quads in shape.faces.items()}
    surfaces = {label(name): faces for name, faces in whole.items()}
    for patch in () if patches is None else patches.of_shape[number]:
        surfaces[patch.label] = whole[patch.face].select(patch.positions)
    return surfaces


def _needed_surfaces(deck: Deck, patches: Patches | None) -> list[set[str]]:
    """Labels of the surfaces of each block that the deck names."""
    needed: list[set[str]] = [set() for _ in range(deck.assembly.n_blocks)]
    for load in deck.loads:
        if isinstance(load, PressureLoad):
            for block in load.blocks.tolist():
                needed[block].add(label(load.face))
    for pair in () if patches is None else patches.pairs:
        needed[pair.block_m].add(pair.patch_m)
        needed[pair.block_s].add(pair.patch_s)
    return needed
