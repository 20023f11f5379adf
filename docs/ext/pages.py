"""Writes the generated pages before Sphinx reads any.

``python -m ext.pages`` in docs (`make pages`) writes those that need no run. None of them is in the
repository.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parents[1]


def write_pages(_app: Any = None) -> None:
    """Write API, scene reference, commands, gallery and results from models, commands and runs."""
    from ext.api import write_api
    from ext.gallery import write_gallery
    from ext.results import write_results

    write_reference(DOCS)
    write_api(DOCS / "api")
    write_gallery(DOCS / "gallery")
    write_results(DOCS / "results")


def write_reference(folder: Path) -> None:
    """Write the pages of commands, scene keys and public names: no run, no docstring pages."""
    from ext.api import write_public
    from ext.commands import write_commands
    from ext.scenes import write_scenes

    write_commands(folder / "commands.md")
    write_scenes(folder / "scenes")
    write_public(folder / "api" / "index.md")


def copy_views(app: Any, error: Exception | None) -> None:
    """Put the views to turn beside the pages that show them: Sphinx copies no HTML."""
    if error is None and app.builder.format == "html":
        for view in (DOCS / "gallery").glob("*-view.html"):
            shutil.copyfile(view, Path(app.outdir) / "gallery" / view.name)


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("builder-inited", write_pages)
    app.connect("build-finished", copy_views)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    write_reference(DOCS)
