"""Files of an answer: JSON, arrays (numpy), meshes for ParaView, tables of joints and sections."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from geometry.answer import Answer, Measure, known, restored
from geometry.errors import unreadable
from geometry.files.mesh_io import write_cells
from geometry.machine.system import write_whole
from geometry.mesh import FloatArray
from geometry.parts.measures import JointResultants, SectionForces
from geometry.parts.rows import Row
from validation.errors import InputError
from validation.output.files import prepare_folder, write_csv, write_json

#: Files of an answer.
FILES = ("answer.json", "answer.npz", "fields.vtu", "contact_pressures.vtu")
#: Endings of files that commands write only if asked to: arrays, and fields for ParaView.
LARGE = (".npz", ".vtu")
#: What reading a damaged answer raises.
_DAMAGES = (OSError, ValueError, KeyError, TypeError, EOFError, RecursionError, BadZipFile)
_HEAD = ("title", "method", "measures", "rows", "fields")
#: What a command adds to the data of an answer.
_OF_COMMAND = ("json_version", "unused_keys", "defaults", "provenance")
_ARRAYS = ("points", "cells", "block_of_point", "layer_of_point")
#: What a file holds in a word, its name, and who writes it.
File = tuple[str, str, Callable[[Path], None]]


def write_answer(answer: Answer, folder: Path) -> tuple[Path, ...]:
    """Write an answer into a folder, which is made: `FILES`, each whole or not at all.

    Files of that name of an earlier answer go where this one has none.

    Returns
    -------
    tuple[Path, ...]
        The files; without contact facets there is no file of them.
    """
    folder = prepare_folder(folder)
    written = []
    for _, name, write in answer_files(answer):
        written.append(folder / name)
        write(written[-1])
    remove_others(folder, FILES, {path.name for path in written})
    return tuple(written)


def remove_others(folder: Path, names: Collection[str], written: Collection[str]) -> None:
    """Remove what an earlier answer left under ``names``, patterns too, that are not written."""
    for name in set(names).difference(written):
        for path in folder.glob(name):
            if path.name not in written:
                path.unlink()


def answer_files(
    answer: Answer, stated: Callable[[], Mapping[str, Any]] | None = None
) -> Iterator[File]:
    """Files of the numbers of an answer.

    ``stated`` is what stands in the first of them, where that is more than the answer itself.
    """
    data, arrays, fields, contacts = FILES
    whole = answer.as_dict if stated is None else stated
    yield "answer", data, lambda path: write_json(str(path), whole())
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
    for name in FILES[:2]:
        why = unreadable(folder / name)
        if why is not None:
            raise InputError(
                f"{folder / name}: {why}; expected a folder that `write` or a command with "
                "`--fields` wrote"
            )
    try:
        data = json.loads((folder / FILES[0]).read_text("utf-8"))
        with np.load(folder / FILES[1], allow_pickle=False) as stored:
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

#: Their files.
JOINT_FILES = ("joints.csv", "joints.vtu", "section_forces.csv")
_AXES = ("x", "y", "z")


def joint_files(
    joints: JointResultants | None, sections: SectionForces | None, names: tuple[str, ...] = ()
) -> Iterator[File]:
    """Files of the forces of joints and sections, where there are some.

    ``names`` are those of the blocks, () without any.
    """
    joint_table, joint_points, section_table = JOINT_FILES
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
