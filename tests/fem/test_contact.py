"""Contact kinematics: derivatives, balance of forces and moments, deformable assemblies."""

from dataclasses import replace

import numpy as np
import pytest

from fem import ExponentialLaw, Frames, Material
from fem.contact.normals import ContactNormals
from fem.contact.surfaces import (
    contact_surfaces,
    corner_overclosures,
    facet_pressures,
    motion_derivatives,
)
from fem.system.build import block_load_forces
from geometry.assembly import moved, spacing_offsets
from geometry.families.boxes import BrickStack
from geometry.loads import named_load
from tests.support.coarse_tubes import ring
from tests.support.fem_problems import deformable_assembly

pytestmark = pytest.mark.quick

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)


def small_tube(layers=1):
    return ring(layers, (12, 2, 4))


@pytest.fixture(scope="module")
def surfaces():
    tube = small_tube()
    return contact_surfaces(tube, spacing_offsets(tube, 0.05))


def with_rule(surfaces, normals):
    return surfaces if normals is ContactNormals.CURRENT else surfaces.with_reference_normals


def random_corners(surfaces, size, seed=1):
    return size * np.random.default_rng(seed).standard_normal((surfaces.n_facets, 8, 3))


@pytest.mark.parametrize("normals", list(ContactNormals))
def test_gradient_is_the_slope_of_the_overclosure(surfaces, normals):
    """Central differences along a random direction, step d of displacements of 0.1 mm.

    Facets are 6 mm and more, so third derivatives are of order d/h³ < 1e-2/mm² and the
    difference errs by d²/6 · 1e-2 = 2e-11 at d = 1e-4 mm; rounding of coordinates of 400 mm
    enters as eps · h / d ~ 1e-11.
    """
    corners = random_corners(surfaces, 0.1)
    direction = random_corners(surfaces, 1.0, seed=2)
    d = 1e-4
    plus = with_rule(surfaces, normals).kinematics(corners + d * direction).overclosure
    minus = with_rule(surfaces, normals).kinematics(corners - d * direction).overclosure
    gradient = with_rule(surfaces, normals).kinematics(corners).gradient
    slope = np.einsum("fpai,fai->fp", gradient, direction)
    assert np.abs((plus - minus) / (2 * d) - slope).max() < 1e-9


def test_derivatives_by_motions_are_slopes(surfaces):
    """Chain rule through random motions of order one: sums of 24 products, to 1e-12.

    Central differences of the first derivative as above: second ones are of order 1/h, the next
    ones 1/h² < 0.03/mm², so products of 24 components err by 24 · 1e-8.
    """
    corners = random_corners(surfaces, 0.1)
    motions = np.stack([random_corners(surfaces, 1.0, seed=k) for k in range(3, 8)], axis=3)
    first, second = motion_derivatives(surfaces, corners, motions)
    gradient = surfaces.kinematics(corners).gradient
    assert np.abs(first - np.einsum("fpai,faim->fpm", gradient, motions)).max() < 1e-12
    assert np.abs(second - np.swapaxes(second, 2, 3)).max() < 1e-12
    d = 1e-4
    for k in range(motions.shape[3]):
        way = d * motions[..., k]
        plus, _ = motion_derivatives(surfaces, corners + way, motions)
        minus, _ = motion_derivatives(surfaces, corners - way, motions)
        assert np.abs((plus - minus) / (2 * d) - second[..., k]).max() < 24e-8


def test_action_equals_reaction_and_moments_balance(surfaces):
    """With current normals the energy does not change in a rigid motion of both bodies, so
    forces and moments about the current positions vanish facet by facet, to round-off."""
    corners = random_corners(surfaces, 0.1)
    law = ExponentialLaw()
    forces = surfaces.nodal_forces(corners, law.pressure(surfaces.overclosures(corners)))
    size = np.abs(forces).sum(axis=(1, 2))
    assert size.max() > 1.0
    assert (np.abs(forces.sum(axis=1)).max(axis=1) <= 1e-14 * size).all()
    tube = small_tube()
    spacing = spacing_offsets(tube, 0.05)
    placed = np.array([tube.nodes(b) + spacing[b] for b in range(tube.n_blocks)], dtype=object)
    where = np.concatenate(
        [
            [placed[b][q] for b, q in zip(surfaces.block_m, surfaces.quads_m, strict=True)],
            [placed[b][q] for b, q in zip(surfaces.block_s, surfaces.quads_s, strict=True)],
        ],
        axis=1,
    ).astype(float)
    about = where.mean(axis=1, keepdims=True)
    moment = np.cross(where + corners - about, forces).sum(axis=1)
    # Arms of up to 30 mm, coordinates of 400 mm with eps 1e-16: 1e-13 mm times the forces.
    assert (np.abs(moment).max(axis=1) <= 2e-12 * size).all()


def test_a_rigid_motion_of_everything_changes_no_gap(surfaces):
    """Current normals turn with the bodies: a rotation by one radian leaves every gap."""
    tube = small_tube()
    angle = 1.0
    turn = np.array(
        [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
    )
    spacing = spacing_offsets(tube, 0.05)
    corners = np.empty((surfaces.n_facets, 8, 3))
    for i in range(surfaces.n_facets):
        m, s = int(surfaces.block_m[i]), int(surfaces.block_s[i])
        corners[i, :4] = (tube.nodes(m) + spacing[m])[surfaces.quads_m[i]]
        corners[i, 4:] = (tube.nodes(s) + spacing[s])[surfaces.quads_s[i]]
    still = surfaces.kinematics(np.zeros_like(corners))
    turned = surfaces.kinematics(corners @ turn.T - corners)
    # Coordinates of up to 400 mm: a few roundings of 5e-14 mm each.
    assert np.abs(turned.overclosure - still.overclosure).max() < 1e-12


def test_facet_weights_are_the_areas_of_the_surface(surfaces):
    """Flat side faces: the weights of the points sum to the area exactly (to rounding)."""
    tube = small_tube()
    area = tube.interfaces.areas
    assert surfaces.areas == pytest.approx(area, rel=2e-2)
    flat = np.abs(tube.interfaces.normals[:, 2]) < 1e-12
    assert flat.any()
    assert surfaces.areas[flat] == pytest.approx(area[flat], rel=1e-13)
    uniform = facet_pressures(surfaces, np.full((surfaces.n_facets, 4), 0.3))
    assert uniform == pytest.approx(0.3, rel=1e-14)


def test_spacing_opens_layers_and_neighbours_by_the_clearance():
    """Flat bricks: every gap is the clearance; in a ring the side gaps are."""
    wall = BrickStack((20.0, 10.0, 10.0), (2, 1, 1), columns=3, layers=2).build()
    gaps = contact_surfaces(wall, spacing_offsets(wall, 0.2)).initial_gaps
    assert gaps == pytest.approx(0.2, rel=1e-12)
    tube = small_tube()
    gaps = contact_surfaces(tube, spacing_offsets(tube, 0.2)).initial_gaps
    side = np.abs(tube.interfaces.normals[:, 2]) < 1e-12
    assert gaps[side] == pytest.approx(0.2, rel=1e-12)
    assert gaps.min() > 0.0


def test_loads_are_the_wrench_of_the_load_case():
    """Resultant of a pressure: minus p times the vector area, to round-off. A load without
    couple has no moment about the mean of the block's surface nodes."""
    tube = small_tube(2)
    load = named_load("pipe", 0.01).on(tube)
    block = int(tube.free_blocks[1])
    forces = block_load_forces(tube, load, block)
    expected = load.facet_forces[load.block == block].sum(axis=0) @ tube.rotations[block]
    assert forces.sum(axis=0) == pytest.approx(expected, rel=1e-12, abs=1e-10)
    load = named_load("shaft", 0.01, as_printed=True).on(tube)
    block = int(load.block[0])
    forces = block_load_forces(tube, load, block)
    shape = tube.shape(block)
    mean = shape.mesh.nodes[shape.surface_nodes].mean(axis=0)
    moment = np.cross(shape.mesh.nodes - mean, forces).sum(axis=0)
    assert np.abs(moment).max() < 1e-10 * np.abs(forces).sum() * 100
    assert block_load_forces(tube, load, 0) is None


def test_groups_follow_the_frames():
    tube = small_tube(2)
    load = named_load("pipe", 0.01).on(tube)
    rigid = deformable_assembly(tube, load, CONCRETE)
    assert len(rigid.bodies) == 1
    assert rigid.bodies[0].n_copies == 8
    assert (rigid.body_number[tube.fixed] == -1).all()
    held = deformable_assembly(tube, load, CONCRETE, frames=Frames.DEFORMABLE)
    assert len(held.bodies) == 3
    # Frame blocks are held, and no others.
    supported = np.unique(held.supports.block)
    assert supported.tolist() == np.flatnonzero(tube.fixed).tolist()
    # Frame blocks meet each other: those facets are there only when they deform.
    assert held.surfaces.n_facets > rigid.surfaces.n_facets


def test_moving_the_tube_moves_the_surfaces():
    """Weights and gaps are invariant, normals turn (rounding of 1e3 mm coordinates)."""
    tube = small_tube()
    turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    there = moved(tube, turn, np.array([1e3, -2e3, 5e2]))
    a = contact_surfaces(tube, spacing_offsets(tube, 0.05))
    b = contact_surfaces(there, spacing_offsets(there, 0.05))
    assert b.weights == pytest.approx(a.weights, rel=1e-11)
    assert np.abs(b.initial_gaps - a.initial_gaps).max() < 1e-11
    assert np.abs(b.normals - a.normals @ turn.T).max() < 1e-11


@pytest.mark.parametrize("normals", list(ContactNormals))
def test_a_clearance_opens_every_gap_by_itself(surfaces, normals):
    """Whatever the normals and displacements: overclosures are less by it, gradients the same."""
    corners = random_corners(surfaces, 1e-2)
    plain = with_rule(surfaces, normals).kinematics(corners)
    opened = with_rule(replace(surfaces, clearance=0.03), normals).kinematics(corners)
    np.testing.assert_allclose(opened.overclosure, plain.overclosure - 0.03, atol=1e-15)
    np.testing.assert_array_equal(opened.gradient, plain.gradient)


@pytest.mark.parametrize("normals", list(ContactNormals))
def test_overclosures_at_corners_are_those_between_points_carried_on(surfaces, normals):
    """Of flat facets without displacement the gap is bilinear: at the points it is the mean of the
    corners with the shape functions there, to rounding; a clearance is taken off once."""
    still = np.zeros((surfaces.n_facets, 8, 3))
    found = replace(surfaces, clearance=0.03)
    normal = found.normals[:, :1]
    flat = np.abs(found.normals - normal).max(axis=(1, 2)) < 1e-12
    at_corners = corner_overclosures(with_rule(found, normals), still)
    at_points = with_rule(found, normals).kinematics(still).overclosure
    near, far = 0.5 * (1.0 + 3.0**-0.5), 0.5 * (1.0 - 3.0**-0.5)
    a, b, c = near * near, near * far, far * far
    shapes = np.array([[a, b, c, b], [b, a, b, c], [c, b, a, b], [b, c, b, a]])
    assert flat.any()
    np.testing.assert_allclose((at_corners @ shapes.T)[flat], at_points[flat], atol=1e-13)
    assert surfaces.clearance == 0.0
    bare = corner_overclosures(with_rule(surfaces, normals), still)
    np.testing.assert_allclose(at_corners, bare - 0.03, atol=1e-15)
