"""Supports and loads on parts of surfaces, from scenes."""

from __future__ import annotations

import difflib
from dataclasses import replace

import numpy as np

from geometry.assembly import AnyBlocks
from geometry.loads import FaceLoad, LineLoad, LoadCase, PressureLoad, TractionLoad
from geometry.mesh import FloatArray, IntArray, QuadSurface
from geometry.regions import Box, Plane, Where, blocks_with, first_met, local_nodes, region_quads
from geometry.supports import HeldFace
from validation.errors import InputError
from validation.scene.read import DeformableScene
from validation.scene.supports import (
    PushSection,
    RegionSection,
    SupportSection,
    SurfaceLoadSection,
)

#: Name of the support that pushes a block.
PUSH = "push"
#: Share of the area of a region by which its vector area may fall short where it is flat.
_FLAT = 1e-6


def stated_load(scene: DeformableScene, assembly: AnyBlocks, load: LoadCase) -> LoadCase:
    """Put what ``[[supports]]``, ``[[loads]]`` and ``load.push`` state on top of a load.

    Raises
    ------
    InputError
        A region that no block has, or a block that does not exist.
    """
    supports, loads, push = scene.supports, scene.loads, scene.push
    if not (supports or loads or push):
        return load
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
            blocks = np.array(
                list(range(assembly.n_blocks))
                if one.blocks is None
                else [block_number(assembly, b, f"{place}.blocks") for b in one.blocks]
            )
            lines.append(LineLoad(blocks, start, end, np.array(one.per_length)))
        elif one.regions:
            faces.append(_face_load(assembly, one, place))
        else:
            _add_force(assembly, one, wrenches, place)
    body = load.body_wrenches
    if wrenches.any():
        body = wrenches if body is None else body + wrenches
    return replace(
        load, faces=tuple(faces), lines=tuple(lines), held=(*load.held, *held), body_wrenches=body
    )


def block_number(assembly: AnyBlocks, block: int | str, place: str) -> int:
    """Number of a block from its number or its name.

    Raises
    ------
    InputError
        A block that does not exist.
    """
    if isinstance(block, int):
        if block < assembly.n_blocks:
            return block
        raise InputError(
            f"{place}: got {block}, but blocks are numbered 0 to {assembly.n_blocks - 1}"
        )
    if block in assembly.names:
        return assembly.names.index(block)
    close = difflib.get_close_matches(block, set(assembly.names) - {""}, n=3, cutoff=0.0)
    known = f"names are {', '.join(close)}, …" if close else "the files name no blocks"
    raise InputError(f"{place}: got {block!r}, but {known}")


def _where(one: RegionSection) -> Where:
    """Region of a section."""
    if one.face is not None:
        return one.face
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


def _blocks(assembly: AnyBlocks, one: RegionSection, where: Where, place: str) -> IntArray:
    """Blocks that are meant: those that are named, else all that have the region.

    Raises
    ------
    InputError
        Where none has it.
    """
    if one.blocks is not None:
        return np.array([block_number(assembly, b, f"{place}.blocks") for b in one.blocks])
    found = blocks_with(assembly, where)
    found = found[~assembly.fixed[found]]
    if not len(found):
        faces = dict.fromkeys(
            name for shape in assembly.shapes for name in getattr(shape, "faces", ())
        )
        if isinstance(where, str):
            names = f"faces are {', '.join(faces)}" if faces else "these blocks name none"
            raise InputError(f"{place}.face: no block that is not fixed has {where!r}; {names}")
        raise InputError(
            f"{place}: no block that is not fixed has a surface node on {where}; expected "
            "coordinates in mm"
        )
    return found


def _held(assembly: AnyBlocks, one: SupportSection, place: str) -> list[HeldFace]:
    where = _where(one)
    found = []
    for block in _blocks(assembly, one, where, place).tolist():
        if one.hold == "normal":
            directions: FloatArray | None = _normal(assembly, block, where, place)[None]
        else:
            axes = ["xyz".index(axis) for axis in one.hold]
            directions = None if len(axes) == 3 else np.eye(3)[axes]
        found.append(
            HeldFace(
                block,
                where,
                directions=directions,
                displacement=None if one.move is None else np.array(one.move),
                path=one.path,
                spring=one.spring,
                name=one.name,
            )
        )
    return found


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
    block = block_number(assembly, push.block, "load.push.block")
    if assembly.fixed[block]:
        raise InputError(
            f"load.push.block: block {assembly.named(block)} is fixed; expected one that can move"
        )
    unit = np.array(push.direction) / np.linalg.norm(push.direction)
    return HeldFace(
        block,
        first_met(assembly, block, unit),
        directions=unit[None],
        displacement=push.distance * unit,
        name=PUSH,
    )


def _face_load(assembly: AnyBlocks, one: SurfaceLoadSection, place: str) -> FaceLoad:
    where = _where(one)
    blocks = _blocks(assembly, one, where, place)
    if one.pressure is not None:
        return PressureLoad(blocks, where, one.pressure)
    if one.traction is not None:
        return TractionLoad(blocks, where, np.array(one.traction))
    unit = TractionLoad(blocks, where, np.array([1.0, 0.0, 0.0]))
    area = float(LoadCase(assembly, "", (unit,), assembly.fixed).facet_forces[:, 0].sum())
    return TractionLoad(blocks, where, np.array(one.force) / area)


def _add_force(
    assembly: AnyBlocks, one: SurfaceLoadSection, wrenches: FloatArray, place: str
) -> None:
    """Add a force on a block as a whole."""
    assert one.blocks is not None
    assert one.force is not None
    block, force = block_number(assembly, one.blocks[0], f"{place}.blocks"), np.array(one.force)
    wrenches[block, :3] += force
    if one.point is not None:
        wrenches[block, 3:] += np.cross(np.array(one.point) - assembly.centroids[block], force)
