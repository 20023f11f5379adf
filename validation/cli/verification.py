"""Commands of verification: effects, cost against accuracy, robustness cases."""

from __future__ import annotations

from pathlib import Path

import typer

from validation.cli.options import (
    JsonOption,
    SceneArgument,
    SetOption,
    method_options,
    scene_outputs,
)


def stability(
    *,
    only: list[str] | None = None,
    list_: bool = False,
    json: JsonOption = None,
) -> None:
    """Run the numerical robustness suite (no buckling analysis).

    Each case has a law, the numbers that verify it, and a verdict.

    Parameters
    ----------
    only : NAME
        Case or subject to run; repeatable.
    list_
        List the cases and their laws without running them.
    """
    from validation.output.outputs import Outputs
    from validation.stability import report
    from validation.stability.suite import chosen

    cases = chosen(only or ())
    with Outputs(json) as outputs:
        if list_:
            report.list_cases(cases, outputs.console)
            outputs.write_json({"cases": [case.as_json() for case in cases]})
            return
        result = report.run_cases(cases)
        report.print_cases(result, outputs.console)
        outputs.write_json(result)
    if result["counts"]["red"]:
        raise typer.Exit(1)


@method_options("fem", "max_work")
def effects(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    tolerance: str | None = None,
    json: JsonOption = None,
    output: Path | None = None,
) -> None:
    """Measure the influence and the cost of each effect.

    Switches off the effects of a scene one at a time, in explicit runs to rest. An interrupted call
    goes on from its rows, in the folder of -o, with the same command.

    Parameters
    ----------
    tolerance : 1%
        Change above which an effect is significant; by default 1%.
    output : -o DIR
        Folder for figure and rows; out/SCENE unless --json is given.
    """
    from validation.case import load_case, require_deformable
    from validation.output.console import following
    from validation.study.effects import costs as study
    from validation.study.rowfile import store_or_none

    file = load_case(scene, settings or ())
    require_deformable(file, "effects")
    bound = study.bound(file, tolerance)
    names = (study.PICTURE, "effects.jsonl")
    with scene_outputs(file, json, output, names) as outputs:
        rows = None if outputs.folder is None else outputs.path(names[1])
        with following(file.name) as follow, store_or_none(rows) as store:
            plain = file.changed({"effects.auto": None})
            costs = study.effect_costs(plain, store, tolerance=bound, told=follow)
        outputs.console.print(study.effects_table(costs))
        outputs.write("picture", names[0], lambda path: study.draw_effects(costs, path))
        outputs.write_json(costs)


@method_options("fem", "max_work")
def cost(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    quick: bool = False,
    json: JsonOption = None,
    output: Path | None = None,
    store: Path = Path("out/cost.jsonl"),
) -> None:
    """Measure computational cost versus accuracy.

    Runs every method on a sequence of meshes; prints and plots error against CPU time.

    Parameters
    ----------
    quick
        Coarse meshes only; takes seconds.
    output : -o DIR
        Folder for the figure; out/SCENE-cost unless --json is given.
    store : FILE.jsonl
        Store of the measurements of `cost`.
    """
    from validation.case import load_case
    from validation.output.console import following
    from validation.study.cost import coarsest_mesh, run_cost

    file = load_case(scene, settings or ())
    coarsest_mesh(file)
    names, stores = ("cost.png",), {"--store": store}
    with scene_outputs(file, json, output, names, ending="-cost", stores=stores) as outputs:
        with following(file.name) as follow:
            result = run_cost(file, store, quick=quick, progress=follow)
        result.print(outputs.console)
        outputs.write("picture", "cost.png", result.draw)
        outputs.write_json(result.as_json())
