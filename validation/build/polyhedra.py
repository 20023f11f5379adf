"""From scenes of triangulated blocks to checked assemblies and loads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.assembly import AnyBlocks, AssemblyError
from geometry.files.block_files import read_blocks
from geometry.files.named_surfaces import Y_UP
from geometry.mesh import FloatArray
from geometry.parts.chosen import numbers_of
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.options import DetectionOptions
from geometry.polyhedra.overlap import check_assembly
from geometry.polyhedra.polyhedron import Polyhedron
from validation.build.blocks import body_forces
from validation.build.supports import supported_blocks
from validation.errors import InputError
from validation.scene.plausibility import check_block_size
from validation.scene.polyhedra import (
    MeshScene,
    PartSection,
    PlaceSection,
    PolyhedralScene,
)

Shape = TypeVar("Shape")


#: Places are turned by at most this, ten turns [°].
LARGEST_ANGLE = 3600.0


def build_polyhedra(scene: PolyhedralScene, folder: Path) -> PolyhedralAssembly:
    """Build and check the blocks of a scene; names of files are relative to the folder."""
    assembly = build_solids(scene, folder)
    check_block_size(scene, assembly)
    check_assembly(assembly, supported_blocks(scene, assembly))
    return assembly


def build_solids(scene: PolyhedralScene, folder: Path) -> PolyhedralAssembly:
    """Build the blocks of a scene, whose contacts are not checked."""
    detection = scene.detection.options
    if isinstance(scene, MeshScene):
        return _from_files(scene, folder, detection)
    return scene.stated.build(detection)


def motion(place: PlaceSection) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and translation (3,) [mm] of a place."""
    axis = np.array(place.axis)
    size = float(np.abs(axis).max())
    if size == 0.0:
        raise AssemblyError("parts.places.axis: got [0, 0, 0], expected a direction")
    if not abs(place.angle) <= LARGEST_ANGLE:
        raise AssemblyError(
            f"parts.places.angle: got {place.angle:g}, expected degrees between "
            f"-{LARGEST_ANGLE:g} and {LARGEST_ANGLE:g}"
        )
    axis = axis / size  # first: the square of a component may be no float
    turn = Rotation.from_rotvec(np.radians(place.angle) * axis / np.linalg.norm(axis)).as_matrix()
    return np.asarray(turn, dtype=np.float64), np.array(place.at)


def _from_files(scene: MeshScene, folder: Path, detection: DetectionOptions) -> PolyhedralAssembly:
    blocks: list[tuple[Polyhedron, FloatArray, FloatArray]] = []
    held: list[bool] = []
    parts: list[int] = []
    upright = Y_UP if scene.block.up == "y" else np.eye(3)
    for number, part in enumerate(scene.parts):
        solids = file_solids(scene, part, folder)
        for place in part.places:
            turn, shift = motion(place)
            blocks += [(solid, turn @ upright, shift) for solid in solids]
            held += [part.fixed or place.fixed or solid.held for solid in solids]
            parts += [number] * len(solids)
    names, fixed = tuple(solid.given_name for solid, _, _ in blocks), np.array(held)
    for one in scene.assembly.fixed:
        fixed[numbers_of("assembly.fixed", one, names)] = True
    assembly = polyhedral_assembly(
        "own blocks",
        blocks,
        fixed,
        detection,
        names if any(names) else (),
        supported=bool(scene.supports),
    )
    return replace(assembly, parts=tuple(parts))


def file_solids(scene: MeshScene, part: PartSection, folder: Path) -> list[Polyhedron]:
    """Solids of one of the files of a scene."""
    block = scene.block
    return read_blocks(
        folder / part.file,
        units=block.units,
        element_size=block.element_size,
        repair=block.repair,
        leave_out=part.leave_out,
    )


def build_live_load(scene: PolyhedralScene, assembly: AnyBlocks) -> FloatArray:
    """Accelerations and point forces about each block's centroid, (n_blocks, 6) [N, N mm]."""
    live = body_forces(scene, assembly, scene.load.acceleration)
    for push in scene.load.forces:
        if push.block >= assembly.n_blocks:
            raise InputError(
                f"load.forces.block: got {push.block}, but blocks are numbered 0 to "
                f"{assembly.n_blocks - 1}"
            )
        force = np.array(push.force)
        live[push.block, :3] += force
        if push.point is not None:
            arm = np.array(push.point) - assembly.centroids[push.block]
            live[push.block, 3:] += np.cross(arm, force)
    return live
