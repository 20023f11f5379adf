"""Robustness cases of explicit dynamics: time steps, impact, rotation, mechanisms."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from fem.contact.law import ExponentialLaw, LinearPenalty
from fem.explicit.output.energy import History, energies
from fem.explicit.run import Run
from fem.explicit.setup.quasi_static import quasi_static_report
from fem.explicit.setup.timed_system import timed_system
from fem.explicit.solve import (
    LARGEST_IMBALANCE,
    UnstableRun,
    run_explicit,
)
from fem.explicit.solve import watch as watch_energy
from fem.explicit.start import prepare
from fem.explicit.step import step as central_difference_step
from fem.explicit.timed import TimedSystem
from fem.method import Explicit
from fem.state import State
from fem.system.contact_state import contact_state
from fem.system.effects import AdaptiveMassDamping, Effects
from fem.system.system import System
from fem.system.time_step import TimeStepError
from geometry.block import box_block
from geometry.mesh import FloatArray
from validation.stability.case import CaseVerdict, case, case_verdict, rejected
from validation.stability.contact_law import STIFF_LAW
from validation.stability.problems import (
    COLUMN,
    CONCRETE,
    deformable,
    held_nodes,
    one_block,
    pressed,
    relative_difference,
    stack,
)

#: Ten metres per second [mm/s].
IMPACT_SPEED = 10_000.0
#: Largest stiffness of the contact of that case [MPa/mm].
IMPACT_STIFFNESS = 1000.0


def free_cube(effects: Effects | None = None) -> TimedSystem:
    """A cube of 10 mm that nothing holds, eight elements."""
    cube = one_block(box_block((10.0, 10.0, 10.0), (2, 2, 2)))
    return timed_system(cube, effects=effects, ramp_time=0.0, end_time=1.0)


def noise(model: TimedSystem, size: float) -> tuple[FloatArray, ...]:
    """Random velocities that excite every mode [mm/s]."""
    rng = np.random.default_rng(1)
    return tuple(size * rng.standard_normal((g.n_copies, g.n_nodes, 3)) for g in model.bodies)


def ended(stated: TimedSystem, method: Explicit | None = None) -> tuple[State, Run]:
    """State at the end of a run, and the run."""
    state = run_explicit(stated, method or Explicit())
    assert state.run is not None
    return state, state.run


def settled_column(
    stated: System, *, ramp: float, end: float, residual: float = 1e-5
) -> tuple[State, Run, FloatArray]:
    """Run a pressed column to its static state; its contact pressures [MPa]."""
    damped = Effects(adaptive_mass_damping=AdaptiveMassDamping())
    whole = timed_system(stated, effects=damped, ramp_time=ramp).until(end)
    state, run = ended(whole, Explicit(residual=residual))
    return state, run, contact_state(stated, state.displacements).point_pressures


@case("time-step-0.99")
def below_critical() -> CaseVerdict:
    """0.99 of the critical step, all modes excited: energy is kept."""
    model = free_cube()
    critical, start = model.critical.critical_time_step, noise(model, 100.0)
    excited = model.until(5000 * critical, velocities=start)
    _, result = ended(excited, Explicit(time_step=0.99 * critical))
    return case_verdict(("energy balance of 5 000 steps", result.energy_balance, 1e-9))


@case("time-step-1.01")
def above_critical() -> CaseVerdict:
    """1.01 of the critical step: rejected."""
    model = free_cube()
    too_long, words = 1.01 * model.critical.critical_time_step, "at most the critical time step"
    run = partial(run_explicit, model.until(1e-3), Explicit(time_step=too_long))
    return rejected(run, TimeStepError, "expected", words)


@case("time-step-1.01-forced")
def forced() -> CaseVerdict:
    """1.01 of the critical step past the door: the watchdog stops the run, nothing infinite."""
    model = free_cube()
    too_long = 1.01 * model.critical.critical_time_step
    loop = prepare(replace(model, velocities=noise(model, 100.0)), time_step=too_long)
    history = History()

    def run() -> None:
        for number in range(5000):
            sample = number % 50 == 0
            central_difference_step(loop, sample=sample)
            if sample:
                history.observe(energies(loop))
                watch_energy(loop, history)

    stopped = rejected(run, UnstableRun, "unstable", "take a smaller")
    finite = bool(np.isfinite(loop.bodies[0].now.displacement).all())
    return stopped if finite else case_verdict(("finite at the stop", finite, "==", 1))


@case()
def impact_10_m_per_s() -> CaseVerdict:
    """A brick hits its support at 10 m/s, undamped: rejected, or less error with a shorter step.

    Contact is capped at 1000 MPa/mm. The energy of the largest step rejects it; half and a quarter
    of it have less and less error.
    """
    assembly = stack(1, top_fixed=True)
    load = replace(pressed(assembly, 0.0), fixed=assembly.fixed)
    # Without a cap the blow would press with gigapascals, which no step of this length resolves.
    law = ExponentialLaw(maximum_stiffness=IMPACT_STIFFNESS)
    stated = deformable(assembly, load, material=CONCRETE, clearance=0.1, law=law)
    model = timed_system(replace(stated, forces=()))
    group = model.bodies[0]
    velocity = np.zeros((1, group.n_nodes, 3))
    velocity[:, :, 2] = -IMPACT_SPEED

    falls = model.until(1e-4, velocities=(velocity,))

    def run(factor: float) -> Run:
        return ended(falls, Explicit(sample_interval=1, safety_factor=factor))[1]

    words = "differ from the external work"
    stopped = rejected(lambda: run(0.9), UnstableRun, words)
    half, quarter = run(0.45), run(0.225)
    contact = float(half.history.column("contact_energy").max())
    start = 0.5 * float(group.lumped_mass.sum()) * IMPACT_SPEED**2
    # The blow is a vibration near the stability limit (ω Δt close to 2), which misplaces energy.
    # The scheme is of second order where the law is smooth, of first across its kinks: half a step
    # gives a half to a quarter.
    return case_verdict(
        ("contact energy over kinetic at the start", contact / start, ">=", 0.01),
        ("rejected at 0.9 of the step", stopped.kind == "refused", "==", 1),
        ("energy balance at 0.45", half.energy_balance, LARGEST_IMBALANCE),
        ("its fall to 0.225 of the step", half.energy_balance / quarter.energy_balance, ">=", 2.0),
    )


@case()
def rotation_360() -> CaseVerdict:
    """A cube turns by 360°: no strain but the centrifugal, energy is kept."""
    model = free_cube(Effects(finite_rotation=True))
    group = model.bodies[0]
    critical = model.critical.critical_time_step
    period = 4000 * critical
    arm = group.mesh.nodes - group.mesh.nodes.mean(axis=0)
    spin = 2.0 * np.pi / period
    turns = (np.cross([0.0, 0.0, spin], arm)[None],)
    state, result = ended(model.until(period, velocities=turns))
    assert state.velocity is not None
    moved, velocity = state.displacements[0][0], state.system.expand(state.velocity)[0][0]
    end = arm + moved - 0.5 * result.time_step * velocity
    before, after = (
        np.einsum("n,ni->i", group.lumped_mass, np.cross(x, v))
        for x, v in ((arm, np.cross([0.0, 0.0, spin], arm)), (end, velocity))
    )
    # Back where it was, but for the half step at the end and the phase of a centred rotation,
    # (ω Δt)²/24 of the angle; centrifugal strain is ρ ω² r² / E.
    stretch = CONCRETE.density * (spin * 10.0) ** 2 / CONCRETE.young_modulus
    back = float(np.abs(moved).max())
    allowed = 10.0 * (stretch + 2.0 * np.pi * (result.time_step / period + 1e-4))
    return case_verdict(
        ("angular momentum", relative_difference(after, before), 1e-5),
        ("energy balance", result.energy_balance, 1e-5),
        ("distance from the start [mm]", back, allowed),
    )


@case(slow=True)
def steps_1e6() -> CaseVerdict:
    """A million steps of a held element: energy is kept."""
    cube = box_block((10.0, 10.0, 10.0), (1, 1, 1))
    held = held_nodes(np.flatnonzero(cube.mesh.nodes[:, 2] == 0.0))
    model = timed_system(one_block(cube, supports=held), ramp_time=0.0, end_time=1.0)
    end, start = 1e6 * 0.9 * model.critical.critical_time_step, noise(model, 100.0)
    _, result = ended(model.until(end, velocities=start), Explicit(sample_interval=10_000))
    # Round-off walks: sqrt(1e6) eps = 2e-13 in velocity, ten times that at worst in energy.
    balance = result.energy_balance
    return case_verdict(("steps", result.n_steps, ">=", 1e6), ("energy balance", balance, 1e-9))


@case()
def zero_load_explicit() -> CaseVerdict:
    """No load, blocks that just touch, linear law: rest, exactly."""
    assembly = stack(2, top_fixed=True)
    stated = deformable(assembly, pressed(stack(2), 0.0), law=LinearPenalty(100.0))
    model = timed_system(replace(stated, forces=()))
    state, _ = ended(model.until(200 * model.critical.critical_time_step))
    largest = max(float(np.abs(u).max()) for u in state.displacements)
    return case_verdict(("largest displacement [mm]", largest, 0.0))


@case(slow=True)
def density_ratio_1e6() -> CaseVerdict:
    """Neighbours whose densities differ by 1e6: static joint pressures."""
    # The exponential law presses stiffly: the column comes to rest in a tenth of the steps.
    pressure, light = 1.0, replace(COLUMN, density=1e-6 * COLUMN.density)
    load, materials = pressed(stack(1), pressure), (COLUMN, COLUMN, light)
    stated = deformable(stack(1), load, material=materials)
    _, result, pressures = settled_column(stated, ramp=1e-5, end=2e-2, residual=1e-3)
    return case_verdict(
        ("residual", result.residual if result.residual is not None else np.nan, 1e-3),
        ("energy balance", result.energy_balance, 1e-2),
        ("joint pressures", relative_difference(pressures, np.array(pressure)), 1e-2),
    )


@case()
def stiff_law_explicit() -> CaseVerdict:
    """Law a hundred times stiffer: the step shrinks, energy is kept."""
    load, laws = pressed(stack(1), 0.01), (ExponentialLaw(), STIFF_LAW)
    runs = [
        settled_column(deformable(stack(1), load, law=law), ramp=5e-4, end=2e-2) for law in laws
    ]
    (_, usual, _), (_, stiff, _) = runs
    return case_verdict(
        ("time step, stiff over usual", stiff.time_step / usual.time_step, 1.0),
        ("energy balance", max(run.energy_balance for _, run, _ in runs), 1e-2),
        ("joint pressures", max(relative_difference(p, np.array(0.01)) for *_, p in runs), 1e-2),
    )


@case()
def mechanism_driven_explicit() -> CaseVerdict:
    """A column pushed sideways without friction: the run says that it is not static."""
    assembly = stack(1)
    stated = deformable(assembly, pressed(assembly, 0.01, face="inner"))
    state, _, _ = settled_column(stated, ramp=2e-4, end=4e-3)
    report = quasi_static_report(state)
    assert report is not None
    return case_verdict(("called static", report.is_static, "==", 0), message=report.verdict)
