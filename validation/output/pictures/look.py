"""Size, font and kind of the pictures of one call, where its scene asks for them.

Pictures are set at one nominal size. What is asked for is a magnification of the whole, lines and
letters alike, and a width in which columns of panels find their places before that.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

#: Points of the small print of a picture at its nominal size.
NOMINAL = 9.0
_MM = 25.4
#: Pixels per inch: on a screen; of what is printed, and of bodies in it.
SCREEN, PRINT = 130, 300
#: A plot without bodies may become narrower and wider than it was set, by these.
_NARROWER, _WIDER = 0.6, 1.5


@dataclass
class Look:
    """What pictures are to look like; by default, as on a screen."""

    width: float | None = None
    """Of the whole picture [mm]."""
    font: str | None = None
    """Family of fonts."""
    font_size: float | None = None
    """Small print [pt]; titles are larger in proportion."""
    notes: list[str] = field(default_factory=list)
    """What could not be as asked for."""

    @property
    def _zoom(self) -> float:
        return (self.font_size or NOMINAL) / NOMINAL

    @property
    def widest(self) -> float | None:
        """Width in which panels find their places, before magnification [in]; None: free."""
        return None if self.width is None else self.width / _MM / self._zoom

    def plot_size(self, size: tuple[float, float]) -> tuple[float, float]:
        """Size of a plot without bodies before magnification [in], its shape kept."""
        if self.widest is None:
            return size
        factor = min(max(self.widest / size[0], _NARROWER), _WIDER)
        return size[0] * factor, size[1] * factor

    def magnification(self, width: float) -> float:
        """By how much a picture of this width [in] is magnified; the width asked for goes first."""
        if self.widest is None or width <= self.widest * 1.001:
            return self._zoom
        assert self.width is not None
        zoom = self.width / _MM / width
        self.notes.append(
            f"{NOMINAL * zoom:.2g} pt in {self.width:g} mm: larger letters have no room"
        )
        return zoom

    @property
    def dots(self) -> int:
        """Pixels of a PNG per inch."""
        return SCREEN if self.width is None else PRINT

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of matplotlib. Text stays text: to be found, and to be set in another font."""
        from matplotlib import rcParams

        known: dict[str, Any] = {"svg.fonttype": "none", "pdf.fonttype": 42}
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
    _write_no_docstrings()
    token = _LOOK.set(wanted)
    try:
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


def magnify(path: Path, kind: str, factor: float) -> None:
    """Make a drawing of lines and letters larger: the page, and all that is on it."""
    if factor == 1.0:
        return
    if kind == "svg":
        _magnify_svg(path, factor)
    elif kind == "pdf":
        _magnify_pdf(path, factor)


def _magnify_svg(path: Path, factor: float) -> None:
    """Change the size at which the drawing is shown; what it holds is in units of its own."""
    import re

    def larger(match: re.Match[str]) -> str:
        return f'{match[1]}="{float(match[2]) * factor:.6g}pt"'

    head, root, rest = path.read_text("utf-8").partition("<svg ")
    tag, end, body = rest.partition(">")
    tag = re.sub(r'\b(width|height)="([\d.]+)pt"', larger, tag)
    path.write_text(head + root + tag + end + body, "utf-8")


def _magnify_pdf(path: Path, factor: float) -> None:
    from pypdf import PdfWriter

    writer = PdfWriter(clone_from=path)
    for page in writer.pages:
        page.scale_by(factor)
    writer.write(path)
