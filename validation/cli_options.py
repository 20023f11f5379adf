"""Options that several commands share, and where their text goes."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

SceneArgument = Annotated[
    str, typer.Argument(metavar="SCENE", help="A built-in scene (see `scenes`) or a TOML file.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="SECTION.KEY=VALUE",
        help="Replace or add a value of the scene; repeatable.",
    ),
]
JsonOption = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE|-", help="Write the result as JSON (- : to the screen)."),
]


def text_console(json: str | None) -> Console:
    """Text for people; moves aside when JSON takes standard output."""
    console = Console(stderr=json == "-", highlight=False, soft_wrap=True)
    if not console.is_terminal:
        # A pipe or a log has no width of its own; tables need more than the default 80 columns.
        console = Console(stderr=json == "-", highlight=False, soft_wrap=True, width=118)
    return console
