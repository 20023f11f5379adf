"""What is seen, from where, and how large: bodies rendered off screen in parallel projection.

A view is a list of parts, each one set of polygons or lines however many blocks are in it, so a
tube of sixty blocks costs as much as one body. One window renders all views of a thread. VTK is
used without pyvista: importing that takes longer than drawing most pictures.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from geometry.files.vtu import as_array, as_cells, as_points
from geometry.machine.system import address_space_left
from geometry.machine.work import LimitError
from geometry.mesh import FloatArray, IntArray

Pixels = npt.NDArray[np.uint8]
Direction = tuple[float, float, float]

#: Dark grey of outlines.
INK = "#303030"


@dataclass(frozen=True)
class Polygons:
    """Polygons."""

    points: FloatArray
    """(n_points, 3) [mm]; all are drawn."""
    polygons: IntArray
    """Points of each polygon, (n_polygons, n_corners)."""
    colour: str | Pixels
    """One for all, or (n_polygons, 3) or (n_points, 3)."""
    lit: bool = True
    """Whether shades show the shape; else colours stay what they mean."""
    opacity: float = 1.0
    two_sided: bool = True
    """Whether polygons are seen from behind too."""


@dataclass(frozen=True)
class Lines:
    """Straight lines."""

    points: FloatArray
    """(n_points, 3) [mm]."""
    segments: IntArray
    """Both ends of each, (n, 2)."""
    colour: str = INK
    width: float = 1.0
    """[px]"""
    opacity: float = 1.0


@dataclass(frozen=True)
class Dots:
    """Points drawn as discs of one size."""

    points: FloatArray
    """(n, 3) [mm]."""
    colour: str
    size: float = 10.0
    """[px]"""


Part = Polygons | Lines | Dots


def merged(
    bodies: Iterable[tuple[FloatArray, IntArray]], n_corners: int
) -> tuple[FloatArray, IntArray]:
    """Points (n, 3) and cells (n, n_corners) of several bodies as those of one part."""
    points, cells, count = [np.zeros((0, 3))], [np.zeros((0, n_corners), dtype=np.int64)], 0
    for own, corners in bodies:
        points.append(own)
        cells.append(corners + count)
        count += len(own)
    return np.concatenate(points), np.concatenate(cells)


@dataclass(frozen=True)
class View:
    """Parts seen from a direction, z upward."""

    parts: Sequence[Part]
    direction: Direction
    """From the parts towards the eye."""
    margin: float = 0.01
    """Share of the size left free for the width of lines."""
    weight: Sequence[float] | None = None
    """Acceleration of all bodies, (3,) [mm/s²]: an arrow beside the axes shows where it acts."""
    window: tuple[FloatArray, FloatArray] | None = None
    """Lower left and upper right corner of what is shown, (2,) each along `axes` [mm]: by default
    all."""

    @cached_property
    def axes(self) -> FloatArray:
        """Unit vectors to the right, up and towards the eye, (3, 3)."""
        towards = np.array(self.direction) / np.linalg.norm(self.direction)
        up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
        right = np.cross(up, towards)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(towards, right), towards])

    @cached_property
    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        seen = [part.points @ self.axes.T for part in self.parts if len(part.points)]
        if not seen:
            return np.zeros(3), np.ones(3)
        points = np.concatenate(seen)
        low, high = points.min(axis=0), points.max(axis=0)
        if self.window is not None:
            low[:2], high[:2] = self.window
        return low, high

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of what is seen [mm]."""
        low, high = self._bounds
        width, height = np.maximum(high - low, 1e-9 * float((high - low).max() or 1.0))[:2]
        return float(width), float(height)

    @property
    def corner(self) -> FloatArray:
        """The lower left and far end of what is seen, along `axes`, (3,) [mm]."""
        return self._bounds[0]

    def place(self, point: FloatArray) -> tuple[float, float]:
        """Where a point is seen: from the left and from below [mm]."""
        x, y, _ = self.axes @ point - self._bounds[0]
        return float(x), float(y)

    def render(self, width: int, height: int) -> Pixels:
        """Picture of exactly so many pixels, (height, width, 3), white where nothing is."""
        return _render(self, width, height)


# ---------------------------------------------------------------------------------------------
# VTK


@contextmanager
def quiet(number: int = 2) -> Iterator[None]:
    """Hide what libraries print: VTK's notes about a missing display, whose fallback is meant.

    ``number`` is that of the stream, 1 or 2.
    """
    stream = (sys.stdout, sys.stderr)[number - 1]
    stream.flush()
    saved = os.dup(number)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, number)
    try:
        yield
    finally:
        stream.flush()
        os.dup2(saved, number)
        os.close(null)
        os.close(saved)


#: Windows of threads: what renders belongs to the thread that made it.
_WINDOWS = threading.local()


#: Addresses that VTK and its window take, measured with VTK 9.7: 0.8 [GB].
_SPACE = 1.0


def _window() -> Any:
    """The window of all views of this thread."""
    if not hasattr(_WINDOWS, "window"):
        _WINDOWS.window = _made_window()
    return _WINDOWS.window


def _made_window() -> Any:
    left = address_space_left() / 2**30
    if left < _SPACE:  # VTK ends the process without a word
        raise LimitError(
            "memory",
            f"pictures of blocks need about {_SPACE:g} GB of addresses, and the limit of this "
            f"process leaves {max(left, 0.0):.2g} (ulimit -v); raise it, or take --json without -o",
        )
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401 - what renders
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    with quiet():
        window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)  # several samples a pixel take three times as long
    return window


#: Most pixels along one side of the window.
LARGEST = 4096


def _render(view: View, width: int, height: int) -> Pixels:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

    width, height = min(max(width, 1), LARGEST), min(max(height, 1), LARGEST)
    bytes_ = vtkUnsignedCharArray()
    with rendered(view, width, height) as window, quiet():
        window.GetPixelData(0, 0, width - 1, height - 1, 0, bytes_, 0)
    # VTK counts rows from below.
    pixels = vtk_to_numpy(bytes_).reshape(height, width, 3)[::-1]
    return np.ascontiguousarray(pixels)


@contextmanager
def rendered(view: View, width: int, height: int) -> Iterator[Any]:
    """VTK's window with a view in it; where it shows the same parts still, the camera moves."""
    window = _window()  # before all else: it brings what renders
    parts, renderer = getattr(_WINDOWS, "shown", (None, None))
    if parts is not view.parts:
        from vtkmodules.vtkRenderingCore import vtkRenderer

        if renderer is not None:
            window.RemoveRenderer(renderer)
        renderer = vtkRenderer()
        renderer.SetBackground(1.0, 1.0, 1.0)
        # Blending in any order takes textures of all pixels; thin lines look the same without.
        renderer.SetUseOIT(any(isinstance(p, Polygons) and p.opacity < 1.0 for p in view.parts))
        for part in view.parts:
            if len(part.points):
                renderer.AddActor(_actor(part))
        window.AddRenderer(renderer)
        _WINDOWS.shown = view.parts, renderer
    assert renderer is not None
    _aim(renderer.GetActiveCamera(), view, width / height)
    window.SetSize(width, height)
    with quiet():
        window.Render()
    yield window


def _aim(camera: Any, view: View, shape: float) -> None:
    """Look at all of a view; ``shape`` is width over height."""
    low, high = view._bounds
    centre = view.axes.T @ ((low + high) / 2)
    deep = float(np.linalg.norm(high - low))
    camera.SetParallelProjection(1)
    camera.SetFocalPoint(*centre)
    camera.SetPosition(*(centre + 2.0 * deep * view.axes[2]))
    camera.SetViewUp(*view.axes[1])
    camera.SetClippingRange(0.5 * deep, 3.5 * deep)
    width, height = view.size
    camera.SetParallelScale(0.5 * (1.0 + view.margin) * max(height, width / shape))


def _actor(part: Part) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkPolyData
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

    if isinstance(part, Polygons):
        part = _coloured_by_points(part)
    data = vtkPolyData()
    data.SetPoints(as_points(part.points))
    mapper, actor = vtkPolyDataMapper(), vtkActor()
    look = actor.GetProperty()
    if isinstance(part, Polygons):
        data.SetPolys(as_cells(part.polygons))
        _colour_surface(part, data, mapper, look)
    elif isinstance(part, Lines):
        data.SetLines(as_cells(part.segments))
        look.SetColor(*(rgb(part.colour) / 255))
        look.SetLineWidth(part.width)
        look.SetOpacity(part.opacity)
        look.LightingOff()
        # Lines lie on surfaces, and are seen.
        mapper.SetResolveCoincidentTopologyToPolygonOffset()
        mapper.SetRelativeCoincidentTopologyLineOffsetParameters(-1.0, -4.0)
    else:
        data.SetVerts(as_cells(np.arange(len(part.points))[:, None]))
        look.SetColor(*(rgb(part.colour) / 255))
        look.SetPointSize(part.size)
        look.SetRenderPointsAsSpheres(True)
    mapper.SetInputData(data)
    actor.SetMapper(mapper)
    return actor


def _coloured_by_points(part: Polygons) -> Polygons:
    """The same with colours of points: VTK has another program, slower, for those of polygons."""
    shades = part.colour
    if isinstance(shades, str) or len(shades) == len(part.points) != len(part.polygons):
        return part
    count, size = part.polygons.shape
    return replace(
        part,
        points=part.points[part.polygons].reshape(-1, 3),
        polygons=np.arange(count * size).reshape(count, size),
        colour=np.repeat(shades, size, axis=0),
    )


def _colour_surface(part: Polygons, data: Any, mapper: Any, look: Any) -> None:
    look.SetOpacity(part.opacity)
    look.SetInterpolationToFlat()
    look.SetBackfaceCulling(not part.two_sided)
    if part.lit:
        look.SetAmbient(0.35)
        look.SetDiffuse(0.75)
    else:
        look.LightingOff()
    if isinstance(part.colour, str):
        look.SetColor(*(rgb(part.colour) / 255))
        return
    data.GetPointData().SetScalars(as_array(part.colour))
    mapper.SetColorModeToDirectScalars()


def rgb(colour: str) -> Pixels:
    """Channels of ``#rrggbb``, (3,)."""
    return np.frombuffer(bytes.fromhex(colour[1:]), dtype=np.uint8)
