"""Combinations of loads: sums, their envelope, and what is rejected."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from geometry import Measure
from validation import InputError, load_case, solve
from validation.study.combinations import (
    combination_answers,
    combination_cases,
    combination_rows,
    envelope,
)

BOX: dict[str, Any] = {
    "block": {"type": "box", "size": [100.0, 50.0, 40.0]},
    "mesh": {"divisions": [2, 1, 1]},
    "fem": {"method": "static", "mesh": "scene", "error_estimate": False},
}
COMBINED = BOX | {
    "material": "concrete",
    "effects": {"gravity": [0.0, 0.0, -9810.0]},
    "supports": [{"face": "x-"}],
    "load": {"x+": {"traction": [0.0, 0.0, -0.01]}},
    "loads": [{"name": "wind", "face": "y-", "pressure": 0.02}],
    "combinations": {"all": {"weight": 1.35, "load": 1.5, "wind": -0.6}, "weight": {"weight": 2.0}},
}


def test_a_combination_is_the_sum_of_its_loads_times_their_factors() -> None:
    """Blocks without contact are linear: displacements add up, exactly to rounding."""

    def moved(*loads: str) -> np.ndarray:
        none = {key: COMBINED[key] for key in ("block", "mesh", "fem", "material", "supports")}
        case = load_case(none | {key: COMBINED[key] for key in loads})
        return solve(case.with_method("static")).fields["displacement"]

    weight, load, wind = moved("effects"), moved("load"), moved("loads")
    found = {
        name: solve(case).fields["displacement"]
        for name, case in combination_cases(load_case(COMBINED)).items()
    }
    np.testing.assert_allclose(found["all"], 1.35 * weight + 1.5 * load - 0.6 * wind, atol=1e-12)
    np.testing.assert_allclose(found["weight"], 2.0 * weight, atol=1e-12)


def test_the_envelope_names_the_combination_that_governs(tmp_path: Path) -> None:
    case, store = load_case(COMBINED), tmp_path / "rows.jsonl"
    answers = combination_answers(case, combination_cases(case), store)
    assert list(answers) == ["all", "weight"]
    # Rows are the answers without their fields, and a second call computes none.
    for name, one in combination_cases(case).items():
        assert answers[name].measures == solve(one).measures
    told: list[str] = []
    assert {
        n: a.as_dict()
        for n, a in combination_answers(case, combination_cases(case), store, told.append).items()
    } == {name: answer.as_dict() for name, answer in answers.items()}
    assert not told
    for measure, (name, largest) in envelope(answers).items():
        values = {n: abs(a.measures[measure].value) for n, a in answers.items()}
        assert values[name] == max(values.values()) == abs(largest.value)


@pytest.mark.quick
def test_a_missing_load_factor_governs_unless_a_smaller_one_is_known() -> None:
    """Infinity: no load reaches the strength. NaN: nothing is known of the factor."""

    def governing(**values: float) -> str:
        answers = {
            name: SimpleNamespace(measures={"cracking_factor": Measure(value, "times the load")})
            for name, value in values.items()
        }
        return envelope(answers)["cracking_factor"][0]  # type: ignore[arg-type]

    assert governing(found=5.0, missing=math.nan) == "missing"
    assert governing(found=5.0, above=2.0, none=math.inf) == "above"


def test_a_factor_of_no_load_is_rejected() -> None:
    case = load_case(COMBINED | {"combinations": {"all": {"snow": 1.0}}})
    with pytest.raises(InputError, match=r"combinations.all.snow: .* weight, load, wind"):
        combination_cases(case)
    with pytest.raises(InputError, match="combinations: got none"):
        combination_cases(load_case(BOX))


@pytest.mark.parametrize("factors", [{"held": 1.0}, {"supports": ["held"]}, {"push": {}}])
def test_combinations_of_other_supports_are_rejected_by_name(factors: dict[str, object]) -> None:
    held = [{"name": "held", "face": "x-", "hold": ["x", "y", "z"]}]
    stated = BOX | {"supports": held, "combinations": {"a": {"load": 1.0, **factors}}}
    named = rf"combinations\.a\.{next(iter(factors))}: .* the same supports and motions in all"
    with pytest.raises(InputError, match=named):
        combination_cases(load_case(stated))


def test_a_combination_that_is_not_carried_says_so_beside_the_others(tmp_path: Path) -> None:
    """Its column was empty, and the next one governed: suction above the weight lifts a box."""
    box = {"size": [100.0, 100.0, 50.0], "divisions": [1, 1, 1]}
    case = load_case(
        {
            "block": {"type": "boxes", "boxes": [box, box]},
            "load": {"pressure": 0.01},
            "effects": {"gravity": [0.0, 0.0, -9810.0]},
            "combinations": {"down": {"load": 1.0}, "up": {"weight": 1.0, "load": -1.0}},
        },
        method="rigid",
    )
    answers = combination_answers(case, combination_cases(case), tmp_path / "rows.jsonl")
    title, *verdicts, _ = next(iter(combination_rows(answers)))
    assert title == "verdict"
    assert [words.split()[0] for words in verdicts] == ["carried", "not"]


WALL: dict[str, Any] = {
    "block": {"type": "wall", "size": [240.0, 115.0, 71.0]},
    "assembly": {"columns": 2, "rows": 2},
    "effects": {"gravity": [0.0, 0.0, -9810.0], "friction": 0.6},
    "load": {"acceleration": [981.0, 0.0, 0.0]},
    "rigid": {"collapse": True},
    "combinations": {"dead": {"weight": 1.35}, "wind": {"weight": 1.0, "load": 2.0}},
}


def test_each_combination_has_its_limit_load(tmp_path: Path) -> None:
    """A load factor of a combination is a factor of its limit; without a load there is none."""
    case = load_case(WALL, method="rigid")
    limit = solve(case).report["collapse"]["factor"]
    stated = case.changed({"combinations.storm": {"weight": 1.0, "load": 1.01 * limit}})
    answers = combination_answers(stated, combination_cases(stated), tmp_path / "rows.jsonl")
    limits = list(combination_rows(answers))[1]
    assert limits[:2] == ["limit load", "–"]
    for name, factor in (("wind", 2.0), ("storm", 1.01 * limit)):
        assert answers[name].report["collapse"]["factor"] == pytest.approx(limit / factor, rel=1e-6)


def test_a_limit_of_a_scene_without_variable_load_is_rejected_in_combinations(
    tmp_path: Path,
) -> None:
    case = load_case(
        WALL | {"load": {}, "combinations": {"dead": {"weight": 1.35}}}, method="rigid"
    )
    with pytest.raises(InputError, match="live load is zero"):
        combination_answers(case, combination_cases(case), tmp_path / "rows.jsonl")
