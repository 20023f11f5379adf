"""The command that measures computational cost versus accuracy."""

from __future__ import annotations

from pathlib import Path

from validation.cli.options import (
    JsonOption,
    SceneArgument,
    SetOption,
    method_options,
    scene_outputs,
)


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
    from validation.study.costs.report import draw_study, print_study, study_json
    from validation.study.costs.study import coarsest_mesh, run_cost

    file = load_case(scene, settings or ())
    coarsest_mesh(file)
    names, stores = ("cost.png",), {"--store": store}
    with scene_outputs(file, json, output, names, ending="-cost", stores=stores) as outputs:
        with following(file.name) as follow:
            study = run_cost(file, store, quick=quick, progress=follow)
        print_study(study, outputs.console)
        title = f"{', '.join((file.name, *(settings or ())))}: {file.load_words}"
        outputs.write("picture", "cost.png", lambda path: draw_study(study, path, title=title))
        outputs.write_json(study_json(study))
