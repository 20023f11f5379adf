"""Laws of the explicit solver on small bodies."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from fem import ElementType, Material
from fem.explicit.kernels import SERIAL
from fem.explicit.kernels.layout import aligned_zeros, to_lanes
from fem.explicit.output.energy import History, energies
from fem.explicit.solve import (
    Frame,
    Output,
    UnstableRun,
    watch,
)
from fem.explicit.start import prepare
from fem.explicit.step import Loop, step
from fem.explicit.timed import TimedSystem
from fem.system.body import Body, placed_body
from fem.system.effects import BulkViscosity, Effects, RayleighDamping
from fem.system.rows import SmoothStepAmplitude
from geometry.block import box_block
from geometry.mesh import CORNERS, HexMesh
from tests.support.explicit_runs import explicit_run
from tests.support.fem_problems import CONCRETE, distorted_box
from tests.support.lone_bodies import fixed_nodes, lone_bodies, nodal_load

PLACEMENTS = Rotation.from_rotvec([[0, 0, 0], [0, 0, 1.0], [0.6, -1.0, 0.3]]).as_matrix()


def cube(n: int = 2, size: float = 10.0) -> HexMesh:
    return box_block((size,) * 3, (n,) * 3).mesh


def bar(n: int, length: float = 100.0, width: float = 1.0, **options) -> Body:
    """Slender bar along x without lateral contraction: a rod in one dimension."""
    material = Material(density=1e-9, young_modulus=1000.0, poisson_ratio=0.0)
    return placed_body(box_block((length, width, width), (n, 1, 1)).mesh, material, **options)


def short(model: TimedSystem, n_steps: int, factor: float = 0.9) -> dict:
    """Options of a run of so many steps at a fraction of the critical step."""
    time_step = factor * model.critical.critical_time_step
    return {"time_step": time_step, "end_time": n_steps * time_step}


def modes(group: Body, held: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [rad/s] and mass-normalised shapes (n, n_nodes, 3) with ``held`` nodes fixed."""
    fixed = np.empty(0, int) if held is None else (3 * held[:, None] + np.arange(3)).ravel()
    free = np.setdiff1d(np.arange(3 * group.n_nodes), fixed)
    stiffness = group.stiffness.toarray()[np.ix_(free, free)]
    square, vectors = eigh(stiffness, np.diag(np.repeat(group.lumped_mass, 3)[free]))
    shapes = np.zeros((len(square), 3 * group.n_nodes))
    shapes[:, free] = vectors.T
    return np.sqrt(np.maximum(square, 0.0)), shapes.reshape(len(square), -1, 3)


def modal_coordinate(model: TimedSystem, shape: np.ndarray, **options) -> np.ndarray:
    """Amplitude of a mass-normalised shape at every step of a run released from it."""
    group = model.bodies[0]
    found: list[float] = []

    def keep(frame: Frame) -> None:
        found.append(
            float(np.einsum("n,ni,ni->", group.lumped_mass, shape, frame.displacements[0][0]))
        )

    output = Output(on_frame=keep, frame_interval=options["time_step"])
    explicit_run(model, displacements=[shape[None]], output=output, **options)
    return np.array(found)


def recurrence_root(q: np.ndarray) -> complex:
    """Root λ of the two-term recurrence q_{n+1} = 2 Re λ q_n - |λ|² q_{n-1} that q obeys."""
    a, b = np.linalg.lstsq(np.column_stack([q[1:-1], q[:-2]]), q[2:], rcond=None)[0]
    return complex(0.5 * a, math.sqrt(max(-b - 0.25 * a * a, 0.0)))


@pytest.mark.parametrize("element", list(ElementType))
def test_patch_affine_state_stays_at_rest(element):
    # The nodal forces of an affine displacement vanish inside and are put on the boundary as
    # loads. What is left is round-off in the forces, 1e-16 of them: displacements off by
    # 1e-16 · 81 or so, energies off by the square of it.
    mesh = distorted_box((3, 3, 3))
    gradient = 1e-4 * np.array([[1.0, 0.4, -0.3], [0.2, -0.8, 0.5], [0.1, 0.6, 0.7]])
    affine = mesh.nodes @ gradient.T
    group = placed_body(mesh, CONCRETE, element=element, rotations=PLACEMENTS)
    reaction = (group.stiffness @ affine.ravel()).reshape(-1, 3)
    turned = np.einsum("cij,nj->cni", PLACEMENTS, reaction)
    model = lone_bodies((group,), loads=(nodal_load(0, turned, copies=[0, 1, 2]),))
    start = np.einsum("cij,nj->cni", PLACEMENTS, affine)
    result = explicit_run(model, displacements=[start], sample_interval=1, **short(model, 100))
    assert result.run.n_steps == 100
    assert result.run.energies.strain_energy > 1e-3
    kinetic = result.run.history.column("kinetic_energy")
    assert np.abs(kinetic).max() < (1e-14) ** 2 * 1e4 * result.run.energies.strain_energy
    np.testing.assert_allclose(result.displacements[0], start, atol=1e-13)


def test_a_mode_rings_at_the_frequency_of_central_differences():
    # sin(ω' Δt / 2) = ω Δt / 2 exactly; the recurrence is solved to round-off.
    group = placed_body(distorted_box((2, 2, 2)), CONCRETE)
    model = lone_bodies((group,))
    omega, shapes = modes(group)
    for k in (6, 20, -1):
        options = short(model, 60, factor=0.7)
        q = modal_coordinate(model, shapes[k], **options)
        root = recurrence_root(q)
        dt = options["time_step"]
        expected = 2.0 * math.asin(0.5 * omega[k] * dt)
        assert abs(root) == pytest.approx(1.0, abs=1e-9)
        assert np.angle(root) == pytest.approx(expected, rel=1e-8)


def test_frequency_error_is_second_order_in_the_time_step():
    # ω' / ω - 1 = (ω Δt)² / 24 + O(Δt⁴): halving Δt divides it by 4 up to (ω Δt)² / 10 < 2 %.
    group = bar(8)
    model = lone_bodies((group,))
    omega, shapes = modes(group)
    k = len(omega) // 2
    error = []
    for n in (1, 2, 4):
        dt = 0.4 / (n * omega[k])
        q = modal_coordinate(model, shapes[k], time_step=dt, end_time=200 * dt)
        error.append(np.angle(recurrence_root(q)) / (omega[k] * dt) - 1.0)
    orders = np.log2(np.array(error[:-1]) / error[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.03)


def test_fixed_free_bar_converges_to_the_closed_form_in_the_mesh_size():
    # ω = π c / 2 L; lumped linear elements are low by (π h / 2 L)² / 24: order 2.
    exact = 0.5 * math.pi * math.sqrt(1000.0 / 1e-9) / 100.0
    error = []
    for n in (4, 8, 16):
        group = bar(n)
        omega, shapes = modes(group, np.flatnonzero(group.mesh.nodes[:, 0] == 0.0))
        axial = np.argmax(np.abs(shapes[:, :, 0].sum(axis=1)))
        error.append(1.0 - omega[axial] / exact)
    np.testing.assert_allclose(np.log2(np.array(error[:-1]) / error[1:]), 2.0, atol=0.02)
    assert error[-1] == pytest.approx((0.5 * math.pi / 16) ** 2 / 24, rel=0.02)


def test_cantilever_released_from_its_mode_keeps_the_fixed_end_still():
    # The dynamic run against the eigenproblem of the supported body, in every placement.
    mesh = box_block((20.0, 4.0, 4.0), (6, 2, 2)).mesh
    group = placed_body(mesh, CONCRETE, rotations=PLACEMENTS)
    held = np.flatnonzero(mesh.nodes[:, 0] == 0.0)
    omega, shapes = modes(group, held)
    support = fixed_nodes(0, held, copies=[0, 1, 2])
    model = lone_bodies((group,), supports=(support,))
    options = short(model, 200)
    start = 1e-3 * np.einsum("cij,nj->cni", PLACEMENTS, shapes[0])
    result = explicit_run(model, displacements=[start], **options)
    assert (result.displacements[0][:, held] == 0.0).all()
    phase = 2.0 * math.asin(0.5 * omega[0] * options["time_step"]) * result.run.n_steps
    # v_{-½} = v_0 - ½ Δt a_0 makes q_n = cos(n ω' Δt) exactly.
    size = np.abs(start).max()
    np.testing.assert_allclose(result.displacements[0], math.cos(phase) * start, atol=1e-9 * size)


def test_wave_speed():
    # A step force sends a step of velocity along at c = √(E/ρ). On a chain of lumped masses
    # node k follows ∫₀^{2ct/h} J_2k, which passes 1/3 at t = x_k / c (to half a cell, the end).
    n, dx = 80, 1.25
    group = bar(n)
    nodes = group.mesh.nodes
    end = np.flatnonzero(nodes[:, 0] == 0.0)
    force = np.zeros_like(nodes)
    force[end, 0] = 0.25
    model = lone_bodies((group,), loads=(nodal_load(0, force),))
    speed = math.sqrt(1000.0 / 1e-9)
    node = int(np.flatnonzero(np.isclose(nodes[:, 0], 50.0))[0])
    times, moved = [], []

    def keep(frame: Frame) -> None:
        times.append(frame.time)
        moved.append(frame.displacements[0][0, node, 0])

    dt = 0.2 * dx / speed
    output = Output(on_frame=keep, frame_interval=dt)
    explicit_run(model, time_step=dt, end_time=75.0 / speed, output=output)
    # Behind the front of a unit force on a unit section the velocity is 1 / (ρ c).
    rate = np.gradient(np.array(moved), dt) * 1e-9 * speed
    arrival = np.interp(1.0 / 3.0, np.maximum.accumulate(rate), times)
    assert abs(arrival * speed - 50.0) < 0.5 * dx
    behind = rate[np.array(times) > 65.0 / speed].mean()
    assert behind == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    "rayleigh", [RayleighDamping(3e3), RayleighDamping(None, 2e-8)], ids=["mass", "stiffness"]
)
def test_prescribed_motion_follows_its_amplitude_and_its_work_is_counted(rayleigh):
    mesh = box_block((20.0, 4.0, 4.0), (4, 1, 1)).mesh
    group = placed_body(mesh, CONCRETE, rotations=PLACEMENTS[2:])
    held = np.flatnonzero(mesh.nodes[:, 0] == 0.0)
    pulled = np.flatnonzero(mesh.nodes[:, 0] == 20.0)
    move = np.array([1e-3, -2e-3, 5e-4])
    model = lone_bodies(
        (group,),
        supports=(
            fixed_nodes(0, held),
            fixed_nodes(0, pulled, displacement=move, amplitude=SmoothStepAmplitude(1e-4)),
        ),
        effects=Effects(rayleigh=rayleigh),
    )
    result = explicit_run(model, end_time=1.5e-4, sample_interval=5)
    np.testing.assert_allclose(
        result.displacements[0][0, pulled], np.tile(move, (4, 1)), atol=1e-15
    )
    assert result.run.energies.external_work > 0.0
    assert result.run.energies.viscous_dissipation > 0.0
    assert result.run.energy_balance < 1e-12


EFFECTS = {
    "none": Effects(),
    "mass": Effects(rayleigh=RayleighDamping(mass_proportional=2e4)),
    "stiffness": Effects(rayleigh=RayleighDamping(stiffness_proportional=2e-8)),
    "bulk": Effects(bulk_viscosity=BulkViscosity()),
    "all": Effects(
        rayleigh=RayleighDamping(mass_proportional=2e4, stiffness_proportional=2e-8),
        bulk_viscosity=BulkViscosity(),
        gravity=np.array([1e3, 2e3, -9810.0]),
    ),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_energy_is_conserved_to_round_off(name):
    # Work and dissipation use the mean velocity of the two half steps: for a linear body the
    # sum is an identity of the scheme, whatever the step; round-off grows as √n_steps.
    group = placed_body(distorted_box((3, 2, 2)), CONCRETE, rotations=PLACEMENTS)
    rng = np.random.default_rng(0)
    force = rng.standard_normal(group.mesh.nodes.shape)
    load = nodal_load(0, force, copies=[0, 2], amplitude=SmoothStepAmplitude(1e-5))
    # Nothing drifts away: K u of a large translation would be all round-off.
    held = fixed_nodes(0, np.arange(2), copies=[0, 1, 2])
    guided = fixed_nodes(0, np.arange(2, 6), copies=[0, 1, 2], components=(0, 2))
    model = lone_bodies((group,), supports=(held, guided), loads=(load,), effects=EFFECTS[name])
    result = explicit_run(model, sample_interval=7, **short(model, 2000))
    assert result.run.energy_balance < 1e-12
    lost = result.run.energies.viscous_dissipation
    assert (lost == 0.0) if name == "none" else (lost > 0.0)


@pytest.mark.parametrize("turning", [False, True], ids=["straight", "turning"])
@pytest.mark.parametrize("name", EFFECTS)
def test_a_body_that_starts_strained_and_at_rest_has_no_viscous_force(name, turning):
    # Dampers see rates, and at rest there is none: -½ Δt a_0 is that of the elastic force alone,
    # to the round-off of one product. Before, the whole strain counted as one step's rate.
    group = placed_body(distorted_box((2, 2, 2)), CONCRETE)
    start = 1e-4 * np.random.default_rng(3).standard_normal((1, *group.mesh.nodes.shape))
    velocities = []
    for effects in (Effects(gravity=EFFECTS[name].gravity), EFFECTS[name]):
        model = lone_bodies((group,), effects=replace(effects, finite_rotation=turning))
        loop = prepare(replace(model, displacements=[start]), time_step=1e-6)
        velocities.append(loop.bodies[0].now.velocity)
    elastic, damped = velocities
    np.testing.assert_allclose(damped, elastic, rtol=0, atol=1e-12 * abs(elastic).max())


def test_energy_does_not_drift():
    # Round-off alone gives 1e-16 · n at the very worst.
    n_steps, group = 100_000, placed_body(cube(1), CONCRETE)
    rng = np.random.default_rng(0)
    velocity = rng.standard_normal((1, 8, 3))
    velocity[0, :3] = 0.0
    model = lone_bodies((group,), supports=(fixed_nodes(0, np.arange(3)),))
    result = explicit_run(
        model, velocities=[velocity], sample_interval=1000, **short(model, n_steps)
    )
    assert result.run.n_steps == n_steps
    assert result.run.energy_balance < 1e-16 * n_steps


@pytest.mark.parametrize(
    ("alpha", "beta"), [(4e4, None), (None, 4e-8), (2e4, 2e-8)], ids=["mass", "stiffness", "both"]
)
def test_rayleigh_damping_ratio(alpha, beta):
    # ξ = ½ (α/ω + β ω); the scheme adds errors of order ω Δt · ξ (stiffness damping lags half
    # a step) and (ω Δt)².
    group = placed_body(distorted_box((2, 2, 2)), CONCRETE)
    omega, shapes = modes(group)
    model = lone_bodies((group,), effects=Effects(rayleigh=RayleighDamping(alpha, beta)))
    options = short(model, 400, factor=0.2)
    dt = options["time_step"]
    for k in (6, 30):
        root = recurrence_root(modal_coordinate(model, shapes[k], **options))
        exponent = np.log(root) / dt
        ratio = -exponent.real / abs(exponent)
        expected = 0.5 * ((alpha or 0.0) / omega[k] + (beta or 0.0) * omega[k])
        tolerance = omega[k] * dt * expected + (omega[k] * dt) ** 2
        assert ratio == pytest.approx(expected, rel=tolerance)
        # And exactly the root of the scheme's own characteristic polynomial.
        a, b, w = (
            0.5 * (alpha or 0.0) * dt,
            (beta or 0.0) * omega[k] ** 2 * dt,
            (omega[k] * dt) ** 2,
        )
        exact = np.roots([1 + a, -2 + w + b, 1 - a - b])
        assert abs(root - exact[np.argmax(exact.imag)]) < 1e-6


def test_bulk_viscosity_damps_the_dilatational_mode_of_one_element_by_b1():
    # Uniaxial strain of a cube: ω = 2 c / h, C / M = 4 b₁ c / h, hence ξ = b₁ (linear part).
    # The viscous force lags half a step: relative error of order ω Δt.
    mesh = cube(1)
    group = placed_body(mesh, CONCRETE)
    c, h, b1 = CONCRETE.dilatational_wave_speed, 10.0, 0.06
    effects = Effects(bulk_viscosity=BulkViscosity(b1, 0.0))
    sides = fixed_nodes(0, np.arange(8), components=(1, 2))
    model = lone_bodies((group,), supports=(sides,), effects=effects)
    omega = 2.0 * c / h
    dt = 0.01 / omega
    stretch = np.zeros((8, 3))
    stretch[:, 0] = mesh.nodes[:, 0] - 5.0
    root = recurrence_root(modal_coordinate(model, stretch, time_step=dt, end_time=800 * dt))
    exponent = np.log(root) / dt
    assert abs(exponent) == pytest.approx(omega, rel=0.01)
    assert -exponent.real / abs(exponent) == pytest.approx(b1, rel=0.01)


def test_quadratic_bulk_viscosity_acts_in_compression_only():
    mesh = cube(1)
    group = placed_body(mesh, CONCRETE)
    model = lone_bodies((group,), effects=Effects(bulk_viscosity=BulkViscosity(0.0, 1.2)))
    stretch = (mesh.nodes - 5.0)[None]
    rate = 1.0
    lost = {}
    for sign in (1.0, -1.0):
        dt = 1e-3 * model.critical.critical_time_step
        result = explicit_run(
            model,
            time_step=dt,
            end_time=4 * dt,
            velocities=[sign * rate * stretch],
            sample_interval=1,
        )
        lost[sign] = result.run.energies.bulk_viscosity_dissipation
    # Three steps at volumetric rate 3: V ρ (b₂ L)² · 3³ · 3 Δt, minus half of the first step,
    # before which there was no rate; the rate changes by 1e-6 in them.
    expected = 1e3 * 2.4e-9 * (1.2 * 10.0) ** 2 * 27.0 * 2.5 * dt
    assert lost[1.0] == 0.0
    assert lost[-1.0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("name", EFFECTS)
def test_critical_time_step_is_sharp(name):
    # A random start has all modes: bounded just below the limit; 1 % above it the worst mode
    # grows by e^(0.28) per step and the watchdog stops it.
    group = placed_body(distorted_box((2, 2, 2)), CONCRETE)
    model = lone_bodies((group,), effects=EFFECTS[name])
    velocity = np.random.default_rng(0).standard_normal((1, 27, 3))
    stable = explicit_run(model, velocities=[velocity], **short(model, 3000, factor=0.999))
    start = 0.5 * group.lumped_mass @ (velocity[0] ** 2).sum(axis=1)
    assert stable.run.history.column("strain_energy").max() < 1e4 * start
    time_step = 1.01 * stable.run.critical.critical_time_step
    loop = prepare(replace(model, velocities=[velocity]), time_step=time_step)
    with pytest.raises(UnstableRun, match=r"unstable at t = .* block\[0\] .*safety_factor"):
        watched_steps(loop, 3000)


def watched_steps(loop: Loop, n_steps: int) -> None:
    history = History()
    for _ in range(n_steps):
        step(loop, sample=True)
        history.observe(energies(loop))
        watch(loop, history)


def test_hourglass_modes_do_not_grow():
    # Velocities in hourglass patterns. ½ v₋ · M v₊ + ½ u · K u is conserved; over a period the
    # strain energy of a mode peaks at its share over 1 - (ω Δt / 2)², and ω Δt / 2 <= factor.
    factor = 0.3
    mesh = cube(3)
    group = placed_body(mesh, CONCRETE, element=ElementType.REDUCED)
    signs = np.prod(np.where(np.round(mesh.nodes / (10 / 3)).astype(int) % 2 == 0, 1, -1), axis=1)
    velocity = np.zeros((1, mesh.n_nodes, 3))
    velocity[0, :, 0] = signs
    model = lone_bodies((group,))
    result = explicit_run(
        model, velocities=[velocity], sample_interval=3, **short(model, 9000, factor)
    )
    put_in = 0.5 * group.lumped_mass.sum()
    hourglass = result.run.history.column("hourglass_energy")
    assert hourglass.max() > 0.1 * put_in
    assert hourglass.max() <= put_in / (1.0 - factor**2)
    assert result.run.history.column("strain_energy").max() <= put_in / (1.0 - factor**2)
    assert np.all(result.run.history.column("strain_energy") >= hourglass - 1e-9 * put_in)


def test_effects_that_are_off_leave_the_bits_of_the_bare_loop():
    group = placed_body(distorted_box((3, 2, 2)), CONCRETE, translations=np.zeros((5, 3)))
    velocity = np.random.default_rng(0).standard_normal((5, group.n_nodes, 3))
    model = lone_bodies((group,))
    dt = 0.9 * model.critical.critical_time_step
    loop = prepare(replace(model, velocities=[velocity]), time_step=dt)
    body = loop.bodies[0]
    for _ in range(200):
        step(loop)
    u = aligned_zeros((body.n_rows, 3, 8))
    v, f = to_lanes(velocity, body.rows.order), np.zeros_like(u)
    r = body.rows
    for _ in range(200):
        SERIAL.stiffness_product(*r.packed, u.ravel(), f.ravel(), None, 8)
        v += (dt / body.mass[:, None, None]) * -f
        u += dt * v
    np.testing.assert_array_equal(body.now.displacement, u)
    np.testing.assert_array_equal(body.now.velocity, v)


@pytest.mark.parametrize("name", ["none", pytest.param("all", marks=pytest.mark.slow)])
def test_threads_copies_and_samples_do_not_change_a_bit(name):
    effects = EFFECTS[name]
    if name == "all":
        effects = Effects(
            effects.rayleigh, effects.bulk_viscosity, finite_rotation=True, gravity=effects.gravity
        )
    mesh = distorted_box((3, 2, 2))
    rng = np.random.default_rng(0)
    velocity = rng.standard_normal((4, mesh.n_nodes, 3))
    results = []
    for n_copies, threads, interval in ((2, 1, 50), (2, 2, 50), (4, 1, 3)):
        group = placed_body(mesh, CONCRETE, rotations=PLACEMENTS[[0, 1, 2, 0]][:n_copies])
        model = lone_bodies((group,), effects=effects)
        results.append(
            explicit_run(
                model,
                velocities=[velocity[:n_copies]],
                threads=threads,
                sample_interval=interval,
                **short(model, 150),
            ).displacements[0][:2]
        )
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


def test_gravity_gives_free_fall():
    # u = ½ g t² exactly for a constant acceleration from rest.
    group = placed_body(cube(2), CONCRETE, rotations=PLACEMENTS)
    g = np.array([0.0, 3.0, -9810.0])
    model = lone_bodies((group,), effects=Effects(gravity=g))
    result = explicit_run(model, **short(model, 500))
    fall = 0.5 * g * result.time**2
    expected = np.broadcast_to(fall, result.displacements[0].shape)
    np.testing.assert_allclose(result.displacements[0], expected, atol=1e-11 * np.abs(fall).max())
    assert result.run.energy_balance < 1e-11


def test_corner_order_of_the_reference_cube():
    # The breathing mode above relies on it.
    np.testing.assert_array_equal(np.sign(cube(1).nodes[cube(1).elements[0]] - 5.0), CORNERS)
