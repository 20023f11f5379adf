"""Faces of different blocks that face each other and are not in contact, or not in all of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.assembly import Assembly, matched_area
from geometry.mesh import FloatArray
from geometry.parts.placed import UnmatchedJoint
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.facet_contact import facing_areas
from geometry.polyhedra.overlap import SignedDistance

#: Part of the contact area of two blocks that may have no matching facets: clipping and curved
#: facets, which are split into flat triangles to find it.
_UNMATCHED = 1e-2
#: Faces farther apart than this many contact tolerances do not face each other.
_REACH = 100.0
#: Faces turned farther from each other than this do not face each other [°].
_ANGLE = 45.0
#: Part of the facing area of two blocks without contact that is not worth a word: edges, curves.
_WORTH = 0.05


@dataclass(frozen=True)
class NearJoint:
    """Two blocks whose facing surfaces are in contact in part, or not at all."""

    block_m: int
    block_s: int
    facing: float
    """Area that faces the other block [mm²]."""
    touching: float
    """Area in contact [mm²]."""
    gap: float
    """Least distance of a corner of one from the surface of the other; 0 where they touch [mm]."""


@dataclass(frozen=True)
class FacingSurfaces:
    """What of all facing surfaces is in contact."""

    area: float
    """Facing area of all pairs of blocks [mm²]."""
    missing: float
    """What of it is not in contact [mm²]."""
    joints: list[NearJoint]
    """Pairs that lack more than a strip at an edge, what lacks most first."""


def facing_surfaces(assembly: PolyhedralAssembly) -> FacingSurfaces:
    """Compare the area that sees another block with the area in contact, pair by pair.

    Pairs of two fixed blocks do not count.
    """
    world = assembly.placed(_REACH * assembly.tolerance)
    pairs, facing = facing_areas(world, _ANGLE, assembly.tolerance)
    free = ~assembly.fixed[pairs].all(axis=1)
    patches, n = assembly.interfaces.patches, assembly.n_blocks
    key = pairs[:, 0] * n + pairs[:, 1]
    of_patch = patches.block_m * n + patches.block_s
    touching = np.zeros(len(key))
    known = np.isin(of_patch, key)
    np.add.at(touching, np.searchsorted(key, of_patch[known]), patches.areas[known])
    in_contact = set((assembly.interfaces.block_m * n + assembly.interfaces.block_s).tolist())
    missing = np.maximum(facing - touching, 0.0)
    joints = []
    for k in np.argsort(-missing, kind="stable").tolist():
        if not free[k] or missing[k] <= _WORTH * facing[k]:
            continue
        m, s = pairs[k].tolist()
        gap = 0.0 if int(key[k]) in in_contact else distance_between(assembly, m, s)
        joints.append(NearJoint(m, s, float(facing[k]), float(touching[k]), gap))
    lacking = sum(joint.facing - joint.touching for joint in joints)
    return FacingSurfaces(float(facing[free].sum()), lacking, joints)


def distance_between(assembly: PolyhedralAssembly, a: int, b: int) -> float:
    """Least distance of a corner of one block from the surface of the other [mm]."""

    def least(one: int, other: int) -> float:
        points: FloatArray = assembly.points(other) - assembly.translations[one]
        away = SignedDistance(assembly.shape(one))(points @ assembly.rotations[one])
        return float(np.abs(away).min())

    return min(least(a, b), least(b, a))


def unmatched_joints(
    assembly: Assembly, surfaces: PolyhedralAssembly
) -> tuple[UnmatchedJoint, ...]:
    """Joints where the facets of two blocks that touch do not match corner on corner.

    ``surfaces`` are the same blocks, their contacts found without matching facets.
    """
    patches = surfaces.interfaces.patches
    pairs = np.unique(np.column_stack([patches.block_m, patches.block_s]), axis=0)
    result = []
    for m, s in pairs.tolist():
        rows = np.flatnonzero((patches.block_m == m) & (patches.block_s == s))
        touching, matched = float(patches.areas[rows].sum()), matched_area(assembly, m, s)
        if matched < (1.0 - _UNMATCHED) * touching:
            toward = patches.normals[rows[np.argmax(patches.areas[rows])]]
            result.append(UnmatchedJoint(m, s, touching, matched, toward))
    return tuple(result)
