"""Searches on the paper's 480 designs, whose exhaustive optimum is known: hits and regret.

The rows are the stored ones of `tubelock sweep paper-480`, so a search of 48 designs takes a
second. ``p_max`` has its optimum at a corner of the grid, and a second valley far from it.
``inside`` is p_max times a price that was chosen, before any search, to have its optimum inside.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from validation.paper.deformable_study import rows_by_design
from validation.study.optimisation.search import Search
from validation.study.optimisation.statement import Optimisation, check_optimisation

PARAMETERS: dict[str, list[Any]] = {
    "block.shift": [0.0, 0.5],
    "block.frequency": [1.0, 1.5, 2.0],
    "block.blocks_per_layer": [2, 3, 4, 5, 6],
    "block.thickness": [30.0, 40.0, 50.0, 60.0],
    "block.amplitude": [10.0, 15.0, 20.0, 25.0],
}
SEEDS = range(20)
#: A tenth of the designs.
TENTH = 48


@cache
def stored() -> dict[tuple[float, ...], float]:
    """p_max of each design [MPa], by shift, frequency, blocks, thickness and amplitude."""
    path = Path(str(resources.files("validation"))) / "studies" / "paper-480.csv"
    return {key: row["p_max"] for key, row in rows_by_design(path).items()}


def inside(key: tuple[float, ...]) -> float:
    """Price of a design: its pressure, dearer away from usual walls, waves and block counts."""
    _, f, n, t, a = key
    away = (
        ((f - 1.5) / 0.5) ** 2 + ((n - 4) / 1.5) ** 2 + ((t - 45) / 12) ** 2 + ((a - 17) / 5) ** 2
    )
    return stored()[key] * float(np.exp(away))


def optimum(measure: Mapping[tuple[float, ...], float]) -> tuple[float, ...]:
    """Exhaustive optimum."""
    return min(measure, key=lambda key: measure[key])


def measures(name: str) -> dict[tuple[float, ...], float]:
    """All 480 values of a measure."""
    return dict(stored()) if name == "p_max" else {key: inside(key) for key in stored()}


def stated(seed: int, evaluations: int = TENTH) -> Optimisation:
    """Search among the 480 designs."""
    data = {"scene": "tsb1-pipe", "minimise": "p_max", "evaluations": evaluations}
    return check_optimisation(data | {"variables": PARAMETERS, "seed": seed})


def searched(
    seed: int, values: Mapping[tuple[float, ...], float], evaluations: int = TENTH
) -> Search:
    """Search a table instead of solving."""
    search = Search(stated(seed, evaluations))
    for number in search.numbers():
        design = search.stated.study.design(number)
        row = {"p_max": values[tuple(design.values())], "status": "ok", "message": ""}
        search.take({"number": number, **design, **row})
    return search


def outcome(name: str, seeds: Iterable[int] = SEEDS, evaluations: int = TENTH) -> dict[str, Any]:
    """Share of hits and regret [-] over seeds."""
    values = measures(name)
    least = min(values.values())
    regret, spent = [], []
    for seed in seeds:
        search = searched(seed, values, evaluations)
        regret.append(search.feasible[0].row["p_max"] / least - 1.0)
        places = search.feasible[0].places
        spent.append(1 + list(search.points).index(places))
    return {
        "measure": name,
        "designs": len(values),
        "computed": evaluations,
        "optimum s, f, n, t, a": str(optimum(values)),
        "seeds": len(regret),
        "hits [%]": 100.0 * np.mean([r == 0.0 for r in regret]),
        "mean regret [%]": 100.0 * np.mean(regret),
        "largest regret [%]": 100.0 * np.max(regret),
        "best found after": float(np.median(spent)),
        "by chance [%]": 100.0 * evaluations / len(values),
    }


def rows() -> Iterator[dict[str, Any]]:
    """Both measures."""
    for name in ("p_max", "inside"):
        yield outcome(name)


def test_a_tenth_of_the_designs_finds_the_best_of_all_more_often_than_not() -> None:
    """Searches of 48 designs find the least p_max of 480 for most seeds, by chance for a tenth."""
    values = measures("p_max")
    assert optimum(values) == (0.5, 2.0, 2, 60.0, 25.0)
    result = outcome("p_max", seeds=range(5))
    assert result["computed"] == TENTH
    assert result["hits [%]"] > 50.0


def test_an_optimum_inside_the_grid_is_found() -> None:
    """A measure with its least value inside, where no bound helps."""
    values = measures("inside")
    best = optimum(values)
    for value, given in list(zip(best, PARAMETERS.values(), strict=True))[1:]:
        assert min(given) < value < max(given)
    result = outcome("inside", seeds=(0, 1))
    assert result["hits [%]"] == pytest.approx(100.0)
