"""Measures of the contact pressures of deformable blocks, by the paper's definitions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem.contact import facet_pressures
from fem.deformable_assembly import DeformableAssembly
from geometry.measures import BlockMeasures, block_measures, measures
from geometry.mesh import FloatArray


@dataclass(frozen=True)
class ContactMeasures:
    """Contact of a whole assembly; blocks of the frame are not measured."""

    p_eff: float
    """Mean over blocks of the mean of their K largest facet pressures [MPa]."""
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


def contact_measures(
    deformable: DeformableAssembly, point_pressures: FloatArray, point_overclosures: FloatArray
) -> ContactMeasures:
    """Measure the pressures of a static or explicit state.

    Parameters
    ----------
    deformable
        The model.
    point_pressures, point_overclosures
        At the points of its surfaces, (n_facets, 4) [MPa] and [mm].
    """
    surfaces, assembly = deformable.surfaces, deformable.assembly
    blocks = assembly.free_blocks
    facets = facet_pressures(surfaces, point_pressures)
    m, s = (assembly.originals[b] for b in (surfaces.block_m, surfaces.block_s))
    per_block = block_measures(blocks, m, s, facets, surfaces.areas)
    overall = measures(
        per_block, assembly.eligible_facets()[blocks], assembly.eligible_areas()[blocks]
    )
    pressing = np.where(point_pressures > 0.0, surfaces.weights, 0.0)
    area = float(pressing.sum())
    return ContactMeasures(
        p_eff=overall.p_eff,
        p_max_face=overall.p_max,
        p_max_point=float(point_pressures.max(initial=0.0)),
        effective_count_percent=overall.effective_count_percent,
        effective_area_percent=overall.effective_area_percent,
        mean_overclosure=float((pressing * point_overclosures).sum()) / area if area else 0.0,
        force=float((surfaces.weights * point_pressures).sum()),
        per_block=per_block,
    )
