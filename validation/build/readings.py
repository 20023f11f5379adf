"""What a file may mean in another way than it was read: repairs, and which way is up."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from geometry.answer import Answer
from geometry.mesh import FloatArray
from geometry.parts.placed import AnyBlocks
from geometry.polyhedra.assembly import PolyhedralAssembly, bare_joints
from geometry.polyhedra.near_joints import facing_surfaces
from geometry.polyhedra.overlap import largest_tolerance
from geometry.polyhedra.polyhedron import Polyhedron
from validation.build.polyhedra import build_polyhedra, file_solids, parts_left_out
from validation.scene.families.mesh import MeshScene
from validation.scene.polyhedra import STRAIGHT_EDGES, PolyhedralScene

#: Part of a volume that facets may leave out unsaid.
_LEFT_OUT = 1e-3
#: Part of the facing area that may be without contact unsaid.
_MISSING = 0.01
#: Supports lie to one side where they are this part of the assembly away across gravity, and
#: farther than below.
_ASIDE = 0.25
#: Rounding of heights, as a part of the assembly, of supports that lie wholly below.
_LEVEL = 1e-3


def solid_notes(scene: PolyhedralScene, answer: Answer) -> Iterator[tuple[str, str]]:
    """What an answer says of solids that no key does, by the name of the row."""
    if answer.method == "rigid":
        blocks = answer.details.blocks
        solids = blocks if isinstance(blocks, PolyhedralAssembly) else None  # compare: facets
        if solids is not None and any(shape.straightened for shape in solids.shapes):
            yield "edges", STRAIGHT_EDGES
        yield from _doubts(scene, blocks, solids).items()
        return
    system = answer.details.whole
    surfaces = build_polyhedra(scene) if system.meets else None
    yield from _doubts(scene, system.assembly, surfaces).items()
    bare = [] if surfaces is None else bare_joints(surfaces)
    if bare:
        m, s = map(system.assembly.named, bare[0])
        more = f" and {len(bare) - 1} more pairs" if len(bare) > 1 else ""
        yield (
            "edge contacts",
            f"left out: blocks {m} and {s}{more} touch along an edge or at a point alone",
        )


def _doubts(
    scene: PolyhedralScene,
    assembly: AnyBlocks,
    surfaces: PolyhedralAssembly | None,
) -> dict[str, str]:
    """Rows on what was changed or left out of files, what looks turned, and faces without contact.

    ``surfaces`` are the blocks as contacts were found on them; None where nothing was searched.
    """
    rows = {}
    pieces = None if isinstance(scene, MeshScene) else getattr(scene.stated, "flat_pieces", None)
    if pieces is not None:
        number, less = pieces
        rows["curved faces"] = (
            f"{number} flat pieces for each: volume and weight {100.0 * less:+.2g} %"
        )
    if isinstance(scene, MeshScene):
        out = parts_left_out(scene)
        if out:
            rows["left out"] = ", ".join(out)
        if scene.block.repair:
            rows["repaired"] = _repairs(scene)
        if surfaces is not None:
            flat = _facet_words(assembly, surfaces)
            if flat:
                rows["curved faces"] = flat
            facing = facing_words(surfaces)
            if facing:
                rows["facing area not in contact"] = facing
        aside = _supports_aside(scene, assembly)
        if aside:
            rows["which way is up"] = aside
    return rows


def _facet_words(assembly: AnyBlocks, solids: PolyhedralAssembly) -> str:
    """Words on what the facets of curved CAD faces leave out of the solids."""
    curved = [b for b in range(solids.n_blocks) if solids.shape(b).exact is not None]
    rigid = isinstance(assembly, PolyhedralAssembly)

    def less(block: int) -> float:
        solid = solids.shape(block)
        flat = replace(solid, exact=None) if rigid else assembly.shape(block)
        return float(flat.volume / solid.volume) - 1.0

    worst = max((less(block) for block in curved), key=abs, default=0.0)
    if abs(worst) <= _LEFT_OUT:
        return ""
    more = "more" if worst > 0.0 else "less"
    kept = (
        "volume and weight are exact, contact areas those of facets, which may lack more"
        if rigid
        else "so is their weight"
    )
    return (
        f"facets enclose up to {100.0 * abs(worst):.2g} % {more} than the blocks drawn: {kept}; a "
        "smaller block.element_size brings them nearer"
    )


def facing_words(surfaces: PolyhedralAssembly) -> str:
    """Words where a part of the surfaces that face each other is not in contact."""
    result = facing_surfaces(surfaces)
    if result.missing <= _MISSING * result.area:
        return ""
    worst = result.joints[0]
    pair = f"{surfaces.named(worst.block_m)} and {surfaces.named(worst.block_s)}"
    gap = max(joint.gap for joint in result.joints)
    apart = f", gaps up to {gap:.3g} mm" if gap else ""
    tolerance = float(f"{1.05 * gap:.2g}")
    remedy = "set detection.angle or detection.tolerance higher"
    if gap:
        remedy = f"set detection.tolerance = {tolerance:g}"
    if tolerance > largest_tolerance(surfaces):
        remedy = "move them together"
    return (
        f"{result.missing / result.area:.0%}: {result.missing:.4g} of {result.area:.4g} mm² at "
        f"{len(result.joints)} joints, most between blocks {pair}{apart}; if they are meant to "
        f"touch, {remedy}"
    )


def _repairs(scene: MeshScene) -> str:
    changed = [
        f"{solid.name}: {', '.join(solid.repairs)}"
        for part in {part.file: part for part in scene.parts}.values()
        for solid in file_solids(scene, part)
        if solid.repairs
    ]
    return "; ".join(changed) or "nothing had to be changed"


def _corners(assembly: AnyBlocks, block: int) -> FloatArray:
    """World coordinates of the points that span a block, (n, 3) [mm]."""
    shape = assembly.shape(block)
    at = shape.points if isinstance(shape, Polyhedron) else shape.mesh.nodes
    return assembly.place(block, at)


def _supports_aside(scene: MeshScene, assembly: AnyBlocks) -> str:
    """Words where all supports lie beside the free blocks and not below, above or around them."""
    gravity = scene.effects.gravity
    if gravity is None or not np.any(gravity) or not assembly.fixed.any():
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
    lowest = [float((_corners(assembly, k) @ down).max()) for k in assembly.free_blocks.tolist()]
    tops = [
        float((_corners(assembly, k) @ down).min()) for k in np.flatnonzero(assembly.fixed).tolist()
    ]
    if min(tops) >= max(lowest) - _LEVEL * reach:  # they stand below, if aside
        return ""
    axis = int(np.argmax(np.abs(across)))
    side = f"{'-+'[int(across[axis] > 0)]}{'xyz'[axis]}"
    remedy = "" if scene.block.up == "y" else ': for a file with y up, set block.up = "y"'
    return f"doubtful: every support lies on the {side} side of the free blocks, gravity along " + (
        f"{np.round(down, 3).tolist()}{remedy}"
    )
