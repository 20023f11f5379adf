"""Limit of the force with which a support that moves drives its blocks: limit analysis of a push.

A support that moves holds all points of its region at one displacement. Rigid blocks determine no
force over that way, but the largest one: the support guides its block, and a force along its
displacement grows on top of all other loads until the blocks move.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from geometry.assembly import AnyBlocks
from geometry.loads import LoadCase
from geometry.mesh import FloatArray, ReadOnlyArrays
from geometry.parts.pairs import OfPairs, pair_values
from geometry.parts.regions import region_points
from geometry.parts.supports import HeldFace
from mbd.contact_jacobian import contact_jacobian
from mbd.friction import (
    CollapseLoad,
    FrictionalContacts,
    collapse_load,
    finite,
    frictional_contacts,
)
from mbd.options import FrictionLaw
from mbd.sliding_collapse import SlidingCollapse, sliding_collapse
from mbd.supports import Guide, RigidSupportError


@dataclass(frozen=True)
class PushLimit(ReadOnlyArrays):
    """Largest force along the displacement of a support, of which rigid blocks know the direction.

    Load factors are forces [N].
    """

    support: str
    """Name of the support."""
    associated: CollapseLoad
    """With joints that open as they slide: no force is larger; infinite where friction jams."""
    contacts: FrictionalContacts
    """Contacts, the block guided."""
    dead: FloatArray
    """All other loads, (n_rows,) [N]."""
    live: FloatArray
    """One newton of the push, alike."""

    @cached_property
    def sliding(self) -> SlidingCollapse:
        """With joints that slide without opening.

        By the friction pyramid inside the cone, for which states are certified in space, too.
        """
        pyramid = replace(self.contacts, law=FrictionLaw.PYRAMID)
        return sliding_collapse(pyramid, self.dead, self.live)


@dataclass(frozen=True)
class Push:
    """Largest force with which a support that moves pushes its block, by faces alone."""

    friction: float
    """Coefficient under which it is pushed [-]."""
    limit: PushLimit | str
    """Or why there is none."""

    @property
    def associated(self) -> float | None:
        """With associated friction [N]; None where there is none."""
        return None if isinstance(self.limit, str) else finite(self.limit.associated.factor)

    @property
    def words(self) -> str:
        """Force at which the block moves with associated friction, and without dilation."""
        if isinstance(self.limit, str):
            return self.limit
        most, slides = self.limit.associated, self.limit.sliding
        words = f"{most.factor:.5g} N with associated friction"
        if np.isinf(most.factor):
            words = "unbounded with associated friction: faces jam"
        elif not most.certified:
            words += " (not certified)"
        if slides.certified:
            words += f"; slides without dilation from {abs(slides.factor):.5g} N on"
            return f"{words} (friction pyramid)"
        return f"{words}; no certified state slides without dilation"

    @property
    def rows(self) -> list[tuple[str, str]]:
        """The force."""
        return [("limit of the push", f"{self.words} (by faces alone)")]

    def as_json(self) -> dict[str, Any]:
        """Return plain data: forces in N; None where friction jams and there is no limit."""
        if isinstance(self.limit, str):
            return {"friction": self.friction, "status": self.limit}
        most, slides = self.limit.associated, self.limit.sliding
        return {
            "friction": self.friction,
            "associated": finite(most.factor),
            "upper_bound": finite(most.upper_bound),
            "certified": most.certified,
            "unbounded": bool(np.isinf(most.factor)),
            "non_associated": finite(slides.factor) if slides.certified else None,
            "status": self.words,
        }


def at_rest(load: LoadCase) -> LoadCase:
    """Return a load without its supports that move."""
    return replace(load, held=tuple(support for support in load.held if not support.moves))


def push_limit(
    assembly: AnyBlocks, load: LoadCase, friction: float, of_pairs: OfPairs = ()
) -> PushLimit:
    """Find the largest force of the support that moves on top of all other loads.

    Parameters
    ----------
    assembly, load
        Blocks and what acts on them; one of the supports moves.
    friction
        Coefficient of friction of all joints [-].
    of_pairs
        That of some pairs of blocks.

    Raises
    ------
    RigidSupportError
        None or several supports move, or one is a spring.
    FrictionError
        The other loads alone cannot be carried.
    """
    pushes = [support for support in load.held if support.moves]
    if len(pushes) != 1:
        raise RigidSupportError(
            f"limit of a push: got {len(pushes)} supports that move; expected one"
        )
    (push,) = pushes
    same = {part.name: getattr(push, part.name) for part in fields(push)}
    held = (*at_rest(load).held, Guide(**same))
    contacts = contact_jacobian(assembly, load.fixed, held)
    dead, live = contacts.rows(load.wrenches), contacts.rows(_unit_force(assembly, push))
    coefficient = pair_values(friction, of_pairs, contacts.block_m, contacts.block_s)
    cones = frictional_contacts(assembly, contacts, coefficient, FrictionLaw.CONE)
    return PushLimit(push.title, collapse_load(cones, dead, live), cones, dead, live)


def _unit_force(assembly: AnyBlocks, push: HeldFace) -> FloatArray:
    """Wrench of one newton along its displacement at the mean of its points, (n_blocks, 6)."""
    assert push.displacement is not None
    unit = push.axes.T @ (push.axes @ push.displacement)
    unit /= np.linalg.norm(unit)
    arm = region_points(assembly, push.block, push.face).mean(axis=0)
    wrenches = np.zeros((assembly.n_blocks, 6))
    wrenches[push.block] = [*unit, *np.cross(arm - assembly.centroids[push.block], unit)]
    return wrenches
