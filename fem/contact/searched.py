"""Contact points that a search found, as the static solver takes them: one point a facet.

The same quantities as `fem.contact.surfaces`, for points x_s = Σ N_a x_a of a slave facet that
face a master facet, whatever the meshes: gap = n · (x_s - x_m(ξ)), n normal to the master facet.
With *current* normals ξ is the closest point of the displaced facet, whose way does not change the
gap (d stands on the facet); with *reference* normals n and ξ stay as the search found them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from fem.contact.search import FacingPoints, closest_points
from fem.contact.surfaces import ContactNormals, PointKinematics, pair_start
from fem.element.facet import bilinear
from geometry.mesh import FloatArray, IntArray


@dataclass(frozen=True)
class SearchedSurfaces:
    """Points that face a facet, sorted by block pair; each is a facet with one point."""

    block_m: IntArray
    """Master block, (n,)."""
    block_s: IntArray
    """Block that the point lies on, (n,)."""
    quads_m: IntArray
    """Corner nodes of the faced facet in block m's mesh, (n, 4)."""
    quads_s: IntArray
    """Corner nodes of the point's facet in block s's mesh, (n, 4)."""
    corners: FloatArray
    """Of both facets before any displacement, m's first, world axes, (n, 8, 3) [mm]."""
    shapes: FloatArray
    """Shape functions of the point's facet there, (n, 4)."""
    xi: FloatArray
    """Natural coordinates of the closest point as the search found it, (n, 2)."""
    normals: FloatArray
    """From m to s as the search found them, (n, 1 point, 3)."""
    weights: FloatArray
    """Area that the point stands for, (n, 1 point) [mm²]."""
    order: IntArray
    """Position of each point in the search, (n,)."""
    clearance: float
    """Added to every gap [mm]."""

    @property
    def n_facets(self) -> int:
        """Number of points."""
        return len(self.block_m)

    @property
    def areas(self) -> FloatArray:
        """Area of each point, (n,) [mm²]."""
        return self.weights[:, 0]

    @cached_property
    def pair_start(self) -> IntArray:
        """First point of each block pair, and the total; (n_pairs + 1,)."""
        return pair_start(self.block_m, self.block_s)

    @cached_property
    def difference(self) -> FloatArray:
        """Corner weights of d = x_s - x_m, (n, 1 point, 8)."""
        return np.concatenate([-bilinear(self.xi)[0], self.shapes], axis=1)[:, None]

    @cached_property
    def tangents(self) -> FloatArray:
        """Orthonormal tangents of the normals, (n, 1 point, 2, 3)."""
        slopes = bilinear(self.xi)[1]
        first: FloatArray = np.einsum("na,nai->ni", slopes[:, :, 0], self.corners[:, :4])
        normal = self.normals[:, 0]
        first -= np.einsum("ni,ni->n", first, normal)[:, None] * normal
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        return np.stack([first, np.cross(normal, first)], axis=1)[:, None]

    def kinematics(
        self, corner_displacements: FloatArray, normals: ContactNormals
    ) -> PointKinematics:
        """Overclosures and their gradients at displaced corners (n, 8, 3) [mm], world axes."""
        corners: FloatArray = self.corners + corner_displacements
        if normals is ContactNormals.REFERENCE:
            d = np.einsum("npa,nai->npi", self.difference, corners)
            gap = np.einsum("npi,npi->np", self.normals, d)
            gradient = -np.einsum("npa,npi->npai", self.difference, self.normals)
            return PointKinematics(-gap - self.clearance, gradient)
        points = np.einsum("na,nai->ni", self.shapes, corners[:, 4:])
        xi, found, normal = closest_points(corners[:, :4], points, self.xi)
        difference = np.concatenate([-bilinear(xi)[0], self.shapes], axis=1)
        by_corner = -np.einsum("na,ni->nai", difference, normal)
        return PointKinematics((-found - self.clearance)[:, None], by_corner[:, None])

    def subset(self, points: IntArray) -> SearchedSurfaces:
        """Keep some points, in the order given."""
        each = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "clearance"}
        return replace(self, **{name: values[points] for name, values in each.items()})


def searched_surfaces(points: FacingPoints, clearance: float) -> SearchedSurfaces:
    """Points of a search at its present positions, as the static solver takes them."""
    master, slave = points.facet, points.slave
    sizes = [len(s.quads) for s in points.surfaces]
    nodes = np.concatenate([s.nodes for s in points.surfaces])
    reference = np.concatenate([s.reference for s in points.surfaces])
    blocks = np.repeat([s.block for s in points.surfaces], sizes)
    order = np.lexsort((blocks[slave], blocks[master]))
    master, slave = master[order], slave[order]
    quads_m, quads_s = points.quads[master], points.quads[slave]
    position = np.einsum("na,nai->ni", points.shapes[order], points.position[quads_s])
    xi, _, normal = closest_points(points.position[quads_m], position, points.xi[order])
    return SearchedSurfaces(
        block_m=blocks[master],
        block_s=blocks[slave],
        quads_m=nodes[quads_m],
        quads_s=nodes[quads_s],
        corners=np.concatenate([reference[quads_m], reference[quads_s]], axis=1),
        shapes=points.shapes[order],
        xi=xi,
        normals=normal[:, None],
        weights=points.weights[order][:, None],
        order=order,
        clearance=clearance,
    )
