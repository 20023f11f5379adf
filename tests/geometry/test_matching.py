"""Facets are one contact where all their corners coincide, to the tolerance and not beyond."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry import Assembly
from geometry.assembly import matched_area
from geometry.families.boxes import ColumnBox, box_column
from geometry.files.hexahedral_solids import hexahedral_block
from geometry.mesh import HexMesh, structured_hexahedra

pytestmark = pytest.mark.quick

SIDE = 20.0
CORNERS = SIDE * np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=float)


def pair(*, shift: float = 0.0, turn: float = 0.0) -> Assembly:
    """Two cubes, the upper one moved along x or turned about its axis [°]."""
    cube = hexahedral_block("cube", HexMesh(CORNERS - SIDE / 2, structured_hexahedra(1, 1, 1)))
    rotation = Rotation.from_euler("z", turn, degrees=True).as_matrix()
    return Assembly(
        name="pair",
        shapes=(cube,),
        shape_of=np.zeros(2, dtype=np.int64),
        rotations=np.stack([np.eye(3), rotation]),
        translations=np.array([[0.0, 0.0, 0.0], [shift, 0.0, SIDE]]),
        layer=np.array([0, 1]),
        fixed=np.array([True, False]),
        unmatched_allowed=True,
    )


@pytest.mark.parametrize("turn", [0.0, 90.0, 180.0])
def test_facets_match_whichever_way_a_block_is_turned(turn: float) -> None:
    assert pair(turn=turn).interfaces.n_contacts == 1
    # The tolerance is 1e-5 of the diagonal of 28 mm: a tenth of a micrometre is the same place.
    assert pair(shift=1e-4, turn=turn).interfaces.n_contacts == 1


@pytest.mark.parametrize(
    "other", [{"shift": 3e-3}, {"shift": 1.0}, {"turn": 45.0}, {"turn": 0.1}, {"turn": 5.0}]
)
def test_facets_that_nearly_match_are_no_contact(other: dict[str, float]) -> None:
    """A turn keeps the centroid: corners decide. 0.1° move them by 14 mm · 0.0017 = 0.025 mm."""
    assert pair(**other).interfaces.n_contacts == 0


def test_the_area_that_matches_is_that_of_one_pair_of_blocks() -> None:
    """Equal boxes match on 40 × 30 mm²; a box of other divisions matches nothing of the last."""
    box, other = ColumnBox((40.0, 30.0, 60.0), (2, 3, 1)), ColumnBox((40.0, 30.0, 60.0), (3, 2, 1))
    column = box_column([box, box, box, other])
    areas = [matched_area(column, m, s) for m, s in ((0, 1), (1, 2), (0, 2), (2, 3))]
    np.testing.assert_allclose(areas, [1200.0, 1200.0, 0.0, 0.0], rtol=1e-14)
