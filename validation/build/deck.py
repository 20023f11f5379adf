"""From scenes to input decks: what a scene says, in the terms of `fem.decks.statement`.

A scene also says how *our* solvers reach the answer; where a deck must do it otherwise, a note
in its heading says so.
"""

from __future__ import annotations

import textwrap
from dataclasses import replace

import numpy as np

from fem.assembly.deformable import Frames, held_faces
from fem.assembly.statement import Problem
from fem.decks.abaqus import check_abaqus
from fem.decks.calculix import check_calculix
from fem.decks.laws import law_notes
from fem.decks.model import as_nodal_forces, deck_model
from fem.decks.placement import canonical
from fem.decks.statement import Deck, DeckStep, Flavour, Hold, Joint, Procedure, loads_of_case
from fem.element.hexahedron import ElementType
from fem.element.lagrange_mesh import serendipity_block
from fem.problem.effects import Effects
from fem.problem.time_step import critical_time_step
from geometry.assembly import Assembly
from geometry.loads import CircumferentialLoad
from validation.build.blocks import HexahedralBlocks
from validation.build.cell import refuse_cell
from validation.build.deformable import (
    build_effects,
    build_hexahedra,
    build_problem,
    fem_section,
    scene_load,
)
from validation.errors import InputError, named
from validation.scene.deformable import Damping, EffectsSection, FemSection, Method
from validation.scene.polyhedra import STRAIGHT_EDGES
from validation.scene.read import DeformableScene, SceneFile
from validation.scene.usage import count, uncounted

#: Explicit run to a static state where the scene names no times [s]: with the paper's damping of
#: 2 /s, amplitudes have fallen to e⁻⁶ = 0.25 % six seconds after the ramp.
QUASI_STATIC_RAMP = 2.0
QUASI_STATIC_END = 8.0

#: Longest note: heading lines stay below what every program reads.
_NOTE_WIDTH = 110


def build_deck(file: SceneFile, flavour: Flavour) -> Deck:
    """State the problem of a scene for another program.

    Raises
    ------
    InputError
        For a scene without deformable blocks, or with a feature that the program has no words
        for, by name.
    """
    scene = file.scene
    if not isinstance(scene, DeformableScene):
        raise InputError(
            f"{file.name}: block.type {scene.block.type!r} has no [material]; a deck is written of "
            "scenes with deformable blocks, such as tsb1-pipe or cantilever"
        )
    with named(file.name):
        return _deck(file.name, scene, flavour)


def _deck(name: str, scene: DeformableScene, flavour: Flavour) -> Deck:
    fem, effects = fem_section(scene, name), scene.effects
    refuse_cell(scene, name, "export")
    blocks = build_hexahedra(scene, name)
    assembly = canonical(blocks.assembly)
    if fem.degree > 1:
        assembly = _quadratic(name, scene, fem.degree, flavour, assembly)
    case = scene_load(scene, name, assembly)
    with uncounted((EffectsSection, "finite_sliding")):
        problem = build_problem(scene, name, HexahedralBlocks(assembly, case, blocks.unmatched))
        joint = _joint(problem, effects) if scene.meets else None
    # CalculiX has no contact in explicit steps; single bodies do what the scene says.
    needs_static = flavour is Flavour.CALCULIX and scene.meets
    asks_static = flavour is not Flavour.GENERAL and fem.method is Method.STATIC
    static = needs_static or asks_static
    _count_keys(scene, flavour, static=static)
    large = scene.meets or effects.finite_rotation
    deck = Deck(
        name=name,
        flavour=flavour,
        assembly=assembly,
        material=problem.material,
        element=problem.element,
        step=_static_step(effects) if static else _explicit_step(name, fem, large_rotations=large),
        holds=tuple(_holds(problem)),
        loads=loads_of_case(case),
        joint=joint,
        effects=replace(_effects(effects, fem, static=static), gravity=problem.acceleration),
        motion=problem.motion,
        clearance=problem.clearance,
        spacing=problem.spacing,
        searched=bool(blocks.unmatched),
    )
    notes = (
        _contact_notes(scene, flavour, static=static, searched=deck.searched) if scene.meets else []
    )
    if scene.straightened(assembly):
        notes.append(f"edges: {STRAIGHT_EDGES}")
    around = [load for load in deck.loads if isinstance(load, CircumferentialLoad)]
    if flavour is Flavour.PAIRS and around:
        deck = replace(deck, loads=(as_nodal_forces(deck, around[0]),))
        notes.append("loads: the traction around the axis as nodal forces, which converters take")
    if flavour is Flavour.CALCULIX and not static:
        deck = _with_time_step(deck, fem)
    # Notes also say what a deck leaves out, which is no use of a key.
    with uncounted((FemSection, "symmetry"), *_idle_keys(fem, static=static)):
        notes += _step_notes(fem, effects, flavour, static=static)
    return _with_notes(deck, notes)


def _quadratic(
    name: str, scene: DeformableScene, degree: int, flavour: Flavour, assembly: Assembly
) -> Assembly:
    """Give all blocks hexahedra of 20 nodes.

    Raises
    ------
    InputError
        What decks do not have with them.
    """
    if degree > 2:
        raise InputError(
            f"{name}: fem.degree: got {degree}; decks have C3D20, of degree 2: expected 1 or 2"
        )
    if flavour is Flavour.GENERAL:
        raise InputError(
            f"{name}: fem.degree: got 2 with --flavour general, an explicit step, which has no "
            "C3D20; expected 1, or --flavour pairs or calculix"
        )
    if flavour is Flavour.CALCULIX and scene.meets:
        raise InputError(
            f"{name}: fem.degree: got 2 with --flavour calculix, whose contact presses at nodes "
            "and finds no increment with C3D20; expected 1, or --flavour pairs"
        )
    return replace(assembly, shapes=tuple(serendipity_block(s) for s in assembly.shapes))


def _idle_keys(fem: FemSection, *, static: bool) -> tuple[tuple[type, str], ...]:
    """Keys of ``[fem]`` that make effects which a deck does not have."""
    undamped = static or fem.method is Method.STATIC  # the static state is damped as the paper's
    return ((FemSection, "mass_scaling"), *(((FemSection, "damping"),) if undamped else ()))


def _count_keys(scene: DeformableScene, flavour: Flavour, *, static: bool) -> None:
    """Count the keys that a deck states, though not every answer to its problem depends on them."""
    assert scene.material is not None
    count(scene.material, "density")
    if static and flavour is not Flavour.GENERAL:
        # Elsewhere blocks slide as far as they do: general contact, and pairs in explicit steps.
        count(scene.effects, "finite_sliding")


def _holds(problem: Problem) -> list[Hold]:
    """Held blocks: all nodes, or the outer faces of frame blocks that deform; and held faces."""
    blocks, load = problem.blocks, problem.load_case
    if problem.frames is Frames.DEFORMABLE:
        return [Hold(held.block, held.face) for held in held_faces(blocks, load)]
    whole = [Hold(block) for block in np.flatnonzero(load.fixed).tolist()]
    return whole + [Hold(held.block, held.face) for held in load.held]


def _joint(problem: Problem, effects: EffectsSection) -> Joint:
    friction = effects.friction
    return Joint(
        problem.law,
        None if friction is None else friction.coefficient,
        None if friction is None else friction.stick_stiffness,
        effects.finite_sliding,
    )


def _contact_notes(
    scene: DeformableScene, flavour: Flavour, *, static: bool, searched: bool
) -> list[str]:
    notes: list[str] = []
    contact = scene.contact
    if contact is not None:
        notes += law_notes(contact.built)
    if flavour is Flavour.GENERAL:
        notes.append(
            "contact: all outer faces may meet and slide; tubelock pairs facets that match, else "
            "searches"
        )
    if flavour is Flavour.CALCULIX:
        notes += [
            "contact: the law is a table of 200 points, linear between them and above 10 MPa"
            + (", moved by the clearance" if contact is not None and contact.clearance else ""),
            "contact: no spring where surfaces are apart by more than 1e-3 sqrt(area of a node)",
            "contact: NODE TO SURFACE; the normal at a node is that of one facet of the other "
            "surface",
            "contact: nodes that slide over a rim by more than 1e-3 sqrt(area of a node) are lost",
        ]
        if searched:
            notes.append(
                "contact: nodes on facets of another mesh pass no uniform pressure; with a table "
                "for SURFACE TO SURFACE CalculiX 2.20 ends in a fault of memory"
            )
    if flavour is Flavour.PAIRS and static:
        notes.append("contact: Abaqus/Standard has no maximum stiffness; it is in the heading only")
    if not static and not scene.effects.finite_rotation:
        notes.append("large rotations: nlgeom=YES, though effects.finite_rotation is off")
    return notes


def _with_time_step(deck: Deck, fem: FemSection) -> Deck:
    """Choose the time step of an explicit run of CalculiX: it takes the one it is given."""
    if deck.step.time_step is not None:
        return deck
    # The deck refuses what CalculiX cannot compute; only then is a time step worth its price.
    critical = critical_time_step(deck_model(deck)[0]).critical_time_step
    count = int(np.ceil(deck.step.end_time / (fem.safety_factor * critical)))
    return replace(deck, step=replace(deck.step, time_step=deck.step.end_time / count))


# ---------------------------------------------------------------------------------------------
# Step, effects and notes


def _quasi_static(fem: FemSection) -> bool:
    """Whether the scene asks for a static state."""
    return fem.method is Method.STATIC or fem.damping is Damping.STATIC


def _explicit_step(name: str, fem: FemSection, *, large_rotations: bool) -> DeckStep:
    end_time, ramp_time = fem.end_time, fem.ramp_time
    if end_time is None and not _quasi_static(fem):
        raise InputError(f"{name}: fem.end_time is missing: an explicit run needs it [s]")
    if end_time is None:
        end_time = QUASI_STATIC_END
    if ramp_time is None:
        ramp_time = min(QUASI_STATIC_RAMP, 0.5 * end_time)
    return DeckStep(
        procedure=Procedure.EXPLICIT,
        end_time=end_time,
        ramp_time=ramp_time,
        time_step=fem.time_step,
        safety_factor=None if fem.time_step is not None else fem.safety_factor,
        large_rotations=large_rotations,
        field_intervals=fem.frames - 1 if fem.frames > 1 else 20,
    )


def _static_step(effects: EffectsSection) -> DeckStep:
    return DeckStep(Procedure.STATIC, 1.0, 1.0, large_rotations=effects.finite_rotation)


def _effects(section: EffectsSection, fem: FemSection, *, static: bool) -> Effects:
    if static:
        section = section.changed({"rayleigh": None, "bulk_viscosity": None})
        fem = fem.changed({"damping": None})
    elif _quasi_static(fem):
        fem = fem.changed({"damping": Damping.PAPER})
    with uncounted(*_idle_keys(fem, static=static)):
        built = build_effects(section, fem)
    return Effects(
        rayleigh=built.rayleigh, bulk_viscosity=built.bulk_viscosity, gravity=built.gravity
    )


def _step_notes(
    fem: FemSection, effects: EffectsSection, flavour: Flavour, *, static: bool
) -> list[str]:
    notes = []
    damped = effects.rayleigh is not None or effects.bulk_viscosity is not None
    if static:
        if fem.method is Method.EXPLICIT:
            notes.append("step: static, where the scene asks for explicit dynamics")
        if damped or fem.damping is not None:
            notes.append("damping: does nothing in a static step and is not written")
        if flavour is Flavour.CALCULIX:
            notes.append("amplitude: the smooth step is sampled at 101 points")
    else:
        if _quasi_static(fem):
            notes += [
                "step: the scene asks for its static state; damped explicit dynamics approaches it",
                "damping: as the scene names it, else the paper's; tubelock's adaptive damping is "
                "its own device",
            ]
        if flavour is Flavour.CALCULIX:
            notes += _calculix_explicit_notes(effects, fem)
    if flavour is Flavour.CALCULIX:
        notes.append("flat: nodes and elements run through the blocks in their order")
        notes.append("loads: tractions and body forces are nodal forces")
        if fem.element is ElementType.REDUCED:
            notes.append("element: the hourglass control of C3D8R is another one")
    if fem.symmetry == "sector":
        notes.append("symmetry: all blocks are written")
    return notes


def _calculix_explicit_notes(effects: EffectsSection, fem: FemSection) -> list[str]:
    notes = ["integration: a predictor-corrector scheme of second order, no central differences"]
    if effects.bulk_viscosity is not None or fem.damping is Damping.PAPER or _quasi_static(fem):
        notes.append("bulk viscosity: CalculiX has none; it is not written")
    return notes


def _with_notes(deck: Deck, notes: list[str]) -> Deck:
    """Attach the notes, and refuse what no deck of this flavour can say."""
    lines = [line for note in notes for line in textwrap.wrap(note.strip(), _NOTE_WIDTH)]
    deck = replace(deck, notes=tuple(lines))
    if deck.flavour is Flavour.CALCULIX:
        check_calculix(deck)
    else:
        check_abaqus(deck)
    return deck
