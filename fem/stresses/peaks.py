"""Largest pressures and stresses of a deformed assembly, with their place.

Pressures are largest at corners of facets: between them a gap is bilinear. The law evaluated there
converges like the displacement, the mean over a facet like the size of the facet. Where the
integration points of a facet do not resolve the pressure at its corners, their largest pressure
counts, and the peak is marked as not resolved (`fem.contact.facet_peaks`).

Stresses are sampled at the integration points inside elements and never averaged across them: at
the acute edge of a block the limit depends on the direction from which it is approached, and a
nodal average of it means nothing.

No criterion of cracking lives at a point. `averaged` stresses are means over the part of a ball
that lies in the block, of the radius of a material length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fem.contact.facet_peaks import FacetPeaks, facet_peaks
from fem.contact.law import ContactLaw
from fem.element.hexahedron import at_corners
from fem.element.kinds import integration_points
from fem.element.stress import (
    invariants,
    largest_tension,
    principal_stress,
    von_mises,
)
from fem.stresses.ball_averages import averaged_tension, ball_averages
from fem.stresses.recovery import block_displacements, moved_bodies
from fem.system.body import Body
from fem.system.contact_state import ContactState
from fem.system.system import System
from geometry.mesh import HEX_FACES, FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.measures import JointResultants, first_largest, summed_by_joint

#: Part of a peak that polynomials may miss, over (d/ℓ)², and at most: 1.15, 1.2 and 0.19 were
#: observed.
_OF_A_PEAK, _MOST_OF_A_PEAK = 1.5, 0.25


@dataclass(frozen=True)
class Peak(ReadOnlyArrays):
    """A largest value and where it is."""

    value: float
    """[MPa], or [mm] of a displacement."""
    blocks: tuple[int, ...]
    """The block, or the two that press on each other."""
    position: FloatArray
    """World axes, before the load acts, (3,) [mm]."""
    face: str | None
    """Named face of the first block that the element or facet lies on; None inside."""
    resolved: bool = True
    """Whether the integration points resolve the value."""


def largest_pressure(deformable: System, law: ContactLaw, state: ContactState) -> Peak | None:
    """Largest contact pressure at a point; None without contact.

    At corners of matched facets, on a grid of those of higher degree, where their integration
    points resolve it; else, and where a search found facets, at an integration point.
    """
    if not state.n_facets:
        return None
    result = _matched_peaks(law, state)
    if result is None:
        point = first_largest(state.point_pressures)
        facet, where = int(state.facet[point]), state.positions[point]
        value, resolved = float(state.point_pressures.max()), True
    else:
        facet = first_largest(result.values)
        value, resolved = float(result.values.max()), result.all_resolved
        where = _place_of_peak(deformable, result, facet)
    pair = int(state.block_m[facet]), int(state.block_s[facet])
    return Peak(value, pair, where, _nearest_face(deformable, pair[0], where), resolved)


def _matched_peaks(law: ContactLaw, state: ContactState) -> FacetPeaks | None:
    """Largest pressure of each matched facet; None where a search found the facets."""
    looks = state.corner_overclosures
    if looks is None:
        return None
    law = law.on(state.block_m, state.block_s)
    return facet_peaks(law, looks, state.point_overclosures.reshape(len(looks), -1))


def _place_of_peak(deformable: System, found: FacetPeaks, facet: int) -> FloatArray:
    """Where the largest pressure of a facet is, before the load acts, (3,) [mm]."""
    surfaces = deformable.surfaces
    block, basis = int(surfaces.block_m[facet]), surfaces.basis
    nodes = deformable.assembly.nodes(block)[surfaces.quads_m[facet]]
    at_edge = bool(found.resolved[facet])
    functions = basis.looks[found.look[facet]] if at_edge else basis.values[found.point[facet]]
    where: FloatArray = functions @ nodes + deformable.offsets[block]
    return where


def pressure_between_nodes(deformable: System, law: ContactLaw, state: ContactState) -> float:
    """What the largest pressure may change between the nodes of its facet [MPa].

    A law of stiffness k [MPa/mm] between bodies of plane strain moduli E' lets pressures change
    over a length of ℓ = E'/k, not over less. So polynomials through nodes a distance d apart may
    miss (d/ℓ)² of a peak, of that part of it that is no uniform pressure; `_OF_A_PEAK` times that
    is the estimate, which counts up to `_MOST_OF_A_PEAK`. Zero where a search found the facets.
    """
    found = _matched_peaks(law, state)
    if found is None or not state.n_facets:
        return 0.0
    facet = first_largest(found.values)
    assert state.corner_overclosures is not None
    looks = state.corner_overclosures[facet]
    pair = int(state.block_m[facet]), int(state.block_s[facet])
    of_pair = law.on(state.block_m, state.block_s).one(facet)
    materials = [deformable.body_of(b).material for b in pair if deformable.group_of[b] >= 0]
    gives = sum((1.0 - m.poisson_ratio**2) / m.young_modulus for m in materials)
    length = 1.0 / (gives * float(of_pair.stiffness(looks.max())))
    distance = _node_distance(deformable, found, facet) / length
    steep = float(found.values[facet] - of_pair.pressure(looks.min()))
    return min(_OF_A_PEAK * distance**2, _MOST_OF_A_PEAK) * max(steep, 0.0)


def _node_distance(deformable: System, found: FacetPeaks, facet: int) -> float:
    """Largest distance of neighbouring nodes at the peak of a facet [mm]."""
    surfaces = deformable.surfaces
    block = int(surfaces.block_m[facet])
    nodes = deformable.assembly.nodes(block)[surfaces.quads_m[facet]]
    n = math.isqrt(len(nodes))
    if n == 2:  # corners go round
        nodes = nodes[[0, 3, 1, 2]]
    where = _place_of_peak(deformable, found, facet) - deformable.offsets[block]
    nearest = int(np.linalg.norm(nodes - where, axis=1).argmin())
    grid = nodes.reshape(n, n, 3)
    largest = 0.0
    for line, k in zip((grid[:, nearest % n], grid[nearest // n]), divmod(nearest, n), strict=True):
        steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
        largest = max(largest, float(steps[max(0, k - 1) : k + 1].max()))
    return largest


def mean_of_block_maxima(deformable: System, law: ContactLaw, state: ContactState) -> float:
    """Mean over free blocks of their largest pressure at a corner of a facet [MPa].

    The limit of the same mean over facets as these shrink; that of integration points where these
    do not resolve the pressure at corners, or where a search found facets.
    """
    result = _matched_peaks(law, state)
    if result is None:
        pressure = np.zeros(state.n_facets)
        np.maximum.at(pressure, state.facet, state.point_pressures)
    else:
        pressure = result.values
    assembly = deformable.assembly
    largest = np.zeros(assembly.n_blocks)
    for block in (state.block_m, state.block_s):
        np.maximum.at(largest, assembly.originals[block], pressure)
    return float(largest[assembly.free_blocks].mean())


def largest_displacement(deformable: System, displacements: tuple[FloatArray, ...]) -> Peak:
    """Node that moves most, and by how much [mm]."""
    blocks = deformable.deformable_blocks.tolist()
    sizes = [
        np.linalg.norm(displacements[deformable.group_of[b]][deformable.copy_of[b]], axis=1)
        for b in blocks
    ]
    largest = np.array([size.max() for size in sizes])
    first, value = first_largest(largest), float(largest.max())
    block, node = blocks[first], first_largest(sizes[first])
    where = deformable.assembly.nodes(block)[node] + deformable.offsets[block]
    return Peak(value, (block,), where, _nearest_face(deformable, block, where))


@dataclass(frozen=True)
class StressPeaks:
    """Largest and least principal stresses of an assembly."""

    sigma_1: Peak
    """Largest first principal stress at an integration point."""
    sigma_3: Peak
    """Least third principal stress there."""
    mises: Peak
    """Largest von Mises stress there."""
    sigma_1_averaged: Peak
    """Largest first principal stress of the stress averaged over a ball; the ball's centre."""
    averaging_radius: float
    """Radius of that ball [mm]."""
    sigma_1_at_corners: float
    """Largest first principal stress at a corner of an element, continued from its own integration
    points: what those may hide [MPa]."""
    sigma_3_at_corners: float
    """Least third principal stress there [MPa]."""
    mises_at_corners: float
    """Largest von Mises stress there [MPa]."""


def stress_peaks(
    deformable: System,
    displacements: tuple[FloatArray, ...],
    *,
    averaging_radius: float | None = None,
    finite_rotation: bool = False,
    representative: IntArray | None = None,
) -> StressPeaks:
    """Sample the stresses inside all elements.

    Parameters
    ----------
    deformable
        Blocks, supports, material.
    displacements
        Of each group, world axes, (n_copies, n_nodes, 3) [mm].
    averaging_radius
        Radius of the ball over which stresses are averaged [mm]; None: that of each material.
    finite_rotation
        Whether the rigid rotation of each block is removed first.
    representative
        Block that stands for each block, (n_blocks,), where a symmetry is known.
    """
    result = []
    for blocks, moved in moved_blocks(
        deformable, displacements, finite_rotation=finite_rotation, representative=representative
    ):
        group = deformable.body_of(int(blocks[0]))
        radius = group.material.averaging_radius if averaging_radius is None else averaging_radius
        result.append(_group_peaks(deformable, blocks, moved, radius))
    averaged = result[first_largest(np.array([f.sigma_1_averaged.value for f in result]))]
    return StressPeaks(
        sigma_1=_largest([f.sigma_1 for f in result]),
        sigma_3=_largest([f.sigma_3 for f in result], -1.0),
        mises=_largest([f.mises for f in result]),
        sigma_1_averaged=averaged.sigma_1_averaged,
        averaging_radius=averaged.averaging_radius,
        sigma_1_at_corners=max(f.sigma_1_at_corners for f in result),
        sigma_3_at_corners=min(f.sigma_3_at_corners for f in result),
        mises_at_corners=max(f.mises_at_corners for f in result),
    )


def moved_blocks(
    deformable: System,
    displacements: tuple[FloatArray, ...],
    *,
    finite_rotation: bool,
    representative: IntArray | None,
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Blocks of each group, (n,), and how they moved in their frames, (n, n_nodes, 3) [mm].

    Parameters are those of `stress_peaks`.
    """
    chosen = deformable.deformable_blocks
    chosen = chosen if representative is None else np.unique(representative[chosen])
    for number, (group, u) in enumerate(zip(deformable.bodies, displacements, strict=True)):
        local, _ = block_displacements(group, u, finite_rotation=finite_rotation)
        blocks = chosen[deformable.group_of[chosen] == number]
        yield blocks, local[deformable.copy_of[blocks]]


def _largest(peaks: list[Peak], sign: float = 1.0) -> Peak:
    values = sign * np.array([peak.value for peak in peaks])
    return replace(peaks[first_largest(values)], value=sign * float(values.max()))


def _group_peaks(
    deformable: System, blocks: IntArray, local: FloatArray, radius: float
) -> StressPeaks:
    """Of blocks of one group, from displacements in their frames (n_blocks, n_nodes, 3) [mm]."""
    group = deformable.body_of(int(blocks[0]))
    linear, stress = group.element.degree == 1, group.point_stress(local)
    points = integration_points(group.mesh, group.element)
    per_element = len(points) // group.mesh.n_elements

    def placed(value: float, copy: int, where: FloatArray, element: int | None = None) -> Peak:
        block, face = int(blocks[copy]), None
        if element is not None:
            face = _element_face(deformable, block, element, where)
        world = deformable.assembly.place(block, where[None])[0] + deformable.offsets[block]
        return Peak(value, (block,), world, face)

    def peak(values: FloatArray, at: FloatArray, sign: float = 1.0) -> Peak:
        copy, row = (int(k) for k in np.unravel_index(first_largest(values), values.shape))
        element = row // per_element if linear and at is points else None
        return placed(sign * float(values.max()), copy, at[row], element)

    first = peak(largest_tension(stress), points)
    third = peak(largest_tension(-stress), points, -1.0)
    mises = peak(np.sqrt(3.0 * invariants(stress)[1]), points)
    if linear:
        balls = ball_averages(group, points, radius)
        averaged = peak(largest_tension(balls.averaged(stress)), balls.centres)
        at_corners = _corner_extremes(group, stress)
    else:  # points hide nothing towards corners, where polynomials overshoot
        of_ball, at_cells = averaged_tension(moved_bodies(group, local), radius)
        averaged = placed(of_ball.value, of_ball.layer - 1, of_ball.position)
        if first.value < averaged.value:  # of a large element they are far from its ends
            first = placed(at_cells.value, at_cells.layer - 1, at_cells.position)
        at_corners = first.value, third.value, mises.value
    return StressPeaks(first, third, mises, averaged, radius, *at_corners)


def _corner_extremes(group: Body, stress: FloatArray) -> tuple[float, float, float]:
    """Largest σ₁, least σ₃ and largest von Mises stress at corners of elements.

    Of those elements that hold half of the extreme inside.
    """
    stress = stress.reshape(-1, len(group.element.points), 6)
    values = principal_stress(stress)
    first, third = values[:, :, 0].max(axis=1), values[:, :, 2].min(axis=1)
    mises = von_mises(values).max(axis=1)
    high = stress[first >= first.max() - 0.5 * abs(first.max())]
    low = stress[third <= third.min() + 0.5 * abs(third.min())]

    def corners(inside: FloatArray) -> FloatArray:
        return principal_stress(at_corners(inside))

    return (
        float(corners(high)[:, :, 0].max()),
        float(corners(low)[:, :, 2].min()),
        float(von_mises(corners(stress[mises >= 0.5 * mises.max()])).max()),
    )


# ---------------------------------------------------------------------------------------------
# Places


def _element_face(deformable: System, block: int, element: int, at: FloatArray) -> str | None:
    """Named face nearest to a point among those that its element lies on."""
    shape = deformable.assembly.shape(block)
    own = np.sort(shape.mesh.elements[element][HEX_FACES], axis=1)
    best: tuple[float, str | None] = (np.inf, None)
    for name, quads in shape.faces.items():
        sides = (np.sort(quads, axis=1)[:, None] == own[None]).all(axis=2)
        for quad in quads[sides.any(axis=1)]:
            distance = float(np.linalg.norm(shape.mesh.nodes[quad].mean(axis=0) - at))
            best = min(best, (distance, name), key=lambda pair: pair[0])
    return best[1]


def _nearest_face(deformable: System, block: int, where: FloatArray) -> str | None:
    """Named face with the facet nearest to a point; contact faces first where two meet."""
    assembly = deformable.assembly
    shape = assembly.shape(block)
    nodes = assembly.nodes(block) + deformable.offsets[block]
    names = [*shape.contact_faces, *(n for n in shape.faces if n not in shape.contact_faces)]
    distances = {
        name: float(np.linalg.norm(nodes[np.unique(shape.faces[name])] - where, axis=1).min())
        for name in names
    }
    return min(distances, key=lambda name: distances[name], default=None)


# ---------------------------------------------------------------------------------------------
# Joints


def joint_forces(state: ContactState) -> JointResultants:
    """Resultants of every pair of blocks in contact, on the higher one, friction included."""
    low, high = np.minimum(state.block_m, state.block_s), np.maximum(state.block_m, state.block_s)
    onwards = np.where(state.block_m == low, 1.0, -1.0)[state.facet, None]
    pairs = np.column_stack([low, high])[state.facet]
    result = summed_by_joint(
        pairs,
        points=state.positions,
        normals=onwards * state.normals,
        areas=state.point_areas,
        forces=onwards * state.point_forces,
    )
    _, of_facet = np.unique(low * (high.max(initial=0) + 1) + high, return_inverse=True)
    joint = of_facet[state.facet]

    def largest(values: FloatArray) -> FloatArray:
        most = np.full(len(result.block_m), -np.inf)
        np.maximum.at(most, joint, values)
        return most

    on_m, on_s = np.moveaxis(state.point_moments, 1, 0)
    both = np.hstack([0.5 * onwards * (on_s - on_m), 0.5 * (on_m + on_s)])
    count = len(result.block_m)
    sums = np.stack([np.bincount(joint, v, minlength=count) for v in both.T], axis=1)
    return replace(
        result,
        moments=result.moments + sums[:, :3],
        couples=sums[:, 3:],
        smallest_gap=-largest(state.point_overclosures),
        largest_gap=largest(-state.point_overclosures),
        largest_slip=largest(np.linalg.norm(state.point_slips, axis=1)),
    )
