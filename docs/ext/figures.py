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


def _plan(axes: Axes) -> None:
    """Blocks of the first free layer of TSB1 seen from above, with the axes."""
    from matplotlib.patches import Wedge

    for k in range(4):
        box = (90 * k - 15, 90 * k + 75)
        axes.add_patch(Wedge((0, 0), 1.6, *box, width=0.4, fc=SKY, alpha=0.45, ec="black", lw=1))
        turn = np.radians(30 + 90 * k)
        axes.text(1.4 * np.cos(turn), 1.4 * np.sin(turn), f"{4 + k}", ha="center", va="center")
    for x, y, name in ((1.0, 0.0, "x"), (0.0, 1.0, "y")):
        _arrow(axes, (0, 0), (x, y))
        axes.text(0.9 * x + 0.08 * y, 0.9 * y + 0.08 * x, name, fontsize=11)
    arc = 0.55 * np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0.05, 1.1, 20)])
    axes.plot(*arc.T, color=VERMILION)
    _arrow(axes, arc[-2], arc[-1], color=VERMILION)
    axes.text(0.55, 0.32, "θ", color=VERMILION, fontsize=12)
    axes.set(xlim=(-1.8, 1.8), ylim=(-1.8, 1.8), aspect="equal")
    axes.set_title("layer 1 from above: its blocks", loc="left", fontsize=11)
    axes.axis("off")


def _elevation(axes: Axes) -> None:
    """Layers of a tube of two free layers, and what lies where along its axis."""
    for layer, (low, high) in enumerate(((-0.5, 0.0), (0.0, 1.0), (1.0, 2.0), (2.0, 2.5))):
        held = layer in (0, 3)
        axes.fill_between((0, 2), low, high, color=GREY if held else SKY, alpha=0.45, lw=0)
        axes.plot((0, 2), (low, low), color="black", lw=1)
        first = 4 * layer
        name = "fixed end ring (frame)" if held else "free"
        words = f"layer {layer}: blocks {first} to {first + 3}\n{name}"
        axes.text(1.0, 0.5 * (low + high), words, ha="center", va="center", fontsize=9)
    axes.plot((0, 0, 2, 2, 0), (-0.5, 2.5, 2.5, -0.5, -0.5), color="black", lw=1)
    _arrow(axes, (-0.25, 0.0), (-0.25, 2.3))
    for z, name in ((0.0, "0"), (1.0, "h"), (2.0, "2 h")):
        axes.plot((-0.3, -0.2), (z, z), color="black", lw=1)
        axes.text(-0.36, z, name, ha="right", va="center", fontsize=10)
    axes.text(-0.36, 2.3, "z", ha="right", va="center", fontsize=11)
    axes.set(xlim=(-0.8, 2.1), ylim=(-0.7, 2.7))
    axes.set_title("layers of a tube of two", loc="left", fontsize=11)
    axes.axis("off")


def _signs(axes: Axes) -> None:
    """Two blocks of a joint: normal, gap, pressure, load and stress that count as positive."""
    axes.fill_between((0, 3), 0.0, 1.2, color=SKY, alpha=0.45, lw=0)
    axes.fill_between((0, 3), 1.6, 2.8, color=GREY, alpha=0.35, lw=0)
    axes.text(0.1, 0.1, "master m", fontsize=10)
    axes.text(0.1, 2.6, "opposing s", fontsize=10)
    _arrow(axes, (0.5, 1.2), (0.5, 2.1), color=BLUE)
    axes.text(0.42, 1.85, "n", color=BLUE, ha="right", fontsize=12)
    _arrow(axes, (1.1, 1.2), (1.1, 1.6), color=VERMILION, arrowstyle="<->")
    axes.text(1.18, 1.4, "gap > 0: open", color=VERMILION, va="center", fontsize=10)
    for x in (2.5, 2.75):
        _arrow(axes, (x, 1.6), (x, 2.0), color=VERMILION)
        _arrow(axes, (x, 1.2), (x, 0.8), color=VERMILION)
    axes.text(2.15, 2.05, "contact pressure ≥ 0\npushes blocks apart", ha="center", fontsize=9)
    for x in (1.0, 1.3, 1.6):
        _arrow(axes, (x, 3.25), (x, 2.8))
    axes.text(1.75, 3.05, "load pressure > 0", va="center", fontsize=10)
    _arrow(axes, (1.2, 0.45), (0.8, 0.45))
    _arrow(axes, (1.6, 0.45), (2.0, 0.45))
    axes.text(1.4, 0.55, "σ > 0: tension", ha="center", fontsize=10)
    axes.set(xlim=(-0.1, 3.7), ylim=(-0.1, 3.4))
    axes.set_title("signs", loc="left", fontsize=11)
    axes.axis("off")


def _effective(face: Axes, bars: Axes) -> None:
    """Facets of a block with their pressures; those that p_eff is the mean of."""
    from matplotlib.collections import PolyCollection

    from fem import Problem, concrete
    from geometry import SineBlock, pipe, tube
    from mbd import analyse

    shape = SineBlock(
        height=200, amplitude=20, frequency=1.5, blocks_per_layer=4, inner_radius=120, thickness=40
    )
    answer = analyse(Problem(tube(shape, layers=2, mesh=(24, 4, 6)), pipe(0.01), concrete))
    own = np.flatnonzero((answer.contacts["blocks"] == 4).any(axis=1))
    pressure = answer.contacts["pressure"][own]
    mesh = answer.contact_mesh()
    count = int(pressure.sum() ** 2 / (pressure**2).sum())
    largest = np.argsort(-pressure)
    chosen = set(largest[:count].tolist())
    upper = answer.contacts["blocks"][own, 0] == 4
    polygons, colours, edges = [], [], []
    for place in np.flatnonzero(upper & (answer.contacts["blocks"][own, 1] >= 8)):
        points = mesh.get_cell(int(own[place])).points
        turn = np.degrees(np.unwrap(np.arctan2(points[:, 1], points[:, 0])))
        polygons.append(np.column_stack([turn, np.linalg.norm(points[:, :2], axis=1)]))
        colours.append(pressure[place])
        edges.append(VERMILION if place in chosen else GREY)
    order = np.argsort([edge == VERMILION for edge in edges], kind="stable")
    drawn = PolyCollection(
        [polygons[k] for k in order],
        array=np.array(colours)[order],
        cmap="YlGnBu",
        edgecolors=[edges[k] for k in order],
        linewidths=[1.6 if edges[k] == VERMILION else 0.5 for k in order],
    )
    face.add_collection(drawn)
    face.autoscale_view()
    face.figure.colorbar(drawn, ax=face, label="pressure p [MPa]")
    face.set(xlabel="θ [°]", ylabel="radius [mm]")
    title = "upper face of block 4: facets of [mesh], effective ones framed"
    face.set_title(title, loc="left", fontsize=11)
    heights = pressure[largest]
    kinds = [BLUE if place in chosen else SKY for place in largest]
    bars.bar(np.arange(1, heights.size + 1), heights, color=kinds, width=1.0)
    effective = heights[:count].mean()
    bars.plot((0.5, count + 0.5), (effective, effective), color=VERMILION)
    words = (
        f"p_eff of the block {effective:.3f}: mean of its\nK = ⌊(Σp)²/Σp²⌋ = {count} largest facets"
    )
    bars.text(count + 2, effective, words, color=VERMILION, va="center", fontsize=10)
    bars.annotate(
        f"largest: {heights[0]:.3f}; p_max is the\nmean of these over blocks",
        (1, heights[0]),
        (count + 2, 0.92 * heights[0]),
        va="center",
        fontsize=10,
        arrowprops={"arrowstyle": "->"},
    )
    bars.set(
        xlabel=f"its {heights.size} facets by pressure", ylabel="p [MPa]", xlim=(0.5, 3 * count)
    )
    bars.set_title("p_eff and p_max", loc="left", fontsize=11)


def conventions(figure: Any) -> None:
    """Draw axes, numbers, signs, facets and the paper's means."""
    grid = figure.add_gridspec(2, 6)
    _plan(figure.add_subplot(grid[0, :2]))
    _elevation(figure.add_subplot(grid[0, 2:4]))
    _signs(figure.add_subplot(grid[0, 4:]))
    _effective(figure.add_subplot(grid[1, :3]), figure.add_subplot(grid[1, 3:]))


#: Width and height of a figure [inch].
SIZES = {"conventions": (12.0, 7.6), "sector": (8.0, 3.9)}


def write_figures() -> None:
    """Write all figures."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figures: dict[str, Callable[[Any], None]] = {
        "contact-gap": contact,
        "conventions": conventions,
        "elements": elements,
        "sector": sector,
    }
    for name, draw in figures.items():
        figure = Figure(figsize=SIZES.get(name, (10.5, 3.6)), layout="constrained", dpi=110)
        FigureCanvasAgg(figure)
        draw(figure)
        figure.savefig(STATIC / f"{name}.png")


if __name__ == "__main__":
    write_figures()
