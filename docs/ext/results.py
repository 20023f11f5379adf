"""Results that trust rests on: tables, errata, hard cases, orders, as the program prints them."""

from __future__ import annotations

import shutil
from pathlib import Path

from ext.runs import emptied, run, shown

#: Page, title, what it is, the command that makes it.
_PAGES = (
    (
        "tables",
        "The paper's tables beside ours",
        "Every row that the paper prints for rigid blocks: read as printed, and as physics says.",
        "reproduce tables",
    ),
    (
        "errata",
        "Errata",
        "What the paper prints and cannot mean, each with a computation that shows it.",
        "reproduce errata",
    ),
    (
        "stability",
        "Hard cases",
        "Cases at and beyond the limits, each with the law that it must obey: they hold, or they "
        "are refused with the message shown.",
        "stability",
    ),
    (
        "convergence",
        "Observed orders",
        "Errors of the elements against the size of the mesh, of the scheme against the step.",
        "convergence -o convergence.png",
    ),
    (
        "peaks",
        "Orders in peaks",
        "Relative errors of curved elements of degree 1 to 3 in displacements, pressures, stresses "
        "of two layers of TSB1 pipe, and what a cap on the contact law changes.",
        "peaks",
    ),
)


def write_results(folder: Path) -> None:
    """Write one page for each command."""
    emptied(folder)
    for name, title, about, command in _PAGES:
        found = run(command)
        pictures = [] if found is None else found.files(".png")
        for picture in pictures:
            shutil.copyfile(picture, folder / picture.name)
        text = shown(found, command, [picture.name for picture in pictures])
        lines = [f"# {title}", "", about, "", text]
        (folder / f"{name}.md").write_text("\n".join(lines), "utf-8")
