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


def write_vtu(
    path: Path,
    points: FloatArray,
    kind: int,
    cells: IntArray,
    *,
    point_data: Mapping[str, npt.NDArray[Any]],
    cell_data: Mapping[str, npt.NDArray[Any]],
) -> None:
    """Write cells of one kind, the number that VTK gives it, with one row of data each."""
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    grid, places = vtkUnstructuredGrid(), vtkPoints()
    places.SetData(as_array(points))
    grid.SetPoints(places)
    grid.SetCells(kind, as_cells(cells))
    for found, data in ((grid.GetPointData(), point_data), (grid.GetCellData(), cell_data)):
        for name, values in data.items():
            array = as_array(values)
            array.SetName(name)
            found.AddArray(array)
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetDataModeToBinary()
    writer.SetCompressionLevel(_COMPRESSION)
    # To a string: a full disk is for Python to say.
    writer.WriteToOutputStringOn()
    writer.Write()
    path.write_text(writer.GetOutputString(), "ascii")
