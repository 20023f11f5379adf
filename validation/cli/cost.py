"""Commands that say what an accuracy costs and how errors fall."""

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
    scene_outputs,
)


def cost(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    quick: Annotated[bool, typer.Option("--quick", help="Coarse meshes only, in seconds.")] = False,
    others: Annotated[
        bool, typer.Option("--others", help="Other programs too, where installed: CalculiX.")
    ] = False,
    json: JsonOption = None,
    output: Annotated[Path | None, folder_option("the figure", "out/SCENE-cost")] = None,
    store: CostStoreOption = COST_STORE,
) -> None:
    """Error against CPU time of every method and mesh: what an accuracy costs."""
    from validation.cost.plan import full_plan, quick_plan, require_cost_scene
    from validation.cost.report import draw_study, print_study, study_json
    from validation.cost.store import CostStore
    from validation.cost.study import run_cost
    from validation.output.console import status
    from validation.scene.read import load_scene

    file = load_scene(scene, settings or ())
    checked = require_cost_scene(file.scene, file.name)
    plan = (quick_plan if quick else full_plan)(file.name, checked, others=others)
    names, stores = ("cost.png",), {"--store": store}
    with scene_outputs(file, json, output, names, ending="-cost", stores=stores) as outputs:
        with CostStore(store) as kept, status(outputs.console, "cost") as tell:
            study = run_cost(
                file.name,
                checked,
                plan,
                kept,
                progress=lambda number, total, what: tell(f"{number} of {total}: {what}"),
            )
        print_study(study, outputs.console)
        title = ", ".join((file.name, *(settings or ())))
        outputs.write("picture", "cost.png", lambda path: draw_study(study, path, title=title))
        outputs.write_json(study_json(study))


def peaks(json: JsonOption = None) -> None:
    """Observed orders of curved elements in pressures and stresses, and what a cap changes."""
    from validation.cost.peaks import peaks, peaks_json, print_peaks
    from validation.output.console import status
    from validation.output.outputs import Outputs

    with Outputs(json) as outputs:
        with status(outputs.console, "two layers of tsb1-pipe, degrees 1 to 3"):
            orders, cap = peaks()
        print_peaks(orders, cap, outputs.console)
        outputs.write_json(peaks_json(orders, cap))
