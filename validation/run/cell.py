"""What a periodic cell is worth: its answer beside that of the tube that it stands for."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fem.state import State
from geometry.mesh import FloatArray
from geometry.parts.rows import Row
from validation.build.cell import check_cell
from validation.case import scene_case
from validation.run.deformable import deformable_answer, on_its_mesh
from validation.run.probe import Numbers, change, mesh_words, numbers_of, probe_scene
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene

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
    runs = (scene_case(_static(scene, how), name) for how in ("periodic cell", "auto"))
    cell, tube = (deformable_answer(on_its_mesh(run)) for run in runs)
    answers = {
        "cell": middle_answer(cell.details),
        "middle": middle_answer(tube.details),
        "tube": numbers_of(tube.details),
    }
    changes = {
        "error_of_middle_layers": change(answers["middle"], answers["cell"]),
        "difference_from_whole_tube": change(answers["tube"], answers["cell"]),
    }
    return {
        "layers": tube.details.deformable.assembly.n_layers,
        "mesh": mesh_words(scene),
        "cell_seconds": cell.report["cpu_seconds"]["total"],
        "tube_seconds": tube.report["cpu_seconds"]["total"],
        **{key: asdict(result) for key, result in (answers | changes).items()},
    }


def probed_cell_error(scene: DeformableScene, name: str) -> dict[str, Any]:
    """Error of the cell on a mesh that is coarse enough to take seconds, whatever the scene's."""
    return cell_error(probe_scene(_static(scene, "auto"), name, fineness=_FINENESS), name)


@dataclass(frozen=True)
class CellError:
    """What a periodic cell differs by from the tube that it stands for."""

    name: str
    found: dict[str, Any]
    """As `cell_error` returns it."""

    @property
    def rows(self) -> list[Row]:
        """Cell, middle layers and whole tube on one mesh, and how the cell differs from both."""
        of, seconds = self.found, "CPU seconds"
        answers = {"cell": "periodic cell", "middle": "its two middle layers", "tube": "whole tube"}
        changes = {
            "error_of_middle_layers": "error of the periodic cell, middle layers",
            "difference_from_whole_tube": "difference from the whole tube",
        }
        words = f"{of['layers']} layers, static, {of['mesh']}, {of['cell_seconds']:.2f} {seconds}; "
        words += f"the whole tube {of['tube_seconds']:.2f} {seconds}"
        rows = [Row("periodic cell and tube", words)]
        for key, title in answers.items():
            p_max, p_eff, u = of[key].values()
            rows.append(Row(title, f"p_max {p_max:.4g} MPa, p_eff {p_eff:.4g} MPa, u {u:.4g} mm"))
        for key, title in changes.items():
            shown = ", ".join(f"{k} {100 * v:+.2f} %" for k, v in of[key].items())
            rows.append(Row(title, shown))
        return rows

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return self.found


def _static(scene: DeformableScene, symmetry: str) -> DeformableScene:
    return scene.changed({"fem.symmetry": symmetry, "fem.method": Method.STATIC})


def middle_answer(solution: State) -> Numbers:
    """Numbers of the two middle layers, rid of their mean motion along and about the axis.

    Of a tube with an odd number of layers, those are the middle one and the one below it.
    """
    assembly = solution.deformable.assembly
    lower = max(assembly.n_layers // 2, 1)
    layers = (1, 2) if assembly.image_of is not None else (lower, lower + 1)
    chosen = np.isin(assembly.layer[assembly.free_blocks], layers)
    blocks = assembly.free_blocks[chosen]
    result = solution.contact.per_block
    return Numbers(
        p_max=float(result.p_max[chosen].mean()),
        p_eff=float(result.p_eff[chosen].mean()),
        displacement=_own_displacement(solution, blocks.tolist()),
    )


def _own_displacement(solution: State, blocks: list[int]) -> float:
    """Largest displacement of some blocks beyond their mean motion along and about the axis."""
    assembly = solution.deformable.assembly
    places, moves, masses = [], [], []
    for block in blocks:
        places.append(solution.deformable.positions(block) - assembly.origin)
        moves.append(solution.displacement_of(block))
        masses.append(solution.deformable.body_of(block).lumped_mass)
    x, u, mass = np.concatenate(places), np.concatenate(moves), np.concatenate(masses)
    about: FloatArray = np.cross(assembly.axis, x)
    motions = np.stack([np.broadcast_to(assembly.axis, x.shape), about])
    # Along and about the axis are orthogonal in the mass of a whole ring, but not of every mesh.
    gram = np.einsum("kni,n,lni->kl", motions, mass, motions)
    mean = np.linalg.solve(gram, np.einsum("kni,n,ni->k", motions, mass, u))
    return float(np.linalg.norm(u - np.einsum("k,kni->ni", mean, motions), axis=1).max())
