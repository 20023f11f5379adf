"""Answers of rigid blocks as text and files, of meshes and of solids: pressures, mechanisms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from geometry.answer import Answer
from geometry.assembly import Assembly
from geometry.files.mesh_io import write_cells
from geometry.parts.measures import SectionForces
from validation.output import answer_files
from validation.output.forces import (
    JOINT_FILES,
    SECTION_FILES,
    write_joints,
    write_sections,
)
from validation.output.outputs import Outputs

#: Files of a rigid answer.
FILES = (
    *answer_files.FILES,
    "contact_pressures.png",
    "contacts.vtu",
    "contacts.png",
    "mechanism.png",
    "explosion.png",
    "stages.png",
    *JOINT_FILES,
    *SECTION_FILES,
)


def is_meshed(answer: Answer) -> bool:
    """Whether its blocks have hexahedra; else they are solids with flat contact patches."""
    return isinstance(answer.details.blocks, Assembly)


# ---------------------------------------------------------------------------------------------
# Files


def write_rigid(answer: Answer, outputs: Outputs) -> None:
    """Write contacts, pictures and joints beside the answer; nothing without a folder."""
    if "disassembly" in answer.parts:
        from validation.output.pictures.polyhedra import draw_explosion

        explosion: Any = answer.parts["disassembly"]
        outputs.write("picture", "explosion.png", partial(draw_explosion, explosion))
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
    if "stages" in answer.parts:
        from validation.output.pictures.construction import draw_stages

        result["stages.png"] = partial(draw_stages, answer)
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
