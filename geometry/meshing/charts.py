"""How a block is meshed anew: grids of elements in parameters, and the lines between them.

A block of a family is the image of one chart, a unit cube of parameters cut by lines in three
directions (of several, where its outline is no quadrilateral). Any other block has one chart for
each of its hexahedra. A block is built again on other lines, its nodes on the exact shape where it
has one; places on the block keep their chart and parameters on every mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.mesh import (
    CORNERS,
    FloatArray,
    HexMesh,
    IntArray,
    ReadOnlyArrays,
)

Lines = tuple[FloatArray, FloatArray, FloatArray]

#: Direction of a hexahedron without a family.
ANY_DIRECTION = "any"


@dataclass(frozen=True)
class Charts(ReadOnlyArrays):
    """Structured grids of elements that make up a block."""

    directions: tuple[str, str, str]
    """Meaning of each direction: ``along`` a course of blocks, ``across`` the wall, ``upward``;
    ``any`` of a hexahedron without a family."""
    parts: tuple[int, int, int]
    """Equal parts of each direction whose ends stay lines of every mesh, such as whole waves."""
    lines: Lines
    """Ends of the elements of each direction, 0 to 1."""
    elements: IntArray
    """Numbers of the elements of each chart, (n_charts, n_1, n_2, n_3)."""
    build: Callable[[Lines], Any]
    """Makes the `geometry.block.Block` on other lines."""
    natural: tuple[int, int, int] = (0, 1, 2)
    """Natural direction of the elements in each direction of the chart."""

    @property
    def counts(self) -> tuple[int, int, int]:
        """Elements in each direction."""
        n_1, n_2, n_3 = self.elements.shape[1:]
        return n_1, n_2, n_3


def repeated(line: FloatArray, parts: int) -> FloatArray:
    """Lines of equal parts that follow each other, 0 to 1, from those of one part."""
    joined = np.concatenate([line[:-1] + k for k in range(parts)] + [[float(parts)]])
    return np.asarray(joined / parts, dtype=np.float64)


def unit_lines(*lines: FloatArray) -> Lines:
    """Lines of any parameters from 0 to 1."""
    first, second, third = ((line - line[0]) / (line[-1] - line[0]) for line in lines)
    return first, second, third


def grid_charts(
    directions: tuple[str, str, str],
    parts: tuple[int, int, int],
    lines: Lines,
    build: Callable[[Lines], Any],
) -> Charts:
    """Charts of a block that is one structured grid."""
    counts = [len(line) - 1 for line in lines]
    elements = np.arange(int(np.prod(counts))).reshape(1, *counts)
    return Charts(directions, parts, lines, elements, build)


@dataclass(frozen=True)
class Places:
    """Points of a block in the parameters of its charts."""

    chart: IntArray
    """(n,)"""
    parameters: FloatArray
    """(n, 3)"""


def places_in(charts: Charts, elements: IntArray, natural: FloatArray) -> Places:
    """Places of points of elements.

    Parameters
    ----------
    charts
        Of the block.
    elements
        Number of the element of each point, (n,).
    natural
        Natural coordinates there, -1 to 1, (n, 3).
    """
    at = np.empty((charts.elements.size, 4), dtype=np.int64)
    at[charts.elements.ravel()] = np.stack(
        np.unravel_index(np.arange(charts.elements.size), charts.elements.shape), axis=1
    )
    members = at[elements]
    places = np.empty((len(elements), 3))
    for k, line in enumerate(charts.lines):
        low, high = line[members[:, 1 + k]], line[members[:, 1 + k] + 1]
        places[:, k] = low + 0.5 * (natural[:, charts.natural[k]] + 1.0) * (high - low)
    return Places(members[:, 0], places)


def located(charts: Charts, places: Places) -> tuple[IntArray, FloatArray]:
    """Element and natural coordinates of places, (n,) and (n, 3): the inverse of `places_in`."""
    cells, natural = [], np.empty_like(places.parameters)
    for k, line in enumerate(charts.lines):
        at = places.parameters[:, k]
        cell = np.clip(np.searchsorted(line, at, side="right") - 1, 0, len(line) - 2)
        cells.append(cell)
        share = (at - line[cell]) / (line[cell + 1] - line[cell])
        natural[:, charts.natural[k]] = 2.0 * share - 1.0
    return charts.elements[places.chart, cells[0], cells[1], cells[2]], natural


def facet_elements(mesh: HexMesh, quads: IntArray) -> tuple[IntArray, FloatArray]:
    """Element of facets of a mesh, and natural coordinates of their corners in it.

    Parameters
    ----------
    mesh
        Hexahedra.
    quads
        Corners of facets on its boundary, (n, 4).

    Returns
    -------
    tuple[IntArray, FloatArray]
        (n,) and (n, 4, 3).
    """
    element, corner = facet_corners(mesh, quads)
    return element, CORNERS[corner]


def facet_corners(mesh: HexMesh, quads: IntArray) -> tuple[IntArray, IntArray]:
    """Element of facets of a mesh (n, 4), and which of its corners theirs are: (n,) and (n, 4)."""
    element = mesh.face_elements(quads)
    return element, (mesh.elements[element][:, None] == quads[:, :, None]).argmax(axis=2)
