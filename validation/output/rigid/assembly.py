"""Rigid-block results as text and files: pressures, mechanisms, explosions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from mbd import Measures
from mbd.options import Norm
from validation.output import answer_files
from validation.output.console import add_dimensions, two_columns
from validation.output.joints import JOINT_FILES, write_joints
from validation.output.outputs import Outputs
from validation.output.pictures.assemblies import draw_mechanism, draw_pressures
from validation.output.rigid.words import (
    CLASS_WORDS,
    add_first_rows,
    add_further_rows,
    add_verdict,
    certificate_words,
    held_words,
    ring_words,
)
from validation.output.section_forces import SECTION_FILES, write_sections
from validation.run.rigid.answer import RigidRun
from validation.run.stages import cpu_words

if TYPE_CHECKING:
    # Machine code that no other rigid answer needs comes with it.
    from validation.run.rigid.explosion import Explosion

#: Files of a rigid result.
FILES = (
    *answer_files.FILES,
    "contact_pressures.png",
    "mechanism.png",
    *JOINT_FILES,
    *SECTION_FILES,
)


def write_rigid(run: RigidRun, outputs: Outputs) -> None:
    """Write pictures and joints beside the answer; nothing without a folder."""
    for name, draw in rigid_pictures(run).items():
        outputs.write("picture", name, draw)
    if run.carried.shown:
        write_joints(run.joints, outputs, run.assembly.names)
        write_sections(run.sections, outputs)


def rigid_pictures(run: RigidRun) -> dict[str, Callable[[Path], None]]:
    """Pictures of a rigid result by the names of their files."""
    result: dict[str, Callable[[Path], None]] = {}
    if run.carried.shown:
        result["contact_pressures.png"] = partial(draw_pressures, run)
    if "mechanism" in run.answer.fields:
        result["mechanism.png"] = partial(draw_mechanism, run)
    return result


def verdict_words(run: RigidRun) -> str:
    """Class of the blocks, in words."""
    return CLASS_WORDS[run.result.mechanism]


def print_rigid(run: RigidRun, console: Console) -> None:
    """Print class, residual, measures and times of a rigid result."""
    result, scene = run.result, run.scene
    table = two_columns(f"{run.name}, rigid blocks: {run.scene.load_words}")
    add_verdict(table, run, ("kinematics (end rings fixed)",) * 2, verdict_words(run))
    if result.supported_classification is not result.classification:
        supported = CLASS_WORDS[result.supported_classification.mechanism]
        table.add_row("kinematics (supports of this load)", supported)
    if run.held is not None:
        table.add_row("resistance to pushes", held_words(run))
    add_first_rows(table, run)
    ring = run.answer.report["ring_pressure"]
    if ring is not None:
        table.add_row("hoop stress p·r/t", ring_words(ring))
    add_further_rows(table, run.further)
    table.add_section()
    table.add_row("proof", certificate_words(result.classification))
    if run.carried.measures is not None:
        add_paper_rows(table, run.carried.measures, scene.rigid.norm)
    add_dimensions(table, run.answer.report["dimensions"], scene.limits)
    table.add_row(
        "model", f"{result.n_blocks} free blocks, {result.n_contacts} contact facet pairs"
    )
    table.add_row(
        "solution",
        f'minimum-norm contact forces (norm = "{scene.rigid.norm}"), solver '
        f'"{scene.rigid.solver}": {result.equilibrium.iterations} iterations',
    )
    table.add_row("CPU seconds", cpu_words(run.cpu_seconds))
    console.print(table)


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
    table.add_row(
        "p_max", f"{found.p_max:.5g} MPa, mean of the blocks' largest pressures (not the maximum)"
    )
    table.add_section()


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
