"""The answer of a static or explicit solver, in the type that all solvers share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from fem.contact.surfaces import ContactNormals
from fem.element.stress import von_mises
from fem.measures import contact_on, contacts_of, measures_of
from fem.problem import Problem
from fem.solution import Solution
from fem.static.result import StaticError
from fem.system.time_step import added_mass_share
from geometry.answer import Answer, Array, Lazy, Measure
from geometry.assembly import Assembly
from geometry.mesh import FloatArray
from geometry.parts.dimensions import dimensions
from geometry.parts.rows import Part


def answer_of(
    solution: Solution,
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
    solution
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
    require_balance(solution)
    layer = solution.deformable.assembly.layer
    measures = measures_of(solution, errors, facets=facets, remarks=remarks)
    found = dict(parts or {})
    return Answer(
        title=_title(solution),
        method=solution.method,
        measures=measures.beside(factors or {}),
        fields=_fields(solution),
        arrays=Lazy(
            {
                "points": lambda: solution.positions,
                "cells": lambda: solution.hexahedra,
                "block_of_point": lambda: solution.block_of_node,
                "layer_of_point": lambda: layer[solution.block_of_node],
            }
        ),
        contacts=contacts_of(solution, facets),
        reported=lambda: (
            report_of(solution, facets)
            | {name: part.as_json() for name, part in found.items()}
            | dict(beside or {})
        ),
        details=solution,
        problem=problem,
        cut=solution.sections,
        parts=found,
    )


#: Imbalance that a static state may have at least, and over its residual [-].
_BALANCED, _OVER_RESIDUAL = 1e-6, 10.0


def require_balance(solution: Solution) -> None:
    """Reject a static state whose printed joint forces and reactions do not balance its blocks.

    A periodic cell is not judged: the force that keeps it in place as a whole is no printed one.
    """
    static, whole = solution.static, solution.deformable
    if static is None or not whole.meets or whole.assembly.image_of is not None:
        return
    left, most = solution.imbalance, max(_BALANCED, _OVER_RESIDUAL * static.residual)
    if not left.largest <= most:
        raise StaticError(
            f"static: the forces of block {whole.assembly.named(left.block)} are out of balance by "
            f"{left.largest:.2g} of the largest joint force; expected at most {most:.2g}: please "
            "report this problem"
        )


def _title(solution: Solution) -> str:
    result = solution.deformable
    blocks, elements = len(result.deformable_blocks), result.model.n_elements
    return f"{result.assembly.name}: {solution.method}, {blocks} blocks, {elements} elements"


def _fields(solution: Solution) -> Lazy[Array]:
    """Nodal fields of all blocks."""

    def principal() -> FloatArray:
        return np.concatenate([r.principal.reshape(-1, 3) for r in solution.recovered])

    return Lazy(
        {
            "displacement": lambda: solution.displacements,
            "stress": lambda: np.concatenate([r.stress.reshape(-1, 6) for r in solution.recovered]),
            "principal_stress": principal,
            "mises": lambda: von_mises(principal()),
        }
    )


# ---------------------------------------------------------------------------------------------
# Report


def report_of(
    solution: Solution, facets: tuple[Assembly, FloatArray] | None = None
) -> dict[str, Any]:
    """Evidence and statistics of the solver, as plain data."""
    result = solution.deformable
    least, largest = solution.nodal_stress_range
    if result.meets:
        beside = contact_report(solution, facets)
    else:
        beside = {"faces": face_displacements(solution)}
    return {
        "n_blocks": len(result.deformable_blocks),
        "n_elements": result.model.n_elements,
        "n_nodes": result.model.n_nodes,
        "max_displacement": solution.largest_displacement,
        "principal_stress": {"max": float(largest), "min": float(least)},
        "dimensions": dimensions(
            result.assembly if facets is None else facets[0],
            result.densities,
            contact_area=_searched_area(solution),
        ).as_json(),
        "assumptions": assumptions(solution),
        **({"large_motion": solution.large_motion} if solution.large_motion else {}),
        **beside,
        **_support_report(solution),
        **_static_report(solution),
        **_explicit_report(solution),
    }


def assumptions(solution: Solution) -> list[str]:
    """What is taken for granted of blocks and joints, in words."""
    whole = solution.deformable
    turned = "rotations of any size" if solution.finite_rotation else "small rotations"
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


def _searched_area(solution: Solution) -> float | None:
    """Area of all facets that face another at the end [mm²]; None where facets match."""
    result = solution.deformable
    searched = result.meets and result.contact.finite_sliding
    if not searched or result.assembly.interfaces.areas.size:
        return None
    return float(solution.contact_state.areas.sum())


def contact_report(
    solution: Solution, facets: tuple[Assembly, FloatArray] | None = None
) -> dict[str, Any]:
    """Entries of contact: only for blocks that touch."""
    result = vars(contact_on(solution, facets))
    numbers = {name: value for name, value in result.items() if name != "per_block"}
    return {
        "slip": solution.slip,
        "n_contacts": solution.contact_state.n_facets,
        "joints": solution.joints.as_json(),
        "imbalance": solution.imbalance.as_json(),
        "contact": numbers,
        "contact_cap": None if solution.cap is None else asdict(solution.cap),
    }


def face_displacements(solution: Solution) -> dict[str, dict[str, list[float]]]:
    """Mean displacement of each named face of the first block, weighted by facet area."""
    result, whole = {}, solution.deformable
    block = whole.assembly.shape(0)
    moved = solution.group_displacements[int(whole.group_of[0])][int(whole.copy_of[0])]
    for name in block.faces:
        surface = block.surface(name)
        mean = surface.areas @ moved[surface.quads].mean(axis=1) / surface.areas.sum()
        result[name] = {"mean_displacement": mean.tolist()}
    return result


def _support_report(solution: Solution) -> dict[str, Any]:
    """Forces of supports, of those that move along their way; only where blocks have any."""
    data: dict[str, Any] = {"reactions": solution.reactions} if solution.reactions else {}
    if solution.push_curves:
        data["motions"] = [
            {
                "support": curve.name,
                "time": curve.times.tolist(),
                "displacement": curve.displacements.tolist(),
                "force": curve.forces.tolist(),
                "free_after": curve.free_after,
            }
            for curve in solution.push_curves
        ]
    return data | ({"reached": solution.reached} if solution.deformable.moves else {})


def _static_report(solution: Solution) -> dict[str, Any]:
    """Report of a static solver."""
    result = solution.static
    if result is None:
        return {}
    energies = ("strain_energy", "contact_energy", "external_work", "frictional_dissipation")
    data = {
        "status": result.status,
        "residual": result.residual,
        "newton_iterations": result.newton_iterations,
        "symmetry": result.symmetry,
        "loose_blocks": result.loose_blocks.tolist(),
        "load_steps": result.load_steps,
        "energies": {name: getattr(result, name) for name in energies},
        "cpu_seconds": result.cpu_seconds,
    }
    balance = solution.energy_balance
    return data if balance is None else data | {"energy_balance": balance}


def _explicit_report(solution: Solution) -> dict[str, Any]:
    """Report of an explicit run."""
    result, stated = solution.explicit, solution.statement
    if result is None or stated is None:
        return {}
    energies, n_bytes = result.energies, result.state_bytes + result.constant_bytes
    data: dict[str, Any] = {
        "status": str(result.status),
        "n_steps": result.n_steps,
        "time": result.time,
        "time_step": result.time_step,
        "critical_time_step": result.critical.critical_time_step,
        "residual": result.residual,
        "newton_iterations": None,
        "energies": None
        if energies is None
        else asdict(energies)
        | {"viscous_dissipation": energies.viscous_dissipation, "total": energies.total},
        "energy_balance": result.energy_balance,
        "element_updates_per_cpu_second": result.element_updates_per_cpu_second,
        "added_mass": added_mass_share(stated.model),
        "bytes_per_node": n_bytes / stated.model.n_nodes,
        "cpu_seconds": {"loop": result.cpu_seconds},
    }
    return data | _quasi_static_report(solution)


def _quasi_static_report(solution: Solution) -> dict[str, Any]:
    """How static the end is, where a static state is expected."""
    stated, report = solution.statement, solution.quasi_static
    if stated is None or stated.recommended is None or report is None:
        return {}
    meets = solution.deformable.meets
    return {
        "loose_blocks": solution.loose_blocks.tolist() if meets else [],
        "counted_pressure": stated.counted_pressure,
        "released_at_start": solution.released_at_start,
        "quasi_static": asdict(report),
        "recommended": asdict(stated.recommended),
        "restarts": solution.restarts,
    }
