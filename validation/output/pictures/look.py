"""Size, font and kind of the pictures of one call, where its scene asks for them.

A width is the size of the figure, a font size is a setting of matplotlib: all other letters,
lines and distances are relative to it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from itertools import product
from typing import Any

#: Points of the small print of a picture at its nominal size.
NOMINAL = 9.0
_MM = 25.4
#: Pixels per inch: on a screen; of what is printed, and of bodies in it.
SCREEN, PRINT = 130, 300
#: Least width of a plot without bodies whose letters are not made smaller, in its own widths.
_NARROWEST = 0.6
#: Size of matplotlib's small letters, in its ``font.size``.
_SMALL = 0.833
#: Settings of matplotlib in points, which grow with the letters.
_IN_POINTS = (
    "lines.linewidth",
    "lines.markersize",
    "patch.linewidth",
    "grid.linewidth",
    "axes.linewidth",
    "axes.labelpad",
    "axes.titlepad",
    *(f"{x}tick.major.{what}" for x, what in product("xy", ("size", "width", "pad"))),
)


@dataclass
class Look:
    """What pictures are to look like; by default, as on a screen."""

    width: float | None = None
    """Of the whole picture [mm]."""
    font: str | None = None
    """Family of fonts."""
    font_size: float | None = None
    """Small print [pt]; titles are larger in proportion."""
    footer: bool = True
    """Whether a line at the foot names the program and the day."""
    labels: str = "none"
    """What stands on the blocks of a drawn assembly: ``none``, ``numbers`` or ``names``."""
    notes: list[str] = field(default_factory=list)
    """What could not be as asked for."""

    @property
    def zoom(self) -> float:
        """Size of letters, lines and distances, in their nominal ones."""
        return (self.font_size or NOMINAL) / NOMINAL

    @property
    def inches(self) -> float | None:
        """Width asked for [in]; None: free."""
        return None if self.width is None else self.width / _MM

    @property
    def dots(self) -> int:
        """Pixels of a PNG per inch."""
        return SCREEN if self.width is None else PRINT

    def fitted(self, zoom: float) -> float:
        """Accept smaller letters than asked for, and note it."""
        if zoom < self.zoom * 0.999:
            self.notes.append(
                f"{NOMINAL * zoom:.2g} pt in {self.width:g} mm: larger letters have no room"
            )
        return zoom

    def plot_size(self, size: tuple[float, float]) -> tuple[tuple[float, float], float]:
        """Size of a plot without bodies [in], its shape kept, and the zoom of its letters."""
        if self.inches is None:
            return (size[0] * self.zoom, size[1] * self.zoom), self.zoom
        zoom = self.fitted(min(self.zoom, self.inches / (_NARROWEST * size[0])))
        return (self.inches, size[1] / size[0] * self.inches), zoom

    def settings(self, zoom: float | None = None) -> Any:
        """Settings of matplotlib. Text stays text: to be found, and to be set in another font."""
        from matplotlib import rcParams, rcParamsDefault

        usual: Any = rcParamsDefault
        zoom = self.zoom if zoom is None else zoom
        known = {key: zoom * usual[key] for key in _IN_POINTS}
        known |= {"font.size": zoom * NOMINAL / _SMALL, "svg.fonttype": "none", "pdf.fonttype": 42}
        if self.font is not None:
            known["font.sans-serif"] = [self.font, *rcParams["font.sans-serif"]]
        return known


_LOOK: ContextVar[Look | None] = ContextVar("look of pictures", default=None)


def look() -> Look:
    """Return the look of the pictures of this call."""
    return _LOOK.get() or Look()


@contextmanager
def looking(wanted: Look) -> Iterator[None]:
    """Draw all pictures in a look."""
    from matplotlib import rc_context

    _write_no_docstrings()
    token = _LOOK.set(wanted)
    try:
        with rc_context(wanted.settings()):
            yield
    finally:
        _LOOK.reset(token)


def _write_no_docstrings() -> None:
    """Spare matplotlib the docstrings of its setters: a third of the time that loading it takes.

    It writes them for every class of what can be drawn; a run that draws reads none.
    """
    from matplotlib.artist import Artist

    setters: Any = Artist
    setters._update_set_signature_and_docstring = classmethod(lambda _: None)
