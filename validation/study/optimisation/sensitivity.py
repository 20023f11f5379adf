"""`tubelock sensitivity`: difference quotients of the measures, with their errors.

Both sides of a difference have the same mesh. The error of a quotient is the change from the
double step; of deformable blocks the change from the coarser mesh is added. The difference between
the one-sided quotients of a smooth measure doubles with the step. Where it does not, half of it is
added to the error; where it grows as the step shrinks, the measure jumps and has no derivative.
Whole numbers, and values that no small step can change, go by whole steps: their error is half of
the difference between the quotients of both sides. An error larger than the derivative leaves none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeGuard

from rich.console import Console

from fem.accuracy.errors import is_negligible
from fem.method import Static
from geometry.answer import FACTORS, Answer, Measure, title_of
from geometry.errors import RefusedError
from validation.case import Case, require_deformable
from validation.errors import InputError, named
from validation.output.answer_files import answer_of_data
from validation.output.console import Printed, listing
from validation.output.files import write_csv
from validation.output.pictures.gallery import save_figure, subplots, wrapped
from validation.output.pictures.scales import BLUE, VERMILION
from validation.study.rowfile import StudyRows
from validation.study.run import computed, runner_for
from validation.study.study import AnswerStudy, DesignRow, Quantity, case_content, data_digest

Values = dict[str, Measure]
#: Measures in the order of the table; the largest mean of a facet where blocks have no p_max.
_MEASURES = (
    "p_max",
    "p_max_facet",
    "p_eff",
    "sigma_1_averaged",
    "max_displacement",
    "cracking_factor",
    "crushing_factor",
    "volume",
)
#: Whose place says that a measure's maximum has moved.
_PLACED = {"p_max": "p_max_facet"}
#: Sections whose numbers are parameters unless others are named; strengths alone matter to rigid
#: blocks of the material.
_SECTIONS = {"rigid": ("block", "assembly"), "fem": ("block", "assembly", "material")}
_RIGID_MATERIAL = ("compressive_strength",)
#: Numbers of [material] that no static answer depends on.
_NOT_STATIC = ("density",)
#: Strengths of [material], with which there are load factors.
_STRENGTHS = ("material.tensile_strength", "material.compressive_strength")
#: A place has moved by more than this part of its radius or a block's size [-].
_MOVED = 0.05
#: Elasticity that an axis of a picture shows at least, to both sides [-].
_LEAST_SPAN = 0.1
#: Rounding of a measure, relative [-].
_ROUNDING = 1e-9
#: Change over a step that is none, relative to the measure [-].
_NOTHING = 1e-6
#: Difference of one-sided quotients over that of the double step: half where the measure is smooth,
#: as large at a kink, twice at a jump [-].
_SMOOTH, _JUMP = 0.75, 1.5


@dataclass(frozen=True)
class Slope:
    """Derivative of one measure with respect to one parameter."""

    parameter: str
    value: float
    """Of the parameter in the scene."""
    unit: str
    """Of the parameter; empty where it has none."""
    step: float
    """Half of the difference of both sides, in the unit of the parameter."""
    measure: str
    base: float
    """Of the measure in the scene."""
    measure_unit: str
    derivative: float | None
    """In the unit of the measure over that of the parameter; None: there is none."""
    error: float
    """Of the derivative; where there is none, the size that it may have."""
    remark: str
    """Why there is no derivative, where the maximum changes place, or one side has no answer."""

    @property
    def elasticity(self) -> float:
        """Relative change of the measure over that of the parameter [-]; NaN: there is none."""
        if self.derivative is None or not (self.value and self.base):
            return math.nan
        return self.derivative * self.value / self.base

    @property
    def elasticity_error(self) -> float:
        """Error of `elasticity` [-]."""
        if self.derivative is None or not (self.value and self.base):
            return math.nan
        return abs(self.error * self.value / self.base)


@dataclass(frozen=True, repr=False)
class Sensitivity(Printed):
    """Derivatives of all measures of a scene."""

    name: str
    load: str
    """In words."""
    method: Quantity
    slopes: tuple[Slope, ...]
    failed: Mapping[str, str]
    """Parameters without a derivative, and why."""

    def print(self, console: Console) -> None:
        """Print one row for each measure and parameter, the largest elasticity first."""
        heads = ("parameter", "value", "step", "derivative", "elasticity", "remark")
        for measure in dict.fromkeys(s.measure for s in self.slopes):
            of = self.of(measure)
            unit = of[0].measure_unit
            words = (
                f"{self.name} ({self.method}): {title_of(measure).words} = {of[0].base:.5g} {unit}"
            )
            table = listing(words, *heads[:1], numbers=heads[1:5])
            table.add_column(heads[5])
            for slope in of:
                unit_words = f" {slope.unit}" if slope.unit else ""
                table.add_row(
                    slope.parameter,
                    f"{slope.value:g}{unit_words}",
                    f"± {slope.step:.3g}",
                    _with_error(slope.derivative, slope.error),
                    "–"
                    if math.isnan(slope.elasticity)
                    else _with_error(slope.elasticity, slope.elasticity_error),
                    slope.remark,
                )
            console.print(table)
        for parameter, why in self.failed.items():
            console.print(f"{parameter}: no derivative: {why}")
        console.print(f"± {self.covered}")

    @property
    def covered(self) -> str:
        """What the error of a derivative covers, and what not."""
        if self.method == "fem":
            return "is the error of the difference quotient and that of the mesh"
        return (
            "is the error of the difference quotient alone: derivatives of deformable blocks are "
            "others and may have the other sign (--method fem)"
        )

    def of(self, measure: str) -> list[Slope]:
        """Slopes of one measure, the largest elasticity first; those without one last."""
        result = [slope for slope in self.slopes if slope.measure == measure]
        without = [s for s in result if math.isnan(s.elasticity)]
        having = [s for s in result if not math.isnan(s.elasticity)]
        return [*sorted(having, key=lambda s: -abs(s.elasticity)), *without]

    @property
    def rows(self) -> list[dict[str, Any]]:
        """One for each slope by the names of its fields; numbers that are none are None."""
        both = ("elasticity", "elasticity_error")
        rows = [asdict(s) | {name: getattr(s, name) for name in both} for s in self.slopes]
        numbers = ("error", *both)
        for row in rows:
            row |= {name: None for name in numbers if not math.isfinite(row[name])}
        return rows

    def write(self, path: Path) -> None:
        """Write all numbers as CSV."""
        heads = (*Slope.__dataclass_fields__, "elasticity", "elasticity_error")
        write_csv(path, heads, (row.values() for row in self.rows))

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        failed = dict(self.failed)
        return {"scene": self.name, "method": self.method, "slopes": self.rows, "failed": failed}

    def draw(self, path: str | Path) -> None:
        """Draw a tornado of elasticities for each measure, with error bars."""
        measures = list(dict.fromkeys(s.measure for s in self.slopes))
        size = (4.2 * len(measures), 4.2)
        figure, axes = subplots(1, len(measures), size=size, squeeze=False, sharex=True)
        for panel, measure in zip(axes.flat, measures, strict=True):
            of = [(s.parameter.partition(".")[2], s) for s in reversed(self.of(measure))]
            values = [0.0 if math.isnan(s.elasticity) else s.elasticity for _, s in of]
            panel.barh(
                [name for name, _ in of],
                values,
                xerr=[0.0 if math.isnan(s.elasticity) else s.elasticity_error for _, s in of],
                color=[VERMILION if v > 0.0 else BLUE for v in values],
                capsize=3,
            )
            for place, (_, slope) in enumerate(of):
                if math.isnan(slope.elasticity):
                    why = "none" if slope.derivative is None else "value 0"
                    panel.annotate(f" {why}", (0.0, place), va="center", fontsize="small")
            panel.axvline(0.0, color="black", linewidth=0.8)
            panel.set_title(title_of(measure).words, loc="left", fontsize="medium")
            panel.set_xlabel("elasticity [–]")
            panel.grid(alpha=0.3, axis="x")
            panel.set_axisbelow(True)
        left, right = panel.get_xlim()  # round-off of results that do not change is no bar
        panel.set_xlim(min(left, -_LEAST_SPAN), max(right, _LEAST_SPAN))
        blocks = "rigid" if self.method == "rigid" else "deformable"
        title = f"{self.name}, {blocks} blocks: {self.load}; what changes the results"
        figure.suptitle(wrapped(title, size[0]), x=0.02, ha="left", fontsize="medium")
        save_figure(figure, Path(path))


def _with_error(value: float | None, error: float) -> str:
    """Value and error with the digits that the error leaves, five at most where it is smaller."""
    if value is None or value == error == 0.0:
        return "none"
    if not error > 0.0:
        return f"{value:.5g}"
    if error < 1e-5 * abs(value):
        return f"{value:.5g} ± {100 * error / abs(value):.1g} %"
    last = math.floor(math.log10(error)) - 1
    if -last > 6:
        digits = max(1, math.floor(math.log10(abs(value) or error)) - last + 1)
        return f"{value:.{digits}g} ± {error:.2g}"
    return f"{value:.{max(0, -last)}f} ± {error:.{max(0, -last)}f}"


# ---------------------------------------------------------------------------------------------
# Computation


def sensitivity_of(
    file: Case,
    store: Path,
    method: Quantity = "rigid",
    parameters: list[str] | None = None,
    step: float = 0.01,
    *,
    workers: int | None = 1,
    tell: Callable[[str], None] | None = None,
) -> Sensitivity:
    """Differentiate the measures of a scene.

    Parameters
    ----------
    file
        The scene.
    store
        File of the rows: one for each answer that a difference needs.
    method
        ``rigid`` or ``fem``.
    parameters
        ``section.key`` of numbers; None: all of block, assembly and (deformable) material.
    step
        Relative step of real parameters [-]; of a value of 0 the step itself.
    workers
        Processes; 1: this one, None: one for each core.
    tell
        Called with words after each answer.
    """
    if method not in _SECTIONS:
        raise InputError(f"sensitivity: method: got {method!r}; expected {' or '.join(_SECTIONS)}")
    if not 0.0 < step <= 0.2:
        raise InputError(f"--step {step:g}: expected a share above 0 and at most 0.2")
    chosen = _numbers_of(file, method) if parameters is None else parameters
    values = {path: _number(file, path) for path in chosen}
    nearby = _Nearby(_base(file, method), method, store, workers, tell or (lambda _: None))
    first = [(path, value, *_steps(value, step)[0]) for path, value in values.items()]
    nearby.compute([_BASE, *(point for one in first for point in _points(*one).values())])
    with named(file.name):
        base = nearby.values(_BASE)
    slopes, failed = list[Slope](), dict[str, str]()
    for path, value in values.items():
        parameter = _Parameter(path, value, file.unit(path), base)
        try:
            slopes += _slopes(parameter, step, nearby)
        except RefusedError as error:
            failed[path] = str(error)
    return Sensitivity(file.name, file.load_words, method, tuple(slopes), failed)


#: Key, value and number of meshes, from coarse to fine, of an answer.
Point = tuple[str, float, int]
#: Meshes of deformable blocks, and that on which the double step is answered.
_MESHES, _COARSE = 2, 1
#: The scene as it is stated.
_BASE: Point = ("", 0.0, _MESHES)
#: Error bars that choose the meshes of deformable blocks [-].
_ACCURACY = dict.fromkeys(("p_max", "p_eff", "sigma_1_averaged", "max_displacement"), 0.05)


def _steps(value: float, share: float) -> list[tuple[float, bool]]:
    """Steps of a number, the first that can be answered counts, and whether each is small."""
    if isinstance(value, int):
        return [(1, False)]
    return [(share * abs(value) if value else share, True), (0.5, False), (1.0, False)]


def _points(path: str, value: float, step: float, small: bool) -> dict[int, Point]:
    """Answers that a derivative needs, by the number of steps; the double ones on the coarse mesh.

    Small steps alone have double ones.
    """
    meshes = {-1: _MESHES, 1: _MESHES} | ({-2: _COARSE, 2: _COARSE} if small else {})
    return {k: (path, value + k * step, meshes[k]) for k in meshes}


def _base(file: Case, method: Quantity) -> Case:
    """Case that is changed: as it is stated, deformable blocks on the first of finer meshes."""
    if method == "rigid":
        return file.with_method("rigid")
    from fem.accuracy.converge import why_not_refined

    require_deformable(file, "sensitivity --method fem")
    static = file if isinstance(file.method, Static) else file.with_method("static")
    with named(file.name):
        why = why_not_refined(static.problem)
    if why is not None or static.problem.after is not None:
        raise InputError(
            f"{file.name}: sensitivity --method fem: got {why or 'a load after another'}, whose "
            "mesh is not refined; expected a scene whose mesh is, such as tsb1-pipe, or --method "
            "rigid"
        )
    assert isinstance(static.method, Static)
    finer = {"mesh": "converged", "accuracy": _ACCURACY, "error_estimate": True, "frames": 0}
    return static.with_method(replace(static.method, **finer))  # type: ignore[arg-type]


@dataclass(frozen=True)
class PointStudy(AnswerStudy):
    """A scene with one number changed at a time."""

    base: Case = field(kw_only=True)

    @cached_property
    def digest(self) -> str:
        """Digest of the scene and its method."""
        return data_digest([super().digest, case_content(self.base)])

    def content(self, number: int) -> Any:
        """Return key, value and number of meshes."""
        return self.design(number)

    def case(self, number: int) -> Case:
        """Case of a design."""
        path, value, meshes = self.design(number)["point"]
        changed = {path: value} if path else {}
        if self.quantity == "fem":
            changed["fem.max_meshes"] = meshes
        name = f"{self.base.name}, {path} = {value:.6g}" if path else self.base.name
        return replace(self.base.changed(changed), name=name)


@dataclass
class _Nearby:
    """Answers to a scene with one number changed: rows of a `PointStudy`."""

    case: Case
    method: Quantity
    store: Path
    workers: int | None
    tell: Callable[[str], None]
    _rows: dict[Point, dict[str, Any]] = field(default_factory=dict)

    def compute(self, points: Sequence[Point]) -> None:
        """Take rows of some points from the store, and compute those that it lacks.

        Load factors on the coarse mesh are those of an answer of its own.
        """
        if self.method == "fem" and any(self.case.values.get(key) for key in _STRENGTHS):
            points = [(path, value, k) for path, value, n in points for k in range(1, n + 1)]
        study = PointStudy(self.case.name, self.method, (("point", tuple(points)),), base=self.case)
        done = 0

        def follow(row: DesignRow) -> None:
            nonlocal done
            done += 1
            self.tell(f"{row.parameters['point'][0] or 'as stated'}, {done} of {len(points)}")

        rows = StudyRows(self.store, study)
        runner = runner_for(study, self.workers if len(points) > 1 else 1)
        self._rows |= zip(points, computed(rows, runner, range(len(points)), follow), strict=True)

    def values(self, point: Point) -> list[Values]:
        """Measures at a point on its meshes, the volume of the blocks among them.

        Raises
        ------
        RefusedError
            A point without an answer.
        """
        if point not in self._rows:
            self.compute([point])
        path, value, meshes = point
        answer = _answer(self._rows[point])
        built = answer.report["dimensions"]
        last = dict(answer.measures)
        last["volume"] = Measure(built["volume"], built["units"]["volume"])
        if "p_max_facet" not in last:
            raise RefusedError("blocks do not carry the load: no pressures")
        if self.method == "rigid":
            return [last]
        solved = answer.report["meshes"]
        if len(solved) < meshes:
            ended = answer.report["accuracy"]["ended_by"]
            raise RefusedError(f"mesh {meshes} is not solved: {ended}; expected more fem.max_work")
        of_coarse = self._rows.get((path, value, _COARSE))
        factors = {} if of_coarse is None else _answer(of_coarse).measures
        coarse = {n: factors[n] for n in FACTORS if n in factors} | {"volume": last["volume"]}
        for name, value in solved[0]["measures"].items():
            coarse[name] = replace(last[name], value=value)
        return [coarse, last][-meshes:]


def _answer(row: Mapping[str, Any]) -> Answer:
    if row["status"] == "failed":
        raise RefusedError(row["message"])
    return answer_of_data(row["answer"])


def _numbers_of(file: Case, method: Quantity) -> list[str]:
    """All numbers of the sections that describe a block, in the order of the scene."""
    values = file.values
    numbers = [key for key, value in values.items() if key.count(".") == 1 and _is_number(value)]
    numbers = [key for name in _SECTIONS[method] for key in numbers if key.startswith(f"{name}.")]
    if method == "rigid":
        named = (f"material.{key}" for key in _RIGID_MATERIAL)
        return [*numbers, *(key for key in named if values.get(key) is not None)]
    return [path for path in numbers if path.partition(".")[2] not in _NOT_STATIC]


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(file: Case, path: str) -> float:
    value = file.values.get(path)
    if not _is_number(value):
        numbers = (key for key, of in file.values.items() if _is_number(of))
        below = [key for key in numbers if key.startswith(f"{path}.")]
        known = ", ".join(below or _numbers_of(file, "fem"))
        raise InputError(
            f"{file.name}: {path}: got {value!r}, expected a number of the scene, such as {known}"
        )
    return value


@dataclass(frozen=True)
class _Parameter:
    """A number of a scene that is changed."""

    path: str
    value: float
    unit: str
    base: list[Values]
    """Measures of the scene as it is."""

    def slope(self, name: str, step: float, derivative: float, error: float, remark: str) -> Slope:
        """Derivative of one measure; none where its error is larger, 0 where nothing changes.

        A measure that jumps has an infinite error. A stress that is negligible with its bar has no
        derivative: its changes are those of rounding and of the mesh.
        """
        of = self.base[-1][name]
        known = (self.path, self.value, self.unit, float(step), name, of.value, of.unit)
        if is_negligible(self.base[-1], name):
            return Slope(
                *known, None, abs(derivative) + error, "negligible beside the largest stress"
            )
        if max(abs(derivative), error) <= _NOTHING * abs(of.value) / step:
            return Slope(*known, 0.0, 0.0, "no change")
        if error <= abs(derivative):
            return Slope(*known, derivative, error, remark)
        return Slope(*known, None, error, "; ".join(filter(None, (_why_none(error), remark))))


def _why_none(error: float) -> str:
    """Why a measure has no derivative."""
    if math.isinf(error):
        return "the measure jumps within the step"
    return f"within ± {error:.2g}: the sign is not determined"


def _slopes(of: _Parameter, share: float, nearby: _Nearby) -> list[Slope]:
    """Derivatives with respect to one parameter, by its first step that can be answered.

    Of a whole step one side is enough.
    """
    why: RefusedError | None = None
    for step, small in _steps(of.value, share):
        sides: dict[int, list[Values]] = {}
        for k, point in _points(of.path, of.value, step, small).items():
            try:
                sides[k] = nearby.values(point)
            except RefusedError as error:
                why = why or error
        if len(sides) == 4 or (sides and not small):
            return [_slope(of, name, step, sides) for name in _common(of.base, *sides.values())]
    raise why or InputError(f"{of.path}: no step makes a tube")


def _slope(of: _Parameter, name: str, step: float, sides: Mapping[int, list[Values]]) -> Slope:
    """Derivative of one measure from its answers, by the number of steps."""
    answers = {0: of.base, **sides}
    value = {k: [mesh[name].value for mesh in answers[k]] for k in answers}
    near = [answers[k][-1] for k in (-1, 0, 1) if k in answers]
    remark = _moved(name, *near)
    if 2 in value:
        derivative, error = _of_small_step(value, step)
        return of.slope(name, step, derivative, error, remark)
    both = [(value[k][-1] - value[0][-1]) / (k * step) for k in (-1, 1) if k in value]
    if len(both) == 1:
        one = "upward" if 1 in value else "downward"
        remark = "; ".join(filter(None, (f"a step {one} alone", remark)))
    error = abs(both[-1] - both[0]) / 2 if len(both) == 2 else abs(both[0])
    return of.slope(name, step, sum(both) / len(both), error, remark)


def _of_small_step(value: Mapping[int, list[float]], step: float) -> tuple[float, float]:
    """Central quotient and its error, of values by the number of steps, from coarse to fine.

    The double step, on the coarsest mesh, bounds what the step leaves out.
    """
    pairs = zip(value[-1], value[1], strict=True)
    quotients = [(high - low) / (2 * step) for low, high in pairs]
    double = (value[2][0] - value[-2][0]) / (4 * step)
    error = abs(quotients[0] - double) + abs(quotients[-1] - quotients[0])
    error += _ROUNDING * abs(value[0][-1]) / step
    return quotients[-1], error + _roughness(*(value[k][0] for k in range(-2, 3)), step=step)


def _roughness(
    low2: float, low: float, middle: float, high: float, high2: float, *, step: float
) -> float:
    """Error of a central quotient of a measure that is not smooth; infinite where it jumps.

    Values on one mesh, two steps to both sides.
    """
    one = abs(high - 2.0 * middle + low) / step
    double = abs(high2 - 2.0 * middle + low2) / (2.0 * step)
    slope = abs(high - low) / (2.0 * step)
    if one <= _SMOOTH * double + _NOTHING * abs(middle) / step:
        return 0.0
    return math.inf if one > max(_JUMP * double, slope) else 0.5 * one


def _common(*answers: list[Values]) -> list[str]:
    """Measures that all answers have on every mesh, as numbers."""
    every = [values for answer in answers for values in answer]
    names = [
        name
        for name in _MEASURES
        if all(name in v and not v[name].remark and math.isfinite(v[name].value) for v in every)
    ]
    return [name for name in names if name != "p_max_facet" or "p_max" not in names]


def _moved(name: str, *answers: Values) -> str:
    """Say from where to where a maximum moves, copies by symmetry aside; nothing if it stays."""
    places = [a[_PLACED.get(name, name)].place for a in answers if _PLACED.get(name, name) in a]
    known = [place for place in places if place is not None and "position" in place]
    if len(known) < len(answers):
        return ""
    words = []
    for key in ("layer", "face", "radius", "height"):
        values = [place[key] for place in known if place.get(key) is not None]
        if len(values) < len(known) or not _differ(values, known[0].get("radius", math.inf)):
            continue
        shown = [f"{v:.0f}" if isinstance(v, float) else str(v) for v in values]
        unit = " mm" if isinstance(values[0], float) else ""
        words.append(f"{key} {' → '.join(shown)}{unit}")
    return f"the maximum changes place: {', '.join(words)}" if words else ""


def _differ(values: list[Any], size: float) -> bool:
    """Whether names or numbers differ, lengths by more than a part of a size [mm]."""
    if not isinstance(values[0], float):
        return len(set(values)) > 1
    return max(values) - min(values) > _MOVED * max(abs(size), *map(abs, values))
