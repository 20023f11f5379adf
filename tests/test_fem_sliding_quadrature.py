"""Points of facets that cross facets of another surface."""

import numpy as np
import pytest

from fem.element.facet import bilinear
from fem.explicit.contact.quadrature import (
    convex_pieces,
    cut_points,
    gauss_points,
    natural_coordinates,
)

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])


def area(polygon):
    x, y = polygon.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def grid(turn, size, cells):
    """Squares that tile the plane round the origin, turned by an angle; (n, 4, 2)."""
    corners = SQUARE / 2.0 * size
    shifts = np.stack(np.meshgrid(*2 * [np.arange(-cells, cells) * size]), axis=-1).reshape(
        -1, 1, 2
    )
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return (corners + shifts) @ rotation.T


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 4])
def test_pieces_fill_the_facet_and_do_not_cross_edges(turn):
    """Areas add up to rounding; the corners of a piece lie on one side of every edge, to 1e-7."""
    others = grid(turn, 1.3, 4)
    pieces = convex_pieces(SQUARE, others)
    assert sum(area(p) for p in pieces) == pytest.approx(4.0, rel=1e-12)
    assert all(area(p) > 0.0 for p in pieces)
    assert len(pieces) >= 4
    for piece in pieces:
        middle = piece.mean(axis=0)
        held = [
            quad for quad in others if min(cross(quad, np.roll(quad, -1, axis=0), middle)) > 0.0
        ]
        assert len(held) == 1
        for corner in piece:
            assert min(cross(held[0], np.roll(held[0], -1, axis=0), corner)) > -1e-6


def cross(a, b, point):
    e, d = b - a, point - a
    return e[:, 0] * d[:, 1] - e[:, 1] * d[:, 0]


def test_what_lies_outside_all_others_is_kept():
    """A square half covered and one that hangs over a corner: the rest is integrated as well."""
    half = SQUARE[None] + [1.0, 0.0]
    corner = SQUARE[None] + [1.5, 1.5]
    for others, inside in ((half, 2.0), (corner, 0.25)):
        pieces = convex_pieces(SQUARE, others)
        assert sum(area(p) for p in pieces) == pytest.approx(4.0, rel=1e-12)
        assert area(pieces[0]) == pytest.approx(inside, rel=1e-12)
    assert len(convex_pieces(SQUARE, SQUARE[None] + [5.0, 0.0])) == 1
    # Seen from the other surface corners run the other way round.
    backwards = convex_pieces(SQUARE, half[:, ::-1])
    assert area(backwards[0]) == pytest.approx(2.0, rel=1e-12)


def test_natural_coordinates_of_a_distorted_facet():
    facet = SQUARE + np.array([[0.1, -0.2], [0.3, 0.1], [-0.2, 0.2], [0.0, -0.1]])
    xi = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    found = natural_coordinates(facet, bilinear(xi)[0] @ facet)
    assert found == pytest.approx(xi, abs=1e-12)


def test_cut_points_integrate_quadratic_functions_and_leave_other_facets_alone():
    """Two facets, one of them cut: both keep their area, and ∫ x² over [0, 2]² is 16/3."""
    corners = np.zeros((2, 4, 3))
    corners[:, :, :2] = SQUARE
    corners[1, :, 0] += 2.0
    across = np.zeros((2, 4, 3))
    across[:, :, :2] = SQUARE - np.array([[[-1.1, 0.3]], [[0.9, 0.3]]])
    whole = gauss_points(corners)
    points = cut_points(whole, corners, {0: across})
    first = points.facet == 0
    assert np.array_equal(points.shapes[~first], whole.shapes[whole.facet == 1])
    assert np.bincount(points.facet, points.weights) == pytest.approx(4.0, rel=1e-12)
    x = points.shapes[first] @ corners[0, :, 0]
    assert points.weights[first] @ x**2 == pytest.approx(16.0 / 3.0, rel=1e-12)
    assert (points.cells >= -1.0).all()
    assert (points.cells <= 1.0).all()
    assert (points.cells[:, 1] > points.cells[:, 0]).all()


def test_an_edge_on_an_edge_cuts_nothing():
    """Facets that match lie on each other's edges to rounding: the Gauss points stay."""
    corners = np.zeros((1, 4, 3))
    corners[0, :, :2] = SQUARE
    others = np.zeros((9, 4, 3))
    others[:, :, :2] = SQUARE[None] + 2.0 * np.array(
        [[[i, j]] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    )
    others += 1e-12 * np.random.default_rng(1).standard_normal(others.shape)
    whole = gauss_points(corners)
    assert cut_points(whole, corners, {0: others}) is whole
