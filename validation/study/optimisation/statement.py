"""What `tubelock optimise` is asked: measures, variables and limits, on one study.

Every variable has a list of values, so a search is a study of which few designs are computed::

    scene = "tsb1-pipe"
    minimise = "p_max"                     # or two measures: their Pareto front
    evaluations = 60
    [variables]
    "block.amplitude" = { from = 10, to = 25 }              # real: 101 values
    "block.blocks_per_layer" = { from = 2, to = 6, step = 1 }
    [limits]
    locked = true
    volume = { most = 8e7 }
    [judge]                                # the best few again, and the worst
    quantity = "fem"                       # so without [judge] too, where blocks are rigid
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

from geometry.answer import FACTORS
from validation.errors import InputError
from validation.scene.keys.toml_text import flat
from validation.scene.read import read_text
from validation.study.scene_study import (
    MOST_DESIGNS,
    SceneStudy,
    check_keys,
    check_study,
    did_you_mean,
    parameter_values,
)
from validation.study.study import COLUMNS, MEASURES

#: Steps of a real variable between its bounds: most, and fewest where there are many variables.
_STEPS, _FEWEST = 100, 10
_KEYS = (
    "scene",
    "quantity",
    "accuracy",
    "minimise",
    "evaluations",
    "seed",
    "variables",
    "cases",
    "limits",
    "settings",
    "judge",
)
_JUDGE_KEYS = ("quantity", "accuracy", "count", "settings")
_EVALUATIONS, _FINALISTS = 60, 3
#: Columns that say how a solver went, not how good a design is.
_NOT_MINIMISED = ("residual", "energy_balance", "equilibrium", "iterations", "mechanism")


@dataclass(frozen=True)
class Limit:
    """A bound of one column: a design within it has an excess of 0."""

    name: str
    """Column, ``locked`` or ``castable``."""
    least: float = -math.inf
    most: float = math.inf

    def excess(self, row: Mapping[str, Any]) -> float:
        """Relative distance to the bound; 1 where the row has no such value."""
        if self.name == "locked":
            return float(row["mechanism"] != "locked")
        value = row[self.name]
        if value is None:
            return 1.0
        below, above = self.least - value, value - self.most
        nearest = self.least if below > 0.0 else self.most
        return max(0.0, below, above) / max(abs(nearest), 1e-12)

    @property
    def words(self) -> str:
        """The limit as it is stated."""
        bounds = (("at least", self.least), ("at most", self.most))
        stated = [f"{word} {value:g}" for word, value in bounds if math.isfinite(value)]
        return " ".join([self.name, *stated])


@dataclass(frozen=True)
class Optimisation:
    """A checked search."""

    study: SceneStudy
    """All designs: cases first, then variables; few of them are computed."""
    cases: tuple[str, ...]
    """Parameters over which the worst answer counts, such as ``load.case``."""
    measures: tuple[str, ...]
    """One or two columns; less is better."""
    limits: tuple[Limit, ...]
    evaluations: int
    """Designs that are computed at most, of each all cases."""
    seed: int
    judge: SceneStudy | None
    """The same designs with the answer that decides; None: the search decides."""
    finalists: int
    """Designs that are computed again by `judge`."""

    @property
    def variables(self) -> list[tuple[str, tuple[Any, ...]]]:
        """Names and values of what is sought."""
        return [(path, v) for path, v in self.study.parameters if path not in self.cases]

    @property
    def n_cases(self) -> int:
        """Answers of one design."""
        return math.prod(len(v) for path, v in self.study.parameters if path in self.cases)

    def numbers(self, places: tuple[int, ...]) -> list[int]:
        """Designs of the study that make up one point: one for each case."""
        sizes = [len(values) for _, values in self.variables]
        number = 0
        for place, size in zip(places, sizes, strict=True):
            number = number * size + place
        count = math.prod(sizes)
        return [case * count + number for case in range(self.n_cases)]

    def places(self, number: int) -> tuple[int, ...]:
        """Place of each variable's value in its list, of a design of the study."""
        result = []
        for _, values in reversed(self.variables):
            number, place = divmod(number, len(values))
            result.append(place)
        return tuple(reversed(result))

    def values(self, places: tuple[int, ...]) -> dict[str, Any]:
        """Values of the variables at a point."""
        return {path: v[k] for (path, v), k in zip(self.variables, places, strict=True)}


def load_optimisation(source: str, overrides: Iterable[str] = ()) -> Optimisation:
    """Read and check a search from a TOML file."""
    path = Path(source)
    try:
        data = tomllib.loads(read_text(path, "a search in TOML"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source}: TOML syntax error: {error}") from None
    result = check_optimisation(data, path.stem, path.parent, overrides)
    return replace(result, study=replace(result.study, reads=(path, *result.study.reads)))


def check_optimisation(
    data: Mapping[str, Any],
    name: str = "search",
    folder: Path | None = None,
    overrides: Iterable[str] = (),
) -> Optimisation:
    """Check the data of a search."""
    check_keys(name, data, _KEYS)
    overrides = tuple(overrides)
    variables, cases = _section(name, data, "variables"), _section(name, data, "cases")
    if not variables:
        raise InputError(
            f"{name}: [variables] is missing or empty: name at least one key of the scene with "
            'its bounds, e.g. "block.amplitude" = { from = 10, to = 25 }'
        )
    ranges = _with_steps(name, dict(flat(variables)), dict(flat(cases)))
    stated = {
        "scene": data.get("scene"),
        "quantity": data.get("quantity", "rigid"),
        **({"accuracy": data["accuracy"]} if "accuracy" in data else {}),
        "parameters": dict(flat(cases)) | ranges,
        "settings": dict(flat(_section(name, data, "settings"))),
    }
    study = check_study(stated, name, folder, overrides)
    judge, count = _judge(name, data, stated, folder, overrides)
    measures = _measures(name, data.get("minimise"), study, judge)
    return Optimisation(
        study=study,
        cases=tuple(path for path, _ in flat(cases)),
        measures=measures,
        limits=_limits(name, data, study),
        evaluations=_whole(f"{name}: evaluations", data.get("evaluations", _EVALUATIONS), 1),
        seed=_whole(f"{name}: seed", data.get("seed", 0), 0),
        judge=judge,
        finalists=count,
    )


def _section(name: str, data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    result = data.get(key, {})
    if not isinstance(result, Mapping):
        raise InputError(f"{name}: [{key}]: expected a section, got {result!r}")
    return result


def _with_steps(
    name: str, variables: Mapping[str, Any], cases: Mapping[str, Any]
) -> dict[str, Any]:
    """Ranges of real variables with steps: as many as a study can number."""
    real = (
        [path for path, given in variables.items() if set(given) == {"from", "to"}]
        if all(isinstance(given, Mapping | list) for given in variables.values())
        else []
    )
    others = math.prod(
        len(parameter_values(f"{name}: {path}", given))
        for path, given in (*variables.items(), *cases.items())
        if path not in real
    )
    steps = _STEPS if not real else int((MOST_DESIGNS / others) ** (1.0 / len(real))) - 1
    steps = max(_FEWEST, min(_STEPS, steps))
    return {
        path: _with_step(f"{name}: {path}", given, steps) if path in real else given
        for path, given in variables.items()
    }


def _with_step(place: str, given: Mapping[str, Any], steps: int) -> dict[str, float]:
    """Range of a real variable with the step that makes it a list of values."""
    start, stop = given["from"], given["to"]
    for value in (start, stop):
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (number and math.isfinite(value)):
            raise InputError(f"{place}: got {dict(given)!r}, expected two finite numbers")
    if not start < stop:
        raise InputError(f"{place}: got from {start:g} to {stop:g}; expected from below to")
    span = Decimal(repr(stop)) - Decimal(repr(start))
    return {"from": float(start), "to": float(stop), "step": float(span / steps)}


def _whole(place: str, value: Any, least: int) -> int:
    if type(value) is not int or value < least:
        raise InputError(f"{place}: got {value!r}, expected a whole number of at least {least}")
    return value


def _measures(
    name: str, given: Any, study: SceneStudy, judge: SceneStudy | None
) -> tuple[str, ...]:
    """One or two columns that both the search and the judge have."""
    columns = [
        c
        for c, kind in COLUMNS[study.quantity].items()
        if kind != "TEXT" and c not in _NOT_MINIMISED and not c.endswith("_error")
        if judge is None or c in COLUMNS[judge.quantity]
    ]
    measures = (given,) if isinstance(given, str) else given
    if not isinstance(measures, list | tuple) or not 1 <= len(measures) <= 2:
        raise InputError(
            f"{name}: minimise: got {given!r}, expected a measure, e.g. "
            f'"{MEASURES[study.quantity][0]}", or a list of two'
        )
    for measure in measures:
        if measure not in columns:
            raise InputError(
                f"{name}: minimise: got {measure!r}, expected one of {', '.join(columns)}"
            )
    return tuple(measures)


def _limits(name: str, data: Mapping[str, Any], study: SceneStudy) -> tuple[Limit, ...]:
    result: list[Limit] = []
    for key, given in _section(name, data, "limits").items():
        place = f"{name}: limits.{key}"
        if key == "castable":
            result += _castable(place, given, study)
        elif key == "locked":
            if given is not True or study.quantity != "rigid":
                raise InputError(f'{place}: expected true, of a search with quantity = "rigid"')
            result.append(Limit(key))
        else:
            result.append(_bound(place, key, given, study))
    return tuple(result)


def _castable(place: str, given: Any, study: SceneStudy) -> list[Limit]:
    """Limits of the scene for casting."""
    limits = study.case(0).limits
    stated = [
        Limit("least_wall", least=limits.least_wall or -math.inf),
        Limit("steepest_joint", most=limits.steepest_joint or math.inf),
    ]
    finite = [x for x in stated if math.isfinite(x.least) or math.isfinite(x.most)]
    if given is not True or not finite:
        raise InputError(
            f"{place}: expected true, of a scene with limits.least_wall [mm] or "
            "limits.steepest_joint [degrees]; set them in [settings]"
        )
    return finite


def _bound(place: str, key: str, given: Any, study: SceneStudy) -> Limit:
    columns = [
        c
        for c, kind in COLUMNS[study.quantity].items()
        if kind == "REAL" and c not in _NOT_MINIMISED and not c.endswith("_error")
    ]
    if key not in columns:
        raise InputError(
            f"{place}: no measure of this search{did_you_mean(key, columns)}; expected locked, "
            f"castable or one of {', '.join(columns)}"
        )
    bounds = given if isinstance(given, Mapping) else {}
    numbers = all(
        isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v)
        for v in bounds.values()
    )
    if not bounds or not set(bounds) <= {"least", "most"} or not numbers:
        raise InputError(f"{place}: got {given!r}, expected {{ least = … }} or {{ most = … }}")
    if key in FACTORS:
        _require_strength(place, key, study)
    return Limit(key, bounds.get("least", -math.inf), bounds.get("most", math.inf))


def _require_strength(place: str, factor: str, study: SceneStudy) -> None:
    strength = "tensile_strength" if factor == "cracking_factor" else "compressive_strength"
    if study.case(0).values.get(f"material.{strength}") is None:
        raise InputError(
            f"{place}: needs material.{strength} [MPa]; set it in [settings] or in the scene"
        )


def _judge(
    name: str,
    data: Mapping[str, Any],
    stated: Mapping[str, Any],
    folder: Path | None,
    overrides: tuple[str, ...],
) -> tuple[SceneStudy | None, int]:
    """Study of the last few designs, and how many they are; None where the search decides.

    Rigid blocks do not decide: without a table of its own their search is judged all the same,
    where deformable blocks have its measures.
    """
    given = _section(name, data, "judge")
    wanted = data.get("minimise")
    measures = [wanted] if isinstance(wanted, str) else wanted
    known = isinstance(measures, list) and set(map(str, measures)) <= set(COLUMNS["fem"])
    if not given and not (stated["quantity"] == "rigid" and known):
        return None, 0
    check_keys(f"{name}: judge", given, _JUDGE_KEYS)
    settings = dict(stated["settings"]) | dict(flat(given.get("settings", {})))
    one = {key: stated[key] for key in ("scene", "parameters")}
    one |= {"quantity": given.get("quantity", "fem"), "settings": settings}
    if "accuracy" in given:
        one["accuracy"] = given["accuracy"]
    count = _whole(f"{name}: judge.count", given.get("count", _FINALISTS), 1)
    return check_study(one, f"{name}-judge", folder, overrides), count
