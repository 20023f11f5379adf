"""What a table says beside its numbers: loads, normals, distances, and what numbers lack."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.support.answers import on_its_mesh
from tests.support.coarse_tubes import coarse
from tests.support.commands import command, set_words
from validation import load_case

pytestmark = pytest.mark.quick

COARSE = coarse(1, 4)
ONE_MESH = ("fem.mesh=scene", "fem.error_estimate=false")


def printed(word: str, scene: str, *settings: str) -> str:
    sets = set_words(settings)
    status, out, err = command(word, scene, *sets, "--json", "a.json")
    assert status == 0, err
    return out


@pytest.mark.usefixtures("tubelock")
@pytest.mark.parametrize(
    ("word", "scene", "settings", "load"),
    [
        ("mbd", "tsb1-pipe", (*COARSE, "load.pressure=0.02"), "internal pressure 0.02 MPa"),
        ("fem", "tsb1-pipe", (*COARSE, *ONE_MESH), "internal pressure 0.01 MPa"),
        ("compare", "tsb1-pipe", (*COARSE, *ONE_MESH), "internal pressure 0.01 MPa"),
        (
            "mbd",
            "wall",
            ("loads=[{blocks = [8], force = [0.0, 0.0, -200.0]}]",),
            "force (0, 0, -200) N on block 8",
        ),
    ],
)
def test_the_first_line_names_the_load_with_its_value(word, scene, settings, load) -> None:
    assert load in printed(word, scene, *settings).splitlines()[0]


@pytest.mark.usefixtures("tubelock")
@pytest.mark.parametrize("scene", ["cubes", "octahedra"])
def test_an_assembly_without_a_load_has_a_class_and_no_rows_of_zeros(scene) -> None:
    out = printed("mbd", scene)
    assert "locked" in out
    assert "no load" in out.splitlines()[0]
    assert "pressure" not in out
    assert json.loads(Path("a.json").read_text("utf-8"))["measures"] == {}


@pytest.mark.usefixtures("tubelock")
def test_normals_that_measure_gaps_are_named() -> None:
    assert "normals" in printed("fem", "tsb1-tunnel", *COARSE, *ONE_MESH)


@pytest.mark.parametrize(("amplitude", "degrees"), [(40.0, None), (90.0, 82)])
def test_waves_that_are_almost_upright_are_named(tubelock, amplitude, degrees) -> None:
    """The slope by the mesh itself: of the block's upper face at the outer radius, where it is
    largest, and by hand atan(2f n a / r_o) = atan(3 · 4 · 90 / 160) = 81.6°."""
    sets = [f"block.amplitude={amplitude}", "assembly.layers=1", "mesh.around=96"]
    sets += ["mesh.radial=1", "mesh.axial=1"]
    words = set_words(sets)
    status, out, _ = tubelock("export", "tsb1-pipe", *words, "-o", "a.inp")
    assert status == 0
    assert ("as steep as" in out) is (degrees is not None)
    assert degrees is None or f"as steep as {degrees}°" in out
    scene = load_case("tsb1-pipe", sets).scene
    shape, block = scene.stated.block, scene.build().shapes[0]
    quads = block.mesh.nodes[block.faces["top"]]
    outer = np.hypot(quads[..., 0], quads[..., 1]) > shape.outer_radius - 1e-6
    pair = quads[outer].reshape(-1, 2, 3)
    rise = np.abs(np.diff(pair[..., 2], axis=1)).ravel()
    run = np.linalg.norm(np.diff(pair[..., :2], axis=1), axis=2).ravel()
    # 32 elements a wave: a chord beside the zero is at most (π/32)²/6 flatter.
    assert (rise / run).max() == pytest.approx(shape.steepest_slope, rel=(np.pi / 32) ** 2)


@pytest.mark.parametrize(
    ("kind", "ratio", "named"),
    [
        ("fem.element=incompatible", 0.4999, True),
        ("fem.degree=2", 0.4999, True),
        ("fem.element=b-bar", 0.4999, False),
        ("fem.element=incompatible", 0.3, False),
    ],
)
def test_oscillating_mean_stresses_are_named(kind, ratio, named) -> None:
    """Of a nearly incompressible cantilever; not where every element has one mean stress."""
    settings = ["fem.method=static", "mesh.divisions=[6,1,1]", f"material.poisson_ratio={ratio}"]
    answer = on_its_mesh("cantilever", [*settings, kind], method="static")
    assert ("nearly incompressible" in answer.report.get("notes", {})) is named
