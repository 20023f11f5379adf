"""Effects together: laws that hold for every combination, in static and in explicit runs."""

from __future__ import annotations

import numpy as np
import pytest

from validation.scene import DeformableScene, load_scene
from validation.tube_explicit import run_tube_explicit
from validation.tube_static import run_tube_static

COARSE = ("assembly.layers=1", "mesh.around=12", "mesh.radial=2", "mesh.axial=4")


def scene_of(*settings: str, case: str = "tsb1-pipe") -> DeformableScene:
    scene = load_scene(case, [*COARSE, *settings]).scene
    assert isinstance(scene, DeformableScene)
    return scene


@pytest.mark.parametrize("method", ["static", "explicit"])
@pytest.mark.parametrize(
    "setting",
    [
        "effects.friction.coefficient=0.3",
        "effects.gravity=[0.0, 0.0, -9810.0]",
        "effects.elastic_frame=true",
        "effects.finite_rotation=true",
    ],
)
def test_a_sector_gives_the_energies_of_the_whole(setting: str, method: str) -> None:
    # Four sectors are equal to the round-off of a run, 1e3 steps of 1e-16 times the ratio of the
    # highest to the lowest frequency (1e3); energies are of the whole tube whatever is computed.
    found = []
    for symmetry in ("sector", "none"):
        scene = scene_of(f'fem.method="{method}"', f'fem.symmetry="{symmetry}"', setting)
        if method == "static":
            found.append(run_tube_static("tube", scene).solver["energies"])
            continue
        run, result = run_tube_explicit("tube", scene)
        found.append(run.solver["energies"])
        last = result.history.column("strain_energy")[-1]
        assert last == pytest.approx(run.solver["energies"]["strain_energy"], rel=1e-14)
    sector, whole = found
    for name in ("strain_energy", "contact_energy", "external_work", "frictional_dissipation"):
        assert sector[name] == pytest.approx(whole[name], rel=1e-7, abs=0.0)
    assert np.isfinite(list(sector.values())).all()
