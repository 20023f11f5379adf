"""Forces that a load brings about in joints that were free of stress before it.

Joints are a little elastic, with a stiffness that is theirs per area, and slide by Coulomb's law:

    λ_n = k max(0, -δ_n),   λ_t = k (a - δ_t), cut back to μ λ_n,

where δ = Gᵀq are relative displacements and a where a joint last stuck. The load grows by
increments against a viscous resistance c to all motions,

    G λ(q) + s f = c (q - q_before),

so that every increment has a solution, by Newton's method; c falls with each one. Blocks that come
to rest are in equilibrium by Coulomb's law, in a state that the load itself has brought about. Of
blocks that keep moving nothing is proved: elastic joints are one assumption.

Equilibrium with admissible forces exists for a block between two walls whenever they may press it
as hard as they like. Nothing but a squeeze that was there before presses them. Blocks that do not
come to rest may still be carried where joints are pressed beforehand: a hint, for other joints or
another history may bring them to rest.

References: Cundall, "A computer model for simulating progressive, large-scale movements in blocky
rock systems", Proc. ISRM Symposium, Nancy (1971), for the joints; Simo and Hughes, Computational
Inelasticity (1998), chapter 3, for cutting back; Kao, Iannuzzo, Thomaszewski, Coros, Van Mele,
Block, "Coupled rigid-block analysis", Computer-Aided Design 146 (2022), for the question of a
squeeze.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from geometry.mesh import FloatArray
from geometry.parts.measures import first_largest
from mbd.contacts.friction import FrictionalContacts
from mbd.contacts.jacobian import RigidContacts
from mbd.equilibrium import EQUILIBRIUM_TOLERANCE, Equilibrium, least_normal
from mbd.programs import DETERMINED, Work

#: Operations that may be spent: seconds.
MOST_SECONDS = 10.0
#: Increments in which the load grows, and most of them in which the imbalance does not halve.
_INCREMENTS, _PATIENCE = 4, 15
#: Imbalance of an increment over the load, and most iterations for it.
_TARGET, _MOST_ITERATIONS = 1e-9, 30
#: Resistance falls by this after an increment of at most so many iterations, and grows after one
#: that fails.
_FALLS, _EASY, _GROWS = 0.25, 10, 4.0
#: Joints that are asked for their least force, those first that miss most of it.
_MOST_JOINTS = 6


@dataclass(frozen=True)
class Loaded:
    """End of a growing load: rest or motion."""

    rests: bool | None
    """Whether they came to rest; None where the limit of work came first."""
    forces: FloatArray
    """(λ_n, λ_1, λ_2) of each contact of the last increment, (n_contacts, 3) [N]."""
    motion: FloatArray
    """Their last motion, ‖d‖ = 1, (n_rows,)."""


@dataclass(frozen=True)
class _Joints:
    """Elastic joints that slide."""

    contacts: FrictionalContacts
    stiffness: FloatArray
    """(n_contacts,)"""

    def forces(self, displacement: FloatArray, stuck: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Forces (n, 3), and their derivatives by relative displacements, (n, 3, 3).

        ``stuck`` is where each joint last stuck, (n, 2).
        """
        k, origin = self.stiffness[:, None], np.column_stack([np.zeros(len(stuck)), stuck])
        trial = k * (origin - self.contacts.slip(displacement))
        return self.contacts.projected(trial), -k[:, None] * self.contacts.returned_by(trial)

    def sticks(self, displacement: FloatArray, forces: FloatArray) -> FloatArray:
        """Where the joints stick that carry forces (n, 3), (n, 2)."""
        return self.contacts.slip(displacement)[:, 1:] + forces[:, 1:] / self.stiffness[:, None]


def load_by_increments(
    contacts: FrictionalContacts, load: FloatArray, weights: FloatArray | None, work: Work
) -> Loaded:
    """Let a load (n_rows,) [N] grow on joints whose stiffnesses are the squares of weights.

    Weights are those of `mbd.equilibrium.column_weights`, (n_contacts,); None: ones.
    """
    stiffness = np.ones(contacts.n_contacts) if weights is None else weights**2
    joints = _Joints(contacts, stiffness)
    n, size = len(load), float(np.linalg.norm(load))
    unit, mean = load / size, float(stiffness.sum()) / n
    displacement, motion = np.zeros(n), np.zeros(n)
    stuck, forces = np.zeros((contacts.n_contacts, 2)), np.zeros((contacts.n_contacts, 3))
    resistance, share, rests = mean, 0.0, None
    done, least, halved = 0, np.inf, 0
    while not work.spent:
        done += 1
        if done - halved > _PATIENCE:
            rests = False
            break
        grown = min(1.0, share + 1.0 / _INCREMENTS)
        following, iterations = _increment(
            joints, displacement, stuck, load=grown * unit, resistance=resistance, work=work
        )
        if following is None:
            resistance *= _GROWS
            continue
        motion, displacement, share = following - displacement, following, grown
        forces, _ = joints.forces(displacement, stuck)
        stuck = joints.sticks(displacement, forces)
        left = float(np.linalg.norm(contacts.matrix @ forces.ravel() + unit))
        if share == 1.0 and left <= 0.1 * EQUILIBRIUM_TOLERANCE:
            rests = True
            break
        if left < 0.5 * least:
            least, halved = left, done
        if iterations <= _EASY:
            resistance *= _FALLS
    motion = motion / (float(np.linalg.norm(motion)) or 1.0)
    return Loaded(rests, size * forces, motion)


def _increment(
    joints: _Joints,
    start: FloatArray,
    stuck: FloatArray,
    *,
    load: FloatArray,
    resistance: float,
    work: Work,
) -> tuple[FloatArray | None, int]:
    """Displacement (n_rows,) in balance with a load, and iterations; None where none is found."""
    from scipy.sparse.linalg import splu

    matrix, resist = joints.contacts.matrix, sp.eye_array(len(load)) * resistance
    entries = int(matrix.nnz)

    def imbalance(displacement: FloatArray) -> tuple[FloatArray, FloatArray]:
        forces, slope = joints.forces(displacement, stuck)
        return matrix @ forces.ravel() + load - resistance * (displacement - start), slope

    displacement = start
    rest, slope = imbalance(displacement)
    for iteration in range(_MOST_ITERATIONS):
        size = float(np.linalg.norm(rest))
        if size <= _TARGET:
            return displacement, iteration
        inner = sp.bsr_array(
            (slope, np.arange(len(slope)), np.arange(len(slope) + 1)), shape=(3 * len(slope),) * 2
        )
        step = splu(sp.csc_array(resist - matrix @ inner.tocsc() @ matrix.T)).solve(rest)
        work.conic(1, entries)
        for halving in range(8):
            trial = displacement + 0.5**halving * step
            rest, slope = imbalance(trial)
            if np.linalg.norm(rest) < size:
                break
        displacement = trial
    return None, _MOST_ITERATIONS


def settled(
    found: Equilibrium,
    contacts: FrictionalContacts,
    load: FloatArray,
    weights: FloatArray | None,
) -> Equilibrium:
    """Decide by a growing load where neither forces nor a mechanism are proved.

    Blocks that come to rest prove forces; others show how they move.
    """
    if found.decided:
        return found
    loaded = load_by_increments(contacts, load, weights, Work(MOST_SECONDS))
    if not loaded.rests:
        return replace(found, motion=loaded.motion)
    left = contacts.matrix @ loaded.forces.ravel() + load
    residual = float(np.linalg.norm(left) / np.linalg.norm(load))
    return replace(
        found,
        holds=True,
        forces=loaded.forces,
        residual=residual,
        status=f"blocks come to rest under the growing load, relative residual {residual:.1e}",
    )


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
    work: Work | None = None,
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
        Column scaling of `mbd.equilibrium.column_weights`, (n_contacts,): stiffnesses
        are its square.
    work
        What may be spent, by default `MOST_SECONDS`; the least force of joints needs some more.
    """
    if not (load.any() and np.any(frictional.friction)):
        return Squeeze(needed=False, programs=0)
    work = work or Work(MOST_SECONDS)
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
    least = np.array([least_normal(frictional, load / size, of == k, work=work) for k in asked])
    least = np.where(np.isnan(least), 0.0, least)
    order = np.argsort(asked)
    k = order[first_largest(least[order])]
    if least[k] <= DETERMINED:
        k, least[k] = 0, 0.0
    m, s = joints[asked[k]].tolist()
    return (m, s), size * float(least[k])
