"""A static problem: a system, how it is solved, and the linear step that its iterations take."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from fem.contact.friction import Coulomb
from fem.contact.search import SearchedPoints
from fem.static.linear_step.condensation import FlexibilityStore
from fem.static.linear_step.condensed import CondensedStep
from fem.static.linear_step.grid_block import GridBlock
from fem.static.linear_step.linearisation import (
    LinearStep,
    SparseSolver,
    SparseStep,
    StaticError,
)
from fem.static.linear_step.reduced import ReducedStep, is_smaller
from fem.system.loose import FreeMotions, unresisted_motions
from fem.system.system import Sector, System
from geometry.errors import is_number
from geometry.mesh import FloatArray

#: Supported nodes of a block beyond which one sparse matrix takes the place of dense flexibilities,
#: which keep them: plane strain holds every node of a slice, and 3 400 took 12 GB.
_MOST_HELD = 1500


class StaticMethod(StrEnum):
    """How the linear problems are solved."""

    CONDENSED = "condensed"
    """In contact forces, with one dense flexibility per shape
    (`fem.static.linear_step.condensed`)."""
    SPARSE = "sparse"
    """One sparse matrix of everything, factored by a library: slower, the oracle."""


@dataclass(frozen=True)
class StaticOptions:
    """How a static problem is solved."""

    method: StaticMethod = StaticMethod.CONDENSED
    """How the linear problems are solved."""
    sparse_solver: SparseSolver | None = None
    """Library of the sparse method; None: the best that is installed."""
    symmetry: int | None = None
    """Order of the cyclic sector model; None: the largest exact one; 1: none."""
    tolerance: float = 1e-8
    """Norm of the residual over norm of the loads at which the iteration stops [-]."""
    max_iterations: int = 120
    """Linear problems solved at most for one load step."""
    load_steps: int = 1
    """Parts in which the load is applied: equal ones, with friction as `load_factors` says."""
    load_tolerance: float | None = None
    """With friction the parts are doubled until that changes displacements and pressures by less
    [-]; None: they stay as they are, and so they do from a given start."""
    motion_steps: int | None = 20
    """Parts of the way of supports that move, after the load; the times of their tables come on
    top. None: all their way at once, with the load."""
    once: bool = False
    """Whether what does not converge is given up, not tried in smaller load steps."""

    def __post_init__(self) -> None:
        if not (is_number(self.tolerance) and self.tolerance > 0.0):
            raise StaticError(f"fem.tolerance: got {self.tolerance!r}, expected a positive number")
        change = self.load_tolerance
        if change is not None and not (math.isfinite(change) and change > 0.0):
            raise StaticError(f"fem.load_tolerance: got {change}, expected a positive number")
        for name in ("max_iterations", "load_steps", "motion_steps"):
            if getattr(self, name) is not None and getattr(self, name) < 1:
                raise StaticError(f"fem.{name}: got {getattr(self, name)}, expected at least 1")


@dataclass(frozen=True)
class StaticProblem:
    """What stays the same in all iterations."""

    system: Sector
    options: StaticOptions
    store: FlexibilityStore
    """Of condensed blocks."""
    step: LinearStep
    law: Coulomb
    """Pressure and friction of its points."""

    def on(self, system: Sector) -> StaticProblem:
        """The problem of the same blocks on other points of contact, or in another stage."""
        return problem_of(system, self.options, self.store)

    @property
    def slides(self) -> bool:
        """Whether points may slide: with friction, unless all of them are taken to stick."""
        return self.system.has_friction and self.law is self.system.law

    @cached_property
    def free(self) -> FreeMotions | None:
        """Motions that nothing resists."""
        return unresisted_motions(self.system, self.step.kept)

    @cached_property
    def farthest_overclosure(self) -> FloatArray:
        """Where contact presses as hard as the stiffest block is stiff, as strains of 1 need [mm].

        One number, or one for each facet.
        """
        law = self.system.law
        return law.normal.overclosure(np.maximum(self.stiffest, law.touching_pressure))

    @cached_property
    def stiffest(self) -> float:
        """Largest Young's modulus of a block [MPa]; 0 where none deforms."""
        slots = range(self.system.n_slots)
        return max((self.system.body(k).material.young_modulus for k in slots), default=0.0)


def problem_of(
    system: Sector,
    options: StaticOptions,
    store: FlexibilityStore,
    near: FloatArray | None = None,
) -> StaticProblem:
    """The system with its linear step; displacements ``near`` its solution, (n_nodes, 3) [mm]."""
    friction = system.has_friction
    step: LinearStep
    # On searched points limits of friction follow the pressures, in displacements alone.
    in_displacements = isinstance(system.points, SearchedPoints) and friction
    whole = options.method is StaticMethod.SPARSE or not system.whole.meets
    whole |= _most_held(system) > _MOST_HELD
    grids = structured_blocks(system.whole, options)
    if grids is not None:
        from fem.static.linear_step.grid import GridStep
        from fem.static.linear_step.grid_pairs import GridPairStep

        step = GridPairStep(system, grids, store) if friction else GridStep(system, grids, near)
    elif whole or (in_displacements and not is_smaller(system)):
        step = SparseStep(system, options.sparse_solver)
    elif in_displacements:
        step = ReducedStep(system, store, options.sparse_solver)
    else:
        step = CondensedStep(system, store, friction=friction)
    return StaticProblem(system, options, store, step, system.law)


def structured_blocks(system: System, options: StaticOptions) -> tuple[GridBlock, ...] | None:
    """Structured blocks, where these are solved in the forces of their contact points."""
    curved = any(body.element.degree > 1 for body in system.bodies)
    if options.method is StaticMethod.SPARSE or not curved:
        return None
    from fem.static.linear_step.grid import grid_blocks

    return grid_blocks(system)


def _most_held(system: Sector) -> int:
    """Supported nodes of the block that has most of them."""
    slots = np.searchsorted(system.node_start, system.held.nodes, side="right")
    return int(np.bincount(slots).max(initial=0))
