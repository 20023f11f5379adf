"""From scenes to input decks: what a scene says, in the terms of `fem.decks.statement`.

A scene also says how *our* solvers reach the answer; where a deck must do it otherwise, a note
in its heading says so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.decks.placement import canonical
from fem.decks.problem import (
    QUASI_STATIC_END,
    QUASI_STATIC_RAMP,
    around_as_forces,
    contact_notes,
    deck_of,
    element_time_step,
    of_degree,
    with_notes,
    with_time_step,
)
from fem.decks.statement import Deck, DeckStep, Flavour, Procedure
from fem.element.hexahedron import ElementType
from fem.system.effects import Effects
from geometry.assembly import Assembly
from validation.build.cell import refuse_cell
from validation.build.problem import (
    build_hexahedra,
    build_problem,
    fem_section,
    scene_load,
)
from validation.case import Case
from validation.errors import InputError, named
from validation.scene.deformable import EffectsSection, Method
from validation.scene.polyhedra import STRAIGHT_EDGES
from validation.scene.read import DeformableScene


def build_deck(file: Case, flavour: Flavour | None = None) -> Deck:
    """State the problem of a scene for another program.

    Without a flavour the deck follows the scene's method: static as a static step of
    Abaqus/Standard with contact pairs, explicit as Abaqus/Explicit with general contact.
    """
    scene = file.scene
    with named(file.name):
        return _deck(file.name, scene, flavour)


def _deck(name: str, scene: DeformableScene, flavour: Flavour | None) -> Deck:
    fem, effects = fem_section(scene, name), scene.effects
    if flavour is None:
        flavour = Flavour.STANDARD if fem.method is Method.STATIC else Flavour.GENERAL
    refuse_cell(scene, name, "export")
    built = build_hexahedra(scene, name).assembly
    assert isinstance(built, Assembly)
    assembly = canonical(built)
    known = build_problem(scene, name, scene_load(scene, assembly))
    assembly, elements = of_degree(assembly, known, flavour, meets=scene.meets)
    problem = build_problem(scene, name, scene_load(scene, assembly))
    # CalculiX has no contact in explicit steps; single bodies do what the scene says.
    as_stated = flavour is Flavour.CALCULIX and not scene.meets
    static = fem.method is Method.STATIC if as_stated else flavour is not Flavour.GENERAL
    large = scene.meets or effects.finite_rotation
    step = _static_step(effects) if static else _explicit_step(name, scene, large_rotations=large)
    deck = replace(
        deck_of(
            problem,
            flavour,
            step,
            _effects(scene, static=static),
            meets=scene.meets,
        ),
        name=name,
    )
    notes = elements + contact_notes(deck, static=static)
    if scene.meets and not static and not effects.finite_rotation:
        notes.append("large rotations: nlgeom=YES, though effects.finite_rotation is off")
    if scene.straightened(assembly):
        notes.append(f"edges: {STRAIGHT_EDGES}")
    deck, more = around_as_forces(deck)
    notes += more
    if not static and fem.mass_scaling is not None:
        deck = _with_mass_scaling(deck, fem.mass_scaling)
    if flavour is Flavour.CALCULIX and not static:
        deck = with_time_step(deck, fem.safety_factor)
    notes += _step_notes(scene, flavour, static=static)
    return with_notes(deck, notes)


def _with_mass_scaling(deck: Deck, factor: float) -> Deck:
    """Let every element allow a multiple of the least time step."""
    if deck.flavour is Flavour.CALCULIX:
        raise InputError(
            f"fem.mass_scaling: got {factor:g} with --flavour calculix, which scales no single "
            "elements; remove it, or choose --flavour general"
        )
    scaled = factor * element_time_step(deck, moving=True)
    return replace(deck, step=replace(deck.step, scaled_time_step=scaled))


# ---------------------------------------------------------------------------------------------
# Step, effects and notes


def _quasi_static(scene: DeformableScene) -> bool:
    """Whether the scene asks for a static state."""
    return scene.fem.method is Method.STATIC or scene.damping == "static"


def _explicit_step(name: str, scene: DeformableScene, *, large_rotations: bool) -> DeckStep:
    fem = scene.fem
    end_time, ramp_time = fem.end_time, fem.ramp_time
    if end_time is None and not _quasi_static(scene):
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


def _effects(scene: DeformableScene, *, static: bool) -> Effects:
    gravity = None if scene.effects.gravity is None else np.array(scene.effects.gravity)
    if static:
        return Effects(gravity=gravity)
    method = scene.in_time
    if _quasi_static(scene):
        method = replace(method, damping="paper")
    built = method.effects(moves=scene.motion is not None, gravity=gravity)
    return Effects(
        rayleigh=built.rayleigh, bulk_viscosity=built.bulk_viscosity, gravity=built.gravity
    )


def _step_notes(scene: DeformableScene, flavour: Flavour, *, static: bool) -> list[str]:
    fem, effects, notes = scene.fem, scene.effects, list[str]()
    damped = effects.rayleigh is not None or effects.bulk_viscosity is not None
    if static:
        if fem.method is Method.EXPLICIT:
            notes.append("step: static, where the scene asks for explicit dynamics")
        if damped or fem.damping is not None:
            notes.append("damping: does nothing in a static step and is not written")
        if flavour is Flavour.CALCULIX:
            notes.append("amplitude: the smooth step is sampled at 101 points")
    else:
        if _quasi_static(scene):
            notes += [
                "step: the scene asks for its static state; damped explicit dynamics approaches it",
                "damping: as the scene names it, else the paper's; tubelock's adaptive damping is "
                "its own device",
            ]
        if flavour is Flavour.CALCULIX:
            notes += _calculix_explicit_notes(scene)
    if flavour is Flavour.CALCULIX:
        notes.append("flat: nodes and elements run through the blocks in their order")
        notes.append("loads: tractions and body forces are nodal forces")
        if fem.element is ElementType.REDUCED:
            notes.append("element: the hourglass control of C3D8R is another one")
    if fem.symmetry == "sector":
        notes.append("symmetry: all blocks are written")
    return notes


def _calculix_explicit_notes(scene: DeformableScene) -> list[str]:
    notes = ["integration: a predictor-corrector scheme of second order, no central differences"]
    if scene.effects.bulk_viscosity is not None or scene.damping != "none":
        notes.append("bulk viscosity: CalculiX has none; it is not written")
    return notes
