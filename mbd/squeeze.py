"""Whether friction that carries a load is pressed by that load, or only by a squeeze beforehand.

Equilibrium with admissible forces exists for a block between two walls whenever they may press it
as hard as they like. Nothing but a squeeze that was there before presses them. Joints that are a
little elastic tell the two apart: with the limits of friction g held fixed, the forces are those of
least complementary energy,

    min ½ Σ |λ|² / w  s.t.  G λ + f = 0,  λ_n >= 0,  ‖λ_t‖ <= g,

and the limits that belong to them are g = μ λ_n. A fixed point is a state of Coulomb's law in
elastic joints that were free of stress before the load; where the limits run out before one is
found, the load does not press the joints enough.

References: Nečas, Jarušek, Haslinger, "On the solution of the variational inequality to the
Signorini problem with small friction", Boll. Unione Mat. Ital. 17-B (1980), for the fixed point;
Kao, Iannuzzo, Thomaszewski, Coros, Van Mele, Block, "Coupled rigid-block analysis",
Computer-Aided Design 146 (2022), for the question.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.mesh import BoolArray, FloatArray
from geometry.parts.measures import first_largest
from mbd.contact_jacobian import Contacts
from mbd.equilibrium import EQUILIBRIUM_TOLERANCE
from mbd.force_range import DETERMINED
from mbd.friction import FrictionalContacts, least_forces
from mbd.programs import Work

#: Change of the limits over the largest one at which they are those of the forces.
_SETTLED = 1e-3
#: Part of the way to the next limits: all of it while changes shrink by this much, else half of it;
#: and the least part that is tried before giving up.
_SHRINKS, _STEP, _LEAST_STEP = 0.7, 0.5, 0.02
#: Operations that may be spent: seconds.
MOST_SECONDS = 10.0
#: Joints that are asked for their least force, those first that miss most of it.
_MOST_JOINTS = 6


@dataclass(frozen=True, kw_only=True)
class Squeeze:
    """Whether a load that friction can carry also presses the joints that carry it."""

    needed: bool | None
    """Whether joints must be pressed beforehand; None where the limit of work came first."""
    blocks: tuple[int, int] | None = None
    """The two blocks that need the largest force between them; None where no single joint does."""
    least: float = 0.0
    """Least normal force between them over all admissible states [N]."""
    programs: int
    """Cone programs solved."""

    def words(self, named: Callable[[int], str] = str) -> str:
        """The verdict, blocks by their names."""
        if self.needed is None:
            return (
                "not decided (limit of work): forces that carry the load exist, and whether it "
                f"presses the joints itself was open after {self.programs} programs"
            )
        if not self.needed:
            return "carried"
        press = "carried only if pressed beforehand"
        if self.blocks is None:
            return f"{press}: no single joint needs a force in every state"
        m, s = map(named, self.blocks)
        return f"{press}: at least {self.least:.4g} N between {m} and {s}"


def squeeze(
    contacts: Contacts,
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
        Admissible forces that carry it, (n_contacts, 3) [N]; the limits start from them.
    weights
        Column scaling of `mbd.equilibrium.column_weights`, (n_contacts,): w is its square.
    limit
        Reference seconds (`geometry.machine.work`) that may be spent; the least force of joints
        needs some more.
    progress
        Called with the number of programs solved.
    """
    size, mu = float(np.linalg.norm(load)), frictional.friction
    if size == 0.0 or not np.any(mu):
        return Squeeze(needed=False, programs=0)
    unit, limits = load / size, mu * forces[:, 0] / size
    step, work, before = 1.0, Work(limit, progress=progress), np.inf
    normal = forces[:, 0] / size
    last = limits
    while not work.spent:
        result = _with_limits(frictional, unit, limits, weights, work)
        if result is None:
            step *= 0.5
            if step < _LEAST_STEP:
                pressed = np.divide(last, mu, out=np.zeros_like(last), where=np.asarray(mu) > 0.0)
                return _most_missing(contacts, frictional, load, pressed - normal, work)
            limits = last + step * (mu * normal - last)
            continue
        normal, last = result[:, 0], limits
        change = mu * normal - limits
        largest = float(np.abs(change).max())
        if largest <= _SETTLED * max(limits.max(), (mu * normal).max()):
            return Squeeze(needed=False, programs=work.programs)
        if largest > _SHRINKS * before:
            step = min(step, _STEP)
        before = largest
        limits = limits + step * change
    return Squeeze(needed=None, programs=work.programs)


def _with_limits(
    frictional: FrictionalContacts,
    unit: FloatArray,
    limits: FloatArray,
    weights: FloatArray | None,
    work: Work,
) -> FloatArray | None:
    """Forces of least energy with fixed limits of friction, (n, 3); None where none balance."""
    solution = least_forces(frictional, unit, weights=weights, limits=limits, work=work)
    return _balanced(frictional, unit, solution)


def _balanced(frictional: FrictionalContacts, unit: FloatArray, solution: Any) -> FloatArray | None:
    """Forces of a program, (n, 3); None where they do not balance the load of one."""
    forces = np.asarray(solution.x)
    balanced = np.linalg.norm(frictional.matrix @ forces + unit) <= EQUILIBRIUM_TOLERANCE
    return forces.reshape(-1, 3) if balanced else None


def _most_missing(
    contacts: Contacts,
    frictional: FrictionalContacts,
    load: FloatArray,
    missing: FloatArray,
    work: Work,
) -> Squeeze:
    """Joint with the largest least force among those that miss most, and that force."""
    joints, of = contacts.joints
    short = np.bincount(of, weights=missing, minlength=len(joints))
    asked = np.sort(np.argsort(-short, kind="stable")[:_MOST_JOINTS]).tolist()
    size = float(np.linalg.norm(load))
    least = np.array([_least_force(frictional, load / size, of == k, work) for k in asked])
    least = np.where(np.isnan(least), 0.0, least)
    k = first_largest(least)
    # Where each joint may be open in one state or another, no single one needs a force.
    if least[k] <= DETERMINED:
        return Squeeze(needed=True, programs=work.programs)
    m, s = joints[asked[k]].tolist()
    return Squeeze(needed=True, blocks=(m, s), least=size * float(least[k]), programs=work.programs)


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
