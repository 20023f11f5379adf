"""Coulomb friction with elastic slip: limit, return, history, work."""

from dataclasses import replace

import numpy as np
import pytest

from fem import ExponentialLaw, LinearPenalty, Static, solve_static
from fem.contact.friction import Coulomb
from tests.support.answers import on_its_mesh
from validation import load_case

#: A stiffness of one: overclosures are pressures.
LAW = Coulomb(LinearPenalty(1.0), 0.3, 50.0)


def random_points(n=200, seed=0):
    """Overclosures with slips, and anchors."""
    random = np.random.default_rng(seed)
    slip, anchor = random.standard_normal((2, n, 1, 2))
    pressure = np.abs(random.standard_normal((n, 1, 1))) * 100.0
    return np.concatenate([pressure, slip], axis=2), anchor


def test_traction_obeys_the_limit_and_the_anchor_reproduces_it():
    """|t| <= mu p, and t = k (s - a) with the new anchor: three roundings of numbers of 100."""
    x, anchor = random_points()
    traction, moved = LAW.tractions(x, anchor)
    friction, slip = traction[..., 1:], x[..., 1:]
    size, limit = np.linalg.norm(friction, axis=2), 0.3 * traction[..., 0]
    assert (traction[..., 0] == x[..., 0]).all()
    assert (size <= limit * (1 + 1e-15)).all()
    assert np.abs(friction - 50.0 * (slip - moved)).max() < 1e-12
    sticks = (moved == anchor).all(axis=2)
    assert sticks.any()
    assert not sticks.all()
    assert size[~sticks] == pytest.approx(limit[~sticks], rel=1e-14)
    # Sliding resists the slip: along s - a, never against it.
    assert ((friction * (slip - anchor)).sum(axis=2) >= 0.0).all()


def test_slope_is_the_derivative_of_the_tractions():
    """Open, sticking and sliding points; central differences of 1e-6 of the law's length.

    Between stick and sliding there is a kink: the few points that cross it in between are left out.
    """
    law = Coulomb(ExponentialLaw(), 0.3, 50.0)
    x, anchor = random_points()
    x = np.concatenate([x[..., :1] * 1e-4 - 3e-3, 1e-5 * x[..., 1:]], axis=2)
    anchor, step = 1e-5 * anchor, 1e-9
    slope = law.slope(x, anchor)
    friction, moved = law.tractions(x, anchor)
    pressed, sticks = friction[..., 0] > 0.0, (moved == anchor).all(axis=2)
    for some in (~pressed, pressed & sticks, pressed & ~sticks):
        assert 20 < some.sum() < 180
    for k in range(3):
        ends = [law.tractions(x + sign * step * np.eye(3)[k], anchor) for sign in (-1.0, 1.0)]
        smooth = ((ends[0][1] == anchor) == (ends[1][1] == anchor)).all(axis=2)
        assert smooth.mean() > 0.98
        change = (ends[1][0] - ends[0][0]) / (2.0 * step)
        scale = np.abs(slope).max(axis=(2, 3))[..., None] + 1e-9
        assert (np.abs(change - slope[..., k]) / scale)[smooth].max() < 1e-5


def test_sliding_back_and_forth_loses_the_area_of_the_loop():
    """Per cycle of amplitude A > mu p/k: 4 mu p (A - mu p/k), exactly in the continuous limit;
    increments only move the anchor while sliding, along which the traction is constant."""
    amplitude = 0.1
    path = np.concatenate([np.linspace(0, amplitude, 101), np.linspace(amplitude, -amplitude, 201)])
    path = np.concatenate([path, np.linspace(-amplitude, amplitude, 201)])
    anchor = np.zeros((1, 1, 2))
    lost = []
    for value in path:
        traction, moved = LAW.tractions(np.array([[[1.0, value, 0.0]]]), anchor)
        lost.append(float((traction[..., 1:] * (moved - anchor)).sum()))
        anchor = moved
    limit = 0.3
    cycle = sum(lost[101:])
    assert cycle == pytest.approx(4 * limit * (amplitude - limit / 50.0), rel=1e-12)
    assert min(lost) >= 0.0


def test_a_turned_path_gives_turned_tractions():
    x, anchor = random_points()
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.0, 0.8, 0.6]])
    here, _ = LAW.tractions(x, anchor)
    there, _ = LAW.tractions(x @ turn.T, anchor @ turn[1:, 1:].T)
    assert np.abs(there - here @ turn.T).max() < 1e-12


def test_without_pressure_the_anchor_follows():
    x = np.array([[[-0.1, 0.4, -0.2]]])
    traction, moved = LAW.tractions(x, np.zeros((1, 1, 2)))
    assert (traction == 0.0).all()
    assert (moved == x[..., 1:]).all()


def test_friction_scales_with_lengths_moduli_and_forces():
    """By dimensions: lengths × 3, moduli × 5, the law's stiffness × 5/3 and pressures × 5 give
    displacements × 3 and stresses × 5, whichever stiffness points stick with by default."""
    answers = [sheared(1.0, 1.0), sheared(3.0, 5.0)]
    for name, factor in (("max_displacement", 3.0), ("p_max_point", 5.0), ("sigma_1_max", 5.0)):
        one, other = (answer[name].value for answer in answers)
        assert other == pytest.approx(factor * one, rel=1e-6), name


def sheared(length, modulus):
    """Answer of a box on a held one that is pressed and drawn sideways below the limit."""
    size = (length * np.array([50.0, 40.0, 30.0])).tolist()
    boxes = [{"size": size, "divisions": [2, 2, 2]}] * 2
    law = {"law": "linear", "stiffness": 500.0 * modulus / length}
    return on_its_mesh(
        load_case(
            {
                "block": {"type": "boxes", "boxes": boxes},
                "load": {"pressure": 0.1 * modulus},
                "material": {
                    "density": 2.4e-9 * modulus / length,
                    "young_modulus": 33e3 * modulus,
                    "poisson_ratio": 0.2,
                },
                "contact": law,
                "effects": {"gravity": [5e5, 0.0, 0.0], "friction": 0.6},
            },
            method="static",
        ),
        method="static",
    )


@pytest.mark.slow
def test_bars_hold_the_answer_of_ten_times_the_stick():
    """Of every measure of two cubes under their weight but stresses at points, which two meshes
    do not resolve. Elastic stick is no part of the problem."""
    boxes = [{"size": [60.0] * 3, "divisions": [2, 2, 2]}] * 2
    scene = {
        "block": {"type": "boxes", "boxes": boxes},
        "material": {"name": "concrete"},
        "effects": {"gravity": [0.0, 0.0, -9810.0], "friction": 0.5},
    }
    problem = load_case(scene, method="static").problem
    friction = replace(problem.coulomb, stick_stiffness=10.0 * problem.system.stick())
    two = Static(max_work=0.8)
    usual, stiffer = (solve_static(p, two) for p in (problem, replace(problem, friction=friction)))
    assert len(usual.report["meshes"]) == len(stiffer.report["meshes"]) == 2
    judged = [name for name, m in usual.measures.items() if m.is_number and m.error is not None]
    assert "sigma_1_averaged" in judged
    for name in judged:
        change = abs(stiffer[name].value - usual[name].value)
        assert change <= usual[name].error, name
