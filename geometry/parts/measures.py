"""The paper's measures of a contact pressure field (section "Evaluation criteria and measures").

The printed "Effective contact area [%]" is a *count* of surface elements, 100 N_eff,j / k_b
averaged over the free blocks; that of K_j = ⌊N_eff,j⌋ whole elements and their area stand beside.

Of a joint, all contacts between two blocks, the resultants are taken about the centroid of its
contact area,

    F = Σ f,   M = Σ (x - x_c) × f,   N = F · n,   e = n × M / N,

so that N acts at x_c + e: in an arch these points are the thrust line (the line of resistance).

Reference: Heyman, The Stone Skeleton, Int. J. Solids Structures 2 (1966), section 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from geometry.errors import RefusedError
from geometry.mesh import BoolArray, FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.placed import AnyBlocks, ContactSet
from geometry.parts.rows import Row, number

#: Pressures below this fraction of the largest are round-off of the solver.
_ROUND_OFF = 1e-12
#: Values that differ by a smaller share are those of symmetric places, but for what solvers leave.
_TIE = 1e-6


def first_largest(values: FloatArray) -> int:
    """Flat index of the first of the largest values: of symmetric places the same one always."""
    most = float(values.max())
    return int(np.argmax(values.ravel() >= most - _TIE * abs(most)))


@dataclass(frozen=True)
class Measures:
    """Averages over the free blocks."""

    effective_count_percent: float
    """Mean of 100 K_j / k_b: whole elements counted [%]."""
    participation_percent: float
    """Mean of 100 N_eff,j / k_b, not rounded down: what the paper's tables print as effective
    contact area [%]."""
    effective_area_percent: float
    """Mean of 100 (area of the K_j elements) / (eligible area of the block) [%]."""
    p_eff: float
    """Effective mean contact pressure as the formula prints it: mean over blocks of the mean of
    the K_j largest [MPa]."""
    p_eff_pooled: float
    """The same pooled over blocks, as the printed tables have it: Σ_j Σ_{i≤K_j} p_ij / Σ_j K_j
    [MPa]."""
    p_max: float
    """Max–mean contact pressure: mean over the blocks of the block maxima [MPa]."""


@dataclass(frozen=True)
class BlockMeasures(ReadOnlyArrays):
    """The same per block."""

    participation: IntArray
    """K_j = ⌊N_eff,j⌋, (n,)."""
    participation_ratio: FloatArray
    """N_eff,j = (Σ p)² / Σ p², (n,) [-]."""
    effective_area: FloatArray
    """Area of the K_j elements of largest pressure, (n,) [mm²]."""
    p_eff: FloatArray
    """Mean of the K_j largest pressures, (n,) [MPa]."""
    p_eff_step: FloatArray
    """Change of that by one element more or one less, the larger one, (n,) [MPa]."""
    p_max: FloatArray
    """Largest pressure, (n,) [MPa]."""


def _block_measures(
    pressure: FloatArray, area: FloatArray
) -> tuple[int, float, float, float, float, float]:
    """K, N_eff, effective area, p_eff, its step, p_max of one block (eq. participation ratio)."""
    largest = float(pressure.max(initial=0.0))
    if largest <= 0.0:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0
    # Of shares of the largest: squares of the pressures may be no numbers of the machine.
    share = pressure / largest
    ratio = float(share.sum()) ** 2 / float(share @ share)
    # A uniform pressure has a whole participation ratio: the nudge keeps round-off from
    # taking the floor one lower.
    count = int(np.floor(ratio * (1 + 1e-9)))
    # Ties are ordered by area, so the result does not depend on the numbering.
    order = np.lexsort((-area, -np.round(share, 9)))
    chosen = order[:count]
    p_eff = float(pressure[chosen].mean())
    near = [pressure[order[:n]].mean() for n in (count - 1, count + 1) if 0 < n <= len(order)]
    step = max((abs(float(other) - p_eff) for other in near), default=0.0)
    return count, ratio, float(area[chosen].sum()), p_eff, step, largest


def effective_facets(pressures: FloatArray) -> BoolArray:
    """Whether each facet is among the K that press most, K the participation ratio.

    ``pressures`` are (n,) [MPa], the result (n,) bool.
    """
    total = float(pressures.sum())
    if total <= 0.0:
        return np.zeros(len(pressures), dtype=bool)
    # A uniform pressure has a whole participation ratio and no order: neither hangs on round-off.
    count = int(total**2 / float(pressures @ pressures) * (1.0 + _TIE))
    alike = np.round(pressures / float(pressures.max()) / _TIE)
    chosen = np.zeros(len(pressures), dtype=bool)
    chosen[np.argsort(-alike, kind="stable")[:count]] = True
    return chosen


def block_measures(
    blocks: IntArray,
    block_m: IntArray,
    block_s: IntArray,
    pressures: FloatArray,
    areas: FloatArray,
) -> BlockMeasures:
    """Measures of each of some blocks; a contact counts for both blocks that share it.

    From pressures [MPa] and areas [mm²] of the contacts, (n_contacts,).
    """
    clean = np.where(pressures > _ROUND_OFF * pressures.max(initial=0.0), pressures, 0.0)
    owner = np.concatenate([block_m, block_s])
    contact = np.tile(np.arange(len(block_m)), 2)
    order = np.argsort(owner, kind="stable")
    contact, owner = contact[order], owner[order]
    first, last = np.searchsorted(owner, blocks), np.searchsorted(owner, blocks, side="right")
    rows = [
        _block_measures(clean[contact[i:j]], areas[contact[i:j]])
        for i, j in zip(first, last, strict=True)
    ]
    count, ratio, area, p_eff, step, p_max = (np.array(c) for c in zip(*rows, strict=True))
    return BlockMeasures(count.astype(np.int64), ratio, area, p_eff, step, p_max)


def measures(
    per_block: BlockMeasures, eligible_facets: IntArray | FloatArray, eligible_areas: FloatArray
) -> Measures:
    """Average over blocks.

    With k_b and the area of the surface that can meet a neighbour, (n,) and (n,) [mm²].
    """
    effective = int(per_block.participation.sum())
    pooled = float(per_block.participation @ per_block.p_eff) / effective if effective else 0.0
    return Measures(
        effective_count_percent=float(np.mean(100.0 * per_block.participation / eligible_facets)),
        participation_percent=float(
            np.mean(100.0 * per_block.participation_ratio / eligible_facets)
        ),
        effective_area_percent=float(np.mean(100.0 * per_block.effective_area / eligible_areas)),
        p_eff=float(per_block.p_eff.mean()),
        p_eff_pooled=pooled,
        p_max=float(per_block.p_max.mean()),
    )


def facet_measures(
    assembly: AnyBlocks, index: IntArray, pressures: FloatArray
) -> tuple[BlockMeasures, Measures]:
    """Measures of the free blocks, and of the assembly, from pressures of its contacts.

    Pressures are those of the contacts at places ``index`` of the interfaces, (n,) [MPa].
    """
    free, result = assembly.free_blocks, assembly.interfaces
    m, s = (assembly.originals[b[index]] for b in (result.block_m, result.block_s))
    per_block = block_measures(free, m, s, pressures, result.areas[index])
    eligible, areas = assembly.eligible_facets(), assembly.eligible_areas()
    return per_block, measures(per_block, eligible[free], areas[free])


#: Contact points whose forces are summed at once: many make large arrays.
_AT_ONCE = 2**16
#: Normal forces below this part of the largest force have no place where they act.
_NO_PLACE = 1e-9


@dataclass(frozen=True, kw_only=True)
class Resultants(ReadOnlyArrays):
    """Forces across surfaces, one row each: joints of two blocks, or sections through blocks."""

    areas: FloatArray
    """(n,) [mm²]."""
    centroids: FloatArray
    """Of the areas, (n, 3) [mm]."""
    normals: FloatArray
    """Unit, (n, 3)."""
    forces: FloatArray
    """F, (n, 3) [N]."""
    moments: FloatArray
    """M about the centroid, (n, 3) [N mm]."""

    @property
    def along_normal(self) -> FloatArray:
        """F · n; (n,) [N]."""
        return np.einsum("ji,ji->j", self.forces, self.normals)

    @property
    def normal_force(self) -> FloatArray:
        """N = F · n; (n,) [N]."""
        return self.along_normal

    @property
    def shear_force(self) -> FloatArray:
        """T, size of the force in the plane; (n,) [N]."""
        along = self.forces - self.normal_force[:, None] * self.normals
        return np.linalg.norm(along, axis=1)

    @property
    def twisting_moment(self) -> FloatArray:
        """Moment about the normal, (n,) [N mm]."""
        return np.einsum("ji,ji->j", self.moments, self.normals)

    @property
    def bending_moment(self) -> FloatArray:
        """Size of the moment in the plane, (n,) [N mm]."""
        bending = self.moments - self.twisting_moment[:, None] * self.normals
        return np.linalg.norm(bending, axis=1)

    @property
    def eccentricity(self) -> FloatArray:
        """e, from the centroid to where F · n acts; zero where there is none; (n, 3) [mm]."""
        normal = self.along_normal
        acts = np.abs(normal) > _NO_PLACE * np.abs(self.forces).max(initial=0.0)
        arm = np.cross(self.normals, self.moments) / np.where(acts, normal, 1.0)[:, None]
        return np.where(acts[:, None], arm, 0.0)

    @property
    def points(self) -> FloatArray:
        """Where N acts: the points of the thrust line, (n, 3) [mm]."""
        return self.centroids + self.eccentricity


@dataclass(frozen=True, kw_only=True)
class JointResultants(Resultants):
    """One row for each pair of blocks that touch; forces act on block s.

    Faces of a joint need not share a normal: N and T are summed over its faces, each with its own.
    Without friction T is zero, and N is never negative. `normals` are mean ones.
    """

    block_m: IntArray
    """Master block, (n_joints,)."""
    block_s: IntArray
    """Opposing block, (n_joints,)."""
    pressing: FloatArray
    """Sum of the forces along the normals of the faces, (n_joints,) [N]."""
    along_faces: FloatArray
    """Resultant of the forces in the faces, (n_joints, 3) [N]."""
    couples: FloatArray | None = None
    """Moment on both blocks alike, of friction that acts on both sides of a gap, (n_joints, 3)
    [N mm]; None: no such moment."""
    smallest_gap: FloatArray | None = None
    """Of deformable blocks, positive where open: negative is penetration; (n_joints,) [mm]."""
    largest_gap: FloatArray | None = None
    """The same, (n_joints,) [mm]."""
    largest_slip: FloatArray | None = None
    """Of deformable blocks, size of the displacement of block s along the joint relative to block
    m, (n_joints,) [mm]."""

    @property
    def normal_force(self) -> FloatArray:
        """N, positive where the blocks press on each other, (n_joints,) [N]."""
        return self.pressing

    @property
    def shear_force(self) -> FloatArray:
        """T, size of the resultant of the forces in the faces, (n_joints,) [N]."""
        return np.linalg.norm(self.along_faces, axis=1)

    @property
    def motion(self) -> dict[str, FloatArray]:
        """Gaps and slip by name, (n_joints,) each [mm]; nothing for rigid blocks."""
        names = ("smallest_gap", "largest_gap", "largest_slip")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    def as_json(self) -> list[dict[str, Any]]:
        """Return the resultants of each joint as plain data, the same keys for all blocks.

        ``force`` and ``moment`` act on the second of ``blocks``, the moment about ``centroid``,
        that of the contact area; ``normal`` points from the first to the second, a mean where
        faces have several. ``normal_force`` and ``shear_force`` are summed over the faces, the
        first is positive where blocks press. The line of ``force`` meets the plane of ``normal`` at
        ``point``, ``eccentricity`` from the centroid.
        Lengths in mm, forces in N, moments in N mm, world axes. Forces include friction.
        Deformable blocks have ``smallest_gap``, ``largest_gap`` and ``largest_slip`` as well.
        """
        columns = {
            "force": self.forces,
            "moment": self.moments,
            "normal_force": self.normal_force,
            "shear_force": self.shear_force,
            "bending_moment": self.bending_moment,
            "twisting_moment": self.twisting_moment,
            "eccentricity": self.eccentricity,
            "point": self.points,
            "centroid": self.centroids,
            "normal": self.normals,
            "area": self.areas,
            **self.motion,
        }
        return [
            {
                "blocks": [int(self.block_m[k]), int(self.block_s[k])],
                **{name: values[k].tolist() for name, values in columns.items()},
            }
            for k in range(len(self.block_m))
        ]


def joint_resultants(
    found: ContactSet,
    index: IntArray,
    forces: FloatArray,
    centroids: FloatArray | None = None,
) -> JointResultants:
    """Sum forces on block s at some contacts, (n_contacts, 3) [N], by pairs of blocks.

    ``index`` says which contacts these are; ``centroids`` as for `summed_by_joint`.
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
    many = int(blocks.max(initial=0)) + 1
    numbers, joint = np.unique(blocks[:, 0] * many + blocks[:, 1], return_inverse=True)
    pairs = np.column_stack(np.divmod(numbers, many))

    parts = [slice(k, k + _AT_ONCE) for k in range(0, len(joint), _AT_ONCE)]

    def total(values: Callable[[slice], FloatArray], width: int) -> FloatArray:
        """Sums over joints of values of some points, (n, width), a part of the points at a time."""
        summed = np.zeros((len(pairs), width))
        for part in parts:
            for k, column in enumerate(values(part).T):
                summed[:, k] += np.bincount(joint[part], column, len(pairs))
        return summed

    area = total(lambda i: areas[i, None], 1)
    middle = centroids
    if middle is None:
        middle = total(lambda i: areas[i, None] * points[i], 3) / area
    normal = total(lambda i: areas[i, None] * normals[i], 3)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    # Faces all around a block have no mean normal.
    normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 1e-9 * area)

    def pressing(i: slice) -> FloatArray:
        return np.einsum("pi,pi->p", forces[i], normals[i])[:, None]

    return JointResultants(
        block_m=pairs[:, 0],
        block_s=pairs[:, 1],
        areas=area.ravel(),
        centroids=middle,
        normals=normal,
        forces=total(lambda i: forces[i], 3),
        moments=total(lambda i: np.cross(points[i] - middle[joint[i]], forces[i]), 3),
        pressing=total(pressing, 1).ravel(),
        along_faces=total(lambda i: forces[i] - pressing(i) * normals[i], 3),
    )


# ---------------------------------------------------------------------------------------------
# Sections


class SectionError(RefusedError):
    """A plane that no section forces can be stated for; the message says what is expected."""


@dataclass(frozen=True, kw_only=True)
class Planes(ReadOnlyArrays):
    """Planes that cut an assembly, or some of its blocks."""

    points: FloatArray
    """A point of each, (n, 3) [mm]."""
    normals: FloatArray
    """Unit, (n, 3)."""
    blocks: tuple[IntArray | None, ...]
    """Numbers of the blocks that each cuts; None: all."""
    names: tuple[str, ...]
    """In tables and files."""

    def among(self, row: int, n_blocks: int) -> IntArray:
        """Numbers of the blocks that a plane cuts, of as many as there are."""
        chosen = self.blocks[row]
        result = np.arange(n_blocks) if chosen is None else chosen
        if not ((result >= 0) & (result < n_blocks)).all():
            raise SectionError(
                f"section {self.names[row]}: got blocks {result.tolist()}; "
                f"expected 0 to {n_blocks - 1}"
            )
        return result


def planes(
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    blocks: npt.ArrayLike | None = None,
    names: Sequence[str] | None = None,
) -> Planes:
    """Check planes: one point (3,) or several (n, 3) [mm], with a normal of any length each."""
    # Arrays are printed on several lines.
    got = " ".join(f"section: got point {points!r} and normal {normals!r}".split())
    try:
        at, along = (np.atleast_2d(np.asarray(v, dtype=np.float64)) for v in (points, normals))
        at, along = np.broadcast_arrays(at, along)
    except (TypeError, ValueError):
        raise SectionError(f"{got}; expected three numbers each, or (n, 3)") from None
    size = np.linalg.norm(along, axis=-1, keepdims=True)
    fit = at.ndim == 2 and at.shape[1] == 3 and len(at) > 0
    if not (fit and np.isfinite(at).all() and np.isfinite(size).all() and (size > 0.0).all()):
        raise SectionError(f"{got}; expected three finite numbers each, the normal not zero")
    chosen = None if blocks is None else np.unique(np.asarray(blocks, dtype=np.int64))
    named = [str(k) for k in range(len(at))] if names is None else names
    return Planes(points=at, normals=along / size, blocks=(chosen,) * len(at), names=tuple(named))


@dataclass(frozen=True, kw_only=True)
class SectionForces(Resultants):
    """What blocks transmit through planes, one row each.

    Forces and moments are those of the part ahead of the plane, where the normal points, on the
    part behind it, the moments about the centroid of the section: N is positive in tension.
    """

    planes: Planes
    """The planes."""

    @cached_property
    def axes(self) -> FloatArray:
        """Two unit vectors in each plane, (n, 2, 3).

        Right-handed with the normal; the second one points upwards (along z) as far as it can, in
        horizontal planes along y.
        """
        normal = self.normals
        flat = np.abs(normal[:, 2:]) > 1.0 - 1e-6
        up = np.where(flat, [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
        second = up - np.einsum("ji,ji->j", up, normal)[:, None] * normal
        second /= np.linalg.norm(second, axis=1, keepdims=True)
        return np.stack([np.cross(second, normal), second], axis=1)

    @property
    def shear_forces(self) -> FloatArray:
        """V along both `axes`, (n, 2) [N]."""
        return np.einsum("jai,ji->ja", self.axes, self.forces)

    @property
    def bending_moments(self) -> FloatArray:
        """M about both `axes`, (n, 2) [N mm]."""
        return np.einsum("jai,ji->ja", self.axes, self.moments)

    def columns(self) -> dict[str, FloatArray]:
        """Values by name, a row for each section; lengths in mm, forces in N, moments in N mm."""
        return {
            "plane_point": self.planes.points,
            "normal": self.normals,
            "area": self.areas,
            "centroid": self.centroids,
            "force": self.forces,
            "moment": self.moments,
            "normal_force": self.normal_force,
            "shear_forces": self.shear_forces,
            "bending_moments": self.bending_moments,
            "twisting_moment": self.twisting_moment,
            "point": self.points,
            "axis_1": self.axes[:, 0],
            "axis_2": self.axes[:, 1],
        }

    def as_json(self) -> list[dict[str, Any]]:
        """Return the values of each section as plain data; the ``point`` is where N acts."""
        columns = self.columns()
        return [
            {"name": name, **{key: values[k].tolist() for key, values in columns.items()}}
            for k, name in enumerate(self.planes.names)
        ]

    @property
    def rows(self) -> list[Row]:
        """A line for each section; its value is the normal force."""
        return [
            Row(f"section {name}", self.words(k), float(self.normal_force[k]), "N")
            for k, name in enumerate(self.planes.names)
        ]

    def words(self, row: int) -> str:
        """One section in a line."""
        force, moment = self.forces[row], self.moments[row]
        least = _NO_PLACE * float(np.linalg.norm(force))
        # Moments are compared with forces at the edge of the section.
        least_moment = least * np.sqrt(self.areas[row]) + _NO_PLACE * float(np.linalg.norm(moment))

        def shown(least: float, *values: float) -> str:
            return ", ".join(number(0.0 if abs(v) <= least else v) for v in values)

        return (
            f"N {shown(least, self.normal_force[row])} N, "
            f"V {shown(least, *self.shear_forces[row])} N, "
            f"M {shown(least_moment, *self.bending_moments[row])} N mm, "
            f"T {shown(least_moment, self.twisting_moment[row])} N mm, "
            f"area {self.areas[row]:.5g} mm²"
        )

    def __repr__(self) -> str:
        """Return a line for each section."""
        return "\n".join(f"{row.title}: {row.words}" for row in self.rows)


def sections_through_joints(
    joints: JointResultants, centroids: FloatArray, cut: Planes
) -> SectionForces:
    """Sum what joints transmit between blocks whose centroids lie on both sides of a plane.

    Rigid blocks have no forces inside: the section follows their joints.

    Parameters
    ----------
    joints
        Forces on block s.
    centroids
        Of the blocks, (n_blocks, 3) [mm].
    cut
        The planes.

    Raises
    ------
    SectionError
        A plane that no joint crosses.
    """
    rows = []
    for k, (point, normal) in enumerate(zip(cut.points, cut.normals, strict=True)):
        behind = (centroids - point) @ normal < 0.0
        m, s = behind[joints.block_m], behind[joints.block_s]
        chosen = cut.among(k, len(centroids))
        crossing = (m != s) & np.isin(joints.block_m, chosen) & np.isin(joints.block_s, chosen)
        at = np.flatnonzero(crossing)
        if not len(at):
            raise nothing_cut(cut, k, "two blocks that touch lie on both sides of it")
        force = np.where(s, 1.0, -1.0)[at, None] * joints.forces[at]
        moment = np.where(s, 1.0, -1.0)[at, None] * joints.moments[at]
        area = float(joints.areas[at].sum())
        share = joints.areas[at] / area if area else np.full(len(at), 1.0 / len(at))
        middle = share @ joints.centroids[at]
        moment += np.cross(joints.centroids[at] - middle, force)
        rows.append((area, middle, force.sum(axis=0), moment.sum(axis=0)))
    return section_rows(cut, rows)


def section_rows(
    cut: Planes, rows: Sequence[tuple[float, FloatArray, FloatArray, FloatArray]]
) -> SectionForces:
    """Sections from area, centroid, force and moment of each."""
    area, middle, force, moment = (np.array(values) for values in zip(*rows, strict=True))
    return SectionForces(
        areas=area,
        centroids=middle,
        normals=cut.normals,
        forces=force,
        moments=moment,
        planes=cut,
    )


def nothing_cut(cut: Planes, row: int, expected: str) -> SectionError:
    """Say that a plane cuts nothing."""
    point, normal = cut.points[row].tolist(), cut.normals[row].tolist()
    among = "" if cut.blocks[row] is None else " of those blocks"
    return SectionError(
        f"section {cut.names[row]}: the plane through {point} mm with normal {normal} cuts "
        f"nothing{among}; expected a plane so that {expected}"
    )


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
    ends = sorted(block for block, result in touching.items() if len(result) == 1)
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


def facets_between(layer: IntArray, block_m: IntArray, block_s: IntArray, lower: int) -> IntArray:
    """Facets (n,) of blocks m and s, (n_facets,) each, that lie between a layer and the next one.

    ``layer`` is that of each block, (n_blocks,).
    """
    m, s = layer[block_m], layer[block_s]
    return np.flatnonzero((np.minimum(m, s) == lower) & (np.maximum(m, s) == lower + 1))
