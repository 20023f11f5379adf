"""A pipe under pressure and a sheared column."""

from __future__ import annotations

import numpy as np

from fem import (
    LinearPenalty,
    Material,
)
from geometry import Assembly
from geometry.block import Block, box_block
from geometry.loads import LoadCase, PressureLoad, TractionLoad, named_load
from geometry.mesh import HexMesh
from tests.support.coarse_tubes import ring
from tests.support.fem_problems import deformable_assembly

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)


def tube(layers=1, divisions=(12, 2, 4)):
    return ring(layers, divisions)


def pipe(layers=1, divisions=(12, 2, 4), case="pipe", **options):
    assembly = tube(layers, divisions)
    return deformable_assembly(assembly, named_load(case, 0.01).on(assembly), CONCRETE, **options)


def column(n_blocks=2, *, shear=0.0, divisions=(2, 2, 2), height=20.0):
    """Boxes of 10 × 10 mm on a fixed one; with ``shear`` the joints rise by shear · x."""
    size = (10.0, 10.0, height)
    box = box_block(size, divisions)
    nodes = box.mesh.nodes.copy()
    nodes[:, 2] += shear * nodes[:, 0]
    mesh = HexMesh(nodes, box.mesh.elements)
    shape = Block("box", mesh, box.faces, ("z-", "z+"))
    number = np.arange(n_blocks + 1)
    return Assembly(
        name="column",
        shapes=(shape,),
        shape_of=np.zeros(n_blocks + 1, dtype=np.int64),
        rotations=np.tile(np.eye(3), (n_blocks + 1, 1, 1)),
        translations=np.outer(number - 1.0, [0.0, 0.0, size[2]]),
        layer=number,
        fixed=number == 0,
        unmatched_allowed=True,
    )


def top_load(assembly, *, pressure=0.0, traction=None):
    """Load on the top face of the last block."""
    blocks = np.array([assembly.n_blocks - 1])
    face = PressureLoad(blocks, "z+", pressure)
    if traction is not None:
        face = TractionLoad(blocks, "z+", np.asarray(traction))
    return LoadCase(assembly, "top", (face,), assembly.fixed)


def sheared_column(ratio, friction, *, pressure=0.1, **options):
    """A flat block of 1 mm on a fixed one: pressed [MPa] and sheared by ``ratio`` times that."""
    assembly = column(1, height=1.0)
    load = top_load(assembly, traction=pressure * np.array([ratio, 0.0, -1.0]))
    stiff = Material(density=2.4e-9, young_modulus=1e7, poisson_ratio=0.0)
    return deformable_assembly(
        assembly, load, stiff, law=LinearPenalty(1e4), friction=friction, **options
    )
