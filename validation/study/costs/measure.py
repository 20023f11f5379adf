"""One setting of `tubelock cost`: run it, take its numbers and its CPU time."""

from __future__ import annotations

import datetime
import gc
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fem.accuracy.converge import MOST_SECONDS, climbed
from fem.accuracy.ladder import LADDER
from fem.dynamics import stated_run
from fem.state import State
from geometry.answer import Answer
from geometry.assembly import Assembly
from geometry.families.sine_block import SineBlockDivisions
from geometry.machine.work import budget
from geometry.mesh import FloatArray, IntArray
from validation.build.problem import build_assembly, scene_problem
from validation.case import scene_case
from validation.errors import InputError, named
from validation.output.provenance import processor
from validation.run.deformable import deformable_answer, on_its_mesh
from validation.scene.family import AssemblyScene
from validation.solving import repeatable, solve
from validation.study.costs.partition import PARTITION_LEVEL, partition_pressures
from validation.study.costs.settings import BaseMesh, CostSetting, with_setting

#: Scalars that are measured.
SCALARS = ("p_max_point", "p_eff", "sigma_1_averaged", "max_displacement")
#: Settings cheaper than this are run twice [CPU s].
CHEAP = 3.0


@dataclass(frozen=True)
class MethodAnswer:
    """What a method says of a scene."""

    assembly: Assembly
    scalars: dict[str, float]
    contacts: IntArray
    """Facets in the interfaces of the assembly, (n,)."""
    pressures: FloatArray
    """Mean pressure of each, (n,) [MPa]."""
    cpu_seconds: float
    details: dict[str, Any] = field(default_factory=dict)
    """Numbers of the solver."""


# ---------------------------------------------------------------------------------------------
# Runs


def measure(
    name: str, scene: AssemblyScene, base: BaseMesh, setting: CostSetting, *, repeats: int = 2
) -> dict[str, Any]:
    """Run a setting; twice where that is cheap.

    Returns
    -------
    dict[str, Any]
        As it is stored: ``scalars`` by the names of `SCALARS`, of rigid blocks means of pressures
        only; ``pressures`` [MPa] and ``areas`` [mm²] of each cell of the partition;
        ``cpu_seconds`` from the scene to the pressures, of each repeat; ``details`` of the solver;
        ``date`` and ``processor``.
    """
    solved = _timed(setting, with_setting(scene, base, setting), f"{name}, {setting.name}")
    result, seconds = _run(name, solved, base, setting)
    times = [seconds]
    while len(times) < repeats and min(times) < CHEAP:
        times.append(_run(name, solved, base, setting)[1])
    today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    return result | {"cpu_seconds": times, "date": today, "processor": processor()}


def warm_up(name: str, scene: AssemblyScene, base: BaseMesh, setting: CostSetting) -> None:
    """Run a setting once on its coarsest mesh for a few steps, so that all kernels are compiled."""
    solved = _timed(setting, with_setting(scene, base, setting), name)
    if setting.method == "explicit":
        short = {"end_time": 1e-3, "ramp_time": 1e-4, "residual": 1e300}
        solved = solved.changed({"fem": short})
    _run(name, solved, base, setting)


def _timed(setting: CostSetting, scene: AssemblyScene, name: str) -> AssemblyScene:
    """Give the scene the times that depend on its lowest excited frequency."""
    usual = setting.ramp_factor == 1.0 and setting.hold_periods is None
    if setting.method != "explicit" or usual:
        return scene
    with named(name):
        times = stated_run(scene_problem(scene, name), scene.in_time).recommended
    assert times is not None  # blocks meet
    ramp = setting.ramp_factor * times.ramp_time
    changed: dict[str, Any] = {"ramp_time": ramp}
    if setting.hold_periods is not None:
        changed["end_time"] = ramp + setting.hold_periods / times.frequency
    scene = scene.changed({"fem": changed})
    if setting.damping_ratio is not None:
        critical = 4.0 * math.pi * times.frequency
        coefficient = setting.damping_ratio * critical  # 1/s
        constant = {"effects.rayleigh.mass_proportional": coefficient, "fem.damping": None}
        scene = scene.changed(constant)
    return scene


def _run(
    name: str, scene: AssemblyScene, base: BaseMesh, setting: CostSetting
) -> tuple[dict[str, Any], float]:
    """Numbers of one run and its CPU time [s]."""
    gc.collect()
    usual = None if setting.method == "explicit" else MOST_SECONDS
    with budget(scene.fem.max_work or usual, memory=scene.fem.max_memory):
        result = _METHODS[setting.method](f"{name}, {setting.name}", scene, setting)
    cells = replace(setting, method="static", level=PARTITION_LEVEL, radial_grading=1.0)
    pressures, areas = partition_pressures(
        result.assembly,
        result.contacts,
        result.pressures,
        build_assembly(with_setting(scene, base, cells)),
        level=setting.facet_level,
        across=_rows(setting, base),
    )
    numbers = {
        "scalars": result.scalars,
        "pressures": pressures.tolist(),
        "areas": areas.tolist(),
        "details": result.details,
    }
    return numbers, result.cpu_seconds


def _rows(setting: CostSetting, base: BaseMesh) -> FloatArray | None:
    """Places of the rows of facets of a graded mesh across the wall; None where they are equal."""
    if setting.radial_grading == 1.0:
        return None
    return SineBlockDivisions(**setting.mesh(base)).radial_positions


def _rigid(where: str, scene: AssemblyScene, _: CostSetting) -> MethodAnswer:
    start = time.process_time()
    rigid = solve(scene_case(scene, where).with_method("rigid"))
    seconds = time.process_time() - start
    result = rigid.details
    if result.measures is None:
        raise InputError(f"{where}: {result.equilibrium.status}")
    details: dict[str, Any] = {
        "n_contacts": result.n_contacts,
        "iterations": result.equilibrium.iterations,
        "residual": result.equilibrium.residual,
    }
    scalars = {"p_eff": result.measures.p_eff}
    contacts, pressures = result.contact_index, result.contact_pressures
    return MethodAnswer(rigid.details.blocks, scalars, contacts, pressures, seconds, details)


def _curved(where: str, scene: AssemblyScene, setting: CostSetting) -> MethodAnswer:
    """All rungs of `fem --accuracy` up to one: what its answer costs a user."""
    start = time.process_time()
    problem = scene_problem(scene, where)
    *_, finest = climbed(problem, LADDER[: setting.level])
    seconds = time.process_time() - start
    scalars = {name: finest.measures[name].value for name in SCALARS}
    details = {"unknowns": finest.numbers.beside["unknowns"]}
    assert finest.facets is not None
    assembly, pressures = finest.facets
    result = assembly.interfaces
    held = assembly.fixed[result.block_m] & assembly.fixed[result.block_s]
    contacts = np.flatnonzero(~held)
    return MethodAnswer(assembly, scalars, contacts, pressures[contacts], seconds, details)


def _deformable(where: str, scene: AssemblyScene, _: CostSetting) -> MethodAnswer:
    start = time.process_time()
    answer = repeatable(deformable_answer(on_its_mesh(scene_case(scene, where))))
    solved: State = answer.details
    seconds = time.process_time() - start
    scalars, details = _numbers(answer)
    contacts, pressures = solved.contact_state.matched, solved.contact_state.pressures
    return MethodAnswer(solved.deformable.assembly, scalars, contacts, pressures, seconds, details)


_METHODS: dict[str, Callable[[str, AssemblyScene, CostSetting], MethodAnswer]] = {
    "rigid": _rigid,
    "static": _deformable,
    "explicit": _deformable,
    "curved": _curved,
}


def _numbers(answer: Answer) -> tuple[dict[str, float], dict[str, Any]]:
    scalars = {name: answer[name].value for name in SCALARS}
    kept = ("status", "n_steps", "time_step", "time", "newton_iterations", "residual", "symmetry")
    reported = {key: answer.report.get(key) for key in kept}
    details = {key: value for key, value in reported.items() if value is not None}
    elements = answer.details.deformable.bodies[0].mesh.n_elements
    return scalars, details | {"elements_per_block": elements}
