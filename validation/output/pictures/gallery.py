"""Panels beside and below each other, with titles, scale bars, colour bars and a legend.

All pictures are set here, so that all look alike: columns of panels, each as large as its column
allows; colour bars that say where their colours stop and what lies beyond; one line that names
the program and the day.
"""

from __future__ import annotations

import datetime
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.mesh import FloatArray
from geometry.system import write_whole
from validation.output.pictures.canvas import LARGEST, View
from validation.output.pictures.look import PRINT, look
from validation.output.pictures.scales import VERMILION, Scale, colour_bar
from validation.output.provenance import program

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter

#: Inches at nominal letters: round all panels, round each, of the line at the foot, of a legend.
_MARGIN, _PAD, _FOOT, _LEGEND = 0.2, 0.1, 0.2, 0.36
#: The same: room of the bar at the side, of each line beside it, thickness of bars, longest.
_SIDE, _SIDE_LINE, _BAR, _LONGEST_BAR = 0.95, 0.16, 0.15, 4.5
#: The same: least height of a panel, least width of a view, and of a figure of free width.
_LEAST_PANEL, _LEAST_VIEW, _LEAST_PAGE = 0.5, 1.5, 5.5
#: The same, from the lower left corner of a view: its scale bar, and its axes.
_AT_BAR, _AT_AXES = (0.58, -0.28), (0.22, -0.3)
#: The same: length of arrows; shorter than that part of it, they point at the reader.
_ARROW, _SEEN_ALONG = 0.17, 0.08
#: The same: height of a line of a title, and letters of it in an inch.
_TITLE_LINE, _TITLE_LETTERS = 0.21, 10.5
#: Part of the height asked for that is left to pictures that would be too wide; wider then.
_LEAST_SHARE = 0.4
#: The same before columns go into rows below each other, where a width is asked for.
_LEAST_SHARE_OF_ROWS = 0.75
#: Height of such a row, in its widths.
_TALLEST = 1.4
#: Halvings of the range in which the height of a row is sought.
_HALVINGS = 12
#: Dots per inch at which matplotlib measures words.
_MEASURING = 100


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
    labels: Sequence[tuple[str, FloatArray]] = ()
    """Words on the view, and where: from its left and from below, (2,) [mm]."""

    @property
    def aspect(self) -> float:
        """Width over height of what is drawn."""
        if self.view is None:
            return self.shape
        width, height = self.view.size
        return float(np.clip(width / height, 0.02, 50.0))


#: Columns of panels beside each other, those of each column from above.
_Columns = Sequence[Sequence[Panel]]


def gallery(
    columns: _Columns,
    title: str,
    path: Path,
    *,
    height: float = 7.5,
    widest: float = 16.0,
    scale: Scale | Sequence[Scale] | None = None,
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
        Colours that all panels share: one bar at the side. Several: one for each row of panels;
        rows with the same colours share a bar.
    legend
        Handles of matplotlib.
    """
    from matplotlib import rc_context

    bars = [] if scale is None else [scale] if isinstance(scale, Scale) else list(scale)
    zoom, requested = look().zoom, look().inches
    while True:
        with rc_context(look().settings(zoom)):
            page = _Page(title, legend, bars, zoom)
            page.lay_out(columns, height * zoom, requested or widest * zoom, requested is not None)
            if requested is None or page.needed <= requested * 1.001:
                look().fitted(zoom)
                page.draw(_dots(path))
                save_figure(page.figure, path)
                return
        zoom *= 0.98 * requested / page.needed


# ---------------------------------------------------------------------------------------------
# Layout


@dataclass(frozen=True)
class _Column:
    """What a column of panels needs [in]."""

    panels: Sequence[Panel]
    beside: float
    """Beside its axes: numbers and labels."""
    between: float
    """Above, between and below its axes: words and bars."""
    words: float
    """Width of the widest words above and below its axes."""
    least: float
    """Height of axes below which there is nothing to see."""

    def width(self, height: float) -> float:
        """Of all the column, where it is so high."""
        each = (height - self.between) / len(self.panels)
        return self.beside + max(self.words, each * max(panel.aspect for panel in self.panels))

    @property
    def least_height(self) -> float:
        """Of the column."""
        return self.between + self.least * len(self.panels)


class _Row:
    """Columns beside each other, as high as their width allows."""

    def __init__(
        self, columns: Sequence[_Column], height: float, room: float, least: float
    ) -> None:
        self.columns = columns
        low = max(height * least, *(column.least_height for column in columns))
        self.height = high = max(height, low)
        for _ in range(_HALVINGS if self._wider(high, room) else 0):
            self.height = 0.5 * (low + high)
            low, high = (
                (low, self.height) if self._wider(self.height, room) else (self.height, high)
            )
        self.widths = [column.width(self.height) for column in columns]

    def _wider(self, height: float, room: float) -> bool:
        """Whether the columns are wider than their room where they are so high."""
        return sum(column.width(height) for column in self.columns) > room * 1.001


def _rows(columns: Sequence[_Column], height: float, room: float) -> list[_Row]:
    """As many columns in each row as it has room for."""
    rows: list[_Row] = []
    first = 0
    for last in range(1, len(columns) + 1):
        row = _Row(columns[first:last], height, room, _LEAST_SHARE_OF_ROWS)
        if sum(row.widths) > room * 1.001 and last - first > 1:
            first = last - 1
            rows.append(_Row(columns[first:last], height, room, _LEAST_SHARE))
        else:
            rows[-1:] = [row]
    return rows


@dataclass
class _Drawing:
    """One panel in a figure."""

    panel: Panel
    row: int
    """Of the figure."""
    column: int
    """Of the row."""
    place: int
    """From above in its column."""
    axes: Any
    bar: Any = None
    """Axes of its colour bar."""
    limits: Any = None
    """Of a plot before a layout widens them."""


class _Page:
    """Panels in a figure that matplotlib's constrained layout sets, twice.

    The first time measures what words and bars need beside what is drawn; then each column becomes
    as wide as its panels are at their height, and the figure as wide as its columns. Most of the
    time goes into axes and their words, so both times have the same ones.
    """

    def __init__(
        self, title: str, legend: Sequence[Any], scales: Sequence[Scale], zoom: float
    ) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.title, self.legend, self.scales, self.zoom = title, legend, scales, zoom
        lines = max((len(scale.lines) for scale in scales), default=0)
        #: Room at the side: for a bar, its numbers, and the lines beside them [in].
        self.side = (_SIDE + _SIDE_LINE * lines) * zoom if scales else 0.0
        self.figure = Figure(dpi=_MEASURING, layout="constrained")
        FigureCanvasAgg(self.figure)
        self.words = self.figure.text(0.0, 0.0, "", fontsize="large", va="top", linespacing=1.15)
        self.drawings: list[_Drawing] = []

    def lay_out(self, columns: _Columns, height: float, widest: float, fixed: bool) -> None:
        """Set columns in a figure, in rows below each other where its width is fixed [in]."""
        edges = 2 * _MARGIN * self.zoom + self.side
        trial = [height * max(p.aspect for p in c) / len(c) + 2 * self.zoom for c in columns]
        self._set([columns], sum(trial) + edges, [trial], [height])
        sizes = [self._measured(k, column, height) for k, column in enumerate(columns)]
        room = widest - edges
        rows = [_Row(sizes, height, room, _LEAST_SHARE)]
        if fixed:
            rows = _rows(sizes, min(height, _TALLEST * room), room)
        inside = max(sum(row.widths) for row in rows)
        #: Width that the panels need [in]: more than is asked for where words have no room.
        self.needed = inside + edges
        if fixed and self.needed > widest * 1.001:
            return
        width = widest if fixed else max(self.needed, _LEAST_PAGE * self.zoom)
        placed = [[column.panels for column in row.columns] for row in rows]
        widths = [[*row.widths, inside - sum(row.widths) + 1e-3] for row in rows]
        self._set(placed, width, widths, [row.height for row in rows], width - self.needed)

    def _set(
        self,
        rows: Sequence[_Columns],
        width: float,
        widths: Sequence[Sequence[float]],
        heights: Sequence[float],
        spare: float = 0.0,
    ) -> None:
        """Make the figure of panels so wide and rows so high [in], and let matplotlib set it."""
        zoom = self.zoom
        words = _wrapped(self.title, (width / zoom - 2 * _MARGIN) * _TITLE_LETTERS)
        top = (0.2 + _TITLE_LINE * len(words)) * zoom
        low = (_FOOT + (_LEGEND if self.legend else 0.0)) * zoom
        #: Width and height [in].
        self.size = np.array([width, sum(heights) + top + low])
        self.figure.set_size_inches(*self.size)
        left = _MARGIN * zoom + max(0.5 * spare, 0.0)
        rect = np.array([[left, low], [width - 2 * left - self.side, sum(heights)]])
        engine: Any = self.figure.get_layout_engine()
        engine.set(w_pad=_PAD * zoom, h_pad=0.5 * _PAD * zoom, hspace=0.0, wspace=0.0)
        engine.set(rect=tuple((rect / self.size).ravel()))
        at = np.array([(_MARGIN + _PAD) * zoom, self.size[1] - 0.12 * zoom]) / self.size
        self.words.set(position=tuple(at), text="\n".join(words))
        self._place(rows, widths, heights)
        _read_no_formulas(self.figure)
        engine.execute(self.figure)

    def _place(
        self,
        rows: Sequence[_Columns],
        widths: Sequence[Sequence[float]],
        heights: Sequence[float],
    ) -> None:
        """Put panels in rows of columns, each into new axes or those it has."""
        before = {id(drawing.panel): drawing for drawing in self.drawings}
        self.drawings = []
        outer = self.figure.add_gridspec(len(rows), 1, height_ratios=list(heights))
        for number, row in enumerate(rows):
            cells = outer[number].subgridspec(1, len(widths[number]), width_ratios=widths[number])
            for c, column in enumerate(row):
                places = cells[c].subgridspec(len(column), 1)
                for k, panel in enumerate(column):
                    old = before.get(id(panel))
                    new = self._filled(panel, places[k]) if old is None else old
                    if old is not None:
                        old.axes.set_subplotspec(places[k])
                        old.axes.set(**old.limits, autoscale_on=True)
                    self.drawings.append(replace(new, row=number, column=c, place=k))

    def _filled(self, panel: Panel, place: Any) -> _Drawing:
        axes = self.figure.add_subplot(place)
        bar = self._fill(panel, axes)
        limits = {"xlim": axes.get_xlim(), "ylim": axes.get_ylim()}
        return _Drawing(panel, 0, 0, 0, axes, bar, limits)

    def _fill(self, panel: Panel, axes: Any) -> Any:
        """Draw a plot, or leave room for a view and what is below it; its colour bar's axes."""
        axes.set_title(panel.title, loc="left", fontsize="medium")
        if panel.plot is not None:
            panel.plot(axes)
            # Layouts know no axes that keep a shape of their own; limits that a plot has set may
            # widen, without a warning.
            axes.set_adjustable("datalim")
            axes.set_autoscale_on(True)
        else:
            lines = 3 if panel.view is None or panel.view.weight is None else 4
            axes.set(xticks=[], yticks=[], xlabel="\n".join(lines * " "))
            axes.spines[:].set_visible(False)
            axes.patch.set_visible(False)
        if panel.scale is None:
            return None
        return colour_bar(self.figure, panel.scale, ax=axes, location="bottom").ax

    def _measured(self, number: int, column: Sequence[Panel], height: float) -> _Column:
        """What a column needs, as matplotlib has set it so high."""
        from matplotlib.transforms import Bbox

        canvas: Any = self.figure.canvas
        renderer = canvas.get_renderer()
        beside, between, words = 0.0, height, 0.0
        for drawing in (d for d in self.drawings if d.column == number):
            axes = drawing.axes.get_window_extent(renderer)
            parts = [part for part in (drawing.axes, drawing.bar) if part is not None]
            outside = Bbox.union(
                [part.get_tightbbox(renderer, for_layout_only=True) for part in parts]
            )
            beside = max(beside, (outside.width - axes.width) / _MEASURING)
            between -= axes.height / _MEASURING
            texts = [drawing.axes._left_title]
            if drawing.bar is not None:
                texts.append(drawing.bar.xaxis.label)
            for text in texts:
                words = max(words, text.get_window_extent(renderer).width / _MEASURING)
            if drawing.panel.view is not None:
                words = max(words, _LEAST_VIEW * self.zoom)
        pad = 2 * _PAD * self.zoom
        return _Column(column, beside + pad, between, words, _LEAST_PANEL * self.zoom)

    # -----------------------------------------------------------------------------------------
    # What matplotlib does not set

    def draw(self, dots: float) -> None:
        """Draw views into the room left for them, bars at the side, and the legend."""
        # No layout engine at all: with the one called "none" matplotlib draws everything twice.
        unset: Any = self.figure
        unset._layout_engine = None
        self.figure.set_dpi(dots)
        for drawing in self.drawings:
            if drawing.panel.view is not None:
                self._draw_view(drawing, drawing.panel.view)
        self._draw_bars()
        if self.legend:
            self.figure.legend(
                handles=list(self.legend),
                loc="lower center",
                bbox_to_anchor=(0.5, 0.8 * _FOOT * self.zoom / self.size[1]),
                ncols=len(self.legend),
                frameon=False,
                fontsize="medium",
            )

    def _draw_view(self, drawing: _Drawing, view: View) -> None:
        """Show a rendered view with a scale bar of a round length, and its ring."""
        low, high = drawing.axes.get_position(original=True).get_points() * self.size
        per_inch = max(*np.array(view.size) / (high - low))
        across, tall = np.array(view.size) / per_inch
        corner = np.array([low[0], low[1] + 0.5 * (high[1] - low[1] - tall)])
        box = np.array([corner, (across, tall)]) / self.size
        drawing.axes.set_position(tuple(box.ravel()))
        drawing.axes.set_xlabel("")
        pixels = _pixels(view, across * self.figure.dpi, tall * self.figure.dpi)
        self.figure.add_artist(_image(pixels, *corner))
        self._draw_axes(corner, view)
        self._draw_scale_bar(corner + self.zoom * np.array(_AT_BAR), view.size[0], per_inch)
        if drawing.panel.ring is not None:
            at = corner + np.array(view.place(drawing.panel.ring)) / per_inch
            self._line([at], marker="o", mfc="none", mec="black", ms=9, mew=1.4)
        for words, place in drawing.panel.labels:
            back = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75}
            at = corner + place / per_inch
            self._write(at, words, size="x-small", ha="center", va="center", bbox=back)

    def _draw_scale_bar(self, start: FloatArray, width: float, per_inch: float) -> None:
        """Draw a bar of a round length from a place in the figure [in]."""
        length = round_length(max(0.4 * width, 0.4 * self.zoom * per_inch))
        end = start + np.array([length / per_inch, 0.0])
        self._line([start, end], linewidth=2.5, solid_capstyle="butt")
        self._write(end + self.zoom * np.array([0.06, 0.0]), f"{length:g} mm", va="center")

    def _draw_axes(self, corner: FloatArray, view: View) -> None:
        """Draw the directions x, y and z below a view, and the one of its weight."""
        seen = {name: view.axes[:2, k] for k, name in enumerate("xyz")}
        at = corner + self.zoom * np.array(_AT_AXES)
        for name, along in seen.items():
            self._arrow(at, along, name, "black")
        if view.weight is not None:
            along = view.axes[:2] @ np.array(view.weight) / np.linalg.norm(view.weight)
            self._arrow(at, along, "g", VERMILION)

    def _arrow(self, start: FloatArray, along: FloatArray, name: str, colour: str) -> None:
        """Draw a unit vector as it is seen, with its name at the tip."""
        tip = start + _ARROW * self.zoom * along
        if np.linalg.norm(along) > _SEEN_ALONG:
            self._line([start, tip], color=colour, linewidth=1.0)
        beyond = tip + 0.075 * self.zoom * along / max(float(np.linalg.norm(along)), 1e-9)
        self._write(beyond, name, size="x-small", color=colour, ha="center", va="center")

    def _line(self, points: Sequence[FloatArray], **options: Any) -> None:
        """Draw a line between places in the figure [in]."""
        from matplotlib.lines import Line2D

        places = (np.array(points) / self.size).T
        self.figure.add_artist(Line2D(*places, **{"color": "black", **options}))

    def _write(self, place: FloatArray, words: str, *, size: str = "small", **options: Any) -> None:
        """Write small print at a place in the figure [in]."""
        x, y = place / self.size
        self.figure.text(x, y, words, fontsize=size, **options)

    def _draw_bars(self) -> None:
        """Draw bars beside all panels, or beside each row of them."""
        shared = len(self.scales) == 1
        # Columns with fewer panels than there are scales have rows of their own.
        last = {(d.row, d.column): d.place for d in self.drawings}
        for row in sorted({drawing.row for drawing in self.drawings}):
            for scale in dict.fromkeys(self.scales):
                places = {k for k, other in enumerate(self.scales) if other == scale}
                boxes = [
                    drawing.axes.get_position()
                    for drawing in self.drawings
                    if shared
                    or (
                        (drawing.row == row and drawing.place in places)
                        and last[row, drawing.column] == len(self.scales) - 1
                    )
                ]
                if not boxes:
                    continue
                low = min(box.y0 for box in boxes) * self.size[1]
                high = max(box.y1 for box in boxes) * self.size[1]
                long = min((0.6 if shared else 0.9) * (high - low), _LONGEST_BAR * self.zoom)
                start = (self.size[0] - self.side, 0.5 * (low + high - long))
                box = np.array([start, (_BAR * self.zoom, long)]) / self.size
                colour_bar(self.figure, scale, cax=self.figure.add_axes(tuple(box.ravel())))
            if shared:
                return


def _wrapped(words: str, letters: float) -> list[str]:
    count = max(int(letters), 12)
    return [line for part in words.split("\n") for line in textwrap.wrap(part, count) or [""]]


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
    shown = foot if look().footer else ""
    width, height = figure.get_size_inches()
    figure.text(
        1 - 0.12 / width,
        0.07 / height,
        shown,
        fontsize="xx-small",
        color="#707070",
        ha="right",
        va="bottom",
    )
    _read_no_formulas(figure)
    options: dict[str, Any] = {"dpi": _dots(path)}
    if kind == "png":
        options["pil_kwargs"] = {"compress_level": 3}

    def write(partial: Path) -> None:
        figure.savefig(partial, format=kind, metadata=_metadata(kind, foot), **options)

    with rc_context(look().settings()):
        write_whole(path, write)


def _dots(path: Path) -> float:
    """Pixels per inch of a figure."""
    return PRINT if path.suffix.lower() != ".png" else look().dots


def subplots(
    rows: int, columns: int, *, size: tuple[float, float], **options: Any
) -> tuple[Figure, Any]:
    """Figure and axes of plots without bodies, set by matplotlib itself; ``size`` in inches."""
    from matplotlib import rcParams
    from matplotlib.figure import Figure

    size, zoom = look().plot_size(size)
    # `looking` sets them back.
    rcParams.update(look().settings(zoom))
    figure = Figure(figsize=size, layout="constrained")
    # Room for the line at the foot.
    engine: Any = figure.get_layout_engine()
    foot = _FOOT * zoom / size[1]
    engine.set(rect=(0.0, foot, 1.0, 1.0 - foot))
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
