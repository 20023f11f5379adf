"""The command that compares methods."""

from __future__ import annotations

from pathlib import Path

from validation.cli.options import (
    AutoOption,
    JsonOption,
    KeepOption,
    SceneArgument,
    SetOption,
    decided,
    scene_outputs,
)


def compare(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Path | None = None,
    explicit: bool = False,
    why: bool = False,
    auto: AutoOption = None,
    keep: KeepOption = None,
) -> None:
    """Compare rigid and finite-element results on the same facets.

    Prints tables and a conclusion; with --why the influence of each modelling assumption.

    Parameters
    ----------
    output : -o DIR
        Folder for the figure; out/SCENE-compare unless --json is given.
    explicit : --explicit/--no-explicit
        Also run a quasi-static explicit analysis.
    why
        Also solve the steps from rigid to deformable blocks.
    """
    from geometry.machine.system import peak_memory_mb
    from validation.case import load_case, require_deformable, with_auto
    from validation.output.console import solver_progress
    from validation.study.comparison import report
    from validation.study.comparison.scene import compared_runs

    case = with_auto(load_case(scene, settings or ()), auto, keep or ())
    with scene_outputs(case, json, output, report.FILES, ending="-compare") as outputs:
        require_deformable(case, "compare")
        case, decision = decided(case, outputs.console, keep)
        with solver_progress(case.name) as show:
            result = report.compare_answers(compared_runs(case, explicit=explicit, progress=show))
            result = result.why() if why else result
        report.print_comparison(result, outputs.console)
        outputs.tell_keys()
        peak = {"peak_memory_mb": peak_memory_mb()}
        data = {"scene": case.name, **result.as_dict(), **peak, **decision}
        outputs.write("picture", report.PICTURE, result.draw)
        outputs.write_data("data", report.DATA, data)
        outputs.write("tables", report.TEXT, lambda path: path.write_text(f"{result}\n", "utf-8"))
        outputs.write_json(data)
