"""Commands that say how far answers can be believed at the edge: hard cases and effects."""

from __future__ import annotations

from typing import Annotated

import typer

from validation.cli_options import JsonOption, text_console


def register(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    app.command()(stability)


def stability(
    *,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="NAME", help="Run this case or subject; repeatable."),
    ] = None,
    listed: Annotated[
        bool, typer.Option("--list", help="List the cases and their laws; run nothing.")
    ] = False,
    json: JsonOption = None,
) -> None:
    """Run the hard cases: each with its law, the numbers that prove it, and a verdict."""
    from validation.stability_command import list_cases, run_stability

    console = text_console(json)
    if listed:
        list_cases(only or (), console)
    elif not run_stability(only or (), json=json, console=console):
        raise typer.Exit(1)
