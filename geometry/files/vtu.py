"""Fields for ParaView, and numbers as VTK takes them.

VTK writes what VTK reads: in half the time that meshio needs, which is not even loaded. Pyvista is
not either: that would take longer than writing.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from geometry.mesh import FloatArray, IntArray

#: zlib's fastest: files are a few per cent larger than by its default.
_COMPRESSION = 1

_Data = Mapping[str, npt.NDArray[Any]]


def as_array(values: npt.NDArray[Any]) -> Any:
    """Numbers as VTK takes them."""
    from vtkmodules.util.numpy_support import numpy_to_vtk

    return numpy_to_vtk(np.ascontiguousarray(values), deep=1)


def as_cells(corners: IntArray) -> Any:
    """Cells by their points, (n, n_corners), as VTK takes them."""
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    count, size = corners.shape
    starts = np.arange(0, count * size + 1, size)
    cells = vtkCellArray()
    cells.SetData(
        numpy_to_vtkIdTypeArray(starts, deep=1),
        numpy_to_vtkIdTypeArray(np.ascontiguousarray(corners, dtype=np.int64).ravel(), deep=1),
    )
    return cells


def as_points(places: FloatArray) -> Any:
    """Points, (n, 3), as VTK takes them."""
    from vtkmodules.vtkCommonCore import vtkPoints

    points = vtkPoints()
    points.SetData(as_array(places))
    return points


def as_surface(points: FloatArray, triangles: IntArray) -> Any:
    """Triangles (n, 3) of points (m, 3), as VTK takes a surface."""
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    surface = vtkPolyData()
    surface.SetPoints(as_points(points))
    surface.SetPolys(as_cells(triangles))
    return surface


def as_grid(
    points: FloatArray, kind: int, cells: IntArray, point_data: _Data, cell_data: _Data
) -> Any:
    """Cells of one kind, the number that VTK gives it, with one row of data each."""
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid

    grid = vtkUnstructuredGrid()
    grid.SetPoints(as_points(points))
    grid.SetCells(kind, as_cells(cells))
    for result, data in ((grid.GetPointData(), point_data), (grid.GetCellData(), cell_data)):
        for name, values in data.items():
            array = as_array(values)
            array.SetName(name)
            result.AddArray(array)
    return grid


def write_vtu(path: Path, grid: Any) -> None:
    """Write what `as_grid` makes."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetDataModeToBinary()
    writer.SetCompressionLevel(_COMPRESSION)
    # To a string: a full disk is for Python to say.
    writer.WriteToOutputStringOn()
    writer.Write()
    path.write_text(writer.GetOutputString(), "ascii")
