"""Sensitivities against closed forms, searches against all designs, and their messages."""

from __future__ import annotations

import math
import re
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.coarse_tubes import keys
from validation import InputError, load_case, optimise, sensitivity, sweep
from validation.study.optimisation.search import Search, worst_of
from validation.study.optimisation.sensitivity import _roughness, _with_error
from validation.study.optimisation.statement import check_optimisation

pytestmark = pytest.mark.quick

COARSE = keys(2, 2)
VARIABLES: dict[str, Any] = {
    "block.amplitude": [10.0, 20.0],
    "block.blocks_per_layer": [3, 4, 5],
}


def stated(**more: Any) -> dict[str, Any]:
    """Search among six coarse tubes."""
    base = {"scene": "tsb1-pipe", "minimise": "p_max", "settings": COARSE, "evaluations": 6}
    base |= {"judge": {"count": 1, "settings": {"fem.mesh": "scene", "fem.error_estimate": False}}}
    return base | {"variables": VARIABLES} | more


def test_the_volume_of_a_tube_has_its_elasticities_by_hand() -> None:
    """V ∝ h ((r + t)² − r²): 1 for h, 2 t (r + t) / (t (2 r + t)) for t, by one part in 1e4."""
    result = sensitivity(
        "tsb1-pipe", COARSE, parameters=["block.height", "block.thickness", "block.inner_radius"]
    )
    slopes = {s.parameter: s for s in result.slopes if s.measure == "volume"}
    r, t = 120.0, 40.0
    assert slopes["block.height"].elasticity == pytest.approx(1.0, abs=1e-6)
    by_hand = 2 * (r + t) / (2 * r + t)
    thick = slopes["block.thickness"]
    assert abs(thick.elasticity - by_hand) <= 1e-4 * by_hand + thick.elasticity_error
    assert slopes["block.inner_radius"].elasticity == pytest.approx(2 * r / (2 * r + t), rel=1e-4)


@pytest.mark.slow
def test_a_column_under_its_weight_has_its_slopes_by_hand() -> None:
    """u = ρ g H² / 2 E + ρ g h / k of two boxes without Poisson's ratio, H = 2 h; no tension.

    Rounding alone has tension here: quotients of it were printed as an elasticity of 0.38 ± 0.24.
    """
    h, rho_g, young, stiffness = 100.0, 2.4e-9 * 9810.0, 33e3, 1e3
    scene = {
        "block": {"type": "boxes", "boxes": [{"size": [h, h, h], "divisions": [1, 1, 1]}] * 2},
        "load": {"pressure": 0.0},
        "material": {"density": 2.4e-9, "young_modulus": young, "poisson_ratio": 0.0},
        "contact": {"law": "linear", "stiffness": stiffness},
        "effects": {"gravity": [0.0, 0.0, -9810.0]},
    }
    result = sensitivity(load_case(scene), method="fem", parameters=["contact.stiffness"])
    slopes = {slope.measure: slope for slope in result.slopes}
    soft, joint = rho_g * (2 * h) ** 2 / (2 * young), rho_g * h / stiffness
    moved = slopes["max_displacement"]
    assert moved.elasticity_error < 1e-3
    # The quotient of 1/k leaves out the square of its step, 1e-4.
    error = moved.elasticity_error + 1e-4
    assert moved.elasticity == pytest.approx(-joint / (soft + joint), abs=error)
    assert slopes["sigma_1_averaged"].derivative is None
    assert slopes["sigma_1_averaged"].remark == "negligible beside the largest stress"


def test_an_arch_has_the_slopes_of_its_weight_on_its_springings() -> None:
    """p = ρ g π R d t / 2 d t at the largest, V = π R d t; it was said to carry no load."""
    scene = load_case("arch", {"assembly.voussoirs": 8, "block.thickness": 250.0})
    result = sensitivity(scene, parameters=["block.radius", "block.depth"])
    found = {(s.measure, s.parameter): s.elasticity for s in result.slopes}
    assert found == pytest.approx(
        {
            ("p_max_facet", "block.radius"): 1.0,
            ("p_max_facet", "block.depth"): 0.0,
            ("volume", "block.radius"): 1.0,
            ("volume", "block.depth"): 1.0,
        },
        abs=1e-6,
    )
    with pytest.raises(InputError, match=r"such as effects\.friction\.coefficient$"):
        sensitivity(scene, parameters=["effects.friction"])


def test_rigid_pressures_are_proportional_to_the_load() -> None:
    """Elasticity 1 of p_max and p_eff; the volume does not change."""
    result = sensitivity("tsb1-pipe", COARSE, parameters=["load.pressure"])
    values = {s.measure: s.elasticity for s in result.slopes}
    assert values == pytest.approx({"p_max": 1.0, "p_eff": 1.0, "volume": 0.0}, abs=1e-6)
    assert re.search(r"load\.pressure .* none .* no change", str(result))
    # The error is that of the quotient: deformable blocks may have another sign.
    assert "deformable" in str(result)


@pytest.mark.parametrize(
    ("value", "error", "words"),
    [
        (23.998, 2e-6, "23.998 ± 8e-06 %"),
        (23.998, 0.02, "23.998 ± 0.020"),
        (23.998, 127.0, "24 ± 127"),
        (1.2345e-8, 2e-11, "1.2345e-08 ± 2e-11"),
        (None, 127.0, "none"),
        (0.0, 0.0, "none"),
    ],
)
def test_a_derivative_has_the_digits_that_its_error_leaves(value, error, words) -> None:
    assert _with_error(value, error) == words


@given(
    x=st.floats(0.0, 0.99), slope=st.floats(-3.0, 3.0), bend=st.floats(0.1, 3.0), far=st.booleans()
)
@settings(max_examples=50, deadline=None)
def test_a_jump_leaves_no_derivative_and_a_kink_is_in_its_error(x, slope, bend, far) -> None:
    """Parabola; with a step of 10 between two samples; with a kink where the parameter stands."""

    def rough(extra: Any) -> float:
        at = [slope * y + bend * y * y + extra(y) for y in (-0.2, -0.1, 0.0, 0.1, 0.2)]
        return _roughness(*at, step=0.1)

    assert rough(lambda _: 0.0) == 0.0
    assert rough(lambda y: 10.0 * (y > 0.1 * x)) == math.inf
    kink = 20.0 if far else -20.0
    assert rough(lambda y: kink * abs(y)) == pytest.approx(abs(kink + 0.1 * bend), rel=1e-9)


def test_whole_numbers_and_half_waves_go_by_whole_steps() -> None:
    """Quotients are those of the answers beside; 2 f stays whole."""
    result = sensitivity(
        "tsb1-pipe", COARSE, parameters=["block.blocks_per_layer", "block.frequency"]
    )
    steps = {s.parameter: s for s in result.slopes if s.measure == "p_eff"}
    assert steps["block.blocks_per_layer"].step == 1.0
    assert steps["block.frequency"].step == 0.5
    rows = sweep("tsb1-pipe", {"block.blocks_per_layer": [3, 5]}, COARSE).rows
    central = (rows[1]["p_eff"] - rows[0]["p_eff"]) / 2
    assert steps["block.blocks_per_layer"].derivative == pytest.approx(central, rel=1e-6)


def test_derivatives_go_on_from_the_rows_that_are_left(tmp_path: Path) -> None:
    """Those of half of the rows are those of a call by itself; a third call computes nothing."""
    store = tmp_path / "rows.jsonl"
    parameters = ["block.amplitude", "block.blocks_per_layer"]
    first = sensitivity("tsb1-pipe", COARSE, parameters=parameters, store=store)
    lines = store.read_bytes().splitlines(keepends=True)
    assert len(lines) == 1 + 4 + 2  # as stated, two steps to both sides, one whole step
    store.write_bytes(b"".join(lines[::2]) + lines[1][:40])
    for _ in range(2):
        again = sensitivity("tsb1-pipe", COARSE, parameters=parameters, store=store)
        assert again == first
        assert len(store.read_bytes().splitlines()) == len(lines) + 1  # a line was cut


def test_a_limit_that_leaves_one_mesh_leaves_no_derivative() -> None:
    """Between those of a coarse and of a fine mesh lies what they differ by, not a derivative."""
    one = {"assembly.layers": 1, "mesh.around": 12, "fem.max_work": 0.1}
    with pytest.raises(InputError, match=r"tsb1-pipe: mesh 2 is not solved: the limit of work"):
        sensitivity("tsb1-pipe", one, method="fem", parameters=["block.blocks_per_layer"])


@pytest.mark.slow
def test_a_search_of_all_designs_finds_the_best_and_goes_on(tmp_path: Path) -> None:
    """The best is that of the study of all; a second call computes nothing again."""
    rows = sweep("tsb1-pipe", VARIABLES, COARSE).rows
    best = min(rows, key=lambda row: row["p_max"])
    store = tmp_path / "search.jsonl"
    first, second = (optimise(stated(), store) for _ in range(2))
    assert {path: first.best[0][path] for path in VARIABLES} == {p: best[p] for p in VARIABLES}
    assert first.best[0]["p_max"] == pytest.approx(best["p_max"], rel=1e-9)
    assert len(second.rows) == 6
    assert {r["cpu_seconds"] for r in second.rows} == {r["cpu_seconds"] for r in first.rows}
    assert "6 designs computed, 6 within the limits, 0 failed" in repr(second)
    assert "best of those judged: " in repr(second)
    ends = {path: best[path] for path, v in VARIABLES.items() if best[path] in (v[0], v[-1])}
    assert all(f"{path} = {value:g}" in repr(second) for path, value in ends.items())
    worst = max(rows, key=lambda row: row["p_max"])
    ordered = {tuple(row[path] for path in VARIABLES) for row in first.judged}
    assert ordered == {tuple(row[path] for path in VARIABLES) for row in (best, worst)}
    second.draw(str(tmp_path / "search.png"))
    assert (tmp_path / "search.png").stat().st_size > 1000
    assert [row["p_max"] for row in first.judged] == sorted(row["p_max"] for row in first.judged)


def test_a_rigid_search_is_judged_by_deformable_blocks_unless_these_have_no_such_measure() -> None:
    asked = {key: value for key, value in stated().items() if key != "judge"}
    by_default = check_optimisation(asked)
    assert by_default.judge is not None
    assert by_default.judge.quantity == "fem"
    assert check_optimisation(asked | {"minimise": "effective_area_percent"}).judge is None


def test_a_limit_that_no_design_meets_names_the_nearest() -> None:
    """The nearest value is that of a design."""
    with pytest.raises(InputError, match=r"none of 6 designs meets volume at most 1000; the near"):
        optimise(stated(limits={"volume": {"most": 1000.0}}))


def test_designs_that_cannot_be_built_do_not_end_a_search() -> None:
    """They are rows with their message."""
    some = VARIABLES | {"block.frequency": [1.5, 1.3]}
    result = optimise(stated(variables=some, evaluations=12))
    failed = [row for row in result.rows if row["status"] == "failed"]
    assert len(failed) == 6
    assert all("2 f whole" in row["message"] for row in failed)
    assert result.best[0]["block.frequency"] == 1.5


def test_the_front_of_two_measures_is_that_of_all_points() -> None:
    """No design of the front is beaten in both measures, and every other one is."""
    search = Search(check_optimisation(stated(minimise=["p_max", "p_eff"])))
    for k, number in enumerate(search.numbers()):
        values = {"p_max": float((3 * k) % 7), "p_eff": float((5 * k) % 7)}
        search.take({"number": number, "status": "ok", "message": "", **values})
    points = {p.scores(search.stated.measures): p for p in search.points.values()}
    best = {p.scores(search.stated.measures) for p in search.best}
    for mine, other in product(points, points):
        assert mine is not None
        assert other is not None
        if mine in best and other != mine:
            assert not all(o <= m for o, m in zip(other, mine, strict=True))


@pytest.mark.parametrize(("measures", "count"), [(["p_max"], 2), (["p_max", "p_eff"], 3)])
def test_finalists_are_the_best_and_reach_from_end_to_end(measures: list[str], count: int) -> None:
    """Of one measure the least ones and the worst; of two, both ends of the front are judged."""
    judge = {"count": count, "settings": {"fem.mesh": "scene", "fem.error_estimate": False}}
    search = Search(check_optimisation(stated(minimise=measures, judge=judge)))
    for k, number in enumerate(search.numbers()):
        # Six designs on a falling line: all are a front of two measures.
        values = {"p_max": float(k), "p_eff": float(-k)}
        search.take({"number": number, "status": "ok", "message": "", **values})
    values = [p.row["p_max"] for p in search.finalists]
    assert values == ([0.0, 1.0, 5.0] if len(measures) == 1 else [0.0, 2.0, 5.0])


def test_the_worst_case_of_a_design_counts_with_its_own_error() -> None:
    """Largest pressure, least load factor; a missing one leaves none."""
    rows = [
        {"status": "ok", "message": "", "p_max": p, "p_max_error": e, "cracking_factor": c}
        for p, e, c in ((1.0, 0.5, 4.0), (2.0, 0.1, 3.0))
    ]
    worst = worst_of(rows)
    assert (worst["p_max"], worst["p_max_error"], worst["cracking_factor"]) == (2.0, 0.1, 3.0)
    rows[1]["p_max"] = None
    assert worst_of(rows)["p_max"] is None
