"""Element updates per CPU second of the explicit solver.

``python -m tests.benchmarks.explicit [--json FILE|-]``

All rates are millions of element updates per second of CPU time of one core, or of elapsed
time where two threads share the work; each the best of several short batches.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from fem.element.hexahedron import ElementType
from fem.element.material import Material
from fem.explicit.kernels import widths
from fem.explicit.output.checkpoint import state_arrays
from fem.explicit.solve import initial_state, prepare
from fem.explicit.state import Lanes
from fem.explicit.step import ExplicitSystem, step, stiffness_force
from fem.explicit.timed import TimedSystem
from fem.system.body import Body, placed_body
from fem.system.effects import BulkViscosity, Effects, RayleighDamping
from fem.system.model import fixed_nodes, nodal_load
from fem.system.time_step import critical_time_step
from geometry.block import box_block
from geometry.machine.system import peak_memory_mb
from tests.benchmarks.kernels import KernelRow, kernel_rows
from tests.benchmarks.kernels import table as kernel_table
from tests.benchmarks.roofline import Roofline, roofline
from tests.benchmarks.stopwatch import best_cpu_seconds, best_wall_seconds, measuring
from tests.support.lone_bodies import lone_bodies
from validation.output.files import write_json

CONCRETE = Material(density=2.4e-9, young_modulus=30_000.0, poisson_ratio=0.2)

#: Divisions of the two blocks: 2 016 and 16 000 elements.
SMALL, LARGE = (14, 12, 12), (25, 25, 25)
LARGE_COPIES = 13

EFFECTS = {
    "mass-proportional damping": Effects(rayleigh=RayleighDamping(mass_proportional=2.0)),
    "stiffness-proportional damping": Effects(rayleigh=RayleighDamping(None, 1e-8)),
    "bulk viscosity": Effects(bulk_viscosity=BulkViscosity()),
    "gravity": Effects(gravity=np.array([0.0, 0.0, -9810.0])),
    "finite rotation": Effects(finite_rotation=True),
}


@dataclass(frozen=True)
class Row:
    """Rates of one case."""

    elements: int
    """Of one block."""
    copies: int
    """Congruent blocks."""
    threads: int
    """Threads."""
    internal_force: float
    """Million element updates per second, internal force alone."""
    whole_step: float
    """The same for the whole step: force, loads, update of velocity and displacement."""
    gflops: float
    """Of the internal force, padding included."""
    bytes_per_node: float
    """Evolving arrays and stiffness over all nodes of all copies."""


def benchmark_group(divisions: tuple[int, int, int], copies: int) -> Body:
    """Copies of a box of concrete, edges of 10 mm."""
    size = (10.0 * divisions[0], 10.0 * divisions[1], 10.0 * divisions[2])
    mesh = box_block(size, divisions).mesh
    return placed_body(mesh, CONCRETE, translations=np.zeros((copies, 3)))


def loaded_model(group: Body) -> TimedSystem:
    """Every copy held at one face and pushed on the opposite one."""
    nodes = group.mesh.nodes
    force = np.zeros_like(nodes)
    force[nodes[:, 2] == nodes[:, 2].max(), 0] = 1.0
    copies = np.arange(group.n_copies)
    return lone_bodies(
        (group,),
        supports=(fixed_nodes(0, np.flatnonzero(nodes[:, 2] == 0.0), copies=copies),),
        loads=(nodal_load(0, force, copies=copies),),
    )


def ready(model: TimedSystem, time_step: float, **options: Any) -> tuple[ExplicitSystem, Lanes]:
    """System and state after a few steps, so that nothing is zero."""
    system = prepare(model, time_step=time_step, **options)
    state = initial_state(system)
    for _ in range(3):
        step(system, state)
    return system, state


def seconds_of_force(system: ExplicitSystem, state: Lanes, threads: int, repeats: int) -> float:
    """Time of one internal force of all copies [s]."""
    body, now = system.bodies[0], state.bodies[0]
    best = best_cpu_seconds if threads == 1 else best_wall_seconds
    return best(
        lambda: stiffness_force(body, now.displacement, now.internal_force, system.kernels),
        repeats=repeats if threads == 1 else 1,
    )


def seconds_of_step(system: ExplicitSystem, state: Lanes, threads: int, repeats: int) -> float:
    """Time of one whole step [s]."""
    best = best_cpu_seconds if threads == 1 else best_wall_seconds
    return best(lambda: step(system, state), repeats=repeats if threads == 1 else 1)


def row(group: Body, time_step: float, threads: int) -> Row:
    """Measure one case."""
    system, state = ready(loaded_model(group), time_step, threads=threads)
    updates = group.mesh.n_elements * group.n_copies
    repeats = max(1, 400_000 // updates)
    force = seconds_of_force(system, state, threads, repeats)
    whole = seconds_of_step(system, state, threads, repeats)
    body = system.bodies[0]
    memory = body.constant_bytes + sum(a.nbytes for a in state_arrays(system, state).values())
    return Row(
        elements=group.mesh.n_elements,
        copies=group.n_copies,
        threads=threads,
        internal_force=updates / force / 1e6,
        whole_step=updates / whole / 1e6,
        gflops=18.0 * len(group.stiffness.indices) * body.lanes / force / 1e9,
        bytes_per_node=memory / (group.n_nodes * group.n_copies),
    )


def effect_costs(group: Body, time_step: float) -> dict[str, float]:
    """Per cent that each effect adds to a step, and what a step adds to its two kernels.

    Each pair is measured in turns, so that a busy machine disturbs both alike.
    """
    plain = ready(lone_bodies((group,)), time_step)
    costs = {
        "effects off, against the two bare kernels": added_percent(
            lambda: bare_seconds(*plain), lambda: seconds_of_step(*plain, threads=1, repeats=2)
        )
    }
    cases = {"loads and supports": loaded_model(group)}
    cases |= {name: lone_bodies((group,), effects=effects) for name, effects in EFFECTS.items()}
    for name, model in cases.items():
        case = ready(model, time_step)
        costs[name] = added_percent(
            lambda: seconds_of_step(*plain, threads=1, repeats=2),
            functools.partial(seconds_of_step, *case, threads=1, repeats=2),
        )
    return costs


def added_percent(without: Callable[[], float], with_it: Callable[[], float]) -> float:
    """Least time with an effect over least time without it, in turns [%]."""
    pairs = [(without(), with_it()) for _ in range(5)]
    base = min(pair[0] for pair in pairs)
    more = min(pair[1] for pair in pairs)
    return 100.0 * (more / base - 1.0)


def bare_seconds(system: ExplicitSystem, state: Lanes) -> float:
    """Product and update called directly, nothing around them [s]."""
    body, now = system.bodies[0], state.bodies[0]
    rows = body.rows

    def work() -> None:
        system.kernels.stiffness_product(
            *rows.packed,
            now.displacement.ravel(),
            now.internal_force.ravel(),
            None,
            body.lanes,
        )
        system.kernels.update(
            body.lanes,
            *widths(body.lanes),
            rows.chunks,
            *(None, None, None),
            system.time_step,
            system.time_step,
            None,
            body.mass,
            now.internal_force.ravel(),
            *(None, None, None, None, None, None, None),
            now.displacement.ravel(),
            now.velocity.ravel(),
            None,
        )

    return best_cpu_seconds(work, repeats=2)


def peers(group: Body) -> dict[str, float]:
    """Million element updates per CPU second of plain ways to the same internal force."""
    mesh, copies = group.mesh, group.n_copies
    u = np.random.default_rng(0).standard_normal((3 * mesh.n_nodes, copies))
    matrix = csr_array(group.stiffness)
    one = np.ascontiguousarray(u[:, 0])
    element = ElementType.INCOMPATIBLE.stiffness(mesh.nodes[mesh.elements], CONCRETE)
    dofs = (3 * mesh.elements[:, :, None] + np.arange(3)).reshape(-1, 24)

    def numpy_loop() -> np.ndarray[Any, Any]:
        force = np.zeros_like(u)
        np.add.at(force, dofs, element @ u[dofs])
        return force

    rates = {
        "numpy, element by element": (numpy_loop, copies),
        "scipy CSR times all copies": (lambda: matrix @ u, copies),
        "scipy CSR, every block its own matrix": (lambda: matrix @ one, 1),
        "scipy BSR times all copies": (lambda: group.stiffness @ u, copies),
    }
    return {
        name: mesh.n_elements * count / best_cpu_seconds(work, trials=3) / 1e6
        for name, (work, count) in rates.items()
    }


def benchmark() -> dict[str, Any]:
    """All rows; about a minute."""
    limits = roofline()
    rows: list[Row] = []
    small = benchmark_group(SMALL, 52)
    time_step = 0.9 * critical_time_step([small], Effects()).critical_time_step
    for threads in (1, 2):
        rows.append(row(small, time_step, threads))
    for copies, divisions in ((12, SMALL), (1, SMALL), (LARGE_COPIES, LARGE), (1, LARGE)):
        group = benchmark_group(divisions, copies)
        counts = [1, 2] if divisions == LARGE else [1]
        rows.extend(row(group, time_step, threads) for threads in counts)

    def prepared(effects: Effects) -> tuple[ExplicitSystem, Lanes]:
        return ready(lone_bodies((small,), effects=effects), time_step)

    return {
        "roofline": dataclasses.asdict(limits),
        "rows": [dataclasses.asdict(r) for r in rows],
        "flops_per_element": flops_per_element(small),
        "internal_force_limit": internal_force_limit(small, limits),
        "kernels": [dataclasses.asdict(r) for r in kernel_rows(small, limits, prepared)],
        "effects_added_percent": effect_costs(small, time_step),
        "peers": peers(small),
        "peak_memory_mb": peak_memory_mb(),
    }


def flops_per_element(group: Body) -> float:
    """Operations of the internal force per element and copy."""
    return 18.0 * len(group.stiffness.indices) / group.mesh.n_elements


def internal_force_limit(group: Body, limits: Roofline) -> float:
    """Million element updates per second if every cycle did its multiply-adds."""
    return limits.peak_float64_gflops * 1e3 / flops_per_element(group)


def table(result: dict[str, Any]) -> str:
    """The result as text."""
    limits = result["roofline"]
    lines = [
        "One core: "
        f"triad {limits['triad_memory_gb_per_s']:.1f} GB/s from memory, "
        f"{limits['triad_cache_gb_per_s']:.1f} GB/s from cache; "
        f"multiply-adds {limits['peak_float64_gflops']:.1f} GF/s ",
        f"Internal force at that peak: {result['internal_force_limit']:.1f} M/s",
        "",
        "elements copies threads  force M/s  step M/s  GF/s  bytes/node",
    ]
    for r in result["rows"]:
        lines.append(
            f"{r['elements']:8d} {r['copies']:6d} {r['threads']:7d} "
            f"{r['internal_force']:10.1f} {r['whole_step']:9.1f} {r['gflops']:5.1f} "
            f"{r['bytes_per_node']:11.0f}"
        )
    lines += kernel_table([KernelRow(**r) for r in result["kernels"]])
    lines += ["", "Effects add to a step:"]
    lines += [f"  {name}: {cost:+.1f} %" for name, cost in result["effects_added_percent"].items()]
    lines += ["", "Internal force otherwise, M/s per CPU second:"]
    lines += [f"  {name}: {rate:.2f}" for name, rate in result["peers"].items()]
    lines.append(f"\nPeak memory {result['peak_memory_mb']:.0f} MB")
    return "\n".join(lines)


def main() -> None:
    """Run the benchmark and write its table, or JSON."""
    requested, console = measuring(__doc__, 110)
    result = benchmark()
    write_json(requested.json, result)
    console.print(table(result))


if __name__ == "__main__":
    main()
