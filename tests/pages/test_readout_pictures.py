"""Pictures of von Mises stresses, which scenes ask for."""

import pytest

from tests.support.answers import on_its_mesh
from validation import load_case
from validation.output.pictures.tubes import MISES, stress_scale, stresses_of

pytestmark = pytest.mark.quick


def bar(traction: float, *, mises: bool = False):
    """A bar without lateral strain, pulled along x."""
    settings = {
        "mesh.divisions": [8, 2, 2],
        "fem.method": "static",
        "material.poisson_ratio": 0.0,
        "pictures.mises": mises,
    }
    case = load_case("cantilever", settings)
    pull = {"x+": {"traction": [traction, 0.0, 0.0]}}
    return on_its_mesh(load_case(case.keys | {"load": pull}), method="static")


def test_von_mises_is_drawn_where_it_is_asked_for() -> None:
    run = bar(-0.3, mises=True)
    assert stresses_of(run)[-1] is MISES
    assert MISES not in stresses_of(bar(-0.3))
    scale = stress_scale(run.details, MISES)
    assert scale.reached[1] == pytest.approx(0.3, rel=1e-9)
    assert (scale.low, scale.diverging) == (0.0, False)
    assert run[MISES.measure].value == pytest.approx(0.3, rel=1e-9)
