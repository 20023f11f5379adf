"""Plane cuts through deformable blocks: stresses inside, and where the blocks end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.files.vtu import as_grid
from geometry.mesh import FloatArray, IntArray
from validation.output.pictures.canvas import merged

if TYPE_CHECKING:
    from fem.state import State


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


def section(solution: State, z: float) -> Section:
    """Cut all blocks by the plane at height z [mm]."""
    deformable = solution.deformable
    bodies, skins, principal, stressed = [], [], [], []
    for block in range(deformable.drawn.n_blocks):
        nodes, shape = deformable.positions(block), deformable.drawn.shape(block)
        if not nodes[:, 2].min() < z < nodes[:, 2].max():
            continue
        solved = deformable.group_of[block] >= 0
        bodies.append((nodes, shape.mesh.elements))
        skins.append((nodes, np.concatenate(list(shape.faces.values()))))
        principal.append(solution.principal(block) if solved else np.zeros((len(nodes), 3)))
        stressed.append(np.full(len(shape.mesh.elements), float(solved)))
    if not bodies:
        nothing = np.zeros((0, 3), np.int64)
        return Section(np.zeros((0, 2)), nothing, np.zeros((0, 3)), np.zeros((0, 2, 2)), nothing)
    fields = {"principal": np.concatenate(principal)}
    owners = {"stressed": np.concatenate(stressed)}
    cut = _cut(as_grid(*_cells(bodies, 8, _HEXAHEDRON), fields, owners), z)
    triangles = _numbers(cut.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    solid = _numbers(cut.GetCellData().GetArray("stressed")) > 0.0
    edge = _cut(as_grid(*_cells(skins, 4, _QUAD), {}, {}), z)
    ends = _numbers(edge.GetPoints().GetData())[:, :2]
    return Section(
        points=_numbers(cut.GetPoints().GetData())[:, :2],
        triangles=triangles[solid],
        values=_numbers(cut.GetPointData().GetArray("principal")),
        borders=ends[_numbers(edge.GetLines().GetConnectivityArray()).reshape(-1, 2)],
        rigid=triangles[~solid],
    )


def _cells(
    bodies: list[tuple[FloatArray, IntArray]], n_corners: int, kind: int
) -> tuple[FloatArray, int, IntArray]:
    """Points of several bodies, the kind of their cells, and these."""
    points, cells = merged(bodies, n_corners)
    return points, kind, cells


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
