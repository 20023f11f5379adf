"""Turnable 3D views for web pages: scenes of vtk.js, self-contained, without network.

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

from validation.output.pictures.canvas import View, rendered
from validation.output.pictures.scales import Scale


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


def colour_gradient(scale: Scale) -> str:
    """CSS gradient of a scale."""
    shades = scale.of(np.linspace(scale.low, scale.high, 9))
    return f"linear-gradient(to right, {', '.join('#' + bytes(rgb).hex() for rgb in shades)})"


def make_view(
    name: str, title: str, note: str, view: View, *, scale: Scale | None = None
) -> View3d:
    """Render the poster and serialize the scene of parts in the colours of a scale."""
    bar = None
    if scale is not None:
        low, high = (f"{value:.3g}" for value in (scale.low, scale.high))
        unit = scale.label.rpartition("[")[2].rstrip("]")
        bar = (colour_gradient(scale), low, f"{high} {unit}")
    width, height = view.size
    longest = 700.0 / max(width, height)
    pixels = view.render(round(longest * width), round(longest * height))
    return View3d(name, title, note, webp(pixels), zipped_scene(view), bar)


def webp(pixels: Any) -> bytes:
    """Encode an image (height, width, 3 or 4) as WebP, its longer side at most 1600 pixels."""
    from PIL import Image

    image = Image.fromarray(pixels)
    image.thumbnail((1600, 1600))
    buffer = io.BytesIO()
    image.save(buffer, format="WEBP", quality=88, method=5)
    return buffer.getvalue()


def zipped_scene(view: View) -> bytes:
    """Scene as the zip file that the viewer loads."""
    with rendered(view, 600, 600) as window:
        text = json.dumps(_serialized(window))
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

    camera = window.GetRenderers().GetFirstRenderer().GetActiveCamera()
    camera.ParallelProjectionOff()
    initialize_serializers()
    context = SynchronizationContext()
    context.set_ignore_last_dependencies(True)
    scene = serialize(None, window, reference_id(window), context, 1)
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
