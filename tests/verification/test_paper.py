"""The paper's study, figures, claims and errata: the judging, the data, the pictures."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.support.coarse_tubes import coarse
from tests.verification.evidence import (
    CoarseEvidence,
    coarse_evidence,
    picture_is_drawn,
    synthetic_study,
)
from validation import InputError, load_case, solve
from validation.paper.claims.judge import claims, judge_claims
from validation.paper.errata import ERRATA, show_errata
from validation.paper.evidence import PaperEvidence, StudyTable
from validation.paper.reading import INGREDIENTS, SharedTubes, reading_variants, to_the_digit
from validation.paper.tables import compute_tables
from validation.paper.verdict import Truth

# ---------------------------------------------------------------------------------------------
# Parameter study


def test_steps_of_one_parameter_are_counted_once() -> None:
    """4 values of a: 3 steps in each of 120 curves; 5 of n: 4 in 96; 2 of s: 1 in 240."""
    study = synthetic_study()
    assert [len(study.pairs(axis)) for axis in range(5)] == [240, 320, 384, 360, 360]
    assert all(before[4] < after[4] and before[:4] == after[:4] for before, after in study.pairs(4))


@pytest.mark.parametrize(
    ("name", "spoiled", "number"),
    [
        ("falls-with-amplitude", {"f1n2t30a15": 2.0}, "358 of 360"),
        ("falls-with-thickness", {"f1n2t40a10": 2.0}, "358 of 360"),
        ("flattens", {"f1n2t30a20": 0.6}, "of 240 pairs"),
        ("fewer-larger-example", {"f2n2t30a10": 9.0}, "not for every a and t"),
        ("fewer-larger", {"f2n2t30a10": 9.0}, "of 160 pairs"),
        ("thick-depends-less", {"f1n6t60a10": 99.0}, "t = 60"),
    ],
)
def test_claims_of_the_study_follow_the_numbers(tmp_path, name, spoiled, number) -> None:
    """True of p = n/(f a t); one changed value (in both s) makes each claim false."""
    right = judge_claims(coarse_evidence(tmp_path), [name])[0]
    wrong = judge_claims(coarse_evidence(tmp_path, synthetic_study(**spoiled)), [name])[0]
    assert (right["verdict"], wrong["verdict"]) == (Truth.TRUE, Truth.FALSE)
    assert number in wrong["number"]


def test_s_a_half_lower_is_judged_by_count(tmp_path) -> None:
    verdict = judge_claims(coarse_evidence(tmp_path), ["cosine-lower"])[0]
    assert verdict["verdict"] == Truth.TRUE
    assert verdict["values"]["lower"] == 240
    assert verdict["values"]["mean_ratio"] == pytest.approx(0.995, rel=1e-12)


def test_claims_that_the_turn_decides_say_so(tmp_path) -> None:
    """Designs of f = 2 that are better with the other turn, s = 0.5 worse: both are named."""
    evidence = coarse_evidence(tmp_path)
    rows = {k: dict(row) for k, row in evidence.study.rows.items()}
    for key, row in rows.items():
        if key[0] == 0.5:
            row["p_max"] *= 1.5
    evidence.__dict__["half_block"] = StudyTable(rows, evidence.study.axes, evidence.study.mesh)
    lower, falls = judge_claims(evidence, ["cosine-lower", "flattens"])
    assert lower["verdict"] == Truth.TRUE
    assert lower["values"]["half_block"]["verdict"] == "false"
    assert "one wave; with half a block false: lower in 0 of 240" in lower["number"]
    assert falls["values"]["half_block"]["verdict"] == falls["verdict"]
    assert "one wave" not in falls["number"]


# ---------------------------------------------------------------------------------------------
# The reading of the tables


@pytest.mark.parametrize(
    ("quantity", "printed", "value", "met"),
    [
        ("effective", 32.0, 32.049, True),
        ("effective", 32.0, 32.051, False),
        ("p_max", 0.23, 0.2295, True),
        ("p_max", 0.23, 0.2294, False),
        ("p_eff", 0.011, None, False),
    ],
)
def test_to_the_digit_is_to_the_printed_digit(quantity, printed, value, met) -> None:
    """Trailing zeros are printed too: 0.230 is three digits, not two."""
    assert to_the_digit(quantity, printed, value) is met


def test_every_printed_number_has_its_row_and_both_readings(tmp_path) -> None:
    data = compute_tables(coarse_evidence(tmp_path).rigid)
    assert (data["of"], len(data["rows"]), len(data["classes"])) == (33, 33, 15)
    assert data["to_the_digit"] == sum(row["to_the_digit"] for row in data["rows"])
    for row in data["rows"]:
        assert row["relative_difference"] == pytest.approx(row["ours"] / row["paper"] - 1)
        # The readings differ where they say: p_eff everywhere, all of shaft.
        if row["case"] != "shaft" and row["quantity"] != "p_eff":
            assert row["physical"] == row["ours"]
    found = {(row["block"], row["case"], row["quantity"]): row for row in data["rows"]}
    shaft = found["TSB1", "shaft", "p_max"]
    assert shaft["physical"] > 1.2 * shaft["ours"]


def test_tubes_that_are_built_once_give_the_results_of_each_scene() -> None:
    tubes = SharedTubes()
    mesh = list(coarse(2, 4, 2))
    found = []
    for scene, more in (("tsb1-pipe", []), ("tsb1-shaft", []), ("tsb1-pipe", ["block.shift=0.5"])):
        file = load_case(scene, [*mesh, *more])
        shared, alone = tubes.solve(scene, *mesh, *more), solve(file.with_method("rigid"))
        assert (shared.case.name, shared.case.scene) == (alone.case.name, alone.case.scene)
        np.testing.assert_array_equal(
            shared.details.contact_pressures, alone.details.contact_pressures
        )
        found.append(shared.details.blocks)
    pipe, shaft, shifted = found
    assert pipe is shaft is not shifted


def test_each_ingredient_moves_what_it_says(tmp_path) -> None:
    solve = coarse_evidence(tmp_path).rigid
    whole, *without = reading_variants(solve)
    assert whole.of == 33
    moved = {item.ingredient: set(item.moved(whole)) for item in without}
    assert set(moved) == set(INGREDIENTS)
    parts = {name: {place.split()[2] for place in places} for name, places in moved.items()}
    assert parts["pooled-p-eff"] == {"p_eff"}
    assert parts["counted-elements"] == parts["not-rounded-down"] == {"effective"}
    for name in ("beam-pressure", "shaft-force", "shaft-point"):
        case = name.partition("-")[0]
        assert {place.split()[1] for place in moved[name]} == {case}
        assert len(moved[name]) >= 4
    assert {place.split()[0] for place in moved["tsb2-wave"]} == {"TSB2"}
    # One tube upside down: no load that knows no direction feels it.
    assert not {p for p in moved["tsb2-wave"] if p.split()[1] in ("pipe", "tunnel")}


# ---------------------------------------------------------------------------------------------
# Claims


def test_there_are_enough_claims_and_every_one_says_where_it_stands() -> None:
    found = claims()
    assert len(found) >= 20
    assert len({claim.name for claim in found}) == len(found)
    assert all(claim.text["statement"] and claim.text["place"] for claim in found)
    with pytest.raises(InputError, match="expected one of locked"):
        judge_claims(PaperEvidence(Path()), ["lockd"])


def test_claims_of_rigid_blocks_are_decided(tmp_path) -> None:
    """What does not depend on the mesh must come out as it does on the fine one."""
    evidence = coarse_evidence(tmp_path)
    found = {row["name"]: row for row in judge_claims(evidence)}
    for name in (
        "length",
        "tsb2-preferable",
        "blocks-alike",
        "no-explosion",
        "axially-open",
        "hexagon-classes",
        "speed-up-printed",
    ):
        assert found[name]["verdict"] == Truth.TRUE, (name, found[name]["number"])
    for name in ("saturates", "thickness-minor", "area-pipe-true"):
        assert found[name]["verdict"] == Truth.FALSE, (name, found[name]["number"])
    needing = {claim.name for claim in claims() if claim.deformable}
    assert all(found[name]["verdict"] == Truth.NOT_COMPUTED for name in needing)
    # What was not run is no fault of the paper: only what it leaves open is not decidable.
    assert found["favourable"]["verdict"] == Truth.UNDECIDABLE
    assert all("--fem" in found[name]["number"] for name in needing)


@pytest.fixture(scope="module")
def deformable_evidence(tmp_path_factory) -> CoarseEvidence:
    """Deformable runs on 12 × 2 × 4 elements per block, kept for all tests."""
    return coarse_evidence(tmp_path_factory.mktemp("fem"), deformable=True)


@pytest.mark.slow
def test_symmetries_of_deformable_tubes_hold_on_any_mesh(deformable_evidence) -> None:
    names = ["half-turn", "mirror", "four-alike", "layers-repeat", "peaks-found", "speed-up"]
    found = {row["name"]: row for row in judge_claims(deformable_evidence, names)}
    # The mesh of a TSB1 block is mapped onto itself by the half turn, that of a TSB2 block by the
    # mirror: the solution has the symmetry up to the ends of the tube, five layers away.
    assert found["half-turn"]["verdict"] == Truth.TRUE, found["half-turn"]["number"]
    assert found["mirror"]["verdict"] == Truth.TRUE, found["mirror"]["number"]
    assert found["half-turn"]["values"]["mirrored"] > 0.5
    assert found["mirror"]["values"]["turned"] > 0.5
    assert found["four-alike"]["values"]["difference"] < 1e-6
    assert len(found["peaks-found"]["values"]["share"]) == 12
    assert found["speed-up"]["verdict"] == Truth.FALSE


@pytest.mark.slow
def test_notches_are_found_where_the_wave_is_deepest(deformable_evidence) -> None:
    names = ["valleys-tsb1", "valleys-tsb2", "one-of-three", "displacement-pipe"]
    found = {row["name"]: row for row in judge_claims(deformable_evidence, names)}
    assert len(found["valleys-tsb1"]["values"]["top"]) == 3
    assert len(found["valleys-tsb1"]["values"]["bottom"]) == 3
    assert found["displacement-pipe"]["verdict"] == Truth.TRUE


# ---------------------------------------------------------------------------------------------
# Errata


def test_every_erratum_is_shown_by_its_own_command(tmp_path) -> None:
    shown = {row["name"]: row for row in show_errata(coarse_evidence(tmp_path))}
    assert set(shown) == {erratum.name for erratum in ERRATA}
    assert all(row["command"].endswith(name) for name, row in shown.items())
    program = shown["degenerate-program"]["values"]
    assert program["z"] == program["6 N_b"] == 48
    assert program["largest_motion"] < 1e-9
    assert abs(program["corrected"]) < 1e-9
    # A half turn of a block is 1.5 waves: crest meets valley, 2 a apart; whole waves meet exactly.
    assert shown["layer-shift"]["values"]["half_block"] == pytest.approx(40.0, rel=1e-9)
    assert shown["layer-shift"]["values"]["whole_waves"] < 1e-9
    assert shown["half-block"]["values"]["valleys"] == 3
    # t/mm³ against kg/mm³ is a factor of 1000 in mass, √1000 in wave speed.
    density = shown["density-unit"]["values"]
    mass = density["block_mass_kg"]
    assert mass["t/mm³"] / mass["kg/mm³"] == pytest.approx(1000, rel=1e-12)
    ratio = density["wave_speed_km_s"]["kg/mm³"] / density["wave_speed_km_s"]["t/mm³"]
    assert ratio == pytest.approx(math.sqrt(1000), rel=1e-12)
    assert shown["rotation-variation"]["values"]["spatial"] < 1e-12
    assert shown["rotation-variation"]["values"]["printed"] > 0.1
    assert shown["pillar-frames"]["values"]["TSB1"]["released"] == "suppressed"
    with pytest.raises(InputError, match="expected one of degenerate-program"):
        show_errata(coarse_evidence(tmp_path), ["typo"])


# ---------------------------------------------------------------------------------------------
# Figures, by their data


def test_curves_of_the_parameter_study_are_all_there() -> None:
    from validation.paper.shown.figures import parameter_curves

    study = synthetic_study()
    for shift in (0.0, 0.5):
        curves = parameter_curves(study, shift)
        assert len(curves) == 3 * 5 * 4
        for (f, t, n), p_max in curves.items():
            expected = (1 - shift / 100) * n / (f * t)
            assert np.allclose(np.array(p_max) * study.axes[4], expected, rtol=1e-14)


def test_ring_pressures_carry_the_load_to_the_frames(tmp_path) -> None:
    """Pillar: the axial load p A passes through every interface, frames included."""
    from validation.paper.shown.figures import rings

    run = coarse_evidence(tmp_path).case("TSB1", "pillar")
    load = np.linalg.norm(run.details.load.facet_forces.sum(axis=0))
    interfaces = run.details.blocks.interfaces
    found = rings(run)
    assert [title.split(" and")[0] for title in found] == [
        "layer 12",
        "layers 6",
        "the bottom frame",
    ]
    for rows in found.values():
        index = run.details.contact_index[rows]
        force = run.details.contact_pressures[rows] * interfaces.areas[index]
        axial = force @ interfaces.normals[index, 2]
        # Equilibrium holds to a relative residual of 1e-6 per block, twelve layers deep.
        assert abs(axial) == pytest.approx(load, rel=1e-4)


def test_cost_rows_stand_beside_the_printed_ones(tmp_path) -> None:
    from validation.paper.shown.figures import cost_rows

    rows = cost_rows(coarse_evidence(tmp_path))
    assert rows[0].cpu_hours == 2.7
    assert rows[1].configurations == 480
    assert rows[1].cpu_hours == pytest.approx(480 * 0.05 / 3600)
    assert rows[2].cpu_hours == 758.0


@pytest.mark.slow
def test_figures_of_deformable_blocks_are_drawn(
    deformable_evidence, tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from validation.paper.claims.deformable import pressure_pairs
    from validation.paper.shown import figures_fem

    figures_fem.draw_layer_comparison(deformable_evidence, tmp_path / "layer.png")
    assert len(pressure_pairs(deformable_evidence)) == 12
    # Columns of these two figures: two of the five load cases.
    monkeypatch.setattr(figures_fem, "CASES", figures_fem.CASES[:2])
    figures_fem.draw_principal(deformable_evidence, 0, tmp_path / "sigma.png")
    figures_fem.draw_displacements(deformable_evidence, tmp_path / "disp.png")
    for name in ("layer", "sigma", "disp"):
        assert picture_is_drawn(tmp_path / f"{name}.png")
