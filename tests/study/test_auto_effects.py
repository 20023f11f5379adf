"""Which effects matter: the probe's decisions are those of the full runs, and nothing is silent."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry import Answer
from tests.support.answers import on_its_mesh
from tests.support.coarse_tubes import coarse
from tests.support.commands import command, set_words
from validation import Case, InputError, load_case
from validation.study.effects.auto import EffectsDecision, decide_effects, require_wider
from validation.study.effects.probe import Change, Quantities, change, effects_of, has_effect

#: Finer than the probe's 12 × 2 × 4 elements, and still quick.
MESH = ["assembly.layers=2", "mesh.around=24", "mesh.radial=2", "mesh.axial=6"]
COARSE = list(coarse(2, 4, 2))
#: A gap of ten nanometres is meant: it is an effect too small to matter.
ACCEPTED = "plausibility.accept=['contact.clearance']"


def numbers(answer: Answer) -> Quantities:
    """What effects are judged by."""
    return Quantities(*(answer[name].value for name in ("p_max", "p_eff", "max_displacement")))


def decided(case: Case, *keep: str) -> tuple[Case, EffectsDecision]:
    """The case with what matters and nothing to decide, and the decision."""
    return decide_effects(case, keep)


def of(found: EffectsDecision, effect: str) -> tuple[bool, Change | None]:
    return next((d.simulated, d.change) for d in found.decisions if d.effect == effect)


def test_decisions_are_those_of_the_full_runs() -> None:
    # The probe is coarser by 2 × 1.5 and finds a change to a factor of two: what changes the full
    # run by less than half the tolerance is left out, what changes it by more than twice stays.
    stated = {
        "friction": ["effects.friction.coefficient=1e-4"],
        "gravity": ["effects.gravity=[0,0,-9806.65]"],
        "clearance": ["contact.clearance=1e-3", ACCEPTED],
    }
    every = [*MESH, *(word for words in stated.values() for word in words)]
    _, found = decided(load_case("tsb1-pipe", [*every, "effects.auto=0.02"]))
    assert {d.effect for d in found.decisions} == set(stated)
    reference = numbers(on_its_mesh("tsb1-pipe", every))
    for effect, words in stated.items():
        without = [word for word in every if word not in words or word == ACCEPTED]
        true = change(reference, numbers(on_its_mesh("tsb1-pipe", without)))
        simulated, probed = of(found, effect)
        assert probed is not None
        assert 0.5 < probed.largest / true.largest < 2.0
        assert simulated or true.largest < 2 * 0.02
        assert not simulated or true.largest > 0.02 / 2
    assert set(found.left_out) == {"friction"}


def test_effects_are_those_of_the_scene_switched_off() -> None:
    """A probe differs from the scene by that effect alone: here also on the mesh of the scene.

    Both go to the load in one step. The probe stops at 1e-5 of the load, which soft contact
    amplifies to at most 1e-3 of a change.
    """
    once, friction = [*COARSE, "fem.load_steps=1"], "effects.friction.coefficient=0.5"
    frame = "effects.elastic_frame=true"
    case, found = decided(load_case("tsb1-pipe", [*once, friction, frame, "effects.auto=0.01"]))
    base = numbers(on_its_mesh("tsb1-pipe", [*once, friction, frame]))
    keys: dict[str, tuple[str, object, object]] = {
        "friction": ("effects.friction.coefficient", 0.5, None),
        "elastic_frame": ("effects.elastic_frame", True, False),
    }
    assert {d.effect for d in found.decisions} == set(keys)
    for decision, other in zip(found.decisions, (frame, friction), strict=True):
        (key,) = decision.changes
        assert (key.key, key.before, key.after) == keys[decision.effect]
        true = change(base, numbers(on_its_mesh("tsb1-pipe", [*once, other])))
        assert decision.change is not None
        assert decision.change.values == pytest.approx(true.values, abs=1e-3)
        assert decision.simulated is decision.change.matters(0.01)
        assert has_effect(case, decision.effect) is decision.simulated


@pytest.mark.quick
def test_no_effect_is_switched_on() -> None:
    case, found = decided(load_case("tsb1-pipe", [*COARSE, "effects.auto=0.01"]))
    assert not found.decisions
    assert not effects_of(case)
    assert found.work == 0.0


def test_damping_does_not_change_the_state_at_rest() -> None:
    # Both forces are proportional to rates, so they are zero at rest; the explicit end state is
    # static to 1e-3, the bound of its settling.
    plain = [*COARSE, "fem.method='explicit'", "fem.damping='static'"]
    damped = ["effects.bulk_viscosity={}", "effects.rayleigh.stiffness_proportional=1e-7"]
    case, found = decided(load_case("tsb1-pipe", [*plain, *damped, "effects.auto=0.01"]))
    assert set(found.left_out) == {"rayleigh", "bulk_viscosity"}
    with_damping, without, bare = (
        on_its_mesh(c)
        for c in (load_case("tsb1-pipe", [*plain, *damped]), case, load_case("tsb1-pipe", plain))
    )
    assert change(numbers(with_damping), numbers(without)).largest < 2e-3
    # What is left out gives the bits of a scene that does not name it.
    np.testing.assert_array_equal(without.fields["displacement"], bare.fields["displacement"])


def test_damping_stays_in_a_run_that_is_not_driven_to_rest() -> None:
    moving = [*COARSE, "fem.method='explicit'", "fem.damping='paper'", "fem.end_time=1e-3"]
    viscous = [*moving, "effects.bulk_viscosity={}"]
    _, found = decided(load_case("tsb1-pipe", [*viscous, "effects.auto=0.01"]))
    assert of(found, "bulk_viscosity") == (True, None)


def test_what_is_kept_stays_and_what_is_left_out_leaves_no_bit() -> None:
    small = [*COARSE, "effects.friction.coefficient=1e-4"]
    stated = load_case("tsb1-pipe", [*small, "effects.auto=0.05"])
    case, found = decided(stated)
    assert of(found, "friction")[0] is False
    overruled, also = decided(stated, "friction")
    assert overruled.scene.effects.friction == stated.scene.effects.friction
    assert also.as_written == ("friction",)
    bare, again = on_its_mesh("tsb1-pipe", COARSE), on_its_mesh(case)
    np.testing.assert_array_equal(bare.fields["displacement"], again.fields["displacement"])


def test_probes_take_a_third_of_the_limit_of_work_and_what_is_dearer_stays_as_written() -> None:
    """One step of the count may be beyond it: all of them together are twice the work at most."""
    weight = ("effects.gravity=[0,0,-9806.65]", "effects.friction=1e-4", "effects.auto=0.01")
    _, whole = decided(load_case("tsb1-pipe", [*COARSE, *weight]))
    assert 0.0 < whole.work <= 20.0 / 3.0
    assert of(whole, "friction")[0] is False
    most = 0.5 * whole.work
    stated = load_case("tsb1-pipe", [*COARSE, *weight, f"fem.max_work={3.0 * most}"])
    case, found = decided(stated)
    assert 0.5 * most <= found.work < whole.work
    assert case.scene.effects.gravity == stated.scene.effects.gravity
    assert case.scene.effects.friction == stated.scene.effects.friction
    assert "more than a third of the limit of work" in found.words


def test_effects_that_are_small_alone_but_not_together_are_kept() -> None:
    # A soft frame and a gap both add to u. The tolerance is just above the larger change.
    words = ["effects.elastic_frame=true", "contact.clearance=3e-4", ACCEPTED]
    written = load_case("tsb1-pipe", [*COARSE, *words])
    stated = written.changed({"effects.auto": 0.9})
    case, wide = decided(stated)
    assert set(wide.left_out) == {"elastic_frame", "clearance"}
    sizes = [d.change.largest for d in wide.decisions if d.change is not None]
    base, bare = (numbers(on_its_mesh(c)) for c in (written, case))
    together = change(base, bare).largest
    assert together > 1.01 * max(sizes)
    _, found = decided(stated.changed({"effects.auto": 1.005 * max(sizes)}))
    assert len(found.left_out) == 1
    smallest = of(found, found.left_out[0])[1]
    assert smallest is not None
    assert smallest.largest == pytest.approx(min(sizes))
    assert "too much together" in " ".join(d.reason for d in found.decisions if d.simulated)


def test_sliding_that_matters_is_part_of_the_explicit_run() -> None:
    auto = ["load.pressure=3.0", "effects.auto=0.005", "fem.method='explicit'"]
    sliding = "effects.finite_sliding=true"
    case, found = decided(load_case("tsb1-beam", [*COARSE, *auto, sliding]))
    assert case.scene.effects.finite_sliding
    assert "of a facet" in found.decisions[0].reason


@cache
def with_auto(tolerance: float | None) -> Case:
    return load_case("tsb1-pipe", {} if tolerance is None else {"effects.auto": tolerance})


@pytest.mark.quick
@given(auto=st.sampled_from([None, 0.001, 0.01, 0.05]), share=st.floats(1e-4, 0.5))
@settings(max_examples=50, deadline=None)
def test_no_bar_is_promised_below_what_left_out_effects_change(
    auto: float | None, share: float
) -> None:
    targets = {"max_displacement": 0.9, "p_eff": share}
    case = with_auto(auto).changed({"fem.accuracy": targets})
    if auto is None or auto <= share:
        require_wider(case)
        return
    with pytest.raises(InputError, match=r"got p_eff=.*expected --auto of at most"):
        require_wider(case)


def decision_of_command(path: Path, *words: str) -> tuple[dict[str, Any], str]:
    """What `tubelock fem` writes of its decision into a file, and what it prints."""
    once = ("fem.mesh=scene", "fem.error_estimate=false")
    stated = set_words(once)
    status, out, _ = command("fem", "tsb1-pipe", *stated, *words, "--json", str(path))
    assert status == 0
    return json.loads(path.read_text("utf-8"))["effects_decision"], out


def test_command_line_prints_and_writes_the_decision(tmp_path: Path) -> None:
    settings = ("effects.friction.coefficient=0.5", "contact.clearance=1e-5", ACCEPTED)
    words = [f"--set={s}" for s in (*COARSE, *settings)]
    data, out = decision_of_command(tmp_path / "run.json", *words, "--auto", "2%")
    assert data["tolerance"] == 0.02
    row = next(d for d in data["decisions"] if d["effect"] == "friction")
    assert row["simulated"]
    assert abs(row["change"]["displacement"]) > 0.02
    (line,) = [x for x in out.splitlines() if x.startswith("effects ")]
    simulated, _, left_out = line.partition("left out:")
    assert "friction (off: " in simulated
    assert "contact.clearance 1e-05 → 0" in left_out
    (gap,) = next(d for d in data["decisions"] if d["effect"] == "clearance")["changes"]
    assert gap == {"key": "contact.clearance", "from": 1e-5, "to": 0.0}


def test_command_line_keeps_what_it_is_told(tmp_path: Path) -> None:
    words = [f"--set={s}" for s in (*COARSE, "effects.friction.coefficient=1e-4")]
    auto = ("--auto", "5%", "--keep", "friction")
    data, _ = decision_of_command(tmp_path / "run.json", *words, *auto)
    assert data["as_written"] == ["friction"]
    assert "friction" not in {d["effect"] for d in data["decisions"]}


def test_meshes_that_do_not_match_are_probed() -> None:
    settings = ["effects.auto=0.01", "fem.method='explicit'", "effects.finite_sliding=true"]
    _, found = decided(load_case("column-nonmatching", settings))
    (sliding,) = (d for d in found.decisions if d.effect == "finite_sliding")
    assert sliding.simulated
    assert "do not match" in sliding.reason


def test_sideways_weight_breaks_the_sector() -> None:
    # Static and explicit agree, which they can only with the whole ring: to the explicit run's
    # settling bound, 1e-3.
    sideways = [*COARSE, "effects.gravity=[9806.65,0,0]"]
    static = on_its_mesh("tsb1-pipe", sideways)
    explicit = on_its_mesh("tsb1-pipe", [*sideways, "fem.method='explicit'"])
    assert static.report["symmetry"] == 1
    assert change(numbers(static), numbers(explicit)).largest < 2e-3


def test_change_of_nothing_is_no_change() -> None:
    zero = Quantities(0.0, 0.0, 0.0)
    assert change(zero, zero).largest == 0.0
    assert change(zero, Quantities(1.0, 0.0, 0.0)).largest == 1.0
