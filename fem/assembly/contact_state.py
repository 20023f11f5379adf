"""Contact of a deformed assembly: which facets press on which blocks, where and how hard."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.assembly.deformable import DeformableAssembly
from fem.contact.surfaces import (
    corner_overclosures,
    facet_corners,
    point_kinematics,
    point_normals,
)
from fem.element.facet import FACET_VALUES
from geometry.mesh import FloatArray, IntArray


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
    """At the corners of matched facets, (n_facets, 4) [mm]; None where a search found them."""

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
        pressures: FloatArray = np.bincount(self.facet, force, minlength=self.n_facets) / self.areas
        return pressures

    @cached_property
    def point_forces(self) -> FloatArray:
        """Normal force of each point on block s, (n_points, 3) [N]."""
        forces: FloatArray = (self.point_areas * self.point_pressures)[:, None] * self.normals
        return forces

    @cached_property
    def forces(self) -> FloatArray:
        """Normal force of each facet on block s, (n_facets, 3) [N]."""
        return self._of_facets(self.point_forces)

    @cached_property
    def mean_normals(self) -> FloatArray:
        """Normals from m to s, weighted by area, unit length, (n_facets, 3)."""
        mean = self._of_facets(self.point_areas[:, None] * self.normals)
        normals: FloatArray = mean / np.linalg.norm(mean, axis=1, keepdims=True)
        return normals

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
        centroids: FloatArray = self.corners.mean(axis=1)
        return centroids

    def joint(self, m: int, s: int) -> IntArray:
        """Points between two blocks, either of which may be the master."""
        pair = (self.block_m == m) & (self.block_s == s)
        pair |= (self.block_m == s) & (self.block_s == m)
        return np.flatnonzero(pair[self.facet])


def corner_displacements(
    deformable: DeformableAssembly, displacements: tuple[FloatArray, ...]
) -> FloatArray:
    """World displacements of the eight corners of every facet pair, m's four first.

    Parameters
    ----------
    deformable
        Blocks and surfaces; rigid blocks do not move.
    displacements
        Of each group, (n_copies, n_nodes, 3) [mm], world axes.

    Returns
    -------
    FloatArray
        (n_facets, 8, 3) [mm].
    """
    surfaces = deformable.surfaces
    moved = np.zeros((surfaces.n_facets, 8, 3))
    for half, (block, quads) in enumerate(
        ((surfaces.block_m, surfaces.quads_m), (surfaces.block_s, surfaces.quads_s))
    ):
        corners = slice(4 * half, 4 * half + 4)
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
        Pressures at the points of `DeformableAssembly.surfaces`, (n_facets, 4) [MPa].
    FloatArray
        Overclosures, (n_facets, 4) [mm].
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
        At the points of its surfaces, (n_facets, 4) [MPa] and [mm].
    """
    surfaces = deformable.surfaces
    moved = corner_displacements(deformable, displacements)
    sides = (
        (surfaces.block_m, surfaces.quads_m, moved[:, :4]),
        (surfaces.block_s, surfaces.quads_s, moved[:, 4:]),
    )
    corners, opposite = (
        facet_corners(deformable.assembly, block, quads)
        + deformable.offsets[block][:, None]
        + displacement
        for block, quads, displacement in sides
    )
    middle = np.einsum("pa,fai->fpi", FACET_VALUES, 0.5 * (corners + opposite))
    normals = point_normals(surfaces, moved, deformable.contact.normals)
    return ContactState(
        block_m=surfaces.block_m,
        block_s=surfaces.block_s,
        interface=surfaces.facet,
        corners=corners,
        facet=np.repeat(np.arange(surfaces.n_facets), 4),
        positions=middle.reshape(-1, 3),
        normals=normals.reshape(-1, 3),
        point_areas=surfaces.weights.ravel(),
        point_pressures=pressures.ravel(),
        point_overclosures=overclosures.ravel(),
        corner_overclosures=corner_overclosures(surfaces, moved, deformable.contact.normals),
    )
