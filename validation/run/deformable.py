"""Deformable answers of cases: what only a scene knows stands round the solvers of `fem`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fem.accuracy.parts import Meshes
from fem.accuracy.statics import solve_static
from fem.element.hexahedron import ElementType
from fem.method import Explicit, Static
from fem.problem import Problem
from fem.state import State
from fem.static.linear_step.flexibility import FlexibilityStore
from geometry.answer import Answer, Lazy
from geometry.compilation.clocks import stages, summed
from geometry.errors import RefusedError
from geometry.machine.system import peak_memory_mb
from geometry.parts.measures import SectionError
from geometry.parts.rows import Notes, Part, Row
from validation.build.problem import fem_section, scene_planes
from validation.case import Case
from validation.errors import InputError, named
from validation.scene.deformable import DeformableSections
from validation.scene.family import RoundScene
from validation.scene.polyhedra import STRAIGHT_EDGES, PolyhedralScene
from validation.scene.read import DeformableScene

if TYPE_CHECKING:
    from fem.explicit.solve import Frame

#: Poisson's ratio from which mean stresses oscillate [-]: on TSB1, 24 × 2 × 8 elements, σ₁ of
#: incompatible modes is then twice that of b-bar (1.2 times at 0.2), 12 times at 0.4999.
NEARLY_INCOMPRESSIBLE = 0.49
#: Elements of degree 1 with one mean stress each.
_MEAN_STRESS = (ElementType.B_BAR, ElementType.REDUCED)


class ContactSearch(StrEnum):
    """Whether and why a run searches the facets that face each other."""

    NONE = "matching meshes, fixed pairs (small sliding)"
    ASKED = "finite sliding"
    NEEDED = "finite sliding (non-matching meshes)"


@dataclass(frozen=True, kw_only=True)
class Follower:
    """Who follows a run, and its files."""

    progress: Callable[[Any], None] = lambda _: None
    """Called with what a run is at: words, or an object whose ``str`` is."""
    on_frame: Callable[[Frame], None] | None = None
    checkpoint: Path | None = None
    """Of an explicit run: see `fem.solve_explicit`."""
    resume: Path | None = None


def deformable_answer(
    case: Case,
    follower: Follower | None = None,
    *,
    problem: Problem | None = None,
    otherwise: Mapping[str, float] | None = None,
    store: FlexibilityStore | None = None,
) -> Answer:
    """Answer a case by statics or explicit dynamics; its scene has a say in words and checks.

    ``problem`` is that of the scene, where it is stated already; ``otherwise`` and ``store`` are
    those of `fem.solve_static`.
    """
    follower, method = Follower() if follower is None else follower, case.method
    solve: Callable[[Problem], Answer]
    if isinstance(method, Static):

        def solve(problem: Problem) -> Answer:
            return solve_static(
                problem,
                method,
                otherwise=otherwise,
                store=store,
                progress=follower.progress,
                on_frame=follower.on_frame,
            )
    else:
        assert isinstance(method, Explicit)

        def solve(problem: Problem) -> Answer:
            from fem.dynamics import solve_explicit

            return solve_explicit(problem, method, **vars(follower))

    if not isinstance(case.stated, DeformableSections):
        return replace(solve(case.stated), case=case)
    name, scene = case.name, case.scene
    follower.progress("blocks, meshes and contact")
    with stages() as watch:
        fem_section(scene, name)
        static = isinstance(method, Static)
        if static and scene.effects.friction is not None and not scene.is_cell:
            from validation.run.held_by_friction import require_held_by_friction

            require_held_by_friction(name, scene)
        problem = case.problem if problem is None else problem
        with named(name):
            if static:
                problem.require_static()
            problem.require_action()
            deformable = problem.deformable
        if static and isinstance(scene, PolyhedralScene):
            from validation.run.held_by_faces import require_held_by_faces

            require_held_by_faces(name, scene, deformable.assembly)
        watch.lap("build")
        seconds = watch.seconds()
    with _explained(name, scene, problem) if static else named(name):
        answer = solve(problem)
    return _of_scene(case, answer, seconds)


@contextmanager
def _explained(name: str, scene: DeformableScene, problem: Problem) -> Iterator[None]:
    """Name the scene where a static run ends without an answer, and what lets blocks move."""
    try:
        yield
    except RefusedError as error:
        if not error.of_input:  # a limit of work or time says nothing of the blocks
            raise InputError(f"{name}: {error}", of_input=False) from None
        from validation.run.held_by_faces import faces_words, squeeze_words
        from validation.run.held_by_friction import inside_words, mechanism_words

        why, stated = str(error), (scene, problem.deformable.assembly)
        faces = faces_words(*stated) or squeeze_words(*stated)
        faces = faces or mechanism_words(name, scene) or inside_words(name, scene)
        if faces:  # then the solver's own remedies do not help
            why = f"{why.partition('; ')[0]}: {faces}"
        raise InputError(f"{name}: {why}") from None


def _of_scene(case: Case, answer: Answer, built: dict[str, float]) -> Answer:
    """The answer with the title of its scene, and parts that only the scene knows."""
    scene, solution = case.scene, answer.details
    parts, notes = dict[str, Part](), _remarks(scene, solution)
    with named(case.name):
        cut = scene_planes(scene, solution.deformable.assembly)
    if cut is not None:
        try:
            parts["sections"] = solution.sections(cut)
        except SectionError as error:
            notes["sections"] = f"none: {error}"
    if notes or "notes" in answer.parts:
        of_solver = answer.parts["notes"].rows if "notes" in answer.parts else []
        parts["notes"] = Notes([*of_solver, *(Row(*note) for note in notes.items())])

    def reported() -> Lazy[Any]:
        search = {"contact_search": str(_contact_search(scene, solution))}
        of_scene = {
            "scene": case.name,
            "load": scene.load_words,
            **{name: part.as_json() for name, part in parts.items()},
            **(search if solution.deformable.meets else {}),
            "cpu_seconds": summed(answer.report["cpu_seconds"], built),
            "peak_memory_mb": peak_memory_mb(),
        }
        return answer.report.beside(of_scene)

    title, meshes = _title(case.name, scene, solution), answer.parts.get("meshes")
    if isinstance(meshes, Meshes):
        title = meshes.qualified(title)
    return replace(
        answer,
        case=case,
        reported=reported,
        title=title,
        parts={**answer.parts, **parts},
    )


def _contact_search(scene: DeformableScene, solution: State) -> ContactSearch:
    """Whether and why facets that face each other were searched."""
    if not solution.deformable.contact.finite_sliding:
        return ContactSearch.NONE
    requested = scene.effects.finite_sliding
    return ContactSearch.ASKED if requested else ContactSearch.NEEDED


def _title(name: str, scene: DeformableScene, solution: State) -> str:
    """Scene, load, method and mesh, for pictures."""
    d, each = solution.deformable, ""
    solved = d.bodies[0].mesh
    degree = f" of degree {solved.degree}" if solved.degree > 1 else ""
    if isinstance(scene, RoundScene):
        count, what = d.assembly.n_layers, "layer"
        elements, each = d.bodies[0].mesh.n_elements, " per block"
    else:
        count, what, elements = len(d.deformable_blocks), "deformable block", d.n_elements
    part = f"{count} {what}{'s' if count > 1 else ''}"
    if d.assembly.image_of is not None:
        part = "periodic cell"
    return (
        f"{name}, {part}: {scene.load_words}; {solution.method} FEM, "
        f"{elements} elements{degree}{each}{scene.gap_words}"
    )


def _remarks(scene: DeformableScene, solution: State) -> dict[str, str]:
    """What no key of the scene says of its elements, by the name of the row."""
    assembly, notes = solution.deformable.assembly, dict[str, str]()
    if isinstance(scene, PolyhedralScene):
        from geometry.polyhedra.assembly import bare_joints
        from validation.build.polyhedra import build_polyhedra
        from validation.build.readings import doubts

        meets = solution.deformable.meets
        surfaces = build_polyhedra(scene, Path()) if meets else None
        notes |= doubts(scene, assembly, Path(), surfaces)
        bare = [] if surfaces is None else bare_joints(surfaces)
        more = f" and {len(bare) - 1} more pairs" if len(bare) > 1 else ""
        if bare:
            notes["edge contacts"] = (
                f"left out: blocks {assembly.named(bare[0][0])} and "
                f"{assembly.named(bare[0][1])}{more} touch along an edge or at a point alone"
            )
    groups = solution.deformable.bodies
    bounded = groups[0].element in _MEAN_STRESS
    ratio = max(group.material.poisson_ratio for group in groups)
    if ratio >= NEARLY_INCOMPRESSIBLE and not bounded:
        notes["nearly incompressible"] = (
            f"ν = {ratio:g}: the mean stress oscillates in these "
            'elements, and σ₁ and σ₃ with it; set fem.element = "b-bar"'
        )
    if scene.straightened(assembly):
        notes["edges"] = STRAIGHT_EDGES
    sizes = [shape.tetrahedra for shape in assembly.shapes if shape.tetrahedra is not None]
    if sizes:
        to = f" to {max(sizes):.3g}" if max(sizes) > min(sizes) else ""
        notes["tetrahedra"] = (
            f"size {min(sizes):.3g}{to} mm (mesh.size; by default ∛V), each split into "
            "four hexahedra"
        )
    return notes


def on_its_mesh(case: Case) -> Case:
    """Return the case on the mesh of its scene, without error bars and what else takes time."""
    if not isinstance(case.method, Static):
        return case
    return case.stating(case.scene.changed({"fem": {"error_estimate": False, "mesh": "scene"}}))
