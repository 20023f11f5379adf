"""Hertz and Cattaneo–Mindlin on meshes that do not match, within what law and chords can err by.

With k = 3 E*/h and p₀ = E* a / 2R of a roller, two errors of first order are known beforehand. The
law gives way by p₀/k, a share of h/3a of the a²/2R by which the end is flattened. Chords of the two
surfaces cross by h²/8R, which presses k h²/8R, a share of 3h/4a of p₀. Fields err by less than the
sum; of balls, p₀ = 2 E* a / πR*, both are smaller.
"""

import pytest

from validation.compare.hertz import BALL_MESHES, ROLLER_MESHES, ball_case, roller_case, slip_case


def law(cells):
    """What the law gives way, over what the end is flattened by."""
    return 1.0 / (3.0 * cells)


def bound(cells):
    """The same, and what chords press over p0."""
    return law(cells) + 3.0 / (4.0 * cells)


def check(found, cells):
    assert found.found_a == pytest.approx(found.a, rel=law(cells))
    assert found.found_p0 == pytest.approx(found.peak, rel=bound(cells))
    assert found.field_error < bound(cells)


def test_a_roller_and_its_order():
    """Two thirds of the edge: the error falls by two thirds, to a tenth."""
    coarse, fine = ROLLER_MESHES[0], 1.5 * ROLLER_MESHES[0]
    errors = []
    for cells in (coarse, fine):
        _, found = roller_case(cells)
        check(found, cells)
        errors.append(found.field_error)
    assert errors[1] < (2.0 / 3.0 + 0.1) * errors[0]


def test_a_roller_pushed_aside_sticks_in_the_middle():
    """From a state that was pressed together: forces were balanced before the support moved, which
    is no equilibrium yet."""
    cells = 1.5 * ROLLER_MESHES[0]
    _, found = slip_case(cells)
    assert 0.3 < found.ratio < 0.7
    assert found.found_c == pytest.approx(found.c, rel=bound(cells))
    assert found.field_error < bound(cells)


def test_two_balls():
    """A quarter of two equal balls."""
    cells = BALL_MESHES[0]
    check(ball_case(cells, 4.0)[1], cells)
