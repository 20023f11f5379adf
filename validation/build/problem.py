"""From a scene to its problem, and from the answer to words that only the scene knows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fem.contact.friction import CoulombFriction
from fem.contact.law import ContactLaw
from fem.contact.pair_laws import PairLaws
from fem.element.hexahedron import ElementType
from fem.method import Static
from fem.problem import Frames, Problem
from geometry.answer import Answer
from geometry.assembly import Assembly
from geometry.loads import CASES, LoadCase
from geometry.machine.system import peak_memory_mb
from geometry.machine.work import LimitError, budget, summed
from geometry.parts.block_selection import chosen_blocks
from geometry.parts.measures import Planes, SectionError, planes
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Notes, Part, Row, grouped
from validation.build.materials import (
    body_forces,
    build_materials,
    friction_of_pairs,
    laws_of_pairs,
)
from validation.errors import InputError, named
from validation.scene.deformable import FemSection
from validation.scene.family import AssemblyScene, RoundScene, round_types
from validation.scene.keys.idle import KeyUse
from validation.scene.polyhedra import STRAIGHT_EDGES, PolyhedralScene
from validation.scene.read import DeformableScene, check_block_size, too_large, too_large_to_deform

if TYPE_CHECKING:
    from fem.state import State


def _refuse(scene: DeformableScene, name: str) -> None:
    """Reject what no method of deformable blocks has, before blocks are built."""
    if scene.effects.auto is not None:
        raise InputError(
            f"{name}: effects.auto is decided by `tubelock fem` and `compare`; here, write the "
            "effects that it names and remove effects.auto"
        )
    if scene.fem.degree > 1 and scene.fem.method != "static":
        raise InputError(
            f'{name}: fem.degree: got {scene.fem.degree} with fem.method = "{scene.fem.method}"; '
            'explicit runs have elements of degree 1: expected 1, or fem.method = "static"'
        )
    if scene.fem.degree > 1 and scene.fem.element != FemSection.model_fields["element"].default:
        raise InputError(
            f'{name}: fem.element: got "{scene.fem.element.value}" with fem.degree = '
            f"{scene.fem.degree}, whose elements have one kind; remove it, or take fem.degree = 1"
        )
    method = scene.method
    with budget(memory=method.max_memory):
        if isinstance(method, Static) and method.mesh != "scene":
            large = too_large(scene)  # it is only built: meshes that are solved begin coarser
        else:
            large = too_large_to_deform(scene, static=isinstance(method, Static))
    if large is not None:
        raise LimitError("memory", f"{name}: {large}")


def build_friction(
    scene: DeformableScene, assembly: AnyBlocks, *, sliding: bool
) -> CoulombFriction | None:
    """Friction of a scene; None where it names none.

    Joints that ``[[contact.pairs]]`` names have theirs; with sliding, any two blocks may meet.
    """
    given = scene.effects.friction
    if given is None:
        if any(pair.friction is not None for pair in scene.contact.pairs):
            raise InputError(
                "contact.pairs: got friction of some joints without that of the others; expected "
                "[effects.friction] coefficient too, or no pairs"
            )
        return None
    constants = given.model_dump(exclude_none=True)
    return CoulombFriction(
        **constants, of_pairs=friction_of_pairs(scene, assembly, anywhere=sliding)
    )


def build_law(scene: DeformableScene, assembly: AnyBlocks, *, sliding: bool) -> ContactLaw:
    """Contact law of a scene, with those that ``[[contact.pairs]]`` have of their own."""
    law = scene.contact.built
    of_pairs = laws_of_pairs(scene, assembly, anywhere=sliding)
    return PairLaws(law, of_pairs) if of_pairs else law


def _build_hexahedra(scene: DeformableScene, name: str) -> LoadCase:
    """Build the load of a scene on its blocks, every one with hexahedra."""
    if isinstance(scene, PolyhedralScene):
        if scene.is_cell:
            check_cell_of_scene(scene, name)
        from validation.build.polyhedra import build_own_blocks

        return build_own_blocks(scene, name)
    return scene_load(scene, build_cell(scene, name)) if scene.is_cell else build_blocks(scene)


def scene_load(scene: AssemblyScene, assembly: Assembly) -> LoadCase:
    """Build the load of a scene on blocks already built."""
    return _with_supports(scene, assembly, scene.build_load(assembly))


def _with_supports(scene: DeformableScene, assembly: AnyBlocks, load: LoadCase) -> LoadCase:
    """A load with what is stated on parts of surfaces, where something is."""
    if not (scene.supports or scene.loads or scene.push):
        return load
    from validation.build.supports import stated_load

    return stated_load(scene, assembly, load)


def _element(scene: DeformableScene, assembly: Assembly) -> dict[str, Any]:
    """Element of a scene on one mesh: of tetrahedra split into hexahedra degree 2.

    The scene may state another, or a kind of elements of degree 1; explicit runs have degree 1, and
    so has general contact of so many facets that degree 2 is beyond the usual work.
    """
    fem = scene.fem
    stated = not fem.model_fields_set.isdisjoint(("degree", "element"))
    tetrahedra = any(shape.tetrahedra is not None for shape in assembly.shapes)
    if stated or not tetrahedra or fem.method != "static":
        return {"degree": fem.degree} if fem.degree > 1 else {"element": fem.element}
    from fem.accuracy.converge import usual_degree

    return {"degree": usual_degree(assembly, friction=scene.effects.friction is not None)}


def _stated(scene: DeformableScene, load: LoadCase, *, rigid: bool) -> Problem:
    """State the problem of a scene on blocks, whatever is to solve it: a method or a deck.

    Where facets do not match, or the scene states it, contact searches facets that face each other.
    """
    blocks, effects, more = load.assembly, scene.effects, dict[str, Any]()
    anywhere, outer = False, scene.stands
    if not rigid:
        assert isinstance(blocks, Assembly)
        anywhere, outer = bool(blocks.unmatched) or effects.finite_sliding, scene.held_at_faces
        more = {**_element(scene, blocks), "motion": scene.motion}
        if scene.meets:
            more["law"] = build_law(scene, blocks, sliding=anywhere)
    return Problem(
        blocks,
        load,
        build_materials(scene, blocks),
        clearance=scene.contact.clearance,
        spacing=scene.contact.spacing,
        frames=Frames.DEFORMABLE if outer else Frames.RIGID,
        friction=build_friction(scene, blocks, sliding=anywhere),
        finite_sliding=effects.finite_sliding,
        finite_rotation=effects.finite_rotation,
        gravity=effects.gravity,
        # The scene was asked at the door, and solids when they were placed.
        check_units=False,
        check_blocks=not rigid and not isinstance(scene, PolyhedralScene),
        **more,
    )


def rigid_problem(scene: DeformableScene, name: str, known: Assembly | None = None) -> Problem:
    """State the problem of a scene for rigid blocks: solids stay solids.

    ``known`` are hexahedral blocks that are built already.
    """
    with named(name):
        if isinstance(scene, PolyhedralScene):
            from validation.build.polyhedra import build_polyhedra

            solids = build_polyhedra(scene)
            live = body_forces(scene, solids, scene.load.acceleration)
            load = LoadCase(solids, "variable load", (), solids.fixed, body_wrenches=live)
            return _stated(scene, _with_supports(scene, solids, load), rigid=True)
        if not scene.meets:
            raise InputError(
                f"{name}: block.type {scene.block.type!r} is one deformable body without contacts; "
                "`tubelock mbd` needs an assembly, such as tsb1-pipe"
            )
        load = build_blocks(scene) if known is None else scene_load(scene, known)
        return _stated(scene, load, rigid=True)


def scene_problem(scene: DeformableScene, name: str) -> Problem:
    """State the problem of a scene for deformable blocks: solids have hexahedra."""
    _refuse(scene, name)  # before blocks are built that no memory holds
    load = _build_hexahedra(scene, name)
    with named(name):
        problem = _stated(scene, load, rigid=False)
        cut = scene_planes(scene, problem.blocks)
        if cut is not None:
            from fem.stresses.sections import check_planes

            check_planes(problem.blocks, cut, ~problem.deforming)
        return problem


def build_blocks(scene: AssemblyScene) -> LoadCase:
    """Build the load of a scene on its blocks."""
    assembly = scene.build()
    check_block_size(scene, assembly)
    return scene_load(scene, assembly)


def scene_planes(scene: DeformableScene, assembly: AnyBlocks) -> Planes | None:
    """Planes of a scene; None where it has none."""
    if not scene.sections:
        return None
    result = []
    for k, one in enumerate(scene.sections):
        blocks = None
        if one.blocks is not None:
            blocks = chosen_blocks(f"sections[{k}].blocks", one.blocks, assembly)
        result.append(planes(one.point, one.normal, blocks=blocks, names=[one.name or str(k + 1)]))
    return Planes(
        points=np.concatenate([one.points for one in result]),
        normals=np.concatenate([one.normals for one in result]),
        blocks=tuple(one.blocks[0] for one in result),
        names=tuple(one.names[0] for one in result),
    )


def check_cell_of_scene(scene: DeformableScene, name: str) -> RoundScene:
    """Return the scene if a periodic cell can stand for it."""
    head, remedy = f'{name}: fem.symmetry = "periodic cell"', 'expected that, or "auto"'
    if not isinstance(scene, RoundScene):
        raise InputError(
            f"{head}: got block.type {scene.block.type!r}, whose layers are not those of a tube; "
            f'expected {round_types()} blocks, or symmetry "auto"'
        )
    if not CASES[scene.load.case].every_layer:
        known = " and ".join(case.name for case in CASES.values() if case.every_layer)
        raise InputError(
            f"{head}: got load.case {scene.load.case!r}, which differs from layer to layer; "
            f"the cell takes {known}; {remedy}"
        )
    if scene.assembly.layers < 2:
        raise InputError(
            f"{head}: got assembly.layers = {scene.assembly.layers}, where nothing repeats; the "
            f"cell stands for two layers or more; {remedy}"
        )
    effects = scene.effects
    for key, blocks in (("[materials]", scene.materials), ("contact.pairs", scene.contact.pairs)):
        if blocks:
            raise InputError(
                f"{head} with {key}: its blocks are those of a long tube, all of one material with "
                "one contact law and friction; remove one of the two"
            )
    for given, key, why in (
        (effects.gravity, "gravity", "the weight adds up from layer to layer"),
        (effects.elastic_frame, "elastic_frame", "the cell has no frame"),
        (effects.finite_sliding, "finite_sliding", "blocks could slide on to other images"),
    ):
        if given:
            raise InputError(f"{head} with effects.{key}: {why}; remove one of the two")
    return scene


def build_cell(scene: DeformableScene, name: str) -> Assembly:
    """Two layers of a tube and the images that they meet."""
    tube = check_cell_of_scene(scene, name)
    with named(name):
        assembly = tube.build_cell()
        check_block_size(scene, assembly)
    return assembly


# ---------------------------------------------------------------------------------------------
# What a scene adds to an answer: title, load, sections, notes on its blocks

#: Load cases that put the ring of a tube under pressure: the loaded face, and what the ring gets.
_RINGS = {"pipe": ("inner", "tension"), "tunnel": ("outer", "compression")}
_OPPOSITE = {"tension": "compression", "compression": "tension"}
#: Poisson's ratio from which mean stresses oscillate [-]: on TSB1, 24 × 2 × 8 elements, σ₁ of
#: incompatible modes is then twice that of b-bar (1.2 times at 0.2), 12 times at 0.4999.
NEARLY_INCOMPRESSIBLE = 0.49
#: Elements of degree 1 with one mean stress each.
_MEAN_STRESS = (ElementType.B_BAR, ElementType.REDUCED)


def told(scene: DeformableScene, name: str, answer: Answer, built: dict[str, float]) -> Answer:
    """The answer to a scene with its title, and parts that only the scene knows.

    ``built`` are the times of what was done before it was solved [s].
    """
    parts, blocks, rigid = dict[str, Part](), answer.problem.blocks, answer.method == "rigid"
    about: dict[str, Any] = {
        "scene": name,
        "load": scene.load_words,
        "cpu_seconds": summed({"build": 0.0} | answer.report["cpu_seconds"], built),
    }
    if rigid:
        hoop = _hoop_stress(scene)
        if hoop is not None:
            parts["ring_pressure"] = hoop
        title = f"{name}: {scene.load_words}; {answer.title.removeprefix(f'{blocks.name}: ')}"
    else:
        about["peak_memory_mb"] = peak_memory_mb()
        title = _title(name, scene, answer.details)
        if "meshes" in answer.parts:
            title = answer.parts["meshes"].qualified(title)  # type: ignore[attr-defined]
    notes = dict(_notes(scene, answer))
    with named(name):
        try:
            cut = scene_planes(scene, blocks)
            if cut is not None:
                assert answer.cut is not None
                parts["sections"] = answer.cut(cut)
        except SectionError as error:
            if rigid and answer.details.holds:
                raise
            notes["sections"] = f"none: {error}"
    if notes or "notes" in answer.parts:
        of_solver = answer.parts["notes"].rows if "notes" in answer.parts else []
        rows = grouped(model=(Row(*note) for note in notes.items()))
        parts["notes"] = Notes([*of_solver, *rows])
    keys = KeyUse(scene, answer.method).words.items()
    parts["keys"] = Notes(grouped(model=(Row(*words) for words in keys)))
    return replace(answer.beside(parts).with_report(about), title=title)


def _notes(scene: DeformableScene, answer: Answer) -> Iterator[tuple[str, str]]:
    """What no key of the scene says of its blocks and elements, by the name of the row."""
    rigid = answer.method == "rigid"
    assembly = answer.details.blocks if rigid else answer.details.whole.assembly
    if isinstance(scene, PolyhedralScene):
        from validation.build.readings import solid_notes

        yield from solid_notes(scene, answer)
    if rigid:
        return
    bodies = answer.details.whole.bodies
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
    d, each = solution.whole, ""
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
