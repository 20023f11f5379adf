from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fem.element.hexahedron import (
    ElementType,
    block_hourglass_stiffness,
    block_lumped_mass,
    block_stiffness,
    gauss_gradients,
    mean_gradients,
)
from fem.element.material import Material
from fem.explicit.kernels.rate_form import mean_gradient
from fem.explicit.rate_form import (
    RateFormError,
    RateFormModel,
    initial_state,
    internal_force,
    internal_force_reference,
)
from fem.problem.time_step import element_frequencies
from geometry.block import box_block
from geometry.mesh import HexMesh
from tests.fem_problems import CONCRETE, boundary_nodes, distorted_box

ALL_EFFECTS = {
    "linear_bulk_viscosity": 0.06,
    "quadratic_bulk_viscosity": 1.2,
    "stiffness_damping": 1e-7,
}


def stable_time_step(mesh: HexMesh) -> float:
    """Irons and Treharne: no assembly is stiffer than its stiffest free element."""
    return 2.0 / float(element_frequencies(mesh, CONCRETE, ElementType.REDUCED).max())


def lane(points: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(points[:, :, None])


def move(model, state, start: np.ndarray, end: np.ndarray, time_step: float = 1e-6) -> np.ndarray:
    """One step from start to end (n_nodes, 3); the internal force there."""
    return internal_force(model, state, lane(end), lane((end - start) / time_step), time_step)[
        :, :, 0
    ]


def test_closed_form_gradients_are_the_integrated_ones() -> None:
    mesh = distorted_box()
    for corners in mesh.nodes[mesh.elements]:
        mean, volume = mean_gradients(*gauss_gradients(corners[None]))
        b = np.empty((8, 3))
        assert mean_gradient(corners, b) == pytest.approx(volume[0], rel=1e-14)
        assert b == pytest.approx(mean[0], abs=1e-14)


@pytest.mark.parametrize("effects", [{}, ALL_EFFECTS], ids=["bare", "all effects"])
def test_kernel_is_the_plain_reference_on_random_motions(effects: dict) -> None:
    """Five steps with strains of some 5 % each: every array equal to round-off."""
    mesh = distorted_box(amount=0.15)
    model = RateFormModel(mesh, CONCRETE, **effects)
    fast, plain = initial_state(model, 3), initial_state(model, 3)
    rng = np.random.default_rng(1)
    position = np.repeat(mesh.nodes[:, :, None], 3, axis=2)
    for _ in range(5):
        velocity = 2e4 * rng.normal(size=position.shape)
        position = position + 1e-6 * velocity
        force = internal_force(model, fast, position, velocity, 1e-6)
        expected = internal_force_reference(model, plain, position, velocity, 1e-6)
        assert abs(force - expected).max() < 1e-14 * abs(expected).max()
        for name in ("stress", "hourglass", "work"):
            ours, theirs = getattr(fast, name), getattr(plain, name)
            assert abs(ours - theirs).max() <= 1e-14 * abs(theirs).max(), name
    assert (fast.work[2:] > 0.0).all() == bool(effects)


@pytest.mark.parametrize("angle", [1.0, 90.0])
def test_rigid_rotation_in_one_step_gives_no_stress(angle: float) -> None:
    """At mid-step the chord of a rotation is a pure spin: strain is zero for any angle.

    Round-off only: E eps times the few sums of eight products.
    """
    mesh = distorted_box()
    model = RateFormModel(mesh, CONCRETE)
    state = initial_state(model)
    turn = Rotation.from_rotvec(np.deg2rad(angle) * np.array([0.6, 0.0, 0.8])).as_matrix()
    force = move(model, state, mesh.nodes, mesh.nodes @ turn.T + 5.0)
    assert abs(state.stress).max() < 1e-14 * 30 * CONCRETE.young_modulus
    assert abs(state.hourglass).max() < 1e-14 * 30 * CONCRETE.young_modulus
    assert abs(force).max() < 1e-14 * 100 * CONCRETE.young_modulus


def test_stress_turns_with_the_body_through_a_full_revolution() -> None:
    """A stressed body turned by 90 steps of 4 degrees: R s Rᵀ at every step, s again at the end.

    Hughes and Winget's rotation is the exact one for a rigid step, so only round-off is left:
    in every step some ten eps of strain, hence 90 · 10 · eps · E = 2e-13 E.
    """
    mesh = distorted_box()
    model = RateFormModel(mesh, CONCRETE)
    state = initial_state(model)
    rng = np.random.default_rng(3)
    place = mesh.nodes + 1e-3 * rng.normal(size=mesh.nodes.shape)
    first = move(model, state, mesh.nodes, place)
    start = state.stress.copy()
    step = Rotation.from_rotvec(np.deg2rad(4.0) * np.array([1.0, 2.0, -2.0]) / 3.0).as_matrix()
    energy = state.work.copy()
    tolerance = 2e-13 * CONCRETE.young_modulus
    for k in range(90):
        turned = place @ step.T
        force = move(model, state, place, turned)
        place = turned
        if k == 21:
            total = np.linalg.matrix_power(step, 22)
            expected = total @ start[..., 0] @ total.T
            assert abs(state.stress[..., 0] - expected).max() < tolerance
    assert abs(state.stress - start).max() < tolerance
    assert abs(force - first).max() < 10.0 * tolerance
    assert abs(state.work - energy).max() < 1e-9 * energy.max()


def test_small_motions_give_the_stiffness_of_the_reduced_element() -> None:
    """f = K u + O(u²): strains of 1e-7 leave a relative difference of that order."""
    mesh = distorted_box()
    model = RateFormModel(mesh, CONCRETE)
    state = initial_state(model)
    u = 1e-7 * np.random.default_rng(6).normal(size=mesh.nodes.shape)
    force = move(model, state, mesh.nodes, mesh.nodes + u)
    linear = (block_stiffness(mesh, CONCRETE, ElementType.REDUCED) @ u.ravel()).reshape(-1, 3)
    assert abs(force - linear).max() < 1e-5 * abs(linear).max()
    hourglass = 0.5 * u.ravel() @ (block_hourglass_stiffness(mesh, CONCRETE) @ u.ravel())
    assert state.work[1, 0] == pytest.approx(hourglass, rel=1e-5)
    total = 0.5 * (u * linear).sum()
    assert state.work[:2, 0].sum() == pytest.approx(total, rel=1e-5)


def test_explicit_patch_test_on_a_distorted_mesh() -> None:
    """Affine state held at the boundary: the inside stays at rest for 100 steps.

    Kinetic energy against the strain energy: round-off of the forces, 1e-15, acting 100 steps,
    squared.
    """
    mesh = distorted_box((4, 3, 3))
    model = RateFormModel(mesh, CONCRETE, **ALL_EFFECTS)
    state = initial_state(model)
    gradient = 0.02 * np.random.default_rng(7).normal(size=(3, 3))
    place = mesh.nodes @ (np.eye(3) + gradient).T
    time_step = 0.8 * stable_time_step(mesh)
    move(model, state, mesh.nodes, place, time_step)
    spread = state.stress - state.stress[:1]
    assert abs(spread).max() < 1e-13 * abs(state.stress).max()
    assert abs(state.hourglass).max() < 1e-13 * abs(state.stress).max()
    inside = np.setdiff1d(np.arange(mesh.n_nodes), boundary_nodes(mesh))
    mass = block_lumped_mass(mesh, CONCRETE.density)[inside]
    position, velocity = lane(place), np.zeros((mesh.n_nodes, 3, 1))
    for _ in range(100):
        force = internal_force(model, state, position, velocity, time_step)
        velocity[inside] -= time_step * force[inside] / mass[:, None, None]
        position += time_step * velocity
    kinetic = 0.5 * (mass[:, None, None] * velocity[inside] ** 2).sum()
    assert kinetic < 1e-26 * state.work[0, 0]


@pytest.mark.parametrize("rate", [50.0, -50.0], ids=["swelling", "shrinking"])
def test_bulk_viscosity_of_one_dilating_element(rate: float) -> None:
    """s = xi rho c_d L tr D on a cube, xi = b1 - b2² (L / c_d) min(0, tr D): Abaqus' formulas.

    Forces with viscosity minus forces without: the corner forces of that pressure.
    """
    size, time_step = 8.0, 1e-9
    mesh = box_block((size,) * 3, (1, 1, 1)).mesh
    velocity = rate / 3.0 * (mesh.nodes - size / 2.0)
    end = mesh.nodes + time_step * velocity

    def force(**effects: float) -> np.ndarray:
        model = RateFormModel(mesh, CONCRETE, **effects)
        return internal_force(model, initial_state(model), lane(end), lane(velocity), time_step)

    speed = CONCRETE.dilatational_wave_speed
    ratio = 0.06 - 1.2**2 * size / speed * min(0.0, rate)
    stress = ratio * CONCRETE.density * speed * size * rate
    viscous = (force(linear_bulk_viscosity=0.06, quadratic_bulk_viscosity=1.2) - force())[:, :, 0]
    # V dN/dx of a cube is a quarter of a face, outward; the face moves by 5e-8 of its size.
    outward = np.sign(mesh.nodes - size / 2.0)
    expected = stress * size**2 / 4.0 * outward
    # A force of E dt rate / 3 is subtracted: eps / (xi rho c L / (E dt)) of relative round-off.
    assert viscous == pytest.approx(expected, rel=1e-6)


def test_linear_bulk_viscosity_is_the_damping_ratio_of_the_dilatational_mode() -> None:
    """One brick in uniaxial strain, both faces free: omega = 2 c / L and zeta = b1.

    Measured from the decay over ten periods; the velocity lags by half a step of
    omega dt = 0.02, which changes the ratio by zeta omega dt / 2 of itself: below 1 %.
    """
    size, ratio = 5.0, 0.06
    mesh = box_block((size,) * 3, (1, 1, 1)).mesh
    model = RateFormModel(mesh, CONCRETE, linear_bulk_viscosity=ratio)
    state = initial_state(model)
    mass = block_lumped_mass(mesh, CONCRETE.density)[:, None, None]
    omega = 2.0 * CONCRETE.dilatational_wave_speed / size
    time_step = 0.02 / omega
    position, velocity = lane(mesh.nodes), np.zeros((8, 3, 1))
    # Strains of 1e-6, so that nothing but the mode is seen.
    velocity[:, 0, 0] = 1e-6 * size * omega * np.sign(mesh.nodes[:, 0] - size / 2.0)
    stretch = []
    for _ in range(round(2.0 * np.pi * 10.0 / 0.02)):
        position = position + time_step * velocity
        force = internal_force(model, state, position, velocity, time_step)
        force[:, 1:] = 0.0
        velocity = velocity - time_step * force / mass
        stretch.append(position[6, 0, 0] - position[0, 0, 0] - size)
    signal = np.array(stretch)
    peaks = np.flatnonzero((signal[1:-1] > signal[:-2]) & (signal[1:-1] > signal[2:])) + 1
    decrement = np.log(signal[peaks[0]] / signal[peaks[-1]]) / (len(peaks) - 1)
    measured = decrement / np.hypot(decrement, 2.0 * np.pi)
    assert measured == pytest.approx(ratio, rel=0.01)


def test_stiffness_damping_is_beta_times_the_stiffness_on_velocity() -> None:
    """Without hourglass control, f_damped - f = beta K v for small motions."""
    mesh = distorted_box()
    beta, time_step = 1e-6, 1e-6
    rng = np.random.default_rng(8)
    velocity = 1e-4 * rng.normal(size=mesh.nodes.shape)
    end = mesh.nodes + time_step * velocity

    def force(**effects: float) -> np.ndarray:
        model = RateFormModel(mesh, CONCRETE, hourglass_scale=0.0, **effects)
        return internal_force(model, initial_state(model), lane(end), lane(velocity), time_step)

    difference = (force(stiffness_damping=beta) - force())[:, :, 0]
    stiffness = block_stiffness(mesh, CONCRETE, ElementType.REDUCED)
    stiffness = stiffness - block_hourglass_stiffness(mesh, CONCRETE)
    expected = beta * (stiffness @ velocity.ravel()).reshape(-1, 3)
    # Displacements of 1e-10 over elements of 1: linear to that, round-off of positions 1e-6.
    assert abs(difference - expected).max() < 1e-5 * abs(expected).max()


def free_flight(steps: int, mesh: HexMesh, model, velocity: np.ndarray, time_step: float):
    """Yield position, velocity at the half step before, state, after every step."""
    state = initial_state(model)
    mass = block_lumped_mass(mesh, model.material.density)[:, None, None]
    position = lane(mesh.nodes)
    for _ in range(steps):
        position = position + time_step * velocity
        force = internal_force(model, state, position, velocity, time_step)
        before = velocity
        velocity = velocity - time_step * force / mass
        yield position, before, velocity, state


def test_hourglass_patterns_stay_bounded_in_a_free_block() -> None:
    """A checkerboard velocity only exchanges energy with the hourglass springs, for 2000 steps.

    Central differences conserve ½ m v(-) v(+) + U of a linear system exactly, and the rate
    form is linear up to strains of 1e-6 squared against one: 1e-10. At the turning points
    v(-) v(+) is negative by (omega dt)² / 4 = 0.4 % of the energy.
    """
    mesh = box_block((4.0, 4.0, 4.0), (4, 4, 4)).mesh
    model = RateFormModel(mesh, CONCRETE)
    time_step = 0.5 * stable_time_step(mesh)
    velocity = np.zeros((mesh.n_nodes, 3, 1))
    velocity[:, 0, 0] = (-1.0) ** np.rint(mesh.nodes).sum(axis=1)
    mass = block_lumped_mass(mesh, CONCRETE.density)[:, None, None]
    energy = 0.5 * mass.sum()
    stored, total = [], []
    for _, before, after, state in free_flight(2000, mesh, model, velocity, time_step):
        stored.append(state.work[1, 0])
        total.append(0.5 * (mass * before * after).sum() + state.work.sum())
    assert max(stored) > 0.9 * energy
    assert max(stored) < 1.01 * energy
    assert np.array(total) == pytest.approx(energy, rel=1e-10)


def test_spinning_block_keeps_its_momenta() -> None:
    """Free flight: linear momentum to round-off, angular momentum too, for internal forces in
    the end configuration have no moment about any point when the stress is symmetric."""
    mesh = distorted_box()
    model = RateFormModel(mesh, CONCRETE)
    time_step = 0.5 * stable_time_step(mesh)
    spin = np.array([300.0, -500.0, 800.0])
    velocity = lane(np.cross(spin, mesh.nodes) + np.array([1e3, 0.0, -2e3]))
    mass = block_lumped_mass(mesh, CONCRETE.density)[:, None, None]

    def momenta(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        linear = (mass * velocity)[:, :, 0].sum(axis=0)
        angular = np.cross(position[:, :, 0], (mass * velocity)[:, :, 0]).sum(axis=0)
        return np.concatenate([linear, angular])

    start = momenta(lane(mesh.nodes), velocity)
    *_, last = free_flight(500, mesh, model, velocity, time_step)
    position, _, velocity, state = last
    end = momenta(position, velocity)
    assert abs(end - start).max() < 1e-11 * abs(start).max()
    assert abs(state.stress).max() > 0.0


def test_bad_input_is_refused_by_name() -> None:
    mesh = distorted_box()
    for name in ("linear_bulk_viscosity", "stiffness_damping", "hourglass_scale"):
        with pytest.raises(RateFormError, match=name):
            RateFormModel(mesh, CONCRETE, **{name: -1.0})
    with pytest.raises(RateFormError, match="quadratic"):
        RateFormModel(mesh, CONCRETE, quadratic_bulk_viscosity=float("nan"))
    model = RateFormModel(mesh, Material(density=1.0, young_modulus=1.0, poisson_ratio=0.0))
    with pytest.raises(RateFormError, match="expected both"):
        internal_force(model, initial_state(model, 2), lane(mesh.nodes), lane(mesh.nodes), 1.0)
