"""Known laws of friction in explicit runs: hysteresis, sticking, gravity that grows."""

import numpy as np
import pytest

from fem import CoulombFriction, LinearPenalty
from fem.dynamics import stated_run
from fem.explicit.setup.timed_system import timed_system
from fem.system.effects import Effects, paper_rayleigh
from fem.system.rows import SmoothStepAmplitude, TabularAmplitude
from tests.support.explicit_runs import explicit_run
from tests.support.fem_problems import in_contact
from tests.support.floor import GRAVITY, block_on_floor
from tests.support.lone_bodies import fixed_nodes, lone_bodies, with_supports
from validation import Case, load_case

#: A block of 40 × 30 mm² pressed into the floor so far, on a linear law [mm, MPa/mm].
SINK, PENALTY, AREA = 5e-4, 200.0, 1200.0
FRICTION = CoulombFriction(0.3, 50.0)
#: Friction at its limit [N] and the elastic slip that reaches it [mm].
LIMIT = FRICTION.coefficient * PENALTY * SINK * AREA
ELASTIC = FRICTION.coefficient * PENALTY * SINK / FRICTION.stick_stiffness


def pushed(amplitude, cycles):
    """All nodes moved along x by 0, +A, -A, +A …, back to +A after so many cycles."""
    deformable = block_on_floor(law=LinearPenalty(PENALTY), lift=-SINK)
    model = timed_system(in_contact(deformable, friction=FRICTION))
    turns = np.array([0.0, 1.0, *([-1.0, 1.0] * cycles)])
    times = np.cumsum([0.0, 1.0, *([2.0] * 2 * cycles)]) * 2.5e-4
    moved = fixed_nodes(
        0,
        np.arange(model.bodies[0].n_nodes),
        displacement=np.array([amplitude, 0.0, 0.0]),
        amplitude=TabularAmplitude(tuple(times), tuple(turns)),
    )
    end = float(times[-1])
    # Time steps meet the turning points.
    step = 2.5e-4 / 128
    held = with_supports(model, moved)
    return explicit_run(held, end_time=end, time_step=step, sample_interval=1)


def test_a_block_pushed_there_and_back_loses_the_area_of_the_loop():
    """A quarter loses μN (A - s), a cycle 4 μN (A - s), s the elastic slip: all nodes move alike,
    so every point has that pressure and slip, and the anchor's path is what counts, however it is
    stepped, but for the steps in which sliding begins, at the start and after four turns: those
    count with the mean of both tractions, at most half a step's work less. The last sample is one
    step before the end, of 2 A in 5e-4 s."""
    amplitude = 0.05
    result = pushed(amplitude, 2)
    expected = LIMIT * (9.0 * amplitude - 9.0 * ELASTIC)
    last_step = LIMIT * 2.0 * amplitude / 5e-4 * result.run.time_step
    lost = result.run.energies.frictional_dissipation
    assert lost == pytest.approx(expected - last_step, abs=5 * 0.5 * last_step)
    assert lost < expected - last_step
    # The supports' work is what is lost and stored: rounding, of some hundred steps.
    assert result.run.energy_balance < 1e-9


def test_what_sticks_loses_nothing():
    """Pushed by nine tenths of the elastic slip the joint is a spring: it holds k A²/2 at the turns
    and loses nothing, to rounding."""
    result = pushed(0.9 * ELASTIC, 2)
    held = result.run.history.column("contact_energy")
    spring = 0.5 * FRICTION.stick_stiffness * AREA * (0.9 * ELASTIC) ** 2
    assert held.max() - held[0] == pytest.approx(spring, rel=1e-9)
    assert np.abs(result.run.history.column("frictional_dissipation")).max() < 1e-12 * spring
    assert result.run.energy_balance < 1e-9


def test_gravity_that_grows_does_the_work_that_it_does():
    """A free block: speed g T/2 after a smooth step of T, which is odd about its middle; work is
    kinetic energy to rounding, as by central differences."""
    group = timed_system(block_on_floor()).bodies[0]
    duration, down = 2e-4, np.array([0.0, 0.0, -GRAVITY])
    effects = Effects(gravity=down, gravity_amplitude=SmoothStepAmplitude(duration))
    result = explicit_run(lone_bodies((group,), effects=effects), end_time=2 * duration)
    speed = -result.system.expand(result.velocity)[0][0, :, 2]
    # Of the second half all, but for the half step by which velocities lag.
    late = 0.5 * result.run.time_step * GRAVITY
    expected = GRAVITY * (0.5 * duration + result.time - duration) - late
    assert speed == pytest.approx(expected, rel=1e-6)
    energies = result.run.energies
    assert energies.external_work == pytest.approx(energies.kinetic_energy, rel=1e-10)


def plate(method: str, damping: str = "static", *, rough: bool = True) -> Case:
    """A plate on a held one, gravity leaning by 0.8 of the angle of friction, 0.3, or not rough."""
    friction = {"friction": {"coefficient": 0.3, "stick_stiffness": 100.0}} if rough else {}
    boxes = [{"size": [50.0, 50.0, 10.0], "divisions": [2, 2, 1]}] * 2
    return load_case(
        {
            "block": {"type": "boxes", "boxes": boxes},
            "load": {"pressure": 1e-6},
            "material": {"density": 2.4e-9, "young_modulus": 33e3, "poisson_ratio": 0.2},
            "contact": {"law": "linear", "stiffness": 200.0},
            "fem": {"method": method} | ({"damping": damping} if method == "explicit" else {}),
            "effects": {
                "gravity": [0.8 * 0.3 * GRAVITY if rough else 0.0, 0.0, -GRAVITY],
                **friction,
            },
        }
    )


def test_gravity_grows_only_on_the_way_to_a_static_state():
    """The paper's damping follows a motion: gravity is there from the start, and damping is what
    was written."""
    for damping, ramped in (("static", True), ("paper", False)):
        case = plate("explicit", damping)
        stated = stated_run(case.problem, case.method)
        effects = stated.effects
        assert (effects.gravity_amplitude is not None) is ramped
        if not ramped:
            assert effects.rayleigh == paper_rayleigh()
            continue
        adaptive = effects.adaptive_mass_damping
        assert (
            adaptive.fraction(0.5 * stated.times.ramp) < adaptive.fraction(stated.times.ramp) == 1.0
        )
