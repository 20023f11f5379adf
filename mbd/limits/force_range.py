"""How much of the reaction is undetermined: least and largest force of every joint.

Rigid blocks with more contacts than equations have many admissible states; the least-norm answer
is one of them. For each joint (all contacts between two blocks) two linear programs find the
least and the largest sum of its normal forces over all of them,

    min, max Σ λ_n over the joint s.t. G λ + f = 0, λ admissible.

A joint that takes part in an admissible self-stress, G λ = 0, can be pressed without bound: one
program finds all of these first, max Σ s_j with s_j <= 1 and s_j <= the sum of joint j.

With the cone of friction in space the programs are cone programs. In a plane the cone is two edges,
and the pyramid has four: of linear programs only the costs differ from one to the next, and each
starts from the basis of the last one.

References: eq. SCP-linear of the paper; Kao, Iannuzzo, Thomaszewski, Coros, Van Mele, Block,
"Coupled rigid-block analysis", Computer-Aided Design 146 (2022), on the indeterminacy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.rows import Row, finite
from mbd.contacts.friction import FrictionalContacts
from mbd.contacts.jacobian import RigidContacts
from mbd.equilibrium import least_normal, newton_equilibrium
from mbd.limits.plane import Reduced
from mbd.programs import DETERMINED, LinearPrograms, Work


@dataclass(frozen=True)
class ForceRanges:
    """Range of the normal force of every joint over all admissible states."""

    block_m: IntArray
    """Master block of each joint, (n_joints,)."""
    block_s: IntArray
    """Opposing block, (n_joints,)."""
    least: FloatArray
    """Least normal force, (n_joints,) [N]."""
    largest: FloatArray
    """Largest, infinite where a self-stress presses the joint; (n_joints,) [N]."""
    shown: FloatArray
    """Normal force of the least-norm answer, (n_joints,) [N]."""
    load: float
    """‖f‖, which `DETERMINED` refers to [N]."""
    unanswered: int = 0
    """Joints whose range was open at the limit of work; what is missing is nan."""

    @property
    def width(self) -> FloatArray:
        """Largest less least, (n_joints,) [N]."""
        return self.largest - self.least

    @property
    def undetermined(self) -> BoolArray:
        """Which joints have a range and no value, (n_joints,)."""
        return self.width > DETERMINED * self.load

    @property
    def unbounded(self) -> BoolArray:
        """Which joints a self-stress can press without bound, (n_joints,)."""
        return np.isinf(self.largest)

    @property
    def rows(self) -> list[Row]:
        """How many joints are statically indeterminate, and the widest range."""
        return [Row("joint forces", self._words)]

    @property
    def _words(self) -> str:
        wide, unbounded = int(self.undetermined.sum()), int(self.unbounded.sum())
        of = f"of {len(self.least)} joints"
        if open_ := int(np.isnan(self.width).sum()):
            reason = " (limit of work)" if self.unanswered else ""
            return (
                f"not decided{reason} in {open_} {of}; of the others {wide} "
                f"are statically indeterminate, {unbounded} of them unbounded (self-stress)"
            )
        if wide == 0:
            return f"statically determinate {of}: every admissible state has the same forces"
        bound = f", {unbounded} of them unbounded (self-stress)" if unbounded else ""
        k = int(np.argmax(np.where(self.unbounded, -1.0, self.width)))
        if unbounded == len(self.least):
            k = int(self.least.argmax())
        pair = f"blocks {self.block_m[k]} and {self.block_s[k]}"
        most = "unbounded" if self.unbounded[k] else f"{self.largest[k]:.4g} N"
        return (
            f"statically indeterminate in {wide} {of}{bound}; between {pair}: minimum "
            f"{self.least[k]:.4g} N, minimum-norm {self.shown[k]:.4g} N, maximum {most}"
        )

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        joints = [
            {
                "blocks": [int(self.block_m[k]), int(self.block_s[k])],
                "least": finite(float(self.least[k])),
                "least_norm": float(self.shown[k]),
                "largest": finite(float(self.largest[k])),
                "unbounded": bool(self.unbounded[k]),
            }
            for k in range(len(self.least))
        ]
        return {
            "joints": joints,
            "undetermined": int(self.undetermined.sum()),
            "unanswered": self.unanswered,
            "unbounded": int(self.unbounded.sum()),
        }


def force_ranges(
    contacts: RigidContacts,
    load: FloatArray,
    shown: FloatArray,
    *,
    frictional: Reduced | None = None,
    work: Work | None = None,
) -> ForceRanges | None:
    """Least and largest normal force of every joint.

    Up to two programs for each joint: milliseconds for walls, tenths of a second for a tube with
    40 000 contacts, longer with friction.

    Parameters
    ----------
    contacts
        Of `mbd.contacts.jacobian`.
    load
        f, (n_rows,) [N].
    shown
        Normal forces of the least-norm answer, (n_contacts,) [N].
    frictional
        The same contacts with friction, in their plane where there is one; None for none.
    work
        What may be spent; no joint is asked beyond.

    Returns
    -------
    ForceRanges | None
        None where no admissible forces balance the load. `ForceRanges.unanswered` joints were left
        at the limit of work.
    """
    pairs, joint = contacts.joints
    n_joints, size = len(pairs), float(np.linalg.norm(load))
    sums = np.asarray(np.bincount(joint, weights=shown, minlength=n_joints), dtype=np.float64)
    if frictional is None:
        matrix, of = contacts.jacobian.to_matrix(), joint
    else:
        matrix, of = _edges(frictional.contacts), np.repeat(joint[frictional.kept], 4)
        load = load[frictional.rows]
    work, known = work or Work(), _all_pressed(contacts, n_joints)
    pressed = _self_stressed(matrix, of, n_joints, work) if known is None else known
    unit = load / size if size > 0.0 else load
    if frictional is not None and frictional.has_cones:
        extreme = _by_cones(frictional.contacts, joint, unit, work)
    else:
        extreme = _by_edges(matrix, of, unit, work)
    answer = partial(ForceRanges, pairs[:, 0], pairs[:, 1], shown=sums, load=size)
    least, largest = np.full(n_joints, np.nan), np.where(pressed, np.inf, np.nan)
    for k in range(n_joints):
        result = extreme(k, 1.0)
        if work.spent:
            return _stopped(answer(least, largest))
        if result is None:
            return None
        least[k] = max(size * result, 0.0) + 0.0  # no -0
    for k in np.flatnonzero(~pressed).tolist():
        result = extreme(k, -1.0) if size > 0.0 else 0.0
        if work.spent:
            return _stopped(answer(least, largest))
        # What only the solver's tolerance lets grow without bound is no answer.
        largest[k] = np.nan if result is None else -size * result
    return answer(least, largest)


#: Of a joint by its number and a sign of 1 or -1: the least sum of its normal forces for a load of
#: one, or minus the largest. None where no admissible forces balance, nan where none are found.
_Extreme = Callable[[int, float], float | None]


def _by_edges(matrix: sp.csc_array, of: IntArray, unit: FloatArray, work: Work) -> _Extreme:
    """By linear programs over the edges of what is admissible, ``of`` joints."""
    programs = LinearPrograms(matrix, (-unit, -unit), (0.0, np.inf), work)

    def extreme(joint: int, sign: float) -> float | None:
        return programs.least(sign * (of == joint))

    return extreme


def _by_cones(contacts: FrictionalContacts, of: IntArray, unit: FloatArray, work: Work) -> _Extreme:
    """By cone programs over contacts ``of`` joints."""

    def extreme(joint: int, sign: float) -> float | None:
        return least_normal(contacts, unit, of == joint, sign=sign, work=work)

    return extreme


def _stopped(ranges: ForceRanges) -> ForceRanges:
    return replace(ranges, unanswered=int(np.isnan(ranges.width).sum()))


def _all_pressed(contacts: RigidContacts, n_joints: int) -> BoolArray | None:
    """Whether every joint is pressed by one self-stress, as in a locked assembly; else None.

    What one program finds for thousands of contacts in minutes, the dual Newton method finds in
    hundredths. Friction only adds self-stresses.
    """
    stress = newton_equilibrium(
        contacts.jacobian, contacts.jacobian.resultant(np.ones(len(contacts.index)))
    )
    return np.ones(n_joints, dtype=np.bool_) if stress.holds else None


def _edges(frictional: FrictionalContacts) -> sp.csc_array:
    """Wrenches of the edges (1, ±μ, 0) and (1, 0, ±μ) of all pyramids, (n_rows, 4 n_contacts).

    Admissible forces are their sums with factors that are not negative.
    """
    normal = np.array([[1.0, 1.0, 1.0, 1.0], [0.0] * 4, [0.0] * 4])
    shear = np.array([[0.0] * 4, [1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
    generators = sp.kron(sp.eye_array(frictional.n_contacts), normal)
    generators = generators + sp.kron(sp.diags_array(frictional.friction), shear)
    return sp.csc_array(frictional.matrix @ generators)


def _self_stressed(matrix: sp.csc_array, of: IntArray, n_joints: int, work: Work) -> BoolArray:
    """Which joints some admissible self-stress presses, (n_joints,).

    Max Σ s_j with s_j <= 1 and s_j <= the sum of joint j: self-stresses are a cone, so that s is 0
    or can be scaled up to 1. With 1 - s >= 0 in place of s and what is above s all is not negative.
    """
    n_rows, n = matrix.shape
    sums = sp.csc_array((np.ones(n), (of, np.arange(n))), shape=(n_joints, n))
    eye, none = sp.eye_array(n_joints), sp.csc_array((n_rows, n_joints))
    equal = sp.vstack([sp.hstack([matrix, none, none]), sp.hstack([sums, eye, -eye])])
    target = np.concatenate([np.zeros(n_rows), np.ones(n_joints)])
    upper = np.concatenate([np.full(n, np.inf), np.ones(n_joints), np.full(n_joints, np.inf)])
    programs = LinearPrograms(sp.csc_array(equal), (target, target), (0.0, upper), work)
    programs.least(np.concatenate([np.zeros(n), np.ones(n_joints), np.zeros(n_joints)]))
    return programs.x[n : n + n_joints] < 0.5
