"""Supports and loads on parts of surfaces, from scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geometry.files.named_sets import face_name
from geometry.loads import (
    FaceLoad,
    LineLoad,
    LoadCase,
    PressureLoad,
    TractionLoad,
)
from geometry.mesh import FloatArray, IntArray, QuadSurface
from geometry.parts.block_selection import chosen_block, chosen_blocks
from geometry.parts.placed import AnyBlocks
from geometry.parts.regions import (
    PUSH,
    Box,
    Edges,
    HeldFace,
    Plane,
    Where,
    blocks_with,
    first_met,
    local_nodes,
    region_nodes,
    region_quads,
)
from validation.errors import InputError
from validation.scene.read import DeformableScene
from validation.scene.supports import (
    PushSection,
    RegionSection,
    SupportSection,
    SurfaceLoadSection,
)

#: Share of the area of a region by which its vector area may fall short where it is flat.
_FLAT = 1e-6


def stated_load(scene: DeformableScene, assembly: AnyBlocks, load: LoadCase) -> LoadCase:
    """Put what ``[[supports]]``, ``[[loads]]`` and ``load.push`` state on top of a load."""
    supports, loads, push = scene.supports, scene.loads, scene.push
    _refuse_fixed(scene, assembly)
    held = [
        face for k, one in enumerate(supports) for face in _held(assembly, one, f"supports[{k}]")
    ]
    if push is not None:
        held.append(_pushed(assembly, push))
    faces, lines, wrenches = list(load.faces), list(load.lines), np.zeros((assembly.n_blocks, 6))
    for k, one in enumerate(loads):
        place = f"loads[{k}]"
        if one.per_length is not None:
            assert one.line is not None
            start, end = map(np.array, one.line)
            blocks = (
                np.arange(assembly.n_blocks)
                if one.blocks is None
                else chosen_blocks(f"{place}.blocks", one.blocks, assembly)
            )
            lines.append(LineLoad(blocks, start, end, np.array(one.per_length)))
        elif one.regions:
            faces.append(_face_load(assembly, one, place))
        else:
            _add_force(assembly, one, wrenches, place)
    result = replace(load, faces=tuple(faces), lines=tuple(lines), held=(*load.held, *held))
    if wrenches.any():
        result = result.with_wrenches(wrenches)
    _refuse_taken(assembly, result)
    return result


def _refuse_taken(assembly: AnyBlocks, load: LoadCase) -> None:
    """Reject a load that never reaches its block: supports hold its facets in its direction."""
    for held in load.held:
        if held.spring is not None:
            continue
        nodes = region_nodes(assembly, held.block, held.face)
        for facets in load.facets:
            mine = facets.block == held.block
            if not mine.any() or not np.isin(facets.quads[mine], nodes).all():
                continue
            forces = facets.forces[mine]
            left = forces - forces @ held.axes.T @ held.axes
            if forces.any() and np.abs(left).max() <= _FLAT * np.abs(forces).max():
                raise InputError(
                    f"supports: {held.title} holds the face of block {assembly.named(held.block)} "
                    "that is loaded, in the direction of the load, and nothing of the load reaches "
                    "the block; expected one of the two there"
                )


def _where(assembly: AnyBlocks, one: RegionSection) -> Where:
    """Region of a section; sets of a file have no upper case."""
    if one.face is not None:
        known = any(one.face in getattr(shape, "faces", ()) for shape in assembly.shapes)
        name = one.face if known else face_name(one.face)
        edges = [getattr(assembly.shape(b), "edge_sets", {}) for b in range(assembly.n_blocks)]
        places = [assembly.place(b, of[name]) for b, of in enumerate(edges) if name in of]
        return Edges(np.concatenate(places)) if places else name
    if one.box is not None:
        low, high = (np.array(corner) for corner in one.box)
        return Box(np.minimum(low, high), np.maximum(low, high))
    plane = one.plane
    assert plane is not None
    if plane.normal is not None:
        return Plane(np.array(plane.point), np.array(plane.normal))
    at = np.array([0.0 if value is None else value for value in (plane.x, plane.y, plane.z)])
    axis = [value is not None for value in (plane.x, plane.y, plane.z)].index(True)
    return Plane(at, np.eye(3)[axis])


def supported_blocks(scene: DeformableScene, assembly: AnyBlocks) -> IntArray:
    """Blocks parts of which ``[[supports]]`` hold, (n,)."""
    blocks = [
        _blocks(assembly, one, _where(assembly, one), f"supports[{k}]")
        for k, one in enumerate(scene.supports)
    ]
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *blocks]))


def _refuse_fixed(scene: DeformableScene, assembly: AnyBlocks) -> None:
    """Reject fixed blocks that are supported, loaded or pushed: nothing would come of it."""
    if scene.held_at_faces:
        return
    chosen = [(f"supports[{k}].blocks", one.blocks) for k, one in enumerate(scene.supports)]
    chosen += [(f"loads[{k}].blocks", one.blocks) for k, one in enumerate(scene.loads)]
    if scene.push is not None:
        chosen.append(("load.push.block", (scene.push.block,)))
    for key, blocks in chosen:
        result = chosen_blocks(key, blocks or (), assembly)
        fixed = result[assembly.fixed[result]]
        if len(fixed):
            raise InputError(
                f"{key}: block {assembly.named(int(fixed[0]))} is fixed; expected blocks that can "
                "move"
            )


def _blocks(assembly: AnyBlocks, one: RegionSection, where: Where, place: str) -> IntArray:
    """Blocks that are meant: those that are named, else all that have the region."""
    if one.blocks is not None:
        return chosen_blocks(f"{place}.blocks", one.blocks, assembly)
    result = blocks_with(assembly, where)
    result = result[~assembly.fixed[result]]
    if not len(result):
        faces = dict.fromkeys(
            name for shape in assembly.shapes for name in getattr(shape, "faces", ())
        )
        if isinstance(where, str):
            faces |= dict.fromkeys(
                name for shape in assembly.shapes for name in getattr(shape, "edge_sets", ())
            )
            names = f"faces are {', '.join(faces)}" if faces else "these blocks name none"
            raise InputError(
                f"{place}.face: no block that is not fixed has {one.face!r}; {names} (sets of a "
                "file are faces or edges where all their nodes are on a block's surface)"
            )
        raise InputError(
            f"{place}: no block that is not fixed has a surface node on {where}; expected "
            "coordinates in mm"
        )
    return result


def _held(assembly: AnyBlocks, one: SupportSection, place: str) -> list[HeldFace]:
    where = _where(assembly, one)
    if isinstance(where, Edges) and one.spring is not None:
        raise InputError(
            f"{place}.spring: {one.face!r} is an edge, which has no area; expected a face"
        )
    result = []
    for block in _blocks(assembly, one, where, place).tolist():
        if one.hold == "normal":
            directions: FloatArray | None = _normal(assembly, block, where, place)[None]
        else:
            axes = ["xyz".index(axis) for axis in one.hold]
            directions = None if len(axes) == 3 else np.eye(3)[axes]
        result.append(
            HeldFace(
                block,
                where,
                directions=directions,
                displacement=None if one.move is None else np.array(one.move),
                path=one.path,
                spring=one.spring,
                name=one.name or (str(one.face) if isinstance(where, Edges) else ""),
            )
        )
    return result


def _normal(assembly: AnyBlocks, block: int, where: Where, place: str) -> FloatArray:
    """Outward normal of a flat region of a block, (3,)."""
    surface = QuadSurface(local_nodes(assembly, block), region_quads(assembly, block, where))
    total = surface.area_vectors.sum(axis=0)
    size, area = float(np.linalg.norm(total)), float(surface.areas.sum())
    if not size or size < (1.0 - _FLAT) * area:
        raise InputError(
            f'{place}.hold: got "normal" of a region of block {assembly.named(block)} that is not '
            'flat; expected axes such as ["z"], or a flat region'
        )
    return assembly.rotations[block] @ (total / size)


def _pushed(assembly: AnyBlocks, push: PushSection) -> HeldFace:
    block = chosen_block("load.push.block", push.block, assembly)
    unit = np.array(push.direction) / np.linalg.norm(push.direction)
    return HeldFace(
        block,
        first_met(assembly, block, unit),
        directions=unit[None],
        displacement=push.distance * unit,
        name=PUSH,
    )


def _face_load(assembly: AnyBlocks, one: SurfaceLoadSection, place: str) -> FaceLoad:
    where = _where(assembly, one)
    blocks = _blocks(assembly, one, where, place)
    if one.pressure is not None:
        return PressureLoad(blocks, where, one.pressure)
    if one.traction is not None:
        return TractionLoad(blocks, where, np.array(one.traction))
    unit = TractionLoad(blocks, where, np.array([1.0, 0.0, 0.0]))
    area = float(LoadCase(assembly, "", (unit,), assembly.fixed).facet_forces[:, 0].sum())
    force = np.array(one.force)
    return TractionLoad(blocks, where, force / area, force=force)


def _add_force(
    assembly: AnyBlocks, one: SurfaceLoadSection, wrenches: FloatArray, place: str
) -> None:
    """Add a force on a block as a whole."""
    assert one.blocks is not None
    assert one.force is not None
    block = chosen_block(f"{place}.blocks", one.blocks[0], assembly)
    force = np.array(one.force)
    wrenches[block, :3] += force
    if one.point is not None:
        wrenches[block, 3:] += np.cross(np.array(one.point) - assembly.centroids[block], force)
