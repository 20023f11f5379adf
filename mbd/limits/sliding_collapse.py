"""Collapse by sliding that does not dilate: non-associated friction, with a certificate.

Limit analysis (`mbd.limits.collapse.collapse_load`) lets a sliding joint open by
n·δ = μ ‖δ_t‖: an associated flow that dry joints do not show, and an upper bound for
what they carry. Here a joint that presses does not open. Wanted is the least factor α at which
forces and a motion exist with

- equilibrium, G λ + f_dead + α f_live = 0, and admissible forces, ‖λ_t‖ <= μ λ_n, λ_n >= 0;
- no overlap, δ_n >= 0, and no opening under pressure, λ_n δ_n = 0;
- friction against the slip, and at its limit where there is any: λ_tᵀδ_t = -μ λ_n ‖δ_t‖;
- work of the live load, f_liveᵀd > 0 (scaled to 1).

This is a mathematical program with equilibrium constraints. All products together are the defect
Σ (λ_n δ_n + μ λ_n ‖δ_t‖ + λ_tᵀδ_t) >= 0, by virtual work Σ μ λ_n ‖δ_t‖ - f_deadᵀd - α, of which
only the sum is bilinear. α + ρ · defect is minimised by sequential linear programs in a trust
region (HiGHS) from the associated state, ρ rising until the defect is nil.

Where associated friction jams and knows no limit, the descent starts from joints whose limits of
friction are frozen at the pressures of the last state, step by step, as Gilbert et al. do.

A solution proves itself (`check_sliding`): at α the blocks can begin to slide with every law of
dry friction obeyed. Nothing proves that no smaller α exists: the program is not convex, the answer
a local minimum. Between it and the associated factor the blocks may stand or slide, depending on
how they came there.

References: Ferris and Tin-Loi, "Limit analysis of frictional block assemblies as a mathematical
program with complementarity constraints", Int. J. Mech. Sci. 43 (2001); Gilbert, Casapulla and
Ahmed, "Limit analysis of masonry block structures with non-associative frictional joints using
linear programming", Comput. Struct. 84 (2006).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.mesh import FloatArray
from geometry.parts.rows import Row, finite
from mbd.contacts.friction import TANGENTS, FrictionalContacts
from mbd.equilibrium import EQUILIBRIUM_TOLERANCE, by_block, frictional_equilibrium
from mbd.limits.collapse import CollapseLoad, collapse_load
from mbd.limits.plane import Reduced
from mbd.options import FrictionLaw
from mbd.programs import Cones, LinearPrograms, Work, least
from mbd.system import RigidSystem

#: Largest violation of any law in a certified state; see `SlidingCheck` for what it is relative to.
SLIDING_TOLERANCE = EQUILIBRIUM_TOLERANCE
#: Weights ρ of the defect, in the order tried. At 1 the factor drops out of α + ρ · defect; just
#: above it the path is least bound to the state that it starts from.
_PENALTIES = (1.5, 6.0, 24.0, 96.0)
#: Most linear programs for one penalty.
_MOST_STEPS = 40
#: First radius of the trust region over the largest normal force and the largest slip …
_FIRST_REACH = 0.5
#: … and the radius at which a path ends.
_LAST_REACH = 1e-9
#: Most linear programs with frozen friction, and the change of pressures at which they settle.
_MOST_FROZEN, _FROZEN = 60, 1e-9
#: Factors beyond this, in sizes of dead over live load, are taken for a jam without limit.
_JAMMED = 1e6
_NOT_FOUND = (
    "no non-associated sliding state found: friction jams the blocks, and the limit load depends "
    "on an unknown prestress (see the ranges of the joint forces)"
)
#: Friction limits below this fraction of the largest are none.
_UNPRESSED = 1e-12
#: Predicted decrease of the merit (a factor of order one) that is round-off of a linear program.
_SETTLED = 1e-10


@dataclass(frozen=True)
class SlidingCheck:
    """How well forces and a motion obey the laws of joints that slide without opening."""

    residual: float
    """‖G λ + f‖ / ‖f‖ with f = f_dead + α f_live."""
    excess: float
    """Largest of ‖λ_t‖ - μ λ_n and -λ_n over the largest force; 0 where all are admissible."""
    overlap: float
    """Largest closing of a contact over the largest relative displacement."""
    opening_work: float
    """Σ λ_n δ_n / |f|ᵀ|d|: pressure on joints that open, the dilation that is not allowed."""
    slipping_defect: float
    """Σ (μ λ_n ‖δ_t‖ + λ_tᵀδ_t) / |f|ᵀ|d|: friction below its limit or not against the slip."""

    @property
    def largest(self) -> float:
        """Largest violation of any law."""
        return max(
            self.residual,
            self.excess,
            self.overlap,
            abs(self.opening_work),
            abs(self.slipping_defect),
        )


@dataclass(frozen=True, kw_only=True)
class SlidingCollapse:
    """A factor at which the blocks can begin to slide without dilation, and the proof."""

    factor: float
    """α, a local minimum over such states; infinity where the associated factor is infinite, nan
    where the dead load alone is not carried."""
    associated: float
    """Factor of limit analysis with dilation: no larger load can be carried."""
    forces: FloatArray
    """(λ_n, λ_1, λ_2) of each contact, (n_contacts, 3) [N]."""
    mechanism: FloatArray | None = None
    """d with f_liveᵀd > 0, ‖d‖ = 1, (n_rows,); None where none was found."""
    check: SlidingCheck | None = None
    """Every law multiplied out; None where no motion was found."""
    programs: int = 0
    """Linear programs solved."""
    reason: str = ""
    """Why no motion was found."""
    stopped: bool = False
    """Whether the limit of work ended the search."""
    state: Mapping[str, Any] = field(default_factory=dict)
    """Forces and motion in space as plain data, for a check by another program."""

    @property
    def certified(self) -> bool:
        """Whether forces and motion obey every law to `SLIDING_TOLERANCE`."""
        return self.check is not None and self.check.largest <= SLIDING_TOLERANCE

    @property
    def status(self) -> str:
        """Verdict in words."""
        if self.certified:
            beyond = f"associated limit load factor {self.associated:.6g}"
            if np.isinf(self.associated):
                beyond = "with associated friction unbounded"
            least = "a local minimum"
            if self.stopped:
                least = "the search for a smaller one stopped at the limit of work, "
                least += f"{self.programs} linear programs"
            return (
                f"slides without dilation from load factor {self.factor:.6g} on (certified; "
                f"{least}); {beyond}"
            )
        if self.stopped:
            return (
                "not decided (limit of work): no certified sliding state after "
                f"{self.programs} linear programs"
            )
        return self.reason or (
            "no certified non-associated sliding state: the best violates a law by "
            f'{self.check.largest if self.check else np.nan:.1e}; try `friction_law` = "pyramid" '
            "or another friction"
        )

    @property
    def rows(self) -> list[Row]:
        """The factor."""
        return [Row("non-associated limit load", self.status, self._proved, "", "verdict")]

    @property
    def _proved(self) -> float | None:
        """The factor of a certified state; None where there is none."""
        return finite(self.factor) if self.certified else None

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "factor": self._proved,
            "associated_factor": finite(self.associated),
            "certified": self.certified,
            "check": None if self.check is None else asdict(self.check),
            "mechanism": by_block(self.mechanism),
            "status": self.status,
            **self.state,
        }


def check_sliding(
    contacts: FrictionalContacts, load: FloatArray, forces: FloatArray, mechanism: FloatArray
) -> SlidingCheck:
    """Multiply out every law of sliding without dilation.

    Under the load f_dead + α f_live, (n_rows,) [N], for forces (λ_n, λ_1, λ_2), (n_contacts, 3)
    [N], and a motion d, (n_rows,).
    """
    tiny = 1e-300
    normal, shear = forces[:, 0], forces[:, 1:]
    slip = contacts.slip(mechanism)
    opening, sliding = slip[:, 0], slip[:, 1:]
    limit = contacts.friction * normal
    outside = np.maximum(contacts.shear_size(shear) - limit, -normal)
    friction_work = limit * contacts.slip_size(sliding) + np.sum(shear * sliding, axis=1)
    # Not the work of the contact forces: a wall that rocks on its edges has none.
    work = float(np.abs(load) @ np.abs(mechanism)) + tiny
    imbalance = np.linalg.norm(contacts.matrix @ forces.ravel() + load)
    return SlidingCheck(
        residual=float(imbalance / max(float(np.linalg.norm(load)), tiny)),
        excess=max(float(outside.max(initial=0.0)), 0.0) / (float(np.abs(forces).max()) + tiny),
        overlap=max(-float(opening.min(initial=0.0)), 0.0) / (float(np.abs(slip).max()) + tiny),
        opening_work=float(normal @ opening) / work,
        slipping_defect=float(friction_work.sum()) / work,
    )


@dataclass(frozen=True)
class _State:
    """An iterate: forces and a motion, each possible by itself; their products are the defect."""

    forces: FloatArray
    """(n, 3)"""
    motion: FloatArray
    """d with f_liveᵀd = 1, (n_rows,)."""
    factor: float
    slip: FloatArray
    """Size of the slip at each contact, (n,)."""
    defect: float

    def merit(self, penalty: float) -> float:
        return self.factor + penalty * self.defect


@dataclass(frozen=True)
class _Programs:
    """Linear programs in x = (λ, α, d, w), w no less than the slip; loads of order one."""

    contacts: FrictionalContacts
    dead: FloatArray
    live: FloatArray
    work: Work
    program: LinearPrograms

    @staticmethod
    def of(
        contacts: FrictionalContacts, dead: FloatArray, live: FloatArray, work: Work
    ) -> _Programs:
        """Balance, a work of one, admissible forces, no overlap, and slips within w."""
        n, slips = contacts.n_contacts, contacts.matrix.T.tocsr()
        one = sp.eye_array(n)
        blocks: list[list[Any]] = [
            [contacts.matrix, sp.csc_array(live[:, None]), None, None],
            [None, None, sp.csc_array(live[None, :]), None],
            [contacts.sides(-np.ones(4), TANGENTS), None, None, None],
            [None, None, -slips[0::3], None],
        ]
        for part in (slips[1::3], slips[2::3]):
            blocks += [[None, None, part, -one], [None, None, -part, -one]]
        equal = np.append(-dead, 1.0)
        program = LinearPrograms(
            sp.block_array(blocks).tocsc(), _rows(equal, np.zeros(9 * n)), (-np.inf, np.inf), work
        )
        return _Programs(contacts, dead, live, work, program)

    def state(self, forces: FloatArray, factor: float, motion: FloatArray) -> _State:
        """Evaluate forces (n, 3), a factor and a motion (n_rows,)."""
        slip = self.contacts.slip_size(self.contacts.slip(motion)[:, 1:])
        dissipated = self.contacts.dissipated(forces[:, 0], slip)
        defect = dissipated - float(self.dead @ motion) - factor
        return _State(forces, motion, factor, slip, defect)

    def step(
        self, state: _State, penalty: float, reach: tuple[float, float]
    ) -> tuple[_State, float] | None:
        """Minimise the merit with products linearised, pressures and slips within reach.

        Returns
        -------
        tuple[_State, float] | None
            Next state and predicted decrease; None where HiGHS gives up.
        """
        n, mu = self.contacts.n_contacts, self.contacts.friction
        pressure, load = slice(0, 3 * n, 3), 3 * n
        motion, slip = slice(load + 1, load + 1 + len(self.dead)), slice(-n, None)
        cost = np.zeros(len(self.program.x))
        cost[pressure] = penalty * mu * state.slip
        cost[load] = 1.0 - penalty
        cost[motion] = -penalty * self.dead
        cost[slip] = penalty * mu * state.forces[:, 0]
        low, high = np.full(len(cost), -np.inf), np.full(len(cost), np.inf)
        for part, centre, radius in (
            (pressure, state.forces[:, 0], reach[0]),
            (slip, state.slip, reach[1]),
        ):
            low[part] = np.maximum(centre - radius, 0.0)
            high[part] = centre + radius
        least = self.program.least(cost, (low, high))
        if least is None:
            return None
        product = self.contacts.dissipated(state.forces[:, 0], state.slip, penalty)
        predicted = state.merit(penalty) - (least - product)
        x = self.program.x
        forces = self.contacts.projected(x[: 3 * n].reshape(-1, 3))
        return self.state(forces, float(x[load]), x[motion]), predicted

    def frozen(self, pressed: FloatArray) -> _State | None:
        """Largest factor, its forces and motion, with limits μ · ``pressed`` (n,) of friction.

        None where no factor is the largest.
        """
        n = self.contacts.n_contacts
        blocks: list[list[Any]] = [
            [self.contacts.matrix, sp.csc_array(self.live[:, None])],
            [self.contacts.sides(np.zeros(4), TANGENTS), None],
        ]
        limits = np.repeat(self.contacts.friction * pressed, 4)
        low, cost = np.full(3 * n + 1, -np.inf), np.zeros(3 * n + 1)
        low[: 3 * n : 3], cost[-1] = 0.0, -1.0
        program = LinearPrograms(
            sp.block_array(blocks).tocsc(),
            _rows(-self.dead, limits),
            (low, np.inf),
            self.work,
        )
        if program.least(cost) is None:
            return None
        # Multipliers of balance are the motion that the live load drives, with a work of one.
        motion = -program.multipliers[: len(self.dead)]
        return self.state(program.x[:-1].reshape(-1, 3), float(program.x[-1]), motion)


def _rows(equal: FloatArray, above: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and largest products of rows that equal some values, and of rows that stay below."""
    return np.append(equal, np.full(len(above), -np.inf)), np.append(equal, above)


def _descend(programs: _Programs, state: _State, penalty: float) -> _State:
    """Follow the merit down until no linear program promises a decrease."""
    reach = _FIRST_REACH
    radii = (float(state.forces[:, 0].max(initial=0.0)), float(state.slip.max(initial=0.0)))
    for _ in range(_MOST_STEPS):
        result = programs.step(state, penalty, (reach * radii[0], reach * radii[1]))
        if result is None or result[1] <= _SETTLED:
            break
        following, predicted = result
        gained = state.merit(penalty) - following.merit(penalty)
        if gained > 0.1 * predicted:
            state = following
        if gained > 0.7 * predicted:
            reach *= 2.0
        elif gained < 0.25 * predicted:
            reach *= 0.4
        if reach < _LAST_REACH:
            break
    return state


def sliding_collapse(
    contacts: FrictionalContacts,
    dead: FloatArray,
    live: FloatArray,
    work: Work | None = None,
) -> SlidingCollapse:
    """Search the least α at which the blocks can begin to slide without dilation.

    The linear programs use the pyramid. With `FrictionLaw.CONE` the motion is chosen, and the state
    judged, by the cone: forces inside the pyramid reach it where joints slide along their
    tangents, as in plane walls and arches; elsewhere the state may fail to be certified. Dead and
    live load are generalized forces, (n_rows,) [N]; ``work`` is what may be spent.

    Raises
    ------
    FrictionError
        When the live load is zero.
    """
    linear = replace(contacts, law=FrictionLaw.PYRAMID)
    start = collapse_load(linear, dead, live)
    if np.isnan(start.factor):
        none = np.zeros_like(start.forces)
        return SlidingCollapse(factor=np.nan, associated=np.nan, forces=none, reason=start.status)
    scale, size = float(np.linalg.norm(dead)) or 1.0, float(np.linalg.norm(live))
    work = work or Work()
    programs = _Programs.of(linear, dead / scale, live / size, work)
    state = _first_state(programs, start, (scale, size))
    if state is None:
        return SlidingCollapse(
            factor=start.factor,
            associated=start.factor,
            forces=start.forces,
            programs=work.programs,
            reason=_NOT_FOUND,
            stopped=work.spent,
        )
    for penalty in _PENALTIES:
        state = _descend(programs, state, penalty)
        if state.defect <= 0.01 * SLIDING_TOLERANCE * max(abs(state.factor), 1.0):
            break
    forces, factor = scale * state.forces, state.factor * scale / size + 0.0  # no -0
    judged = partial(_judged, contacts, forces, dead + factor * live)
    motion, check = judged(state.motion)
    if check.largest > SLIDING_TOLERANCE and contacts.law is FrictionLaw.CONE:
        # The pyramid leaves slips between its tangents open; the cone does not.
        motion, check = judged(
            _least_dissipation(contacts, state.forces, programs.dead, programs.live)
        )
    return SlidingCollapse(
        factor=factor,
        associated=start.factor,
        forces=forces,
        mechanism=motion,
        check=check,
        programs=work.programs,
        stopped=work.spent,
    )


def _judged(
    contacts: FrictionalContacts, forces: FloatArray, load: FloatArray, motion: FloatArray
) -> tuple[FloatArray, SlidingCheck]:
    """Part of a motion that supports leave, ‖d‖ = 1, and its laws beside forces under a load."""
    motion = contacts.admissible(motion)
    unit = motion / np.linalg.norm(motion)
    return unit, check_sliding(contacts, load, forces, unit)


def _first_state(
    programs: _Programs, start: CollapseLoad, sizes: tuple[float, float]
) -> _State | None:
    """State that the descent starts from; None in a jam, or at the limit of work.

    The associated collapse where there is one. Where friction with dilation jams, limits of
    friction are frozen at the pressures of the last state, so that joints slide without dilation
    (Gilbert et al. 2006); the first pressures are those of the dead load.
    """
    scale, size = sizes
    if start.mechanism is not None:
        motion = start.mechanism / float(start.mechanism @ programs.live)
        return programs.state(start.forces / scale, start.factor * size / scale, motion)
    pressed = frictional_equilibrium(programs.contacts, programs.dead).forces[:, 0]
    for _ in range(_MOST_FROZEN):
        result = programs.frozen(pressed)
        if result is None or result.factor > _JAMMED:
            return None
        change = float(np.abs(result.forces[:, 0] - pressed).max(initial=0.0))
        if change <= _FROZEN * max(float(pressed.max(initial=0.0)), 1.0):
            break
        pressed = 0.5 * (pressed + result.forces[:, 0])
    return result


def _least_dissipation(
    contacts: FrictionalContacts, forces: FloatArray, dead: FloatArray, live: FloatArray
) -> FloatArray:
    """Return the motion with f_liveᵀd = 1 of least Σ μ λ_n ‖δ_t‖ - f_deadᵀd by the cone; (n_rows,).

    Pressures fixed, the defect is convex in the motion.
    """
    import clarabel

    weight = contacts.friction * forces[:, 0]
    pressed = np.flatnonzero(weight > _UNPRESSED * weight.max(initial=0.0))
    n, rows = len(pressed), len(dead)
    slips = contacts.matrix.T.tocsr()
    # (s, δ_1, δ_2) in a second-order cone at each contact that presses.
    picks = sp.csc_array((np.ones(n), (3 * np.arange(n), np.arange(n))), shape=(3 * n, n))
    tangential = slips[(3 * pressed[:, None] + np.array([0, 1, 2])).ravel()]
    tangential = sp.diags_array(np.tile([0.0, 1.0, 1.0], n)) @ tangential
    opening: list[Any] = [slips[0::3], sp.csc_array((contacts.n_contacts, n))]
    open_or_shut = clarabel.NonnegativeConeT(contacts.n_contacts)
    x, _ = least(
        sp.hstack([sp.csc_array(live[None, :]), sp.csc_array((1, n))]),
        np.ones(1),
        Cones(
            sp.block_array([opening, [tangential, picks]]),
            [open_or_shut, *[clarabel.SecondOrderConeT(3)] * n],
        ),
        # Bounds what blocks that nothing presses may do.
        squares=sp.diags_array(np.concatenate([np.full(rows, 1e-9), np.zeros(n)])),
        cost=np.concatenate([-dead, weight[pressed]]),
    )
    return x[:rows]


def sliding_state(system: RigidSystem, found: SlidingCollapse, problem: Reduced) -> dict[str, Any]:
    """Forces at contacts, motion and loads of blocks about their centroids, in space.

    From forces of a problem and motion in space; empty without a motion. Forces act on block s
    [N], the motion has any scale [mm, rad].
    """
    if found.mechanism is None:
        return {}
    contacts, interfaces = system.contacts, system.touching.interfaces
    kept, index = problem.kept, contacts.index[problem.kept]
    points, normals = interfaces.centroids[index], interfaces.normals[index]
    forces = problem.contacts.world(found.forces, normals)
    if problem.behind is not None:
        # Contacts on one face carry the forces of both, mirror images of each other: these act
        # half way between, and what points out of the plane cancels.
        points = points + 0.5 * problem.behind
        out = problem.behind / np.linalg.norm(problem.behind)
        forces = forces - (forces @ out)[:, None] * out
    free, weight = contacts.free_blocks, system.stated.rigid_weight
    motion = found.mechanism.reshape(-1, 6) / np.repeat([1.0, contacts.length], 3)
    dead = np.zeros((len(free), 6)) if weight is None else weight[free]
    live = system.stated.rigid_load.wrenches[free]
    blocks = np.column_stack([contacts.block_m[kept], contacts.block_s[kept]])
    return {
        "contacts": _table(blocks=blocks, point=points, normal=normals, force=forces),
        "blocks": _table(
            block=free,
            centroid=system.blocks.centroids[free],
            displacement=motion[:, :3],
            rotation=motion[:, 3:],
            dead_force=dead[:, :3],
            dead_moment=dead[:, 3:],
            live_force=live[:, :3],
            live_moment=live[:, 3:],
        ),
    }


def _table(**columns: np.ndarray[Any, Any]) -> list[dict[str, Any]]:
    """Rows of a table as plain data."""
    lists = [column.tolist() for column in columns.values()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*lists, strict=True)]
