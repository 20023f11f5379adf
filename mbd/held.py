"""Whether contact holds blocks at all: one rigid equilibrium before a static run, or after one.

Deformable blocks press on each other where faces overlap; edges that cross and corners that touch
have no area and carry nothing, and facets pass forces inside their corners. If rigid blocks in
contact at all corners of all these areas have a motion that the load drives and friction does not
stop, every contact pressure does work of one sign on it and no small displacement is in
equilibrium: Newton's method would iterate in vain.

Where blocks move far (finite sliding) or close gaps first, they may come to rest elsewhere: that is
no proof against such a run, and explains one that failed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.interface import Interfaces
from geometry.loads import LoadCase
from geometry.mesh import FloatArray
from geometry.parts.placed import AnyBlocks
from geometry.polyhedra.assembly import as_polyhedral
from geometry.polyhedra.options import DetectionOptions
from mbd.contacts.friction import MOST_FRICTION, FrictionalContacts
from mbd.equilibrium import frictional_equilibrium
from mbd.system import RigidStatement, RigidSystem, Stated, carried_words

#: Natural coordinates of the corners of a facet (4, 2), and of its Gauss points in each direction.
_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_GAUSS = 1.0 / math.sqrt(3.0)
#: More contact points than this are left to the static solver: the cone program takes minutes.
_MOST_POINTS = 20_000
#: Part of a unit motion that supports hold, and that is round-off.
_HELD = 1e-9


class HexahedralStatement(RigidStatement, Protocol):
    """A statement of a problem on hexahedra, such as `fem.Problem`."""

    @property
    def blocks(self) -> Assembly:
        """Blocks with hexahedra."""

    @property
    def load_case(self) -> LoadCase:
        """Loads and supports without the weight."""

    @property
    def finite_sliding(self) -> bool:
        """Whether blocks may slide far."""

    @property
    def clearance(self) -> float:
        """Gap along the normal of every facet [mm]."""

    @property
    def spacing(self) -> float:
        """By which neighbours are moved apart [mm]."""


class UnheldError(RefusedError):
    """Blocks that move under the load, whatever their elasticity; the message names the motion."""


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
        at = 1.0 + self.natural * _CORNERS[:, None] * _CORNERS
        corners = 0.25 * at.prod(axis=-1) @ corners
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


def _bearing(problem: HexahedralStatement, blocks: AnyBlocks) -> RigidSystem:
    """Blocks on some contacts, under the loads of a problem."""
    return RigidSystem(Stated(blocks, problem.load_case, problem.rigid_weight, problem.coulomb))


def _motion(system: RigidSystem) -> str | None:
    """Motion that the load drives, in words; None where nothing certainly moves."""
    if system.equilibrium.holds:
        return None
    answer = system.equilibrium if system.coulomb is None else system.with_friction
    return None if answer.mechanism is None else _words(system, answer.mechanism)


def _squeeze(system: RigidSystem) -> str | None:
    """What has to press joints beforehand, so that friction carries the load; None: nothing."""
    if system.coulomb is None or not system.with_friction.holds:
        return None
    result = system.squeeze(system.with_friction.forces)
    if not result.needed:
        return None
    words = carried_words(True, result.needed)
    return f"{words}: {result.reason()}; the load does not press them"


def _at_corners(problem: HexahedralStatement, natural: float = 1.0) -> RigidSystem | None:
    """Contact at the corners of facets, or nearer to their middle by a natural coordinate.

    None where facets do not match, for supports that move and springs, and for many points.
    """
    assembly, load = problem.blocks, problem.load_case
    if not _is_held(load) or assembly.unmatched or not load.fixed.any():
        return None
    if assembly.image_of is not None:  # of a periodic cell
        return None
    if not 0 < 4 * assembly.interfaces.n_contacts <= _MOST_POINTS:
        return None
    same = {part.name: getattr(assembly, part.name) for part in fields(assembly)}
    points = _AtCorners(facets=assembly.interfaces, natural=natural, **same)
    return _bearing(problem, points)


def _on_faces(problem: HexahedralStatement, detection: DetectionOptions) -> RigidSystem | None:
    """Contact over the areas that solids share.

    None for curved faces, many contacts, supports that move, springs, and supports by name, which
    surfaces do not have.
    """
    assembly, load = problem.blocks, problem.load_case
    if any(shape.curve is not None for shape in assembly.shapes) or not _is_held(load):
        return None
    surfaces = as_polyhedral(assembly, detection)
    bare = surfaces.with_faces_alone()
    if bare.interfaces.n_contacts > _MOST_POINTS or not surfaces.interfaces.n_contacts:
        return None
    if any(isinstance(held.face, str) for held in load.held):
        return None
    return _bearing(problem, bare)


def _is_held(load: LoadCase) -> bool:
    """Whether rigid blocks can have the supports: none moves or is a spring."""
    return not any(held.moves or held.spring is not None for held in load.held)


def _faces_words(faces: RigidSystem) -> str | None:
    if not faces.blocks.interfaces.n_contacts:
        return "blocks touch along edges and at points alone, and edges and points carry nothing"
    words = _motion(faces)
    if words is None:
        return None
    return f"the faces of the blocks do not carry the load: {words} (edges and corners carry none)"


def require_held(problem: HexahedralStatement) -> None:
    """Reject a problem that certainly has no static state.

    Raises
    ------
    UnheldError
        The motion that the load drives.
    """
    friction = problem.coulomb
    corners = None if friction is None else _at_corners(problem)
    words = None if corners is None else _motion(corners)
    if words is not None:
        assert friction is not None
        least = min([friction.coefficient, *(pair[2] for pair in friction.of_pairs)])
        given = f"{friction.coefficient:g}" if least == friction.coefficient else "the joints"
        raise UnheldError(
            f"no static state: {words}, and friction of {given} does not stop it; expected a load "
            "that is carried: raise `coefficient`, turn the load, hold more blocks, or follow the "
            'motion with fem.method = "explicit"'
        )
    opened = problem.finite_sliding or problem.clearance > 0.0 or problem.spacing > 0.0
    solids = problem.blocks.detection
    faces = None if solids is None or opened else _on_faces(problem, solids)
    words = None if faces is None else _faces_words(faces)
    if words is not None:
        raise UnheldError(
            f"no equilibrium: {words}; expected faces that carry the load: `tubelock mbd` shows "
            "the motion; change the shape, fix more blocks, add `friction`, or follow the motion "
            'with fem.method = "explicit"'
        )


def explain_unheld(problem: HexahedralStatement, error: RefusedError) -> None:
    """Let the error of a static run that found no equilibrium say what lets blocks move.

    Raises
    ------
    UnheldError
        As `require_held`.
    """
    require_held(problem)
    why = why_unheld(problem)
    if why is not None:  # then the solver's own remedies do not help
        error.args = (f"{str(error).partition('; ')[0]}: {why}",)


def why_unheld(problem: HexahedralStatement) -> str | None:
    """Say what lets blocks move where a static run found no equilibrium; None: nothing known."""
    solids = problem.blocks.detection
    if solids is not None:
        faces = _on_faces(problem, solids)
        words = None if faces is None else _faces_words(faces) or _squeeze(faces)
    else:
        corners = _at_corners(problem)
        words = None if corners is None else _motion(corners)
        words = words and (
            f"contacts and supports do not carry the load: {words}; `tubelock mbd` draws it: hold "
            "that motion, or add `friction`"
        )
    if words is not None or problem.coulomb is None:
        return words
    inside = _at_corners(problem, _GAUSS)
    words = None if inside is None else _motion(inside)
    return words and (
        "facets that match press at Gauss points, 0.21 of a facet inside their edges, and over "
        f"those {words}; expected a finer mesh, or meshes that do not match, whose contact reaches "
        "the edges"
    )


def _straight_motion(frictional: FrictionalContacts, force: FloatArray) -> FloatArray | None:
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


def _words(system: RigidSystem, motion: FloatArray) -> str:
    """Name the joint that moves most and how, in a motion that a load drives."""
    contacts, frictional, force = system.contacts, system.frictional, system.force
    straight = _straight_motion(frictional, force)
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
