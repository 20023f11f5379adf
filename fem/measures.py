"""Measures of a state of deformable blocks: fixed names, each with its unit and place.

`p_eff` and `p_max` are the paper's means over facets, `p_max_facet` is the largest mean over a
facet, `p_max_point` the largest pressure at a point. `sigma_1_max`, `sigma_3_min` and `mises_max`
are sampled inside elements, `sigma_1_averaged` is the first principal stress of the stress averaged
over a ball of `Material.averaging_radius`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from fem.assembly.contact_state import ContactMeasures
from fem.assembly.peaks import (
    Peak,
    largest_displacement,
    largest_pressure,
    mean_of_block_maxima,
)
from fem.contact.facet_peaks import LARGEST_FACTOR
from fem.solution import Solution
from geometry.answer import Lazy, Measure, place
from geometry.assembly import Assembly
from geometry.measures import block_measures, measures
from geometry.mesh import FloatArray, IntArray


def measures_of(
    solution: Solution,
    errors: Mapping[str, float] | None = None,
    *,
    facets: tuple[Assembly, FloatArray] | None = None,
    remarks: Mapping[str, str] | None = None,
) -> Lazy[Measure]:
    """Measures of a solution, each computed when it is read: see `fem.answer.answer_of`."""
    makers = {"max_displacement": lambda: _displacement(solution)} | _stresses(solution)
    if solution.deformable.meets:
        makers |= _pressures(solution, facets)
    bars, notes = errors or {}, remarks or {}

    def told(name: str) -> Callable[[], Measure]:
        return lambda: replace(makers[name](), error=bars.get(name), remark=notes.get(name, ""))

    return Lazy({name: told(name) for name in makers})


def _displacement(solution: Solution) -> Measure:
    peak = largest_displacement(solution.deformable, solution.group_displacements)
    return _measure(solution, peak, "mm")


def _stresses(solution: Solution) -> dict[str, Callable[[], Measure]]:
    radius = solution.averaging_radius
    return {
        "sigma_1_max": lambda: _measure(solution, solution.stress_peaks.sigma_1),
        "sigma_3_min": lambda: _measure(solution, solution.stress_peaks.sigma_3),
        "mises_max": lambda: _measure(solution, solution.stress_peaks.mises),
        "sigma_1_averaged": lambda: _measure(
            solution, solution.stress_peaks.sigma_1_averaged, averaging_radius=radius
        ),
    }


def _pressures(
    solution: Solution, facets: tuple[Assembly, FloatArray] | None
) -> dict[str, Callable[[], Measure]]:
    def at_a_point() -> Measure:
        law = solution.deformable.contact.law
        largest = largest_pressure(solution.deformable, law, solution.contact_state)
        return Measure(0.0, "MPa") if largest is None else _measure(solution, largest)

    at_points = {"p_max_point": at_a_point}
    if facets is not None:
        return facet_measures(*facets) | at_points
    state = solution.contact_state
    return {
        "p_eff": lambda: Measure(solution.contact.p_eff, "MPa"),
        "p_max": lambda: Measure(solution.contact.p_max, "MPa"),
        "p_max_facet": lambda: largest_mean(
            solution.deformable.assembly,
            np.column_stack([state.block_m, state.block_s]),
            state.pressures,
            state.centroids,
        ),
    } | at_points


def facet_measures(assembly: Assembly, pressures: FloatArray) -> dict[str, Callable[[], Measure]]:
    """Means over the facets of an assembly, from the pressures of its interfaces (n,) [MPa]."""
    found = assembly.interfaces
    m, s = (assembly.originals[b] for b in (found.block_m, found.block_s))
    per_block = block_measures(assembly.free_blocks, m, s, pressures, found.areas)
    blocks = np.column_stack([found.block_m, found.block_s])
    return {
        "p_eff": lambda: Measure(float(per_block.p_eff.mean()), "MPa"),
        "p_max": lambda: Measure(float(per_block.p_max.mean()), "MPa"),
        "p_max_facet": lambda: largest_mean(assembly, blocks, pressures, found.centroids),
    }


def contact_on(
    solution: Solution, facets: tuple[Assembly, FloatArray] | None = None
) -> ContactMeasures:
    """The paper's measures of a state, over other facets where these are given.

    What is measured at points is that of the mesh that was solved.
    """
    found = solution.contact
    if facets is None:
        return found
    assembly, pressures = facets
    blocks, matched = assembly.free_blocks, assembly.interfaces
    m, s = (assembly.originals[b] for b in (matched.block_m, matched.block_s))
    per_block = block_measures(blocks, m, s, pressures, matched.areas)
    eligible, areas = assembly.eligible_facets(), assembly.eligible_areas()
    overall = vars(measures(per_block, eligible[blocks], areas[blocks]))
    shared = {name: value for name, value in overall.items() if hasattr(found, name)}
    return replace(found, **shared, per_block=per_block)


def largest_mean(
    assembly: Assembly, blocks: IntArray, pressures: FloatArray, centroids: FloatArray
) -> Measure:
    """Largest of the mean pressures of facets (n,) between blocks (n, 2), at their centroids."""
    if not len(pressures):
        return Measure(0.0, "MPa")
    worst = int(pressures.argmax())
    pair = int(blocks[worst, 0]), int(blocks[worst, 1])
    where = place(assembly, pair, centroids[worst], None)
    return Measure(float(pressures[worst]), "MPa", place=where)


def _measure(solution: Solution, peak: Peak, unit: str = "MPa", **beside: float) -> Measure:
    """Value and place of a peak, and what stands beside the place."""
    where = place(solution.deformable.assembly, peak.blocks, peak.position, peak.face)
    return Measure(peak.value, unit, place=where | beside, resolved=peak.resolved)


def load_step_change(solution: Solution) -> dict[str, float]:
    """Change of each measure by half as many load steps, in its unit; empty if not known."""
    coarse = solution.coarser_loading
    if coarse is None:
        return {}
    before, after = measures_of(coarse), measures_of(solution)
    return {name: abs(after[name].value - before[name].value) for name in after}


def bracketed(solution: Solution) -> dict[str, float]:
    """How far both sides of each peak lie apart in the solution itself [MPa].

    Means over facets and integration points against corners of facets, integration points
    against corners of elements.
    """
    stress, found, pressures = solution.stress_peaks, measures_of(solution), {}
    if solution.deformable.meets:
        law = solution.deformable.contact.law
        corners = mean_of_block_maxima(solution.deformable, law, solution.contact_state)
        pressures = {
            "p_max": abs(corners - found["p_max"].value),
            "p_max_point": _peak_distance(solution, found["p_max_point"]),
        }
    return pressures | {
        "sigma_1_max": abs(stress.sigma_1_at_corners - stress.sigma_1.value),
        "sigma_3_min": abs(stress.sigma_3_at_corners - stress.sigma_3.value),
        "mises_max": abs(stress.mises_at_corners - stress.mises.value),
    }


def _peak_distance(solution: Solution, peak: Measure) -> float:
    """Distance from the largest pressure to the integration points, or beyond them [MPa].

    Where these do not resolve the pressure at an edge, it is larger than theirs by
    `LARGEST_FACTOR` or more.
    """
    if not peak.resolved:
        return (LARGEST_FACTOR - 1.0) * peak.value
    return abs(peak.value - solution.contact.p_max_point)
