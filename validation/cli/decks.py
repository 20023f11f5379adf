"""Commands that write and read the input files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from validation.cli.options import JsonOption, SceneArgument, SetOption
from validation.errors import InputError


def export(
    scene: SceneArgument,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE.inp", help="Input deck to write.")
    ],
    flavour: Annotated[
        str | None,
        typer.Option(
            metavar="general|pairs|calculix",
            help="general: Abaqus/Explicit, general contact; pairs: Abaqus with contact pairs; "
            "calculix: no parts or instances. Default: as fem.method; static: pairs, a step of "
            "Abaqus/Standard; explicit: general.",
            autocompletion=lambda incomplete: [
                word for word in ("general", "pairs", "calculix") if word.startswith(incomplete)
            ],
        ),
    ] = None,
    settings: SetOption = None,
) -> None:
    """Write an input deck for Abaqus or CalculiX."""
    from fem.decks.statement import Flavour
    from validation.output.decks import export_deck, print_export
    from validation.output.outputs import Outputs
    from validation.scene.read import load_scene
    from validation.scene.usage import recording

    if flavour is not None and flavour not in set(Flavour):
        raise InputError(f"--flavour {flavour}: expected one of {', '.join(Flavour)}")
    file = load_scene(scene, settings or ())
    with Outputs(files={"-o": output}, scene=file) as outputs:
        with recording(file.scene) as use:
            written = export_deck(file, None if flavour is None else Flavour(flavour), output)
        print_export(written, outputs.console)
        outputs.tell_unused(use)


def import_(
    deck: Annotated[
        Path, typer.Argument(metavar="FILE", help="Input deck (.inp) or mesh to read.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="File to write: a deck (.inp) or a mesh (.vtu)."
        ),
    ] = None,
    json: JsonOption = None,
) -> None:
    """Read an exported deck or a hexahedral mesh.

    Prints a summary of its content.
    """
    from validation.output.decks import import_file
    from validation.output.outputs import Outputs

    with Outputs(json, files={"-o": output}, reads=(deck,)) as outputs:
        table, data = import_file(deck, output)
        outputs.console.print(table)
        outputs.write_json(data)
