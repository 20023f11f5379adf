"""`tubelock peaks`: orders are slopes, and a cap lowers the peak it acts on."""

from __future__ import annotations

from dataclasses import replace

import pytest

from validation.study.costs import measure as costs_measure
from validation.study.costs.peaks import cap_comparison, order


@pytest.mark.parametrize("slope", [1.0, 2.5])
def test_an_order_is_the_slope_of_the_error(slope: float) -> None:
    errors = (8.0, 0.1, 0.1 * 0.5**slope)
    elements = ((6, 1, 1), (12, 2, 2), (24, 4, 4))
    assert order(elements, errors, 0.0) == pytest.approx(slope, rel=1e-12)
    assert order(elements, errors, 0.1) is None, "an error no larger than the reference's own"


@pytest.mark.parametrize("errors", [(0.1, -0.01), (0.01, 0.1)])
def test_a_change_of_sign_and_growth_are_no_order(errors: tuple[float, float]) -> None:
    assert order(((12, 1, 4), (24, 2, 8)), errors, 0.0) is None


def test_a_cap_takes_off_the_peak() -> None:
    """Equal forces with a softer law above a pressure: its largest value falls."""
    rung = replace(
        costs_measure.LADDER[0],
        degree=2,
        along=12,
        across=1,
        upward=4,
        across_grading=1.0,
        upward_grading=8.0,
    )
    found = cap_comparison((rung,))
    change = {q: found["capped"][q] / value - 1.0 for q, value in found["without"].items()}
    assert found["force_share"] > 0
    assert change["p_max_point"] < 0.0
    # Means of the load are in balance: what the cap takes off the peak the neighbours carry.
    assert abs(change["p_eff"]) < abs(change["p_max_point"])
