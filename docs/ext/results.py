"""Verification results: tables, errata, robustness cases, orders, as the program prints them."""

from __future__ import annotations

import shutil
from pathlib import Path

from ext.runs import emptied, run, shown

#: Page, title, what it is, the command that makes it.
_PAGES = (
    (
        "tables",
        "The paper's tables and tubelock",
        "All rigid-block values of the paper, with its assumptions and physically consistent.",
        "reproduce tables",
    ),
    (
        "errata",
        "Errata",
        "Errors in the paper, each with a computation.",
        "reproduce errata",
    ),
    (
        "stability",
        "Robustness cases",
        "Limits of the input, each with the law that must hold. A case holds, or the input is "
        "rejected with the message shown.",
        "stability",
    ),
    (
        "peaks",
        "Convergence of peaks",
        "Pressures and stresses of two layers of TSB1 over the degree of the elements.",
        "sweep degrees",
    ),
)


def write_results(folder: Path) -> None:
    """Write one page for each command."""
    emptied(folder)
    for name, title, about, command in _PAGES:
        result = run(command)
        pictures = [] if result is None else result.files(".png")
        for picture in pictures:
            shutil.copyfile(picture, folder / picture.name)
        text = shown(result, command, [picture.name for picture in pictures])
        lines = [f"# {title}", "", about, "", text]
        (folder / f"{name}.md").write_text("\n".join(lines), "utf-8")
