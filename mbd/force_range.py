"""How much of the reaction is undetermined: least and largest force of every joint.

Rigid blocks with more contacts than equations have many admissible states; the least-norm answer
is one of them. For each joint (all contacts between two blocks) two linear programs find the
least and the largest sum of its normal forces over all of them,

    min, max Σ λ_n over the joint s.t. G λ + f = 0, λ admissible.

A joint that takes part in an admissible self-stress, G λ = 0, can be pressed without bound: one
program finds all of these first, max Σ s_j with s_j <= 1 and s_j <= the sum of joint j. With
friction the pyramid stands for the cone, inside it: every state counted is admissible, and the
true range is no narrower.

There are far more contacts than equations, so programs start from few columns and price the
others by the multipliers (column generation): no column may promise less than the optimum found.

References: eq. SCP-linear of the paper; Kao, Iannuzzo, Thomaszewski, Coros, Van Mele, Block,
"Coupled rigid-block analysis", Computer-Aided Design 146 (2022), on the indeterminacy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.assembly import AnyBlocks
from geometry.mesh import BoolArray, FloatArray, IntArray
from mbd.contact_jacobian import Contacts
from mbd.equilibrium import newton_equilibrium
from mbd.friction import FrictionalContacts, FrictionError

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
        """Rows in the plane of a generalized force in space.

        Raises
        ------
        FrictionError
            When it acts out of the plane.
        """
        outside = np.delete(load, self.rows)
        if np.abs(outside).max(initial=0.0) > _FLAT * np.abs(load).max(initial=0.0):
            raise FrictionError("plane problem: the load acts out of the plane")
        return load[self.rows]


def plane_problem(
    assembly: AnyBlocks, contacts: Contacts, frictional: FrictionalContacts, axis: int
) -> PlaneProblem:
    """Reduce to the plane normal to a coordinate axis.

    Parameters
    ----------
    assembly, contacts, frictional
        Blocks, contacts and their wrenches in space.
    axis
        0, 1 or 2: x, y or z, out of the plane.

    Raises
    ------
    FrictionError
        When normals lean out of the plane or contacts do not lie on two faces, one for one.
    """
    points = assembly.interfaces.centroids[contacts.index]
    normals = assembly.interfaces.normals[contacts.index]
    height = points[:, axis]
    front = height < height.mean()
    size = float(np.ptp(points, axis=0).max())
    flat = np.ptp(height[front]) <= _FLAT * size and np.ptp(height[~front]) <= _FLAT * size
    paired = 2 * int(front.sum()) == len(front)
    if not (flat and paired and np.abs(normals[:, axis]).max() <= _FLAT):
        raise FrictionError(
            "plane problem: expected contacts on two flat faces, one behind the other, with "
            "normals in the plane"
        )
    first, second = (axis + 1) % 3, (axis + 2) % 3
    keep = np.sort([first, second, 3 + axis])
    rows = (6 * np.arange(len(contacts.free_blocks))[:, None] + keep).ravel()
    kept = np.flatnonzero(front)
    columns = (3 * kept[:, None] + np.arange(3)).ravel()
    matrix = sp.csc_array(sp.csr_array(frictional.matrix)[rows].tocsc()[:, columns])
    reduced = replace(frictional, matrix=matrix, tangents=frictional.tangents[kept])
    behind = np.eye(3)[axis] * (height[~front].mean() - height[front].mean())
    return PlaneProblem(reduced, rows, kept, behind)


#: Joints whose range is narrower than this fraction of the load count as determined: linear
#: programs are solved to 1e-7 of a load of one.
DETERMINED = 1e-6
#: Programs of no more contacts start with all columns.
_FEW = 3000
#: Columns taken in at once.
_MORE = 500
#: Reduced cost below which a column is taken in; costs are one.
_PRICED = 1e-8
#: Imbalance over the load above which a linear program's answer is not believed.
_BALANCED = 1e-6


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


def force_ranges(
    contacts: Contacts,
    load: FloatArray,
    shown: FloatArray,
    *,
    frictional: FrictionalContacts | None = None,
    plane: PlaneProblem | None = None,
) -> ForceRanges | None:
    """Least and largest normal force of every joint.

    Up to two linear programs for each joint: milliseconds for walls, tenths of a second for a tube
    with 40 000 contacts, longer with friction.

    Parameters
    ----------
    contacts
        Of `mbd.contact_jacobian`.
    load
        f, (n_rows,) [N].
    shown
        Normal forces of the least-norm answer, (n_contacts,) [N].
    frictional
        The same contacts with friction; None for none.
    plane
        The same problem in its plane, where it is plane: the same ranges in a fraction of the time.

    Returns
    -------
    ForceRanges | None
        None where no admissible forces balance the load.
    """
    pairs, joint = np.unique(
        np.column_stack([contacts.block_m, contacts.block_s]), axis=0, return_inverse=True
    )
    joint = joint.ravel()
    n_joints, size = len(pairs), float(np.linalg.norm(load))
    sums = np.asarray(np.bincount(joint, weights=shown, minlength=n_joints), dtype=np.float64)
    if plane is not None:
        frictional, load = plane.contacts, plane.load(load)
        joint, shown = joint[plane.kept], shown[plane.kept]
    program = _program(contacts, frictional, shown, joint, n_joints)
    unit = load / size if size > 0.0 else load
    pressed = _all_pressed(contacts, n_joints)
    if pressed is None:
        pressed = program.self_stressed()
    least, largest = np.zeros(n_joints), np.full(n_joints, np.inf)
    for k in range(n_joints):
        found = program.extreme(k, -unit, 1.0)
        if found is None:
            return None
        least[k] = size * found
        if pressed[k] or size == 0.0:
            largest[k] = np.inf if pressed[k] else 0.0
            continue
        found = program.extreme(k, -unit, -1.0)
        # What only the solver's tolerance lets grow without bound is no answer.
        largest[k] = np.nan if found is None else size * found
    return ForceRanges(pairs[:, 0], pairs[:, 1], least, largest, sums, size)


def least_forces(
    contacts: Contacts, load: FloatArray, frictional: FrictionalContacts, asked: IntArray
) -> FloatArray:
    """Least normal force of some joints over all admissible states, (n_asked,) [N].

    Joints are numbered as in `ForceRanges`; nan where a program finds none.
    """
    pairs = np.column_stack([contacts.block_m, contacts.block_s])
    joints, joint = np.unique(pairs, axis=0, return_inverse=True)
    shown = np.zeros(len(pairs))
    program = _program(contacts, frictional, shown, joint.ravel(), len(joints))
    size = float(np.linalg.norm(load))
    found = [program.extreme(int(k), -load / size, 1.0) for k in asked]
    return size * np.array([np.nan if least is None else least for least in found])


def _all_pressed(contacts: Contacts, n_joints: int) -> BoolArray | None:
    """Whether every joint is pressed by one self-stress, as in a locked assembly; else None.

    What one program finds for thousands of contacts in minutes, the dual Newton method finds in
    hundredths. Friction only adds self-stresses.
    """
    stress = newton_equilibrium(
        contacts.jacobian, contacts.jacobian.resultant(np.ones(len(contacts.index)))
    )
    return np.ones(n_joints, dtype=np.bool_) if stress.holds else None


@dataclass(frozen=True)
class _Program:
    """Balance and admissibility of contact forces, one column for each component."""

    matrix: sp.csc_array
    """(n_rows, n_columns)"""
    sums: sp.csr_array
    """Normal force of each joint, (n_joints, n_columns)."""
    cone: sp.csc_array
    """Rows whose products with the forces are not positive; none without friction."""
    signed: BoolArray
    """Columns that are not negative: the normal forces; (n_columns,)."""
    pool: BoolArray
    """Columns that programs start with; grows from program to program; (n_columns,)."""

    def extreme(self, joint: int, target: FloatArray, sign: float) -> float | None:
        """Least (sign 1) or largest (sign -1) force of a joint; None if there is none."""
        cost = sign * self.sums[[joint]].toarray().ravel()
        rows = _Rows(self.matrix, target, self.cone)
        solution = _minimise(cost, rows, self.signed, self.pool)
        if solution is None:
            return None
        imbalance = float(np.linalg.norm(self.matrix @ solution - target))
        if imbalance > _BALANCED * float(np.linalg.norm(target)):
            return None
        return abs(float(cost @ solution))

    def self_stressed(self) -> BoolArray:
        """Which joints some admissible self-stress presses, (n_joints,)."""
        n_joints, n_columns = self.sums.shape
        n_rows, n_cone = self.matrix.shape[0], self.cone.shape[0]
        # x = (λ, 1 - s): the largest Σ s is the least Σ (1 - s), columns not negative as the rest.
        rows = _Rows(
            sp.csc_array(sp.hstack([self.matrix, sp.csc_array((n_rows, n_joints))])),
            np.zeros(n_rows),
            sp.csc_array(
                sp.vstack(
                    [
                        sp.hstack([-self.sums, -sp.eye_array(n_joints)]),
                        sp.hstack([self.cone, sp.csc_array((n_cone, n_joints))]),
                    ]
                )
            ),
            np.concatenate([-np.ones(n_joints), np.zeros(n_cone)]),
        )
        pool = np.concatenate([self.pool, np.ones(n_joints, dtype=np.bool_)])
        solution = _minimise(
            np.concatenate([np.zeros(n_columns), np.ones(n_joints)]),
            rows,
            np.concatenate([self.signed, np.ones(n_joints, dtype=np.bool_)]),
            pool,
        )
        if solution is None:
            return np.zeros(n_joints, dtype=np.bool_)
        # Self-stresses are a cone: s is 0, or can be scaled up to 1.
        return solution[n_columns:] < 0.5


def _program(
    contacts: Contacts,
    frictional: FrictionalContacts | None,
    shown: FloatArray,
    joint: IntArray,
    n_joints: int,
) -> _Program:
    n = len(joint)
    each = 1 if frictional is None else 3
    normal = each * np.arange(n)
    sums = sp.csr_array((np.ones(n), (joint, normal)), shape=(n_joints, each * n))
    signed = np.zeros(each * n, dtype=np.bool_)
    signed[normal] = True
    pool = ~signed
    pool[normal] = (shown > 0.0) | (n <= _FEW)
    if frictional is None:
        none, matrix = sp.csc_array((0, n)), contacts.jacobian.to_matrix()
        if n > _FEW:
            # As many columns as equations balance what the pressing ones balance.
            basis = _Rows(matrix, matrix @ shown, none)
            first = _minimise(np.ones(n), basis, signed, pool, grow=False)
            pool = pool if first is None else first > 0.0
        return _Program(matrix, sums, none, signed, pool)
    mu = frictional.friction
    sides = np.array([[-mu, 1, 1], [-mu, 1, -1], [-mu, -1, 1], [-mu, -1, -1]], dtype=np.float64)
    cone = sp.csc_array(sp.kron(sp.eye_array(n), sides))
    return _Program(frictional.matrix, sums, cone, signed, pool)


@dataclass(frozen=True)
class _Rows:
    """equal x = target, above x <= limit."""

    equal: sp.csc_array
    target: FloatArray
    above: sp.csc_array
    limit: FloatArray | None = None
    """None: zeros."""


def _minimise(
    cost: FloatArray, rows: _Rows, signed: BoolArray, pool: BoolArray, *, grow: bool = True
) -> FloatArray | None:
    """Least cost · x in HiGHS by columns of a pool that grows; None without an answer."""
    # Loaded here: most answers need no linear program.
    from scipy.optimize import linprog

    right = np.zeros(rows.above.shape[0]) if rows.limit is None else rows.limit
    while True:
        columns = np.flatnonzero(pool)
        constraints: dict[str, Any] = {"A_eq": rows.equal[:, columns], "b_eq": rows.target}
        if rows.above.shape[0]:
            constraints |= {"A_ub": rows.above[:, columns], "b_ub": right}
        lower = np.where(signed[columns], 0.0, -np.inf)
        bounds = np.column_stack([lower, np.full(len(columns), np.inf)])
        constraints["bounds"] = bounds
        solution = linprog(cost[columns], method="highs", **constraints)
        if solution.x is None or not solution.success:
            return None
        price = cost - rows.equal.T @ solution.eqlin.marginals
        if rows.above.shape[0]:
            price -= rows.above.T @ solution.ineqlin.marginals
        price[pool] = 0.0
        cheapest = np.argsort(price)[:_MORE]
        cheapest = cheapest[price[cheapest] < -_PRICED]
        if not (grow and len(cheapest)):
            x = np.zeros(len(cost))
            x[columns] = solution.x
            return x
        pool[cheapest] = True
