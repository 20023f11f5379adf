"""Which way blocks that carry a load are held: a small push along each axis, carried or not."""

from __future__ import annotations

import numpy as np

from geometry.loads.case import LoadCase
from geometry.placed_blocks import AnyBlocks
from mbd.contact_jacobian import contact_jacobian
from mbd.equilibrium import newton_equilibrium
from mbd.generalized_force import generalized_force

#: Push over load: far above the tolerance of an equilibrium, too small to lift what weighs.
_PUSH = 1e-3

_AXES = ("+x", "-x", "+y", "-y", "+z", "-z")


def held_against(assembly: AnyBlocks, load: LoadCase) -> dict[str, bool]:
    """Whether blocks without friction stay where a small push acts beside their load.

    All free blocks are pushed at once, each by its volume. By duality a push that is not carried
    drives a motion that the load does not hinder: along it the blocks are free, however well the
    load is carried.

    Parameters
    ----------
    assembly
        Blocks and contacts.
    load
        What they carry.

    Returns
    -------
    dict[str, bool]
        For +x, -x and so on; a direction that is neither proved held nor free is left out.
    """
    contacts = contact_jacobian(assembly, load.fixed)
    force = generalized_force(assembly, load, contacts.free_blocks, contacts.length)
    size = float(np.linalg.norm(force)) or 1.0
    held = {}
    for k, name in enumerate(_AXES):
        push = np.zeros((len(contacts.free_blocks), 6))
        push[:, k // 2] = (-1.0) ** k * assembly.volumes[contacts.free_blocks]
        push *= _PUSH * size / np.linalg.norm(push)
        found = newton_equilibrium(contacts.jacobian, force + push.ravel())
        if found.holds or found.mechanism is not None:
            held[name] = found.holds
    return held
