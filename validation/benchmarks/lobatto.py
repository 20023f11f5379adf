"""What explicit steps of elements of degree 2 or 3 would cost.

``python -m validation.benchmarks.lobatto [--json FILE|-]``

Nodes at Gauss–Lobatto points have a diagonal mass, so that a central difference step needs no
solution. Its work is the product with the stiffness, 18 operations a pair of neighbours and copy,
and the number of steps that of critical steps in a given time. Both are measured on the block of
two layers of TSB1, beside what the state says in which such a run ends, the static one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

from fem.problem.time_step import largest_mode, scaled
from validation.output.console import measuring, tabled
from validation.output.files import write_json
from validation.run.solve import run_static
from validation.scene.read import TubeScene, load_scene

#: Elements around, across and along a block; and their degree.
MESHES = (
    ((24, 2, 4), 1),
    ((36, 3, 6), 1),
    ((48, 4, 8), 1),
    ((72, 6, 12), 1),
    ((12, 1, 2), 2),
    ((24, 2, 4), 2),
    ((36, 3, 6), 2),
    ((12, 1, 2), 3),
    ((24, 2, 4), 3),
)
#: Measures of the end state.
QUANTITIES = ("max_displacement", "p_max_point", "sigma_1_averaged")


@dataclass(frozen=True)
class Work:
    """One mesh."""

    elements: tuple[int, int, int]
    degree: int
    nodes: int
    """Of one block."""
    neighbours: float
    """Blocks of the stiffness in the row of a node, mean."""
    time_step: float
    """Critical, of a free block [s]."""
    operations: float
    """Of products with the stiffness of one block, for a millisecond of simulated time [Gflop]."""
    measures: dict[str, float]
    """Of the static state."""


def work(elements: tuple[int, int, int], degree: int) -> Work:
    """Measure one mesh."""
    around, radial, axial = elements
    scene = load_scene("tsb1-pipe").scene
    assert isinstance(scene, TubeScene)
    changes = {
        "assembly.layers": 2,
        "mesh": {"around": around, "radial": radial, "axial": axial},
        "fem": {"method": "static", "degree": degree, "error_estimate": False},
    }
    run = run_static("tsb1-pipe", scene.changed(changes))
    group = max(run.deformable.model.groups, key=lambda g: g.n_nodes)
    largest, _ = largest_mode(scaled(group.stiffness, group.lumped_mass))
    step, pairs = 2.0 / largest**0.5, len(group.stiffness.indices)
    return Work(
        elements=elements,
        degree=degree,
        nodes=group.n_nodes,
        neighbours=pairs / group.n_nodes,
        time_step=step,
        operations=18.0 * pairs * 1e-3 / step / 1e9,
        measures={key: run.measures[key].value for key in QUANTITIES},
    )


_COLUMNS: dict[str, Callable[[Work], str]] = {
    "elements, degree": lambda row: f"{' × '.join(map(str, row.elements))}, {row.degree}",
    "nodes": lambda row: f"{row.nodes}",
    "neighbours": lambda row: f"{row.neighbours:.0f}",
    "step [µs]": lambda row: f"{1e6 * row.time_step:.3f}",
    "Gflop a ms": lambda row: f"{row.operations:.3g}",
    "u [mm]": lambda row: f"{row.measures['max_displacement']:.5f}",
    "p_max [MPa]": lambda row: f"{row.measures['p_max_point']:.3f}",
    "σ₁ [MPa]": lambda row: f"{row.measures['sigma_1_averaged']:.3f}",
}


def main() -> None:
    """Print every mesh."""
    asked, console = measuring(__doc__, 110)
    rows = [work(*mesh) for mesh in MESHES]
    console.print(tabled("Explicit work of elements of higher degree", rows, _COLUMNS))
    write_json(asked.json, [asdict(row) for row in rows])


if __name__ == "__main__":
    main()
