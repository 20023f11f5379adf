"""Commands that say how far answers can be believed: hard cases, effects, the periodic cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from validation.cli_options import JsonOption, SceneArgument, SetOption, text_console


def register(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    app.command()(stability)
    app.command()(effects)
    app.command()(cell)


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


def effects(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    tolerance: Annotated[
        str | None,
        typer.Option(metavar="1%", help="Change beyond which an effect matters; 1% by default."),
    ] = None,
    proof: Annotated[
        bool,
        typer.Option(
            "--proof", help="Also build the loop without effects: bits and instructions, 35 CPU s."
        ),
    ] = False,
    json: JsonOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            help="Folder for the figure; out/SCENE unless --json is given.",
        ),
    ] = None,
) -> None:
    """Measure what each effect changes in the answer of a tube, and what it costs."""
    from validation.effects_command import run_effects
    from validation.scene import load_scene

    file = load_scene(scene, settings or ())
    folder = output
    if folder is None and json is None:
        folder = Path("out") / file.name
    run_effects(
        file,
        folder=folder,
        json=json,
        console=text_console(json),
        tolerance=tolerance,
        proof=proof,
    )


def cell(scene: SceneArgument, *, settings: SetOption = None, json: JsonOption = None) -> None:
    """Measure the error of the two-layer periodic cell against the whole tube."""
    from validation.cell_command import run_cell
    from validation.scene import load_scene

    run_cell(load_scene(scene, settings or ()), json=json, console=text_console(json))
