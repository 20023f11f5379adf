"""Deformable tubes from the command line: three methods, one answer where they must agree."""

from __future__ import annotations

import json
import pickle
import signal
from pathlib import Path

import numpy as np
import pytest

from tests.support.answers import both_kinds, on_its_mesh
from tests.support.coarse_tubes import COARSE, tube
from tests.support.commands import ANSWER_FILES
from validation import InputError, compare, read_answer, sweep

pytestmark = pytest.mark.quick

SETTINGS = [a for s in COARSE for a in ("--set", s)]


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


def test_sector_and_whole_tube_give_the_same_digits() -> None:
    whole = on_its_mesh(tube("tsb1-shaft", "fem.symmetry='none'"), method="static")
    sector = on_its_mesh(tube("tsb1-shaft", "fem.symmetry='sector'"), method="static")
    assert sector.details.system.orbits.order == 4
    # Both stop at a residual of 1e-8 of the load; the tube's softest motion amplifies it tenfold.
    for a, b in zip(whole.details.displacements, sector.details.displacements, strict=True):
        np.testing.assert_allclose(b, a, atol=1e-6 * np.abs(a).max())


@pytest.mark.slow
def test_sector_is_refused_where_the_load_breaks_it(tubelock) -> None:
    status, _, err = tubelock("fem", "tsb1-beam", *SETTINGS, "--set", "fem.symmetry=sector")
    assert status == 2
    assert "not the same on every block" in err


@pytest.mark.parametrize("case", ["tunnel", "pillar", "beam"])
def test_every_load_case_has_a_static_answer(case: str) -> None:
    run = on_its_mesh(tube(f"tsb1-{case}"), method="static")
    assert run.details.evidence.residual < 1e-8
    assert run["p_max"].value > 0


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_json_and_files_of_a_static_tube(tubelock) -> None:
    on_mesh = (*SETTINGS, "--set", "fem.mesh=scene")
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


@pytest.mark.thorough
@pytest.mark.usefixtures("undrawn")
def test_interrupted_tube_continues_to_the_same_bits(tubelock, monkeypatch) -> None:
    arguments = ["fem", "tsb1-pipe", *SETTINGS, "--fields", "--set", "fem.method=explicit"]
    arguments += ["--set", "fem.sample_interval=20"]
    assert tubelock(*arguments, "-o", "whole")[0] == 0

    def impatient(_):
        def show(sample) -> None:
            if sample.step > 150:
                signal.raise_signal(signal.SIGINT)

        return show

    with monkeypatch.context() as patch:
        patch.setattr("validation.output.console.explicit_progress", impatient)
        status, _, said = tubelock(*arguments, "-o", "cut")
    assert status == 130
    assert "continue with --resume cut/checkpoint.npz" in said
    assert tubelock(*arguments, "-o", "cut", "--resume", "cut/checkpoint.npz")[0] == 0
    for name in ("history.csv", "fields.vtu"):
        assert Path("whole", name).read_bytes() == Path("cut", name).read_bytes()
    whole, cut = read_answer("whole"), read_answer("cut")
    assert whole.method == "explicit"
    for group in ("verdict", "measures", "evidence", "model"):
        assert whole.rows[group] == cut.rows[group]


def test_larger_clearance_means_larger_displacement_and_pressure() -> None:
    gaps = {"contact.clearance": [0.0, 0.03]}
    settings = (*COARSE, "fem.mesh=scene", "fem.error_estimate=false")
    study = sweep("tsb1-pipe", gaps, settings, quantity="fem")
    closed, open_ = study.rows
    assert open_["max_displacement"] > closed["max_displacement"] + 0.03
    assert open_["p_eff"] > closed["p_eff"]


def test_paper_damping_rings_where_adaptive_damping_settles() -> None:
    # α = 2 /s damps over half a second: after a few milliseconds the tube still moves.
    scene = tube(
        "tsb1-pipe",
        "fem.method='explicit'",
        "fem.damping='paper'",
        "fem.end_time=2e-3",
        "fem.ramp_time=1e-4",
    )
    ringing = on_its_mesh(scene, method="explicit").details.run
    assert ringing is not None
    calm = tube("tsb1-pipe", "fem.method='explicit'")
    settled = on_its_mesh(calm, method="explicit").details.run
    assert settled is not None
    assert settled.residual is not None
    assert ringing.residual is not None
    assert settled.residual < 1e-4 < ringing.residual
    assert ringing.energy_balance < 1e-3


def test_friction_is_absent_unless_named_and_then_dissipates() -> None:
    plain = on_its_mesh(tube("tsb1-pipe"), method="static")
    rough = on_its_mesh(tube("tsb1-pipe", "effects.friction.coefficient=0.3"), method="static")
    assert plain.details.deformable.contact.friction is None
    assert plain.details.frictional_dissipation == 0.0
    assert rough.details.frictional_dissipation > 0.0
    # Friction only resists: with it the tube moves less.
    assert rough.details.largest_displacement < plain.details.largest_displacement
