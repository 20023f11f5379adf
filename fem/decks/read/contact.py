"""Contact of a deck: which blocks can meet, and by which interaction."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import KDTree

from fem.contact.friction import CoulombFriction
from fem.contact.law import ContactLaw
from fem.contact.pair_laws import PairLaws
from fem.decks.keywords import DeckError
from fem.decks.read.blocks import Blocks
from fem.decks.read.cards import Card
from fem.decks.read.model import ModelLines, Named, Step, friction_of, law_of
from fem.decks.read.words import Dialect
from geometry.assembly import Assembly
from geometry.files.hexahedral_solids import SURFACE
from geometry.mesh import BoolArray, IntArray
from geometry.parts.placed import UnmatchedJoint
from geometry.polyhedra.assembly import PolyhedralAssembly

#: Surfaces without a contact pair that are closer than this, in edges of their facets, could touch.
_NEAR = 0.5
#: The same in ∛V of the smallest block: no other block has room between.
_THIN = 0.25
#: Distance of the centres of such facets at most, in edges: those that meet along an edge alone are
#: farther apart.
_ASIDE = 0.75
#: Cosine of the angle between facets that face each other, at least.
_FACING = 0.7


@dataclass
class DeckContact:
    """Which blocks can meet, and by which interaction."""

    model: ModelLines
    blocks: Blocks
    pairs: dict[tuple[int, int], Named] = field(default_factory=dict)
    everywhere: Named | None = None
    """Of all surfaces."""
    clearances: set[float] = field(default_factory=set)
    small_sliding: bool = False
    surfaces: set[frozenset[str]] = field(default_factory=set)
    """Names of the two surfaces of each pair."""

    @property
    def stated(self) -> list[Named]:
        """Interactions, that of all surfaces first."""
        every = [self.everywhere] if self.everywhere else []
        return [*every, *self.pairs.values()]

    @property
    def clearance(self) -> float:
        """Along every normal [mm]."""
        return next(iter(self.clearances), 0.0)

    def read(self, steps: tuple[Step, ...]) -> None:
        """Read contact of the model data and of steps.

        Raises
        ------
        DeckError
            Naming the line of what is not read.
        """
        for card in [*self.model.other, *(card for step in steps for card in step.cards)]:
            word = card.keyword
            if word == "CONTACT PAIR":
                self._pairs(card)
            elif word == "CONTACT" and self.model.dialect is Dialect.CALCULIX:
                raise card.unread("which CalculiX ignores,")
            elif word == "CONTACT INCLUSIONS":
                if "ALL EXTERIOR" not in card.parameters and card.data:
                    raise card.unread("of some surfaces")
                every = dict(enumerate(np.arange(len(p.outer)) for p in self.blocks.parts))
                named = sorted(self.blocks.named(), key=lambda one: -max(map(len, one[1].values())))
                for name, facets in [*named, (SURFACE, every)]:
                    self.blocks.meet(name, facets)
            elif word == "CONTACT PROPERTY ASSIGNMENT":
                self._properties(card)
            elif word in {"CLEARANCE", "CONTACT CLEARANCE"}:
                key = "VALUE" if word == "CLEARANCE" else "CLEARANCE"
                self.clearances.add(card.number(card.line, card.parameter(key)))
                if len(self.clearances) > 1:
                    raise card.unread(f"{sorted(self.clearances)} mm in several pairs")

    def _pairs(self, card: Card) -> None:
        kind, adjust = card.option("TYPE"), card.option("ADJUST")
        if kind not in {"", "NODE TO SURFACE", "SURFACE TO SURFACE"}:
            raise card.unread(f"type={kind}")
        if adjust not in {"", "NO"} and card.number(card.line, adjust):
            raise card.unread(f"adjust={adjust}")
        stated = self.model.of("SURFACE INTERACTION", card.option("INTERACTION"), card)
        self.small_sliding |= "SMALL SLIDING" in card.parameters
        if not card.data:
            raise card.wrong("no surfaces", "two in a line")
        for line, row in card.rows():
            if len(row) < 2 or not row[1]:
                raise card.unread("contact of a surface with itself", line)
            ends = [self.blocks.surface(card, line, text) for text in row[:2]]
            names = frozenset(text.upper() for text in row[:2])
            if names in self.surfaces:
                raise card.wrong(f"the pair {', '.join(row[:2])} twice", "it once", line)
            self.surfaces.add(names)
            self._join(card, line, stated, *ends)
            for name, end in zip(row[:2], ends, strict=True):
                self.blocks.meet(name.strip('"'), end)

    def _properties(self, card: Card) -> None:
        for line, row in card.rows():
            name = row[2].strip('"').upper() if len(row) == 3 else ""
            stated = self.model.of("SURFACE INTERACTION", name, card, line)
            if row[0] or row[1]:
                ends = [self.blocks.surface(card, line, text) for text in row[:2]]
                self._join(card, line, stated, *ends)
            else:
                self.everywhere = stated

    def _join(self, card: Card, line: int, stated: Named, *ends: dict[int, IntArray]) -> None:
        pairs = {(min(a, b), max(a, b)) for a in ends[0] for b in ends[1] if a != b}
        if not pairs:
            raise card.unread("contact of a block with itself", line)
        if any(self.pairs.get(pair, stated) is not stated for pair in pairs):
            raise card.unread("a second interaction of the same two blocks", line)
        self.pairs |= dict.fromkeys(pairs, stated)

    # -----------------------------------------------------------------------------------------
    # As contact of a problem

    @property
    def is_rough(self) -> bool:
        """Whether any joint has friction."""
        return any(friction_of(self.model, one)[0] for one in self.stated)

    def unmatched(
        self, assembly: Assembly, every: tuple[UnmatchedJoint, ...]
    ) -> tuple[UnmatchedJoint, ...]:
        """Those joints whose facets do not match that are of blocks that can meet."""
        fixed = assembly.fixed
        return tuple(
            joint
            for joint in every
            if self.everywhere is not None or (joint.block_m, joint.block_s) in self.pairs
            if not (fixed[joint.block_m] and fixed[joint.block_s])
        )

    def joints(self, size: float) -> dict[str, object]:
        """Law and friction of a problem; facets have edges of a size [mm]."""
        default, model = self.stated[0], self.model
        law, (friction, stick) = law_of(model, default, size), friction_of(model, default)
        laws: list[tuple[int, int, ContactLaw]] = []
        frictions: list[tuple[int, int, float]] = []
        for (a, b), stated in self.pairs.items():
            if stated is default:
                continue
            other, (coefficient, slope) = law_of(model, stated, size), friction_of(model, stated)
            if slope not in {None, stick}:
                raise stated.card.unread("stick slopes of several interactions")
            if other != law:
                laws.append((a, b, other))
            if coefficient != friction:
                frictions.append((a, b, coefficient))
        coulomb = None
        if friction or frictions:
            constants = {} if stick is None else {"stick_stiffness": stick}
            coulomb = CoulombFriction(friction, of_pairs=tuple(frictions), **constants)
        return {"law": PairLaws(law, tuple(laws)) if laws else law, "friction": coulomb}

    def check_unpaired(self, assembly: Assembly, surfaces: PolyhedralAssembly, size: float) -> None:
        """Reject surfaces that face each other without a pair: here they would press.

        Blocks that touch elsewhere pass through each other: a note.
        """
        if self.everywhere is not None:
            return
        patches, fixed = surfaces.interfaces.patches, assembly.fixed
        for a, b in self._without(_facing(assembly, size), fixed):
            raise DeckError(
                f"{assembly.name}: surfaces of {self.blocks.name(a)} and {self.blocks.name(b)} "
                "face each other, touch or nearly so, and no *Contact Pair has both; expected "
                "one, or surfaces that are apart"
            )
        touching = np.column_stack([patches.block_m, patches.block_s])
        for a, b in self._without(touching, fixed):
            self.model.note(
                f"contact: {self.blocks.name(a)} and {self.blocks.name(b)} touch and no "
                "*Contact Pair has both: they do not press on each other"
            )

    def _without(self, pairs: IntArray, fixed: BoolArray) -> list[tuple[int, int]]:
        """Those of pairs of blocks, (n, 2), that have no contact pair, and are not both fixed."""
        each = map(tuple, np.unique(np.sort(pairs, axis=1), axis=0).tolist())
        return [(a, b) for a, b in each if (a, b) not in self.pairs and not fixed[[a, b]].all()]


def _facing(assembly: Assembly, size: float) -> IntArray:
    """Pairs of blocks of which contact facets with edges of a size face each other, (n, 2)."""
    blocks = range(assembly.n_blocks)
    corners = [assembly.nodes(b)[assembly.shape(b).contact_quads] for b in blocks]
    block, at = np.repeat(blocks, list(map(len, corners))), np.concatenate(corners)
    centre = at.mean(axis=1)
    normal = np.cross(at[:, 2] - at[:, 0], at[:, 3] - at[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    a, b = KDTree(centre).query_pairs(_ASIDE * size, output_type="ndarray").T
    apart = np.abs(((centre[b] - centre[a]) * normal[a]).sum(axis=1))
    reach = min(_NEAR * size, _THIN * float(np.cbrt(assembly.volumes.min())))
    near = (block[a] != block[b]) & ((normal[a] * normal[b]).sum(axis=1) < -_FACING)
    mine = near & (apart <= reach)
    return np.column_stack([block[a], block[b]])[mine]
