"""What a rigid answer has beside its equilibrium: friction, load factors, ranges and margin.

A function finds each part, which gives rows of a table and plain data.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from geometry.loads import LoadCase
from geometry.mesh import FloatArray
from geometry.parts.pairs import OfPairs, pair_values
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Part, Row
from mbd.contacts.jacobian import RigidContacts, contact_jacobian
from mbd.friction.equilibrium import (
    CollapseLoad,
    FrictionalContacts,
    RigidFrictionError,
    by_block,
    collapse_load,
    frictional_contacts,
    frictional_equilibrium,
)
from mbd.friction.loading import settled
from mbd.friction.squeeze import Squeeze, squeeze
from mbd.frictionless.equilibrium import Equilibrium, column_weights
from mbd.frictionless.mechanism import Classification
from mbd.limits.force_range import ForceRanges, PlaneProblem, force_ranges, plane_problem
from mbd.limits.pushes import Margin, interlocking_margin
from mbd.limits.sliding_collapse import SlidingCollapse, sliding_collapse, sliding_state
from mbd.options import Rigid
from mbd.results.motion import motion_of_blocks, placed_motion

#: Dead and live load of each block, (n_blocks, 6) each [N, N mm].
Wrenches = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class Friction:
    """Whether the load is carried with Coulomb friction."""

    coefficient: float
    """Of all joints, but those of pairs [-]."""
    of_pairs: bool
    """Whether pairs of blocks have their own."""
    equilibrium: Equilibrium
    forces: FloatArray | None
    """On block s at all contacts of free blocks, which carry the load; None where none do;
    (n_contacts, 3) [N]."""
    squeeze: Squeeze | None
    """Whether friction that carries the load is pressed by it."""

    @property
    def given(self) -> str:
        """The coefficient in words."""
        return f"μ = {self.coefficient:g}{', others between pairs' if self.of_pairs else ''}"

    @property
    def rows(self) -> list[Row]:
        """None: the verdict and the evidence of the answer are those with friction."""
        return []

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        f = self.equilibrium
        data: dict[str, Any] = {
            "holds": f.holds,
            "residual": f.residual,
            "largest_normal_force": float(f.forces[:, 0].max(initial=0.0)) if f.holds else None,
            "mechanism": by_block(f.mechanism),
            "work": f.work,
            "smallest_contact_work": f.smallest_contact_work,
            "status": f.status,
        }
        if self.squeeze is not None:
            blocks = None if self.squeeze.blocks is None else list(self.squeeze.blocks)
            data["squeeze"] = {
                "needed": self.squeeze.needed,
                "blocks": blocks,
                "least": self.squeeze.least if self.squeeze.needed else None,
                "programs": self.squeeze.programs,
            }
        return data


# ---------------------------------------------------------------------------------------------
# What is asked


@dataclass(frozen=True, kw_only=True)
class Question:
    """What is asked of rigid blocks beside their equilibrium without friction."""

    blocks: AnyBlocks
    """With the contacts that count."""
    load: LoadCase
    """Says what is held."""
    wrenches: Wrenches
    """What acts."""
    method: Rigid
    friction: float | None
    """Coefficient of all joints [-]; None: frictionless."""
    of_pairs: OfPairs
    """That of some pairs of blocks."""
    smooth: Equilibrium
    """Without friction. Forces that balance the load are admissible whatever the friction: no joint
    needs a squeeze beforehand."""
    frictionless: Classification
    """Without friction."""
    tell: Callable[[str], None]
    """Called with what is being found."""

    @cached_property
    def contacts(self) -> RigidContacts:
        """Contacts of `blocks`."""
        return contact_jacobian(self.blocks, self.load.fixed, self.load.held)

    @cached_property
    def frictional(self) -> FrictionalContacts:
        """Contacts with the friction that is stated, 0 where there is none."""
        m, s = self.contacts.block_m, self.contacts.block_s
        given = pair_values(self.friction or 0.0, self.of_pairs, m, s)
        return frictional_contacts(self.blocks, self.contacts, given, self.method.friction_law)

    @cached_property
    def loads(self) -> Wrenches:
        """Dead and live load in the rows of the free blocks."""
        dead, live = map(self.contacts.rows, self.wrenches)
        return dead, live

    @property
    def all_loads(self) -> FloatArray:
        """Dead and live load together, (n_rows,) [N]."""
        return self.loads[0] + self.loads[1]

    @cached_property
    def weights(self) -> FloatArray | None:
        """Of the forces in the norm that is minimised."""
        return column_weights(self.method.norm, self.contacts.areas)

    @cached_property
    def balance(self) -> Equilibrium | None:
        """Equilibrium with friction; None without it."""
        if self.friction is None:
            return None
        self.tell("equilibrium with friction")
        found = frictional_equilibrium(self.frictional, self.all_loads, weights=self.weights)
        if self.smooth.holds and not found.holds:
            return self.smooth.with_tangents
        return settled(found, self.frictional, self.all_loads, self.weights)

    @cached_property
    def collapse(self) -> CollapseLoad | None:
        """Load factor at collapse; None where it is not asked."""
        if not self.method.collapse:
            return None
        self.tell("load factor at collapse")
        found = collapse_load(self.frictional, *self.loads)
        if not np.isnan(found.factor) or found.mechanism is None:
            return found
        moving = placed_motion(self.blocks, found.mechanism, ~self.load.fixed)
        motion = motion_of_blocks(self.blocks, moving, self.wrenches[0], proved=True)
        return replace(found, status=f"{found.status}: {motion.words}")

    def plane(self, *loads: FloatArray) -> PlaneProblem | None:
        """Return the problem in the plane in which blocks and loads lie; None: there is none."""
        for axis in range(3):
            try:
                plane = plane_problem(self.blocks, self.contacts, self.frictional, axis)
                for load in loads:
                    plane.load(load)
            except RigidFrictionError:
                continue
            return plane
        return None

    def counting(self, what: str) -> Callable[[int], None]:
        """Return a progress of programs solved."""
        return lambda programs: self.tell(f"{what}: {programs} programs solved")


def parts_of(asked: Question) -> dict[str, Part]:
    """What is found, by name."""
    method, balance, collapse = asked.method, asked.balance, asked.collapse
    # Without a limit the answer rests on friction that jams: the ranges of forces decide.
    jams = collapse is not None and bool(np.isinf(collapse.factor))
    ranges = (method.ranges or jams) and (balance is None or balance.holds)
    parts: dict[str, Part | None] = {
        "friction": None if balance is None else _friction(asked, balance),
        "collapse": collapse,
        "sliding": _sliding(asked) if method.sliding else None,
        "ranges": _ranges(asked) if ranges else None,
        "margin": _margin(asked) if method.margin else None,
    }
    return {name: part for name, part in parts.items() if part is not None}


def _friction(asked: Question, balance: Equilibrium) -> Friction:
    """Whether the load is carried with friction, and whether it presses the joints itself."""
    forces = pressed = None
    if balance.holds:
        normals = asked.blocks.interfaces.normals[asked.contacts.index]
        forces = asked.frictional.world(balance.forces, normals)
        pressed = Squeeze(needed=False, programs=0)
        if not asked.smooth.holds:
            asked.tell("whether the load presses the joints that need friction")
            pressed = squeeze(
                asked.contacts,
                asked.frictional,
                asked.all_loads,
                balance.forces,
                weights=asked.weights,
                progress=asked.counting("whether the load presses the joints"),
            )
    return Friction(asked.friction or 0.0, bool(asked.of_pairs), balance, forces, pressed)


def _sliding(asked: Question) -> SlidingCollapse:
    """Collapse by sliding without dilation, in the plane where the problem is plane."""
    asked.tell("collapse by sliding without dilation")
    plane, progress = asked.plane(*asked.loads), asked.counting("sliding collapse")
    if plane is None:
        result = sliding_collapse(asked.frictional, *asked.loads, progress=progress)
    else:
        flat = [plane.load(load) for load in asked.loads]
        result = sliding_collapse(plane.contacts, *flat, progress=progress)
        if result.mechanism is not None:
            rows = np.zeros(len(asked.loads[0]))
            rows[plane.rows] = result.mechanism
            result = replace(result, mechanism=rows)
    state = sliding_state(
        asked.blocks,
        asked.contacts,
        result,
        frictional=asked.frictional,
        plane=plane,
        wrenches=asked.wrenches,
    )
    return replace(result, state=state)


def _ranges(asked: Question) -> ForceRanges | None:
    """Ranges of the joints' forces, where forces balance the load."""

    def progress(done: int, of: int) -> None:
        asked.tell(f"range of the forces of joints: {done} of {of}")

    find = partial(force_ranges, asked.contacts, asked.all_loads, progress=progress)
    if asked.balance is not None:
        shown, plane = asked.balance.forces[:, 0], asked.plane(asked.all_loads)
        return find(shown, frictional=asked.frictional, plane=plane)
    return find(asked.smooth.forces) if asked.smooth.holds else None


def _margin(asked: Question) -> Margin:
    progress = asked.counting("unit loads of the margin")
    return interlocking_margin(asked.contacts, progress=progress)
