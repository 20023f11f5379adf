"""Blocks that were filled with tetrahedra: in decks as these, of ten nodes.

tubelock splits each tetrahedron into four hexahedra; other programs have good tetrahedra.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.decks.keywords import DeckError
from fem.decks.meshes import TetrahedralMesh, tetrahedral_block
from fem.decks.model import as_nodal_forces, nodal_forces
from fem.decks.statement import Deck, DeckLoad, Flavour, Hold, NodalForceLoad
from geometry.assembly import Assembly
from geometry.loads import PressureLoad
from geometry.mesh import IntArray


def has_tetrahedra(assembly: Assembly) -> bool:
    """Whether some block was filled with tetrahedra."""
    return any(shape.tetrahedra is not None for shape in assembly.shapes)


def with_tetrahedra(deck: Deck) -> tuple[Deck, list[str]]:
    """Deck with the tetrahedra of blocks that were filled with them, and notes.

    Raises
    ------
    DeckError
        Springs below them: quadratic tetrahedra have no forces at corners under a pressure.
    """
    assembly = deck.assembly
    if not has_tetrahedra(assembly):
        return deck, []
    shapes = tuple(
        shape if shape.tetrahedra is None else tetrahedral_block(shape) for shape in assembly.shapes
    )
    changed = replace(assembly, shapes=shapes)
    if any(_mesh(changed, spring.block) for spring in deck.springs):
        raise DeckError(
            "support: got springs below blocks of tetrahedra, whose corners have no share of a "
            "pressure; expected a file of hexahedra (.vtu, .inp), or a support without stiffness"
        )
    loads = tuple(_load(deck, load, changed) for load in deck.loads)
    holds = tuple(_hold(hold, changed) for hold in deck.holds)
    name = "C3D10M" if deck.flavour is Flavour.GENERAL else "C3D10"
    note = (
        f"elements: {name}, the tetrahedra of gmsh; tubelock's answer has other elements: it "
        "splits each into four hexahedra"
    )
    return replace(deck, assembly=changed, loads=loads, holds=holds), [note]


def _mesh(assembly: Assembly, block: int) -> TetrahedralMesh | None:
    mesh = assembly.shape(block).mesh
    return mesh if isinstance(mesh, TetrahedralMesh) else None


def _load(deck: Deck, load: DeckLoad, changed: Assembly) -> DeckLoad:
    """Forces on nodes, and what is written as such, on the nodes of tetrahedra."""
    written = deck.flavour is Flavour.CALCULIX and not isinstance(load, PressureLoad)
    if written:
        load = as_nodal_forces(deck, load)
    if not isinstance(load, NodalForceLoad):
        return load
    blocks: list[IntArray] = []
    nodes, forces = [], []
    for block in np.unique(load.blocks).tolist():
        force, mesh = nodal_forces(deck, load, block), _mesh(changed, block)
        force = force if mesh is None else mesh.on_tetrahedra(force)
        where = np.flatnonzero(force.any(axis=1))
        blocks.append(np.full(len(where), block))
        nodes.append(where)
        forces.append(force[where])
    return NodalForceLoad(np.concatenate(blocks), np.concatenate(nodes), np.concatenate(forces))


def _hold(hold: Hold, changed: Assembly) -> Hold:
    mesh = _mesh(changed, hold.block)
    if mesh is None or hold.nodes is None:
        return hold
    return replace(hold, nodes=tuple(mesh.renumbered(np.array(hold.nodes)).tolist()))
