"""Pictures: pyvista renders bodies off screen in parallel projection, matplotlib sets the rest.

Colours are safe for colour-blind readers: Okabe–Ito for kinds, a perceptually uniform map for
pressures whose pale end is no contact, a blue–red map for stresses.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from validation.files import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Okabe–Ito colours.
BLUE, SKY, ORANGE, VERMILION, GREEN, GREY = (
    "#0072B2",
    "#56B4E9",
    "#E69F00",
    "#D55E00",
    "#009E73",
    "#8C8C8C",
)
#: Pale is low, dark is high.
PRESSURE_MAP = "YlGnBu"


#: Diverging: compression blue, tension red.
STRESS_MAP = "RdBu_r"


@contextmanager
def quiet() -> Iterator[None]:
    """Hide VTK's notes about a missing display: the off-screen fallback that follows is meant."""
    sys.stderr.flush()
    saved = os.dup(2)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        sys.stderr.flush()
        os.dup2(saved, 2)
        os.close(null)
        os.close(saved)


@dataclass(frozen=True)
class Rendered:
    """An image in parallel projection, cropped to what it shows."""

    pixels: npt.NDArray[np.uint8]
    """(height, width, 3)."""
    size_of_pixel: float
    """Length that one pixel spans in the plane of the picture [mm]."""


def render(
    draw: Callable[[Any], None], direction: tuple[float, float, float], *, height: int = 1400
) -> Rendered:
    """Render what ``draw`` adds to a plotter, seen from ``direction``, z upward.

    Parameters
    ----------
    draw
        Adds meshes to the plotter it is given.
    direction
        From the scene towards the eye.
    height
        Pixels along the longer side, before cropping.
    """
    import pyvista

    with quiet():
        plotter = pyvista.Plotter(off_screen=True, window_size=(height, height), border=False)
    plotter.set_background("white")
    draw(plotter)
    low, high = np.array(plotter.bounds[::2]), np.array(plotter.bounds[1::2])
    centre, reach = (low + high) / 2, float(np.linalg.norm(high - low))
    away = np.array(direction) / np.linalg.norm(direction)
    plotter.camera_position = [(centre + 2 * reach * away).tolist(), centre.tolist(), (0, 0, 1)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.52 * reach
    plotter.camera.clipping_range = (0.1 * reach, 4 * reach)
    with quiet():
        pixels = plotter.screenshot(None, return_img=True)
    plotter.close()
    shown = np.argwhere((pixels < 250).any(axis=2))
    if len(shown):
        (top, left), (bottom, right) = shown.min(axis=0), shown.max(axis=0) + 1
        pixels = pixels[top:bottom, left:right]
    return Rendered(pixels, 2 * 0.52 * reach / height)


def place(axes: Axes, image: Rendered, title: str) -> None:
    """Show an image with a title and a scale bar of a round length."""
    height, width = image.pixels.shape[:2]
    axes.imshow(image.pixels, interpolation="lanczos")
    axes.set_axis_off()
    axes.set_title(title, fontsize=11, loc="left")
    span = 0.45 * width * image.size_of_pixel
    decade = 10.0 ** np.floor(np.log10(span))
    bar = decade * max(m for m in (1, 2, 5) if m * decade <= span)
    y = height * 1.02 + 12
    length = bar / image.size_of_pixel
    axes.plot([0, length], [y, y], color="black", linewidth=2.5, solid_capstyle="butt")
    axes.text(length * 1.06, y, f"{bar:g} mm", va="center", fontsize=9)
    axes.set_xlim(-4, width + 4)
    axes.set_ylim(y + 18, -8)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole or not at all, and close it."""
    import matplotlib.pyplot as plt

    write_whole(path, lambda partial: figure.savefig(partial, dpi=130, format="png"))
    plt.close(figure)


def polydata(points: npt.NDArray[np.float64], quads: npt.NDArray[np.int64]) -> Any:
    """Quadrilaterals (n, 4) over points (m, 3) as pyvista takes them."""
    import pyvista

    faces = np.hstack([np.full((len(quads), 1), 4), quads]).ravel()
    return pyvista.PolyData(points, faces)
