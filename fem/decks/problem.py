"""Decks of a `Problem`: its blocks, elements and steps as a program has them, written in a call."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from fem.decks.abaqus import abaqus_lines
from fem.decks.calculix import calculix_lines, check_calculix
from fem.decks.deck import Deck, Flavour
from fem.decks.faces import half_facet_angle
from fem.decks.keywords import DeckError, safe_names
from fem.decks.laws import law_notes
from fem.decks.loads import check_loads
from fem.decks.placement import canonical
from fem.decks.supports import DeckSupports, check_springs
from fem.element.hexahedron import ElementType
from fem.method import Explicit, Static
from fem.problem import Problem, require_problem
from fem.system.time_step import critical_time_step
from geometry.assembly import Assembly
from geometry.loads import CircumferentialLoad
from geometry.machine.system import write_whole

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
    write_whole(path, lambda partial: write_deck_file(partial, deck))
    return path


def deck_lines(deck: Deck) -> Iterator[str]:
    """Lines of a deck; the same deck gives the same lines.

    Parameters
    ----------
    deck
        The problem; its assembly must be canonical (`fem.decks.placement.canonical`).

    Raises
    ------
    DeckError
        What the program has no words for, by name; while the lines are made, not before.
    """
    return calculix_lines(deck) if deck.is_flat else abaqus_lines(deck)


def write_deck_file(path: Path, deck: Deck) -> dict[str, int]:
    """Write a deck; give a temporary path and rename it when whole.

    Returns
    -------
    dict[str, int]
        How often each keyword was written, in the order of first use.

    Raises
    ------
    DeckError
        As `deck_lines`; the file is then not whole.
    """
    keywords: dict[str, int] = {}
    with path.open("w", encoding="ascii", newline="\n") as file:
        for line in deck_lines(deck):
            file.write(line)
            file.write("\n")
            if line.startswith("*") and not line.startswith("**"):
                word = line.partition(",")[0]
                keywords[word] = keywords.get(word, 0) + 1
    return keywords


def problem_deck(
    problem: Problem,
    flavour: Flavour,
    method: Static | Explicit | None = None,
    *,
    name: str | None = None,
    notes: tuple[str, ...] = (),
) -> Deck:
    """State a problem and how it is solved for a program.

    Raises
    ------
    DeckError
        As `write_deck`.
    """
    if problem.blocks.image_of is not None:
        raise DeckError(
            f"{problem.blocks.name}: a periodic cell has no deck; expected a whole tube"
        )
    run = _run_of(problem, flavour, method)
    if isinstance(run, Explicit) and not isinstance(method, Explicit):
        problem = replace(problem, finite_rotation=True)
    stated = _on(problem, canonical(problem.blocks))
    deck = Deck(name or problem.blocks.name, flavour, stated, run)
    elements = _element_notes(problem)
    stated = _on(stated, _of_one_material_each(deck.assembly, problem))
    deck = replace(deck, problem=replace(stated, degree=1))
    _check(deck)
    if deck.is_flat and isinstance(run, Explicit) and run.time_step is None:
        deck = replace(deck, method=_with_time_step(deck, run))
    every = [
        f"mesh: {deck.first_element[-1]} {deck.element}; tubelock's own answer refines it until "
        "its error bars are narrow",
        "mesh: `tubelock deck FILE --run` solves it and prints its error bars",
        *(*elements, *_contact_notes(deck), *_support_notes(deck), *notes),
    ]
    if isinstance(run, Explicit) and _settles(problem, method):
        every += [
            "step: damped explicit dynamics approaches the static state",
            "damping: as stated, else the paper's; tubelock's adaptive damping is its own device",
        ]
    every += _step_notes(deck)
    lines = (line for note in every for line in textwrap.wrap(note.strip(), _NOTE_WIDTH))
    return replace(deck, notes=tuple(lines))


def _run_of(
    problem: Problem, flavour: Flavour, method: Static | Explicit | None
) -> Static | Explicit:
    """Method of the steps: static ones, or a run in time with its end, its ramp and its damping.

    Programs have constant damping: a run to the static state has the paper's.

    Raises
    ------
    DeckError
        A run in time without an end, of a program of static steps, or of several stages.
    ProblemError
        Static steps of blocks that move at the start.
    """
    if not isinstance(method, Explicit):
        problem.refuse_motion()
        if flavour is not Flavour.GENERAL:
            return method or Static()
        method = Explicit(damping="static")
    if flavour is Flavour.STANDARD:
        raise DeckError(
            "method: got Explicit with program abaqus, a static step; expected abaqus-explicit"
        )
    if problem.after is not None:
        raise DeckError("after: got stages, which are static; expected program abaqus or calculix")
    end = method.end_time
    if _settles(problem, method):
        method, end = replace(method, damping="paper"), end or QUASI_STATIC_END
    if end is None:
        raise DeckError("fem.end_time is missing: an explicit run needs it [s]")
    ramp = min(QUASI_STATIC_RAMP, 0.5 * end) if method.ramp_time is None else method.ramp_time
    return replace(method, end_time=end, ramp_time=ramp)


def _settles(problem: Problem, method: Static | Explicit | None) -> bool:
    """Whether a method ends at the static state."""
    if not isinstance(method, Explicit):
        return True
    return method.damped(moves=problem.motion is not None) == "static"


def _on(problem: Problem, blocks: Assembly) -> Problem:
    """The problem and those before it on the same blocks with other elements, shapes or names."""
    load = replace(problem.load_case, assembly=blocks)
    after = None if problem.after is None else _on(problem.after, blocks)
    return replace(problem, blocks=blocks, load=load, after=after, check_blocks=False)


def _element_notes(problem: Problem) -> list[str]:
    """Where a deck has other elements: hexahedra of degree 1, also those of split tetrahedra.

    Raises
    ------
    DeckError
        Hexahedra of a higher degree.
    """
    if not any(shape.tetrahedra is not None for shape in problem.blocks.shapes):
        if problem.degree > 1:
            raise DeckError(
                f"fem.degree: got {problem.degree}; decks have elements of degree 1: expected 1"
            )
        return []
    lower = [f"elements: degree 1; tubelock's answer has degree {problem.degree}"]
    return [
        "elements: hexahedra, four of each tetrahedron, as in tubelock",
        *(lower if problem.degree > 1 else ()),
    ]


def _of_one_material_each(blocks: Assembly, problem: Problem) -> Assembly:
    """Blocks whose shapes have one material each, as parts of a deck have.

    A shape of several materials is there once for each. Names are those that a deck can have.
    """
    pairs = list(zip(blocks.shape_of.tolist(), problem.materials, strict=True))
    kinds = sorted(dict.fromkeys(pairs), key=lambda kind: kind[0])
    shapes, shape_of = blocks.shapes, blocks.shape_of
    if len(kinds) != len(shapes):
        shapes = tuple(shapes[shape] for shape, _ in kinds)
        shape_of = np.array([kinds.index(pair) for pair in pairs])
    (title,), names = safe_names([blocks.name]), safe_names(shape.name for shape in shapes)
    if [title, *names] == [blocks.name, *(shape.name for shape in blocks.shapes)]:
        return blocks
    renamed = tuple(replace(shape, name=n) for shape, n in zip(shapes, names, strict=True))
    return replace(blocks, name=title, shapes=renamed, shape_of=shape_of)


def _check(deck: Deck) -> None:
    """Refuse what no deck can express, and what the program does not have.

    Raises
    ------
    DeckError
        By name.
    """
    problem, names = deck.problem, deck.elements
    if problem.element.value not in names:
        raise DeckError(
            f"fem.element: got {problem.element.value!r}, which a deck of flavour {deck.flavour} "
            "has no name for (C3D8 averages the dilatation in Abaqus, not in CalculiX); expected "
            f"one of {', '.join(map(repr, names))}"
        )
    for stage in deck.stages:
        check_loads(stage.load_case)
    check_springs(deck)
    if problem.motion is not None and DeckSupports(deck).leaning:
        raise DeckError(
            "initial: got a motion beside supports along directions that lean; expected one of the "
            "two, or supports along x, y or z"
        )
    if deck.is_flat:
        check_calculix(deck)
        return
    if deck.meets and deck.has_pairs and deck.flavour is Flavour.GENERAL:
        raise DeckError(
            "contact.pairs: general contact has one friction and one law here; remove them, or "
            "choose --flavour standard or calculix"
        )
    small = deck.meets and not (problem.finite_sliding or deck.searched)
    if problem.clearance != 0.0 and deck.flavour is Flavour.STANDARD and not small:
        raise DeckError(
            f"contact.clearance: got {problem.clearance:g} mm, which contact pairs take in small "
            "sliding alone (*Clearance), and these blocks slide freely; expected --flavour general "
            "or calculix, or contact.spacing"
        )


#: Share of the critical time step that an explicit step of CalculiX takes at the most: its scheme
#: is 10 % off at 0.9 of it in a beam under a load at once, 0.2 % at a quarter.
_CALCULIX_SHARE = 0.25


def _with_time_step(deck: Deck, run: Explicit) -> Explicit:
    """Choose the time step of an explicit run of CalculiX: it takes the one that a deck states."""
    effects = replace(deck.effects, finite_rotation=deck.problem.finite_rotation)
    longest = critical_time_step(deck.problem.system.bodies, effects).critical_time_step
    share = min(run.safety_factor, _CALCULIX_SHARE)
    count = np.ceil(deck.end_time / (share * longest))
    return replace(run, time_step=deck.end_time / float(count))


# ---------------------------------------------------------------------------------------------
# Notes


def _contact_notes(deck: Deck) -> list[str]:
    """Where the program takes another contact than the one stated; nothing without contact."""
    if not deck.meets:
        return []
    notes, problem = [], deck.problem
    if not deck.is_flat:
        notes += law_notes(problem.contact_law, static=deck.in_time is None)
    if deck.flavour is Flavour.GENERAL:
        notes.append(
            "contact: all outer faces may meet and slide; tubelock pairs facets that match, else "
            "searches"
        )
    if deck.is_flat and not deck.on_faces:
        notes += [
            "contact: the law is a table of 200 points, linear between them and above 10 MPa"
            + (", moved by the clearance" if problem.clearance else ""),
            "contact: no spring where surfaces are apart by more than 1e-3 sqrt(area of a node)",
            "contact: NODE TO SURFACE; pressure acts at nodes, and joints of n facets across "
            "resist opening 1 + 2/n^2 times as much; it acts along the normal of one facet, off by "
            f"half the angle between facets, here {_largest_angle(deck):.2g} rad: both fall with "
            "the mesh",
            "contact: nodes that slid over a rim by more than 1e-3 sqrt(area of a node) are lost "
            "in the next increment" + ("; this step has one" if deck.stays_paired else ""),
        ]
        if deck.searched:
            notes.append(
                "contact: nodes on facets of another mesh pass no uniform pressure; with a table "
                "for SURFACE TO SURFACE CalculiX 2.20 ends in a fault of memory"
            )
    if deck.is_flat and (problem.clearance or problem.spacing):
        notes.append(
            "gaps: CalculiX 2.20 finds no increment ('too many cutbacks') where blocks float in "
            "their gaps: nothing holds them before they touch"
        )
    return notes


def _largest_angle(deck: Deck) -> float:
    """Half the largest angle between facets of a contact face that share an edge [rad]."""
    faces = ((shape, face) for shape in deck.assembly.shapes for face in shape.contact_faces)
    return max((half_facet_angle(*face) for face in faces), default=0.0)


def _support_notes(deck: Deck) -> list[str]:
    """Where supports and loads of the deck differ from those stated."""
    notes, load = [], deck.problem.load_case
    if any(held.spring is not None for held in load.held):
        notes.append(
            "supports: beds of springs are springs at nodes, the integral of k N dA each; over n "
            "facets they resist turning by 1 + 2/n^2 times as much as the bed"
        )
    acts = load.faces or load.lines or load.nodes
    if any(held.moves for held in load.held) and acts and len(deck.stages) == 1:
        notes.append("supports: those that move do so while the loads grow; tubelock loads first")
    around = any(isinstance(one, CircumferentialLoad) for one in load.faces)
    if deck.flavour is Flavour.STANDARD and around and not load.without_couple:
        notes.append("loads: the traction around the axis as nodal forces, which converters take")
    if deck.is_flat:
        notes.append("loads: tractions and body forces are nodal forces")
    return notes


def _step_notes(deck: Deck) -> list[str]:
    """What a program does otherwise in its steps, and how many increments it takes."""
    notes = []
    if deck.is_flat:
        notes.append("flat: nodes and elements run through the blocks in their order")
        if deck.problem.element is ElementType.REDUCED:
            notes.append("element: the hourglass control of C3D8R is another one")
        notes.append(
            "amplitude: the smooth step is sampled at 101 points"
            if deck.in_time is None
            else "integration: a predictor-corrector scheme of second order, no central differences"
        )
    counted = deck.increments
    if counted is not None:
        text = f"step: {counted[0]:.2g} increments of {counted[1]:.2g} s"
        if deck.in_time is not None and deck.in_time.time_step is None:
            text += ", more where contact shortens them"
        if deck.needs_double:
            text += "; single precision loses digits in so many: run abaqus with double=both"
        notes.append(text)
    return notes
