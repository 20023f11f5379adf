"""Read model data and the step: material, joints, effects, motion, supports, times, loads."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fem.assembly.statement import Motion
from fem.contact.law import ContactLaw
from fem.contact.pair_laws import PairLaws
from fem.decks.keywords import DeckError, name_of
from fem.decks.laws import read_law
from fem.decks.placement import rounded
from fem.decks.read.cards import Card, Heading, Sections, block_entry, floats, heading_value
from fem.decks.statement import (
    ALL,
    BodyForceLoad,
    DeckLoad,
    DeckStep,
    Hold,
    Joint,
    NodalForceLoad,
    Procedure,
)
from fem.element.material import Material
from fem.problem.effects import BulkViscosity, Effects, RayleighDamping
from geometry.loads import CircumferentialLoad, PressureLoad, TractionLoad
from geometry.mesh import FloatArray, IntArray


def read_materials(sections: Sections) -> dict[str, Material]:
    """Read density and elasticity of every material, by name."""
    materials, densities, moduli = (
        sections.all(keyword) for keyword in ("MATERIAL", "DENSITY", "ELASTIC")
    )
    if not len(materials) == len(densities) == len(moduli) >= 1:
        line = materials[-1].line if materials else sections.step[0].line
        raise DeckError(
            f"line {line}: got {len(materials)} cards *Material, {len(densities)} *Density and "
            f"{len(moduli)} *Elastic; expected as many of each"
        )
    found = {}
    for card, density, elastic in zip(materials, densities, moduli, strict=True):
        values = *density.numbers().tolist(), *elastic.numbers().tolist()
        if len(values) != 3:
            raise DeckError(f"line {card.line}: expected one density, a modulus and a ratio")
        found[card.parameter("NAME").upper()] = Material(
            density=values[0], young_modulus=values[1], poisson_ratio=values[2]
        )
    return found


def read_joint(
    sections: Sections, behavior: Card, heading: Heading, blocks: dict[str, int]
) -> Joint:
    """Read the contact law and friction; ``behavior`` is the card *Surface Behavior.

    Interactions but the first are of pairs of blocks; ``blocks`` numbers the instances by name.
    """
    law = _law_of(behavior, heading)
    pairs = sections.all("CONTACT PAIR")
    finite = any(
        p.parameters.get("TYPE", "").upper() == "NODE TO SURFACE"
        and "SMALL SLIDING" not in p.parameters
        for p in pairs
    )
    frictions, laws, name = dict[str, Card | None](), dict[str, ContactLaw](), ""
    for card in sections.model:
        if card.keyword == "SURFACE INTERACTION":
            name = card.parameter("NAME").upper()
            frictions[name] = None
        elif card.keyword == "FRICTION":
            frictions[name] = card
        elif card.keyword == "SURFACE BEHAVIOR":
            laws[name] = _law_of(card, heading)
    values = {k: 0.0 if c is None else float(c.numbers()[0]) for k, c in frictions.items()}
    given = next((card for card in frictions.values() if card is not None), None)
    first, *others = values
    of_pairs, own = dict[tuple[int, int], float](), dict[tuple[int, int], ContactLaw]()
    for card in pairs:
        name = card.parameter("INTERACTION").upper()
        for line, row in card.rows():
            a, b = sorted(block_entry(line, entry, blocks)[0] for entry in row[:2])
            if name in others and values[name] != values[first]:
                of_pairs[a, b] = values[name]
            if name in others and laws[name] != law:
                own[a, b] = laws[name]
    if own:
        law = PairLaws(law, tuple((*k, v) for k, v in own.items()))
    if given is None:
        return Joint(law, finite_sliding=finite)
    slope = given.parameters.get("SHEAR TRACTION SLOPE")
    stick = None if slope is None else floats(given.line, [slope])[0]
    return Joint(law, values[first], stick, finite, tuple((*k, v) for k, v in of_pairs.items()))


def _law_of(behavior: Card, heading: Heading) -> ContactLaw:
    """Law of the card *Surface Behavior."""
    return read_law(
        behavior.parameter("PRESSURE-OVERCLOSURE").upper(),
        behavior.numbers().tolist(),
        line=behavior.line,
        maximum_stiffness=lambda: _maximum_stiffness(heading),
    )


def _maximum_stiffness(heading: Heading) -> float:
    """Of the heading: where the data line has none."""
    if heading.values.get("maximum contact stiffness") == "none":
        return np.inf
    return float(heading_value(heading, "maximum contact stiffness", 1)[0])


def read_effects(sections: Sections) -> Effects:
    """Read Rayleigh damping, bulk viscosity and gravity."""
    damping = next(iter(sections.all("DAMPING")), None)  # of all materials the same
    viscosity = sections.maybe("BULK VISCOSITY")
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


def read_step(sections: Sections) -> DeckStep:
    """Read what is computed, with the amplitude and the output intervals."""
    amplitude = sections.maybe("AMPLITUDE")
    ramp = 0.0 if amplitude is None else _ramp(amplitude)
    large = sections.step[0].parameters.get("NLGEOM", "").upper() != "NO"
    static = sections.maybe("STATIC")
    if static is not None:
        values = static.numbers()
        if len(values) != 4:
            raise DeckError(f"line {static.line}: expected four times under *Static")
        return DeckStep(Procedure.STATIC, float(values[1]), ramp, large_rotations=large)
    dynamic = sections.one("DYNAMIC")
    row = next(iter(dynamic.rows()), (dynamic.line, []))[1]
    if len(row) != 2:
        raise DeckError(f"line {dynamic.line}: expected a time step (or nothing) and an end time")
    end_time = floats(dynamic.line, row[1:])[0]
    factor = dynamic.parameters.get("SCALE FACTOR")
    scaling = sections.maybe("FIXED MASS SCALING")
    fields, history = _output_intervals(sections, end_time)
    return DeckStep(
        Procedure.EXPLICIT,
        end_time,
        ramp,
        time_step=floats(dynamic.line, row[:1])[0] if row[0] else None,
        safety_factor=None if factor is None else floats(dynamic.line, [factor])[0],
        scaled_time_step=None
        if scaling is None
        else floats(scaling.line, [scaling.parameter("DT")])[0],
        large_rotations=large,
        field_intervals=fields,
        history_intervals=history,
    )


def _ramp(card: Card) -> float:
    values = card.numbers()
    kind = card.parameters.get("DEFINITION", "").upper()
    if (
        kind != "SMOOTH STEP"
        or values.shape != (4,)
        or (values[[0, 1, 3]] != (0.0, 0.0, 1.0)).any()
    ):
        raise DeckError(f"line {card.line}: expected a smooth step from 0 at time 0 to 1")
    return float(values[2])


def _output_intervals(sections: Sections, end_time: float) -> tuple[int, int]:
    fields, history = 20, 200
    for card in sections.all("OUTPUT"):
        if "NUMBER INTERVAL" in card.parameters:
            fields = int(floats(card.line, [card.parameters["NUMBER INTERVAL"]])[0])
        if "TIME INTERVAL" in card.parameters:
            interval = floats(card.line, [card.parameters["TIME INTERVAL"]])[0]
            history = round(end_time / interval) if interval > 0.0 else 0
    return fields, history


def read_loads(sections: Sections, blocks: dict[str, int]) -> Iterator[DeckLoad]:
    """Read loads but gravity; ``blocks`` numbers the instances by name."""
    for card in sections.step:
        rows = list(card.rows()) if card.keyword in {"DSLOAD", "DLOAD", "CLOAD"} else []
        if not rows:
            continue
        if card.keyword == "CLOAD":
            yield _nodal_force(rows, blocks)
            continue
        line, row = rows[0]
        kind = row[1].upper() if len(row) > 1 else ""
        if card.keyword == "DLOAD" and kind == "GRAV":
            continue
        where = [block_entry(number, r[0], blocks) for number, r in rows]
        loaded = np.array(list(dict.fromkeys(block for block, _ in where)), dtype=np.int64)
        face = name_of(where[0][1])
        if card.keyword == "DLOAD" and kind in {"BX", "BY", "BZ"}:
            yield _body_force(rows, loaded, blocks)
        elif card.keyword == "DSLOAD" and kind == "P":
            yield PressureLoad(loaded, face, floats(line, row[2:3])[0])
        elif card.keyword == "DSLOAD" and kind == "TRVEC" and "ORIENTATION" in card.parameters:
            yield CircumferentialLoad(loaded, face, floats(line, row[2:3])[0])
        elif card.keyword == "DSLOAD" and kind == "TRVEC":
            yield _traction(rows, loaded, face)
        else:
            raise DeckError(
                f"line {line}: got load {kind!r}; expected P or TRVEC under *Dsload, GRAV, BX, BY "
                "or BZ under *Dload"
            )


def _body_force(
    rows: list[tuple[int, list[str]]], loaded: IntArray, blocks: dict[str, int]
) -> BodyForceLoad:
    density = np.zeros((len(loaded), 3))
    position = {block: k for k, block in enumerate(loaded.tolist())}
    for line, row in rows:
        block, _ = block_entry(line, row[0], blocks)
        axis = "XYZ".find(row[1].upper()[1:])
        density[position[block], axis] = floats(line, row[2:3])[0]
    return BodyForceLoad(loaded, density)


def _nodal_force(rows: list[tuple[int, list[str]]], blocks: dict[str, int]) -> NodalForceLoad:
    forces: dict[tuple[int, int], FloatArray] = {}
    for line, row in rows:
        block, node = block_entry(line, row[0], blocks)
        component, value = floats(line, row[1:3]) if len(row) == 3 else (0.0, 0.0)
        if not node.isdigit() or component not in {1.0, 2.0, 3.0}:
            raise DeckError(f"line {line}: expected INSTANCE.NODE, a component and a force")
        forces.setdefault((block, int(node) - 1), np.zeros(3))[int(component) - 1] = value
    keys = np.array(list(forces), dtype=np.int64)
    return NodalForceLoad(keys[:, 0], keys[:, 1], np.array(list(forces.values())))


def _traction(rows: list[tuple[int, list[str]]], loaded: IntArray, face: str) -> TractionLoad:
    traction = np.zeros(3)
    for line, row in rows:
        if len(row) != 6:
            raise DeckError(f"line {line}: expected a surface, TRVEC, a magnitude and a direction")
        value, *direction = floats(line, row[2:])
        traction[int(np.argmax(direction))] = value
    return TractionLoad(loaded, face, traction)
