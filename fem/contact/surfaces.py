"""Contact points: gaps, nodal forces, tangents, whether facets match or a search found them.

At a point of the opposing surface that faces one of the master surface

    d = x_s - x_m = offset + Σ functions u
    n = a / |a|, a = t_1 × t_2, t = tangent + Σ slopes u
    overclosure = -n · d - clearance minus the gap

and the energy is the sum of w W(overclosure) with w the reference area of the point. Forces
are its derivatives: on the nodes -w p ∂(overclosure)/∂u. The first half of the nodes of a point are
those of the master facet, the second those of the opposing one.

The rule of the normal lies in tangents and slopes. Where facets *match*, corner on corner, Gauss
points lie on each pair, 2 × 2 on bilinear facets (`fem.element.functions.FacetBasis`), and t is the
mean of the tangents of both: neither is favoured. Where a *search* found what a point faces
(`fem.contact.search`), t is that of the master facet at the closest point. These *current* normals
are those of the deformed surfaces: their variation is part of the force, so forces and moments
about the current positions balance to round-off. With *reference* normals slopes are zero: the
overclosure is linear in the displacement.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.sparse import csr_array

from fem.contact.law import ContactLaw
from fem.element.functions import FacetBasis, basis_of
from fem.element.hexahedron import chunks
from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.machine.work import Operation, count
from geometry.mesh import (
    FloatArray,
    IntArray,
    ReadOnlyArrays,
    cross,
    cross_matrix,
    lengths,
    run_starts,
)

#: Points times nodes whose gradients are computed at a time: what a cache holds.
_AT_ONCE = 1 << 14


class ContactError(RefusedError):
    """Contact that cannot be computed: which faces, what is wrong, what to do."""


@dataclass(frozen=True)
class ContactPoints(ReadOnlyArrays):
    """Points of contact on pairs of facets, world axes; a search finds one for each pair.

    Sorted by block pair. Points of a system (`fem.system.system.System`) have `rows` and `axes`: a
    sector, a half turn or a periodic image is only another choice of these.
    """

    block_m: IntArray
    """Master block, (n,)."""
    block_s: IntArray
    """Opposing block, (n,)."""
    quads_m: IntArray
    """Nodes in block m's mesh, (n, n_nodes of a facet)."""
    quads_s: IntArray
    """Nodes of block s alike; of matched facets those that coincide, one by one."""
    functions: FloatArray
    """Weights of the nodes in d, (n, n_points, nodes of both), or (1, …) for all facets."""
    slopes: FloatArray
    """Weights of the nodes in the tangents, (n, n_points, 2, nodes of both), or (1, …)."""
    offsets: FloatArray
    """x_s - x_m in the reference position, spacing included, (n, n_points, 3) [mm]."""
    tangents: FloatArray
    """Tangents dx/dr, dx/ds whose normal counts, there, (n, n_points, 2, 3) [mm]."""
    sides: FloatArray
    """Orthonormal directions along which slips are measured, (n, n_points, 2, 3); (…, 0, 3) in a
    system without friction."""
    weights: FloatArray
    """Reference area of each point, (n, n_points) [mm²]."""
    clearance: float
    """Added to every gap, as if the surfaces lay half of it inside their blocks [mm]."""
    rows: IntArray = field(kw_only=True)
    """Row of the state of each node of both facets, m's first, `n_rows` of rigid blocks,
    (n, nodes of both)."""
    axes: FloatArray = field(kw_only=True)
    """From the frames in which the state of both blocks is to the world, (n, 2, 3, 3)."""
    n_rows: int = field(default=0, kw_only=True)
    """Rows of the state."""

    @property
    def n_facets(self) -> int:
        """Number of matched facet pairs."""
        return len(self.block_m)

    @cached_property
    def pair_start(self) -> IntArray:
        """First facet of each block pair, and the total; (n_pairs + 1,)."""
        return run_starts(self.block_m, self.block_s)

    @cached_property
    def areas(self) -> FloatArray:
        """Reference area of each facet, (n,) [mm²]."""
        return self.weights.sum(axis=1)

    @property
    def with_reference_normals(self) -> Self:
        """The same with normals that do not turn."""
        return replace(self, slopes=np.zeros((1, *self.slopes.shape[1:])))

    def kinematics(self, moved: FloatArray) -> PointKinematics:
        """Overclosures and gradients at displacements of the nodes, (n, nodes of both, 3) [mm]."""
        frame = self.frame(moved)
        by_tangents = frame.by_tangents if self.slopes.any() else None
        gradient = np.empty((*frame.gap.shape, moved.shape[1], 3))
        # Runs along all nodes, not along three components, of what a cache holds.
        for part in chunks(len(gradient), max(1, 3 * _AT_ONCE // max(gradient[:1].size, 1))):
            functions, slopes = (
                given if len(given) == 1 else given[part] for given in (self.functions, self.slopes)
            )
            for i in range(3):
                along = functions * -frame.normal[part, :, i, None]
                if by_tangents is not None:
                    turning = slopes[:, :, 0] * by_tangents[part, :, 0, i, None]
                    along += turning + slopes[:, :, 1] * by_tangents[part, :, 1, i, None]
                gradient[part, ..., i] = along
        return PointKinematics(-frame.gap - self.clearance, gradient)

    # ---- by the state of a system, (n_rows, 3) [mm]

    @cached_property
    def moves(self) -> FloatArray:
        """One at nodes of deformable blocks, zero at those of rigid ones, (n, nodes of both)."""
        return (self.rows < self.n_rows).astype(np.float64)

    def moved(self, state: FloatArray) -> FloatArray:
        """World displacements of the nodes, (n, nodes of both, 3) [mm]."""
        local = np.concatenate([state, np.zeros((1, 3))])[self.rows]
        sides = local.reshape(-1, 2, local.shape[1] // 2, 3)
        return np.einsum("fbij,fbaj->fbai", self.axes, sides).reshape(local.shape)

    def gaps(self, state: FloatArray) -> Gaps:
        """Overclosures at a state, and slips where there is friction."""
        world = self.kinematics(self.moved(state))
        count(Operation.POINT, world.gradient.size / 3.0)
        x, gradient = world.overclosure[..., None], self._in_frames(world.gradient)[:, :, None]
        if not self.sides.shape[2]:
            return Gaps(x, gradient)
        return Gaps(
            np.concatenate([x, self.gather(self._by_slips, state)], axis=2),
            np.concatenate([gradient, self._by_slips], axis=2),
        )

    @cached_property
    def _by_slips(self) -> FloatArray:
        """∂(slip)/∂(state), (n, n_points, 2 or 0, nodes of both, 3)."""
        world = np.einsum("fpa,fpki->fpkai", self.functions, self.sides)
        return self._in_frames(_flat(world)).reshape(world.shape)

    def _in_frames(self, gradient: FloatArray) -> FloatArray:
        """World gradients (n, …, nodes of both, 3) in the frames, zero at rigid blocks."""
        split = gradient.reshape(*gradient.shape[:2], 2, gradient.shape[2] // 2, 3)
        local: FloatArray = (split @ self.axes[:, None]).reshape(gradient.shape)
        local *= self.moves[:, None, :, None]
        return local

    def gather(self, gradient: FloatArray, state: FloatArray) -> FloatArray:
        """Product of gradients (n, …, nodes of both, 3) with a state, (n, …) [mm]."""
        local = np.concatenate([state, np.zeros((1, 3))])[self.rows]
        moved = np.einsum("fpai,fai->fp", _flat(gradient), local, optimize=True)
        return moved.reshape(gradient.shape[:-2])

    def scatter(self, gradient: FloatArray, point_forces: FloatArray) -> FloatArray:
        """Nodal forces -Σ w t ∂x/∂u of forces w t (n, …) [N], (n_rows, 3) [N]."""
        rows = _flat(gradient)
        forces = point_forces.reshape(rows.shape[:2])
        return self._summed(-np.einsum("fp,fpai->fai", forces, rows))

    def _summed(self, forces: FloatArray) -> FloatArray:
        """Sum of forces on the nodes in the frames, (n_rows, 3) [N]."""
        where, result = self.rows.ravel(), np.empty((self.n_rows, 3))
        for i in range(3):
            values = forces[:, :, i].ravel()
            result[:, i] = np.bincount(where, values, minlength=self.n_rows + 1)[:-1]
        return result

    def gradient_matrix(self, gradient: FloatArray, some: IntArray) -> csr_array:
        """Gradients (n, …, nodes of both, 3) as a sparse matrix, (n_some, 3 n_rows).

        ``some`` are the rows to keep, rows of a facet · facet + row.
        """
        per_facet, width = int(np.prod(gradient.shape[1:-2])), 3 * gradient.shape[-2]
        columns = (3 * self.rows[:, :, None] + np.arange(3)).reshape(-1, width)
        columns = np.where(columns < 3 * self.n_rows, columns, 0)[some // per_facet]
        values = gradient.reshape(-1, width)[some]
        ends = width * np.arange(len(some) + 1)
        matrix = csr_array(
            (values.ravel(), columns.ravel(), ends), shape=(len(some), 3 * self.n_rows)
        )
        matrix.sum_duplicates()
        matrix.eliminate_zeros()
        return matrix

    # ---- by displacements of the nodes

    def nodal_forces(
        self, moved: FloatArray, pressures: FloatArray, frictions: FloatArray | None = None
    ) -> FloatArray:
        """Forces on the nodes of both facets, world axes, (n, nodes of both, 3) [N].

        Parameters
        ----------
        moved
            Displacements of the nodes, (n, nodes of both, 3) [mm].
        pressures
            Of the points, (n, n_points) [MPa].
        frictions
            On block s there, (n, n_points, 3) [MPa]; None: without.
        """
        gradient = self.kinematics(moved).gradient
        forces = -np.einsum("fp,fpai->fai", self.weights * pressures, gradient)
        if frictions is not None:
            acting = self.weights[..., None] * frictions
            forces += np.einsum("fpa,fpi->fai", self.functions, acting)
        return forces

    def overclosures(self, moved: FloatArray) -> FloatArray:
        """Overclosures alone of `kinematics`, (n, n_points) [mm]."""
        return -self.frame(moved).gap - self.clearance

    def frame(self, moved: FloatArray) -> CurrentFrame:
        """Tangents, normals and gaps at displacements of the nodes, (n, nodes of both, 3) [mm]."""
        d = self.offsets + self.functions @ moved
        n, n_points, _, n_nodes = self.slopes.shape
        turned = self.slopes.reshape(n, 2 * n_points, n_nodes) @ moved
        tangents = self.tangents + turned.reshape(self.tangents.shape)
        vector = cross(tangents[:, :, 0], tangents[:, :, 1])
        area = lengths(vector)
        normal = vector / area[:, :, None]
        gap = np.einsum("fpi,fpi->fp", normal, d)
        slip = (d - gap[:, :, None] * normal) / area[:, :, None]
        return CurrentFrame(d, tangents, normal, area, gap, slip)

    def subset(self, some: IntArray) -> Self:
        """Keep some facets, in the order requested; block pairs are found anew."""
        return replace(self, **{name: values[some] for name, values in self._each.items()})

    @property
    def _each(self) -> dict[str, Any]:
        """What every facet has, by name."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        n = self.n_facets
        return {k: v for k, v in values.items() if np.ndim(v) and len(v) == n and k != "origin"}


def _flat(gradient: FloatArray) -> FloatArray:
    """All rows of each facet, (n, …, nodes of both, 3) to (n, n_rows, nodes of both, 3)."""
    n_rows = int(np.prod(gradient.shape[1:-2]))
    return gradient.reshape(len(gradient), n_rows, *gradient.shape[-2:])


@dataclass(frozen=True)
class Gaps:
    """Overclosures of all points, with friction also their slips, and their derivatives."""

    x: FloatArray
    """Overclosure, then slips along `ContactPoints.sides`, (n, n_points, 1 or 3) [mm]."""
    gradient: FloatArray
    """∂x/∂(state), (n, n_points, 1 or 3, nodes of both, 3)."""

    @property
    def overclosure(self) -> FloatArray:
        """Overclosures alone, (n, n_points) [mm]."""
        return self.x[..., 0]


def of_no_system(n: int, n_nodes: int) -> dict[str, Any]:
    """Rows and axes of points on so many pairs of facets whose nodes do not move."""
    rows = np.broadcast_to(np.zeros((), np.int64), (n, n_nodes))
    return {"rows": rows, "axes": np.broadcast_to(np.eye(3), (n, 2, 3, 3))}


@dataclass(frozen=True)
class MatchedFacets(ContactPoints):
    """Points of facets that match corner on corner."""

    facet: IntArray
    """Position in the assembly's interfaces, (n,)."""
    basis: FacetBasis
    """Functions of the nodes of a facet at its points."""

    @cached_property
    def normals(self) -> FloatArray:
        """Reference normals from m to s, (n, n_points, 3)."""
        area_vectors: FloatArray = cross(self.tangents[:, :, 0], self.tangents[:, :, 1])
        return area_vectors / lengths(area_vectors)[..., None]

    @property
    def initial_gaps(self) -> FloatArray:
        """Gap before any displacement, (n, n_points) [mm]."""
        along = np.einsum("fpi,fpi->fp", self.normals, self.offsets)
        return along + self.clearance


def matched_facets(
    blocks: tuple[IntArray, IntArray],
    quads: tuple[IntArray, IntArray],
    nodes: tuple[FloatArray, FloatArray],
    basis: FacetBasis,
    *,
    apart: FloatArray | None = None,
    clearance: float = 0.0,
) -> MatchedFacets:
    """Points on pairs of facets, with current normals.

    Parameters
    ----------
    blocks, quads
        Of both sides, master first, (n,) and (n, n_nodes of a facet).
    nodes
        Where they are, (n, n_nodes, 3) [mm].
    basis
        Functions of their nodes.
    apart
        What block s is moved by against m, (n, 3) [mm]; None: nothing.
    clearance
        Added to every gap [mm].
    """
    offsets = basis.values @ (nodes[1] - nodes[0])
    if apart is not None:
        offsets += apart[:, None]
    tangents = basis.tangents(0.5 * (nodes[0] + nodes[1]))
    area_vectors = cross(tangents[:, :, 0], tangents[:, :, 1])
    areas = lengths(area_vectors)
    first = tangents[:, :, 0] / lengths(tangents[:, :, 0])[..., None]
    second = cross(area_vectors / areas[:, :, None], first)
    return MatchedFacets(
        block_m=blocks[0],
        block_s=blocks[1],
        quads_m=quads[0],
        quads_s=quads[1],
        functions=basis.difference[None],
        slopes=np.ascontiguousarray(basis.mean_slopes.transpose(0, 2, 1))[None],
        offsets=offsets,
        tangents=tangents,
        sides=np.stack([first, second], axis=2),
        weights=areas * basis.weights,
        clearance=clearance,
        facet=np.arange(len(blocks[0])),
        basis=basis,
        **of_no_system(len(blocks[0]), basis.difference.shape[-1]),
    )


def contact_surfaces(
    assembly: Assembly, moved: FloatArray | None = None, *, clearance: float = 0.0
) -> MatchedFacets:
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
    nodes_m = placed_corners(assembly, interfaces.block_m, quads_m, origin)
    nodes_s = placed_corners(assembly, interfaces.block_s, quads_s, origin)
    m, s = interfaces.block_m, interfaces.block_s
    apart = None if moved is None else moved[s] - moved[m]
    return matched_facets(
        (m, s),
        (quads_m, quads_s),
        (nodes_m, nodes_s),
        basis_of(quads_m),
        apart=apart,
        clearance=clearance,
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


def placed_corners(
    assembly: Assembly, blocks: IntArray, quads: IntArray, origin: FloatArray | float = 0.0
) -> FloatArray:
    """Positions of nodes of facets (n, m) from an origin on, world axes, (n, m, 3) [mm]."""
    corners = np.empty((*quads.shape, 3))
    order = np.argsort(blocks, kind="stable")
    present, first = np.unique(blocks[order], return_index=True)
    for block, members in zip(present.tolist(), np.split(order, first[1:]), strict=False):
        shift = assembly.translations[block] - origin
        corners[members] = (
            assembly.shape(block).mesh.nodes[quads[members]] @ assembly.rotations[block].T + shift
        )
    return corners


def check_initial_overlap(surfaces: MatchedFacets, law: ContactLaw, clearance: float = 0.0) -> None:
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
        "blocks that touch: correct the placement or raise `clearance`"
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


@dataclass(frozen=True)
class CurrentFrame:
    """Where points have moved."""

    d: FloatArray
    """x_s - x_m, (n, n_points, 3) [mm]."""
    tangents: FloatArray
    """Whose normal counts, (n, n_points, 2, 3) [mm]."""
    normal: FloatArray
    """From m to s, (n, n_points, 3)."""
    area: FloatArray
    """|a|, (n, n_points) [mm²]."""
    gap: FloatArray
    """n · d, (n, n_points) [mm]."""
    slip: FloatArray
    """e = (d - n (n · d)) / |a|, (n, n_points, 3) [1/mm]."""

    @property
    def by_tangents(self) -> FloatArray:
        """Derivatives of the overclosure by both tangents, (n, n_points, 2, 3) [-].

        ∂(overclosure)/∂a = -e; a = t_1 × t_2 turns it into t_2 × (-e) and (-e) × t_1.
        """
        first, second = np.moveaxis(self.tangents, 2, 0)
        return np.stack([cross(self.slip, second), cross(first, self.slip)], axis=2)


def corner_overclosures(surfaces: MatchedFacets, moved: FloatArray) -> FloatArray:
    """Overclosures where facets are looked at for peaks, (n, n_looks) [mm].

    Of bilinear facets these are the corners: between them a gap is bilinear but for the turning of
    the normal, and its extremes are here. Tangents and d are polynomials, so their values at the
    Gauss points say those everywhere.
    """
    frame, to_looks = surfaces.frame(moved), surfaces.basis.to_looks
    there = to_looks @ frame.tangents.reshape(*frame.tangents.shape[:2], 6)
    vector: FloatArray = cross(there[..., :3], there[..., 3:])
    normal: FloatArray = vector / lengths(vector)[..., None]
    return -np.einsum("fci,fci->fc", normal, to_looks @ frame.d) - surfaces.clearance


def motion_derivatives(
    surfaces: ContactPoints, moved: FloatArray, motions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """First and second derivative of the overclosure by motions.

    Parameters
    ----------
    surfaces
        Facets in contact.
    moved
        Where their nodes are, (n, nodes of both, 3) [mm].
    motions
        Displacements of the nodes of both facets by unit motions, (n, nodes of both, 3, n_motions).

    Returns
    -------
    tuple[FloatArray, FloatArray]
        (n, n_points, n_motions) and (n, n_points, n_motions, n_motions).
    """
    frame = surfaces.frame(moved)
    first = np.concatenate([-frame.normal[:, :, None], frame.by_tangents], axis=2)
    first = first.reshape(*first.shape[:2], 9)
    factors, n_motions = _frame_factors(surfaces), motions.shape[3]
    way = factors.reshape(len(factors), -1, factors.shape[3]) @ motions.reshape(
        *motions.shape[:2], 3 * n_motions
    )
    way = way.reshape(*first.shape, n_motions)
    gradient = (first[:, :, None] @ way)[:, :, 0]
    return gradient, _transposed(way) @ _second_derivatives(frame) @ way


def _frame_factors(surfaces: ContactPoints) -> FloatArray:
    """Weights of the nodes of both facets in d, t_1 and t_2, (…, n_points, 3, nodes of both)."""
    return np.concatenate([surfaces.functions[:, :, None], surfaces.slopes], axis=2)


def _second_derivatives(frame: CurrentFrame) -> FloatArray:
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
    turn = np.concatenate(
        [-cross_matrix(frame.tangents[:, :, 1]), cross_matrix(frame.tangents[:, :, 0])], axis=3
    )
    hessian = np.zeros((*frame.area.shape, 9, 9))
    hessian[..., 3:, :3] = _transposed(turn) @ by_a_d
    hessian[..., :3, 3:] = _transposed(hessian[..., 3:, :3])
    hessian[..., 3:, 3:] = _transposed(turn) @ by_a_a @ turn
    hessian[..., 3:6, 6:] += cross_matrix(e)
    hessian[..., 6:, 3:6] -= cross_matrix(e)
    return hessian


def _transposed(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2)


# ---------------------------------------------------------------------------------------------
# Forces


def facet_pressures(surfaces: ContactPoints, point_pressures: FloatArray) -> FloatArray:
    """Mean pressure of each facet, its force over its area; (n,) [MPa]."""
    return (surfaces.weights * point_pressures).sum(axis=1) / surfaces.areas
