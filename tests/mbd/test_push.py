"""Largest force of a support that pushes rigid blocks, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from fem import CoulombFriction
from geometry.families.boxes import ColumnBox, box_column
from geometry.loads import LoadCase
from geometry.parts.placed import AnyBlocks
from geometry.parts.regions import Box, HeldFace, Plane
from geometry.polyhedra.assembly import PolyhedralAssembly, as_polyhedral
from mbd.contacts.supports import RigidSupportError
from mbd.limits.pushes import push_limit
from mbd.system import RigidSystem, Stated

pytestmark = pytest.mark.quick

X = np.eye(3)[0]
#: Sides of the bricks [mm] and weight of one [N].
A, B, C = 80.0, 60.0, 40.0
WEIGHT = 7.0


@pytest.fixture(params=[False, True], ids=["hexahedra", "triangles"])
def bricks(request) -> AnyBlocks:
    """A fixed brick with a free one on it."""
    column = box_column([ColumnBox((A, B, C), (4, 2, 2))] * 2)
    return as_polyhedral(column) if request.param else column


def pushed(bricks: AnyBlocks, *held: HeldFace, weight: float = WEIGHT) -> LoadCase:
    wrench = np.zeros((2, 6))
    wrench[1, 2] = -weight
    return LoadCase(bricks, "push", (), bricks.fixed, held, body_wrenches=wrench)


def flat(bricks: AnyBlocks) -> HeldFace:
    """A punch against the whole side of the upper brick; the length of its way is no matter."""
    side = Plane(bricks.centroids[1] - 0.5 * A * X, X)
    return HeldFace(1, side, X[None, :], displacement=0.3 * X, name="punch")


def system(load: LoadCase, friction: float) -> RigidSystem:
    return RigidSystem(Stated(load.assembly, load, coulomb=CoulombFriction(friction)))


@pytest.mark.parametrize("friction", [0.2, 1.5])
def test_a_flat_punch_shifts_a_brick_with_the_force_of_its_friction(bricks, friction):
    """It holds the brick upright, so that μ W slides it however high friction is."""
    found = push_limit(system(pushed(bricks, flat(bricks)), friction))
    assert found.associated.certified
    assert found.associated.factor == pytest.approx(friction * WEIGHT, rel=1e-6)
    assert found.sliding.certified
    assert found.sliding.factor == pytest.approx(friction * WEIGHT, rel=1e-6)


def test_a_punch_on_the_upper_edge_tips_a_brick_that_would_not_slide(bricks):
    """About the far contact points: F C = W a, less than μ W. Triangulated bricks touch at the
    edge, a = A / 2; hexahedra at the centroids of four facets, an eighth of A inside it."""
    middle = bricks.centroids[1]
    half = np.array([0.5 * A, 0.5 * B, 0.5 * C])
    corner = middle + half * [-1.0, -1.0, 1.0]
    edge = Box(corner - 0.1, corner + np.array([0.1, B + 0.1, 0.1]))
    punch = HeldFace(1, edge, X[None, :], displacement=X)
    found = push_limit(system(pushed(bricks, punch), 1.5))
    assert found.associated.certified
    arm = A * (0.5 if isinstance(bricks, PolyhedralAssembly) else 0.375)
    assert found.associated.factor == pytest.approx(WEIGHT * arm / C, rel=1e-6)


def test_pushes_without_a_limit_are_named(bricks):
    up = flat(bricks)
    with pytest.raises(RigidSupportError, match="got 0 supports that move; expected one"):
        push_limit(system(pushed(bricks), 0.3))
    with pytest.raises(RigidSupportError, match="got 2 supports that move"):
        push_limit(system(pushed(bricks, up, up), 0.3))
    lifted = push_limit(system(pushed(bricks, up, weight=-WEIGHT), 0.3))
    assert lifted.words == "none: the dead load alone is not carried"
