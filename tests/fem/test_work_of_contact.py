"""Forecast of the work of general contact: whether problems are refined depends on it."""

from dataclasses import replace

import numpy as np
import pytest

from fem.accuracy.converge import general_work
from validation import load_case

pytestmark = pytest.mark.quick


def test_work_adds_up_over_layers_and_grows_by_the_cube_of_the_points() -> None:
    """A layer's contact is condensed by itself: n³ of its points; friction never makes it less."""
    blocks = load_case("tsb1-pipe", {"assembly.layers": 2}).problem.blocks
    work = general_work(blocks, 1, friction=False)
    assert work > 0.0
    assert general_work(blocks, 2, friction=False) == pytest.approx(4.0**3 * work, rel=1e-12)
    assert general_work(blocks, 1, friction=True) > work
    together = replace(blocks, layer=np.where(blocks.fixed, blocks.layer, 1))
    assert general_work(together, 1, friction=False) == pytest.approx(2.0**2 * work, rel=1e-12)
