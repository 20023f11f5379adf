"""Forecast of the work of general contact: which meshes are started depends on it."""

import numpy as np
import pytest

from fem.accuracy.converge import searched_work

pytestmark = pytest.mark.quick


def test_work_adds_up_over_layers_and_grows_by_the_cube_of_the_points() -> None:
    """A layer's contact is condensed by itself: n³ of its points; friction never makes it less."""
    points = np.array([40.0, 10.0, 25.0])
    work = searched_work(points, friction=False)
    assert work > 0.0
    assert work == pytest.approx(
        sum(searched_work(points[[k]], friction=False) for k in range(3)), rel=1e-12
    )
    assert searched_work(2.0 * points, friction=False) == pytest.approx(8.0 * work, rel=1e-12)
    assert searched_work(points, friction=True) > work
