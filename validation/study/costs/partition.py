"""Pressures of different meshes on one partition of every contact face into cells.

Cells are equal in the parameters of a face, as the facets of a mesh are; a cell's pressure is the
mean over its area. A face is a grid of facets, row by row.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from geometry.assembly import Assembly
from geometry.mesh import FloatArray, IntArray
from validation.errors import InputError

#: The partition's cells in a face are as many as the facets of this level.
PARTITION_LEVEL = 2

#: Areas below this part of the largest cell's are round-off.
_TOUCHES = 1e-9


def overlap(edges_from: FloatArray, edges_to: FloatArray) -> FloatArray:
    """Share of each interval between edges in each of others, (n_to, n_from)."""
    a, b = edges_from, edges_to
    low = np.maximum(a[None, :-1], b[:-1, None])
    high = np.minimum(a[None, 1:], b[1:, None])
    return np.clip(high - low, 0.0, None) / np.diff(a)


def grid_of(quads: IntArray) -> tuple[int, int]:
    """Rows and columns of facets that run row by row, more than one in each direction.

    Two facets of a row that follow each other share an edge; the last of a row and the first of
    the next one do not.
    """
    shared = [len(set(a) & set(b)) == 2 for a, b in pairwise(quads.tolist())]
    columns = shared.index(False) + 1 if False in shared else len(quads)
    return len(quads) // columns, columns


def partition_pressures(
    assembly: Assembly,
    contacts: IntArray,
    pressures: FloatArray,
    cells: Assembly,
    *,
    level: int,
    across: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Mean pressure and area of the cells of all contact faces that touch.

    Parameters
    ----------
    assembly
        The blocks.
    contacts
        Facets in its interfaces that carry pressures, (n,).
    pressures
        (n,) [MPa]
    cells
        The same blocks on the mesh of `PARTITION_LEVEL`.
    level
        Of the mesh of `assembly`, over the base mesh.
    across
        Places of the rows of its facets, 0 to 1, where they are not equal.

    Returns
    -------
    tuple[FloatArray, FloatArray]
        (n_cells,) [MPa] and [mm²]; face by face in the order of blocks, the same for all meshes.
    """
    result = assembly.interfaces
    free = ~(assembly.fixed[result.block_m[contacts]] & assembly.fixed[result.block_s[contacts]])
    contacts, pressures = contacts[free], pressures[free]
    block, facet = result.block_m[contacts], result.facet_m[contacts]
    areas = result.areas[contacts]
    all_pressures, all_areas = [], []
    for number in np.unique(block).tolist():
        shape, coarse, first = assembly.shape(number), cells.shape(number), 0
        for name in shape.contact_faces:
            size = len(shape.faces[name])
            mine = np.flatnonzero((block == number) & (facet >= first) & (facet < first + size))
            place, first = facet[mine] - first, first + size
            if not len(mine):
                continue
            rows, columns = _shares(grid_of(coarse.faces[name]), level, across)
            grid = (rows.shape[1], columns.shape[1])
            if grid[0] * grid[1] != size:
                raise InputError(
                    f"{assembly.name}: face {name}: {size} facets are no grid of {grid[0]} × "
                    f"{grid[1]}; pressures of different meshes cannot be compared on it"
                )
            area, force = (
                (rows @ np.bincount(place, values, size).reshape(grid) @ columns.T).ravel()
                for values in (areas[mine], areas[mine] * pressures[mine])
            )
            # Part of a face may meet nothing.
            touches = area > _TOUCHES * area.max()
            all_areas.append(area[touches])
            all_pressures.append(force[touches] / area[touches])
    return np.concatenate(all_pressures), np.concatenate(all_areas)


def _shares(
    coarse: tuple[int, int], level: int, across: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Shares of the rows and of the columns of a level in those of the partition."""
    own = [np.linspace(0.0, 1.0, n * level // PARTITION_LEVEL + 1) for n in coarse]
    if across is not None:
        own[0] = across
    common = [np.linspace(0.0, 1.0, n + 1) for n in coarse]
    rows, columns = (overlap(a, b) for a, b in zip(own, common, strict=True))
    return rows, columns
