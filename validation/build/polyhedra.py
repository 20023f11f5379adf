"""From scenes of triangulated blocks to checked assemblies and loads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.assembly import AnyBlocks, AssemblyError
from geometry.files.block_files import read_blocks
from geometry.files.named_surfaces import Y_UP
from geometry.loads import LoadCase
from geometry.mesh import BoolArray, FloatArray
from geometry.parts.chosen import numbers_of
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.options import DetectionOptions
from geometry.polyhedra.overlap import check_assembly
from geometry.polyhedra.polyhedron import Polyhedron
from validation.build.blocks import body_forces, build_weight
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
    detection = scene.detection.options
    if isinstance(scene, MeshScene):
        assembly = _from_files(scene, folder, detection)
    else:
        assembly = scene.stated.build(detection)
    check_block_size(scene, assembly)
    check_assembly(assembly, supported_blocks(scene, assembly))
    return assembly


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
    def read(part: PartSection) -> Sequence[tuple[Polyhedron, Polyhedron]]:
        return [(solid, solid) for solid in file_solids(scene, part, folder)]

    placed = placed_blocks(scene, read)
    assembly = polyhedral_assembly(
        "own blocks",
        placed.blocks,
        placed.fixed,
        detection,
        placed.names,
        supported=bool(scene.supports),
    )
    return replace(assembly, parts=placed.parts)


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


@dataclass(frozen=True)
class Placed(Generic[Shape]):
    """Blocks of all parts, in the order of places."""

    blocks: list[tuple[Shape, FloatArray, FloatArray]]
    """With rotation (3, 3) and translation (3,) [mm]."""
    fixed: BoolArray
    """Which are held: by their file, their place, number or name; (n_blocks,)."""
    names: tuple[str, ...]
    """As in `geometry.assembly.PlacedBlocks`."""
    parts: tuple[int, ...]
    """Of ``[[parts]]``, (n_blocks,)."""


def placed_blocks(
    scene: MeshScene, read: Callable[[PartSection], Sequence[tuple[Shape, Polyhedron]]]
) -> Placed[Shape]:
    """Place the blocks of all parts.

    Parameters
    ----------
    scene
        Its parts.
    read
        Reads the blocks of a part's file, and the solids that it gives.
    """
    blocks: list[tuple[Shape, FloatArray, FloatArray]] = []
    held: list[bool] = []
    names: list[str] = []
    upright = Y_UP if scene.block.up == "y" else np.eye(3)
    parts: list[int] = []
    for number, part in enumerate(scene.parts):
        result = read(part)
        for place in part.places:
            turn, shift = motion(place)
            blocks += [(shape, turn @ upright, shift) for shape, _ in result]
            held += [part.fixed or place.fixed or solid.held for _, solid in result]
            names += [solid.given_name for _, solid in result]
            parts += [number] * len(result)
    fixed = np.array(held)
    for one in scene.assembly.fixed:
        fixed[numbers_of("assembly.fixed", one, names)] = True
    return Placed(blocks, fixed, tuple(names) if any(names) else (), tuple(parts))


@dataclass(frozen=True)
class BodyLoads:
    """Loads on whole blocks."""

    dead: FloatArray
    """(F, M) about each block's centroid, (n_blocks, 6) [N, N mm]."""
    live: FloatArray
    """The same for what may grow, (n_blocks, 6)."""

    def load_case(self, assembly: AnyBlocks) -> LoadCase:
        """Dead and live load together."""
        return LoadCase(
            assembly,
            "dead and live load",
            (),
            assembly.fixed,
            body_wrenches=self.dead + self.live,
        )


def build_body_loads(scene: PolyhedralScene, assembly: AnyBlocks) -> BodyLoads:
    """Build weight, accelerations and point forces."""
    weight = build_weight(scene, assembly)
    dead = np.zeros((assembly.n_blocks, 6)) if weight is None else weight
    return BodyLoads(dead, build_live_load(scene, assembly))


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
