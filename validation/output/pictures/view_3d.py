"""Turnable 3D views for web pages: pyvista scenes in vtk.js, self-contained, without network.

The viewer is the static page of trame-vtk (vtk.js, BSD licence); scenes are serialized as it
expects them. One viewer serves any number of scenes.
"""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import dataclass
from typing import Any

import numpy as np

from validation.output.pictures.canvas import Dots, Lines, Part, Surface, View, quiet
from validation.output.pictures.gallery import Scale


@dataclass(frozen=True)
class View3d:
    """A scene to turn."""

    name: str
    """Identifier in the page."""
    title: str
    note: str
    """What is shown and what the colours mean."""
    poster: bytes
    """Picture shown before the view is opened (WebP)."""
    scene: bytes
    """Zipped vtk.js scene."""
    colour_bar: tuple[str, str, str] | None
    """CSS gradient and the labels of its ends."""


def viewer_page() -> str | None:
    """Text of the viewer page; None without trame-vtk."""
    try:
        from trame_vtk.tools.vtksz2html import HTML_VIEWER_PATH
    except ImportError:
        return None
    return HTML_VIEWER_PATH.read_text("utf-8")


def colour_gradient(colours: str) -> str:
    """CSS gradient of a matplotlib map."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    stops = [to_hex(colormaps[colours](x)) for x in np.linspace(0.0, 1.0, 9)]
    return f"linear-gradient(to right, {', '.join(stops)})"


def make_view(
    name: str,
    title: str,
    note: str,
    view: View,
    *,
    scale: Scale | None = None,
) -> View3d:
    """Render the poster and serialize the scene.

    Parameters
    ----------
    name, title, note
        As in `View3d`.
    view
        Parts, and from where they are first seen.
    scale
        Colours of the parts.
    """
    bar = None
    if scale is not None:
        low, high = (f"{value:.3g}" for value in (scale.low, scale.high))
        bar = (colour_gradient(scale.colours), low, f"{high} {scale.label}")
    width, height = view.size
    longest = 700.0 / max(width, height)
    pixels = view.render(round(longest * width), round(longest * height))
    return View3d(name, title, note, webp(pixels), zipped_scene(view), bar)


def webp(pixels: Any, *, largest: int = 1600) -> bytes:
    """Encode an image (height, width, 3 or 4) as WebP, its longer side at most ``largest``."""
    from PIL import Image

    image = Image.fromarray(pixels)
    image.thumbnail((largest, largest))
    buffer = io.BytesIO()
    image.save(buffer, format="WEBP", quality=88, method=5)
    return buffer.getvalue()


def zipped_scene(view: View) -> bytes:
    """Scene as the zip file that the viewer loads."""
    import pyvista

    with quiet():
        plotter = pyvista.Plotter(off_screen=True, window_size=(600, 600))
    plotter.set_background("white")
    for part in view.parts:
        _add(plotter, part)
    low, high = np.array(plotter.bounds[::2]), np.array(plotter.bounds[1::2])
    centre, reach = (low + high) / 2, float(np.linalg.norm(high - low))
    away = np.array(view.direction) / np.linalg.norm(view.direction)
    plotter.camera_position = [(centre + 2 * reach * away).tolist(), centre.tolist(), (0, 0, 1)]
    plotter.camera.view_angle = 30.0
    plotter.camera.clipping_range = (0.1 * reach, 6 * reach)
    with quiet():
        plotter.render()
    text = json.dumps(_serialized(plotter.render_window))
    plotter.close()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        archive.writestr("index.json", text)
    return buffer.getvalue()


def _add(plotter: Any, part: Part) -> None:
    """Add a part to a plotter, with the colours as data: no lookup in the browser."""
    import pyvista

    if isinstance(part, Dots):
        plotter.add_points(part.points, color=part.colour, point_size=part.size)
        return
    cells = part.polygons if isinstance(part, Surface) else part.segments
    flat = np.insert(cells, 0, cells.shape[1], axis=1).ravel()
    if isinstance(part, Lines):
        mesh = pyvista.PolyData(part.points, lines=flat)
        style = {"color": part.colour, "line_width": part.width, "opacity": part.opacity}
        plotter.add_mesh(mesh, **style)
        return
    mesh = pyvista.PolyData(part.points, flat)
    if isinstance(part.colour, str):
        plotter.add_mesh(mesh, color=part.colour, lighting=part.lit, opacity=part.opacity)
        return
    of_cells = len(part.colour) == len(cells)
    (mesh.cell_data if of_cells else mesh.point_data)["colour"] = part.colour
    plotter.add_mesh(mesh.clean(), scalars="colour", rgb=True, lighting=part.lit)


def _serialized(window: Any) -> dict[str, Any]:
    """State of a render window and the arrays it refers to, as vtk.js synchronizes them."""
    from trame_vtk.modules.vtk.serializers import (
        SynchronizationContext,
        extract_array_hash,
        initialize_serializers,
        reference_id,
        serialize,
    )

    initialize_serializers()
    context = SynchronizationContext()
    context.set_ignore_last_dependencies(True)
    scene = serialize(None, window, reference_id(window), context, 1)
    camera = window.GetRenderers().GetFirstRenderer().GetActiveCamera()
    scene["extra"] = {
        "vtkRefId": reference_id(window),
        "centerOfRotation": camera.GetFocalPoint(),
        "camera": reference_id(camera),
    }
    arrays = {
        entry["hash"]: {
            **entry,
            "content": context.get_cached_data_array(entry["hash"], False),
        }
        for entry in extract_array_hash(scene)
    }
    return {"hashes": arrays, "scene": scene}
