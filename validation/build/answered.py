"""What the scene of a case adds to its answer: title, load, sections, notes on its blocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from fem.element.hexahedron import ElementType
from geometry.answer import Answer
from geometry.compilation.clocks import summed
from geometry.machine.system import peak_memory_mb
from geometry.parts.measures import Planes, SectionError
from geometry.parts.rows import Notes, Part, Row, grouped
from validation.build.problem import scene_planes
from validation.case import Case
from validation.errors import named
from validation.scene.family import RoundScene
from validation.scene.keys.idle import key_words
from validation.scene.polyhedra import STRAIGHT_EDGES, PolyhedralScene
from validation.scene.read import DeformableScene

if TYPE_CHECKING:
    from fem.state import State

#: Load cases that put the ring of a tube under pressure: the loaded face, and what the ring gets.
_RINGS = {"pipe": ("inner", "tension"), "tunnel": ("outer", "compression")}
_OPPOSITE = {"tension": "compression", "compression": "tension"}
#: Poisson's ratio from which mean stresses oscillate [-]: on TSB1, 24 × 2 × 8 elements, σ₁ of
#: incompatible modes is then twice that of b-bar (1.2 times at 0.2), 12 times at 0.4999.
NEARLY_INCOMPRESSIBLE = 0.49
#: Elements of degree 1 with one mean stress each.
_MEAN_STRESS = (ElementType.B_BAR, ElementType.REDUCED)


def of_scene(case: Case, answer: Answer, built: dict[str, float]) -> Answer:
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
        hoop = hoop_stress(scene)
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
    keys = key_words(scene, case.method.name).items()
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


def hoop_stress(scene: object) -> HoopStress | None:
    """Hoop stress of a tube under pressure; None of all else."""
    if not isinstance(scene, RoundScene) or scene.load.case not in _RINGS:
        return None
    face, sense = _RINGS[scene.load.case]
    pressure, thickness = scene.load.pressure, scene.thickness
    radius = float(scene.block.inner_radius)
    radius += thickness * (face == "outer")
    sense = sense if pressure >= 0.0 else _OPPOSITE[sense]
    return HoopStress(abs(pressure) * radius / thickness, radius, sense)
