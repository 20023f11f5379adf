"""Which triangles bound one solid, where several solids touch along faces, edges and corners.

Two triangles that share an edge with no others belong together. Round an edge with more, matter
and void alternate: a triangle belongs to the one across the matter between them, so that solids
that share an edge, a corner or a whole face come apart, and one that touches itself does not.
"""

from __future__ import annotations

import numpy as np

from geometry.mesh import BoolArray, FloatArray, IntArray, MeshError, connected_parts
from geometry.polyhedra.near.triangle_search import (
    distinct_rows,
    in_one_piece,
    joined,
    undirected_edges,
)

#: Faces within this angle round their edge lie on each other [rad].
_SAME_PLACE = 1e-3


def closed_solids(name: str, points: FloatArray, triangles: IntArray) -> list[IntArray]:
    """Triangles of each solid, in the order of their first triangles.

    A closed surface inside another one and turned the other way is a cavity of that solid.

    Parameters
    ----------
    name
        What messages call the surface.
    points, triangles
        Coinciding points merged, (n_points, 3) and (n_triangles, 3).

    Raises
    ------
    MeshError
        For triangles that lie on each other, facing the same way.
    """
    if in_one_piece(triangles):
        volume = _six_volumes(points[triangles] - points.mean(axis=0)).sum()
        return [triangles if volume >= 0.0 else triangles[:, ::-1]]
    outward, turned = _turned_outward(points, triangles)
    label = connected_parts(len(triangles), *across_matter(name, points, outward).T)
    _, first = np.unique(label, return_index=True)
    first = np.sort(first)
    solids = [outward[label == label[k]] for k in first]
    return with_cavities(points, solids, turned[first])


def one_solid(points: FloatArray, triangles: IntArray) -> IntArray:
    """Turn the closed surfaces that bound one solid: the outer one outward, cavities inward.

    Parameters
    ----------
    points, triangles
        Of surfaces that are each turned one way, whichever; (n_points, 3) and (n_triangles, 3).
    """
    outward, _ = _turned_outward(points, triangles)
    label = _parts(len(points), outward)
    shells = [outward[label == k] for k in np.unique(label)]
    return np.concatenate(with_cavities(points, shells))


def with_cavities(
    points: FloatArray, solids: list[IntArray], turned: BoolArray | None = None
) -> list[IntArray]:
    """Join cavities, turned inward, to the solids that they are in.

    Parameters
    ----------
    points
        (n_points, 3)
    solids
        Triangles of closed surfaces, turned outward.
    turned
        Whether each had faced the other way: a surface inside one that had not is a cavity, any
        other is a solid of its own. None: solids and cavities alternate from outside inwards.

    Returns
    -------
    list of IntArray
        Triangles of the solids, in the order given.
    """
    if len(solids) < 2 or (turned is not None and turned.all() == turned.any()):
        return solids
    corners = [points[s] for s in solids]
    lower, upper = (np.array([f(c, axis=(0, 1)) for c in corners]) for f in (np.min, np.max))
    volumes = np.array([_six_volumes(c).sum() for c in corners])
    cavity = np.zeros(len(solids), dtype=np.bool_)
    joined = list(solids)
    for k in np.argsort(-volumes, kind="stable").tolist():
        around = np.flatnonzero((lower < lower[k]).all(axis=1) & (upper > upper[k]).all(axis=1))
        outer = [j for j in around.tolist() if _encloses(corners[j], corners[k][0].mean(axis=0))]
        if not outer:
            continue
        parent = min(outer, key=volumes.__getitem__)
        cavity[k] = not cavity[parent] and (turned is None or turned[k] != turned[parent])
        if cavity[k]:
            joined[parent] = np.concatenate([joined[parent], solids[k][:, ::-1]])
    return [joined[k] for k in np.flatnonzero(~cavity)]


def _encloses(corners: FloatArray, point: FloatArray) -> bool:
    """Whether a closed surface goes round a point: its triangles fill 4π of what is seen from it.

    Reference: A. Van Oosterom and J. Strackee, The solid angle of a plane triangle, IEEE Trans.
    Biomed. Eng. 30 (1983) 125-126.
    """
    a, b, c = np.moveaxis(corners - point, 1, 0)
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    ab, bc, ca = (np.einsum("ti,ti->t", x, y) for x, y in ((a, b), (b, c), (c, a)))
    angle = np.arctan2(
        np.einsum("ti,ti->t", a, np.cross(b, c)), la * lb * lc + ab * lc + bc * la + ca * lb
    )
    return abs(float(angle.sum())) > np.pi  # half of each angle: 2π inside, 0 outside


def _six_volumes(corners: FloatArray) -> FloatArray:
    """Six times the volume that each triangle spans with the origin, (n,)."""
    return np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))


def across_matter(name: str, points: FloatArray, triangles: IntArray) -> IntArray:
    """Pairs of triangles that bound the same matter at the edges they share, (n, 2).

    Raises
    ------
    MeshError
        For triangles that lie on each other, facing the same way.
    """
    plain = joined(triangles)
    if plain is not None:
        return plain
    _check_distinct(name, points, triangles)
    _, edge, count = undirected_edges(triangles)
    order = np.argsort(edge, kind="stable")  # uses of each edge one after the other
    start = np.cumsum(count) - count
    twice = order[start[count == 2][:, None] + np.arange(2)] // 3
    shared = [
        _round_edge(name, points, triangles, order[first : first + uses])
        for first, uses in zip(start[count > 2], count[count > 2], strict=True)
    ]
    return np.concatenate([twice, *shared])


def _check_distinct(name: str, points: FloatArray, triangles: IntArray) -> None:
    """Reject triangles that are there twice, turned the same way: they would count twice."""
    smallest = np.argmin(triangles, axis=1)[:, None]
    rolled = np.take_along_axis(triangles, (smallest + np.arange(3)) % 3, axis=1)
    first, _, count = distinct_rows(rolled)
    if (count > 1).any():
        place = points[triangles[first[count > 1][0]]].mean(axis=0)
        raise MeshError(
            f"{name}: {int((count - 1).sum())} triangles are there more than once, the first near "
            f"{np.round(place, 3).tolist()}; expected each once: remove duplicate faces in the "
            "program that made it"
        )


def _round_edge(name: str, points: FloatArray, triangles: IntArray, uses: IntArray) -> IntArray:
    """Pair the triangles round one edge that more than two of them share.

    A triangle that runs along the edge as the first one does has matter on the side of falling
    angles, one that runs against it on the side of rising angles.
    """
    of, side = uses // 3, uses % 3
    start, end = triangles[of, side], triangles[of, (side + 1) % 3]
    along = start == start[0]
    if 2 * np.count_nonzero(along) != len(uses):
        return np.column_stack([of[:-1], of[1:]])  # open, or turned against each other: one surface
    axis = points[end[0]] - points[start[0]]
    axis /= np.linalg.norm(axis)
    arm = points[triangles[of, (side + 2) % 3]] - points[start[0]]
    arm -= np.outer(arm @ axis, axis)
    first = arm[0] / np.linalg.norm(arm[0])
    angle = np.arctan2(arm @ np.cross(axis, first), arm @ first)
    matter = (angle[along][None] - angle[~along][:, None]) % (2 * np.pi)
    # Faces that lie on each other have no matter between them: it lies on their other sides.
    matter[matter < _SAME_PLACE] += 2 * np.pi
    matter[matter > 2 * np.pi + _SAME_PLACE] -= 2 * np.pi
    other = np.argmin(matter, axis=1)
    if len(np.unique(other)) != len(other):
        place = 0.5 * (points[start[0]] + points[end[0]])
        raise MeshError(
            f"{name}: surfaces lie on each other, facing the same way, at the edge near "
            f"{np.round(place, 3).tolist()}; expected solids that touch and do not overlap, with "
            "normals that all point outward"
        )
    return np.column_stack([of[~along], of[along][other]])


def _turned_outward(points: FloatArray, triangles: IntArray) -> tuple[IntArray, BoolArray]:
    """Turn parts that enclose a negative volume inside out; what shares corners is one part.

    Returns the triangles and whether each was turned.
    """
    label = _parts(len(points), triangles)
    volume = np.bincount(label, weights=_six_volumes(points[triangles] - points.mean(axis=0)))
    turned = volume[label] < 0.0
    return np.where(turned[:, None], triangles[:, ::-1], triangles), turned


def _parts(n_points: int, triangles: IntArray) -> IntArray:
    """Number of the part that each triangle is in: what shares corners is one, (n_triangles,)."""
    start, end = triangles[:, [[0, 1], [1, 2]]].reshape(-1, 2).T
    return connected_parts(n_points, start, end)[triangles[:, 0]]
