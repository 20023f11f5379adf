"""The verdict on a load, and what edges and corners change of it.

Blocks touch at two sets of contacts, whatever the friction: on *faces*, and on *faces with edges
and corners* (`PolyhedralAssembly.bearing`). The verdict of an answer is that of faces.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan
from typing import Any, NamedTuple

from geometry.parts.rows import Row, finite, grouped
from mbd.frictionless.mechanism import Classification, MechanismClass

#: What a load takes that does not press the joints itself.
_SQUEEZED = {
    False: "",
    True: " if pressed beforehand (a hint, not proved)",
    None: " if the load presses the joints itself (not decided)",
}


def carried_words(holds: bool | None, squeezed: bool | None = False) -> str:
    """Whether a load is carried, and under which condition: fields of `Verdict`."""
    if holds:
        return f"carried{_SQUEEZED[squeezed]}"
    return "not decided" if holds is None else "not carried"


class Verdict(NamedTuple):
    """Verdict on a load, of blocks that touch at one set of contacts."""

    mechanism: MechanismClass
    """Class without friction."""
    holds: bool | None
    """Whether forces balance the load; None: neither they nor a mechanism are proved."""
    squeezed: bool | None = False
    """Whether joints seem to need a squeeze beforehand; None where the limit of work came first."""

    @property
    def condition(self) -> str:
        """Further condition, in words; empty where there is none."""
        return _SQUEEZED[self.squeezed] if self.holds else ""

    @property
    def carried(self) -> str:
        """Whether the load is carried, in words."""
        return carried_words(self.holds, self.squeezed)


def _factor_words(factor: float) -> str:
    return "none" if isnan(factor) else f"{factor:.6g}".replace("inf", "unbounded")


@dataclass(frozen=True)
class EdgesAndCorners:
    """Verdicts without and with the contacts of edges and corners."""

    n_contacts: int
    """Contacts that are left out."""
    faces: Verdict
    """Without them: that of the answer."""
    both: Verdict
    """With them."""
    factors: tuple[float, float] | None
    """Load factors at collapse without and with them; None where they are not asked."""
    classification: Classification
    """With them."""

    @property
    def words(self) -> str:
        """Change of the verdict; empty where there is none."""
        faces, both = self.faces, self.both
        if both.holds and faces.holds is False:
            held = "held by edges and corners alone: faces alone do not carry"
            return f"{held}; with both {both.carried}" if both.squeezed is not False else held
        changed = [both.carried] if both.carried != faces.carried else []
        if self.classification.locked and faces.mechanism is not MechanismClass.LOCKED:
            changed.insert(0, "locked")
        return f"with edges and corners: {', '.join(changed)}" if changed else ""

    @property
    def rows(self) -> list[Row]:
        """The verdict and the limit load with edges and corners; the proof of another class."""
        words = "nothing to the verdict"
        if self.words:
            words = f"verdict: {self._named}"
        if self.factors is not None:
            without, factor = map(_factor_words, self.factors)
            words += f"; limit load factor {factor} for {without}"
        left = f"({self.n_contacts} contacts without area, left out: a chamfer removes them)"
        proof = []
        if self.both.mechanism is not self.faces.mechanism:
            proof = [Row("proof with edges and corners", self.classification.proof)]
        return grouped(
            verdict=[Row("edges and corners would add", f"{words} {left}")], evidence=proof
        )

    @property
    def _named(self) -> str:
        """Verdict with them."""
        return f"{'locked, ' * self.classification.locked}{self.both.carried}"

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "n_contacts": self.n_contacts,
            **self.classification.as_json(),
            "carried": self.both.holds,
            "squeeze_needed": self.both.squeezed,
            "collapse_factor": None if self.factors is None else finite(self.factors[1]),
        }
