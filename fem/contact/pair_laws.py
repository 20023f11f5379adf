"""Contact laws of some pairs of blocks: each joint has its law, the others have a default.

Solvers call `ContactLaw.on` with the blocks of their facets or points. Where all of these have one
law they get that law itself, so a problem with one law runs no code of this file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from fem.contact.law import ContactLaw
from fem.contact.own_law import PressureLaw, as_law
from geometry.mesh import FloatArray, IntArray
from geometry.parts.pairs import OfPairs, pair_values


class _SomeLaws(ContactLaw):
    """Bounds of several laws, on the side of the first contact and of the least overlap."""

    name = "pairs"

    @property
    def start(self) -> float:
        """Overclosure at which the first of the laws begins [mm]."""
        return min(law.start for law in self.members)

    @property
    def touching_stiffness(self) -> float:
        """Stiffness of the softest at zero clearance [MPa/mm]."""
        return min(law.touching_stiffness for law in self.members)

    @property
    def largest_initial_overclosure(self) -> float:
        """Overclosure that every law takes at the start [mm]."""
        return min(law.largest_initial_overclosure for law in self.members)

    def allowed_overclosure(self, clearance: float) -> float:
        """Overclosure that every law takes at the start with a clearance [mm]."""
        return min(law.allowed_overclosure(clearance) for law in self.members)


@dataclass(frozen=True)
class PairLaws(_SomeLaws):
    """A contact law for all joints but those of some pairs of blocks, which have their own.

    ``PairLaws(ExponentialLaw(), ((0, 1, LinearPenalty(500.0)),))``
    """

    default: ContactLaw | PressureLaw
    """Law of pairs that are not named."""
    of_pairs: tuple[tuple[int, int, ContactLaw | PressureLaw], ...]
    """Blocks and their law, whichever of the two is named first."""

    @cached_property
    def members(self) -> tuple[ContactLaw, ...]:
        """The default, then each other law once."""
        result: list[ContactLaw] = []
        for law in map(as_law, [self.default, *(pair[2] for pair in self.of_pairs)]):
            result += [law] * (law not in result)
        return tuple(result)

    @cached_property
    def numbers(self) -> OfPairs:
        """Pairs and the place of their law in `members`."""
        return tuple((a, b, float(self.members.index(as_law(law)))) for a, b, law in self.of_pairs)

    def on(self, block_m: IntArray, block_s: IntArray) -> ContactLaw:
        """Law of each of some joints, blocks (n,) each; one law where all have it."""
        result = np.asarray(pair_values(0.0, self.numbers, block_m, block_s), dtype=np.int64)
        which = np.broadcast_to(result, block_m.shape)
        if len(which) and (which == which[0]).all():
            return self.members[which[0]]
        return LawOfPoints(self.members, which) if len(which) else self.members[0]

    def __str__(self) -> str:
        """The default and the number of pairs."""
        return f"{self.default} and others between {len(self.of_pairs)} pairs"


@dataclass(frozen=True)
class LawOfPoints(_SomeLaws):
    """Laws of facets or points: each has one of some laws."""

    laws: tuple[ContactLaw, ...]
    """Some laws."""
    which: IntArray = field(repr=False)
    """Law of each facet or point, (n,)."""

    @property
    def members(self) -> tuple[ContactLaw, ...]:
        """All of the laws."""
        return self.laws

    def on(self, block_m: IntArray, block_s: IntArray) -> ContactLaw:  # noqa: ARG002
        """The same: the facets are known."""
        return self

    def one(self, point: int) -> ContactLaw:
        """Law of one facet or point."""
        return self.laws[self.which[point]]

    def stiffest(self, overclosure: FloatArray) -> int:
        """Place of the largest stiffness at overclosures (n,) [mm]."""
        return int(np.argmax(self.stiffness(overclosure)))

    @cached_property
    def table(self) -> FloatArray:
        """`LawConstants` of each facet or point, (n, 9), for compiled functions."""
        return np.array([law.constants for law in self.laws])[self.which]

    def _each(self, method: Callable[[ContactLaw], Any], at: npt.ArrayLike) -> FloatArray:
        """Values of each law where it acts; (n, …), or one number for all facets."""
        x = np.asarray(at, dtype=np.float64)
        which = self.which.reshape(-1, *(1,) * max(x.ndim - 1, 0))
        result = method(self.laws[0])(x)
        for k, law in enumerate(self.laws[1:], 1):
            result = np.where(which == k, method(law)(x), result)
        return np.asarray(result, dtype=np.float64)

    def pressure(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Pressure [MPa] at overclosures [mm], (n, …) or one for all."""
        return self._each(lambda law: law.pressure, overclosure)

    def stiffness(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Slope dp/dx [MPa/mm] at overclosures [mm], alike."""
        return self._each(lambda law: law.stiffness, overclosure)

    def stored_energy(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Energy per area [N/mm] at overclosures [mm], alike."""
        return self._each(lambda law: law.stored_energy, overclosure)

    def overclosure(self, pressure: npt.ArrayLike) -> FloatArray:
        """Overclosures [mm] for pressures [MPa], alike."""
        return self._each(lambda law: law.overclosure, pressure)
