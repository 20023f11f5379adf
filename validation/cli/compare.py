"""Commands that compare analyses: methods, initial gaps, mesh sizes and time steps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from validation.cli.options import (
    AutoOption,
    JsonOption,
    KeepOption,
    SceneArgument,
    SetOption,
    folder_option,
    folder_outputs,
    scene_outputs,
)


def compare(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[Path | None, folder_option("the figure", "out/SCENE-compare")] = None,
    explicit: Annotated[
        bool, typer.Option(help="Also run a quasi-static explicit analysis.")
    ] = False,
    auto: AutoOption = None,
    keep: KeepOption = None,
) -> None:
    """Compare rigid and finite-element results on the same facets.

    Prints tables, the influence of each modelling assumption, and a conclusion.
    """
    from geometry.system import peak_memory_mb
    from validation.build.cell import refuse_cell
    from validation.calls import compare as compared
    from validation.case import load_case, require_deformable, with_auto
    from validation.output.progress import solver_progress
    from validation.study.comparison import report
    from validation.study.comparison.scene import comparable_problem, compared_runs

    file = with_auto(load_case(scene, settings or ()), auto, keep or ())
    with scene_outputs(file, json, output, (report.PICTURE,), ending="-compare") as outputs:
        checked, added = require_deformable(file, "compare"), {}
        if checked.effects.auto is not None:
            from validation.study.effects.report import decided

            checked, decision = decided(checked, file.name, outputs.console)
            added["effects_decision"] = decision.as_json()
        refuse_cell(checked, file.name, "compare")
        comparable_problem(checked, file.name)
        with solver_progress(file.name) as show:
            show("rigid blocks, then static")
            rigid, deformable = compared_runs(file.name, checked, explicit=explicit, progress=show)
            result = compared(*rigid, *deformable)
            data = result.as_dict()
        report.print_comparison(result, outputs.console)
        outputs.tell_keys()
        peak = peak_memory_mb()
        outputs.write("picture", report.PICTURE, result.draw)
        outputs.write_json({"scene": file.name, **data, "peak_memory_mb": peak, **added})


def clearance(
    scene: SceneArgument,
    *,
    gap: Annotated[
        list[float] | None,
        typer.Option("--gap", metavar="MM", help="Initial gap [mm]; repeatable."),
    ] = None,
    kind: Annotated[
        Literal["clearance", "spacing"],
        typer.Option(
            help="clearance: a uniform gap along the facet normals; spacing: blocks moved apart, "
            "as in the paper."
        ),
    ] = "clearance",
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[Path | None, folder_option("the figure", "out/SCENE-clearance")] = None,
) -> None:
    """Vary the initial gap between the blocks.

    Prints displacements and contact pressures (static analysis) for each gap.
    """
    from validation.case import load_case, require_deformable
    from validation.output.progress import following
    from validation.study.clearance import GAPS, clearance_rows, draw_clearance, print_rows

    file = load_case(scene, settings or ())
    checked = require_deformable(file, "clearance")
    names = ("clearance.png",)
    with scene_outputs(file, json, output, names, ending="-clearance") as outputs:
        with following(f"{file.name}: static states"):
            rows = clearance_rows(file.name, checked, tuple(gap) if gap else GAPS, kind)
        print_rows(file.name, rows, outputs.console)
        outputs.tell_keys()
        outputs.write(
            "picture", "clearance.png", lambda path: draw_clearance(file.name, rows, path)
        )
        outputs.write_json(rows)


def convergence(
    output: Annotated[Path | None, folder_option("the figure", "out/convergence")] = None,
    json: JsonOption = None,
) -> None:
    """Measure convergence orders in mesh size and time step."""
    from validation.output.progress import following
    from validation.study.convergence import (
        draw_convergence,
        mesh_curves,
        print_convergence,
        time_step_curve,
    )

    names = ("convergence.png",)
    with folder_outputs("convergence", json, output, names) as outputs:
        with following("convergence"):
            curves = [*mesh_curves(), time_step_curve()]
        print_convergence(curves, outputs.console)
        outputs.write("picture", names[0], lambda path: draw_convergence(curves, path))
        outputs.write_json(curves)
