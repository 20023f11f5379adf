"""Files of an answer: its numbers, fields for ParaView, tables, pictures, histories."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast
from zipfile import BadZipFile

import numpy as np

from geometry.answer import Answer, Measure, is_round, known, restored
from geometry.assembly import Assembly
from geometry.errors import unreadable
from geometry.files.mesh_io import write_cells
from geometry.machine.system import write_whole
from geometry.mesh import FloatArray
from geometry.parts.measures import JointResultants, SectionForces
from geometry.parts.rows import Row
from validation.errors import InputError
from validation.output.files import FRAMES, prepare_folder, remove_others, write_csv, write_json
from validation.output.outputs import Outputs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fem.explicit.output.energy import History
    from fem.system.reactions import PushCurve
    from mbd.building.stages import StageResults
    from validation.output.explosion import Explosion

#: Files of the numbers of an answer.
NUMBERS = ("answer.json", "answer.npz", "fields.vtu", "contact_pressures.vtu")
#: Those of what joints and sections transmit.
_JOINT_FILES = ("joints.csv", "joints.vtu", "section_forces.csv")
#: Those of a command.
FILES = (
    *NUMBERS,
    *_JOINT_FILES,
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
#: What reading a damaged answer raises.
_DAMAGES = (OSError, ValueError, KeyError, TypeError, EOFError, RecursionError, BadZipFile)
_HEAD = ("title", "method", "measures", "rows", "fields")
#: What a command adds to the data of an answer.
_OF_COMMAND = ("json_version", "unused_keys", "defaults", "provenance")
_ARRAYS = ("points", "cells", "block_of_point", "layer_of_point")
#: What a file holds in a word, its name, and who writes it.
File = tuple[str, str, Callable[[Path], None]]


def write_answer(answer: Answer, folder: Path) -> tuple[Path, ...]:
    """Write an answer into a folder, which is made: `NUMBERS`, each whole or not at all.

    Files of that name of an earlier answer go where this one has none.

    Returns
    -------
    tuple[Path, ...]
        The files; without contact facets there is no file of them.
    """
    folder = prepare_folder(folder)
    written = [folder / NUMBERS[0]]
    write_json(str(written[0]), answer.as_dict())
    for _, name, write in _field_files(answer):
        written.append(folder / name)
        write(written[-1])
    remove_others(folder, NUMBERS, {path.name for path in written})
    return tuple(written)


def _field_files(answer: Answer) -> Iterator[File]:
    """Files of the fields of an answer."""
    _, arrays, fields, contacts = NUMBERS
    yield "arrays", arrays, lambda path: write_whole(path, lambda file: _write_arrays(answer, file))
    yield "fields", fields, lambda path: _write_fields(answer, path)
    if "corners" in answer.contacts:
        yield "pressures", contacts, lambda path: write_contacts(answer, path)


def _write_arrays(answer: Answer, path: Path) -> None:
    arrays: dict[str, Any] = dict(answer.arrays)
    arrays |= {f"field {name}": values for name, values in answer.fields.items()}
    arrays |= {f"contact {name}": values for name, values in answer.contacts.items()}
    with path.open("wb") as file:
        np.savez(file, **arrays)


def _write_fields(answer: Answer, path: Path) -> None:
    """Write blocks before the load acts with their fields; of deformable ones as they were solved.

    An answer that was read has no elements of higher degree and no integration points.
    """
    if answer.method != "rigid" and answer.details is not None:
        from validation.output.fields import write_solution

        write_solution(answer.details, path)
        return
    first = answer.cells[:, 0]
    owners = {
        "block": answer.block_of_point[first].astype(np.int32),
        "layer": answer.layer_of_point[first].astype(np.int32),
    }
    kind = "hexahedron" if answer.cells.shape[1] == 8 else "triangle"
    fields = answer.fields
    write_cells(path, answer.points, kind, answer.cells, point_data=fields, cell_data=owners)


def write_contacts(answer: Answer, path: Path) -> None:
    """Write contact facets with pressures, forces, gaps, slips, blocks and layers as `.vtu`."""
    result = answer.contacts
    given = {"pressure": "contact_pressure", "force": "contact_force"}
    values = {
        given.get(n, n): result[n] for n in ("pressure", "force", "gap", "slip") if n in result
    }
    if "force" in result:
        values["traction"] = result["force"] / result["area"][:, None]
    values |= {name: result[name] for name in ("normal", "area")}
    for k, side in enumerate("ms"):
        values[f"block_{side}"] = result["blocks"][:, k].astype(np.int32)
        values[f"layer_{side}"] = result["layer"][:, k].astype(np.int32)
    corners = result["corners"].reshape(-1, 3)
    quads = np.arange(len(corners)).reshape(-1, 4)
    write_cells(path, corners, "quad", quads, cell_data=values)


def measure_of(data: Mapping[str, Any]) -> Measure:
    """Measure of its plain data; one without a number has a remark instead."""
    value = data["value"]
    return Measure(**{**data, "value": math.nan if value is None else value})


def read_answer(folder: Path) -> Answer:
    """Read an answer that was written; `details`, the solver's own result, is not kept."""
    for name in NUMBERS[:2]:
        why = unreadable(folder / name)
        if why is not None:
            raise InputError(
                f"{folder / name}: {why}; expected a folder that `write` or a command with "
                "`--fields` wrote"
            )
    try:
        data = json.loads((folder / NUMBERS[0]).read_text("utf-8"))
        with np.load(folder / NUMBERS[1], allow_pickle=False) as stored:
            return answer_of_data(data, {name: stored[name] for name in stored.files})
    except _DAMAGES as error:
        raise InputError(f"{folder}: holds a damaged answer ({error}); write it again") from None


def answer_of_data(data: Mapping[str, Any], arrays: Mapping[str, Any] | None = None) -> Answer:
    """Answer of the data of `Answer.as_dict`, with the arrays of `write` or without any."""
    beside = (*_HEAD, *_OF_COMMAND)
    report = {name: part for name, part in data.items() if name not in beside}
    measures = {name: measure_of(of) for name, of in data["measures"].items()}
    stored = dict.fromkeys(_ARRAYS, np.zeros(0)) if arrays is None else arrays
    kept = {
        "title": data["title"],
        "method": data["method"],
        "measures": known(measures),
        "fields": known(_named(stored, "field ")),
        "contacts": known(_named(stored, "contact ")),
        "arrays": known({name: stored[name] for name in _ARRAYS}),
    }
    return restored(kept, report, [Row(**row) for row in data["rows"]])


def _named(arrays: Mapping[str, Any], kind: str) -> dict[str, Any]:
    return {name.removeprefix(kind): v for name, v in arrays.items() if name.startswith(kind)}


# ---------------------------------------------------------------------------------------------
# What joints and sections transmit

_AXES = ("x", "y", "z")


def _joint_files(
    joints: JointResultants | None, sections: SectionForces | None, names: tuple[str, ...] = ()
) -> Iterator[File]:
    """Files of the forces of joints and sections, where there are some.

    ``names`` are those of the blocks, () without any.
    """
    joint_table, joint_points, section_table = _JOINT_FILES
    if joints is not None and len(joints.block_m):
        yield "joints", joint_table, lambda path: _write_table(joints, names, path)
        yield "joints", joint_points, lambda path: _write_points(joints, path)
    if sections is not None:
        yield "sections", section_table, lambda path: _write_sections(sections, path)


def _write_table(joints: JointResultants, names: tuple[str, ...], path: Path) -> None:
    """One row a joint; forces and moments act on block s, moments about the centroid."""
    named = np.array(names)
    columns = {
        "block_m": joints.block_m,
        "block_s": joints.block_s,
        **({"name_m": named[joints.block_m], "name_s": named[joints.block_s]} if names else {}),
        "area_mm2": joints.areas,
        **_components("centroid", joints.centroids, "mm"),
        **_components("normal", joints.normals, ""),
        **_components("force", joints.forces, "N"),
        **_components("moment", joints.moments, "Nmm"),
        "normal_force_N": joints.normal_force,
        "shear_force_N": joints.shear_force,
        "bending_moment_Nmm": joints.bending_moment,
        "twisting_moment_Nmm": joints.twisting_moment,
        **_components("thrust_point", joints.points, "mm"),
        **{f"{key}_mm": values for key, values in joints.motion.items()},
    }

    write_csv(path, columns, zip(*(values.tolist() for values in columns.values()), strict=True))


def _components(
    name: str, values: FloatArray, unit: str, axes: tuple[str, ...] = _AXES
) -> dict[str, FloatArray]:
    """Columns of the components of vectors (n, n_axes), named by axis and unit."""
    end = f"_{unit}" if unit else ""
    return {f"{name}_{axis}{end}": values[:, k] for k, axis in enumerate(axes)}


def _write_points(joints: JointResultants, path: Path) -> None:
    """A point at the centroid of each joint, with its vectors."""
    write_cells(
        path,
        joints.centroids,
        "vertex",
        np.arange(len(joints.centroids))[:, None],
        point_data={
            "force": joints.forces,
            "moment": joints.moments,
            "normal": joints.normals,
            "normal_force": joints.normal_force,
            "shear_force": joints.shear_force,
            "bending_moment": joints.bending_moment,
            "eccentricity": joints.eccentricity,
            "area": joints.areas,
            **joints.motion,
            "block_m": joints.block_m.astype(np.int32),
            "block_s": joints.block_s.astype(np.int32),
        },
    )


#: Units of the columns; others are directions.
_UNITS = {
    "plane_point": "mm",
    "area": "mm2",
    "centroid": "mm",
    "force": "N",
    "moment": "Nmm",
    "normal_force": "N",
    "shear_forces": "N",
    "bending_moments": "Nmm",
    "twisting_moment": "Nmm",
    "point": "mm",
}


def _write_sections(found: SectionForces, path: Path) -> None:
    columns = {"name": list(found.planes.names)}
    for key, values in found.columns().items():
        unit = _UNITS.get(key, "")
        if values.ndim == 1:
            columns[f"{key}_{unit}"] = values.tolist()
            continue
        axes = ("x", "y", "z") if values.shape[1] == 3 else ("1", "2")
        parts = _components(key, values, unit, axes)
        columns |= {name: part.tolist() for name, part in parts.items()}
    write_csv(path, columns, zip(*columns.values(), strict=True))


# ---------------------------------------------------------------------------------------------
# What a command leaves: the answer, tables, pictures, histories


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
    data = answer.as_dict()
    outputs.write_data("answer", NUMBERS[0], data)
    if outputs.folder is not None:
        for words, name, write in _field_files(answer):
            outputs.write(words, name, write)
    outputs.remove_others()
    outputs.write_json(data)


def _files(answer: Answer) -> Iterator[File]:
    """Files of an answer beside its numbers and fields."""
    details, rigid, drawn = answer.details, answer.method == "rigid", pictures(answer)
    if rigid and not is_meshed(answer):
        yield "contacts", "contacts.vtu", partial(_write_patches, answer)
    sections = cast("SectionForces | None", answer.parts.get("sections"))
    yield from _joint_files(_joints(answer), sections, answer.problem.blocks.names)
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

    return joints_of(details) if details.whole.meets else None


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

    result: dict[str, Callable[[Answer], Figure]] = {}
    if "disassembly" in answer.parts:
        from validation.output.pictures.polyhedra import draw_explosion

        explosion = cast("Explosion", answer.parts["disassembly"])
        result["explosion.png"] = lambda _: draw_explosion(explosion)
    if not is_meshed(answer):
        from validation.output.pictures.polyhedra import draw_polyhedra

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
    if answer.details.whole.meets:
        result["contact_pressures.png"] = tubes.draw_contact
    result["stresses.png"] = tubes.draw_stresses
    if is_round(answer.details.whole.assembly):
        result["displacement.png"] = tubes.draw_displacement
    return result


def _write_patches(answer: Answer, path: Path) -> None:
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
