"""Tiny problems that robustness cases share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fem.contact.law import ContactLaw, ExponentialLaw
from fem.contact.normals import ContactNormals
from fem.element.hexahedron import ElementType
from fem.element.material import Material
from fem.problem import Problem
from fem.system.rows import NOT_HELD, ForceRows, HeldRows, held_at
from fem.system.system import System
from geometry.assembly import Assembly
from geometry.block import Block
from geometry.families.boxes import BrickStack
from geometry.families.sine_block import TSB1, SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.loads import LoadCase, face_pressure
from geometry.mesh import FloatArray, IntArray

CONCRETE = Material(density=2.4e-9, young_modulus=30_000.0, poisson_ratio=0.2)
#: Without lateral contraction a pressed stack is one-dimensional: closed forms are exact.
COLUMN = Material(density=2.4e-9, young_modulus=30_000.0, poisson_ratio=0.0)
COARSE = SineBlockDivisions(24, 3, 6)
#: Brick of the stack [mm].
BRICK = (40.0, 40.0, 20.0)


def tsb1_tube(
    layers: int = 2, divisions: SineBlockDivisions = COARSE, **changes: float
) -> Assembly:
    """TSB1 with changed parameters, coarse."""
    return SineTube(replace(TSB1, **changes), divisions, layers).build()  # type: ignore[arg-type]


def stack(layers: int = 2, *, top_fixed: bool = False) -> Assembly:
    """Column of bricks on a fixed one; the row above is free unless ``top_fixed``."""
    built = BrickStack(BRICK, (2, 2, 2), layers=layers).build()
    if top_fixed:
        return built
    fixed = built.fixed.copy()
    fixed[-1] = False
    return replace(built, fixed=fixed)


def pressed(assembly: Assembly, pressure: float, *, face: str = "top") -> LoadCase:
    """Pressure on one face of the last block of a stack [MPa]; positive pushes inward."""
    return face_pressure(assembly, np.array([assembly.n_blocks - 1]), face, pressure)


def deformable(
    assembly: Assembly,
    load: LoadCase,
    *,
    material: Material | Sequence[Material] = COLUMN,
    element: ElementType = ElementType.INCOMPATIBLE,
    law: ContactLaw | None = None,
    clearance: float = 0.0,
) -> System:
    """Deformable blocks with reference normals, whose closed forms are exact."""
    return Problem(
        assembly,
        load,
        material,
        element=element,
        law=law or ExponentialLaw(),
        normals=ContactNormals.REFERENCE,
        clearance=clearance,
        check_units=False,
    ).system


def one_block(
    block: Block,
    material: Material = CONCRETE,
    *,
    element: ElementType = ElementType.INCOMPATIBLE,
    supports: HeldRows = NOT_HELD,
    forces: tuple[ForceRows, ...] = (),
) -> System:
    """A block that meets nothing, with supports and forces on its nodes."""
    none = np.zeros(1, dtype=np.int64)
    alone = Assembly(
        name=block.name,
        shapes=(block,),
        shape_of=none,
        rotations=np.eye(3)[None],
        translations=np.zeros((1, 3)),
        layer=none,
        fixed=np.zeros(1, dtype=np.bool_),
    )
    load = LoadCase(alone, "forces", (), alone.fixed)
    stated = deformable(alone, load, material=material, element=element)
    return replace(stated, supports=supports, forces=forces)


def held_nodes(nodes: IntArray, *components: int) -> HeldRows:
    """Hold nodes of `one_block` along some axes, by default all."""
    along = np.eye(3)[list(components) or [0, 1, 2]]
    return held_at(0, np.repeat(nodes, len(along)), np.tile(along, (len(nodes), 1)))


def relative_difference(value: FloatArray | float, expected: FloatArray | float) -> float:
    """Largest difference over the largest expected value."""
    size = float(np.abs(expected).max())
    difference = float(np.abs(np.asarray(value) - np.asarray(expected)).max())
    return difference / size if size > 0.0 else difference
