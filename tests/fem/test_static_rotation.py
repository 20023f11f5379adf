"""Static states with finite rotation: against explicit dynamics, and where they end."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fem import CoulombFriction, Frames, LinearPenalty, Material
from fem.explicit.setup.timed_system import timed_system
from fem.explicit.solve import StopCriterion, solve
from fem.static import rotation
from fem.static.result import StaticError
from fem.static.rotation import solve_static_with_rotation
from fem.static.solve import StaticOptions, solve_static
from fem.stresses.recovery import block_displacements, turned_rigidly
from fem.system.effects import AdaptiveMassDamping, Effects
from geometry import HexagonBlock, SineBlock
from geometry.families.boxes import ColumnBox, box_column
from geometry.families.hexagon_block import HexagonBlockDivisions
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import HexagonTube, SineTube
from geometry.loads import face_pressure, named_load
from tests.support.fem_problems import deformable_assembly

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)
TSB1 = SineBlock(
    height=200.0,
    amplitude=20.0,
    frequency=1.5,
    shift=0.0,
    blocks_per_layer=4,
    inner_radius=120.0,
    thickness=40.0,
)


def pipe(clearance):
    assembly = SineTube(TSB1, SineBlockDivisions(12, 2, 4), 2).build()
    load = named_load("pipe", 0.01).on(assembly)
    return deformable_assembly(assembly, load, CONCRETE, clearance=clearance)


@pytest.fixture(scope="module")
def turned():
    """Blocks turn by 2 mrad in gaps of 0.1 mm before they press."""
    return solve_static_with_rotation(pipe(0.1))


def test_explicit_dynamics_ends_in_the_same_state(turned):
    """The explicit run stops 1e-6 of the load away: its softest motion amplifies that by 1e2."""
    deformable = turned.deformable
    effects = Effects(finite_rotation=True, adaptive_mass_damping=AdaptiveMassDamping())
    stated = timed_system(
        deformable,
        counted_pressure=10.0,  # above what presses here
        effects=effects,
    )
    run = solve(
        stated,
        end_time=10 * stated.end_time,
        stop=StopCriterion(residual=1e-6, not_before=stated.ramp_time),
    )
    found = stated.expand(run.displacements)
    for moving, still in zip(found, turned.displacements, strict=True):
        assert np.abs(moving - still).max() < 1e-4 * np.abs(still).max()


def test_rotation_matters_and_the_residual_counts_it(turned):
    """Turns of 2 mrad taken for strain, 2e-6 times E, are 0.07 MPa: more than the pressure."""
    straight = solve_static(pipe(0.1))
    assert turned.converged
    assert turned.residual <= 2e-8
    assert "finite rotation in" in turned.evidence.status
    change = abs(turned.pressures.max() / straight.pressures.max() - 1.0)
    assert change > 3e-3


def test_energies_are_those_of_the_turned_blocks(turned):
    """Dead loads do more work than is stored: what is stored is the work of the growing load.

    A turn taken for strain would be E θ² V = 33e3 · 5e-6 · 7e6 = 1e6 N mm more.
    """
    assert turned.strain_energy > 0.0
    assert turned.strain_energy + turned.contact_energy < turned.external_work


def test_soft_motions_do_not_stop_the_rounds():
    """Hexagons in gaps: forces left by one round turn blocks by more than the next can tell.

    Rounds solved to the tolerance alone changed by 1e-7 of the load for ever.
    """
    block = HexagonBlock(4, 120.0, 40.0)
    assembly = HexagonTube(block, HexagonBlockDivisions(4, 2), 2).build()
    load = named_load("shaft", 0.01).on(assembly)
    result = solve_static_with_rotation(
        deformable_assembly(assembly, load, CONCRETE, clearance=0.01)
    )
    assert result.converged
    assert result.residual <= 2e-8


def test_blocks_that_turn_too_far_are_refused():
    with pytest.raises(StaticError, match="explicit"):
        solve_static_with_rotation(pipe(0.5))


def leaning_block(share, gap=1.0):
    """A block of 40 × 60 × 120 mm on a plate, and a fixed stop beside its upper quarter."""
    boxes = box_column(
        [
            ColumnBox((80.0, 100.0, 20.0), (4, 4, 1)),
            ColumnBox((20.0, 60.0, 30.0), (2, 3, 2)),
            ColumnBox((40.0, 60.0, 120.0), (3, 3, 3)),
        ]
    )
    places = np.array([[-40.0, -50.0, 0.0], [20.0 + gap, -30.0, 110.0], [-20.0, -30.0, 20.0]])
    shapes = tuple(replace(s, contact_faces=tuple(s.faces)) for s in boxes.shapes)
    boxes = replace(boxes, translations=places, shapes=shapes)
    load = face_pressure(boxes, np.array([2]), "z+", 1e-12)
    return deformable_assembly(
        boxes,
        replace(load, fixed=np.array([True, True, False])),
        CONCRETE,
        law=LinearPenalty(1e3),
        frames=Frames.RIGID,
        finite_sliding=True,
        friction=CoulombFriction(0.6),
        gravity=9810.0 * np.array([share / 3.0, 0.0, -1.0]),
    )


@pytest.mark.parametrize("share", [1.1, 2.0])
def test_a_block_that_tips_against_a_stop_presses_by_its_moment(share):
    """Weight W and a push of W t / 3 tip it about its edge until its top has moved by 1 mm. In the
    turned place, with the sine s = 1 / 120 and the cosine c, the middle is 20 c - 60 s beside the
    edge and 60 c + 20 s above it, and the stop touches 120 c above it, with friction of 0.6 R at
    most 1 mm from it, c - 1 and depths of 1e-3 mm aside: 0.6 % of R."""
    found = solve_static_with_rotation(leaning_block(share))
    assert found.converged
    assert found.residual <= 2e-8
    weight = 2.4e-9 * 9810.0 * 40.0 * 60.0 * 120.0
    s = 1.0 / 120.0
    c = np.sqrt(1.0 - s * s)
    moment = weight * (share / 3.0 * (60.0 * c + 20.0 * s) - (20.0 * c - 60.0 * s))
    state = found.contact_state
    stop = (state.block_m == 1) | (state.block_s == 1)
    reaction = abs(state.forces[stop, 0].sum())
    assert reaction == pytest.approx(moment / (120.0 * c), rel=6e-3)


def test_a_linear_rotation_becomes_a_finite_one_about_the_same_axis():
    """It moves nodes as R - 1 does, whichever way a block was placed, and leaves its middle."""
    group = pipe(0.0).bodies[0]
    nodes = group.reference_positions()
    middle = group.lumped_mass @ nodes / group.lumped_mass.sum()
    axis, angle = np.array([2.0, -1.0, 2.0]) / 3.0, 0.3
    arms = nodes - middle[:, None]
    linear = np.tan(angle) * np.cross(axis, arms)
    finite = arms @ Rotation.from_rotvec(angle * axis).as_matrix().T - arms
    assert turned_rigidly(group, linear + 5.0) == pytest.approx(finite + 5.0, abs=1e-9)


def test_a_small_turn_of_a_block_gives_no_strain():
    """Displacements have 16 digits: what is left is 1e-7 of them by the second order alone."""
    group = pipe(0.0).bodies[0]
    angle = 1e-7
    moved = np.cross([0.0, angle, 0.0], group.reference_positions())
    local, _ = block_displacements(group, moved, finite_rotation=True)
    assert np.abs(local).max() < angle**2 * np.ptp(group.mesh.nodes)


def test_a_round_without_equilibrium_is_one_of_blocks_that_turn_too_far(monkeypatch):
    """The first round is one of small rotations; "Newton did not converge" names no rotation."""

    def ends(*arguments, start=None, **stated):
        found = solve_static(*arguments, start=start, **stated)
        away = replace(found.evidence, residuals=(1e-4,), converged=False)
        return found if start is None else replace(found, evidence=away)

    monkeypatch.setattr(rotation, "solve_static", ends)
    with pytest.raises(StaticError, match=r"blocks turn too far .* after 1 rounds"):
        solve_static_with_rotation(pipe(0.1))


def test_rounds_that_stagnate_below_the_tolerance_are_an_answer(monkeypatch, turned):
    """Each round is asked for a hundredth of the tolerance; round-off may end it before."""

    def stagnating(*arguments, **stated):
        state = solve_static(*arguments, **stated)
        near = replace(state.evidence, residuals=(3e-10,), converged=False)
        return replace(state, evidence=near)

    monkeypatch.setattr(rotation, "solve_static", stagnating)
    found = solve_static_with_rotation(pipe(0.1), StaticOptions(tolerance=1e-8))
    assert found.converged
    assert "did not converge" not in found.evidence.status
    # Residuals of 1e-8 of the load, which the softest motion amplifies by 1e2.
    for moved, expected in zip(found.displacements, turned.displacements, strict=True):
        assert np.abs(moved - expected).max() < 1e-5 * np.abs(expected).max()
    rough = solve_static_with_rotation(pipe(0.1), StaticOptions(tolerance=1e-10))
    assert not rough.converged
