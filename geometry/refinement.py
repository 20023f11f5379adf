"""Blocks meshed anew: on the lines of a family's charts, or hexahedron by hexahedron."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from geometry.block import ANY_DIRECTION, Block, Charts, Lines, facet_elements, repeated
from geometry.errors import RefusedError
from geometry.mesh import (
    FloatArray,
    HexMesh,
    IntArray,
    grid_points,
    shape_values,
    structured_hexahedra,
)

#: Nodes that lie closer than this share of the size of a block are one.
_SAME_NODE = 1e-7


class RefinementError(RefusedError):
    """A block that cannot be meshed as requested."""


def charts_of(block: Block) -> Charts:
    """Charts of a block: those of its family, else one for each hexahedron."""
    if block.charts is not None:
        return block.charts
    line = np.array([0.0, 1.0])
    elements = np.arange(block.mesh.n_elements).reshape(-1, 1, 1, 1)
    lines = (line, line, line)
    return Charts((ANY_DIRECTION,) * 3, (1, 1, 1), lines, elements, partial(_split, block))


def charts_as(block: Block, other: Charts) -> Charts:
    """Charts of a block of the kind that another mesh of it has: of its family, or hexahedra."""
    charts = charts_of(block)
    if charts.directions == other.directions:
        return charts
    return charts_of(replace(block, charts=None))


def with_lines(block: Block, per_part: dict[str, FloatArray]) -> Block:
    """Mesh a block anew.

    Parameters
    ----------
    block
        What is meshed.
    per_part
        Ends of the elements of one part of each direction, 0 to 1, by the name of the direction.
    """
    charts = charts_of(block)
    missing = [name for name in charts.directions if name not in per_part]
    if missing:
        raise RefinementError(f"{block.name}: no lines given {missing[0]!r}; expected them")
    first, second, third = (
        repeated(per_part[name], n) for name, n in zip(charts.directions, charts.parts, strict=True)
    )
    return _built(charts, (first, second, third))


def _built(charts: Charts, lines: Lines) -> Block:
    """The block of charts on other lines."""
    block: Block = charts.build(lines)
    return block


def _split(block: Block, lines: Lines) -> Block:
    """Cut every hexahedron of a block by the same lines, on its exact shape where it has one."""
    mesh, curve = block.mesh, block.curve
    counts = tuple(len(line) - 1 for line in lines)
    natural = 2.0 * grid_points(*lines) - 1.0
    shares = shape_values(natural)
    given = mesh.nodes[mesh.elements[:, :8]] if curve is None else curve.parameters()
    parameters = shares @ given
    flat = parameters.reshape(-1, parameters.shape[2])
    points = flat if curve is None else curve.shape(flat)
    size = _SAME_NODE * float(np.ptp(points, axis=0).max())
    key = np.round(points / size + 1.0 / np.pi).astype(np.int64)
    _, first, number = np.unique(key, axis=0, return_index=True, return_inverse=True)
    of = np.asarray(number).reshape(mesh.n_elements, -1)
    cells = structured_hexahedra(*counts)
    elements = of[:, cells].reshape(-1, 8)
    faces = {name: _split_quads(mesh, quads, of, counts) for name, quads in block.faces.items()}
    charts = Charts(
        (ANY_DIRECTION,) * 3,
        (1, 1, 1),
        lines,
        np.arange(len(elements)).reshape(-1, *counts),
        partial(_split, block),
    )
    new_curve = None
    if curve is not None:
        places = parameters[:, cells].reshape(len(elements), 8, -1)
        new_curve = replace(curve, parameters=lambda: places)
    return replace(
        block, mesh=HexMesh(points[first], elements), faces=faces, curve=new_curve, charts=charts
    )


def _split_quads(
    mesh: HexMesh, quads: IntArray, numbers: IntArray, counts: tuple[int, ...]
) -> IntArray:
    """Facets of the parts of hexahedra on some facets, oriented like these."""
    if not len(quads):
        return quads
    element, corners = facet_elements(mesh, quads)
    corners = (0.5 * (corners + 1.0) * np.array(counts)).round().astype(np.int64)
    grid = numbers.reshape(len(numbers), *(n + 1 for n in counts))
    along = (corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    result = []
    for e, origin, first, second in zip(element, corners[:, 0], *along, strict=True):
        n, m = int(np.abs(first).max()), int(np.abs(second).max())
        i, j = (index.ravel()[:, None] for index in np.indices((n, m)))
        for_corner = ((0, 0), (1, 0), (1, 1), (0, 1))
        places = [
            origin + (i + di) * (first // n) + (j + dj) * (second // m) for di, dj in for_corner
        ]
        result.append(np.stack([grid[e][tuple(p.T)] for p in places], axis=1))
    return np.concatenate(result)
