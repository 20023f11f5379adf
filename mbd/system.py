"""Rigid blocks in contact under loads: class, forces, motion and verdict, each computed once.

Blocks touch at two sets of contacts, whatever the friction: on *faces*, and on *faces with edges
and corners* (`PolyhedralAssembly.bearing`). The verdict of an answer is that of faces.

Friction is loaded where it is asked: a tube without it does without cone programs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import numpy as np

from geometry.assembly import Assembly
from geometry.loads import LoadCase
from geometry.mesh import BoolArray, FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.balance import (
    Imbalance,
    Reactions,
    imbalance,
    joint_wrenches,
    of_fixed_blocks,
    together,
)
from geometry.parts.measures import (
    BlockMeasures,
    JointResultants,
    Measures,
    facet_measures,
    joint_resultants,
)
from geometry.parts.pairs import OfPairs, pair_values
from geometry.parts.placed import AnyBlocks
from geometry.polyhedra.options import CROSSING_EDGES, STANDING_CORNER
from mbd.contacts.jacobian import RigidContacts, contact_jacobian
from mbd.contacts.supports import support_wrenches
from mbd.equilibrium import Equilibrium, column_weights, equilibrium
from mbd.mechanism import MANY_BLOCKS, Classification, Mechanism, MechanismClass, classify
from mbd.options import Rigid

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly
    from mbd.contacts.friction import FrictionalContacts
    from mbd.loading import Squeeze
    from mbd.programs import Work


class JointFriction(Protocol):
    """Friction of all joints, such as `fem.CoulombFriction`."""

    @property
    def coefficient(self) -> float:
        """Coefficient μ [-]."""

    @property
    def of_pairs(self) -> OfPairs:
        """That of some pairs of blocks."""


class RigidStatement(Protocol):
    """A statement of a problem, such as `fem.Problem`, as far as rigid blocks read it."""

    @property
    def rigid_blocks(self) -> AnyBlocks:
        """The assembly of blocks, on the contacts of rigid ones."""

    @property
    def rigid_load(self) -> LoadCase:
        """Loads and supports without the weight."""

    @property
    def rigid_weight(self) -> FloatArray | None:
        """Weight of each block about its mass centroid, (n_blocks, 6) [N, N mm]; None: none."""

    @property
    def coulomb(self) -> JointFriction | None:
        """Friction; None: frictionless."""

    @property
    def interference(self) -> float:
        """By which joints are squeezed before any load acts [mm]."""

    @property
    def compressive_strength(self) -> float | None:
        """Of all blocks [MPa]; None: not stated."""


@dataclass(frozen=True)
class Stated:
    """Blocks and a load without more: a `RigidStatement`."""

    rigid_blocks: AnyBlocks
    rigid_load: LoadCase
    rigid_weight: FloatArray | None = None
    coulomb: JointFriction | None = None
    interference: float = 0.0
    compressive_strength: float | None = None

    @property
    def blocks(self) -> AnyBlocks:
        """The assembly."""
        return self.rigid_blocks


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


def silent(_: str) -> None:
    """Tell nothing."""


def placed_motion(assembly: AnyBlocks, motion: FloatArray, free: BoolArray) -> FloatArray:
    """(δt [mm], δθ [rad]) of all blocks, (n_blocks, 6), from rows of a Jacobian of free ones."""
    moving = np.zeros((assembly.n_blocks, 6))
    moving[free] = motion.reshape(-1, 6)
    moving[:, 3:] /= assembly.characteristic_length
    return moving


@dataclass(frozen=True)
class RigidSystem(ReadOnlyArrays):
    """Blocks in contact under loads, with friction or without, and what follows from them."""

    stated: RigidStatement
    method: Rigid = field(default_factory=Rigid)
    tell: Callable[[str], None] = silent
    """Called with what is being found; lost where the system is pickled."""
    edges: bool = False
    """Whether edges and corners of solids count as well."""

    def __getstate__(self) -> dict[str, Any]:
        """Pickle what was stated and found."""
        return {**vars(self), "tell": silent}

    @property
    def blocks(self) -> AnyBlocks:
        """With all their contacts."""
        return self.stated.rigid_blocks

    @cached_property
    def touching(self) -> AnyBlocks:
        """With the contacts that count."""
        if self.edges or isinstance(self.blocks, Assembly):
            return self.blocks
        return cast("PolyhedralAssembly", self.blocks).bearing()

    @cached_property
    def with_edges(self) -> RigidSystem | None:
        """The same blocks on all their contacts; None where these are all that count.

        What no motion leaves cannot move with more contacts either: then it is the system itself.
        """
        if self.touching is self.blocks:
            return None
        locked = self.classification.locked and self.supported_classification.locked
        return self if locked else replace(self, edges=True)

    @cached_property
    def load(self) -> LoadCase:
        """All that acts, weight included, and what is held."""
        return self.stated.rigid_load.with_wrenches(self.stated.rigid_weight)

    @property
    def coulomb(self) -> JointFriction | None:
        """Friction; None: frictionless."""
        return self.stated.coulomb

    @cached_property
    def contacts(self) -> RigidContacts:
        """Contacts of the blocks that move."""
        return contact_jacobian(self.touching, self.load.fixed, self.load.held)

    @cached_property
    def force(self) -> FloatArray:
        """All loads in the rows of the free blocks, (n_rows,) [N]."""
        return self.contacts.rows(self.load.wrenches)

    @cached_property
    def dead(self) -> FloatArray:
        """Weight in these rows, (n_rows,) [N]."""
        weight = self.stated.rigid_weight
        return np.zeros_like(self.force) if weight is None else self.contacts.rows(weight)

    @cached_property
    def live(self) -> FloatArray:
        """Loads that can grow, (n_rows,) [N]."""
        return self.contacts.rows(self.stated.rigid_load.wrenches)

    @cached_property
    def weights(self) -> FloatArray:
        """Of the forces in the norm that is minimised, (n_contacts,)."""
        return column_weights(self.method.norm, self.contacts.areas)

    @cached_property
    def equilibrium(self) -> Equilibrium:
        """Without friction."""
        solver, weights = self.method.solver, self.weights
        return equilibrium(self.contacts.jacobian, self.force, solver=solver, weights=weights)

    @cached_property
    def frictional(self) -> FrictionalContacts:
        """Contacts with the friction that is stated, 0 where there is none."""
        from mbd.contacts.friction import frictional_contacts

        m, s, mu = self.contacts.block_m, self.contacts.block_s, self.coulomb
        given = 0.0 if mu is None else pair_values(mu.coefficient, mu.of_pairs, m, s)
        return frictional_contacts(self.touching, self.contacts, given, self.method.friction_law)

    @cached_property
    def with_friction(self) -> Equilibrium:
        """With friction, as the cone program finds it."""
        from mbd.equilibrium import frictional_equilibrium

        return frictional_equilibrium(self.frictional, self.force, weights=self.weights)

    @cached_property
    def balance(self) -> Equilibrium | None:
        """With friction, by all that is known; None without it."""
        if self.coulomb is None:
            return None
        from mbd.loading import settled

        self.tell("equilibrium with friction")
        if self.equilibrium.holds and not self.with_friction.holds:
            return self.equilibrium.with_tangents
        return settled(self.with_friction, self.frictional, self.force, self.weights)

    def squeeze(self, forces: FloatArray, limit: float | None = None) -> Squeeze:
        """Whether the load itself presses joints that carry it by forces (n_contacts, 3) [N].

        ``limit``: reference seconds that may be spent.
        """
        from mbd.loading import MOST_SECONDS, Squeeze, squeeze

        if self.equilibrium.holds:
            return Squeeze(needed=False, programs=0)
        work = self.counted(
            "whether the load presses the joints that need friction",
            MOST_SECONDS if limit is None else limit,
        )
        friction, weights = self.frictional, self.weights
        return squeeze(self.contacts, friction, self.force, forces, weights=weights, work=work)

    def counted(self, what: str, limit: float = math.inf) -> Work:
        """Return work on something, of so many reference seconds at most, that tells of it."""
        from mbd.programs import Work

        self.tell(what)
        return Work(
            limit, progress=lambda programs: self.tell(f"{what}: {programs} programs solved")
        )

    @cached_property
    def supported_classification(self) -> Classification:
        """Class with the supports of the load case; differs only where it releases a frame."""
        many = len(self.contacts.free_blocks) > MANY_BLOCKS
        return classify(self.contacts.jacobian, self.force, self.equilibrium, many=many)

    @cached_property
    def classification(self) -> Classification:
        """Class with every frame block held, as the paper classifies, with its certificate."""
        if (self.load.fixed == self.blocks.fixed).all():
            return self.supported_classification
        held = contact_jacobian(self.touching, supports=self.load.held)
        return classify(held.jacobian, held.rows(self.load.wrenches))

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
    def holds(self) -> bool:
        """Whether forces balance the load."""
        return self.deciding.holds

    @property
    def of_load(self) -> bool:
        """Whether the load itself brings forces about that balance it, as far as is known."""
        return self.holds and self.verdict.squeezed is not True

    @property
    def driven(self) -> FloatArray | None:
        """Mechanism that the load drives, (n_rows,), where it is not carried."""
        return self.deciding.mechanism

    @property
    def moving(self) -> FloatArray | None:
        """How blocks move where the load does not bring them to rest, proved or not; (n_rows,)."""
        if self.driven is not None:
            return self.driven
        return self.deciding.motion if self.pressed is None else self.pressed.motion

    @property
    def block_motion(self) -> FloatArray | None:
        """(δt [mm], δθ [rad]) of each block under the mechanism, (n_blocks, 6).

        None where locked, or where friction holds the blocks. Prefers how the load moves them;
        blocks held by the certificate's supports stay.
        """
        certificate = self.classification.certificate
        if self.moving is not None:
            return placed_motion(self.blocks, self.moving, ~self.load.fixed)
        if isinstance(certificate, Mechanism) and (self.balance is None or not self.holds):
            motion = certificate.virtual_displacement
            return placed_motion(self.blocks, motion, ~self.blocks.fixed)
        return None

    @cached_property
    def contact_forces(self) -> FloatArray:
        """Along the normals, λ >= 0, zero where nothing holds; (n_contacts,) [N]."""
        if self.balance is None:
            return self.equilibrium.forces * self.holds
        return np.asarray(np.maximum(np.einsum("ni,ni->n", self.forces, self._normals), 0.0))

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
            others=self._held[1],
            centres=blocks.centroids,
            free=np.flatnonzero(own & ~load.fixed),
        )

    @cached_property
    def contact_index(self) -> IntArray:
        """Position of each contact that counts in the interfaces of the blocks, (n_contacts,)."""
        if self.touching is self.blocks:
            return self.contacts.index
        bears = cast("PolyhedralAssembly", self.blocks).interfaces.bears
        return np.flatnonzero(bears)[self.contacts.index]

    @property
    def deciding(self) -> Equilibrium:
        """Equilibrium that decides: with friction, where there is some."""
        return self.equilibrium if self.balance is None else self.balance

    @cached_property
    def pressed(self) -> Squeeze | None:
        """Whether friction that carries the load is pressed by it; None where it carries none."""
        found = self.balance
        return None if found is None or not found.holds else self.squeeze(found.forces)

    @property
    def verdict(self) -> Verdict:
        """Verdict on the load."""
        found, pressed = self.deciding, self.pressed
        holds = False if found.mechanism is not None else found.holds or None
        return Verdict(self.mechanism, holds, False if pressed is None else pressed.needed)

    @property
    def words(self) -> str:
        """The answer as a headline says it: locked, carried or not carried."""
        edges = self.edges_words
        return self._faces_words + (f"; {edges}" if edges else "")

    @property
    def edges_words(self) -> str:
        """What edges and corners change of the verdict; empty where they change nothing."""
        if self.with_edges is None:
            return ""
        faces, both = self.verdict, self.with_edges.verdict
        if both.holds and faces.holds is False:
            held = "held by edges and corners alone: faces alone do not carry"
            return f"{held}; with both {both.carried}" if both.squeezed is not False else held
        changed = [both.carried] if both.carried != faces.carried else []
        locked = both.mechanism is MechanismClass.LOCKED
        if locked and faces.mechanism is not MechanismClass.LOCKED:
            changed.insert(0, "locked")
        return f"with edges and corners: {', '.join(changed)}" if changed else ""

    @property
    def _faces_words(self) -> str:
        carried, mu = self.verdict.carried, self.coulomb
        if mu is None:
            if self.supported_classification.locked:
                return "locked"
            nothing = not self.load.wrenches.any()
            return "not locked, and nothing acts" if nothing else f"{carried} without friction"
        reason = "" if self.pressed is None else self.pressed.reason(self.blocks.named)
        given = f"μ = {mu.coefficient:g}{', others between pairs' if mu.of_pairs else ''}"
        words = f"{carried}{f': {reason},' if reason else ''} with friction {given}"
        if not self.holds:
            return words
        locked = self.classification.locked
        return f"{words} (without: {'locked' if locked else carried_words(self.equilibrium.holds)})"

    @property
    def _normals(self) -> FloatArray:
        return self.blocks.interfaces.normals[self.contact_index]

    @cached_property
    def forces(self) -> FloatArray:
        """On block s of each contact, zero where nothing holds; (n_contacts, 3) [N]."""
        if self.balance is None:
            return self.contact_forces[:, None] * self._normals
        if not self.holds:
            return np.zeros((self.n_contacts, 3))
        return self.on_s(self.balance.forces)

    def on_s(self, forces: FloatArray) -> FloatArray:
        """Forces (normal, two tangents) as vectors on block s of each contact, (n_contacts, 3)."""
        return self.frictional.world(forces, self._normals)

    @cached_property
    def _held(self) -> tuple[Reactions, FloatArray]:
        return self.held_by(self.joints, self.load.wrenches)

    def held_by(self, joints: JointResultants, acting: FloatArray) -> tuple[Reactions, FloatArray]:
        """Supports, and fixed blocks less what their supports take; and what is no joint.

        Parameters
        ----------
        joints
            Forces at the contacts, summed.
        acting
            Loads about each block's mass centroid, (n_blocks, 6) [N, N mm].

        Returns
        -------
        tuple[Reactions, FloatArray]
            And loads and supports together, (n_blocks, 6) [N, N mm].
        """
        blocks, load, supports, others = self.blocks, self.load, None, acting
        if load.held:
            on_blocks = joint_wrenches(blocks, joints, blocks.centroids)
            supports, on_each = support_wrenches(blocks, load, acting + on_blocks)
            others = acting + on_each
        fixed = of_fixed_blocks(blocks, joints, np.flatnonzero(load.fixed), others)
        return fixed if supports is None else together(supports, fixed), others

    @property
    def reactions(self) -> Reactions:
        """Supports, and fixed blocks less what their supports take."""
        return self._held[0]
