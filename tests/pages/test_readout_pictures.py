"""Pictures of principal directions and von Mises stresses, which scenes ask for."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.answers import on_its_mesh
from validation import load_case
from validation.output.pictures.canvas import rgb
from validation.output.pictures.directions import arrow_parts, crosses, draw_directions
from validation.output.pictures.scales import BLUE, VERMILION
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
    # Two arrows each, but none on the ends of the bar, where the pull points out of the surface.
    along = np.abs(found.normals[:, 0]) < 0.5
    assert len(tension.points) == 2 * POINTS * along.sum()


@pytest.mark.parametrize(
    ("traction", "shown", "absent"), [(0.3, VERMILION, BLUE), (-0.3, BLUE, VERMILION)]
)
def test_tension_and_compression_differ_in_colour_and_shape(
    traction, shown, absent, tmp_path: Path
) -> None:
    run = bar(traction)
    path = tmp_path / "arrows.png"
    draw_directions(run, path)
    pixels = np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3)[:-1]
    drawn = pixels[: int(0.85 * len(pixels))]  # without the legend
    assert (drawn == rgb(shown)).all(axis=1).sum() > 500
    assert not (drawn == rgb(absent)).all(axis=1).any()
    # Heads of arrows, the widest part, lie outside for tension and inside for compression.
    part = arrow_parts(crosses(run.details, None))[0 if traction > 0.0 else 1]
    arrows = part.points.reshape(-1, POINTS, 3)
    starts, tips = arrows[:, 0], arrows[:, -1]
    half = len(starts) // 2
    middle = 0.5 * (starts[:half] + starts[half:])
    outward = np.linalg.norm(tips[:half] - middle, axis=1) > np.linalg.norm(
        starts[:half] - middle, axis=1
    )
    assert (outward == (traction > 0.0)).all()


def test_von_mises_is_drawn_where_it_is_asked_for() -> None:
    run = bar(-0.3, mises=True)
    assert stresses_of(run)[-1] is MISES
    assert MISES not in stresses_of(bar(-0.3))
    scale = stress_scale(run.details, MISES)
    assert scale.reached[1] == pytest.approx(0.3, rel=1e-9)
    assert (scale.low, scale.diverging) == (0.0, False)
    assert run[MISES.measure].value == pytest.approx(0.3, rel=1e-9)


def test_rigid_answers_ignore_pictures_of_stresses_by_name(tubelock, tmp_path) -> None:
    keys = ("--set", "pictures.arrows=true", "--set", "pictures.mises=true")
    small = ("--set", "assembly.layers=1", "--set", "mesh.around=12", "--set", "mesh.radial=1")
    status, out, _ = tubelock("mbd", "tsb1-pipe", *keys, *small, "-o", str(tmp_path / "out"))
    assert status == 0
    ignored = next(line for line in out.splitlines() if line.startswith("ignored"))
    assert "[pictures]" in ignored or {"pictures.arrows", "pictures.mises"} <= set(
        ignored.replace(",", " ").split()
    )
