"""Explicit contact: rate of the whole step, share of contact, cost of runs to the static state.

``python -m validation.benchmarks.contact [--json FILE|-] [--large]``

TSB1 under the pipe load, 0.01 MPa. Rates are millions of element updates per CPU second of one
core, each the best of several short batches in a state with contact. Runs stop when the force
residual and the settling say so; their end is compared with the static solution of the same
mesh. ``--large`` adds 15 360 elements per block (many minutes).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from fem.assembly.contact_state import matched_pressures
from fem.assembly.deformable import DeformableAssembly
from fem.assembly.statement import Problem
from fem.assembly.symmetry import cyclic_orbits
from fem.element.material import concrete
from fem.explicit.setup.assembly import ExplicitAssembly, explicit_assembly
from fem.explicit.setup.quasi_static import RecommendedTimes, recommended_times
from fem.explicit.solve import (
    ExplicitResult,
    StopCriterion,
    displacements_of,
    initial_state,
    prepare,
    solve,
)
from fem.explicit.state import State
from fem.explicit.step import System, step
from fem.problem.effects import AdaptiveMassDamping, Effects
from fem.problem.loads import SmoothStepAmplitude
from fem.problem.time_step import critical_time_step
from fem.static.solve import solve_static
from geometry.families.sine_block import TSB1, SineBlockDivisions
from geometry.families.tube import sine_tube
from geometry.loads import load_case
from geometry.mesh import FloatArray
from validation.benchmarks.stopwatch import best_cpu_seconds
from validation.output.console import measuring, tabled
from validation.output.files import write_json
from validation.run.stages import peak_memory_mb

#: Elements round, through and along one block.
MESHES = {960: (24, 4, 10), 3888: (36, 6, 18), 15360: (60, 8, 32)}

#: Layers, elements per block, order of the sector, CPU seconds to stay below.
RUNS = ((1, 960, 1, 10.0), (12, 960, 1, 40.0), (12, 960, 4, None), (12, 3888, 4, None))
LARGE_RUNS = ((12, 3888, 1, 240.0), (12, 15360, 4, None), (12, 15360, 1, 1200.0))


@dataclass(frozen=True)
class RateRow:
    """Cost of a step with contact."""

    layers: int
    elements_per_block: int
    symmetry: int
    """Order of the sector that is computed; 1: all blocks."""
    elements: int
    """Hexahedra computed."""
    contact_facets: int
    """Facet pairs computed."""
    million_updates_per_second: float
    """Element updates of the whole step per CPU second, millions."""
    contact_percent: float
    """Share of contact in the step [%]."""
    pressing_percent: float
    """Contact points that press at the time [%]."""


@dataclass(frozen=True)
class RunRow:
    """One run to the static state."""

    layers: int
    elements_per_block: int
    symmetry: int
    steps: int
    cpu_seconds: float
    """From the model to the end state, compilation left out."""
    target_seconds: float | None
    """What the run was to stay below."""
    static_cpu_seconds: float
    """Of the static solver for the same model."""
    residual: float
    settling: float
    displacement_error: float
    """Root mean square against the static solution, relative."""
    pressure_error: float
    """The same of the point pressures."""
    largest_pressure_error: float
    """Of the largest point pressure, relative."""
    energy_balance: float
    peak_memory_mb: float
    """Of the process so far, static solution of the row not yet included [MB]."""


def pipe(layers: int, elements: int) -> DeformableAssembly:
    """TSB1 under the pipe load."""
    tube = sine_tube(TSB1, SineBlockDivisions(*MESHES[elements]), layers)
    return Problem(tube, load_case(tube, "pipe", 0.01), concrete).deformable


def statement(
    deformable: DeformableAssembly, symmetry: int
) -> tuple[ExplicitAssembly, RecommendedTimes]:
    """Explicit model with adaptive damping, ramped as recommended."""
    orbits = cyclic_orbits(deformable, symmetry)
    times = recommended_times(explicit_assembly(deformable, orbits=orbits).model, damped=True)
    model = explicit_assembly(
        deformable,
        counted_pressure=4.0,  # above what presses here: no run has to start again
        orbits=orbits,
        effects=Effects(adaptive_mass_damping=AdaptiveMassDamping(interval=50)),
        amplitude=SmoothStepAmplitude(times.ramp_time),
    )
    return model, times


def rate(layers: int, elements: int, symmetry: int, *, warm_up: int = 3000) -> RateRow:
    """Measure steps in a state with contact."""
    deformable = pipe(layers, elements)
    found, _ = statement(deformable, symmetry)
    system, state = warm(found, warm_up)
    contact = system.interactions[0]
    whole = best_cpu_seconds(lambda: step(system, state), repeats=20)
    alone = best_cpu_seconds(lambda: contact.add_force(system, state), repeats=20)
    pairs = deformable.surfaces.subset(found.orbits.facets)
    pressures, _ = matched_pressures(deformable, found.expand(displacements_of(system, state)))
    return RateRow(
        layers=layers,
        elements_per_block=elements,
        symmetry=symmetry,
        elements=found.model.n_elements,
        contact_facets=pairs.n_facets,
        million_updates_per_second=found.model.n_elements / whole / 1e6,
        contact_percent=100.0 * alone / whole,
        pressing_percent=100.0 * float((pressures > 0.0).mean()),
    )


def warm(found: ExplicitAssembly, count: int) -> tuple[System, State]:
    """Do some steps, damped: blocks press by then."""
    dt = 0.9 * critical_time_step(found.model).critical_time_step
    system = prepare(found.model, time_step=dt)
    state = initial_state(system)
    state.mass_damping = 2000.0
    for _ in range(count):
        step(system, state)
    return system, state


def run(layers: int, elements: int, symmetry: int, target: float | None) -> RunRow:
    """Run to the static state and compare with the static solution."""
    deformable = pipe(layers, elements)
    compile_kernels(deformable, symmetry)
    start = time.process_time()
    found, times = statement(deformable, symmetry)
    result = to_static(found, times)
    displacements = found.expand(result.displacements)
    pressures, _ = matched_pressures(deformable, displacements)
    seconds = time.process_time() - start
    memory = peak_memory_mb()
    start = time.process_time()
    static = solve_static(deformable)
    static_seconds = time.process_time() - start
    largest = float(static.pressures.max())
    return RunRow(
        layers=layers,
        elements_per_block=elements,
        symmetry=symmetry,
        steps=result.n_steps,
        cpu_seconds=seconds,
        target_seconds=target,
        static_cpu_seconds=static_seconds,
        residual=float("nan") if result.residual is None else result.residual,
        settling=float("nan") if result.settling is None else result.settling,
        displacement_error=_relative(displacements[0], static.displacements[0]),
        pressure_error=_relative(pressures, static.pressures),
        largest_pressure_error=abs(float(pressures.max()) - largest) / largest,
        energy_balance=result.energy_balance,
        peak_memory_mb=memory,
    )


def to_static(found: ExplicitAssembly, times: RecommendedTimes) -> ExplicitResult:
    """Run until force residual and settling are below their bounds."""
    return solve(
        found.model,
        end_time=times.end_time,
        stop=StopCriterion(1e-4, times.ramp_time),
        sample_interval=100,
    )


def compile_kernels(deformable: DeformableAssembly, symmetry: int) -> None:
    """Run a few steps, so that compiled code is loaded before the clock starts."""
    found, times = statement(deformable, symmetry)
    solve(found.model, end_time=1e-4 * times.end_time, stop=StopCriterion(0.0), sample_interval=5)


def _relative(a: FloatArray, b: FloatArray) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2)))


_CASE: dict[str, Callable[[RateRow | RunRow], str]] = {
    "layers": lambda row: f"{row.layers}",
    "elements/block": lambda row: f"{row.elements_per_block}",
    "sector 1/": lambda row: f"{row.symmetry}",
}
_RATES: dict[str, Callable[[RateRow], str]] = {
    **_CASE,
    "M updates/s": lambda row: f"{row.million_updates_per_second:.1f}",
    "contact %": lambda row: f"{row.contact_percent:.0f}",
    "pressing %": lambda row: f"{row.pressing_percent:.0f}",
}
_RUNS: dict[str, Callable[[RunRow], str]] = {
    **_CASE,
    "steps": lambda row: f"{row.steps}",
    "CPU s": lambda row: f"{row.cpu_seconds:.2f}",
    "target": lambda row: "" if row.target_seconds is None else f"{row.target_seconds:.0f}",
    "static CPU s": lambda row: f"{row.static_cpu_seconds:.2f}",
    "u error": lambda row: f"{row.displacement_error:.1e}",
    "p error": lambda row: f"{row.pressure_error:.1e}",
    "p_max error": lambda row: f"{row.largest_pressure_error:.1e}",
    "peak MB": lambda row: f"{row.peak_memory_mb:.0f}",
}


def main() -> None:
    """Run the benchmark from the command line."""
    asked, console = measuring(__doc__, 130, large="15 360 elements per block too")
    rates = [rate(1, 960, 1), rate(12, 960, 1), rate(12, 960, 4), rate(12, 3888, 4, warm_up=500)]
    runs = [run(*case) for case in (*RUNS, *(LARGE_RUNS if asked.large else ()))]
    console.print(tabled("Step with contact, one thread", rates, _RATES, words=0))
    console.print(tabled("Explicit runs to the static state", runs, _RUNS, words=0))
    found = {"rates": [asdict(r) for r in rates], "runs": [asdict(r) for r in runs]}
    write_json(asked.json, found)


if __name__ == "__main__":
    main()
