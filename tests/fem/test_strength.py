"""Load factors at first cracking and crushing, against closed forms and against the scaled load."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fem import Material, Problem, concrete, solve_static
from fem.accuracy.strength import _BoundError, _scaled_until, strength_factors
from fem.answer.measures import measures_of
from geometry import ColumnBox, Measure, RefusedError, box_column, pipe
from geometry.answer import measure_rows
from geometry.loads import face_pressure
from geometry.machine.work import LimitError
from tests.fixtures.commands import small_meshes
from tests.support.answers import PLAIN
from tests.support.coarse_tubes import coarse, ring
from tests.support.commands import answered, set_words

TUBE = coarse(2, 2)


def pressed(pressure: float, **strengths: float) -> Problem:
    """Boxes without lateral strain: the pressure is the stress everywhere."""
    blocks = box_column([ColumnBox((40.0, 40.0, 40.0), (1, 1, 1))] * 3)
    material = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.0, **strengths)
    return Problem(blocks, face_pressure(blocks, np.array([2]), "z+", pressure), material)


@pytest.mark.quick
def test_boxes_crush_where_the_pressure_is_the_strength() -> None:
    """The factor is strength over pressure; uniform compression has no tension to crack by."""
    problem = pressed(0.5, compressive_strength=30.0, tensile_strength=3.0)
    found = solve_static(problem, PLAIN)
    assert found["crushing_factor"].value == pytest.approx(60.0, rel=1e-6)
    assert found["cracking_factor"].remark.startswith("none: ")
    measures = json.loads(json.dumps(found.as_dict(), allow_nan=False))["measures"]
    assert measures["cracking_factor"]["value"] is None


@pytest.mark.quick
def test_crushing_is_judged_by_the_larger_stress_and_never_without_the_pressure() -> None:
    """A stress in elements may be far below a pressure that the mesh does not resolve."""
    problem = pressed(0.5, compressive_strength=30.0)
    state = solve_static(problem, PLAIN).details
    measures = dict(measures_of(state))
    hidden = measures | {"p_max_point": replace(measures["p_max_point"], resolved=False)}
    factor = strength_factors(problem, state, hidden)["crushing_factor"]
    assert factor.remark == "not found: p_max_point is not resolved on this mesh"
    larger = measures | {"sigma_3_min": replace(measures["sigma_3_min"], value=-30.0)}
    assert strength_factors(problem, state, larger)["crushing_factor"].value == pytest.approx(1.0)


@pytest.mark.quick
def test_tension_is_round_off_beside_other_stresses_not_beside_forces() -> None:
    problem = pressed(0.5, tensile_strength=3.0)
    state = solve_static(problem, PLAIN).details
    measures = dict(measures_of(state)) | {"total_reaction": Measure(1e12, "N")}

    def factor(tension: float) -> Measure:
        stress = replace(measures["sigma_1_averaged"], value=tension)
        return strength_factors(problem, state, measures | {"sigma_1_averaged": stress})[
            "cracking_factor"
        ]

    assert factor(3.0).value == pytest.approx(1.0)
    assert factor(1e-11).remark == "none: no tension"
    wide = replace(measures["sigma_1_averaged"], value=1e-14, error=1e-12)  # of converged meshes
    found = strength_factors(problem, state, measures | {"sigma_1_averaged": wide})
    assert found["cracking_factor"].remark == "none: no tension"


@pytest.mark.quick
def test_a_linear_body_cracks_in_proportion() -> None:
    words = ("mesh.divisions=[8,2,2]", "fem.method='static'", "fem.degree=2")
    words = (*words, "material.tensile_strength=3", "fem.error_estimate=false")
    found, out = answered("fem", "cantilever", *set_words(words))
    stress = found["measures"]["sigma_1_averaged"]
    factor = found["measures"]["cracking_factor"]
    assert factor["value"] == pytest.approx(3.0 / stress["value"], rel=1e-9)
    assert "tensile_strength" not in out.partition("ignored")[2]


def test_the_scaled_load_reaches_the_strength() -> None:
    """Contact is not linear: the factor is not strength over stress, and is that of a new run.

    The last secant leaves out the curvature, at most about the square of 0.03.
    """
    blocks = ring(1, (12, 2, 2))
    material = replace(concrete, tensile_strength=1.0)
    found = solve_static(Problem(blocks, pipe(0.01), material), PLAIN)
    factor = found["cracking_factor"].value
    again = solve_static(Problem(blocks, pipe(0.01 * factor), concrete), PLAIN)
    assert again["sigma_1_averaged"].value == pytest.approx(1.0, rel=2 * 0.03**2)
    assert abs(factor * found["sigma_1_averaged"].value - 1.0) > 0.01
    assert "cracking_factor" not in again.measures


@pytest.mark.quick
def test_rigid_contacts_crush_in_proportion() -> None:
    words = (*TUBE, "material.compressive_strength=30")
    data, out = answered("mbd", "tsb1-pipe", *set_words(words))
    found = data["measures"]
    peak = found["p_max_facet"]["value"]
    assert found["crushing_factor"]["value"] == pytest.approx(30.0 / peak, rel=1e-12)
    words = "by mean pressures of facets of rigid blocks, without peaks"
    assert words in " ".join(out.replace("│", " ").split())
    assert "compressive_strength" not in out.partition("ignored")[2]


@pytest.mark.quick
def test_the_limit_that_is_reached_first_is_named_first() -> None:
    """Whichever it is; a limit that no load reaches comes last."""
    place = {"blocks": [0], "layer": None, "face": None, "position": [0, 0, 0], "stress": "p_max"}
    for cracking, crushing in ((312.6, 26.0), (26.0, 312.6), (math.inf, 26.0)):
        factors = {"cracking_factor": cracking, "crushing_factor": crushing}
        rows = measure_rows(
            {name: Measure(v, "times the load", place=place) for name, v in factors.items()}
        )
        assert rows[0].words.startswith("26 times the load")


@pytest.mark.slow
def test_the_bar_of_a_factor_is_that_of_the_stress_at_the_factor() -> None:
    """A run at the factor has another relative bar: contact is stiffer there."""
    blocks = ring(1, (12, 2, 4))
    material = replace(concrete, tensile_strength=3.0)
    with small_meshes(1, 2, 3):
        factor = solve_static(Problem(blocks, pipe(0.01), material))["cracking_factor"]
        load = pipe(0.01 * factor.value)
        stress = solve_static(Problem(blocks, load, concrete))["sigma_1_averaged"]
    assert factor.error is not None
    assert stress.error is not None
    shares = factor.error / factor.value, stress.error / stress.value
    assert shares[0] == pytest.approx(shares[1], rel=0.2)


def scaled(stress: Callable[[float], float], most: float = np.inf) -> tuple[float, list[float]]:
    """Factor at which a stress by load is 3 MPa, and the loads that were solved.

    Above ``most`` there is no state.
    """
    loads: list[float] = []

    def at(factor: float) -> Measure:
        loads.append(factor)
        if factor > most:
            raise RefusedError("blocks move away")
        return Measure(stress(factor), "MPa")

    return _scaled_until(3.0, {1.0: Measure(stress(1.0), "MPa")}, at)[0], loads


@pytest.mark.quick
def test_a_factor_is_found_beside_loads_without_a_state() -> None:
    """Stress ∝ load^0.7 reaches 3 at 30^(1/0.7) = 129; the first stride would go beyond 150."""
    factor, loads = scaled(lambda load: 0.1 * load**0.7, most=150.0)
    assert factor == pytest.approx(30.0 ** (1 / 0.7), rel=1e-3)
    assert len(loads) <= 12


@pytest.mark.quick
def test_a_search_without_end_says_between_which_loads() -> None:
    """Above loads that are solved, whether the stress falls again or nothing more is held."""
    with pytest.raises(
        _BoundError, match=r"above 1\d+ .* at most 0.\d+ of 3 MPa \(it does not grow"
    ):
        scaled(lambda load: 0.1 * load * np.exp(-load / 10.0))
    with pytest.raises(_BoundError, match=r"above 4.\d+ times .*no static state at .*move away"):
        scaled(lambda load: 0.1 * load, most=5.0)
    with pytest.raises(_BoundError, match=r"^below 0.75 times .* more than 3 MPa"):
        scaled(lambda _: 4.0)


@pytest.mark.quick
def test_a_limit_that_ends_a_search_is_its_reason() -> None:
    """It is asked once, and the factor is at least the largest load that is solved."""
    loads: list[float] = []

    def at(factor: float) -> Measure:
        loads.append(factor)
        raise LimitError("work")

    solved = {load: Measure(0.1 * load, "MPa") for load in (1.0, 8.0, 40.0)}
    with pytest.raises(_BoundError, match=r"between 8 and 40 times .*limit of work") as found:
        _scaled_until(3.0, solved, at)
    assert "no static state" not in str(found.value)
    assert found.value.least == 8.0
    assert loads == [pytest.approx(30.0)]


@pytest.mark.quick
def test_a_search_begins_at_loads_that_are_solved() -> None:
    """Of a larger load with a smaller stress nothing is concluded."""
    solved = {load: Measure(0.1 * load, "MPa") for load in (1.0, 29.9)}
    asked: list[float] = []

    def at(factor: float) -> Measure:
        asked.append(factor)
        return Measure(0.1 * factor, "MPa")

    assert _scaled_until(3.0, solved, at)[0] == pytest.approx(30.0)
    assert len(asked) == 1
    beyond = {8.0: solved[1.0], 40.0: Measure(4.0, "MPa"), 99.0: Measure(1.0, "MPa")}
    with pytest.raises(_BoundError, match="between 8 and 40 times") as found:
        _scaled_until(3.0, beyond, lambda _: Measure(0.05, "MPa"))
    assert found.value.least == 8.0
