"""Answers of a stated accuracy: what is asked, how often error bars cover, what is refused."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

from tests.test_validation_cli import tubelock  # noqa: F401 - fixture
from tests.test_validation_own_fem import deformable
from validation.cost.references import references
from validation.errors import InputError
from validation.run.curved.accuracy import (
    DEGREES,
    FACET_MEANS,
    LADDER,
    QUANTITIES,
    SAFETY,
    closer,
    curved_scene,
    error_bar,
    graded_to_both_ends,
    parse_targets,
    reached,
    run_to_accuracy,
    unmet,
)
from validation.run.curved.solve import Solved, solve_curved
from validation.run.measures import Measure
from validation.scene.read import TubeScene


def scene(name: str, *settings: str) -> TubeScene:
    found = deformable(name, *(settings or ("assembly.layers=1",)))
    return curved_scene(name, found, "--accuracy")


def test_what_is_asked_is_read() -> None:
    assert parse_targets(["u=1%", "p_max_point=0.03"]) == {
        "max_displacement": 0.01,
        "p_max_point": 0.03,
    }


@pytest.mark.parametrize("text", ["1%", "weight=1%", "p_eff=0%", "p_eff=120%", "p_eff", "p_eff=x"])
def test_what_cannot_be_asked_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="expected QUANTITY=SHARE"):
        parse_targets([text])


def test_a_quantity_is_asked_once() -> None:
    with pytest.raises(InputError, match="asked twice"):
        parse_targets(["u=1%", "max_displacement=2%"])


def test_error_bars_are_compared_relatively() -> None:
    measures = {
        "p_eff": Measure(-2.0, "MPa", 0.1),
        "p_max": Measure(1.0, "MPa"),
        "p_max_point": Measure(0.0, "MPa", 0.0),
    }
    assert reached(measures, "p_eff") == 0.05
    targets = {"p_eff": 0.05, "p_max": 0.5, "p_max_point": 0.01}
    assert unmet(measures, targets) == ["p_max"]


def test_graded_lines() -> None:
    """Symmetric, and in the limit of many elements the middle ones are longer by the grading."""
    ends = graded_to_both_ends(4000, 20.0)
    sizes = np.diff(ends)
    np.testing.assert_allclose(ends + ends[::-1], 1.0, rtol=0, atol=1e-14)
    # Sizes at the middles of elements: the slope changes by 4 arccosh(√20) / 4000 over one.
    assert sizes[2000] / sizes[0] == pytest.approx(20.0, rel=0.005)


def test_an_error_bar_is_of_the_last_change_or_of_a_larger_one_before() -> None:
    """Errors that halve leave at most the last change, and a quarter of the one before it."""
    assert error_bar([1.0, 1.5]) == pytest.approx(SAFETY * 0.5)
    assert error_bar([1.0, 1.5, 1.75]) == pytest.approx(SAFETY * 0.25)
    # A last change that vanishes by chance.
    assert error_bar([1.0, 1.5, 1.5]) == pytest.approx(SAFETY * 0.125)


def test_error_bars_cover_nine_of_ten_errors() -> None:
    """Three tubes on the first rungs, judged by values of meshes of four times the unknowns."""
    missed, judged = [], 0
    for name in ("tsb1-pipe", "tsb2-pipe", "tsb1-tunnel"):
        tube = scene(name, "assembly.layers=2")
        for ladder, last in ((LADDER, 2), (DEGREES, 3)):
            solved: list[Solved] = []
            for rung in ladder.rungs[:last]:
                state = solved[-1].state if solved else None
                solved.append(solve_curved(name, tube, rung.mesh(3), state))
            found = [s.measures for s in solved]
            assert set(found[0]) == set(QUANTITIES)
            for k in range(2, last + 1):
                bars = ladder.error_bars(found[:k])
                for key, reference in references()[f"{name}, assembly.layers = 2"].items():
                    judged += 1
                    error = abs(found[k - 1][key].value - reference.value)
                    if error > bars[key] + reference.uncertainty:
                        missed.append((name, k, key))
    assert judged == 63
    assert len(missed) <= judged // 10, missed


def test_time_that_is_not_enough_is_refused_with_what_is_reached() -> None:
    with pytest.raises(InputError, match=r"CPU s and .* are left \(--max-seconds\)"):
        run_to_accuracy("tube", scene("tsb1-pipe"), {"p_max_point": 0.01}, seconds=1e-3)


def test_command(tubelock) -> None:  # type: ignore[no-untyped-def] # noqa: F811
    short = ("--set", "assembly.layers=1")
    status, out, _ = tubelock(
        "fem", "tsb1-pipe", *short, "--accuracy", "u=20%", "--json", "fem.json"
    )
    assert status == 0
    data = json.loads(Path("fem.json").read_text())
    bar = data["measures"]["max_displacement"]
    assert 0.0 < bar["error"] <= 0.2 * bar["value"]
    assert [mesh["degree"] for mesh in data["meshes"]] == [r.degree for r in DEGREES.rungs[:2]]
    assert "times the change from the mesh before" in out


def test_a_wide_bar_names_a_command_that_gives_a_narrower_one(tubelock) -> None:  # type: ignore[no-untyped-def] # noqa: F811
    coarse = ("--set", "mesh.around=6", "--set", "mesh.radial=1", "--set", "mesh.axial=2")
    short = ("--set", "assembly.layers=1")
    _, out, _ = tubelock("fem", "tsb2-tunnel", *short, *coarse)
    (told,) = (line for line in out.splitlines() if line.startswith("closer"))
    program, *words = shlex.split(told)[1:]
    assert program == "tubelock"
    assert words[:-2] == ["fem", "tsb2-tunnel", *short, *coarse]
    name, share = next(iter(parse_targets([words[-1]]).items()))
    status, out, _ = tubelock(*words, "--json", "closer.json")
    assert status == 0
    assert "closer " not in out
    bar = json.loads(Path("closer.json").read_text())["measures"][name]
    assert bar["error"] <= share * abs(bar["value"])


@pytest.mark.parametrize(
    ("name", "error", "told"),
    [
        ("tsb1-pipe", 0.2, "p_max_point=5%"),
        ("tsb1-pipe", 0.05, None),
        # A shaft is no load of the ladder, explicit runs have none, no bar is no wide bar.
        ("tsb1-shaft", 0.2, None),
        ("tsb1-pipe", None, None),
    ],
)
def test_only_wide_bars_of_tubes_name_one(name: str, error: float | None, told: str | None) -> None:
    measures = {"p_max_point": Measure(1.0, "MPa", error), "p_eff": Measure(1.0, "MPa", 0.01)}
    assert closer(deformable(name), measures) == told


def test_other_scenes_take_shares_of_their_own_mesh(tubelock) -> None:  # type: ignore[no-untyped-def] # noqa: F811
    mesh = ("thb0-tunnel", "--set", "mesh.edge=4", "--set", "mesh.radial=2")
    short = (*mesh, "--set", "assembly.layers=1", "--json", "f.json", "--accuracy")
    status, out, _ = tubelock("fem", *short, "u=90%")
    assert status == 0
    # The coarsest mesh has no bar; cubic elements on it have one, and it is enough.
    assert "24 elements of degree 1: max_displacement without an error bar" in out
    assert "6 elements of degree 3 per block" in out
    # Means over the facets of another mesh are another number: they have no bar and are not told.
    assert not FACET_MEANS & json.loads(Path("f.json").read_text())["measures"].keys()
    assert "p_eff, p_max " in out
    status, _, err = tubelock("fem", *short, "u=0.001%")
    assert status == 2
    assert "[mesh] of the scene reaches max_displacement ±" in err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["tsb1-pipe", "--max-seconds", "3"], "give both or none"),
        (["tsb1-pipe", "--accuracy", "u=1%", "--resume", "a.npz"], "leave out --accuracy"),
    ],
)
def test_bad_input(tubelock, arguments, text) -> None:  # type: ignore[no-untyped-def] # noqa: F811
    status, _, err = tubelock("fem", *arguments)
    assert status == 2
    assert text in err
    assert "Traceback" not in err
