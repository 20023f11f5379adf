"""From scenes to what the solvers take: assemblies and load cases."""

from __future__ import annotations

import numpy as np

from geometry.assembly import AnyBlocks, Assembly
from geometry.loads import LoadCase
from geometry.mesh import FloatArray
from validation.build.materials import densities
from validation.build.supports import stated_load
from validation.errors import InputError
from validation.scene.family import AssemblyScene
from validation.scene.plausibility import check_block_size
from validation.scene.polyhedra import PolyhedralScene
from validation.scene.read import DeformableScene
from validation.scene.sections import Vector


def require_assembly(scene: DeformableScene, name: str, command: str) -> AssemblyScene:
    """Return the scene if its blocks meet each other."""
    if isinstance(scene, AssemblyScene) and scene.meets:
        return scene
    if isinstance(scene, PolyhedralScene):
        raise InputError(
            f"{name}: blocks of type {scene.block.type!r} have no mesh of a family; `tubelock "
            f"{command}` expects one, such as tsb1-pipe: use `tubelock mbd` or `tubelock fem`"
        )
    raise InputError(
        f"{name}: block.type {scene.block.type!r} is one deformable body without contacts; "
        f"`tubelock {command}` needs an assembly, such as tsb1-pipe"
    )


def build_assembly(scene: AssemblyScene) -> Assembly:
    """Build the blocks of a scene."""
    assembly = scene.build()
    check_block_size(scene, assembly)
    return assembly


def body_forces(
    scene: DeformableScene, assembly: AnyBlocks, acceleration: Vector | None
) -> FloatArray:
    """Mass times an acceleration [mm/s²] of every block, (n_blocks, 6) [N, N mm]; None: zero."""
    wrenches = np.zeros((assembly.n_blocks, 6))
    if acceleration is not None:
        wrenches[:, :3] = np.outer(densities(scene, assembly) * assembly.volumes, acceleration)
    return wrenches


def build_weight(scene: DeformableScene, assembly: AnyBlocks) -> FloatArray | None:
    """Weight of rigid blocks under ``effects.gravity``, about their mass centroids.

    Deformable blocks carry theirs node by node (`fem.assembly.deformable`).

    Returns
    -------
    FloatArray | None
        (n_blocks, 6) [N, N mm]; None where the scene names no gravity.
    """
    gravity = scene.effects.gravity
    return None if gravity is None else body_forces(scene, assembly, gravity)


def build_blocks(scene: AssemblyScene) -> LoadCase:
    """Build the load of a scene on its blocks."""
    assembly = build_assembly(scene)
    return stated_load(scene, assembly, scene.build_load(assembly))
