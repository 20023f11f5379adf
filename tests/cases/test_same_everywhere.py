"""Limits of work are the same on every machine, under any load: no clock has a say in answers."""

from __future__ import annotations

import itertools
import time
from typing import Any

import pytest
from threadpoolctl import threadpool_limits

from tests.fixtures.commands import small_meshes
from tests.support.coarse_tubes import keys
from validation import load_case, solve, sweep

CASES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "refined tube with a gap": (
        "tsb1-tunnel",
        "static",
        {"assembly.layers": 1, "contact.clearance": 0.05},
    ),
    "rigid ranges": ("octahedra", "rigid", {"rigid.ranges": True, "effects.friction": 0.4}),
}


def without_times(data: Any) -> Any:
    """Plain data without what is measured by a clock."""
    if isinstance(data, dict):
        told = {"cpu_seconds", "peak_memory_mb"}
        return {key: without_times(value) for key, value in data.items() if key not in told}
    if isinstance(data, list):
        rows = [v for v in data if not (isinstance(v, dict) and v.get("group") == "time")]
        return [without_times(value) for value in rows]
    return data


@pytest.mark.parametrize("name", CASES)
def test_neither_a_fast_clock_nor_more_threads_change_an_answer(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    scene, method, settings = CASES[name]
    settings = settings | ({"fem.max_work": 0.3} if method == "static" else {})

    def answer() -> Any:
        """Of a case that has kept nothing: what is known already is not counted as work."""
        return without_times(solve(load_case(scene, settings, method=method)).as_dict())

    first = answer()
    for clock in ("process_time", "perf_counter"):
        readings = itertools.count(0.0, 10.0)
        monkeypatch.setattr(time, clock, lambda readings=readings: next(readings))
    with threadpool_limits(2, user_api="blas"):
        assert answer() == first
    assert first["work"]["done"] > 0.0


@pytest.mark.thorough
def test_a_sweep_has_the_same_rows_with_any_number_of_workers() -> None:
    """Of deformable blocks; those of rigid ones are compared with a Dask cluster's in every run."""
    settings = keys(1, 4) | {"fem.mesh": "scene", "fem.error_estimate": False}
    one, two = (
        sweep("tsb1-pipe", {"block.amplitude": [20.0, 24.0]}, settings, quantity="fem", workers=n)
        for n in (1, 2)
    )
    assert without_times(list(one.rows)) == without_times(list(two.rows))
    assert {row["status"] for row in one.rows} == {"ok"}


def test_a_limit_of_work_ends_a_refinement_and_says_so() -> None:
    """Less work leaves fewer meshes, each as before; its sum is in the answer."""
    case = load_case("tsb1-pipe", {"assembly.layers": 1, "fem.max_work": 5.0}, method="static")
    with small_meshes():
        more = solve(case).as_dict()
    assert more["work"]["stopped_by"] is None
    of_meshes = sum(mesh["work"] for mesh in more["meshes"])
    assert of_meshes * (1.0 - 1e-12) <= more["work"]["done"] <= 5.0
    first, second, *_ = (mesh["work"] for mesh in more["meshes"])
    limit = first + 0.5 * second
    with small_meshes():
        few = solve(case.changed({"fem.max_work": limit})).as_dict()
    assert without_times(few["meshes"]) == without_times(more["meshes"][:1])
    assert few["work"]["stopped_by"] == few["accuracy"]["stopped_by"] == "work"
    assert few["work"]["limit"] == limit
    assert few["accuracy"]["ended_by"].startswith("the limit of work")


def test_a_limit_that_allows_a_mesh_allows_its_answer() -> None:
    """Whatever an answer still needs then: forces of searched contact, of which a mesh has none."""
    case = load_case("versatile", {"fem.max_work": 0.5}, method="static")
    more = solve(case).as_dict()
    (mesh,) = more["meshes"]
    least = solve(case.changed({"fem.max_work": 1.000001 * mesh["work"]})).as_dict()
    assert without_times(least["measures"]) == without_times(more["measures"])
    assert least["work"]["done"] > least["work"]["limit"]


def test_a_limit_that_leaves_out_error_bars_stands_in_the_answer() -> None:
    """On one mesh the state is found whatever it takes; its bars within the limit of the rest."""
    settings = keys(1, 2)
    case = load_case("tsb1-pipe", {**settings, "fem.mesh": "scene"}, method="static")
    whole = solve(case).as_dict()
    assert whole["work"]["stopped_by"] is None
    cut = solve(case.changed({"fem.max_seconds": 1e-9})).as_dict()
    assert cut["work"]["stopped_by"] == "clock"
    value = whole["measures"]["p_eff"]["value"]
    assert cut["measures"]["p_eff"]["value"] == pytest.approx(value, rel=1e-12)
    assert cut["measures"]["p_eff"]["error"] is None
