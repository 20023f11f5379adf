"""Best and worst design of a rigid study, solved with deformable blocks."""

from __future__ import annotations

import pytest

from tests.support.coarse_tubes import keys
from tests.support.commands import command
from validation import load_case, solve, sweep

pytestmark = pytest.mark.quick

SETTINGS = {
    **keys(1, 2),
    "fem.mesh": "scene",
    "fem.error_estimate": False,
}
STUDY = """
scene = "tsb1-tunnel"
[parameters]
"load.pressure" = {pressures}
[settings]
"assembly.layers" = 1
"mesh.around" = 12
"mesh.radial" = 1
"mesh.axial" = 2
"fem.mesh" = "scene"
"fem.error_estimate" = false
"""


@pytest.mark.parametrize("largest", [0.014, 0.015])
def test_a_study_says_when_its_designs_differ_by_less_than_rigid_blocks_tell(largest) -> None:
    """Pressures are proportional to the load: the factor of designs is that of loads."""
    study = sweep("tsb1-tunnel", {"load.pressure": [0.01, 0.012, largest]}, SETTINGS)
    assert ("--judge" in str(study)) is (largest < 0.0145)


@pytest.mark.slow
def test_the_judge_prints_the_answers_of_deformable_blocks(tmp_path) -> None:
    file = tmp_path / "loads.toml"
    file.write_text(STUDY.format(pressures=[0.012, 0.01]), "utf-8")
    store = str(tmp_path / "rows.jsonl")
    status, printed, error = command("sweep", str(file), "-o", store, "--workers", "1", "--judge")
    assert status == 0, error
    for pressure in (0.012, 0.01):
        case = load_case("tsb1-tunnel", SETTINGS | {"load.pressure": pressure})
        assert f"{solve(case)['p_max'].value:.4g}" in printed
    assert "deformable blocks: the same order" in printed
    # The same door in Python, on the same rows.
    values = {"load.pressure": [0.012, 0.01]}
    study = sweep("tsb1-tunnel", values, SETTINGS, store=store, judge=True)
    assert [row["load.pressure"] for row in study.judged] == [0.01, 0.012]
    assert "deformable blocks: the same order" in repr(study)
    assert study.summary["this_run"]["computed"] == 0


def test_a_judge_needs_two_designs_of_rigid_blocks(tmp_path) -> None:
    file = tmp_path / "one.toml"
    file.write_text(STUDY.format(pressures=[0.01]), "utf-8")
    store = str(tmp_path / "rows.jsonl")
    status, _, error = command("sweep", str(file), "-o", store, "--workers", "1", "--judge")
    assert status == 2
    assert "expected two designs or more" in error
