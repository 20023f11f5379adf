"""Contact of a deformed assembly: which facets press on which blocks, where and how hard.

Measures of the pressures are by the paper's definitions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fem.assembly.deformable import Contact, DeformableAssembly
from fem.assembly.symmetry import Orbits
from fem.contact.law import ContactLaw, ExponentialLaw
from fem.contact.search import BlockSurface, FacingPoints, SearchedSurfaces
from fem.contact.surfaces import (
    ContactNormals,
    ContactSurfaces,
    corner_overclosures,
    facet_corners,
    point_kinematics,
    point_normals,
)
from fem.element.facet import facet_areas, facet_functions
from fem.element.lagrange_mesh import LagrangeMesh
from geometry.assembly import Assembly
from geometry.measures import BlockMeasures, block_measures, measures
from geometry.mesh import BoolArray, FloatArray, IntArray, ReadOnlyArrays, structured_quads


def block_surfaces(
    deformable: DeformableAssembly, orbits: Orbits | None = None, copy_of: IntArray | None = None
) -> tuple[BlockSurface, ...]:
    """Collect the facets of all blocks that can touch others, in the order of their groups.

    Parameters
    ----------
    deformable
        Blocks where they stand before any displacement.
    orbits
        Blocks that are computed once; None: every block is computed.
    copy_of
        Copy of its group that moves as each block does, (n_blocks,); None: those of ``deformable``.
    """
    assembly = deformable.assembly
    copies = deformable.copy_of if copy_of is None else copy_of
    turns = _turns(deformable, orbits)
    result = []
    for block in range(assembly.n_blocks):
        if len(assembly.shape(block).contact_quads):
            surface = block_surface(assembly, block, deformable.offsets[block])
            result.append(
                replace(
                    surface,
                    group=int(deformable.group_of[block]),
                    copy=int(max(copies[block], 0)),
                    stands=block if orbits is None else int(orbits.representative[block]),
                    turn=int(turns[block]),
                )
            )
    return tuple(sorted(result, key=lambda surface: surface.group))


def block_surface(assembly: Assembly, block: int, offset: FloatArray) -> BlockSurface:
    """Facets of one block that can touch others, moved by an offset (3,) [mm]; it moves alone."""
    mesh, quads = assembly.shape(block).mesh, assembly.shape(block).contact_quads
    facets = None
    if isinstance(mesh, LagrangeMesh):
        facets = mesh.facet_nodes(quads)
        quads = facets[:, structured_quads(mesh.degree)].reshape(-1, 4)
    nodes, origin = np.unique(quads), assembly.centroids.mean(axis=0)
    shift = assembly.translations[block] + offset - origin
    return BlockSurface(
        block=block,
        group=0,
        copy=block,
        rotation=assembly.rotations[block],
        nodes=nodes,
        reference=mesh.nodes[nodes] @ assembly.rotations[block].T + shift,
        quads=np.searchsorted(nodes, quads),
        facets=None if facets is None else np.searchsorted(nodes, facets),
        stands=block,
        origin=origin,
    )


def _turns(deformable: DeformableAssembly, orbits: Orbits | None) -> IntArray:
    """By how many angles of the sector each block is turned from the one that stands for it."""
    assembly = deformable.assembly
    if orbits is None or orbits.order == 1:
        return np.zeros(assembly.n_blocks, dtype=np.int64)
    relative = assembly.rotations @ np.swapaxes(assembly.rotations[orbits.representative], 1, 2)
    twice_sine = relative - np.swapaxes(relative, 1, 2)
    axis = np.stack([twice_sine[:, 2, 1], twice_sine[:, 0, 2], twice_sine[:, 1, 0]], axis=1)
    sine = 0.5 * axis @ assembly.axis
    cosine = 0.5 * (np.trace(relative, axis1=1, axis2=2) - 1.0)
    angle: FloatArray = np.arctan2(sine, cosine) * orbits.order / (2.0 * np.pi)
    return np.rint(angle).astype(np.int64) % orbits.order


def facing_points(
    deformable: DeformableAssembly,
    displacements: tuple[FloatArray, ...] | None = None,
    orbits: Orbits | None = None,
) -> FacingPoints:
    """Find what faces what in an assembly.

    Parameters
    ----------
    deformable
        Blocks and contact law.
    displacements
        Of its groups, world axes, (n_copies, n_nodes, 3) [mm]; None: before any displacement.
    orbits
        Points are those of one block of each orbit; None: of all blocks.
    """
    reach = -deformable.contact.law.start - deformable.surfaces.clearance
    order = 1 if orbits is None else orbits.order
    points = FacingPoints(block_surfaces(deformable, orbits), reach=reach, symmetry=order)
    if displacements is not None:
        points.displace(displacements)
        points.search()
    return points


#: Least share of a facet that counts as facing a block.
_SLIVER = 1e-3


#: Slip of matched facets, in blocks, from which moments of second order are counted: 1e-8 before.
_SLID = 1e-4


@dataclass(frozen=True)
class ContactState(ReadOnlyArrays):
    """Contact of an assembly at given displacements, whether facets match or a search found them.

    Facets have points of integration, any number each.
    """

    block_m: IntArray
    """Block that the facet presses on (the master), (n_facets,)."""
    block_s: IntArray
    """Block whose facet it is in a search, the opposing one of matched facets; (n_facets,)."""
    interface: IntArray | None
    """Position of each facet in the assembly's interfaces; None where a search found them."""
    corners: FloatArray
    """Where the facet, or the part of it that faces the master, is now; (n_facets, 4, 3) [mm]."""
    facet: IntArray
    """Facet of each point, (n_points,)."""
    positions: FloatArray
    """Of the points now, world axes, (n_points, 3) [mm]."""
    normals: FloatArray
    """From m to s, (n_points, 3)."""
    point_areas: FloatArray
    """(n_points,) [mm²]"""
    point_pressures: FloatArray
    """(n_points,) [MPa]"""
    point_overclosures: FloatArray
    """(n_points,) [mm]"""
    point_slips: FloatArray
    """Displacement of block s along the facet, relative to block m, world axes, (n_points, 3) [mm]:
    of points that coincided as built, or in a search of the points that face each other now."""
    point_frictions: FloatArray | None = None
    """Friction on block s, world axes, (n_points, 3) [MPa]; None without friction."""
    point_moments: FloatArray | None = None
    """Moment on blocks m and s about `positions` beside that of `point_forces`, (n_points, 2, 3)
    [N mm]: forces act on both sides of a gap. None where it is none, without friction and with
    current normals, until facets have slid far."""
    corner_overclosures: FloatArray | None = None
    """Where matched facets are looked at for peaks, at corners of bilinear ones, (n_facets, n)
    [mm]; None where a search found them."""
    position_s: IntArray | None = None
    """Where a search found them: position of each in the contact facets of block s, (n_facets,)."""

    @property
    def n_facets(self) -> int:
        """Number of facets."""
        return len(self.block_m)

    @property
    def matched(self) -> IntArray:
        """Position of each facet in the assembly's interfaces, (n_facets,)."""
        if self.interface is None:
            raise ValueError("contact: facets that a search found are no interfaces")
        return self.interface

    @cached_property
    def areas(self) -> FloatArray:
        """Of the facets, as far as they face the master, (n_facets,) [mm²]."""
        areas = np.bincount(self.facet, self.point_areas, minlength=self.n_facets)
        return areas.astype(np.float64)

    @cached_property
    def pressures(self) -> FloatArray:
        """Force over area of each facet, (n_facets,) [MPa]."""
        force = self.point_areas * self.point_pressures
        return np.bincount(self.facet, force, minlength=self.n_facets) / self.areas

    @cached_property
    def point_forces(self) -> FloatArray:
        """Force of each point on block s, friction included, (n_points, 3) [N]."""
        traction = self.point_pressures[:, None] * self.normals
        if self.point_frictions is not None:
            traction += self.point_frictions
        return self.point_areas[:, None] * traction

    @cached_property
    def forces(self) -> FloatArray:
        """Force of each facet on block s, friction included, (n_facets, 3) [N]."""
        return self._of_facets(self.point_forces)

    @cached_property
    def mean_normals(self) -> FloatArray:
        """Normals from m to s, weighted by area, unit length, (n_facets, 3)."""
        mean = self._of_facets(self.point_areas[:, None] * self.normals)
        return mean / np.linalg.norm(mean, axis=1, keepdims=True)

    @cached_property
    def slips(self) -> FloatArray:
        """Slips of the points, weighted by area, (n_facets, 3) [mm]."""
        return self._of_facets(self.point_areas[:, None] * self.point_slips) / self.areas[:, None]

    def _of_facets(self, values: FloatArray) -> FloatArray:
        """Sum of the values of the points of each facet, (n_facets, 3)."""
        columns = [np.bincount(self.facet, column, minlength=self.n_facets) for column in values.T]
        return np.stack(columns, axis=1)

    @cached_property
    def deepest(self) -> FloatArray:
        """Largest overclosure of each facet, (n_facets,) [mm]."""
        deepest = np.full(self.n_facets, -np.inf)
        np.maximum.at(deepest, self.facet, self.point_overclosures)
        return deepest

    @cached_property
    def centroids(self) -> FloatArray:
        """Means of the corners, (n_facets, 3) [mm]."""
        return self.corners.mean(axis=1)

    def joint(self, m: int, s: int) -> IntArray:
        """Points between two blocks, either of which may be the master."""
        pair = (self.block_m == m) & (self.block_s == s)
        pair |= (self.block_m == s) & (self.block_s == m)
        return np.flatnonzero(pair[self.facet])


def corner_displacements(
    deformable: DeformableAssembly,
    displacements: tuple[FloatArray, ...],
    surfaces: ContactSurfaces | SearchedSurfaces | None = None,
) -> FloatArray:
    """World displacements of the nodes of every facet pair, m's first.

    Parameters
    ----------
    deformable
        Blocks and surfaces; rigid blocks do not move.
    displacements
        Of each group, (n_copies, n_nodes, 3) [mm], world axes.
    surfaces
        Facets; None: the matched ones.

    Returns
    -------
    FloatArray
        (n_facets, nodes of both, 3) [mm].
    """
    surfaces = deformable.surfaces if surfaces is None else surfaces
    per_side = surfaces.quads_m.shape[1]
    moved = np.zeros((surfaces.n_facets, 2 * per_side, 3))
    for half, (block, quads) in enumerate(
        ((surfaces.block_m, surfaces.quads_m), (surfaces.block_s, surfaces.quads_s))
    ):
        corners = slice(per_side * half, per_side * (half + 1))
        for group, u in enumerate(displacements):
            rows: IntArray = np.flatnonzero(deformable.group_of[block] == group)
            copies = deformable.copy_of[block[rows]]
            moved[rows, corners] = u[copies[:, None], quads[rows]]
    return moved


def matched_pressures(
    deformable: DeformableAssembly, displacements: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray]:
    """Contact pressures and overclosures of a displacement on matched facets.

    Returns
    -------
    FloatArray
        Pressures at the points of `DeformableAssembly.surfaces`, (n_facets, n_points) [MPa].
    FloatArray
        Overclosures, alike [mm].
    """
    corners = corner_displacements(deformable, displacements)
    result = point_kinematics(deformable.surfaces, corners, deformable.contact.normals)
    law = deformable.contact.law.on(deformable.surfaces.block_m, deformable.surfaces.block_s)
    return law.pressure(result.overclosure), result.overclosure


def matched_state(
    deformable: DeformableAssembly,
    displacements: tuple[FloatArray, ...],
    pressures: FloatArray,
    overclosures: FloatArray,
    frictions: FloatArray | None = None,
) -> ContactState:
    """Contact of matched facets.

    Parameters
    ----------
    deformable
        Blocks and surfaces.
    displacements
        Of each group, world axes, (n_copies, n_nodes, 3) [mm].
    pressures, overclosures
        At the points of its surfaces, (n_facets, n_points) [MPa] and [mm].
    frictions
        Friction on block s there, (n_facets, n_points, 3) [MPa]; None: without.
    """
    surfaces, basis = deformable.surfaces, deformable.surfaces.basis
    moved = corner_displacements(deformable, displacements)
    on_m, on_s = np.split(moved, 2, axis=1)
    apart = surfaces.offsets + basis.difference @ moved
    sides = (
        (surfaces.block_m, surfaces.quads_m, on_m),
        (surfaces.block_s, surfaces.quads_s, on_s),
    )
    nodes, opposite = (
        facet_corners(deformable.assembly, block, quads)
        + deformable.offsets[block][:, None]
        + displacement
        for block, quads, displacement in sides
    )
    middle = np.einsum("pa,fai->fpi", basis.values, 0.5 * (nodes + opposite))
    normals = point_normals(surfaces, moved, deformable.contact.normals)
    each, measured = surfaces.weights[..., None], deformable.contact.normals
    moments = _moments(each, apart, pressures[..., None], normals, frictions, measured)
    far = float(np.abs(apart).max(initial=0.0)) > _SLID * deformable.assembly.characteristic_length
    if far and measured is ContactNormals.CURRENT:
        on_m, on_s = (basis.tangents(x) for x in (nodes, opposite))
        turning = _turning_moments(surfaces.weights * pressures, _along(apart, normals), on_m, on_s)
        moments = turning if moments is None else moments + turning
    return ContactState(
        block_m=surfaces.block_m,
        block_s=surfaces.block_s,
        interface=surfaces.facet,
        corners=nodes[:, basis.corners],
        facet=np.repeat(np.arange(surfaces.n_facets), basis.n_points),
        positions=middle.reshape(-1, 3),
        normals=normals.reshape(-1, 3),
        point_areas=surfaces.weights.ravel(),
        point_pressures=pressures.ravel(),
        point_overclosures=overclosures.ravel(),
        point_slips=_along(basis.difference @ moved, normals).reshape(-1, 3),
        point_frictions=None if frictions is None else frictions.reshape(-1, 3),
        point_moments=None if moments is None else moments.reshape(-1, 2, 3),
        corner_overclosures=corner_overclosures(surfaces, moved, deformable.contact.normals),
    )


def _moments(  # noqa: PLR0917
    weights: FloatArray,
    apart: FloatArray,
    pressures: FloatArray,
    normals: FloatArray,
    frictions: FloatArray | None,
    measured: ContactNormals,
) -> FloatArray | None:
    """Moments of forces on both sides of a gap about its middle, x_s - x_m apart, (..., 2, 3).

    Pressures along current normals act along the gap, or half way across it: only friction counts.
    """
    acting = frictions
    if measured is ContactNormals.REFERENCE:
        acting = pressures * normals + (0.0 if frictions is None else frictions)
    if acting is None:
        return None
    return np.repeat(0.5 * np.cross(apart, weights * acting)[..., None, :], 2, axis=-2)


def _turning_moments(
    forces: FloatArray, slips: FloatArray, on_m: FloatArray, on_s: FloatArray
) -> FloatArray:
    """Moments of what turns the mean normal of matched facets, (n_facets, n_points, 2, 3) [N mm].

    The force of a point p on the tangents of both sides is -p/2 ∂x/∂t_k, with t_k their mean. The
    moments of both sides are opposite, and of second order: by the slip and the tilt between them.
    From w p (n, p) [N], slips (n, p, 3) [mm] and tangents of both sides, (n, p, 2, 3) [mm].
    """
    first, second = np.moveaxis(0.5 * (on_m + on_s), 2, 0)
    lean = slips / np.linalg.norm(np.cross(first, second), axis=2, keepdims=True)
    by = np.stack([np.cross(lean, second), np.cross(first, lean)], axis=2)
    half = -0.25 * forces[..., None] * np.cross(on_s - on_m, by).sum(axis=2)
    return np.stack([-half, half], axis=2)


def searched_state(
    surfaces: SearchedSurfaces,
    moved: FloatArray,
    contact: Contact | None,
    frictions: FloatArray | None = None,
) -> ContactState:
    """Contact of the points of a search.

    Facets are those of the finer of two surfaces, one entry for each block that a facet faces,
    with the part of its area that faces it. Where no point of it presses, an entry far away and one
    of less than a thousandth of its facet is left out: facets are counted. Such a sliver that
    presses belongs to the nearest facet of its joint.

    Parameters
    ----------
    surfaces
        The points.
    moved
        Displacements of the nodes of both facets, (n_points, nodes of both, 3) [mm], world axes.
    contact
        Law and normals; None: nothing presses.
    frictions
        Friction on block s, (n_points, 3) [MPa]; None: without.
    """
    normals = ContactNormals.CURRENT if contact is None else contact.normals
    there = surfaces.kinematics(moved, normals)
    overclosure, weights = there.overclosure[:, 0], surfaces.weights[:, 0]
    pressure = np.zeros_like(overclosure)
    if contact is not None:
        law = contact.law.on(surfaces.block_m, surfaces.block_s)
        pressure = law.pressure(there.overclosure)[:, 0]
    key = np.column_stack([surfaces.block_m, surfaces.block_s, surfaces.position_s])
    _, first, which = np.unique(key, axis=0, return_index=True, return_inverse=True)
    which = which.ravel()
    area = np.bincount(which, weights)
    mean = -np.bincount(which, weights * overclosure) / area - surfaces.clearance
    presses = np.bincount(which, pressure > 0.0) > 0.0
    whole = area > _SLIVER * surfaces.facet_areas[first]
    near = (((mean <= surfaces.farthest) & whole) | presses)[which]
    n_nodes, kept = surfaces.shapes.shape[1], surfaces.subset(np.flatnonzero(near))
    nodes = (kept.corners + moved[near])[:, n_nodes:]
    apart = np.einsum("na,nai->ni", kept.difference[:, 0], kept.corners + moved[near])
    positions = np.einsum("na,nai->ni", kept.shapes, nodes) - 0.5 * apart
    nodes, positions = nodes + kept.origin, positions + kept.origin
    direction = -there.gradient[near, 0, n_nodes:].sum(axis=1)
    frictions = None if frictions is None else frictions[near]
    acting = pressure[near, None], direction, frictions
    key, part = _with_slivers(key[near], positions, whole[which][near])
    entries, which = np.unique(key, axis=0, return_inverse=True)
    own = np.flatnonzero(part)
    first = own[np.unique(which.ravel()[own], return_index=True)[1]]
    return ContactState(
        block_m=entries[:, 0],
        block_s=entries[:, 1],
        interface=None,
        corners=_faced_parts(nodes[first], which.ravel()[own], kept.cells[own]),
        facet=which.ravel(),
        positions=positions,
        normals=direction,
        point_areas=weights[near],
        point_pressures=pressure[near],
        point_overclosures=overclosure[near],
        point_slips=_searched_slips(kept),
        point_frictions=frictions,
        point_moments=_moments(weights[near, None], apart, *acting, normals),
        position_s=entries[:, 2],
    )


def _with_slivers(
    key: IntArray, positions: FloatArray, whole: BoolArray
) -> tuple[IntArray, BoolArray]:
    """Give each point of a sliver to the nearest facet of its joint, if that has another one.

    From blocks m and s and the facet of each point (n, 3), where it is (n, 3) [mm] and whether its
    part of the facet is none (n,): the same key, and whether a point is on the facet of its key.
    """
    key, own = key.copy(), np.ones(len(key), dtype=np.bool_)
    for point in np.flatnonzero(~whole).tolist():
        others = np.flatnonzero(whole & (key[:, :2] == key[point, :2]).all(axis=1))
        if len(others):
            away = np.linalg.norm(positions[others] - positions[point], axis=1)
            key[point], own[point] = key[others[away.argmin()]], False
    return key, own


def _along(vectors: FloatArray, normals: FloatArray) -> FloatArray:
    """Parts of vectors in the planes of unit normals, (..., 3) each."""
    return vectors - np.einsum("...i,...i->...", vectors, normals)[..., None] * normals


def _searched_slips(surfaces: SearchedSurfaces) -> FloatArray:
    """How far the points that face each other now were apart along the facet, (n_points, 3) [mm].

    Positions before any displacement: a motion that two blocks share is no slip, however large.
    """
    n_nodes = surfaces.shapes.shape[1]
    apart = -np.einsum("na,nai->ni", surfaces.difference[:, 0], surfaces.corners)
    slopes = facet_functions(surfaces.xi, n_nodes)[1]
    tangents = np.einsum("nak,nai->nki", slopes, surfaces.corners[:, :n_nodes])
    normal = np.cross(tangents[:, 0], tangents[:, 1])
    return _along(apart, normal / np.linalg.norm(normal, axis=1, keepdims=True))


def _faced_parts(nodes: FloatArray, which: IntArray, cells: FloatArray) -> FloatArray:
    """Corners of the part of each facet on which its points lie, (n_facets, 4, 3) [mm].

    ``nodes`` are those of the facets, (n_facets, n_nodes, 3) [mm].
    """
    low, high = np.full((len(nodes), 2), 1.0), np.full((len(nodes), 2), -1.0)
    np.minimum.at(low, which, cells[:, 0])
    np.maximum.at(high, which, cells[:, 1])
    xi = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high], axis=1)
    xi = np.concatenate([xi, np.stack([low[:, 0], high[:, 1]], 1)[:, None]], axis=1)
    values = facet_functions(xi.reshape(-1, 2), nodes.shape[1])[0]
    values = values.reshape(len(nodes), 4, nodes.shape[1])
    return np.einsum("fpa,fai->fpi", values, nodes)


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


def contact_measures(assembly: Assembly, state: ContactState) -> ContactMeasures:
    """Measure the pressures of a static or explicit state.

    Facets that a search found are those of the finer of two surfaces; for either block as many
    could meet a neighbour as cover its contact faces.
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
        p_max=overall.p_max,
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


def cap_action(law: ContactLaw, pressures: FloatArray, areas: FloatArray) -> CapAction | None:
    """Where the cap of a law acted on points of pressures [MPa] and areas [mm²], (n,) each.

    None for a law without one, and where pairs of blocks have laws of their own.
    """
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
