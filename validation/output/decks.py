"""Decks written, read and described."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import KDTree

from fem.answer.measures import largest_turn, load_step_change
from fem.decks.deck import Deck, Flavour
from fem.decks.problem import problem_deck, write_deck_file
from fem.element.hexahedron import ElementType
from fem.element.material import Material
from fem.method import Explicit, Static
from fem.problem import Problem
from geometry.answer import Answer
from geometry.errors import RefusedError
from geometry.machine.system import write_whole
from geometry.mesh import FloatArray
from geometry.parts.rows import Notes, Part, Row, RowTable, grouped, time_row
from mbd.options import Rigid
from validation.case import Case, refuse_cell
from validation.errors import InputError, named
from validation.output.files import prepare_file
from validation.scene.polyhedra import STRAIGHT_EDGES

if TYPE_CHECKING:
    from fem.decks.read.deck import InputDeck

#: Largest strain, and rotation [rad] where it is linear: their products are a fiftieth of them.
LARGEST_STRAIN = 0.02
#: Nodes of elements, each counted by itself, up to which a mesh is checked by a higher degree.
_CHECKED_NODES = 50_000
#: Change of displacements by that degree from which a mesh is called coarse [-].
_COARSE = 0.1
#: Time that an explicit program takes for an element and an increment, by experience [s].
_ELEMENT_INCREMENT = 1.0e-6


@dataclass(frozen=True)
class WrittenDeck:
    """A deck on disk."""

    deck: Deck
    """What it says."""
    path: Path
    """Where it is."""
    n_bytes: int
    """Its size."""
    keywords: dict[str, int]
    """How often each keyword occurs."""
    cpu_seconds: float
    """CPU time of building and writing it."""


def export_deck(file: Case, flavour: Flavour | None, path: Path) -> WrittenDeck:
    """Write the deck of a scene, whole or not at all."""
    start = time.process_time()
    if path.suffix.lower() != ".inp":
        raise InputError(f"-o {path}: expected a file name that ends in .inp")
    return _write(build_deck(file, flavour), path, start)


def _write(deck: Deck, path: Path, start: float) -> WrittenDeck:
    prepare_file(path)
    keywords: dict[str, int] = {}
    with named(deck.name):
        write_whole(path, lambda partial: keywords.update(write_deck_file(partial, deck)))
    return WrittenDeck(deck, path, path.stat().st_size, keywords, time.process_time() - start)


def export_table(written: WrittenDeck, *, verbose: bool = False) -> RowTable:
    """The contents of a deck that was written, and how to run it."""
    deck = written.deck
    data = problem_json(deck.problem, deck.element, meets=deck.meets)
    step = "static" if deck.in_time is None else "explicit"
    rows = [
        *_problem_rows(data),
        Row("step", f"{step}, {deck.end_time:g} s, smooth step of {deck.ramp_time:g} s"),
        *(Row("notes", note) for note in deck.notes),
        Row("file", f"{written.path}, {written.n_bytes / 1e6:.3g} MB"),
        Row("run it", deck_command(deck, written.path)),
    ]
    counted = deck.increments
    if counted is not None:
        hours = counted[0] * data["n_elements"] * _ELEMENT_INCREMENT / 3600.0
        words = f"{counted[0]:.2g} increments, {hours:.2g} core hours"
        rows.append(Row("expected", f"{words} at 1 µs an element and increment"))
    if verbose:
        keywords = (f"{word} ({count})" for word, count in written.keywords.items())
        rows.append(Row("keywords", ", ".join(keywords)))
    rows.append(time_row({"total": written.cpu_seconds}))
    return RowTable(f"{deck.name}: deck for {deck.program}, flavour {deck.flavour}", rows)


def deck_command(deck: Deck, path: Path) -> str:
    """Command that runs a deck."""
    if deck.is_flat:
        return f"ccx {path.with_suffix('')}"
    double = " double=both" if deck.needs_double else ""
    return f"abaqus job={path.stem} input={path}{double}"


# ---------------------------------------------------------------------------------------------
# Decks that are read


def read_file(path: Path, dialect: str | None) -> InputDeck:
    """Read a deck, and check all that a solution checks before it begins."""
    from fem.decks.read.deck import read_deck

    try:
        deck = read_deck(path, dialect=dialect)
    except RefusedError as error:
        raise InputError(str(error)) from None
    try:
        deck.validate()
    except RefusedError as error:
        raise InputError(f"{path}: {error}") from None
    return deck


def deck_method(deck: InputDeck, asked: Mapping[str, Any]) -> Static | Explicit:
    """Method of a deck with the fields that are asked for.

    On its own mesh, unless ``asked`` has a mesh or an accuracy.

    Raises
    ------
    InputError
        A field that the method does not have, or finer meshes under forces on nodes.
    """
    method = deck.method
    missing = set(asked) - {f.name for f in fields(method)}
    if missing:
        option = f"--{min(missing).replace('_', '-')}"
        raise InputError(
            f"{option}: {deck.name} is an explicit run on the mesh of the deck; leave it out"
        )
    if isinstance(method, Explicit):
        return replace(method, **asked)
    mesh = asked.get("mesh", "converged" if "accuracy" in asked else "scene")
    if mesh == "converged" and not method.error_estimate:
        raise InputError(
            f"{deck.name}: forces on nodes belong to the mesh of the deck, and have no error bars; "
            "expected --mesh scene without --accuracy"
        )
    return replace(method, **{**asked, "mesh": mesh})


def solve_deck(
    deck: InputDeck,
    method: Static | Explicit | None = None,
    progress: Callable[[Any], None] | None = None,
) -> Answer:
    """Solve a deck by a method, by default its own: static equilibrium or explicit dynamics."""
    from fem import solve_explicit, solve_static

    problem, method, before = deck.problem(), method or deck.method, len(deck.model.notes)
    if isinstance(method, Explicit):
        with named(deck.name):
            answer = solve_explicit(problem, method, progress=progress)
    else:
        if problem.after is None and not method.error_estimate:
            deck.model.note("error bars: none, forces on nodes belong to the mesh of the deck")
        with named(deck.name):
            answer = solve_static(problem, method, progress=progress)
        if problem.after is not None:
            deck.model.note(f"error bars: none of the mesh; {_change_by_increments(answer)}")
        if method.mesh == "scene":
            _check_mesh(deck, problem, answer)
    parts, strain = dict[str, Part](), largest_strain(problem, answer)
    if strain > LARGEST_STRAIN:
        deck.model.note(
            f"strain: {strain:.2g} at the most, above {LARGEST_STRAIN:g}: strains are linear here, "
            "and the answer has left their range"
        )
    if deck.steps[-1].large_rotations and not problem.finite_rotation:
        turn, words = largest_turn(answer.details), "largest rotation of a block"
        parts["rotation"] = Notes([Row(words, f"{turn:.2g} rad", turn, "rad", "evidence")])
        turned = largest_rotation(answer)
        if turned > LARGEST_STRAIN:
            deck.model.note(
                f"nlgeom: elements turn by {turned:.2g} rad at the most, above {LARGEST_STRAIN:g}: "
                "this answer is linear in rotations, and has left their range"
            )
    if len(deck.model.notes) > before:
        found = (Row("remarks", note) for note in deck.model.notes[before:])
        parts["remarks"] = Notes(grouped(evidence=found))
    return answer.beside(parts)


def _check_mesh(deck: InputDeck, problem: Problem, answer: Answer) -> None:
    """Compare with elements of one degree more on the same mesh, where that is cheap: a remark.

    Without friction and search: these would take longer than the answer itself.
    """
    from fem import solve_static

    degree = problem.degree + 1
    elements = sum(problem.blocks.shape(b).mesh.n_elements for b in problem.blocks.free_blocks)
    nodes = elements * (degree + 1) ** 3
    if problem.coulomb is not None or problem.after or problem.searches or nodes > _CHECKED_NODES:
        return
    stiffer = replace(problem, element=ElementType.INCOMPATIBLE, degree=degree, check_blocks=False)
    finer = solve_static(stiffer, Static(mesh="scene", error_estimate=False))
    moved, better = answer.fields["displacement"], _moved_there(finer, answer)
    change = float(np.linalg.norm(better)) / (float(np.linalg.norm(moved)) or 1.0) - 1.0
    if abs(change) > _COARSE:
        deck.model.note(
            f"mesh: too coarse, or of badly shaped elements; elements of degree {degree} on the "
            f"same mesh change displacements by {100.0 * change:+.3g} %"
        )


def _moved_there(answer: Answer, other: Answer) -> FloatArray:
    """Displacements of an answer at the points of another of the same blocks, (n, 3) [mm]."""
    result = np.zeros((len(other.points), 3))
    for block in np.unique(other.block_of_point).tolist():
        here, there = (one.block_of_point == block for one in (answer, other))
        _, nearest = KDTree(answer.points[here]).query(other.points[there])
        result[there] = answer.fields["displacement"][here][nearest]
    return result


def _change_by_increments(answer: Answer) -> str:
    """What half as many increments of each stage change."""
    change = load_step_change(answer.details)
    shares = (
        f"{name} by {100.0 * change[name] / abs(answer[name].value or 1.0):.2g} %"
        for name in ("max_displacement", "p_max_point")
        if name in change
    )
    steps = answer.details.evidence.load_steps
    return f"half of {steps} increments a stage would change {', '.join(shares)}"


def draw_deck(deck: InputDeck, path: Path) -> None:
    """Draw blocks, fixed blocks and loads of a deck, before any answer."""
    from validation.output.pictures.assemblies import draw_assembly
    from validation.output.pictures.gallery import save_figure

    problem = deck.problem()
    title = f"{path.parent.name}: {problem.blocks.n_blocks} blocks of the input deck"
    weight = None if problem.gravity is None else [float(part) for part in problem.gravity]
    figure = draw_assembly(problem.blocks, problem.load_case, title=title, weight=weight)
    save_figure(figure, path)


def largest_rotation(answer: Answer) -> float:
    """Largest rotation of an element, of its displacement gradient's mean [rad]."""
    x, u = answer.points[answer.cells], answer.fields["displacement"][answer.cells]
    x, u = (values - values.mean(axis=1, keepdims=True) for values in (x, u))
    inverse = np.linalg.inv(np.einsum("nki,nkj->nij", x, x))
    gradient = np.einsum("nki,nkj->nij", u, x) @ inverse
    turned = 0.5 * (gradient - gradient.transpose(0, 2, 1))
    return float(np.sqrt(0.5 * (turned**2).sum(axis=(1, 2))).max())


def largest_strain(problem: Problem, answer: Answer) -> float:
    """Largest principal strain of an answer, of its sign regardless [-]."""
    stress = answer.fields["principal_stress"]
    ratio = np.array([material.poisson_ratio for material in problem.materials])
    modulus = np.array([material.young_modulus for material in problem.materials])
    nu, e = ratio[answer.block_of_point, None], modulus[answer.block_of_point, None]
    strain = ((1.0 + nu) * stress - nu * stress.sum(axis=1, keepdims=True)) / e
    return float(np.abs(strain).max())


def rewrite(deck: InputDeck, path: Path) -> WrittenDeck:
    """Write the problem of a deck that was read for its program."""
    start = time.process_time()
    if path.suffix.lower() != ".inp":
        raise InputError(f"--write {path}: expected a file name that ends in .inp")
    with named(deck.name):
        notes = tuple(deck.model.notes)
        stated = problem_deck(deck.problem(), deck.flavour, deck.method, notes=notes)
    return _write(stated, path, start)


# ---------------------------------------------------------------------------------------------
# Words and data


def input_json(deck: InputDeck) -> dict[str, Any]:
    """Return what a deck that was read says as plain data."""
    problem, step = deck.problem(), deck.steps[-1]
    element = problem.element.value if problem.degree == 1 else f"degree {problem.degree}"
    return {
        "deck": deck.name,
        "dialect": str(deck.dialect),
        "detected": deck.detected,
        "procedure": "explicit" if step.explicit else "static",
        "duration": step.duration,
        "large_rotations": step.large_rotations,
        **problem_json(problem, element, meets=problem.system.meets),
        "remarks": deck.model.notes,
        "without_influence": list(deck.without_influence),
    }


def input_table(deck: InputDeck) -> RowTable:
    """Describe a deck that was read."""
    data = input_json(deck)
    turns = "large rotations" if data["large_rotations"] else "small rotations"
    rows = [
        Row("dialect", f"{data['dialect']} ({data['detected']})"),
        *_problem_rows(data),
        Row("step", f"{data['procedure']}, {data['duration']:g} s, {turns}"),
        *(Row("remarks", remark) for remark in data["remarks"]),
        Row("no influence", ", ".join(data["without_influence"])),
    ]
    return RowTable(f"{deck.name}: input deck", [row for row in rows if row.words])


def problem_json(problem: Problem, element: str, *, meets: bool) -> dict[str, Any]:
    """Return blocks, materials, contact, supports and loads of a problem as plain data."""
    blocks, load, friction = problem.blocks, problem.load_case, problem.coulomb
    wrenches = np.zeros((0, 6)) if load.body_wrenches is None else load.body_wrenches
    meshes = [blocks.shape(block).mesh for block in range(blocks.n_blocks)]
    laws = problem.contact_law.members if meets else ()
    return {
        "blocks": blocks.n_blocks,
        "names": list(blocks.names),
        "n_nodes": sum(mesh.n_nodes for mesh in meshes),
        "n_elements": sum(mesh.n_elements for mesh in meshes),
        "volume": float(blocks.volumes.sum()),
        "element": element,
        "materials": [_constants(material) for material in dict.fromkeys(problem.materials)],
        "law": "; ".join(law.words for law in laws) or None,
        "friction": None if friction is None else friction.coefficient,
        "clearance": problem.clearance,
        "fixed_blocks": int(load.fixed.sum()),
        "supports": sorted({held.title for held in load.held}),
        "loads": [one.words for one in (*load.faces, *load.lines)],
        "gravity": None if problem.gravity is None else [float(part) for part in problem.gravity],
        "body_forces": int(wrenches.any(axis=1).sum()),
        "nodal_forces": sum(len(nodes.block) for nodes in load.nodes),
    }


def _problem_rows(data: Mapping[str, Any]) -> list[Row]:
    """Rows of `problem_json`."""
    mesh = (
        f"{data['blocks']}, {data['n_nodes']} nodes, {data['n_elements']} hexahedra "
        f"({data['element']}), {data['volume']:.6g} mm³"
    )
    friction = data["friction"]
    slides = "frictionless" if friction is None else f"friction {friction:g}"
    held = [f"{data['fixed_blocks']} fixed blocks"] * bool(data["fixed_blocks"])
    loads = [f"{n} × {one}" if n > 1 else one for one, n in Counter(data["loads"]).items()]
    loads += [f"forces per volume on {data['body_forces']} blocks"] * bool(data["body_forces"])
    if data["gravity"] is not None:
        loads.append(f"gravity {', '.join(f'{part:g}' for part in data['gravity'])} mm/s²")
    loads += [f"{data['nodal_forces']} nodal forces"] * bool(data["nodal_forces"])
    rows = [
        Row("blocks", mesh),
        *(
            Row(
                "material",
                f"{one['young_modulus']:g} MPa, ν = {one['poisson_ratio']:g}, "
                f"{one['density']:.3g} t/mm³",
            )
            for one in data["materials"]
        ),
        Row("contact", f"{data['law']}; {slides}" if data["law"] else "none"),
        Row("clearance", f"{data['clearance']:g} mm" if data["clearance"] else ""),
        Row("supports", ", ".join([*held, *data["supports"]]) or "none"),
        Row("loads", ", ".join(loads) or "none"),
    ]
    return [row for row in rows if row.words]


def _constants(material: Material) -> dict[str, float]:
    """Constants that a deck has of a material."""
    names = ("density", "young_modulus", "poisson_ratio")
    return {name: getattr(material, name) for name in names}


def build_deck(case: Case, flavour: Flavour | None = None) -> Deck:
    """State the problem of a scene for another program.

    Without a flavour the deck follows the scene's method: static as a static step of
    Abaqus/Standard with contact pairs, explicit as Abaqus/Explicit with general contact.
    """
    method = case.method
    assert not isinstance(method, Rigid)
    static = isinstance(method, Static)
    if flavour is None:
        flavour = Flavour.STANDARD if static else Flavour.GENERAL
    refuse_cell(case, "export")
    problem = case.problem
    notes = []
    # CalculiX has no contact in explicit steps; single bodies do what the scene says.
    as_stated = flavour is Flavour.CALCULIX and not case.meets
    run = None
    if flavour is Flavour.GENERAL or (as_stated and not static):
        run = replace(case.in_time, frames=method.frames)
        run = replace(run, damping="static") if static else run
        if case.meets and not problem.finite_rotation:
            problem = replace(problem, finite_rotation=True, check_blocks=False)
            notes.append("large rotations: nlgeom=YES, though effects.finite_rotation is off")
    if case.scene.straightened(problem.blocks):
        notes.append(f"edges: {STRAIGHT_EDGES}")
    notes += _step_notes(case, flavour, run, moves=problem.motion is not None)
    with named(case.name):
        return problem_deck(problem, flavour, run, name=case.name, notes=tuple(notes))


def _step_notes(case: Case, flavour: Flavour, run: Explicit | None, *, moves: bool) -> list[str]:
    """What the step of a deck does otherwise than the method of a case."""
    method, in_time, notes = case.method, case.in_time, list[str]()
    viscous, damping = in_time.bulk_viscosity is not None, None
    if isinstance(method, Explicit):
        damping, viscous = method.damping, viscous or method.damped(moves=moves) != "none"
    if run is None:
        if isinstance(method, Explicit):
            notes.append("step: static, where the scene asks for explicit dynamics")
        if any(one is not None for one in (in_time.rayleigh, in_time.bulk_viscosity, damping)):
            notes.append("damping: does nothing in a static step and is not written")
    if run is not None and flavour is Flavour.CALCULIX and viscous:
        notes.append("bulk viscosity: CalculiX has none; it is not written")
    if not isinstance(method, Rigid) and method.symmetry == "sector":
        notes.append("symmetry: all blocks are written")
    return notes
