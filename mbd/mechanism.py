"""Mechanism classes with certificates that one multiplication checks.

The printed linear program (eq. kinematic-feasibility-lp) is degenerate: δq = 0, s = 1 is always
optimal. What it means to ask is whether the cone {δq : Gᵀδq >= 0} is {0}. By the theorem of the
alternative (Stiemke, Gordan) it is, if and only if rank G = 6 N_b *and* some strictly positive λ
has Gλ = 0, a positive self-stress. With λ = 1 + μ that self-stress is an equilibrium problem with
the load G1, which the dual Newton method solves; where there is none, the method returns a
mechanism.

The two linear programs that follow in the paper (activated, suppressed) are equilibrium problems
as well: max fᵀδq over the cone is positive if and only if no equilibrium with f exists, and
min fᵀδq is negative if and only if none exists with -f.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import scipy.linalg

from geometry.mesh import FloatArray, ReadOnlyArrays
from geometry.parts.rows import plain
from mbd.contacts.jacobian import ContactJacobian
from mbd.equilibrium import (
    EQUILIBRIUM_TOLERANCE,
    Equilibrium,
    equilibrium,
    load_size,
)

#: Singular values of G below this fraction of the largest count as zero.
RANK_TOLERANCE = 1e-10
#: Of more free blocks than this, motions of single ones are looked for before motions of all.
MANY_BLOCKS = 100
#: A motion is that of one block where no gap closes faster than this part of the load's work.
_CLOSING = 1e-10


class MechanismClass(StrEnum):
    """Kinematic classes of the paper."""

    LOCKED = "locked"
    """No mechanism at all."""
    SUPPRESSED = "suppressed"
    """Mechanisms exist; the load opposes some and drives none."""
    NEUTRAL = "neutral"
    """Mechanisms exist; the load works on none of them."""
    ACTIVATED = "activated"
    """The load drives a mechanism."""
    UNDECIDED = "undecided"
    """Neither a self-stress nor a mechanism could be certified within tolerance."""

    @property
    def words(self) -> str:
        """The class in words."""
        return _CLASS_WORDS[self]


_CLASS_WORDS = {
    MechanismClass.LOCKED: "locked: no mechanism exists",
    MechanismClass.SUPPRESSED: "suppressed: a mechanism exists, the load acts against it",
    MechanismClass.NEUTRAL: "neutral: a mechanism exists, the load does no work on it",
    MechanismClass.ACTIVATED: "activated: a mechanism exists, and the load drives it",
    MechanismClass.UNDECIDED: "undecided: no proof of locking or of a mechanism within tolerance",
}


@dataclass(frozen=True)
class SelfStress(ReadOnlyArrays):
    """Certificate of *locked*: λ >= 1 with G λ = 0, and full rank."""

    forces: FloatArray
    """λ, every entry at least 1; (n_contacts,)."""
    residual: float
    """‖G λ‖ / ‖λ‖."""
    smallest_singular_value: float
    """σ_min(G) / σ_max(G); positive: full rank."""


@dataclass(frozen=True)
class Mechanism:
    """Certificate of a mechanism: δq ≠ 0 with Gᵀδq >= 0."""

    virtual_displacement: FloatArray
    """(δt, ℓ δθ) of each free block, ‖δq‖ = 1; (n_free, 6)."""
    smallest_gap_rate: float
    """min Gᵀδq; zero to round-off or positive."""
    work: float
    """fᵀδq / ‖f‖: positive where the load drives it, 0 for a zero load."""


@dataclass(frozen=True)
class Classification:
    """Mechanism class and its certificate."""

    mechanism: MechanismClass
    certificate: SelfStress | Mechanism | None
    """Self-stress if locked; the activated, opposed or some admissible mechanism if not."""

    @property
    def locked(self) -> bool:
        """Whether no mechanism exists."""
        return self.mechanism is MechanismClass.LOCKED

    @property
    def proof(self) -> str:
        """The certificate with its numbers, in words."""
        certificate = self.certificate
        if isinstance(certificate, SelfStress):
            return (
                "forces that press in every joint balance (‖Gλ‖/‖λ‖ = "
                f"{certificate.residual:.1e}), and no motion is free (σ_min/σ_max = "
                f"{certificate.smallest_singular_value:.1e})"
            )
        if isinstance(certificate, Mechanism):
            return (
                "a motion that closes no joint (smallest gap rate "
                f"{certificate.smallest_gap_rate:.1e}); work of the load on it, over its size: "
                f"{certificate.work:.3g}"
            )
        return "none"

    def as_json(self) -> dict[str, Any]:
        """Return the class and its certificate as plain data."""
        certificate, data = self.certificate, None
        if isinstance(certificate, SelfStress):
            data = {"kind": "self-stress", "smallest_force": float(certificate.forces.min())}
            data |= plain(certificate, "residual", "smallest_singular_value")
        elif isinstance(certificate, Mechanism):
            names = ("virtual_displacement", "smallest_gap_rate", "work")
            data = {"kind": "mechanism", **plain(certificate, *names)}
        return {"mechanism": str(self.mechanism), "certificate": data}


def as_mechanism(jacobian: ContactJacobian, direction: FloatArray, load: FloatArray) -> Mechanism:
    """Package a direction as a certificate, measured against G and f."""
    unit = direction / np.linalg.norm(direction)
    rates = jacobian.gap_rates(unit)
    size = load_size(load)
    return Mechanism(
        virtual_displacement=unit.reshape(-1, 6) if len(unit) % 6 == 0 else unit[None, :],
        smallest_gap_rate=float(rates.min(initial=0.0)) if len(rates) else 0.0,
        work=float(load @ unit) / size if size > 0 else 0.0,
    )


def smallest_singular_pair(jacobian: ContactJacobian) -> tuple[float, FloatArray]:
    """σ_min(G)/σ_max(G) and its left singular vector, by inverse subspace iteration.

    σ is evaluated as ‖Gᵀv‖, not as the root of an eigenvalue of G Gᵀ, so ratios down to 1e-15 are
    seen, not only down to 1e-8.
    """
    n_rows, n_contacts = jacobian.shape
    rng = np.random.default_rng(0)
    ones = np.ones(n_contacts)
    largest = _largest_singular_value(jacobian)
    if largest == 0.0:
        return 0.0, _some_motion(jacobian)
    shift = 1e-15 * largest**2
    solve = None
    while solve is None:
        try:
            solve = jacobian.normal_solver(ones, shift)
        except scipy.linalg.LinAlgError:
            shift *= 10.0
    subspace = rng.standard_normal((n_rows, min(jacobian.n_motions, 8)))
    subspace = np.linalg.qr(jacobian.admissible(subspace))[0]
    for _ in range(8):
        subspace = np.linalg.qr(jacobian.admissible(solve(subspace)))[0]
    rates = jacobian.condensed_rates(subspace)
    # The triangle of the tall matrix has its singular values and right vectors.
    _, values, right = np.linalg.svd(np.linalg.qr(rates, mode="r"))
    vector: FloatArray = subspace @ right[-1]
    return float(values[-1]) / largest, vector


def _some_motion(jacobian: ContactJacobian) -> FloatArray:
    """The first motion that supports leave, (n_rows,)."""
    n_rows, _ = jacobian.shape
    for row in range(n_rows):
        motion: FloatArray = jacobian.admissible(np.eye(1, n_rows, row)[0])
        if np.linalg.norm(motion) > RANK_TOLERANCE:
            break
    return motion


def _largest_singular_value(jacobian: ContactJacobian) -> float:
    n_rows, n_contacts = jacobian.shape
    if n_contacts == 0:
        return 0.0
    product = jacobian.normal_product()
    v = np.random.default_rng(1).standard_normal(n_rows)
    value = 0.0
    for _ in range(30):
        size = float(np.linalg.norm(v))
        if size <= RANK_TOLERANCE**2:  # supports take all wrenches of the contacts
            return 0.0
        v = v / size
        image = product(v)
        value, v = float(v @ image), image
    return float(np.sqrt(max(value, 0.0)))


def classify(
    jacobian: ContactJacobian,
    load: FloatArray,
    known: Equilibrium | None = None,
    *,
    many: bool = False,
) -> Classification:
    """Mechanism class of an assembly under a load (n_rows,) [N], with a certificate.

    ``known`` is its answer to the load, by whatever weights: what that proves is not proved again.
    Of ``many`` blocks a motion of one that the load opposes saves most of the time.
    """
    _, n_contacts = jacobian.shape
    ones = np.ones(n_contacts)
    if jacobian.n_motions == 0:  # supports hold all blocks
        return Classification(MechanismClass.LOCKED, SelfStress(ones, 0.0, 1.0))
    if n_contacts == 0:
        return _unlocked(jacobian, load, _some_motion(jacobian), known)
    opposed = single_motion(jacobian, -load) if many else None
    if opposed is not None:
        return _unlocked(jacobian, load, opposed, known, opposed=True)
    stress = jacobian.once("self-stress", lambda: equilibrium(jacobian, jacobian.resultant(ones)))
    if not stress.decided:
        return Classification(MechanismClass.UNDECIDED, None)
    ratio, vector = jacobian.once(
        "smallest singular pair", lambda: smallest_singular_pair(jacobian)
    )
    if stress.holds and ratio > RANK_TOLERANCE:
        forces = 1.0 + stress.forces
        residual = np.linalg.norm(jacobian.resultant(forces)) / np.linalg.norm(forces)
        return Classification(MechanismClass.LOCKED, SelfStress(forces, float(residual), ratio))
    motion = vector if stress.mechanism is None else stress.mechanism
    return _unlocked(jacobian, load, motion, known)


def single_motion(jacobian: ContactJacobian, load: FloatArray) -> FloatArray | None:
    """Motion of one block, all others at rest, that a load drives; None where there is none.

    It is what remains of that block's part of the load (n_rows,) [N] when contact forces have
    balanced as much of it as they can.
    """
    # Loaded here: assemblies of few blocks do without.
    from scipy.optimize import nnls

    for first in range(0, len(load), 6):
        pushed = load[first : first + 6]
        size = load_size(pushed)
        if size == 0.0:
            continue
        wrenches = jacobian.wrenches_on(first // 6)
        forces, rest = nnls(wrenches, -pushed / size)
        if rest <= EQUILIBRIUM_TOLERANCE:
            continue
        direction = (wrenches @ forces + pushed / size) / rest
        work = float(direction @ pushed) / size
        if (wrenches.T @ direction).min(initial=0.0) >= -_CLOSING * work:
            motion = np.zeros(len(load))
            motion[first : first + 6] = direction
            return motion
    return None


def _unlocked(
    jacobian: ContactJacobian,
    load: FloatArray,
    motion: FloatArray,
    known: Equilibrium | None,
    *,
    opposed: bool = False,
) -> Classification:
    """Class of an assembly with a mechanism, (n_rows,), which the load may be known to oppose."""
    driven = known if known is not None and known.decided else equilibrium(jacobian, load)
    kind = MechanismClass.UNDECIDED
    if driven.mechanism is not None:
        kind, motion = MechanismClass.ACTIVATED, driven.mechanism
    elif driven.holds and opposed:
        kind = MechanismClass.SUPPRESSED
    elif driven.holds:
        against = equilibrium(jacobian, -load)
        if against.mechanism is not None:
            kind, motion = MechanismClass.SUPPRESSED, against.mechanism
        elif against.holds:
            kind = MechanismClass.NEUTRAL
    return Classification(kind, as_mechanism(jacobian, motion, load))
