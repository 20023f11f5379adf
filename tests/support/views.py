"""Points of view: the same assembly and load far away, turned, in metres, renumbered."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar, cast

import numpy as np
from scipy.spatial.transform import Rotation

from geometry import Assembly
from geometry.assembly import moved, renumbered
from geometry.loads import FaceLoad, LoadCase, PressureLoad, TractionLoad
from geometry.mesh import FloatArray, IntArray
from geometry.parts.placed import AnyBlocks
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.polyhedron import Polyhedron

Placed = TypeVar("Placed", bound=Assembly | PolyhedralAssembly)


@dataclass(frozen=True)
class View:
    """x becomes scale · turn · x + offset; blocks in another order. Forces stay in N."""

    name: str
    offset: float = 0.0
    """In units of the original [mm]."""
    angle: float = 0.0
    """About (1, 2, 3) [rad]."""
    scale: float = 1.0
    """New units of length in an old one."""
    reverse: bool = False

    @property
    def turn(self) -> FloatArray:
        """Rotation, (3, 3)."""
        axis = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
        return np.asarray(Rotation.from_rotvec(self.angle * axis).as_matrix(), dtype=np.float64)

    @property
    def shift(self) -> FloatArray:
        """Translation after all else, (3,) [new units]."""
        return self.scale * self.offset * np.array([1.0, -1.0, 1.0])

    def order(self, n_blocks: int) -> IntArray:
        """Old number of each block, (n_blocks,)."""
        order = np.arange(n_blocks)
        return order[::-1] if self.reverse else order


#: Where everything must look the same from.
VIEWS = (
    View("1e6 mm away", offset=1e6),
    View("turned", angle=0.7),
    View("in metres", scale=1e-3),
    View("renumbered", reverse=True),
    View("all at once", offset=1e6, angle=0.7, scale=1e-3, reverse=True),
)


def scaled(assembly: Assembly, factor: float) -> Assembly:
    """Return the same assembly in another unit of length."""
    shapes = tuple(
        replace(shape, mesh=replace(shape.mesh, nodes=shape.mesh.nodes * factor), curve=None)
        for shape in assembly.shapes
    )
    return replace(
        assembly,
        shapes=shapes,
        translations=assembly.translations * factor,
        origin=assembly.origin * factor,
    )


def seen(assembly: Placed, view: View) -> Placed:
    """Return the assembly from there."""
    order = view.order(assembly.n_blocks)
    if isinstance(assembly, Assembly):
        there = moved(scaled(assembly, view.scale), view.turn, view.shift)
        return cast("Placed", renumbered(there, order))
    shapes = [Polyhedron(s.name, view.scale * s.points, s.triangles) for s in assembly.shapes]
    return replace(
        assembly,
        shapes=tuple(shapes),
        shape_of=assembly.shape_of[order],
        rotations=(view.turn @ assembly.rotations)[order],
        translations=(view.scale * assembly.translations @ view.turn.T + view.shift)[order],
        fixed=assembly.fixed[order],
    )


def seen_load(load: LoadCase, assembly: AnyBlocks, view: View) -> LoadCase:
    """Return the load from there, its forces in N as before, on the assembly seen from there."""
    order, turn, scale = view.order(len(load.fixed)), view.turn.T, view.scale
    number = np.argsort(order)
    wrenches = load.body_wrenches
    if wrenches is not None:
        wrenches = np.hstack([wrenches[:, :3] @ turn, scale * wrenches[:, 3:] @ turn])[order]

    def face(acts: FaceLoad) -> FaceLoad:
        blocks = number[acts.blocks]
        if isinstance(acts, PressureLoad):
            return replace(acts, blocks=blocks, pressure=acts.pressure / scale**2)
        if isinstance(acts, TractionLoad):
            return replace(acts, blocks=blocks, traction=acts.traction @ turn / scale**2)
        return replace(acts, blocks=blocks, traction=acts.traction / scale**2)

    return replace(
        load,
        assembly=assembly,
        faces=tuple(face(acts) for acts in load.faces),
        held=tuple(replace(held, block=int(number[held.block])) for held in load.held),
        fixed=load.fixed[order],
        body_wrenches=wrenches,
    )
