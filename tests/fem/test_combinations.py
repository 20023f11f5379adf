"""Effects together: laws that hold for every combination, in static and in explicit runs."""

from __future__ import annotations

import numpy as np
import pytest

from fem.static.solve import StaticOptions, static_state
from tests.support.answers import on_its_mesh
from tests.support.coarse_tubes import coarse
from validation import Case, load_case

COARSE = coarse(2, 4)


def scene_of(*settings: str, case: str = "tsb1-pipe") -> Case:
    return load_case(case, [*COARSE, *settings])


@pytest.mark.parametrize(
    ("setting", "method"),
    [
        ("effects.elastic_frame=true", "static"),
        ("effects.elastic_frame=true", "explicit"),
        ("effects.friction.coefficient=0.3", "explicit"),
    ],
)
def test_a_sector_gives_the_energies_of_the_whole(setting: str, method: str) -> None:
    # Four sectors are equal to the round-off of a run, 1e3 steps of 1e-16 times the ratio of the
    # highest to the lowest frequency (1e3); energies are of the whole tube whatever is computed.
    found = []
    for symmetry in ("sector", "none"):
        scene = scene_of(f'fem.method="{method}"', f'fem.symmetry="{symmetry}"', setting)
        answer = on_its_mesh(scene, method=method)
        found.append(answer.report["energies"])
        if method == "explicit":
            last = answer.details.run.history.column("strain_energy")[-1]
            assert last == pytest.approx(found[-1]["strain_energy"], rel=1e-14)
    sector, whole = found
    for name in ("strain_energy", "contact_energy", "external_work", "frictional_dissipation"):
        assert sector[name] == pytest.approx(whole[name], rel=1e-7, abs=0.0)
        assert np.isfinite(sector[name])


def test_explicit_friction_follows_slow_loading() -> None:
    # Slip depends on the load path. The static solver in 16 load steps is within
    # 1e-4 of its limit; a ramp of four periods leaves inertia of (1/4)²/4 of the slips' share of
    # the answer, a tenth: 2e-3. After a quarter of a period the pipe was 13 % off.
    friction = "effects.friction.coefficient=0.05"
    scene = scene_of(friction, 'fem.method="explicit"', 'fem.damping="static"')
    run = on_its_mesh(scene, method="explicit")
    slow = static_state(scene.problem.system, StaticOptions(load_steps=16))
    assert run.details.contact_state.point_pressures.max() == pytest.approx(
        slow.pressures.max(), rel=5e-3
    )
    assert run.details.largest_displacement == pytest.approx(slow.largest_displacement, rel=5e-3)


def test_friction_that_closes_a_clearance_is_loaded_in_steps() -> None:
    """One step counts slip before touch as stick, so friction holds where nothing pressed yet."""
    pillar = ("contact.clearance=0.05", "effects.friction.coefficient=0.3")
    gap = on_its_mesh(scene_of(*pillar, case="tsb1-pillar"), method="static")
    assert gap.details.evidence.load_steps > 1
    one = on_its_mesh(scene_of(*pillar, "fem.load_steps=1", case="tsb1-pillar"), method="static")
    # Slip that nothing resisted dissipates nothing: finer loading loses less.
    lost = [run.details.evidence.frictional_dissipation for run in (gap, one)]
    assert lost[0] < 0.5 * lost[1]
    plain = on_its_mesh(scene_of("contact.clearance=0.05"), method="static")
    assert plain.details.evidence.load_steps == 1
