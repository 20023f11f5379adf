"""Face-to-face contact on conforming interfaces: gaps, pressures, nodal forces, tangent.

Opposing facets are matched corner on corner. On each pair lie Gauss points, 2 × 2 on bilinear
facets (`fem.element.facet.FacetBasis`); at a point

    d = x_s - x_m                    from the master point to the opposing one
    n = a / |a|, a = t_1 × t_2       t the mean of the two facets' tangents: neither is favoured
    overclosure = -n · d - clearance minus the gap

and the energy is the sum of w W(overclosure) with w the reference area of the point. Forces
are its derivatives: on the nodes -w p ∂(overclosure)/∂u. The first half of the nodes of a pair are
those of the master facet, the second the coinciding ones of the opposing facet. Bilinear facets
have their four corners for nodes.

With *reference* normals n does not change: the overclosure is linear in the displacement. With
*current* normals n follows both surfaces; its variation is part of the force, so forces and
moments about the current positions balance to round-off.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from fem.contact.law import ContactLaw
from fem.element.facet import BILINEAR, FacetBasis, basis_of
from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays, cross_matrix, run_starts


class ContactError(RefusedError):
    """Contact that cannot be computed: which faces, what is wrong, what to do."""


class ContactNormals(StrEnum):
    """Which normals measure the gap."""

    CURRENT = "current"
    """Of the deformed surfaces."""
    REFERENCE = "reference"
    """Of the undeformed surfaces: the gap is linear in the displacement."""


@dataclass(frozen=True)
class ContactSurfaces(ReadOnlyArrays):
    """Matched facets of an assembly with their Gauss points, world axes.

    Sorted by block pair; both the static and the explicit solver read it.
    """

    block_m: IntArray
    """Master block, (n,)."""
    block_s: IntArray
    """Opposing block, (n,)."""
    quads_m: IntArray
    """Nodes in block m's mesh, (n, n_nodes of a facet)."""
    quads_s: IntArray
    """Coinciding nodes of block s, one by one."""
    facet: IntArray
    """Position in the assembly's interfaces, (n,)."""
    tangents: FloatArray
    """Mean reference tangents dx/dr, dx/ds of the two facets, (n, n_points, 2, 3) [mm]."""
    offsets: FloatArray
    """x_s - x_m in the reference position, spacing included, (n, n_points, 3) [mm]."""
    clearance: float = 0.0
    """Added to every gap, as if the surfaces lay half of it inside their blocks [mm]."""
    basis: FacetBasis = BILINEAR
    """Functions of the nodes of a facet at its points."""

    @property
    def n_facets(self) -> int:
        """Number of matched facet pairs."""
        return len(self.block_m)

    @cached_property
    def pair_start(self) -> IntArray:
        """First facet of each block pair, and the total; (n_pairs + 1,)."""
        return run_starts(self.block_m, self.block_s)

    @cached_property
    def area_vectors(self) -> FloatArray:
        """t_1 × t_2 of the reference position, (n, n_points, 3) [mm²]."""
        return np.cross(self.tangents[:, :, 0], self.tangents[:, :, 1])

    @cached_property
    def weights(self) -> FloatArray:
        """Reference area of each point, (n, n_points) [mm²]."""
        return np.linalg.norm(self.area_vectors, axis=2) * self.basis.weights

    @cached_property
    def normals(self) -> FloatArray:
        """Reference normals from m to s, (n, n_points, 3)."""
        return self.area_vectors / np.linalg.norm(self.area_vectors, axis=2, keepdims=True)

    @cached_property
    def sides(self) -> FloatArray:
        """Orthonormal reference tangents, along which slips are measured, (n, n_points, 2, 3)."""
        first = self.tangents[:, :, 0]
        first = first / np.linalg.norm(first, axis=2, keepdims=True)
        return np.stack([first, np.cross(self.normals, first)], axis=2)

    @cached_property
    def areas(self) -> FloatArray:
        """Reference area of each facet, (n,) [mm²]."""
        return self.weights.sum(axis=1)

    @property
    def initial_gaps(self) -> FloatArray:
        """Gap before any displacement, (n, n_points) [mm]."""
        along = np.einsum("fpi,fpi->fp", self.normals, self.offsets)
        return along + self.clearance

    @property
    def difference(self) -> FloatArray:
        """Weights of the nodes in d = x_s - x_m, (n, n_points, nodes of both)."""
        difference = self.basis.difference
        return np.broadcast_to(difference, (self.n_facets, *difference.shape))

    def kinematics(
        self, corner_displacements: FloatArray, normals: ContactNormals
    ) -> PointKinematics:
        """Overclosures and gradients at displaced nodes (n, nodes of both, 3) [mm], world axes."""
        return point_kinematics(self, corner_displacements, normals)

    def subset(self, facets: IntArray) -> ContactSurfaces:
        """Keep some facets, in the order given; block pairs are found anew."""
        names = (f.name for f in fields(self) if f.name not in ("clearance", "basis"))
        return replace(self, **{name: getattr(self, name)[facets] for name in names})


def contact_surfaces(
    assembly: Assembly, moved: FloatArray | None = None, *, clearance: float = 0.0
) -> ContactSurfaces:
    """Gather the matched facets of an assembly that a deformation can load.

    Facets between two fixed blocks are kept: a frame may be deformable.

    Parameters
    ----------
    assembly
        Conforming blocks.
    moved
        Translation of each block from its conforming place, (n_blocks, 3) [mm]
        (`geometry.assembly.spacing_offsets`); None: the blocks touch.
    clearance
        Added to every gap [mm].

    Raises
    ------
    AssemblyError
        Facets of free blocks without partner where that is not allowed.
    """
    interfaces = assembly.interfaces
    quads_m = _facet_nodes(assembly, interfaces.block_m, interfaces.quads_m)
    quads_s = _facet_nodes(assembly, interfaces.block_s, interfaces.quads_s)
    # Far from the world's origin differences of places have fewer digits.
    origin = assembly.centroids.mean(axis=0)
    nodes_m = facet_corners(assembly, interfaces.block_m, quads_m, origin)
    nodes_s = facet_corners(assembly, interfaces.block_s, quads_s, origin)
    basis = basis_of(quads_m)
    offsets: FloatArray = basis.values @ (nodes_s - nodes_m)
    if moved is not None:
        offsets += (moved[interfaces.block_s] - moved[interfaces.block_m])[:, None]
    return ContactSurfaces(
        block_m=interfaces.block_m,
        block_s=interfaces.block_s,
        quads_m=quads_m,
        quads_s=quads_s,
        facet=np.arange(interfaces.n_contacts),
        tangents=basis.tangents(0.5 * (nodes_m + nodes_s)),
        offsets=offsets,
        clearance=clearance,
        basis=basis,
    )


def _facet_nodes(assembly: Assembly, blocks: IntArray, quads: IntArray) -> IntArray:
    """All nodes of facets of blocks, from their corners (n, 4)."""
    result: IntArray | None = None
    for number, shape in enumerate(assembly.shapes):
        members = assembly.shape_of[blocks] == number
        nodes = shape.mesh.facet_nodes(quads[members])
        result = np.empty((len(blocks), nodes.shape[1]), np.int64) if result is None else result
        result[members] = nodes
    assert result is not None
    return result


def facet_corners(
    assembly: Assembly, blocks: IntArray, quads: IntArray, origin: FloatArray | float = 0.0
) -> FloatArray:
    """Positions of nodes of facets (n, m) from an origin on, world axes, (n, m, 3) [mm]."""
    corners = np.empty((*quads.shape, 3))
    for block in np.unique(blocks).tolist():
        members = blocks == block
        shift = assembly.translations[block] - origin
        corners[members] = (
            assembly.shape(block).mesh.nodes[quads[members]] @ assembly.rotations[block].T + shift
        )
    return corners


def check_initial_overlap(
    surfaces: ContactSurfaces, law: ContactLaw, clearance: float = 0.0
) -> None:
    """Reject surfaces that lie deeper in each other than the law's curve reaches.

    A negative clearance [mm] is an interference that is stated.

    Raises
    ------
    ContactError
        Naming the deepest block pair, its depth and the law's range.
    """
    deepest = (-surfaces.initial_gaps).max(axis=1, initial=-np.inf)
    reach = law.allowed_overclosure(clearance)
    refuse_overlap(surfaces.block_m, surfaces.block_s, deepest, reach)


def refuse_overlap(
    block_m: IntArray, block_s: IntArray, deepest: FloatArray, range_end: float
) -> None:
    """Reject facets (n_facets,) whose largest overclosure [mm] is beyond a law's range [mm]."""
    if not len(deepest) or deepest.max() <= range_end:
        return
    worst = int(np.argmax(deepest))
    raise ContactError(
        f"contact: {int((deepest > range_end).sum())} facets overlap at the start by more than "
        f"{range_end:.3g} mm, where the contact law ends; deepest {deepest[worst]:.3g} mm between "
        f"blocks {int(block_m[worst])} and {int(block_s[worst])}; expected "
        "blocks that touch: correct the placement or raise contact.clearance"
    )


# ---------------------------------------------------------------------------------------------
# Kinematics


@dataclass(frozen=True)
class PointKinematics:
    """Overclosure of every point and its derivative by the corner displacements."""

    overclosure: FloatArray
    """(n, n_points) [mm]"""
    gradient: FloatArray
    """∂(overclosure)/∂(corner displacement) in world axes, (n, n_points, nodes of both, 3)."""


def reference_gradient(surfaces: ContactSurfaces) -> FloatArray:
    """Gradient of the overclosure with reference normals, (n, n_points, nodes of both, 3)."""
    return -np.einsum("pa,fpi->fpai", surfaces.basis.difference, surfaces.normals)


def point_kinematics(
    surfaces: ContactSurfaces,
    corner_displacements: FloatArray,
    normals: ContactNormals = ContactNormals.CURRENT,
) -> PointKinematics:
    """Overclosures and their gradients at displacements of corners, (n, nodes of both, 3) [mm]."""
    d = surfaces.offsets + surfaces.basis.difference @ corner_displacements
    if normals is ContactNormals.REFERENCE:
        return PointKinematics(
            -np.einsum("fpi,fpi->fp", surfaces.normals, d) - surfaces.clearance,
            reference_gradient(surfaces),
        )
    frame = _current_frame(surfaces, corner_displacements, d)
    basis = surfaces.basis
    by_normal = -np.einsum("pa,fpi->fpai", basis.difference, frame.normal)
    # ∂(overclosure)/∂a = -e; a = t_1 × t_2 turns it into t_2 × (-e) and (-e) × t_1.
    by_first = np.cross(frame.slip, frame.tangents[:, :, 1])
    by_second = np.cross(frame.tangents[:, :, 0], frame.slip)
    turning = np.einsum("pa,fpi->fpai", basis.mean_slopes[:, :, 0], by_first)
    turning += np.einsum("pa,fpi->fpai", basis.mean_slopes[:, :, 1], by_second)
    return PointKinematics(-frame.gap - surfaces.clearance, by_normal + turning)


@dataclass(frozen=True)
class _CurrentFrame:
    """Tangents, normal, gap and e = (d - n (n · d)) / |a| of the displaced points."""

    tangents: FloatArray
    normal: FloatArray
    area: FloatArray
    gap: FloatArray
    slip: FloatArray


def _current_frame(
    surfaces: ContactSurfaces, corner_displacements: FloatArray, d: FloatArray
) -> _CurrentFrame:
    slopes = surfaces.basis.mean_slopes
    by_each = slopes.transpose(0, 2, 1).reshape(-1, slopes.shape[1]) @ corner_displacements
    tangents = surfaces.tangents + by_each.reshape(surfaces.tangents.shape)
    vector = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    area = np.linalg.norm(vector, axis=2)
    normal = vector / area[:, :, None]
    gap = np.einsum("fpi,fpi->fp", normal, d)
    slip = (d - gap[:, :, None] * normal) / area[:, :, None]
    return _CurrentFrame(tangents, normal, area, gap, slip)


def point_overclosures(
    surfaces: ContactSurfaces,
    corner_displacements: FloatArray,
    normals: ContactNormals = ContactNormals.CURRENT,
) -> FloatArray:
    """Overclosures alone of `point_kinematics`, (n, n_points) [mm]."""
    d = surfaces.offsets + surfaces.basis.difference @ corner_displacements
    if normals is ContactNormals.REFERENCE:
        return -np.einsum("fpi,fpi->fp", surfaces.normals, d) - surfaces.clearance
    return -_current_frame(surfaces, corner_displacements, d).gap - surfaces.clearance


def point_normals(
    surfaces: ContactSurfaces,
    corner_displacements: FloatArray,
    normals: ContactNormals = ContactNormals.CURRENT,
) -> FloatArray:
    """Normals from m to s that measure the gaps at displaced corners, (n, n_points, 3)."""
    if normals is ContactNormals.REFERENCE:
        return surfaces.normals
    d = surfaces.offsets + surfaces.basis.difference @ corner_displacements
    return _current_frame(surfaces, corner_displacements, d).normal


def corner_overclosures(
    surfaces: ContactSurfaces,
    corner_displacements: FloatArray,
    normals: ContactNormals = ContactNormals.CURRENT,
) -> FloatArray:
    """Overclosures where facets are looked at for peaks, (n, n_looks) [mm].

    Of bilinear facets these are the corners: between them a gap is bilinear but for the turning of
    the normal, and its extremes are here. Tangents and d are polynomials, so their values at the
    Gauss points say those everywhere.
    """
    basis = surfaces.basis
    d = surfaces.offsets + surfaces.basis.difference @ corner_displacements
    tangents: FloatArray = surfaces.tangents
    if normals is ContactNormals.CURRENT:
        turned: FloatArray = np.einsum("pak,fai->fpki", basis.mean_slopes, corner_displacements)
        tangents = tangents + turned
    there = basis.to_looks @ tangents.reshape(*tangents.shape[:2], 6)
    vector: FloatArray = np.cross(there[..., :3], there[..., 3:])
    normal: FloatArray = vector / np.linalg.norm(vector, axis=2, keepdims=True)
    distance = basis.to_looks @ d
    return -np.einsum("fci,fci->fc", normal, distance) - surfaces.clearance


def curvature(surfaces: ContactSurfaces, corner_displacements: FloatArray) -> FloatArray:
    """Second derivative of the overclosure with current normals.

    Returns
    -------
    FloatArray
        (n, n_points, m, m) [1/mm], degrees of freedom 3 · node + component.
    """
    d = surfaces.offsets + surfaces.basis.difference @ corner_displacements
    hessian = _second_derivatives(_current_frame(surfaces, corner_displacements, d))
    spread = np.einsum("pka,ij->pkiaj", _frame_factors(surfaces), np.eye(3))
    spread = spread.reshape(*spread.shape[:1], 9, -1)
    return _transposed(spread) @ hessian @ spread


def motion_derivatives(
    surfaces: ContactSurfaces, corner_displacements: FloatArray, motions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """First and second derivative of the overclosure by motions, with current normals.

    Parameters
    ----------
    surfaces
        Facets in contact.
    corner_displacements
        Where they are, (n, nodes of both, 3) [mm].
    motions
        Displacements of the nodes of both facets by unit motions, (n, nodes of both, 3, n_motions).

    Returns
    -------
    tuple[FloatArray, FloatArray]
        (n, n_points, n_motions) and (n, n_points, n_motions, n_motions).
    """
    d = surfaces.offsets + surfaces.basis.difference @ corner_displacements
    frame = _current_frame(surfaces, corner_displacements, d)
    by_first = np.cross(frame.slip, frame.tangents[:, :, 1])
    by_second = np.cross(frame.tangents[:, :, 0], frame.slip)
    first = np.concatenate([-frame.normal, by_first, by_second], axis=2)
    way = np.einsum("pka,faim->fpkim", _frame_factors(surfaces), motions, optimize=True)
    way = way.reshape(*first.shape, -1)
    gradient = (first[:, :, None] @ way)[:, :, 0]
    return gradient, _transposed(way) @ _second_derivatives(frame) @ way


def _frame_factors(surfaces: ContactSurfaces) -> FloatArray:
    """Weights of the nodes of both facets in d, t_1 and t_2, (n_points, 3, nodes of both)."""
    basis = surfaces.basis
    slopes = (basis.mean_slopes[:, :, 0], basis.mean_slopes[:, :, 1])
    return np.stack([basis.difference, *slopes], axis=1)


def _second_derivatives(frame: _CurrentFrame) -> FloatArray:
    """Second derivative of the overclosure by (d, t_1, t_2), (n, n_points, 9, 9).

    With e the tangential part of d over |a| and P = 1 - n nᵀ: ∂²/∂a∂d = -P / |a|,
    ∂²/∂a² = ((n·d) P / |a| + n eᵀ + e nᵀ) / |a|, ∂²/∂t_1∂t_2 = [e]×.
    """
    n, e, area = frame.normal, frame.slip, frame.area[:, :, None, None]
    tangential = np.eye(3) - n[..., :, None] * n[..., None, :]
    mixed = n[..., :, None] * e[..., None, :]
    by_a_d = -tangential / area
    by_a_a = (frame.gap[:, :, None, None] * tangential / area + mixed + _transposed(mixed)) / area
    # δa = -[t_2]× δt_1 + [t_1]× δt_2
    turn = [-cross_matrix(frame.tangents[:, :, 1]), cross_matrix(frame.tangents[:, :, 0])]
    hessian = np.zeros((*frame.area.shape, 9, 9))
    for i in range(2):
        rows = slice(3 + 3 * i, 6 + 3 * i)
        hessian[..., rows, :3] = _transposed(turn[i]) @ by_a_d
        hessian[..., :3, rows] = _transposed(hessian[..., rows, :3])
        for j in range(2):
            columns = slice(3 + 3 * j, 6 + 3 * j)
            hessian[..., rows, columns] = _transposed(turn[i]) @ by_a_a @ turn[j]
    hessian[..., 3:6, 6:] += cross_matrix(e)
    hessian[..., 6:, 3:6] -= cross_matrix(e)
    return hessian


def _transposed(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2)


# ---------------------------------------------------------------------------------------------
# Forces


def corner_forces(kinematics: PointKinematics, point_forces: FloatArray) -> FloatArray:
    """Forces on the nodes of both facets, world axes: (n, nodes of both, 3) [N].

    From w p of each point, (n, n_points) [N].
    """
    return -np.einsum("fp,fpai->fai", point_forces, kinematics.gradient)


def curvature_tangent(
    surfaces: ContactSurfaces, corner_displacements: FloatArray, point_forces: FloatArray
) -> FloatArray:
    """Part of the derivative of minus the corner forces that comes from turning normals.

    Returns
    -------
    FloatArray
        (n, m, m) [N/mm].
    """
    return np.einsum("fp,fpij->fij", point_forces, curvature(surfaces, corner_displacements))


def facet_pressures(surfaces: ContactSurfaces, point_pressures: FloatArray) -> FloatArray:
    """Mean pressure of each facet, its force over its area; (n,) [MPa]."""
    return (surfaces.weights * point_pressures).sum(axis=1) / surfaces.areas
