"""The comparison of rigid and deformable blocks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from geometry import Answer
from tests.fixtures.commands import small_meshes
from validation import compare, load_case, solve


@pytest.fixture(scope="module", autouse=True)
def _small() -> Iterator[None]:
    """Which meshes they are does not matter here."""
    with small_meshes(1, 2, 3):
        yield


@pytest.fixture(scope="module")
def converged() -> Answer:
    return solve(load_case("column"))


@pytest.fixture(scope="module")
def found(converged: Answer) -> Any:
    norms = ({"rigid.norm": norm} for norm in ("force", "pressure"))
    rigid = (solve(load_case("column", norm, method="rigid")) for norm in norms)
    return compare(*rigid, converged)


def test_the_static_answer_of_a_comparison_is_that_of_fem(found: Any, converged: Answer) -> None:
    for name in ("p_eff", "p_max", "p_max_facet"):
        assert found.static[name].value == pytest.approx(converged[name].value, rel=1e-9)
    assert found.static["p_max_point"].value == converged["p_max_point"].value
    assert found.static.report["contact"]["p_eff"] == found.static["p_eff"].value


def test_all_answers_of_a_comparison_lie_on_the_same_facets(found: Any) -> None:
    """Every joint carries the load, 0.5 MPa on the uppermost face, facet by facet in one order."""
    _, pair = np.unique(found.contacts["blocks"], axis=0, return_inverse=True)
    load = 0.5 * 50.0 * 40.0
    for pressures in found.pressures:
        of_joints = np.bincount(pair.ravel(), pressures * found.contacts["area"])
        # The elements sample the exponential law at points: to a few per cent, on four facets.
        np.testing.assert_allclose(of_joints, load, rtol=0.05)


def test_the_conclusion_compares_the_two_peaks(found: Any) -> None:
    rigid = found.answers[found.names.index("rigid (pressure)")]
    ratio = found.static["p_max_point"].value / rigid["p_max_facet"].value
    assert f"is {ratio:.2g} times the rigid one" in found.conclusion
