"""The rigid answer of triangulated blocks as text and files."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from geometry.files.block_files import SURFACES_ALONE
from geometry.files.hexahedral_solids import six_sided_hexahedra
from geometry.files.mesh_io import write_triangles
from geometry.measures import JointResultants
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.facet_contact import CROSSING_EDGES, STANDING_CORNER
from validation.output import answer_files
from validation.output.console import add_dimensions, two_columns
from validation.output.joints import JOINT_FILES, write_joints
from validation.output.outputs import Outputs
from validation.output.pictures.polyhedra import draw_polyhedra, draw_polyhedral_mechanism
from validation.output.rigid.words import (
    CLASS_WORDS,
    add_first_rows,
    add_further_rows,
    add_verdict,
    certificate_words,
    held_words,
)
from validation.output.section_forces import SECTION_FILES, write_sections
from validation.run.rigid.polyhedra import PolyhedralRun
from validation.run.rigid.push import limit_words
from validation.run.stages import cpu_words
from validation.scene.polyhedra import STRAIGHT_EDGES, MeshScene

#: Resultants below this part of the largest normal force are round-off.
_NOTHING = 1e-9
#: Files that hold surfaces alone.
_SURFACES = {".stl", ".ply", ".off", *SURFACES_ALONE}
#: Files of a rigid result.
FILES = (
    *answer_files.FILES,
    "contacts.vtu",
    "contacts.png",
    "mechanism.png",
    *JOINT_FILES,
    *SECTION_FILES,
)


def write_rigid(run: PolyhedralRun, outputs: Outputs) -> None:
    """Write contacts as field and picture, and the mechanism where there is one."""
    outputs.write("contacts", "contacts.vtu", lambda path: write_contacts(run, path))
    for name, draw in rigid_pictures(run).items():
        outputs.write("picture", name, draw)
    if run.carried.shown:
        write_joints(run.joints, outputs, run.assembly.names)
        write_sections(run.sections, outputs)


def rigid_pictures(run: PolyhedralRun) -> dict[str, Callable[[Path], None]]:
    """Pictures of a rigid result by the names of their files."""
    result: dict[str, Callable[[Path], None]] = {"contacts.png": partial(draw_polyhedra, run)}
    if "mechanism" in run.answer.fields:
        result["mechanism.png"] = partial(draw_polyhedral_mechanism, run)
    return result


def print_rigid(run: PolyhedralRun, console: Console) -> None:
    """Print verdict, proof, equilibrium and contacts."""
    result, interfaces = run.result, run.assembly.interfaces
    table = two_columns(f"{run.name}, rigid blocks: {run.scene.load_words}")
    add_verdict(table, run, ("verdict (frictionless)", "without friction"), verdict_words(run))
    if run.held is not None:
        table.add_row("resistance to pushes", held_words(run))
    add_first_rows(table, run)
    add_further_rows(table, run.further)
    if run.push is not None:
        table.add_row("limit of the push", f"{limit_words(run.push)} (by faces alone)")
    table.add_section()
    table.add_row("proof", certificate_words(result.classification))
    if run.faces is not None:
        table.add_row("by faces alone", CLASS_WORDS[run.faces.mechanism])
        table.add_row("proof for the faces", certificate_words(run.faces))
    forces = run.carried.normal_forces
    if run.carried.shown and forces.max(initial=0.0) > 0:
        if not run.patch_pressures.size:
            table.add_row("largest contact pressure", "none: edges and points have no area")
        table.add_row("largest contact force", f"{forces.max():.5g} N")
        for words, value in joint_words(run.joints, run.assembly):
            table.add_row(words, value)
    table.add_section()
    bare = bare_words(run)
    points = f", of which {bare}" if bare else ""
    table.add_row(
        "model",
        f"{run.assembly.n_blocks} blocks, {result.n_blocks} of them free; "
        f"{interfaces.n_contacts} contact points{points}",
    )
    table.add_row(
        "contact patches",
        f"{len(interfaces.patches.areas)}, {interfaces.patches.areas.sum():.5g} mm² in all; "
        f"contact tolerance {run.assembly.tolerance:.3g} mm",
    )
    add_dimensions(table, run.answer.report["dimensions"], run.scene.limits)
    table.add_row("volume mesh", volume_words(run))
    if run.straightened:
        table.add_row("edges", STRAIGHT_EDGES)
    for name, words in run.doubts.items():
        table.add_row(name, words)
    table.add_row("CPU seconds", cpu_words(run.cpu_seconds))
    console.print(table)


def bare_words(run: PolyhedralRun) -> str:
    """Count the contacts without area by kind; empty where there is none."""
    crossing, standing = run.bare_contacts[CROSSING_EDGES], run.bare_contacts[STANDING_CORNER]
    words = [f"{crossing} edge–edge"] if crossing else []
    words += [f"{standing} vertex–face"] if standing else []
    return " and ".join(words) + " contacts" if words else ""


def verdict_words(run: PolyhedralRun) -> str:
    """State the verdict; by faces alone where edge and vertex contacts change it."""
    result = run.result.classification
    verdict = "interlocked" if result.locked else "not interlocked"
    if run.faces is None or run.faces.mechanism is result.mechanism:
        return f"{verdict}; {CLASS_WORDS[result.mechanism]}"
    if result.locked:
        verdict = "interlocked by edge and vertex contacts"
    words = f"{result.mechanism} by {bare_words(run)}; by faces alone: {run.faces.mechanism}"
    return f"{verdict}: {words}"


def volume_words(run: PolyhedralRun) -> str:
    """Describe how `tubelock fem` meshes the blocks."""
    parts = run.scene.parts if isinstance(run.scene, MeshScene) else ()
    if any(Path(part.file).suffix.lower() not in _SURFACES for part in parts):
        return "hexahedra of the files, where they have them"
    shapes = run.assembly.shapes
    other = sum(six_sided_hexahedra(shape, 1) is None for shape in shapes)
    if not other:
        return "hexahedral meshing possible: every block has six flat sides"
    return f"{other} of {len(shapes)} shapes: tetrahedra, each split into four hexahedra"


def joint_words(joints: JointResultants, assembly: PolyhedralAssembly) -> list[tuple[str, str]]:
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
        if values[k] > _NOTHING * max(float(joints.normal_force.max()), 1e-300):
            rows.append((f"largest {name}", f"{values[k]:.5g} {unit} (joint {blocks})"))
    return rows


def write_contacts(run: PolyhedralRun, path: Path) -> None:
    """Write the contact polygons with pressures, normals and blocks as `.vtu` triangles."""
    interfaces = run.assembly.interfaces
    polygons, patches = interfaces.polygons, interfaces.patches
    triangles, owner = polygons.triangles
    patch = polygons.patch[owner]
    carried = {}
    if contacts := run.answer.contacts:  # an attempt that failed is no field
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
