"""The answer of a static or explicit solver, in the type that all solvers share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import cache, partial
from typing import Any

import numpy as np

from fem.answer.forces import (
    energies_of,
    energy_balance,
    imbalance_of,
    joints_of,
    push_curves_of,
    reactions_of,
    released_at_start,
)
from fem.answer.measures import (
    contact_on,
    contacts_of,
    large_motion,
    measures_of,
    quasi_static,
    reached,
    slip,
    turned_within,
    unrestrained_blocks,
)
from fem.answer.pressures import cap_action
from fem.answer.rows import state_rows
from fem.contact.normals import ContactNormals
from fem.element.material import von_mises
from fem.problem import Problem
from fem.state import State
from fem.static.linear_step.linearisation import StaticError
from fem.stresses.recovery import nodal_stress_range, recovered_of
from fem.stresses.sections import section_forces
from geometry.answer import Answer, Array, Lazy, Measure, known
from geometry.assembly import Assembly
from geometry.mesh import FloatArray, IntArray
from geometry.parts.dimensions import Built, dimensions
from geometry.parts.rows import Part


def answer_of(
    state: State,
    errors: Mapping[str, float] | None = None,
    *,
    facets: tuple[Assembly, FloatArray] | None = None,
    remarks: Mapping[str, str] | None = None,
    factors: Mapping[str, Measure] | None = None,
    problem: Problem | None = None,
    parts: Mapping[str, Part] | None = None,
    beside: Mapping[str, Any] | None = None,
) -> Answer:
    """Make the answer of what a solver found; what takes time is computed when it is read.

    Parameters
    ----------
    state
        What the solver found.
    errors
        Estimated error of measures by name, in their units; those not named have none.
    facets
        Another mesh of the same blocks and the mean pressure on each of its `interfaces`, (n,)
        [MPa]: `p_eff`, `p_max`, `p_max_facet` and `contacts` are then those of its facets.
    remarks
        Why values are none to use, by the name of the measure.
    factors
        Load factors (`fem.accuracy.strength`), measures beside the others.
    problem
        What was solved.
    parts
        What was found beside the measures; the report has each by its name.
    beside
        More of the report, as plain data.

    Raises
    ------
    StaticError
        Printed forces of a static state that do not balance its blocks.
    """
    require_balance(state)
    layer = state.whole.assembly.layer
    measures = measures_of(state, errors, facets=facets, remarks=remarks)
    blocks = state.whole.assembly if facets is None else facets[0]
    sought = problem is not None and problem.finite_sliding
    whole = state.whole
    of_body = np.array([body.material.density for body in whole.bodies])
    densities = np.where(whole.body_number < 0, 0.0, of_body[whole.body_number])
    matching = problem is None or not problem.unmatched
    built = Built(
        lambda: dimensions(blocks, densities, closed_area=_closed_area(state, matching=matching))
    )
    return Answer(
        title=_title(state),
        method=state.method,
        measures=measures.beside(factors or {}),
        fields=_fields(state),
        arrays=Lazy(
            {
                "points": lambda: _positions(state),
                "cells": lambda: _hexahedra(state),
                "block_of_point": lambda: state.whole.block_of_node,
                "layer_of_point": lambda: layer[state.whole.block_of_node],
            }
        ),
        contacts=contacts_of(state, facets),
        reported=cache(lambda: known(report_of(state, facets, sought=sought) | dict(beside or {}))),
        details=state,
        problem=problem,
        cut=partial(section_forces, state),
        parts={**(parts or {}), "dimensions": built},
        tabled=partial(state_rows, facets=facets),
    )


#: Imbalance that a static state may have at least, and over its residual [-].
_BALANCED, _OVER_RESIDUAL = 1e-6, 10.0


def require_balance(state: State) -> None:
    """Reject a static state whose printed joint forces and reactions do not balance its blocks.

    A periodic cell is not judged: the force that keeps it in place as a whole is no printed one.
    """
    whole = state.whole
    if state.run is not None or not whole.meets or whole.assembly.image_of is not None:
        return
    left = imbalance_of(state)
    most = max(_BALANCED, _OVER_RESIDUAL * state.evidence.residuals[-1])
    if not left.largest <= most:
        raise StaticError(
            f"static: the forces of block {whole.assembly.named(left.block)} are out of balance by "
            f"{left.largest:.2g} of the largest joint force; expected at most {most:.2g}: please "
            "report this problem"
        )


def _title(state: State) -> str:
    result = state.whole
    blocks, elements = len(result.deformable_blocks), result.n_elements
    return f"{result.assembly.name}: {state.method}, {blocks} blocks, {elements} elements"


def _fields(state: State) -> Lazy[Array]:
    """Nodal fields of all blocks."""

    def principal() -> FloatArray:
        return np.concatenate([r.principal.reshape(-1, 3) for r in recovered_of(state)])

    def stress() -> FloatArray:
        return np.concatenate([r.stress.reshape(-1, 6) for r in recovered_of(state)])

    return Lazy(
        {
            "displacement": lambda: np.concatenate([u.reshape(-1, 3) for u in state.displacements]),
            "stress": stress,
            "principal_stress": principal,
            "mises": lambda: von_mises(principal()),
        }
    )


def _positions(state: State) -> FloatArray:
    """Of all nodes before the load acts, (n_nodes, 3) [mm]."""
    bodies = state.whole.bodies
    return np.concatenate([g.reference_positions().reshape(-1, 3) for g in bodies])


def _hexahedra(state: State) -> IntArray:
    """Corner nodes of all elements, (n_elements, 8)."""
    elements, first = [], 0
    for body in state.whole.bodies:
        starts = first + body.n_nodes * np.arange(body.n_copies)
        elements.append((body.mesh.elements[None] + starts[:, None, None]).reshape(-1, 8))
        first += body.n_nodes * body.n_copies
    return np.concatenate(elements)


# ---------------------------------------------------------------------------------------------
# Report


def report_of(
    state: State, facets: tuple[Assembly, FloatArray] | None, *, sought: bool
) -> dict[str, Any]:
    """Evidence and statistics of the solver, as plain data.

    ``sought``: whether finite sliding is stated, so that contact is searched for whatever the mesh.
    """
    result = state.whole
    large, turned = large_motion(state), turned_within(state)
    least, largest = nodal_stress_range(state)
    if result.meets:
        contact = contact_report(state, facets) | {"contact_search": _search_words(state, sought)}
    else:
        contact = face_displacements(state)
    return {
        "n_blocks": len(result.deformable_blocks),
        "n_elements": result.n_elements,
        "n_nodes": result.n_nodes,
        "max_displacement": state.largest_displacement,
        "principal_stress": {"max": float(largest), "min": float(least)},
        "assumptions": assumptions(state),
        **({"large_motion": large} if large else {}),
        **({"turned_within_blocks": turned} if turned else {}),
        **contact,
        **_support_report(state),
        **_static_report(state),
        **_explicit_report(state),
    }


def _search_words(state: State, sought: bool) -> str:
    """Whether and why the facets that face each other were searched."""
    if not state.whole.contact.finite_sliding:
        return "matching meshes, fixed pairs (small sliding)"
    return "finite sliding" if sought else "finite sliding (non-matching meshes)"


def assumptions(state: State) -> list[str]:
    """What is taken for granted of blocks and joints, in words."""
    whole = state.whole
    turned = (
        "rotations of any size of whole blocks, small ones within"
        if state.finite_rotation
        else "small rotations"
    )
    words = [f"linear elastic blocks, small strains, {turned}"]
    if whole.meets:
        contact = whole.contact
        as_built = contact.normals is ContactNormals.REFERENCE
        words += [
            f"gaps along {'normals as built' if as_built else 'normals that turn with the blocks'}",
            "joints without friction" if contact.friction is None else "Coulomb friction in joints",
            "contact searched again as blocks slide"
            if contact.finite_sliding
            else "facets stay in contact with the same facets",
        ]
    return words


def _closed_area(state: State, *, matching: bool) -> float | None:
    """Area of the points that press at the end [mm²]; None where all facets match."""
    result = state.whole
    searched = result.meets and result.contact.finite_sliding
    if not searched or (matching and result.assembly.interfaces.areas.size):
        return None
    found = state.contact_state
    return float(found.point_areas[found.point_pressures > 0.0].sum())


def contact_report(
    state: State, facets: tuple[Assembly, FloatArray] | None = None
) -> dict[str, Any]:
    """Entries of contact: only for blocks that touch."""
    result, cap = vars(contact_on(state, facets)), cap_action(state)
    numbers = {name: value for name, value in result.items() if name != "per_block"}
    return {
        "slip": slip(state),
        "n_contacts": state.contact_state.n_facets,
        "joints": joints_of(state).as_json(),
        "imbalance": imbalance_of(state).as_json(),
        "contact": numbers,
        "contact_cap": None if cap is None else asdict(cap),
    }


def face_displacements(state: State) -> dict[str, Any]:
    """Mean displacement of each named face of the first block, weighted by facet area."""
    result, whole = {}, state.whole
    block = whole.assembly.shape(0)
    moved = state.displacements[int(whole.body_number[0])][int(whole.copy_of[0])]
    for name in block.faces:
        surface = block.surface(name)
        mean = surface.areas @ moved[surface.quads].mean(axis=1) / surface.areas.sum()
        result[name] = {"mean_displacement": mean.tolist()}
    return {"faces": result}


def _support_report(state: State) -> dict[str, Any]:
    """Forces of supports, of those that move along their way; only where blocks have any."""
    reactions = reactions_of(state)
    data: dict[str, Any] = {"reactions": reactions} if reactions else {}
    if push_curves_of(state):
        data["motions"] = [
            {
                "support": curve.name,
                "time": curve.times.tolist(),
                "displacement": curve.displacements.tolist(),
                "force": curve.forces.tolist(),
                "free_after": curve.free_after,
            }
            for curve in push_curves_of(state)
        ]
    return data | ({"reached": reached(state)} if state.whole.supports.tables else {})


def _static_report(state: State) -> dict[str, Any]:
    """Report of a static solver."""
    if state.run is not None:
        return {}
    evidence = state.evidence
    data = {
        "status": evidence.status,
        "residual": state.residual,
        "newton_iterations": len(evidence.residuals),
        "symmetry": state.system.orbits.order,
        "loose_blocks": evidence.loose_blocks.tolist(),
        "load_steps": evidence.load_steps,
        "energies": energies_of(state),
        "cpu_seconds": evidence.cpu_seconds,
    }
    balance = energy_balance(state)
    return data if balance is None else data | {"energy_balance": balance}


def _explicit_report(state: State) -> dict[str, Any]:
    """Report of an explicit run."""
    run = state.run
    if run is None:
        return {}
    stated = run.stated
    data: dict[str, Any] = {
        "status": str(run.status),
        "n_steps": run.n_steps,
        "time": run.time,
        "time_step": run.time_step,
        "critical_time_step": run.critical.critical_time_step,
        "residual": run.residual,
        "newton_iterations": None,
        "energies": energies_of(state),
        "energy_balance": run.energy_balance,
        "element_updates_per_cpu_second": run.cost.element_updates_per_cpu_second,
        "bytes_per_node": run.cost.n_bytes / stated.system.n_nodes,
        "cpu_seconds": {"loop": run.cost.cpu_seconds},
    }
    return data | _quasi_static_report(state)


def _quasi_static_report(state: State) -> dict[str, Any]:
    """How static the end is, where a static state is expected."""
    run, report = state.run, quasi_static(state)
    if run is None or run.stated.times.recommended is None or report is None:
        return {}
    meets = state.whole.meets
    return {
        "loose_blocks": unrestrained_blocks(state).tolist() if meets else [],
        "counted_pressure": run.stated.counted_pressure,
        "released_at_start": released_at_start(state),
        "quasi_static": asdict(report),
        "recommended": asdict(run.stated.times.recommended),
        "restarts": run.restarts,
    }
