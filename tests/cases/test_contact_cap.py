"""A cap on the contact law is named, says where it acted, and no run has one unasked."""

from __future__ import annotations

import numpy as np
import pytest
from rich.console import Console

from tests.support.face import (
    DeformableScene,
    Flavour,
    Frame,
    build_deck,
    check_scene,
    critical_time_step,
    on_its_mesh,
    print_run,
    scene_case,
    scene_problem,
    stated_run,
)
from tests.support.own_blocks import column, overclosure
from validation import InputError

#: Above 0.883 MPa, where a cap of 1000 MPa/mm begins.
PRESSURE = 2.0


def changed(pressure: float, **sections: dict[str, object]) -> DeformableScene:
    data = column(pressure).model_dump(mode="json", exclude_unset=True)
    for name, values in sections.items():
        data[name] = data.get(name, {}) | values
    scene = check_scene(data)
    assert isinstance(scene, DeformableScene)
    return scene


def test_a_scene_without_a_cap_follows_the_law_of_the_text() -> None:
    run = on_its_mesh(column(PRESSURE), "column", "static")
    # Without lateral strain every joint closes by the law's inverse, every box by p h / E; the
    # residual is 1e-8 of the load, and a joint is as stiff as the boxes within tenfold.
    top = 2 * overclosure(PRESSURE) + PRESSURE * 160.0 / 33e3
    assert run.details.largest_displacement == pytest.approx(top, rel=1e-7)
    assert run.as_dict()["contact_cap"] is None


def test_a_cap_says_where_it_acted(capsys: pytest.CaptureFixture[str]) -> None:
    capped = changed(PRESSURE, contact={"maximum_stiffness": 1000.0})
    run = on_its_mesh(capped, "column", "static")
    found = run.as_dict()["contact_cap"]
    points = 2 * 3 * 2 * 4
    assert found["points"] == found["pressing_points"] == points
    assert found["force_share"] == pytest.approx(1.0, rel=1e-12)
    # Linear from the cap on: 1.117 MPa at 1000 MPa/mm more for each joint.
    start = run.details.deformable.contact.law.constants
    deep = start.linear_start + (PRESSURE - start.linear_pressure) / 1000.0
    np.testing.assert_allclose(run.details.contact_state.point_overclosures, deep, rtol=1e-7)
    print_run(run, Console(width=300))
    assert f"at {points} of {points} closed contact points, 100 %" in capsys.readouterr().out
    idle = on_its_mesh(changed(0.5, contact={"maximum_stiffness": 1000.0}), "column", "static")
    assert idle.as_dict()["contact_cap"]["points"] == 0


def test_decks_carry_a_cap_and_say_where_there_is_none() -> None:
    plain = build_deck(scene_case(name="column", scene=column(PRESSURE)), Flavour.GENERAL)
    assert any("no maximum stiffness" in note for note in plain.notes)
    scene = changed(PRESSURE, contact={"maximum_stiffness": 1000.0})
    capped = build_deck(scene_case(name="column", scene=scene), Flavour.GENERAL)
    assert not any("no maximum stiffness" in note for note in capped.notes)
    assert capped.joint is not None
    assert capped.joint.law == run_law(scene)


def run_law(scene: DeformableScene) -> object:
    assert scene.contact is not None
    return scene.contact.built


def test_a_run_that_outgrows_its_time_step_starts_again(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """8 MPa is eight times what the first time step counts in, beyond its margin of safety."""
    pressure = 8.0
    stated = stated_run(scene_problem(column(pressure), "column"), column(pressure).in_time)
    longest = critical_time_step(stated.assembly.model).critical_time_step
    frames: list[Frame] = []
    run = on_its_mesh(
        changed(pressure, fem={"method": "explicit", "frames": 5}), "column", on_frame=frames.append
    )
    result = run.details.explicit
    assert result is not None
    assert result.critical.critical_time_step < longest
    assert run.details.restarts >= 1
    print_run(run, Console(width=200))
    assert (
        f"{run.details.restarts}: the contact stiffness exceeded the limit of the time step"
        in capsys.readouterr().out
    )
    # Frames of abandoned runs are marked: the others are one history from its start to its end.
    kept = [frame for frame in frames if frame.restart == run.details.restarts]
    assert len(kept) < len(frames)
    assert [frame.number for frame in kept] == list(range(len(kept)))
    assert kept[-1].last
    assert run.details.statement.counted_pressure >= 4.0
    top = 2 * overclosure(pressure) + pressure * 160.0 / 33e3
    # Damped until the residual is 1e-4 of the load.
    assert run.details.largest_displacement == pytest.approx(top, rel=1e-3)
    # A time step that the scene gives stays: the remedy is named instead.
    given = {"method": "explicit", "time_step": 0.99 * longest, "sample_interval": 1}
    with pytest.raises(InputError, match=r"reached .* MPa.*time step .* allows"):
        on_its_mesh(changed(pressure, fem=given), "column", "explicit")
