"""Whether friction that carries a load is pressed by that load, or only by a squeeze beforehand.

Equilibrium with admissible forces exists for a block between two walls whenever they may press it
as hard as they like. Nothing but a squeeze that was there before presses them. Joints that are a
little elastic, and free of stress before the load grows, tell the two apart
(`mbd.friction.loading`). Blocks that come to rest are carried. Blocks that do not may still
be carried where joints are pressed beforehand: a hint, for other joints or another history may
bring them to rest.

Reference: Kao, Iannuzzo, Thomaszewski, Coros, Van Mele, Block, "Coupled rigid-block analysis",
Computer-Aided Design 146 (2022), for the question.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.mesh import BoolArray, FloatArray
from geometry.parts.measures import first_largest
from mbd.contacts.jacobian import RigidContacts
from mbd.friction.equilibrium import FrictionalContacts, least_forces
from mbd.friction.loading import MOST_SECONDS, load_by_increments
from mbd.frictionless.equilibrium import EQUILIBRIUM_TOLERANCE
from mbd.programs import DETERMINED, Work

#: Joints that are asked for their least force, those first that miss most of it.
_MOST_JOINTS = 6


@dataclass(frozen=True, kw_only=True)
class Squeeze:
    """Whether a load that friction can carry also presses the joints that carry it."""

    needed: bool | None
    """Whether joints seem to need a squeeze beforehand; None where the limit of work came first."""
    blocks: tuple[int, int] | None = None
    """Two blocks that need the largest force between them: of all joints, or of none by itself."""
    least: float = 0.0
    """Least normal force between them over all admissible states, which is proved [N]."""
    motion: FloatArray | None = None
    """How blocks move that are not pressed beforehand, ‖d‖ = 1, (n_rows,)."""
    programs: int
    """Linear problems and cone programs solved."""

    def reason(self, named: Callable[[int], str] = str) -> str:
        """Where a squeeze is needed, or why it is not decided; blocks by their names."""
        if self.needed is None:
            return f"limit of work or time after {self.programs} linear problems"
        if not self.needed or self.blocks is None:
            return ""
        m, s = map(named, self.blocks)
        if not self.least:
            return f"the load presses too little between {m} and {s}"
        return f"at least {self.least:.4g} N between {m} and {s}"


def squeeze(
    contacts: RigidContacts,
    frictional: FrictionalContacts,
    load: FloatArray,
    forces: FloatArray,
    *,
    weights: FloatArray | None = None,
    limit: float = MOST_SECONDS,
    progress: Callable[[int], None] | None = None,
) -> Squeeze:
    """Look for forces that the load itself brings about.

    Parameters
    ----------
    contacts, frictional
        The same contacts without and with tangents.
    load
        f, (n_rows,) [N], which can be carried.
    forces
        Admissible forces that carry it, (n_contacts, 3) [N].
    weights
        Column scaling of `mbd.frictionless.equilibrium.column_weights`, (n_contacts,): stiffnesses
        are its square.
    limit
        Reference seconds (`geometry.machine.work`) that may be spent; the least force of joints
        needs some more.
    progress
        Called with the number of linear problems solved.
    """
    if not (load.any() and np.any(frictional.friction)):
        return Squeeze(needed=False, programs=0)
    work = Work(limit, progress=progress)
    loaded = load_by_increments(frictional, load, weights, work)
    if loaded.rests is not False:
        return Squeeze(needed=None if loaded.rests is None else False, programs=work.programs)
    missing = forces[:, 0] - loaded.forces[:, 0]
    blocks, least = _most_missing(contacts, frictional, load, missing, work)
    return Squeeze(
        needed=True,
        blocks=blocks,
        least=least,
        motion=loaded.motion,
        programs=work.programs,
    )


def _balanced(frictional: FrictionalContacts, unit: FloatArray, solution: Any) -> FloatArray | None:
    """Forces of a program, (n, 3); None where they do not balance the load of one."""
    forces = np.asarray(solution.x)
    balanced = np.linalg.norm(frictional.matrix @ forces + unit) <= EQUILIBRIUM_TOLERANCE
    return forces.reshape(-1, 3) if balanced else None


def _most_missing(
    contacts: RigidContacts,
    frictional: FrictionalContacts,
    load: FloatArray,
    missing: FloatArray,
    work: Work,
) -> tuple[tuple[int, int], float]:
    """Joint with the largest least force [N] among those that miss most of ``missing`` (n,).

    The one that misses most, and no force, where each may be open in one state or another.
    """
    joints, of = contacts.joints
    short = np.bincount(of, weights=missing, minlength=len(joints))
    asked = np.argsort(-short, kind="stable")[:_MOST_JOINTS]
    size = float(np.linalg.norm(load))
    least = np.array([_least_force(frictional, load / size, of == k, work) for k in asked])
    least = np.where(np.isnan(least), 0.0, least)
    order = np.argsort(asked)
    k = order[first_largest(least[order])]
    if least[k] <= DETERMINED:
        k, least[k] = 0, 0.0
    m, s = joints[asked[k]].tolist()
    return (m, s), size * float(least[k])


def _least_force(
    frictional: FrictionalContacts, unit: FloatArray, joint: BoolArray, work: Work
) -> float:
    """Least sum of the normal forces of some contacts, (n,), over all admissible states.

    Of a load of one; nan where the program finds none.
    """
    cost = np.zeros((frictional.n_contacts, 3))
    cost[joint, 0] = 1.0
    solution = least_forces(frictional, unit, cost=cost.ravel(), work=work)
    forces = _balanced(frictional, unit, solution)
    return np.nan if forces is None else float(cost.ravel() @ forces.ravel())
