from __future__ import annotations

import numpy as np
import pytest

from fem import ElementType, Material
from fem.element.kinds import block_lumped_mass, block_stiffness
from fem.system.time_step import (
    characteristic_length,
    characteristic_time_step,
    damped_factor,
)
from geometry.block import box_block
from tests.support.fem_problems import CONCRETE

pytestmark = pytest.mark.quick


def exact_time_step(mesh, material, element) -> float:
    root = 1.0 / np.sqrt(np.repeat(block_lumped_mass(mesh, material.density), 3))
    stiffness = block_stiffness(mesh, material, element).toarray()
    return 2.0 / np.sqrt(np.linalg.eigvalsh(stiffness * root * root[:, None])[-1])


def test_uniform_strain_cube_has_its_closed_form() -> None:
    """Dilatation of a free cube: omega² = 12 K / (rho a²); its shear modes: 8 mu / (rho a²)."""
    size = 7.0
    mesh = box_block((size,) * 3, (1, 1, 1)).mesh
    for nu in (0.0, 0.2, 0.4):
        material = Material(density=2.4e-9, young_modulus=30_000.0, poisson_ratio=nu)
        highest = max(12.0 * material.bulk_modulus, 8.0 * material.shear_modulus)
        exact = 2.0 / np.sqrt(highest / material.density / size**2)
        assert exact_time_step(mesh, material, ElementType.REDUCED) == pytest.approx(
            exact, rel=1e-12
        )


def test_length_over_speed_is_no_bound() -> None:
    """For a cube of nu = 0.2, L/c exceeds the true step by sqrt(6)/2: 22 % unsafe."""
    mesh = box_block((5.0,) * 3, (1, 1, 1)).mesh
    quoted = characteristic_time_step(mesh, CONCRETE)
    true = exact_time_step(mesh, CONCRETE, ElementType.REDUCED)
    assert quoted / true == pytest.approx(np.sqrt(6.0) / 2.0, rel=1e-12)
    with_viscosity = characteristic_time_step(mesh, CONCRETE, linear_bulk_viscosity=0.06)
    assert with_viscosity / quoted == pytest.approx(np.sqrt(1.0036) - 0.06, rel=1e-14)
    assert damped_factor(0.0) == 1.0


def test_characteristic_length_of_a_skewed_brick_is_its_smallest_height() -> None:
    """Shear keeps volume and base area, so the height of the flat direction stays."""
    mesh = box_block((4.0, 3.0, 0.5), (1, 1, 1)).mesh
    skew = np.array([[1.0, 0.0, 0.7], [0.0, 1.0, -0.3], [0.0, 0.0, 1.0]])
    length = characteristic_length((mesh.nodes @ skew.T)[mesh.elements])
    assert length == pytest.approx([0.5], rel=1e-13)
