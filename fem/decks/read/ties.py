"""Tied surfaces whose nodes coincide: what they tie is one block."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from fem.decks.keywords import DeckError
from fem.decks.read.bodies import Blocks
from fem.decks.read.cards import Card
from fem.decks.read.elements import VOLUMES
from fem.decks.read.model import ModelLines
from geometry.mesh import IntArray

#: Nodes coincide where they are nearer than this, relative to the size of the surface.
_NEAR = 1e-6
#: Elements without nodes between corners.
_STRAIGHT = {4, 8}


def unite_tied(blocks: Blocks, model: ModelLines) -> bool:
    """Give the nodes of tied surfaces one place in their part; whether there are any.

    Raises
    ------
    DeckError
        Naming the line: surfaces of several instances, of elements with nodes between corners, or
        with nodes that do not coincide.
    """
    cards = [card for card in model.other if card.keyword == "TIE"]
    for card in cards:
        for line, row in card.rows():
            if len(row) != 2:
                raise DeckError(
                    f"{card.at(line)}: got {', '.join(row)}; expected two surfaces, the dependent "
                    "one first"
                )
            _unite(blocks, card, line, row)
            model.note("ties: blocks whose tied nodes coincide are one block")
    return bool(cards)


def _unite(blocks: Blocks, card: Card, line: int, names: list[str]) -> None:
    (of, tied), (other, kept) = (_nodes(blocks, card, line, name) for name in names)
    instance = blocks.places.instances[of]
    part = instance.part
    alone = sum(one.part is part for one in blocks.places.instances) == 1
    if of < 0 or of != other or not alone or VOLUMES.get(part.kind) not in _STRAIGHT:
        raise DeckError(
            f"{card.at(line)}: *Tie is covered between surfaces of one instance, the only one of "
            "its part, with elements of 4 or 8 nodes; expected that, or one mesh for both"
        )
    places = part.nodes
    apart, nearest = map(np.asarray, cKDTree(places[kept]).query(places[tied]))
    if apart.max() > _NEAR * np.ptp(places[tied], axis=0).max():
        raise DeckError(
            f"{card.at(line)}: a node of {names[0]} is {apart.max():.3g} mm from the nearest one "
            f"of {names[1]}; expected nodes that coincide, or one mesh for both"
        )
    moved = dict(zip(tied.tolist(), kept[nearest].tolist(), strict=True))
    part.index.update({label: moved.get(at, at) for label, at in part.index.items()})


def _nodes(blocks: Blocks, card: Card, line: int, name: str) -> tuple[int, IntArray]:
    """Instance of a surface, -1: of several, and its part's nodes at corners of elements."""
    facets = blocks.surface(card, line, name)
    instances = {blocks.owners[block][0] for block in facets}
    solids = [(blocks.solid(block), rows) for block, rows in facets.items()]
    nodes = np.unique(np.concatenate([s.nodes[s.outer[rows].ravel()] for s, rows in solids]))
    if len(instances) > 1:
        return -1, nodes
    (instance,) = instances
    # Those behind are made where tetrahedra are split.
    return instance, nodes[nodes < len(blocks.places.instances[instance].part.places)]
