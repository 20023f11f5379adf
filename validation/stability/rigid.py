"""Robustness cases of rigid blocks: equilibrium, classes and their certificates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import scipy.sparse as sp

from geometry.assembly import Assembly, renumbered
from geometry.families.sine_block import SineBlockDivisions
from geometry.loads import LoadCase, named_load
from geometry.mesh import FloatArray
from geometry.parts.placed import AssemblyError
from mbd import Norm, analyse, contact_jacobian
from mbd.contacts.jacobian import ContactJacobian, PairWrenches, RigidContacts
from mbd.equilibrium import column_weights, newton_equilibrium
from mbd.mechanism import Classification, SelfStress
from validation.stability.case import CaseVerdict, Number, case, case_verdict, rejected
from validation.stability.problems import pressed, relative_difference, stack, tsb1_tube

#: Pressure of the paper's load cases [MPa].
PRESSURE = 0.01


def certified(assembly: Assembly, load: LoadCase) -> list[Number]:
    """Check class and equilibrium of an assembly by multiplying out G, written as a matrix."""
    contacts = contact_jacobian(assembly, load.fixed)
    matrix, force = contacts.jacobian.to_matrix(), contacts.rows(load.wrenches)
    result = analyse(assembly, load=load).details
    balance, numbers = result.equilibrium, _certificate(result.supported_classification, matrix)
    if not balance.holds:
        return [*numbers, *_driven(matrix, force, balance.mechanism)]
    size = float(np.linalg.norm(force)) or 1.0
    left = float(np.linalg.norm(matrix @ balance.forces + force)) / size
    least = float(balance.forces.min())
    return [*numbers, ("equilibrium ‖Gλ+f‖/‖f‖", left, 1e-9), ("least λ [N]", least, ">=", 0.0)]


def _certificate(classified: Classification, matrix: sp.csc_array) -> list[Number]:
    result, certificate = classified.mechanism, classified.certificate
    if certificate is None:
        return [(f"{result}: certificates", 0, ">=", 1)]
    if isinstance(certificate, SelfStress):
        stress, rank = certificate.forces, certificate.smallest_singular_value
        left = float(np.linalg.norm(matrix @ stress) / np.linalg.norm(stress))
        return [(f"{result}: self-stress ‖Gλ‖/‖λ‖", left, 1e-9), ("σ_min/σ_max", rank, ">=", 1e-10)]
    motion = certificate.virtual_displacement.ravel()
    return [(f"{result}: mechanism min Gᵀδq", float((matrix.T @ motion).min()), ">=", -1e-8)]


def _driven(matrix: sp.csc_array, force: FloatArray, motion: FloatArray | None) -> list[Number]:
    if motion is None:
        return [("load-activated mechanisms", 0, ">=", 1)]
    work = float(force @ motion) / float(np.linalg.norm(force))
    closing = -float((matrix.T @ motion).min()) / work
    return [
        ("no equilibrium: fᵀd/‖f‖", work, ">=", 1e-7),
        ("closing −min Gᵀd / work", closing, 1e-6),
    ]


def piped(assembly: Assembly) -> LoadCase:
    """Pressure of the paper's pipe."""
    return named_load("pipe", PRESSURE).on(assembly)


CERTIFIED = "products with the contact matrix confirm class and forces under pipe pressure"


#: Tubes at the edge of what can be built: what is unusual about each, and what builds it.
TUBES: dict[str, tuple[str, Callable[[], Assembly]]] = {
    "amplitude-0.01-mm": (
        "Waves of 0.01 mm on blocks of 200 mm",
        partial(tsb1_tube, amplitude=0.01),
    ),
    "amplitude-60-mm": ("Waves of 60 mm on blocks of 200 mm", partial(tsb1_tube, amplitude=60.0)),
    "thickness-0.02": ("Wall of 2 % of the inner radius", partial(tsb1_tube, thickness=2.4)),
    "thickness-2": ("Wall of twice the inner radius", partial(tsb1_tube, thickness=240.0)),
    "blocks-2": ("Two blocks in a layer", partial(tsb1_tube, blocks_per_layer=2)),
    "blocks-64": (
        "64 blocks in a layer",
        partial(tsb1_tube, 1, SineBlockDivisions(12, 2, 4), blocks_per_layer=64, amplitude=2.0),
    ),
    "layers-1": ("One free layer", partial(tsb1_tube, 1)),
    "layers-200": (
        "200 free layers, 4 800 unknowns",
        partial(tsb1_tube, 200, SineBlockDivisions(12, 2, 3)),
    ),
}


def _piped(build: Callable[[], Assembly]) -> CaseVerdict:
    assembly = build()
    return case_verdict(*certified(assembly, piped(assembly)))


for _name, (_words, _build) in TUBES.items():
    case(_name, f"{_words}: {CERTIFIED}")(partial(_piped, _build))


@case()
def mechanism_driven() -> CaseVerdict:
    """A column pushed sideways: no equilibrium, and the ray proves it."""
    assembly = stack(2)
    load = pressed(assembly, PRESSURE, face="inner")
    balance = analyse(assembly, load=load).details.equilibrium
    return case_verdict(*certified(assembly, load), message=balance.status)


@case()
def zero_load_rigid() -> CaseVerdict:
    """No load: equilibrium with λ = 0 exactly."""
    assembly = tsb1_tube()
    result = analyse(assembly, load=named_load("pipe", 0.0).on(assembly)).details
    largest = float(np.abs(result.contact_forces).max())
    return case_verdict(("holds", result.equilibrium.holds, "==", 1), ("largest λ", largest, 0))


def _scale_law(pressure: float) -> CaseVerdict:
    assembly = tsb1_tube()
    unit = analyse(assembly, load=named_load("pipe", 1.0).on(assembly)).details
    other = analyse(assembly, load=named_load("pipe", pressure).on(assembly)).details
    off = relative_difference(other.contact_forces / pressure, unit.contact_forces)
    # λ is determined to the residual target 1e-12 times the condition of the pressing columns.
    left = other.equilibrium.residual
    return case_verdict(("‖Gλ+f‖/‖f‖", left, 1e-9), ("λ/p against p = 1 MPa", off, 1e-9))


@case("load-1e-12-rigid")
def low_load() -> CaseVerdict:
    """Load of 1e-12 MPa: forces scale with the load."""
    return _scale_law(1e-12)


@case("load-1e9-rigid")
def high_load() -> CaseVerdict:
    """Load of 1e9 MPa: forces scale with the load."""
    return _scale_law(1e9)


def _of_a_tube() -> tuple[RigidContacts, FloatArray]:
    """Contacts of a tube and the wrenches of the load on its rows."""
    assembly = tsb1_tube()
    load = piped(assembly)
    contacts = contact_jacobian(assembly, load.fixed)
    return contacts, contacts.rows(load.wrenches)


def _repetition_law(times: int, least: int = 0) -> CaseVerdict:
    contacts, force = _of_a_tube()
    once = newton_equilibrium(contacts.jacobian, force)
    single = contacts.jacobian.contacts
    copies = PairWrenches.of_each(np.repeat(single.each, times, axis=0), single.pair_start * times)
    many = newton_equilibrium(replace(contacts.jacobian, contacts=copies), force)
    # Minimum norm spreads a force evenly over copies of a contact.
    expected = np.repeat(once.forces, times) / times
    return case_verdict(
        ("contacts", len(many.forces), ">=", least),
        ("‖Gλ+f‖/‖f‖", many.residual, 1e-9),
        ("λ against λ₁/k", relative_difference(many.forces, expected), 1e-9),
    )


@case()
def duplicated_contacts() -> CaseVerdict:
    """Every contact twice: each copy carries half."""
    return _repetition_law(2)


@case()
def contacts_5e5() -> CaseVerdict:
    """Every contact many times, 5e5 in all: copies share evenly."""
    return _repetition_law(500, 500_000)


@case()
def zero_area_contacts() -> CaseVerdict:
    """Contacts of zero area carry nothing; the rest balance, finite."""
    contacts, force = _of_a_tube()
    areas = contacts.areas.copy()
    areas[::7] = 0.0
    weights = column_weights(Norm.PRESSURE, areas)
    result = newton_equilibrium(contacts.jacobian, force, weights=weights)
    carried = float(np.abs(result.forces[::7]).max())
    return case_verdict(("‖Gλ+f‖/‖f‖", result.residual, 1e-9), ("λ there", carried, 0.0))


def _on_one_block(wrenches: FloatArray) -> ContactJacobian:
    """G of one free block, from the unit wrench of each contact (6, n_contacts)."""
    pairs, whole = np.zeros(1, dtype=np.int64), np.eye(6)[None]
    contacts = PairWrenches.of_each(wrenches.T, np.array([0, wrenches.shape[1]]))
    return ContactJacobian(contacts, np.zeros_like(whole), whole, pairs, pairs, n_free=1)


@case()
def parallel_normals() -> CaseVerdict:
    """Normals 2e-7 rad apart: the two forces of the closed form."""
    angle = 1e-7
    columns = np.zeros((6, 2))
    columns[:2] = [[np.cos(angle), np.cos(angle)], [np.sin(angle), -np.sin(angle)]]
    expected = np.array([0.75, 0.25])
    result = newton_equilibrium(_on_one_block(columns), -columns @ expected)
    # Forces are the residual (1e-12) over the smallest singular value (1.4e-7).
    return case_verdict(
        ("‖Gλ+f‖/‖f‖", result.residual, 1e-9),
        ("λ against (¾, ¼)", relative_difference(result.forces, expected), 1e-5),
    )


@case()
def rank_deficient() -> CaseVerdict:
    """24 contacts of rank 1 in six rows: even forces; across: a ray."""
    column = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    jacobian = _on_one_block(np.column_stack([column] * 12 + [-column] * 12))
    held = newton_equilibrium(jacobian, -6.0 * column)
    across = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    free = newton_equilibrium(jacobian, across)
    checks = (
        ("‖Gλ+f‖/‖f‖", held.residual, 1e-9),
        ("λ against ½", relative_difference(held.forces[:12], np.full(12, 0.5)), 1e-9),
    )
    return case_verdict(*checks, *_driven(jacobian.to_matrix(), across, free.mechanism))


def _cone(outside: float) -> tuple[FloatArray, FloatArray]:
    """Six independent contacts, and a load that is so far outside of what five of them carry."""
    matrix = np.eye(6) + 0.3 * np.random.default_rng(4).standard_normal((6, 6))
    matrix /= np.linalg.norm(matrix, axis=0)
    return matrix, outside * matrix[:, 5] - matrix[:, :5].sum(axis=1)


@case()
def cone_inside_1e_9() -> CaseVerdict:
    """Load 1e-9 inside the feasible cone: carried by the exact forces."""
    matrix, load = _cone(-1e-9)
    result = newton_equilibrium(_on_one_block(matrix), load)
    exact = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1e-9])
    return case_verdict(
        ("‖Gλ+f‖/‖f‖", result.residual, 1e-11),
        ("λ against the exact forces", relative_difference(result.forces, exact), 1e-10),
    )


@case()
def cone_outside_1e_9() -> CaseVerdict:
    """Load 1e-9 outside the cone, within the tolerance of 1e-6: carried, the residual names it."""
    matrix, load = _cone(1e-9)
    result = newton_equilibrium(_on_one_block(matrix), load)
    # Distance to the cone: the part of the overshoot orthogonal to the five others.
    basis, _ = np.linalg.qr(matrix[:, :5])
    rest = matrix[:, 5] - basis @ (basis.T @ matrix[:, 5])
    distance = 1e-9 * float(np.linalg.norm(rest)) / float(np.linalg.norm(load))
    return case_verdict(
        ("holds", result.holds, "==", 1),
        ("residual over distance, off 1", abs(result.residual / distance - 1.0), 0.01),
    )


@case()
def cone_outside_1e_5() -> CaseVerdict:
    """Load 1e-5 outside the cone: no equilibrium, and the ray proves it."""
    matrix, load = _cone(1e-5)
    result = newton_equilibrium(_on_one_block(matrix), load)
    return case_verdict(
        *_driven(sp.csc_array(matrix), load, result.mechanism), message=result.status
    )


def _without_top_block(*, unmatched_allowed: bool) -> Assembly:
    assembly = tsb1_tube()
    broken = renumbered(assembly, np.arange(assembly.n_blocks - 1))
    return replace(broken, unmatched_allowed=unmatched_allowed)


@case()
def frame_incomplete() -> CaseVerdict:
    """A frame without one block: rejected, naming the block left open."""
    broken = _without_top_block(unmatched_allowed=False)
    return rejected(lambda: broken.interfaces, AssemblyError, "meet no partner", "expected")


@case()
def frame_open() -> CaseVerdict:
    """The same with open faces allowed: products confirm its class and forces."""
    return _piped(partial(_without_top_block, unmatched_allowed=True))
