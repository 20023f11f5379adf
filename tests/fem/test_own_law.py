"""Contact laws of one's own: what follows from two methods, and what answers say with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fem import (
    ExponentialLaw,
    LinearPenalty,
    Problem,
    TabularLaw,
    solve_static,
)
from fem.contact.law import ContactLawError
from fem.contact.own_law import OwnLaw
from tests.support.answers import PLAIN
from tests.support.coarse_tubes import pressed

OVERCLOSURES = np.concatenate([[-1.0], np.linspace(-2e-3, 6e-3, 401)])


class Exponential:
    """The paper's law written down once more."""

    c0, p0 = 1e-3, 1e-4

    def pressure(self, overclosure: np.ndarray) -> np.ndarray:
        x = np.minimum(np.maximum(overclosure / self.c0 + 1.0, 0.0), 40.0)
        return self.p0 / (np.e - 1.0) * x * np.expm1(x)

    def stiffness(self, overclosure: np.ndarray) -> np.ndarray:
        x = np.minimum(np.maximum(overclosure / self.c0 + 1.0, 0.0), 40.0)
        return self.p0 / (np.e - 1.0) / self.c0 * (np.expm1(x) + x * np.exp(x)) * (x > 0.0)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return pressed()


def test_what_follows_from_two_methods_is_what_the_built_in_law_says() -> None:
    own, built_in = OwnLaw(Exponential()), ExponentialLaw()
    assert own.start == pytest.approx(built_in.start, abs=1e-12)
    for name in ("pressure", "stiffness", "stored_energy"):
        found, expected = (getattr(law, name)(OVERCLOSURES) for law in (own, built_in))
        # Eight parts of six Gauss points: an exponential over seven c0 to 1e-12 of the largest.
        assert np.abs(found - expected).max() < 1e-11 * expected.max()
    pressures = np.geomspace(1e-6, 1.0, 50)
    assert np.abs(own.overclosure(pressures) - built_in.overclosure(pressures)).max() < 1e-12
    assert own.touching_stiffness == pytest.approx(built_in.touching_stiffness, rel=1e-12)


def test_an_own_law_gives_the_answer_of_the_built_in_one(problem) -> None:
    """The same law: both answers have a residual of 1e-8, pressures a gain below 1e2."""
    answers = [
        solve_static(replace(problem, law=law), PLAIN) for law in (Exponential(), problem.law)
    ]
    own, built_in = (answer.contacts["pressure"] for answer in answers)
    assert np.abs(own - built_in).max() < 1e-6 * built_in.max()


def test_a_table_of_two_points_is_the_linear_law(problem) -> None:
    table, linear = TabularLaw([(0.0, 0.0), (0.01, 1.0)]), LinearPenalty(100.0)
    for name in ("pressure", "stored_energy"):
        found, expected = (getattr(law, name)(OVERCLOSURES) for law in (table, linear))
        assert np.allclose(found, expected, rtol=1e-13, atol=1e-16)
    pressures = np.linspace(0.0, 3.0, 20)
    assert np.allclose(table.overclosure(pressures), linear.overclosure(pressures), rtol=1e-13)
    answers = [solve_static(replace(problem, law=law), PLAIN) for law in (table, linear)]
    first, second = (answer.contacts["pressure"] for answer in answers)
    assert np.abs(first - second).max() < 1e-6 * second.max()


def test_a_fine_table_tends_to_its_curve(problem) -> None:
    """Linear between points that lie h apart: pressures differ by h² p'' / 8."""
    curve = ExponentialLaw()
    at = np.linspace(-1e-3, 9e-3, 101)
    table = TabularLaw(np.column_stack([at, curve.pressure(at)]))
    between = np.linspace(-1e-3, 9e-3, 3001)
    bound = 1e-4**2 / 8.0 * np.gradient(curve.stiffness(between), between).max()
    assert np.abs(table.pressure(between) - curve.pressure(between)).max() < 1.01 * bound
    energy = table.stored_energy(between) - curve.stored_energy(between)
    assert np.abs(energy).max() < 1e-2 * 1.01 * bound
    answers = [solve_static(replace(problem, law=law), PLAIN) for law in (table, curve)]
    largest = [answer["p_max_facet"].value for answer in answers]
    assert largest[0] == pytest.approx(largest[1], rel=2e-3)


class Wrong(Exponential):
    """One thing that no law may have."""

    def __init__(self, what: str) -> None:
        self.what = what

    def pressure(self, overclosure: np.ndarray) -> np.ndarray:
        found = super().pressure(overclosure)
        changed = {"far": found + 1.0, "falls": -found, "shape": found.sum()}
        return changed.get(self.what, found)

    def stiffness(self, overclosure: np.ndarray) -> np.ndarray:
        return super().stiffness(overclosure) * (2.0 if self.what == "slope" else 1.0)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (Wrong("far"), "expected zero where surfaces are apart"),
        (Wrong("falls"), "has no pressure"),
        (Wrong("shape"), "expected the same shape"),
        (Wrong("slope"), "expected the slope of its pressure"),
    ],
)
def test_what_is_no_law_is_refused_when_a_problem_is_made(problem, law, words: str) -> None:
    with pytest.raises(ContactLawError, match=words):
        replace(problem, law=law)
