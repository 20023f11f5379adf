"""`tubelock compare`: rigid, static and explicit answers on the same mesh, side by side.

Compared as the paper compares: contact pressure per facet (correlation, overlap of the effective
contact areas, location of the peaks) on the top and bottom faces of the middle layer, and over the
whole tube; p_eff, p_max; force resultants per interface; time of each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fem.assembly.deformable import DeformableAssembly
from geometry.assembly import Assembly
from geometry.measures import between_layers
from geometry.mesh import BoolArray, FloatArray, IntArray
from mbd.options import Norm
from validation.build.blocks import BuiltScene
from validation.build.deformable import build_deformable, fem_section, scene_load
from validation.build.facing import FacingBlocks, facing_blocks
from validation.compare.decomposition import Step, decompose
from validation.errors import InputError
from validation.run.deformable import DeformableRun
from validation.run.rigid.answer import RigidRun, analyse_rigid
from validation.run.solve import run_explicit, run_static
from validation.scene.deformable import Damping, Method
from validation.scene.read import DeformableScene
from validation.scene.sections import RigidSection
from validation.scene.usage import uncounted


@dataclass(frozen=True)
class Answer:
    """Contact pressures of one method on the facets that all methods share."""

    method: str
    """``rigid (force)``, ``rigid (pressure)``, ``static``, ``explicit``."""
    pressures: FloatArray
    """On `Comparison.contacts`, (n_contacts,) [MPa]."""
    p_eff: float
    p_max: float
    effective_count_percent: float
    cpu_seconds: float
    """CPU time from the built scene to the pressures [s]."""


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
    explicit: DeformableRun | None
    contacts: IntArray
    """Facets that all answers share, positions in the interfaces of the rigid blocks, (n,)."""
    answers: tuple[Answer, ...]
    """Rigid in both norms, static, explicit."""
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
    name: str, scene: DeformableScene, *, explicit: bool = True, progress: Any = None
) -> Comparison:
    """Answer a scene by rigid blocks, static and, where asked for, explicit finite elements.

    Raises
    ------
    InputError
        Input that cannot be solved, or a load that rigid blocks do not carry.
    """
    fem = fem_section(scene, name)
    deformable = build_comparable(scene, name)
    assembly = deformable.assembly
    if deformable.contact.finite_sliding:
        assembly = facing_blocks(assembly)
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
    static_scene = scene.changed({"fem.method": Method.STATIC})
    static = run_static(name, static_scene, deformable=deformable)
    dynamic = None
    if explicit:
        damping = fem.damping or Damping.STATIC
        explicit_scene = scene.changed({"fem": {"method": Method.EXPLICIT, "damping": damping}})
        dynamic = run_explicit(name, explicit_scene, deformable=deformable, progress=progress)
    steps = decompose(name, scene, static)
    return _collect(name, rigid, static, dynamic, steps)


def build_comparable(scene: DeformableScene, name: str) -> DeformableAssembly:
    """Build the blocks that all answers share.

    Raises
    ------
    InputError
        When they cannot be solved.
    """
    fem_section(scene, name)
    # The method is not the scene's to choose here.
    return build_deformable(scene.changed({"fem.method": Method.EXPLICIT}), name)


def _collect(
    name: str,
    rigid: dict[Norm, RigidRun],
    static: DeformableRun,
    dynamic: DeformableRun | None,
    steps: list[Step],
) -> Comparison:
    blocks = rigid[Norm.FORCE].assembly
    contacts = rigid[Norm.FORCE].result.contact_index
    solved = [run for run in (static, dynamic) if run is not None]
    places = [_places(run, blocks) for run in solved]
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
                run.result.contact_pressures[rows],
                measured.p_eff,
                measured.p_max,
                measured.effective_count_percent,
                run.cpu_seconds["total"],
            )
        )
    for tube, place in zip(solved, places, strict=True):
        order = np.argsort(place)
        rows = order[np.searchsorted(place[order], contacts)]
        answers.append(
            Answer(
                str(tube.method),
                tube.facet_pressures[rows],
                tube.contact.p_eff,
                tube.contact.p_max_face,
                tube.contact.effective_count_percent,
                tube.cpu_seconds["solve"],
            )
        )
    return Comparison(
        name=name,
        rigid=rigid[Norm.PRESSURE],
        static=static,
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
    return run.contact_index


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
    """Errors of the explicit end state against the static one; None without an explicit run.

    Displacement and pressure are root mean squares relative to the static field's; p_max is the
    mean of the block maxima.
    """
    a, b = comparison.static, comparison.explicit
    if b is None:
        return None
    u = np.concatenate([x.ravel() for x in a.displacements])
    v = np.concatenate([x.ravel() for x in b.displacements])
    p, q = a.facet_pressures, b.facet_pressures
    return {
        "displacement_rms": float(np.linalg.norm(v - u) / np.linalg.norm(u)),
        "pressure_rms": float(np.linalg.norm(q - p) / np.linalg.norm(p)),
        "p_max": abs(b.contact.p_max_face / a.contact.p_max_face - 1.0),
        "p_max_point": abs(b.contact.p_max_point / a.contact.p_max_point - 1.0),
    }


def explanations(comparison: Comparison) -> list[str]:
    """Say in words where the differences come from; the numbers are those of the steps."""
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
    errors = explicit_errors(comparison)
    if errors is not None:
        lines.append(
            "the explicit run ends at the static state: displacement off by "
            f"{100 * errors['displacement_rms']:.2f} % (rms), pressure by "
            f"{100 * errors['pressure_rms']:.2f} % (rms), p_max by {100 * errors['p_max']:.2f} %"
        )
    return lines
