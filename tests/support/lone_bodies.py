"""Bodies without contact in an explicit run, with loads and supports at their nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fem.contact.law import ExponentialLaw
from fem.contact.normals import ContactNormals
from fem.contact.surfaces import contact_surfaces
from fem.explicit.timed import TimedSystem
from fem.system.body import Body
from fem.system.effects import Effects
from fem.system.model import InteractionModel, NodalLoad, Support
from fem.system.system import Contact, System
from geometry.assembly import Assembly
from geometry.block import Block


def lone_bodies(
    bodies: Sequence[Body],
    supports: Sequence[Support] = (),
    loads: Sequence[NodalLoad] = (),
    effects: Effects | None = None,
    interactions: Sequence[InteractionModel] = (),
) -> TimedSystem:
    """Statement of bodies that meet nothing, or only in ``interactions``."""
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
        group_of=body_of,
        copy_of=np.concatenate(copies),
        offsets=np.zeros((n, 3)),
        surfaces=contact_surfaces(assembly, np.zeros((n, 3)), clearance=0.0),
        contact=Contact(ExponentialLaw(), ContactNormals.CURRENT),
        supports=tuple(supports),
        forces=tuple(loads),
        gravity=None if effects is None else effects.gravity,
    )
    blocks = tuple(np.flatnonzero(body_of == number) for number in range(len(bodies)))
    return TimedSystem(system, blocks, effects or Effects(), tuple(interactions))


def with_supports(stated: TimedSystem, *supports: Support) -> TimedSystem:
    """The same with other supports."""
    return replace(stated, system=replace(stated.system, supports=supports))
