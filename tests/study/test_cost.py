"""Cost of accuracy: methods on meshes, errors against the finest answer, and what is kept."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from validation import Case, InputError, load_case
from validation.study import cost
from validation.study import study as study_of_cases
from validation.study.cost import QUANTITIES, CostResult, cost_cases, run_cost
from validation.study.rowfile import RowFile

#: Cases of a quick study of one layer, in their order.
QUICK = (
    *("rigid, mesh ×1", "rigid, mesh ×2", "static, mesh ×1", "static, mesh ×2"),
    *("explicit, mesh ×1", "converged, ± 10 %", "converged, ± 3 %"),
)


def tube(*settings: str) -> Case:
    """A short tube."""
    return load_case("tsb1-pipe", ["assembly.layers=1", *settings])


@pytest.fixture(scope="module")
def store(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("cost") / "cost.jsonl"


@pytest.fixture(scope="module", autouse=True)
def once() -> Iterator[None]:
    """Solve each case once: of times nothing here is asked."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cost, "_CHEAP", 0.0)
        yield


@pytest.fixture(scope="module")
def study(once, store) -> CostResult:
    return run_cost(tube(), store, quick=True)


def test_errors_are_those_of_the_measures_against_the_finest_answer(study) -> None:
    assert tuple(row.name for row in study.rows) == QUICK
    assert study.finest.errors == dict.fromkeys(QUANTITIES, 0.0)
    finest = study.finest.answer
    for row in study.rows:
        of_rigid = row.method == "rigid"
        assert set(row.errors) == ({"p_eff"} if of_rigid else set(QUANTITIES))
        assert row.cost > 0.0
        for name, error in row.errors.items():
            change = abs(row.answer[name].value - finest[name].value)
            assert error == pytest.approx(change / finest[name].value, rel=1e-12, abs=1e-15)
    for name in QUANTITIES:
        assert study.uncertainty(name) == finest[name].error / finest[name].value < 0.03


def test_errors_fall_with_the_mesh_and_explicit_runs_end_at_the_static_state(study) -> None:
    rows = {row.name: row for row in study.rows}
    order = [rows[name] for name in ("static, mesh ×1", "static, mesh ×2", "converged, ± 10 %")]
    for coarse, fine in pairwise(order):
        for name in ("max_displacement", "p_max_point", "sigma_1_averaged"):
            assert fine.errors[name] < coarse.errors[name]
    explicit, static = rows["explicit, mesh ×1"].answer, rows["static, mesh ×1"].answer
    for name in QUANTITIES:
        # The run stops at a residual of 1e-4 of the load; its softest motion amplifies it tenfold.
        assert explicit[name].value == pytest.approx(static[name].value, rel=1e-3)


def test_rows_that_are_kept_are_not_computed_again(study, store, monkeypatch) -> None:
    assert len(RowFile(store)) == len(QUICK)

    def no_run(*_: object) -> None:
        raise AssertionError("a new run")

    monkeypatch.setattr(study_of_cases.CaseStudy, "results", no_run)
    again = run_cost(tube(), store, quick=True)
    assert [(row.name, row.cost, row.errors) for row in again.rows] == [
        (row.name, row.cost, row.errors) for row in study.rows
    ]


def test_a_killed_study_goes_on_and_a_case_that_fails_is_told(study, tmp_path, monkeypatch) -> None:
    known, store, done = dict(zip(QUICK, study.rows, strict=True)), tmp_path / "cost.jsonl", []

    def answered(self: Any, number: int) -> tuple[dict[str, Any], list[str]]:
        name = QUICK[number]
        if name == "static, mesh ×1" and len(done) == 2:
            raise KeyboardInterrupt
        done.append(name)
        if name == "explicit, mesh ×1":
            raise InputError("went unstable")
        return {"answer": known[name].answer.as_dict()}, []

    monkeypatch.setattr(study_of_cases.CaseStudy, "results", answered)
    with pytest.raises(KeyboardInterrupt):
        run_cost(tube(), store, quick=True)
    assert done == list(QUICK[:2])
    done += ["killed"]
    found = run_cost(tube(), store, quick=True)
    assert set(done[3:]) == set(QUICK[2:])
    assert found.failures == {"explicit, mesh ×1": "went unstable"}
    assert [row.name for row in found.rows] == [n for n in QUICK if n != "explicit, mesh ×1"]


def test_without_a_finest_answer_there_are_no_errors(tmp_path, monkeypatch) -> None:
    def failed(*_: object) -> None:
        raise InputError("went unstable")

    monkeypatch.setattr(study_of_cases.CaseStudy, "results", failed)
    with pytest.raises(InputError, match="converged, ± 3 %: went unstable"):
        run_cost(tube(), tmp_path / "cost.jsonl", quick=True)


@pytest.mark.parametrize(
    "name", ["tsb1-pipe", "thb0-tunnel", "planar-sine", "osteomorphic", "brick-stack"]
)
def test_meshes_of_a_family_are_multiples_of_the_coarsest_and_conform(name: str) -> None:
    found = cost_cases(load_case(name), quick=True)
    one, two = (found[f"rigid, mesh ×{level}"] for level in (1, 2))
    counts = [case.problem.blocks.interfaces.n_contacts for case in (one, two)]
    assert counts[1] == 4 * counts[0]


def test_blocks_that_are_not_refined_have_one_more_mesh_as_the_finest(monkeypatch) -> None:
    monkeypatch.setattr(cost, "why_not_refined", lambda _: "supports that move step by step")
    *others, (name, case) = cost_cases(tube(), quick=True).items()
    assert name == "static, mesh ×4"
    assert case.method.error_estimate
    assert not any(case.method.error_estimate for _, case in others if case.method.name == "static")


@pytest.mark.parametrize("stated", ["fem.degree=2", "fem.element=reduced"])
def test_elements_that_are_stated_are_those_of_every_mesh(stated: str) -> None:
    """Refined answers have elements of their own: they would be errors of others."""
    coarse = ("mesh.around=12", "mesh.radial=1", "mesh.axial=2")
    found = cost_cases(tube(*coarse, stated), quick=True)
    assert list(found)[-1] == "static, mesh ×4"
    assert not any(name.startswith("converged") for name in found)


def test_a_limit_of_work_holds_for_every_case() -> None:
    for name, case in cost_cases(tube("fem.max_work=0.3"), quick=True).items():
        assert name.startswith("rigid") or case.method.max_work == 0.3


@pytest.mark.slow
def test_command(study, store, tubelock) -> None:
    status, out, _ = tubelock(
        *("cost", "tsb1-pipe", "--set", "assembly.layers=1", "--quick", "--store", str(store)),
        *("-o", "run", "--json", "cost.json"),
    )
    assert status == 0
    assert "finest: converged" in out
    assert Path("run/cost.png").stat().st_size > 10_000
    data = json.loads(Path("cost.json").read_text())
    assert [case["name"] for case in data["cases"]] == list(QUICK)
    assert data["finest"]["relative_error_bars"]["p_eff"] == study.uncertainty("p_eff")
