"""A field file as a page to turn: vtk.js, without network."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def write_view(field: Path, page: Path) -> bool:
    """Write a self-contained page that shows the pressures of a field file.

    Returns
    -------
    bool
        Whether it could be written: trame-vtk (extra ``report``) has the viewer.
    """
    try:
        from trame_vtk.tools.vtksz2html import embed_data_to_viewer_file
    except ImportError:
        return False
    import pyvista

    from validation.output.pictures.canvas import View
    from validation.output.pictures.view_3d import zipped_scene

    view = View([_coloured(pyvista.read(field))], (1.0, -1.6, 0.7))
    embed_data_to_viewer_file(zipped_scene(view), page)
    return True


def _coloured(mesh: Any) -> Any:
    """Surface with the colours of its pressures as data: no lookup in the browser."""
    import numpy as np

    from validation.output.pictures.canvas import Polygons
    from validation.output.pictures.scales import PRESSURE_MAP, Scale

    name = next(key for key in mesh.cell_data if "pressure" in key)
    values = np.asarray(mesh.cell_data[name])
    top = max(float(np.quantile(values, 0.995)), 1e-300)
    scale = Scale("contact pressure [MPa]", PRESSURE_MAP, 0.0, top, (0.0, float(values.max())))
    surface = mesh.extract_surface(algorithm="dataset_surface")
    cells = (
        surface.regular_faces if surface.is_all_triangles else surface.faces.reshape(-1, 5)[:, 1:]
    )
    shades = scale.of(values[surface.cell_data["vtkOriginalCellIds"]])
    return Polygons(np.asarray(surface.points, dtype=float), np.asarray(cells), shades, lit=False)
