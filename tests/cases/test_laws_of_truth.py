"""Laws that did not hold once: files and tables agree, options are checked, studies are judged."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import pyvista

from fem import Explicit, Static
from geometry import RefusedError
from mbd import Rigid, analyse
from tests.support.commands import command
from validation import load_case, optimise, read_answer, sensitivity, write

#: One layer of the tube of the paper, coarse.
COARSE = {"assembly.layers": 1, "mesh.around": 12, "mesh.radial": 1, "mesh.axial": 4}


def sets(settings):
    return [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]


@pytest.fixture(name="tube", scope="module")
def _tube():
    return load_case("tsb1-pipe", COARSE).problem


@pytest.fixture(name="built", scope="module")
def _built(tube):
    return analyse(tube)


# ---------------------------------------------------------------------------------------------
# Files and tables say the same


@pytest.mark.usefixtures("undrawn")
def test_pressures_on_facets_that_are_written_have_the_largest_of_the_table(tmp_path):
    status, _, error = command("fem", "tsb1-pipe", *sets(COARSE), "--fields", "-o", str(tmp_path))
    assert status == 0, error
    facets = pyvista.read(tmp_path / "contact_pressures.vtu")
    largest = read_answer(tmp_path).measures["p_max_facet"].value
    assert facets.cell_data["contact_pressure"].max() == pytest.approx(largest, rel=1e-9)


def test_normals_that_measure_gaps_are_named(tmp_path):
    fem = {"fem.mesh": "scene", "fem.error_estimate": "false"}
    words = sets(COARSE | fem)
    status, printed, _ = command("fem", "tsb1-tunnel", *words, "--json", str(tmp_path / "a.json"))
    assert status == 0
    assert "normals" in printed


@pytest.mark.parametrize("flavour", ["calculix"])
def test_a_deck_that_is_read_and_written_is_read_again(tmp_path, flavour):
    """Export, read, write and read: the identity."""
    first, second = tmp_path / "first.inp", tmp_path / "second.inp"
    words = sets(COARSE)
    assert command("export", "tsb1-pipe", *words, "--flavour", flavour, "-o", str(first))[0] == 0
    assert command("deck", str(first), "--write", str(second))[0] == 0
    status, _, error = command("deck", str(second))
    assert status == 0, error


# ---------------------------------------------------------------------------------------------
# The same checks in Python as in scenes

WRONG = {
    "damping": lambda _: Explicit(damping="foo"),
    "symmetry of a run": lambda _: Explicit(symmetry="foo"),
    "ramp": lambda _: Explicit(ramp_time=-1.0),
    "mesh": lambda _: Static(mesh="foo"),
    "limit": lambda _: Static(accuracy={"u": 0.9}, max_seconds=-1.0),
    "norm": lambda _: Rigid(norm="foo"),
    "sliding": lambda p: replace(p, finite_sliding="no"),
    "degree": lambda p: replace(p, degree=True),
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
def test_a_wrong_option_is_rejected_when_it_is_made(tube, wrong):
    with pytest.raises(RefusedError, match=r"got .*; expected"):
        wrong(tube)


def test_numbers_of_numpy_are_numbers(tube):
    """Friction of single precision is that coefficient to its digits."""
    assert replace(tube, friction=np.float32(0.25)).coulomb == replace(tube, friction=0.25).coulomb
    assert Static(load_steps=np.int64(2)) == Static(load_steps=2)


@pytest.mark.parametrize("scene", ["wall", "tsb1-shaft"])
def test_settings_of_friction_replace_it_in_both_spellings(scene):
    """Whether the scene states it or not, and in which spelling."""
    names = ("effects.friction", "effects.friction.coefficient")
    for before in ((), *((f"{name}=0.4",) for name in names)):
        for name in names:
            case = load_case(scene, [*before, f"{name}=0.5"])
            assert case.scene.effects.friction.coefficient == 0.5
            assert case.changed({name: 0.7}).scene.effects.friction.coefficient == 0.7
    case = load_case(scene, ["effects.friction=0.4", "effects.friction.stick_stiffness=50.0"])
    assert case.scene.effects.friction.coefficient == 0.4


def test_a_problem_can_be_pickled(tube):
    assert pickle.loads(pickle.dumps(tube)).blocks.n_blocks == tube.blocks.n_blocks


def test_a_damaged_answer_is_one_refusal(tmp_path, built):
    write(built, tmp_path)
    (tmp_path / "answer.npz").write_bytes(b"PK\x03\x04damaged")
    with pytest.raises(RefusedError):
        read_answer(tmp_path)


# ---------------------------------------------------------------------------------------------
# Studies

STUDY = """
scene = "tsb1-pipe"
quantity = "rigid"
[parameters]
"block.amplitude" = [15.0, 20.0]
[settings]
"assembly.layers" = 1
"mesh.around" = 12
"mesh.radial" = 1
"mesh.axial" = {axial}
"""


def test_rows_of_another_study_are_rejected(tmp_path):
    one, other = tmp_path / "one.toml", tmp_path / "other.toml"
    one.write_text(STUDY.format(axial=2), "utf-8")
    other.write_text(STUDY.format(axial=4), "utf-8")
    rows = str(tmp_path / "one.jsonl")
    common = ("--workers", "1", "-o")
    first = command("sweep", str(one), *common, rows)
    assert first[0] == 0, first[2]
    second = command("sweep", str(other), *common, str(tmp_path / "o.jsonl"), "--rows", rows)
    assert second[0] == 2
    assert "has no row of other" in second[2]


SEARCH = {
    "scene": "tsb1-tunnel",
    "minimise": "p_max",
    "settings": COARSE,
    "evaluations": 3,
    "judge": {"settings": {"fem.mesh": "scene", "fem.error_estimate": False}},
    "variables": {"block.amplitude": [18.0, 20.0]},
}


@pytest.fixture(name="search", scope="module")
def _search():
    return optimise(SEARCH)


def test_a_search_names_the_variables_that_end_at_a_bound(search):
    best = search.best[0]["block.amplitude"]
    assert best in (18.0, 20.0)
    assert "at the bound" in str(search)


def test_a_search_of_rigid_blocks_ends_with_deformable_ones(search):
    assert search.judged


def test_a_derivative_says_what_its_error_covers():
    """The error is that of the difference quotient: deformable blocks may have another sign."""
    found = sensitivity("tsb1-tunnel", COARSE, parameters=["block.amplitude"])
    assert "deformable" in str(found)
