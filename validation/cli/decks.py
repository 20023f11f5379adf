"""Commands that write and read the input files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from validation.cli.options import (
    JsonOption,
    SceneArgument,
    SetOption,
    complete_flavours,
    exit_by,
    method_options,
)
from validation.errors import InputError

if TYPE_CHECKING:
    from validation.case import Case


def export(
    scene: SceneArgument,
    *,
    output: Path,
    flavour: Annotated[str | None, typer.Option(autocompletion=complete_flavours)] = None,
    settings: SetOption = None,
    verbose: bool = False,
) -> None:
    """Write an input deck, or the blocks as OBJ or compas JSON.

    Decks are for Abaqus/Standard, Abaqus/Explicit or CalculiX.

    Parameters
    ----------
    output : -o FILE.inp|obj|json
        File to write: an input deck, or blocks as OBJ or as an assembly of compas.
    flavour : general|standard|calculix
        general: Abaqus/Explicit, general contact; standard: Abaqus/Standard, a static step, contact
        pairs; calculix: no parts or instances. Default: as fem.method; static: standard, explicit:
        general.
    verbose : -v
        Print how often each keyword occurs.
    """
    from fem.decks.deck import Flavour
    from validation.case import load_case
    from validation.output.decks import export_deck, export_table
    from validation.output.outputs import Outputs

    if flavour is not None and flavour not in set(Flavour):
        raise InputError(
            f"--flavour {flavour}: expected one of {', '.join(Flavour)}; Abaqus reads general "
            "(Abaqus/Explicit) and standard (Abaqus/Standard)"
        )
    file = load_case(scene, settings or ())
    if output.suffix.lower() != ".inp":
        given = {f"--flavour {flavour}": flavour is not None, "--verbose": verbose}
        for option in (option for option, is_given in given.items() if is_given):
            raise InputError(f"{option}: {output} is no deck; expected -o FILE.inp")
        _export_blocks(file, output)
        return
    with Outputs(files={"-o": output}, case=file) as outputs:
        kind = None if flavour is None else Flavour(flavour)
        written = export_deck(file, kind, output)
        outputs.console.print(export_table(written, verbose=verbose))
        step = "static" if written.deck.in_time is None else "explicit"
        outputs.tell_keys(f"{step} deck")


def _export_blocks(file: Case, output: Path) -> None:
    """Write the blocks of a scene where they stand."""
    from geometry.files.write_solids import SOLID_SUFFIXES, write_solids
    from geometry.polyhedra.assembly import as_polyhedral
    from validation.output.files import prepare_file
    from validation.output.outputs import Outputs

    with Outputs(files={"-o": output}, case=file) as outputs:
        if output.suffix.lower() not in SOLID_SUFFIXES:
            raise InputError(f"-o {output}: expected a name that ends in .inp, .obj or .json")
        problem = file.with_method("rigid").problem
        placed = problem.blocks if problem.is_solid else as_polyhedral(problem.blocks)
        prepare_file(output)
        write_solids(output, placed)
        outputs.say(f"{placed.n_blocks} blocks", output)
        outputs.tell_keys("blocks")


def _one_of(option: str, got: str, allowed: tuple[str, ...]) -> None:
    if got not in allowed:
        raise InputError(f"{option} {got}: expected one of {', '.join(allowed)}")


def check(
    file: Path,
    *,
    units: str = "mm",
    up: str = "z",
    json: JsonOption = None,
    repair: Path | None = None,
) -> None:
    """Check a file of blocks, or those of a scene: faults, overlaps, gaps; repair a file.

    Parameters
    ----------
    file : FILE
        Blocks: STL, OBJ, STEP, JSON, …; or a scene: TOML.
    units : mm|cm|m|inch
        Unit of the file.
    up : y|z
        Axis that points up.
    repair : NEW.obj|json
        Mend duplicate or turned triangles and flat holes, and write the blocks in mm.
    """
    from validation.output.console import following
    from validation.output.outputs import Outputs
    from validation.output.solids import check_file, write_repaired

    _one_of("--units", units, ("mm", "cm", "m", "inch"))
    _one_of("--up", up, ("y", "z"))
    if file.suffix == ".toml":
        if (units, up) != ("mm", "z"):
            raise InputError(f"{file}: a scene states units and up itself; leave the option out")
        if repair is not None:
            raise InputError(f"--repair: {file} is a scene; expected a file of blocks")
        _check_scene(file, json)
        return
    with Outputs(json, files={"--repair": repair}, reads=(file,)) as outputs:
        with following(f"{file.name}: reads the blocks and finds where they touch"):
            result = (
                check_file(file, units=units, up=up, repair=False)
                if repair is None
                else write_repaired(file, repair, units=units, up=up)
            )
        outputs.console.print(result.table())
        outputs.write_json(result.as_dict())
        if repair is not None:
            outputs.say(f"{len(result.blocks)} blocks", repair)
            return
    if not result.clean:
        raise typer.Exit(1)


def _check_scene(file: Path, json: str | None) -> None:
    """Check a scene and the blocks of its files."""
    from validation.case import load_case
    from validation.output.outputs import Outputs
    from validation.output.solids import check_case

    with Outputs(json, reads=(file,), exit_line=False) as outputs:
        case = load_case(str(file))
        blocks = check_case(case, file)
        if blocks is not None:
            outputs.console.print(blocks.table())
        outputs.say("scene", file)
        found = {} if blocks is None else blocks.as_dict()
        outputs.write_json({"scene": case.keys, **found})
    if not (blocks is None or blocks.clean):
        raise typer.Exit(1)


@method_options("fem", "mesh", "accuracy", "max_work", "max_seconds", "max_memory", of_scene=False)
def deck(
    file: Path,
    *,
    write: Path | None = None,
    run: bool = False,
    dialect: str | None = None,
    json: JsonOption = None,
    open_: bool = False,
    asked: dict[str, Any],
) -> None:
    """Read an Abaqus or CalculiX deck, check it, print a summary.

    Parameters
    ----------
    file : FILE
        Input deck of Abaqus or CalculiX (.inp).
    write : FILE.inp
        Write it again for its program.
    run
        Solve its step and print the answer.
    dialect : abaqus|calculix
        Program whose meaning the keywords have. Default: detected.
    open_
        Draw blocks, supports and loads: out/NAME/assembly.png.
    """
    from validation.output.console import solver_progress
    from validation.output.decks import (
        deck_command,
        deck_method,
        draw_deck,
        input_json,
        input_table,
        read_file,
        rewrite,
        solve_deck,
    )
    from validation.output.outputs import Outputs

    if dialect is not None:
        _one_of("--dialect", dialect, ("abaqus", "calculix"))
    if asked and not run:
        raise InputError(f"--{next(iter(asked)).replace('_', '-')}: needs --run")
    picture = Path("out", file.stem, "assembly.png") if open_ else None
    files = {"--write": write, "--open": picture}
    with Outputs(json, files=files, reads=(file,)) as outputs:
        stated = read_file(file, dialect)
        outputs.console.print(input_table(stated))
        data = input_json(stated)
        if write is not None:
            written = rewrite(stated, write)
            outputs.say(f"{written.n_bytes / 1e6:.3g} MB", write)
            outputs.console.print(f"{'run it':9} {deck_command(written.deck, write)}")
        if picture is not None:
            draw_deck(stated, picture)
            outputs.say("picture", picture)
        if run:
            method = deck_method(stated, asked)
            with solver_progress(stated.name) as show:
                answer = solve_deck(stated, method, show)
                show.end(answer)
            outputs.show(answer.table)
            found, named = answer.as_dict(), ("title", "measures", "rows", "accuracy")
            data = input_json(stated) | {name: found[name] for name in named if name in found}
            if "rotation" in answer.parts:
                data["largest_rotation"] = answer.parts["rotation"].rows[0].value
        outputs.write_json(data)
    if run:
        exit_by(answer, method)
