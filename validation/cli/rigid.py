"""The rigid-block analysis: equilibrium and mechanisms, disassembly test."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from validation.cli.options import (
    CombinationsOption,
    FieldsOption,
    JsonOption,
    MaxMemoryOption,
    MaxSecondsOption,
    MaxWorkOption,
    SceneArgument,
    SetOption,
    folder_option,
    method_fields,
    scene_outputs,
    solve_combinations,
    with_fields,
)

if TYPE_CHECKING:
    from geometry.parts.rows import Part


def mbd(
    scene: SceneArgument,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[
        Path | None, folder_option("pictures, JSON and joint forces", "out/SCENE")
    ] = None,
    *,
    fields: FieldsOption = False,
    unlock: Annotated[
        bool,
        typer.Option(
            "--layers-to-unlock",
            help="Also determine the number of layers at which the tube ceases to be locked.",
        ),
    ] = False,
    refine: Annotated[
        bool,
        typer.Option("--refine", help="h-refinement check: also solve with half the facet size."),
    ] = False,
    disassemble: Annotated[
        bool,
        typer.Option(
            "--disassemble",
            help="Also test of a tube how far all blocks can move outward, rings released.",
        ),
    ] = False,
    combinations: CombinationsOption = False,
    max_work: MaxWorkOption = None,
    max_seconds: MaxSecondsOption = None,
    max_memory: MaxMemoryOption = None,
) -> None:
    """Rigid-block analysis: locked or not, equilibrium, pressures.

    Prints the kinematic classification with its proof, the equilibrium residual and the contact
    pressures.
    """
    from validation.case import load_case
    from validation.output.progress import following
    from validation.output.rigid import FILES, explosion_table, rigid_table, write_rigid
    from validation.solving import solve

    asked = method_fields(max_work=max_work, max_seconds=max_seconds, max_memory=max_memory)
    file = with_fields(load_case(scene, settings or (), method="rigid"), asked, "rigid")
    if combinations:
        alone = {"fields": fields, "layers-to-unlock": unlock, "refine": refine}
        solve_combinations(file, json, output, alone | {"disassemble": disassemble})
        return
    if unlock or refine:
        from validation.study import mesh_and_frames as others

        others.check(file, unlock=unlock, refine=refine)
    with scene_outputs(file, json, output, FILES, fields=fields) as outputs:
        explosion = None
        if disassemble:
            from validation.output.explosion import run_explosion

            with following(f"{file.name}: motion outwards"):
                explosion = run_explosion(file)
        with following(file.name) as show:
            answer = solve(file, show)
        parts: dict[str, Part] = {}
        added: dict[str, Any] = {}
        if unlock:
            with following(f"{file.name}: layers to unlock"):
                parts["layers_to_unlock"] = others.layers_to_unlock(file)
        if refine:
            with following(f"{file.name}: half the facet size"):
                parts["refinement"] = others.refined(file, answer)
        answer = answer.beside(parts, {})
        outputs.show(rigid_table(answer))
        outputs.tell_keys()
        if explosion is not None:
            from validation.output.pictures.polyhedra import draw_explosion

            outputs.show(explosion_table(explosion))
            added["disassembly"] = explosion.as_json()
            outputs.write("picture", "explosion.png", partial(draw_explosion, explosion))
        if outputs.folder is not None:
            write_rigid(answer, outputs)
        outputs.write_answer(answer.with_report(added))
