"""One body in a uniform state of stress: every measure is known in closed form."""

import numpy as np
import pytest

from fem import solve_static
from tests.support.answers import PLAIN
from validation import load_case

pytestmark = pytest.mark.quick

STRESS, MODULUS = 0.1, 33_000.0


def bar(sign: float, degree: int):
    """Bar without lateral contraction, clamped at one end and pulled or pushed at the other."""
    traction = {"x+": {"traction": [sign * STRESS, 0.0, 0.0]}}
    settings = {
        "fem.method": "static",
        "fem.degree": degree,
        "material.poisson_ratio": 0.0,
        "mesh.divisions": [2, 1, 1],
        "load": traction,
    }
    return solve_static(load_case("cantilever", settings).problem, PLAIN)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_measures_of_uniaxial_stress(sign: float, degree: int) -> None:
    """σ = ± p along x alone: Mises is p, u is p L / E, the work of the load is twice the energy."""
    answer = bar(sign, degree)
    largest, least = max(sign, 0.0) * STRESS, min(sign, 0.0) * STRESS
    near = pytest.approx
    assert answer["sigma_1_max"].value == near(largest, abs=1e-9 * STRESS)
    assert answer["sigma_3_min"].value == near(least, abs=1e-9 * STRESS)
    assert answer["mises_max"].value == near(STRESS, rel=1e-9)
    assert answer["max_displacement"].value == near(STRESS * 400.0 / MODULUS, rel=1e-9)
    nodal = answer.report["principal_stress"]
    assert nodal == {
        "max": near(largest, abs=1e-9 * STRESS),
        "min": near(least, abs=1e-9 * STRESS),
    }
    np.testing.assert_allclose(answer.fields["mises"], STRESS, rtol=1e-9)
    assert answer.report["energies"]["strain_energy"] == near(
        0.5 * STRESS**2 / MODULUS * 400.0 * 40.0 * 60.0, rel=1e-9
    )
    assert answer.report["energy_balance"] < 1e-9
    assert answer.report["n_elements"] == 2 * 1 * 1
