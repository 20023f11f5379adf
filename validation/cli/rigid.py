"""The rigid-block analysis: equilibrium and mechanisms, disassembly test."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from validation.cli.options import (
    CombinationsOption,
    FieldsOption,
    JsonOption,
    SceneArgument,
    SetOption,
    method_options,
    scene_outputs,
    solve_combinations,
)

if TYPE_CHECKING:
    from geometry.answer import Answer
    from geometry.parts.rows import Part
    from validation.case import Case
    from validation.output.outputs import Outputs

#: Files of the stages of a construction, and of other numbers of layers.
STAGES, LAYERS = "stages.jsonl", "layers.jsonl"


@method_options("rigid", "take_out", "max_work", "max_seconds", "max_memory")
def mbd(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Path | None = None,
    fields: FieldsOption = False,
    layers_to_unlock: bool = False,
    refine: bool = False,
    disassemble: bool = False,
    stages: bool = False,
    combinations: CombinationsOption = False,
) -> None:
    """Rigid-block analysis: locked or not, equilibrium, pressures.

    Prints the kinematic classification with its proof, the equilibrium residual and the contact
    pressures.

    Parameters
    ----------
    output : -o DIR
        Folder for pictures, JSON and joint forces; out/SCENE unless --json is given.
    layers_to_unlock
        Also determine the number of layers at which the tube ceases to be locked.
    refine
        h-refinement check: also solve with half the facet size.
    disassemble
        Also test of a tube how far all blocks can move outward, rings released.
    stages
        Whether each stage of the construction stands, and its least propping: in the order of
        [stages], or layer by layer.
    """
    from validation.case import load_case
    from validation.output.command_files import FILES, write_command_files
    from validation.output.console import following

    case = load_case(scene, settings or (), method="rigid")
    if stages and "stages" not in case.keys:
        case = case.changed({"stages.order": "layers"})
    asked = {
        "--layers-to-unlock": layers_to_unlock,
        "--refine": refine,
        "--disassemble": disassemble,
    }
    if combinations:
        solve_combinations(case, json, output, {"--fields": fields, **asked})
        return
    if any(asked.values()):
        from validation.study.beside_rigid import check_asked

        check_asked(case, asked)
    asks = {STAGES: "stages" in case.keys, LAYERS: layers_to_unlock}
    kept = tuple(name for name, on in asks.items() if on)
    with scene_outputs(case, json, output, (*FILES, *kept), fields=fields) as outputs:
        with following(case.name) as show:
            answer = _solved(case, outputs, show)
        write_command_files(answer.beside(_studied(case, answer, asked, outputs)), outputs)


def _solved(case: Case, outputs: Outputs, show: Callable[[Any], None]) -> Answer:
    """Answer, with stages that a file of rows in the folder keeps."""
    from validation.solving import solve

    if STAGES not in outputs.names:
        return solve(case, show)
    from validation.study.beside_rigid import solve_in_stages

    with _rows(outputs, STAGES) as store:
        return solve_in_stages(case, store, show)


@contextmanager
def _rows(outputs: Outputs, name: str) -> Iterator[Path]:
    """File of rows in the folder; without one it goes at the end."""
    from validation.study.rowfile import store_or_none

    with store_or_none(None if outputs.folder is None else outputs.path(name)) as store:
        yield store


def _studied(
    case: Case, answer: Answer, asked: Mapping[str, bool], outputs: Outputs
) -> dict[str, Part]:
    """Answers to other numbers of layers and to shorter facets, and the motion outwards."""
    from validation.output.console import following

    parts: dict[str, Part] = {}
    if asked["--disassemble"]:
        from validation.output.explosion import run_explosion

        with following(f"{case.name}: motion outwards"):
            parts["disassembly"] = run_explosion(case)
    if asked["--layers-to-unlock"]:
        from validation.study.beside_rigid import layers_to_unlock

        with following(f"{case.name}: layers to unlock"), _rows(outputs, LAYERS) as store:
            parts["layers_to_unlock"] = layers_to_unlock(case, store)
    if asked["--refine"]:
        from validation.study.beside_rigid import refined

        with following(f"{case.name}: half the facet size"):
            parts["refinement"] = refined(case, answer)
    return parts
