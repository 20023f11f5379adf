"""Contact pressures of a state: the paper's measures, and peaks between the points that are solved.

Equilibrium fixes the pressures at integration points. They are largest at corners of facets:
between them a gap is bilinear. The law evaluated there converges like the displacement, the mean
over a facet like the size of the facet. A steep law turns a small extrapolation into a large
factor: beyond `LARGEST_FACTOR` the pressure at the edge belongs to no state that was solved. The
facet then counts with its largest pressure at an integration point, and the peak is marked as not
resolved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fem.contact.law import ContactLaw, ExponentialLaw
from fem.state import State, once
from fem.stresses.recovery import Peak, nearest_face
from fem.system.contact_state import facets_that_fit
from fem.system.system import System
from geometry.errors import RefusedError
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.measures import BlockMeasures, block_measures, first_largest, measures

#: Largest pressure near an edge over that at the integration points of the same facet [-].
#: A factor e is an extrapolation of at most c0, the length over which the exponential law grows
#: by e. A linear pressure between two Gauss points reaches a factor of 1.37 along one edge and
#: 1.87 at a corner.
LARGEST_FACTOR = math.e
#: Part of a peak that polynomials may miss, over (d/ℓ)², and at most: 1.15, 1.2 and 0.19 were
#: observed.
_OF_A_PEAK, _MOST_OF_A_PEAK = 1.5, 0.25


class NoContactError(RefusedError):
    """Contact of single bodies, which have none."""


@dataclass(frozen=True)
class ContactMeasures:
    """Contact of a whole assembly; blocks of the frame are not measured."""

    p_eff: float
    """Mean over blocks of the mean of their K largest facet pressures [MPa]."""
    p_eff_pooled: float
    """The same pooled over blocks: mean of the K largest of all of them together [MPa]."""
    p_max: float
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


@once
def contact_measures(state: State) -> ContactMeasures:
    """Measure the pressures of a static or explicit state by the paper's definitions.

    Facets that a search found are those of the finer of two surfaces; for either block as many
    could meet a neighbour as cover its contact faces.
    """
    if not state.whole.meets:
        raise NoContactError(
            "contact: got single bodies, which have no contact; expected blocks that meet"
        )
    assembly, contact = state.whole.assembly, state.contact_state
    blocks, areas = assembly.free_blocks, assembly.eligible_areas()
    m, s = (assembly.originals[b] for b in (contact.block_m, contact.block_s))
    per_block = block_measures(blocks, m, s, contact.pressures, contact.areas)
    eligible: FloatArray = assembly.eligible_facets().astype(np.float64)
    if contact.interface is None:
        eligible = facets_that_fit(assembly, contact)
    overall = measures(per_block, eligible[blocks], areas[blocks])
    pressing = np.where(contact.point_pressures > 0.0, contact.point_areas, 0.0)
    area = float(pressing.sum())
    return ContactMeasures(
        p_eff=overall.p_eff,
        p_eff_pooled=overall.p_eff_pooled,
        p_max=overall.p_max,
        p_max_point=float(contact.point_pressures.max(initial=0.0)),
        effective_count_percent=overall.effective_count_percent,
        effective_area_percent=overall.effective_area_percent,
        mean_overclosure=float(pressing @ contact.point_overclosures) / area if area else 0.0,
        force=float(contact.point_areas @ contact.point_pressures),
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


def cap_action(state: State) -> CapAction | None:
    """Where the maximum stiffness of the contact law acted.

    None for a law without one, and where pairs of blocks have laws of their own.
    """
    law, contact = state.whole.contact.law, state.contact_state
    if not (isinstance(law, ExponentialLaw) and np.isfinite(law.maximum_stiffness)):
        return None
    force = contact.point_areas * contact.point_pressures
    acted = contact.point_pressures > law.constants.linear_pressure
    total = float(force.sum())
    return CapAction(
        maximum_stiffness=law.maximum_stiffness,
        pressure=law.constants.linear_pressure,
        points=int(acted.sum()),
        pressing_points=int((force > 0.0).sum()),
        force_share=float(force[acted].sum()) / total if total else 0.0,
    )


# ---------------------------------------------------------------------------------------------
# Peaks


@dataclass(frozen=True)
class FacetPeaks:
    """Largest pressure of each facet, and where it is."""

    values: FloatArray
    """(n_facets,) [MPa]"""
    look: IntArray
    """Which point near the edges the value belongs to, where resolved; (n_facets,)."""
    point: IntArray
    """Integration point of the largest pressure, which the value belongs to elsewhere;
    (n_facets,)."""
    resolved: BoolArray
    """Whether the integration points resolve the pressure at the edges, (n_facets,)."""
    extrapolated: FloatArray
    """The law at the extrapolated gap, (n_facets,) [MPa]."""

    @property
    def all_resolved(self) -> bool:
        """Whether no facet that is not resolved can hold a larger pressure than the largest."""
        hidden = self.extrapolated[~self.resolved]
        return bool(hidden.max(initial=0.0) <= self.values.max(initial=0.0))


def facet_peaks(law: ContactLaw, at_looks: FloatArray, at_points: FloatArray) -> FacetPeaks:
    """Find the largest pressure of each facet.

    Parameters
    ----------
    law
        Contact law.
    at_looks
        Overclosures extrapolated to edges and corners, (n_facets, n_looks) [mm].
    at_points
        Overclosures at integration points, (n_facets, n_points) [mm].
    """
    look, point = at_looks.argmax(axis=1), at_points.argmax(axis=1)
    rows = np.arange(len(at_looks))
    with np.errstate(over="ignore"):
        extrapolated = law.pressure(at_looks[rows, look])
    inside = law.pressure(at_points[rows, point])
    resolved = extrapolated <= LARGEST_FACTOR * inside
    values = np.where(resolved, extrapolated, inside)
    return FacetPeaks(values, look, point, resolved, extrapolated)


def largest_pressure(state: State) -> Peak | None:
    """Largest contact pressure at a point; None without contact.

    At corners of matched facets, on a grid of those of higher degree, where their integration
    points resolve it; else, and where a search found facets, at an integration point.
    """
    whole, contact = state.whole, state.contact_state
    if not contact.n_facets:
        return None
    result = _matched_peaks(state)
    if result is None:
        point = first_largest(contact.point_pressures)
        facet, where = int(contact.facet[point]), contact.positions[point]
        value, resolved = float(contact.point_pressures.max()), True
    else:
        facet = first_largest(result.values)
        value, resolved = float(result.values.max()), result.all_resolved
        where = _place_of_peak(whole, result, facet)
    pair = int(contact.block_m[facet]), int(contact.block_s[facet])
    return Peak(value, pair, where, nearest_face(whole, pair[0], where), resolved)


def _matched_peaks(state: State) -> FacetPeaks | None:
    """Largest pressure of each matched facet; None where a search found the facets."""
    contact = state.contact_state
    looks = contact.corner_overclosures
    if looks is None:
        return None
    law = state.whole.contact.law.on(contact.block_m, contact.block_s)
    return facet_peaks(law, looks, contact.point_overclosures.reshape(len(looks), -1))


def _place_of_peak(system: System, found: FacetPeaks, facet: int) -> FloatArray:
    """Where the largest pressure of a facet is, before the load acts, (3,) [mm]."""
    surfaces = system.surfaces
    block, basis = int(surfaces.block_m[facet]), surfaces.basis
    nodes = system.assembly.nodes(block)[surfaces.quads_m[facet]]
    at_edge = bool(found.resolved[facet])
    functions = basis.looks[found.look[facet]] if at_edge else basis.values[found.point[facet]]
    where: FloatArray = functions @ nodes + system.offsets[block]
    return where


def pressure_between_nodes(state: State) -> float:
    """What the largest pressure may change between the nodes of its facet [MPa].

    A law of stiffness k [MPa/mm] between bodies of plane strain moduli E' lets pressures change
    over a length of ℓ = E'/k, not over less. So polynomials through nodes a distance d apart may
    miss (d/ℓ)² of a peak, of that part of it that is no uniform pressure; `_OF_A_PEAK` times that
    is the estimate, which counts up to `_MOST_OF_A_PEAK`. Zero where a search found the facets.
    """
    whole, contact, found = state.whole, state.contact_state, _matched_peaks(state)
    if found is None or not contact.n_facets:
        return 0.0
    facet = first_largest(found.values)
    assert contact.corner_overclosures is not None
    looks = contact.corner_overclosures[facet]
    pair = int(contact.block_m[facet]), int(contact.block_s[facet])
    of_pair = whole.contact.law.on(contact.block_m, contact.block_s).one(facet)
    materials = [whole.body_of(b).material for b in pair if whole.body_number[b] >= 0]
    gives = sum((1.0 - m.poisson_ratio**2) / m.young_modulus for m in materials)
    length = 1.0 / (gives * float(of_pair.stiffness(looks.max())))
    distance = _node_distance(whole, found, facet) / length
    steep = float(found.values[facet] - of_pair.pressure(looks.min()))
    return min(_OF_A_PEAK * distance**2, _MOST_OF_A_PEAK) * max(steep, 0.0)


def _node_distance(system: System, found: FacetPeaks, facet: int) -> float:
    """Largest distance of neighbouring nodes at the peak of a facet [mm]."""
    surfaces = system.surfaces
    block = int(surfaces.block_m[facet])
    nodes = system.assembly.nodes(block)[surfaces.quads_m[facet]]
    n = math.isqrt(len(nodes))
    if n == 2:  # corners go round
        nodes = nodes[[0, 3, 1, 2]]
    where = _place_of_peak(system, found, facet) - system.offsets[block]
    nearest = int(np.linalg.norm(nodes - where, axis=1).argmin())
    grid = nodes.reshape(n, n, 3)
    largest = 0.0
    for line, k in zip((grid[:, nearest % n], grid[nearest // n]), divmod(nearest, n), strict=True):
        steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
        largest = max(largest, float(steps[max(0, k - 1) : k + 1].max()))
    return largest
