"""Blocks on a rigid floor: bouncing, sliding at the friction angle, time step safety."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fem import CoulombFriction, ExponentialLaw, LinearPenalty
from fem.contact.friction import FrictionError
from fem.contact.normals import ContactNormals
from fem.explicit.body import world_vectors
from fem.explicit.damping import applied_forces
from fem.explicit.setup.timed_system import timed_system
from fem.explicit.solve import (
    UnstableRun,
    displacements_of,
)
from fem.explicit.start import prepare
from fem.explicit.step import step
from fem.system.effects import Effects, RayleighDamping
from fem.system.time_step import critical_time_step
from tests.support.explicit_runs import explicit_run
from tests.support.fem_problems import in_contact
from tests.support.floor import CONCRETE, GRAVITY, block_on_floor


def falling(deformable, speed):
    """Velocity of all nodes, downwards [mm/s]."""
    velocity = np.zeros((1, deformable.bodies[0].n_nodes, 3))
    velocity[:, :, 2] = -speed
    return (velocity,)


def bounce(time_step):
    deformable = block_on_floor(lift=0.02)
    statement = timed_system(deformable)
    return explicit_run(
        statement,
        end_time=6e-3,
        time_step=time_step,
        velocities=falling(deformable, 10.0),
        sample_interval=10,
    )


def test_a_bouncing_block_keeps_its_energy():
    """Undamped: the error of the balance is that of central differences, second order in Δt.

    The block must come back: its mean velocity turns, what is missing is vibration.
    """
    coarse, fine = bounce(2e-6), bounce(1e-6)
    errors = [np.abs(run.run.history.column("energy_balance")).max() for run in (coarse, fine)]
    assert (
        coarse.run.history.column("contact_energy").max() > 0.1 * coarse.run.energies.kinetic_energy
    )
    assert errors[0] < 1e-2
    assert 3.0 < errors[0] / errors[1] < 5.5
    mass = coarse.run.stated.bodies[0].lumped_mass
    assert mass @ coarse.system.expand(coarse.velocity)[0][0, :, 2] / mass.sum() > 5.0
    assert abs(fine.run.history.column("energy_balance")[-1]) < 1e-4


def on_incline(ratio, *, coefficient=0.3, time=4e-3, floor_first=True, effects=None):
    """Slide of a block on a plane whose slope is ``ratio`` times the coefficient of friction.

    The block starts in its equilibrium on a linear penalty. Returns the mean slide along the
    slope and the result.
    """
    slope = ratio * coefficient
    down = GRAVITY / math.sqrt(1.0 + slope**2)
    size = (40.0, 30.0, 20.0)
    penalty = 200.0
    sink = CONCRETE.density * down * size[2] / penalty
    gravity = np.array([slope * down, 0.0, -down])
    deformable = block_on_floor(
        size, law=LinearPenalty(penalty), lift=-sink, gravity=gravity, floor_first=floor_first
    )
    friction = CoulombFriction(coefficient)
    statement = timed_system(in_contact(deformable, friction=friction), effects=effects)
    result = explicit_run(statement, end_time=time)
    mass = statement.bodies[0].lumped_mass
    return float(mass @ result.displacements[0][0, :, 0] / mass.sum()), result


def test_a_damped_slide_reaches_its_terminal_velocity():
    """Damping α m v against m (g sin - μ g cos): v = (g sin - μ g cos)/α, approached by
    exp(-α t). After eight of those times 3e-4 of it is missing; the damping works on the vibration
    of the normal force as well, of which exp(-4) is left."""
    rate, time = 2000.0, 4e-3
    effects = Effects(rayleigh=RayleighDamping(mass_proportional=rate))
    _, result = on_incline(1.5, time=time, effects=effects)
    mass = result.run.stated.bodies[0].lumped_mass
    speed = float(mass @ result.system.expand(result.velocity)[0][0, :, 0] / mass.sum())
    down = GRAVITY / math.hypot(1.0, 1.5 * 0.3)
    assert speed == pytest.approx(0.5 * 0.3 * down / rate, rel=0.01)
    assert result.run.energy_balance < 1e-3


def test_the_slide_does_not_depend_on_who_is_master():
    """Flat facets: the pressure at a point and its slip are the same from either side, but for the
    turn of a facet's normal with the strain, p/E = 1e-8 here, and what the time steps that they
    share leave: far below one part in a million of the slide."""
    (one, first), (other, second) = (on_incline(1.2, floor_first=f) for f in (True, False))
    assert one == pytest.approx(other, rel=1e-6)
    lost = [run.run.energies.frictional_dissipation for run in (first, second)]
    assert lost[0] > 0.0
    assert lost[0] == pytest.approx(lost[1], rel=1e-6)


def test_friction_is_refused_where_it_cannot_act():
    deformable = block_on_floor(normals=ContactNormals.REFERENCE)
    with pytest.raises(FrictionError, match="current normals"):
        timed_system(in_contact(deformable, friction=CoulombFriction(0.1)))


def test_a_law_without_cap_is_watched():
    """A fast block drives the exponential law to stiffnesses the step was not made for."""
    law = ExponentialLaw(maximum_stiffness=math.inf)
    deformable = block_on_floor(lift=0.002, law=law)
    with pytest.raises(UnstableRun, match=r"blocks 0 and 1 reached .* MPa.*safety_factor"):
        explicit_run(
            timed_system(deformable),
            end_time=2e-3,
            velocities=falling(deformable, 2e4),
            safety_factor=1.0,
            sample_interval=1,
        )


def test_time_step_counts_contact():
    """A stiff penalty (1e5 MPa/mm on elements of 10 mm, E = 33 000 MPa) lowers the critical step.

    A block in equilibrium on it, pressed by its weight, stays there at 0.9 of the step; with
    the step of the free block it is thrown off.
    """
    sink = CONCRETE.density * GRAVITY * 20.0 / 1e5
    gravity = np.array([0.0, 0.0, -GRAVITY])
    deformable = block_on_floor(law=LinearPenalty(1e5), lift=-sink, gravity=gravity)
    model = timed_system(deformable)
    with_contact = model.critical.critical_time_step
    without = critical_time_step(model.bodies, model.effects).critical_time_step
    assert with_contact < 0.5 * without
    highest = []
    for time_step in (0.9 * with_contact, 0.9 * without):
        loop = prepare(model, time_step=time_step)
        for _ in range(1000):
            step(loop)
        highest.append(np.abs(displacements_of(loop)[0]).max())
    # The weight at once compresses it by twice ρ g h² / 2E and lifts it off a little after that.
    compression = CONCRETE.density * GRAVITY * 20.0**2 / (2.0 * 33e3)
    assert highest[0] < 10.0 * compression
    assert highest[1] > 100.0 * highest[0]


def floor_forces(model, path):
    """Forces on the blocks at the last of some displacements, (3,) or one row a block [mm]."""
    loop, group = prepare(model, time_step=1e-9), model.bodies[0]
    (body,) = loop.bodies
    for moved in path:
        copies = np.broadcast_to(moved, (group.n_copies, 3))
        everywhere = (np.repeat(copies[:, None], group.n_nodes, axis=1),)
        there = prepare(replace(model, displacements=everywhere), time_step=1e-9).bodies[0]
        body.now.displacement[:] = there.now.displacement
        body.now.applied_force[:] = 0.0
        loop.interactions[0].add_force(loop)
    return world_vectors(body, applied_forces(body))


def test_friction_forgets_when_blocks_lift_off():
    """Pressed, lifted, moved along, pressed again: no traction, as if it had never touched.

    Pressed and moved along without lifting, it rubs with μ times the pressing force.
    """
    deformable = block_on_floor(lift=0.05)
    model = timed_system(in_contact(deformable, friction=CoulombFriction(0.3)))
    pressed, along = np.array([0.0, 0.0, -0.052]), np.array([0.05, 0.0, 0.0])
    lifted = np.array([0.0, 0.0, 0.1])
    fresh = floor_forces(model, [pressed + along])
    again = floor_forces(model, [pressed, lifted, lifted + along, pressed + along])
    np.testing.assert_array_equal(again, fresh)
    assert abs(fresh[..., 0].sum()) < 1e-12 * fresh[..., 2].sum()
    rubbed = floor_forces(model, [pressed, pressed + along])
    assert rubbed[..., 0].sum() == pytest.approx(-0.3 * rubbed[..., 2].sum(), rel=1e-12)


def test_friction_forgets_the_block_that_lifts_off_beside_one_that_stays():
    """They are lanes of one loop: what the facets of one forget, those of the other keep."""
    deformable = block_on_floor(lift=0.05, blocks=2)
    model = timed_system(in_contact(deformable, friction=CoulombFriction(0.3)))
    pressed, along = np.array([0.0, 0.0, -0.052]), np.array([0.05, 0.0, 0.0])
    lifted = np.array([0.0, 0.0, 0.1])
    path = [[pressed, pressed], [pressed, lifted], [pressed, lifted + along]]
    force = floor_forces(model, [*map(np.array, path), np.array([pressed + along] * 2)])
    across, normal = force[..., 0].sum(axis=1), force[..., 2].sum(axis=1)
    assert across[0] == pytest.approx(-0.3 * normal[0], rel=1e-12)
    assert abs(across[1]) < 1e-12 * normal[1]
