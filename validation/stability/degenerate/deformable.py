"""Degenerate contact of deformable blocks: facets of any size, rims, edges, and what is refused."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from fem.accuracy.statics import solve_static
from fem.contact.law import LinearPenalty
from fem.element.material import concrete
from fem.method import Static
from fem.problem import Problem
from geometry.assembly import Assembly
from geometry.block import Block, box_block
from geometry.loads import LoadCase
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import as_polyhedral, bare_joints
from geometry.polyhedra.options import DetectionOptions
from validation.stability.case import CaseVerdict, case, case_verdict
from validation.stability.problems import relative_difference

_EYE = np.eye(3)
_GRAVITY = 9810.0
#: Newton's residual, on one block's weight.
_RESIDUAL = 1e-7

Placed = tuple[Block, FloatArray, FloatArray]


def _standing(*placed: Placed) -> Assembly:
    """Blocks of which the first is held."""
    n = len(placed)
    return Assembly(
        name="degenerate",
        shapes=tuple(block for block, _, _ in placed),
        shape_of=np.arange(n),
        rotations=np.array([turn for _, turn, _ in placed]),
        translations=np.array([shift for _, _, shift in placed]),
        layer=np.arange(n),
        fixed=np.arange(n) == 0,
        unmatched_allowed=True,
    )


def _box(size: tuple[float, float, float], divisions: tuple[int, int, int]) -> Block:
    return box_block(size, divisions, contact_faces=("x-", "x+", "y-", "y+", "z-", "z+"))


#: One facet on top, 400 mm wide.
_FLOOR: Placed = (_box((400.0, 400.0, 50.0), (1, 1, 1)), _EYE, np.array([-200.0, -200.0, -50.0]))


def _presses(*placed: Placed) -> CaseVerdict:
    """Bodies on the floor press on it with their weight, each for itself, and on nothing else."""
    assembly = _standing(_FLOOR, *placed)
    problem = Problem(
        assembly,
        LoadCase(assembly, "weight", (), assembly.fixed.copy()),
        concrete,
        law=LinearPenalty(100.0),
        finite_sliding=True,
        gravity=(0.0, 0.0, -_GRAVITY),
    )
    state = solve_static(problem, Static(mesh="scene", error_estimate=False)).details.contact_state
    lift = abs(float(state.point_forces[:, 2].sum()))
    weight = _GRAVITY * concrete.density * float(assembly.volumes[1:].sum())
    pairs = np.sort(np.column_stack([state.block_m, state.block_s]), axis=1)
    joint = np.unique(pairs, axis=0, return_inverse=True)[1].ravel()
    # Elastic blocks touch by slivers where they share an edge: by less than the residual.
    carried = np.bincount(joint, state.pressures * state.areas) > _RESIDUAL * weight
    return case_verdict(
        ("lift against weight", relative_difference(lift, weight), _RESIDUAL),
        ("joints that carry", int(carried.sum()), "==", len(placed)),
    )


def _cube(x: float, y: float, degrees: float = 0.0) -> Placed:
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    return _box((100.0, 100.0, 100.0), (2, 2, 2)), turn, np.array([x, y, 0.0])


@case()
def dice_on_a_facet() -> CaseVerdict:
    """A cube of 5 mm on a facet of 400 mm: presses with its weight."""
    return _presses((_box((5.0, 5.0, 5.0), (3, 3, 3)), _EYE, np.array([1.0, -7.0, 0.0])))


@case()
def facets_turned() -> CaseVerdict:
    """A cube turned by 31° on the floor's facet: presses with its weight."""
    return _presses(_cube(0.0, 0.0, 31.0))


@case()
def over_the_rim() -> CaseVerdict:
    """A cube whose part beyond the floor's rim has nothing under it."""
    return _presses(_cube(140.0, 0.0))


@case()
def blocks_share_an_edge() -> CaseVerdict:
    """Cubes on a floor that share an edge: it carries nothing."""
    return _presses(_cube(0.0, 0.0), _cube(-100.0, -100.0))


def _without_face(turn: Rotation) -> CaseVerdict:
    cube = _box((100.0, 100.0, 100.0), (2, 2, 2))
    assembly = _standing(_FLOOR, (cube, turn.as_matrix(), np.zeros(3)))
    bare = bare_joints(as_polyhedral(assembly, DetectionOptions()))
    return case_verdict(("pairs that touch without a face", len(bare), "==", 1))


@case()
def block_on_its_edge() -> CaseVerdict:
    """A deformable cube on its edge: a contact that it does not have."""
    return _without_face(Rotation.from_euler("y", -45.0, degrees=True))


@case()
def block_on_its_corner() -> CaseVerdict:
    """A deformable cube on its corner: a contact that it does not have."""
    return _without_face(Rotation.align_vectors([[0.0, 0.0, 1.0]], np.ones((1, 3)))[0])
