"""Box scenes: one deformable box, or uncoupled copies of it, as a model for the solvers."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from fem.element.material import Material, MaterialError
from fem.problem.loads import SmoothStepAmplitude, pressure_forces, traction_forces
from fem.problem.mass_scaling import scale_masses
from fem.problem.model import (
    BlockGroup,
    Model,
    ModelError,
    NodalLoad,
    Support,
    block_group,
    fixed_nodes,
    nodal_load,
)
from geometry.block import Block, box_block
from geometry.mesh import FloatArray, MeshError
from validation.build.effects import build_effects
from validation.errors import InputError
from validation.scene.deformable import BoxScene, MaterialSection, Method


@dataclass(frozen=True)
class BoxModel:
    """A box scene made ready for the solvers."""

    block: Block
    """The box with its named faces."""
    model: Model
    """One group of copies, supports, loads, effects."""
    velocities: tuple[FloatArray, ...] | None
    """Initial velocities, (n_copies, n_nodes, 3) [mm/s]; None: at rest."""
    ramp_time: float
    """Duration of the smooth step of the loads [s]; 0: at once."""
    cpu_seconds: float
    """CPU time of building it [s]."""


def build_material(section: MaterialSection) -> Material:
    """Material of a scene.

    Raises
    ------
    InputError
        For constants no elastic material has.
    """
    try:
        return Material(section.density, section.young_modulus, section.poisson_ratio)
    except MaterialError as error:
        raise InputError(str(error)) from None


def ramp_time(scene: BoxScene) -> float:
    """Duration of the smooth step: half of the run unless the scene says otherwise [s]."""
    fem = scene.fem
    if fem.ramp_time is not None:
        return fem.ramp_time
    return 0.0 if fem.end_time is None else 0.5 * fem.end_time


def copy_placements(scene: BoxScene) -> FloatArray:
    """Copies side by side along y, half a box apart, (n_copies, 3) [mm]."""
    offsets = np.zeros((scene.assembly.copies, 3))
    offsets[:, 1] = 1.5 * scene.block.size[1] * np.arange(scene.assembly.copies)
    return offsets


def _loads(scene: BoxScene, block: Block, copies: range) -> list[NodalLoad]:
    duration = ramp_time(scene)
    amplitude = SmoothStepAmplitude(duration) if duration > 0 else None
    loads = []
    for face, load in scene.load.items():
        quads, nodes = block.faces[face], block.mesh.nodes
        if load.pressure is not None:
            forces = pressure_forces(nodes, quads, load.pressure)
        else:
            forces = traction_forces(nodes, quads, np.array(load.traction))
        follows = load.pressure is not None and scene.effects.finite_rotation
        loads.append(
            nodal_load(0, forces, copies=copies, amplitude=amplitude, follows_block=follows)
        )
    return loads


def _supports(scene: BoxScene, block: Block, copies: range) -> list[Support]:
    faces = [block.faces[face] for face in scene.support]
    if not faces:
        return []
    return [fixed_nodes(0, np.unique(np.concatenate(faces)), copies=copies)]


def _velocities(scene: BoxScene, group: BlockGroup) -> tuple[FloatArray, ...] | None:
    if scene.initial is None:
        return None
    positions = group.reference_positions()
    arm = positions - positions.mean(axis=1, keepdims=True)
    spin = np.cross(np.array(scene.initial.angular_velocity), arm)
    return (np.array(scene.initial.velocity) + spin,)


def build_box(scene: BoxScene) -> BoxModel:
    """Build the model of a box scene.

    Raises
    ------
    InputError
        When it describes nothing that can be solved.
    """
    start = time.process_time()
    if scene.fem.method is Method.STATIC and scene.effects.finite_rotation:
        raise InputError(
            'effects.finite_rotation: got fem.method = "static", which is linear for one body; '
            'expected fem.method = "explicit", or finite_rotation off'
        )
    try:
        block = box_block(scene.block.size, scene.mesh.divisions)
        group = block_group(
            block.mesh,
            build_material(scene.material),
            element=scene.fem.element,
            translations=copy_placements(scene),
            name="box",
        )
    except MeshError as error:
        raise InputError(str(error)) from None
    copies = range(scene.assembly.copies)
    try:
        model = Model(
            groups=(group,),
            supports=tuple(_supports(scene, block, copies)),
            loads=tuple(_loads(scene, block, copies)),
            effects=build_effects(scene.effects, scene.fem),
            formulation=scene.fem.formulation,
        )
        if scene.fem.mass_scaling is not None:
            model = scale_masses(model, scene.fem.mass_scaling)
    except ModelError as error:
        raise InputError(str(error)) from None
    seconds = time.process_time() - start
    return BoxModel(block, model, _velocities(scene, group), ramp_time(scene), seconds)
