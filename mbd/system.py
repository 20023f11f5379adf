"""Rigid blocks in contact under loads: what every analysis of them reads, each part computed once.

Friction is loaded where it is asked: a tube without it does without cone programs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from geometry.loads import LoadCase
from geometry.mesh import FloatArray
from geometry.parts.pairs import OfPairs, pair_values
from geometry.parts.placed import AnyBlocks
from mbd.contacts.jacobian import RigidContacts, contact_jacobian
from mbd.equilibrium import Equilibrium, column_weights, equilibrium
from mbd.options import Rigid

if TYPE_CHECKING:
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

    def on(self, blocks: AnyBlocks) -> Stated:
        """Return the same blocks that touch at some of their contacts."""
        if blocks is self.rigid_blocks:
            return self
        load = replace(self.rigid_load, assembly=blocks)
        return replace(self, rigid_blocks=blocks, rigid_load=load)


@dataclass(frozen=True)
class RigidSystem:
    """Blocks in contact under loads, with friction or without."""

    stated: RigidStatement
    method: Rigid = field(default_factory=Rigid)
    tell: Callable[[str], None] = lambda _: None
    """Called with what is being found."""

    @property
    def blocks(self) -> AnyBlocks:
        """With the contacts that count."""
        return self.stated.rigid_blocks

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
        return contact_jacobian(self.blocks, self.load.fixed, self.load.held)

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
    def frictionless(self) -> Equilibrium:
        """Without friction."""
        solver, weights = self.method.solver, self.weights
        return equilibrium(self.contacts.jacobian, self.force, solver=solver, weights=weights)

    @cached_property
    def frictional(self) -> FrictionalContacts:
        """Contacts with the friction that is stated, 0 where there is none."""
        from mbd.contacts.friction import frictional_contacts

        m, s, mu = self.contacts.block_m, self.contacts.block_s, self.coulomb
        given = 0.0 if mu is None else pair_values(mu.coefficient, mu.of_pairs, m, s)
        return frictional_contacts(self.blocks, self.contacts, given, self.method.friction_law)

    @cached_property
    def with_friction(self) -> Equilibrium:
        """With friction, as the cone program finds it."""
        from mbd.equilibrium import frictional_equilibrium

        return frictional_equilibrium(self.frictional, self.force, weights=self.weights)

    @cached_property
    def balance(self) -> Equilibrium | None:
        """With friction, by all that is known; None without it."""
        from mbd.loading import settled

        if self.coulomb is None:
            return None
        self.tell("equilibrium with friction")
        if self.frictionless.holds and not self.with_friction.holds:
            return self.frictionless.with_tangents
        return settled(self.with_friction, self.frictional, self.force, self.weights)

    def squeeze(self, forces: FloatArray, limit: float | None = None) -> Squeeze:
        """Whether the load itself presses joints that carry it by forces (n_contacts, 3) [N].

        ``limit``: reference seconds that may be spent.
        """
        from mbd.loading import MOST_SECONDS, Squeeze, squeeze

        if self.frictionless.holds:
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
