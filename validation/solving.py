"""Every answer: `solve(case)`, by rigid blocks, statics or explicit dynamics."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from fem.element.hexahedron import ElementType
from fem.method import Static
from geometry.answer import Answer
from geometry.compilation.clocks import summed, timed_stages
from geometry.errors import RefusedError
from geometry.machine.system import peak_memory_mb
from geometry.parts.dimensions import Limits
from geometry.parts.measures import Planes, SectionError
from geometry.parts.rows import Notes, Part, Row, grouped
from mbd.options import Rigid
from validation.build.problem import scene_planes
from validation.case import Case
from validation.errors import InputError, named
from validation.scene.family import RoundScene
from validation.scene.polyhedra import STRAIGHT_EDGES, PolyhedralScene
from validation.scene.read import DeformableScene

if TYPE_CHECKING:
    from fem.explicit.solve import Frame
    from fem.state import State
    from geometry.machine.work import Budget
    from geometry.parts.dimensions import Built


def solve(
    case: Case,
    progress: Callable[[Any], None] | None = None,
    *,
    otherwise: Mapping[str, float] | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    checkpoint: Path | None = None,
    resume: Path | None = None,
) -> Answer:
    """Answer a case by its method.

    Parameters
    ----------
    case
        Of `load_case`, or ``Case(name=..., stated=problem, method=Rigid())``.
    progress
        Called with what the run is at: words, or an object whose ``str`` is.
    otherwise
        Relative error bars [-] that a static state is refined to where its method has no accuracy;
        None: `fem.accuracy.converge.TARGETS`.
    on_frame, checkpoint, resume
        As `fem.solve_static` and `fem.solve_explicit`.

    Returns
    -------
    Answer
        With its case; ``print(answer)`` is its table.

    Raises
    ------
    InputError
        One line: what was got, what is expected, what to do.
    KeyboardInterrupt
        An explicit run that was interrupted and has no checkpoint.
    """
    show, method = progress or (lambda _: None), case.method
    show("builds the blocks and finds where they touch")
    with timed_stages() as watch:
        problem = case.check()
        watch.lap("build")
    built = watch.seconds()
    with _explained(case) if isinstance(method, Static) else named(case.name):
        if isinstance(method, Rigid):
            from mbd.answer import analyse

            answer = analyse(problem, method, progress=show)
        elif isinstance(method, Static):
            from fem.accuracy.statics import solve_static

            answer = solve_static(
                problem, method, otherwise=otherwise, progress=show, on_frame=on_frame
            )
        else:
            from fem.dynamics import solve_explicit

            answer = solve_explicit(
                problem,
                method,
                progress=show,
                on_frame=on_frame,
                checkpoint=checkpoint,
                resume=resume,
            )
            run = answer.details.run
            if checkpoint is None and run.status == "interrupted":
                raise KeyboardInterrupt(
                    f"{run.n_steps} time steps were done; no checkpoint was written: -o names a "
                    "folder for one"
                )
    if case.source is not None:
        answer = _of_scene(case, answer, built)
    built_blocks = cast("Built", answer.parts["dimensions"])
    limits = Limits(case.limits.least_wall, case.limits.steepest_joint)
    return replace(answer.beside({"dimensions": replace(built_blocks, limits=limits)}), case=case)


@contextmanager
def _explained(case: Case) -> Iterator[None]:
    """Name the case where a static run ends without an answer, and what lets blocks move."""
    with named(case.name):
        try:
            yield
        except RefusedError as error:
            from mbd.held import why_unheld

            # A limit of work or time says nothing of the blocks.
            why = why_unheld(case.problem.meshed, case.solids) if error.of_input else None
            if why is not None:  # then the solver's own remedies do not help
                error.args = (f"{str(error).partition('; ')[0]}: {why}",)
            raise


def repeatable(answer: Answer) -> Answer:
    """Return an answer that every machine gives.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C ended its run.
    InputError
        A limit of CPU time did.
    """
    run = None if answer.method == "rigid" else answer.details.run
    by = cast("Budget", answer.parts["work"]).stopped_by
    if by == "interrupt" or (run is not None and run.status == "interrupted"):
        raise KeyboardInterrupt
    if run is not None and by == "work":
        raise InputError(
            "fem.max_work: the limit of work ended an explicit run before its end; expected more, "
            "or none"
        )
    if by == "clock":
        section = "rigid" if answer.method == "rigid" else "fem"
        raise InputError(
            f"{section}.max_seconds: the limit of CPU time ended a run, and its answer depends on "
            f"the machine; expected {section}.max_work, which is the same on every machine"
        )
    return answer


# ---------------------------------------------------------------------------------------------
# What the scene of a case adds to its answer: title, load, sections, notes on its blocks

#: Load cases that put the ring of a tube under pressure: the loaded face, and what the ring gets.
_RINGS = {"pipe": ("inner", "tension"), "tunnel": ("outer", "compression")}
_OPPOSITE = {"tension": "compression", "compression": "tension"}
#: Poisson's ratio from which mean stresses oscillate [-]: on TSB1, 24 × 2 × 8 elements, σ₁ of
#: incompatible modes is then twice that of b-bar (1.2 times at 0.2), 12 times at 0.4999.
NEARLY_INCOMPRESSIBLE = 0.49
#: Elements of degree 1 with one mean stress each.
_MEAN_STRESS = (ElementType.B_BAR, ElementType.REDUCED)


def _of_scene(case: Case, answer: Answer, built: dict[str, float]) -> Answer:
    """The answer with the title of its scene, and parts that only the scene knows.

    ``built`` are the times of what was done before it was solved [s].
    """
    scene, parts = case.scene, dict[str, Part]()
    told: dict[str, Any] = {
        "scene": case.name,
        "load": scene.load_words,
        "cpu_seconds": summed({"build": 0.0} | answer.report["cpu_seconds"], built),
    }
    title, blocks = answer.title, answer.problem.blocks
    if answer.method == "rigid":
        hoop = _hoop_stress(scene)
        if hoop is not None:
            parts["ring_pressure"] = hoop
        notes = dict(_rigid_notes(scene, answer))
        title = f"{case.name}: {scene.load_words}; {title.removeprefix(f'{blocks.name}: ')}"
    else:
        solution = answer.details
        told["peak_memory_mb"] = peak_memory_mb()
        title, notes = _title(case.name, scene, solution), dict(_notes(scene, solution))
        if "meshes" in answer.parts:
            title = answer.parts["meshes"].qualified(title)  # type: ignore[attr-defined]
    with named(case.name):
        try:
            parts |= _sections(scene_planes(scene, blocks), answer)
        except SectionError as error:
            if answer.method == "rigid" and answer.details.holds:
                raise
            notes["sections"] = f"none: {error}"
    if notes or "notes" in answer.parts:
        of_solver = answer.parts["notes"].rows if "notes" in answer.parts else []
        rows = grouped(model=(Row(*note) for note in notes.items()))
        parts["notes"] = Notes([*of_solver, *rows])
    keys = case.key_use().words.items()
    parts["keys"] = Notes(grouped(model=(Row(*words) for words in keys)))
    return replace(answer.beside(parts).with_report(told), title=title)


def _sections(cut: Planes | None, answer: Answer) -> dict[str, Part]:
    """Forces through the planes of a scene, where it has some."""
    if cut is None:
        return {}
    assert answer.cut is not None
    return {"sections": answer.cut(cut)}


def _rigid_notes(scene: DeformableScene, answer: Answer) -> Iterator[tuple[str, str]]:
    """What was changed or left out of solids."""
    if isinstance(scene, PolyhedralScene):
        from validation.build.readings import doubts

        blocks = answer.details.blocks
        if any(shape.straightened for shape in blocks.shapes):
            yield "edges", STRAIGHT_EDGES
        yield from doubts(scene, blocks, blocks).items()


def _notes(scene: DeformableScene, solution: State) -> Iterator[tuple[str, str]]:
    """What no key of the scene says of its elements, by the name of the row."""
    assembly = solution.deformable.assembly
    if isinstance(scene, PolyhedralScene):
        from geometry.polyhedra.assembly import bare_joints
        from validation.build.polyhedra import build_polyhedra
        from validation.build.readings import doubts

        surfaces = build_polyhedra(scene) if solution.deformable.meets else None
        yield from doubts(scene, assembly, surfaces).items()
        bare = [] if surfaces is None else bare_joints(surfaces)
        more = f" and {len(bare) - 1} more pairs" if len(bare) > 1 else ""
        if bare:
            m, s = map(assembly.named, bare[0])
            yield (
                "edge contacts",
                f"left out: blocks {m} and {s}{more} touch along an edge or at a point alone",
            )
    bodies = solution.deformable.bodies
    ratio = max(body.material.poisson_ratio for body in bodies)
    if ratio >= NEARLY_INCOMPRESSIBLE and bodies[0].element not in _MEAN_STRESS:
        yield (
            "nearly incompressible",
            f"ν = {ratio:g}: the mean stress oscillates in these elements, and σ₁ and σ₃ with it; "
            'set fem.element = "b-bar"',
        )
    if scene.straightened(assembly):
        yield "edges", STRAIGHT_EDGES
    sizes = [shape.tetrahedra for shape in assembly.shapes if shape.tetrahedra is not None]
    if sizes:
        to = f" to {max(sizes):.3g}" if max(sizes) > min(sizes) else ""
        yield (
            "tetrahedra",
            f"size {min(sizes):.3g}{to} mm (mesh.size; by default ∛V), each split into four "
            "hexahedra",
        )


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


@dataclass(frozen=True)
class HoopStress:
    """Mean hoop stress p·r/t of a closed ring, by hand."""

    value: float
    """[MPa]"""
    radius: float
    """Of the loaded face [mm]."""
    sense: str
    """Tension or compression."""
    unit: str = "MPa"

    @property
    def rows(self) -> list[Row]:
        """The stress, with a remark on dry joints."""
        words = f"{self.value:.5g} MPa, mean hoop {self.sense} of a closed ring, "
        words += f"r = {self.radius:g} mm"
        if self.sense == "tension":
            words += "; dry joints carry no tension: waves and end rings do"
        return [Row("hoop stress p·r/t", words, self.value, self.unit)]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def _hoop_stress(scene: object) -> HoopStress | None:
    """Hoop stress of a tube under pressure; None of all else."""
    if not isinstance(scene, RoundScene) or scene.load.case not in _RINGS:
        return None
    face, sense = _RINGS[scene.load.case]
    pressure, thickness = scene.load.pressure, scene.thickness
    radius = float(scene.block.inner_radius)
    radius += thickness * (face == "outer")
    sense = sense if pressure >= 0.0 else _OPPOSITE[sense]
    return HoopStress(abs(pressure) * radius / thickness, radius, sense)
