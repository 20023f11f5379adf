"""Faces of blocks as element faces, and the patches on which two blocks meet.

Deck programs name a facet by its element and one of six face labels. Abaqus, CalculiX and this
package number the corners of a hexahedron alike; `HEX_FACES` lists the faces in the order S1 to
S6 of Abaqus' C3D8.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, chain

import numpy as np

from fem.contact.search import FacingPoints
from fem.decks.deck import Deck
from fem.decks.keywords import DeckError, label
from fem.system.contact_state import block_surface
from geometry.block import Block
from geometry.mesh import HEX_FACES, IntArray


@dataclass(frozen=True)
class ElementFaces:
    """Facets as element faces."""

    elements: IntArray
    """Element of each facet, from 0, (n,)."""
    sides: IntArray
    """Row of `HEX_FACES`, side S1 being 0, (n,)."""

    def select(self, positions: IntArray) -> ElementFaces:
        """Keep some facets."""
        return ElementFaces(self.elements[positions], self.sides[positions])


def element_faces(block: Block, quads: IntArray) -> ElementFaces:
    """Find the element and side of boundary facets.

    Raises
    ------
    DeckError
        A facet that is no element face, or that faces inward.
    """
    elements = block.mesh.elements
    every = elements[:, HEX_FACES].reshape(-1, 4)
    joined = np.sort(np.concatenate([every, quads]), axis=1)
    _, key = np.unique(joined, axis=0, return_inverse=True)
    key = key.ravel()
    place = np.full(int(key.max()) + 1, -1, dtype=np.int64)
    place[key[: len(every)]] = np.arange(len(every))
    result = place[key[len(every) :]]
    if (result < 0).any():
        bad = int(np.flatnonzero(result < 0)[0])
        raise DeckError(f"{block.name}: facet {quads[bad].tolist()} is no face of an element")
    # Counter-clockwise from outside: the facet's second corner follows its first on the face.
    corners = every[result]
    first = (corners == quads[:, :1]).argmax(axis=1)
    follows = corners[np.arange(len(result)), (first + 1) % 4] == quads[:, 1]
    if not follows.all():
        bad = int(np.flatnonzero(~follows)[0])
        raise DeckError(f"{block.name}: facet {quads[bad].tolist()} faces inward")
    return ElementFaces(result // 6, result % 6)


@dataclass(frozen=True)
class Patch:
    """Part of a face that meets one face of one neighbour."""

    label: str
    """Name of its surface: that of the face where the patch is all of it."""
    face: str
    """Face it lies on."""
    positions: IntArray
    """Facets of the face, ascending, (n,)."""


@dataclass(frozen=True)
class PatchPair:
    """Two patches that meet."""

    block_m: int
    """Master block."""
    patch_m: str
    """Label of its patch."""
    block_s: int
    """Opposing (slave) block."""
    patch_s: str
    """Label of its patch."""


@dataclass(frozen=True)
class Patches:
    """All patches of an assembly."""

    of_shape: tuple[tuple[Patch, ...], ...]
    """Patches of each shape that are not whole faces, in the order of their labels."""
    pairs: tuple[PatchPair, ...]
    """Pairs in the order of the interfaces."""


def contact_patches(deck: Deck) -> Patches:
    """Patches on which blocks of a deck meet; pairs of which both blocks are held are left out.

    Congruent blocks meet their neighbours alike, so a shape has few distinct patches. Where facets
    do not match, whole faces meet: those that face each other somewhere.
    """
    if deck.searched:
        return Patches(tuple(() for _ in deck.assembly.shapes), tuple(facing_faces(deck)))
    assembly, result = deck.assembly, deck.assembly.interfaces
    sizes = [[len(shape.faces[name]) for name in shape.contact_faces] for shape in assembly.shapes]
    # Face and position in it of each contact facet, the facets of all shapes one after the other.
    of = np.repeat([k for shape in sizes for k in range(len(shape))], [*chain(*sizes)]).astype(int)
    place = np.array([k for shape in sizes for size in shape for k in range(size)], dtype=np.int64)
    start = np.array([0, *accumulate(map(sum, sizes))])[assembly.shape_of]
    at_m = start[result.block_m] + result.facet_m
    at_s = start[result.block_s] + result.facet_s
    held = ~deck.problem.deforming
    key = np.column_stack([result.block_m, result.block_s, of[at_m], of[at_s]])
    keep = np.flatnonzero(~(held[result.block_m] & held[result.block_s]))
    bodies, which = np.unique(key[keep], axis=0, return_inverse=True)
    known: list[dict[tuple[str, bytes], Patch]] = [{} for _ in assembly.shapes]

    def named(block: int, face: int, positions: IntArray) -> str:
        """Label of a patch: the same facets of the same shape get the same label."""
        number = int(assembly.shape_of[block])
        name = assembly.shapes[number].contact_faces[face]
        if len(positions) == sizes[number][face]:
            return label(name)
        count = 1 + sum(patch.face == name for patch in known[number].values())
        patch = Patch(f"{label(name)}-PATCH-{count}", name, positions)
        return known[number].setdefault((name, positions.tobytes()), patch).label

    pairs = []
    for number, (m, s, f_m, f_s) in enumerate(bodies.tolist()):
        mine = keep[which.ravel() == number]
        patch_m = named(m, f_m, np.sort(place[at_m[mine]]))
        pairs.append(PatchPair(m, patch_m, s, named(s, f_s, np.sort(place[at_s[mine]]))))
    return Patches(tuple(tuple(patches.values()) for patches in known), tuple(pairs))


def facing_faces(deck: Deck) -> list[PatchPair]:
    """Faces of two blocks that face each other; the slave is the one of the smaller facets."""
    assembly = deck.assembly
    surfaces = tuple(
        block_surface(assembly, block, deck.offsets[block])
        for block in range(assembly.n_blocks)
        if len(assembly.shape(block).contact_quads)
    )
    points = FacingPoints(surfaces, reach=deck.problem.spacing)
    names = [
        [name for name in shape.contact_faces for _ in shape.faces[name]]
        for shape in assembly.shapes
    ]
    face_of = [label(n) for s in surfaces for n in names[int(assembly.shape_of[s.block])]]
    deforms, block_of = deck.problem.deforming, points.facet_block.tolist()
    facing = np.unique(np.column_stack([points.now.facet, points.now.slave]), axis=0).tolist()
    pairs = dict.fromkeys(
        PatchPair(block_of[m], face_of[m], block_of[s], face_of[s]) for m, s in facing
    )
    return [pair for pair in pairs if deforms[pair.block_m] or deforms[pair.block_s]]


def half_facet_angle(shape: Block, face: str) -> float:
    """Half the largest angle between normals of facets that share an edge [rad]."""
    surface = shape.surface(face)
    edges = np.sort(np.concatenate([surface.quads[:, [i, (i + 1) % 4]] for i in range(4)]), axis=1)
    owner = np.tile(np.arange(surface.n_facets), 4)
    _, which, count = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(which.ravel(), kind="stable")
    start = np.concatenate([[0], np.cumsum(count)])[:-1][count == 2]
    first, second = owner[order[start]], owner[order[start + 1]]
    cosine = np.einsum("ij,ij->i", surface.normals[first], surface.normals[second])
    return float(0.5 * np.arccos(np.clip(cosine, -1.0, 1.0)).max(initial=0.0))
