"""One scene, one problem: solvers and exported decks mean the same gaps and the same weight."""

from __future__ import annotations

import numpy as np
import pytest

from fem import ExponentialLaw, Frames, Material
from fem.decks.deck import Flavour
from fem.decks.laws import law_table
from fem.decks.problem import problem_deck
from fem.explicit.setup.timed_system import timed_system
from fem.system.effects import EffectError, Effects
from fem.system.system import System
from geometry import ColumnBox, RefusedError, box_column
from geometry.loads import face_pressure
from tests.support.coarse_tubes import coarse
from tests.support.fem_problems import deformable_assembly
from validation import load_case, solve

COARSE = coarse(2, 2, 2)
CONCRETE = Material(density=2.4e-9, young_modulus=33_000.0, poisson_ratio=0.2)
GRAVITY = np.array([0.0, 0.0, -9810.0])


def test_clearance_and_spacing_are_two_gaps() -> None:
    """A uniform gap is 0.01 mm on every facet; blocks moved apart open wavy joints unevenly."""
    gaps = {}
    for kind in ("clearance", "spacing"):
        file = load_case("tsb1-pipe", [*COARSE, f"contact.{kind}=0.01"])
        gaps[kind] = file.problem.system.surfaces.initial_gaps
    # Facets coincide up to rounding of coordinates of 400 mm.
    assert np.abs(gaps["clearance"] - 0.01).max() < 1e-12
    assert gaps["spacing"].min() < 0.005
    assert gaps["spacing"].max() > 0.011


def test_pairs_that_slide_freely_take_no_clearance_and_general_contact_does() -> None:
    settings = [*COARSE, "effects.finite_sliding=true", "contact.clearance=0.01"]
    problem = load_case("tsb1-pipe", settings).problem
    with pytest.raises(RefusedError, match=r"clearance: got 0\.01 mm.*expected --flavour general"):
        problem_deck(problem, Flavour.STANDARD)
    assert problem_deck(problem, Flavour.GENERAL).problem.clearance == 0.01


def test_the_table_for_calculix_is_moved_by_the_clearance() -> None:
    law, clearance = ExponentialLaw(), 0.01
    pressure, overclosure = law_table(law, clearance)[:-1].T
    assert np.allclose(law.pressure(overclosure - clearance), pressure, rtol=1e-12, atol=1e-15)
    problem = load_case("tsb1-pipe", [*COARSE, "contact.clearance=0.01"]).problem
    deck = problem_deck(problem, Flavour.CALCULIX)
    assert "moved by the clearance" in " ".join(deck.notes)


def weighing_column() -> System:
    """Two boxes, the lower one standing; the upper one's weight is twenty times the pressure."""
    boxes = box_column([ColumnBox((40.0, 40.0, 60.0), (2, 2, 2))] * 2)
    load = face_pressure(boxes, np.array([1]), "z+", 1e-4)
    return deformable_assembly(boxes, load, CONCRETE, frames=Frames.DEFORMABLE, gravity=GRAVITY)


def test_gravity_is_stated_once() -> None:
    column = weighing_column()
    assert np.array_equal(timed_system(column).effects.gravity, GRAVITY)
    same = timed_system(column, effects=Effects(gravity=GRAVITY.copy()))
    assert np.array_equal(same.effects.gravity, GRAVITY)
    with pytest.raises(EffectError, match="where the assembly has"):
        timed_system(column, effects=Effects(gravity=2.0 * GRAVITY))


def test_rigid_blocks_carry_the_weight_that_the_scene_states() -> None:
    """A column's lowest joint bears the pressure and all that stands above it."""
    gravity = "effects.gravity=[0.0, 0.0, -9810.0]"
    weightless, heavy = (solve(load_case("column", s, method="rigid")) for s in ((), (gravity,)))
    found = []
    for run in (weightless, heavy):
        joints = run.details.blocks.interfaces
        lowest = joints.block_m[run.details.contact_index] == 0
        found.append(run.details.contact_forces[lowest].sum())
    above = heavy.details.blocks.volumes[1:].sum()
    density = heavy.case.scene.material.density  # type: ignore[union-attr]
    # The equilibrium's residual is below 1e-6 of the forces.
    assert found[1] - found[0] == pytest.approx(density * 9810.0 * above, rel=1e-5)
    data = load_case("column", (gravity,)).keys
    del data["material"]
    # Without a material the blocks are of concrete, as this scene says itself.
    unstated = solve(load_case(data, method="rigid"))
    np.testing.assert_allclose(unstated.details.contact_forces, heavy.details.contact_forces)
