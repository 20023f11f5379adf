"""What a run with curved elements leaves: fields for ParaView, pictures, its numbers as text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console

from fem.element.lagrange_stress import grid_places
from fem.static.lagrange_fields import lagrange_cells
from geometry.assembly import Assembly
from geometry.files.mesh_io import write_lagrange_cells
from validation.output.console import two_columns
from validation.output.deformable.answers import add_measures, cap_words, write_state_files
from validation.output.deformable.fields import principal_stresses
from validation.output.outputs import Outputs
from validation.run.curved.fields import CurvedFields
from validation.run.curved.solve import CurvedRun


def print_curved(run: CurvedRun, console: Console) -> None:
    """Print the numbers of a run with curved elements."""
    table = two_columns(run.title)
    for k, (solved, seconds) in enumerate(zip(run.meshes, run.seconds, strict=True)):
        across, around, along = (len(line) - 1 for line in solved.lines)
        table.add_row(
            "" if k else "meshes, CPU seconds",
            f"{around} × {across} × {along} elements of degree {solved.degree}, "
            f"{solved.n_unknowns} unknowns: {seconds:.2f}",
        )
    table.add_row("Newton iterations", f"{run.state.iterations}")
    table.add_row("force residual", f"{run.state.residual:.2e}")
    add_measures(table, run.measures)
    if run.cap is not None:
        table.add_row("cap of the contact law", cap_words(run.cap))
    table.add_row("errors", run.estimate)
    table.add_row("CPU seconds", f"{sum(run.seconds):.3f}")
    console.print(table)


def write_curved_files(run: CurvedRun, fields: CurvedFields, outputs: Outputs) -> None:
    """Write fields of the elements, and pictures at the nodes of ``[mesh]``."""
    outputs.write("fields", "fields.vtu", lambda path: _write_fields(run, fields, path))
    write_state_files(fields, outputs)


def _write_fields(run: CurvedRun, fields: CurvedFields, path: Path) -> None:
    """Elements of the first block of each layer as Lagrange cells with nodes of their own."""
    cells = lagrange_cells(run.state)
    deformable = fields.deformable
    assembly: Assembly = deformable.assembly
    layers = np.arange(1, run.scene.assembly.layers + 1)
    blocks = np.array([np.flatnonzero(assembly.layer == layer)[0] for layer in layers])
    group, copies = deformable.model.groups[0], deformable.copy_of[blocks]
    turns = group.rotations[copies][:, None, None]
    placed = (turns @ cells.positions[..., None])[..., 0]
    moved = (turns @ cells.displacement[..., None])[..., 0]
    n_elements = cells.positions.shape[0]
    write_lagrange_cells(
        path,
        (placed + group.translations[copies, None, None]).reshape(-1, *placed.shape[2:]),
        grid_places(cells.degree),
        {
            "displacement": moved.reshape(-1, 3),
            **principal_stresses([cells.principal]),
        },
        {
            "block": np.repeat(blocks, n_elements).astype(np.int32),
            "layer": np.repeat(layers, n_elements).astype(np.int32),
        },
    )
