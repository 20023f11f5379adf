"""Explicit runs with rollers, moving supports, springs and line loads, against static answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from fem import Explicit, Problem, concrete, solve_explicit, solve_static
from fem.answer.forces import imbalance_of, joints_of, reactions_of
from fem.problem import Motion
from fem.system.effects import Effects
from fem.system.sector import SymmetryError
from fem.system.time_step import critical_time_step
from geometry.loads import LineLoad
from tests.support.answers import PLAIN, on_its_mesh
from tests.support.coarse_tubes import coarse, pressed
from tests.support.supports import ONE, TWO, A, X, Y, Z, case, pulled, roller
from validation import load_case

SIDES = tuple(roller(ONE, 0, -axis) for axis in (X, Y))
TOP = ONE.centroids[0] + 0.5 * A * np.ones(3)
EDGE = LineLoad(np.array([0]), TOP - A * Y, TOP, np.array([1.0, 0.0, -3.0]))
GUIDES = tuple(roller(TWO, 1, -axis) for axis in (X, Y))
CASES = {
    "traction on rollers": case(ONE, [pulled(ONE, 0, X, 0.5 * X)], (*SIDES, roller(ONE, 0, -Z))),
    "line load on rollers": case(ONE, held=(*SIDES, roller(ONE, 0, -Z)), lines=[EDGE]),
    "line load on springs": case(ONE, held=(*SIDES, roller(ONE, 0, -Z, spring=2.0)), lines=[EDGE]),
    "support that moves": case(TWO, held=(*GUIDES, roller(TWO, 1, Z, displacement=-0.01 * Z))),
    "support that moves by a table": case(
        TWO,
        held=(
            *GUIDES,
            roller(TWO, 1, Z, displacement=-0.01 * Z, path=((0, 0), (0.002, 0.5), (0.004, 1))),
        ),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_damped_runs_come_to_the_static_state(name: str) -> None:
    problem = Problem(CASES[name].assembly, CASES[name], concrete)
    static = solve_static(problem, PLAIN).fields["displacement"]
    end = 0.02 if CASES[name].assembly is ONE else None
    explicit = solve_explicit(
        problem,
        Explicit(damping="static", end_time=end),
    ).fields["displacement"]
    assert np.abs(explicit - static).max() <= 1e-3 * np.abs(static).max()
    assert np.abs(static).max() > 0.0


def test_forces_of_supports_come_to_those_of_the_static_state() -> None:
    """Force against displacement is that of the static path, but for waves.

    A support that starts at a velocity v sends a wave of the force ρ c v A, twice that where it
    comes back from the fixed cube. The end of the run is static to the bound of its residual.
    """
    problem = Problem(TWO, CASES["support that moves by a table"], concrete)
    (static, run) = (
        solve_static(problem, PLAIN).as_dict(),
        solve_explicit(problem, Explicit()).as_dict(),
    )
    assert set(run["reactions"]) == set(static["reactions"])
    size = abs(static["motions"][0]["force"][-1])
    for name, reaction in static["reactions"].items():
        assert run["reactions"][name]["force"] == pytest.approx(reaction["force"], abs=1e-4 * size)
    (curve,), (path,) = run["motions"], static["motions"]
    assert curve["force"][-1] == pytest.approx(size, rel=1e-4)
    assert curve["displacement"][-1] == pytest.approx(0.01, rel=1e-9)
    expected = np.interp(curve["displacement"], path["displacement"], path["force"])
    wave = concrete.density * concrete.bar_wave_speed * (0.005 / 0.002) * A**2
    assert np.abs(curve["force"] - expected).max() < 2.0 * wave < 0.03 * size


@pytest.mark.parametrize("quarters", [1, 2])
def test_a_block_swings_on_springs_with_the_period_of_the_closed_form(quarters: int) -> None:
    """T = 2π √(m / k A): after T/4 the block has gone v T / 2π, after T/2 it is back.

    Its own compliance lengthens the period by k L / 6 E = 4e-5, the step is far below T.
    """
    stiffness, speed = 0.2, 10.0
    load = case(ONE, held=(*SIDES, roller(ONE, 0, -Z, spring=stiffness)))
    mass = concrete.density * A**3
    period = 2.0 * np.pi * np.sqrt(mass / (stiffness * A * A))
    problem = Problem(ONE, load, concrete, motion=Motion(speed * Z, np.zeros(3)))
    answer = solve_explicit(problem, Explicit(damping="none", end_time=quarters * period / 4.0))
    moved = answer.fields["displacement"][:, 2].mean() * 2.0 * np.pi / (speed * period)
    assert moved == pytest.approx(1.0 if quarters == 1 else 0.0, abs=2e-3)


def test_the_time_step_is_that_of_block_and_springs() -> None:
    """2/ω of K + springs, by a dense solver: springs count once."""
    load = case(ONE, held=(*SIDES, roller(ONE, 0, -Z, spring=5e3)))
    (group,) = Problem(ONE, load, concrete).system.bodies
    squares = eigh(
        group.stiffness.toarray(), np.diag(np.repeat(group.lumped_mass, 3)), eigvals_only=True
    )
    step = critical_time_step([group], Effects()).critical_time_step
    assert step == pytest.approx(2.0 / np.sqrt(squares[-1]), rel=1e-5)
    soft = Problem(ONE, case(ONE, held=(*SIDES, roller(ONE, 0, -Z))), concrete).system.bodies
    assert step < 0.9 * critical_time_step(soft, Effects()).critical_time_step


@pytest.mark.parametrize("symmetry", ["sector", "none"])
def test_a_sector_has_the_reactions_of_the_whole_ring(symmetry: str) -> None:
    """Of the ends, and of what both leave of the pressure together: none."""
    small = coarse(1, 2)
    short = ("fem.method=explicit", "fem.end_time=1e-5", "effects.elastic_frame=true")
    case = load_case("tsb1-pipe", [*small, *short, f"fem.symmetry={symmetry}"])
    found = on_its_mesh(case, method="explicit").details
    assert imbalance_of(found).largest < 1e-9
    assert reactions_of(found).keys() == {"bottom", "top"}
    forces = np.array([of["force"] for of in reactions_of(found).values()])
    assert np.abs(forces[:, :2]).max() < 1e-9 * joints_of(found).normal_force.max()


def test_blocks_that_move_across_the_axis_are_all_computed() -> None:
    """Loads of a tube are those of one block of four; a motion along x is not: with every symmetry
    that is exact the answer is that of all blocks, and a sector is none."""
    motion = Motion(np.array([10.0, 0.0, 0.0]), np.zeros(3))
    problem = pressed(motion=motion)
    alone = Explicit(ramp_time=5e-5, end_time=1e-4)
    found, whole = (
        solve_explicit(problem, replace(alone, symmetry=symmetry)).fields["displacement"]
        for symmetry in ("auto", "none")
    )
    np.testing.assert_allclose(found, whole, rtol=0.0, atol=1e-9 * np.abs(whole).max())
    with pytest.raises(SymmetryError, match="move across the axis"):
        solve_explicit(problem, replace(alone, symmetry="sector"))
