"""What a sliding step costs over a paired one: ``python -m validation.benchmarks.sliding``.

TSB1 under the pipe load, 0.01 MPa, in a state with contact: facets paired or searched (each one
cut where its neighbours went), with finite rotation, with friction of 0.1, with both; all blocks
and the exact sector, on two meshes. CPU time of a step of one core, each the best of several
short batches, all variants of a mesh taken in turn so that a busy machine slows them alike.
``--json FILE|-`` writes the numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np

from fem.assembly.deformable import DeformableAssembly
from fem.assembly.symmetry import cyclic_orbits
from fem.contact.friction import CoulombFriction
from fem.explicit.setup.assembly import explicit_assembly
from fem.explicit.state import State
from fem.explicit.step import System, step
from fem.problem.effects import Effects
from validation.benchmarks.contact import pipe, warm
from validation.benchmarks.stopwatch import best_cpu_seconds
from validation.output.console import measuring, tabled
from validation.output.files import write_json

#: Layers, elements per block, order of the sector.
MESHES = ((1, 960, 1), (1, 960, 4), (2, 3888, 1), (2, 3888, 4))
#: Steps before the clock starts: blocks press by then.
_WARM_UP = 1500
#: Times that every variant is measured, in turn, and steps of one batch.
_ROUNDS, _STEPS = 3, 20

#: Friction, finite rotation.
EFFECTS = {
    "alone": (False, False),
    "finite rotation": (False, True),
    "friction": (True, False),
    "friction and rotation": (True, True),
}


@dataclass(frozen=True)
class SlidingRow:
    """Cost of a step, paired and sliding."""

    layers: int
    elements_per_block: int
    symmetry: int
    """Order of the sector that is computed; 1: all blocks."""
    effects: str
    paired: float
    """CPU time of a step with paired facets [s]."""
    sliding: float
    """The same with searched facets [s]."""
    points_per_pair: float
    """Contact points that the search integrates, over four for each matched pair."""

    @property
    def ratio(self) -> float:
        """What sliding costs over pairs."""
        return self.sliding / self.paired


def ready(
    deformable: DeformableAssembly, symmetry: int, *, friction: bool, rotation: bool
) -> tuple[System, State]:
    """A run with contact, ready for the next step."""
    contact = replace(deformable.contact, friction=CoulombFriction(0.1) if friction else None)
    found = explicit_assembly(
        replace(deformable, contact=contact),
        orbits=cyclic_orbits(deformable, symmetry),
        counted_pressure=4.0,
        effects=Effects(finite_rotation=rotation),
    )
    return warm(found, _WARM_UP)


def measure(layers: int, elements: int, symmetry: int, effects: str) -> SlidingRow:
    """Measure one row."""
    friction, rotation = EFFECTS[effects]
    paired = pipe(layers, elements)
    sliding = replace(paired, contact=replace(paired.contact, finite_sliding=True))
    both = [
        ready(problem, symmetry, friction=friction, rotation=rotation)
        for problem in (paired, sliding)
    ]

    rounds = [
        [best_cpu_seconds(partial(step, *run), repeats=_STEPS, trials=4) for run in both]
        for _ in range(_ROUNDS)
    ]
    alone, searched = np.min(rounds, axis=0).tolist()
    facets = paired.surfaces.n_facets / symmetry
    points = both[1][0].interactions[0].points.count  # type: ignore[attr-defined]
    share = points / (4.0 * facets)
    return SlidingRow(layers, elements, symmetry, effects, alone, searched, share)


_COLUMNS: dict[str, Callable[[SlidingRow], str]] = {
    "layers": lambda row: f"{row.layers}",
    "elements/block": lambda row: f"{row.elements_per_block}",
    "sector 1/": lambda row: f"{row.symmetry}",
    "with": lambda row: row.effects,
    "paired ms": lambda row: f"{1e3 * row.paired:.3f}",
    "sliding ms": lambda row: f"{1e3 * row.sliding:.3f}",
    "×": lambda row: f"{row.ratio:.2f}",
}


def main() -> None:
    """Run the benchmark from the command line."""
    asked, console = measuring(__doc__, 110)
    rows = [measure(*mesh, effects) for mesh in MESHES for effects in EFFECTS]
    console.print(tabled("CPU time of a step, one thread", rows, _COLUMNS, words=0))
    write_json(asked.json, [asdict(row) | {"ratio": row.ratio} for row in rows])


if __name__ == "__main__":
    main()
