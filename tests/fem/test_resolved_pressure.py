"""A pressure at a point belongs to the solved state: never far above the integration points."""

from __future__ import annotations

import numpy as np
import pytest

from fem import ExponentialLaw
from fem.accuracy.errors import relative
from fem.answer.measures import bracketed
from fem.answer.pressures import LARGEST_FACTOR, contact_measures, facet_peaks
from geometry import Answer, Measure
from tests.support.answers import on_its_mesh
from tests.support.coarse_tubes import coarse
from validation import load_case

COARSE = list(coarse(2, 4))


def coarse_tube(clearance: float) -> Answer:
    file = load_case("tsb1-pipe", [*COARSE, f"contact.clearance={clearance}"])
    return on_its_mesh(file, method="static")


@pytest.mark.parametrize("clearance", [0.0, 0.01, 0.05, 1.0])
def test_a_clearance_leaves_the_pressure_at_a_point_in_the_solved_state(clearance: float) -> None:
    """Extrapolated gaps gave 0.994, 4.21, 208 and 3e16 MPa where points have 0.5 to 1.2 MPa."""
    run = coarse_tube(clearance)
    peak = run["p_max_point"]
    assert peak.value <= LARGEST_FACTOR * contact_measures(run.details).p_max_point
    # A corner is pressed harder than the points inside by a factor e at most, or not resolved.
    assert peak.resolved == (clearance == 0.0)
    if not peak.resolved:
        assert peak.value == contact_measures(run.details).p_max_point
        assert bracketed(run.details)["p_max_point"] >= (LARGEST_FACTOR - 1.0) * peak.value


def test_a_pressure_that_is_not_resolved_is_printed_as_such() -> None:
    run = coarse_tube(0.05)
    row = next(s for s in str(run).splitlines() if "pressure at a point" in s)
    assert "not resolved" in row
    assert run["p_max_point"].as_json()["resolved"] is False
    assert "resolved" not in run["p_eff"].as_json()


def test_no_accuracy_is_reached_by_a_pressure_that_is_not_resolved() -> None:
    assert relative(Measure(1.0, "MPa", 0.01)) == pytest.approx(0.01)
    assert relative(Measure(1.0, "MPa", 0.01, resolved=False)) == np.inf


def test_a_facet_counts_with_what_its_points_resolve() -> None:
    law = ExponentialLaw()
    inside = np.linspace(0.0, 5e-3, 6)[:, None] * np.array([0.2, 0.5, 1.0, 0.8])
    for step in (0.0, 1e-4, 1e-3, 1e-1, 1e3):
        edges = inside.max(axis=1)[:, None] + step * np.array([0.0, -1.0, 1.0])
        found = facet_peaks(law, edges, inside)
        largest = law.pressure(inside.max(axis=1))
        assert (found.values >= largest).all()
        assert (found.values <= LARGEST_FACTOR * largest).all()
        law_there = law.pressure(edges.max(axis=1))
        np.testing.assert_array_equal(found.values[found.resolved], law_there[found.resolved])
        np.testing.assert_array_equal(found.values[~found.resolved], largest[~found.resolved])
        # A facet that is almost open hides nothing as long as another one presses harder.
        hidden = law_there[~found.resolved].max(initial=0.0)
        assert found.all_resolved == (hidden <= found.values.max())
