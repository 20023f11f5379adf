"""Plane cuts through deformable blocks: stresses inside, and where the blocks end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.files.vtu import as_grid
from geometry.mesh import FloatArray, IntArray

if TYPE_CHECKING:
    from validation.output.pictures.drawn import DrawnState


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


def section(run: DrawnState, z: float) -> Section:
    """Cut all deformable blocks by the plane at height z [mm]."""
    points, triangles = [np.zeros((0, 2))], [np.zeros((0, 3), np.int64)]
    values, borders, offset = [np.zeros((0, 3))], [np.zeros((0, 2, 2))], 0
    for block in run.deformable.deformable_blocks.tolist():
        nodes = run.positions(block)
        if not nodes[:, 2].min() < z < nodes[:, 2].max():
            continue
        shape = run.drawn.shape(block)
        fields = {"principal": run.principal(block)}
        cut = _cut(as_grid(nodes, _HEXAHEDRON, shape.mesh.elements, fields, {}), z)
        corners = cut.GetPoints()
        if corners is None or not cut.GetNumberOfPolys():
            continue
        points.append(_numbers(corners.GetData())[:, :2])
        triangles.append(_numbers(cut.GetPolys().GetConnectivityArray()).reshape(-1, 3) + offset)
        values.append(_numbers(cut.GetPointData().GetArray("principal")))
        offset += len(points[-1])
        borders.append(_border(nodes, np.concatenate(list(shape.faces.values())), z))
    parts: Any = points, triangles, values, borders
    return Section(*map(np.concatenate, parts))


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
