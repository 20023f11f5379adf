"""The stored rows of the paper's study with deformable blocks: computed again, and judged."""

from __future__ import annotations

import csv
from importlib import resources
from itertools import pairwise
from pathlib import Path

import pytest

from tests.support.face import (
    PATHS,
    Compared,
    Design,
    complete_axes,
    judge_geometry,
    rank_correlations,
    read_rows,
)
from validation.study.design import run_design
from validation.study.study import load_study

ROWS = Path(str(resources.files("validation"))) / "studies" / "paper-480-fem.csv"
MEASURES = ("p_max", "p_eff", "sigma_1_averaged", "max_displacement")


def test_rows_are_those_of_the_study() -> None:
    """Every row is a design of the built-in study; the file is small."""
    study = load_study("paper-480-fem")
    known = {tuple(study.design(n).values()) for n in range(study.n_designs)}
    rows = list(csv.DictReader(ROWS.read_text("utf-8").splitlines()))
    heads = [study.head(path) for path, _ in study.parameters]
    assert {tuple(float(row[head]) for head in heads) for row in rows} <= known
    assert ROWS.stat().st_size <= 200_000


@pytest.mark.parametrize("key", [(0.0, 1.0, 3, 40.0, 15.0), (0.0, 1.5, 3, 60.0, 15.0)])
def test_designs_computed_again_agree_within_their_error_bars(key: Design) -> None:
    """The solver of today gives what is stored: a change of it that matters is seen here.

    They are among the cheapest designs of two thicknesses and frequencies.
    """
    stored, study = read_rows(ROWS)[key], load_study("paper-480-fem")
    row = run_design(study, study.number(dict(zip(PATHS, key, strict=True))))
    assert row.status == "ok"
    for name in MEASURES:
        assert abs(row.results[name] - stored[name]) <= stored[f"{name}_error"]


def test_the_complete_part_of_a_study_is_judged() -> None:
    """Values of which designs are missing are left out; what is there is whole."""
    full = {(s, f, 2, 30.0, a) for s in (0.0, 0.5) for f in (1.0, 2.0) for a in (10.0, 20.0)}
    extra = {(0.0, 1.0, 2, 30.0, 25.0)}
    axes = complete_axes(full | extra)
    assert axes == ((0.0, 0.5), (1.0, 2.0), (2,), (30.0,), (10.0, 20.0))


def test_verdicts_and_correlations_follow_from_the_rows() -> None:
    """Each claim is judged by each measure; a measure ranks itself."""
    compared = Compared()
    of = {"claim": "falls-with-amplitude", "measure": "deformable p_max"}
    falling = next(r for r in judge_geometry(compared) if of.items() <= r.items())
    curves: dict[tuple[float, ...], dict[float, float]] = {}
    for (*others, a), row in compared.rows.items():
        curves.setdefault(tuple(others), {})[a] = row["p_max_fem"]
    ordered = [[curve[a] for a in sorted(curve)] for curve in curves.values()]
    by_hand = all(x > y for curve in ordered for x, y in pairwise(curve))
    assert (falling["verdict"] == "true") == by_hand
    for row in rank_correlations(compared):
        assert row[row["measure"]] == pytest.approx(1.0)
