"""The paper's claims on geometry, judged by the rows of its study with deformable blocks."""

from __future__ import annotations

from itertools import pairwise

import pytest

from validation.paper.deformable_study import (
    Compared,
    complete_axes,
    judge_geometry,
    rank_correlations,
)


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
