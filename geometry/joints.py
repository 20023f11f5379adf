"""Joints: where blocks do not match, and the resultants of the contact forces in each.

The contact forces of two blocks are summed about the centroid of their contact area,

    F = Σ f,   M = Σ (x - x_c) × f,   N = F · n,   e = n × M / N,

so that N acts at x_c + e: in an arch these points are the thrust line (the line of resistance).

Reference: Heyman, The Stone Skeleton, Int. J. Solids Structures 2 (1966), section 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.assembly import Assembly, ContactSet
from geometry.mesh import FloatArray, IntArray

#: Normal forces below this part of the largest force have no place where they act.
_ROUND_OFF = 1e-9


@dataclass(frozen=True)
class JointResultants:
    """One row for each pair of blocks that touch; forces act on block s."""

    block_m: IntArray
    """Master block, (n_joints,)."""
    block_s: IntArray
    """Opposing block, (n_joints,)."""
    areas: FloatArray
    """Contact area, (n_joints,) [mm²]."""
    centroids: FloatArray
    """Centroid of the contact area, (n_joints, 3) [mm]."""
    normals: FloatArray
    """Mean unit normal from m to s, (n_joints, 3)."""
    forces: FloatArray
    """F, (n_joints, 3) [N]."""
    moments: FloatArray
    """M about the centroid, (n_joints, 3) [N mm]."""

    @property
    def normal_force(self) -> FloatArray:
        """N, positive where the blocks press on each other; (n_joints,) [N]."""
        return np.einsum("ji,ji->j", self.forces, self.normals)

    @property
    def shear_force(self) -> FloatArray:
        """T, size of the force in the plane of the joint; (n_joints,) [N]."""
        along = self.forces - self.normal_force[:, None] * self.normals
        return np.linalg.norm(along, axis=1)

    @property
    def twisting_moment(self) -> FloatArray:
        """Moment about the normal, (n_joints,) [N mm]."""
        return np.einsum("ji,ji->j", self.moments, self.normals)

    @property
    def bending_moment(self) -> FloatArray:
        """Size of the moment in the plane of the joint, (n_joints,) [N mm]."""
        bending = self.moments - self.twisting_moment[:, None] * self.normals
        return np.linalg.norm(bending, axis=1)

    @property
    def eccentricity(self) -> FloatArray:
        """e, from the centroid to where N acts; zero where there is no N; (n_joints, 3) [mm]."""
        normal = self.normal_force
        pressed = normal > _ROUND_OFF * np.abs(self.forces).max(initial=0.0)
        arm = np.cross(self.normals, self.moments) / np.where(pressed, normal, 1.0)[:, None]
        return np.where(pressed[:, None], arm, 0.0)

    @property
    def points(self) -> FloatArray:
        """Where N acts: the points of the thrust line, (n_joints, 3) [mm]."""
        return self.centroids + self.eccentricity


def joint_resultants(
    found: ContactSet,
    index: IntArray,
    forces: FloatArray,
    centroids: FloatArray | None = None,
) -> JointResultants:
    """Sum contact forces by pairs of blocks.

    Parameters
    ----------
    found
        Contacts of an assembly.
    index
        Which of them the forces are of, (n_contacts,).
    forces
        Force on block s at each contact, (n_contacts, 3) [N].
    centroids
        As for `summed_by_joint`.
    """
    pairs = np.column_stack([found.block_m[index], found.block_s[index]])
    return summed_by_joint(
        pairs,
        points=found.centroids[index],
        normals=found.normals[index],
        areas=found.areas[index],
        forces=forces,
        centroids=centroids,
    )


def summed_by_joint(
    blocks: IntArray,
    *,
    points: FloatArray,
    normals: FloatArray,
    areas: FloatArray,
    forces: FloatArray,
    centroids: FloatArray | None = None,
) -> JointResultants:
    """Sum forces at points by pairs of blocks.

    Parameters
    ----------
    blocks
        Blocks m and s of each point, (n_points, 2).
    points
        (n_points, 3) [mm].
    normals
        Unit, from m to s, (n_points, 3).
    areas
        That each point stands for, (n_points,) [mm²].
    forces
        On block s, (n_points, 3) [N].
    centroids
        Centroid of the contact area of each pair, in the order of the sorted pairs, (n_joints, 3)
        [mm]; by default the mean of the points, weighted by their areas.
    """
    pairs, joint = np.unique(blocks, axis=0, return_inverse=True)
    joint, n = joint.ravel(), len(pairs)

    def total(values: FloatArray) -> FloatArray:
        out = np.zeros((n, *values.shape[1:]))
        np.add.at(out, joint, values)
        return out

    area = total(areas)
    middle = total(areas[:, None] * points) / area[:, None] if centroids is None else centroids
    normal = total(areas[:, None] * normals)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    moment = total(np.cross(points - middle[joint], forces))
    return JointResultants(pairs[:, 0], pairs[:, 1], area, middle, normal, total(forces), moment)


def chain(joints: JointResultants) -> IntArray | None:
    """Joints in order along a row of blocks, as in an arch; None where the blocks form no row.

    Returns
    -------
    IntArray | None
        Joints so that neighbours share a block, from the end with the lower block number.
    """
    n = len(joints.block_m)
    touching: dict[int, list[int]] = {}
    for k, pair in enumerate(zip(joints.block_m.tolist(), joints.block_s.tolist(), strict=True)):
        for block in pair:
            touching.setdefault(block, []).append(k)
    ends = sorted(block for block, found in touching.items() if len(found) == 1)
    if len(ends) != 2 or max(map(len, touching.values())) > 2:
        return None
    order, block = [touching[ends[0]][0]], ends[0]
    while True:
        k = order[-1]
        block = int(joints.block_m[k] + joints.block_s[k] - block)
        following = [j for j in touching[block] if j != k]
        if not following:
            return np.array(order, dtype=np.int64) if len(order) == n else None
        order.append(following[0])


@dataclass(frozen=True)
class UnmatchedJoint:
    """Two blocks that touch where their facets do not all match."""

    block_m: int
    """One block."""
    block_s: int
    """The other one."""
    touching: float
    """Area on which they touch [mm²]."""
    matched: float
    """Area of it on which facets match corner on corner [mm²]."""
    toward: FloatArray
    """Direction in which the face of block m looks, (3,)."""

    def __str__(self) -> str:
        """Say which blocks, which face, and how much of it matches."""
        return (
            f"the meshes of blocks {self.block_m} and {self.block_s} do not match: facets meet "
            f"corner on corner on {self.matched:.4g} of the {self.touching:.4g} mm² on which the "
            f"blocks touch (face of block {self.block_m} that looks along "
            f"{np.round(self.toward, 3).tolist()})"
        )


def matched_area(assembly: Assembly, block_m: int, block_s: int) -> float:
    """Area of the facets of two blocks that coincide corner on corner [mm²].

    Of four triangles round the middle of each, as `polyhedron_from_block` cuts them.
    """
    found = assembly.interfaces
    meets = (found.block_m == block_m) & (found.block_s == block_s)
    corners = assembly.shape(block_m).mesh.nodes[found.quads_m[meets]]
    arms = corners - corners.mean(axis=1, keepdims=True)
    doubled = np.linalg.norm(np.cross(arms, np.roll(arms, -1, axis=1)), axis=2)
    return 0.5 * float(doubled.sum())


def between_layers(assembly: Assembly, contacts: IntArray, lower: int) -> IntArray:
    """Rows of ``contacts``, places in the interfaces, between a layer and the next one, (n,)."""
    found = assembly.interfaces
    return facets_between(assembly.layer, found.block_m[contacts], found.block_s[contacts], lower)


def facets_between(layer: IntArray, block_m: IntArray, block_s: IntArray, lower: int) -> IntArray:
    """Facets that lie between a layer and the next one, (n,).

    Parameters
    ----------
    layer
        Of each block, (n_blocks,).
    block_m, block_s
        Both blocks of each facet, (n_facets,).
    lower
        The lower layer.
    """
    m, s = layer[block_m], layer[block_s]
    return np.flatnonzero((np.minimum(m, s) == lower) & (np.maximum(m, s) == lower + 1))
