"""The command that compares methods."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from validation.cli.options import (
    AutoOption,
    JsonOption,
    KeepOption,
    SceneArgument,
    SetOption,
    folder_option,
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
    from geometry.machine.system import peak_memory_mb
    from validation.build.cell import refuse_cell
    from validation.case import load_case, require_deformable, with_auto
    from validation.notebook import compare as compared
    from validation.output.progress import solver_progress
    from validation.study.comparison import report
    from validation.study.comparison.scene import comparable_problem, compared_runs

    file = with_auto(load_case(scene, settings or ()), auto, keep or ())
    with scene_outputs(file, json, output, (report.PICTURE,), ending="-compare") as outputs:
        checked, added = require_deformable(file, "compare"), {}
        if checked.effects.auto is not None:
            from validation.study.effects.report import decided

            checked, decision = decided(checked, file.name, outputs.console, keep or ())
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
