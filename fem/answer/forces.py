"""Forces of a state: of joints and supports, what they leave on a block, and the way of pushes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fem.state import State, once
from fem.system.reactions import PushCurve, push_curves, reactions
from geometry.mesh import FloatArray
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
        largest_slip=largest(np.linalg.norm(contact.point_slips, axis=1)),
    )


def reactions_of(state: State) -> dict[str, dict[str, Any]]:
    """Resultants of supports and rigid blocks by name: `geometry.parts.balance.Reactions`."""
    whole = state.deformable
    result = reactions(whole, state.support_forces, state.displacements)
    if whole.meets:
        rigid, loads = np.flatnonzero(whole.group_of < 0), whole.on_ground
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
    whole, loads = state.deformable, state.system.expand(state.system.loads[-1])
    others = np.zeros((whole.assembly.n_blocks, 6))
    acting, needed = np.zeros(whole.assembly.n_blocks), _contact_forces(state, loads)
    centres = whole.assembly.centroids + whole.offsets
    for number, (group, u) in enumerate(zip(whole.bodies, state.displacements, strict=True)):
        blocks = whole.deformable_blocks[whole.group_of[whole.deformable_blocks] == number]
        force = needed[number][whole.copy_of[blocks]]
        places = (group.reference_positions() + u)[whole.copy_of[blocks]]
        moment = np.cross(places - centres[blocks][:, None], force)
        others[blocks] = -np.hstack([force.sum(axis=1), moment.sum(axis=1)])
        sizes = np.linalg.norm(loads[number][whole.copy_of[blocks]], axis=2)
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
    """K u of the nodes of each group, for balance and energy, (n_copies, n_nodes, 3) [N]."""
    groups = zip(state.deformable.bodies, state.displacements, strict=True)
    return tuple(
        g.internal_force(u @ g.rotations) @ g.rotations.transpose(0, 2, 1) for g, u in groups
    )


def _contact_forces(state: State, loads: list[FloatArray]) -> tuple[FloatArray, ...]:
    """What contact has to do to the nodes of each group, (n_copies, n_nodes, 3) [N].

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
    return push_curves(state.deformable, tuple(steps.items()))
