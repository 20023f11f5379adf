"""Deformable tubes from the command line: three methods, one answer where they must agree."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import pytest

from tests.support.answers import both_kinds
from tests.support.coarse_tubes import COARSE, tube
from tests.support.commands import ANSWER_FILES, set_words
from validation import InputError, compare, sweep

pytestmark = pytest.mark.quick

SETTINGS = set_words(COARSE)


def test_three_answers_to_one_scene() -> None:
    found = compare(*both_kinds(tube("tsb1-pipe"), explicit=True)).why()
    assert found.names == ("rigid (force)", "rigid (pressure)", "static", "explicit")
    errors = found.explicit_errors
    assert errors is not None
    # What the project promises of an explicit run to the static state.
    assert errors["displacement_rms"] < 2e-3
    assert errors["pressure_rms"] < 2e-3
    assert errors["p_max"] < 5e-3
    # Stiff blocks on linear springs are the rigid limit of a uniform foundation; 2 × 2 points in
    # place of one per facet let a facet carry a moment, with two facets per half wave.
    assert found.steps[0]["p_max"] == pytest.approx(
        found.rows["p_max"]["rigid (pressure)"], rel=0.15
    )
    assert found.steps[-1]["p_max"] == pytest.approx(found.static["p_max"].value, rel=1e-3)
    # Units are text: what stands in square brackets is no markup.
    assert "|u| max [mm]" in repr(found)
    # What was written or pickled has the same numbers, and no problem to take apart.
    again = compare(*pickle.loads(pickle.dumps(found.answers)))
    assert again.agreement == found.agreement
    assert again.rows == found.rows
    assert again.why().steps == ()
    with pytest.raises(InputError, match="does not hold its blocks"):
        again.draw("none.png")


def test_steps_of_a_comparison_have_the_friction_of_the_scene() -> None:
    """On contact a hundred times softer than the blocks elasticity changes a hundredth or so."""
    soft = tube("tsb1-pipe", "effects.friction=0.3", "contact.maximum_stiffness=1")
    found = compare(*both_kinds(soft)).why()
    *_, stiff, elastic = found.steps
    assert stiff["words"] == "with the scene's contact law"
    for name in ("p_max", "p_eff"):
        assert elastic[name] == pytest.approx(stiff[name], rel=0.05)
    assert "μ = 0.3; " in repr(found)
    assert found.static["p_max_point"].error is None
    assert "MPa" not in found.conclusion


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_json_and_files_of_a_static_tube(tubelock) -> None:
    on_mesh = (*SETTINGS, "--set", "fem.mesh=scene", "--set", "fem.error_estimate=false")
    status, _, _ = tubelock(
        "fem", "tsb1-pipe", *on_mesh, "-o", "run", "--fields", "--json", "run.json"
    )
    assert status == 0
    data = json.loads(Path("run.json").read_text())
    assert {
        "p_eff",
        "p_eff_pooled",
        "p_max",
        "p_max_point",
        "effective_count_percent",
        "mean_overclosure",
        "force",
    } <= set(data["contact"])
    assert data["residual"] < 1e-8
    assert {p.name for p in Path("run").iterdir()} == {
        *ANSWER_FILES,
        "contact_pressures.png",
        "stresses.png",
        "displacement.png",
        "joints.csv",
        "joints.vtu",
    }


def test_larger_clearance_means_larger_displacement_and_pressure() -> None:
    gaps = {"contact.clearance": [0.0, 0.03]}
    settings = (*COARSE, "fem.mesh=scene", "fem.error_estimate=false")
    study = sweep("tsb1-pipe", gaps, settings, quantity="fem")
    closed, open_ = study.rows
    assert open_["max_displacement"] > closed["max_displacement"] + 0.03
    assert open_["p_eff"] > closed["p_eff"]
