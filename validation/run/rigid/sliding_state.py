"""A state of sliding without dilation as data, so that another program can multiply it out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.assembly import AnyBlocks
from geometry.mesh import FloatArray, IntArray
from mbd.contact_jacobian import Contacts
from mbd.force_range import PlaneProblem
from mbd.friction import FrictionalContacts
from mbd.sliding_collapse import SlidingCollapse


@dataclass(frozen=True)
class SlidingState:
    """A state of sliding in space: what is needed to multiply out every law again."""

    block_m: IntArray
    """One block of each contact, (n_contacts,)."""
    block_s: IntArray
    """The other one, (n_contacts,)."""
    points: FloatArray
    """(n_contacts, 3) [mm]."""
    normals: FloatArray
    """From m to s, (n_contacts, 3)."""
    forces: FloatArray
    """On block s, (n_contacts, 3) [N]."""
    blocks: IntArray
    """Numbers of the free blocks, (n_free,)."""
    centroids: FloatArray
    """Theirs, (n_free, 3) [mm]."""
    motion: FloatArray
    """Displacement [mm] and rotation [rad] about the centroids, to any scale; (n_free, 6)."""
    dead: FloatArray
    """Force and moment about the centroids, (n_free, 6) [N, N mm]."""
    live: FloatArray
    """The same of the live load, whose factor is `SlidingCollapse.factor`."""

    def as_json(self) -> dict[str, Any]:
        """Return plain data: forces at contacts, motion and loads of blocks."""
        contacts = [
            {
                "blocks": [int(self.block_m[k]), int(self.block_s[k])],
                "point": self.points[k].tolist(),
                "normal": self.normals[k].tolist(),
                "force": self.forces[k].tolist(),
            }
            for k in range(len(self.block_m))
        ]
        blocks = [
            {
                "block": int(number),
                "centroid": self.centroids[k].tolist(),
                "displacement": self.motion[k, :3].tolist(),
                "rotation": self.motion[k, 3:].tolist(),
                "dead_force": self.dead[k, :3].tolist(),
                "dead_moment": self.dead[k, 3:].tolist(),
                "live_force": self.live[k, :3].tolist(),
                "live_moment": self.live[k, 3:].tolist(),
            }
            for k, number in enumerate(self.blocks)
        ]
        return {"contacts": contacts, "blocks": blocks}


def sliding_state(
    assembly: AnyBlocks,
    contacts: Contacts,
    found: SlidingCollapse,
    *,
    frictional: FrictionalContacts,
    plane: PlaneProblem | None,
    wrenches: tuple[FloatArray, FloatArray],
) -> SlidingState | None:
    """Forces and motion in space of what was found there or in a plane; None without a motion.

    Wrenches are dead and live load of each block, (n_blocks, 6) each [N, N mm].
    """
    if found.mechanism is None:
        return None
    kept = np.arange(len(contacts.index)) if plane is None else plane.kept
    index = contacts.index[kept]
    points, normals = assembly.interfaces.centroids[index], assembly.interfaces.normals[index]
    if plane is None:
        forces = frictional.world(found.forces, normals)
    else:
        # Contacts on one face carry the forces of both, mirror images of each other: these act
        # half way between, and what points out of the plane cancels.
        points = points + 0.5 * plane.behind
        out = plane.behind / np.linalg.norm(plane.behind)
        forces = plane.contacts.world(found.forces, normals)
        forces = forces - (forces @ out)[:, None] * out
    motion = found.mechanism.reshape(-1, 6) / np.repeat([1.0, contacts.length], 3)
    free = contacts.free_blocks
    return SlidingState(
        block_m=contacts.block_m[kept],
        block_s=contacts.block_s[kept],
        points=points,
        normals=normals,
        forces=forces,
        blocks=free,
        centroids=assembly.centroids[free],
        motion=motion,
        dead=wrenches[0][free],
        live=wrenches[1][free],
    )
