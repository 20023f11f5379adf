"""Blocks that friction alone would have to hold, and does not: said before a static run.

Facets pass forces somewhere inside their corners. If rigid blocks in contact at all corners of all
facets have a motion that friction does not stop, and that the load drives, no static state exists
near the shape as built; Newton's method would look for it in vain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from fem.contact.friction import CoulombFriction
from fem.element.facet import FACET_CORNERS, bilinear
from geometry.assembly import Assembly
from geometry.interface import Interfaces
from geometry.loads import LoadCase
from geometry.mesh import FloatArray
from mbd import contact_jacobian
from mbd.contact_jacobian import Contacts
from mbd.equilibrium import newton_equilibrium
from mbd.friction import (
    MOST_FRICTION,
    FrictionalContacts,
    frictional_contacts,
    frictional_equilibrium,
)
from validation.build.materials import build_weight
from validation.build.problem import build_friction, build_hexahedra
from validation.errors import InputError
from validation.scene.polyhedra import PolyhedralScene
from validation.scene.read import DeformableScene

#: Natural coordinate of the points of facets that match.
GAUSS = 1.0 / math.sqrt(3.0)
#: More contact points than this are left to the static solver: the cone program takes minutes.
MOST_POINTS = 20_000
#: Part of a unit motion that supports hold, and that is round-off.
_HELD = 1e-9


@dataclass(frozen=True, kw_only=True)
class _AtCorners(Assembly):
    """An assembly whose contacts are the corners of its facets, or points inside them."""

    facets: Interfaces
    natural: float
    """Natural coordinate of the points, 1 at the corners."""

    @cached_property
    def interfaces(self) -> Interfaces:
        result = self.facets
        corners = np.zeros((result.n_contacts, 4, 3))
        for block in np.unique(result.block_m):
            here = result.block_m == block
            corners[here] = self.nodes(int(block))[result.quads_m[here]]
        corners = bilinear(self.natural * FACET_CORNERS)[0] @ corners
        return replace(
            result,
            block_m=np.repeat(result.block_m, 4),
            block_s=np.repeat(result.block_s, 4),
            quads_m=np.repeat(result.quads_m, 4, axis=0),
            quads_s=np.repeat(result.quads_s, 4, axis=0),
            facet_m=np.repeat(result.facet_m, 4),
            facet_s=np.repeat(result.facet_s, 4),
            centroids=corners.reshape(-1, 3),
            normals=np.repeat(result.normals, 4, axis=0),
            areas=np.repeat(result.areas / 4.0, 4),
            pair_start=4 * result.pair_start,
        )


def _at_corners(assembly: Assembly, natural: float) -> _AtCorners:
    same = {part.name: getattr(assembly, part.name) for part in fields(assembly)}
    return _AtCorners(facets=assembly.interfaces, natural=natural, **same)


def require_held_by_friction(name: str, scene: DeformableScene) -> None:
    """Refuse a static run of blocks that slide or tip with a coefficient of friction.

    Costs one rigid equilibrium where contact alone holds the load.
    """
    words = _moving_words(name, scene, 1.0)
    if words is not None:
        friction = build_friction(scene, build_hexahedra(scene, name).assembly, sliding=False)
        assert friction is not None
        least = min([friction.coefficient, *(pair[2] for pair in friction.of_pairs)])
        given = f"{friction.coefficient:g}" if least == friction.coefficient else "the joints"
        raise InputError(
            f"{name}: no static state: {words}, and friction of {given} does not "
            "stop it; expected a load that is carried: raise effects.friction.coefficient, turn "
            'the load, hold more blocks, or follow the motion with fem.method = "explicit"'
        )


def _moving_words(name: str, scene: DeformableScene, natural: float) -> str | None:
    """`sliding_words` of a scene; None where facets do not match, for motions and springs."""
    if not scene.for_rigid_blocks:
        return None
    load = build_hexahedra(scene, name)
    assembly = load.assembly
    assert isinstance(assembly, Assembly)
    if assembly.unmatched or not load.fixed.any():
        return None
    friction, weight = build_friction(scene, assembly, sliding=False), build_weight(scene, assembly)
    return sliding_words(assembly, load.with_wrenches(weight), friction, natural)


def mechanism_words(name: str, scene: DeformableScene) -> str | None:
    """Words where contacts and supports leave a motion that the load drives."""
    words = None if isinstance(scene, PolyhedralScene) else _moving_words(name, scene, 1.0)
    if words is None:
        return None
    return (
        f"the load activates a mechanism that contacts and supports leave ({words}); `tubelock "
        "mbd` draws it: hold that motion, or add effects.friction"
    )


def inside_words(name: str, scene: DeformableScene) -> str | None:
    """Words where blocks stand on their faces, and not on the Gauss points of facets that match."""
    words = None if scene.effects.friction is None else _moving_words(name, scene, GAUSS)
    if words is None:
        return None
    return (
        "facets that match press at Gauss points, 0.21 of a facet inside their edges, and over "
        f"those {words}; expected a finer mesh, or meshes that do not match, whose contact "
        "reaches the edges"
    )


def sliding_words(
    assembly: Assembly, load: LoadCase, friction: CoulombFriction | None, natural: float = 1.0
) -> str | None:
    """Name the block that slides or tips, and on which; None where nothing certainly does.

    Facets of the blocks match; the load is tractions, weights and supports. Contact acts at the
    corners of facets, or nearer to their middle by a natural coordinate.
    """
    if not 0 < 4 * assembly.interfaces.n_contacts <= MOST_POINTS:
        return None
    points = _at_corners(assembly, natural)
    contacts = contact_jacobian(points, load.fixed, load.held)
    force = contacts.rows(load.wrenches)
    smooth = newton_equilibrium(contacts.jacobian, force)
    if smooth.holds:
        return None
    mu = 0.0 if friction is None else friction.on(contacts.block_m, contacts.block_s)
    frictional = frictional_contacts(points, contacts, mu)
    motion = smooth.mechanism
    if friction is not None:
        motion = frictional_equilibrium(frictional, force).mechanism
    return None if motion is None else motion_words(contacts, frictional, motion, force)


def sliding_motion(frictional: FrictionalContacts, force: FloatArray) -> FloatArray | None:
    """Motion of blocks that do not turn which the load (n_rows,) drives; None where none is.

    Where forces alone find no balance, blocks slide or lift off; where moments do not, they tip.
    A mechanism of the whole is any combination of both.
    """
    motions = frictional.motions
    if motions is None:
        motions = np.tile(np.eye(6), (len(force) // 6, 1, 1))
    straight = np.zeros_like(motions)
    for block, motion in enumerate(motions):
        _, sizes, ways = np.linalg.svd((np.eye(6) - motion)[:, :3])
        left = ways[sizes <= _HELD]
        straight[block, :3, :3] = left.T @ left
    projector = sp.block_diag([sp.coo_array(part) for part in straight], format="csc")
    matrix = sp.csc_array(projector @ frictional.matrix)
    shifted = replace(frictional, matrix=matrix, motions=straight)
    return frictional_equilibrium(shifted, shifted.admissible(force)).mechanism


def motion_words(
    contacts: Contacts, frictional: FrictionalContacts, motion: FloatArray, force: FloatArray
) -> str:
    """Name the joint that moves most and how, in a motion that a load drives."""
    straight = sliding_motion(frictional, force)
    relative = frictional.slip(motion if straight is None else straight)
    most = int(np.linalg.norm(relative, axis=1).argmax())
    m, s = int(contacts.block_m[most]), int(contacts.block_s[most])
    joint = (contacts.block_m == m) & (contacts.block_s == s)
    opening = relative[joint, 0]
    slip = np.einsum("ni,nij->nj", relative[joint, 1:], frictional.tangents[joint])
    largest = float(np.linalg.norm(relative[most]))
    # All points of a joint that slides move alike; of one that tips they open unequally.
    if straight is None and np.ptp(opening) > 0.1 * largest:
        return f"block {s} tips on block {m}"
    way = slip.mean(axis=0)
    size = float(np.linalg.norm(way))
    if size < 0.1 * largest:
        return f"block {s} lifts off block {m}"
    words = ", ".join(
        f"{part:.2f}" for part in np.where(np.abs(way) < 5e-3 * size, 0.0, way / size)
    )
    stuck = replace(frictional, friction=np.full_like(frictional.friction, MOST_FRICTION))
    tips = straight is not None and not frictional_equilibrium(stuck, force).holds
    return f"block {s} slides{' and tips' if tips else ''} on block {m} along ({words})"
