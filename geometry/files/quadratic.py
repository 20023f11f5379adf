"""Hexahedra of 20 or 27 nodes from files: their own quadratic map as the exact shape of a block.

Nodes are numbered as VTK does, 20 of them as Abaqus C3D20 does as well: corners, middles of edges,
then middles of faces (x-, x+, y-, y+, z-, z+) and the centre. Twenty nodes are made 27 by the
functions of the 20-node element, so that one map serves both.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geometry.block import Curve
from geometry.mesh import (
    CORNERS,
    HEX_EDGES,
    HEX_FACES,
    FloatArray,
    IntArray,
    MeshError,
    grid_points,
)

#: Corners of the faces, in the order of their middles.
_FACES: IntArray = HEX_FACES[[5, 3, 2, 4, 0, 1]]
#: Places of the 27 nodes, (27, 3).
NATURAL: FloatArray = np.concatenate(
    [CORNERS, CORNERS[HEX_EDGES].mean(axis=1), CORNERS[_FACES].mean(axis=1), np.zeros((1, 3))]
)
#: Middles that two elements share lie closer than this, in lengths of their edge or face.
_SHARED = 1e-6


class FoldedElementError(MeshError):
    """A curved element whose middles turn it inside out: no rigid answer has its shape either."""


def quadratic_curve(path: Path, corners: IntArray, places: FloatArray) -> Curve:
    """Exact shape of hexahedra with nodes on their edges.

    Parameters
    ----------
    path
        File that they are from, for messages.
    corners
        Nodes at the corners, (n, 8).
    places
        Of all nodes, (n, 20 or 27, 3) [mm].

    Raises
    ------
    MeshError
        Elements that fold, or that share an edge or a face but not its middle.
    """
    nodes = places if places.shape[1] == 27 else _follow() @ places
    _check_folds(path, nodes)
    _check_shared(path, corners, nodes)

    def parameters() -> FloatArray:
        number = np.broadcast_to(np.arange(len(nodes))[:, None, None], (len(nodes), 8, 1))
        natural = np.broadcast_to(CORNERS, (len(nodes), 8, 3))
        return np.concatenate([number, natural], axis=2)

    def shape(given: FloatArray) -> FloatArray:
        element = np.rint(given[:, 0]).astype(np.int64)
        points = np.zeros((len(given), 3))
        for node, value in enumerate(_values(given[:, 1:]).T):
            points += value[:, None] * nodes[element, node]
        return points

    return Curve(parameters, shape)


def _line(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values and slopes of the three functions of a line, (..., 3) each."""
    values = np.stack([0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)], axis=-1)
    return values, np.stack([x - 0.5, -2.0 * x, x + 0.5], axis=-1)


def _values(natural: FloatArray, by: int | None = None) -> FloatArray:
    """Functions of the 27 nodes, or their slopes in one direction, (n_points, 27)."""
    product = np.ones((len(natural), 27))
    for axis in range(3):
        line = _line(natural[:, axis])[1 if axis == by else 0]
        product *= line[:, np.rint(NATURAL[:, axis]).astype(np.int64) + 1]
    return product


def _follow() -> FloatArray:
    """Places of 27 nodes from those of 20: faces and centre follow as in the 20-node element."""
    follow = np.eye(27, 20)
    for node in range(20, 27):
        # Middles of the edges round a face, or of all edges; corners are as far again.
        away = np.abs(NATURAL[:20] - NATURAL[node]).sum(axis=1)
        corners, middles = away == away[:8].min(), away == away[8:].min()
        follow[node, corners] = -0.25
        follow[node, middles] = 0.5 if node < 26 else 0.25
    return follow


def _check_shared(path: Path, corners: IntArray, nodes: FloatArray) -> None:
    for name, groups, first in (("edge", HEX_EDGES, 8), ("face", _FACES, 20)):
        owner = np.repeat(np.arange(len(nodes)), len(groups))
        ends = np.sort(corners[:, groups], axis=2).reshape(len(owner), -1)
        _, unique, same = np.unique(ends, axis=0, return_index=True, return_inverse=True)
        middle = nodes[:, first : first + len(groups)].reshape(-1, 3)
        size = np.linalg.norm(np.ptp(nodes[:, groups], axis=2), axis=2).ravel()
        other = unique[same.ravel()]
        apart = np.linalg.norm(middle - middle[other], axis=1)
        bad = int(np.argmax(apart / size))
        if apart[bad] > _SHARED * size[bad]:
            raise MeshError(
                f"{path}: elements {owner[other[bad]]} and {owner[bad]} (counted from 0) share the "
                f"corners of {'an' if name == 'edge' else 'a'} {name}, but its middles lie "
                f"{apart[bad]:.3g} mm apart; expected one curved {name} for both"
            )


def _check_folds(path: Path, nodes: FloatArray) -> None:
    """Look at as many points as the Jacobian, of degree 5 in each direction, is made of."""
    points = grid_points(*[np.cos(np.pi * np.arange(6) / 5.0)] * 3)
    worst = np.empty(len(nodes))
    for some in np.array_split(np.arange(len(nodes)), 1 + len(nodes) // 500):
        tangents = [_values(points, axis) @ nodes[some] for axis in range(3)]
        normal = np.cross(tangents[0], tangents[1])
        worst[some] = np.einsum("epi,epi->ep", normal, tangents[2]).min(axis=1)
    bad = int(np.argmin(worst))
    if worst[bad] > 0.0:
        return
    ends = nodes[bad][HEX_EDGES]
    chord = ends[:, 1] - ends[:, 0]
    along = np.einsum("ei,ei->e", nodes[bad, 8:20] - ends[:, 0], chord) / (chord**2).sum(axis=1)
    edge = int(np.argmax(np.abs(along - 0.5)))
    where = "expected middles that do not fold it"
    if abs(along[edge] - 0.5) >= 0.25:
        a, b = HEX_EDGES[edge]
        where = (
            f"its node {edge + 8} does not stand in the middle half of the edge from its node {a} "
            f"to {b}: expected the order of VTK and Abaqus"
        )
    raise FoldedElementError(
        f"{path}: {int((worst <= 0.0).sum())} of {len(nodes)} curved hexahedra fold, worst element "
        f"{bad} (counted from 0, Jacobian {worst[bad]:.3g} mm³); {where}"
    )
