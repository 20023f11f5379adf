"""Extremes of stresses at points, against the formulas of the six components."""

import numpy as np
import pytest

from fem.element.lagrange_stress import SampledStress

pytestmark = pytest.mark.quick


def test_largest_mises_is_that_of_the_six_components() -> None:
    """σ_v² = ½ Σ (σ_i − σ_j)² + 3 Σ τ², at the point where it is largest; 1e-13: round-off."""
    stress = np.random.default_rng(0).standard_normal((3, 4, 5, 6))
    xx, yy, zz, xy, yz, xz = np.moveaxis(stress, -1, 0)
    squares = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
    mises = np.sqrt(squares + 3.0 * (xy**2 + yz**2 + xz**2))
    positions = np.random.default_rng(1).standard_normal((4, 5, 3))
    body, element, point = np.unravel_index(mises.argmax(), mises.shape)

    largest = SampledStress(positions, np.ones((4, 5)), stress).largest_mises()

    assert largest.value == pytest.approx(mises.max(), rel=1e-13)
    assert largest.layer == body + 1
    np.testing.assert_array_equal(largest.position, positions[element, point])
