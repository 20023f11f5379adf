"""Rigid surfaces as thin solids behind them: R3D3 and R3D4, whose one side meets other blocks."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fem.decks.keywords import DeckError
from fem.decks.read.cards import Card
from fem.decks.read.elements import Hexahedra, middles
from fem.decks.read.mesh import Part
from geometry.mesh import FloatArray, IntArray

#: Thickness of the solids, in the shortest edge of a facet.
_THICKNESS = 0.05
#: Cosine of the angle between a facet and the mean normal at its nodes, at least.
_FLATTEST = 0.05


def side_number(card: Card, line: int, side: str, positive: bool) -> int:
    """Position of a side of a rigid surface: 0, the one that meets others.

    Raises
    ------
    DeckError
        The other side, or a name that is none.
    """
    outer = "SPOS" if positive else "SNEG"
    if side not in {"", outer}:
        raise DeckError(
            f"{card.at(line)}: got side {side!r} of a rigid surface; expected {outer}, the outer "
            "side, or the one side that all surfaces name"
        )
    return 0


def behind_surface(part: Part, facets: IntArray, stated: frozenset[str]) -> Hexahedra:
    """Hexahedra behind the side of a rigid surface that meets other blocks.

    Triangles are split into three quadrilaterals, quadrilaterals into four, so that both match.
    The side is the outer one of closed surfaces, the stated one of others.

    Parameters
    ----------
    part
        The part.
    facets
        Its facets, (n, 4); of triangles the last node twice.
    stated
        Sides that the deck names: SPOS, SNEG.

    Raises
    ------
    DeckError
        An open surface of which both sides or none are named, facets that do not go round the same
        way, or that fold too sharply.
    """
    positive = _positive(part, facets, stated)
    ends = np.sort(np.stack([facets, np.roll(facets, -1, axis=1)], axis=2), axis=2)
    nodes, edges = middles(part.nodes, ends, None)
    triangle = facets[:, 2] == facets[:, 3]
    corners = nodes[facets]
    centre = np.where(triangle[:, None], corners[:, :3].mean(axis=1), corners.mean(axis=1))
    middle = len(nodes) + np.arange(len(facets))
    nodes = np.concatenate([nodes, centre])
    quads = np.stack(
        [facets, edges, np.tile(middle[:, None], 4), np.roll(edges, 1, axis=1)], axis=2
    )
    quads[triangle, 2] = np.column_stack([facets[:, 2], edges[:, 3], middle, edges[:, 1]])[triangle]
    quads[triangle, 3] = quads[triangle, 2]
    outer = quads if positive else quads[:, :, ::-1]
    used = np.ones(quads.shape[:2], dtype=np.bool_)
    used[triangle, 3] = False
    top = outer[used]
    fan = _fans(top)
    inner = _inwards(part, nodes, top, fan)
    return Hexahedra(
        np.concatenate([nodes, inner]),
        np.concatenate([fan + len(nodes), top], axis=1),
        np.repeat(np.arange(len(facets)), used.sum(axis=1)),
        outer[:, None],
        positive,
    )


def _fans(quads: IntArray) -> IntArray:
    """Number of the fan of each corner: facets around a node that share edges, (n, 4).

    Where parts of a surface touch at a node alone, it has a fan for each.
    """
    corner = np.arange(quads.size).reshape(quads.shape)
    ahead, following = np.roll(quads, -1, axis=1), np.roll(corner, -1, axis=1)
    low, high = np.minimum(quads, ahead), np.maximum(quads, ahead)
    # Corners of an edge at its lower node, then at the higher one.
    ends = np.stack(
        [np.where(quads < ahead, corner, following), np.where(quads < ahead, following, corner)]
    ).reshape(2, -1)
    order = np.lexsort((high.ravel(), low.ravel()))
    edges = np.column_stack([low.ravel(), high.ravel()])[order]
    same = (edges[1:] == edges[:-1]).all(axis=1)
    pairs = ends[:, order]
    rows, columns = pairs[:, :-1][:, same].ravel(), pairs[:, 1:][:, same].ravel()
    graph = coo_array((np.ones(len(rows)), (rows, columns)), (quads.size, quads.size))
    _, label = connected_components(graph, directed=False)
    return np.asarray(label.reshape(quads.shape), dtype=np.int64)


def _inwards(part: Part, nodes: FloatArray, quads: IntArray, fan: IntArray) -> FloatArray:
    """Node of each fan, moved behind the surface by its thickness, (n_fans, 3) [mm]."""
    corners = nodes[quads]
    areas = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals = areas / np.linalg.norm(areas, axis=1, keepdims=True)
    at = np.zeros((int(fan.max()) + 1, 3))
    np.add.at(at, fan, np.tile(normals[:, None], (1, 4, 1)))
    at /= np.linalg.norm(at, axis=1, keepdims=True)
    if not np.einsum("qki,qi->qk", at[fan], normals).min() > _FLATTEST:
        raise DeckError(
            f"{part.kind_at}: facets of the rigid surface fold to a point, or do not go round the "
            "same way; expected a smoother surface with one normal"
        )
    place = np.zeros_like(at)
    place[fan] = corners
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return place - _THICKNESS * float(edges.min()) * at


def _positive(part: Part, facets: IntArray, stated: frozenset[str]) -> bool:
    """Whether the positive side of a surface meets other blocks."""
    turned = np.stack([facets, np.roll(facets, -1, axis=1)], axis=2).reshape(-1, 2)
    turned = turned[turned[:, 0] != turned[:, 1]]
    n = len(part.places)
    forward = np.sort(turned[:, 0] * n + turned[:, 1])
    backward = np.sort(turned[:, 1] * n + turned[:, 0])
    closed = np.array_equal(forward, backward) and len(np.unique(forward)) == len(forward)
    if not closed:
        if len(stated) != 1:
            raise DeckError(
                f"{part.kind_at}: the rigid surface is open and "
                + ("both of its sides meet blocks" if stated else "no *Surface names its side")
                + "; expected surfaces on SPOS or on SNEG, or a closed surface"
            )
        return stated == {"SPOS"}
    _, label = connected_components(
        coo_array((np.ones(len(turned)), (turned[:, 0], turned[:, 1])), (n, n)), directed=False
    )
    corners = part.nodes[facets]
    area = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    volume = np.bincount(label[facets[:, 0]], np.einsum("ni,ni->n", corners[:, 0], area))
    signs = np.sign(volume[np.unique(label[facets[:, 0]])])
    if len(set(signs.tolist())) != 1:
        raise DeckError(
            f"{part.kind_at}: closed rigid surfaces have normals to the inside and to the outside; "
            "expected them all to one side"
        )
    return bool(signs[0] > 0)
