"""Operations are counted as they are done: closed forms, and loops that count."""

from __future__ import annotations

import pytest

from fem.element.kinds import block_stiffness, element_of
from fem.element.lagrange import with_degree
from geometry import box_block
from geometry.machine.work import GROWTH, SECONDS, Operation, budget, count, count_elimination
from tests.support.curved_blocks import CONCRETE

pytestmark = pytest.mark.quick


def test_every_operation_has_a_cost_and_a_growth_and_adds_up_through_all_budgets() -> None:
    assert set(SECONDS) == set(GROWTH) == set(Operation)
    for kind in Operation:
        with budget() as outer, budget() as inner:
            count(kind, 3.0)
            count(kind, 4.0)
        for one in (outer, inner):
            assert one.done == {kind: 7.0}
            assert one.seconds == pytest.approx(7.0 * SECONDS[kind])
        assert inner.grown(8.0) == pytest.approx(7.0 * SECONDS[kind] * 8.0 ** GROWTH[kind])


@pytest.mark.parametrize(("inner", "around"), [(200, 0), (150, 300), (300, 20)])
def test_eliminations_count_the_multiplications_of_a_loop(inner: int, around: int) -> None:
    """Each pivot changes all entries behind it; leading terms, to one part in the smaller size."""
    loop = sum((inner + around - k - 1) ** 2 for k in range(inner))
    for symmetric, share in ((True, 0.5), (False, 1.0)):
        with budget() as done:
            count_elimination(inner, around, symmetric=symmetric)
        assert done.done[Operation.DENSE] == pytest.approx(share * loop, rel=2.0 / inner)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_stiffness_counts_entries_at_points_of_all_elements(degree: int) -> None:
    """(3 n)² entries of an element with n nodes, at n points."""
    block = with_degree(box_block((4.0, 3.0, 2.0), (3, 2, 2)), degree)
    element, n = element_of(block.mesh), (degree + 1) ** 3
    with budget() as done:
        block_stiffness(block.mesh, CONCRETE, element)
    assert done.done[Operation.ELEMENT] == (3 * n) ** 2 * n * 12
