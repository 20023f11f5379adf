"""Energies and works of a state [N mm]."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from fem.answer.forces import internal_forces, push_curves_of
from fem.state import State, once


def energies_of(state: State) -> dict[str, float] | None:
    """Of a static state, or of the last sample of a run, by name; None before the first."""
    if state.run is None:
        return {
            "strain_energy": strain_energy(state),
            "contact_energy": contact_energy(state),
            "external_work": external_work(state),
            "frictional_dissipation": state.frictional_dissipation,
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
    law = state.deformable.contact.law.on(points.block_m, points.block_s)
    stored = float((points.weights * law.stored_energy(state.overclosures)).sum())
    if state.frictions is None:
        return stored
    square = (state.frictions**2).sum(axis=-1)
    return stored + float((points.weights * square).sum()) / (2.0 * state.deformable.stick())


def external_work(state: State) -> float:
    """Of loads, weight and supports on the way to the state [N mm].

    Of blocks in contact what they store and friction dissipates, less what contact holds before
    anything acts; of single bodies half of the loads along the displacements.
    """
    if not state.deformable.meets:
        return 0.5 * load_work(state)
    stored = strain_energy(state) + contact_energy(state)
    return stored + state.frictional_dissipation - _at_rest(state)


def _at_rest(state: State) -> float:
    """Contact energy before any load acts [N mm]; 0 with interference, which takes work."""
    if state.deformable.surfaces.clearance < 0.0:
        return 0.0
    start = np.zeros_like(state.displacement)
    return contact_energy(replace(state, displacement=start, friction=None, anchor=None))


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
    slots = system.slot_of[state.deformable.deformable_blocks]
    copies = np.repeat(np.bincount(slots, minlength=system.n_slots), np.diff(system.node_start))
    work = copies @ (state.displacement * system.loads[-1]).sum(axis=1)
    return float(work)


def energy_balance(state: State) -> float | None:
    """Error of the balance of energies [-]; None for static blocks in contact."""
    if state.run is not None:
        return state.run.energy_balance
    if state.deformable.meets:
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
