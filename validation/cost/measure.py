"""One setting of `tubelock cost`: run it, take its numbers and its CPU time.

Pressures of different meshes are compared on one partition of every contact face into cells,
equal in the parameters of the face; a cell's pressure is the mean over its area.
"""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np

from fem.explicit.solve import Status
from geometry.assembly import Assembly
from geometry.families.sine_block import SineBlockDivisions
from geometry.mesh import FloatArray, IntArray
from validation.build.deformable import build_deformable
from validation.cost.curved import solve_rungs
from validation.cost.settings import (
    BaseMesh,
    CostSetting,
    damped_constantly,
    with_setting,
)
from validation.errors import InputError
from validation.run.deformable import DeformableRun
from validation.run.explicit import run_explicit, scene_statement
from validation.run.rigid.assembly import analyse_rigid, build_scene
from validation.run.static import run_static
from validation.scene.read import SceneFile, TubeScene

#: Scalars that are measured, with their units and what they are.
SCALARS = {
    "p_max_point": ("MPa", "largest contact pressure at a point"),
    "p_eff": ("MPa", "effective mean contact pressure"),
    "sigma_1_averaged": ("MPa", "largest principal stress averaged over a ball"),
    "max_displacement": ("mm", "largest displacement"),
}
#: The partition's cells in a face are as many as the facets of this level.
PARTITION_LEVEL = 2
#: Settings cheaper than this are run twice [CPU s].
CHEAP = 3.0


@dataclass(frozen=True)
class Measurement:
    """What a setting answers and what it costs."""

    scalars: dict[str, float]
    """By the names of `SCALARS`; rigid blocks have means of pressures only."""
    pressures: list[float]
    """Mean contact pressure of each cell of the partition [MPa]."""
    areas: list[float]
    """Area of each cell [mm²]."""
    cpu_seconds: list[float]
    """From the scene to the pressures, of each repeat [s]."""
    details: dict[str, Any]
    """Numbers of the solver: elements, steps or iterations, residual, status."""

    @property
    def cost(self) -> float:
        """Least CPU time of the repeats: what others do to the machine only adds [s]."""
        return min(self.cpu_seconds)

    def as_json(self) -> dict[str, Any]:
        """Plain data, numbers in full precision."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Read what `as_json` gave.

        Raises
        ------
        ValueError, TypeError
            Other data.
        """
        found = cls(**data)
        if len(found.pressures) != len(found.areas) or not found.cpu_seconds:
            raise ValueError("not a measurement")
        return found


# ---------------------------------------------------------------------------------------------
# Pressures on the common partition


def overlap(edges_from: FloatArray, edges_to: FloatArray) -> FloatArray:
    """Share of each interval between edges in each of others, (n_to, n_from)."""
    a, b = edges_from, edges_to
    low = np.maximum(a[None, :-1], b[:-1, None])
    high = np.minimum(a[None, 1:], b[1:, None])
    return np.clip(high - low, 0.0, None) / np.diff(a)


def _edges(mesh: Mapping[str, float]) -> dict[str, FloatArray]:
    """Places of the nodes of a block in each direction, 0 to 1."""
    around, radial, axial = (int(mesh[key]) for key in ("around", "radial", "axial"))
    divisions = SineBlockDivisions(around, radial, axial, mesh["radial_grading"])
    return {
        "around": np.linspace(0.0, 1.0, around + 1),
        "radial": divisions.radial_positions,
        "axial": np.linspace(0.0, 1.0, axial + 1),
    }


def partition_pressures(
    assembly: Assembly,
    contacts: IntArray,
    pressures: FloatArray,
    *,
    mesh: Mapping[str, float],
    cells: Mapping[str, float],
) -> tuple[FloatArray, FloatArray]:
    """Mean pressure and area of the cells of all contact faces of a tube of Sine Blocks.

    Parameters
    ----------
    assembly
        The tube.
    contacts
        Facets in its interfaces that carry pressures, (n,).
    pressures
        (n,) [MPa]
    mesh
        ``[mesh]``: ``around``, ``radial``, ``axial``, ``radial_grading``.
    cells
        The same of the partition.

    Returns
    -------
    tuple[FloatArray, FloatArray]
        (n_cells,) [MPa] and [mm²]; face by face in the order of blocks, the same for all meshes.
    """
    found = assembly.interfaces
    free = ~(assembly.fixed[found.block_m[contacts]] & assembly.fixed[found.block_s[contacts]])
    contacts, pressures = contacts[free], pressures[free]
    block, facet = found.block_m[contacts], found.facet_m[contacts]
    areas = found.areas[contacts]
    own, common = _edges(mesh), _edges(cells)
    all_pressures, all_areas = [], []
    for number in np.unique(block):
        mine = block == number
        shape, first = assembly.shape(int(number)), 0
        for name in shape.contact_faces:
            size = len(shape.faces[name])
            inside = mine & (facet >= first) & (facet < first + size)
            if inside.any():
                area, force = np.zeros(size), np.zeros(size)
                np.add.at(area, facet[inside] - first, areas[inside])
                np.add.at(force, facet[inside] - first, (areas * pressures)[inside])
                other = "axial" if name in ("left", "right") else "around"
                rows = overlap(own["radial"], common["radial"])
                columns = overlap(own[other], common[other])
                grid = (rows.shape[1], columns.shape[1])
                area = rows @ area.reshape(grid) @ columns.T
                force = rows @ force.reshape(grid) @ columns.T
                all_areas.append(area.ravel())
                all_pressures.append((force / area).ravel())
            first += size
    return np.concatenate(all_pressures), np.concatenate(all_areas)


# ---------------------------------------------------------------------------------------------
# Runs


def measure(
    name: str, scene: TubeScene, base: BaseMesh, setting: CostSetting, *, repeats: int = 2
) -> Measurement:
    """Run a setting; twice where that is cheap.

    Raises
    ------
    InputError
        A setting that has no answer.
    KeyboardInterrupt
        When the run was stopped from outside.
    """
    solved = _timed(setting, with_setting(scene, base, setting), f"{name}, {setting.name}")
    found, seconds = _run(name, solved, base, setting)
    times = [seconds]
    while len(times) < repeats and min(times) < CHEAP:
        times.append(_run(name, solved, base, setting)[1])
    return Measurement(**found, cpu_seconds=times)


def warm_up(name: str, scene: TubeScene, base: BaseMesh, setting: CostSetting) -> None:
    """Run a setting once on its coarsest mesh for a few steps, so that all kernels are compiled."""
    solved = _timed(setting, with_setting(scene, base, setting), name)
    if setting.method == "explicit":
        assert solved.fem is not None
        short = {"end_time": 1e-3, "ramp_time": 1e-4, "residual": 1e300}
        solved = solved.model_copy(update={"fem": solved.fem.model_copy(update=short)})
    _run(name, solved, base, setting)


def solver_scene(name: str, scene: TubeScene, base: BaseMesh, setting: CostSetting) -> TubeScene:
    """Scene that a setting solves, its times included."""
    return _timed(setting, with_setting(scene, base, setting), name)


def _timed(setting: CostSetting, scene: TubeScene, name: str) -> TubeScene:
    """Give the scene the times that depend on its lowest excited frequency."""
    usual = setting.ramp_factor == 1.0 and setting.hold_periods is None
    if setting.method != "explicit" or usual:
        return scene
    assert scene.fem is not None
    times = scene_statement(scene, name, build_deformable(scene, name)).recommended
    assert times is not None  # blocks meet
    ramp = setting.ramp_factor * times.ramp_time
    changed: dict[str, Any] = {"ramp_time": ramp}
    if setting.hold_periods is not None:
        changed["end_time"] = ramp + setting.hold_periods / times.frequency
    scene = scene.model_copy(update={"fem": scene.fem.model_copy(update=changed)})
    if setting.damping_ratio is not None:
        critical = 4.0 * math.pi * times.frequency
        scene = damped_constantly(scene, setting.damping_ratio * critical)
    return scene


def _run(
    name: str, scene: TubeScene, base: BaseMesh, setting: CostSetting
) -> tuple[dict[str, Any], float]:
    """Numbers of one run and its CPU time [s]."""
    gc.collect()
    where = f"{name}, {setting.name}"
    start = time.process_time()
    if setting.method == "rigid":
        rigid = analyse_rigid(build_scene(SceneFile(name=where, scene=scene)))
        seconds = time.process_time() - start
        measures = rigid.result.measures
        if measures is None:
            raise InputError(f"{where}: {rigid.result.equilibrium.status}")
        scalars = {"p_eff": measures.p_eff}
        details: dict[str, Any] = {
            "n_contacts": rigid.result.n_contacts,
            "iterations": rigid.result.equilibrium.iterations,
            "residual": rigid.result.equilibrium.residual,
        }
        assembly = rigid.assembly
        contacts, pressures = rigid.result.contact_index, rigid.result.contact_pressures
    elif setting.method == "curved":
        curved, values, seconds = solve_rungs(where, scene, setting)
        scalars = {name: values[name] for name in SCALARS}
        details = {"unknowns_per_block": curved.run.mesh.n_unknowns}
        assembly, state = curved.deformable.assembly, curved.contact_state
        assert state.interface is not None
        contacts, pressures = state.interface, state.pressures
    else:
        tube = _deformable(where, scene, setting)
        seconds = time.process_time() - start
        scalars, details = _tube_numbers(tube)
        assembly = tube.deformable.assembly
        contacts, pressures = tube.contact_index, tube.facet_pressures
    cell_pressures, areas = partition_pressures(
        assembly, contacts, pressures, mesh=setting.mesh(base), cells=base.at(PARTITION_LEVEL)
    )
    found = {
        "scalars": scalars,
        "pressures": cell_pressures.tolist(),
        "areas": areas.tolist(),
        "details": details,
    }
    return found, seconds


def _deformable(where: str, scene: TubeScene, setting: CostSetting) -> DeformableRun:
    if setting.method == "static":
        return run_static(where, scene)
    run = run_explicit(where, scene)
    if run.explicit is not None and run.explicit.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return run


def _tube_numbers(tube: DeformableRun) -> tuple[dict[str, float], dict[str, Any]]:
    scalars = {name: tube.measures[name].value for name in SCALARS}
    kept = ("status", "n_steps", "time_step", "time", "newton_iterations", "residual", "symmetry")
    told = {key: getattr(tube.answer.solver, key, None) for key in kept}
    details = {key: value for key, value in told.items() if value is not None}
    elements = tube.deformable.model.groups[0].mesh.n_elements
    return scalars, details | {"elements_per_block": elements}
