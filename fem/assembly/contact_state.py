"""Contact of a deformed assembly: which facets press on which blocks, where and how hard."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.assembly.deformable import DeformableAssembly
from fem.contact.law import ContactLaw
from fem.contact.search import FacingPoints, closest_points
from fem.contact.searched import SearchedSurfaces
from fem.contact.surfaces import (
    ContactSurfaces,
    corner_overclosures,
    facet_corners,
    point_kinematics,
    point_normals,
)
from fem.element.facet import bilinear
from geometry.mesh import FloatArray, IntArray

#: Least share of a facet that counts as facing a block.
_SLIVER = 1e-3


@dataclass(frozen=True)
class ContactState:
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
    corner_overclosures: FloatArray | None = None
    """Where matched facets are looked at for peaks, at corners of bilinear ones, (n_facets, n)
    [mm]; None where a search found them."""
    position_s: IntArray | None = None
    """Where a search found them: position of each in the contact facets of block s, (n_facets,)."""

    @property
    def n_facets(self) -> int:
        """Number of facets."""
        return len(self.block_m)

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
        """Normal force of each point on block s, (n_points, 3) [N]."""
        return (self.point_areas * self.point_pressures)[:, None] * self.normals

    @cached_property
    def forces(self) -> FloatArray:
        """Normal force of each facet on block s, (n_facets, 3) [N]."""
        return self._of_facets(self.point_forces)

    @cached_property
    def mean_normals(self) -> FloatArray:
        """Normals from m to s, weighted by area, unit length, (n_facets, 3)."""
        mean = self._of_facets(self.point_areas[:, None] * self.normals)
        return mean / np.linalg.norm(mean, axis=1, keepdims=True)

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
    found = point_kinematics(deformable.surfaces, corners, deformable.contact.normals)
    return deformable.contact.law.pressure(found.overclosure), found.overclosure


def matched_state(
    deformable: DeformableAssembly,
    displacements: tuple[FloatArray, ...],
    pressures: FloatArray,
    overclosures: FloatArray,
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
    """
    surfaces, basis = deformable.surfaces, deformable.surfaces.basis
    moved = corner_displacements(deformable, displacements)
    on_m, on_s = np.split(moved, 2, axis=1)
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
        corner_overclosures=corner_overclosures(surfaces, moved, deformable.contact.normals),
    )


def searched_state(points: FacingPoints, law: ContactLaw, clearance: float) -> ContactState:
    """Contact of all points that a search found to face a facet.

    Facets are those of the finer of two surfaces, one entry for each block that a facet faces,
    with the part of its area that faces it; less than a thousandth of a facet is left out, for
    facets are counted.

    Parameters
    ----------
    points
        At their present positions.
    law
        Contact law.
    clearance
        Added to every gap [mm].
    """
    master, slave, position = points.facet, points.slave, points.place()
    _, gap, normal = closest_points(points.position[points.quads[master]], position, points.xi)
    key = np.column_stack([points.facet_block[master], points.facet_block[slave], slave])
    _, which = np.unique(key, axis=0, return_inverse=True)
    area = np.bincount(which.ravel(), points.weights)
    mean = np.bincount(which.ravel(), points.weights * gap) / area
    near = mean[which.ravel()] <= points.farthest
    near &= area[which.ravel()] > _SLIVER * points.facet_area[slave]
    master, slave = master[near], slave[near]
    position, gap, normal = position[near], gap[near], normal[near]
    overclosure = -gap - clearance
    key = np.column_stack([points.facet_block[master], points.facet_block[slave], slave])
    entries, which = np.unique(key, axis=0, return_inverse=True)
    which = which.ravel()
    return ContactState(
        block_m=entries[:, 0],
        block_s=entries[:, 1],
        interface=None,
        corners=_faced_parts(points, entries[:, 2], which, points.cells[near]),
        facet=which,
        positions=position,
        normals=normal,
        point_areas=points.weights[near],
        point_pressures=law.pressure(overclosure),
        point_overclosures=overclosure,
        position_s=points.facet_position[entries[:, 2]],
    )


def _faced_parts(
    points: FacingPoints, facets: IntArray, which: IntArray, cells: FloatArray
) -> FloatArray:
    """Corners of the part of each facet on which its points lie, (n_facets, 4, 3) [mm]."""
    low, high = np.full((len(facets), 2), 1.0), np.full((len(facets), 2), -1.0)
    np.minimum.at(low, which, cells[:, 0])
    np.maximum.at(high, which, cells[:, 1])
    xi = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high], axis=1)
    xi = np.concatenate([xi, np.stack([low[:, 0], high[:, 1]], 1)[:, None]], axis=1)
    corners = points.position[points.quads[facets]]
    return np.einsum("fpa,fai->fpi", bilinear(xi)[0], corners)
