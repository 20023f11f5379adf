"""Answers of rigid blocks as text and files, of meshes and of solids: pressures, mechanisms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geometry.answer import FACTORS, Answer, Measure
from geometry.assembly import Assembly
from geometry.files.mesh_io import write_cells
from geometry.parts.measures import JointResultants, Measures, SectionForces
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Row, number
from geometry.polyhedra.bare_contacts import CROSSING_EDGES, STANDING_CORNER
from mbd.options import Norm
from validation.output import answer_files
from validation.output.console import RowTable, cpu_row, dimension_rows, part_rows
from validation.output.forces import (
    JOINT_FILES,
    SECTION_FILES,
    support_rows,
    write_joints,
    write_sections,
)
from validation.output.outputs import Outputs

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly

    # Machine code that no other rigid answer needs comes with it.
    from validation.output.explosion import Explosion

#: Files of a rigid answer.
FILES = (
    *answer_files.FILES,
    "contact_pressures.png",
    "contacts.vtu",
    "contacts.png",
    "mechanism.png",
    "explosion.png",
    *JOINT_FILES,
    *SECTION_FILES,
)
#: Components below this part of the largest are round-off.
_NOISE = 1e-9
#: What a load factor of rigid blocks is.
OF_RIGID_BLOCKS = "by mean pressures of facets of rigid blocks, without peaks"
#: Why nothing of rigid blocks has an error bar.
_NO_BARS = "none of rigid blocks; where forces are not unique, those of least norm are shown"
#: Parts whose rows stand among the first.
_FIRST = ("collapse", "sliding")


def is_meshed(answer: Answer) -> bool:
    """Whether its blocks have hexahedra; else they are solids with flat contact patches."""
    return isinstance(answer.details.blocks, Assembly)


# ---------------------------------------------------------------------------------------------
# Files


def write_rigid(answer: Answer, outputs: Outputs) -> None:
    """Write contacts, pictures and joints beside the answer; nothing without a folder."""
    if not is_meshed(answer):
        outputs.write("contacts", "contacts.vtu", lambda path: write_contacts(answer, path))
    for name, draw in rigid_pictures(answer).items():
        outputs.write("picture", name, draw)
    if answer.details.holds:
        write_joints(answer.details.joints, outputs, answer.details.blocks.names)
        cut = answer.parts.get("sections")
        write_sections(cut if isinstance(cut, SectionForces) else None, outputs)


def rigid_pictures(answer: Answer) -> dict[str, Callable[[Path], None]]:
    """Pictures of a rigid answer by the names of their files."""
    from validation.output.pictures.assemblies import draw_mechanism, draw_pressures
    from validation.output.pictures.polyhedra import draw_polyhedra

    result: dict[str, Callable[[Path], None]] = {}
    meshed = is_meshed(answer)
    if not meshed:
        result["contacts.png"] = partial(draw_polyhedra, answer)
    elif answer.details.holds:
        result["contact_pressures.png"] = partial(draw_pressures, answer)
    if "mechanism" in answer.fields:
        result["mechanism.png"] = partial(draw_mechanism, answer)
    return result


def write_contacts(answer: Answer, path: Path) -> None:
    """Write the contact polygons with pressures, normals and blocks as `.vtu` triangles."""
    interfaces = answer.details.blocks.interfaces
    polygons, patches = interfaces.polygons, interfaces.patches
    triangles, owner = polygons.triangles
    patch = polygons.patch[owner]
    carried = {}
    if contacts := answer.contacts:  # an attempt that failed is no field
        traction = contacts["force"] / contacts["area"][:, None]
        carried = {
            "patch_pressure": contacts["pressure"][patch],
            "patch_traction": traction[patch],
        }
    write_cells(
        path,
        polygons.corners,
        "triangle",
        triangles,
        cell_data={
            **carried,
            "normal": patches.normals[patch],
            "block_m": patches.block_m[patch].astype(np.int32),
            "block_s": patches.block_s[patch].astype(np.int32),
        },
    )


# ---------------------------------------------------------------------------------------------
# The table


def rigid_table(answer: Answer) -> RowTable:
    """Verdict, measures, proof and times of a rigid answer."""
    case = answer.case
    known = ("friction", "motion", "edges_and_corners", *_FIRST, "notes")
    others = [name for name in answer.parts if name not in known]
    first = [*_verdict_rows(answer), *_first_rows(answer), *part_rows(answer, *others)]
    proof = _proof_rows(answer)
    last = [*part_rows(answer, "notes"), cpu_row(answer.report["cpu_seconds"])]
    groups = _mesh_groups(answer) if is_meshed(answer) else _solid_groups(answer)
    return RowTable(
        f"{case.name}, rigid blocks: {case.scene.load_words}",
        [first, [*proof, *groups[0]], *groups[1:-1], [*groups[-1], *last]],
    )


def _verdict_rows(answer: Answer) -> list[Row]:
    """What was asked first: the verdict with friction, else that of the class."""
    result, moves = answer.details, part_rows(answer, "motion")
    rows = [] if result.friction is None else [Row("verdict", result.words)]
    if not is_meshed(answer):
        words = f"{verdict_words(answer)}{result.edges}"
        return [*(rows or [Row("verdict (frictionless)", words)]), *moves]
    rows.append(Row("kinematics (end rings fixed)", verdict_words(answer)))
    if result.supported_classification is not result.classification:
        supported = result.supported_classification.mechanism.words
        rows.append(Row("kinematics (supports of this load)", supported))
    return [*rows, *moves]


def verdict_words(answer: Answer) -> str:
    """Class of the blocks in words, without friction."""
    result = answer.details.classification
    verdict = "" if is_meshed(answer) else f"{'' if result.locked else 'not '}interlocked; "
    return f"{verdict}{result.mechanism.words}"


def _proof_rows(answer: Answer) -> list[Row]:
    """Proof of the verdict; with friction that of the class beside it, and of edges and corners."""
    rubbing, smooth = answer.details.friction, answer.details.classification.proof
    rows = [Row("proof", smooth)]
    if rubbing is not None:
        rows = [*rubbing.rows, Row("proof without friction", smooth)]
    beside = answer.details.edges_and_corners
    return rows if beside is None else [*rows, *beside.proof_rows]


def bare_words(answer: Answer) -> str:
    """Count the contacts without area by kind; empty where there is none."""
    bare = answer.details.bare_contacts
    kinds = ((CROSSING_EDGES, "edge–edge"), (STANDING_CORNER, "vertex–face"))
    words = [f"{bare[kind]} {name}" for kind, name in kinds if bare[kind]]
    return " and ".join(words) + " contacts" if words else ""


def _first_rows(answer: Answer) -> list[Row]:
    """The main results: equilibrium, largest pressure, forces, reaction."""
    result, measures = answer.details, answer.measures
    rubs = result.friction is not None
    status = result.equilibrium.status
    rows = [] if rubs else [Row("in equilibrium", status, result.equilibrium.residual)]
    rows += part_rows(answer, *_FIRST)

    def add(title: str, words: str, measure: Measure) -> None:
        rows.append(Row(title, words, measure.value, measure.unit))

    if "p_max_facet" in measures:
        peak = measures["p_max_facet"]
        add("largest contact pressure", pressure_words(peak), peak)
    if "crushing_factor" in measures:
        factor = measures["crushing_factor"]
        words = f"{factor.value_words}, {OF_RIGID_BLOCKS}"
        add(FACTORS["crushing_factor"].words, words, factor)
    if "least_joint_force" in measures:
        words = joint_force_words(measures, result.blocks)
        add("normal forces of joints", words, measures["largest_joint_force"])
    if "total_reaction" in measures:
        words = reaction_words(measures, answer.report["reaction"])
        add("total reaction", words, measures["total_reaction"])
        rows += support_rows(answer.report)
    rows += part_rows(answer, "edges_and_corners")
    if rubs and not is_meshed(answer):
        rows.append(Row("without friction", verdict_words(answer)))
    if measures:
        rows.append(Row("error bars", _NO_BARS))
    if result.holds and not result.of_load:
        words = "of one state that balances; whether the load brings it about is not proved"
        rows.append(Row("forces", words))
    return rows


def reaction_words(found: Mapping[str, Measure], force: list[float]) -> str:
    """Sum of the forces of fixed blocks; nothing where the load balances itself to round-off."""
    size = max(found[n].value for n in ("total_reaction", "largest_joint_force") if n in found)
    parts = [0.0 if abs(x) <= _NOISE * size else x for x in force]
    if not any(parts):
        return "0 N: the loads are self-equilibrated"
    return f"{found['total_reaction'].value_words}: ({', '.join(map(number, parts))})"


def pressure_words(peak: Measure) -> str:
    """Value of a mean over a facet, how large that is, and where."""
    if peak.place is None:
        return peak.value_words
    area = f"mean over a facet of {peak.place['facet_area']:.4g} mm²"
    return f"{peak.value_words}, {area}: {peak.place_words}"


def joint_force_words(found: Mapping[str, Measure], assembly: AnyBlocks) -> str:
    """Least and largest normal force between two blocks, and which blocks."""
    parts, noise = [], _NOISE * found["largest_joint_force"].value
    for word, name in (("least", "least_joint_force"), ("largest", "largest_joint_force")):
        where = found[name].place or {}
        joint = "–".join(map(assembly.named, where["blocks"]))
        force = found[name].value_words if abs(found[name].value) > noise else "0 N"
        parts.append(f"{word} {force} (joint {joint})")
    return ", ".join(parts)


def _mesh_groups(answer: Answer) -> list[list[Row]]:
    """Rows of blocks with hexahedra: none beside the proof; the paper's; contacts and solver."""
    result, case = answer.details, answer.case
    paper = result.shown_measures
    words = f'minimum-norm contact forces (norm = "{result.norm}"), solver "{case.method.solver}"'
    if result.equilibrium.iterations:
        words += f": {result.equilibrium.iterations} iterations"
    model = f"{result.n_blocks} free blocks, {result.n_contacts} contact facet pairs"
    return [
        [],
        [] if paper is None else paper_rows(paper, result.norm),
        [
            *dimension_rows(answer.report["dimensions"], case.limits),
            Row("model", model),
            Row("solution", words),
        ],
    ]


def paper_rows(found: Measures, norm: Norm) -> list[Row]:
    """The paper's measures: means over facets and blocks, which follow the facets."""
    number, area = found.effective_count_percent, found.effective_area_percent
    every, pooled = found.p_eff, found.p_eff_pooled
    over = "MPa, mean over the effective facets"
    return [
        Row("the paper's measures", f'means over facets and blocks, norm = "{norm}"'),
        Row("effective contact elements", f"{number:.2f} % (participation ratio)", number, "%"),
        Row("effective contact area", f"{area:.2f} % (the same by area)", area, "%"),
        Row("p_eff (formula)", f"{every:.5g} {over}, then over the blocks", every, "MPa"),
        Row("p_eff (tables)", f"{pooled:.5g} {over} of all blocks", pooled, "MPa"),
        Row("p_max", f"{found.p_max:.5g} MPa, mean of the block maxima", found.p_max, "MPa"),
    ]


def _solid_groups(answer: Answer) -> list[list[Row]]:
    """Rows of solids: forces of points and joints beside the proof; patches, how they mesh."""
    result = answer.details
    solids: PolyhedralAssembly = result.blocks
    forces, patches = result.normal_forces, solids.interfaces.patches
    shown = []
    if result.holds and forces.max(initial=0.0) > 0:
        if not result.patch_pressures.size:
            shown.append(Row("largest contact pressure", "none: edges and points have no area"))
        largest = float(forces.max())
        shown.append(Row("largest contact force", f"{number(largest)} N", largest, "N"))
        shown += joint_rows(result.joints, solids)
    bare = bare_words(answer)
    points = f", of which {bare}" if bare else ""
    model = (
        f"{solids.n_blocks} blocks, {result.n_blocks} of them free; "
        f"{solids.interfaces.n_contacts} contact points{points}"
    )
    joints = (
        f"{len(patches.areas)}, {patches.areas.sum():.5g} mm² in all; contact tolerance "
        f"{solids.tolerance:.3g} mm"
    )
    rows = [Row("model", model), Row("contact patches", joints), *_curved_rows(solids)]
    rows += dimension_rows(answer.report["dimensions"], answer.case.limits)
    return [shown, [*rows, Row("volume mesh", volume_words(answer))]]


def _curved_rows(solids: PolyhedralAssembly) -> list[Row]:
    """How wide the contact of curved faces is taken: it grows with the tolerance."""
    patches = solids.interfaces.patches
    curved = np.flatnonzero(patches.curved)
    if not curved.size:
        return []
    widths = patches.widths[curved]
    k, least, most = int(curved[widths.argmin()]), float(widths.min()), float(widths.max())
    words = (
        f"{least:.3g} mm wide between blocks {solids.named(patches.block_m[k])} and "
        f"{solids.named(patches.block_s[k])}, up to {most:.3g} mm: where gaps are within the "
        "contact tolerance"
    )
    return [Row("contact of curved faces", words, least, "mm")]


def volume_words(answer: Answer) -> str:
    """Describe how `tubelock fem` meshes the blocks."""
    from geometry.files.block_files import SURFACES_ALONE
    from geometry.files.hexahedral_solids import six_sided_hexahedra

    scene, shapes = answer.case.scene, answer.details.blocks.shapes
    surfaces = {".stl", ".ply", ".off", *SURFACES_ALONE}
    if any(Path(part.file).suffix.lower() not in surfaces for part in scene.files):
        return "hexahedra of the files, where they have them"
    other = sum(six_sided_hexahedra(shape, 1) is None for shape in shapes)
    if not other:
        return "hexahedral meshing possible: every block has six flat sides"
    return f"{other} of {len(shapes)} shapes: tetrahedra, each split into four hexahedra"


def joint_rows(joints: JointResultants, assembly: AnyBlocks) -> list[Row]:
    """The largest resultants of joints, and where they are."""
    eccentricity = np.linalg.norm(joints.eccentricity, axis=1)
    rows = []
    for name, values, unit in (
        ("shear force T", joints.shear_force, "N"),
        ("bending moment M", joints.bending_moment, "N mm"),
        ("eccentricity M/N", eccentricity, "mm"),
    ):
        k = int(np.argmax(values))
        blocks = "–".join(assembly.named(int(b)) for b in (joints.block_m[k], joints.block_s[k]))
        if values[k] > _NOISE * max(float(joints.normal_force.max()), 1e-300):
            words = f"{number(values[k])} {unit} (joint {blocks})"
            rows.append(Row(f"largest {name}", words, float(values[k]), unit))
    return rows


# ---------------------------------------------------------------------------------------------
# Explosions


def explosion_table(run: Explosion) -> RowTable:
    """The verdict of a radial disassembly and its numbers."""
    first, finite = run.first, run.finite
    admissible = "admissible" if first.admissible else "not admissible"
    rate = (
        f"{admissible}: smallest gap rate {first.smallest_gap_rate:.4g} mm per mm outward; "
        f"{first.closing_area_percent:.1f} % of the contact area closes, "
        f"{first.opening_area_percent:.1f} % opens"
    )
    last = finite.distances[-1]
    if finite.first_overlap is None:
        motion = f"free up to {last:g} mm (one wall thickness), the largest distance computed"
    else:
        motion = (
            f"free up to {finite.free_distance:.3g} mm, then blocks overlap by more than "
            f"{finite.tolerance:g} mm; {finite.depths[-1]:.3g} mm at {last:g} mm"
        )
    held = "carried by the contacts alone"
    if not first.held_together:
        held = "drives a mechanism (twist and elongation of the tube included)"
    verdict = "disassembles radially" if run.explodes else "does not disassemble radially"
    rows = [
        Row("verdict", verdict),
        Row("first order, end rings released", rate, first.smallest_gap_rate),
        Row("finite motion", motion, finite.free_distance, "mm"),
        Row("outward push, end rings fixed", f"{run.held}"),
        Row("outward push, no supports", held),
        Row("CPU seconds", f"{run.cpu_seconds:.2f}", run.cpu_seconds, "s"),
    ]
    return RowTable(f"{run.name}: radial disassembly test", [rows])
