"""Write a deck for Abaqus: heading, parts and instances; model data and step from beside.

Reference: Abaqus Keywords Reference Guide.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from fem.decks.abaqus.model import boundary_lines, model_lines
from fem.decks.abaqus.step import step_lines
from fem.decks.faces import ElementFaces, Patches, contact_patches, element_faces
from fem.decks.keywords import (
    DeckError,
    element_lines,
    entry_lines,
    keyword,
    label,
    node_lines,
    real,
    reals,
)
from fem.decks.laws import law_heading
from fem.decks.names import (
    ALL,
    CONTACT,
    CYLINDRICAL,
    ELEMENT_NAMES,
    HOURGLASS,
    MATERIAL,
    block_label,
    check_deck,
    element_name,
)
from fem.decks.placement import placement_rows
from fem.decks.statement import Deck, Flavour, Procedure
from fem.element.hexahedron import ElementType
from geometry.block import Block
from geometry.loads.case import CircumferentialLoad
from geometry.mesh import IntArray


def abaqus_lines(deck: Deck) -> Iterator[str]:
    """Lines of a deck with parts and instances (flavours general and pairs).

    Parameters
    ----------
    deck
        The problem; its assembly must be canonical (`fem.decks.placement.canonical`).

    Raises
    ------
    DeckError
        What Abaqus has no words for, by name.
    """
    check_abaqus(deck)
    patches = contact_patches(deck) if _has_pairs(deck) else None
    yield from heading_lines(deck)
    for number, shape in enumerate(deck.assembly.shapes):
        yield from _part(deck, number, shape, patches)
    yield from _assembly(deck)
    yield from model_lines(deck)
    yield from boundary_lines(deck)
    yield from step_lines(deck, patches)


def check_abaqus(deck: Deck) -> None:
    """Refuse what Abaqus cannot express.

    Raises
    ------
    DeckError
        By name.
    """
    check_deck(deck)
    static = deck.step.procedure is Procedure.STATIC
    small = deck.joint is not None and not (deck.joint.finite_sliding or deck.searched)
    if deck.clearance != 0.0 and not (deck.flavour is Flavour.PAIRS and static and small):
        raise DeckError(
            f"contact.clearance: got {deck.clearance:g} mm, a gap along every normal, which Abaqus "
            "prescribes for pairs of small sliding in a static step alone (*Clearance); expected "
            "contact.spacing, flavour pairs with fem.method=static, or flavour calculix"
        )


def _has_pairs(deck: Deck) -> bool:
    return deck.joint is not None and deck.flavour is Flavour.PAIRS


# ---------------------------------------------------------------------------------------------
# Heading


def program_version() -> str:
    """Return the version that is written into headings."""
    try:
        return version("tubelock")
    except PackageNotFoundError:
        return "0"


def heading_lines(deck: Deck) -> Iterator[str]:
    """Heading with provenance and what no keyword says; `fem.decks.read.deck` reads it."""
    assembly = deck.assembly
    name = deck.name.encode("ascii", "replace").decode().replace("\n", " ")[:80]
    yield "*Heading"
    yield f"tubelock {program_version()}, scene {name}"
    yield f"flavour: {deck.flavour}"
    yield "units: mm, N, MPa, s, t (density in t/mm3)"
    yield f"axis: {reals(assembly.axis)} through {reals(assembly.origin)}"
    yield f"open faces: {'allowed' if assembly.unmatched_allowed else 'none'}"
    if deck.searched:
        yield "joints: faces that do not match"
    told = None if deck.joint is None else law_heading(deck.joint.law)
    if told is not None:
        yield told
    yield f"clearance along every normal: {real(deck.clearance)}"
    yield f"spacing of the blocks: {real(deck.spacing)}"
    if deck.spacing != 0.0:
        for block in range(assembly.n_blocks):
            place = reals(assembly.translations[block])
            yield f"place without spacing: {block_label(deck, block)} {place}"
    for note in deck.notes:
        yield f"note: {note}"


# ---------------------------------------------------------------------------------------------
# Parts and instances


def _part(deck: Deck, number: int, shape: Block, patches: Patches | None) -> Iterator[str]:
    mesh = shape.mesh
    yield "**"
    yield f"** {shape.name}: {np.count_nonzero(deck.assembly.shape_of == number)} instances"
    yield keyword("Part", name=label(shape.name))
    yield keyword("Node")
    yield from node_lines(mesh.nodes + 0.0)
    yield keyword("Element", type=element_name(deck, ELEMENT_NAMES))
    yield from element_lines(mesh.connectivity)
    yield keyword("Nset", nset=ALL, generate=None)
    yield f"1, {mesh.n_nodes}, 1"
    yield keyword("Elset", elset=ALL, generate=None)
    yield f"1, {mesh.n_elements}, 1"
    faces = {name: element_faces(shape, quads) for name, quads in shape.faces.items()}
    for name, facets in faces.items():
        yield from surface_lines(label(name), facets)
    if shape.contact_faces:
        yield keyword("Surface", type="ELEMENT", name=CONTACT)
        for name in shape.contact_faces:
            yield from _surface_members(label(name), faces[name])
    if patches is not None:
        for patch in patches.of_shape[number]:
            yield from surface_lines(patch.label, faces[patch.face].select(patch.positions))
    for name in _held_faces(deck, number):
        yield keyword("Nset", nset=f"{label(name)}-NODES")
        yield from entry_lines(np.unique(mesh.facet_nodes(shape.faces[name])) + 1)
    yield from _section(deck)
    yield keyword("End Part")


def surface_lines(
    name: str, faces: ElementFaces, *, prefix: str = "", first_element: int = 1
) -> Iterator[str]:
    """Element sets of a surface, one for each side, and the surface itself."""
    for side in np.unique(faces.sides).tolist():
        yield keyword("Elset", elset=f"{prefix}{name}-S{side + 1}")
        yield from entry_lines((faces.elements[faces.sides == side] + first_element).tolist())
    yield keyword("Surface", type="ELEMENT", name=f"{prefix}{name}")
    yield from _surface_members(name, faces, prefix=prefix)


def _surface_members(name: str, faces: ElementFaces, *, prefix: str = "") -> Iterator[str]:
    for side in np.unique(faces.sides).tolist():
        yield f"{prefix}{name}-S{side + 1}, S{side + 1}"


def _held_faces(deck: Deck, number: int) -> list[str]:
    """Faces of a shape whose nodes are held on some block, in the order of the shape's faces."""
    held = {h.face for h in deck.holds if int(deck.assembly.shape_of[h.block]) == number}
    return [name for name in deck.assembly.shapes[number].faces if name in held]


def _section(deck: Deck) -> Iterator[str]:
    controls = {"controls": HOURGLASS} if deck.element is ElementType.REDUCED else {}
    yield keyword("Solid Section", elset=ALL, material=MATERIAL, **controls)
    yield ","


def _assembly(deck: Deck) -> Iterator[str]:
    assembly = deck.assembly
    places = assembly.translations + deck.offsets
    yield "**"
    yield keyword("Assembly", name=label(assembly.name))
    for block in range(assembly.n_blocks):
        part = label(assembly.shape(block).name)
        yield keyword("Instance", name=block_label(deck, block), part=part)
        for row in placement_rows(assembly.rotations[block], places[block]):
            yield reals(row)
        yield keyword("End Instance")
    for layer in np.unique(assembly.layer).tolist():
        yield keyword("Elset", elset=f"LAYER-{layer:02d}")
        yield from _members(deck, np.flatnonzero(assembly.layer == layer))
    if assembly.fixed.any():
        yield keyword("Elset", elset="FRAME")
        yield from _members(deck, np.flatnonzero(assembly.fixed))
    if any(isinstance(load, CircumferentialLoad) for load in deck.loads):
        yield keyword("Orientation", name=CYLINDRICAL, system="CYLINDRICAL")
        yield reals([*assembly.origin, *(assembly.origin + assembly.axis)])
    yield keyword("End Assembly")


def _members(deck: Deck, blocks: IntArray) -> Iterator[str]:
    """All elements (or nodes) of some blocks."""
    return entry_lines(f"{block_label(deck, block)}.{ALL}" for block in blocks.tolist())
