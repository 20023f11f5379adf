"""The rigid-block analysis: equilibrium and mechanisms, disassembly test."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from validation.cli.options import (
    CombinationsOption,
    FieldsOption,
    JsonOption,
    SceneArgument,
    SetOption,
    folder_option,
    method_options,
    scene_outputs,
    solve_combinations,
)

if TYPE_CHECKING:
    from geometry.answer import Answer
    from geometry.parts.rows import Part
    from validation.case import Case
    from validation.output.explosion import Explosion


@method_options("rigid", "take_out", "max_work", "max_seconds", "max_memory")
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
    stages: Annotated[
        bool,
        typer.Option(
            "--stages",
            help="Whether each stage of the construction stands, and its least propping: in the "
            "order of [stages], or layer by layer.",
        ),
    ] = False,
    combinations: CombinationsOption = False,
) -> None:
    """Rigid-block analysis: locked or not, equilibrium, pressures.

    Prints the kinematic classification with its proof, the equilibrium residual and the contact
    pressures.
    """
    from validation.case import load_case
    from validation.output.progress import following
    from validation.output.rigid import FILES, write_rigid
    from validation.solving import solve

    case = load_case(scene, settings or (), method="rigid")
    if stages and case.scene.stages is None:
        case = case.changed({"stages.order": "layers"})
    if combinations:
        alone = {"fields": fields, "layers-to-unlock": unlock, "refine": refine, "stages": stages}
        solve_combinations(case, json, output, alone | {"disassemble": disassemble})
        return
    if unlock or refine:
        from validation.study.mesh_and_frames import check

        check(case, unlock=unlock, refine=refine)
    with scene_outputs(case, json, output, FILES, fields=fields) as outputs:
        parts: dict[str, Part] = {"disassembly": _exploded(case)} if disassemble else {}
        with following(case.name) as show:
            answer = solve(case, show)
        parts |= _studied(case, answer, unlock=unlock, refine=refine)
        answer = answer.beside(parts)
        outputs.show(answer.table)
        outputs.tell_keys(answered=True)
        if outputs.folder is not None:
            write_rigid(answer, outputs)
        outputs.write_answer(answer)


def _studied(case: Case, answer: Answer, *, unlock: bool, refine: bool) -> dict[str, Part]:
    """Answers to other numbers of layers and to shorter facets."""
    from validation.output.progress import following

    parts: dict[str, Part] = {}
    if unlock:
        from validation.study.mesh_and_frames import layers_to_unlock

        with following(f"{case.name}: layers to unlock"):
            parts["layers_to_unlock"] = layers_to_unlock(case)
    if refine:
        from validation.study.mesh_and_frames import refined

        with following(f"{case.name}: half the facet size"):
            parts["refinement"] = refined(case, answer)
    return parts


def _exploded(case: Case) -> Explosion:
    """Motion of all blocks outwards."""
    from validation.output.explosion import run_explosion
    from validation.output.progress import following

    with following(f"{case.name}: motion outwards"):
        return run_explosion(case)
