"""Answers of several solvers to one problem beside each other, measure by measure and per facet.

Compared as the paper compares: contact pressure per facet (correlation, overlap of the effective
contact areas, location of the peaks) on the top and bottom faces of the middle layer, and over the
whole tube; p_eff, p_max; force resultants per interface; time of each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from fem.problem import Problem
from geometry.answer import TITLES, Answer, Array
from geometry.mesh import FloatArray, IntArray
from geometry.parts.measures import effective_facets, facets_between
from validation.errors import InputError

#: Relative differences of pressures below this are round-off of the solvers (residual 1e-8).
_UNIFORM = 1e-6


def _correlation(a: FloatArray, b: FloatArray, area: FloatArray) -> float:
    weight = area / area.sum()
    da, db = a - weight @ a, b - weight @ b
    spread_a, spread_b = float(np.sqrt(weight @ da**2)), float(np.sqrt(weight @ db**2))
    uniform_a = spread_a <= _UNIFORM * abs(float(weight @ a))
    uniform_b = spread_b <= _UNIFORM * abs(float(weight @ b))
    if uniform_a or uniform_b:
        return 1.0 if uniform_a and uniform_b else 0.0
    return float(weight @ (da * db)) / (spread_a * spread_b)


def agreement(
    faces: str,
    reference: FloatArray,
    other: FloatArray,
    *,
    centroids: FloatArray,
    areas: FloatArray,
    block: IntArray,
) -> dict[str, Any]:
    """Compare two pressure fields, (n,) [MPa], on the same facets.

    Their centroids are (n, 3) [mm], their areas (n,) [mm²]; ``block`` is the block whose peak is
    looked for on each, (n,). ``faces`` are ``all``, in a tube also ``top`` and ``bottom`` of the
    middle layer.

    Returns
    -------
    dict[str, Any]
        ``correlation``: area-weighted Pearson correlation of the pressures; two uniform fields: 1,
        one: 0. ``overlap``: shared area of the effective contact regions over their union.
        ``peaks_found``: mean over blocks of the reference's largest pressure within two facets of
        the other's peak, over its largest of all: one where the peaks coincide, several equal peaks
        counting as one. ``force_ratio``: total contact force of the other over the reference's.
    """
    union = shared = 0.0
    hits = []
    for number in np.unique(block):
        mine = block == number
        a, b = effective_facets(reference[mine]), effective_facets(other[mine])
        union += float(areas[mine][a | b].sum())
        shared += float(areas[mine][a & b].sum())
        highest = float(reference[mine].max())
        if highest > 0:
            away = np.linalg.norm(centroids[mine] - centroids[mine][other[mine].argmax()], axis=1)
            near = away <= 2 * np.sqrt(areas[mine].max())
            hits.append(float(reference[mine][near].max()) / highest)
    total = float(areas @ reference)
    return {
        "faces": faces,
        "correlation": _correlation(reference, other, areas),
        "overlap": shared / union if union > 0 else 1.0,
        "peaks_found": float(np.mean(hits)) if hits else 1.0,
        "force_ratio": float(areas @ other) / total if total > 0 else 1.0,
    }


#: What each answer is.
_WORDS = {
    "rigid (force)": "rigid blocks, least sum of squared forces: depends on the number of facets",
    "rigid (pressure)": "rigid blocks, least squared pressures over the area: does not depend on "
    "it",
    "converged": "deformable blocks, converged; [mesh] gives the facets of the means alone",
    "static": "deformable blocks with the elements of [mesh]",
    "explicit": "the same elements, explicit dynamics damped to the static state",
}
#: Loads of one problem differ by this share of the largest at most.
_ROUNDING = 1e-3
#: Peaks that differ by a larger factor are no round-off of two methods [-].
_ALIKE = 1.2
#: Centroids of one facet lie this close [mm]; of facets that a search found, in facet sizes.
_NEAR, _NEAR_SEARCHED = 1e-3, 0.5


@dataclass(frozen=True, repr=False)
class ComparedAnswers:
    """Answers to one problem on the contact facets that they share."""

    answers: tuple[Answer, ...]
    """In the order in which they were given."""
    places: tuple[IntArray, ...]
    """Where the facets that all answers share are in the contacts of each, (n,) each."""
    steps: tuple[dict[str, Any], ...] = ()
    """From rigid blocks to the static answer, one assumption at a time: see `why`."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each answer: rigid ones with their norm, numbered where two are alike."""
        refined = any(map(is_refined, self.answers))
        names = []
        for answer in self.answers:
            name = answer.method
            if name == "rigid":
                name = f"rigid ({answer.report['norm']})"
            elif name == "static" and refined and not is_refined(answer):
                name = "static on [mesh]"
            names.append(name)
        return tuple(
            n if names.count(n) == 1 else f"{n} {names[: k + 1].count(n)}"
            for k, n in enumerate(names)
        )

    @property
    def words(self) -> tuple[str, ...]:
        """What each answer is."""
        kinds = ("converged" if is_refined(a) else _kind(a) for a in self.answers)
        return tuple(_WORDS[kind] for kind in kinds)

    @property
    def friction_words(self) -> str:
        """Friction of the problem; nothing where every answer was read or pickled."""
        problem = next((a.problem for a in self.answers if a.problem is not None), None)
        if problem is None:
            return ""
        friction = problem.coulomb
        if friction is None:
            return "no friction; "
        others = " and others between pairs" if friction.of_pairs else ""
        return f"μ = {friction.coefficient:g}{others}; "

    @cached_property
    def reference(self) -> int:
        """Which answer the others are compared with: the first static one, else the last."""
        methods = [answer.method for answer in self.answers]
        return methods.index("static") if "static" in methods else len(methods) - 1

    @property
    def static(self) -> Answer:
        """That answer."""
        return self.answers[self.reference]

    @property
    def rigid(self) -> int | None:
        """Rigid answer that is explained: that of least pressures, else the last one."""
        result = [k for k, answer in enumerate(self.answers) if answer.method == "rigid"]
        by_pressure = [k for k in result if self.answers[k].report["norm"] == "pressure"]
        return next(iter(by_pressure or result[-1:]), None)

    @cached_property
    def contacts(self) -> dict[str, Array]:
        """The shared facets as the first answer has them, without pressures."""
        result = self.answers[0].contacts
        return {
            n: result[n][self.places[0]]
            for n in result
            if n not in ("pressure", "force", "gap", "slip")
        }

    @cached_property
    def pressures(self) -> tuple[FloatArray, ...]:
        """Of each answer on those facets, (n,) [MPa]."""
        pairs = zip(self.answers, self.places, strict=True)
        return tuple(answer.contacts["pressure"][place] for answer, place in pairs)

    @cached_property
    def is_tube(self) -> bool:
        """Whether blocks stand in rings about an axis: places then have a radius."""
        return any("radius" in (m.place or {}) for m in self.answers[0].measures.values())

    @cached_property
    def layer(self) -> int:
        """Middle one of the free layers, which lie between two frames."""
        return (int(self.answers[0].contacts["layer"].max()) - 1) // 2 + 1

    @cached_property
    def faces(self) -> dict[str, IntArray]:
        """Rows of facets that are compared: all, in a tube also those around the middle layer."""
        result = {"all": np.arange(len(self.places[0]))}
        if self.is_tube:
            layers = np.arange(int(self.contacts["layer"].max(initial=0)) + 1)
            m, s = self.contacts["layer"].T
            result["top"] = facets_between(layers, m, s, self.layer)
            result["bottom"] = facets_between(layers, m, s, self.layer - 1)
        return result

    @cached_property
    def agreement(self) -> dict[str, tuple[dict[str, Any], ...]]:
        """Of the pressures of each other answer with those of the reference, by faces."""
        result = self.contacts
        m, s = result["blocks"].T
        # Peaks are looked for per block of the middle layer; over the whole tube, per first block.
        owner = np.where(result["layer"][:, 0] == self.layer, m, s)
        return {
            name: tuple(
                agreement(
                    faces,
                    self.pressures[self.reference][rows],
                    self.pressures[k][rows],
                    centroids=result["centroid"][rows],
                    areas=result["area"][rows],
                    block=(m if faces == "all" else owner)[rows],
                )
                for faces, rows in self.faces.items()
                if len(rows)
            )
            for k, name in enumerate(self.names)
            if k != self.reference
        }

    @cached_property
    def interface_forces(self) -> tuple[FloatArray, ...]:
        """Force resultant of every pair of blocks in each answer, (n_pairs, 3) [N]."""
        result = self.contacts
        _, row = np.unique(result["blocks"], axis=0, return_inverse=True)
        along, totals = result["normal"] * result["area"][:, None], []
        for pressures in self.pressures:
            total = np.zeros((int(row.max()) + 1, 3))
            np.add.at(total, row.ravel(), pressures[:, None] * along)
            totals.append(total)
        return tuple(totals)

    def interface_force_error(self, name: str) -> float:
        """RMS difference of the pair resultants from the reference, relative to their RMS."""
        ours = self.interface_forces[self.names.index(name)]
        static = self.interface_forces[self.reference]
        scale = float(np.sqrt(np.mean(static**2)))
        return float(np.sqrt(np.mean((ours - static) ** 2))) / scale if scale > 0 else 0.0

    def why(self) -> Self:
        """Return the comparison with the steps from rigid blocks to the static answer, solved now.

        None without a rigid and a static answer, or where the problem was left behind.
        """
        from validation.study.comparison.decomposition import decompose

        static = self.static
        known = self.rigid is not None and static.method == "static" and static.problem is not None
        return replace(
            self, steps=tuple(decompose(static, refined=is_refined(static))) if known else ()
        )

    @cached_property
    def explicit_errors(self) -> dict[str, float] | None:
        """Errors of an explicit end state against the static one of its mesh; None without both.

        Displacement and pressure are root mean squares relative to the static field's; p_max is
        the mean of the block maxima.
        """
        b = next((a for a in self.answers if a.method == "explicit"), None)
        if b is None:
            return None
        same = (a for a in self.answers if a.method == "static" and not is_refined(a))
        a = next((a for a in same if np.array_equal(a.points, b.points)), None)
        if a is None:
            return None
        u, v = (x.fields["displacement"] for x in (a, b))
        p, q = (x.contacts["pressure"] for x in (a, b))
        old, new = (x.report["contact"] for x in (a, b))
        return {
            "displacement_rms": float(np.linalg.norm(v - u) / np.linalg.norm(u)),
            "pressure_rms": float(np.linalg.norm(q - p) / np.linalg.norm(p)),
            **{n: abs(new[n] / old[n] - 1.0) for n in ("p_max", "p_max_point")},
        }

    @property
    def rows(self) -> dict[str, dict[str, float | None]]:
        """Value of each measure in each answer; None where an answer does not have it."""
        known = [name for name in TITLES if any(name in a.measures for a in self.answers)]
        return {
            name: {
                method: answer[name].value if name in answer.measures else None
                for method, answer in zip(self.names, self.answers, strict=True)
            }
            for name in known
        }

    @property
    def conclusion(self) -> str:
        """What the comparison shows of the peaks, in words; else how alike pressures are."""
        if self.rigid is None or "p_max_point" not in self.static.measures:
            return "; ".join(map(self._alike, self.agreement))
        point = self.static["p_max_point"]
        if point.error is None or not point.is_number:
            alike = "; ".join(map(self._alike, self.agreement))
            return f"the finite-element peak at a point has no error bar to use; {alike}"
        peak, mean = point.value, self.answers[self.rigid]["p_max_facet"].value
        if not mean > 0.0:
            return "no joint presses"
        words = (
            f"the finite-element peak, {peak:.3g} MPa at a point, is {peak / mean:.2g} times the "
            f"rigid one, {mean:.3g} MPa over a facet"
        )
        if 1.0 / _ALIKE < peak / mean < _ALIKE:
            return f"{words}: both agree"
        return f"{words}: rigid pressures are means over facets that share force, not peaks"

    def _alike(self, name: str) -> str:
        whole = self.agreement[name][0]
        return (
            f"{name} against {self.names[self.reference]}: correlation of the pressures "
            f"{whole['correlation']:.3f}, contact force {100 * (whole['force_ratio'] - 1):+.1f} %"
        )

    @property
    def explanations(self) -> list[str]:
        """Where the differences come from, in words; the numbers are those of the steps."""
        lines = [] if self.rigid is None or self.rigid == self.reference else self._of_rigid()
        errors = self.explicit_errors
        if errors is not None:
            lines.append(
                "the explicit run ends at the static state of its mesh: displacement off by "
                "{displacement_rms:.2%} (rms), pressure by {pressure_rms:.2%} (rms), p_max by "
                "{p_max:.2%}".format(**errors).replace("%", " %")
            )
        return lines

    def _of_rigid(self) -> list[str]:
        assert self.rigid is not None
        name, lines, before = self.names[self.rigid], [], self.answers[self.rigid].report["contact"]
        for step in self.steps:
            changes = [
                f"{key} {before[key]:.3g} → {step[key]:.3g} MPa "
                f"({100 * (step[key] / before[key] - 1):+.0f} %)"
                for key in ("p_max", "p_eff")
            ]
            lines.append(
                f"{step['words']}: {', '.join(changes)}, {step['effective_count_percent']:.1f} % "
                "of the elements effective"
            )
            before = step
        whole, differ = self.agreement[name][0], "resultants differ"
        if self.is_tube:
            differ = "the tube is statically indeterminate, so resultants differ too"
        lines.append(
            f"{differ}: force per interface by {100 * self.interface_force_error(name):.0f} % "
            f"(rms), total contact force by {100 * (whole['force_ratio'] - 1):+.0f} %"
        )
        return lines

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data: what ``--json`` prints."""
        answers = [
            {
                "name": name,
                "words": words,
                "measures": answer.as_dict()["measures"],
                "contact": answer.report["contact"],
                "cpu_seconds": answer.report["cpu_seconds"],
            }
            for name, words, answer in zip(self.names, self.words, self.answers, strict=True)
        ]
        return {
            "answers": answers,
            "reference": self.names[self.reference],
            "n_contacts": len(self.places[0]),
            "agreement": {n: list(result) for n, result in self.agreement.items()},
            "interface_force_error": {n: self.interface_force_error(n) for n in self.agreement},
            "explicit_errors": self.explicit_errors,
            "steps": list(self.steps),
            "explanations": self.explanations,
            "conclusion": self.conclusion,
        }


def is_refined(answer: Answer) -> bool:
    """Whether a static answer was solved on finer and finer meshes."""
    return "accuracy" in answer.report


def _kind(answer: Answer) -> str:
    return f"rigid ({answer.report['norm']})" if answer.method == "rigid" else answer.method


def shared_facets(answers: Sequence[Answer]) -> tuple[IntArray, ...]:
    """Where the contact facets that all answers share are in the contacts of each, (n,) each."""
    if len(answers) < 2:
        raise InputError(f"compare: got {len(answers)} answers; expected two or more")
    for answer in answers:
        if "facet" not in answer.contacts:
            raise InputError(f"compare: {answer.title}: has no contact facets to compare")
    _require_one_problem(answers)
    first, *others = answers
    shared = [_shared(first, other) for other in others]
    rows = np.arange(len(first.contacts["facet"]))
    for ours, _ in shared:
        rows = np.intersect1d(rows, ours)
    return (rows, *(theirs[np.searchsorted(ours, rows)] for ours, theirs in shared))


def _require_one_problem(answers: Sequence[Answer]) -> None:
    """Reject answers of different problems; one that was read has no problem to compare."""
    seen: dict[str, tuple[Answer, Any]] = {}
    for answer in answers:
        for name, value in _parts_of(answer).items():
            first, stated = seen.setdefault(name, (answer, value))
            if not _is_same(stated, value):
                raise InputError(
                    f"compare: {first.title} and {answer.title} differ in {name}; expected answers "
                    "to one problem"
                )


def _parts_of(answer: Answer) -> dict[str, Any]:
    """What two answers to one problem have in common, by name; rigid blocks have no elasticity."""
    problem = answer.problem
    if problem is None:
        return {}
    friction = problem.coulomb
    load = problem.load_case if isinstance(problem, Problem) else problem.rigid_load
    weight = problem.rigid_weight
    result = {
        "friction": None if friction is None else (friction.coefficient, *friction.of_pairs),
        "fixed blocks": load.fixed,
        "loads or weight": load.wrenches + (0.0 if weight is None else weight),
    }
    if answer.method != "rigid":
        names = ("materials", "contact_law", "clearance", "spacing")
        result |= {name.replace("_", " "): getattr(problem, name) for name in names}
    return result


def _is_same(one: Any, other: Any) -> bool:
    """Whether two parts of problems are equal; arrays to the share that meshes leave."""
    if not isinstance(one, np.ndarray):
        return bool(one == other)
    if one.shape != other.shape:
        return False
    apart = np.abs(np.subtract(one, other, dtype=float)).max(initial=0.0)
    return bool(apart <= _ROUNDING * np.abs(one).max(initial=0.0))


def _shared(first: Answer, other: Answer) -> tuple[IntArray, IntArray]:
    """Positions of the facets that both answers have, in the order of the first one."""
    mine, its = first.contacts, other.contacts
    places = {key: k for k, key in enumerate(_keys(its))}
    pairs = [(k, places[key]) for k, key in enumerate(_keys(mine)) if key in places]
    ours, theirs = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    apart = np.linalg.norm(mine["centroid"][ours] - its["centroid"][theirs], axis=1)
    searched = (mine["facet"][ours] < 0).any(axis=1)
    near = np.where(searched, _NEAR_SEARCHED * np.sqrt(mine["area"][ours]), _NEAR)
    if not (apart <= near).any():
        raise InputError(
            f"compare: {first.title} and {other.title} share no contact facet; expected "
            "answers to one problem on one mesh"
        )
    return ours[apart <= near], theirs[apart <= near]


def _keys(contacts: Any) -> list[tuple[int, ...]]:
    """What names a facet: the block that it is of, its number there, and the other block."""
    blocks, facet = contacts["blocks"], contacts["facet"]
    turned = facet[:, 0] < 0
    blocks = np.where(turned[:, None], blocks[:, ::-1], blocks)
    number = np.where(turned, facet[:, 1], facet[:, 0])
    return [tuple(row) for row in np.column_stack([blocks, number]).tolist()]
