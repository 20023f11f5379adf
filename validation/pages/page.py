"""Pages of HTML that need no network: templates, pictures inside, and who wrote them."""

from __future__ import annotations

import base64
import datetime
import os
import platform
from pathlib import Path
from typing import Any

import numpy as np

from validation.output.files import program
from validation.output.pictures.view_3d import viewer_page, webp

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
