"""Points near each other, against the tree of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from geometry.interface import coincident, pairs_within

pytestmark = pytest.mark.quick


@pytest.mark.parametrize("n", [0, 1, 2, 150])
@pytest.mark.parametrize("reach", [0.0, 0.3, 1.0, 50.0])
def test_pairs_are_those_of_a_tree(n: int, reach: float) -> None:
    """Of random points and of a grid, whose cells and distances are whole numbers."""
    random = np.random.default_rng(n).uniform(-5.0, 5.0, (n, 3))
    for points in (random, np.round(random), random * [1.0, 1e-3, 1e6], np.zeros((n, 3))):
        pairs = pairs_within(points, reach)
        expected = cKDTree(points.reshape(-1, 3)).query_pairs(reach, output_type="ndarray")
        assert {(int(i), int(j)) for i, j in pairs} == {(int(i), int(j)) for i, j in expected}
        assert len(pairs) == len(expected)


@pytest.mark.parametrize("n", [0, 1, 300])
@pytest.mark.parametrize("tolerance", [1e-6, 0.4])
def test_coincident_points_are_the_nearest(n: int, tolerance: float) -> None:
    rng = np.random.default_rng(n)
    others = rng.uniform(-5.0, 5.0, (n, 3))
    points = np.concatenate([others, rng.uniform(-5.0, 5.0, (50, 3))])
    points = points + rng.uniform(-0.5, 0.5, points.shape) * tolerance
    nearest = cKDTree(others).query(points, distance_upper_bound=tolerance)[1]
    assert np.array_equal(coincident(points, others, tolerance), nearest)
