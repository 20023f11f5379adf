"""Finite rotations of blocks: no strain, and nothing lost."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fem.explicit import kernels
from fem.explicit.kernels import SERIAL
from fem.explicit.start import prepare
from fem.explicit.step import placed_internal_force
from fem.system.body import placed_body
from fem.system.effects import BulkViscosity, Effects, RayleighDamping
from fem.system.rows import SmoothStepAmplitude
from tests.support.explicit_runs import explicit_run
from tests.support.fem_problems import CONCRETE, distorted_box
from tests.support.lone_bodies import lone_bodies, nodal_load
from validation import load_case, solve

FINITE = Effects(finite_rotation=True)
PLACEMENTS = Rotation.from_rotvec([[0, 0, 0], [0, 0, 1.0], [0.6, -1.0, 0.3]]).as_matrix()


def body_number(n_copies=3):
    return placed_body(distorted_box((3, 2, 2)), CONCRETE, rotations=PLACEMENTS[:n_copies])


def rigid_displacement(group, angle: float, axis, shift) -> np.ndarray:
    """Displacement of every copy by one rigid motion, (n_copies, n_nodes, 3)."""
    turn = Rotation.from_rotvec(angle * np.asarray(axis) / np.linalg.norm(axis)).as_matrix()
    start = group.reference_positions()
    return start @ turn.T + shift - start


@pytest.mark.parametrize("degrees", [1.0, 90.0, 179.9, 360.0, 540.0])
def test_rigid_motion_gives_no_strain(degrees):
    # u' is round-off of positions of size 10: strain 1e-15 or so, forces K times it.
    group = body_number()
    start = rigid_displacement(group, np.radians(degrees), [1.0, -2.0, 0.5], [5.0, -3.0, 8.0])
    model = lone_bodies((group,), effects=FINITE)
    dt = 0.9 * model.critical.critical_time_step
    result = explicit_run(
        model, time_step=dt, end_time=50 * dt, displacements=[start], sample_interval=1
    )
    stiff = np.abs(group.stiffness.diagonal()).max() * group.n_nodes
    assert result.run.history.column("strain_energy").max() < stiff * (20 * 1e-15) ** 2
    np.testing.assert_allclose(result.displacements[0], start, rtol=0, atol=1e-12)


def test_frames_are_the_best_rotation():
    # Against scipy's Wahba solution of every copy, for strained and turned blocks.
    group = body_number()
    rng = np.random.default_rng(0)
    strain = 0.05 * rng.standard_normal((3, group.n_nodes, 3))
    start = rigid_displacement(group, 2.0, [1.0, 1.0, 0.0], [1.0, 2.0, 3.0]) + strain
    stated = lone_bodies((group,), effects=FINITE)
    body = prepare(replace(stated, displacements=[start]), time_step=1e-7).bodies[0]
    frame = body.now.frame
    mass = group.lumped_mass
    centre = mass @ group.mesh.nodes / mass.sum()
    for k in range(3):
        local = (start[k] + group.reference_positions()[k]) @ PLACEMENTS[k]
        turned = local - mass @ local / mass.sum()
        expected, _ = Rotation.align_vectors(
            turned, group.mesh.nodes - centre, weights=mass / mass.sum()
        )
        found = np.eye(3) + frame.turn[:, :, k]
        np.testing.assert_allclose(found, expected.as_matrix(), atol=1e-13)
        seen = turned @ found - (group.mesh.nodes - centre)
        np.testing.assert_allclose(frame.local[body.rows.row, :, k], seen, atol=1e-13)


def test_forces_are_the_gradient_of_the_strain_energy():
    # The torque-free correction is what differentiating through the frame gives: central
    # differences of the energy, with step 1e-4, agree to 1e-4² of the third derivative and
    # 1e-16 / 1e-4 of the energy.
    group = body_number(2)
    rng = np.random.default_rng(1)
    start = rigid_displacement(group, 1.0, [0, 0, 1.0], np.zeros(3))
    start += 0.05 * rng.standard_normal(start.shape)
    stated = lone_bodies((group,), effects=FINITE)

    def evaluate(u):
        body = prepare(replace(stated, displacements=[u]), time_step=1e-7).bodies[0]
        local, r = body.now.frame.local, body.rows
        total, force = np.zeros(body.lanes), np.zeros_like(local)
        SERIAL.stiffness_product(*r.packed, local.ravel(), force.ravel(), None, 2)
        kernels.dot_lanes(local, force, total)
        placed = placed_internal_force(body)[r.row].transpose(2, 0, 1)
        return 0.5 * total.sum(), np.einsum("cij,cnj->cni", PLACEMENTS[:2], placed)

    _, force = evaluate(start)
    for _ in range(4):
        direction = rng.standard_normal(start.shape)
        h = 1e-4
        slope = (evaluate(start + h * direction)[0] - evaluate(start - h * direction)[0]) / (2 * h)
        assert slope == pytest.approx(float((force * direction).sum()), rel=1e-6)
    torque = np.cross(group.reference_positions() + start, force).sum(axis=1)
    assert np.abs(torque).max() < 1e-12 * np.abs(force).sum() * 5.0


def angular_momentum(group, result) -> tuple[np.ndarray, np.ndarray]:
    position = group.reference_positions() + result.displacements[0]
    momentum = group.lumped_mass[:, None] * result.system.expand(result.velocity)[0]
    return momentum.sum(axis=1), np.cross(position, momentum).sum(axis=1)


def test_free_spinning_block_keeps_both_momenta():
    # Σ m x_n × v is kept exactly by central differences with torque-free forces, to round-off
    # of n_steps additions.
    group = body_number()
    spin = np.array([200.0, -3e4, 1e4])
    x = group.reference_positions()
    velocity = np.cross(spin, x) + np.array([500.0, 0.0, -200.0])
    model = lone_bodies((group,), effects=FINITE)
    dt = 0.9 * model.critical.critical_time_step
    turn = 2.0 * np.pi / np.linalg.norm(spin)
    short, long = (
        explicit_run(model, time_step=dt, end_time=t, velocities=[velocity]) for t in (2 * dt, turn)
    )
    assert long.run.n_steps > 500
    p0, h0 = angular_momentum(group, short)
    p1, h1 = angular_momentum(group, long)
    np.testing.assert_allclose(p1, p0, rtol=0, atol=1e-13 * np.abs(p0).max())
    np.testing.assert_allclose(h1, h0, rtol=0, atol=1e-12 * np.linalg.norm(h0))
    # Energy: exact gradient, so only the nonlinear part of the scheme's error, (ω Δt)² of the
    # small strain energy of spinning up.
    assert long.run.energy_balance < 1e-4


def test_damping_and_viscosity_do_not_brake_a_rigid_spin():
    # Viscous forces act on rates of strain seen from the frame: no torque, no loss of spin.
    group = body_number()
    velocity = np.cross([0.0, 0.0, 1e4], group.reference_positions())
    effects = Effects(
        rayleigh=RayleighDamping(stiffness_proportional=2e-8),
        bulk_viscosity=BulkViscosity(),
        finite_rotation=True,
    )
    model = lone_bodies((group,), effects=effects)
    dt = 0.9 * model.critical.critical_time_step
    first = explicit_run(model, time_step=dt, end_time=2 * dt, velocities=[velocity])
    last = explicit_run(model, time_step=dt, end_time=1000 * dt, velocities=[velocity])
    _, h0 = angular_momentum(group, first)
    _, h1 = angular_momentum(group, last)
    np.testing.assert_allclose(h1, h0, rtol=0, atol=1e-12 * np.linalg.norm(h0))
    assert last.run.energies.viscous_dissipation > 0.0
    assert last.run.energy_balance < 1e-4


def test_small_motions_agree_with_the_small_rotation_path():
    # The two differ by squares of the rotation, 1e-6 here, relative to the displacement.
    group = body_number()
    force = 1e-2 * np.random.default_rng(0).standard_normal(group.mesh.nodes.shape)
    load = nodal_load(0, force, copies=[0, 1, 2], amplitude=SmoothStepAmplitude(1e-5))
    small, finite = (
        explicit_run(
            lone_bodies((group,), loads=(load,), effects=e), time_step=1.5e-7, end_time=2e-5
        )
        for e in (Effects(), FINITE)
    )
    size = np.abs(small.displacements[0]).max()
    turned = size / 1.0
    assert turned < 1e-2
    np.testing.assert_allclose(
        small.displacements[0], finite.displacements[0], rtol=0, atol=3 * turned * size
    )


def test_following_load_turns_with_the_block():
    # A force along the axis of a freely spinning, stiff block stays along the block: after a
    # quarter turn it pushes along y. Without following it keeps pushing along x.
    group = placed_body(distorted_box((3, 2, 2)), CONCRETE)
    mass = group.lumped_mass
    centre = mass @ group.mesh.nodes / mass.sum()
    spin = 2e4
    velocity = np.cross([0.0, 0.0, spin], group.mesh.nodes - centre)[None]
    acceleration = 1e6
    force = np.zeros((group.n_nodes, 3))
    force[:, 0] = mass * acceleration
    end = 0.5 * np.pi / spin
    for follows, expected in (
        (True, acceleration / spin * np.array([1.0, 1.0])),
        (False, acceleration * end * np.array([1.0, 0.0])),
    ):
        load = nodal_load(0, force, follows_block=follows)
        result = explicit_run(
            lone_bodies((group,), loads=(load,), effects=FINITE),
            end_time=end,
            velocities=[velocity],
        )
        drift = mass @ result.system.expand(result.velocity)[0][0] / mass.sum()
        # The last step is left out of the velocity and the end time is rounded up to a step.
        np.testing.assert_allclose(
            drift[:2], expected, atol=3 * acceleration * result.run.time_step
        )
        assert result.run.energy_balance < 1e-4


@pytest.mark.parametrize(("load", "named"), [(2e-2, True), (1e-6, False)])
def test_blocks_that_bend_far_are_named(load: float, named: bool) -> None:
    """Slender cantilevers that bend far are too stiff, one of 0.4 rad by 44 %: it had no word."""
    scene = {
        "block": {"type": "box", "size": [100.0, 5.0, 5.0]},
        "mesh": {"divisions": [20, 1, 2]},
        "material": {"density": 2.4e-9, "young_modulus": 1000.0, "poisson_ratio": 0.0},
        "supports": [{"face": "x-"}],
        "load": {"z+": {"pressure": load}},
        "effects": {"finite_rotation": True},
        "fem": {"method": "explicit", "end_time": 0.02, "damping": "static"},
    }
    answer = solve(load_case(scene))
    assert ("turned_within_blocks" in answer.as_dict()) == named
    assert ("large rotation within a block" in str(answer)) == named
