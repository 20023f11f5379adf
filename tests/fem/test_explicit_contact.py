"""Explicit contact: kernel against its plain twin, balances, symmetry, agreement with statics."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fem import CoulombFriction, Frames, Material
from fem.contact.friction import Coulomb
from fem.contact.normals import ContactNormals
from fem.element.functions import FACET_SLOPES, FACET_VALUES
from fem.explicit.body import world_vectors
from fem.explicit.contact.paired import shared_out
from fem.explicit.damping import applied_forces
from fem.explicit.setup.timed_system import timed_system
from fem.explicit.start import prepare
from fem.system.contact_state import corner_displacements
from geometry.loads import named_load
from tests.support.coarse_tubes import ring
from tests.support.fem_problems import deformable_assembly, in_contact, matched_pressures, still

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)


def tube(layers=1, case="pipe", **options):
    found = ring(layers, (12, 2, 4))
    return deformable_assembly(found, named_load(case, 0.01).on(found), CONCRETE, **options)


def random_displacements(deformable, size, seed=0):
    rng = np.random.default_rng(seed)
    groups = deformable.bodies
    result = tuple(size * rng.standard_normal((g.n_copies, g.n_nodes, 3)) for g in groups)
    still(deformable, result)
    return result


def in_model_order(statement, displacements):
    """Displacements of all copies in the order of the explicit model's copies."""
    copy_of = statement.system.whole.copy_of
    pairs = zip(displacements, statement.blocks, strict=True)
    return tuple(moved[copy_of[blocks]] for moved, blocks in pairs)


def kernel_forces(statement, displacements, *, then=None, **options):
    """Contact forces of the loop, world axes, copies as in the deformable assembly; energy.

    With ``then`` those at displacements that follow upon the first.
    """
    copy_of = statement.system.whole.copy_of

    def ready(moved):
        start = in_model_order(statement, moved)
        return prepare(replace(statement, displacements=start), time_step=1e-9, **options)

    loop = ready(displacements)
    if then is not None:
        displacements, following = then, ready(then)
        for body, new in zip(loop.bodies, following.bodies, strict=True):
            body.now.displacement[:] = new.now.displacement
    for body in loop.bodies:
        body.now.applied_force[:] = 0.0
    loop.interactions[0].add_force(loop)
    result = [np.zeros_like(u) for u in displacements]
    for g, body in enumerate(loop.bodies):
        world = world_vectors(body, applied_forces(body))
        result[g][copy_of[statement.blocks[g]]] = world
    return result, loop.interactions[0].energy()


def plain_forces(deformable, displacements):
    """The same with the plain functions of fem.contact."""
    surfaces, law = deformable.surfaces, deformable.contact.law
    corners = corner_displacements(deformable, displacements)
    found = surfaces.kinematics(corners)
    forces = surfaces.nodal_forces(corners, law.pressure(found.overclosure))
    result = [np.zeros_like(u) for u in displacements]
    for half, blocks, quads in (
        (0, surfaces.block_m, surfaces.quads_m),
        (4, surfaces.block_s, surfaces.quads_s),
    ):
        for g, total in enumerate(result):
            mine = deformable.body_number[blocks] == g
            copies = deformable.copy_of[blocks[mine]]
            np.add.at(total, (copies[:, None], quads[mine]), forces[mine, half : half + 4])
    return result, float((surfaces.weights * law.stored_energy(found.overclosure)).sum())


@pytest.mark.parametrize("normals", list(ContactNormals))
@pytest.mark.parametrize("frames", list(Frames))
def test_kernel_agrees_with_the_plain_reference(normals, frames):
    """Random displacements of 5 µm on a tube of three layers, a gap of 2 µm.

    The overclosures of the two differ by rounding of coordinates of 400 mm, 1e-13 mm; the
    forces then by that times the stiffness over the pressure, at most 1/c0 = 1e3/mm: 1e-10.
    """
    deformable = tube(3, normals=normals, frames=frames, clearance=0.002)
    displacements = random_displacements(deformable, 5e-3)
    expected, energy = plain_forces(deformable, displacements)
    found, stored = kernel_forces(timed_system(deformable), displacements)
    for a, b in zip(found, expected, strict=True):
        assert np.abs(b).max() > 1.0
        assert np.abs(a - b).max() < 1e-10 * np.abs(b).max()
    assert stored == pytest.approx(energy, rel=1e-10)


@pytest.mark.parametrize("clearance", [-0.001, 0.03])
def test_kernel_agrees_on_open_and_pressed_tubes(clearance):
    """Clearances of both signs and both kinds; displacements as large as the gap."""
    for kind in ("clearance", "spacing"):
        deformable = tube(**{kind: clearance})
        displacements = random_displacements(deformable, 0.02)
        expected, _ = plain_forces(deformable, displacements)
        found, _ = kernel_forces(timed_system(deformable), displacements)
        assert np.abs(expected[0]).max() > 1.0
        assert np.abs(found[0] - expected[0]).max() < 1e-10 * np.abs(expected[0]).max()


def slips(deformable, displacements):
    """Tangential parts of x_s - x_m along two tangents, (n, 4, 2), and the tangents."""
    surfaces = deformable.surfaces
    corners = corner_displacements(deformable, displacements)
    slopes = 0.5 * np.concatenate([FACET_SLOPES, FACET_SLOPES], axis=1)
    tangents = surfaces.tangents + np.einsum("pak,fai->fpki", slopes, corners)
    normal = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    along = tangents[:, :, 0] / np.linalg.norm(tangents[:, :, 0], axis=2, keepdims=True)
    basis = np.stack([along, np.cross(normal, along)], axis=2)
    d = surfaces.offsets + np.einsum("pa,fai->fpi", DIFFERENCE, corners)
    return np.einsum("fpki,fpi->fpk", basis, d), basis


DIFFERENCE = np.concatenate([-FACET_VALUES, FACET_VALUES], axis=1)


def test_friction_agrees_with_the_plain_law():
    """Two evaluations 0.03 µm apart; anchors start where points touch in the first.

    Kernel and reference take tangents along different edges of a facet; those turn by
    change of displacement over facet size, 3e-5/20 = 1.5e-6, so with offsets d of
    5 µm the slips differ by 1e-8 mm of 3e-5 mm: 3e-4, and the forces as much.
    """
    deformable = tube(clearance=-0.002)
    friction = CoulombFriction(0.2, 50.0)
    before = random_displacements(deformable, 2e-3)
    after = tuple(
        a + b for a, b in zip(before, random_displacements(deformable, 3e-5, seed=1), strict=True)
    )
    (s0, _), (s1, basis) = slips(deformable, before), slips(deformable, after)
    touched = matched_pressures(deformable, before)[0] > 0.0
    pressure, overclosure = matched_pressures(deformable, after)
    anchor = np.where(touched[:, :, None], s0, s1)
    law = Coulomb(deformable.contact.law, friction.coefficient, friction.stick_stiffness)
    x = np.concatenate([overclosure[:, :, None], s1], axis=2)
    traction = law.tractions(x, anchor)[0][..., 1:]
    slides = np.linalg.norm(traction, axis=2) > 0.999 * friction.coefficient * pressure
    assert 0.1 < slides[touched].mean() < 0.9
    surfaces = deformable.surfaces
    force = -surfaces.weights[:, :, None] * np.einsum("fpk,fpki->fpi", traction, basis)
    corners = np.einsum("pa,fpi->fai", DIFFERENCE, force)
    expected, _ = plain_forces(deformable, after)
    for half, blocks, quads in (
        (0, surfaces.block_m, surfaces.quads_m),
        (4, surfaces.block_s, surfaces.quads_s),
    ):
        mine = deformable.body_number[blocks] == 0
        copies = deformable.copy_of[blocks[mine]]
        np.add.at(expected[0], (copies[:, None], quads[mine]), corners[mine, half : half + 4])
    statement = timed_system(in_contact(deformable, friction=friction))
    found, _ = kernel_forces(statement, before, then=after)
    size = np.abs(force).max()
    assert np.abs(found[0] - expected[0]).max() < 1e-3 * size


@pytest.mark.parametrize("threads", [1, 2, 5, 40])
def test_threads_share_all_units_by_their_work_and_where_they_are(threads):
    rng = np.random.default_rng(7)
    work, place = rng.integers(1, 20, 30), rng.random(30)
    order, shares = shared_out(work, place, threads)
    np.testing.assert_array_equal(np.sort(order), np.arange(30))
    assert (np.diff(place[order]) >= 0.0).all()
    assert (shares[0], shares[-1], len(shares)) == (0, 30, threads + 1)
    done = [work[order[a:b]].sum() for a, b in pairwise(shares)]
    # A boundary is off by half a unit at most.
    assert np.abs(np.array(done) - work.sum() / threads).max() <= work.max()


def test_two_threads_give_the_same_bits():
    deformable = tube(3)
    displacements = random_displacements(deformable, 5e-3)
    statement = timed_system(deformable)
    one, _ = kernel_forces(statement, displacements, threads=1)
    two, _ = kernel_forces(statement, displacements, threads=2)
    assert np.array_equal(one[0], two[0])


def test_no_symmetry_keeps_every_block():
    deformable = tube(2)
    statement = timed_system(deformable)
    assert statement.bodies[0].n_copies == 8
    displacements = random_displacements(deformable, 1.0)
    back = statement.expand(in_model_order(statement, displacements))
    # Into the frames of the blocks and back: rounding.
    np.testing.assert_allclose(back[0], displacements[0], rtol=0.0, atol=1e-14)
