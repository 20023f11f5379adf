"""Files that a command leaves of an answer beside its numbers: tables, pictures, histories."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from geometry.answer import Answer, is_round
from geometry.assembly import Assembly
from geometry.files.mesh_io import write_cells
from geometry.machine.system import write_whole
from geometry.parts.measures import JointResultants, SectionForces
from validation.output import answer_files
from validation.output.files import FRAMES, write_csv
from validation.output.outputs import Outputs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fem.explicit.output.energy import History
    from fem.system.reactions import PushCurve
    from mbd.building.stages import StageResults
    from validation.output.explosion import Explosion

#: Files of an answer.
FILES = (
    *answer_files.FILES,
    *answer_files.JOINT_FILES,
    "contact_pressures.png",
    "contacts.vtu",
    "contacts.png",
    "mechanism.png",
    "explosion.png",
    "stages.png",
    "stages.csv",
    "stresses.png",
    "displacement.png",
    "motions.csv",
    "motions.png",
    "history.csv",
    "energies.png",
    FRAMES,
    "frames.pvd",
)


def is_meshed(answer: Answer) -> bool:
    """Whether blocks of a rigid answer have hexahedra; else they are solids with flat patches."""
    return isinstance(answer.details.blocks, Assembly)


def write_command_files(answer: Answer, outputs: Outputs) -> None:
    """Print the table of an answer and write its files."""
    outputs.show(answer.table)
    outputs.tell_keys(answered=True)
    if outputs.folder is not None:
        for words, name, write in _files(answer):
            outputs.write(words, name, write)
        if answer.method != "rigid" and answer.case.method.frames > 0:
            outputs.path(FRAMES)
            outputs.say("frames", outputs.path("frames.pvd"))
    outputs.write_answer(answer)


def _files(answer: Answer) -> Iterator[answer_files.File]:
    """Files of an answer beside its numbers and fields."""
    details, rigid, drawn = answer.details, answer.method == "rigid", pictures(answer)
    if rigid and not is_meshed(answer):
        yield "contacts", "contacts.vtu", partial(_write_contacts, answer)
    sections = cast("SectionForces | None", answer.parts.get("sections"))
    yield from answer_files.joint_files(_joints(answer), sections, answer.problem.blocks.names)
    if "stages" in answer.parts:
        columns = cast("StageResults", answer.parts["stages"]).table
        rows = list(zip(*columns.values(), strict=True))
        yield "stages", "stages.csv", lambda path: write_csv(path, columns, rows)
    if not rigid and (curves := _push_curves(answer)):
        from validation.output.pictures.plots import draw_motions

        yield "motions", "motions.csv", partial(_write_motions, curves)
        drawn["motions.png"] = partial(draw_motions, answer)
    if not rigid and details.run is not None:
        from validation.output.pictures.plots import draw_energies

        yield "history", "history.csv", partial(_write_history, details.run.history)
        drawn["energies.png"] = partial(draw_energies, answer)
    for name, draw in drawn.items():
        yield "picture", name, partial(_save, draw)


def _joints(answer: Answer) -> JointResultants | None:
    details = answer.details
    if answer.method == "rigid":
        return details.joints if details.holds else None
    from fem.answer.forces import joints_of

    return joints_of(details) if details.deformable.meets else None


def _push_curves(answer: Answer) -> tuple[PushCurve, ...]:
    from fem.answer.forces import push_curves_of

    return push_curves_of(answer.details)


def _save(draw: Callable[[], Figure], path: Path) -> None:
    from validation.output.pictures.gallery import save_figure

    save_figure(draw(), path)


def pictures(answer: Answer) -> dict[str, Callable[[], Figure]]:
    """Pictures of an answer by the names of their files."""
    result = _rigid_pictures if answer.method == "rigid" else _deformable_pictures
    return {name: partial(draw, answer) for name, draw in result(answer).items()}


def _rigid_pictures(answer: Answer) -> dict[str, Callable[[Answer], Figure]]:
    from validation.output.pictures.assemblies import draw_mechanism, draw_pressures
    from validation.output.pictures.polyhedra import draw_explosion, draw_polyhedra

    result: dict[str, Callable[[Answer], Figure]] = {}
    if "disassembly" in answer.parts:
        explosion = cast("Explosion", answer.parts["disassembly"])
        result["explosion.png"] = lambda _: draw_explosion(explosion)
    if not is_meshed(answer):
        result["contacts.png"] = draw_polyhedra
    elif answer.details.holds:
        result["contact_pressures.png"] = draw_pressures
    if "mechanism" in answer.fields:
        result["mechanism.png"] = draw_mechanism
    if "stages" in answer.parts:
        from validation.output.pictures.construction import draw_stages

        result["stages.png"] = draw_stages
    return result


def _deformable_pictures(answer: Answer) -> dict[str, Callable[[Answer], Figure]]:
    """Pictures of a deformable answer; that of the displacement is one of tubes."""
    from validation.output.pictures import tubes

    result: dict[str, Callable[[Answer], Figure]] = {}
    if answer.details.deformable.meets:
        result["contact_pressures.png"] = tubes.draw_contact
    result["stresses.png"] = tubes.draw_stresses
    if is_round(answer.details.deformable.assembly):
        result["displacement.png"] = tubes.draw_displacement
    return result


def _write_contacts(answer: Answer, path: Path) -> None:
    """Write the contact polygons with pressures, normals and blocks as `.vtu` triangles."""
    interfaces = answer.details.blocks.interfaces
    polygons, patches = interfaces.polygons, interfaces.patches
    triangles, owner = polygons.triangles
    patch = polygons.patch[owner]
    carried = {}
    if contacts := answer.contacts:  # an attempt that failed is no field
        traction = contacts["force"] / contacts["area"][:, None]
        carried = {
            "patch_pressure": contacts["pressure"][patch],
            "patch_traction": traction[patch],
        }
    write_cells(
        path,
        polygons.corners,
        "triangle",
        triangles,
        cell_data={
            **carried,
            "normal": patches.normals[patch],
            "block_m": patches.block_m[patch].astype(np.int32),
            "block_s": patches.block_s[patch].astype(np.int32),
        },
    )


def _write_motions(curves: Iterable[PushCurve], path: Path) -> None:
    """Write force against displacement of supports that move."""
    rows = [
        (curve.name, *row)
        for curve in curves
        for row in zip(curve.times, curve.displacements, curve.forces, strict=True)
    ]
    write_csv(path, ("support", "time_s", "displacement_mm", "force_N"), rows)


def _write_history(history: History, path: Path) -> None:
    """Write energies over time."""
    write_whole(path, lambda partial: partial.write_text(history.csv(), "utf-8"))
