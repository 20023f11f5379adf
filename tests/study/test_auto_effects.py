"""Which effects matter: the probe's decisions are those of the full runs, and nothing is silent."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.support.face import (
    Change,
    DeformableScene,
    EffectName,
    EffectsSection,
    StaticOptions,
    change,
    command,
    contact_measures,
    on_its_mesh,
    with_auto,
)
from tests.support.face import EffectNumbers as Answer
from tests.support.face import effect_numbers_of as answer_of
from tests.support.face import solve_deformable_static as solve_static
from tests.support.fem_problems import pair_resultants
from validation import InputError, compare, load_case
from validation.study.comparison.scene import compared_runs
from validation.study.effects import limit
from validation.study.effects.auto import EffectsDecision, decide_effects

#: Finer than the probe's 12 × 2 × 4 elements, and still quick.
MESH = ["assembly.layers=2", "mesh.around=24", "mesh.radial=2", "mesh.axial=6"]
COARSE = ["assembly.layers=2", "mesh.around=12", "mesh.radial=2", "mesh.axial=4"]
FRICTION, CLEARANCE = EffectName.FRICTION, EffectName.CLEARANCE
#: A gap of ten nanometres is meant: it is an effect too small to matter.
ACCEPTED = "plausibility.accept=['contact.clearance']"


def scene_of(*settings: str, case: str = "tsb1-pipe") -> DeformableScene:
    scene = load_case(case, settings).scene
    assert isinstance(scene, DeformableScene)
    return scene


def of(found: EffectsDecision, effect: EffectName) -> tuple[bool, Change | None]:
    return next((d.simulated, d.change) for d in found.decisions if d.effect is effect)


def test_decisions_are_those_of_the_full_runs() -> None:
    # The probe is coarser by 2 × 1.5 and finds a change to a factor of two: what changes the full
    # run by less than half the tolerance is left out, what changes it by more than twice stays.
    effects = ["effects.friction.coefficient=1e-4", "effects.gravity=[0,0,-9806.65]"]
    scene = scene_of(*MESH, *effects, "contact.clearance=1e-5", ACCEPTED, "effects.auto=0.02")
    _, found = decide_effects(scene, "tube")
    assert {d.effect for d in found.decisions} == {
        FRICTION,
        EffectName.GRAVITY,
        CLEARANCE,
        EffectName.ELASTIC_FRAME,
        EffectName.FINITE_ROTATION,
    }
    bare = scene_of(*MESH)
    reference = answer_of(on_its_mesh(bare, "tube", "static").details)
    added = {
        FRICTION: {"effects.friction": scene.effects.friction},
        EffectName.GRAVITY: {"effects.gravity": scene.effects.gravity},
        CLEARANCE: {"contact.clearance": 1e-5},
    }
    for effect, changes in added.items():
        true = change(
            reference, answer_of(on_its_mesh(bare.changed(changes), "tube", "static").details)
        )
        simulated, probed = of(found, effect)
        assert probed is not None
        assert 0.5 < probed.largest / true.largest < 2.0
        assert simulated or true.largest < 2 * 0.02
        assert not simulated or true.largest > 0.02 / 2
    assert {FRICTION, CLEARANCE} & set(found.left_out)
    assert EffectName.GRAVITY not in found.left_out


def test_the_rule_is_that_of_the_effects_command() -> None:
    """An effect is added to none: here on the mesh of the scene, which is as coarse as a probe.

    Both go to the load in one step. The probe stops at 1e-5 of the load, which soft contact
    amplifies to at most 1e-3 of a change.
    """
    settings = [*COARSE, "fem.load_steps=1"]
    scene = scene_of(*settings, "effects.friction.coefficient=0.5", "effects.auto=0.01")
    _, found = decide_effects(scene, "tube")
    base = answer_of(on_its_mesh(scene_of(*settings), "tube", "static").details)
    for effect in (FRICTION, EffectName.FINITE_ROTATION, EffectName.ELASTIC_FRAME):
        value = scene.effects.friction if effect is FRICTION else True
        with_it = scene_of(*settings).changed({f"effects.{effect}": value})
        true = change(base, answer_of(on_its_mesh(with_it, "tube", "static").details))
        simulated, probed = of(found, effect)
        assert probed is not None
        assert probed.values == pytest.approx(true.values, abs=1e-3)
        assert simulated is probed.matters(0.01)


def test_finite_rotation_is_estimated_as_explicit_runs_find_it() -> None:
    # At 300 times the load blocks turn by 2 mrad, which changes the answer by 0.4 %. The probe,
    # here on the mesh of the run, stops at 1e-5 of the load and the explicit runs at 1e-6: 2e-5 of
    # 4e-3, amplified tenfold by the softest motion.
    explicit = ["fem.method='explicit'", "fem.residual=1e-6"]
    # A cap keeps contact soft at this load: without one the answer changes half as much.
    settings = [*COARSE, "load.pressure=3.0", "contact.maximum_stiffness=1000", *explicit]
    scene = scene_of(*settings, "effects.auto.decide=['finite_rotation']", case="tsb1-beam")
    _, found = decide_effects(scene, "tube")
    _, estimated = of(found, EffectName.FINITE_ROTATION)
    answers = []
    for finite in (True, False):
        probe = scene.changed({"effects": {"auto": None, "finite_rotation": finite}})
        run = on_its_mesh(probe, "tube", "explicit")
        answers.append(answer_of(run.details))
    true = change(*reversed(answers))
    assert estimated is not None
    assert true.largest > 0.003
    for name in ("p_max", "p_eff", "displacement"):
        assert getattr(estimated, name) == pytest.approx(getattr(true, name), rel=0.05)


def test_damping_does_not_change_the_state_at_rest() -> None:
    # Both forces are proportional to rates, so they are zero at rest; the explicit end state is
    # static to 1e-3, the bound of its settling.
    plain = [*COARSE, "fem.method='explicit'", "fem.damping='static'"]
    damped = ["effects.bulk_viscosity={}", "effects.rayleigh.stiffness_proportional=1e-7"]
    scene = scene_of(*plain, *damped, "effects.auto.decide=['rayleigh','bulk_viscosity']")
    decided, found = decide_effects(scene, "tube")
    assert set(found.left_out) == {EffectName.RAYLEIGH, EffectName.BULK_VISCOSITY}
    with_damping = on_its_mesh(scene_of(*plain, *damped), "tube", "explicit")
    without, bare = (on_its_mesh(s, "tube", "explicit") for s in (decided, scene_of(*plain)))
    assert change(answer_of(with_damping.details), answer_of(without.details)).largest < 2e-3
    # What is left out gives the bits of a scene that does not name it.
    for a, b in zip(
        without.details.group_displacements, bare.details.group_displacements, strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_damping_stays_in_a_run_that_is_not_driven_to_rest() -> None:
    settings = [*COARSE, "fem.method='explicit'", "fem.damping='paper'", "fem.end_time=1e-3"]
    scene = scene_of(*settings, "effects.bulk_viscosity={}", "effects.auto.decide=['rayleigh']")
    with pytest.raises(InputError, match="names rayleigh, which has no value"):
        decide_effects(scene, "tube")
    scene = scene_of(
        *settings, "effects.bulk_viscosity={}", "effects.auto.decide=['bulk_viscosity']"
    )
    assert of(decide_effects(scene, "tube")[1], EffectName.BULK_VISCOSITY) == (True, None)


def test_what_is_kept_stays_and_what_is_left_out_leaves_no_bit() -> None:
    small = ["effects.friction.coefficient=1e-4", "effects.elastic_frame=false"]
    file = load_case("tsb1-pipe", [*COARSE, *small])
    auto = with_auto(file, "5%").scene
    kept = with_auto(file, "5%", ["friction"]).scene
    assert isinstance(auto, DeformableScene)
    assert isinstance(kept, DeformableScene)
    decided, found = decide_effects(auto, "tube")
    # Written off stays off, and is not even a candidate.
    assert EffectName.ELASTIC_FRAME not in {d.effect for d in found.decisions}
    assert of(found, FRICTION)[0] is False
    overruled, also = decide_effects(kept, "tube")
    assert overruled.effects.friction == kept.effects.friction
    assert also.as_written == (FRICTION,)
    bare = on_its_mesh(scene_of(*COARSE), "tube", "static")
    again = on_its_mesh(decided, "tube", "static")
    for a, b in zip(
        bare.details.group_displacements, again.details.group_displacements, strict=True
    ):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("case", ["tsb1-shaft", "thb0-tunnel", "planar-sine"])
def test_probes_take_a_third_of_the_answer_at_most(case: str) -> None:
    """By unknowns times linear problems of the probe, over those of the answer's first meshes."""
    layers = () if case == "planar-sine" else ("assembly.layers=1",)
    _, found = decide_effects(scene_of(*layers, "effects.auto=0.01", case=case), "scene")
    assert 0.0 < found.share_of_answer <= 1.0 / 3.0
    assert of(found, EffectName.FINITE_ROTATION)[1] is not None


def test_what_is_too_dear_to_probe_stays_as_written() -> None:
    """An answer on one mesh that is as coarse as the probe takes no more than a probe."""
    weight = "effects.gravity=[0,0,-9806.65]"
    scene = scene_of(*COARSE, weight, "fem.mesh=scene", "effects.auto=0.01")
    decided, found = decide_effects(scene, "tube")
    assert found.share_of_answer <= 1.0 / 3.0
    assert decided.effects.gravity == scene.effects.gravity
    assert not decided.effects.finite_rotation
    assert "more than a third of the work of the answer" in found.words


def test_effects_can_be_written_as_auto() -> None:
    # Only what is written so is decided; its value stays where it is.
    friction = "effects.friction={coefficient=0.2,when='auto'}"
    effects = scene_of("effects.elastic_frame='auto'", friction).effects
    assert effects.auto is not None
    assert set(effects.auto.decide or ()) == {EffectName.ELASTIC_FRAME, FRICTION}
    assert effects.auto.tolerance == 0.01
    assert effects.friction is not None
    assert effects.friction.coefficient == 0.2
    assert not effects.elastic_frame
    both = scene_of("effects.finite_rotation='auto'", "effects.auto='3%'").effects.auto
    assert both is not None
    assert (both.tolerance, both.decide) == (0.03, (EffectName.FINITE_ROTATION,))
    assert scene_of("effects.auto=false").effects.auto is None
    with pytest.raises(InputError, match='expected "auto"'):
        scene_of("effects.friction={coefficient=0.2,when='maybe'}")
    with pytest.raises(InputError, match="in decide and in keep"):
        scene_of("effects.elastic_frame='auto'", "effects.auto.keep=['elastic_frame']")


def test_effects_that_are_small_alone_but_not_together_are_put_back() -> None:
    # The tolerance is put between the larger change and the sum of both: the larger is simulated.
    settings = [*COARSE, "contact.clearance=1e-4"]
    names = "effects.auto.decide=['clearance','elastic_frame']"
    _, wide = decide_effects(scene_of(*settings, "effects.auto.tolerance=0.9", names), "tube")
    sizes = [d.change.largest for d in wide.decisions if d.change is not None]
    assert len(wide.left_out) == 2
    tolerance = 0.5 * (max(sizes) + sum(sizes))
    narrow = scene_of(*settings, f"effects.auto.tolerance={tolerance}", names)
    _, found = decide_effects(narrow, "tube")
    assert len(found.left_out) == 1
    assert of(found, found.left_out[0])[1].largest == pytest.approx(min(sizes))
    assert "too much together" in " ".join(d.reason for d in found.decisions if d.simulated)


def test_sliding_that_matters_is_part_of_the_static_run() -> None:
    settings = [*COARSE, "load.pressure=3.0", "effects.auto='0.5%'"]
    scene = scene_of(*settings, "effects.finite_sliding='auto'", case="tsb1-beam")
    decided, found = decide_effects(scene, "tube")
    assert decided.effects.finite_sliding
    assert "of a facet" in found.decisions[0].reason


def test_finite_rotation_that_matters_is_part_of_the_static_run() -> None:
    settings = [*COARSE, "contact.clearance=0.1", "effects.elastic_frame=false"]
    auto = ("effects.auto.tolerance='0.05%'", "effects.auto.decide=['finite_rotation']")
    scene = scene_of(*settings, *auto)
    decided, found = decide_effects(scene, "tube")
    assert decided.effects.finite_rotation is True
    (decision,) = found.decisions
    assert decision.change is not None
    run, without = (
        on_its_mesh(scene.changed({"effects": effects}), "tube", "static")
        for effects in (decided.effects, EffectsSection())
    )
    assert "finite rotation" in run.details.static.status
    change = run.details.largest_displacement / without.details.largest_displacement - 1.0
    # The probe, on the same mesh, stops at 1e-5 of the load, which soft gaps amplify.
    assert change == pytest.approx(decision.change.displacement, rel=0.05)


def test_command_line_prints_and_writes_the_decision(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    once = ("fem.mesh=scene", "fem.error_estimate=false", "effects.friction.coefficient=0.5")
    settings = [f"--set={s}" for s in [*MESH, *once]]
    words = ("fem", "tsb1-pipe", *settings, "--auto", "2%", "--json", str(path))
    status, out, _ = command(*words)
    assert status == 0
    data = json.loads(path.read_text())["effects_decision"]
    assert data["tolerance"] == 0.02
    row = next(d for d in data["decisions"] if d["effect"] == "friction")
    assert row["simulated"]
    assert abs(row["change"]["displacement"]) > 0.02
    (line,) = [x for x in out.splitlines() if x.startswith("effects ")]
    simulated, _, left_out = line.partition("left out:")
    assert "friction coefficient 0.5 (" in simulated
    assert "finite rotation (" in left_out


def test_meshes_that_do_not_match_are_probed() -> None:
    _, found = decide_effects(scene_of(case="column-nonmatching"), "column")
    (sliding,) = (d for d in found.decisions if d.effect is EffectName.FINITE_SLIDING)
    assert sliding.simulated
    assert "do not match" in sliding.reason


def test_a_scene_without_a_static_state_cannot_be_probed(monkeypatch) -> None:
    # The load pushes the flat bricks out: a mechanism.
    monkeypatch.setattr(limit, "SHARE", np.inf)  # however dear a probe is
    scene = scene_of("effects.auto=0.01", case="brick-stack")
    with pytest.raises(InputError, match=r"remove effects\.auto, and every effect acts as written"):
        decide_effects(scene, "stack")


# ---------------------------------------------------------------------------------------------
# Weight in static runs


def test_static_tube_carries_its_weight() -> None:
    # The frame carries load and weight: the z forces of all pairs with a fixed block add up to
    # the weight of the free blocks (pipe pressure has no axial part), to the residual, 1e-8 of
    # the loads.
    run = on_its_mesh(scene_of(*COARSE, "effects.gravity=[0,0,-9806.65]"), "tube", "static")
    found = run.details.deformable
    weight = sum(float(g.lumped_mass.sum()) * g.n_copies * -9806.65 for g in found.model.groups)
    surfaces, fixed = found.surfaces, found.assembly.fixed
    first = surfaces.pair_start[:-1]
    m, s = surfaces.block_m[first], surfaces.block_s[first]
    result = solve_static(found, StaticOptions(tolerance=1e-10))
    force, _ = pair_resultants(result)
    on_free = force[fixed[m] & ~fixed[s]].sum(axis=0) - force[fixed[s] & ~fixed[m]].sum(axis=0)
    assert on_free[2] == pytest.approx(-weight, rel=1e-6)
    assert contact_measures(found.assembly, result.contact_state).p_max > 0


def test_sideways_weight_breaks_the_sector() -> None:
    # Static and explicit agree, which they can only with the whole ring: to the explicit run's
    # settling bound, 1e-3.
    sideways = [*COARSE, "effects.gravity=[9806.65,0,0]"]
    static = on_its_mesh(scene_of(*sideways), "tube", "static")
    explicit = on_its_mesh(scene_of(*sideways, "fem.method='explicit'"), "tube", "explicit")
    assert static.details.static.symmetry == 1
    assert change(answer_of(static.details), answer_of(explicit.details)).largest < 2e-3


def test_rigid_blocks_of_a_comparison_weigh_as_much() -> None:
    # The frame carries the weight of the free blocks, to the residual of the equilibrium.
    scene = scene_of(*COARSE, "effects.gravity=[0,0,-9806.65]", "fem.mesh='scene'")
    rigid, deformable = compared_runs("tube", scene)
    found, assembly = compare(*rigid, *deformable), rigid[0].details.blocks
    weight = 2.4e-9 * 9806.65 * assembly.volumes[assembly.free_blocks].sum()
    m, s = assembly.fixed[np.unique(found.contacts["blocks"], axis=0)].T
    for forces in found.interface_forces[:2]:
        on_frame = forces[s & ~m].sum(axis=0) - forces[m & ~s].sum(axis=0)
        assert on_frame[2] == pytest.approx(-weight, rel=1e-6)


def test_change_of_nothing_is_no_change() -> None:
    zero = Answer(0.0, 0.0, 0.0)
    assert change(zero, zero).largest == 0.0
    assert change(zero, Answer(1.0, 0.0, 0.0)).largest == 1.0
