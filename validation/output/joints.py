"""What the joints transmit, as a table and as points with vectors for ParaView."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geometry.files.mesh_io import write_points
from geometry.measures import JointResultants
from geometry.mesh import FloatArray
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
    write_points(
        path,
        joints.centroids,
        {
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
