"""Plane cuts through deformable blocks: stresses inside, and where the blocks end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.files.vtu import as_grid
from geometry.mesh import FloatArray, IntArray

if TYPE_CHECKING:
    from fem.solution import Solution


#: VTK's numbers of cells.
_HEXAHEDRON, _QUAD = 12, 9


@dataclass(frozen=True)
class Section:
    """A plane cut through the blocks."""

    points: FloatArray
    """(n_points, 2): x and y [mm]."""
    triangles: IntArray
    """(n_triangles, 3)"""
    values: FloatArray
    """Principal stresses σ₁, σ₂, σ₃ at the points, (n_points, 3) [MPa]."""
    borders: FloatArray
    """Where the blocks end: both ends of each piece, (n, 2, 2) [mm]."""
    rigid: IntArray
    """Triangles of blocks that have no stresses, (n, 3)."""


def section(solution: Solution, z: float) -> Section:
    """Cut all blocks by the plane at height z [mm]."""
    cuts = [_cut_block(solution, b, z) for b in range(solution.deformable.drawn.n_blocks)]
    result = [cut for cut in cuts if cut is not None]
    counts = np.cumsum([0, *(len(cut.points) for cut in result)])
    shifted = [
        (cut.triangles + n, cut.rigid + n) for cut, n in zip(result, counts[:-1], strict=True)
    ]
    nothing = np.zeros((0, 3), np.int64)
    return Section(
        np.concatenate([np.zeros((0, 2)), *(cut.points for cut in result)]),
        np.concatenate([nothing, *(solid for solid, _ in shifted)]),
        np.concatenate([np.zeros((0, 3)), *(cut.values for cut in result)]),
        np.concatenate([np.zeros((0, 2, 2)), *(cut.borders for cut in result)]),
        np.concatenate([nothing, *(rigid for _, rigid in shifted)]),
    )


def _cut_block(solution: Solution, block: int, z: float) -> Section | None:
    """Cut one block; None where the plane does not meet it."""
    nodes, shape = (
        solution.deformable.positions(block),
        solution.deformable.drawn.shape(block),
    )
    if not nodes[:, 2].min() < z < nodes[:, 2].max():
        return None
    stressed = solution.deformable.group_of[block] >= 0
    principal = solution.principal(block) if stressed else np.zeros((len(nodes), 3))
    grid = as_grid(nodes, _HEXAHEDRON, shape.mesh.elements, {"principal": principal}, {})
    cut = _cut(grid, z)
    if cut.GetPoints() is None or not cut.GetNumberOfPolys():
        return None
    triangles = _numbers(cut.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return Section(
        _numbers(cut.GetPoints().GetData())[:, :2],
        triangles if stressed else triangles[:0],
        _numbers(cut.GetPointData().GetArray("principal")),
        _border(nodes, np.concatenate(list(shape.faces.values())), z),
        triangles[:0] if stressed else triangles,
    )


def _numbers(array: Any) -> Any:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return np.array(vtk_to_numpy(array))


def _cut(data: Any, z: float) -> Any:
    """Triangles or lines in which a plane cuts."""
    from vtkmodules.vtkCommonDataModel import vtkPlane
    from vtkmodules.vtkFiltersCore import vtkCutter

    plane, cutter = vtkPlane(), vtkCutter()
    plane.SetNormal(0.0, 0.0, 1.0)
    plane.SetOrigin(0.0, 0.0, z)
    cutter.SetCutFunction(plane)
    cutter.SetInputData(data)
    cutter.GenerateTrianglesOn()
    cutter.Update()
    return cutter.GetOutput()


def _border(nodes: FloatArray, quads: IntArray, z: float) -> FloatArray:
    """Both ends of each piece in which a plane cuts a surface, (n, 2, 2) [mm]."""
    cut = _cut(as_grid(nodes, _QUAD, quads, {}, {}), z)
    if not cut.GetNumberOfLines():
        return np.zeros((0, 2, 2))
    corners = _numbers(cut.GetPoints().GetData())[:, :2]
    return corners[_numbers(cut.GetLines().GetConnectivityArray()).reshape(-1, 2)]
