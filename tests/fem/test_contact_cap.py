"""A cap on the contact law is named, says where it acted, and no run has one unasked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fem.decks.deck import Flavour
from fem.decks.problem import deck_lines, problem_deck
from fem.dynamics import stated_run
from fem.explicit.solve import Frame
from tests.support.answers import on_its_mesh
from tests.support.own_blocks import column, overclosure
from tests.support.printed import printed
from validation import Case, InputError, load_case

#: Above 0.883 MPa, where a cap of 1000 MPa/mm begins.
PRESSURE = 2.0


def changed(pressure: float, **sections: dict[str, object]) -> Case:
    data = column(pressure).keys
    for name, values in sections.items():
        data[name] = data.get(name, {}) | values
    return load_case(data)


def test_a_scene_without_a_cap_follows_the_law_of_the_text() -> None:
    run = on_its_mesh(column(PRESSURE), method="static")
    # Without lateral strain every joint closes by the law's inverse, every box by p h / E; the
    # residual is 1e-8 of the load, and a joint is as stiff as the boxes within tenfold.
    top = 2 * overclosure(PRESSURE) + PRESSURE * 160.0 / 33e3
    assert run.details.largest_displacement == pytest.approx(top, rel=1e-7)
    assert run.as_dict()["contact_cap"] is None


def test_a_cap_says_where_it_acted(tmp_path: Path) -> None:
    capped = changed(PRESSURE, contact={"maximum_stiffness": 1000.0})
    run = on_its_mesh(capped, method="static")
    found = run.as_dict()["contact_cap"]
    points = 2 * 3 * 2 * 4
    assert found["points"] == found["pressing_points"] == points
    assert found["force_share"] == pytest.approx(1.0, rel=1e-12)
    # Linear from the cap on: 1.117 MPa at 1000 MPa/mm more for each joint.
    start = run.details.whole.contact.law.constants
    deep = start.linear_start + (PRESSURE - start.linear_pressure) / 1000.0
    np.testing.assert_allclose(run.details.contact_state.point_overclosures, deep, rtol=1e-7)
    told = printed(capped, tmp_path)
    assert f"at {points} of {points} closed contact points, 100 %" in told
    idle = on_its_mesh(changed(0.5, contact={"maximum_stiffness": 1000.0}), method="static")
    assert idle.as_dict()["contact_cap"]["points"] == 0


def test_decks_carry_a_cap_and_say_where_there_is_none() -> None:
    plain = problem_deck(column(PRESSURE).problem, Flavour.GENERAL)
    assert any("no maximum stiffness" in note for note in plain.notes)
    problem = changed(PRESSURE, contact={"maximum_stiffness": 1000.0}).problem
    capped = problem_deck(problem, Flavour.GENERAL)
    assert not any("no maximum stiffness" in note for note in capped.notes)
    assert "0.001, 0.0001, 1000.0" in deck_lines(capped)


def test_a_run_that_outgrows_its_time_step_starts_again(tmp_path: Path) -> None:
    """8 MPa is eight times what the first time step counts in, beyond its margin of safety."""
    pressure = 8.0
    case = column(pressure).with_method("explicit")
    stated = stated_run(case.problem, case.method)
    longest = stated.critical.critical_time_step
    frames: list[Frame] = []
    moving = changed(pressure, fem={"method": "explicit", "frames": 5})
    run = on_its_mesh(moving, on_frame=frames.append)
    result = run.details.run
    assert result is not None
    assert result.critical.critical_time_step < longest
    assert run.details.run.restarts >= 1
    words = f"{run.details.run.restarts}: the contact stiffness exceeded the limit of the time step"
    assert words in printed(changed(pressure, fem={"method": "explicit"}), tmp_path)
    # Frames of abandoned runs are marked: the others are one history from its start to its end.
    kept = [frame for frame in frames if frame.restart == run.details.run.restarts]
    assert len(kept) < len(frames)
    assert [frame.number for frame in kept] == list(range(len(kept)))
    assert kept[-1].last
    assert run.details.run.stated.counted_pressure >= 4.0
    top = 2 * overclosure(pressure) + pressure * 160.0 / 33e3
    # Damped until the residual is 1e-4 of the load.
    assert run.details.largest_displacement == pytest.approx(top, rel=1e-3)
    # A time step that the scene gives stays: the remedy is named instead.
    given = {"method": "explicit", "time_step": 0.99 * longest, "sample_interval": 1}
    with pytest.raises(InputError, match=r"reached .* MPa.*time step .* allows"):
        on_its_mesh(changed(pressure, fem=given), method="explicit")
