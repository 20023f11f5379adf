"""What a scene states is honoured, or rejected in one line: nothing is dropped."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fem import ExponentialLaw, LinearPenalty, solve_explicit, solve_static
from geometry import HeldFace, RefusedError, pipe
from tests.support.commands import command
from validation import load_case

pytestmark = pytest.mark.quick

#: Two cubes of 20 mm in a column: the lower one stands on its bottom face.
COLUMN = """
[block]
type = "boxes"
boxes = [{size = [20, 20, 20], divisions = [2, 2, 2]}, {size = [20, 20, 20], divisions = [2, 2, 2]}]
[material]
density = 2.4e-9
young_modulus = 33000.0
poisson_ratio = 0.0
[contact]
law = "linear"
stiffness = 10.0
"""
TUBE = """
[block]
type = "sine"
height = 200
amplitude = 20
frequency = 1
shift = 0
blocks_per_layer = 4
inner_radius = 150
thickness = 40
[assembly]
layers = 1
[mesh]
around = 12
radial = 1
axial = 4
"""
#: A cube of 100 mm on another, in one file.
CUBES = "".join(
    f"o {name}\n"
    + "".join(
        f"v {x} {y} {z}\n"
        for z in (low, low + 100)
        for x, y in ((0, 0), (100, 0), (100, 100), (0, 100))
    )
    + "".join(
        "f " + " ".join(str(8 * number + corner) for corner in face) + "\n"
        for face in (
            (1, 4, 3, 2),
            (5, 6, 7, 8),
            (1, 2, 6, 5),
            (2, 3, 7, 6),
            (3, 4, 8, 7),
            (4, 1, 5, 8),
        )
    )
    for number, (name, low) in enumerate((("low", 0), ("high", 100)))
)


@pytest.fixture(name="run")
def _run(tmp_path):
    """Run a command on a scene: exit status, all that is printed, and the file of the JSON."""

    def run(word, text, *settings):
        path, data = tmp_path / "scene.toml", tmp_path / "answer.json"
        path.write_text(text, "utf-8")
        data.unlink(missing_ok=True)
        words = [part for one in settings for part in ("--set", one)]
        status, printed, error = command(*word.split(), str(path), *words, "--json", str(data))
        return status, printed + error, data

    return run


def rejected(run, word, text, *settings):
    status, printed, _ = run(word, text, *settings)
    assert status == 2
    line = printed.strip()
    assert line.startswith("error: ")
    assert "\n" not in line
    return line


# ---------------------------------------------------------------------------------------------
# Loads


@pytest.mark.parametrize("word", ["mbd", "fem"])
def test_a_named_load_case_has_a_size(run, word):
    line = rejected(run, word, TUBE + "[load]\ncase = 'pipe'\n")
    assert "load.pressure is missing" in line


LOADS = {
    "a tube": ("tsb1-pipe", ("load.pressure=0.02",), "internal pressure 0.02 MPa"),
    "forces on blocks": (
        "wall",
        ("load.forces=[{block = 8, force = [0.0, 0.0, -200.0]}]",),
        "force (0, 0, -200) N on block 8",
    ),
    "none": ("cubes", (), "no load"),
}


@pytest.mark.parametrize(("scene", "settings", "words"), LOADS.values(), ids=LOADS)
def test_the_table_of_rigid_blocks_names_the_load_with_its_value(tmp_path, scene, settings, words):
    small = ("assembly.layers=1", "mesh.around=12", "mesh.radial=1", "mesh.axial=4")
    settings = [*settings, *(small if scene == "tsb1-pipe" else ())]
    sets = [part for one in settings for part in ("--set", one)]
    status, printed, _ = command("mbd", scene, *sets, "--json", str(tmp_path / "answer.json"))
    assert status == 0
    assert words in printed.splitlines()[0]


def test_tables_of_deformable_blocks_and_of_comparisons_name_the_load_with_its_value(run):
    coarse = TUBE + "[load]\ncase = 'pipe'\npressure = 0.02\n[fem]\nmesh = 'scene'\n"
    for word in ("fem", "compare"):
        status, printed, _ = run(word, coarse)
        assert status == 0
        assert "internal pressure 0.02 MPa" in printed.splitlines()[0]


def test_a_load_without_a_name_is_in_a_combination_or_rejects_it(run):
    loads = (
        'loads = [{face = "z+", blocks = [1], pressure = 1.0}, '
        '{name = "side", face = "z+", blocks = [1], pressure = 0.5}]\n'
    )
    line = rejected(run, "fem --combinations", f"{loads}{COLUMN}[combinations.a]\nside = 1.0\n")
    assert "combinations.a: loads[0] (pressure 1 MPa) has no name" in line


def test_a_combination_has_factors(run):
    line = rejected(run, "fem --combinations", f"{COLUMN}[combinations.a]\n")
    assert "combinations.a: got no factors" in line


@pytest.mark.parametrize("word", ["fem", "compare"])
def test_deformable_blocks_on_which_nothing_acts_are_rejected(run, word):
    assert "nothing acts" in rejected(run, word, COLUMN)
    assert "nothing acts" in rejected(run, word, COLUMN, "load.pressure=0.0")


def test_rigid_blocks_on_which_nothing_acts_have_a_class(run):
    status, printed, _ = run("mbd", COLUMN)
    assert status == 0
    assert "neutral: a mechanism exists" in printed


@pytest.mark.parametrize("solve", [solve_static, solve_explicit])
def test_a_problem_in_which_nothing_acts_is_rejected(solve):
    settings = {"assembly.layers": 1, "mesh.around": 12, "mesh.radial": 1, "mesh.axial": 4}
    problem = replace(load_case("tsb1-pipe", settings).problem, load=pipe(0.0))
    with pytest.raises(RefusedError, match="nothing acts"):
        solve(problem)


def test_a_shift_without_a_phase_is_rejected(run):
    load = "[load]\ncase = 'pipe'\npressure = 0.01\n"
    line = rejected(run, "mbd", TUBE.replace("shift = 0", "shift = 1e17") + load)
    assert "block.shift: got 1e+17" in line


# ---------------------------------------------------------------------------------------------
# Supports

MOVES = {
    "x, y along z": ('hold = ["x", "y"], move = [0.0, 0.0, -0.1]', "[0.0, 0.0, -0.1]"),
    "z along x and z": ('hold = ["z"], move = [0.5, 0.0, -0.1]', "[0.5, 0.0, 0.0]"),
    "normal along x": ('hold = "normal", move = [0.1, 0.0, 0.0]', "[0.1, 0.0, 0.0]"),
}


def supported(words):
    return f'supports = [{{face = "z+", blocks = [1], {words}}}]\n{COLUMN}'


@pytest.mark.parametrize(("words", "lost"), MOVES.values(), ids=MOVES)
def test_a_motion_across_what_is_held_is_rejected(run, words, lost):
    assert f"nothing moves it by {lost}" in rejected(run, "fem", supported(words))


def test_a_motion_across_what_is_held_is_rejected_in_python():
    with pytest.raises(RefusedError, match="nothing moves it"):
        HeldFace(0, "z+", directions=np.eye(3)[:2], displacement=np.array([0.0, 0.0, -0.1]))


def test_a_support_that_holds_nothing_is_rejected(run):
    assert "supports.hold: got []" in rejected(run, "fem", supported("hold = []"))


@pytest.mark.parametrize("law", ["linear", "exponential"])
@pytest.mark.parametrize("sliding", ["false", "true"], ids=["matched", "searched"])
def test_a_support_that_moves_along_one_axis_arrives(run, sliding, law):
    """Its block is free across: half of both cubes and the joint are springs in series."""
    text = supported('hold = ["z"], move = [0.0, 0.0, -0.02]')
    if law == "exponential":
        text = text.replace('law = "linear"\nstiffness = 10.0\n', "")
    status, printed, data = run(
        "fem",
        text,
        f"effects.finite_sliding={sliding}",
        "fem.mesh=scene",
        "fem.error_estimate=false",
    )
    assert status == 0, printed
    answer = json.loads(data.read_text("utf-8"))
    assert answer["reached"] is True
    assert answer["measures"]["max_displacement"]["value"] == pytest.approx(0.02, rel=1e-6)
    pressure = answer["measures"]["p_max_point"]["value"]
    joint = ExponentialLaw() if law == "exponential" else LinearPenalty(10.0)
    # p h (1/E + 1/E) + overclosure(p) = way: bars without Poisson's effect are exact.
    way = pressure * 40.0 / 33_000.0 + float(joint.overclosure(pressure))
    assert way == pytest.approx(0.02, rel=1e-6)


def test_a_state_that_is_not_reached_is_status_3(run):
    """The run ends in the middle of the motion."""
    text = supported("move = [0.0, 0.0, -0.02]")
    settings = ("fem.method=explicit", "fem.end_time=1e-4", "fem.ramp_time=2e-4")
    status, printed, data = run("fem", text, *settings, "fem.error_estimate=false")
    assert status == 3, printed
    assert '"reached": false' in data.read_text("utf-8")
    assert "supports that move" in printed


# ---------------------------------------------------------------------------------------------
# Tracebacks


@pytest.mark.parametrize("word", ["mbd", "fem"])
def test_own_blocks_that_supports_alone_hold_have_an_answer(run, tmp_path, word):
    (tmp_path / "cubes.obj").write_text(CUBES, "utf-8")
    text = (
        'supports = [{name = "ground", plane = {z = 0.0}}]\nparts = [{file = "cubes.obj"}]\n'
        '[block]\ntype = "mesh"\n[effects]\ngravity = [0.0, 0.0, -9810.0]\n'
        "[mesh]\ndivisions = 2\n[fem]\nmesh = 'scene'\nerror_estimate = false\n"
    )
    status, printed, _ = run(word, text)
    assert status == 0, printed


def test_lists_in_lists_are_one_line(run):
    deep = 2000 * "[" + 2000 * "]"
    rejected(run, "mbd", COLUMN, f"load.pressure={deep}")
