"""Forces of a state, of joints and supports, what they leave on a block; energies and works."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np

from fem.state import State, once
from fem.system.reactions import PushCurve, push_curves, reactions
from geometry.mesh import FloatArray, lengths
from geometry.parts.balance import Imbalance, imbalance, of_fixed_blocks, together
from geometry.parts.measures import JointResultants, summed_by_joint


@once
def joints_of(state: State) -> JointResultants:
    """Resultants of every pair of blocks in contact, on the higher one, friction included."""
    contact = state.contact_state
    low, high = (
        np.minimum(contact.block_m, contact.block_s),
        np.maximum(contact.block_m, contact.block_s),
    )
    onwards = np.where(contact.block_m == low, 1.0, -1.0)[contact.facet, None]
    pairs = np.column_stack([low, high])[contact.facet]
    result = summed_by_joint(
        pairs,
        points=contact.positions,
        normals=onwards * contact.normals,
        areas=contact.point_areas,
        forces=onwards * contact.point_forces,
    )
    _, of_facet = np.unique(low * (high.max(initial=0) + 1) + high, return_inverse=True)
    joint = of_facet[contact.facet]

    def largest(values: FloatArray) -> FloatArray:
        most = np.full(len(result.block_m), -np.inf)
        np.maximum.at(most, joint, values)
        return most

    on_m, on_s = np.moveaxis(contact.point_moments, 1, 0)
    both = np.hstack([0.5 * onwards * (on_s - on_m), 0.5 * (on_m + on_s)])
    count = len(result.block_m)
    sums = np.stack([np.bincount(joint, v, minlength=count) for v in both.T], axis=1)
    return replace(
        result,
        moments=result.moments + sums[:, :3],
        couples=sums[:, 3:],
        smallest_gap=-largest(contact.point_overclosures),
        largest_gap=largest(-contact.point_overclosures),
        largest_slip=largest(lengths(contact.point_slips)),
    )


def reactions_of(state: State) -> dict[str, dict[str, Any]]:
    """Resultants of supports and rigid blocks by name: `geometry.parts.balance.Reactions`."""
    whole = state.whole
    result = reactions(whole, state.support_forces, state.displacements)
    if whole.meets:
        rigid, loads = np.flatnonzero(whole.body_number < 0), whole.on_ground
        others = None if loads is None else state.load_factor * loads
        fixed = of_fixed_blocks(whole.assembly, joints_of(state), rigid, others)
        result = together(result, fixed)
    return result.as_json()


@once
def imbalance_of(state: State) -> Imbalance:
    """What joints, loads, supports and inertia leave on a block, moments about deformed places.

    Internal forces of small rotations balance about the undeformed places: their moment about
    the deformed ones, of second order, is one of the terms.
    """
    whole, loads = state.whole, state.system.expand(state.system.loads[-1])
    others = np.zeros((whole.assembly.n_blocks, 6))
    acting, needed = np.zeros(whole.assembly.n_blocks), _contact_forces(state, loads)
    centres = whole.assembly.centroids + whole.offsets
    for number, (body, u) in enumerate(zip(whole.bodies, state.displacements, strict=True)):
        blocks = whole.deformable_blocks[whole.body_number[whole.deformable_blocks] == number]
        force = needed[number][whole.copy_of[blocks]]
        places = (body.reference_positions() + u)[whole.copy_of[blocks]]
        # Sums of x_i f_j: their skew part is the moment.
        sums = np.swapaxes(places - centres[blocks][:, None], 1, 2) @ force
        moment = sums[:, [1, 2, 0], [2, 0, 1]] - sums[:, [2, 0, 1], [1, 2, 0]]
        others[blocks] = -np.hstack([force.sum(axis=1), moment])
        sizes = lengths(loads[number][whole.copy_of[blocks]])
        acting[blocks] = sizes.sum(axis=1)
    return imbalance(
        whole.assembly,
        joints_of(state),
        acting=acting,
        others=others,
        centres=centres,
        free=whole.deformable_blocks,
    )


@once
def internal_forces(state: State) -> tuple[FloatArray, ...]:
    """K u of the nodes of each body, for balance and energy, (n_copies, n_nodes, 3) [N]."""
    return tuple(state.system.expand(state.system.internal_force(state.displacement)))


def _contact_forces(state: State, loads: list[FloatArray]) -> tuple[FloatArray, ...]:
    """What contact has to do to the nodes of each body, (n_copies, n_nodes, 3) [N].

    From the loads on them, alike.
    """
    if state.contact_force is not None:
        return tuple(state.system.expand(state.contact_force))
    held, result = state.support_forces, list[FloatArray]()
    for number, load in enumerate(loads):
        force = internal_forces(state)[number] - load
        result.append(force - held[number] if held else force)
    return tuple(result)


@once
def push_curves_of(state: State) -> tuple[PushCurve, ...]:
    """Force against displacement of each support that moves step by step."""
    if state.run is not None:
        return state.run.pushed
    path = (*state.evidence.path, state)
    steps = {s.time: s.support_forces for s in path if s.time is not None}
    if not steps or state.evidence.curves:
        return state.evidence.curves
    return push_curves(state.whole, tuple(steps.items()))


# ---------------------------------------------------------------------------------------------
# Energies and works [N mm]


def energies_of(state: State) -> dict[str, float] | None:
    """Of a static state, or of the last sample of a run, by name; None before the first."""
    if state.run is None:
        return {
            "strain_energy": strain_energy(state),
            "contact_energy": contact_energy(state),
            "external_work": external_work(state),
            "frictional_dissipation": state.evidence.frictional_dissipation,
        }
    last = state.run.energies
    if last is None:
        return None
    beside = {"viscous_dissipation": last.viscous_dissipation, "total": last.total}
    return asdict(last) | beside


@once
def strain_energy(state: State) -> float:
    """Of all blocks [N mm]."""
    forces = zip(state.displacements, internal_forces(state), strict=True)
    return 0.5 * sum(float((u * force).sum()) for u, force in forces)


@once
def contact_energy(state: State) -> float:
    """What contact laws hold [N mm]."""
    points = state.points
    law = state.whole.contact.law.on(points.block_m, points.block_s)
    stored = float((points.weights * law.stored_energy(state.overclosures)).sum())
    if state.frictions is None:
        return stored
    square = (state.frictions**2).sum(axis=-1)
    return stored + float((points.weights * square).sum()) / (2.0 * state.whole.stick())


def external_work(state: State) -> float:
    """Of loads, weight and supports on the way to the state [N mm].

    Of blocks in contact what they store and friction dissipates, less what contact holds before
    anything acts; of single bodies half of the loads along the displacements.
    """
    if not state.whole.meets:
        return 0.5 * load_work(state)
    stored = strain_energy(state) + contact_energy(state)
    return stored + state.evidence.frictional_dissipation - _at_rest(state)


def _at_rest(state: State) -> float:
    """Contact energy before any load acts [N mm]; 0 with interference, which takes work."""
    if state.whole.surfaces.clearance < 0.0:
        return 0.0
    start = np.zeros_like(state.displacement)
    return contact_energy(replace(state, displacement=start, friction=None))


def work_of_motion(state: State) -> float | None:
    """Of the one support that moves, by the balance of energies [N mm].

    What the state stores and dissipates more than the state before the motion, less the work of
    the loads, which are constant then. None of explicit runs, of several supports that move,
    and of problems after another.
    """
    if state.run is not None or state.evidence.curves or len(push_curves_of(state)) != 1:
        return None
    before = [one for one in state.evidence.path if not one.time]
    if not before and load_work(state):
        return None
    work = external_work(state) - load_work(state)
    return work - (external_work(before[-1]) - load_work(before[-1]) if before else 0.0)


def load_work(state: State) -> float:
    """Full loads times displacements [N mm]."""
    system = state.system
    slots = system.slot_of[state.whole.deformable_blocks]
    copies = np.repeat(np.bincount(slots, minlength=system.n_slots), np.diff(system.node_start))
    work = copies @ (state.displacement * system.loads[-1]).sum(axis=1)
    return float(work)


def energy_balance(state: State) -> float | None:
    """Error of the balance of energies [-]; None for static blocks in contact."""
    if state.run is not None:
        return state.run.energy_balance
    if state.whole.meets:
        return None
    strain = strain_energy(state)
    return abs(external_work(state) - strain) / max(strain, 1e-300)


def released_at_start(state: State) -> float | None:
    """Energy that contact holds before any load acts, over the largest work of the loads [-].

    None where it is less than that work, as it is unless the law presses hard at zero
    clearance.
    """
    if state.run is None:
        return None
    history = state.run.history
    held, work = history.column("contact_energy")[:1], np.abs(history.column("external_work"))
    return float(held[0] / work.max()) if held.size and held[0] > work.max() > 0.0 else None
