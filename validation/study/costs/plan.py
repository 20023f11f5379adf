"""Which settings `tubelock cost` runs on a scene, which is the reference, and what is left out why.

What a scene does not have is left out by name: curved elements, a grading across the wall.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fem.accuracy.converge import MOST_SECONDS, why_not_refined
from fem.accuracy.ladder import LADDER, on_rung
from fem.element.hexahedron import ElementType
from fem.static.linear_step.grid import grid_blocks
from fem.system.sector import largest_cyclic_orbits
from fem.system.system import System
from geometry.machine.work import SECONDS, Operation
from mbd.options import Norm
from validation.build.cell import refuse_cell
from validation.build.problem import fem_section, scene_problem
from validation.errors import InputError
from validation.scene.family import AssemblyScene
from validation.study.costs.measure import SCALARS
from validation.study.costs.settings import (
    ELEMENT_NAMES,
    BaseMesh,
    CostSetting,
    base_mesh,
    curved_setting,
    degree_setting,
    explicit_setting,
    graded,
    rigid_setting,
    static_setting,
    variants,
)

#: What errors are measured in: the scalars, and the pressure field in L2.
QUANTITIES = (*SCALARS, "pressure_l2")
#: What sits at the outer edge of the wall.
EDGE_QUANTITIES = ("p_max_point",)
#: Effects that errors cannot be measured with, and why.
_REFUSED = {
    "friction": "errors are measured against a static solution, which depends on no history",
    "gravity": "rigid answers are measured too, of the load alone",
    "elastic_frame": "expected rigid frame blocks, which rigid and deformable answers share",
    "finite_sliding": "pressures are compared facet by facet, and a search finds other facets",
}


@dataclass(frozen=True)
class Judge:
    """Meshes of one method, coarse to fine, that say what is right."""

    settings: tuple[CostSetting, ...]
    quantities: tuple[str, ...]
    """That they judge."""
    extrapolated: bool
    """Whether their limit counts; else the finest, with the error bar of `fem --accuracy`."""

    @property
    def words(self) -> str:
        """Which meshes, and how they judge."""
        if not self.extrapolated:
            return f"{self.settings[-1].name}, judged by the meshes before"
        meshes = ", ".join(setting.mesh_words for setting in self.settings)
        return f"{self.settings[0].family} on {meshes}, extrapolated"


@dataclass(frozen=True)
class CostPlan:
    """All that one call measures."""

    base: BaseMesh
    settings: tuple[CostSetting, ...]
    judges: tuple[Judge, ...]
    """What errors are measured against; of two that judge a quantity the last one counts."""
    left_out: tuple[tuple[str, str], ...] = ()
    """Methods that are not measured, and why."""

    @property
    def references(self) -> tuple[CostSetting, ...]:
        """Settings of all judges, each once."""
        return tuple(dict.fromkeys(s for judge in self.judges for s in judge.settings))


def extrapolated(base: BaseMesh, levels: tuple[int, ...]) -> tuple[Judge, ...]:
    """Trilinear blocks in the limit of vanishing elements; graded for what sits at the outer edge.

    The limit is the same on both, but for plain means over facets.
    """
    plain = tuple(static_setting(ElementType.INCOMPATIBLE, k) for k in levels)
    judges = [Judge(plain, QUANTITIES, extrapolated=True)]
    if base.grades:
        short = tuple(graded(setting) for setting in plain)
        judges.append(Judge(short, EDGE_QUANTITIES, extrapolated=True))
    return tuple(judges)


def by_degree(level: int, degrees: tuple[int, ...]) -> Judge:
    """One mesh on the exact shape, the highest degree with its error bar.

    Its facets are too few for plain means over the largest of them.
    """
    quantities = tuple(q for q in QUANTITIES if q != "p_eff")
    settings = tuple(degree_setting(degree, level) for degree in degrees)
    return Judge(settings, quantities, extrapolated=False)


def curved_rungs(*rungs: int) -> tuple[Judge, ...]:
    """Rungs of `fem --accuracy`, the finest with its error bar."""
    return (Judge(tuple(map(curved_setting, rungs)), QUANTITIES, extrapolated=False),)


def require_cost_scene(scene: Any, name: str) -> AssemblyScene:
    """Return the scene if its work and precision can be measured."""
    if not isinstance(scene, AssemblyScene) or not scene.meets:
        raise InputError(
            f"{name}: block.type {scene.block.type!r}: the cost of accuracy is that of contact "
            "pressures on finer and finer meshes; expected a scene whose blocks meet and have "
            "[mesh], such as tsb1-pipe, thb0-tunnel or planar-sine"
        )
    fem_section(scene, name)
    refuse_cell(scene, name, "cost")
    for effect, why in _REFUSED.items():
        if getattr(scene.effects, effect):
            raise InputError(f"{name}: effects.{effect}: {why}; remove {effect}")
    base_mesh(scene, name)
    return scene


def full_plan(name: str, scene: AssemblyScene) -> CostPlan:
    """Everything, to decide by."""
    base, best = base_mesh(scene, name), ElementType.INCOMPATIBLE
    left_out: list[tuple[str, str]] = []
    result = [rigid_setting(norm, k) for norm in Norm for k in (1, 2, 4, 6)]
    for element in ELEMENT_NAMES:
        result += [static_setting(element, k) for k in (1, 2, 3, 4)]
    for element in ELEMENT_NAMES:
        result += [explicit_setting(element, k) for k in (1, 2, 4)]
    result += [static_setting(best, 6), explicit_setting(best, 6)]
    if base.grades:
        result += [graded(static_setting(best, k)) for k in (2, 3, 4, 6)]
        result += [graded(explicit_setting(best, k)) for k in (2, 4)]
    else:
        left_out.append(("graded meshes", f'[mesh] of "{scene.block.type}" has no grading'))
    result += variants(2)
    why = _why_no_ladder(name, scene)
    if why is not None:
        left_out.append(("mesh sequence of `fem --accuracy`", why))
        result += [degree_setting(degree, k) for degree in (2, 3) for k in (1, 2, 3)[: 5 - degree]]
        judges = (*extrapolated(base, (3, 4, 6, 8)), by_degree(2, (2, 3, 4)))
        return CostPlan(base, tuple(result), judges, tuple(left_out))
    # The finest rung judges the others and all that is not curved.
    result += [curved_setting(k) for k in (1, 2, 3, 4, 5)]
    return CostPlan(base, tuple(result), curved_rungs(4, 5, 6), tuple(left_out))


def _why_no_ladder(name: str, scene: AssemblyScene) -> str | None:
    """Why the finest meshes of `fem --accuracy` are no reference; None where they are."""
    problem = scene_problem(scene, name)
    why = why_not_refined(problem)
    if why is not None:
        return f"it does not refine {why}"
    if grid_blocks(on_rung(problem, LADDER[0]).deformable) is None:
        return "its finest meshes take minutes where blocks are no structured grids"
    finest = on_rung(problem, LADDER[-2])
    if _work(finest.deformable) > MOST_SECONDS:
        return "its finest meshes are beyond the limit of work: blocks of a layer are not alike"
    return None


def _work(deformable: System) -> float:
    """Work of the contact of a sector before it is solved: dense matrices of each layer."""
    surfaces, layer = deformable.surfaces, deformable.assembly.layer
    low = np.minimum(layer[surfaces.block_m], layer[surfaces.block_s])
    order = largest_cyclic_orbits(deformable).order
    points = np.bincount(low) * (surfaces.basis.n_points / order)
    return SECONDS[Operation.DENSE] * float((points**3).sum())


def quick_plan(name: str, scene: AssemblyScene) -> CostPlan:
    """Coarse meshes: shows how it works, in seconds."""
    result = [rigid_setting(norm, k) for norm in Norm for k in (1, 2)]
    result += [
        static_setting(element, k)
        for element in (ElementType.INCOMPATIBLE, ElementType.REDUCED)
        for k in (1, 2)
    ]
    result += [explicit_setting(ElementType.INCOMPATIBLE, 1)]
    result += [variants(1)[0]]
    base = base_mesh(scene, name)
    return CostPlan(base, tuple(result), extrapolated(base, (2, 3, 4)))
