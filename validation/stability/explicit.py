"""Robustness cases of explicit dynamics: time steps, impact, rotation, mechanisms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.contact.law import ExponentialLaw, LinearPenalty
from fem.explicit.output.energy import History, energies
from fem.explicit.setup.quasi_static import quasi_static_report
from fem.explicit.setup.timed_system import timed_system
from fem.explicit.solve import (
    LARGEST_IMBALANCE,
    Run,
    StopCriterion,
    UnstableRun,
    initial_state,
    prepare,
    solve,
)
from fem.explicit.solve import watch as watch_energy
from fem.explicit.step import step as central_difference_step
from fem.explicit.timed import TimedSystem
from fem.system.effects import AdaptiveMassDamping, Effects
from fem.system.model import fixed_nodes
from fem.system.state import contact_state
from fem.system.system import System
from fem.system.time_step import TimeStepError
from geometry.block import box_block
from geometry.mesh import FloatArray
from validation.stability.case import Cases, Check, Finding, Verdict, refusal
from validation.stability.problems import (
    COLUMN,
    CONCRETE,
    deformable,
    one_block,
    pressed,
    relative,
    stack,
)

CASES = Cases("explicit")

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


def settled(
    stated: System, *, ramp: float, end: float, residual: float = 1e-5
) -> tuple[Run, FloatArray]:
    """Run a pressed column to its static state; the run and its contact pressures [MPa]."""
    whole = timed_system(
        stated,
        effects=Effects(adaptive_mass_damping=AdaptiveMassDamping()),
        ramp_time=ramp,
    )
    result = solve(
        whole,
        end_time=end,
        stop=StopCriterion(residual=residual, not_before=ramp),
    )
    return result, contact_state(stated, whole.expand(result.displacements)).point_pressures


@CASES.add("time-step-0.99", "0.99 of the critical step, all modes excited: energy is kept")
def _below_critical() -> Finding:
    model = free_cube()
    critical = model.critical.critical_time_step
    result = solve(
        model,
        end_time=5000 * critical,
        time_step=0.99 * critical,
        velocities=noise(model, 100.0),
    )
    return Finding(Check("energy balance of 5 000 steps", result.energy_balance, 1e-9))


@CASES.add("time-step-1.01", "1.01 of the critical step: rejected")
def _above_critical() -> Finding:
    model = free_cube()
    critical = model.critical.critical_time_step
    return refusal(
        lambda: solve(model, end_time=1e-3, time_step=1.01 * critical),
        TimeStepError,
        "expected at most the critical time step",
    )


@CASES.add(
    "time-step-1.01-forced",
    "1.01 of the critical step past the door: the watchdog stops the run, nothing infinite",
)
def _forced() -> Finding:
    model = free_cube()
    critical = model.critical.critical_time_step
    system = prepare(model, time_step=1.01 * critical)
    state = initial_state(system, velocities=noise(model, 100.0))
    history = History()

    def run() -> None:
        for number in range(5000):
            sample = number % 50 == 0
            central_difference_step(system, state, sample=sample)
            if sample:
                history.observe(energies(system, state))
                watch_energy(system, state, history)

    stopped = refusal(run, UnstableRun, "unstable", "take a smaller")
    finite = float(np.isfinite(state.bodies[0].displacement).all())
    checks = (*stopped.checks, Check("finite at the stop", finite, 1, 1))
    return Finding(*checks, refusal=stopped.refusal)


@CASES.add(
    "impact-10-m-per-s",
    "A brick hits its support at 10 m/s, no damping, contact capped at 1000 MPa/mm: rejected by "
    "its energy at the largest step; half and a quarter of it have less and less error",
)
def _impact() -> Finding:
    assembly = stack(1, top_fixed=True)
    load = replace(pressed(assembly, 0.0), fixed=assembly.fixed)
    # Without a cap the blow would press with gigapascals, which no step of this length resolves.
    law = ExponentialLaw(maximum_stiffness=IMPACT_STIFFNESS)
    stated = deformable(assembly, load, material=CONCRETE, clearance=0.1, law=law)
    model = timed_system(replace(stated, forces=()))
    group = model.bodies[0]
    velocity = np.zeros((1, group.n_nodes, 3))
    velocity[:, :, 2] = -IMPACT_SPEED

    def run(safety_factor: float) -> Run:
        return solve(
            model,
            end_time=1e-4,
            velocities=(velocity,),
            sample_interval=1,
            safety_factor=safety_factor,
        )

    rejected = refusal(lambda: run(0.9), UnstableRun, "differ from the external work")
    runs = [run(0.45), run(0.225)]
    errors = [each.energy_balance for each in runs]
    contact = float(runs[0].history.column("contact_energy").max())
    start = 0.5 * float(group.lumped_mass.sum()) * IMPACT_SPEED**2
    # The blow is a vibration near the stability limit (ω Δt close to 2), which misplaces energy.
    # The scheme is of second order where the law is smooth, of first across its kinks: half a step
    # gives a half to a quarter.
    return Finding(
        Check("contact energy over kinetic at the start", contact / start, least=0.01),
        Check("rejected at 0.9 of the step", float(rejected.verdict is Verdict.REFUSED), 1.0, 1.0),
        Check("energy balance at 0.45", errors[0], LARGEST_IMBALANCE),
        Check("its fall from 0.45 to 0.225 of the step", errors[0] / errors[1], least=2.0),
    )


@CASES.add("rotation-360", "A cube turns by 360°: no strain but the centrifugal, energy is kept")
def _revolution() -> Finding:
    model = free_cube(Effects(finite_rotation=True))
    group = model.bodies[0]
    critical = model.critical.critical_time_step
    period = 4000 * critical
    arm = group.mesh.nodes - group.mesh.nodes.mean(axis=0)
    spin = 2.0 * np.pi / period
    result = solve(model, end_time=period, velocities=(np.cross([0.0, 0.0, spin], arm)[None],))
    mass, half = group.lumped_mass, 0.5 * result.time_step
    momenta = [
        np.einsum("n,ni->i", mass, np.cross(arm + u, v))
        for u, v in (
            (np.zeros_like(arm), np.cross([0.0, 0.0, spin], arm)),
            (result.displacements[0][0] - half * result.velocities[0][0], result.velocities[0][0]),
        )
    ]
    # Back where it was, but for the half step at the end and the phase of a centred rotation,
    # (ω Δt)²/24 of the angle; centrifugal strain is ρ ω² r² / E.
    stretch = CONCRETE.density * (spin * 10.0) ** 2 / CONCRETE.young_modulus
    back = float(np.abs(result.displacements[0]).max())
    allowed = 10.0 * (stretch + 2.0 * np.pi * (result.time_step / period + 1e-4))
    return Finding(
        Check("angular momentum", relative(momenta[1], momenta[0]), 1e-5),
        Check("energy balance", result.energy_balance, 1e-5),
        Check("distance from the start [mm]", back, allowed),
    )


@CASES.add("steps-1e6", "A million steps of a held element: energy is kept", slow=True)
def _million() -> Finding:
    cube = box_block((10.0, 10.0, 10.0), (1, 1, 1))
    held = fixed_nodes(0, np.flatnonzero(cube.mesh.nodes[:, 2] == 0.0))
    model = timed_system(one_block(cube, supports=(held,)), ramp_time=0.0, end_time=1.0)
    critical = model.critical.critical_time_step
    result = solve(
        model,
        end_time=1e6 * 0.9 * critical,
        velocities=noise(model, 100.0),
        sample_interval=10_000,
    )
    # Round-off walks: sqrt(1e6) eps = 2e-13 in velocity, ten times that at worst in energy.
    return Finding(
        Check("steps", result.n_steps, least=1e6),
        Check("energy balance", result.energy_balance, 1e-9),
    )


@CASES.add("zero-load-explicit", "No load, blocks that just touch, linear law: rest, exactly")
def _rest() -> Finding:
    assembly = stack(2, top_fixed=True)
    stated = deformable(assembly, pressed(stack(2), 0.0), law=LinearPenalty(100.0))
    model = timed_system(replace(stated, forces=()))
    critical = model.critical.critical_time_step
    result = solve(model, end_time=200 * critical)
    largest = max(float(np.abs(u).max()) for u in result.displacements)
    return Finding(Check("largest displacement [mm]", largest, 0.0))


@CASES.add(
    "density-ratio-1e6",
    "Neighbours whose densities differ by 1e6: static joint pressures",
    slow=True,
)
def _density_contrast() -> Finding:
    # The exponential law presses stiffly: the column comes to rest in a tenth of the steps.
    pressure = 1.0
    light = replace(COLUMN, density=1e-6 * COLUMN.density)
    materials = (COLUMN, COLUMN, light)
    stated = deformable(stack(1), pressed(stack(1), pressure), material=materials)
    result, pressures = settled(stated, ramp=1e-5, end=2e-2, residual=1e-3)
    return Finding(
        Check("residual", result.residual if result.residual is not None else np.nan, 1e-3),
        Check("energy balance", result.energy_balance, 1e-2),
        Check("joint pressures", relative(pressures, np.array(pressure)), 1e-2),
    )


@CASES.add("stiff-law-explicit", "Law a hundred times stiffer: the step shrinks, energy is kept")
def _stiff_law() -> Finding:
    pressure = 0.01
    steps, balances, errors = [], [], []
    for law in (ExponentialLaw(), ExponentialLaw(1e-5, 1e-4, maximum_stiffness=1e5)):
        stated = deformable(stack(1), pressed(stack(1), pressure), law=law)
        result, pressures = settled(stated, ramp=5e-4, end=2e-2)
        steps.append(result.time_step)
        balances.append(result.energy_balance)
        errors.append(relative(pressures, np.array(pressure)))
    return Finding(
        Check("time step, stiff over usual", steps[1] / steps[0], 1.0),
        Check("energy balance", max(balances), 1e-2),
        Check("joint pressures", max(errors), 1e-2),
    )


@CASES.add(
    "mechanism-driven-explicit",
    "A column pushed sideways without friction: the run says that it is not static",
)
def _driven() -> Finding:
    assembly = stack(1)
    stated = deformable(assembly, pressed(assembly, 0.01, face="inner"))
    result, _ = settled(stated, ramp=2e-4, end=4e-3)
    report = quasi_static_report(result)
    assert report is not None
    return Finding(Check("called static", report.is_static, 0, 0), refusal=report.verdict)
