"""Coulomb friction with elastic slip: limit, return, history, work."""

import numpy as np
import pytest

from fem import CoulombFriction
from fem.contact.friction import FrictionError, friction_tractions

LAW = CoulombFriction(0.3, 50.0)


def random_points(n=200, seed=0):
    random = np.random.default_rng(seed)
    return (
        random.standard_normal((n, 2)),
        random.standard_normal((n, 2)),
        np.abs(random.standard_normal(n)) * 100.0,
    )


def test_traction_obeys_the_limit_and_the_anchor_reproduces_it():
    """|t| <= mu p, and t = k (s - a) with the new anchor: three roundings of numbers of 100."""
    slip, anchor, pressure = random_points()
    traction, moved = friction_tractions(LAW, slip, anchor, pressure)
    size = np.linalg.norm(traction, axis=1)
    limit = 0.3 * pressure
    assert (size <= limit * (1 + 1e-15)).all()
    assert np.abs(traction - 50.0 * (slip - moved)).max() < 1e-12
    sticks = (moved == anchor).all(axis=1)
    assert sticks.any()
    assert not sticks.all()
    assert size[~sticks] == pytest.approx(limit[~sticks], rel=1e-14)
    # Sliding resists the slip: along s - a, never against it.
    assert (np.einsum("ni,ni->n", traction, slip - anchor) >= 0.0).all()


def test_sliding_back_and_forth_loses_the_area_of_the_loop():
    """Per cycle of amplitude A > mu p/k: 4 mu p (A - mu p/k), exactly in the continuous limit;
    increments only move the anchor while sliding, along which the traction is constant."""
    pressure, amplitude = np.array([1.0]), 0.1
    path = np.concatenate([np.linspace(0, amplitude, 101), np.linspace(amplitude, -amplitude, 201)])
    path = np.concatenate([path, np.linspace(-amplitude, amplitude, 201)])
    anchor = np.zeros((1, 2))
    lost = []
    for value in path:
        traction, moved = friction_tractions(LAW, np.array([[value, 0.0]]), anchor, pressure)
        lost.append(float((traction * (moved - anchor)).sum()))
        anchor = moved
    limit = 0.3
    cycle = sum(lost[101:])
    assert cycle == pytest.approx(4 * limit * (amplitude - limit / 50.0), rel=1e-12)
    assert min(lost) >= 0.0


def test_a_turned_path_gives_turned_tractions():
    slip, anchor, pressure = random_points()
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    here, _ = friction_tractions(LAW, slip, anchor, pressure)
    there, _ = friction_tractions(LAW, slip @ turn.T, anchor @ turn.T, pressure)
    assert np.abs(there - here @ turn.T).max() < 1e-12


def test_without_pressure_the_anchor_follows():
    slip = np.array([[[0.4, -0.2]]])
    traction, moved = friction_tractions(LAW, slip, np.zeros((1, 1, 2)), np.zeros((1, 1)))
    assert (traction == 0.0).all()
    assert (moved == slip).all()
    assert traction.shape == (1, 1, 2)


@pytest.mark.parametrize(
    ("mu", "stiffness"), [(0.0, 1.0), (-0.1, 1.0), (0.1, np.inf), (30.0, 1.0), (np.nan, 1.0)]
)
def test_unusable_constants_are_refused(mu, stiffness):
    with pytest.raises(FrictionError, match=r"effects\.friction"):
        CoulombFriction(mu, stiffness)


def test_an_angle_in_place_of_a_coefficient_is_named():
    with pytest.raises(FrictionError, match=r"got 30, expected up to 10; an angle .* tangent"):
        CoulombFriction(30.0)
