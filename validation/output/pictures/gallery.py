"""Panels beside and below each other, with titles, scale bars, colour bars and a legend.

All pictures are set here, so that all look alike: columns of panels, each as large as its column
allows; colour bars that say where their colours stop and what lies beyond; one line that names
the program and the day.
"""

from __future__ import annotations

import datetime
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.mesh import FloatArray
from validation.output.files import write_whole
from validation.output.pictures.canvas import LARGEST, View
from validation.output.pictures.look import PRINT, look, magnify
from validation.output.provenance import program

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter

#: Okabe–Ito colours: told apart by colour-blind readers.
BLUE, SKY, ORANGE, VERMILION, GREEN, GREY = (
    "#0072B2",
    "#56B4E9",
    "#E69F00",
    "#D55E00",
    "#009E73",
    "#8C8C8C",
)
#: Lines of one plot, one after the other.
OF_LINES = (BLUE, ORANGE, GREEN, VERMILION)
#: Pale is low, dark is high: pressures.
PRESSURE_MAP = "YlGnBu"
#: Compression blue, tension red.
STRESS_MAP = "RdBu_r"
#: Displacements.
MOTION_MAP = "viridis"

# Inches.
_MARGIN, _GAP = 0.3, 0.35
_LINE = 0.2
_FOOT = 0.28
_LEGEND = 0.36
_SCALE_BAR = 0.3
_BAR = 0.7
_SIDE_BAR = 1.25
#: Part of the height asked for that is left to pictures that would be too wide; wider then.
_LEAST_SHARE = 0.4
#: The same before columns go into rows below each other, where a width is asked for.
_LEAST_SHARE_OF_ROWS = 0.75
#: Height of such a row, in its widths.
_TALLEST = 1.4
#: Longest colour bar [in].
_LONGEST_BAR = 4.5
#: Characters of a title in an inch, by its size in points.
_PER_INCH = 132.0
_TITLE, _PANEL_TITLE, _SMALL = 12.5, 10.5, 9.0


@dataclass(frozen=True)
class Scale:
    """Colours of a quantity, and what it reaches."""

    label: str
    """Quantity and unit."""
    colours: str
    """Name of a matplotlib map."""
    low: float
    high: float
    reached: tuple[float, float]
    """Least and largest value there is; beyond the colours, the bar has an arrow."""
    note: str = ""
    """Where the largest value lies, in words."""

    def of(self, values: FloatArray) -> Any:
        """Colours of values, (n, 3) uint8."""
        from matplotlib import colormaps

        span = max(self.high - self.low, 1e-300)
        shades = colormaps[self.colours](np.clip((values - self.low) / span, 0.0, 1.0))
        return (255 * shades[:, :3] + 0.5).astype(np.uint8)

    @property
    def beyond(self) -> str:
        """At which ends of the bar values lie beyond the colours, as matplotlib names it."""
        slack = 1e-9 * max(abs(self.low), abs(self.high))
        below, above = self.reached[0] < self.low - slack, self.reached[1] > self.high + slack
        return {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[below, above]

    @property
    def words(self) -> str:
        """Label, and where the colours stop below what there is, how far it goes."""
        least, most = self.reached
        said = {
            "neither": "",
            "min": f"down to {least:.3g}",
            "max": f"up to {most:.3g}",
            "both": f"from {least:.3g} to {most:.3g}",
        }[self.beyond]
        return ", ".join(part for part in (self._label, said.replace("-", "−")) if part)

    @property
    def power(self) -> int:
        """Power of ten that the numbers at the bar leave out, where they would be too long."""
        largest = max(abs(self.low), abs(self.high))
        power = int(np.floor(np.log10(largest))) if largest > 1e-299 else 0
        return power if not -2 <= power < 4 else 0

    @property
    def _label(self) -> str:
        """Label, its unit with the power of ten."""
        if not self.power:
            return self.label
        raised = str(self.power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        what, bracket, unit = self.label.rpartition("[")
        return f"{what}{bracket}10{raised} {unit}"

    @property
    def lines(self) -> list[str]:
        """All that is written below a bar."""
        return [line for line in (self.words, self.note) if line]


def scale_from_zero(label: str, colours: str, values: Sequence[FloatArray]) -> Scale:
    """Colours from zero to the largest of some values, never empty."""
    most = max((float(v.max(initial=0.0)) for v in values), default=0.0)
    least = min((float(v.min(initial=0.0)) for v in values), default=0.0)
    return Scale(label, colours, 0.0, most or 1e-300, (least, most))


def symmetric_scale(label: str, colours: str, values: Sequence[FloatArray]) -> Scale:
    """Colours ± the 99.8 % quantile: a few singular nodes must not drown the picture."""
    every = np.concatenate([v.ravel() for v in values]) if values else np.zeros(1)
    every = every if len(every) else np.zeros(1)
    reach = max(float(np.quantile(np.abs(every), 0.998)), 1e-300)
    return Scale(label, colours, -reach, reach, (float(every.min()), float(every.max())))


@dataclass(frozen=True)
class Panel:
    """One view or one plot."""

    title: str
    view: View | None = None
    plot: Callable[[Axes], None] | None = None
    """Draws into axes, where there is no view."""
    shape: float = 1.0
    """Width over height of a plot."""
    scale: Scale | None = None
    """Colours of this panel alone: a bar stands below it."""
    ring: FloatArray | None = None
    """Place in the view that its bar speaks of, (3,) [mm]."""
    bare: bool = False
    """Whether a plot has no numbers at its axes, and needs no room for them."""

    @property
    def aspect(self) -> float:
        """Width over height of what is drawn."""
        if self.view is None:
            return self.shape
        width, height = self.view.size
        return float(np.clip(width / height, 0.02, 50.0))

    @property
    def around(self) -> tuple[float, float, float]:
        """Inches to the left and above what is drawn, and below it."""
        left, below = (0.0, _SCALE_BAR) if self.view is not None else (0.62, 0.5)
        if self.bare:
            left, below = 0.0, 0.05
        if self.scale is not None:
            below += _BAR + (0.16 if self.scale.note else 0.0)
        return left, 0.06, below


@dataclass
class _Box:
    """Where a panel's drawing stands in the figure [in], from below left."""

    panel: Panel
    x: float = 0.0
    y: float = 0.0
    width: float = 1.0
    height: float = 1.0
    room: float = 1.0
    """Width of the column."""


@dataclass
class _Layout:
    """Columns of panels in a figure."""

    columns: Sequence[Sequence[Panel]]
    title: str
    height: float
    widest: float
    legend: bool
    scale: Scale | None
    asked: float | None = None
    """Width of the figure that a scene asks for [in]."""
    boxes: list[_Box] = field(default_factory=list)
    width: float = 0.0
    """Of the whole figure [in]."""
    tall: float = 0.0
    """Of the whole figure [in]."""
    title_lines: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Find the largest columns that fit, in rows where a width is asked for."""
        side = _SIDE_BAR if self.scale is not None else 0.0
        room = (self.asked or self.widest) - _MARGIN - side
        rows = [_Row(self.columns, self.height, room, _LEAST_SHARE)]
        if self.asked is not None:
            rows = self._rows(room)
        needed = max(row.right for row in rows) + _MARGIN + side
        self.width = max(needed, self.asked or 5.5)
        top = _FOOT + (_LEGEND if self.legend else 0.0)
        for row in reversed(rows):
            for box in row.boxes:
                box.x += 0.5 * (self.width - needed)
                box.y += top
            self.boxes += row.boxes
            top += row.height + _GAP
        self.title_lines = _wrapped(self.title, self.width - 2 * _MARGIN, _TITLE)
        self.tall = top - _GAP + 0.25 + _LINE * 1.15 * len(self.title_lines)

    def _rows(self, room: float) -> list[_Row]:
        """As many columns in each row as it has room for."""
        rows: list[_Row] = []
        first, height = 0, min(self.height, _TALLEST * room)
        for last in range(1, len(self.columns) + 1):
            row = _Row(self.columns[first:last], height, room, _LEAST_SHARE_OF_ROWS)
            if row.right > room * 1.001 and last - first > 1:
                first = last - 1
                row = _Row(self.columns[first:last], height, room, _LEAST_SHARE)
                rows.append(row)
            else:
                rows[-1:] = [row]
        return rows


class _Row:
    """Columns beside each other, as high as their width allows."""

    def __init__(
        self, columns: Sequence[Sequence[Panel]], height: float, room: float, least: float
    ) -> None:
        share = 1.0
        for _ in range(8):
            self.height = max(
                height * share, *(_fixed(column) + 0.5 * len(column) for column in columns)
            )
            self._set(columns)
            if self.right <= room * 1.001 or share <= least:
                break
            share = max(share * room / self.right, least)

    def _set(self, columns: Sequence[Sequence[Panel]]) -> None:
        self.boxes: list[_Box] = []
        left = _MARGIN
        for column in columns:
            boxes = self._stack(column, self.height)
            before = max(panel.around[0] for panel in column)
            wide = max(box.width for box in boxes)
            wide = max(wide, *(_least_width(panel) for panel in column))
            for box in boxes:
                box.x, box.room = left + before, wide
            self.boxes += boxes
            left += before + wide + _GAP
        #: Where the last column ends [in].
        self.right = left - _GAP

    @staticmethod
    def _stack(column: Sequence[Panel], height: float) -> list[_Box]:
        """Boxes of a column from above, each with room for its title and bars."""
        tall = (height - _fixed(column)) / len(column)
        boxes, top = [], height
        for panel in column:
            _, above, below = panel.around
            top -= _head(panel) + above + tall
            boxes.append(_Box(panel, 0.0, top, tall * panel.aspect, tall))
            top -= below
        return boxes


def _fixed(column: Sequence[Panel]) -> float:
    """Height of the words and bars of a column [in]."""
    return sum(sum(panel.around[1:]) + _head(panel) for panel in column)


def _head(panel: Panel) -> float:
    return _LINE * len(panel.title.split("\n"))


def _least_width(panel: Panel) -> float:
    """Room that the words of a panel need [in]."""
    least = max(1.0, _text_width(panel.title, _PANEL_TITLE) - panel.around[0])
    if panel.scale is None:
        return least
    return max(least, 2.1, *(_text_width(line, _SMALL) for line in panel.scale.lines))


def _text_width(words: str, size: float) -> float:
    """Width of a text [in], about."""
    return max(len(line) for line in words.split("\n")) * size / _PER_INCH


def _wrapped(words: str, inches: float, size: float) -> list[str]:
    count = max(int(inches * _PER_INCH / size), 12)
    return [line for part in words.split("\n") for line in textwrap.wrap(part, count) or [""]]


def gallery(
    columns: Sequence[Sequence[Panel]],
    title: str,
    path: Path,
    *,
    height: float = 7.5,
    widest: float = 16.0,
    scale: Scale | None = None,
    legend: Sequence[Any] = (),
) -> None:
    """Draw panels, those of each column from above, and write them as PNG, SVG or PDF.

    Parameters
    ----------
    height
        Of the columns [in]; less where they would be wider than ``widest``.
    widest
        Of the figure [in].
    scale
        Colours that all panels share: one bar at the side.
    legend
        Handles of matplotlib.
    """
    from matplotlib.figure import Figure

    layout = _Layout(columns, title, height, widest, bool(legend), scale, look().widest)
    size = (layout.width, layout.tall)
    figure = Figure(figsize=size, dpi=_dots(path, size[0]))
    for box in layout.boxes:
        _draw_panel(figure, box)
    figure.text(
        _MARGIN / size[0],
        1 - 0.14 / size[1],
        "\n".join(layout.title_lines),
        fontsize=_TITLE,
        va="top",
        linespacing=1.15,
    )
    if scale is not None:
        shown = layout.tall - _FOOT - 0.9
        long = min(0.6 * shown, _LONGEST_BAR)
        low = _FOOT + 0.5 * (shown - long)
        bar = figure.add_axes(
            (1 - 1.05 / size[0], low / size[1], 0.16 / size[0], long / size[1]),
        )
        colour_bar(figure, bar, scale)
    if legend:
        figure.legend(
            handles=list(legend),
            loc="lower center",
            bbox_to_anchor=(0.5, 0.8 * _FOOT / size[1]),
            ncols=len(legend),
            frameon=False,
            fontsize=10,
        )
    save_figure(figure, path)


def _draw_panel(figure: Figure, box: _Box) -> None:
    """Draw one panel where its box is."""
    panel, (wide, tall) = box.panel, figure.get_size_inches()
    left, above, below = panel.around
    start = box.x
    if panel.view is not None:
        _draw_view(figure, panel, panel.view, box)
    else:
        assert panel.plot is not None
        start -= left
        place = (box.x / wide, box.y / tall, box.width / wide, box.height / tall)
        panel.plot(figure.add_axes(place))
    figure.text(
        start / wide,
        (box.y + box.height + above) / tall,
        panel.title,
        fontsize=_PANEL_TITLE,
        va="bottom",
    )
    if panel.scale is not None:
        # Numbers at the ends of a bar are as wide as the bar is shorter than its column.
        width = min(box.room, 3.4) - 0.5
        middle = box.x + 0.5 * (box.room if box.width < width else box.width)
        first = middle - 0.5 * width
        y = box.y - below + _BAR - 0.28 + (0.16 if panel.scale.note else 0.0)
        bar = figure.add_axes((first / wide, y / tall, width / wide, 0.13 / tall))
        colour_bar(figure, bar, panel.scale, horizontal=True)


def _draw_view(figure: Figure, panel: Panel, view: View, box: _Box) -> None:
    """Show a rendered view with a scale bar of a round length, and its ring."""
    from matplotlib.lines import Line2D

    wide, tall = figure.get_size_inches()
    pixels = _pixels(view, box.width * figure.dpi, box.height * figure.dpi)
    figure.add_artist(_image(pixels, box.x, box.y))
    per_inch = view.size[0] / box.width
    length = round_length(max(0.45 * view.size[0], 0.54 * per_inch))
    y, end = (box.y - 0.12) / tall, box.x + length / per_inch
    bar = Line2D([box.x / wide, end / wide], [y, y], color="black", linewidth=2.5)
    bar.set_solid_capstyle("butt")
    figure.add_artist(bar)
    figure.text((end + 0.06) / wide, y, f"{length:g} mm", va="center", fontsize=_SMALL)
    if panel.ring is not None:
        x, y = view.place(panel.ring)
        place = ((box.x + x / per_inch) / wide, (box.y + y / per_inch) / tall)
        ring = Line2D(*[[v] for v in place], marker="o", mfc="none", mec="black", ms=9, mew=1.4)
        figure.add_artist(ring)


def fill_axes(axes: Axes, view: View) -> None:
    """Show a view that has the shape of some axes in all of them."""
    box = axes.bbox
    pixels = _pixels(view, box.width, box.height)
    axes.patch.set_visible(False)
    figure: Any = axes.figure
    figure.add_artist(_image(pixels, box.x0 / figure.dpi, box.y0 / figure.dpi))


def _pixels(view: View, width: float, height: float) -> Any:
    """Exactly so many pixels of a view, from twice as many each way, so that lines are smooth.

    Where one window has not as many, from as many as it has.
    """
    from PIL import Image

    size = max(round(width), 1), max(round(height), 1)
    more = min(2.0, LARGEST / max(size))
    rendered = Image.fromarray(view.render(*(round(more * side) for side in size)))
    return np.asarray(rendered.resize(size, Image.Resampling.BOX))


def _image(pixels: Any, x: float, y: float) -> Any:
    """Pixels as they are, at a place in a figure [in]: nothing is drawn anew."""
    from matplotlib.artist import Artist

    shown = np.full((*pixels.shape[:2], 4), 255, np.uint8)
    shown[..., :3] = pixels[::-1]

    class Image(Artist):
        """An image that no axes scale."""

        def draw(self, renderer: Any) -> None:
            # Dots of a screen, points of what is printed.
            inch = renderer.points_to_pixels(72.0)
            renderer.draw_image(renderer.new_gc(), x * inch, y * inch, shown)

    return Image()


def round_length(most: float) -> float:
    """Largest of 1, 2, 5, 10, … that is not longer."""
    decade = 10.0 ** np.floor(np.log10(most))
    return float(decade * max(m for m in (1, 2, 5) if m * decade <= most * (1 + 1e-9)))


def colour_bar(figure: Figure, axes: Axes, scale: Scale, *, horizontal: bool = False) -> None:
    """Draw a colour bar; arrows where values go beyond its colours."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    bar = figure.colorbar(
        ScalarMappable(Normalize(scale.low, scale.high), scale.colours),
        cax=axes,
        orientation="horizontal" if horizontal else "vertical",
        extend=scale.beyond,
    )
    ten = 10.0**scale.power
    bar.formatter = FuncFormatter(lambda value, _: f"{value / ten:.3g}".replace("-", "−"))
    bar.locator = MaxNLocator(4 if horizontal else 6)
    bar.set_label("\n".join(scale.lines), fontsize=_SMALL)
    axes.tick_params(labelsize=_SMALL)


# ---------------------------------------------------------------------------------------------
# Files


def twos_and_fives(words: Callable[[float], str]) -> FuncFormatter:
    """Label twos and fives between the decades of an axis."""
    from matplotlib.ticker import FuncFormatter

    return FuncFormatter(lambda value, _: words(value) if f"{value:e}"[0] in "25" else "")


def save_figure(figure: Figure, path: Path, *, about: str = "") -> None:
    """Write a figure as PNG, SVG or PDF, whole or not at all; its foot names program and day."""
    from matplotlib import rc_context

    kind = path.suffix.lower().removeprefix(".")
    today = datetime.date.today().isoformat()
    foot = " · ".join(part for part in (about, f"tubelock {program()}", today) if part)
    width, height = figure.get_size_inches()
    figure.text(
        1 - 0.12 / width,
        0.07 / height,
        foot,
        fontsize=6.5,
        color="#707070",
        ha="right",
        va="bottom",
    )
    _read_no_formulas(figure)
    options: dict[str, Any] = {"dpi": _dots(path, width)}
    if kind == "png":
        options["pil_kwargs"] = {"compress_level": 3}

    def write(partial: Path) -> None:
        figure.savefig(partial, format=kind, metadata=_metadata(kind, foot), **options)
        magnify(partial, kind, look().magnification(width))

    settings: Any = look().settings
    with rc_context(settings):
        write_whole(path, write)


def _dots(path: Path, width: float) -> float:
    """Pixels per inch of a figure, before it is magnified."""
    if path.suffix.lower() != ".png":
        return PRINT
    return look().dots * look().magnification(width)


def subplots(
    rows: int, columns: int, *, size: tuple[float, float], **options: Any
) -> tuple[Figure, Any]:
    """Figure and axes of plots without bodies, set by matplotlib itself; ``size`` in inches."""
    from matplotlib.figure import Figure

    size = look().plot_size(size)
    figure = Figure(figsize=size, layout="constrained")
    # Room for the line at the foot.
    engine: Any = figure.get_layout_engine()
    engine.set(rect=(0.0, 0.2 / size[1], 1.0, 1.0 - 0.2 / size[1]))
    return figure, figure.subplots(rows, columns, **options)


def _metadata(kind: str, foot: str) -> dict[str, str]:
    """What a file says of itself, by the names that its kind has for it."""
    return {
        "png": {"Software": f"tubelock {program()}", "Description": foot},
        "svg": {"Creator": f"tubelock {program()}", "Description": foot},
        "pdf": {"Creator": f"tubelock {program()}", "Subject": foot},
    }[kind]


def _read_no_formulas(figure: Figure) -> None:
    """Take texts as they are: names hold what they like; only numbers at axes have exponents."""
    from matplotlib.legend import Legend
    from matplotlib.text import Text

    for owner in (figure, *figure.axes):
        for child in owner.get_children():
            texts = child.get_texts() if isinstance(child, Legend) else [child]
            for text in texts:
                if isinstance(text, Text):
                    text.set_parse_math(False)
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            axis.label.set_parse_math(False)


def marked(scale: Scale, panel: Panel, point: FloatArray, words: str) -> Panel:
    """Panel with a bar that names where the extreme value lies, and a ring there."""
    return replace(panel, scale=replace(scale, note=words), ring=point)
