"""What a periodic cell is worth: its answer beside that of the tube that it stands for."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from rich.table import Table

from fem.solution import Solution
from geometry.mesh import FloatArray
from validation.build.cell import check_cell
from validation.output.console import listing
from validation.run.solve import run_static
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene
from validation.study.effects.probe import Answer, answer_of, change, mesh_words, probe_scene

#: Fineness of the mesh on which a run measures the error of its cell: with the coarsest mesh it
#: would find a fraction of it.
_FINENESS = 2


def cell_error(scene: DeformableScene, name: str) -> dict[str, Any]:
    """Solve the cell and the whole tube of the scene statically on one mesh.

    Returns
    -------
    dict[str, Any]
        Free layers of the tube and elements of a block; answers of the cell, of the two middle
        layers, both relative to their mean motion along and about the axis, and of the whole tube
        [MPa, mm]; CPU times from the scene to the pressures [s]; relative changes: from the middle
        layers to the cell, which is its error, and from the whole tube, whose ends are in it.
    """
    check_cell(scene, name)
    cell = run_static(name, _static(scene, "periodic cell"))
    tube = run_static(name, _static(scene, "auto"))
    answers = {
        "cell": middle_answer(cell.solution),
        "middle": middle_answer(tube.solution),
        "tube": answer_of(tube.solution),
    }
    changes = {
        "error_of_middle_layers": change(answers["middle"], answers["cell"]),
        "difference_from_whole_tube": change(answers["tube"], answers["cell"]),
    }
    return {
        "layers": tube.solution.deformable.assembly.n_layers,
        "mesh": mesh_words(scene),
        "cell_seconds": cell.cpu_seconds["total"],
        "tube_seconds": tube.cpu_seconds["total"],
        **{key: asdict(result) for key, result in (answers | changes).items()},
    }


def probed_cell_error(scene: DeformableScene, name: str) -> dict[str, Any]:
    """Error of the cell on a mesh that is coarse enough to take seconds, whatever the scene's."""
    return cell_error(probe_scene(_static(scene, "auto"), name, fineness=_FINENESS), name)


def _static(scene: DeformableScene, symmetry: str) -> DeformableScene:
    return scene.changed({"fem.symmetry": symmetry, "fem.method": Method.STATIC})


def middle_answer(solution: Solution) -> Answer:
    """Answer of the two middle layers, rid of their mean motion along and about the axis.

    Of a tube with an odd number of layers, those are the middle one and the one below it.
    """
    assembly = solution.deformable.assembly
    lower = max(assembly.n_layers // 2, 1)
    layers = (1, 2) if assembly.image_of is not None else (lower, lower + 1)
    chosen = np.isin(assembly.layer[assembly.free_blocks], layers)
    blocks = assembly.free_blocks[chosen]
    result = solution.contact.per_block
    return Answer(
        p_max=float(result.p_max[chosen].mean()),
        p_eff=float(result.p_eff[chosen].mean()),
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


def cell_table(name: str, found: dict[str, Any]) -> Table:
    """Cell, middle layers and tube, and the error."""
    seconds = {key: f"{found[f'{key}_seconds']:.2f}" for key in ("cell", "tube")}
    rows = [
        ("periodic cell", "cell", "{:.5g}", 1.0),
        ("two middle layers of the tube", "middle", "{:.5g}", 1.0),
        ("whole tube", "tube", "{:.5g}", 1.0),
        ("error of the middle layers", "error_of_middle_layers", "{:+.2f} %", 100.0),
        ("difference from the whole tube", "difference_from_whole_tube", "{:+.2f} %", 100.0),
    ]
    title = f"{name}: periodic cell and {found['layers']} layers, static, {found['mesh']}"
    table = listing(title, "", "p_max, MPa", "p_eff, MPa", "u, mm", "CPU s")
    for words, key, form, factor in rows:
        numbers = (form.format(factor * value) for value in found[key].values())
        table.add_row(words, *numbers, seconds.get(key, ""))
    return table
