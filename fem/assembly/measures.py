"""Measures of the contact pressures of deformable blocks, by the paper's definitions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem.assembly.contact_state import ContactState
from fem.contact.law import ContactLaw, ExponentialLaw
from fem.element.facet import facet_areas
from geometry.assembly import Assembly
from geometry.measures import BlockMeasures, block_measures, measures
from geometry.mesh import FloatArray


@dataclass(frozen=True)
class ContactMeasures:
    """Contact of a whole assembly; blocks of the frame are not measured."""

    p_eff: float
    """Mean over blocks of the mean of their K largest facet pressures [MPa]."""
    p_eff_pooled: float
    """The same pooled over blocks: mean of the K largest of all of them together [MPa]."""
    p_max_face: float
    """Mean over blocks of their largest facet pressure, the paper's max-mean [MPa]."""
    p_max_point: float
    """Largest pressure at any integration point [MPa]."""
    effective_count_percent: float
    """Mean over blocks of 100 K / (facets that can meet a neighbour) [%]."""
    effective_area_percent: float
    """The same with areas [%]."""
    mean_overclosure: float
    """Area-weighted mean overclosure where surfaces press on each other [mm]."""
    force: float
    """Sum of all contact forces, each pair counted once [N]."""
    per_block: BlockMeasures
    """The paper's measures of each free block."""


def contact_measures(assembly: Assembly, state: ContactState) -> ContactMeasures:
    """Measure the pressures of a static or explicit state.

    Facets that a search found are those of the finer of two surfaces; for either block as many
    could meet a neighbour as cover its contact faces.

    Parameters
    ----------
    assembly
        Blocks.
    state
        Their contact.
    """
    blocks, areas = assembly.free_blocks, assembly.eligible_areas()
    m, s = (assembly.originals[b] for b in (state.block_m, state.block_s))
    per_block = block_measures(blocks, m, s, state.pressures, state.areas)
    eligible: FloatArray = assembly.eligible_facets().astype(np.float64)
    if state.interface is None:
        eligible = facets_that_fit(assembly, state)
    overall = measures(per_block, eligible[blocks], areas[blocks])
    pressing = np.where(state.point_pressures > 0.0, state.point_areas, 0.0)
    area = float(pressing.sum())
    return ContactMeasures(
        p_eff=overall.p_eff,
        p_eff_pooled=overall.p_eff_pooled,
        p_max_face=overall.p_max,
        p_max_point=float(state.point_pressures.max(initial=0.0)),
        effective_count_percent=overall.effective_count_percent,
        effective_area_percent=overall.effective_area_percent,
        mean_overclosure=float(pressing @ state.point_overclosures) / area if area else 0.0,
        force=float(state.point_areas @ state.point_pressures),
        per_block=per_block,
    )


@dataclass(frozen=True)
class CapAction:
    """Where the maximum stiffness of an exponential law acted: there it is another law."""

    maximum_stiffness: float
    """[MPa/mm]"""
    pressure: float
    """Pressure from which it acts [MPa]."""
    points: int
    """Integration points at which it acted."""
    pressing_points: int
    """Integration points that press."""
    force_share: float
    """Contact force of those points over all contact force [-]."""


def cap_action(law: ContactLaw, state: ContactState) -> CapAction | None:
    """Where the cap of a law acted; None for a law without one."""
    return cap_action_at(law, state.point_pressures, state.point_areas)


def cap_action_at(law: ContactLaw, pressures: FloatArray, areas: FloatArray) -> CapAction | None:
    """Where the cap of a law acted, from pressures [MPa] and areas [mm²] of points, (n,) each."""
    if not (isinstance(law, ExponentialLaw) and np.isfinite(law.maximum_stiffness)):
        return None
    force = areas * pressures
    acted = pressures > law.constants.linear_pressure
    total = float(force.sum())
    return CapAction(
        maximum_stiffness=law.maximum_stiffness,
        pressure=law.constants.linear_pressure,
        points=int(acted.sum()),
        pressing_points=int((force > 0.0).sum()),
        force_share=float(force[acted].sum()) / total if total else 0.0,
    )


def facets_that_fit(assembly: Assembly, state: ContactState) -> FloatArray:
    """How many facets that a search found cover the contact faces of each block, (n_blocks,)."""
    areas = [facet_areas(s.mesh.nodes, s.contact_quads) for s in assembly.shapes]
    whole, own = (
        np.array([of(area) for area in areas], dtype=np.float64)[assembly.shape_of]
        for of in (np.sum, len)
    )
    ends = np.concatenate([state.block_m, state.block_s])
    met = np.bincount(ends, minlength=assembly.n_blocks)
    covered = np.bincount(ends, np.tile(state.areas, 2), minlength=assembly.n_blocks)
    return np.where(met > 0, met * whole / np.maximum(covered, 1e-300), own)
