"""The command line. Bad input gives one line on standard error and exit status 2."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core
from rich.console import Console

from validation import stability_cli, study_cli
from validation.cli_options import (
    AutoOption,
    CostCacheOption,
    JsonOption,
    KeepOption,
    SceneArgument,
    SetOption,
)
from validation.cli_options import text_console as _console
from validation.errors import InputError

#: Order of the commands in ``tubelock --help``: from looking to doubting.
_CONTENTS = (
    "demo",
    "scenes",
    "show",
    "mbd",
    "explode",
    "fem",
    "compare",
    "clearance",
    "studies",
    "sweep",
    "export",
    "import",
    "cost",
    "effects",
    "cell",
    "stability",
    "convergence",
    "reproduce",
)


class _TableOfContents(typer.core.TyperGroup):
    """Lists the commands in the order of `_CONTENTS`, others after them."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in order."""
        names = super().list_commands(ctx)
        known = {name: place for place, name in enumerate(_CONTENTS)}
        return sorted(names, key=lambda name: known.get(name, len(known)))


app = typer.Typer(
    name="tubelock",
    cls=_TableOfContents,
    help="Topological interlocking assemblies: locked or not, contact pressures, stresses.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
reproduce_app = typer.Typer()
app.add_typer(reproduce_app, name="reproduce")
study_cli.register(app, reproduce_app)
stability_cli.register(app)


@app.command()
def scenes(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="Print this scene, to copy and change.")
    ] = None,
) -> None:
    """List the built-in scenes, or print one as TOML."""
    from validation.scene import builtin_names, builtin_text

    if name is not None:
        sys.stdout.write(builtin_text(name))
        return
    console = _console(None)
    names = builtin_names()
    width = max(len(scene) for scene in names)
    for scene in names:
        first = builtin_text(scene).splitlines()[0].lstrip("# ")
        console.print(f"{scene:{width}} {first}")


@app.command()
def show(
    scene: SceneArgument,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE.png", help="Picture to write.")
    ] = Path("tube.png"),
    settings: SetOption = None,
) -> None:
    """Draw a scene: blocks, frame, load and supports."""
    from validation.files import prepare_file
    from validation.rigid import build_scene
    from validation.scene import load_scene
    from validation.scene_polyhedra import PolyhedralScene

    file = load_scene(scene, settings or ())
    if output.suffix.lower() != ".png":
        raise InputError(f"-o {output}: expected a file name that ends in .png")
    if isinstance(file.scene, PolyhedralScene):
        from validation.polyhedra_command import show_polyhedra

        show_polyhedra(file, file.scene, output)
        _console(None).print(f"picture   {output}")
        return
    built = build_scene(file, command="show")
    prepare_file(output)
    from validation.pictures import draw_assembly

    draw_assembly(built.assembly, built.load, output, title=file.name)
    _console(None).print(f"picture   {output}")


@app.command()
def mbd(
    scene: SceneArgument,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            help="Folder for pressures (.vtu) and picture; out/SCENE unless --json is given.",
        ),
    ] = None,
) -> None:
    """Rigid blocks: is the tube locked, does it carry the load, with which contact pressures."""
    from validation.files import output_folder, prepare_json, write_json
    from validation.rigid import analyse_rigid, build_matching, rigid_json
    from validation.scene import load_scene
    from validation.scene_polyhedra import PolyhedralScene
    from validation.text import print_rigid

    file = load_scene(scene, settings or ())
    folder = output
    if folder is None and json is None:
        folder = Path("out") / file.name
    if isinstance(file.scene, PolyhedralScene):
        from validation.polyhedra_command import mbd_polyhedra

        mbd_polyhedra(file, file.scene, console=_console(json), json=json, folder=folder)
        return
    built = build_matching(file)
    prepare_json(json)
    with output_folder(folder):
        run = analyse_rigid(built)
        console = _console(json)
        print_rigid(run, console)
        if folder is not None:
            from validation.rigid_files import write_rigid

            for words, path in write_rigid(run, folder):
                console.print(f"{words:9} {path}")
        write_json(json, rigid_json(run))


@app.command()
def fem(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            help="Folder for fields, history, pictures; out/SCENE unless --json is given.",
        ),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="CHECKPOINT", help="Continue an interrupted run."),
    ] = None,
    accuracy: Annotated[
        str | None,
        typer.Option(metavar="1%", help="Cheapest setting that `cost` found for it (in p_max)."),
    ] = None,
    auto: AutoOption = None,
    keep: KeepOption = None,
    cache: CostCacheOption = Path("out/cost-cache"),
) -> None:
    """Deformable blocks: displacements, principal stresses, energies."""
    from validation.fem_command import run_fem
    from validation.scene import load_scene, with_auto

    file = with_auto(load_scene(scene, settings or ()), auto, keep or ())
    if accuracy is not None:
        from validation.cost_command import with_accuracy

        file = with_accuracy(file, accuracy, cache, _console(json))
    run_fem(file, json=json, output=output, resume=resume, console=_console(json))


@app.command()
def compare(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for the figure; out/SCENE-compare."
        ),
    ] = None,
    explicit: Annotated[
        bool, typer.Option(help="Run explicit dynamics to the static state too.")
    ] = True,
    auto: AutoOption = None,
    keep: KeepOption = None,
) -> None:
    """Rigid, static and explicit answers on the same mesh, side by side."""
    from validation.compare_command import run_compare
    from validation.scene import load_scene, with_auto

    file = with_auto(load_scene(scene, settings or ()), auto, keep or ())
    run_compare(file, json=json, output=output, explicit=explicit, console=_console(json))


@app.command()
def clearance(
    scene: SceneArgument,
    gap: Annotated[
        list[float] | None,
        typer.Option("--gap", metavar="MM", help="Initial clearance; repeatable."),
    ] = None,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Folder; out/SCENE-clearance."),
    ] = None,
) -> None:
    """What the initial gap between the blocks does to displacements and pressures."""
    from validation.clearance import GAPS, run_clearance
    from validation.scene import load_scene

    file = load_scene(scene, settings or ())
    gaps = tuple(gap) if gap else GAPS
    run_clearance(file, gaps=gaps, json=json, output=output, console=_console(json))


@app.command()
def convergence(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE.png", help="Picture to write.")
    ] = Path("convergence.png"),
    json: JsonOption = None,
) -> None:
    """Observed orders of the elements in mesh size and of the scheme in time step."""
    from validation.convergence import run_convergence

    run_convergence(output, json, _console(json))


@app.command()
def cost(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    quick: Annotated[bool, typer.Option("--quick", help="Coarse meshes only, in seconds.")] = False,
    json: JsonOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for the figure; out/SCENE-cost."
        ),
    ] = None,
    cache: CostCacheOption = Path("out/cost-cache"),
) -> None:
    """Error against CPU time of every method and mesh: what an accuracy costs."""
    from validation.cost_command import run_cost_command
    from validation.scene import load_scene

    file = load_scene(scene, settings or ())
    run_cost_command(
        file, quick=quick, json=json, output=output, cache_folder=cache, console=_console(json)
    )


@reproduce_app.command("tables")
def reproduce_tables(json: JsonOption = None) -> None:
    """Every row of the paper's tables: ours beside the printed value."""
    from validation.files import prepare_json, write_json
    from validation.paper.tables import compute_tables, print_tables, tables_json

    prepare_json(json)
    console = _console(json)
    rows = compute_tables(console)
    print_tables(rows, console)
    write_json(json, tables_json(rows))


@app.command("export")
def export_scene(
    scene: SceneArgument,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE.inp", help="Deck to write.")
    ],
    flavour: Annotated[
        str,
        typer.Option(
            metavar="general|pairs|calculix",
            help="Abaqus/Explicit; Abaqus with contact pairs; flat for CalculiX.",
        ),
    ] = "general",
    settings: SetOption = None,
) -> None:
    """Write a scene as an input deck for Abaqus or CalculiX."""
    from fem.decks.statement import Flavour
    from validation.deck_command import run_export
    from validation.scene import load_scene

    if flavour not in set(Flavour):
        raise InputError(f"--flavour {flavour}: expected one of {', '.join(Flavour)}")
    file = load_scene(scene, settings or ())
    run_export(file, flavour=Flavour(flavour), output=output, console=_console(None))


@app.command("import")
def import_file(
    deck: Annotated[Path, typer.Argument(metavar="FILE", help="Deck (.inp) or mesh to read.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="Write it again: a deck (.inp) or a mesh (.vtu)."
        ),
    ] = None,
    json: JsonOption = None,
) -> None:
    """Read a deck that `export` wrote, or a mesh of hexahedra, and say what is in it."""
    from validation.deck_command import run_import

    run_import(deck, output=output, json=json, console=_console(json))


@app.command()
def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the pictures.")
    ] = Path("out/demo"),
) -> None:
    """Run the main job: the paper's tables beside ours, and pictures of the tubes."""
    from validation.demo import run_demo

    run_demo(output, _console(None))


@app.command()
def explode(
    scene: SceneArgument,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE.png",
            help="Strip of pictures; out/SCENE/explosion.png unless --json is given.",
        ),
    ] = None,
) -> None:
    """Move all blocks of a tube outward at once, frame released: does it explode, and how far."""
    from validation.explode import explosion_json, print_explosion, run_explosion
    from validation.files import prepare_file, prepare_json, write_json
    from validation.scene import load_scene

    file = load_scene(scene, settings or ())
    picture = output
    if picture is None and json is None:
        picture = Path("out") / file.name / "explosion.png"
    if picture is not None and picture.suffix.lower() != ".png":
        raise InputError(f"-o {picture}: expected a file name that ends in .png")
    prepare_json(json)
    run = run_explosion(file)
    console = _console(json)
    print_explosion(run, console)
    if picture is not None:
        from validation.explode import draw_explosion

        prepare_file(picture)
        draw_explosion(run, picture)
        console.print(f"picture   {picture}")
    write_json(json, explosion_json(run))


def main() -> None:
    """Run the command line; the only place that turns errors into exit statuses."""
    try:
        app()
    except InputError as error:
        Console(stderr=True, soft_wrap=True, highlight=False, markup=False).print(f"error: {error}")
        raise SystemExit(2) from None
    except MemoryError as error:
        Console(stderr=True, soft_wrap=True, highlight=False, markup=False).print(
            f"error: this needs more memory than there is ({error}); "
            "take fewer elements ([mesh]) or fewer layers (assembly.layers)"
        )
        raise SystemExit(2) from None
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        Console(stderr=True, soft_wrap=True, highlight=False, markup=False).print(
            f"error: {where}{error.strerror or error}; the output could not be written or a file "
            "not be read: make room, or choose another place"
        )
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        Console(stderr=True).print("interrupted")
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
