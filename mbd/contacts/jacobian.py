"""Contact Jacobian G: one column per contact, six rows per free block (eq. gap-variation).

The reference point of each block is its mass centroid and moments are divided by a
characteristic length, so a row is a force in every unit system and no result depends on units:
a virtual displacement is (δt, ℓ δθ), a wrench is (F, M/ℓ).

All contacts between two blocks act through one six-dimensional wrench, and congruent pairs of
blocks have the same contacts, so products and normal matrices cost little even with 500 000
contacts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import scipy.linalg
import scipy.sparse

from geometry.interface import Interfaces
from geometry.machine.work import Operation, count
from geometry.mesh import (
    BoolArray,
    FloatArray,
    IntArray,
    ReadOnlyArrays,
    cross_matrix,
    read_only,
    run_starts,
)
from geometry.parts.placed import AnyBlocks
from geometry.parts.regions import HeldFace
from mbd.contacts.supports import admissible, free_motions

Value = TypeVar("Value")

#: A normal matrix, or the inverse of one, which also takes several vectors as columns.
NormalMap = Callable[[FloatArray], FloatArray]


#: Part of a load that is left where supports take it, by the digits of their directions.
_ROUND_OFF = 1e-9
#: Blocks by which neighbours may lie apart in the stated order, and a better one is not looked for.
_NARROW = 10
#: The 21 pairs (i, j) with i <= j of a symmetric 6 × 6 matrix.
_UPPER = np.triu_indices(6)


@dataclass(frozen=True)
class PairKind(ReadOnlyArrays):
    """Pairs with the same contacts, or with as many."""

    wrenches: FloatArray
    """Of each of the k pairs in its frame, (k, n, 6); (1, n, 6) where all have the same."""
    pairs: IntArray
    """Pairs of this kind, (k,)."""
    contacts: IntArray
    """Place of each contact of each of them, (k, n)."""

    @cached_property
    def products(self) -> FloatArray:
        """Upper triangles of g gᵀ, (k or 1, n, 21)."""
        return self.wrenches[..., _UPPER[0]] * self.wrenches[..., _UPPER[1]]

    @cached_property
    def triangle(self) -> FloatArray:
        """At most six wrenches a pair with the same Σ g gᵀ, (k or 1, ≤ 6, 6)."""
        return np.linalg.qr(self.wrenches, mode="r")

    def sums(self, values: FloatArray, of: FloatArray) -> FloatArray:
        """Sums over the contacts of each pair of values (n_contacts,) times rows (k or 1, n, m)."""
        own = values[self.contacts]
        return own @ of[0] if len(of) == 1 else np.einsum("kn,knm->km", own, of)


@dataclass(frozen=True)
class PairWrenches(ReadOnlyArrays):
    """Unit wrenches (n, (x - x_pair) × n / ℓ) of the contacts, each kind of pairs kept once."""

    kinds: tuple[PairKind, ...]
    pair_start: IntArray
    """First contact of each pair, and the total; (n_pairs + 1,)."""

    @staticmethod
    def of_each(wrenches: FloatArray, pair_start: IntArray) -> PairWrenches:
        """Contacts (n_contacts, 6) of pairs that have nothing in common but their number."""
        count, kinds = np.diff(pair_start), []
        for number in np.unique(count).tolist():
            pairs = np.flatnonzero(count == number)
            contacts = pair_start[pairs][:, None] + np.arange(number)
            kinds.append(PairKind(wrenches[contacts], pairs, contacts))
        return PairWrenches(tuple(kinds), pair_start)

    @cached_property
    def each(self) -> FloatArray:
        """Wrench of each contact in the frame of its pair, (n_contacts, 6)."""
        wrenches = np.empty((self.n_contacts, 6))
        for kind in self.kinds:
            wrenches[kind.contacts] = kind.wrenches
        return wrenches

    @property
    def n_contacts(self) -> int:
        """Number of contacts."""
        return int(self.pair_start[-1])

    def rates(self, motion: FloatArray) -> FloatArray:
        """Gap rates (n_contacts,) of relative motions of the pairs (n_pairs, 6)."""
        rates = np.empty(self.n_contacts)
        for kind in self.kinds:
            own = motion[kind.pairs]
            if len(kind.wrenches) == 1:
                rates[kind.contacts] = own @ kind.wrenches[0].T
            else:
                rates[kind.contacts] = np.einsum("knm,km->kn", kind.wrenches, own)
        return rates

    def condensed_rates(self, motions: FloatArray) -> FloatArray:
        """Rows (n, k) with the products of the gap rates of relative motions (n_pairs, 6, k)."""
        rows = [kind.triangle @ motions[kind.pairs] for kind in self.kinds]
        return np.concatenate([row.reshape(-1, motions.shape[2]) for row in rows])

    def sums(self, forces: FloatArray) -> FloatArray:
        """Wrenches of the pairs (n_pairs, 6) from contact forces (n_contacts,)."""
        total = np.empty((len(self.pair_start) - 1, 6))
        for kind in self.kinds:
            total[kind.pairs] = kind.sums(forces, kind.wrenches)
        return total

    def squares(self, weights: FloatArray) -> FloatArray:
        """Sums Σ w g gᵀ over the contacts of each pair, (n_pairs, 6, 6)."""
        upper = np.empty((len(self.pair_start) - 1, len(_UPPER[0])))
        for kind in self.kinds:
            upper[kind.pairs] = kind.sums(weights, kind.products)
        full = np.empty((len(upper), 6, 6))
        full[:, _UPPER[0], _UPPER[1]] = full[:, _UPPER[1], _UPPER[0]] = upper
        return full


def _block_places(rows: IntArray, columns: IntArray) -> tuple[IntArray, IntArray]:
    """Row and column of each entry of 6 × 6 blocks, (n, 6, 6) each."""
    six = np.arange(6)
    i = np.repeat(6 * rows[:, None, None] + six[:, None], 6, axis=2)
    j = np.repeat(6 * columns[:, None, None] + six, 6, axis=1)
    return i, j


@dataclass(frozen=True)
class ContactJacobian(ReadOnlyArrays):
    """G of an assembly, contacts grouped by block pair (m, s)."""

    contacts: PairWrenches
    """Unit wrenches of the contacts, each in the frame of its pair."""
    transfer_m: FloatArray
    """Moves a pair wrench to block m's centroid and to world axes; zero where m is fixed;
    (n_pairs, 6, 6)."""
    transfer_s: FloatArray
    """The same for block s, (n_pairs, 6, 6)."""
    row_m: IntArray
    """Free-block number of m (0 where m is fixed: its transfer is zero), (n_pairs,)."""
    row_s: IntArray
    """Free-block number of s, (n_pairs,)."""
    n_free: int
    """Number of free blocks."""
    motions: FloatArray | None = None
    """Projectors on the motions that supports leave, (n_free, 6, 6); None: all of them."""
    proved: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)
    """Results that do not depend on the load, by name: load cases of the same blocks share them."""

    def once(self, name: str, find: Callable[[], Value]) -> Value:
        """Result that follows from G alone, computed when it is first requested and cached."""
        if name not in self.proved:
            self.proved[name] = read_only(find())
        result: Value = self.proved[name]
        return result

    @property
    def shape(self) -> tuple[int, int]:
        """(6 n_free, n_contacts)."""
        return 6 * self.n_free, self.contacts.n_contacts

    def admissible(self, rows: FloatArray) -> FloatArray:
        """Part of some rows (6 n_free, …) that supports leave."""
        return rows if self.motions is None else admissible(self.motions, rows)

    @property
    def n_motions(self) -> int:
        """Independent motions that supports leave."""
        if self.motions is None:
            return self.shape[0]
        return round(float(np.trace(self.motions, axis1=1, axis2=2).sum()))

    @cached_property
    def _transfer(self) -> scipy.sparse.csr_array:
        """Both transfers as one matrix, (6 n_free, 6 n_pairs)."""
        n_pairs = len(self.row_m)
        rows = np.concatenate([self.row_m, self.row_s])
        columns = np.tile(np.arange(n_pairs), 2)
        i, j = _block_places(rows, columns)
        values = np.concatenate([-self.transfer_m, self.transfer_s])
        matrix = scipy.sparse.csr_array(
            scipy.sparse.coo_array(
                (values.ravel(), (i.ravel(), j.ravel())), shape=(self.shape[0], 6 * n_pairs)
            )
        )
        matrix.eliminate_zeros()
        return matrix

    @cached_property
    def _relative(self) -> scipy.sparse.csr_array:
        """Motion of s against m of each pair from those of the blocks, (6 n_pairs, 6 n_free)."""
        return scipy.sparse.csr_array(self._transfer.T)

    def gap_rates(self, virtual_displacement: FloatArray) -> FloatArray:
        """Gᵀ δq, (n_contacts,)."""
        return self.contacts.rates((self._relative @ virtual_displacement).reshape(-1, 6))

    def condensed_rates(self, directions: FloatArray) -> FloatArray:
        """Rows (n, k) whose products are those of Gᵀ times some directions (6 n_free, k).

        Congruent pairs need six rows each, however many contacts they have.
        """
        n_pairs, n = len(self.row_m), directions.shape[1]
        return self.contacts.condensed_rates((self._relative @ directions).reshape(n_pairs, 6, n))

    def resultant(self, forces: FloatArray) -> FloatArray:
        """G λ, (6 n_free,)."""
        return self._transfer @ self.contacts.sums(forces).ravel()

    @cached_property
    def _band(self) -> tuple[IntArray, int]:
        """Place of each free block in a narrow band, and its half bandwidth in rows.

        Builders number blocks course by course, which is narrower for a shell than what reduces
        the bandwidth of any graph.
        """
        stated = np.arange(self.n_free)

        def reach(position: IntArray) -> int:
            return int(np.abs(position[self.row_m] - position[self.row_s]).max(initial=0))

        if reach(stated) <= _NARROW:
            return stated, 6 * reach(stated) + 5
        from scipy.sparse.csgraph import reverse_cuthill_mckee

        graph = scipy.sparse.coo_array(
            (np.ones(len(self.row_m)), (self.row_m, self.row_s)), shape=(self.n_free,) * 2
        ).tocsr()
        together = scipy.sparse.csr_array(graph + graph.T)
        reordered = np.empty_like(stated)
        reordered[reverse_cuthill_mckee(together, symmetric_mode=True)] = stated
        position = min(reordered, stated, key=reach)
        return position, 6 * reach(position) + 5

    @cached_property
    def _band_places(self) -> tuple[IntArray, IntArray]:
        """Entries of `_block_entries` in the lower triangle, and where they are in its band."""
        position, half_band = self._band
        m, s = position[self.row_m], position[self.row_s]
        i, j = _block_places(np.concatenate([m, s, m]), np.concatenate([m, s, s]))
        # A block off the diagonal is there once, above or below it; one on it is there whole.
        low, high = np.minimum(i, j), np.maximum(i, j)
        lower = i >= j
        lower[2 * len(m) :] = True
        return np.flatnonzero(lower), (low * half_band + high)[lower]

    def _block_entries(self, weights: FloatArray) -> FloatArray:
        """6 × 6 blocks (m, m), (s, s) and (m, s) of G diag(weights) Gᵀ, (3 n_pairs, 6, 6)."""
        pair = self.contacts.squares(weights)
        left_m, left_s = self.transfer_m @ pair, self.transfer_s @ pair
        t_m, t_s = self.transfer_m.transpose(0, 2, 1), self.transfer_s.transpose(0, 2, 1)
        return np.concatenate([left_m @ t_m, left_s @ t_s, -left_m @ t_s])

    def normal_product(self) -> NormalMap:
        """Product with G Gᵀ, without a walk over the contacts."""
        pair = self.contacts.squares(np.ones(self.contacts.n_contacts))

        def product(vector: FloatArray) -> FloatArray:
            relative = (self._relative @ vector).reshape(-1, 6, 1)
            return self._transfer @ (pair @ relative).ravel()

        return product

    def normal_solver(self, weights: FloatArray, shift: float) -> NormalMap:
        """Factor G diag(weights) Gᵀ + shift I by a banded Cholesky decomposition.

        Raises
        ------
        LimitError
            A limit is reached.
        """
        position, half_band = self._band
        entries, places = self._band_places
        n = self.shape[0]
        count(Operation.DENSE, 0.5 * n * half_band**2)
        count(Operation.ENTRY, 2.0 * n * (half_band + 1) + self.contacts.n_contacts)
        band = np.bincount(
            places,
            weights=self._block_entries(weights).ravel()[entries],
            minlength=(half_band + 1) * n,
        ).reshape(n, half_band + 1)
        band = band.T  # as LAPACK has it: factored in place
        band[0] += shift
        factor = scipy.linalg.cholesky_banded(
            band, lower=True, overwrite_ab=True, check_finite=False
        )
        scatter = (6 * position[:, None] + np.arange(6)).ravel()

        def solve(right_hand_side: FloatArray) -> FloatArray:
            ordered = np.empty_like(right_hand_side)
            ordered[scatter] = right_hand_side
            x = scipy.linalg.cho_solve_banded((factor, True), ordered, check_finite=False)
            return x[scatter]

        return solve

    @cached_property
    def _pairs_of_blocks(self) -> tuple[IntArray, IntArray]:
        """Sides of pairs sorted by free block, then by pair, and the first of each block.

        Side 2 k is block m of pair k, 2 k + 1 its block s; sides of fixed blocks are left out.
        """
        moves = [transfer.any(axis=(1, 2)) for transfer in (self.transfer_m, self.transfer_s)]
        blocks = np.column_stack([self.row_m, self.row_s]).ravel()
        blocks = np.where(np.column_stack(moves).ravel(), blocks, self.n_free)
        sides = np.argsort(blocks, kind="stable")
        return sides, np.searchsorted(blocks[sides], np.arange(self.n_free + 1))

    def wrenches_on(self, block: int) -> FloatArray:
        """Columns of the contacts of one free block in its rows of G, (6, n)."""
        sides, first = self._pairs_of_blocks
        columns = [np.zeros((6, 0))]
        wrenches, start = self.contacts.each, self.contacts.pair_start
        for side in sides[first[block] : first[block + 1]].tolist():
            pair, of_s = divmod(side, 2)
            transfer = self.transfer_s[pair] if of_s else -self.transfer_m[pair]
            columns.append(transfer @ wrenches[start[pair] : start[pair + 1]].T)
        return np.hstack(columns)

    def to_matrix(self) -> scipy.sparse.csc_array:
        """G as a sparse matrix, (6 n_free, n_contacts)."""
        contacts = self.contacts
        pair_of = np.repeat(np.arange(len(self.row_m)), np.diff(contacts.pair_start))
        rows = 6 * pair_of[:, None] + np.arange(6)
        start = 6 * np.arange(contacts.n_contacts + 1)
        unit = scipy.sparse.csc_array(
            (contacts.each.ravel(), rows.ravel(), start),
            shape=(self._transfer.shape[1], contacts.n_contacts),
        )
        matrix = scipy.sparse.csc_array(self._transfer @ unit)
        matrix.eliminate_zeros()
        return matrix


@dataclass(frozen=True)
class RigidContacts(ReadOnlyArrays):
    """The contacts that touch at least one free block, and what belongs to them."""

    jacobian: ContactJacobian
    """G, moments divided by `length`."""
    index: IntArray
    """Position of each contact in the assembly's interfaces, (n_contacts,)."""
    block_m: IntArray
    """Master block, (n_contacts,)."""
    block_s: IntArray
    """Opposing block, (n_contacts,)."""
    areas: FloatArray
    """Facet areas, (n_contacts,) [mm²]."""
    free_blocks: IntArray
    """Block number of each group of six rows, (n_free,)."""
    length: float
    """Characteristic length ℓ [mm]."""

    def rows(self, wrenches: FloatArray) -> FloatArray:
        """Stack (F, M/ℓ) of the free blocks in the order of G, less what supports take.

        From force and moment about each block's mass centroid, (n_blocks, 6) [N, N mm]; (6 n_free,)
        [N].
        """
        scaled = np.array(wrenches[self.free_blocks], dtype=np.float64)
        scaled[:, 3:] /= self.length
        left = self.jacobian.admissible(scaled.ravel()).reshape(-1, 6)
        # What supports take leaves round-off, which is no load.
        least = _ROUND_OFF * np.linalg.norm(scaled, axis=1)
        return np.where(np.linalg.norm(left, axis=1) <= least, 0.0, left.T).T.ravel()

    @cached_property
    def joints(self) -> tuple[IntArray, IntArray]:
        """Pairs of blocks that touch, (n_joints, 2), and the joint of each contact."""
        pairs = np.column_stack([self.block_m, self.block_s])
        joints, of = np.unique(pairs, axis=0, return_inverse=True)
        return joints, of.ravel()


def _transfer(
    points: FloatArray, centroids: FloatArray, length: float, axes: FloatArray | None
) -> FloatArray:
    """Matrices that move a wrench (F, M/ℓ) from points to centroids, (n, 6, 6).

    ``axes`` (n, 3, 3) turn it to world axes as well, where it is given in others.
    """
    out = np.zeros((len(points), 6, 6))
    out[:, range(6), range(6)] = 1.0
    out[:, 3:, :3] = cross_matrix(points - centroids) / length
    if axes is None:
        return out
    turn = np.zeros_like(out)
    turn[:, :3, :3] = turn[:, 3:, 3:] = axes
    return out @ turn


@dataclass(frozen=True)
class _Pairs(ReadOnlyArrays):
    """Contacts between pairs of blocks, of which one at least is free."""

    index: IntArray
    """Position of each contact in the assembly's interfaces."""
    start: IntArray
    """First contact of each pair, and the total."""
    points: FloatArray
    normals: FloatArray
    length: float

    @cached_property
    def middle(self) -> FloatArray:
        """Mean of the contact points of each pair, (n_pairs, 3) [mm]."""
        if not len(self.points):
            return np.zeros((0, 3))
        total = np.add.reduceat(self.points, self.start[:-1], axis=0)
        return total / np.diff(self.start)[:, None]

    def wrenches(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Unit wrenches of normals at points given from their pair's middle, (n, 6)."""
        return np.hstack([normals, np.cross(points, normals) / self.length])


def _separate(pairs: _Pairs) -> PairWrenches:
    """Contacts of which nothing more is known, in world axes."""
    arm = pairs.points - np.repeat(pairs.middle, np.diff(pairs.start), axis=0)
    return PairWrenches.of_each(pairs.wrenches(arm, pairs.normals), pairs.start)


def _congruent(pairs: _Pairs, interfaces: Interfaces) -> tuple[PairWrenches, FloatArray]:
    """Contacts of each kind of pair once, in the axes of block m; and these axes."""
    of = np.searchsorted(interfaces.pair_start, pairs.index[pairs.start[:-1]], side="right") - 1
    axes, kind_of = interfaces.pair_rotations[of], interfaces.pair_class[of]
    kinds = []
    for kind in np.unique(kind_of).tolist():
        indices = np.flatnonzero(kind_of == kind)
        first = int(indices[0])
        here = slice(int(pairs.start[first]), int(pairs.start[first + 1]))
        arm = (pairs.points[here] - pairs.middle[first]) @ axes[first]
        contacts = pairs.start[indices][:, None] + np.arange(here.stop - here.start)
        normals = pairs.normals[here] @ axes[first]
        kinds.append(PairKind(pairs.wrenches(arm, normals)[None], indices, contacts))
    return PairWrenches(tuple(kinds), pairs.start), axes


def contact_jacobian(
    assembly: AnyBlocks, fixed: BoolArray | None = None, supports: tuple[HeldFace, ...] = ()
) -> RigidContacts:
    """Assemble G for the contacts of an assembly (eq. gap-variation).

    Blocks that are held, by default the frame, have no rows; contacts between two of them are left
    out: they constrain nothing. Rows of blocks with supports are of the motions that these leave.
    Without supports it is kept with the assembly: load cases of the same blocks have the same.

    Raises
    ------
    RigidSupportError
        Springs, and supports that move.
    """
    held = assembly.fixed if fixed is None else fixed
    if supports:
        return _contacts(assembly, held, supports)
    key = "contact Jacobian", held.tobytes()
    if key not in assembly.kept:
        assembly.kept[key] = _contacts(assembly, held, ())
    result: RigidContacts = assembly.kept[key]
    return result


def _contacts(
    assembly: AnyBlocks, held: BoolArray, supports: tuple[HeldFace, ...]
) -> RigidContacts:
    """Assemble G of blocks, some of which are held as a whole, (n_blocks,)."""
    interfaces = assembly.interfaces
    index = np.flatnonzero(~(held[interfaces.block_m] & held[interfaces.block_s]))
    block_m, block_s = interfaces.block_m[index], interfaces.block_s[index]
    start = run_starts(block_m, block_s)
    length = assembly.characteristic_length
    pairs = _Pairs(index, start, interfaces.centroids[index], interfaces.normals[index], length)
    contacts: PairWrenches
    if isinstance(interfaces, Interfaces):
        contacts, axes = _congruent(pairs, interfaces)
    else:
        contacts, axes = _separate(pairs), None
    middle = pairs.middle
    number = np.cumsum(~held) - 1
    pair_m, pair_s = block_m[start[:-1]], block_s[start[:-1]]
    transfer_m = _transfer(middle, assembly.centroids[pair_m], length, axes)
    transfer_s = _transfer(middle, assembly.centroids[pair_s], length, axes)
    transfer_m[held[pair_m]] = 0.0
    transfer_s[held[pair_s]] = 0.0
    free = np.flatnonzero(~held)
    motions = free_motions(assembly, supports, free, length) if supports else None
    if motions is not None:
        transfer_m, transfer_s = (
            admissible(motions[np.where(held[pair], 0, number[pair])], transfer)
            for pair, transfer in ((pair_m, transfer_m), (pair_s, transfer_s))
        )
    jacobian = ContactJacobian(
        contacts=contacts,
        transfer_m=transfer_m,
        transfer_s=transfer_s,
        row_m=np.where(held[pair_m], number[pair_s], number[pair_m]),
        row_s=np.where(held[pair_s], number[pair_m], number[pair_s]),
        n_free=len(free),
        motions=motions,
    )
    return RigidContacts(
        jacobian=jacobian,
        index=index,
        block_m=block_m,
        block_s=block_s,
        areas=interfaces.areas[index],
        free_blocks=free,
        length=length,
    )
