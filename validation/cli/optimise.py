"""Commands that help to choose a block: what matters, and the best design."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from validation.cli.options import (
    JsonOption,
    SceneArgument,
    SetOption,
    folder_option,
    scene_outputs,
)

if TYPE_CHECKING:
    from validation.study.run import Runner
    from validation.study.study import Study


def sensitivity(
    scene: SceneArgument,
    *,
    method: Annotated[
        Literal["rigid", "fem"],
        typer.Option(help="rigid: as `mbd`; fem: deformable blocks on the meshes of `fem`."),
    ] = "rigid",
    of: Annotated[
        list[str] | None,
        typer.Option(
            "--of", metavar="SECTION.KEY", help="Parameter; repeatable. By default all numbers."
        ),
    ] = None,
    step: Annotated[
        float, typer.Option(metavar="SHARE", help="Relative step of real parameters.")
    ] = 0.01,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[
        Path | None, folder_option("table and picture", "out/SCENE-sensitivity")
    ] = None,
) -> None:
    """Derivatives of the measures with respect to the parameters of a scene.

    Each comes with its elasticity and the error of the difference quotient.
    """
    from validation.output.console import status, told_of_compilation
    from validation.scene.read import load_scene
    from validation.study.optimisation import sensitivity as study

    file = load_scene(scene, settings or ())
    names = ("sensitivity.csv", "sensitivity.png")
    with scene_outputs(file, json, output, names, ending="-sensitivity") as outputs:
        with status(outputs.console, f"{file.name}: sensitivity") as tell, told_of_compilation():
            result = study.sensitivity_of(file, method, of, step, tell)
        result.print(outputs.console)
        outputs.write("table", names[0], result.write)
        outputs.write("picture", names[1], result.draw)
        outputs.write_json(result.as_json())


def optimise(
    file: Annotated[str, typer.Argument(metavar="FILE.toml", help="Measures, variables, limits.")],
    *,
    settings: SetOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE.sqlite",
            help="Store of the rows; by default out/FILE.sqlite. The picture lies beside it.",
        ),
    ] = None,
    workers: Annotated[
        int,
        typer.Option(
            metavar="N", help="Number of processes; with one each answer guides the next."
        ),
    ] = 1,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Run on this Dask cluster.")
    ] = None,
    json: JsonOption = None,
) -> None:
    """Find the best design: one measure, or two (Pareto front), under limits.

    An interrupted search continues with the same command.
    """
    from validation.output.outputs import Outputs
    from validation.study.optimisation import report, search
    from validation.study.optimisation.statement import load_optimisation

    stated = load_optimisation(file, settings or ())
    path = Path("out") / f"{stated.study.name}.sqlite" if output is None else output
    final_path = path.with_name(f"{path.stem}-judge.sqlite")
    picture = path.with_suffix(".png")
    stores = {"-o": path} | ({} if stated.judge is None else {"[judge]": final_path})

    def runner(study: Study) -> Runner:
        return search.runner_for(study, workers, scheduler)

    with Outputs(json, files={"picture": picture}, stores=stores, reads=stated.study.reads) as out:
        result, final = search.optimise(stated, path, final_path, runner, _progress)
        report.print_search(result, final, out.console)
        report.draw_search(result, final, picture)
        out.say("picture", picture)
        out.say("results", path)
        out.write_json(report.search_json(result, final))


def _progress(words: str) -> None:
    """Print the course of a search in a line of its own, on a terminal."""
    from validation.output.console import error_console, quiet

    console = error_console()
    if console.is_terminal and not quiet.get():
        console.print(words)
