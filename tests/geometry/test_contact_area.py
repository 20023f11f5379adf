"""What bears with friction: areas, and corners and edges in the interior of a face."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry.families.masonry import box
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.options import DetectionOptions
from geometry.polyhedra.polyhedron import Polyhedron, convex_polyhedron, polyhedron, widths
from tests.support.blocks import random_rotation

pytestmark = pytest.mark.quick

#: A plate of 100 × 100 × 20 mm whose top is z = 0.
PLATE = box((100.0, 100.0, 20.0))


def on_plate(
    shape: Polyhedron, place: list[float], *, seed: int = 0, tolerance: float = 0.01
) -> PolyhedralAssembly:
    """A shape at a place on the plate, turned as a whole."""
    turn = random_rotation(seed)
    blocks = [
        (PLATE, turn, turn @ np.array([-50.0, -50.0, -20.0])),
        (shape, turn, turn @ np.array(place)),
    ]
    detection = DetectionOptions(tolerance=tolerance)
    return polyhedral_assembly("plate", blocks, np.array([True, False]), detection)


def tip() -> Polyhedron:
    """A pyramid that stands on its tip at the origin."""
    corners = [[a, b, 30.0] for a in (-20.0, 20.0) for b in (-20.0, 20.0)]
    return convex_polyhedron("tip", [*corners, [0.0, 0.0, 0.0]])


def knife(half_length: float) -> Polyhedron:
    """A wedge that stands on its edge along x."""
    points = [[x, y, 20.0] for x in (-half_length, half_length) for y in (-10.0, 10.0)]
    points += [[x, 0.0, 0.0] for x in (-half_length, half_length)]
    return convex_polyhedron("knife", points)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-2])
@pytest.mark.parametrize(("overlap", "bears"), [(0.005, False), (0.015, False), (1.0, True)])
@pytest.mark.parametrize("seed", range(3))
def test_a_strip_narrower_than_a_thousandth_is_no_area(
    overlap: float, bears: bool, tolerance: float, seed: int
) -> None:
    """A box of 20 mm that overhangs: a thousandth is 0.02 mm, whatever the tolerance below it."""
    shape = box((20.0, 20.0, 20.0))
    found = on_plate(shape, [50.0 - overlap, 0.0, 0.0], seed=seed, tolerance=tolerance).interfaces
    assert len(found.patches.areas) == 1
    assert found.patches.areas.sum() == pytest.approx(20.0 * overlap, rel=1e-3)
    assert found.bears.all() == found.bears.any() == bears
    assert bool(found.on_areas.any()) == bears


def test_a_strip_narrower_than_the_tolerance_is_no_area() -> None:
    shape = box((20.0, 20.0, 20.0))
    found = on_plate(shape, [49.9, 0.0, 0.0], tolerance=0.2).interfaces
    assert not found.bears.any()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("place", "bears"),
    [
        ([10.0, -20.0, 0.0], True),
        ([49.0, 0.0, 0.0], True),
        ([49.95, 0.0, 0.0], False),
        ([50.0, 10.0, 0.0], False),
        ([50.0, 50.0, 0.0], False),
    ],
)
def test_a_tip_bears_in_the_interior_of_a_face(place: list[float], bears: bool, seed: int) -> None:
    """Farther from its border than a thousandth of its width, 0.1 mm: as a ball does."""
    found = on_plate(tip(), place, seed=seed).interfaces
    assert found.bears.any() == bears
    assert not found.on_areas.any()


@pytest.mark.parametrize("half_length", [20.0, 80.0])
def test_a_knife_edge_bears_whether_it_ends_on_the_face_or_beyond(half_length: float) -> None:
    found = on_plate(knife(half_length), [0.0, 5.0, 0.0]).interfaces
    assert found.bears.sum() == 2
    ends = np.abs(found.centroids[found.bears] @ random_rotation(0))[:, 0]
    np.testing.assert_allclose(ends, min(half_length, 50.0), rtol=1e-6)


def test_diagonal_neighbours_do_not_bear_on_each_other() -> None:
    """Four boxes round a vertical line: areas between neighbours, a line across."""
    shape, eye = box((20.0, 20.0, 20.0)), np.eye(3)
    places = [[10.0 * a, 10.0 * b, 10.0 * c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    blocks = [(shape, eye, np.array(place)) for place in places]
    found = polyhedral_assembly("eight", blocks, np.arange(8) == 0).bearing().interfaces
    pairs = np.unique(np.column_stack([found.block_m, found.block_s]), axis=0)
    apart = np.abs(np.diff(np.array(places)[pairs], axis=1)).sum(axis=2)
    np.testing.assert_array_equal(apart.ravel(), np.full(12, 20.0))


def cut(corners: FloatArray, triangles: FloatArray, seed: int) -> tuple[FloatArray, FloatArray]:
    """The same surface, some triangles cut round a point inside, in another order."""
    rng = np.random.default_rng(seed)
    points, result = [*corners], []
    for a, b, c in triangles:
        if rng.random() < 0.5:
            result.append([a, b, c])
            continue
        points.append(rng.dirichlet([2.0, 2.0, 2.0]) @ corners[[a, b, c]])
        result += [[a, b, len(points) - 1], [b, c, len(points) - 1], [c, a, len(points) - 1]]
    return np.array(points), rng.permutation(np.array(result))


@given(seed=st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_the_width_of_a_face_is_that_of_the_face_not_of_its_triangles(seed: int) -> None:
    """A rectangle is as wide as it is, however it is turned, cut and ordered."""
    plate = box((100.0, 30.0, 20.0))
    points, triangles = cut(plate.points, plate.triangles, seed)
    block = polyhedron("cut", points @ random_rotation(seed).T, triangles)
    assert sorted(block.face_widths) == pytest.approx([20.0, 20.0, 20.0, 20.0, 30.0, 30.0])
    assert block.face_borders[1][-1] == 24


def test_two_strips_far_apart_are_as_wide_as_their_sum_over_their_length() -> None:
    """Rails of 2 × 100 mm, 80 mm apart: no wider than both together along the longer way."""
    strip = np.array([[[0, 0, 0], [100, 0, 0], [100, 2, 0]], [[0, 0, 0], [100, 2, 0], [0, 2, 0]]])
    both = np.concatenate([strip, strip + np.array([0, 80, 0])]).astype(np.float64)
    (width,) = widths(both, np.zeros(4, dtype=np.int64))
    assert 1.0 < width < 4.0
