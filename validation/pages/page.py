"""Pages of HTML that need no network: templates, pictures inside, and who wrote them."""

from __future__ import annotations

import base64
import datetime
import io
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from validation.output.pictures.view_3d import viewer_page, webp
from validation.output.provenance import program

#: Packages whose folders hold templates.
_FOLDERS = ("pages", "paper")


def page_text(template: str, **values: Any) -> str:
    """Return a page from a template and its values.

    ``views``, where there are any, are 3-D views whose data the page carries.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader

    loader = ChoiceLoader([PackageLoader("validation", folder) for folder in _FOLDERS])
    pages = Environment(loader=loader, autoescape=True)
    pages.filters["base64"] = lambda content: base64.b64encode(content).decode()
    pages.filters["percent"] = lambda share: "" if share is None else f"{100 * share:+.1f} %"
    pages.filters["webp"] = webp_of
    return pages.get_template(template).render(
        program=program(),
        today=datetime.datetime.now(tz=datetime.UTC).date().isoformat(),
        machine=f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        viewer=(viewer_page() or "").encode(),
        **values,
    )


def webp_of(path: Path) -> bytes:
    """Picture of a file, to stand in a page."""
    import matplotlib.image

    pixels = matplotlib.image.imread(path)
    return webp((255 * pixels[..., :3]).astype(np.uint8))


@dataclass(frozen=True)
class PrintedTable:
    """A table that a command prints."""

    title: str
    heads: list[str]
    """Empty words where the command prints none."""
    rows: list[tuple[str, ...]]


class _Kept(Console):
    """A console that keeps what is printed."""

    def __init__(self) -> None:
        super().__init__(file=io.StringIO())
        self.printed: list[Any] = []

    def print(self, *objects: Any, **_: Any) -> None:
        """Keep what would be printed."""
        self.printed += objects


def printed_tables(show: Callable[[Console], object]) -> list[PrintedTable]:
    """Tables that a function prints to a console."""
    console = _Kept()
    show(console)
    return [_as_printed(table) for table in console.printed if isinstance(table, Table)]


def _as_printed(table: Table) -> PrintedTable:
    heads = [str(column.header) if table.show_header else "" for column in table.columns]
    cells = ([str(cell) for cell in column.cells] for column in table.columns)
    rows = [row for row in zip(*cells, strict=True) if any(row)]
    return PrintedTable(str(table.title), heads, rows)
