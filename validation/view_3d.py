"""Turnable 3D views for web pages: pyvista scenes in vtk.js, self-contained, without network.

The viewer is the static page of trame-vtk (vtk.js, BSD licence); scenes are serialized as it
expects them. One viewer serves any number of scenes.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.mesh import FloatArray, IntArray
from validation.rendering import polydata, render


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
    text: str = HTML_VIEWER_PATH.read_text("utf-8")
    return text


def coloured_surface(
    points: FloatArray,
    quads: IntArray,
    values: FloatArray,
    colours: str,
    limits: tuple[float, float],
) -> Any:
    """Quadrilaterals coloured by cell, with the colours as data (no lookup in the browser).

    Parameters
    ----------
    points, quads
        (n, 3) [mm] and (m, 4).
    values
        (m,)
    colours
        Name of a matplotlib map.
    limits
        Values of its ends.
    """
    from matplotlib import colormaps

    surface = polydata(points, quads)
    span = max(limits[1] - limits[0], 1e-300)
    shade = colormaps[colours](np.clip((values - limits[0]) / span, 0.0, 1.0))
    surface.cell_data["colour"] = (255 * shade[:, :3]).astype(np.uint8)
    return surface


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
    draw: Callable[[Any], None],
    direction: tuple[float, float, float],
    *,
    colour_bar: tuple[str, str, str] | None = None,
) -> View3d:
    """Render the poster and serialize the scene.

    Parameters
    ----------
    name, title, note, colour_bar
        As in `View3d`.
    draw
        Adds meshes to the plotter it is given.
    direction
        From the scene towards the eye.
    """
    image = render(draw, direction, height=700)
    return View3d(name, title, note, webp(image.pixels), zipped_scene(draw, direction), colour_bar)


def webp(pixels: Any, *, largest: int = 1600) -> bytes:
    """Encode an image (height, width, 3 or 4) as WebP, its longer side at most ``largest``."""
    from PIL import Image

    image = Image.fromarray(pixels)
    image.thumbnail((largest, largest))
    buffer = io.BytesIO()
    image.save(buffer, format="WEBP", quality=88, method=5)
    return buffer.getvalue()


def zipped_scene(draw: Callable[[Any], None], direction: tuple[float, float, float]) -> bytes:
    """Scene of a plotter as the zip file that the viewer loads."""
    import pyvista

    from validation.rendering import quiet

    with quiet():
        plotter = pyvista.Plotter(off_screen=True, window_size=(600, 600))
    plotter.set_background("white")
    draw(plotter)
    low, high = np.array(plotter.bounds[::2]), np.array(plotter.bounds[1::2])
    centre, reach = (low + high) / 2, float(np.linalg.norm(high - low))
    away = np.array(direction) / np.linalg.norm(direction)
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
