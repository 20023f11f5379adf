"""How much of the reaction is undetermined: least and largest force of every joint.

Rigid blocks with more contacts than equations have many admissible states; the least-norm answer
is one of them. For each joint (all contacts between two blocks) two linear programs find the
least and the largest sum of its normal forces over all of them,

    min, max Σ λ_n over the joint s.t. G λ + f = 0, λ admissible.

A joint that takes part in an admissible self-stress, G λ = 0, can be pressed without bound: one
program finds all of these first, max Σ s_j with s_j <= 1 and s_j <= the sum of joint j. With
friction the pyramid stands for the cone, inside it: every state counted is admissible, and the
true range is no narrower.

Only the costs differ from program to program: each starts from the basis of the last one.

References: eq. SCP-linear of the paper; Kao, Iannuzzo, Thomaszewski, Coros, Van Mele, Block,
"Coupled rigid-block analysis", Computer-Aided Design 146 (2022), on the indeterminacy.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Row, finite
from mbd.contacts.jacobian import RigidContacts
from mbd.friction.equilibrium import FrictionalContacts, RigidFrictionError
from mbd.frictionless.equilibrium import newton_equilibrium
from mbd.programs import DETERMINED, LinearPrograms, Work

#: Out-of-plane parts below this fraction are round-off of vertices and normals.
_FLAT = 1e-9


@dataclass(frozen=True)
class PlaneProblem:
    """Half the contacts, half the unknowns: contacts of one face and what acts in the plane.

    Walls and arches of one block's depth have each contact twice, on either face. If nothing acts
    out of the plane, the mean of an admissible state and its mirror image is one in the plane, so
    nothing is lost by contacts on one face that carry the forces of both, and blocks that move in
    the plane.
    """

    contacts: FrictionalContacts
    """Three rows for each free block: two forces and a couple."""
    rows: IntArray
    """Rows of the problem in space that are kept, (3 n_free,)."""
    kept: IntArray
    """Contacts of the problem in space that are kept, (n,)."""
    behind: FloatArray
    """From the face of these contacts to the other one, (3,) [mm]."""

    def load(self, load: FloatArray) -> FloatArray:
        """Rows in the plane of a generalized force in space."""
        outside = np.delete(load, self.rows)
        if np.abs(outside).max(initial=0.0) > _FLAT * np.abs(load).max(initial=0.0):
            raise RigidFrictionError("plane problem: the load acts out of the plane")
        return load[self.rows]


def plane_problem(
    assembly: AnyBlocks, contacts: RigidContacts, frictional: FrictionalContacts, axis: int
) -> PlaneProblem:
    """Reduce to the plane normal to a coordinate axis.

    Parameters
    ----------
    assembly, contacts, frictional
        Blocks, contacts and their wrenches in space.
    axis
        0, 1 or 2: x, y or z, out of the plane.
    """
    points = assembly.interfaces.centroids[contacts.index]
    normals = assembly.interfaces.normals[contacts.index]
    height = points[:, axis]
    front = height < height.mean()
    size = float(np.ptp(points, axis=0).max())
    flat = np.ptp(height[front]) <= _FLAT * size and np.ptp(height[~front]) <= _FLAT * size
    paired = 2 * int(front.sum()) == len(front)
    if not (flat and paired and np.abs(normals[:, axis]).max() <= _FLAT):
        raise RigidFrictionError(
            "plane problem: expected contacts on two flat faces, one behind the other, with "
            "normals in the plane"
        )
    first, second = (axis + 1) % 3, (axis + 2) % 3
    keep = np.sort([first, second, 3 + axis])
    rows = (6 * np.arange(len(contacts.free_blocks))[:, None] + keep).ravel()
    kept = np.flatnonzero(front)
    columns = (3 * kept[:, None] + np.arange(3)).ravel()
    matrix = sp.csc_array(sp.csr_array(frictional.matrix)[rows].tocsc()[:, columns])
    motions = frictional.motions
    if motions is not None:
        out = np.delete(np.arange(6), keep)
        if np.abs(motions[:, keep][:, :, out]).max() > _FLAT:
            raise RigidFrictionError(
                "plane problem: a support couples motions in the plane with others"
            )
        motions = motions[:, keep][:, :, keep]
    tangents = frictional.tangents[kept]
    reduced = replace(
        frictional,
        matrix=matrix,
        tangents=tangents,
        friction=frictional.friction[kept],
        motions=motions,
    )
    behind = np.eye(3)[axis] * (height[~front].mean() - height[front].mean())
    return PlaneProblem(reduced, rows, kept, behind)


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
        if self.unanswered:
            return (
                f"not decided (limit of work) in {self.unanswered} {of}; of the others {wide} "
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
    frictional: FrictionalContacts | None = None,
    plane: PlaneProblem | None = None,
    progress: Callable[[int, int], None] | None = None,
    limit: float = math.inf,
) -> ForceRanges | None:
    """Least and largest normal force of every joint.

    Up to two linear programs for each joint: milliseconds for walls, tenths of a second for a tube
    with 40 000 contacts, longer with friction.

    Parameters
    ----------
    contacts
        Of `mbd.contacts.jacobian`.
    load
        f, (n_rows,) [N].
    shown
        Normal forces of the least-norm answer, (n_contacts,) [N].
    frictional
        The same contacts with friction; None for none.
    plane
        The same problem in its plane, where it is plane: the same ranges in a fraction of the time.
    progress
        Called with the number of joints that are done and that of all.
    limit
        Reference seconds (`geometry.machine.work`) after which no joint is asked any more.

    Returns
    -------
    ForceRanges | None
        None where no admissible forces balance the load. `ForceRanges.unanswered` joints were left
        at the limit of work.
    """
    pairs, joint = contacts.joints
    n_joints, size = len(pairs), float(np.linalg.norm(load))
    sums = np.asarray(np.bincount(joint, weights=shown, minlength=n_joints), dtype=np.float64)
    if plane is not None:
        frictional, load = plane.contacts, plane.load(load)
        joint = joint[plane.kept]
    matrix, of = _columns(contacts, frictional, joint)
    work, known = Work(limit), _all_pressed(contacts, n_joints)
    pressed = _self_stressed(matrix, of, n_joints, work) if known is None else known
    programs = LinearPrograms(matrix, -load / size if size > 0.0 else -load, work)
    answer = partial(ForceRanges, pairs[:, 0], pairs[:, 1], shown=sums, load=size)
    least, largest = np.full(n_joints, np.nan), np.where(pressed, np.inf, np.nan)
    for k in range(n_joints):
        if progress is not None:
            progress(k, n_joints)
        result = programs.least((of == k).astype(np.float64))
        if work.spent:
            return _stopped(answer(least, largest))
        if result is None:
            return None
        least[k] = size * result
    for k in np.flatnonzero(~pressed).tolist():
        result = programs.least(-(of == k).astype(np.float64)) if size > 0.0 else 0.0
        if work.spent:
            return _stopped(answer(least, largest))
        # What only the solver's tolerance lets grow without bound is no answer.
        largest[k] = np.nan if result is None else -size * result
    return answer(least, largest)


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


def _columns(
    contacts: RigidContacts, frictional: FrictionalContacts | None, joint: IntArray
) -> tuple[sp.csc_array, IntArray]:
    """Wrenches of the edges of all admissible forces, each with a normal force of one.

    Admissible forces are their sums with factors that are not negative: the normal without
    friction, the four edges (1, ±μ, 0) and (1, 0, ±μ) of the pyramid with it. Returns
    (n_rows, n_columns) and the joint of each column, (n_columns,).
    """
    if frictional is None:
        return contacts.jacobian.to_matrix(), joint
    normal = np.array([[1.0, 1.0, 1.0, 1.0], [0.0] * 4, [0.0] * 4])
    shear = np.array([[0.0] * 4, [1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
    generators = sp.kron(sp.eye_array(len(joint)), normal)
    generators = generators + sp.kron(sp.diags_array(frictional.friction), shear)
    return sp.csc_array(frictional.matrix @ generators), np.repeat(joint, 4)


def _self_stressed(matrix: sp.csc_array, of: IntArray, n_joints: int, work: Work) -> BoolArray:
    """Which joints some admissible self-stress presses, (n_joints,).

    Max Σ s_j with s_j <= 1 and s_j <= the sum of joint j: self-stresses are a cone, so that s is 0
    or can be scaled up to 1. With 1 - s >= 0 in place of s and what is above s all is not negative.
    """
    n_rows, n = matrix.shape
    sums = sp.csc_array((np.ones(n), (of, np.arange(n))), shape=(n_joints, n))
    eye, none = sp.eye_array(n_joints), sp.csc_array((n_rows, n_joints))
    equal = sp.vstack([sp.hstack([matrix, none, none]), sp.hstack([sums, eye, -eye])])
    programs = LinearPrograms(
        sp.csc_array(equal),
        np.concatenate([np.zeros(n_rows), np.ones(n_joints)]),
        work,
        upper=np.concatenate([np.full(n, np.inf), np.ones(n_joints), np.full(n_joints, np.inf)]),
    )
    programs.least(np.concatenate([np.zeros(n), np.ones(n_joints), np.zeros(n_joints)]))
    return programs.x[n : n + n_joints] < 0.5
