"""What the joints transmit, as a table and as points with vectors for ParaView."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geometry.files.mesh_io import write_cells
from geometry.mesh import FloatArray
from geometry.parts.measures import JointResultants, SectionForces
from validation.output.files import write_csv
from validation.output.outputs import Outputs

#: Files of the resultants.
JOINT_FILES = ("joints.csv", "joints.vtu")
_AXES = ("x", "y", "z")


def write_joints(joints: JointResultants, outputs: Outputs, names: tuple[str, ...] = ()) -> None:
    """Write both files; nothing without a folder or without joints.

    ``names`` are those of the blocks, () without any.
    """
    if len(joints.block_m):
        outputs.write("joints", "joints.csv", lambda path: _write_table(joints, names, path))
        outputs.write("joints", "joints.vtu", lambda path: _write_points(joints, path))


def _write_table(joints: JointResultants, names: tuple[str, ...], path: Path) -> None:
    """One row a joint; forces and moments act on block s, moments about the centroid."""
    named = np.array(names)
    columns = {
        "block_m": joints.block_m,
        "block_s": joints.block_s,
        **({"name_m": named[joints.block_m], "name_s": named[joints.block_s]} if names else {}),
        "area_mm2": joints.areas,
        **components("centroid", joints.centroids, "mm"),
        **components("normal", joints.normals, ""),
        **components("force", joints.forces, "N"),
        **components("moment", joints.moments, "Nmm"),
        "normal_force_N": joints.normal_force,
        "shear_force_N": joints.shear_force,
        "bending_moment_Nmm": joints.bending_moment,
        "twisting_moment_Nmm": joints.twisting_moment,
        **components("thrust_point", joints.points, "mm"),
        **{f"{key}_mm": values for key, values in joints.motion.items()},
    }

    write_csv(path, columns, zip(*(values.tolist() for values in columns.values()), strict=True))


def components(
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


#: File of the section forces.
SECTION_FILES = ("section_forces.csv",)
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


def write_sections(found: SectionForces | None, outputs: Outputs) -> None:
    """Write one row for each section; nothing without a folder or without sections."""
    if found is not None:
        outputs.write("sections", SECTION_FILES[0], lambda path: _write(found, path))


def _write(found: SectionForces, path: Path) -> None:
    columns = {"name": list(found.planes.names)}
    for key, values in found.columns().items():
        unit = _UNITS.get(key, "")
        if values.ndim == 1:
            columns[f"{key}_{unit}"] = values.tolist()
            continue
        axes = ("x", "y", "z") if values.shape[1] == 3 else ("1", "2")
        parts = components(key, values, unit, axes)
        columns |= {name: part.tolist() for name, part in parts.items()}
    write_csv(path, columns, zip(*columns.values(), strict=True))
