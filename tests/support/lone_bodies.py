"""Bodies without contact in an explicit run, with loads and supports at their nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fem.contact.law import ExponentialLaw
from fem.contact.normals import ContactNormals
from fem.contact.surfaces import contact_surfaces
from fem.explicit.timed import TimedSystem
from fem.system.body import Body
from fem.system.effects import Effects
from fem.system.rows import Amplitude, ForceRows, HeldRows, held_at, joined_rows
from fem.system.system import Contact, System
from geometry.assembly import Assembly
from geometry.block import Block
from geometry.mesh import FloatArray, IntArray

#: Rows of a system, from its bodies.
Support = Callable[[Sequence[Body]], HeldRows]
Load = Callable[[Sequence[Body]], ForceRows]


def blocks_of(bodies: Sequence[Body], group: int, copies: IntArray) -> IntArray:
    """Blocks that copies of a body are: body after body."""
    return copies + sum(body.n_copies for body in bodies[:group])


def fixed_nodes(
    group: int,
    nodes: IntArray,
    *,
    copies: Sequence[int] | IntArray = (0,),
    components: tuple[int, ...] = (0, 1, 2),
    axes: FloatArray | None = None,
    displacement: FloatArray | None = None,
    amplitude: Amplitude | None = None,
) -> Support:
    """Hold nodes of copies of a body along some of the axes, world, or move them [mm]."""

    def held(bodies: Sequence[Body]) -> HeldRows:
        grid = np.meshgrid(copies, nodes, components, indexing="ij")
        of, node, component = (array.ravel() for array in grid)
        along = (np.eye(3) if axes is None else axes)[component]
        local = np.einsum("nij,ni->nj", bodies[group].rotations[of], along)
        values = (np.zeros(3) if displacement is None else displacement)[component]
        return held_at(blocks_of(bodies, group, of), node, local, values, amplitude=amplitude)

    return held


def nodal_load(
    group: int,
    forces: FloatArray,
    *,
    copies: Sequence[int] | IntArray = (0,),
    amplitude: Amplitude | None = None,
    follows_block: bool = False,
) -> Load:
    """Forces on the nodes of all copies (n_nodes, 3), or each (n, n_nodes, 3), world axes [N]."""

    def load(bodies: Sequence[Body]) -> ForceRows:
        dense = np.broadcast_to(forces, (len(copies), *np.shape(forces)[-2:]))
        k, node = np.nonzero(np.any(dense != 0.0, axis=2))
        of = np.asarray(copies)[k]
        local = np.einsum("nij,ni->nj", bodies[group].rotations[of], dense[k, node])
        return ForceRows(blocks_of(bodies, group, of), node, local, amplitude, follows_block)

    return load


def lone_bodies(
    bodies: Sequence[Body],
    supports: Sequence[Support] = (),
    loads: Sequence[Load] = (),
    effects: Effects | None = None,
) -> TimedSystem:
    """Statement of bodies that meet nothing."""
    copies = [np.arange(body.n_copies) for body in bodies]
    body_of = np.repeat(np.arange(len(bodies)), [len(of) for of in copies])
    n = len(body_of)
    assembly = Assembly(
        name="lone bodies",
        shapes=tuple(Block(body.name, body.mesh, {}) for body in bodies),
        shape_of=body_of,
        rotations=np.concatenate([body.rotations for body in bodies]),
        translations=np.concatenate([body.translations for body in bodies]),
        layer=np.zeros(n, dtype=np.int64),
        fixed=np.zeros(n, dtype=np.bool_),
    )
    system = System(
        assembly=assembly,
        bodies=tuple(bodies),
        body_number=body_of,
        copy_of=np.concatenate(copies),
        offsets=np.zeros((n, 3)),
        surfaces=contact_surfaces(assembly, np.zeros((n, 3)), clearance=0.0),
        contact=Contact(ExponentialLaw(), ContactNormals.CURRENT),
        supports=joined_rows([support(bodies) for support in supports]),
        forces=tuple(load(bodies) for load in loads),
        gravity=None if effects is None else effects.gravity,
    )
    blocks = tuple(np.flatnonzero(body_of == number) for number in range(len(bodies)))
    return TimedSystem(system.computed, blocks, effects or Effects())


def with_supports(stated: TimedSystem, *supports: Support) -> TimedSystem:
    """The same with other supports, of the blocks that are computed."""
    whole = stated.system.whole
    held = joined_rows([support(whole.bodies) for support in supports])
    held = replace(held, block=np.concatenate(stated.blocks)[held.block])
    return replace(stated, system=replace(stated.system, whole=replace(whole, supports=held)))
