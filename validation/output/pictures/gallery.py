"""Panels beside and below each other, with titles, scale bars, colour bars and a legend.

All pictures are set here, so that all look alike: columns of panels, each as large as its column
allows; colour bars that say where their colours stop and what lies beyond; one line that names
the program and the day. Words are measured once, views and plots fill the room that they leave.
"""

from __future__ import annotations

import datetime
import io
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.machine.system import write_whole
from geometry.mesh import FloatArray
from validation.output.files import program
from validation.output.pictures.canvas import Pixels, View
from validation.output.pictures.scales import VERMILION, Scale
from validation.scene.sections import PicturesSection

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter

#: Points of letters of medium size.
_LETTERS = 10.8


#: What pictures of this call show, where its scene states it.
_SHOWN: ContextVar[PicturesSection | None] = ContextVar("shown", default=None)


def pictures_section() -> PicturesSection:
    """Return what the pictures of this call show."""
    return _SHOWN.get() or PicturesSection()


def settings() -> Any:
    """Settings of matplotlib."""
    return {"font.size": _LETTERS, "text.hinting": "none"}


@contextmanager
def showing(stated: PicturesSection | None) -> Iterator[None]:
    """Draw all pictures as a scene states."""
    from matplotlib import rc_context

    _write_no_docstrings()
    token = _SHOWN.set(stated)
    try:
        with rc_context(settings()):
            yield
    finally:
        _SHOWN.reset(token)


def _write_no_docstrings() -> None:
    """Spare matplotlib the docstrings of its setters: two fifths of the time that loading it takes.

    It writes them for every class of what can be drawn, and lists of them into docstrings of
    functions; a run that draws reads none.
    """
    from matplotlib import artist

    writer: Any = artist
    writer.Artist._update_set_signature_and_docstring = classmethod(lambda _: None)
    writer.kwdoc = lambda _: ""


#: Inches: round all panels, between columns, of the line at the foot, of a legend, of its handles.
_MARGIN, _PAD, _FOOT, _LEGEND, _HANDLE = 0.2, 0.2, 0.2, 0.36, 0.75
#: The same: lines of the title, of titles of panels and of small print.
_TITLE_LINE, _LINE, _SMALL_LINE = 0.21, 0.19, 0.16
#: The same: thickness of bars, shortest and longest, and room of numbers below one.
_BAR, _LEAST_BAR, _LONGEST_BAR, _BELOW_BAR = 0.15, 1.9, 4.5, 0.3
#: The same: least height of a panel, least width of a view, and of a figure.
_LEAST_PANEL, _LEAST_VIEW, _LEAST_PAGE = 0.5, 1.5, 5.5
#: The same: room below a view, and, from its lower left corner, its scale bar and its axes.
_BELOW_VIEW, _AT_BAR, _AT_AXES = 0.62, (0.58, -0.3), (0.22, -0.32)
#: The same: room of the numbers of axes at the left, at the right and below; length of a tick.
_NUMBERS, _TICK = (0.68, 0.15, 0.5), 0.05
#: The same: length of arrows. Those that look shorter than that part of it are left out.
_ARROW, _SEEN_ALONG = 0.17, 0.15
#: Letters of the title in an inch.
_TITLE_LETTERS = 10.5
#: Pixels of a file per inch.
_DOTS = 130


@dataclass(frozen=True)
class Numbers:
    """Numbers beside a flat view, whose own lengths mean nothing."""

    across: str
    """Words below the view."""
    up: str
    """Words at its left."""
    ticks_across: Mapping[str, float]
    """Places along the first axis of the view by their words [mm]."""
    ticks_up: Mapping[str, float]
    """The same along the second one."""


def round_numbers(low: float, high: float) -> dict[str, float]:
    """About four round numbers between both ends of an axis, by their words."""
    from matplotlib.ticker import MaxNLocator

    every = MaxNLocator(4).tick_values(low, high)
    return {f"{x:g}".replace("-", "−"): float(x) for x in every if low <= x <= high}


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
    note: str = ""
    """Lines below the bar."""
    labels: Sequence[tuple[str, FloatArray]] = ()
    """Words on the view, and where: from its left and from below, (2,) [mm]."""
    numbers: Numbers | None = None
    """Numbers round a flat view, in place of its axes and its scale bar."""

    @cached_property
    def aspect(self) -> float:
        """Width over height of what is drawn."""
        if self.view is None:
            return self.shape
        width, height = self.view.size
        return float(np.clip(width / height, 0.02, 50.0))

    @property
    def lines(self) -> list[str]:
        """All that is written below its bar."""
        note = self.note.split("\n") if self.note else ()
        return [*(self.scale.lines if self.scale else ()), *note]

    @property
    def beside(self) -> tuple[float, float]:
        """Room at the left and at the right of what is drawn [in]."""
        numbered = self.numbers or self.plot
        return _NUMBERS[:2] if numbered else (0.0, 0.0)

    @property
    def above(self) -> float:
        """Room of the title [in]."""
        return 0.2 + _LINE * len(self.title.split("\n"))

    @property
    def below_drawing(self) -> float:
        """Room of axes or numbers below what is drawn [in]."""
        if self.numbers or self.plot:
            return _NUMBERS[2]
        return _BELOW_VIEW + (0.1 if self.view and self.view.weight is not None else 0.0)

    @property
    def below(self) -> float:
        """Room of axes and of a bar below what is drawn [in]."""
        bar = _BAR + _BELOW_BAR + _SMALL_LINE * len(self.lines) if self.scale else 0.0
        return self.below_drawing + bar

    @cached_property
    def least_width(self) -> float:
        """Width that its words need, and a view at least [in]."""
        widths = [_width(line, "medium") for line in self.title.split("\n")]
        if self.scale:
            widths += [_LEAST_BAR, *(_width(line, "small") for line in self.lines)]
        return self.beside[0] + max(_LEAST_VIEW if self.view else 0.0, *widths)

    def width(self, height: float) -> float:
        """Of all of it where what is drawn is so high [in]."""
        return max(self.least_width, sum(self.beside) + height * self.aspect)


def gallery(
    columns: Sequence[Sequence[Panel]],
    title: str,
    *,
    height: float = 7.5,
    widest: float = 16.0,
    scale: Scale | Sequence[Scale] | None = None,
    legend: Sequence[Any] = (),
) -> Figure:
    """Draw panels, those of each column from above.

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
    with rc_context(settings()):
        beside = max((_beside(bar) + _SMALL_LINE * len(bar.lines) for bar in bars), default=0.0)
        side = _PAD + _BAR + beside if bars else 0.0
        layout = _Layout(columns, height, widest - 2 * _MARGIN - side)
        named = sum(_width(one.get_label(), "medium") + _HANDLE for one in legend)
        width = max(sum(layout.widths) + 2 * _MARGIN + side, _LEAST_PAGE, named)
        # A minus sign, where a number follows.
        title = re.sub(r"(?<![\w)])-(?=\d)", "−", title)
        words = wrapped(title, width - 2 * _MARGIN)
        top = layout.height + _FOOT + (_LEGEND if legend else 0.0)
        page = _Page((width, top + 0.2 + _TITLE_LINE * len(words.split("\n"))))
        page.write((_MARGIN, page.size[1] - 0.12), words, fontsize="large", va="top")
        boxes = layout.boxes(0.5 * (width - side - sum(layout.widths)), top)
        for column, places in zip(columns, boxes, strict=True):
            for panel, box in zip(column, places, strict=True):
                page.draw(panel, box)
        for shared, spans in _sides(bars, boxes).items():
            low, high = min(box[1] for box in spans), max(box[1] + box[3] for box in spans)
            long = min((0.6 if len(bars) == 1 else 0.9) * (high - low), _LONGEST_BAR)
            start = (width - _MARGIN - side + _PAD, 0.5 * (low + high - long))
            page.bar(shared, shared.lines, start, long, upright=True)
        if legend:
            options = {"ncols": len(legend), "frameon": False, "fontsize": "medium"}
            place = (0.5, 0.8 * _FOOT / page.size[1])
            page.figure.legend(
                handles=list(legend), loc="lower center", bbox_to_anchor=place, **options
            )
        return page.figure


# ---------------------------------------------------------------------------------------------
# Layout


class _Layout:
    """Columns beside each other, as high as their width allows.

    What first panels draw begins at one height, and what last ones draw ends at one.
    """

    def __init__(self, columns: Sequence[Sequence[Panel]], height: float, room: float) -> None:
        self.columns = columns
        self._above = max(column[0].above for column in columns)
        self._below = max(column[-1].below for column in columns)
        least = [self._between(column) + len(column) * _LEAST_PANEL for column in columns]
        low = max(least)
        # Widths are linear in the height between those at which words cease to be wider.
        breaks = [
            self._between(column)
            + len(column) * (panel.least_width - sum(panel.beside)) / panel.aspect
            for column in columns
            for panel in column
        ]
        high = max(low, height)
        heights = np.clip(sorted([low, high, *breaks]), low, high)
        #: Height of all columns, and width of each with the room beside it [in].
        self.height = float(np.interp(room, [sum(self._widths(h)) for h in heights], heights))
        self.widths = self._widths(self.height)

    def _widths(self, height: float) -> list[float]:
        """Of each column, where all are so high [in]."""
        return [
            _PAD + max(panel.width(self._each(column, height)) for panel in column)
            for column in self.columns
        ]

    def _between(self, column: Sequence[Panel]) -> float:
        """Room above, between and below what the panels of a column draw [in]."""
        inner = sum(panel.below for panel in column[:-1]) + sum(p.above for p in column[1:])
        return self._above + self._below + inner

    def _each(self, column: Sequence[Panel], height: float) -> float:
        """Height of what each panel of a column draws [in]."""
        return (height - self._between(column)) / len(column)

    def boxes(self, left: float, top: float) -> list[list[_Box]]:
        """Where the panels of each column draw, from the upper left corner of all [in]."""
        result = []
        for column, width in zip(self.columns, self.widths, strict=True):
            each, boxes = self._each(column, self.height), list[_Box]()
            upper = top - self._above
            for k, panel in enumerate(column):
                before, after = panel.beside
                wide = width - _PAD - before - after if panel.plot else each * panel.aspect
                boxes.append((left + before, upper - each, wide, each))
                following = column[k + 1].above if k + 1 < len(column) else 0.0
                upper -= each + panel.below + following
            result.append(boxes)
            left += width
        return result


def _sides(bars: Sequence[Scale], boxes: Sequence[Sequence[_Box]]) -> dict[Scale, list[_Box]]:
    """What each bar at the side stands beside: all, or the rows that have its colours."""
    if len(bars) == 1:
        return {bars[0]: [box for column in boxes for box in column]}
    result: dict[Scale, list[_Box]] = {}
    for row, scale in enumerate(bars):
        # Columns with fewer panels have rows of their own.
        of_row = [column[row] for column in boxes if len(column) == len(bars)]
        result.setdefault(scale, []).extend(of_row)
    return result


# ---------------------------------------------------------------------------------------------
# Drawing


class _Page:
    """A figure, and what is drawn at places in it [in], from its lower left corner."""

    def __init__(self, size: tuple[float, float]) -> None:
        self.size = np.array(size)
        self.figure = _figure(size)

    def line(self, points: Any, **options: Any) -> None:
        """Draw a line through places, (n, 2)."""
        from matplotlib.lines import Line2D

        places = (np.array(points) / self.size).T
        self.figure.add_artist(Line2D(*places, **{"color": "black", "linewidth": 0.8, **options}))

    def write(self, place: Any, words: str, **options: Any) -> None:
        """Write words as they are; small print by default."""
        options = {"fontsize": "small", "linespacing": 1.15, "parse_math": False, **options}
        x, y = np.array(place) / self.size
        self.figure.text(x, y, words, **options)

    def paint(self, pixels: Any, x: float, y: float) -> None:
        """Show pixels as they are, (height, width, 3): nothing is drawn anew."""
        self.figure.add_artist(_image(pixels, np.array([x, y]) / self.size))

    # -----------------------------------------------------------------------------------------
    # Panels

    def draw(self, panel: Panel, box: _Box) -> None:
        """Draw a panel, its title above and its bar below."""
        x, y, wide, high = box
        self.write((x, y + high + 0.08), panel.title, fontsize="medium", va="bottom")
        if panel.scale is not None:
            start = (x, y - panel.below_drawing - _BAR)
            self.bar(panel.scale, panel.lines, start, max(wide, _LEAST_BAR))
        if panel.view is not None:
            self._draw_view(panel, panel.view, box)
            return
        assert panel.plot is not None
        axes = self.figure.add_axes(tuple((np.array(box).reshape(2, 2) / self.size).ravel()))
        panel.plot(axes)
        # Limits that a plot has set may widen, without a warning.
        axes.set_adjustable("datalim")
        axes.set_autoscale_on(True)

    def _draw_view(self, panel: Panel, view: View, box: _Box) -> None:
        """Show a rendered view with its axes or numbers."""
        x, y, wide, high = box
        per_inch = view.size[1] / high
        dots = self.figure.dpi
        self.paint(view.render(round(wide * dots), round(high * dots)), x, y)
        if panel.numbers is None:
            self._draw_axes(x + _AT_AXES[0], y + _AT_AXES[1], view)
            self._draw_scale_bar(x + _AT_BAR[0], y + _AT_BAR[1], view.size[0], per_inch)
        else:
            self._draw_numbers(panel.numbers, view, box)
        for words, place in panel.labels:
            back = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75}
            at = np.array([x, y]) + place / per_inch
            self.write(at, words, fontsize="x-small", ha="center", va="center", bbox=back)

    def _draw_scale_bar(self, x: float, y: float, width: float, per_inch: float) -> None:
        """Draw a bar of a round length."""
        length = round_length(max(0.4 * width, 0.4 * per_inch))
        end = x + length / per_inch
        self.line([(x, y), (end, y)], linewidth=2.5, solid_capstyle="butt")
        self.write((end + 0.06, y), f"{length:g} mm", va="center")

    def _draw_axes(self, x: float, y: float, view: View) -> None:
        """Draw the directions x, y and z below a view, and the one of its weight."""
        arrows = {name: (view.axes[:2, k], "black") for k, name in enumerate("xyz")}
        if view.weight is not None:
            along = view.axes[:2] @ np.array(view.weight) / np.linalg.norm(view.weight)
            arrows["g"] = (along, VERMILION)
        for name, (along, colour) in arrows.items():
            start, long = np.array([x, y]), float(np.linalg.norm(along))
            if long < _SEEN_ALONG:
                continue
            tip = start + _ARROW * along
            self.line([start, tip], color=colour, linewidth=1.0)
            beyond = tip + 0.085 * along / long
            self.write(beyond, name, fontsize="x-small", color=colour, ha="center", va="center")

    def _draw_numbers(self, numbers: Numbers, view: View, box: _Box) -> None:
        """Draw a frame round a flat view, its ticks, and the words of both axes."""
        x, y, wide, high = box
        self.line([(x, y), (x + wide, y), (x + wide, y + high), (x, y + high), (x, y)])
        low = view.corner
        for words, place in numbers.ticks_across.items():
            at = x + (place - low[0]) * wide / view.size[0]
            self.line([(at, y), (at, y - _TICK)])
            self.write((at, y - 0.09), words, ha="center", va="top")
        for words, place in numbers.ticks_up.items():
            at = y + (place - low[1]) * high / view.size[1]
            self.line([(x, at), (x - _TICK, at)])
            self.write((x - 0.09, at), words, ha="right", va="center")
        self.write((x + 0.5 * wide, y - 0.28), numbers.across, ha="center", va="top")
        at = x - _NUMBERS[0] + 0.02
        self.write((at, y + 0.5 * high), numbers.up, rotation=90, ha="left", va="center")

    # -----------------------------------------------------------------------------------------
    # Colours

    def bar(
        self,
        scale: Scale,
        lines: Sequence[str],
        start: tuple[float, float],
        length: float,
        *,
        upright: bool = False,
    ) -> None:
        """Draw the colours of a scale from a place to the right or upwards, numbers and words.

        Both ends are labelled; it has arrows where values go beyond its colours.
        """
        from matplotlib.patches import Polygon

        def at(along: float, across: float) -> tuple[float, float]:
            """Place along the bar, and to that side of it where its numbers are."""
            x, y = start
            return (x + across, y + along) if upright else (x + along, y + _BAR - across)

        tip = 0.7 * _BAR
        low = tip if scale.beyond in ("min", "both") else 0.0
        high = length - (tip if scale.beyond in ("max", "both") else 0.0)
        dots = self.figure.dpi
        shades = scale.gradient(max(round((high - low) * dots), 2))
        strip = np.repeat(shades[None], max(round(_BAR * dots), 1), axis=0)
        corner = at(low, 0.0) if upright else at(low, _BAR)
        self.paint(strip.transpose(1, 0, 2)[::-1] if upright else strip, *corner)
        border = [at(low, 0.0), at(low - tip, 0.5 * _BAR) if low else at(low, 0.0), at(low, _BAR)]
        beyond = at(high + tip, 0.5 * _BAR) if high < length else at(high, _BAR)
        border += [at(high, _BAR), beyond, at(high, 0.0), at(low, 0.0)]
        for ends, colour in ((border[:3], shades[0]), (border[3:6], shades[-1])):
            arrow = Polygon(np.array(ends) / self.size, color=tuple(colour / 255.0), linewidth=0.0)
            self.figure.add_artist(arrow)
        self.line(border)
        ticks = scale.ticks(6 if upright else 2)
        for k, value in enumerate(ticks):
            along = low + (high - low) * float(scale.position(np.array([value]))[0])
            self.line([at(along, _BAR), at(along, _BAR + _TICK)])
            words, place = scale.number(value), at(along, _BAR + 0.09)
            if upright:
                self.write(place, words, va="center")
            else:  # what stands at the ends has no room beside the bar
                side = "left" if k == 0 else "right" if k == len(ticks) - 1 else "center"
                self.write(place, words, ha=side, va="top")
        words = "\n".join(lines)
        if upright:
            place = at(0.5 * length, _BAR + _beside(scale))
            self.write(place, words, rotation=90, ha="left", va="center", ma="center")
        else:
            self.write(at(0.0, _BAR + _BELOW_BAR), words, va="top")


#: Left, lower end, width and height [in].
_Box = tuple[float, float, float, float]


def _width(words: str, size: str) -> float:
    """Width of a line [in]."""
    from matplotlib.backends.backend_agg import RendererAgg
    from matplotlib.font_manager import FontProperties

    renderer: Any = RendererAgg(1, 1, 72)  # type: ignore[no-untyped-call]
    wide, _, _ = renderer.get_text_width_height_descent(words, FontProperties(size=size), False)
    return float(wide) / 72.0


def _beside(scale: Scale) -> float:
    """Room of the numbers beside an upright bar [in]."""
    return 0.17 + max(_width(scale.number(value), "small") for value in scale.ticks(6))


def wrapped(title: str, width: float) -> str:
    """A title in lines of a width [in]."""
    count = max(int(width * _TITLE_LETTERS), 12)
    return "\n".join(textwrap.fill(part, count) for part in title.split("\n"))


def _image(pixels: Pixels, place: FloatArray) -> Any:
    """Pixels at a place in a figure, (2,) in parts of its size."""
    from matplotlib.artist import Artist
    from matplotlib.transforms import Bbox
    from PIL import Image

    size = np.array(pixels.shape[1::-1])

    class Picture(Artist):
        """Dots of a file as they are; a notebook may show a figure larger, and without margins."""

        def get_window_extent(self, renderer: Any = None) -> Any:  # noqa: ARG002
            figure: Any = self.figure
            return Bbox.from_bounds(
                *figure.transFigure.transform(place), *(size * figure.dpi / _DOTS)
            )

        def draw(self, renderer: Any) -> None:
            box = self.get_window_extent()
            shown = Image.fromarray(pixels)
            if abs(box.width - size[0]) > 0.5:
                shown = shown.resize((round(box.width), round(box.height)))
            dots = np.asarray(shown.convert("RGBA"))[::-1]
            renderer.draw_image(renderer.new_gc(), box.x0, box.y0, dots)

    return Picture()


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
    """Write a figure as PNG, whole or not at all; its foot names program and day."""
    write_whole(path, lambda partial: partial.write_bytes(png_of(figure, about)))


def png_of(figure: Figure, about: str = "") -> bytes:
    """The same as bytes."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    today = datetime.date.today().isoformat()
    foot = " · ".join(part for part in (about, f"tubelock {program()}", today) if part)
    width, height = figure.get_size_inches()
    if pictures_section().footer:
        place = (1 - 0.12 / width, 0.07 / height)
        figure.text(*place, foot, size="xx-small", color="#707070", ha="right", va="bottom")
    stated = PngInfo()
    stated.add_text("Software", f"tubelock {program()}")
    stated.add_itxt("Description", foot)
    buffer = io.BytesIO()
    dots = (_DOTS, _DOTS)
    Image.fromarray(pixels_of(figure)).save(
        buffer, "PNG", compress_level=2, dpi=dots, pnginfo=stated
    )
    return buffer.getvalue()


def pixels_of(figure: Figure) -> Pixels:
    """A figure without foot as pixels, (height, width, 3)."""
    from matplotlib import rc_context

    _read_no_formulas(figure)
    canvas: Any = figure.canvas
    with rc_context(settings()):
        canvas.draw()
    colours = np.asarray(canvas.buffer_rgba())
    return np.stack([colours[..., k] for k in range(3)], axis=-1)  # three of four bytes copy slowly


def _figure(size: tuple[float, float], **options: Any) -> Figure:
    """An empty figure of a size [in]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=_DOTS, **options)
    FigureCanvasAgg(figure)
    return figure


def subplots(
    rows: int, columns: int, *, size: tuple[float, float], **options: Any
) -> tuple[Figure, Any]:
    """Figure and axes of plots without bodies, set by matplotlib itself; ``size`` in inches."""
    from matplotlib import rcParams

    # `showing` sets them back.
    rcParams.update(settings())
    figure = _figure(size, layout="constrained")
    # Room for the line at the foot.
    engine: Any = figure.get_layout_engine()
    engine.set(rect=(0.0, _FOOT / size[1], 1.0, 1.0 - _FOOT / size[1]))
    return figure, figure.subplots(rows, columns, **options)


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
