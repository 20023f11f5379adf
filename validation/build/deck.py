"""From scenes to input decks: the problem of a scene, how it is solved, and what the deck changes.

A scene also says how *our* solvers reach the answer; where a deck must do it otherwise, a note
in its heading says so.
"""

from __future__ import annotations

from dataclasses import replace

from fem.decks.deck import Deck, Flavour
from fem.decks.problem import problem_deck
from fem.method import Explicit, Static
from validation.case import Case, refuse_cell
from validation.errors import named
from validation.scene.deformable import Method
from validation.scene.polyhedra import STRAIGHT_EDGES
from validation.scene.read import DeformableScene


def build_deck(case: Case, flavour: Flavour | None = None) -> Deck:
    """State the problem of a scene for another program.

    Without a flavour the deck follows the scene's method: static as a static step of
    Abaqus/Standard with contact pairs, explicit as Abaqus/Explicit with general contact.
    """
    scene, static = case.scene, isinstance(case.method, Static)
    if flavour is None:
        flavour = Flavour.STANDARD if static else Flavour.GENERAL
    refuse_cell(case, "export")
    problem = case.problem
    notes = []
    # CalculiX has no contact in explicit steps; single bodies do what the scene says.
    as_stated = flavour is Flavour.CALCULIX and not scene.meets
    run = None
    if flavour is Flavour.GENERAL or (as_stated and not static):
        run = replace(scene.in_time, frames=scene.method.frames)
        run = replace(run, damping="static") if static else run
        if scene.meets and not problem.finite_rotation:
            problem = replace(problem, finite_rotation=True, check_blocks=False)
            notes.append("large rotations: nlgeom=YES, though effects.finite_rotation is off")
    if scene.straightened(problem.blocks):
        notes.append(f"edges: {STRAIGHT_EDGES}")
    notes += _step_notes(scene, flavour, run)
    with named(case.name):
        return problem_deck(problem, flavour, run, name=case.name, notes=tuple(notes))


def _step_notes(scene: DeformableScene, flavour: Flavour, run: Explicit | None) -> list[str]:
    effects, notes = scene.effects, list[str]()
    damped = effects.rayleigh is not None or effects.bulk_viscosity is not None
    if run is None:
        if scene.fem.method is Method.EXPLICIT:
            notes.append("step: static, where the scene asks for explicit dynamics")
        if damped or scene.fem.damping is not None:
            notes.append("damping: does nothing in a static step and is not written")
    viscous = effects.bulk_viscosity is not None or scene.damping != "none"
    if run is not None and flavour is Flavour.CALCULIX and viscous:
        notes.append("bulk viscosity: CalculiX has none; it is not written")
    if scene.fem.symmetry == "sector":
        notes.append("symmetry: all blocks are written")
    return notes
