"""What a rigid answer has beside its equilibrium: friction, load factors, ranges and margin.

A function finds each part, which gives rows of a table and plain data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from geometry.mesh import FloatArray
from geometry.parts.rows import Part, Row, plain
from mbd.equilibrium import Equilibrium, by_block
from mbd.limits.collapse import CollapseLoad, collapse_load
from mbd.limits.force_range import ForceRanges, force_ranges
from mbd.limits.plane import Reduced, reduced
from mbd.limits.pushes import interlocking_margin
from mbd.limits.sliding_collapse import SlidingCollapse, sliding_collapse, sliding_state
from mbd.loading import Squeeze
from mbd.results.motion import motion_of_blocks, placed_motion
from mbd.system import RigidSystem


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
        found, pressed = self.equilibrium, self.squeeze
        largest = float(found.forces[:, 0].max(initial=0.0)) if found.holds else None
        data = plain(found, "holds", "residual", "work", "smallest_contact_work", "status")
        data |= {"largest_normal_force": largest, "mechanism": by_block(found.mechanism)}
        if pressed is not None:
            data["squeeze"] = plain(pressed, "needed", "blocks", "programs")
            data["squeeze"]["least"] = pressed.least if pressed.needed else None
        return data


def parts_of(system: RigidSystem) -> dict[str, Part]:
    """What is found, by name."""
    method, balance = system.method, system.balance
    collapse = _collapse(system) if method.collapse else None
    # Without a limit the answer rests on friction that jams: the ranges of forces decide.
    jams = collapse is not None and bool(np.isinf(collapse.factor))
    work = partial(system.counted, "unit loads of the margin")
    ranges = (method.ranges or jams) and (balance is None or balance.holds)
    parts: dict[str, Part | None] = {
        "friction": None if balance is None else _friction(system, balance),
        "collapse": collapse,
        "sliding": _sliding(system) if method.sliding else None,
        "ranges": _ranges(system) if ranges else None,
        "margin": interlocking_margin(system.contacts, work()) if method.margin else None,
    }
    return {name: part for name, part in parts.items() if part is not None}


def _friction(system: RigidSystem, balance: Equilibrium) -> Friction:
    """Whether the load is carried with friction, and whether it presses the joints itself."""
    forces = pressed = None
    if balance.holds:
        normals = system.blocks.interfaces.normals[system.contacts.index]
        forces = system.frictional.world(balance.forces, normals)
        pressed = system.squeeze(balance.forces)
    mu = system.coulomb
    assert mu is not None
    return Friction(mu.coefficient, bool(mu.of_pairs), balance, forces, pressed)


def _collapse(system: RigidSystem) -> CollapseLoad:
    """Load factor at collapse, and how blocks move that the dead load alone moves."""
    system.tell("load factor at collapse")
    found = collapse_load(system.frictional, system.dead, system.live)
    if not np.isnan(found.factor) or found.mechanism is None:
        return found
    moving = placed_motion(system.blocks, found.mechanism, ~system.load.fixed)
    weight = system.stated.rigid_weight
    motion = motion_of_blocks(system.blocks, moving, weight, proved=True)
    return replace(found, status=f"{found.status}: {motion.words}")


def _reduced(system: RigidSystem, *loads: FloatArray) -> Reduced:
    return reduced(system.blocks, system.contacts, system.frictional, *loads)


def _sliding(system: RigidSystem) -> SlidingCollapse:
    """Collapse by sliding without dilation, in the plane where the problem is plane."""
    work = system.counted("collapse by sliding without dilation")
    problem = _reduced(system, system.dead, system.live)
    dead, live = (load[problem.rows] for load in (system.dead, system.live))
    result = sliding_collapse(problem.contacts, dead, live, work)
    if result.mechanism is not None:
        motion = problem.motion(result.mechanism, len(system.force))
        result = replace(result, mechanism=motion)
    return replace(result, state=sliding_state(system, result, problem))


def _ranges(system: RigidSystem) -> ForceRanges | None:
    """Ranges of the joints' forces, where forces balance the load."""
    contacts, force = system.contacts, system.force
    work = system.counted("ranges of the forces of joints")
    if system.balance is not None:
        problem, shown = _reduced(system, force), system.balance.forces[:, 0]
        return force_ranges(contacts, force, shown, frictional=problem, work=work)
    if not system.frictionless.holds:
        return None
    return force_ranges(contacts, force, system.frictionless.forces, work=work)
