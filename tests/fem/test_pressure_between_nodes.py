"""What nodes may hide of a peak of pressure, by the length of the contact law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fem import ExponentialLaw, Problem, concrete
from fem.accuracy.converge import climbed
from fem.accuracy.ladder import Rung
from fem.answer.measures import hidden_between_nodes
from geometry import SineBlock, pipe, tube
from geometry.families.boxes import ColumnBox, box_column
from geometry.loads import face_pressure

pytestmark = pytest.mark.quick
COARSE = Rung(2, 6, 1, 2, 1.0, 1.0)


def hidden(problem: Problem) -> tuple[float, float]:
    """What is hidden and the largest pressure on a coarse mesh [MPa]."""
    (found,) = climbed(problem, [COARSE])
    return hidden_between_nodes(found.state)["p_max_point"], found.measures["p_max_point"].value


def pressed_tube(size: float, softer: float = 1.0) -> Problem:
    """A tube and the lengths of its contact law, all of them multiplied by a size."""
    block = SineBlock(
        height=200.0 * size,
        amplitude=20.0 * size,
        frequency=1.5,
        blocks_per_layer=4,
        inner_radius=120.0 * size,
        thickness=40.0 * size,
    )
    law = ExponentialLaw(clearance_at_zero_pressure=1e-3 * size * softer)
    return Problem(tube(block, layers=1, mesh=(12, 1, 2)), pipe(0.01), concrete, law=law)


def test_uniform_pressure_hides_nothing() -> None:
    blocks = box_column([ColumnBox((40.0, 40.0, 40.0), (1, 1, 1))] * 3)
    without = replace(concrete, poisson_ratio=0.0)
    problem = Problem(blocks, face_pressure(blocks, np.array([2]), "z+", 0.5), without)
    assert hidden(problem)[0] == pytest.approx(0.0, abs=1e-9)


def test_what_is_hidden_depends_on_no_unit_of_length() -> None:
    assert hidden(pressed_tube(3.0))[0] == pytest.approx(hidden(pressed_tube(1.0))[0], rel=1e-6)


def test_a_softer_law_hides_less_and_a_stiff_one_a_quarter_at_most() -> None:
    shares = [
        of / p for of, p in (hidden(pressed_tube(1.0, softer)) for softer in (0.1, 1.0, 30.0))
    ]
    assert shares[0] > shares[1] > shares[2] > 0.0
    assert shares[0] <= 0.25
