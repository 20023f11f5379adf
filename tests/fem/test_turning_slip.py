"""Friction of explicit runs: its slip turns with the surface, wherever facets start, and no energy
of it is forgotten. Matched and searched facets alike."""

from dataclasses import replace

import numpy as np
import pytest

from fem import CoulombFriction, Frames, LinearPenalty
from fem.explicit.body import world_vectors
from fem.explicit.damping import applied_forces
from fem.explicit.kernels.layout import to_lanes
from fem.explicit.setup.timed_system import timed_system
from fem.explicit.start import prepare
from geometry.mesh import HexMesh
from tests.support.blocks import random_rotation
from tests.support.fem_problems import in_contact
from tests.support.floor import block_on_floor
from tests.support.lone_bodies import with_supports

pytestmark = [pytest.mark.quick, pytest.mark.parametrize("sliding", [False, True])]

PENALTY, STICK, COEFFICIENT = 200.0, 50.0, 0.3
FRICTION = CoulombFriction(COEFFICIENT, STICK)


def bricks(sliding, **options):
    """A brick of 40 × 30 × 20 mm on another, the upper one the master; both may move."""
    stated = block_on_floor(
        law=LinearPenalty(PENALTY), frames=Frames.DEFORMABLE, floor_first=False, **options
    )
    return in_contact(stated, friction=FRICTION, finite_sliding=sliding)


def along_path(deformable, path):
    """Forces on the nodes of both bricks [N], energy stored and lost [N mm], at each of some
    displacements (2, n_nodes, 3) [mm]."""
    statement = timed_system(deformable, ramp_time=0.0)
    loop = prepare(with_supports(statement), time_step=1e-9)
    (body,) = loop.bodies
    now = body.now
    turns = body.body.rotations
    result = []
    for moved in path:
        local = np.einsum("cij,cni->cnj", turns, moved[statement.blocks[0]])
        now.displacement[:] = to_lanes(local, body.rows.order)
        now.applied_force[:] = 0.0
        contact = loop.interactions[0]
        contact.add_force(loop)
        force = world_vectors(body, applied_forces(body))[np.argsort(statement.blocks[0])]
        result.append((force, contact.energy(), contact.dissipation()))
    return [np.array(column) for column in zip(*result, strict=True)]


def shifts(path, n_nodes):
    """Displacements that move all of the upper brick by each of a path (n, 3)."""
    result = np.zeros((len(path), 2, n_nodes, 3))
    result[:, 0] = np.array(path)[:, None]
    return result


def test_contact_begins_without_friction_and_sticks_from_there(sliding):
    """A brick that comes down as it moves on has no friction in the step in which it touches, and
    k A Δ after another way Δ: rounding."""
    deformable = bricks(sliding, lift=0.01)
    path = [[0.0, 0.0, 0.0], [1.0, 0.0, -0.02], [1.0 + 1e-3, 0.0, -0.02], [1.0 + 1e-3, 2e-3, -0.02]]
    force = along_path(deformable, shifts(path, 27))[0][:, 0].sum(axis=1)
    sticks = STICK * 40.0 * 30.0
    expected = -sticks * np.array([[0, 0], [0, 0], [1e-3, 0], [1e-3, 2e-3]])
    np.testing.assert_allclose(force[:, :2], expected, atol=1e-9 * sticks)


def test_what_opens_loses_the_energy_of_its_slip(sliding):
    """Pressed, dragged until it sticks and slides, lifted to where the pressure is zero: at every
    step the work on the bricks is what is taken from the store, less what is lost. Forces are
    linear in each step, so the mean of both ends is exact: rounding."""
    deformable = bricks(sliding, lift=-0.01)
    ways = np.array([0.0, 5e-3, 9e-3, 0.03, 0.05, 0.05 - 4e-3])
    path = [[x, 0.5 * x, 0.0] for x in ways] + [[0.05, 0.02, 0.011], [0.06, 0.0, 0.011]]
    moved = shifts(path, 27)
    force, stored, lost = along_path(deformable, moved)
    # Of the way up, contact acts as long as it presses.
    pressing = moved.copy()
    pressing[-2:, 0, :, 2] = 0.01
    work = 0.5 * ((force[1:] + force[:-1]) * np.diff(pressing, axis=0)).sum(axis=(1, 2, 3))
    np.testing.assert_allclose(-np.diff(stored + lost), work, atol=1e-9 * stored.max())
    assert stored[-1] == 0.0
    assert lost[-2] > lost[-3]


def test_a_slip_turns_with_the_surface(sliding):
    """Both bricks, pressed and dragged, turn as one by any angle: so do the forces (rounding of
    coordinates of 40 mm on overclosures of 0.01 mm)."""
    deformable = bricks(sliding, lift=-0.01)
    group = deformable.bodies[0]
    place = group.reference_positions()[np.argsort(deformable.copy_of)]
    before, dragged = shifts([[0.0, 0.0, 0.0], [8e-3, -5e-3, 0.0]], 27)
    turn = random_rotation(3)
    turned = (place + dragged) @ turn.T - place
    force = along_path(deformable, [before, dragged, turned])[0]
    assert np.abs(force[1, 0].sum(axis=0)[:2]).min() > 100.0
    np.testing.assert_allclose(force[2], force[1] @ turn.T, atol=1e-9 * np.abs(force[1]).max())


def renumbered(block, rng):
    """The same block, its nodes in another order, its facets from other corners."""
    order = rng.permutation(block.mesh.n_nodes)
    number = np.argsort(order)
    mesh = HexMesh(block.mesh.nodes[order], number[block.mesh.elements])
    start = {name: rng.integers(0, 4, len(quads)) for name, quads in block.faces.items()}
    faces = {
        name: np.take_along_axis(number[quads], (start[name][:, None] + np.arange(4)) % 4, axis=1)
        for name, quads in block.faces.items()
    }
    return replace(block, mesh=mesh, faces=faces), order


def test_the_corner_at_which_a_facet_starts_changes_nothing(sliding):
    """Bricks that have slid are sheared by a hundredth: their forces are those of the same bricks
    with nodes and facets numbered otherwise (rounding, as above). Edges turn by other angles, and
    what has slid with them."""
    deformable = bricks(sliding, lift=-0.05)
    rng = np.random.default_rng(4)
    sheared = 0.2 * rng.standard_normal((2, 27, 3))
    sheared[:, :, 2] *= 0.01
    slid = shifts([[0.0, 0.0, 0.0], [0.3, 0.1, 0.0]], 27)
    path = np.array([*slid, slid[1] + sheared])
    shape, order = renumbered(deformable.assembly.shapes[0], rng)
    other = bricks(sliding, lift=-0.05, shape=shape)
    expected = along_path(deformable, path)[0][-1]
    found = along_path(other, path[:, :, order])[0][-1]
    np.testing.assert_allclose(found, expected[:, order], atol=1e-9 * np.abs(expected).max())
