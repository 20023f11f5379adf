"""A tube with sliding contact."""

from __future__ import annotations

from fem import Material
from geometry.loads import named_load
from tests.support.coarse_tubes import ring
from tests.support.fem_problems import deformable_assembly

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)


def tube(**options):
    found = ring(1, (12, 2, 4))
    return deformable_assembly(found, named_load("pipe", 0.01).on(found), CONCRETE, **options)
