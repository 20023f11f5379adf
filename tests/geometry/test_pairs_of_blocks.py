"""Pairs of blocks: which touch without a face, and which may be named in a statement."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.families.masonry import box
from geometry.parts.pairs import PairError, check_pairs
from geometry.polyhedra.assembly import bare_joints, polyhedral_assembly

pytestmark = pytest.mark.quick

FLAT, ON_EDGE = np.eye(3), Rotation.from_euler("y", 45.0, degrees=True).as_matrix()


@pytest.mark.parametrize("seed", range(3))
def test_cubes_that_stand_on_an_edge_have_a_bare_joint(seed: int) -> None:
    """On a floor beside others that stand on a face, whatever the numbers of all are."""
    cube, floor = box((10.0, 10.0, 10.0), "cube"), box((300.0, 30.0, 10.0), "floor")
    placed = [(floor, FLAT, np.array([0.0, 0.0, -10.0]))]
    turns = [FLAT, ON_EDGE, FLAT, ON_EDGE, ON_EDGE]
    placed += [(cube, t, np.array([50.0 * k + 20, 10.0, 0.0])) for k, t in enumerate(turns)]
    # A turn about y by 45 degrees puts the middle of an edge below the origin of the box.
    low = [min(0.0, float((turn @ shape.points.T)[2].min())) for shape, turn, _ in placed]
    lifted = [(s, t, at - [0.0, 0.0, z]) for (s, t, at), z in zip(placed, low, strict=True)]
    order = np.random.default_rng(seed).permutation(6)
    blocks = polyhedral_assembly("cubes", [lifted[k] for k in order], order == 0)
    number = np.argsort(order)
    expected = {tuple(sorted((int(number[0]), int(number[k])))) for k in (2, 4, 5)}
    assert set(bare_joints(blocks)) == expected


def test_pairs_must_touch_only_where_the_joints_are_known() -> None:
    joints = (np.array([0, 2]), np.array([1, 1]))
    check_pairs("friction", (), 4, joints)
    check_pairs("friction", ((2, 1, 0.3), (0, 1, 0.6)), 4, joints)
    check_pairs("friction", ((0, 3, 0.3),), 4)
    with pytest.raises(PairError, match="blocks 0 and 3 do not touch"):
        check_pairs("friction", ((2, 1, 0.3), (3, 0, 0.3)), 4, joints)
