"""The command that measures computational cost versus accuracy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from validation.cli.options import (
    COST_STORE,
    CostStoreOption,
    JsonOption,
    SceneArgument,
    SetOption,
    folder_option,
    method_options,
    scene_outputs,
)


@method_options("fem", "max_work")
def cost(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Coarse meshes only; takes seconds.")
    ] = False,
    json: JsonOption = None,
    output: Annotated[Path | None, folder_option("the figure", "out/SCENE-cost")] = None,
    store: CostStoreOption = COST_STORE,
) -> None:
    """Measure computational cost versus accuracy.

    Runs every method on a sequence of meshes; prints and plots error against CPU time.
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
