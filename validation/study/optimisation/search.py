"""The search itself: optuna asks for designs, the engine of studies computes them, rows are told.

optuna: ask and tell, whole and real variables, limits and two measures in one well-kept library.
Its sampler alone ends beside the optimum of the paper's designs for half of the seeds, so that a
search of one measure ends with a compass search around the best design.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from geometry.answer import title_of
from validation.errors import InputError
from validation.study.optimisation.statement import Limit, Optimisation
from validation.study.rowfile import StudyRows
from validation.study.run import Runner, Tally, computed, sweep
from validation.study.study import DesignRow

Places = tuple[int, ...]
#: Designs at random before the sampler learns, and those that all fail before a search ends.
_STARTS, _ALL_FAILED = 10, 20
#: Part of the evaluations that the sampler chooses; the others lie near the best design.
_SAMPLED = 0.5
#: Designs that differ in so many variables at most count as of one valley.
_SAME_VALLEY = 2
#: Times that the sampler may ask again for known designs before the nearest new one is taken.
_REPEATS = 20


@dataclass(frozen=True)
class Point:
    """One design with the worst of its cases."""

    places: Places
    """Place of each variable's value in its list."""
    row: dict[str, Any]
    """Columns of its rows: of each measure the worst case; ``status`` and ``message``."""
    excess: tuple[float, ...]
    """By how much each limit is exceeded [-]; 0: it is met."""

    @property
    def failed(self) -> bool:
        """Whether nothing could be computed."""
        return bool(self.row["status"] == "failed")

    @property
    def feasible(self) -> bool:
        """Whether it was computed and meets all limits."""
        return not self.failed and not any(self.excess)

    def scores(self, measures: Iterable[str]) -> tuple[float, ...] | None:
        """Values to minimise; None where there are none."""
        values = tuple(self.row.get(name) for name in measures)
        return None if self.failed or None in values else tuple(map(float, values))  # type: ignore[arg-type]


def worst_of(rows: list[Mapping[str, Any]]) -> dict[str, Any]:
    """Worst value of each column over the cases of a design, with its own error bar.

    A case that failed or lacks a value leaves none.
    """
    failed = next((row for row in rows if row["status"] == "failed"), None)
    result = dict(rows[0] if failed is None else failed)
    if failed is not None or len(rows) == 1:
        return result
    for name in result:
        values = [row[name] for row in rows]
        if name.endswith("_error") or not all(isinstance(v, int | float | None) for v in values):
            continue
        if None in values:
            result |= {name: None} | ({f"{name}_error": None} if f"{name}_error" in result else {})
            continue
        of = (min if title_of(name).least else max)(range(len(rows)), key=lambda k: values[k])
        result[name] = values[of]
        if f"{name}_error" in result:
            result[f"{name}_error"] = rows[of][f"{name}_error"]
    mechanisms = {row.get("mechanism") for row in rows} - {"locked"}
    if "mechanism" in result and mechanisms:
        result["mechanism"] = mechanisms.pop()
    result["message"] = "; ".join(dict.fromkeys(r["message"] for r in rows if r["message"]))
    return result


@dataclass
class Search:
    """A search under way: what is known, and which design comes next."""

    stated: Optimisation
    points: dict[Places, Point] = field(default_factory=dict)
    """Designs whose cases are all computed, in the order in which they were."""
    _rows: dict[int, Mapping[str, Any]] = field(default_factory=dict)
    _asked: dict[Places, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        optuna = _optuna()
        sampler = optuna.samplers.TPESampler(
            seed=self.stated.seed,
            n_startup_trials=_STARTS,
            multivariate=True,
        )
        self._space = {
            path: optuna.distributions.IntDistribution(0, len(values) - 1)
            for path, values in self.stated.variables
        }
        self._study = optuna.create_study(
            sampler=sampler, directions=["minimize"] * len(self.stated.measures)
        )

    # ------------------------------------------------------------------------------------------

    def take(self, row: Mapping[str, Any]) -> Point | None:
        """Take in a row; returns its design when all of its cases are there."""
        self._rows[row["number"]] = row
        places = self.stated.places(row["number"])
        numbers = self.stated.numbers(places)
        if places in self.points or not all(number in self._rows for number in numbers):
            return None
        of = worst_of([self._rows[number] for number in numbers])
        excess = (
            ()
            if of["status"] == "failed"
            else tuple(limit.excess(of) for limit in self.stated.limits)
        )
        point = Point(places, of, excess)
        self.points[places] = point
        self._tell(point)
        return point

    def _tell(self, point: Point) -> None:
        """Tell the sampler; a design without an answer exceeds every limit."""
        trial = self._asked.pop(point.places, None)
        scores, constraints = self._lesson(point)
        if trial is not None:
            self._end(trial, scores, constraints)
        elif scores is not None:
            told = _optuna().trial.create_trial(
                params=dict(zip(self._space, point.places, strict=True)),
                distributions=self._space,
                values=list(scores),
                constraints=constraints,
            )
            self._study.add_trial(told)

    def _lesson(self, point: Point) -> tuple[tuple[float, ...] | None, dict[str, float]]:
        """Values and excess over the limits that the sampler learns from a design.

        One without values counts as the worst one known, outside the limits.
        """
        scores = point.scores(self.stated.measures)
        excess = point.excess if scores is not None else (1.0,) * len(self.stated.limits)
        names = [limit.name for limit in self.stated.limits]
        constraints = dict(zip(names, excess, strict=False)) | {"answer": float(scores is None)}
        if scores is None:
            known = [p.scores(self.stated.measures) for p in self.points.values()]
            answered = [s for s in known if s is not None]
            scores = tuple(map(max, zip(*answered, strict=True))) if answered else None
        return scores, constraints

    def _end(
        self, trial: Any, scores: tuple[float, ...] | None, constraints: Mapping[str, float]
    ) -> None:
        """End a trial of the sampler; without values it has failed."""
        for name, value in constraints.items():
            trial.set_constraint(name, value)
        if scores is None:
            self._study.tell(trial, state=_optuna().trial.TrialState.FAIL)
        else:
            self._study.tell(trial, list(scores))

    def numbers(self) -> Iterator[int]:
        """Designs of the study to compute next, all cases of one point together."""
        while (places := self._next()) is not None:
            for number in self.stated.numbers(places):
                if number not in self._rows:
                    yield number

    def _next(self) -> Places | None:
        """Next point; None where the evaluations are spent or all designs are known."""
        if len(self.points) + len(self._asked) >= min(self.stated.evaluations, self._count):
            return None
        if len(self.points) >= _ALL_FAILED and all(p.failed for p in self.points.values()):
            raise no_design(self)
        spent = len(self.points) + len(self._asked)
        # The sampler comes near an optimum of one measure, and seldom onto it.
        sampled = len(self.stated.measures) == 2 or spent < _SAMPLED * self.stated.evaluations
        places: Places = (0,) * len(self._space)
        for _ in range(_REPEATS if sampled or not self.feasible else 0):
            trial = self._study.ask(self._space)
            places = tuple(trial.params[path] for path in self._space)
            if self._is_new(places):
                self._asked[places] = trial
                return places
            known = self.points.get(places)
            self._end(trial, *((None, {}) if known is None else self._lesson(known)))
        places = self._near() if self.feasible else self._nearest_new(places)
        self._asked[places] = None
        return places

    @property
    def _count(self) -> int:
        """Designs that there are."""
        return self.stated.study.n_designs // self.stated.n_cases

    def _near(self) -> Places:
        """New design beside a good one: of the best, then of good ones far from those searched."""
        searched = list[Places]()
        for point in self.feasible:
            if any(_axes_apart(point.places, other) <= _SAME_VALLEY for other in searched):
                continue
            beside = next(filter(self._is_new, self._beside(point.places)), None)
            if beside is not None:
                return beside
            searched.append(point.places)
        return self._nearest_new(searched[0])

    def _beside(self, places: Places) -> Iterator[Places]:
        """Designs that differ in one variable, by halved steps."""
        sizes = [len(values) for _, values in self.stated.variables]
        largest = max(1, *(size // 4 for size in sizes))
        for step in (largest >> k for k in range(largest.bit_length())):
            for axis, size in enumerate(sizes):
                for end in (places[axis] - step, places[axis] + step):
                    yield (*places[:axis], min(max(end, 0), size - 1), *places[axis + 1 :])

    def _nearest_new(self, places: Places) -> Places:
        """Design nearest to a known one, by single steps of the lists."""
        rim, seen = [places], {places}
        sizes = [len(values) for _, values in self.stated.variables]
        for at in rim:
            if self._is_new(at):
                return at
            for axis, size in enumerate(sizes):
                for end in (at[axis] - 1, at[axis] + 1):
                    near = (*at[:axis], end, *at[axis + 1 :])
                    if 0 <= end < size and near not in seen:
                        seen.add(near)
                        rim.append(near)
        return places

    def _is_new(self, places: Places) -> bool:
        return places not in self.points and places not in self._asked

    # ------------------------------------------------------------------------------------------

    @property
    def feasible(self) -> list[Point]:
        """Designs that meet all limits, the least first measure first."""
        measures = self.stated.measures
        result = [p for p in self.points.values() if p.feasible and p.scores(measures) is not None]
        return sorted(result, key=lambda p: (p.scores(measures), p.places))

    @property
    def at_bounds(self) -> dict[str, Any]:
        """Values of the best design that are the first or last of their variable, by its name."""
        best = self.feasible[0].places
        stated = zip(self.stated.variables, best, strict=True)
        return {path: v[place] for (path, v), place in stated if place in (0, len(v) - 1)}

    @property
    def best(self) -> list[Point]:
        """The Pareto front; of one measure the designs with the least value."""
        return front(self.feasible, self.stated.measures)

    @property
    def finalists(self) -> list[Point]:
        """Designs that are judged again: the front first, evenly along it, then the next ones.

        Of one measure the worst design comes last: whether it stays so says how far the search can
        be believed.
        """
        count, best, feasible = self.stated.finalists, self.best, self.feasible
        if len(self.stated.measures) == 2 and len(best) > count > 1:
            return [best[round(k * (len(best) - 1) / (count - 1))] for k in range(count)]
        first = [*best, *(p for p in feasible if p not in best)][:count]
        alone = len(self.stated.measures) == 1 and feasible[-1] not in first
        return [*first, feasible[-1]] if alone else first


def _axes_apart(one: Places, other: Places) -> int:
    """Number of variables in which two designs differ."""
    return sum(a != b for a, b in zip(one, other, strict=True))


def front(points: list[Point], measures: tuple[str, ...]) -> list[Point]:
    """Points that no other one beats in one measure without loss in the others."""
    scores = {p.places: p.scores(measures) for p in points}

    def beaten(mine: tuple[float, ...]) -> bool:
        return any(
            other != mine and all(o <= m for o, m in zip(other, mine, strict=True))
            for other in scores.values()
            if other is not None
        )

    return [p for p in points if not beaten(scores[p.places] or ())]


def run_search(
    search: Search,
    results: StudyRows,
    runner: Runner,
    on_point: Callable[[], None] | None = None,
) -> Tally:
    """Compute designs until the evaluations are spent; rows that the file holds count."""
    for row in results.rows():
        search.take(row)

    def follow(row: DesignRow) -> None:
        point = search.take(row.flat)
        if on_point is not None and point is not None:
            on_point()

    tally = sweep(results, runner, on_row=follow, numbers=search.numbers())
    if not search.feasible:
        raise no_design(search)
    return tally


def no_design(search: Search) -> InputError:
    """One line: what stands against every design, and the nearest that can be met."""
    stated, points = search.stated, list(search.points.values())
    name, computed = stated.study.name, [p for p in points if not p.failed]
    if not computed:
        words = f"{name}: none of {len(points)} designs can be computed; the first: "
        return InputError(words + f"{points[0].row['message']}; expected other [variables]")
    answered = [p for p in computed if p.scores(stated.measures) is not None]
    if not answered:
        return InputError(
            f"{name}: none of {len(computed)} designs has {' and '.join(stated.measures)}: "
            "the load is not carried, or the mesh does not resolve it"
        )
    nearest = min(answered, key=lambda p: (sum(p.excess), p.places))
    unmet = [limit for limit, e in zip(stated.limits, nearest.excess, strict=True) if e > 0.0]
    at = ", ".join(
        f"{path} = {value:g}" if isinstance(value, float) else f"{path} = {value}"
        for path, value in stated.values(nearest.places).items()
    )
    limits = " and ".join(limit.words for limit in unmet)
    has = ", ".join(_value_words(limit, nearest.row) for limit in unmet)
    return InputError(
        f"{name}: none of {len(answered)} designs meets {limits}; the nearest has {has} ({at})"
    )


def _value_words(limit: Limit, row: Mapping[str, Any]) -> str:
    if limit.name == "locked":
        return f"mechanism {row['mechanism']}"
    value = row[limit.name]
    return f"{limit.name} {'no value' if value is None else f'{value:.5g}'}"


def judged_finalists(search: Search, results: StudyRows, runner: Runner) -> list[Point]:
    """Compute the finalists with the answer that decides, best first; failed ones last."""
    stated = search.stated
    wanted = [p.places for p in search.finalists]
    numbers = [number for places in wanted for number in stated.numbers(places)]
    rows = iter(computed(results, runner, numbers))
    points = [Point(places, worst_of(list(islice(rows, stated.n_cases))), ()) for places in wanted]
    return sorted(
        points, key=lambda p: (p.scores(stated.measures) is None, p.scores(stated.measures) or ())
    )


def _optuna() -> Any:
    try:
        import optuna
    except ImportError:
        raise InputError(
            "optimise: needs the library optuna: pip install 'tubelock[optimise]'"
        ) from None
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    return optuna
