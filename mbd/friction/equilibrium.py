"""Coulomb friction in the rigid answer: which loads can be carried, and how far they can grow.

A contact force (λ_n, λ_1, λ_2) is admissible if ‖(λ_1, λ_2)‖ <= μ λ_n, a second-order cone; the
pyramid |λ_1| + |λ_2| <= μ λ_n lies inside it and makes linear programs. Both are solved by
clarabel. A load that admits equilibrium with admissible forces *can* be carried; by the lower-bound
theorem for rigid blocks no more is claimed (sliding friction is not associated). A load that
does not is certain to set the blocks in motion; the certificate is a virtual displacement d with
n·δ >= μ ‖δ_t‖ in every contact (δ the relative displacement there) and fᵀd > 0: no admissible
force does negative work on it.

References: eq. SCP-linear of the paper with friction added; Kao, Iannuzzo, Thomaszewski, Coros,
Van Mele, Block, "Coupled rigid-block analysis", Computer-Aided Design 146 (2022); Livesley, "Limit
analysis of structures formed from rigid blocks", Int. J. Numer. Methods Eng. 12 (1978).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.errors import RefusedError
from geometry.mesh import FloatArray, IntArray
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Row, finite
from mbd.contacts.jacobian import RigidContacts
from mbd.contacts.supports import admissible
from mbd.frictionless.equilibrium import EQUILIBRIUM_TOLERANCE, Equilibrium
from mbd.options import FrictionLaw
from mbd.programs import Work, least_conic

#: A mechanism certifies only if no admissible unit force does more negative work than this
#: fraction of the load's work.
CERTIFICATE_TOLERANCE = 1e-6


#: Coefficients of dry materials stay below 2; beyond this a number is something else.
MOST_FRICTION = 10.0


#: Sides of the pyramid |λ_1| + |λ_2| <= μ λ_n.
TANGENTS = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]], dtype=np.float64)


def by_block(motion: FloatArray | None) -> list[list[float]] | None:
    """Motion of each block as plain data, where there is one."""
    return None if motion is None else motion.reshape(-1, 6).tolist()


class RigidFrictionError(RefusedError):
    """A friction coefficient that means nothing."""


@dataclass(frozen=True)
class FrictionalContacts:
    """Wrenches of unit normal and tangential forces at each contact."""

    matrix: sp.csc_array
    """(6 n_free, 3 n_contacts), columns (normal, first, second tangent) contact by contact."""
    tangents: FloatArray
    """Unit tangents, (n_contacts, 2, 3)."""
    friction: FloatArray
    """μ of each contact, (n_contacts,)."""
    law: FrictionLaw
    motions: FloatArray | None = None
    """Projectors on the motions that supports leave, (n_free, m, m) for m rows each; None: all."""

    def admissible(self, motion: FloatArray) -> FloatArray:
        """Part of a motion (n_rows,) that supports leave."""
        return admissible(self.motions, motion)

    @property
    def n_contacts(self) -> int:
        """Number of contact points."""
        return len(self.tangents)

    def slip(self, displacement: FloatArray) -> FloatArray:
        """Relative displacement (normal, first, second tangent) at each contact, (n, 3)."""
        return (self.matrix.T @ displacement).reshape(-1, 3)

    def slip_size(self, tangential: FloatArray) -> FloatArray:
        """Return the friction work per μ λ_n of slips along the tangents, (n, 2) to (n,).

        Their length; for the pyramid the larger of the two parts.
        """
        return (
            np.linalg.norm(tangential, axis=1)
            if self.law is FrictionLaw.CONE
            else np.abs(tangential).max(axis=1)
        )

    def shear_size(self, tangential: FloatArray) -> FloatArray:
        """Return the size of tangential forces that the law compares with μ λ_n, (n, 2) to (n,)."""
        return (
            np.linalg.norm(tangential, axis=1)
            if self.law is FrictionLaw.CONE
            else np.abs(tangential).sum(axis=1)
        )

    def dissipated(self, normal: FloatArray, slip: FloatArray, factor: float = 1.0) -> float:
        """Sum of μ λ_n ‖δ_t‖ times a factor, from λ_n and ‖δ_t‖ of the contacts, (n,) each."""
        return factor * float((self.friction * normal) @ slip)

    def sides(self, of_normal: FloatArray, of_shear: FloatArray) -> sp.sparray:
        """Rows μ λ_n · a + (λ_1, λ_2) · b of each contact, for rows a (n,) and b (n, 2)."""
        shear = np.column_stack([np.zeros(len(of_normal)), of_shear])
        normal = np.column_stack([of_normal, np.zeros((len(of_normal), 2))])
        return sp.kron(sp.eye_array(self.n_contacts), shear) + sp.kron(
            sp.diags_array(self.friction), normal
        )

    def smallest_work(self, displacement: FloatArray) -> FloatArray:
        """Return the least work of an admissible force with λ_n = 1 at each contact, (n,)."""
        relative = self.slip(displacement)
        return relative[:, 0] - self.friction * self.slip_size(relative[:, 1:])

    def world(self, forces: FloatArray, normals: FloatArray) -> FloatArray:
        """Forces (normal, first, second tangent) as vectors on block s, (n_contacts, 3) [N].

        ``normals`` are those of the contacts, (n_contacts, 3).
        """
        tangential: FloatArray = np.einsum("nk,nki->ni", forces[:, 1:], self.tangents)
        return forces[:, :1] * normals + tangential

    def projected(self, forces: FloatArray) -> FloatArray:
        """Nearest admissible forces along the tangents, (n, 3): the return to Coulomb's law."""
        normal, trial = np.maximum(forces[:, 0], 0.0), forces[:, 1:]
        return np.column_stack([normal, trial * self._share(normal, trial)[:, None]])

    def _share(self, normal: FloatArray, trial: FloatArray) -> FloatArray:
        """Part of tangential forces (n, 2) that normal forces (n,) admit, at most 1; (n,)."""
        size, limit = self.shear_size(trial), self.friction * normal
        return np.where(size > limit, limit / np.maximum(size, 1e-300), 1.0)

    def returned_by(self, forces: FloatArray) -> FloatArray:
        """Derivative of `projected` by the forces, (n, 3) to (n, 3, 3)."""
        trial, mu = forces[:, 1:], self.friction
        share = self._share(np.maximum(forces[:, 0], 0.0), trial)
        way = (share < 1.0)[:, None] * trial / np.maximum(self.shear_size(trial), 1e-300)[:, None]
        along = way if self.law is FrictionLaw.CONE else np.sign(trial)
        slope = np.zeros((len(mu), 3, 3))
        slope[:, 0, 0] = 1.0
        slope[:, 1:, 0] = mu[:, None] * way
        slope[:, 1:, 1:] = share[:, None, None] * (np.eye(2) - way[:, :, None] * along[:, None])
        return slope * (forces[:, 0] > 0.0)[:, None, None]


def check_coefficients(friction: FloatArray) -> None:
    """Reject coefficients of friction that no joint has."""
    wrong = friction[~(np.isfinite(friction) & (friction >= 0.0))]
    if wrong.size:
        raise RigidFrictionError(f"friction: got {wrong[0]}, expected 0 or a positive number")
    most = float(friction.max(initial=0.0))
    if most > MOST_FRICTION:
        raise RigidFrictionError(
            f"friction: got {most:g}, expected a coefficient up to {MOST_FRICTION:g}; an "
            "angle of friction φ is given as its tangent: 30° is 0.577"
        )


def require_live(live: FloatArray) -> None:
    """Reject a load that cannot grow, as there is none."""
    if not live.any():
        raise RigidFrictionError("limit load: the live load is zero; expected one that can grow")


def frictional_contacts(
    assembly: AnyBlocks,
    contacts: RigidContacts,
    friction: float | FloatArray,
    law: FrictionLaw = FrictionLaw.CONE,
) -> FrictionalContacts:
    """Assemble the wrenches of normal and tangential contact forces.

    Friction is that of all contacts, or of each one, (n_contacts,).
    """
    check_coefficients(np.atleast_1d(friction))
    normals = assembly.interfaces.normals[contacts.index]
    # Rounded: joints that mirror each other have mirrored tangents where two axes are as far.
    axis = np.eye(3)[np.abs(normals).round(6).argmin(axis=1)]
    first = np.cross(normals, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    tangents = np.stack([first, second], axis=1)
    matrix = _wrenches(assembly, contacts, np.concatenate([normals[:, None], tangents], axis=1))
    motions = contacts.jacobian.motions
    if motions is not None:
        matrix = sp.block_diag([sp.csc_array(each) for each in motions], format="csc") @ matrix
        matrix.eliminate_zeros()
    mu = np.broadcast_to(np.asarray(friction, dtype=np.float64), len(normals))
    return FrictionalContacts(matrix, tangents, mu, law, motions)


def _wrenches(assembly: AnyBlocks, contacts: RigidContacts, directions: FloatArray) -> sp.csc_array:
    """Wrenches (F, M/ℓ) of unit forces along directions (n, 3, 3) on s, and opposite ones on m."""
    free, places = contacts.free_blocks, np.arange(directions[..., 0].size).reshape(-1, 3)
    number = np.full(assembly.n_blocks, -1, dtype=np.int64)
    number[free] = np.arange(len(free))
    points, parts = assembly.interfaces.centroids[contacts.index], []
    for block, sign in ((contacts.block_m, -1.0), (contacts.block_s, 1.0)):
        moves = np.flatnonzero(number[block] >= 0)
        arm, along = (points - assembly.centroids[block])[moves, None], directions[moves]
        wrench = sign * np.concatenate([along, np.cross(arm, along) / contacts.length], axis=2)
        rows = 6 * number[block[moves], None, None] + np.arange(6)
        columns = places[moves, :, None]
        parts.append([np.broadcast_to(v, wrench.shape).ravel() for v in (wrench, rows, columns)])
    values, rows, columns = (np.concatenate(part) for part in zip(*parts, strict=True))
    shape = 6 * len(free), places.size
    return sp.coo_array((values, (rows, columns)), shape=shape).tocsc()


def admissible_cones(contacts: FrictionalContacts) -> tuple[sp.csc_array, list[Any]]:
    """Rows R and cones K such that R x in K says that the forces x are admissible."""
    import clarabel

    mu = contacts.friction
    smooth, rough = np.flatnonzero(mu == 0.0), np.flatnonzero(mu > 0.0)
    rows: list[Any] = []
    cones: list[Any] = []
    if len(smooth):
        # A second-order cone of zero width has no interior: say λ_1 = λ_2 = 0, λ_n >= 0 instead.
        tangential = np.sort(np.concatenate([3 * smooth + 1, 3 * smooth + 2]))
        order = np.concatenate([tangential, 3 * smooth])
        rows.append(sp.eye_array(3 * len(mu), format="csr")[order])
        cones += [clarabel.ZeroConeT(2 * len(smooth)), clarabel.NonnegativeConeT(len(smooth))]
    if len(rough) and contacts.law is FrictionLaw.CONE:
        scale = np.column_stack([mu, np.ones((len(mu), 2))]).ravel()
        rows.append(_some(sp.diags_array(scale), rough, 3))
        cones += [clarabel.SecondOrderConeT(3)] * len(rough)
    elif len(rough):
        sides = contacts.sides(np.ones(4), TANGENTS)
        rows.append(_some(sides, rough, 4))
        cones.append(clarabel.NonnegativeConeT(4 * len(rough)))
    return sp.vstack(rows).tocsc() if rows else sp.csc_array((0, 0)), cones


def least_forces(
    contacts: FrictionalContacts,
    load: FloatArray,
    *,
    cost: FloatArray | None = None,
    weights: FloatArray | None = None,
    live: FloatArray | None = None,
    work: Work,
) -> Any:
    """Solve for the admissible forces of least cost that balance a load of one.

    Parameters
    ----------
    contacts
        What is admissible.
    load
        (n_rows,)
    cost
        Of each force, (3 n_contacts,); None: half the sum of their squares …
    weights
        … over those of these, (n_contacts,); None: ones.
    live
        A load (n_rows,) whose factor is one more unknown, the last one, with its own cost.
    work
        Counts the program.

    Returns
    -------
    Any
        Solution of clarabel: ``x`` the forces, ``z`` begins with the multipliers of balance.
    """
    n = contacts.n_contacts
    rows, cones = admissible_cones(contacts)
    column = np.ones(n) if weights is None else weights
    squares, equal = sp.diags_array(np.repeat(column**-2.0, 3)), contacts.matrix
    if live is not None:
        equal = sp.hstack([equal, sp.csc_array(live[:, None])])
        rows = sp.hstack([rows, sp.csc_array((rows.shape[0], 1))])
    return least_conic(
        quadratic=squares if cost is None else sp.csc_array((len(cost), len(cost))),
        cost=np.zeros(3 * n) if cost is None else cost,
        equal=equal,
        target=-load,
        rows=rows,
        cones=cones,
        work=work,
    )


def _some(rows: Any, contacts: IntArray, each: int) -> Any:
    """Rows of some contacts, ``each`` of every one."""
    if len(contacts) * each == rows.shape[0]:
        return rows
    return rows.tocsr()[(each * contacts[:, None] + np.arange(each)).ravel()]


def _bounded(x: Any) -> FloatArray:
    """Solver output with what ran off to infinity (no solution exists) set to zero."""
    values = np.asarray(x, dtype=np.float64)
    return np.where(np.abs(values) < 1e12, values, 0.0)


def _unit_largest(direction: FloatArray) -> FloatArray:
    """Direction scaled to a largest entry of 1; zero where it is not finite."""
    largest = float(np.abs(direction).max(initial=0.0))
    if not (np.isfinite(largest) and largest > 0.0):
        return np.zeros_like(direction)
    return direction / largest


def _certified(
    contacts: FrictionalContacts, dual: FloatArray, load: FloatArray, closing: float = 0.0
) -> tuple[FloatArray, float, float] | None:
    """Motion along a dual or against it, its work and the least contact work; None: no mechanism.

    No contact force may do more negative work than ``closing``, or than its part of the work.
    """
    direction = contacts.admissible(_unit_largest(dual))
    size = float(np.linalg.norm(direction))
    for unit in (direction / size, -direction / size) if size else ():
        work = float(load @ unit) / float(np.linalg.norm(load))
        least = float(contacts.smallest_work(unit).min(initial=0.0))
        if work > 0.0 and least >= -max(closing, CERTIFICATE_TOLERANCE * work):
            return unit, work, least
    return None


def frictional_equilibrium(
    contacts: FrictionalContacts, load: FloatArray, *, weights: FloatArray | None = None
) -> Equilibrium:
    """Smallest admissible forces that balance a load (n_rows,) [N], or a certified mechanism.

    Smallest by the column scaling of `mbd.frictionless.equilibrium.column_weights`,
    (n_contacts,), ones by default. Undecided (neither holds nor a
    mechanism) at the edge of what can be carried.
    """
    size = float(np.linalg.norm(load))
    if size == 0.0:
        nothing = np.zeros((contacts.n_contacts, 3))
        status = "equilibrium: no load"
        return Equilibrium(holds=True, forces=nothing, residual=0.0, status=status)
    unit = load / size
    forces, residual, direction = _least_forces(contacts, unit, weights)
    answer = partial(Equilibrium, forces=size * forces, residual=residual)
    if residual <= EQUILIBRIUM_TOLERANCE:
        status = "forces within the friction cones balance the load (statically admissible), "
        return answer(holds=True, status=f"{status}relative residual {residual:.1e}")
    certified = _certified(contacts, direction, unit)
    if certified is not None:
        mechanism, work, least = certified
        return answer(
            mechanism=mechanism,
            work=work,
            smallest_contact_work=least,
            status="not statically admissible: the load sets blocks in motion, and friction "
            "does not stop them (see the certificate)",
        )
    return answer(
        status=f"undecided: residual {residual:.1e} and no certified mechanism; the load is at "
        "the limit of what the contacts carry: change it or the friction slightly"
    )


def _least_forces(
    contacts: FrictionalContacts, unit: FloatArray, weights: FloatArray | None
) -> tuple[FloatArray, float, FloatArray]:
    """Smallest admissible forces that come nearest to balance, what is left, and its dual."""
    n = contacts.n_contacts
    if n == 0:
        return np.zeros((0, 3)), 1.0, unit
    solution = least_forces(contacts, unit, weights=weights, work=Work())
    forces = contacts.projected(_bounded(solution.x).reshape(-1, 3))
    residual = float(np.linalg.norm(contacts.matrix @ forces.ravel() + unit))
    return forces, residual, np.asarray(solution.z)[: len(unit)]


@dataclass(frozen=True, kw_only=True)
class CollapseLoad:
    """How far a live load can grow on top of a dead load until the first mechanism."""

    factor: float
    """Largest α for which dead + α live can be carried with associated friction and infinite
    strength; infinity where there is none, nan where the dead load alone is not carried."""
    upper_bound: float = np.inf
    """-f_deadᵀd / f_liveᵀd of the mechanism: no larger α can be carried."""
    forces: FloatArray
    """Contact forces at collapse (at an infinite factor: those of the live load alone); (n, 3)."""
    residual: float
    """Relative residual of those forces."""
    mechanism: FloatArray | None = None
    """Collapse mechanism d, f_liveᵀd > 0, ‖d‖ = 1; None at an infinite factor. Where the dead load
    alone is not carried, the one that it drives."""
    smallest_contact_work: float = 0.0
    """Least work of an admissible unit force on the mechanism; zero to round-off."""
    status: str
    """Verdict in words."""

    @property
    def certified(self) -> bool:
        """Whether forces and mechanism prove the factor from both sides, to 1e-4 of it."""
        if np.isnan(self.factor):
            return self.mechanism is not None
        if np.isinf(self.factor):
            return self.residual <= EQUILIBRIUM_TOLERANCE
        return (
            self.mechanism is not None
            and self.residual <= EQUILIBRIUM_TOLERANCE
            and abs(self.upper_bound - self.factor) <= 1e-4 * max(abs(self.factor), 1e-3)
        )

    @property
    def rows(self) -> list[Row]:
        """The factor and its proof."""
        proof = ""
        if np.isfinite(self.upper_bound):
            proof = f"; kinematic upper bound {self.upper_bound:.6g}, residual {self.residual:.1e}"
        return [Row("limit load", self.status + proof, finite(self.factor), "", "verdict")]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "factor": finite(self.factor),
            "upper_bound": finite(self.upper_bound),
            "never": bool(np.isinf(self.factor)),
            "certified": self.certified,
            "residual": self.residual,
            "smallest_contact_work": self.smallest_contact_work,
            "mechanism": by_block(self.mechanism),
            "status": self.status,
        }


def collapse_load(contacts: FrictionalContacts, dead: FloatArray, live: FloatArray) -> CollapseLoad:
    """Limit analysis: the largest α such that dead + α live, (n_rows,) each [N], can be carried."""
    require_live(live)
    base = frictional_equilibrium(contacts, dead)
    if not base.holds:
        verdict = "not decided" if base.mechanism is None else "not carried"
        return CollapseLoad(
            factor=np.nan,
            upper_bound=np.nan,
            forces=np.zeros_like(base.forces),
            residual=base.residual,
            mechanism=base.mechanism,
            smallest_contact_work=base.smallest_contact_work,
            status=f"none: the dead load alone is {verdict}",
        )
    alone = frictional_equilibrium(contacts, live)
    if alone.holds:
        return CollapseLoad(
            factor=np.inf,
            forces=alone.forces,
            residual=alone.residual,
            status="load factor unbounded: rigid blocks, associated friction (sliding joints "
            "dilate), no crushing. Dry joints may slide under a smaller load: `sliding` searches "
            "for it",
        )
    factor, forces, dual = _largest_factor(contacts, dead, live)
    total = dead + factor * live
    residual = float(np.linalg.norm(contacts.matrix @ forces.ravel() + total))
    residual /= max(float(np.linalg.norm(total)), 1e-300)
    answer = partial(CollapseLoad, factor=factor, forces=forces, residual=residual)
    certified = _certified(contacts, dual, live, 1e-5)
    if certified is not None:
        unit, _, least = certified
        return answer(
            upper_bound=-float(dead @ unit) / float(live @ unit),
            mechanism=unit,
            smallest_contact_work=least,
            status=f"collapse load factor {factor:.6g} (limit analysis)",
        )
    return answer(status=f"load factor of at least {factor:.6g}; no mechanism was certified")


def _largest_factor(
    contacts: FrictionalContacts, dead: FloatArray, live: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Factor of the live load at collapse, contact forces there, and the mechanism's direction."""
    size = float(np.linalg.norm(live))
    scale = max(float(np.linalg.norm(dead)), size)
    cost = np.append(np.zeros(3 * contacts.n_contacts), -1.0)
    solution = least_forces(contacts, dead / scale, cost=cost, live=live / size, work=Work())
    x = _bounded(solution.x)
    forces = scale * contacts.projected(x[:-1].reshape(-1, 3))
    return float(x[-1]) * scale / size, forces, np.asarray(solution.z)[: len(live)]
