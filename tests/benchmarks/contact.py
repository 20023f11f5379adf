"""Explicit contact: rate of a step, share of contact, and what sliding costs over paired facets.

``python -m tests.benchmarks.contact [--json FILE|-]``

TSB1 under the pipe load, 0.01 MPa, in a state with contact. CPU times of a step of one core, each
the best of several short batches, paired and searched facets in turns so that a busy machine slows
both alike. ``tubelock cost`` measures whole runs to the static state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np

from fem import CoulombFriction, Problem, concrete
from fem.explicit.setup.timed_system import timed_system
from fem.explicit.solve import initial_state, prepare
from fem.explicit.state import Lanes
from fem.explicit.step import ExplicitSystem, step
from fem.system.effects import AdaptiveMassDamping, Effects
from fem.system.system import System
from geometry.families.sine_block import TSB1, SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.loads import named_load
from tests.benchmarks.stopwatch import best_cpu_seconds, measuring
from validation.output.console import tabled
from validation.output.files import write_json

#: Elements round, through and along one block.
MESHES = {960: (24, 4, 10), 3888: (36, 6, 18)}
#: Layers, elements per block, order of the sector that is computed (1: all blocks).
CASES = ((1, 960, 1), (1, 960, 4), (2, 3888, 1), (2, 3888, 4))
#: Friction, finite rotation.
EFFECTS = {
    "alone": (False, False),
    "finite rotation": (False, True),
    "friction": (True, False),
    "friction and rotation": (True, True),
}
#: Steps before the clock starts: blocks press by then.
_WARM_UP = 1500
#: Times that both variants are measured, in turn.
_ROUNDS = 3


@dataclass(frozen=True)
class ContactRow:
    """Cost of a step with contact."""

    layers: int
    elements_per_block: int
    symmetry: int
    effects: str
    million_updates_per_second: float
    """Element updates of the whole step per CPU second, facets paired, millions."""
    contact_percent: float
    """Share of contact in that step [%]."""
    sliding_ratio: float
    """CPU time of a step with searched facets over one with paired facets [-]."""


def tube(layers: int, elements: int) -> System:
    """TSB1 under the pipe load."""
    blocks = SineTube(TSB1, SineBlockDivisions(*MESHES[elements]), layers).build()
    return Problem(blocks, named_load("pipe", 0.01).on(blocks), concrete).deformable


def pressing(
    deformable: System, symmetry: int, effects: Effects, steps: int
) -> tuple[ExplicitSystem, Lanes]:
    """A damped run after some steps: blocks press by then."""
    model = timed_system(
        deformable,
        symmetry="none" if symmetry == 1 else "sector",
        ramp_time=0.0,
        counted_pressure=4.0,  # above what presses here: no run has to start again
        effects=replace(effects, adaptive_mass_damping=AdaptiveMassDamping(interval=50)),
    )
    system = prepare(model, time_step=0.9 * model.critical.critical_time_step)
    state = initial_state(system)
    state.mass_damping = 2000.0
    for _ in range(steps):
        step(system, state)
    return system, state


def measure(layers: int, elements: int, symmetry: int, effects: str) -> ContactRow:
    """Measure one row."""
    friction, rotation = EFFECTS[effects]
    paired = tube(layers, elements)
    law = replace(paired.contact, friction=CoulombFriction(0.1) if friction else None)
    runs = [
        pressing(
            replace(paired, contact=replace(law, finite_sliding=sliding)),
            symmetry,
            Effects(finite_rotation=rotation),
            _WARM_UP,
        )
        for sliding in (False, True)
    ]
    rounds = [
        [best_cpu_seconds(partial(step, *run), repeats=20, trials=4) for run in runs]
        for _ in range(_ROUNDS)
    ]
    whole, searched = np.min(rounds, axis=0).tolist()
    system, state = runs[0]
    contact = system.interactions[0]
    alone = best_cpu_seconds(partial(contact.add_force, system, state), repeats=20)
    return ContactRow(
        layers=layers,
        elements_per_block=elements,
        symmetry=symmetry,
        effects=effects,
        million_updates_per_second=system.stated.n_elements / whole / 1e6,
        contact_percent=100.0 * alone / whole,
        sliding_ratio=searched / whole,
    )


_COLUMNS: dict[str, Callable[[ContactRow], str]] = {
    "with": lambda row: row.effects,
    "layers": lambda row: f"{row.layers}",
    "elements/block": lambda row: f"{row.elements_per_block}",
    "sector 1/": lambda row: f"{row.symmetry}",
    "M updates/s": lambda row: f"{row.million_updates_per_second:.1f}",
    "contact %": lambda row: f"{row.contact_percent:.0f}",
    "sliding ×": lambda row: f"{row.sliding_ratio:.2f}",
}


def main() -> None:
    """Run the benchmark from the command line."""
    asked, console = measuring(__doc__, 110)
    rows = [measure(*case, effects) for case in CASES for effects in EFFECTS]
    console.print(tabled("Explicit step with contact, one thread", rows, _COLUMNS))
    write_json(asked.json, [asdict(row) for row in rows])


if __name__ == "__main__":
    main()
