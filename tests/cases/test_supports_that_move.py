"""Blocks that supports carry and blocks that are pushed: where they arrive and how they move."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fem import ExponentialLaw, LinearPenalty
from tests.support.commands import set_words
from tests.support.drawn_blocks import cuboid, write_obj

pytestmark = pytest.mark.quick

ONE_MESH = "[fem]\nmesh = 'scene'\nerror_estimate = false\n"
#: Two cubes of 20 mm in a column: the lower one stands on its bottom face.
COLUMN = """
supports = [{{face = "z+", blocks = [1], {words}}}]
[block]
type = "boxes"
boxes = [
    {{size = [20, 20, 20], divisions = [2, 2, 2]}}, {{size = [20, 20, 20], divisions = [2, 2, 2]}}
]
[material]
density = 2.4e-9
young_modulus = 33000.0
poisson_ratio = 0.0
[contact]
{law}
"""


@pytest.fixture(name="run")
def _run(tubelock):
    """Run ``tubelock fem`` on a scene: exit status, all that is printed, and the JSON."""

    def run(text, *settings):
        Path("scene.toml").write_text(text, "utf-8")
        sets = set_words(settings)
        status, out, err = tubelock("fem", "scene.toml", *sets, "--json", "a.json")
        written = Path("a.json")
        return status, out + err, json.loads(written.read_text()) if written.exists() else {}

    return run


@pytest.mark.parametrize(("law", "sliding"), [("linear", "true"), ("exponential", "false")])
def test_a_support_that_moves_along_one_axis_arrives(run, sliding, law):
    """Its block is free across: half of both cubes and the joint are springs in series."""
    stated = 'law = "linear"\nstiffness = 10.0\n' if law == "linear" else ""
    text = COLUMN.format(words='hold = ["z"], move = [0.0, 0.0, -0.02]', law=stated) + ONE_MESH
    status, printed, answer = run(text, f"effects.finite_sliding={sliding}")
    assert status == 0, printed
    assert answer["reached"] is True
    assert answer["measures"]["max_displacement"]["value"] == pytest.approx(0.02, rel=1e-6)
    pressure = answer["measures"]["p_max_point"]["value"]
    joint = ExponentialLaw() if law == "exponential" else LinearPenalty(10.0)
    # p h (1/E + 1/E) + overclosure(p) = way: bars without Poisson's effect are exact.
    way = pressure * 40.0 / 33_000.0 + float(joint.overclosure(pressure))
    assert way == pytest.approx(0.02, rel=1e-6)


def test_a_state_that_is_not_reached_is_status_3(run):
    """The run ends in the middle of the motion."""
    text = COLUMN.format(words="move = [0.0, 0.0, -0.02]", law='law = "linear"\nstiffness = 10.0')
    settings = ("fem.method=explicit", "fem.end_time=1e-4", "fem.ramp_time=2e-4")
    status, printed, answer = run(text, *settings)
    assert status == 3, printed
    assert answer["reached"] is False
    assert "supports that move" in printed


#: A block that its support moves along, by a fifth of its size, on another one.
CARRIED = """
supports = [{face = "z+", blocks = [1], move = [10.0, 0.0, 0.0]}]
[block]
type = "boxes"
boxes = [
    {size = [100, 100, 20], divisions = [4, 4, 1]},
    {size = [50, 50, 50], divisions = [2, 2, 2]},
]
[contact]
clearance = -0.001
"""


@pytest.mark.parametrize("sliding", [False, True])
def test_a_translation_asks_for_no_finite_rotation(run, sliding):
    """It asks for finite sliding where that is off."""
    setting = f"effects.finite_sliding={str(sliding).lower()}"
    status, printed, answer = run(CARRIED + ONE_MESH, setting)
    assert status == 0, printed
    assert "finite_rotation" not in printed
    assert ("large_motion" in answer) is not sliding


#: A cube of 50 mm pressed by N = 100 N onto a plate and pushed by a force F at a height.
PUSHED = """
loads = [{{blocks = [1], force = [{force}, 0.0, 0.0], point = [0.0, 0.0, {height}]}}]
[block]
type = "boxes"
boxes = [
    {{size = [50, 50, 10], divisions = [2, 2, 1]}}, {{size = [50, 50, 50], divisions = [2, 2, 2]}}
]
[load]
pressure = 0.04
[effects.friction]
coefficient = 0.3
"""


@pytest.mark.parametrize(
    ("force", "above", "slides", "tips"),
    [(40.0, 25.0, True, False), (28.0, 100.0, False, True), (70.0, 50.0, True, True)],
)
def test_a_block_slides_beyond_its_friction_and_tips_beyond_its_moment(
    run, force, above, slides, tips
):
    assert slides is (force > 0.3 * 100.0)
    assert tips is (force * above > 100.0 * 25.0)
    status, printed, _ = run(PUSHED.format(force=force, height=10.0 + above))
    assert status == 2
    assert ("slides" in printed, "tips" in printed) == (slides, tips)


@pytest.mark.parametrize("word", ["mbd", "fem"])
def test_own_blocks_that_supports_alone_hold_have_an_answer(tubelock, word):
    write_obj(
        Path("cubes.obj"),
        {"low": cuboid((0, 0, 0), (9, 9, 9)), "top": cuboid((0, 0, 9), (9, 9, 18))},
    )
    Path("scene.toml").write_text(
        'supports = [{name = "ground", plane = {z = 0.0}}]\nparts = [{file = "cubes.obj"}]\n'
        '[block]\ntype = "mesh"\n[effects]\ngravity = [0.0, 0.0, -9810.0]\n'
        f"[mesh]\ndivisions = 2\n{ONE_MESH}"
    )
    status, out, err = tubelock(word, "scene.toml", "--json", "a.json")
    assert status == 0, out + err


#: A cube that moves by 1 mm through a gap, then presses both cubes by 0.01 mm.
CLOSING = COLUMN.format(
    words='hold = ["x", "y", "z"], move = [0.0, 0.0, -1.01]',
    law='law = "linear"\nstiffness = 1.0e6\nclearance = 1.0',
)


@pytest.mark.parametrize("steps", [1, 2, 20])
def test_a_support_that_closes_a_gap_does_the_work_that_is_stored(run, steps):
    """½ F w of two bars and the joint in series over the way after the gap, whatever the steps: an
    error of 1e-8 in forces is one of 1e-8 in energies, a hundred times more after a way of 1 mm."""
    status, printed, answer = run(CLOSING + ONE_MESH, f"fem.motion_steps={steps}")
    assert status == 0, printed
    area, way = 20.0**2, 0.01
    stiffness = 1.0 / (40.0 / 33_000.0 + 1e-6)
    work = 0.5 * stiffness * area * way**2
    assert answer["measures"]["push_work"]["value"] == pytest.approx(work, rel=1e-4)
    stored = answer["energies"]["strain_energy"] + answer["energies"]["contact_energy"]
    assert stored == pytest.approx(work, rel=1e-4)
    assert answer["energies"]["external_work"] == pytest.approx(stored, rel=1e-12)


def test_the_push_of_a_sector_is_that_of_the_whole(run):
    """Four quarters of a tube whose outer face moves: force and work, to rounding of both runs."""
    text = """
supports = [{face = "outer", blocks = [4, 5, 6, 7], move = [0.0, 0.0, -0.002]}]
[block]
type = "sine"
height = 200.0
amplitude = 20.0
frequency = 1.5
blocks_per_layer = 4
inner_radius = 120.0
thickness = 40.0
[assembly]
layers = 1
[mesh]
around = 12
radial = 1
axial = 2
[load]
case = "pipe"
pressure = 0.001
"""
    settings = ("fem.method=explicit", "fem.end_time=2e-4", "fem.ramp_time=1e-4")
    answers = []
    for symmetry in ("none", "auto"):
        status, printed, answer = run(text, *settings, f"fem.symmetry={symmetry}")
        assert status == 0, printed
        answers.append({n: m["value"] for n, m in answer["measures"].items() if "push" in n})
    assert set(answers[0]) == {"push_peak", "push_work"}
    assert answers[1] == pytest.approx(answers[0], rel=1e-9)
