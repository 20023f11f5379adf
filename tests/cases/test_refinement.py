"""`mbd --refine`: the change under one refinement is the difference of two answers."""

from __future__ import annotations

import pytest

from tests.support.commands import answered, set_words

COARSE = {"around": 12, "radial": 1, "axial": 2}


def asked(factor: int) -> list[str]:
    counts = {key: factor * n for key, n in COARSE.items()}
    pairs = ["assembly.layers=2", *(f"mesh.{key}={n}" for key, n in counts.items())]
    return ["tsb1-pipe", *set_words(pairs)]


def test_a_refinement_is_the_difference_of_two_answers() -> None:
    (one, out), (two, _) = answered("mbd", *asked(1), "--refine"), answered("mbd", *asked(2))
    found = one["refinement"]
    assert found["n_contacts"] == two["n_contacts"] == 4 * one["n_contacts"]
    assert not found["class_changes"]
    for name, change in found["changes"].items():
        # The same run twice; measures of 0.1 MPa to round-off of a thousand sums.
        before, after = (
            value((answer["contact"] | answer["measures"])[name]) for answer in (one, two)
        )
        assert found["values"][name] == pytest.approx(after, rel=1e-9)
        assert change == pytest.approx(after - before, abs=1e-9)
        assert (name in found["not_converged"]) is (abs(after - before) > 0.05 * after)
    # Twelve elements round half a metre: the peak on a facet is not converged, and that is told.
    assert "p_max_facet" in found["not_converged"]
    words = {row["title"]: row["words"] for row in one["rows"]}["half the facet size"]
    assert "half the facet size" in out
    assert "not converged with the facets (p_max_facet" in words


def value(measure: float | dict[str, float]) -> float:
    return measure["value"] if isinstance(measure, dict) else measure
