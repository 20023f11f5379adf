"""Figures of the theory pages: ``python -m ext.figures`` in docs writes them into docs/static."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fem.contact.law import ExponentialLaw
from validation.output.pictures.scales import BLUE, GREY, SKY, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STATIC = Path(__file__).parents[1] / "static"


def _arrow(axes: Axes, start: Any, end: Any, **options: Any) -> None:
    """Draw an arrow between two points."""
    style = {"arrowstyle": "->", "color": "black", "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=style | options)


def _contact(axes: Axes, gap: float, title: str) -> None:
    """Two facets with their points, the normal, and the distance between them."""
    x = np.linspace(0.0, 4.0, 41)
    lower, upper = 0.06 * (x - 2.0) ** 2, gap + 0.05 * (x - 2.0) ** 2 + 0.05 * (x - 2.0)
    axes.fill_between(x, lower, -1.4, color=SKY, alpha=0.45, lw=0)
    axes.fill_between(x, upper, 1.9, color=GREY, alpha=0.35, lw=0)
    axes.plot(x, lower, color=BLUE)
    axes.plot(x, upper, color="black")
    axes.plot([2.0, 2.0], [0.0, gap], "o", color=VERMILION, ms=5)
    _arrow(axes, (1.0, 0.06), (1.0, 0.96), color=BLUE)
    axes.text(0.88, 0.5, "n", color=BLUE, ha="right", fontsize=12)
    _arrow(axes, (2.0, 0.0), (2.0, gap), color=VERMILION)
    words = "d: gap n · d > 0" if gap > 0 else "d: overclosure\nx = −n · d > 0"
    place = 0.5 * gap if gap > 0 else gap - 0.4
    axes.text(2.1, place, words, color=VERMILION, va="center", fontsize=10)
    axes.text(0.15, -1.2, "master m", color=BLUE, fontsize=10)
    axes.text(0.15, 1.6, "opposing block s", fontsize=10)
    axes.set_title(title, loc="left", fontsize=11)
    axes.set(xlim=(0, 4), ylim=(-1.4, 1.9), xticks=[], yticks=[], aspect="equal")


def _law(axes: Axes) -> None:
    """Pressure over overclosure of the default law."""
    law = ExponentialLaw()
    x = np.linspace(-2e-3, 7e-3, 200)
    axes.plot(1e3 * x, law.pressure(x), color=BLUE)
    axes.set_xlabel("overclosure x [µm]")
    axes.set_ylabel("pressure p [MPa]")
    axes.axvline(0.0, color=GREY, lw=0.8)
    axes.set_title("default contact law", loc="left", fontsize=11)
    axes.grid(alpha=0.3)


def contact(figure: Any) -> None:
    """Draw gap, normal and overclosure, and the law."""
    left, middle, right = figure.subplots(1, 3)
    _contact(left, 0.75, "open: no pressure")
    _contact(middle, -0.45, "closed: pressure p(x)")
    _law(right)


def _corners(warp: float) -> Any:
    """Corners of a hexahedron in the order of VTK, (8, 2) in an oblique view."""
    flat = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    points = np.array([[x, y, z] for z in (0.0, 1.0) for x, y in flat])
    points[5] += warp * np.array([0.25, -0.1, 0.2])
    points[3] += warp * np.array([-0.15, 0.1, 0.1])
    return points @ np.array([[1.0, 0.15], [0.45, 0.35], [0.0, 1.0]])


def _hexahedron(axes: Axes, corners: Any, title: str) -> None:
    """Edges and numbered corners."""
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)]
    edges += [(k, k + 4) for k in range(4)]
    for a, b in edges:
        style = {"color": GREY, "ls": "--"} if 3 in (a, b) else {"color": "black", "ls": "-"}
        axes.plot(*corners[[a, b]].T, lw=1.2, **style)
    axes.plot(*corners.T, "o", color=BLUE, ms=5)
    for k, point in enumerate(corners):
        axes.annotate(str(k), point, (4, 4), textcoords="offset points", fontsize=10)
    axes.set_title(title, loc="left", fontsize=11)
    axes.set_aspect("equal")
    axes.axis("off")


def _lagrange(axes: Axes, degree: int) -> None:
    """Facet of a high-order element on a curved edge: nodes and contact points."""
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)  # near Gauss–Lobatto points
    inner = np.polynomial.legendre.leggauss(degree + 2)[0] / 2 + 0.5

    def placed(x: Any, y: Any) -> Any:
        return x * 1.6, y + 0.18 * np.sin(2.5 * x) * y

    line = np.linspace(0.0, 1.0, 40)
    for edge in ((line, 0 * line), (line, 0 * line + 1), (0 * line, line), (0 * line + 1, line)):
        axes.plot(*placed(*edge), color="black", lw=1.2)
    for points, look in (
        (nodes, {"marker": "o", "color": BLUE}),
        (inner, {"marker": "x", "color": VERMILION}),
    ):
        x, y = np.meshgrid(points, points)
        name = "nodes" if look["marker"] == "o" else "contact points"
        axes.plot(*placed(x.ravel(), y.ravel()), ls="", ms=5, label=f"{x.size} {name}", **look)
    axes.legend(frameon=False, fontsize=9, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2)
    axes.set_title(f"facet of degree {degree}", loc="left", fontsize=11)
    axes.set_aspect("equal")
    axes.axis("off")


def elements(figure: Any) -> None:
    """Draw the numbering of a hexahedron, its shape in a block, and a high-order facet."""
    left, middle, right = figure.subplots(1, 3)
    _hexahedron(left, _corners(0.0), "reference element, corners 0 to 7")
    _hexahedron(middle, _corners(1.0), "isoparametric: any shape")
    _lagrange(right, 3)


def sector(figure: Any) -> None:
    """Draw one layer of four blocks, and the sector that is solved."""
    from matplotlib.patches import Wedge

    left, right = figure.subplots(1, 2)
    for axes, names in ((left, ("block 0", "1", "2", "3")), (right, ("u", "R u", "", "Rᵀ u"))):
        for k, name in enumerate(names):
            colour, alpha = (BLUE, 0.75) if k == 0 else (SKY, 0.4 if axes is left or name else 0.08)
            box = (45 + 90 * k, 135 + 90 * k)
            axes.add_patch(Wedge((0, 0), 1.6, *box, width=0.4, color=colour, alpha=alpha, lw=0))
            for radius, words in ((1.4, name), (1.0, "" if k or axes is left else "solved")):
                turn = np.radians(90 + 90 * k)
                place = radius * np.cos(turn), radius * np.sin(turn)
                axes.text(*place, words, ha="center", va="center", fontsize=12)
        for angle in np.radians((45, 135, 225, 315) if axes is left else (45, 135)):
            axes.plot(*np.outer([np.cos(angle), np.sin(angle)], [1.2, 1.6]), color="black", lw=1.2)
        axes.set(xlim=(-1.8, 1.8), ylim=(-1.8, 1.9), aspect="equal")
        axes.axis("off")
    left.set_title("ring of n = 4 equal blocks with equal loads", loc="left", fontsize=11)
    right.set_title("sector: neighbours are images, turned by 2π/n", loc="left", fontsize=11)


def write_figures() -> None:
    """Write all figures."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figures: dict[str, Callable[[Any], None]] = {
        "contact-gap": contact,
        "elements": elements,
        "sector": sector,
    }
    for name, draw in figures.items():
        figure = Figure(
            figsize=(10.5, 3.6) if name != "sector" else (8.0, 3.9), layout="constrained", dpi=110
        )
        FigureCanvasAgg(figure)
        draw(figure)
        figure.savefig(STATIC / f"{name}.png")


if __name__ == "__main__":
    write_figures()
