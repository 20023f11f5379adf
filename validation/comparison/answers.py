"""`tubelock compare`: rigid, static and explicit answers over the same facets, side by side.

The static answer is the converged one, evaluated over the facets of the scene's mesh; an explicit
run has the elements of that mesh, and so has the static answer that it ends at.

Compared as the paper compares: contact pressure per facet (correlation, overlap of the effective
contact areas, location of the peaks) on the top and bottom faces of the middle layer, and over the
whole tube; p_eff, p_max; force resultants per interface; time of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fem.accuracy.converge import MOST_WORK
from fem.assembly.statement import Problem
from geometry.answer import Measure
from geometry.assembly import Assembly
from geometry.measures import between_layers
from geometry.mesh import BoolArray, FloatArray, IntArray
from mbd.options import Norm
from validation.build.blocks import BuiltScene
from validation.build.deformable import (
    build_hexahedra,
    build_problem,
    fem_section,
    scene_load,
)
from validation.build.facing import FacingBlocks, facing_blocks
from validation.comparison.decomposition import Step, decompose, decompose_converged
from validation.errors import InputError, named
from validation.run.accuracy import DEFAULT_TARGETS, refined
from validation.run.deformable import DeformableRun
from validation.run.held_by_faces import require_held_by_faces
from validation.run.rigid.answer import RigidRun, analyse_rigid
from validation.run.solve import run_converged, run_explicit, run_static
from validation.scene.deformable import Damping, Method
from validation.scene.read import DeformableScene
from validation.scene.sections import RigidSection
from validation.scene.usage import uncounted

#: Deformable answers, and what each answer is.
_NAMES = ("static", "static on [mesh]", "explicit")
_WORDS = {
    "force": "rigid blocks, least sum of squared forces: depends on the number of facets",
    "pressure": "rigid blocks, least squared pressures over the area: does not depend on it",
    "static": "deformable blocks with the elements of [mesh]",
    "converged": "deformable blocks, converged; [mesh] gives the facets of the means alone",
    "static on [mesh]": "deformable blocks with the elements of [mesh]",
    "explicit": "the same elements, explicit dynamics damped to the static state",
}


@dataclass(frozen=True)
class Answer:
    """Contact pressures of one method on the facets that all methods share."""

    method: str
    """``rigid (force)``, ``rigid (pressure)``, ``static``, ``static on [mesh]``, ``explicit``."""
    words: str
    """What it is."""
    pressures: FloatArray
    """On `Comparison.contacts`, (n_contacts,) [MPa]."""
    p_eff: float
    """Mean over blocks of the mean of their effective facets [MPa]."""
    p_max: float
    """Mean over blocks of their largest mean over a facet [MPa]."""
    p_max_facet: float
    """Largest mean over a facet [MPa]."""
    effective_count_percent: float
    cpu_seconds: float
    """CPU time from the built scene to the pressures [s]."""
    p_max_point: Measure | None = None
    """Largest pressure at a point; rigid blocks have none."""
    max_displacement: Measure | None = None
    """Of deformable blocks."""
    errors: Mapping[str, float | None] = field(default_factory=dict)
    """Error bars of the facet means of deformable blocks by name [MPa]."""


#: Ratio of largest facet pressures, deformable over rigid, from which on it is explained.
_PEAK = 1.5
#: Relative differences of pressures below this are round-off of the solvers (residual 1e-8).
_UNIFORM = 1e-6


@dataclass(frozen=True)
class PressureAgreement:
    """How alike two pressure fields are on one set of facets."""

    faces: str
    """``all``, in a tube also ``top`` and ``bottom`` (of the middle layer)."""
    correlation: float
    """Area-weighted Pearson correlation of the pressures; two uniform fields: 1, one: 0."""
    overlap: float
    """Shared area of the effective contact regions over their union."""
    peaks_found: float
    """Mean over blocks of the reference's largest pressure within two facets of the other's peak,
    over its largest of all: one where the peaks coincide, several equal peaks counting as one."""
    force_ratio: float
    """Total contact force of the other over that of the reference."""


@dataclass(frozen=True)
class Comparison:
    """All answers to one scene."""

    name: str
    rigid: RigidRun
    static: DeformableRun
    """Converged, where the scene's mesh can be refined and the scene states no elements."""
    on_mesh: DeformableRun | None
    """The static state of the elements of an explicit run."""
    explicit: DeformableRun | None
    contacts: IntArray
    """Facets that all answers share, positions in the interfaces of the rigid blocks, (n,)."""
    answers: tuple[Answer, ...]
    """Rigid in both norms, static, static on the scene's mesh and explicit."""
    agreement: dict[str, tuple[PressureAgreement, ...]]
    """Of each other answer against the static one."""
    interface_forces: dict[str, FloatArray]
    """Force resultant of every block pair in every answer, (n_pairs, 3) [N]."""
    steps: tuple[Step, ...]
    """From rigid blocks to the static answer, one assumption at a time."""


def effective_region(pressure: FloatArray) -> BoolArray:
    """Whether each facet is among the K largest, K the participation ratio; (n,) bool."""
    total = float(pressure.sum())
    if total <= 0.0:
        return np.zeros(len(pressure), dtype=bool)
    # A uniform pressure has a whole participation ratio and no order: neither hangs on round-off.
    count = int(total**2 / float(pressure @ pressure) * (1.0 + _UNIFORM))
    alike = np.round(pressure / float(pressure.max()) / _UNIFORM)
    chosen = np.zeros(len(pressure), dtype=bool)
    chosen[np.argsort(-alike, kind="stable")[:count]] = True
    return chosen


def _correlation(a: FloatArray, b: FloatArray, area: FloatArray) -> float:
    weight = area / area.sum()
    da, db = a - weight @ a, b - weight @ b
    spread_a, spread_b = float(np.sqrt(weight @ da**2)), float(np.sqrt(weight @ db**2))
    uniform_a = spread_a <= _UNIFORM * abs(float(weight @ a))
    uniform_b = spread_b <= _UNIFORM * abs(float(weight @ b))
    if uniform_a or uniform_b:
        return 1.0 if uniform_a and uniform_b else 0.0
    return float(weight @ (da * db)) / (spread_a * spread_b)


def agreement(
    faces: str,
    reference: FloatArray,
    other: FloatArray,
    *,
    centroids: FloatArray,
    areas: FloatArray,
    block: IntArray,
) -> PressureAgreement:
    """Compare two pressure fields, (n,) [MPa], on the same facets.

    Their centroids are (n, 3) [mm], their areas (n,) [mm²]; ``block`` is the block whose peak is
    looked for on each, (n,).
    """
    union = shared = 0.0
    hits = []
    for number in np.unique(block):
        mine = block == number
        a, b = effective_region(reference[mine]), effective_region(other[mine])
        union += float(areas[mine][a | b].sum())
        shared += float(areas[mine][a & b].sum())
        highest = float(reference[mine].max())
        if highest > 0:
            away = np.linalg.norm(centroids[mine] - centroids[mine][other[mine].argmax()], axis=1)
            near = away <= 2 * np.sqrt(areas[mine].max())
            hits.append(float(reference[mine][near].max()) / highest)
    total = float(areas @ reference)
    return PressureAgreement(
        faces=faces,
        correlation=_correlation(reference, other, areas),
        overlap=shared / union if union > 0 else 1.0,
        peaks_found=float(np.mean(hits)) if hits else 1.0,
        force_ratio=float(areas @ other) / total if total > 0 else 1.0,
    )


def compare(
    name: str,
    scene: DeformableScene,
    *,
    explicit: bool = False,
    progress: Any = None,
    refinement: Any = None,
) -> Comparison:
    """Answer a scene by rigid blocks, static and, if ``explicit``, explicit finite elements.

    ``progress`` is called by the explicit run, ``refinement`` before each mesh of the static one.

    Raises
    ------
    InputError
        Input that cannot be solved, or a load that rigid blocks do not carry.
    """
    fem = fem_section(scene, name)
    problem = build_comparable(scene, name)
    require_held_by_faces(name, scene, problem.blocks)
    assembly = problem.blocks
    if problem.finite_sliding:
        assembly = facing_blocks(problem.deformable.assembly)
    rigid = _rigid_answers(name, scene, assembly)
    static_scene = scene.changed({"fem.method": Method.STATIC})
    one_mesh = problem.finite_sliding or not refined(name, static_scene, {})
    on_mesh = dynamic = None
    if one_mesh or explicit:
        on_mesh = run_static(name, static_scene, deformable=problem.deformable)
    if explicit:
        damping = fem.damping or Damping.STATIC
        explicit_scene = scene.changed({"fem": {"method": Method.EXPLICIT, "damping": damping}})
        dynamic = run_explicit(
            name, explicit_scene, deformable=problem.deformable, progress=progress
        )
    if on_mesh is not None and one_mesh:
        steps = decompose(name, scene, on_mesh)
        return _collect(name, rigid, on_mesh, (None, dynamic), steps)
    static = run_converged(
        name, static_scene, DEFAULT_TARGETS, most_work=MOST_WORK, progress=refinement
    )
    steps = decompose_converged(problem, static)
    return _collect(name, rigid, static, (on_mesh, dynamic), steps)


def _rigid_answers(name: str, scene: DeformableScene, assembly: Assembly) -> dict[Norm, RigidRun]:
    """Answers of rigid blocks in both norms.

    Raises
    ------
    InputError
        A load that they do not carry.
    """
    load = scene_load(scene, name, assembly)
    rigid: dict[Norm, RigidRun] = {}
    idle = [(RigidSection, key) for key in RigidSection.model_fields if key != "solver"]
    for norm in Norm:
        # Both norms are compared, and no answer further to them.
        section = RigidSection(norm=norm, solver=scene.rigid.solver)
        chosen = scene.changed({"rigid": section})
        with uncounted(*idle):
            rigid[norm] = analyse_rigid(BuiltScene(name, chosen, assembly, load, 0.0))
        if not rigid[norm].result.equilibrium.holds:
            raise InputError(f"{name}: {rigid[norm].result.equilibrium.status}")
    return rigid


def build_comparable(scene: DeformableScene, name: str) -> Problem:
    """State the problem that all answers share.

    Raises
    ------
    InputError
        When they cannot be solved.
    """
    fem_section(scene, name)
    # The method is not the scene's to choose here.
    chosen = scene.changed({"fem.method": Method.STATIC})
    blocks = build_hexahedra(chosen, name)
    with named(name):
        return build_problem(chosen, name, blocks)


def _collect(
    name: str,
    rigid: dict[Norm, RigidRun],
    static: DeformableRun,
    same_mesh: tuple[DeformableRun | None, DeformableRun | None],
    steps: list[Step],
) -> Comparison:
    blocks = rigid[Norm.FORCE].assembly
    contacts = rigid[Norm.FORCE].result.contact_index
    on_mesh, dynamic = same_mesh
    named_runs = {_NAMES[0]: static, _NAMES[1]: on_mesh, _NAMES[2]: dynamic}
    solved = {method: run for method, run in named_runs.items() if run is not None}
    places = [_places(run, blocks) for run in solved.values()]
    for place in places:
        contacts = np.intersect1d(contacts, place)
    answers = []
    for norm, run in rigid.items():
        rows = np.searchsorted(run.result.contact_index, contacts)
        measured = run.result.measures
        assert measured is not None
        answers.append(
            Answer(
                f"rigid ({norm})",
                _WORDS[norm],
                run.result.contact_pressures[rows],
                measured.p_eff,
                measured.p_max,
                float(run.result.contact_pressures.max(initial=0.0)),
                measured.effective_count_percent,
                run.cpu_seconds["total"],
            )
        )
    for (method, tube), place in zip(solved.items(), places, strict=True):
        order = np.argsort(place)
        rows = order[np.searchsorted(place[order], contacts)]
        answers.append(
            Answer(
                method,
                _WORDS["converged" if tube.facets is not None else method],
                _pressures(tube)[rows],
                tube.contact.p_eff,
                tube.contact.p_max,
                float(_pressures(tube).max(initial=0.0)),
                tube.contact.effective_count_percent,
                tube.cpu_seconds["solve"],
                tube.measures["p_max_point"],
                tube.measures["max_displacement"],
                {name: tube.measures[name].error for name in ("p_eff", "p_max", "p_max_facet")},
            )
        )
    return Comparison(
        name=name,
        rigid=rigid[Norm.PRESSURE],
        static=static,
        on_mesh=on_mesh,
        explicit=dynamic,
        contacts=contacts,
        answers=tuple(answers),
        agreement=_agreements(static, blocks, contacts, answers),
        interface_forces=_interface_forces(blocks, contacts, answers),
        steps=tuple(steps),
    )


def _places(run: DeformableRun, blocks: Assembly) -> IntArray:
    """Position of each facet of a run in the interfaces of the rigid blocks, -1 where none is."""
    if isinstance(blocks, FacingBlocks):
        return blocks.positions(run.contact_state)
    if run.facets is not None:
        return np.arange(len(run.facets[1]))
    return run.contact_index


def _pressures(run: DeformableRun) -> FloatArray:
    """Mean pressures over the facets of the scene's mesh, in the order of `_places`."""
    return run.facet_pressures if run.facets is None else run.facets[1]


def _agreements(
    static: DeformableRun, assembly: Assembly, contacts: IntArray, answers: list[Answer]
) -> dict[str, tuple[PressureAgreement, ...]]:
    found = assembly.interfaces
    layer = assembly.n_layers // 2 + 1
    reference = next(a.pressures for a in answers if a.method == "static")
    sets = {"all": np.arange(len(contacts))}
    if static.is_tube:
        sets["top"] = between_layers(assembly, contacts, layer)
        sets["bottom"] = between_layers(assembly, contacts, layer - 1)
    m, s = found.block_m[contacts], found.block_s[contacts]
    # Peaks are looked for per block of the compared layer; over the whole tube, per master block.
    owner = np.where(assembly.layer[m] == layer, m, s)
    result = {}
    for answer in answers:
        if answer.method == "static":
            continue
        result[answer.method] = tuple(
            agreement(
                faces,
                reference[rows],
                answer.pressures[rows],
                centroids=found.centroids[contacts[rows]],
                areas=found.areas[contacts[rows]],
                block=m[rows] if faces == "all" else owner[rows],
            )
            for faces, rows in sets.items()
        )
    return result


def _interface_forces(
    assembly: Assembly, contacts: IntArray, answers: list[Answer]
) -> dict[str, FloatArray]:
    found = assembly.interfaces
    pair = np.searchsorted(found.pair_start, contacts, side="right") - 1
    used, row = np.unique(pair, return_inverse=True)
    direction = found.normals[contacts] * found.areas[contacts, None]
    forces = {}
    for answer in answers:
        total = np.zeros((len(used), 3))
        np.add.at(total, row, answer.pressures[:, None] * direction)
        forces[answer.method] = total
    return forces


def interface_force_error(comparison: Comparison, method: str) -> float:
    """RMS difference of the pair resultants from the static ones, relative to their RMS."""
    ours, static = comparison.interface_forces[method], comparison.interface_forces["static"]
    scale = float(np.sqrt(np.mean(static**2)))
    return float(np.sqrt(np.mean((ours - static) ** 2))) / scale if scale > 0 else 0.0


def explicit_errors(comparison: Comparison) -> dict[str, float] | None:
    """Errors of the explicit end state against the static one of its mesh; None without a run.

    Displacement and pressure are root mean squares relative to the static field's; p_max is the
    mean of the block maxima.
    """
    a, b = comparison.on_mesh or comparison.static, comparison.explicit
    if b is None:
        return None
    u = np.concatenate([x.ravel() for x in a.displacements])
    v = np.concatenate([x.ravel() for x in b.displacements])
    p, q = a.facet_pressures, b.facet_pressures
    return {
        "displacement_rms": float(np.linalg.norm(v - u) / np.linalg.norm(u)),
        "pressure_rms": float(np.linalg.norm(q - p) / np.linalg.norm(p)),
        "p_max": abs(b.contact.p_max / a.contact.p_max - 1.0),
        "p_max_point": abs(b.contact.p_max_point / a.contact.p_max_point - 1.0),
    }


#: Peaks that differ by a larger factor are no round-off of two methods [-].
_ALIKE = 1.2


def conclusion(comparison: Comparison) -> str:
    """What the comparison shows of the peaks, in words."""
    rigid = next(a for a in comparison.answers if a.method == "rigid (pressure)")
    static = next(a for a in comparison.answers if a.method == "static")
    at_point = static.p_max_point
    if at_point is None or not rigid.p_max_facet > 0.0:
        return "no joint presses"
    ratio = at_point.value / rigid.p_max_facet
    words = (
        f"the finite-element peak, {at_point.value:.3g} MPa at a point, is {ratio:.2g} times the "
        f"rigid one, {rigid.p_max_facet:.3g} MPa over a facet"
    )
    if 1.0 / _ALIKE < ratio < _ALIKE:
        return f"{words}: both agree"
    return f"{words}: rigid pressures are means over facets that share force, not peaks"


def explanations(comparison: Comparison) -> list[str]:
    """Explain the differences in words, with the numbers of the steps."""
    rigid = next(a for a in comparison.answers if a.method == "rigid (pressure)")
    whole = comparison.agreement["rigid (pressure)"][0]
    lines = []
    before_eff, before_max = rigid.p_eff, rigid.p_max
    for step in comparison.steps:
        lines.append(
            f"{step.words}: p_max {before_max:.3g} → {step.p_max:.3g} MPa "
            f"({100 * (step.p_max / before_max - 1):+.0f} %), p_eff {before_eff:.3g} → "
            f"{step.p_eff:.3g} MPa ({100 * (step.p_eff / before_eff - 1):+.0f} %), "
            f"{step.effective_count_percent:.1f} % of the elements effective"
        )
        before_eff, before_max = step.p_eff, step.p_max
    indeterminate = "the tube is statically indeterminate, so resultants differ too"
    lines.append(
        f"{indeterminate if comparison.static.is_tube else 'resultants differ'}: force per "
        "interface by "
        f"{100 * interface_force_error(comparison, 'rigid (pressure)'):.0f} % (rms), total contact "
        f"force by {100 * (whole.force_ratio - 1):+.0f} %"
    )
    static = next(a for a in comparison.answers if a.method == "static")
    peaks = float(static.pressures.max(initial=0.0)), float(rigid.pressures.max(initial=0.0))
    if peaks[0] > _PEAK * peaks[1]:
        lines.append(
            f"the largest facet pressure is {peaks[0]:.3g} MPa deformable and {peaks[1]:.3g} MPa "
            "rigid: rigid pressures are means over facets that share force, not peaks"
        )
    errors = explicit_errors(comparison)
    if errors is not None:
        lines.append(
            "the explicit run ends at the static state of its mesh: displacement off by "
            f"{100 * errors['displacement_rms']:.2f} % (rms), pressure by "
            f"{100 * errors['pressure_rms']:.2f} % (rms), p_max by {100 * errors['p_max']:.2f} %"
        )
    return lines
