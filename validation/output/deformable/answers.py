"""What a deformable run leaves: fields for ParaView, history, pictures, and its numbers as text."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from geometry.answer import Answer
from geometry.machine.system import write_whole
from geometry.parts.measures import SectionForces
from validation.output import answer_files
from validation.output.deformable.fields import FRAMES
from validation.output.files import write_csv
from validation.output.forces import (
    JOINT_FILES,
    SECTION_FILES,
    write_joints,
    write_sections,
)
from validation.output.outputs import Outputs
from validation.scene.family import RoundScene
from validation.solving import solve

if TYPE_CHECKING:
    from fem.explicit.output.energy import History

#: Files of a run.
FILES = (
    *answer_files.FILES,
    "contact_pressures.png",
    "stresses.png",
    "sections.png",
    "displacement.png",
    *JOINT_FILES,
    *SECTION_FILES,
    "motions.csv",
    "motions.png",
    "history.csv",
    "energies.png",
    FRAMES,
    "frames.pvd",
)


def write_run_files(answer: Answer, outputs: Outputs) -> None:
    """Write joints, pictures and history beside the answer; nothing without a folder."""
    if outputs.folder is None:
        return
    if answer.details.deformable.meets:
        write_joints(answer.details.joints, outputs, answer.details.deformable.assembly.names)
    sections = answer.parts.get("sections")
    write_sections(sections if isinstance(sections, SectionForces) else None, outputs)
    for file, draw in run_pictures(answer).items():
        outputs.write("picture", file, partial(draw, answer))
    if answer.details.push_curves:
        _write_motions(answer, outputs)
    if answer.details.run is not None:
        _write_history(answer.details.run.history, answer.title, outputs)
    if answer.case.scene.fem.frames > 0:
        outputs.path(FRAMES)
        outputs.say("frames", outputs.path("frames.pvd"))


def run_pictures(answer: Answer) -> dict[str, Callable[[Answer, Path], None]]:
    """Pictures of a state; sections and the view along an axis are those of tubes."""
    from validation.output.pictures import tubes

    pictures: dict[str, Callable[[Answer, Path], None]] = {}
    if answer.details.deformable.meets:
        pictures["contact_pressures.png"] = tubes.draw_contact
    pictures["stresses.png"] = tubes.draw_stresses
    if isinstance(answer.case.scene, RoundScene):
        pictures["sections.png"] = tubes.draw_sections
        pictures["displacement.png"] = tubes.draw_displacement
    return pictures


def _write_motions(answer: Answer, outputs: Outputs) -> None:
    """Write force against displacement of supports that move, next to the rigid limit."""
    from validation.output.pictures.motions import draw_motions

    curves, limit = answer.details.push_curves, _rigid_limit(answer)
    rows = [
        (curve.name, *row)
        for curve in curves
        for row in zip(curve.times, curve.displacements, curve.forces, strict=True)
    ]
    heads = ("support", "time_s", "displacement_mm", "force_N")
    outputs.write("motions", "motions.csv", lambda path: write_csv(path, heads, rows))
    outputs.write(
        "picture",
        "motions.png",
        lambda path: draw_motions(curves, path, title=answer.title, limit=limit),
    )


def _rigid_limit(answer: Answer) -> float | None:
    """Limit of the push of a scene with associated friction [N]; None where there is none."""
    if answer.case.scene.push is None:
        return None
    push = solve(answer.case.with_method("rigid")).parts["push_limit"]
    return push.associated  # type: ignore[attr-defined]


def _write_history(history: History, title: str, outputs: Outputs) -> None:
    """Write energies over time as table and picture."""
    from validation.output.pictures.energies import draw_energies

    def table(path: Path) -> None:
        write_whole(path, lambda partial: partial.write_text(history.csv(), "utf-8"))

    outputs.write("history", "history.csv", table)
    outputs.write("picture", "energies.png", lambda path: draw_energies(history, path, title=title))
