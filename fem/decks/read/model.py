"""Read model data: material, joints, effects, initial motion, supports."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fem.assembly.statement import Motion
from fem.decks.keywords import DeckError, name_of
from fem.decks.laws import read_law
from fem.decks.names import ALL
from fem.decks.placement import rounded
from fem.decks.read.cards import Card, floats
from fem.decks.read.sections import Heading, Sections, block_entry, heading_value
from fem.decks.statement import Hold, Joint
from fem.element.material import Material
from fem.problem.effects import BulkViscosity, Effects, RayleighDamping
from geometry.mesh import FloatArray


def read_material(sections: Sections) -> Material:
    """Read density and elasticity."""
    density = sections.one("DENSITY").numbers()
    elastic = sections.one("ELASTIC").numbers()
    if len(density) != 1 or len(elastic) != 2:
        raise DeckError(
            f"line {sections.one('MATERIAL').line}: expected one density, a modulus and a ratio"
        )
    return Material(
        density=float(density[0]), young_modulus=float(elastic[0]), poisson_ratio=float(elastic[1])
    )


def read_joint(sections: Sections, behavior: Card, heading: Heading) -> Joint:
    """Read the contact law and friction; ``behavior`` is the card *Surface Behavior."""
    kind = behavior.parameter("PRESSURE-OVERCLOSURE").upper()
    values = behavior.numbers().tolist()
    law = read_law(
        kind, values, line=behavior.line, maximum_stiffness=lambda: _maximum_stiffness(heading)
    )
    pairs = sections.all("CONTACT PAIR")
    finite = any(
        p.parameters.get("TYPE", "").upper() == "NODE TO SURFACE"
        and "SMALL SLIDING" not in p.parameters
        for p in pairs
    )
    friction = sections.maybe("FRICTION")
    if friction is None:
        return Joint(law, finite_sliding=finite)
    slope = friction.parameters.get("SHEAR TRACTION SLOPE")
    stick = None if slope is None else floats(friction.line, [slope])[0]
    return Joint(law, float(friction.numbers()[0]), stick, finite)


def _maximum_stiffness(heading: Heading) -> float:
    """Of the heading: where the data line has none."""
    if heading.values.get("maximum contact stiffness") == "none":
        return np.inf
    return float(heading_value(heading, "maximum contact stiffness", 1)[0])


def read_effects(sections: Sections) -> Effects:
    """Read Rayleigh damping, bulk viscosity and gravity."""
    damping, viscosity = sections.maybe("DAMPING"), sections.maybe("BULK VISCOSITY")
    rayleigh = None
    if damping is not None:
        given = {
            name: floats(damping.line, [damping.parameters[word]])[0]
            for word, name in (
                ("ALPHA", "mass_proportional"),
                ("BETA", "stiffness_proportional"),
            )
            if word in damping.parameters
        }
        rayleigh = RayleighDamping(**given)
    bulk = None
    if viscosity is not None and viscosity.numbers().any():
        bulk = BulkViscosity(*viscosity.numbers().tolist())
    return Effects(rayleigh=rayleigh, bulk_viscosity=bulk, gravity=_gravity(sections))


def _gravity(sections: Sections) -> FloatArray | None:
    """Sum of the components given for the first block; all blocks have the same."""
    gravity: FloatArray | None = None
    for card in sections.all("DLOAD"):
        for line, row in card.rows():
            if len(row) == 6 and row[1].upper() == "GRAV":
                value, *direction = floats(line, row[2:])
                gravity = np.zeros(3) if gravity is None else gravity
                gravity[int(np.argmax(direction))] = value
    return gravity


def read_motion(sections: Sections) -> Motion | None:
    """Read the initial motion, the same for every block."""
    card = sections.maybe("INITIAL CONDITIONS")
    if card is None:
        return None
    velocity, angular = np.zeros(3), np.zeros(3)
    rows = list(card.rows())
    if card.parameter("TYPE").upper() == "VELOCITY":
        for line, row in rows:
            component, value = floats(line, row[1:3])
            if component not in {1.0, 2.0, 3.0}:
                raise DeckError(f"line {line}: got component {component:g}, expected 1, 2 or 3")
            velocity[int(component) - 1] = value
    elif len(rows) > 1:
        (line, first), (next_line, second) = rows[0], rows[1]
        spin, *linear = floats(line, first[1:])
        points = floats(next_line, second)
        if len(linear) != 3 or len(points) != 6:
            raise DeckError(f"line {line}: expected a speed, a velocity and two points")
        velocity = np.array(linear)
        direction = np.array(points[3:]) - np.array(points[:3])
        angular = rounded(spin * direction / np.linalg.norm(direction))
    return Motion(velocity, angular)


def read_holds(sections: Sections, blocks: dict[str, int]) -> Iterator[Hold]:
    """Read supports; ``blocks`` numbers the instances by name."""
    for card in sections.all("BOUNDARY"):
        for line, row in card.rows():
            block, nodes = block_entry(line, row[0], blocks)
            first, last = (int(x) for x in floats(line, row[1:3]))
            face = None if nodes == ALL else name_of(nodes.removesuffix("-NODES"))
            yield Hold(block, face, tuple(range(first - 1, last)))
