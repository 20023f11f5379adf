"""Answers of rigid blocks as text and files, of meshes and of solids: pressures, mechanisms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

from geometry.answer import FACTORS, Answer, Measure
from geometry.assembly import AnyBlocks, Assembly
from geometry.files.block_files import SURFACES_ALONE
from geometry.files.hexahedral_solids import six_sided_hexahedra
from geometry.files.mesh_io import write_triangles
from geometry.parts.measures import JointResultants, Measures, SectionForces
from geometry.polyhedra.facet_contact import CROSSING_EDGES, STANDING_CORNER
from mbd.options import Norm
from validation.output import answer_files
from validation.output.console import add_dimensions, cpu_words, two_columns
from validation.output.forces import (
    JOINT_FILES,
    SECTION_FILES,
    add_reactions,
    write_joints,
    write_sections,
)
from validation.output.outputs import Outputs
from validation.output.pictures.assemblies import draw_mechanism, draw_pressures
from validation.output.pictures.polyhedra import draw_polyhedra
from validation.scene.polyhedra import MeshScene

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly

    # Machine code that no other rigid answer needs comes with it.
    from validation.run.rigid.explosion import Explosion

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
#: Files that hold surfaces alone.
_SURFACES = {".stl", ".ply", ".off", *SURFACES_ALONE}
#: What a load factor of rigid blocks is.
OF_RIGID_BLOCKS = "by mean pressures of facets of rigid blocks, without peaks"
#: Parts whose rows stand among the first, and those that stand beside the proof.
_FIRST, _PROOFS = ("collapse", "sliding"), ("by_faces_alone",)


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
    if answer.details.shown:
        write_joints(answer.details.joints, outputs, answer.details.blocks.names)
        cut = answer.parts.get("sections")
        write_sections(cut if isinstance(cut, SectionForces) else None, outputs)


def rigid_pictures(answer: Answer) -> dict[str, Callable[[Path], None]]:
    """Pictures of a rigid answer by the names of their files."""
    result: dict[str, Callable[[Path], None]] = {}
    meshed = is_meshed(answer)
    if not meshed:
        result["contacts.png"] = partial(draw_polyhedra, answer)
    elif answer.details.shown:
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
    write_triangles(
        path,
        polygons.corners,
        triangles,
        {
            **carried,
            "normal": patches.normals[patch],
            "block_m": patches.block_m[patch].astype(np.int32),
            "block_s": patches.block_s[patch].astype(np.int32),
        },
    )


# ---------------------------------------------------------------------------------------------
# The table


def print_rigid(answer: Answer, console: Console) -> None:
    """Print verdict, measures, proof and times of a rigid answer."""
    result, case = answer.details, answer.case
    table = two_columns(f"{case.name}, rigid blocks: {case.scene.load_words}")
    _add_verdict(table, answer)
    _add_first_rows(table, answer)
    others = [name for name in answer.parts if name not in ("friction", *_FIRST, *_PROOFS, "notes")]
    _add_parts(table, answer, others)
    table.add_section()
    table.add_row("proof", result.classification.proof)
    _add_parts(table, answer, _PROOFS)
    if is_meshed(answer):
        _add_mesh(table, answer)
    else:
        _add_solids(table, answer)
    _add_parts(table, answer, ("notes",))
    table.add_row("CPU seconds", cpu_words(answer.report["cpu_seconds"]))
    console.print(table)


def _add_parts(table: Table, answer: Answer, names: tuple[str, ...] | list[str]) -> None:
    for name in names:
        for title, words in answer.parts[name].rows if name in answer.parts else ():
            table.add_row(title, words)


def _add_verdict(table: Table, answer: Answer) -> None:
    """Add what was asked first: the verdict with friction, else that of the class."""
    result, rubbing = answer.details, answer.parts.get("friction")
    if rubbing is not None:
        table.add_row(*rubbing.rows[0])
    if not is_meshed(answer):
        if rubbing is None:
            table.add_row("verdict (frictionless)", verdict_words(answer))
        return
    table.add_row("kinematics (end rings fixed)", verdict_words(answer))
    if result.supported_classification is not result.classification:
        supported = result.supported_classification.mechanism.words
        table.add_row("kinematics (supports of this load)", supported)


def verdict_words(answer: Answer) -> str:
    """Class of the blocks in words; by faces alone where edge and vertex contacts change it."""
    result, faces = answer.details.classification, answer.parts.get("by_faces_alone")
    if is_meshed(answer):
        return str(result.mechanism.words)
    verdict = "interlocked" if result.locked else "not interlocked"
    other = None if faces is None else faces.classification.mechanism  # type: ignore[attr-defined]
    if other is None or other is result.mechanism:
        return f"{verdict}; {result.mechanism.words}"
    if result.locked:
        verdict = "interlocked by edge and vertex contacts"
    return f"{verdict}: {result.mechanism} by {bare_words(answer)}; by faces alone: {other}"


def bare_words(answer: Answer) -> str:
    """Count the contacts without area by kind; empty where there is none."""
    bare = answer.details.bare_contacts
    kinds = ((CROSSING_EDGES, "edge–edge"), (STANDING_CORNER, "vertex–face"))
    words = [f"{bare[kind]} {name}" for kind, name in kinds if bare[kind]]
    return " and ".join(words) + " contacts" if words else ""


def _add_first_rows(table: Table, answer: Answer) -> None:
    """Add the main results: equilibrium, largest pressure, forces, reaction."""
    result, measures = answer.details, answer.measures
    if result.friction is None:
        table.add_row("in equilibrium", result.equilibrium.status)
    _add_parts(table, answer, _FIRST)
    if "p_max_facet" in measures:
        table.add_row("largest contact pressure", pressure_words(measures["p_max_facet"]))
    if "crushing_factor" in measures:
        words = f"{measures['crushing_factor'].value_words}, {OF_RIGID_BLOCKS}"
        table.add_row(FACTORS["crushing_factor"].words, words)
    if "least_joint_force" in measures:
        table.add_row("normal forces of joints", joint_force_words(measures, result.blocks))
    if "total_reaction" in measures:
        table.add_row("total reaction", reaction_words(measures, answer.report["reaction"]))
        add_reactions(table, answer.report)
    for row in answer.parts["friction"].rows[1:] if result.friction is not None else ():
        table.add_row(*row)
    if result.friction is not None and not is_meshed(answer):
        table.add_row("without friction", verdict_words(answer))
    if result.holds and not result.shown:
        table.add_row("forces", "none of the load alone: they follow from what presses before")


def reaction_words(found: Mapping[str, Measure], force: list[float]) -> str:
    """Sum of the forces of fixed blocks; nothing where the load balances itself to round-off."""
    size = max(found[n].value for n in ("total_reaction", "largest_joint_force") if n in found)
    parts = [0.0 if abs(x) <= _NOISE * size else x for x in force]
    if not any(parts):
        return "0 N: the loads are self-equilibrated"
    return f"{found['total_reaction'].value_words}: ({', '.join(f'{x:.5g}' for x in parts)})"


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


def _add_mesh(table: Table, answer: Answer) -> None:
    """Add what blocks with hexahedra have: the paper's measures, contacts and solver."""
    result, case = answer.details, answer.case
    if result.shown_measures is not None:
        add_paper_rows(table, result.shown_measures, result.norm)
    add_dimensions(table, answer.report["dimensions"], case.limits)
    table.add_row(
        "model", f"{result.n_blocks} free blocks, {result.n_contacts} contact facet pairs"
    )
    words = f'minimum-norm contact forces (norm = "{result.norm}"), solver "{case.method.solver}"'
    if result.equilibrium.iterations:
        words += f": {result.equilibrium.iterations} iterations"
    table.add_row("solution", words)


def add_paper_rows(table: Table, found: Measures, norm: Norm) -> None:
    """Add the paper's measures: means over facets and blocks, which follow the facets."""
    table.add_section()
    table.add_row("the paper's measures", f'means over facets and blocks, norm = "{norm}"')
    table.add_row(
        "effective contact elements", f"{found.effective_count_percent:.2f} % (participation ratio)"
    )
    table.add_row(
        "effective contact area", f"{found.effective_area_percent:.2f} % (the same by area)"
    )
    table.add_row(
        "p_eff (formula)",
        f"{found.p_eff:.5g} MPa, mean over the effective facets, then over the blocks",
    )
    table.add_row(
        "p_eff (tables)",
        f"{found.p_eff_pooled:.5g} MPa, mean over the effective facets of all blocks",
    )
    table.add_row("p_max", f"{found.p_max:.5g} MPa, mean of the block maxima")
    table.add_section()


def _add_solids(table: Table, answer: Answer) -> None:
    """Add what solids have: forces of points and joints, patches, how they are meshed."""
    result = answer.details
    solids: PolyhedralAssembly = result.blocks
    forces, patches = result.normal_forces, solids.interfaces.patches
    if result.shown and forces.max(initial=0.0) > 0:
        if not result.patch_pressures.size:
            table.add_row("largest contact pressure", "none: edges and points have no area")
        table.add_row("largest contact force", f"{forces.max():.5g} N")
        for words, value in joint_words(result.joints, solids):
            table.add_row(words, value)
    table.add_section()
    bare = bare_words(answer)
    points = f", of which {bare}" if bare else ""
    table.add_row(
        "model",
        f"{solids.n_blocks} blocks, {result.n_blocks} of them free; "
        f"{solids.interfaces.n_contacts} contact points{points}",
    )
    table.add_row(
        "contact patches",
        f"{len(patches.areas)}, {patches.areas.sum():.5g} mm² in all; contact tolerance "
        f"{solids.tolerance:.3g} mm",
    )
    add_dimensions(table, answer.report["dimensions"], answer.case.limits)
    table.add_row("volume mesh", volume_words(answer))


def volume_words(answer: Answer) -> str:
    """Describe how `tubelock fem` meshes the blocks."""
    scene, shapes = answer.case.scene, answer.details.blocks.shapes
    parts = scene.parts if isinstance(scene, MeshScene) else ()
    if any(Path(part.file).suffix.lower() not in _SURFACES for part in parts):
        return "hexahedra of the files, where they have them"
    other = sum(six_sided_hexahedra(shape, 1) is None for shape in shapes)
    if not other:
        return "hexahedral meshing possible: every block has six flat sides"
    return f"{other} of {len(shapes)} shapes: tetrahedra, each split into four hexahedra"


def joint_words(joints: JointResultants, assembly: AnyBlocks) -> list[tuple[str, str]]:
    """Locate the largest resultants of joints."""
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
            rows.append((f"largest {name}", f"{values[k]:.5g} {unit} (joint {blocks})"))
    return rows


# ---------------------------------------------------------------------------------------------
# Explosions


def print_explosion(run: Explosion, console: Console) -> None:
    """Print the verdict and its numbers."""
    first, finite = run.first, run.finite
    table = two_columns(f"{run.name}: radial disassembly test")
    table.add_row(
        "verdict", "disassembles radially" if run.explodes else "does not disassemble radially"
    )
    words = "admissible" if first.admissible else "not admissible"
    table.add_row(
        "first order, end rings released",
        f"{words}: smallest gap rate {first.smallest_gap_rate:.4g} mm per mm outward; "
        f"{first.closing_area_percent:.1f} % of the contact area closes, "
        f"{first.opening_area_percent:.1f} % opens",
    )
    last = finite.distances[-1]
    if finite.first_overlap is None:
        words = f"free up to {last:g} mm (one wall thickness), the largest distance computed"
    else:
        words = (
            f"free up to {finite.free_distance:.3g} mm, then blocks overlap by more than "
            f"{finite.tolerance:g} mm; {finite.depths[-1]:.3g} mm at {last:g} mm"
        )
    table.add_row("finite motion", words)
    table.add_row("outward push, end rings fixed", f"{run.held}")
    table.add_row(
        "outward push, no supports",
        "carried by the contacts alone"
        if first.held_together
        else "drives a mechanism (twist and elongation of the tube included)",
    )
    table.add_row("CPU seconds", f"{run.cpu_seconds:.2f}")
    console.print(table)
