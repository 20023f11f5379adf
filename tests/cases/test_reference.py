"""Explicit runs beside the converged static state, and the comparison of rigid and deformable."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry import Answer
from tests.fixtures.commands import small_meshes
from validation import compare, load_case, solve

TO_REST = ["fem", "column", "--set", "fem.method=explicit", "--set", "fem.damping=static"]


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


def answer(run: Any, *more: str) -> tuple[str, dict[str, Any]]:
    status, out, err = run(*TO_REST, *more, "--json", "a.json")
    assert status == 0, err
    return out, json.loads(Path("a.json").read_text())


def test_an_explicit_run_has_the_converged_value_beside_its_own(
    tubelock,
    converged: Answer,
) -> None:
    """Their difference is the discretisation error, and error bars cover it."""
    out, data = answer(tubelock)
    assert "discretisation error" in out
    assert "force residual" in out
    assert "remaining displacement" in out
    reference = data["static_reference"]
    assert {"p_eff", "p_max_point", "max_displacement"} <= set(reference["measures"])
    for name, measure in reference["measures"].items():
        # One program, one problem: the digits of `fem` with the static method.
        assert measure["value"] == pytest.approx(converged[name].value, rel=1e-9)
    for name, error in reference["discretisation_error"].items():
        own, far = data["measures"][name], reference["measures"][name]
        assert own["value"] - far["value"] == pytest.approx(error, rel=1e-12)
        assert own["error"] == pytest.approx(abs(error) + far["error"], rel=1e-12)


def test_an_option_leaves_the_converged_value_out(tubelock) -> None:
    out, data = answer(tubelock, "--no-static-reference", "--set", "fem.error_estimate=false")
    assert "discretisation" not in out
    assert "static_reference" not in data


@pytest.mark.parametrize(
    ("setting", "why"),
    [
        ("effects.friction.coefficient=0.3", "friction have many static states"),
        ("effects.finite_rotation=true", "static states have small"),
    ],
)
def test_a_scene_without_a_converged_state_says_why(tubelock, setting, why) -> None:
    out, data = answer(tubelock, "--set", setting, "--set", "fem.error_estimate=false")
    line = next(x for x in out.splitlines() if "converged static state" in x)
    assert why in line
    assert why in data["static_reference"]["why_not"]


def test_a_run_that_ends_before_it_is_at_rest_has_no_error_bars(tubelock) -> None:
    """Its distance to a static state is none of the mesh: values have no bar, one row says why."""
    out, data = answer(tubelock, "--set", "fem.end_time=0.0001")
    assert not data["quasi_static"]["is_static"]
    assert all(m["error"] is None for m in data["measures"].values())
    assert out.count("not at rest: no error bar") == 1
    assert data["notes"]["error bars"] == "not at rest: no error bar"
    assert "±" not in out


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
