"""Answers of a stated accuracy: from coarse to fine until the error bars say that it is reached.

Static tubes of Sine Blocks climb a ladder of meshes of curved elements. Each rung starts from the
state of the one before, refines it in all three directions or in degree, and has at most about half
of its error, so that the change from the rung before bounds the error of a rung; a factor of safety
comes on top. A change may be small by chance: with errors that halve, that of a rung is at most a
quarter of the change before the last one too, and the larger of both counts. Displacements converge
faster, like the energy of an error: a rung has at most a third of what was before. Pressures and
tension have their peaks at the upper and lower faces, so elements shorten towards these and towards
the outer face; round a block they are equal, with lines at the joints of the neighbours.

Displacements, p_eff and averaged tension are integrals: they gain more with the degree of few large
elements. Where nothing else is asked, that ladder is taken. Peaks at edges gain less there, between
the first and the second power of the degree, so that an error is up to four times the change from 4
to 5, and their bars are wider.

With the degree and the mesh of a scene each measure has the change from one degree less as the
estimate of its error.

Other scenes take shares of their own mesh, static ones with cubic elements beside trilinear ones
(`validation.run.estimate`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.families.sine_block import SineBlockDivisions
from geometry.loads import CASES
from geometry.mesh import FloatArray
from validation.errors import InputError
from validation.run.curved.solve import (
    CurvedMesh,
    CurvedRun,
    Solved,
    curved_run,
    facet_lines,
    solve_curved,
)
from validation.run.measures import Measure
from validation.scene.deformable import Method, parse_share
from validation.scene.plausibility import machine_memory
from validation.scene.read import DeformableScene, TubeScene

#: Quantities that an accuracy may be asked of, and other names of them.
QUANTITIES = (
    "max_displacement",
    "p_eff",
    "p_max",
    "p_max_point",
    "sigma_1_max",
    "sigma_1_averaged",
    "sigma_3_min",
)
_OTHER_NAMES = {"u": "max_displacement"}

#: Factor of safety on the change from the rung before, …
SAFETY = 1.5
#: … or on this part of the change before that, where it is larger.
_EARLIER = 0.25
#: Quantities that gain with the degree.
INTEGRALS = frozenset({"max_displacement", "p_eff", "sigma_1_averaged"})
#: Bars above this part of the value are wide.
_WIDE = 0.1
#: Shares of its own mesh that a scene without a ladder is solved on.
SHARES = (1.0 / 3.0, 0.5, 1.0)
#: The same with degrees, of static scenes that name none: by their unknowns.
_SHARES_AND_DEGREES = (
    *((1.0 / 3.0, 1), (0.5, 1), (1.0 / 6.0, 3), (0.25, 3), (1.0 / 3.0, 3), (1.0, 1), (0.5, 3)),
)
#: Means over facets, which other facets do not estimate.
FACET_MEANS = frozenset({"p_eff", "p_max"})

#: Contact points of one sector at most: the contact problem is dense.
_MOST_POINTS = 12000
#: CPU time grows with this power of the unknowns, memory with the next one, by measurement.
_TIME_POWER = 1.7
_MEMORY_POWER, _BYTES = 1.4, 150.0
#: Part of the machine's memory that is used.
_MEMORY_SHARE = 0.8


@dataclass(frozen=True)
class Rung:
    """Curved elements of one block of TSB1's proportions."""

    degree: int
    around: int
    """Elements round a block; at least four of a wave are taken."""
    radial: int
    axial: int
    radial_grading: float
    """Elements at the inner over those at the outer face."""
    axial_grading: float
    """Elements in the middle over those at the upper and lower faces, in the limit of many."""

    def mesh(self, waves: int) -> CurvedMesh:
        """Elements of a block with so many waves."""
        around = waves * max(4, -(-self.around // waves))
        across = SineBlockDivisions(around, self.radial, self.axial, self.radial_grading)
        lines = (
            across.radial_positions,
            np.linspace(0.0, 1.0, around + 1),
            graded_to_both_ends(self.axial, self.axial_grading),
        )
        return CurvedMesh(self.degree, lines)


@dataclass(frozen=True)
class Ladder:
    """Meshes from coarse to fine, from a second to some minutes for two layers on one core."""

    rungs: tuple[Rung, ...]
    displacement: float
    """Part of the bar of other quantities that displacements have."""
    peak: float
    """How much wider bars of peaks are."""

    @property
    def words(self) -> str:
        """What its error bars are."""
        wider = f", peaks {self.peak:g} times it" if self.peak > 1.0 else ""
        return (
            f"{SAFETY:g} times the change from the mesh before, or a quarter of the one before "
            f"that; displacements have {self.displacement:g} of it{wider}"
        )

    def error_bars(self, found: Sequence[dict[str, Measure]]) -> dict[str, float]:
        """Estimated errors of the measures of the last of its first two meshes or more."""
        bars = {key: error_bar([m[key].value for m in found]) for key in found[-1]}
        peak = {key: self.peak * bar for key, bar in bars.items() if key not in INTEGRALS}
        return bars | peak | {"max_displacement": self.displacement * bars["max_displacement"]}


#: Of displacements a third of an error is left by a rung, or less.
LADDER = Ladder(
    (
        Rung(3, 12, 1, 4, 1.0, 20.0),
        Rung(3, 18, 2, 6, 3.0, 40.0),
        Rung(4, 18, 2, 6, 4.0, 40.0),
        Rung(4, 24, 3, 6, 6.0, 80.0),
        Rung(5, 24, 3, 6, 8.0, 150.0),
    ),
    displacement=0.5,
    peak=1.0,
)
#: For integrals: of displacements two fifths are left.
DEGREES = Ladder(
    (
        Rung(3, 12, 1, 4, 1.0, 20.0),
        Rung(4, 12, 1, 4, 1.0, 20.0),
        Rung(5, 12, 1, 4, 1.0, 20.0),
        Rung(5, 12, 2, 6, 4.0, 40.0),
        Rung(5, 24, 3, 6, 8.0, 150.0),
    ),
    displacement=0.7,
    peak=2.5,
)


def graded_to_both_ends(n: int, grading: float) -> FloatArray:
    """Ends of n elements on [0, 1], by a hyperbolic tangent; its slopes' ratio is the grading."""
    x = np.arccosh(np.sqrt(grading)) * np.linspace(-1.0, 1.0, n + 1)
    return 0.5 * (np.tanh(x) / np.tanh(x[-1]) + 1.0)


def share_rungs(scene: DeformableScene, targets: Iterable[str]) -> list[tuple[float, int]]:
    """Shares of the scene's own mesh and degrees there, from coarse to fine.

    Means over facets, where they are asked for, ask elements of higher degree for the own mesh.
    """
    fem = scene.fem
    if fem is None or fem.method is not Method.STATIC:
        return [(share, 1) for share in SHARES]
    named = [(share, fem.degree) for share in SHARES]
    rungs = named if fem.degree > 1 else list(_SHARES_AND_DEGREES)
    if FACET_MEANS.isdisjoint(targets):
        return rungs
    return [(share, degree) for share, degree in rungs if degree == 1 or share == 1.0]


def share_scenes(
    scene: DeformableScene, targets: Iterable[str]
) -> Iterator[tuple[float, int, DeformableScene]]:
    """Scenes of `share_rungs`, their shares and degrees, without those that are no other mesh."""
    before = None
    for share, degree in share_rungs(scene, targets):
        given = scene if share == 1.0 else scene.coarser(share)
        if given is not None and scene.fem is not None:
            given = given.changed({"fem.degree": degree})
        if given is not None and given != before:
            before = given
            yield share, degree, given


def run_curved(name: str, scene: DeformableScene) -> CurvedRun:
    """Solve a tube for its static state with the curved elements that the scene asks for.

    Raises
    ------
    InputError
        What the solver of layered tubes does not do, by name, or a state that was not found.
    """
    assert scene.fem is not None
    degree = scene.fem.degree
    tube = curved_scene(name, scene, f"fem.degree = {degree}")
    waves = round(2 * tube.block.frequency)
    if tube.mesh.around % waves:
        raise InputError(
            f"{name}: mesh.around: got {tube.mesh.around}; expected a multiple of {waves}, the "
            "waves of a block, so that layers meet"
        )
    points = (degree + 2) ** 2 * _facets(tube)
    if points > _MOST_POINTS:
        raise InputError(
            f"{name}: fem.degree = {degree}: got a mesh with {points} contact points in a sector; "
            f"expected at most {_MOST_POINTS}: curved elements need few, try mesh.around = "
            f"{4 * waves}, mesh.radial = 2, mesh.axial = 4"
        )
    lines = facet_lines(tube)
    less = solve_curved(name, tube, CurvedMesh(degree - 1, lines))
    found = solve_curved(name, tube, CurvedMesh(degree, lines), less.state)
    changes = {
        key: abs(measure.value - less.measures[key].value)
        for key, measure in found.measures.items()
    }
    return curved_run(name, tube, (less, found), changes, f"changes from degree {degree - 1}")


def refused(scene: DeformableScene) -> tuple[str, str] | None:
    """What of a scene the solver of layered tubes does not do, and what is expected; else None.

    The general static solver has elements of higher degree for that.
    """
    if not isinstance(scene, TubeScene):
        return "blocks of this family", "a tube of Sine Blocks"
    if scene.fem is None or scene.material is None or scene.contact is None:
        return "no [material], [contact] or [fem]", "all three"
    fem, case, effects = scene.fem, scene.load.case, scene.effects
    checks = [
        (fem.method is Method.STATIC, f'fem.method = "{fem.method}"', 'fem.method = "static"'),
        (
            fem.symmetry in ("auto", "sector"),
            f'fem.symmetry = "{fem.symmetry}"',
            '"auto" or "sector"',
        ),
        (not fem.frames, "fem.frames", "none"),
        (CASES[case].every_layer, f"load case {case}", "pipe or tunnel"),
        (not scene.contact.spacing, "contact.spacing", "contact.clearance"),
        (
            effects.gravity is None or not any(effects.gravity[:2]),
            "effects.gravity across the axis",
            "gravity along the axis alone, such as [0, 0, -9810]",
        ),
        *(
            (not getattr(effects, key), f"effects.{key}", "no effect but gravity")
            for key in type(effects).model_fields
            if key != "gravity"
        ),
    ]
    return next(((what, expected) for good, what, expected in checks if not good), None)


def curved_scene(name: str, scene: DeformableScene, asked: str) -> TubeScene:
    """Refuse by name what the solver of layered tubes does not do.

    Raises
    ------
    InputError
        What, and what is expected.
    """
    found = refused(scene)
    if found is not None:
        what, expected = found
        raise InputError(
            f"{name}: {asked} with {what}: the solver of layered tubes does not do that; expected "
            f"{expected}, or the general static solver"
        )
    assert isinstance(scene, TubeScene)
    return scene


def _facets(scene: TubeScene) -> int:
    """Facets of all joints of one sector."""
    mesh, layers = scene.mesh, scene.assembly.layers
    return mesh.radial * ((layers + 1) * mesh.around + layers * mesh.axial)


def parse_targets(texts: list[str]) -> dict[str, float]:
    """Read ``p_max_point=3%`` and the like: relative errors [-] by quantity.

    Raises
    ------
    InputError
        For anything else, and for a quantity asked twice.
    """
    found: dict[str, float] = {}
    for text in texts:
        name, _, number = (part.strip() for part in text.rpartition("="))
        name, share = _OTHER_NAMES.get(name, name), parse_share(number)
        if name not in QUANTITIES or share is None:
            raise InputError(
                f"--accuracy {text}: expected QUANTITY=SHARE with a share between 0 and 100 %, "
                f"such as p_max_point=3% ({', '.join(('u', *QUANTITIES[1:]))})"
            )
        if name in found:
            raise InputError(f"--accuracy {text}: {name} is asked twice; expected it once")
        found[name] = share
    return found


def reached(measures: dict[str, Measure], name: str) -> float:
    """Relative error of a measure by its error bar; infinite without one."""
    measure = measures[name]
    if measure.error is None or (measure.value == 0.0 and measure.error > 0.0):
        return float("inf")
    return measure.error / abs(measure.value) if measure.error else 0.0


def unmet(measures: dict[str, Measure], targets: dict[str, float]) -> list[str]:
    """Quantities whose error bars are wider than asked."""
    return [name for name, share in targets.items() if not reached(measures, name) <= share]


def closer(scene: DeformableScene, measures: dict[str, Measure]) -> str | None:
    """Accuracy that curved elements give a measure whose bar is wide: ``p_max_point=5%``.

    That of the widest bar above a tenth of its value; None where there is none, or where the ladder
    does not serve. Principal stresses at a point come to a tenth in every tube that was tried
    (`validation.cost.references`), all else to a twentieth.
    """
    wide = {name: reached(measures, name) for name in QUANTITIES if name in measures}
    wide = {name: share for name, share in wide.items() if _WIDE < share < np.inf}
    if not wide or refused(scene) is not None:
        return None
    name = max(wide, key=lambda key: wide[key])
    share = 10 if name in ("sigma_1_max", "sigma_3_min") else 5
    return f"{next((o for o, own in _OTHER_NAMES.items() if own == name), name)}={share}%"


def words_of(measures: dict[str, Measure], names: list[str]) -> str:
    """Error bars of some quantities, relative: ``p_max_point ± 2.1 %``."""
    shares = {name: 100.0 * reached(measures, name) for name in names}
    return ", ".join(
        f"{name} ± {share:.2g} %" if np.isfinite(share) else f"{name} without an error bar"
        for name, share in shares.items()
    )


def run_to_accuracy(
    name: str,
    scene: TubeScene,
    targets: dict[str, float],
    *,
    seconds: float | None = None,
    tell: Callable[[str], None] | None = None,
) -> CurvedRun:
    """Climb the ladder until every target is met.

    Targets are relative errors [-] by quantity, ``seconds`` is CPU time at most [s]; ``tell`` is
    told before each rung what comes.

    Raises
    ------
    InputError
        When the ladder, the time or the memory ends before, with what is reached.
    """
    waves = round(2 * scene.block.frequency)
    solved: list[Solved] = []
    run: CurvedRun | None = None
    ladder = DEGREES if INTEGRALS.issuperset(targets) else LADDER
    for rung in ladder.rungs:
        mesh = rung.mesh(waves)
        why = _beyond(mesh, solved, seconds)
        if why is not None:
            raise InputError(_refusal(name, run, targets, why))
        if tell is not None:
            tell(f"{mesh.n_unknowns} unknowns of degree {mesh.degree} per block")
        # A state of the rung before that was is kept no longer than it is needed.
        solved = [*solved, solve_curved(name, scene, mesh, solved[-1].state if solved else None)]
        if len(solved) == 1:
            continue
        errors = ladder.error_bars([s.measures for s in solved])
        run = curved_run(name, scene, tuple(solved), errors, ladder.words)
        if not unmet(run.measures, targets):
            return run
    raise InputError(_refusal(name, run, targets, "that is the finest mesh there is"))


def error_bar(values: Sequence[Any], size: Callable[[Any], float] = abs) -> float:
    """Estimated error of the last of the values of two meshes or more, from coarse to fine.

    Values are numbers or arrays, of whose changes there is a size.
    """
    changes = [size(b - a) for a, b in itertools.pairwise(values)]
    return SAFETY * max(changes[-1], _EARLIER * max(changes[-2:-1], default=0.0))


def _beyond(mesh: CurvedMesh, solved: list[Solved], seconds: float | None) -> str | None:
    """Why a mesh is not solved; None where it may be."""
    there = machine_memory()
    need = _BYTES * mesh.n_unknowns**_MEMORY_POWER
    if there is not None and need > _MEMORY_SHARE * there:
        return f"the next mesh needs about {need / 2**30:.2g} GB of {there / 2**30:.2g} GB"
    if seconds is None or not solved:
        return None
    last = solved[-1]
    growth = (mesh.n_unknowns / last.mesh.n_unknowns) ** _TIME_POWER
    left = seconds - sum(s.cpu_seconds for s in solved)
    if growth * last.cpu_seconds > left:
        return (
            f"the next mesh takes about {growth * last.cpu_seconds:.2g} CPU s and {left:.2g} of "
            f"{seconds:g} are left (--max-seconds)"
        )
    return None


def _refusal(name: str, run: CurvedRun | None, targets: dict[str, float], why: str) -> str:
    """One line: what was reached, why not more, what to do."""
    asked = ", ".join(f"{key}={100 * share:g}%" for key, share in targets.items())
    if run is None:
        return f"{name}: --accuracy {asked}: {why}; no error can be told yet, allow more"
    return (
        f"{name}: --accuracy {asked}: reached {words_of(run.measures, list(targets))} in "
        f"{sum(run.seconds):.2g} CPU s; {why}; ask for that, or allow more"
    )
