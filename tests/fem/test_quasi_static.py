"""Frequencies of blocks on contacts, recommended times, and what counts as static."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fem import ExponentialLaw, Frames, LinearPenalty, Material, Problem, concrete
from fem.answer.measures import unrestrained_blocks
from fem.explicit.output.energy import COLUMNS
from fem.explicit.run import Status
from fem.explicit.setup.quasi_static import (
    block_frequencies,
    motions_about_centroid,
    quasi_static_report,
)
from fem.explicit.setup.timed_system import timed_system
from fem.static.solve import static_state
from fem.system.effects import AdaptiveMassDamping, BulkViscosity, Effects, RayleighDamping
from geometry.families.boxes import BrickStack, ColumnBox, box_column
from geometry.loads import LoadCase, face_pressure, named_load
from geometry.parts.regions import HeldFace
from tests.support.answers import on_its_mesh
from tests.support.coarse_tubes import coarse, ring
from tests.support.explicit_runs import explicit_run
from tests.support.fem_problems import deformable_assembly
from validation import InputError, load_case

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)


def column(law, *, layers=1, material=CONCRETE):
    """Bricks 100 × 60 × 50 on each other between two rigid ones; no load."""
    wall = BrickStack((100.0, 60.0, 50.0), (2, 2, 2), columns=1, layers=layers).build()
    load = LoadCase(wall, "none", (), wall.fixed)
    return deformable_assembly(wall, load, material, law=law)


def tube(**options):
    found = ring(1, (12, 2, 4))
    return deformable_assembly(found, named_load("pipe", 0.01).on(found), CONCRETE, **options)


def test_rigid_motions_are_rigid():
    """Any combination changes no distance to first order: the gradient is skew (round-off)."""
    deformable = tube()
    group = deformable.bodies[0]
    points = group.mesh.nodes[:4]
    motions = motions_about_centroid(group, points)
    for i in range(6):
        for a in range(4):
            for b in range(a):
                change = (motions[a, :, i] - motions[b, :, i]) @ (points[a] - points[b])
                assert abs(change) < 1e-10


def test_frequency_of_a_brick_between_two_springs():
    """Up and down: ω² = 2 k A / m; two bricks on three springs: ω² = (2 ∓ 1) k A / m. Turning
    modes are softer only by geometry: ω² = 2 k I_area / Θ per axis; sliding meets nothing."""
    stiffness = 50.0
    law = LinearPenalty(stiffness)
    mass = 2.4e-9 * 100.0 * 60.0 * 50.0
    stiff = Material(
        density=2.4e-9, young_modulus=1e16, poisson_ratio=0.2
    )  # next to which the springs' compliance is all, to 1e-13
    found = block_frequencies(timed_system(column(law, material=stiff)).system, 0.01)
    heave = 2.0 * stiffness * 6000.0 / mass
    # The lumped mass of the mesh turns with its own inertia, not the brick's.
    nodes = column(law).bodies[0].mesh.nodes
    lumped = column(law).bodies[0].lumped_mass
    arm = nodes - lumped @ nodes / lumped.sum()
    turns = []
    for axis, width, length in ((0, 60.0, 100.0), (1, 100.0, 60.0)):
        # 2 × 2 Gauss on facets halves of the width: the exact second moment of area.
        area = length * width**3 / 12.0
        inertia = lumped @ (arm[:, 1 - axis] ** 2 + arm[:, 2] ** 2)
        turns.append(2.0 * stiffness * area / inertia)
    lowest = math.sqrt(min(heave, *turns)) / (2.0 * math.pi)
    assert found.lowest == pytest.approx(lowest, rel=1e-10)


@pytest.mark.parametrize("stiffness", [1e4, 1e9, 1e18])
def test_stiff_contact_promises_no_frequency_that_no_elastic_block_has(stiffness):
    """Between rigid ends a brick of height h swings no faster than a clamped bar, c / 2h; as rigid
    blocks it was 470 times that for a law of 1e9 MPa/mm, and the run ended before a wave had
    crossed it. Half of a brick that yields as a whole gives the lower bound, c / 8h."""
    effects = Effects(adaptive_mass_damping=AdaptiveMassDamping())
    times = timed_system(column(LinearPenalty(stiffness)), effects=effects).times.recommended
    clamped = math.sqrt(CONCRETE.young_modulus / CONCRETE.density) / (2.0 * 50.0)
    assert clamped / 4.0 < times.frequency < clamped
    assert times.end_time > 50.0 / clamped


@pytest.mark.parametrize("damped", [True, False])
def test_a_verdict_does_not_advise_what_is_on(damped):
    deformable = tube()
    damping = AdaptiveMassDamping() if damped else None
    stated = timed_system(
        deformable,
        effects=Effects(adaptive_mass_damping=damping),
        ramp_time=1e-4,
    )
    result = explicit_run(stated, end_time=2e-4, residual=1e-12, sample_interval=10)
    report = quasi_static_report(result)
    assert "exceeds" in report.verdict
    assert ("fem.damping" in report.verdict) is not damped


def test_a_run_stops_where_its_round_off_stands():
    """ε √Σ (k u)² over the load is the residual that remains, within a factor of four either way;
    a run that asks for a tenth of it ends there, is not called static, and says what to do."""
    deformable = tube()
    stated = timed_system(
        deformable,
        counted_pressure=10.0,
        effects=Effects(adaptive_mass_damping=AdaptiveMassDamping()),
    )
    result = explicit_run(
        stated,
        end_time=20 * stated.times.end,
        sample_interval=10,
        residual=1e-15,
    )
    assert result.run.status is Status.STALLED
    assert 0.25 < result.run.history.column("residual").min() / result.run.rest.round_off < 4.0
    report = quasi_static_report(result)
    assert not report.is_static
    assert "a larger fem.residual" in report.verdict


def test_a_law_that_presses_before_the_load_starts_with_a_blow():
    """1.5 MPa at zero clearance under a load of 0.01 MPa: contact holds more energy at the start
    than the load ever does. The balance shows the error in time of that blow, of second order
    in the step; no stiffness is met that the first time step did not count."""
    deformable = tube(law=ExponentialLaw(pressure_at_zero_clearance=1.5))
    statement = timed_system(
        deformable, effects=Effects(adaptive_mass_damping=AdaptiveMassDamping())
    )
    assert statement.counted_pressure == pytest.approx(2.0 * 1.5)
    balance = []
    for factor in (0.2, 0.1, 0.05):
        state = explicit_run(statement, end_time=1e-4, safety_factor=factor, sample_interval=1)
        column = state.run.history.column
        assert column("contact_energy")[0] > 10.0 * np.abs(column("external_work")).max()
        balance.append(state.run.energy_balance)
    # Second order is a factor of four; half of the way to first order is for kinks of the law.
    assert balance[0] / balance[1] > 2.8
    assert balance[1] / balance[2] > 2.8


def test_frequencies_are_those_of_the_sector():
    deformable = tube()
    whole = block_frequencies(timed_system(deformable).system, 0.01)
    sector = block_frequencies(timed_system(deformable, symmetry="sector").system, 0.01)
    assert sector.excited == pytest.approx(whole.excited, rel=1e-9)
    assert sector.lowest >= whole.lowest * (1.0 - 1e-9)


def test_nothing_resists_is_said():
    apart = column(LinearPenalty(50.0))
    system = timed_system(apart).system
    none = system.points.subset(np.arange(0))
    with pytest.raises(ValueError, match="resists"):
        block_frequencies(system.on(none), 0.01)


def test_little_kinetic_energy_is_not_static():
    """Damped as in the paper (α = 2 /s) a tube rings on: there are times under full load with
    kinetic energy below 1 % of the internal energy (it swings through zero) and a force residual
    above 1 %. The report says that the end is not static."""
    deformable = tube()
    times = timed_system(deformable).times.recommended
    assert times.ramp_time == pytest.approx(10.0 / times.frequency)
    paper = Effects(rayleigh=RayleighDamping(2.0, 1e-8), bulk_viscosity=BulkViscosity())
    ramp = 2.0 / times.frequency
    statement = timed_system(
        deformable,
        counted_pressure=10.0,  # above what presses here
        effects=paper,
        ramp_time=ramp,
    )
    result = explicit_run(statement, end_time=3.0 * ramp, residual=1e-12, sample_interval=10)
    table = {name: result.run.history.column(name) for name in COLUMNS}
    held = table["time"] > ramp
    internal = table["strain_energy"] + table["contact_energy"]
    still = table["kinetic_energy"] < 0.01 * internal
    assert (still & held).any()
    assert (table["residual"][still & held] > 0.01).any()
    report = quasi_static_report(result)
    assert not report.is_static
    assert "residual" in report.verdict
    # A run that nothing damps to rest is a motion, as stated: no failure to arrive.
    assert report.verdict.startswith("in motion at ")
    energies = result.run.energies
    internal = energies.strain_energy + energies.contact_energy
    kinetic = report.kinetic_over_internal_energy
    assert kinetic == pytest.approx(energies.kinetic_energy / internal, rel=1e-12)
    assert report.hold_time == pytest.approx(2.0 * ramp, rel=1e-2)
    assert result.run.energy_balance < 1e-2


def test_elastic_frames_reach_the_static_state():
    """Frames that deform, held at their outer faces: explicit and static agree within 1e-3."""
    deformable = tube(frames=Frames.DEFORMABLE)
    statement = timed_system(
        deformable,
        counted_pressure=10.0,
        effects=Effects(adaptive_mass_damping=AdaptiveMassDamping(interval=50)),
    )
    result = explicit_run(statement, end_time=statement.times.end, residual=1e-5)
    static = static_state(deformable)
    for a, b in zip(result.displacements, static.displacements, strict=True):
        assert np.sqrt(np.mean((a - b) ** 2)) < 1e-3 * np.sqrt(np.mean(b**2))


def test_floating_blocks_are_named_by_an_explicit_run() -> None:
    """Blocks 0.05 mm apart touch on some sides only. A static run finds no equilibrium on this mesh
    and names the remedy, which has the answer."""
    case = load_case(
        "tsb1-pipe",
        [*coarse(1, 2), "contact.spacing=0.05", "fem.mesh=scene", "fem.error_estimate=false"],
    )
    with pytest.raises(InputError, match=r"no equilibrium found .* use an explicit run"):
        on_its_mesh(case, method="static")
    explicit = on_its_mesh(case, method="explicit")
    assert explicit.report["loose_blocks"] == [4, 5, 6, 7]
    touching = case.changed({"contact.spacing": 0.0, "fem.method": "explicit"})
    assert not unrestrained_blocks(on_its_mesh(touching, method="explicit").details).size


def test_motions_that_supports_hold_have_no_frequency() -> None:
    """A brick on another, held upward at its top: what is left slides without resistance."""
    blocks = box_column([ColumnBox((80.0, 60.0, 40.0), (2, 2, 2))] * 2)
    load = face_pressure(blocks, np.array([1]), "z+", 0.01)
    free = timed_system(Problem(blocks, load, concrete).system).system
    assert block_frequencies(free, 0.01).lowest > 0.0
    top = replace(load, held=(HeldFace(1, "z+", np.eye(3)[2:]),))
    with pytest.raises(ValueError, match="no contact resists any motion"):
        timed_system(Problem(blocks, top, concrete).system)
