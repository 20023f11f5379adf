"""Work and precision: the laws of fronts, orders and caches, and the command."""

from __future__ import annotations

import json
import re
from copy import deepcopy
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fem import ElementType
from geometry import Assembly
from mbd import Norm
from validation import Case, InputError, load_case
from validation.study.costs import measure as costs_measure
from validation.study.costs import study as cost
from validation.study.costs.analysis import (
    Point,
    cheapest,
    fitted_order,
    observed_order,
    pareto_front,
    richardson,
)
from validation.study.costs.measure import measure
from validation.study.costs.partition import grid_of, overlap, partition_pressures
from validation.study.costs.plan import (
    QUANTITIES,
    CostPlan,
    by_degree,
    curved_rungs,
    extrapolated,
    full_plan,
    quick_plan,
)
from validation.study.costs.settings import (
    BaseMesh,
    CostSetting,
    base_mesh,
    curved_setting,
    degree_setting,
    graded,
    rigid_setting,
    static_setting,
    with_setting,
)
from validation.study.costs.study import setting_study
from validation.study.rowfile import RowFile

SETTINGS = ("--set", "assembly.layers=1")


def tube(*settings: str) -> Any:
    """Scene of a short tube."""
    return load_case("tsb1-pipe", ["assembly.layers=1", *settings]).scene


#: A small scene of every other family whose blocks meet and refine.
OTHERS = {
    "thb0-tunnel": ("assembly.layers=1",),
    "planar-sine": ("assembly.columns=1", "assembly.layers=1"),
    "osteomorphic": ("assembly.columns=1", "assembly.layers=1"),
    "brick-stack": (),
}


def other(name: str) -> Any:
    """Scene of another family."""
    return load_case(name, OTHERS[name]).scene


def case_of(scene: Any) -> Case:
    """Case of a scene that was changed."""
    return Case(name="a", stated=scene, method=scene.method)


def built(scene: Any, setting: CostSetting) -> Assembly:
    """Blocks of a scene on the mesh of a setting."""
    solved = with_setting(scene, base_mesh(scene, "a"), setting)
    return case_of(solved).with_method("rigid").problem.blocks


# ---------------------------------------------------------------------------------------------
# Extrapolation and orders on numbers whose limit is known


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0, 3.7])
@pytest.mark.parametrize("levels", [(1, 2, 4), (3, 4, 6, 7)])
def test_extrapolation_is_exact_for_one_power(order: float, levels: tuple[int, ...]) -> None:
    limit, slope = np.array([2.0, -1.0]), np.array([0.3, 0.8])
    values = [limit + slope * k**-order for k in levels]
    found = richardson(levels, values)
    # The order solves one equation with differences of 1e-3 and more: round-off 1e-16 / 1e-3.
    assert found.order == pytest.approx(order, rel=1e-10)
    np.testing.assert_allclose(found.value, limit, atol=1e-11)


@pytest.mark.parametrize("second", [-0.3, 0.3])
def test_estimated_error_covers_a_second_power(second: float) -> None:
    # v = 1 + h² + c h³: fitting one power leaves a third-order rest, which drops by (4/7)³ and
    # more from the extrapolation of (3, 4, 6) to that of (4, 6, 7): their difference covers it.
    levels = (3, 4, 6, 7)
    values = [np.array([1.0 + k**-2 + second * k**-3]) for k in levels]
    found = richardson(levels, values)
    assert abs(found.value[0] - 1.0) <= found.error < abs(values[-1][0] - 1.0)


@pytest.mark.parametrize("values", [(1.0, 2.0, 1.5), (1.0, 1.1, 1.3), (1.0, 2.0, 2.0)])
def test_levels_without_an_order_are_not_extrapolated(values: tuple[float, ...]) -> None:
    found = richardson((1, 2, 4), [np.array([v]) for v in values])
    assert found.order is None
    assert found.value[0] == values[-1]
    assert found.error == max(abs(v - values[-1]) for v in values)


def test_order_does_not_depend_on_units() -> None:
    values = [np.array([1.0 + 0.7 * k**-1.5]) for k in (2, 3, 5)]
    weights = np.ones(1)
    one = observed_order((2, 3, 5), values, weights)
    other = observed_order((2, 3, 5), [1e6 * v for v in values], 1e3 * weights)
    assert one == pytest.approx(1.5, rel=1e-10)
    assert other == pytest.approx(1.5, rel=1e-10)


def test_levels_must_ascend_and_be_three() -> None:
    with pytest.raises(ValueError, match="three or more"):
        richardson((1, 2), [np.ones(1)] * 2)
    with pytest.raises(ValueError, match="ascending"):
        richardson((1, 3, 2), [np.ones(1)] * 3)


def test_fitted_order_is_the_slope_above_the_floor() -> None:
    levels = (1, 2, 4, 8)
    errors = [0.5 * k**-2 for k in levels]
    assert fitted_order(levels, errors, floor=0.0) == pytest.approx(2.0, rel=1e-12)
    # What the reference cannot resolve does not bend the slope.
    flat = [*errors[:3], errors[2]]
    assert fitted_order(levels, flat, floor=0.6 * errors[2]) == pytest.approx(2.0, rel=1e-12)
    assert fitted_order(levels, errors, floor=0.1) is None


# ---------------------------------------------------------------------------------------------
# Fronts


def beats(a: Point, b: Point) -> bool:
    no_worse = a.cost <= b.cost and a.error <= b.error
    return no_worse and (a.cost < b.cost or a.error < b.error)


@pytest.mark.parametrize("seed", range(5))
def test_pareto_front_laws(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Few distinct values, so that ties occur.
    points = [Point(float(a), float(b)) for a, b in rng.integers(1, 9, (40, 2))]
    front = pareto_front(points)
    assert not any(beats(p, points[i]) for p in points for i in front)
    chosen = {points[i] for i in front}
    left = [p for p in points if p not in chosen]
    assert all(any(beats(points[i], p) for i in front) for p in left)
    assert all(
        points[a].cost < points[b].cost and points[a].error > points[b].error
        for a, b in pairwise(front)
    )
    order = rng.permutation(len(points))
    again = pareto_front([points[i] for i in order])
    assert [points[order[i]] for i in again] == [points[i] for i in front]
    assert [left[i] for i in pareto_front(left)] != [points[i] for i in front]


def test_a_small_error_by_luck_is_not_an_answer() -> None:
    # The first family passes through zero error at its second mesh.
    points = [Point(1, 0.3), Point(2, 0.001), Point(4, 0.05), Point(9, 0.004), Point(20, 0.005)]
    finer: list[list[int]] = [[1, 2], [2], [], [4], []]
    assert cheapest(points, finer, 0.01, reference_error=0.0) == 3
    assert cheapest(points, finer, 0.06, reference_error=0.0) == 1
    assert cheapest(points, finer, 0.01, reference_error=0.0055) is None


def test_a_lone_mesh_is_as_reliable_as_the_family_it_varies() -> None:
    plain = [static_setting(ElementType.INCOMPATIBLE, k) for k in (2, 4)]
    lone = replace(plain[0], family=f"{plain[0].family}, varied")
    two = [graded(setting) for setting in plain]
    nothing: dict[str, object] = {}
    rows = [cost.CostRow(setting, nothing, {}) for setting in (*plain, lone, *two)]
    assert cost.finer_meshes(rows) == [[1], [], [1], [4], []]


# ---------------------------------------------------------------------------------------------
# The common partition


@pytest.mark.parametrize(("n_from", "n_to"), [(3, 2), (2, 3), (4, 4), (12, 24), (36, 24)])
def test_every_interval_is_shared_out_whole(n_from: int, n_to: int) -> None:
    # Each entry is a difference of quotients below 1, times n ≤ 36: round-off 36 · 1e-16.
    shares = overlap(np.linspace(0, 1, n_from + 1), np.linspace(0, 1, n_to + 1))
    np.testing.assert_allclose(shares.sum(axis=0), 1.0, rtol=1e-13)
    np.testing.assert_allclose(shares.sum(axis=1), n_from / n_to, rtol=1e-13)


def check_partition(scene: Any, level: int, grading: float = 1.0) -> int:
    """Forces and uniform pressures stay what they are; number of cells."""
    setting = replace(rigid_setting(Norm.FORCE, level), radial_grading=grading)
    assembly = built(scene, setting)
    cells = built(scene, rigid_setting(Norm.FORCE, 2))
    found = assembly.interfaces
    # Contacts of two frame blocks are left out.
    free = ~(assembly.fixed[found.block_m] & assembly.fixed[found.block_s])
    contacts = np.flatnonzero(free)
    pressures = np.random.default_rng(level).uniform(0, 1, len(contacts))
    rows = None
    if grading != 1.0:
        radii = np.unique(np.hypot(*assembly.shape(0).mesh.nodes[:, :2].T).round(9))
        rows = (radii - radii[0]) / (radii[-1] - radii[0])
    p, area = partition_pressures(assembly, contacts, pressures, cells, level=level, across=rows)
    assert p @ area == pytest.approx(pressures @ found.areas[contacts], rel=1e-12)
    assert area.sum() == pytest.approx(found.areas[contacts].sum(), rel=1e-12)
    ones, _ = partition_pressures(
        assembly, contacts, np.ones(len(contacts)), cells, level=level, across=rows
    )
    np.testing.assert_allclose(ones, 1.0, rtol=1e-12)
    return len(p)


@pytest.mark.parametrize(("level", "grading"), [(1, 1.0), (2, 1.0), (3, 1.0), (3, 8.0)])
def test_partition_keeps_forces_and_uniform_pressures(level: int, grading: float) -> None:
    # Four blocks: two wavy layers of interfaces and the sides, 2 × 24 cells and 2 × 4 each.
    assert check_partition(tube(), level, grading) == 4 * (2 * 48 + 8)


@pytest.mark.parametrize("name", OTHERS)
def test_partition_is_the_same_for_all_meshes_of_a_family(name: str) -> None:
    scene = other(name)
    assert len({check_partition(scene, level) for level in (1, 2, 3)}) == 1


@pytest.mark.parametrize("name", OTHERS)
def test_a_field_that_varies_along_a_face_lies_alike_on_all_meshes(name: str) -> None:
    """Facets run in one order on all meshes: pressures of one place meet in one cell.

    A pressure linear in space has on a cell the mean of its facets; facets of curved faces are
    flat, and their centroids lie off by at most their size squared over a radius.
    """
    scene = other(name)
    cells = built(scene, rigid_setting(Norm.FORCE, 2))
    found = []
    for level in (2, 6):
        assembly = built(scene, rigid_setting(Norm.FORCE, level))
        contacts = np.arange(assembly.interfaces.n_contacts)
        linear = assembly.interfaces.centroids @ np.array([1.0, 2.0, 3.0])
        found.append(partition_pressures(assembly, contacts, linear, cells, level=level)[0])
    size = float(np.sqrt(cells.interfaces.areas.max()))
    assert np.abs(found[0] - found[1]).max() < 0.5 * size
    assert np.ptp(found[0]) > 10.0 * size


def test_grid_of_facets_row_by_row() -> None:
    node = np.arange(4 * 6).reshape(4, 6)
    quads = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    assert grid_of(quads.reshape(-1, 4)) == (3, 5)


@pytest.mark.parametrize("frequency", [1.0, 1.5, 2.0, 2.5])
@pytest.mark.parametrize("blocks", [2, 4, 9])
def test_every_level_of_the_base_mesh_conforms(frequency: float, blocks: int) -> None:
    scene = tube(f"block.frequency={frequency}", f"block.blocks_per_layer={blocks}")
    for level in (1, 2):
        assert built(scene, rigid_setting(Norm.FORCE, level)).interfaces.n_contacts > 0


# ---------------------------------------------------------------------------------------------
# Cache


def question(scene: Any, base: BaseMesh, setting: CostSetting) -> str:
    """Digest of what a measurement asks."""
    return setting_study("a", scene, base, [setting]).question(0)


def small_plan(scene: Any) -> CostPlan:
    settings = (
        rigid_setting(Norm.PRESSURE, 1),
        static_setting(ElementType.INCOMPATIBLE, 1),
        static_setting(ElementType.INCOMPATIBLE, 2),
    )
    base = base_mesh(scene, "a")
    return CostPlan(base, settings, extrapolated(base, (1, 2, 3)))


#: What was measured, by the type of the scene; its tests ask for one scene of each.
_MEASURED: dict[tuple[type, CostSetting], dict[str, Any]] = {}


def once(name: str, scene: Any, base: BaseMesh, setting: CostSetting) -> dict[str, Any]:
    """`measure`, explicit runs once; what a test has measured serves the others.

    The first of all runs compiles: of two the cheaper counts.
    """
    key = (type(scene), setting)
    if key not in _MEASURED:
        repeats = 1 if setting.method == "explicit" else 2
        _MEASURED[key] = measure(name, scene, base, setting, repeats=repeats)
    return deepcopy(_MEASURED[key])


@pytest.fixture
def measured_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost, "measure", once)
    monkeypatch.setattr(cost, "warm_up", lambda *_: None)  # for times, which nothing here compares


def test_hit_gives_the_same_bits_and_no_new_run(tmp_path, monkeypatch, measured_once) -> None:
    scene, store = tube(), tmp_path / "cost.jsonl"
    plan = small_plan(scene)
    first = cost.run_cost("a", scene, plan, store)
    # Two of the three reference meshes are among the settings, the three graded ones are not.
    assert len(RowFile(store)) == 7

    def no_run(*arguments: object) -> None:
        raise AssertionError("a new run")

    monkeypatch.setattr(cost, "measure", no_run)
    monkeypatch.setattr(cost, "warm_up", no_run)
    second = cost.run_cost("a", scene, plan, store)
    assert second.rows == first.rows
    assert second.reference_errors == first.reference_errors
    for quantity in QUANTITIES:
        one, other = first.reference[quantity].value, second.reference[quantity].value
        assert one.tobytes() == other.tobytes()
    # What the study says follows from it: rigid blocks err by their model, meshes converge.
    finest = first.families()["static C3D8I"]
    assert finest[1].errors["max_displacement"] < finest[0].errors["max_displacement"]
    assert first.best("pressure_l2").setting.method == "static"
    # A scene that cost has measured is answered without any run.
    quantity, target = (
        "max_displacement",
        1.01 * (finest[1].errors["max_displacement"] + first.reference_errors["max_displacement"]),
    )
    chosen = first.choose(quantity, target)
    assert chosen is not None
    assert chosen.errors[quantity] <= target


def test_rungs_of_curved_elements_are_judged_by_the_finest(
    tmp_path, monkeypatch, measured_once
) -> None:
    """Two tiny rungs: the reference is the last, its error 1.5 times the change from the first."""
    ladder = costs_measure.LADDER
    tiny = replace(ladder[0], degree=2, along=12, across=1, across_grading=1.0, upward_grading=8.0)
    rungs = tuple(replace(tiny, upward=axial) for axial in (2, 4))
    monkeypatch.setattr(costs_measure, "LADDER", rungs)
    scene, store = tube(), tmp_path / "cost.jsonl"
    settings = (rigid_setting(Norm.PRESSURE, 1), curved_setting(1), curved_setting(2))
    plan = CostPlan(base_mesh(scene, "a"), settings, curved_rungs(1, 2))
    found = cost.run_cost("a", scene, plan, store)
    first, second = found.families()["static curved"]
    assert set(second.errors) == set(QUANTITIES)
    assert all(error == 0.0 for error in second.errors.values())
    for quantity, error in first.errors.items():
        assert found.reference_errors[quantity] == pytest.approx(1.5 * error, rel=1e-12)


def test_the_reference_is_curved_where_a_run_climbs_so_far() -> None:
    assert "curved" in full_plan("a", tube()).judges[-1].words
    # A wall has no blocks that are alike: fine meshes take too long.
    wall = load_case("planar-sine").scene
    assert "curved" not in full_plan("a", wall).judges[-1].words


@pytest.mark.parametrize("name", ["thb0-tunnel", "planar-sine"])
def test_other_families_are_measured_and_say_what_is_left_out(
    name, tmp_path, measured_once
) -> None:
    """Without a grading the reference of every quantity is extrapolated from plain meshes."""
    scene, store = other(name), tmp_path / "cost.jsonl"
    left_out = dict(full_plan("a", scene).left_out).keys()
    assert "graded meshes" in left_out
    assert ("mesh sequence of `fem --accuracy`" in left_out) == (name == "thb0-tunnel")
    plan = small_plan(scene)
    assert len(plan.judges) == 1
    found = cost.run_cost("a", scene, plan, store)
    assert not found.failures
    coarse, fine = found.families()["static C3D8I"]
    assert set(fine.errors) == set(QUANTITIES)
    assert fine.errors["pressure_l2"] < coarse.errors["pressure_l2"]
    assert set(found.families()["rigid, pressure norm"][0].errors) == {"p_eff", "pressure_l2"}
    assert all(row.measured["processor"] and row.measured["date"] for row in found.rows)


def test_degrees_judge_points_and_fields_where_there_is_no_ladder(tmp_path, measured_once) -> None:
    """Of two degrees the higher is right, to 1.5 times the change; means over facets are not its.

    Trilinear blocks of the same mesh are further from it than it is uncertain.
    """
    scene, store = other("planar-sine"), tmp_path / "cost.jsonl"
    plan = small_plan(scene)
    plan = replace(
        plan,
        settings=(*plan.settings, degree_setting(2, 1)),
        judges=(*plan.judges, by_degree(1, (2, 3))),
    )
    found = cost.run_cost("a", scene, plan, store)
    (second,) = found.families()["static degree 2"]
    trilinear = found.families()["static C3D8I"][0]
    for quantity in set(QUANTITIES) - {"p_eff"}:
        assert found.reference[quantity].order is None
        unsure = found.reference_errors[quantity]
        assert unsure == pytest.approx(1.5 * second.errors[quantity], rel=1e-12)
        assert trilinear.errors[quantity] > unsure


@pytest.mark.thorough
def test_killed_run_resumes_where_it_was(tmp_path, monkeypatch, measured_once) -> None:
    scene, store = tube(), tmp_path / "cost.jsonl"
    plan = small_plan(scene)
    done: list[str] = []

    def counted(name, scene, base, setting):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(setting.name)
        return once(name, scene, base, setting)

    with monkeypatch.context() as patch:
        patch.setattr(cost, "measure", counted)
        with pytest.raises(KeyboardInterrupt):
            cost.run_cost("a", scene, plan, store)
    assert len(RowFile(store)) == 2
    again: list[str] = []

    def told(number: int, total: int, what: str) -> None:
        again.append(what)

    cost.run_cost("a", scene, plan, store, progress=told)
    assert len(again) == 5
    assert not set(again) & set(done)


def test_a_setting_without_an_answer_is_told_and_the_rest_stands(tmp_path, monkeypatch) -> None:
    scene, store = tube(), tmp_path / "cost.jsonl"
    plan = small_plan(scene)

    def broken(name, scene, base, setting):
        if setting.method == "rigid":
            raise InputError("went unstable")
        return once(name, scene, base, setting)

    monkeypatch.setattr(cost, "measure", broken)
    found = cost.run_cost("a", scene, plan, store)
    assert found.failures == {plan.settings[0].name: "went unstable"}
    assert [row.setting for row in found.rows] == list(plan.settings[1:])


def test_a_setting_beyond_the_limit_of_work_is_told_and_the_rest_stands(
    tmp_path, monkeypatch
) -> None:
    scene, store = tube("fem.max_work=0.3"), tmp_path / "cost.jsonl"
    plan, dear = small_plan(scene), curved_setting(3)

    def kept(name, scene, base, setting):
        return (measure if setting == dear else once)(name, scene, base, setting)

    monkeypatch.setattr(cost, "measure", kept)
    found = cost.run_cost("a", scene, replace(plan, settings=(*plan.settings, dear)), store)
    assert "the limit of work" in found.failures.pop(dear.name)
    assert not found.failures
    assert [row.setting for row in found.rows] == list(plan.settings)


def test_key_is_the_content(tmp_path) -> None:
    scene = tube()
    setting = static_setting(ElementType.FULL, 2)
    base = base_mesh(scene, "a")
    key = question(scene, base, setting)
    # The mesh of the scene is what cost varies; a family's name is only a name.
    same = [
        question(tube("mesh.around=24"), base, setting),
        question(scene, base, replace(setting, family="another name")),
    ]
    other = [
        question(tube("load.pressure=0.02"), base, setting),
        question(tube("material.poisson_ratio=0.3"), base, setting),
        question(tube("contact.clearance=0.01"), base, setting),
        question(scene, base, replace(setting, level=3)),
        question(scene, base, static_setting(ElementType.B_BAR, 2)),
        question(scene, base, replace(setting, ramp_factor=2.0)),
        question(scene, base, graded(setting)),
    ]
    assert set(same) == {key}
    assert len({key, *other}) == 1 + len(other)
    for plan in (full_plan("a", scene), quick_plan("a", scene)):
        runs = {*plan.settings, *plan.references}
        assert len({question(scene, base, s) for s in runs}) == len(runs)


# ---------------------------------------------------------------------------------------------
# Command


@pytest.mark.slow
def test_quick_command(tubelock, measured_once) -> None:
    status, out, _ = tubelock(
        "cost", "tsb1-pipe", *SETTINGS, "--quick", "-o", "run", "--json", "cost.json"
    )
    assert status == 0
    # Which of two methods is cheaper on one mesh is noise; that one of them keeps it is not.
    # Which of them is cheapest depends on the clock.
    assert re.search(r"10 % in max_displacement: \w+ C3D8\w?, mesh ×[\d./]+, [\d.e-]+ CPU s", out)
    assert Path("run/cost.png").stat().st_size > 10_000
    data = json.loads(Path("cost.json").read_text())
    assert len(data["settings"]) == 10
    assert all(s["cpu_seconds"][0] > 0 for s in data["settings"])
    assert set(data["pareto"]["max_displacement"]) <= {s["name"] for s in data["settings"]}
    assert data["pareto"]["max_displacement"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["cost", "cantilever"], "whose blocks meet"),
        (["cost", "tetrahedra"], "whose blocks meet"),
        (["cost", "column"], "mesh of its own"),
        (["cost", "wall"], "whose blocks meet"),
        (["cost", "tsb1-pipe", "--set", "effects.finite_sliding=true"], "remove finite_sliding"),
        (["cost", "tsb1-pipe", "--set", "effects.friction.coefficient=0.1"], "remove friction"),
        (["cost", "tsb1-pipe", "--set", "effects.elastic_frame=true"], "elastic_frame"),
    ],
)
def test_bad_input_gives_one_line(tubelock, arguments, message) -> None:
    status, out, err = tubelock(*arguments)
    assert status == 2
    assert out == ""
    assert err.count("\n") == 1
    assert message in err
    assert not list(Path().iterdir())
