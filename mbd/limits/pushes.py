"""How blocks resist pushes: the margin of interlocking, small pushes, and the limit of one push.

An assembly is interlocked if and only if every load can be carried (Wang, Song, Pauly, "DESIA: a
general framework for designing interlocking assemblies", ACM Trans. Graph. 37 (2018) and "Design
and structural optimization of topological interlocking assemblies", ibid. 38 (2019)). Every load
is a positive combination of unit forces and couples on single blocks, so those decide, and the
worst of them measures the margin.

A unit load carried with Σ λ²/A = 1/S needs the contact energy of a piston of area S under uniform
pressure: S is its *bearing area* [mm²]. The effort sqrt(1/S) is convex and homogeneous in the
load, so a load with components f_i on those axes needs at most Σ |f_i| / sqrt(S_i).

Blocks that carry a load are held one way and not another: a small push along each axis tells.

A support that moves holds all points of its region at one displacement. Rigid blocks determine no
force over that way, but the largest one: the support guides its block, and a force along its
displacement grows on top of all other loads until the blocks move.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from geometry.loads import LoadCase
from geometry.mesh import FloatArray
from geometry.parts.measures import first_largest
from geometry.parts.placed import AnyBlocks
from geometry.parts.regions import HeldFace, region_points
from geometry.parts.rows import Row, finite, number, plain
from mbd.contacts.jacobian import RigidContacts
from mbd.contacts.supports import Guide, RigidSupportError
from mbd.equilibrium import Equilibrium, column_weights, newton_equilibrium
from mbd.limits.collapse import CollapseLoad, collapse_load
from mbd.limits.sliding_collapse import SlidingCollapse, sliding_collapse
from mbd.options import FrictionLaw, Norm
from mbd.programs import Work
from mbd.system import RigidSystem, Stated

_AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


@dataclass(frozen=True)
class Margin:
    """The load that is carried worst."""

    bearing_area: float
    """Smallest bearing area over all unit loads [mm²]; 0 if some load cannot be carried."""
    block: int
    """Number of the loaded block."""
    load: str
    """Axis of the worst load, e.g. ``+Fz`` or ``-Mx`` (couples are M/ℓ)."""
    areas: FloatArray
    """Bearing area of each unit load (0 where it cannot be carried): (n_free, 6, 2) [mm²], the
    last index 0 for +, 1 for -."""
    mechanism: FloatArray | None
    """Mechanism that the worst load drives, (n_rows,); None if every load is carried."""
    unasked: int = 0
    """Unit loads that were left at the limit of work; their bearing areas are nan."""

    @property
    def interlocked(self) -> bool:
        """Whether every load that was asked can be carried."""
        return self.bearing_area > 0.0

    @property
    def rows(self) -> list[Row]:
        """The load and its bearing area."""
        area, worst = f"{self.bearing_area:.4g} mm²", f"{self.load} on block {self.block}"
        words = f"none: unit load {worst} is not statically admissible"
        if self.unasked:
            of = self.areas.size
            words = f"not decided (limit of work): {of - self.unasked} of {of} unit loads were "
            words += f"asked; the worst of them: {worst}, {area}"
        elif self.interlocked:
            words = f"smallest bearing area {area} (unit load {worst})"
        return [Row("margin", words, finite(self.bearing_area), "mm²")]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return plain(self, "interlocked", "bearing_area", "unasked", "block", "load")


def interlocking_margin(contacts: RigidContacts, work: Work | None = None) -> Margin:
    """Carry unit forces and couples, both ways, on each free block in turn.

    Costs twelve equilibria for each free block. No further load is asked where no work is left.
    """
    areas, (n_rows, n_contacts) = contacts.areas, contacts.jacobian.shape
    bearing = np.full((n_rows, 2), np.nan)
    mechanism: FloatArray | None = None
    answers = _equilibria(contacts, _units(contacts), Norm.PRESSURE, work=work or Work())
    for place, (load, found) in enumerate(answers):
        area = 0.0
        if np.linalg.norm(load) <= _TAKEN:
            area = np.inf
        elif found.holds and n_contacts:
            area = 1.0 / float(np.sum(found.forces**2 / areas))
        elif mechanism is None:
            mechanism = found.mechanism
        bearing.flat[place] = area
    worst = first_largest(np.where(np.isnan(bearing), -np.inf, -bearing))
    row, way = divmod(worst, 2)
    return Margin(
        bearing_area=float(bearing[row, way]),
        block=int(contacts.free_blocks[row // 6]),
        load="+-"[way] + _AXES[row % 6],
        areas=bearing.reshape(-1, 6, 2),
        mechanism=mechanism,
        unasked=int(np.isnan(bearing).sum()),
    )


def _units(contacts: RigidContacts) -> Iterator[FloatArray]:
    """Unit forces and couples on each free block, one way and the other, (n_rows,) each."""
    n_rows = contacts.jacobian.shape[0]
    for row in range(n_rows):
        yield from (sign * np.eye(1, n_rows, row)[0] for sign in (1.0, -1.0))


def _equilibria(
    contacts: RigidContacts,
    loads: Iterable[FloatArray],
    norm: Norm,
    *,
    beside: FloatArray | float = 0.0,
    start: FloatArray | None = None,
    work: Work | None = None,
) -> Iterator[tuple[FloatArray, Equilibrium]]:
    """Parts of loads (n_rows,) [N] that supports leave, and their equilibria.

    ``beside`` acts with each of them, ``start`` is the multiplier of its equilibrium. No further
    load is asked where no work is left.
    """
    jacobian, weights = contacts.jacobian, column_weights(norm, contacts.areas)
    for load in loads:
        if work is not None and work.spent:
            return
        left = jacobian.admissible(load)
        found = newton_equilibrium(jacobian, beside + left, weights=weights, start=start)
        if work is not None:
            work.conic(found.iterations, 12 * jacobian.shape[1])
        yield left, found


#: What supports leave of a unit force that they take [-].
_TAKEN = 1e-9
#: Push over load: far above the tolerance of an equilibrium, too small to lift what weighs.
_PUSH = 1e-3

_WAYS = ("+x", "-x", "+y", "-y", "+z", "-z")


@dataclass(frozen=True)
class Pushes:
    """Small pushes on all blocks together that are resisted beside the load, without friction."""

    system: RigidSystem

    @cached_property
    def held(self) -> dict[str, bool]:
        """Whether blocks without friction stay where a small push acts beside their load.

        All free blocks are pushed at once, each by its volume. By duality a push that is not
        carried drives a motion that the load does not hinder: along it the blocks are free, however
        well the load is carried. Keys are +x, -x and so on; a direction that is neither proved held
        nor free is left out.
        """
        system, held = self.system, dict[str, bool]()
        size = _PUSH * (float(np.linalg.norm(system.force)) or 1.0)
        answers = _equilibria(
            system.contacts,
            [size * push for push in self._pushes.values()],
            system.method.norm,
            beside=system.force,
            start=system.equilibrium.multiplier,
        )
        for way, (_, found) in zip(_WAYS, answers, strict=True):
            if found.decided:
                held[way] = found.holds
        return held

    @cached_property
    def by_load(self) -> tuple[str, ...]:
        """Directions in which nothing but the load holds the blocks: they would be lifted."""
        ways = [way for way, holds in self.held.items() if holds]
        alone = _equilibria(self.system.contacts, [self._pushes[way] for way in ways], Norm.FORCE)
        return tuple(way for way, (_, found) in zip(ways, alone, strict=True) if not found.holds)

    @cached_property
    def _pushes(self) -> dict[str, FloatArray]:
        """One newton on all free blocks by their volumes, along each way, (n_rows,) [N]."""
        contacts = self.system.contacts
        volumes = self.system.blocks.volumes[contacts.free_blocks]
        pushes = np.zeros((len(_WAYS), len(volumes), 6))
        for k in range(len(_WAYS)):
            pushes[k, :, k // 2] = (-1.0) ** k * volumes / np.linalg.norm(volumes)
        return {
            way: contacts.jacobian.admissible(push.ravel())
            for way, push in zip(_WAYS, pushes, strict=True)
        }

    @property
    def rows(self) -> list[Row]:
        """Axes along which the assembly resists, is held by its load, and slides freely."""
        alone = self.system.dead.any() and not self.system.live.any()
        down = "held down by its weight" if alone else "held by its load"
        words = []
        for title, axes in (
            (
                "resists pushes along",
                [way for way in self.held if self.held[way] and way not in self.by_load],
            ),
            (f"{down} against pushes along", list(self.by_load)),
            ("slides freely along", [way for way in self.held if not self.held[way]]),
        ):
            if axes:
                words.append(f"{title} {', '.join(axes)}")
        words[-1:] = [f"{words[-1]} (all blocks together, frictionless)"]
        return [Row("resistance to pushes", "; ".join(words), group="verdict")]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {"held_against": self.held, "held_by_load": list(self.by_load)}


# ---------------------------------------------------------------------------------------------
# A support that moves


@dataclass(frozen=True)
class Push:
    """Largest force along the displacement of a support that moves; load factors are forces [N].

    Rigid blocks know the direction of its displacement alone.
    """

    system: RigidSystem
    """The block guided: a newton of the push grows beside all other loads."""
    associated: CollapseLoad
    """With joints that open as they slide: no force is larger; infinite where friction jams."""

    @cached_property
    def sliding(self) -> SlidingCollapse:
        """With joints that slide without opening.

        By the friction pyramid inside the cone, for which states are certified in space, too.
        """
        pyramid = replace(self.system.frictional, law=FrictionLaw.PYRAMID)
        return sliding_collapse(pyramid, self.system.dead, self.system.live)

    @property
    def words(self) -> str:
        """Force at which the block moves with associated friction, and without dilation."""
        most = self.associated
        if np.isnan(most.factor):
            return most.status
        words = f"{number(most.factor)} N with associated friction"
        if np.isinf(most.factor):
            words = "unbounded with associated friction: faces jam"
        elif not most.certified:
            words += " (not certified)"
        if self.sliding.certified:
            words += f"; slides without dilation from {number(abs(self.sliding.factor))} N on"
            return f"{words} (friction pyramid)"
        return f"{words}; no certified state slides without dilation"

    @property
    def rows(self) -> list[Row]:
        """The force."""
        factor = finite(self.associated.factor)
        return [Row("limit of the push", f"{self.words} (by faces)", factor, "N", "verdict")]

    def as_json(self) -> dict[str, Any]:
        """Return plain data: forces in N; None where friction jams and there is no limit."""
        most, slides, mu = self.associated, self.sliding, self.system.coulomb
        return {
            "friction": 0.0 if mu is None else mu.coefficient,
            "associated": finite(most.factor),
            "upper_bound": finite(most.upper_bound),
            "certified": most.certified,
            "unbounded": bool(np.isinf(most.factor)),
            "non_associated": finite(slides.factor) if slides.certified else None,
            "status": self.words,
        }


def push_limit(system: RigidSystem) -> Push:
    """Find the largest force of the support that moves on top of all other loads.

    Raises
    ------
    RigidSupportError
        None or several supports move, or one is a spring.
    """
    blocks, load = system.blocks, system.load
    pushes = [support for support in load.held if support.moves]
    if len(pushes) != 1:
        raise RigidSupportError(
            f"limit of a push: got {len(pushes)} supports that move; expected one"
        )
    (push,) = pushes
    same = {part.name: getattr(push, part.name) for part in fields(push)}
    held = (*(support for support in load.held if not support.moves), Guide(**same))
    one = LoadCase(blocks, load.name, (), load.fixed, held, body_wrenches=_unit_force(blocks, push))
    method = replace(system.method, friction_law=FrictionLaw.CONE)
    guided = RigidSystem(Stated(blocks, one, load.wrenches, system.coulomb), method)
    return Push(guided, collapse_load(guided.frictional, guided.dead, guided.live))


def _unit_force(assembly: AnyBlocks, push: HeldFace) -> FloatArray:
    """Wrench of one newton along its displacement at the mean of its points, (n_blocks, 6)."""
    assert push.displacement is not None
    unit = push.axes.T @ (push.axes @ push.displacement)
    unit /= np.linalg.norm(unit)
    arm = region_points(assembly, push.block, push.face).mean(axis=0)
    wrenches = np.zeros((assembly.n_blocks, 6))
    wrenches[push.block] = [*unit, *np.cross(arm - assembly.centroids[push.block], unit)]
    return wrenches
