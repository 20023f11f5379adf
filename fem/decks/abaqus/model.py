"""Model data of an Abaqus deck: material, joints, amplitude, initial motion, supports.

Reference: Abaqus Analysis User's Guide, "Contact pressure-overclosure relationships".
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fem.decks.keywords import keyword, label, real, reals
from fem.decks.laws import law_lines
from fem.decks.names import ALL, HOURGLASS, JOINT, LOADING, MATERIAL, block_label
from fem.decks.placement import rounded
from fem.decks.statement import Deck, Flavour, Procedure
from fem.element.hexahedron import ElementType

#: Distance of the two points of an axis of rotation: far, so that its direction keeps its digits.
_AXIS_LENGTH = 1000.0


def model_lines(deck: Deck) -> Iterator[str]:
    """Material, surface interaction, amplitude, initial motion and general contact."""
    yield "**"
    if deck.element is ElementType.REDUCED:
        yield "** Stiffness control, as the reduced element of tubelock has."
        yield keyword("Section Controls", name=HOURGLASS, hourglass="STIFFNESS")
        yield "1.0, 1.0, 1.0"
    yield from material_lines(deck)
    if deck.joint is not None:
        yield from _interaction(deck)
    if deck.step.ramp_time > 0.0:
        yield keyword("Amplitude", name=LOADING, definition="SMOOTH STEP")
        yield reals([0.0, 0.0, deck.step.ramp_time, 1.0])
    if deck.motion is not None:
        yield from _initial_motion(deck)
    if deck.joint is not None and deck.flavour is Flavour.GENERAL:
        yield "** All outer faces of all blocks may meet."
        yield keyword("Contact")
        yield keyword("Contact Inclusions", ALL_EXTERIOR=None)
        yield keyword("Contact Property Assignment")
        yield f", , {JOINT}"


def material_lines(deck: Deck) -> Iterator[str]:
    """Material with density, elasticity and Rayleigh damping."""
    material, rayleigh = deck.material, deck.effects.rayleigh
    yield keyword("Material", name=MATERIAL)
    yield keyword("Density")
    yield f"{real(material.density)},"
    yield keyword("Elastic")
    yield reals([material.young_modulus, material.poisson_ratio])
    if rayleigh is not None:
        values = {
            "alpha": rayleigh.mass_proportional,
            "beta": rayleigh.stiffness_proportional,
        }
        given = {name: real(value) for name, value in values.items() if value is not None}
        if given:
            yield keyword("Damping", **given)


def _interaction(deck: Deck) -> Iterator[str]:
    joint = deck.joint
    assert joint is not None
    yield keyword("Surface Interaction", name=JOINT)
    yield from law_lines(joint.law, explicit=deck.step.procedure is Procedure.EXPLICIT)
    if joint.friction is not None:
        slope = {}
        if joint.stick_stiffness is not None:
            slope = {"shear_traction_slope": real(joint.stick_stiffness)}
        yield keyword("Friction", **slope)
        yield f"{real(joint.friction)},"


def _initial_motion(deck: Deck) -> Iterator[str]:
    motion, assembly = deck.motion, deck.assembly
    assert motion is not None
    angular = rounded(motion.angular_velocity)
    spin = float(np.linalg.norm(angular))
    if spin == 0.0:
        yield keyword("Initial Conditions", type="VELOCITY")
        for block in range(assembly.n_blocks):
            for component, value in enumerate(motion.velocity.tolist(), start=1):
                if value != 0.0:
                    yield f"{block_label(deck, block)}.{ALL}, {component}, {real(value)}"
        return
    yield keyword("Initial Conditions", type="ROTATING VELOCITY")
    for block in range(assembly.n_blocks):
        centre = (assembly.nodes(block) + deck.offsets[block]).mean(axis=0)
        target = f"{block_label(deck, block)}.{ALL}"
        yield f"{target}, {reals([spin, *motion.velocity])}"
        yield reals([*centre, *(centre + _AXIS_LENGTH * angular / spin)])


def boundary_lines(deck: Deck) -> Iterator[str]:
    """Supports."""
    if not deck.holds:
        return
    yield keyword("Boundary")
    for hold in deck.holds:
        nodes = ALL if hold.face is None else f"{label(hold.face)}-NODES"
        first, last = hold.components[0] + 1, hold.components[-1] + 1
        yield f"{block_label(deck, hold.block)}.{nodes}, {first}, {last}"
