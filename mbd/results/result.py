"""What the rigid-block analysis of one problem found: class, forces, motion and verdict.

Blocks touch at two sets of contacts, whatever the friction: on *faces*, and on *faces with edges
and corners* (`PolyhedralAssembly.bearing`). The verdict of an answer is that of faces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import isnan
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from geometry.assembly import Assembly
from geometry.loads import LoadCase
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.balance import Imbalance, Reactions, imbalance, of_fixed_blocks, together
from geometry.parts.measures import (
    BlockMeasures,
    JointResultants,
    Measures,
    facet_measures,
    joint_resultants,
)
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Part, Row, finite, grouped
from geometry.polyhedra.options import CROSSING_EDGES, STANDING_CORNER
from mbd.contacts.jacobian import contact_wrenches
from mbd.contacts.supports import support_wrenches
from mbd.equilibrium import Equilibrium
from mbd.mechanism import Classification, Mechanism, MechanismClass
from mbd.options import Norm
from mbd.results.motion import placed_motion

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly
    from mbd.results.parts import Friction


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


@dataclass(frozen=True)
class RigidResult(ReadOnlyArrays):
    """Everything the rigid-block analysis of one assembly under one load found."""

    classification: Classification
    """Class with every frame block held, as the paper classifies, with its certificate."""
    supported_classification: Classification
    """Class with the supports of the load case; differs only where it releases a frame."""
    equilibrium: Equilibrium
    """Contact forces, residual, load-activated mechanism if there is one, status."""
    contact_index: IntArray
    """Position of each contact in the assembly's interfaces, (n_contacts,)."""
    norm: Norm
    """What the contact forces minimise."""
    blocks: AnyBlocks = field(repr=False)
    """What was analysed …"""
    load: LoadCase = field(repr=False)
    """… under which loads and supports, weight included."""
    parts: Mapping[str, Part] = field(default_factory=dict)
    """What was found beside, by name."""
    cpu_seconds: Mapping[str, float] = field(default_factory=dict)
    """CPU time of each stage, and in all [s]."""

    @property
    def mechanism(self) -> MechanismClass:
        """Class with every frame block held."""
        return self.classification.mechanism

    @property
    def n_blocks(self) -> int:
        """Blocks free to move under the load."""
        return int((~self.load.fixed).sum())

    @property
    def n_contacts(self) -> int:
        """Contacts that touch at least one free block."""
        return len(self.contact_index)

    @property
    def friction(self) -> Friction | None:
        """What friction adds; None without it."""
        return cast("Friction | None", self.parts.get("friction"))

    @property
    def balance(self) -> Equilibrium:
        """Equilibrium that decides: with friction, where there is some."""
        return self.equilibrium if self.friction is None else self.friction.equilibrium

    @property
    def holds(self) -> bool:
        """Whether forces balance the load."""
        return self.balance.holds

    @property
    def of_load(self) -> bool:
        """Whether the load itself brings forces about that balance it, as far as is known."""
        return self.holds and self.verdict.squeezed is not True

    @property
    def verdict(self) -> Verdict:
        """Verdict on the load."""
        found, pressed = self.balance, None if self.friction is None else self.friction.squeeze
        holds = False if found.mechanism is not None else found.holds or None
        return Verdict(self.mechanism, holds, False if pressed is None else pressed.needed)

    @property
    def edges_and_corners(self) -> EdgesAndCorners | None:
        """Verdicts with edges and corners; None where there are none."""
        return cast("EdgesAndCorners | None", self.parts.get("edges_and_corners"))

    @property
    def words(self) -> str:
        """The answer as a headline says it: locked, carried or not carried."""
        edges = "" if self.edges_and_corners is None else self.edges_and_corners.words
        return self._faces_words + (f"; {edges}" if edges else "")

    @property
    def _faces_words(self) -> str:
        carried, friction = self.verdict.carried, self.friction
        if friction is None:
            if self.supported_classification.locked:
                return "locked"
            nothing = not self.load.wrenches.any()
            return "not locked, and nothing acts" if nothing else f"{carried} without friction"
        reason = "" if friction.squeeze is None else friction.squeeze.reason(self.blocks.named)
        words = f"{carried}{f': {reason},' if reason else ''} with friction {friction.given}"
        if not self.holds:
            return words
        locked = self.classification.locked
        return f"{words} (without: {'locked' if locked else carried_words(self.equilibrium.holds)})"

    @property
    def driven(self) -> FloatArray | None:
        """Mechanism that the load drives, (n_rows,), where it is not carried."""
        return self.balance.mechanism

    @property
    def moving(self) -> FloatArray | None:
        """How blocks move where the load does not bring them to rest, proved or not; (n_rows,)."""
        if self.driven is not None:
            return self.driven
        pressed = None if self.friction is None else self.friction.squeeze
        return self.balance.motion if pressed is None else pressed.motion

    @property
    def block_motion(self) -> FloatArray | None:
        """(δt [mm], δθ [rad]) of each block under the mechanism, (n_blocks, 6).

        None where locked, or where friction holds the blocks. Prefers how the load moves them;
        blocks held by the certificate's supports stay.
        """
        certificate = self.classification.certificate
        if self.moving is not None:
            return placed_motion(self.blocks, self.moving, ~self.load.fixed)
        if isinstance(certificate, Mechanism) and (self.friction is None or not self.holds):
            motion = certificate.virtual_displacement
            return placed_motion(self.blocks, motion, ~self.blocks.fixed)
        return None

    @cached_property
    def forces(self) -> FloatArray:
        """On block s of each contact, zero where nothing holds; (n_contacts, 3) [N]."""
        if self.friction is not None:
            given = self.friction.forces
            return np.zeros((self.n_contacts, 3)) if given is None else given
        return self.contact_forces[:, None] * self._normals

    @cached_property
    def contact_forces(self) -> FloatArray:
        """Along the normals, λ >= 0, zero where nothing holds; (n_contacts,) [N]."""
        if self.friction is None:
            return self.equilibrium.forces * self.holds
        return np.asarray(np.maximum(np.einsum("ni,ni->n", self.forces, self._normals), 0.0))

    @property
    def _normals(self) -> FloatArray:
        return self.blocks.interfaces.normals[self.contact_index]

    @property
    def contact_pressures(self) -> FloatArray:
        """λ / A, (n_contacts,) [MPa]."""
        return self.contact_forces / self.blocks.interfaces.areas[self.contact_index]

    @cached_property
    def measures(self) -> Measures | None:
        """The paper's measures; None where no joint presses."""
        return self._facet_measures[1] if self.contact_forces.any() else None

    @property
    def per_block(self) -> BlockMeasures:
        """The paper's measures of each free block (`blocks.free_blocks`)."""
        return self._facet_measures[0]

    @cached_property
    def _facet_measures(self) -> tuple[BlockMeasures, Measures]:
        return facet_measures(self.blocks, self.contact_index, self.contact_pressures)

    @cached_property
    def joints(self) -> JointResultants:
        """Resultants of the forces between each two blocks."""
        index, found, centroids = self.contact_index, self.blocks.interfaces, None
        if not isinstance(self.blocks, Assembly):
            pairs = np.unique(np.column_stack([found.block_m[index], found.block_s[index]]), axis=0)
            centroids = cast("PolyhedralAssembly", self.blocks).joint_centroids(pairs)
        return joint_resultants(found, index, self.forces, centroids)

    @cached_property
    def patch_pressures(self) -> FloatArray:
        """Mean pressure of each flat patch, of elements each facet; 0: nothing; (n,) [MPa]."""
        if isinstance(self.blocks, Assembly):
            pressures = np.zeros(self.blocks.interfaces.n_contacts)
            pressures[self.contact_index] = self.contact_forces
            return pressures / self.blocks.interfaces.areas
        found = cast("PolyhedralAssembly", self.blocks).interfaces
        return found.patch_pressures(self.contact_index, self.contact_forces)

    @property
    def bare_contacts(self) -> dict[int, int]:
        """Number of contacts without area of each kind; of solids alone."""
        if isinstance(self.blocks, Assembly):
            return {}
        patch = cast("PolyhedralAssembly", self.blocks).interfaces.patch
        return {kind: int((patch == kind).sum()) for kind in (CROSSING_EDGES, STANDING_CORNER)}

    @cached_property
    def _supports(self) -> tuple[Reactions | None, FloatArray]:
        """Supports by name, and what they and the loads do to each block, (n_blocks, 6)."""
        blocks, load = self.blocks, self.load
        if not load.held:
            return None, load.wrenches
        on_blocks = contact_wrenches(blocks, self.contact_index, self.forces)
        supports, on_each = support_wrenches(blocks, load, load.wrenches + on_blocks)
        return supports, load.wrenches + on_each

    @cached_property
    def reactions(self) -> Reactions:
        """Supports, and fixed blocks less what their supports take."""
        fixed, (supports, others) = np.flatnonzero(self.load.fixed), self._supports
        of_blocks = of_fixed_blocks(self.blocks, self.joints, fixed, others)
        return of_blocks if supports is None else together(supports, of_blocks)

    @property
    def reaction(self) -> FloatArray:
        """Force of fixed blocks and supports, against all loads and weight, (3,) [N]."""
        return self.reactions.forces.sum(axis=0)

    @property
    def imbalance(self) -> Imbalance:
        """What joints, loads and supports leave on a free block."""
        blocks, load = self.blocks, self.load
        own = blocks.originals == np.arange(blocks.n_blocks)
        return imbalance(
            blocks,
            self.joints,
            acting=load.acting,
            others=self._supports[1],
            centres=blocks.centroids,
            free=np.flatnonzero(own & ~load.fixed),
        )
