"""What a periodic cell is worth: its answer beside that of the tube that it stands for."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.table import Table

from fem.solution import Solution
from geometry.mesh import FloatArray
from validation.build.cell import check_cell
from validation.effects.probe import Answer, Change, answer_of, change, mesh_words, probe_scene
from validation.output.console import listing
from validation.run.solve import run_static
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene

#: Fineness of the mesh on which a run measures the error of its cell: with the coarsest mesh it
#: would find a fraction of it.
_FINENESS = 2


@dataclass(frozen=True)
class CellError:
    """A periodic cell beside the tube that it stands for, both static on one mesh."""

    layers: int
    """Free layers of the tube."""
    mesh: str
    """Elements of a block."""
    cell: Answer
    """Of the cell; displacements relative to its mean motion along and about the axis."""
    middle: Answer
    """Of the two middle layers of the tube, in the same way."""
    tube: Answer
    """Of the whole tube."""
    cell_seconds: float
    """CPU time from the scene to the pressures [s]."""
    tube_seconds: float

    @property
    def against_middle(self) -> Change:
        """From the middle of the tube to the cell: the error of what the cell stands for."""
        return change(self.middle, self.cell)

    @property
    def against_tube(self) -> Change:
        """From the whole tube to the cell: what the ends do is in it."""
        return change(self.tube, self.cell)

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        errors = {
            "error_of_middle_layers": asdict(self.against_middle),
            "difference_from_whole_tube": asdict(self.against_tube),
        }
        return asdict(self) | errors


def cell_error(scene: DeformableScene, name: str) -> CellError:
    """Solve the cell and the whole tube statically on the mesh of the scene.

    Raises
    ------
    InputError
        Where the layers do not repeat, or one of the two cannot be solved.
    """
    check_cell(scene, name)
    return _beside(_static(scene, "periodic cell"), _static(scene, "auto"), name)


def probed_cell_error(scene: DeformableScene, name: str) -> CellError:
    """Error of the cell on a mesh that is coarse enough to take seconds, whatever the scene's."""
    return cell_error(probe_scene(_static(scene, "auto"), name, fineness=_FINENESS), name)


def _static(scene: DeformableScene, symmetry: str) -> DeformableScene:
    return scene.changed({"fem.symmetry": symmetry, "fem.method": Method.STATIC})


def _beside(cell_scene: DeformableScene, tube_scene: DeformableScene, name: str) -> CellError:
    cell, tube = run_static(name, cell_scene), run_static(name, tube_scene)
    return CellError(
        layers=tube.solution.deformable.assembly.n_layers,
        mesh=mesh_words(cell_scene),
        cell=middle_answer(cell.solution),
        middle=middle_answer(tube.solution),
        tube=answer_of(tube.solution),
        cell_seconds=cell.cpu_seconds["total"],
        tube_seconds=tube.cpu_seconds["total"],
    )


def middle_answer(solution: Solution) -> Answer:
    """Answer of the two middle layers, rid of their mean motion along and about the axis.

    Of a tube with an odd number of layers, those are the middle one and the one below it.
    """
    assembly = solution.deformable.assembly
    lower = max(assembly.n_layers // 2, 1)
    layers = (1, 2) if assembly.image_of is not None else (lower, lower + 1)
    chosen = np.isin(assembly.layer[assembly.free_blocks], layers)
    blocks = assembly.free_blocks[chosen]
    found = solution.contact.per_block
    return Answer(
        p_max=float(found.p_max[chosen].mean()),
        p_eff=float(found.p_eff[chosen].mean()),
        displacement=_own_displacement(solution, blocks.tolist()),
    )


def _own_displacement(solution: Solution, blocks: list[int]) -> float:
    """Largest displacement of some blocks beyond their mean motion along and about the axis."""
    assembly = solution.deformable.assembly
    places, moves, masses = [], [], []
    for block in blocks:
        places.append(solution.deformable.positions(block) - assembly.origin)
        moves.append(solution.displacement(block))
        masses.append(solution.deformable.group(block).lumped_mass)
    x, u, mass = np.concatenate(places), np.concatenate(moves), np.concatenate(masses)
    about: FloatArray = np.cross(assembly.axis, x)
    motions = np.stack([np.broadcast_to(assembly.axis, x.shape), about])
    # Along and about the axis are orthogonal in the mass of a whole ring, but not of every mesh.
    gram = np.einsum("kni,n,lni->kl", motions, mass, motions)
    mean = np.linalg.solve(gram, np.einsum("kni,n,ni->k", motions, mass, u))
    return float(np.linalg.norm(u - np.einsum("k,kni->ni", mean, motions), axis=1).max())


def cell_table(name: str, found: CellError) -> Table:
    """Cell, middle layers and tube, and the error."""
    title = f"{name}: periodic cell beside {found.layers} layers, static, {found.mesh}"
    table = listing(title, "", "p_max, MPa", "p_eff, MPa", "u, mm", "CPU s")
    rows = (
        ("periodic cell", found.cell, found.cell_seconds),
        ("two middle layers of the tube", found.middle, None),
        ("whole tube", found.tube, found.tube_seconds),
    )
    for words, a, seconds in rows:
        numbers = (f"{v:.5g}" for v in a.values)
        table.add_row(words, *numbers, "" if seconds is None else f"{seconds:.2f}")
    for words, c in (
        ("error of the middle layers", found.against_middle),
        ("difference from the whole tube", found.against_tube),
    ):
        table.add_row(words, *(f"{100 * v:+.2f} %" for v in c.values), "")
    return table
