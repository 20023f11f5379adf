"""What a file may mean in another way than it was read: repairs, and which way is up."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geometry.assembly import AnyBlocks
from geometry.files.named_surfaces import left_out
from validation.build.polyhedra import file_solids
from validation.scene.polyhedra import MeshScene, PolyhedralScene

#: Supports lie to one side where they are this part of the assembly away across gravity, and
#: farther than below.
_ASIDE = 0.25


def doubts(scene: PolyhedralScene, assembly: AnyBlocks, folder: Path) -> dict[str, str]:
    """Rows that say what was changed or left out of files, and what looks turned; by name."""
    rows = {}
    if isinstance(scene, MeshScene):
        out = [f"{Path(part.file).name}: {one}" for part in scene.parts for one in part.leave_out]
        for file in dict.fromkeys(part.file for part in scene.parts):
            out += [f"{Path(file).name}: {one}" for one in left_out(folder / file)]
        if out:
            rows["left out"] = ", ".join(out)
        if scene.block.repair:
            rows["repaired"] = _repairs(scene, folder)
        aside = _supports_aside(scene, assembly)
        if aside:
            rows["which way is up"] = aside
    return rows


def _repairs(scene: MeshScene, folder: Path) -> str:
    changed = [
        f"{solid.name}: {', '.join(solid.repairs)}"
        for part in {part.file: part for part in scene.parts}.values()
        for solid in file_solids(scene, part, folder)
        if solid.repairs
    ]
    return "; ".join(changed) or "nothing had to be changed"


def _supports_aside(scene: MeshScene, assembly: AnyBlocks) -> str:
    """Words where all supports lie beside the free blocks and not below, above or around them."""
    gravity = scene.effects.gravity
    if gravity is None or not np.any(gravity):
        return ""
    down = np.array(gravity) / np.linalg.norm(gravity)
    free, held = assembly.centroids[~assembly.fixed], assembly.centroids[assembly.fixed]
    away = held.mean(axis=0) - free.mean(axis=0)
    across = away - (away @ down) * down
    distance = float(np.linalg.norm(across))
    reach = float(np.linalg.norm(np.ptp(assembly.centroids, axis=0)))
    if distance <= max(_ASIDE * reach, abs(float(away @ down))):
        return ""
    if (held @ across).min() <= (free @ across).mean():
        return ""
    axis = int(np.argmax(np.abs(across)))
    side = f"{'-+'[int(across[axis] > 0)]}{'xyz'[axis]}"
    remedy = "" if scene.block.up == "y" else ': for a file with y up, set block.up = "y"'
    return f"doubtful: every support lies on the {side} side of the free blocks, gravity along " + (
        f"{np.round(down, 3).tolist()}{remedy}"
    )
