"""Unit wrenches of the contacts between two blocks, as sums and products over block pairs.

All contacts of a pair act through one six-dimensional wrench, and congruent pairs have the same
contacts, seen from their frame. So products with the unit wrenches are products of small dense
matrices, one for each kind of pair: of a tube some fourteen, however many blocks it has.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from geometry.mesh import FloatArray, IntArray

#: The 21 pairs (i, j) with i <= j of a symmetric 6 × 6 matrix.
_UPPER = np.triu_indices(6)


def _symmetric(upper: FloatArray) -> FloatArray:
    """Symmetric matrices (n, 6, 6) of their upper triangles (n, 21)."""
    full = np.empty((len(upper), 6, 6))
    full[:, _UPPER[0], _UPPER[1]] = upper
    full[:, _UPPER[1], _UPPER[0]] = upper
    return full


def _upper_products(wrenches: FloatArray) -> FloatArray:
    """Upper triangles of g gᵀ, (n, 21)."""
    return wrenches[:, _UPPER[0]] * wrenches[:, _UPPER[1]]


@dataclass(frozen=True)
class SeparateWrenches:
    """Contacts that have nothing in common."""

    wrenches: FloatArray
    """(n_contacts, 6), contacts of a pair one after the other."""
    pair_start: IntArray
    """First contact of each pair, and the total; (n_pairs + 1,)."""

    @property
    def n_contacts(self) -> int:
        """Number of contacts."""
        return len(self.wrenches)

    @cached_property
    def pair_of(self) -> IntArray:
        """Pair of each contact, (n_contacts,)."""
        count = np.diff(self.pair_start)
        return np.repeat(np.arange(len(count)), count)

    @cached_property
    def _products(self) -> FloatArray:
        return _upper_products(self.wrenches)

    def _sums(self, values: FloatArray) -> FloatArray:
        if not len(values):
            return np.zeros((len(self.pair_start) - 1, values.shape[1]))
        return np.add.reduceat(values, self.pair_start[:-1], axis=0)

    def rates(self, motion: FloatArray) -> FloatArray:
        """Gap rates (n_contacts,) of relative motions of the pairs (n_pairs, 6)."""
        return np.einsum("ci,ci->c", self.wrenches, motion[self.pair_of])

    def sums(self, forces: FloatArray) -> FloatArray:
        """Wrenches of the pairs (n_pairs, 6) from contact forces (n_contacts,)."""
        return self._sums(self.wrenches * forces[:, None])

    def squares(self, weights: FloatArray) -> FloatArray:
        """Sums Σ w g gᵀ over the contacts of each pair, (n_pairs, 6, 6)."""
        return _symmetric(self._sums(self._products * weights[:, None]))

    def separate(self) -> SeparateWrenches:
        """Return itself."""
        return self


@dataclass(frozen=True)
class PairKind:
    """Pairs with the same contacts."""

    wrenches: FloatArray
    """(n, 6), in the frame of the pair."""
    pairs: IntArray
    """Pairs of this kind, (k,)."""
    contacts: IntArray
    """Place of each contact of each of them, (k, n)."""

    @cached_property
    def products(self) -> FloatArray:
        """Upper triangles of g gᵀ, (n, 21)."""
        return _upper_products(self.wrenches)


@dataclass(frozen=True)
class CongruentWrenches:
    """Contacts of pairs of a few kinds, each kind kept once."""

    kinds: tuple[PairKind, ...]
    pair_start: IntArray
    """First contact of each pair, and the total; (n_pairs + 1,)."""

    @property
    def n_contacts(self) -> int:
        """Number of contacts."""
        return int(self.pair_start[-1])

    def rates(self, motion: FloatArray) -> FloatArray:
        """Gap rates (n_contacts,) of relative motions of the pairs (n_pairs, 6)."""
        rates = np.empty(self.n_contacts)
        for kind in self.kinds:
            rates[kind.contacts] = motion[kind.pairs] @ kind.wrenches.T
        return rates

    def sums(self, forces: FloatArray) -> FloatArray:
        """Wrenches of the pairs (n_pairs, 6) from contact forces (n_contacts,)."""
        total = np.empty((len(self.pair_start) - 1, 6))
        for kind in self.kinds:
            total[kind.pairs] = forces[kind.contacts] @ kind.wrenches
        return total

    def squares(self, weights: FloatArray) -> FloatArray:
        """Sums Σ w g gᵀ over the contacts of each pair, (n_pairs, 6, 6)."""
        upper = np.empty((len(self.pair_start) - 1, 21))
        for kind in self.kinds:
            upper[kind.pairs] = weights[kind.contacts] @ kind.products
        return _symmetric(upper)

    def separate(self) -> SeparateWrenches:
        """Return the same contacts one by one, each in the frame of its pair."""
        wrenches = np.empty((self.n_contacts, 6))
        for kind in self.kinds:
            wrenches[kind.contacts] = kind.wrenches
        return SeparateWrenches(wrenches, self.pair_start)


#: Unit wrench (n, (x - x_pair) × n / ℓ) of each contact about its pair's point.
PairWrenches: TypeAlias = SeparateWrenches | CongruentWrenches
