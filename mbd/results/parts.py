"""What a rigid answer has beside its equilibrium: friction, load factors, ranges and margin.

A function finds each part, which gives rows of a table and plain data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from geometry.mesh import FloatArray
from geometry.parts.rows import Part, Row, finite, grouped, plain
from mbd.equilibrium import by_block
from mbd.limits.collapse import CollapseLoad, collapse_load
from mbd.limits.force_range import ForceRanges, force_ranges
from mbd.limits.plane import Reduced, reduced
from mbd.limits.pushes import interlocking_margin
from mbd.limits.sliding_collapse import SlidingCollapse, sliding_collapse, sliding_state
from mbd.results.rows import driven_motion
from mbd.system import RigidSystem

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly


@dataclass(frozen=True)
class Friction:
    """Whether the load is carried with Coulomb friction."""

    system: RigidSystem

    @property
    def rows(self) -> list[Row]:
        """None: the verdict and the evidence of the answer are those with friction."""
        return []

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        found, pressed = self.system.deciding, self.system.pressed
        largest = float(found.forces[:, 0].max(initial=0.0)) if found.holds else None
        data = plain(found, "holds", "residual", "work", "smallest_contact_work", "status")
        data |= {"largest_normal_force": largest, "mechanism": by_block(found.mechanism)}
        if pressed is not None:
            data["squeeze"] = plain(pressed, "needed", "blocks", "programs")
            data["squeeze"]["least"] = pressed.least if pressed.needed else None
        return data


def _factor_words(factor: float) -> str:
    return "none" if np.isnan(factor) else f"{factor:.6g}".replace("inf", "unbounded")


@dataclass(frozen=True)
class EdgesAndCorners:
    """What the contacts of edges and corners would add to the verdict."""

    faces: RigidSystem
    """Without them: that of the answer."""
    both: RigidSystem
    """With them."""
    factors: tuple[float, float] | None
    """Load factors at collapse without and with them; None where they are not asked."""

    @property
    def n_contacts(self) -> int:
        """Contacts that are left out."""
        return int((~cast("PolyhedralAssembly", self.faces.blocks).interfaces.bears).sum())

    @property
    def rows(self) -> list[Row]:
        """The verdict and the limit load with edges and corners; the proof of another class."""
        words, proof = "nothing to the verdict", list[Row]()
        if self.faces.edges_words:
            locked = "locked, " * self.both.classification.locked
            words = f"verdict: {locked}{self.both.verdict.carried}"
        if self.factors is not None:
            without, factor = map(_factor_words, self.factors)
            words += f"; limit load factor {factor} for {without}"
        left = f"({self.n_contacts} contacts without area, left out: a chamfer removes them)"
        if self.both.mechanism is not self.faces.mechanism:
            proof = [Row("proof with edges and corners", self.both.classification.proof)]
        return grouped(
            verdict=[Row("edges and corners would add", f"{words} {left}")], evidence=proof
        )

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        verdict = self.both.verdict
        return {
            "n_contacts": self.n_contacts,
            **self.both.classification.as_json(),
            "carried": verdict.holds,
            "squeeze_needed": verdict.squeezed,
            "collapse_factor": None if self.factors is None else finite(self.factors[1]),
        }


def parts_of(system: RigidSystem) -> dict[str, Part]:
    """What is found, by name."""
    method, balance = system.method, system.balance
    collapse = collapse_of(system) if method.collapse else None
    # Without a limit the answer rests on friction that jams: the ranges of forces decide.
    jams = collapse is not None and bool(np.isinf(collapse.factor))
    work = partial(system.counted, "unit loads of the margin")
    ranges = (method.ranges or jams) and (balance is None or balance.holds)
    parts: dict[str, Part | None] = {
        "friction": None if balance is None else Friction(system),
        "collapse": collapse,
        "sliding": _sliding(system) if method.sliding else None,
        "ranges": _ranges(system) if ranges else None,
        "margin": interlocking_margin(system.contacts, work()) if method.margin else None,
    }
    return {name: part for name, part in parts.items() if part is not None}


def collapse_of(system: RigidSystem) -> CollapseLoad:
    """Load factor at collapse, and how blocks move that the dead load alone moves."""
    system.tell("load factor at collapse")
    found = collapse_load(system.frictional, system.dead, system.live)
    if not np.isnan(found.factor) or found.mechanism is None:
        return found
    motion = driven_motion(system, found.mechanism, proved=True)
    return replace(found, status=f"{found.status}: {motion.words}")


def _reduced(system: RigidSystem, *loads: FloatArray) -> Reduced:
    return reduced(system.touching, system.contacts, system.frictional, *loads)


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
    if not system.equilibrium.holds:
        return None
    return force_ranges(contacts, force, system.equilibrium.forces, work=work)
