"""Laws of tubes: conforming interfaces, congruence, balance of areas, bad parameters refused."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry import Assembly, HexagonBlock
from geometry.answer import is_round
from geometry.assembly import moved, renumbered
from geometry.errors import RefusedError
from geometry.families.hexagon_block import HexagonBlockDivisions
from geometry.families.planar_wall import OsteomorphicWall, PlanarSineWall
from geometry.families.sine_block import (
    BlockParameterError,
    LayerTurn,
    SineBlockDivisions,
    wave,
    waves_of_turn,
)
from geometry.families.tube import HexagonTube, SineTube
from geometry.loads import LoadCaseError, named_load
from geometry.parts.placed import AssemblyError
from mbd import analyse
from tests.support.blocks import random_rotation, tsb

pytestmark = pytest.mark.quick


@given(
    waves=st.integers(1, 5),
    shift=st.floats(-2.0, 2.0),
    blocks=st.integers(2, 9),
    layers=st.integers(1, 4),
    amplitude=st.floats(0.0, 60.0),
)
@settings(max_examples=30, deadline=None)
def test_every_contact_facet_of_every_free_block_meets_its_twin(
    waves: int, shift: float, blocks: int, layers: int, amplitude: float
) -> None:
    parameters = tsb(shift, frequency=waves / 2, blocks_per_layer=blocks, amplitude=amplitude)
    tube = SineTube(parameters, SineBlockDivisions(4 * waves, 2, 2), layers).build()
    found = tube.interfaces  # raises AssemblyError where a facet of a free block is alone
    facets = 4 * waves * 2
    sides = 2 * (blocks * layers * 2 + blocks * 2)
    assert found.n_contacts == blocks * (layers + 1) * facets + sides // 2 * 2
    assert (found.block_m < found.block_s).all()


def test_matched_nodes_coincide_and_normals_oppose(small_tube: Assembly) -> None:
    found = small_tube.interfaces
    for contact in range(0, found.n_contacts, 37):
        m, s = found.block_m[contact], found.block_s[contact]
        corner_m = small_tube.nodes(m)[found.quads_m[contact]]
        corner_s = small_tube.nodes(s)[found.quads_s[contact]]
        # Coordinates up to 600 mm, rotated once: a few roundings of 1e-13 mm.
        np.testing.assert_allclose(corner_s, corner_m, atol=1e-11)
        arm = small_tube.centroids[s] - small_tube.centroids[m]
        assert found.normals[contact] @ arm > 0


def test_surface_of_a_free_block_is_closed(small_tube: Assembly) -> None:
    # Vector areas of the four contact faces and the two curved ones sum to zero.
    shape = small_tube.shapes[0]
    total = sum(shape.surface(name).area_vectors.sum(axis=0) for name in shape.faces)
    area = sum(shape.surface(name).areas.sum() for name in shape.faces)
    assert np.abs(total).max() < 1e-13 * area


def test_free_blocks_share_one_shape_and_layers_stack(small_tube: Assembly) -> None:
    assert set(small_tube.shape_of[small_tube.free_blocks]) == {0}
    np.testing.assert_allclose(small_tube.centroids[small_tube.layer == 2][:, 2].mean(), 300.0)
    np.testing.assert_array_equal(np.bincount(small_tube.layer), [4] * 5)
    ends = [small_tube.nodes(b)[:, 2] for b in (0, small_tube.n_blocks - 1)]
    # 3 layers of 200 mm and two frames of 100 mm.
    assert ends[1].max() - ends[0].min() == pytest.approx(800.0, rel=1e-14)


@pytest.mark.parametrize(("shift", "frequency"), [(0.0, 1.5), (0.5, 1.0), (0.3, 2.0)])
def test_the_outer_face_is_at_the_outer_radius_and_as_steep_as_stated(
    shift: float, frequency: float
) -> None:
    """Chords of n per wave are flatter than the tangent where it is steepest: by (π/n)²/6."""
    waves, n = round(2 * frequency), 48
    block = tsb(shift, frequency=frequency)
    built = SineTube(block, SineBlockDivisions(waves * n, 2, 2), 1).build()
    shape = built.shape(int(built.free_blocks[0]))
    radius = np.hypot(*(shape.mesh.nodes - built.origin)[:, :2].T)
    assert radius.max() == pytest.approx(block.outer_radius, rel=1e-12)
    assert radius.min() == pytest.approx(block.inner_radius, rel=1e-12)
    corners = shape.mesh.nodes[shape.faces["top"]]
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    away = np.hypot(ends[..., 0], ends[..., 1])
    ends = ends[(np.abs(away - block.outer_radius) < 1e-9).all(axis=1)]
    arc = block.outer_radius * 2 * np.pi / (block.blocks_per_layer * waves * n)
    slope = np.abs(ends[:, 1, 2] - ends[:, 0, 2]).max() / arc
    # A node at a zero of the wave or half a chord beside it: (π/n)²/2 at most.
    assert block.steepest_slope * (1 - (np.pi / n) ** 2) <= slope <= block.steepest_slope


def test_pressure_resultants_are_closed_forms(small_tube: Assembly) -> None:
    # A uniform pressure on a whole ring has no resultant; on the flat top it is p A with the
    # area of the inscribed polygon.
    pipe = named_load("pipe", 0.01).on(small_tube)
    assert np.abs(pipe.facet_forces.sum(axis=0)).max() < 1e-12 * np.abs(pipe.facet_forces).sum()
    pillar = named_load("pillar", 0.01).on(small_tube)
    polygon = 0.5 * 96 * np.sin(2 * np.pi / 96) * (160.0**2 - 120.0**2)
    np.testing.assert_allclose(
        pillar.facet_forces.sum(axis=0), [0, 0, -0.01 * polygon], atol=1e-12 * polygon
    )
    shaft = named_load("shaft", 0.01).on(small_tube)
    moment = np.cross(shaft.centroids, shaft.facet_forces).sum(axis=0)
    arm = np.linalg.norm(shaft.centroids[:, :2], axis=1)
    area = np.linalg.norm(shaft.area_vectors, axis=1)
    assert moment[2] == pytest.approx(0.01 * float(arm @ area), rel=1e-12)


def test_loads_turn_with_the_assembly(small_tube: Assembly) -> None:
    turn, shift = random_rotation(1), np.array([10.0, 20.0, -5.0])
    there = moved(small_tube, turn, shift)
    for name in ("pipe", "tunnel", "pillar", "beam", "shaft"):
        for as_printed in (False, True):
            a = named_load(name, 0.01, as_printed=as_printed).on(small_tube).facet_forces
            b = named_load(name, 0.01, as_printed=as_printed).on(there).facet_forces
            np.testing.assert_allclose(b, a @ turn.T, atol=1e-12 * np.abs(a).max())


@pytest.mark.parametrize("shuffled", [False, True])
def test_interfaces_are_those_of_a_search_among_all_facets(shuffled: bool) -> None:
    """Each way two blocks lie side by side is searched once: against all pairs, in the world."""
    tube = SineTube(tsb(0.4), SineBlockDivisions(12, 2, 3), 3).build()
    tube = moved(tube, random_rotation(2), np.array([5.0, -8.0, 300.0]))
    if shuffled:
        tube = renumbered(tube, np.random.default_rng(1).permutation(tube.n_blocks))
    owner, corners = [], []
    for b in range(tube.n_blocks):
        quads = tube.shape(b).contact_quads
        owner.append(np.full(len(quads), b))
        corners.append(tube.nodes(b)[quads])
    block, corner = np.concatenate(owner), np.concatenate(corners)
    centroid = corner.mean(axis=1)
    apart = np.linalg.norm(centroid[:, None] - centroid[None], axis=2)
    i, j = np.nonzero((apart < 1e-6) & (block[:, None] < block[None]))
    found = tube.interfaces
    assert found.n_contacts == len(i)
    expected = np.column_stack([block[i], block[j], np.round(centroid[i], 6)])
    ours = np.column_stack([found.block_m, found.block_s, np.round(found.centroids, 6)])
    np.testing.assert_allclose(
        ours[np.lexsort(ours.T)], expected[np.lexsort(expected.T)], atol=2e-6
    )
    for n in range(found.n_contacts):
        m, s = int(found.block_m[n]), int(found.block_s[n])
        mine, other = tube.nodes(m)[found.quads_m[n]], tube.nodes(s)[found.quads_s[n]]
        np.testing.assert_allclose(mine, other, atol=1e-9)
        vector = 0.5 * np.cross(mine[2] - mine[0], mine[3] - mine[1])
        np.testing.assert_allclose(found.normals[n] * found.areas[n], vector, atol=1e-9)
    assert len(np.unique(found.pair_class)) < found.n_pairs


@pytest.mark.parametrize(
    ("frequency", "turn", "share"),
    [
        (1.0, "half block", 1 / 2),
        (1.0, "one wave", 1 / 2),
        (1.5, "half block", 1 / 3),
        (1.5, 2, 2 / 3),
        (2.0, "half block", 1 / 2),
        (2.0, "one wave", 1 / 4),
        (2.0, 0, 0.0),
    ],
)
def test_odd_layers_turn_by_whole_waves(frequency: float, turn: str | int, share: float) -> None:
    """Whatever the whole number of waves, every contact facet of a free block meets another."""
    block = tsb(frequency=frequency)
    named = LayerTurn(turn) if isinstance(turn, str) else turn
    tube = SineTube(block, SineBlockDivisions(12, 2, 2), 2, named).build()
    first = [tube.rotations[tube.layer == k][0] for k in (0, 1, 2)]
    angle = np.arctan2(first[1][1, 0], first[1][0, 0])
    assert angle == pytest.approx(share * block.block_angle, abs=1e-14)
    np.testing.assert_array_equal(first[0], first[2])
    ends = np.concatenate([tube.interfaces.block_m, tube.interfaces.block_s])
    met = np.bincount(ends, minlength=tube.n_blocks)
    assert (met[tube.free_blocks] == tube.eligible_facets()[tube.free_blocks]).all()


@pytest.mark.parametrize("turn", [0.25, 0.5, 1.3])
def test_depth_of_a_collision_is_that_of_the_faces(turn: float) -> None:
    """2 a |sin π turn| against the faces themselves, sampled: of second order in the step."""
    block = tsb(frequency=2.0)
    u = np.linspace(0.0, 1.0, 4001)
    outer = np.full_like(u, block.outer_radius)
    apart = wave(block, u, outer) - wave(block, u + turn / block.waves_per_block, outer)
    with pytest.raises(BlockParameterError) as error:
        waves_of_turn(block, turn)
    depth = float(str(error.value).split("up to ")[1].split(" mm")[0])
    assert depth == pytest.approx(np.abs(apart).max(), rel=5.1e-3)


def test_s_and_s_plus_one_are_one_tube_upside_down() -> None:
    """Under a load that knows no direction: why s = 0.5 and 1.5 are one design of the study."""
    found = []
    for shift in (0.5, 1.5):
        tube = SineTube(tsb(shift), SineBlockDivisions(12, 2, 4), 2).build()
        result = analyse(tube, load=named_load("pipe", 0.01).on(tube)).details
        found.append(np.sort(result.contact_pressures))
    np.testing.assert_allclose(found[0], found[1], atol=1e-8 * found[0].max())


@pytest.mark.parametrize("family", ["sine", "hexagon"])
def test_shaft_as_printed_acts_at_the_mean_of_the_surface_nodes(family: str) -> None:
    """The named faces of both blocks are their whole surface: an independent list of its nodes."""
    if family == "sine":
        tube = SineTube(tsb(0.5), SineBlockDivisions(12, 3, 4), 1).build()
    else:
        block = HexagonBlock(4, 120.0, 40.0)
        tube = HexagonTube(block, HexagonBlockDivisions(4, 3), 1).build()
    load = named_load("shaft", 0.01, as_printed=True).on(tube)
    for b in np.unique(load.block).tolist():
        shape = tube.shape(b)
        surface = np.unique(np.concatenate([q.ravel() for q in shape.faces.values()]))
        np.testing.assert_array_equal(shape.surface_nodes, surface)
        mean = tube.nodes(b)[surface].mean(axis=0)
        np.testing.assert_allclose(load.centroids[load.block == b] - mean, 0.0, atol=1e-12)


@pytest.mark.parametrize("layers", [1, 2])
def test_two_blocks_are_a_ring_and_the_torque_of_a_shaft_is_that_of_its_traction(
    layers: int,
) -> None:
    """τ times the area of a layer, 2 π R h, at the radius R; facets are chords of the circle.

    Their centroids lie in a line as those of a wall do: a shaft of one layer was rejected.
    """
    block = tsb(blocks_per_layer=2, frequency=1.0)
    tube = SineTube(block, SineBlockDivisions(48, 3, 4), layers).build()
    assert is_round(tube)
    load = named_load("shaft", 0.01).on(tube)
    torque = np.cross(load.centroids, load.facet_forces).sum(axis=0)
    by_hand = 0.01 * 2.0 * np.pi * 160.0**2 * 200.0
    chord = (np.pi / 48) ** 2 / 2  # areas and radii of chords of 2 π / 96, each to half of that
    np.testing.assert_allclose(torque[:2], 0.0, atol=1e-9 * by_hand)
    assert by_hand * (1.0 - 2.0 * chord) <= abs(torque[2]) <= by_hand


def test_a_wall_has_no_axis_for_a_traction_to_go_round() -> None:
    block = (160.0, 50.0, 150.0, 12.0)
    wall = PlanarSineWall(*block, 1.0, 0.5, divisions=(8, 2, 4), columns=2, layers=2).build()
    with pytest.raises(LoadCaseError, match=r"got shaft, .* blocks stand in no ring; expected one"):
        named_load("shaft", 0.01).on(wall)
    assert len(named_load("tunnel", 0.01).on(wall).facet_forces)


@pytest.mark.parametrize("grading", [0.5, 1.0, 8.0])
def test_graded_walls_conform_nest_and_keep_the_volume(grading: float) -> None:
    coarse = SineBlockDivisions(12, 3, 4, radial_grading=grading)
    fine = SineBlockDivisions(12, 6, 4, radial_grading=grading)
    # One map of equal steps: every second place of the finer wall is one of the coarser.
    np.testing.assert_allclose(fine.radial_positions[::2], coarse.radial_positions, atol=1e-15)
    many = np.diff(SineBlockDivisions(12, 4000, 4, radial_grading=grading).radial_positions)
    # Lengths of the first and last of n elements: half an element from the ends, 1/n off.
    assert many[0] / many[-1] == pytest.approx(grading, rel=2e-3)
    tube = SineTube(tsb(0.0), coarse, 1).build()
    assert tube.interfaces.n_contacts > 0


def test_a_grading_that_is_no_ratio_is_refused() -> None:
    with pytest.raises(RefusedError, match="radial_grading"):
        SineTube(tsb(0.0), SineBlockDivisions(12, 3, 4, radial_grading=0.0), 1).build()


def test_elements_that_meet_the_wave_at_its_zeros_are_refused() -> None:
    """Two elements a wave: with shift 0 the Sine Block was a plain one, and its tube activated."""
    with pytest.raises(BlockParameterError, match=r"amplitude of \S+ mm for 20 mm; try 12"):
        SineTube(tsb(0.0), SineBlockDivisions(6, 2, 2), 1).build()
    # Corners reach |sin(π s)| of the amplitude; an eighth of a wave from the zeros is s = 1/4.
    for shift, accepted in ((0.05, False), (0.2, False), (0.24, False), (0.25, True), (0.3, True)):
        with (
            nullcontext()
            if accepted
            else pytest.raises(BlockParameterError, match="near its zeros")
        ):
            SineTube(tsb(shift), SineBlockDivisions(6, 2, 2), 1).build()
    cosine = SineTube(tsb(0.5), SineBlockDivisions(6, 2, 2), 1).build()
    z = cosine.shapes[0].mesh.nodes[:, 2]
    assert np.ptp(z) == pytest.approx(200.0 + 2 * 20.0)
    # Four corners a wave reach at least 1/√2 of the amplitude, whatever the phase.
    for shift in np.linspace(0.0, 1.0, 9):
        SineTube(tsb(shift), SineBlockDivisions(12, 2, 2), 1).build()
    wall = (200.0, 40.0, 120.0, 8.0)
    with pytest.raises(AssemblyError, match="for 8 mm; expected more elements"):
        PlanarSineWall(*wall, 1.5, 0.0, divisions=(6, 2, 2), columns=1, layers=1).build()
    with pytest.raises(AssemblyError, match="for 8 mm; expected more elements"):
        OsteomorphicWall(*wall, divisions=(8, 1, 2), columns=1, layers=1).build()
