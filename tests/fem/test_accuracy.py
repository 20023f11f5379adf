"""Answers of a stated accuracy: what is asked, how often error bars cover, what is refused."""

from __future__ import annotations

import json
import math
import re
import time
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from fem import Static, solve_static
from fem.accuracy import converge as converging
from fem.accuracy import strength
from fem.accuracy.converge import climbed, converge, usual_work
from fem.accuracy.errors import (
    LEAST_MESHES,
    OF_SEQUENCES,
    SAFETY,
    OnMesh,
    error_bar,
    relative,
    sequence_bars,
    unmet,
)
from fem.accuracy.ladder import (
    DEGREES,
    LADDER,
    PEAKS,
    PRESSURES,
    Rung,
    graded_to_both_ends,
    graded_to_one_end,
)
from geometry import Measure
from geometry.errors import RefusedError
from geometry.machine.work import Budget, LimitError
from tests.fixtures.commands import small_meshes
from tests.support.commands import answered
from tests.support.own_blocks import column
from tests.support.references import references
from tests.support.stated import stated
from validation import load_case, solve


def test_error_bars_are_compared_relatively() -> None:
    measures = {
        "p_eff": Measure(-2.0, "MPa", 0.1),
        "p_max": Measure(1.0, "MPa"),
        "p_max_point": Measure(0.0, "MPa", 0.0),
    }
    assert relative(measures["p_eff"]) == 0.05
    targets = {"p_eff": 0.05, "p_max": 0.5, "p_max_point": 0.01}
    assert unmet(measures, targets) == ["p_max"]


def test_graded_lines() -> None:
    """Symmetric, and in the limit of many elements the middle ones are longer by the grading."""
    ends = graded_to_both_ends(4000, 20.0)
    sizes = np.diff(ends)
    np.testing.assert_allclose(ends + ends[::-1], 1.0, rtol=0, atol=1e-14)
    # Sizes at the middles of elements: the slope changes by 4 arccosh(√20) / 4000 over one.
    assert sizes[2000] / sizes[0] == pytest.approx(20.0, rel=0.005)


@pytest.mark.parametrize("grading", [1.0, 8.0])
def test_lines_graded_to_one_end(grading: float) -> None:
    ends = graded_to_one_end(2000, grading)
    sizes = np.diff(ends)
    assert (ends[0], ends[-1]) == (0.0, 1.0)
    assert sizes[0] / sizes[-1] == pytest.approx(grading, rel=0.005)


def test_an_error_bar_is_the_largest_that_earlier_meshes_tell() -> None:
    """Errors that halve leave the last change, and a third of that from the mesh before it."""
    assert error_bar(1.5, [(1.0, 2.0)]) == pytest.approx(SAFETY * 0.5)
    assert error_bar(1.75, [(1.0, 4.0), (1.5, 2.0)]) == pytest.approx(SAFETY * 0.25)
    # A last change that vanishes by chance.
    assert error_bar(1.5, [(1.0, 4.0), (1.5, 2.0)]) == pytest.approx(SAFETY * 0.5 / 3.0)
    # Exact for an error that falls as stated, but for the factor of safety.
    assert error_bar(3.0 + 2.0, [(3.0 + 8.0, 4.0)]) == pytest.approx(SAFETY * 2.0)
    vector = np.array([3.0, 4.0])
    assert error_bar(np.zeros(2), [(vector, 2.0)], np.linalg.norm) == pytest.approx(SAFETY * 5.0)


@pytest.mark.quick
@pytest.mark.parametrize("rate", [0.5, 0.7, 1.0])
def test_three_meshes_show_by_which_rate_a_pressure_at_a_point_converges(rate: float) -> None:
    """Its bar is the error of the last one by the safety, whatever the rate."""
    sizes, exact = (1.0, 2.0, 4.0), 3.0
    values = [exact - 0.5 * size**-rate for size in sizes]
    found = [{"p_max_point": Measure(value, "MPa")} for value in values]
    meshes = [OnMesh(*of) for of in zip(found, PRESSURES, sizes, sizes, strict=False)]
    bar = sequence_bars(meshes)["p_max_point"]
    assert bar == pytest.approx(OF_SEQUENCES * (exact - values[-1]), rel=1e-6)


#: A stored reference that is 0.6 % from every mesh from the second on: docs/trust/error-bars.md.
DISTANT = ("tsb1-tunnel", "max_displacement")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "far", "least"),
    [
        (("tsb1-pipe", "tsb1-tunnel"), False, 16),
        pytest.param(
            ("tsb1-pipe", "tsb2-pipe", "tsb1-tunnel"), False, 25, marks=pytest.mark.thorough
        ),
        pytest.param(("tsb1-pipe",), True, 20, marks=pytest.mark.thorough),
    ],
)
def test_error_bars_cover_nine_of_ten_errors(names: tuple[str, ...], far: bool, least: int) -> None:
    """Tubes on the first rungs, judged by values of meshes of many times the unknowns.

    From the third mesh on: before it no bar is believed. Stresses at edges have one from the fourth
    mesh of their ladder on, and on the ladder of peaks. A rung of two ladders is solved once.
    """
    missed, judged = [], 0
    for name in names:
        tube = stated(name, "assembly.layers=2")
        known = references()[f"{name}, assembly.layers = 2"]
        climbs = ((LADDER, LEAST_MESHES, 4 if far else 3), (PRESSURES, LEAST_MESHES, 3))
        climbs += ((PEAKS, LEAST_MESHES, 3),) if far else ()
        rungs = dict.fromkeys(rung for ladder, _, n in climbs for rung in ladder[:n])
        by_rung = dict(zip(rungs, climbed(tube, rungs), strict=True))
        for ladder, first, n in climbs:
            solved = [by_rung[rung] for rung in ladder[:n]]
            found = [s.measures for s in solved]
            assert known.keys() <= found[0].keys()
            for k in range(first, n + 1):
                bars = sequence_bars([s.numbers for s in solved[:k]])
                for key, reference in known.items():
                    if key not in bars or (name, key) == DISTANT:
                        continue
                    judged += 1
                    error = abs(found[k - 1][key].value - reference.value)
                    if error > bars[key] + reference.uncertainty:
                        missed.append((name, k, key))
    assert judged >= least  # stresses at edges, and what one mesh alone resolves, have no bar
    assert len(missed) <= judged // 10, missed


def test_only_a_request_is_pursued_where_bars_stay_far_too_wide() -> None:
    """After four meshes; their bars compare meshes fine enough to foretell that of the next one."""
    tube = stated("tsb1-pipe", "assembly.layers=1", *("mesh.around=12", "mesh.axial=4"))
    ladder = tuple(Rung(1, 12, 1, n, 1.0, 1.0) for n in (4, 5, 6, 7, 8))
    sought = {"p_max_point": 1e-5}
    by_itself = converge(tube, otherwise=sought, ladder=ladder)
    assert "much too wide" in by_itself.accuracy.ended_by
    assert len(by_itself.meshes.meshes) == 4
    assert len(converge(tube, sought, ladder=ladder).meshes.meshes) == 5


def test_time_that_is_not_enough_ends_with_what_is_reached() -> None:
    """One mesh is solved whatever it takes, and has no error bar alone."""
    found = converge(stated("tsb1-pipe"), {"p_max_point": 1e-6}, max_seconds=1e-3)
    told = found.accuracy.as_json()
    assert told["not_reached"] == ["p_max_point"]
    assert told["reached"]["p_max_point"] == relative(found.measures["p_max_point"]) == math.inf
    assert "CPU time" in told["ended_by"]
    assert "-" not in told["ended_by"]
    assert len(found.meshes.meshes) == 1


def test_a_mesh_that_takes_longer_than_the_limit_is_left_unfinished(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A clock that counts its readings, one of which each iteration takes."""
    readings = count()
    monkeypatch.setattr(time, "process_time", lambda: float(next(readings)))
    problem = stated("tsb1-pipe")
    ladder = Rung(2, 6, 1, 2, 1.0, 1.0), Rung(3, 6, 1, 2, 1.0, 1.0)
    first = converge(problem, ladder=ladder[:1])
    allowed = next(readings) + 3
    begin = next(readings)
    found = converge(problem, {"p_max_point": 1e-6}, max_seconds=allowed, ladder=ladder)
    assert next(readings) - begin <= allowed + 5
    assert "limit of CPU time" in found.accuracy.ended_by
    assert len(found.meshes.meshes) == 1
    assert found.measures["p_eff"].value == pytest.approx(first.measures["p_eff"].value, rel=1e-9)


@pytest.mark.usefixtures("undrawn")
def test_an_interrupt_leaves_the_files_of_the_last_finished_mesh(tubelock, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    state, calls = converging._state, count(1)

    def interrupted(*given):  # type: ignore[no-untyped-def]
        if next(calls) > 2:
            raise KeyboardInterrupt
        return state(*given)

    monkeypatch.setattr(converging, "_state", interrupted)
    status, _, said = tubelock("fem", "tsb1-pipe", "--set", "assembly.layers=1", "-o", "o")
    assert status == 130
    assert said.endswith(" s: the files have what was computed until then\n")
    data = json.loads(Path("o/answer.json").read_text())
    assert data["work"]["stopped_by"] == data["accuracy"]["stopped_by"] == "interrupt"
    assert len(data["meshes"]) == 2
    assert data["measures"]["max_displacement"]["error"] > 0.0
    assert Path("o/stresses.png").exists()


def test_work_that_does_for_no_mesh_is_no_answer(tubelock) -> None:  # type: ignore[no-untyped-def]
    status, _, said = tubelock("fem", "tsb1-pipe", "--max-work", "1e-6", "--json", "f.json")
    assert (status, said.count("\n")) == (3, 1)
    assert "limit of work" in said
    assert not Path("f.json").exists()


def test_command(tubelock) -> None:  # type: ignore[no-untyped-def]
    short = ("--set", "assembly.layers=1")
    asked = ("--accuracy", "u=20%", "--accuracy", "p_eff=0.5")
    data, _ = answered("fem", "tsb1-pipe", *short, *asked)
    bar = data["measures"]["max_displacement"]
    assert 0.0 < bar["error"] <= 0.2 * bar["value"]
    assert data["accuracy"]["requested"] == {"max_displacement": 0.2, "p_eff": 0.5}
    assert [mesh["degree"] for mesh in data["meshes"]] == [r.degree for r in DEGREES[:LEAST_MESHES]]
    # A limit leaves the first meshes of the same sequence.
    few = ("--set", "fem.max_meshes=1", "--json", "few.json")
    assert tubelock("fem", "tsb1-pipe", *short, *asked, *few)[0] == 3
    found = json.loads(Path("few.json").read_text())
    (mesh,), first = found["meshes"], data["meshes"][0]
    assert mesh["measures"] == pytest.approx(first["measures"], rel=1e-9)
    assert found["measures"]["p_eff"]["value"] == mesh["measures"]["p_eff"]
    assert found["accuracy"]["ended_by"] == "the limit of meshes"


@pytest.mark.parametrize("name", ["thb0-tunnel", "osteomorphic"])
def test_other_families_and_loads_are_refined_too(name: str) -> None:
    """Means over facets are those of the facets of the scene, on every mesh."""
    short = ["--set", "assembly.layers=1"]
    short += ["--set", "assembly.columns=1"] if name == "osteomorphic" else []
    data, _ = answered("fem", name, *short, "--accuracy", "u=50%")
    assert all(data["measures"][key]["error"] > 0.0 for key in ("p_eff", "p_max", "p_max_facet"))


def test_an_accuracy_that_is_not_reached_is_told_and_has_a_status_of_its_own(tubelock) -> None:  # type: ignore[no-untyped-def]
    short = ("--set", "assembly.layers=1", "--json", "f.json", "--max-seconds", "0.001")
    status, _, _ = tubelock("fem", "tsb1-pipe", *short, "--accuracy", "u=0.001%")
    assert status == 3
    data = json.loads(Path("f.json").read_text())
    assert data["accuracy"]["not_reached"] == ["max_displacement"]
    assert data["measures"]["max_displacement"]["value"] > 0.0


def test_printed_seconds_include_the_load_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that stands still but there."""
    clock = [0.0]

    def factors(*_: object, **__: object) -> dict[str, Measure]:
        clock[0] += 1000.0
        return {}

    monkeypatch.setattr(time, "process_time", lambda: clock[0])
    monkeypatch.setattr(strength, "strength_factors", factors)
    case = column(0.5).changed({"material.tensile_strength": 1.0})
    with small_meshes(1):
        seconds = solve(case).report["cpu_seconds"]
    assert seconds["load factors"] == seconds["total"] == 1000.0


def test_one_mesh_is_said_to_be_no_converged_answer():
    """The limit of work ends a run after its first mesh: title and values at a point say so."""
    case = load_case("tsb1-pipe", {"assembly.layers": 1})
    first = solve(case).parts["meshes"].meshes[0].beside["work"]
    answer = solve(case.changed({"fem.max_work": 1.2 * first}))
    assert answer.report["work"]["stopped_by"] == "work"
    assert len(answer.parts["meshes"].meshes) == 1
    assert "one mesh: these numbers are not converged" in str(answer).splitlines()[0]
    assert not answer["p_max_point"].is_number
    assert answer["u"].is_number


@pytest.mark.parametrize(("forecast", "meshes"), [(45.0, 2), (60.0, 1)])
def test_a_second_mesh_is_begun_where_it_may_be_finished(monkeypatch, forecast, meshes):
    """Error bars need two; the second is begun with three tenths of its forecast, of 15 s."""
    monkeypatch.setattr(Budget, "grown", lambda *_: forecast)
    answer = solve(load_case("tsb1-pipe", {"assembly.layers": 1}))
    assert len(answer.parts["meshes"].meshes) == meshes
    assert answer.report["work"]["stopped_by"] == "work"
    assert (answer["u"].error is None) == (meshes == 1)


def test_limit_of_work_grows_with_the_blocks():
    """Four layers have their error bars within the share that as many blocks of 200 layers have."""
    few, many = (load_case("tsb1-pipe", {"assembly.layers": n}) for n in (4, 200))
    ratio = len(few.problem.blocks.free_blocks) / len(many.problem.blocks.free_blocks)
    share = ratio * usual_work(many.problem)
    answer = solve(few.changed({"fem.max_work": share}))
    assert len(answer.parts["meshes"].meshes) >= LEAST_MESHES
    assert answer["u"].error is not None


def needed(*settings: str) -> float:
    """Memory that a tube says to need where there is none [GB]."""
    with pytest.raises(LimitError) as refused:
        solve_static(stated("tsb1-pipe", *settings), Static(max_memory=1e-6))
    return float(re.findall(r"about (\S+) GB of memory, and the limit", str(refused.value))[0])


@pytest.mark.parametrize("more", ["effects.friction=0.3", "contact.clearance=0.0"])
def test_memory_is_stated_before_the_first_mesh_and_suffices(more: str) -> None:
    """The next mesh does not fit: the first one is the answer."""
    problem = stated("tsb1-pipe", "assembly.layers=2", more)
    need = needed("assembly.layers=2", more)
    with pytest.raises(LimitError, match="GB of memory"):
        solve_static(problem, Static(max_memory=0.99 * need))
    accuracy = solve_static(problem, Static(max_memory=1.01 * need)).parts["accuracy"]
    assert accuracy.stopped_by == "memory"
    assert accuracy.ended_by.startswith("the limit of memory")
    assert needed("assembly.layers=8", more) > need


def test_the_mesh_of_a_scene_takes_dense_matrices_where_it_is_solved_in_degree_1() -> None:
    """Coarser meshes begin a default run; elements of higher degree have a count of their own."""
    assert load_case("tsb1-pipe", ["fem.max_memory=0.5"]).problem.blocks.n_blocks == 56
    few = ["mesh.around=24", "mesh.radial=1", "mesh.axial=6", "fem.degree=3"]
    assert load_case("tsb1-pipe", ["fem.max_memory=0.5", *few]).problem.degree == 3
    dense = load_case("tsb1-pipe", ["fem.max_memory=0.5", 'fem.mesh="scene"'])
    with pytest.raises(RefusedError, match=r"1\.69 GB of memory"):
        _ = dense.problem
