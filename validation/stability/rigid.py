"""Robustness cases of rigid blocks: equilibrium, classes and their certificates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import scipy.sparse as sp

from geometry.assembly import Assembly, AssemblyError, renumbered
from geometry.families.sine_block import SineBlockDivisions
from geometry.loads import LoadCase, named_load
from geometry.mesh import FloatArray
from mbd import Norm, analyse, contact_jacobian
from mbd.contact_jacobian import ContactJacobian, SeparateWrenches
from mbd.equilibrium import column_weights, newton_equilibrium
from mbd.mechanism import Classification, SelfStress
from validation.stability.case import Cases, Check, Finding, refusal
from validation.stability.problems import pressed, relative, stack, tube

CASES = Cases("rigid")

#: Pressure of the paper's load cases [MPa].
PRESSURE = 0.01


def certified(assembly: Assembly, load: LoadCase) -> tuple[Check, ...]:
    """Check class and equilibrium of an assembly by multiplying out G, written as a matrix."""
    contacts = contact_jacobian(assembly, load.fixed)
    matrix = contacts.jacobian.to_matrix()
    force = contacts.rows(load.wrenches)
    result = analyse(assembly, load=load).details
    size = float(np.linalg.norm(force))
    checks = list(_class_checks(result.supported_classification, matrix))
    balance = result.equilibrium
    if balance.holds:
        left = float(np.linalg.norm(matrix @ balance.forces + force))
        checks.append(Check("equilibrium ‖Gλ+f‖/‖f‖", left / size if size else left, 1e-9))
        checks.append(Check("least λ [N]", float(balance.forces.min()), least=0.0))
    else:
        checks += _driven(matrix, force, balance.mechanism)
    return tuple(checks)


def _class_checks(classified: Classification, matrix: sp.csc_array) -> tuple[Check, ...]:
    result, certificate = classified.mechanism, classified.certificate
    if certificate is None:
        return (Check(f"{result}: certificates", 0, least=1),)
    if isinstance(certificate, SelfStress):
        stress = certificate.forces
        left = float(np.linalg.norm(matrix @ stress) / np.linalg.norm(stress))
        rank = certificate.smallest_singular_value
        return (
            Check(f"{result}: self-stress ‖Gλ‖/‖λ‖", left, 1e-9),
            Check("σ_min/σ_max", rank, least=1e-10),
        )
    motion = certificate.virtual_displacement.ravel()
    return (Check(f"{result}: mechanism min Gᵀδq", float((matrix.T @ motion).min()), least=-1e-8),)


def _driven(
    matrix: sp.csc_array, force: FloatArray, motion: FloatArray | None
) -> tuple[Check, ...]:
    if motion is None:
        return (Check("load-activated mechanisms", 0, least=1),)
    work = float(force @ motion) / float(np.linalg.norm(force))
    return (
        Check("no equilibrium: fᵀd/‖f‖", work, least=1e-7),
        Check("closing −min Gᵀd / work", -float((matrix.T @ motion).min()) / work, 1e-6),
    )


def piped(assembly: Assembly) -> LoadCase:
    """Pressure of the paper's pipe."""
    return named_load("pipe", PRESSURE).on(assembly)


CERTIFIED = "products with the contact matrix confirm class and forces under pipe pressure"


#: Tubes at the edge of what can be built: what is unusual about each, and what builds it.
TUBES: dict[str, tuple[str, Callable[[], Assembly]]] = {
    "amplitude-0.01-mm": ("Waves of 0.01 mm on blocks of 200 mm", partial(tube, amplitude=0.01)),
    "amplitude-60-mm": ("Waves of 60 mm on blocks of 200 mm", partial(tube, amplitude=60.0)),
    "thickness-0.02": ("Wall of 2 % of the inner radius", partial(tube, thickness=2.4)),
    "thickness-2": ("Wall of twice the inner radius", partial(tube, thickness=240.0)),
    "blocks-2": ("Two blocks in a layer", partial(tube, blocks_per_layer=2)),
    "blocks-64": (
        "64 blocks in a layer",
        partial(tube, 1, SineBlockDivisions(12, 2, 4), blocks_per_layer=64, amplitude=2.0),
    ),
    "layers-1": ("One free layer", partial(tube, 1)),
    "layers-200": (
        "200 free layers, 4 800 unknowns",
        partial(tube, 200, SineBlockDivisions(12, 2, 3)),
    ),
}


def _piped(build: Callable[[], Assembly]) -> Finding:
    assembly = build()
    return Finding(*certified(assembly, piped(assembly)))


for _name, (_words, _build) in TUBES.items():
    CASES.case(_name, f"{_words}: {CERTIFIED}", _piped, _build)


@CASES.add("mechanism-driven", "A column pushed sideways: no equilibrium, and the ray proves it")
def _driven_column() -> Finding:
    assembly = stack(2)
    load = pressed(assembly, PRESSURE, face="inner")
    balance = analyse(assembly, load=load).details.equilibrium
    return Finding(*certified(assembly, load), refusal=balance.status)


@CASES.add("zero-load-rigid", "No load: equilibrium with λ = 0 exactly")
def _no_load() -> Finding:
    assembly = tube()
    result = analyse(assembly, load=named_load("pipe", 0.0).on(assembly)).details
    largest = float(np.abs(result.contact_forces).max())
    return Finding(Check("holds", result.equilibrium.holds, 1, 1), Check("largest λ", largest, 0))


def _scale_law(pressure: float) -> Finding:
    assembly = tube()
    unit = analyse(assembly, load=named_load("pipe", 1.0).on(assembly)).details
    other = analyse(assembly, load=named_load("pipe", pressure).on(assembly)).details
    difference = relative(other.contact_forces / pressure, unit.contact_forces)
    # λ is determined to the residual target 1e-12 times the condition of the pressing columns.
    return Finding(
        Check("‖Gλ+f‖/‖f‖", other.equilibrium.residual, 1e-9),
        Check("λ/p against p = 1 MPa", difference, 1e-9),
    )


CASES.case("load-1e-12-rigid", "Load of 1e-12 MPa: forces scale with the load", _scale_law, 1e-12)
CASES.case("load-1e9-rigid", "Load of 1e9 MPa: forces scale with the load", _scale_law, 1e9)


def _repeated(jacobian: ContactJacobian, times: int) -> ContactJacobian:
    once = jacobian.contacts.separate()
    many = SeparateWrenches(np.repeat(once.wrenches, times, axis=0), once.pair_start * times)
    return replace(jacobian, contacts=many)


def _repetition_law(times: int, least: int = 0) -> Finding:
    assembly = tube()
    load = named_load("pipe", PRESSURE).on(assembly)
    contacts = contact_jacobian(assembly, load.fixed)
    force = contacts.rows(load.wrenches)
    once = newton_equilibrium(contacts.jacobian, force)
    many = newton_equilibrium(_repeated(contacts.jacobian, times), force)
    # Minimum norm spreads a force evenly over copies of a contact.
    expected = np.repeat(once.forces, times) / times
    return Finding(
        Check("contacts", len(many.forces), least=least),
        Check("‖Gλ+f‖/‖f‖", many.residual, 1e-9),
        Check("λ against λ₁/k", relative(many.forces, expected), 1e-9),
    )


CASES.case("duplicated-contacts", "Every contact twice: each copy carries half", _repetition_law, 2)
CASES.case(
    "contacts-5e5",
    "Every contact many times, 5e5 in all: copies share evenly",
    _repetition_law,
    500,
    500_000,
)


@CASES.add("zero-area-contacts", "Contacts of zero area carry nothing; the rest balance, finite")
def _zero_area() -> Finding:
    assembly = tube()
    load = named_load("pipe", PRESSURE).on(assembly)
    contacts = contact_jacobian(assembly, load.fixed)
    force = contacts.rows(load.wrenches)
    areas = contacts.areas.copy()
    areas[::7] = 0.0
    result = newton_equilibrium(
        contacts.jacobian, force, weights=column_weights(Norm.PRESSURE, areas)
    )
    carried = float(np.abs(result.forces[::7]).max())
    return Finding(Check("‖Gλ+f‖/‖f‖", result.residual, 1e-9), Check("λ there", carried, 0.0))


def _on_one_block(wrenches: FloatArray) -> ContactJacobian:
    """G of one free block, from the unit wrench of each contact (6, n_contacts)."""
    pairs, whole = np.zeros(1, dtype=np.int64), np.eye(6)[None]
    contacts = SeparateWrenches(wrenches.T, np.array([0, wrenches.shape[1]]))
    return ContactJacobian(contacts, np.zeros_like(whole), whole, pairs, pairs, n_free=1)


@CASES.add("parallel-normals", "Normals 2e-7 rad apart: the two forces of the closed form")
def _parallel() -> Finding:
    angle = 1e-7
    columns = np.zeros((6, 2))
    columns[:2] = [[np.cos(angle), np.cos(angle)], [np.sin(angle), -np.sin(angle)]]
    expected = np.array([0.75, 0.25])
    result = newton_equilibrium(_on_one_block(columns), -columns @ expected)
    # Forces are the residual (1e-12) over the smallest singular value (1.4e-7).
    return Finding(
        Check("‖Gλ+f‖/‖f‖", result.residual, 1e-9),
        Check("λ against (¾, ¼)", relative(result.forces, expected), 1e-5),
    )


@CASES.add("rank-deficient", "24 contacts of rank 1 in six rows: even forces; across: a ray")
def _rank_deficient() -> Finding:
    column = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    jacobian = _on_one_block(np.column_stack([column] * 12 + [-column] * 12))
    held = newton_equilibrium(jacobian, -6.0 * column)
    across = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    free = newton_equilibrium(jacobian, across)
    checks = (
        Check("‖Gλ+f‖/‖f‖", held.residual, 1e-9),
        Check("λ against ½", relative(held.forces[:12], np.full(12, 0.5)), 1e-9),
    )
    return Finding(*checks, *_driven(jacobian.to_matrix(), across, free.mechanism))


def _cone() -> tuple[FloatArray, FloatArray]:
    """Six independent contacts, and a load that five of them carry exactly."""
    matrix = np.eye(6) + 0.3 * np.random.default_rng(4).standard_normal((6, 6))
    matrix /= np.linalg.norm(matrix, axis=0)
    return matrix, -matrix[:, :5].sum(axis=1)


@CASES.add("cone-inside-1e-9", "Load 1e-9 inside the feasible cone: carried by the exact forces")
def _inside() -> Finding:
    matrix, load = _cone()
    load = load - 1e-9 * matrix[:, 5]
    result = newton_equilibrium(_on_one_block(matrix), load)
    exact = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1e-9])
    return Finding(
        Check("‖Gλ+f‖/‖f‖", result.residual, 1e-11),
        Check("λ against the exact forces", relative(result.forces, exact), 1e-10),
    )


@CASES.add(
    "cone-outside-1e-9",
    "Load 1e-9 outside the cone, within the tolerance of 1e-6: carried, the residual names it",
)
def _just_outside() -> Finding:
    matrix, load = _cone()
    load = load + 1e-9 * matrix[:, 5]
    result = newton_equilibrium(_on_one_block(matrix), load)
    # Distance to the cone: the part of the overshoot orthogonal to the five others.
    basis, _ = np.linalg.qr(matrix[:, :5])
    rest = matrix[:, 5] - basis @ (basis.T @ matrix[:, 5])
    distance = 1e-9 * float(np.linalg.norm(rest)) / float(np.linalg.norm(load))
    return Finding(
        Check("holds", result.holds, 1, 1),
        Check("residual over distance", result.residual / distance, 1.01, 0.99),
    )


@CASES.add("cone-outside-1e-5", "Load 1e-5 outside the cone: no equilibrium, and the ray proves it")
def _outside() -> Finding:
    matrix, load = _cone()
    load = load + 1e-5 * matrix[:, 5]
    result = newton_equilibrium(_on_one_block(matrix), load)
    return Finding(*_driven(sp.csc_array(matrix), load, result.mechanism), refusal=result.status)


def _without_top_block(*, unmatched_allowed: bool) -> Assembly:
    assembly = tube()
    broken = renumbered(assembly, np.arange(assembly.n_blocks - 1))
    return replace(broken, unmatched_allowed=unmatched_allowed)


@CASES.add("frame-incomplete", "A frame without one block: rejected, naming the block left open")
def _incomplete_frame() -> Finding:
    broken = _without_top_block(unmatched_allowed=False)
    return refusal(lambda: broken.interfaces, AssemblyError, "meet no partner", "expected")


CASES.case(
    "frame-open",
    "The same with open faces allowed: products confirm its class and forces",
    _piped,
    partial(_without_top_block, unmatched_allowed=True),
)
