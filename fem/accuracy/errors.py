"""The rule of error bars: what changes between meshes say of the last value.

If the error of a value falls by a factor R from one mesh to another one, that of the second is the
change between them over R - 1. Changes may vanish by chance and coarse meshes need not be in their
asymptotic range: so several meshes are compared, the largest estimate counts, and a factor of
safety comes on top (as in Roache's grid convergence index). What half as many load steps change is
added.

On finer and finer meshes (`sequence_bars`) factors are powers of their fineness, the squared degree
over the size of elements: errors at edges fall so, since the h-p-version converges by h over p²
where a solution is not smooth. Both meshes before the last are compared, in each direction that is
finer, so that one agreement by chance is no convergence. A pressure at a point whose changes do not
shrink as the rate demands falls as slowly as they say: it may have its peak where the mesh is not
yet fine.

One mesh (`one_mesh_bars`) is compared with coarser ones: a run on a mesh with 1/r of the elements
along every edge has r times the error, or a smaller power of it where three meshes show that; of
two meshes the factor of safety is larger. Elements of degree two and more are judged by the same
elements of another degree, whose error is a fixed multiple: means over facets are those over the
same facets then.

Peaks are known from two sides (`fem.answer.measures.bracketed`). Contact forces are in balance on
facets, so means over them lie below a peak of pressure and values at their corners, continued
outwards by a steep law, above it: an error bar is at least the distance. Stresses inside elements
and at their corners lie on the same side: what an element hides comes on top of what the mesh
leaves out.

A value that a few elements decide is not known better than others settle: two meshes may agree by
chance. Stresses at edges peak at the same edges: those of degree two and more on one mesh are known
no better than the worst of them. Rates and shares were chosen on problems that
``python -m tests.verification error-bars`` solves; docs/trust/error-bars.md states how they are
judged.

References: P. J. Roache, Perspective: a method for uniform reporting of grid refinement studies, J.
Fluids Eng. 116 (1994) 405-413; I. Babuška, M. Suri, The h-p version of the finite element method
with quasiuniform meshes, ESAIM: M2AN 21 (1987) 199-238.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fem.accuracy.ladder import AT_EDGES, INTEGRALS, OF_FACETS, Rung
from geometry.answer import Measure
from geometry.mesh import FloatArray
from geometry.parts.rows import Row, grouped

#: Factors of safety of one mesh beside others, of sequences of meshes, and of two meshes, of which
#: one is coarser or contact is searched. The last two are Roache's for three meshes and for two;
#: `tests/verification/error_bars.py` measures how often they suffice.
SAFETY, OF_SEQUENCES, OF_TWO = 1.5, 1.25, 3.0
#: Meshes whose fineness differs by a smaller share are as fine.
_SAME = 1e-6
#: Meshes before an error bar is believed: one agreement of two is no convergence.
LEAST_MESHES = 3
#: All values at a point.
_AT_A_POINT = (*AT_EDGES, "p_max_point")
#: Values that a few elements decide, beside those at edges.
LOCAL = frozenset({"p_max_point", "sigma_1_averaged"})
#: Why values have no error bar: stresses at edges before the mesh was refined there, and what
#: earlier meshes did not resolve.
AT_AN_EDGE = "not resolved (grows at an edge)"
BY_ONE_MESH = "not resolved (too few meshes reach this edge)"
#: Why values at a point are no numbers where the first mesh is the last.
ONE_MESH = "not resolved (one mesh, not converged)"
#: Why means over facets are no numbers where blocks move far.
TOO_FAR = "not resolved (blocks move too far for facets of small motions)"
#: Part of the largest last change that a local value is not known better than.
_SHARED = 0.3
#: The same of elements of degree two or more on one mesh: nine of ten bars hold in tests/fem.
_SHARED_OF_DEGREES = 1.0 / 3.0
#: The same of means over facets, which elements in one direction alone may not change.
_SHARED_OF_FACETS = 0.03
#: Measures whose errors fall with the distance of nodes: contact ends inside elements, where the
#: degree counts once. They have bars by that distance.
_BY_LENGTHS = frozenset({"max_displacement"})
#: Power of the fineness of a mesh by which errors fall; of values that few elements decide.
_RATE, _RATE_OF_FEW = 1.25, 1.0
#: A pressure at a point falls by the power that meshes show where that is less, at least by this
#: one. Shares, powers and factors of safety are judged by the tables of
#: docs/trust/error-bars.md, which replay them on kept meshes.
_SLOWEST = 0.5
#: Stresses below this share of the largest one need no finer mesh [-].
_NEGLIGIBLE = 1e-3
#: A value at an edge that changes by more than the first share of its value, and by more than the
#: second one of the change before, grows.
_GROWTH, _SLOWING = 0.05, 0.7
#: What coarser meshes judge beside them in elements of degree two or more.
_OF_MESHES = ("sigma_1_averaged", "p_max_point", "max_displacement", *AT_EDGES)

#: Values of measures, each in its unit.
Values = Mapping[str, float]


def error_bar(
    value: Any,
    others: Iterable[tuple[Any, float]],
    size: Callable[[Any], float] = abs,
    safety: float = SAFETY,
) -> float:
    """Estimated error of a value, 0 where nothing is compared with it.

    Parameters
    ----------
    value
        A number, or an array of whose changes there is a size.
    others
        The same on other meshes, each with the factor by which its error exceeds that of the value:
        more than 1 of coarser meshes, less of finer ones.
    size
        Size of a change.
    safety
        Factor of safety.
    """
    changes = (size(value - other) / abs(reduction - 1.0) for other, reduction in others)
    return safety * max(changes, default=0.0)


@dataclass(frozen=True)
class OnMesh:
    """Numbers of a problem on one of finer and finer meshes."""

    measures: Mapping[str, Measure]
    """Without errors."""
    rung: Rung
    fineness: float
    """Squared degree over the length of the shortest elements."""
    along: float
    """That along a course."""
    steps: Values = field(default_factory=dict)
    """Change of each measure by half as many load steps, in its unit."""
    beside: Mapping[str, Any] = field(default_factory=dict)
    """Elements, unknowns, CPU time and work, as plain data."""

    @property
    def values(self) -> dict[str, float]:
        """Of all measures, each in its unit."""
        return {name: measure.value for name, measure in self.measures.items()}

    def sizes(self, name: str) -> tuple[float, float]:
        """Fineness and that along a course, as the error of a measure falls with them."""
        degrees = self.rung.degree if name in _BY_LENGTHS else 1
        return self.fineness / degrees, self.along / degrees

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "degree": self.rung.degree,
            "fineness": self.fineness,
            "fineness_along": self.along,
            **self.beside,
            "measures": self.values,
            "not_resolved": [name for name, m in self.measures.items() if not m.resolved],
            "load_step_changes": dict(self.steps),
        }


def sequence_bars(meshes: Sequence[OnMesh], *, searched: bool = False) -> dict[str, float]:
    """Estimated errors of the measures of the last of two or more meshes, in their units.

    Measures that are `unresolved` have no bar. A value that a few elements decide has a bar of
    a share of the largest last change at least, relative to each value, of the displacement, p_eff
    and values of its kind; a mean over facets has one of a smaller share. Two meshes with
    ``searched`` contact, whose edges lie inside elements, show no rate, and may agree by chance:
    errors fall by half the power, and no value is known better than the largest change.
    """
    *before, last = meshes
    values, hidden, bars = last.values, unresolved(meshes), dict[str, float]()
    two = searched and len(before) == 1
    for name in [name for name in values if name not in hidden]:
        rate = _rate(meshes, name) / (1 + two)
        compared = [
            (mesh.measures[name].value, (fine / coarse) ** rate)
            for mesh in before[-2:]
            for fine, coarse in zip(last.sizes(name), mesh.sizes(name), strict=True)
            if fine > (1.0 + _SAME) * coarse
        ]
        bars[name] = error_bar(values[name], compared, safety=OF_TWO if two else OF_SEQUENCES)
    change = _largest_change(before[-1].measures, last.measures)
    shares = dict.fromkeys(LOCAL, _SHARED) | dict.fromkeys(OF_FACETS, _SHARED_OF_FACETS)
    if two:
        shares = dict.fromkeys(values, 1.0)
    shares = {name: share * change for name, share in shares.items()}
    return _with_steps(_at_least(bars, values, shares), last.steps)


def _rate(meshes: Sequence[OnMesh], name: str) -> float:
    """Power of the fineness by which the error of a measure is taken to fall."""
    rate = _RATE_OF_FEW if name in LOCAL or name in AT_EDGES else _RATE
    if name != "p_max_point" or len(meshes) < 3:
        return rate
    sizes = np.array([mesh.sizes(name) for mesh in meshes[-3:]])
    grows = (np.diff(sizes, axis=0) > _SAME * sizes[:-1]).all(axis=0)
    shown = [mesh.measures[name].value for mesh in meshes[-3:]]
    return _shown_rate(shown, sizes[:, 1 if grows[1] else 0], rate)


def _shown_rate(values: Sequence[float], fine: FloatArray, most: float) -> float:
    """Power of the fineness (3,) that three meshes show, between the slowest one and ``most``.

    Changes of an error c f^-r over the fineness f have the ratio (f₁^-r - f₂^-r) / (f₂^-r - f₃^-r).
    """
    one, two, three = values

    def excess(rate: float) -> float:
        left = fine**-rate
        return float((left[0] - left[1]) * abs(three - two) - (left[1] - left[2]) * abs(two - one))

    if excess(_SLOWEST) >= 0.0 and three != two:
        return _SLOWEST
    if excess(most) <= 0.0:
        return most
    low, high = _SLOWEST, most
    while high - low > 1e-12:
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
    return high


def one_mesh_bars(
    values: Values,
    meshes: Sequence[tuple[Values, float]],
    degrees: Sequence[tuple[Values, float]],
    sides: Values,
    steps: Values,
) -> dict[str, float]:
    """Estimated errors of measures on one mesh, in their units.

    Parameters
    ----------
    values
        On the mesh.
    meshes
        On coarser or finer meshes, each with the length of its elements over that of the mesh.
    degrees
        On the same elements of other degrees, each with its error over that of the mesh.
    sides
        How far both sides of peaks lie apart in the solution itself.
    steps
        What half as many load steps change.
    """
    two = len(meshes) == 1 and meshes[0][1] > 1.0
    bars, beside = _compared(values, meshes, OF_TWO if two else SAFETY), sides
    if degrees:
        beside = {name: bar for name, bar in bars.items() if name in _OF_MESHES}
        bars = _compared(values, degrees, SAFETY)
    bars = {
        name: (sum if name in AT_EDGES else max)((bar, beside.get(name, 0.0)))
        for name, bar in bars.items()
    }
    if degrees:
        widest = _widest(bars, values, LOCAL)
        edges = max(_SHARED_OF_DEGREES * widest, _widest(bars, values, AT_EDGES))
        shares = dict.fromkeys(LOCAL, _SHARED_OF_DEGREES * widest)
        shares |= dict.fromkeys(AT_EDGES, edges)
        changes = {n: abs(values[n] - of[n]) for of, _ in degrees for n in values.keys() & of}
        shares |= dict.fromkeys(OF_FACETS, _SHARED_OF_FACETS * _widest(changes, values, LOCAL))
        bars = _at_least(bars, values, shares)
    return _with_steps(bars, steps)


def _widest(bars: Values, values: Values, names: Iterable[str]) -> float:
    """Widest relative bar of some stresses, negligible ones left out."""
    sizes = {name: abs(values[name]) for name in names if name in bars}
    least = _NEGLIGIBLE * max(sizes.values(), default=0.0)
    return max((bars[name] / size for name, size in sizes.items() if size > least), default=0.0)


def _compared(
    values: Values, others: Sequence[tuple[Values, float]], safety: float
) -> dict[str, float]:
    """Bars of the measures that all others have: facets may match on one mesh alone.

    Two others and the mesh itself show by which rate stresses and pressures converge.
    """
    ordered = sorted([(values, 1.0), *others], key=lambda one: -one[1])
    fine = np.array([1.0 / length for _, length in ordered])
    bars = {}
    for name in [name for name in values if others and all(name in of for of, _ in others)]:
        rate = 1.0
        if len(ordered) == LEAST_MESHES and name not in _BY_LENGTHS:
            rate = _shown_rate([of[name] for of, _ in ordered], fine, rate)
        compared = [(of[name], length**rate) for of, length in others]
        bars[name] = error_bar(values[name], compared, safety=safety)
    return bars


def _at_least(bars: dict[str, float], values: Values, shares: Values) -> dict[str, float]:
    """Bars that are no narrower than shares of their values."""
    wider = {n: max(bars[n], shares[n] * abs(values[n])) for n in shares.keys() & bars.keys()}
    return bars | wider


def with_stick(bars: Mapping[str, float], change: Values) -> dict[str, float]:
    """Bars that no change by a tenth of the stick stiffness leaves; its error is a part of that."""
    return {name: max(bar, OF_SEQUENCES * change.get(name, 0.0)) for name, bar in bars.items()}


def _with_steps(bars: Values, steps: Values) -> dict[str, float]:
    return {name: bar + steps.get(name, 0.0) for name, bar in bars.items()}


def _largest_change(before: Mapping[str, Measure], last: Mapping[str, Measure]) -> float:
    """Largest relative change of what most answers are asked for; not of negligible stresses."""
    largest = max(abs(m.value) for name, m in last.items() if m.unit == "MPa")
    changes = [
        abs(last[name].value - before[name].value) / abs(last[name].value)
        for name in LOCAL | INTEGRALS
        if name in last
        and abs(last[name].value) > (_NEGLIGIBLE * largest if last[name].unit == "MPa" else 0.0)
    ]
    return max(changes, default=0.0)


# ---------------------------------------------------------------------------------------------
# Values without a bar, and bars that are narrow enough


def unresolved(meshes: Sequence[OnMesh]) -> dict[str, str]:
    """Say of measures why changes between finer and finer meshes are no error bars.

    Where the last meshes have the same elements between the upper and lower faces, or equally
    many through the wall, nothing shows what the mesh hides of stresses at an edge. A value
    that one of the last three meshes did not resolve has changed from there to another one.
    """
    names = meshes[-1].measures.keys()
    if len(meshes) == 1:
        return dict.fromkeys([name for name in _AT_A_POINT if name in names], ONE_MESH)
    hidden = {n for of in meshes[-3:] for n, m in of.measures.items() if not m.resolved}
    result = dict.fromkeys(hidden & names, BY_ONE_MESH)
    rungs = [mesh.rung for mesh in meshes[-3:]]
    upward, across = {(r.upward, r.upward_grading) for r in rungs}, {r.across for r in rungs}
    if 1 in (len(upward), len(across)):
        result |= dict.fromkeys([name for name in AT_EDGES if name in names], AT_AN_EDGE)
    return result


def growing(meshes: Sequence[OnMesh]) -> dict[str, str]:
    """Values at a point that have grown with the last refinements without slowing down."""
    remarks: dict[str, str] = {}
    for name in [n for n in _AT_A_POINT if n in meshes[-1].measures] if len(meshes) > 3 else ():
        sizes = [abs(mesh.measures[name].value) for mesh in meshes[-3:]]
        before, last = sizes[1] - sizes[0], sizes[2] - sizes[1]
        if last > _GROWTH * sizes[2] and last > _SLOWING * before > 0.0:
            instead = "averaged value" if name in AT_EDGES else "largest mean pressure of a facet"
            remarks[name] = f"grows at this edge with every refinement: use the {instead}"
    return remarks


def relative(measure: Measure) -> float:
    """Relative error of a measure by its error bar; infinite without one, or if not resolved."""
    if measure.error is None or not measure.resolved:
        return math.inf
    if measure.value == 0.0 and measure.error > 0.0:
        return math.inf
    return measure.error / abs(measure.value) if measure.error else 0.0


def is_negligible(measures: Mapping[str, Measure], name: str) -> bool:
    """Whether a value with its bar is a negligible share of the largest one of the same unit.

    The largest one is at least its value without its bar.
    """
    of, error = measures[name], measures[name].error
    alike = [m for m in measures.values() if m.unit == of.unit]
    largest = max(abs(m.value) - (m.error or 0.0) for m in alike)
    return error is not None and abs(of.value) + error <= _NEGLIGIBLE * largest


def unmet(measures: Mapping[str, Measure], targets: Mapping[str, float]) -> list[str]:
    """Measures whose error bars are wider than requested, and which are not negligible."""
    return [
        name
        for name, share in targets.items()
        if name in measures
        and not relative(measures[name]) <= share
        and not is_negligible(measures, name)
    ]


def is_reached(measures: Mapping[str, Measure], targets: Mapping[str, float], n: int) -> bool:
    """Whether the error bars of the last of n meshes are believed, and as narrow as requested."""
    return n >= LEAST_MESHES and not unmet(measures, targets)


# ---------------------------------------------------------------------------------------------
# What an answer has of them beside its measures (`geometry.answer.Answer.parts`)


@dataclass(frozen=True)
class Accuracy:
    """Error bars that finer and finer meshes were solved for."""

    requested: Mapping[str, float]
    """Relative error bars [-] by measure."""
    measures: Mapping[str, Measure]
    """Numbers of the last mesh with their error bars."""
    ended_by: str
    """What ended the refinement."""
    stopped_by: str | None = None
    """Which limit did: "work", "clock", "memory" or "interrupt"; None: none."""

    @property
    def not_reached(self) -> list[str]:
        """Measures whose error bars are wider than requested."""
        return unmet(self.measures, self.requested)

    def request_rows(self, names: Sequence[str] | None = None) -> list[str]:
        """Repeat requests, by default all, reached or not, with their error bars."""
        rows = []
        for name in self.requested if names is None else names:
            share, bar = self.requested[name], relative(self.measures[name])
            digits = 1 if bar < 0.1 else 0
            bar_words = f"± {100 * bar:.{digits}f} %" if math.isfinite(bar) else "no error bar"
            if bar <= share:
                verdict = f"reached, {bar_words}"
            elif is_negligible(self.measures, name):
                verdict = "not needed, negligible beside the largest stress"
            else:
                verdict = f"not reached, {bar_words}"
            rows.append(f"{name}={100 * share:g}%: {verdict}")
        return rows

    @property
    def rows(self) -> list[Row]:
        """Each request with what was reached, and what ended the refinement."""
        rows = [Row("requested error bars", row) for row in self.request_rows()]
        return grouped(evidence=[*rows, Row("refinement ended by", self.ended_by)])

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "requested": dict(self.requested),
            "reached": {name: relative(self.measures[name]) for name in self.requested},
            "not_reached": self.not_reached,
            "ended_by": self.ended_by,
            "stopped_by": self.stopped_by,
        }


@dataclass(frozen=True)
class Meshes:
    """Meshes that were solved, from coarse to fine."""

    meshes: list[OnMesh]

    def qualified(self, title: str) -> str:
        """Title of an answer, with what one mesh leaves open."""
        one = "; one mesh: these numbers are not converged"
        return title if len(self.meshes) > 1 else title + one

    @property
    def rows(self) -> list[Row]:
        """Elements and CPU time of each mesh."""
        rows = []
        for mesh in self.meshes:
            of, seconds = mesh.beside, mesh.beside["cpu_seconds"]
            words = f"{of['elements_per_block']} elements of degree {mesh.rung.degree} per block"
            words += f", {of['unknowns']} unknowns: {seconds:.2f} CPU s"
            rows.append(Row("meshes", words, seconds, "s", "time"))
        return rows

    def as_json(self) -> list[dict[str, Any]]:
        """Return plain data."""
        return [mesh.as_json() for mesh in self.meshes]
