"""Decks of a `Problem`: what it says in the terms of `fem.decks.statement`, written in a call."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from fem.contact.law import LinearPenalty
from fem.decks.abaqus import check_abaqus
from fem.decks.calculix import CALCULIX_ELEMENTS, check_calculix
from fem.decks.keywords import DeckError, safe_names
from fem.decks.laws import law_notes
from fem.decks.meshes import serendipity_block
from fem.decks.model import as_nodal_forces, deck_model
from fem.decks.placement import canonical
from fem.decks.statement import (
    ELEMENT_NAMES,
    Deck,
    DeckStep,
    Flavour,
    Hold,
    Joint,
    Procedure,
    element_name,
    loads_of_case,
)
from fem.decks.supports import holds_on, springs_on_ground
from fem.decks.write import write_deck as write_statement
from fem.element.material import Material
from fem.method import Explicit, Static
from fem.problem import Problem, before_motion, require_problem
from fem.system.build import Frames, held_faces
from fem.system.effects import PAPER_RAYLEIGH, SAFETY_FACTOR, BulkViscosity, Effects
from fem.system.time_step import characteristic_time_step, critical_time_step
from geometry.assembly import Assembly
from geometry.block import Block
from geometry.loads import CircumferentialLoad
from geometry.machine.system import write_whole
from geometry.mesh import IntArray

#: Explicit run to a static state where nobody names times [s]: with the paper's damping of 2 /s,
#: amplitudes have fallen to e⁻⁶ = 0.25 % six seconds after the ramp.
QUASI_STATIC_RAMP = 2.0
QUASI_STATIC_END = 8.0

#: Longest note: heading lines stay below what every program reads, and fit the printed table.
_NOTE_WIDTH = 98

Program = Literal["abaqus", "abaqus-explicit", "calculix"]
_FLAVOURS = {
    "abaqus": Flavour.STANDARD,
    "abaqus-explicit": Flavour.GENERAL,
    "calculix": Flavour.CALCULIX,
}


def write_deck(
    problem: Problem,
    path: str | Path,
    method: Static | Explicit | None = None,
    *,
    program: Program = "abaqus",
) -> Path:
    """Write a problem as an input deck for another program.

    Parameters
    ----------
    problem
        The statement.
    path
        File to write, ``.inp``.
    method
        Static, the default: its static state, with ``abaqus-explicit`` by damped explicit dynamics.
        Explicit: its run in time, of ``abaqus-explicit``, and of ``calculix`` without contact.
    program
        ``abaqus``: a static step of Abaqus/Standard with contact pairs; ``abaqus-explicit``: damped
        explicit dynamics to the static state, with general contact; ``calculix``: a static step of
        CalculiX, which has the contact law as a table.

    Returns
    -------
    Path
        The file. Its heading says where the deck differs from the statement.

    Raises
    ------
    DeckError
        What the program has no words for, by name.
    """
    problem = require_problem(problem)
    path = Path(path)
    if program not in get_args(Program):
        raise DeckError(f"program: got {program!r}; expected {', '.join(get_args(Program))}")
    if path.suffix.lower() != ".inp":
        raise DeckError(f"{path}: expected a file name that ends in .inp")
    deck = problem_deck(problem, _FLAVOURS[program], method)
    write_whole(path, lambda partial: write_statement(partial, deck))
    return path


def problem_deck(
    problem: Problem, flavour: Flavour, method: Static | Explicit | None = None
) -> Deck:
    """State a problem and how it is solved for a program.

    Raises
    ------
    DeckError
        As `write_deck`.
    """
    in_time = method if isinstance(method, Explicit) else None
    if in_time is None:
        problem.refuse_motion()
    if in_time is not None and flavour is Flavour.STANDARD:
        raise DeckError(
            "method: got Explicit with program abaqus, a static step; expected abaqus-explicit"
        )
    static = in_time is None and flavour is not Flavour.GENERAL
    if problem.blocks.image_of is not None:
        raise DeckError(
            f"{problem.blocks.name}: a periodic cell has no deck; expected a whole tube"
        )
    step = DeckStep(Procedure.STATIC, 1.0, 1.0, large_rotations=problem.finite_rotation)
    effects = Effects()
    if in_time is not None:
        step, effects = _in_time(problem, in_time)
    elif not static:
        times = QUASI_STATIC_END, QUASI_STATIC_RAMP
        step = DeckStep(Procedure.EXPLICIT, *times, safety_factor=SAFETY_FACTOR)
        effects = Effects(rayleigh=PAPER_RAYLEIGH, bulk_viscosity=BulkViscosity())
    assembly, meets = canonical(problem.blocks), problem.deformable.meets
    assembly, notes = of_degree(assembly, problem, flavour, meets=meets)
    load = replace(problem.load_case, assembly=assembly)
    stated = replace(problem, blocks=assembly, load=load, degree=1, check_blocks=False)
    deck = deck_of(stated, flavour, step, effects, meets=meets)
    if in_time is not None and flavour is Flavour.CALCULIX:
        deck = with_time_step(deck, in_time.safety_factor)
    notes += contact_notes(deck, static=static) + support_notes(deck)
    if in_time is None and not static:
        notes.append("step: damped explicit dynamics approaches the static state")
    deck, more = around_as_forces(deck)
    return with_notes(deck, notes + more)


def _in_time(problem: Problem, method: Explicit) -> tuple[DeckStep, Effects]:
    """Explicit step of a run.

    Raises
    ------
    DeckError
        A run without an end.
    """
    if method.end_time is None or method.ramp_time is None:
        raise DeckError(
            "method: got Explicit without end_time or ramp_time, which a deck states; expected "
            "both [s]"
        )
    step = DeckStep(
        Procedure.EXPLICIT,
        method.end_time,
        method.ramp_time,
        time_step=method.time_step,
        safety_factor=None if method.time_step is not None else method.safety_factor,
        large_rotations=problem.finite_rotation,
    )
    built = method.effects(moves=problem.motion is not None)
    return step, Effects(rayleigh=built.rayleigh, bulk_viscosity=built.bulk_viscosity)


def of_degree(
    assembly: Assembly, problem: Problem, flavour: Flavour, *, meets: bool
) -> tuple[Assembly, list[str]]:
    """Blocks with the elements of a problem that a program has, and a note where it has others.

    Tetrahedra that tubelock split into hexahedra are these hexahedra, of degree 1 where the
    program has no others.
    """
    split = any(shape.tetrahedra is not None for shape in assembly.shapes)
    on_faces = flavour is Flavour.CALCULIX and presses_on_faces(problem)
    meets = meets and not on_faces
    linear = flavour is Flavour.GENERAL or (flavour is Flavour.CALCULIX and meets)
    notes = ["elements: hexahedra, four of each tetrahedron, as in tubelock"] * split
    if problem.degree == 1:
        return assembly, notes
    if split and linear:
        return assembly, [*notes, "elements: degree 1; tubelock's answer has degree 2"]
    return quadratic(assembly, problem.degree, flavour, meets=meets), notes


def presses_on_faces(problem: Problem) -> bool:
    """Whether CalculiX can press on faces: laws that are linear, without a clearance."""
    linear = all(isinstance(law, LinearPenalty) for law in problem.contact_law.members)
    return linear and problem.clearance == 0.0


def _is_searched(problem: Problem) -> bool:
    """Whether facets of blocks that may meet do not match."""
    fixed = problem.load_case.fixed
    moving = (not (fixed[one.block_m] and fixed[one.block_s]) for one in problem.unmatched)
    return any(moving) or (problem.searches and not problem.blocks.interfaces.n_contacts)


def deck_of(
    problem: Problem,
    flavour: Flavour,
    step: DeckStep,
    effects: Effects,
    *,
    meets: bool,
) -> Deck:
    """Deck of a problem on canonical blocks (`fem.decks.placement.canonical`)."""
    assembly, material = _of_one_material_each(problem)
    before, earlier = None, problem.after
    if earlier is None and step.procedure is Procedure.STATIC and problem.coulomb is not None:
        earlier = before_motion(problem, loaded=True)  # friction remembers which comes first
    if earlier is not None:
        before = deck_of(
            _on_blocks(earlier, problem),
            flavour,
            step,
            effects,
            meets=meets,
        )
    return Deck(
        name=problem.blocks.name,
        flavour=flavour,
        assembly=assembly,
        material=material,
        element=problem.element,
        step=step,
        holds=holds_of(problem, before),
        springs=springs_on_ground(problem.blocks, problem.load_case.held, flavour),
        loads=loads_of_case(problem.load_case),
        joint=joint_of(problem) if meets else None,
        effects=replace(effects, gravity=problem.acceleration),
        motion=problem.motion,
        clearance=problem.clearance,
        spacing=problem.spacing,
        searched=_is_searched(problem),
        before=before,
    )


def _on_blocks(earlier: Problem, problem: Problem) -> Problem:
    """Earlier statement on the blocks of a later one, which may be turned or of another degree."""
    load = replace(earlier.load_case, assembly=problem.blocks)
    before = None if earlier.after is None else _on_blocks(earlier.after, problem)
    return replace(
        earlier,
        blocks=problem.blocks,
        load=load,
        degree=problem.degree,
        check_blocks=problem.check_blocks,
        after=before,
    )


def _of_one_material_each(
    problem: Problem,
) -> tuple[Assembly, Material | tuple[Material, ...]]:
    """Blocks whose shapes have one material each, as parts of a deck have, and the materials.

    A shape of several materials is there once for each. Names are those that a deck can have.
    """
    blocks, materials = problem.blocks, problem.materials
    if len(set(materials)) == 1:
        return _named_for_decks(blocks, blocks.shapes, blocks.shape_of), materials[0]
    pairs = list(zip(blocks.shape_of.tolist(), materials, strict=True))
    kinds = sorted(dict.fromkeys(pairs), key=lambda kind: kind[0])
    used = [shape for shape, _ in kinds]
    shape_of = np.array([kinds.index(pair) for pair in pairs])
    split = _named_for_decks(blocks, tuple(blocks.shapes[shape] for shape in used), shape_of)
    return split, tuple(material for _, material in kinds)


def _named_for_decks(blocks: Assembly, shapes: tuple[Block, ...], shape_of: IntArray) -> Assembly:
    """Blocks of some shapes, under names that decks can have."""
    title, *names = safe_names([blocks.name])[:1] + safe_names(shape.name for shape in shapes)
    if [title, *names] == [blocks.name, *(shape.name for shape in blocks.shapes)]:
        return blocks
    renamed = tuple(replace(shape, name=n) for shape, n in zip(shapes, names, strict=True))
    return replace(blocks, name=title, shapes=renamed, shape_of=shape_of)


def holds_of(problem: Problem, before: Deck | None = None) -> tuple[Hold, ...]:
    """Held blocks: all nodes, or the outer faces of frame blocks that deform; and held faces."""
    blocks, load = problem.blocks, problem.load_case
    known = () if before is None else before.every_hold
    regions = {(hold.block, hold.nodes): hold.region for hold in known if hold.nodes is not None}
    if problem.frames is Frames.DEFORMABLE:
        return holds_on(blocks, held_faces(blocks, load), regions)
    whole = [Hold(block) for block in np.flatnonzero(load.fixed).tolist()]
    return (*whole, *holds_on(blocks, load.held, regions))


def support_notes(deck: Deck) -> list[str]:
    """Where supports and loads of the deck differ from those stated."""
    notes = []
    if deck.springs:
        notes.append(
            "supports: beds of springs are springs at nodes, the integral of k N dA each; over n "
            "facets they resist turning by 1 + 2/n^2 times as much as the bed"
        )
    moved = any(hold.displacement for hold in deck.holds)
    if moved and deck.loads and deck.before is None:
        notes.append("supports: those that move do so while the loads grow; tubelock loads first")
    return notes


def joint_of(problem: Problem) -> Joint:
    """How faces that meet act on each other."""
    friction = problem.coulomb
    return Joint(
        problem.contact_law,
        None if friction is None else friction.coefficient,
        None if friction is None else friction.stick_stiffness,
        problem.finite_sliding,
        () if friction is None else friction.of_pairs,
        presses_on_faces(problem),
    )


def quadratic(assembly: Assembly, degree: int, flavour: Flavour, *, meets: bool) -> Assembly:
    """Give all blocks hexahedra of 20 nodes.

    Raises
    ------
    DeckError
        What decks do not have with them.
    """
    if degree > 2:
        raise DeckError(f"fem.degree: got {degree}; decks have C3D20, of degree 2: expected 1 or 2")
    if flavour is Flavour.GENERAL:
        raise DeckError(
            "fem.degree: got 2 with --flavour general, an explicit step, which has no "
            "C3D20; expected 1, or --flavour standard or calculix"
        )
    if flavour is Flavour.CALCULIX and meets:
        raise DeckError(
            "fem.degree: got 2 with --flavour calculix, whose contact presses at nodes "
            "and finds no increment with C3D20; expected 1, or --flavour standard"
        )
    return replace(assembly, shapes=tuple(serendipity_block(s) for s in assembly.shapes))


def contact_notes(deck: Deck, *, static: bool) -> list[str]:
    """Where the program takes another contact than the one stated; nothing without contact."""
    if deck.joint is None:
        return []
    notes = []
    if deck.flavour is not Flavour.CALCULIX:
        notes += law_notes(deck.joint.law, static=static)
    if deck.flavour is Flavour.GENERAL:
        notes.append(
            "contact: all outer faces may meet and slide; tubelock pairs facets that match, else "
            "searches"
        )
    if deck.flavour is Flavour.CALCULIX and not deck.joint.face_to_face:
        notes += [
            "contact: the law is a table of 200 points, linear between them and above 10 MPa"
            + (", moved by the clearance" if deck.clearance else ""),
            "contact: no spring where surfaces are apart by more than 1e-3 sqrt(area of a node)",
            "contact: NODE TO SURFACE; the normal at a node is that of one facet of the other "
            "surface",
            "contact: nodes that slide over a rim by more than 1e-3 sqrt(area of a node) are lost",
        ]
        if deck.searched:
            notes.append(
                "contact: nodes on facets of another mesh pass no uniform pressure; with a table "
                "for SURFACE TO SURFACE CalculiX 2.20 ends in a fault of memory"
            )
    return notes


def around_as_forces(deck: Deck) -> tuple[Deck, list[str]]:
    """Tractions about the axis as nodal forces where contact pairs are written, and a note."""
    around = [load for load in deck.loads if isinstance(load, CircumferentialLoad)]
    if deck.flavour is not Flavour.STANDARD or not around:
        return deck, []
    note = "loads: the traction around the axis as nodal forces, which converters take"
    loads = [
        as_nodal_forces(deck, load) if any(load is other for other in around) else load
        for load in deck.loads
    ]
    return replace(deck, loads=tuple(loads)), [note]


#: Share of the critical time step that an explicit step of CalculiX takes at the most: its scheme
#: is 10 % off at 0.9 of it in a beam under a load at once, 0.2 % at a quarter.
_CALCULIX_SHARE = 0.25


def with_time_step(deck: Deck, safety_factor: float) -> Deck:
    """Choose the time step of an explicit run of CalculiX: it takes the one that a deck states."""
    if deck.step.time_step is not None:
        return deck
    # The deck rejects what CalculiX cannot compute; only then is a time step worth its price.
    critical = critical_time_step(deck_model(deck)[0]).critical_time_step
    share = min(safety_factor, _CALCULIX_SHARE)
    count = int(np.ceil(deck.step.end_time / (share * critical)))
    return replace(deck, step=replace(deck.step, time_step=deck.step.end_time / count))


#: Increments above which Abaqus recommends to keep all numbers in double precision.
_SINGLE_PRECISION = 3.0e5


def element_time_step(deck: Deck, *, moving: bool = False) -> float:
    """Least time step of an element as Abaqus/Explicit estimates it, without contact [s].

    Of all blocks, or of those that are not held.
    """
    blocks = np.arange(deck.assembly.n_blocks)
    blocks = np.setdiff1d(blocks, deck.held_blocks) if moving else blocks
    used = np.unique(deck.assembly.shape_of[blocks]).tolist()
    viscosity = deck.effects.bulk_viscosity
    linear = 0.0 if viscosity is None else viscosity.linear_bulk_viscosity
    return min(
        characteristic_time_step(shape.mesh, material, linear_bulk_viscosity=linear)
        for shape, material in ((deck.assembly.shapes[k], deck.materials[k]) for k in used)
    )


def increments(deck: Deck) -> tuple[float, float] | None:
    """Number of increments of an explicit step and their length [s]; None: of a static one."""
    step = deck.step
    if step.procedure is not Procedure.EXPLICIT:
        return None
    least = step.scaled_time_step or element_time_step(deck)
    increment = step.time_step or (step.safety_factor or 1.0) * least
    return step.end_time / increment, increment


def needs_double(deck: Deck) -> bool:
    """Whether an explicit step has so many increments that single precision loses digits."""
    counted = increments(deck)
    return (
        deck.flavour is not Flavour.CALCULIX
        and counted is not None
        and counted[0] > _SINGLE_PRECISION
    )


def _increment_notes(deck: Deck) -> list[str]:
    """How many increments an explicit step takes, and what precision they need."""
    counted = increments(deck)
    if counted is None:
        return []
    count, increment = counted
    text = f"step: {count:.2g} increments of {increment:.2g} s"
    if deck.step.time_step is None:
        text += ", more where contact shortens them"
    if needs_double(deck):
        text += "; single precision loses digits in so many: run abaqus with double=both"
    return [text]


def _gap_notes(deck: Deck) -> list[str]:
    gaps = deck.joint is not None and (deck.clearance != 0.0 or deck.spacing != 0.0)
    if deck.flavour is not Flavour.CALCULIX or not gaps:
        return []
    return [
        "gaps: CalculiX 2.20 finds no increment ('too many cutbacks') where blocks float in their "
        "gaps: nothing holds them before they touch"
    ]


def _mesh_notes(deck: Deck) -> list[str]:
    """Which mesh a deck has, and how its error is learnt."""
    names = CALCULIX_ELEMENTS if deck.flavour is Flavour.CALCULIX else ELEMENT_NAMES
    count: dict[str, int] = {}
    for block in range(deck.assembly.n_blocks):
        shape = deck.assembly.shape(block)
        name = element_name(deck, names, shape) if deck.element in names else deck.element.value
        count[name] = count.get(name, 0) + shape.mesh.n_elements
    mesh = ", ".join(f"{number} {name}" for name, number in count.items())
    return [
        f"mesh: {mesh}; tubelock's own answer refines it until its error bars are narrow",
        "mesh: `tubelock deck FILE --run` solves it and prints its error bars",
    ]


def noted(deck: Deck, notes: list[str]) -> Deck:
    """Add notes to those that a deck has, in lines of its heading."""
    lines = [line for note in notes for line in textwrap.wrap(note.strip(), _NOTE_WIDTH)]
    return replace(deck, notes=(*deck.notes, *lines))


def with_notes(deck: Deck, notes: list[str]) -> Deck:
    """Attach the notes, and refuse what no deck of this flavour can say.

    Raises
    ------
    DeckError
        By name.
    """
    notes = [*_mesh_notes(deck), *notes, *_gap_notes(deck), *_increment_notes(deck)]
    deck = noted(replace(deck, notes=()), notes)
    if deck.flavour is Flavour.CALCULIX:
        check_calculix(deck)
    else:
        check_abaqus(deck)
    return deck
