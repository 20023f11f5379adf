"""Names that the parts of a deck refer to each other by, and what no deck can express."""

from __future__ import annotations

from collections.abc import Mapping

from fem.decks.keywords import DeckError
from fem.decks.statement import BodyForceLoad, Deck, NodalForceLoad
from fem.element.hexahedron import ELEMENTS, ElementType
from fem.element.lagrange_mesh import SerendipityMesh

#: Abaqus' name of each element that has one.
ELEMENT_NAMES = {kind: found.abaqus for kind, found in ELEMENTS.items() if found.abaqus}


ALL = "ALL"


CONTACT = "CONTACT"


MATERIAL = "BLOCK-MATERIAL"


JOINT = "JOINT"


LOADING = "LOADING"


CYLINDRICAL = "TUBE-AXIS"


HOURGLASS = "HOURGLASS"


def element_name(deck: Deck, elements: Mapping[ElementType, str]) -> str:
    """Name of the hexahedra of a deck: by their nodes, those of eight by their kind."""
    twenty = isinstance(deck.assembly.shapes[0].mesh, SerendipityMesh)
    return "C3D20" if twenty else elements[deck.element]


def block_label(deck: Deck, block: int) -> str:
    """Name of the instance of a block."""
    digits = max(3, len(str(deck.assembly.n_blocks - 1)))
    return f"BLOCK-{block:0{digits}d}"


def check_deck(deck: Deck, elements: Mapping[ElementType, str] = ELEMENT_NAMES) -> None:
    """Refuse what no deck can express, and elements that the program does not have.

    Raises
    ------
    DeckError
        By name.
    """
    if deck.element not in elements:
        raise DeckError(
            f"fem.element: got {deck.element.value!r}, which a deck of flavour {deck.flavour} has "
            "no name for (C3D8 averages the dilatation in Abaqus, not in CalculiX); expected one "
            f"of {', '.join(repr(e.value) for e in elements)}"
        )
    _check_references(deck)
    for hold in deck.holds:
        first, last = hold.components[0], hold.components[-1]
        if hold.components != tuple(range(first, last + 1)):
            raise DeckError(f"support of block {hold.block}: components are not consecutive")
    if deck.effects.adaptive_mass_damping is not None:
        raise DeckError(
            "fem.damping: adaptive mass damping is a device of this program; expected "
            "constant Rayleigh damping in a deck"
        )


def _check_references(deck: Deck) -> None:
    """Refuse supports and loads on faces or nodes that a block does not have."""
    shape = deck.assembly.shape
    named = [(hold.block, hold.face) for hold in deck.holds if hold.face is not None]
    for load in deck.loads:
        if isinstance(load, NodalForceLoad):
            for block, node in zip(load.blocks.tolist(), load.nodes.tolist(), strict=True):
                if not 0 <= node < shape(block).mesh.n_nodes:
                    raise DeckError(f"load: block {block} has no node {node + 1}")
        elif not isinstance(load, BodyForceLoad):
            named += [(block, load.face) for block in load.blocks.tolist()]
    for block, face in named:
        if face not in shape(block).faces:
            raise DeckError(
                f"block {block} ({shape(block).name}) has no face {face!r}; expected one of "
                f"{', '.join(shape(block).faces)}"
            )
