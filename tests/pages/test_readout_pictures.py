"""Pictures of principal directions and von Mises stresses, which scenes ask for."""

import numpy as np
import pytest

from tests.support.answers import on_its_mesh
from validation import load_case
from validation.output.pictures.directions import arrow_parts, crosses
from validation.output.pictures.tubes import MISES, stress_scale, stresses_of

pytestmark = pytest.mark.quick
#: Points of an arrow: four rings of ten.
POINTS = 40


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


def test_arrows_are_along_the_pull_and_of_its_size() -> None:
    run = bar(0.3)
    found = crosses(run.details, None)
    assert found.values[:, 2] == pytest.approx(0.3, rel=1e-9)
    assert np.abs(found.values[:, :2]).max() < 1e-9
    assert np.abs(found.directions[:, 2, 0]) == pytest.approx(1.0, rel=1e-9)
    away = found.points[:, None] - found.points
    apart = np.linalg.norm(away, axis=2) + 1e9 * np.eye(len(away))
    assert apart.min() >= found.spacing * (1 - 1e-9)
    tension, compression = arrow_parts(found)
    assert len(compression.points) == 0
    assert len(arrow_parts(crosses(bar(-0.3).details, None))[0].points) == 0
    # Two arrows each, but none on the ends of the bar, where the pull points out of the surface.
    along = np.abs(found.normals[:, 0]) < 0.5
    assert len(tension.points) == 2 * POINTS * along.sum()


def test_von_mises_is_drawn_where_it_is_asked_for() -> None:
    run = bar(-0.3, mises=True)
    assert stresses_of(run)[-1] is MISES
    assert MISES not in stresses_of(bar(-0.3))
    scale = stress_scale(run.details, MISES)
    assert scale.reached[1] == pytest.approx(0.3, rel=1e-9)
    assert (scale.low, scale.diverging) == (0.0, False)
    assert run[MISES.measure].value == pytest.approx(0.3, rel=1e-9)
