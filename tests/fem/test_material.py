from __future__ import annotations

import numpy as np
import pytest

from fem import Material
from fem.element.material import VOIGT

pytestmark = pytest.mark.quick


@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.2, 0.4999])
def test_elasticity_matrix_is_hookes_law(nu: float) -> None:
    """Inverting sigma = D eps gives eps = ((1 + nu) sigma - nu tr(sigma) I) / E."""
    material = Material(density=2.4e-9, young_modulus=30_000.0, poisson_ratio=nu)
    rng = np.random.default_rng(0)
    a = rng.normal(size=(3, 3))
    sigma = a + a.T
    eps = ((1.0 + nu) * sigma - nu * np.trace(sigma) * np.eye(3)) / 30_000.0
    engineering = np.array([eps[i, j] * (1.0 if i == j else 2.0) for i, j in VOIGT])
    expected = np.array([sigma[i, j] for i, j in VOIGT])
    # Near incompressibility the pressure is lambda / E = 1 / (3 (1 - 2 nu)) round-offs off.
    tolerance = 1e-14 * material.constrained_modulus / material.shear_modulus
    assert material.elasticity_matrix() @ engineering == pytest.approx(expected, rel=tolerance * 10)


def test_moduli_and_wave_speeds_agree() -> None:
    m = Material(density=2.4e-9, young_modulus=30_000.0, poisson_ratio=0.2)
    assert m.bulk_modulus == pytest.approx(m.lame_modulus + 2.0 / 3.0 * m.shear_modulus, rel=1e-15)
    # c_d² / c_s² = 2 (1 - nu) / (1 - 2 nu), Achenbach (1973), eq. 4.6.
    ratio = m.dilatational_wave_speed**2 / (m.shear_modulus / m.density)
    assert ratio == pytest.approx(2.0 * 0.8 / 0.6, rel=1e-14)
    assert m.dilatational_wave_speed == pytest.approx(3.7268e6, rel=1e-4)
