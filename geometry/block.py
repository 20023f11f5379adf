"""A block shape: one hexahedral mesh with named faces.

Congruent blocks share one `Block`; an `Assembly` places copies of it by rigid motions.

A block of a family is the image of one chart, a unit cube of parameters cut by lines in three
directions (of several, where its outline is no quadrilateral). Any other block has one chart for
each of its hexahedra. A block is built again on other lines, its nodes on the exact shape where it
has one; places on the block keep their chart and parameters on every mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from geometry.mesh import (
    CORNERS,
    FloatArray,
    HexMesh,
    IntArray,
    QuadSurface,
    ReadOnlyArrays,
    boundary_quads,
    check_mesh,
    grid_faces,
    grid_points,
    structured_hexahedra,
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
    build: Callable[[Lines], Block]
    """Makes the `Block` on other lines."""
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


@dataclass(frozen=True)
class Curve:
    """The exact shape of a block, of which its mesh is a sample."""

    parameters: Callable[[], FloatArray]
    """Of the corners of each element, (n_elements, 8, n): one node may have several. Made when
    asked for: trilinear and rigid blocks have no use for them."""
    shape: Callable[[FloatArray], FloatArray]
    """Points of parameters, (m, n) to (m, 3) [mm]."""


@dataclass(frozen=True)
class Block(ReadOnlyArrays):
    """One block shape in its own reference position."""

    name: str
    """Name in reports and decks, e.g. ``sine-block``."""
    mesh: HexMesh
    """Volume mesh in the reference position [mm]."""
    faces: dict[str, IntArray]
    """Named groups of boundary facets, each (n_facets, 4) node numbers, oriented outward."""
    contact_faces: tuple[str, ...] = field(default=())
    """Names of the groups that can meet another block."""
    curve: Curve | None = None
    """The exact shape; None: the mesh is the shape."""
    charts: Charts | None = None
    """How it is meshed anew (`geometry.refinement.charts_of`); None: by its hexahedra."""
    divided: Callable[[int], Block] | None = None
    """Makes a block of so many elements along every edge anew; None: it is no such block."""
    edge_sets: dict[str, FloatArray] = field(default_factory=dict)
    """Named edges and corners: the places of their corners, each (n, 3) [mm]."""
    tetrahedra: float | None = None
    """Size of the tetrahedra that its hexahedra were split from [mm]; None: of no tetrahedra."""

    @cached_property
    def _extent(self) -> tuple[float, FloatArray]:
        return self.mesh.extent()

    @property
    def volume(self) -> float:
        """Volume of the mesh [mm³]."""
        return self._extent[0]

    @property
    def centroid(self) -> FloatArray:
        """Mass centroid of the mesh, (3,) [mm]."""
        return self._extent[1]

    @cached_property
    def contact_quads(self) -> IntArray:
        """All facets that can meet another block, groups in the order of `contact_faces`."""
        if not self.contact_faces:
            return np.empty((0, 4), dtype=np.int64)
        return np.concatenate([self.faces[name] for name in self.contact_faces])

    @cached_property
    def boundary(self) -> IntArray:
        """Facets on the boundary, oriented outward, (n, 4)."""
        return boundary_quads(self.mesh)

    @cached_property
    def surface_nodes(self) -> IntArray:
        """Nodes on the boundary, each once, sorted; (n,)."""
        return np.unique(self.boundary)

    def surface(self, name: str) -> QuadSurface:
        """Return the named face group as a surface with centroids, normals and areas."""
        return QuadSurface(self.mesh.nodes, self.faces[name])


def box_block(
    size: tuple[float, float, float],
    divisions: tuple[int, int, int],
    *,
    name: str = "box",
    contact_faces: tuple[str, ...] = (),
    face_names: dict[str, str] | None = None,
) -> Block:
    """Box [0, size] [mm] meshed by equal bricks, faces named ``x-``, ``x+``, … ``z+``.

    ``divisions`` are the elements along x, y, z; ``contact_faces`` can meet another block;
    ``face_names`` are other names of the six faces.
    """
    lines = unit_lines(*(np.linspace(0.0, 1.0, n + 1) for n in divisions))
    return _box(size, name, face_names or {}, contact_faces, lines)


def _box(
    size: tuple[float, float, float],
    name: str,
    face_names: dict[str, str],
    contact_faces: tuple[str, ...],
    lines: Lines,
) -> Block:
    counts = [len(line) - 1 for line in lines]
    places = (_scaled(line, length) for line, length in zip(lines, size, strict=True))
    mesh = HexMesh(grid_points(*places), structured_hexahedra(*counts))
    check_mesh(mesh, name)
    axis = {"u": "x", "v": "y", "w": "z"}
    faces = {axis[key[0]] + key[1]: quads for key, quads in grid_faces(*counts).items()}
    faces = {new: faces[old] for old, new in (face_names or {key: key for key in faces}).items()}
    build = partial(_box, size, name, face_names, contact_faces)
    charts = grid_charts(("along", "across", "upward"), (1, 1, 1), lines, build)
    return Block(name, mesh, faces, contact_faces, charts=charts)


def _scaled(line: FloatArray, length: float) -> FloatArray:
    """Line from 0 to a length; equal parts are those of the length: 50, not 49.99999999999999."""
    n = len(line)
    even = np.array_equal(line, np.linspace(0.0, 1.0, n))
    return np.linspace(0.0, length, n) if even else line * length


def mapped_block(
    name: str,
    lines: tuple[FloatArray, FloatArray, FloatArray],
    shape: Callable[[FloatArray], FloatArray],
    faces: dict[str, str],
    contact_faces: tuple[str, ...],
    *,
    directions: tuple[str, str, str],
    parts: tuple[int, int, int] = (1, 1, 1),
) -> Block:
    """Block of an exact shape: the image of a grid of three parameters, right-handed.

    Parameters
    ----------
    name
        Name of the block shape.
    lines
        Values of each parameter at the nodes.
    shape
        Points of parameters, (m, 3) to (m, 3) [mm].
    faces
        Name of each side of the grid, ``u-`` to ``w+``.
    contact_faces
        Faces that can meet another block.
    directions, parts
        What each parameter is, and equal parts of it that every mesh keeps (`Charts`).
    """
    counts = [len(line) - 1 for line in lines]
    mesh = HexMesh(shape(grid_points(*lines)), structured_hexahedra(*counts))
    check_mesh(mesh, name)
    named = {faces[side]: quads for side, quads in grid_faces(*counts).items()}
    curve = Curve(partial(_corner_parameters, lines, mesh.elements), shape)
    build = partial(
        _mapped_again,
        partial(mapped_block, name, directions=directions, parts=parts),
        lines,
        (shape, faces, contact_faces),
    )
    charts = grid_charts(directions, parts, unit_lines(*lines), build)
    return Block(name, mesh, named, contact_faces, curve, charts)


def _corner_parameters(lines: Lines, elements: IntArray) -> FloatArray:
    return grid_points(*lines)[elements]


def _mapped_again(
    mapped: Callable[..., Block], lines: Lines, stated: tuple[Any, ...], unit: Lines
) -> Block:
    """Return the same block on other lines, (n,) of each parameter from 0 to 1."""
    first, second, third = (
        line[0] + (line[-1] - line[0]) * at for line, at in zip(lines, unit, strict=True)
    )
    return mapped((first, second, third), *stated)
