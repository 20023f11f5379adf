"""The step of an Abaqus deck: procedure, contact pairs, loads, output.

Reference: Abaqus Analysis User's Guide, "Distributed loads" (surface tractions).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fem.decks.faces import Patches
from fem.decks.keywords import keyword, label, real, reals
from fem.decks.names import ALL, CYLINDRICAL, JOINT, LOADING, block_label
from fem.decks.statement import (
    BodyForceLoad,
    Deck,
    DeckLoad,
    Flavour,
    NodalForceLoad,
    Procedure,
)
from geometry.loads.case import CircumferentialLoad, PressureLoad, TractionLoad
from geometry.mesh import FloatArray

ENERGIES = ("ALLAE", "ALLFD", "ALLIE", "ALLKE", "ALLSE", "ALLVD", "ALLWK", "ETOTAL")


def step_lines(deck: Deck, patches: Patches | None) -> Iterator[str]:
    """Write the step, and before a static one the contact pairs, which are model data there."""
    step = deck.step
    static = step.procedure is Procedure.STATIC
    if patches is not None and static:
        yield from _contact_pairs(deck, patches)
    yield "**"
    yield keyword("Step", name="LOAD", nlgeom="YES" if step.large_rotations else "NO")
    if static:
        yield keyword("Static")
        yield reals([0.1 * step.end_time, step.end_time, 1e-6 * step.end_time, step.end_time])
    else:
        yield from _explicit(deck)
    if patches is not None and not static:
        yield from _contact_pairs(deck, patches)
    for load in deck.loads:
        yield from _load(deck, load)
    if deck.effects.gravity is not None:
        yield from gravity_lines(
            deck.effects.gravity,
            [f"{block_label(deck, b)}.{ALL}" for b in range(deck.assembly.n_blocks)],
        )
    yield from _output(deck)
    yield keyword("End Step")


def _explicit(deck: Deck) -> Iterator[str]:
    step, viscosity = deck.step, deck.effects.bulk_viscosity
    if step.time_step is not None:
        yield "*Dynamic, Explicit, direct user control"
        yield reals([step.time_step, step.end_time])
    elif step.safety_factor is not None:
        yield f"*Dynamic, Explicit, scale factor={real(step.safety_factor)}"
        yield f", {real(step.end_time)}"
    else:
        yield "*Dynamic, Explicit"
        yield f", {real(step.end_time)}"
    yield keyword("Bulk Viscosity")
    if viscosity is None:
        yield "0.0, 0.0"
    else:
        yield reals([viscosity.linear_bulk_viscosity, viscosity.quadratic_bulk_viscosity])


def _contact_pairs(deck: Deck, patches: Patches) -> Iterator[str]:
    """Contact pairs: slave, then master. Typed in a static step; Abaqus/Explicit has no types."""
    for pair in patches.pairs:
        yield pair_keyword(deck)
        yield (
            f"{block_label(deck, pair.block_s)}.{pair.patch_s}, "
            f"{block_label(deck, pair.block_m)}.{pair.patch_m}"
        )
    if deck.clearance == 0.0:
        return
    yield "** Gaps along the normals, whatever the coordinates say."
    for pair in patches.pairs:
        yield (
            f"*Clearance, master={block_label(deck, pair.block_m)}.{pair.patch_m}, "
            f"slave={block_label(deck, pair.block_s)}.{pair.patch_s}, value={real(deck.clearance)}"
        )


def pair_keyword(deck: Deck) -> str:
    """Keyword line of a contact pair."""
    if deck.step.procedure is Procedure.EXPLICIT:
        return f"*Contact Pair, interaction={JOINT}, mechanical constraint=PENALTY"
    if deck.searched and deck.flavour is Flavour.PAIRS:
        # Nodes on facets of another mesh pass no uniform pressure; surface on surface does.
        return f"*Contact Pair, interaction={JOINT}, type=SURFACE TO SURFACE"
    line = f"*Contact Pair, interaction={JOINT}, type=NODE TO SURFACE"
    finite = deck.joint is not None and deck.joint.finite_sliding
    return line if finite else f"{line}, small sliding"


def amplitude_parameter(deck: Deck) -> dict[str, str | None]:
    """Parameter that names the amplitude of the loads, if there is one."""
    return {"amplitude": LOADING} if deck.step.ramp_time > 0.0 else {}


def _load(deck: Deck, load: DeckLoad) -> Iterator[str]:
    amplitude = amplitude_parameter(deck)
    if isinstance(load, NodalForceLoad):
        yield keyword("Cload", **amplitude)
        yield from _nodal_forces(deck, load)
    elif isinstance(load, BodyForceLoad):
        yield keyword("Dload", **amplitude)
        yield from _body_forces(deck, load)
    elif isinstance(load, PressureLoad):
        yield keyword("Dsload", **amplitude)
        for surface in _surfaces(deck, load):
            yield f"{surface}, P, {real(load.pressure)}"
    elif isinstance(load, CircumferentialLoad):
        yield keyword("Dsload", **amplitude, orientation=CYLINDRICAL, follower="NO")
        for surface in _surfaces(deck, load):
            yield f"{surface}, TRVEC, {real(load.traction)}, 0.0, 1.0, 0.0"
    else:
        yield keyword("Dsload", **amplitude, follower="NO")
        for surface in _surfaces(deck, load):
            yield from _components(f"{surface}, TRVEC", load.traction)


def _surfaces(deck: Deck, load: PressureLoad | CircumferentialLoad | TractionLoad) -> list[str]:
    """Loaded surfaces by name."""
    return [f"{block_label(deck, block)}.{label(load.face)}" for block in load.blocks.tolist()]


def _components(start: str, vector: FloatArray) -> Iterator[str]:
    """Magnitude and direction of each component of a vector: exact, unlike those of the whole."""
    for direction, value in zip(np.eye(3), vector.tolist(), strict=True):
        if value != 0.0:
            yield f"{start}, {real(value)}, {reals(direction)}"


def _nodal_forces(deck: Deck, load: NodalForceLoad) -> Iterator[str]:
    for block, node, force in zip(load.blocks, load.nodes, load.forces.tolist(), strict=True):
        for component, value in enumerate(force, start=1):
            if value != 0.0:
                yield f"{block_label(deck, int(block))}.{node + 1}, {component}, {real(value)}"


def _body_forces(deck: Deck, load: BodyForceLoad) -> Iterator[str]:
    for block, force in zip(load.blocks.tolist(), load.force_density.tolist(), strict=True):
        for axis, value in zip("XYZ", force, strict=True):
            if value != 0.0:
                yield f"{block_label(deck, block)}.{ALL}, B{axis}, {real(value)}"


def gravity_lines(gravity: FloatArray, targets: list[str]) -> Iterator[str]:
    """Gravity by components, constant in time, on element sets."""
    yield keyword("Dload")
    for target in targets:
        yield from _components(f"{target}, GRAV", gravity)


def _output(deck: Deck) -> Iterator[str]:
    step = deck.step
    contact = deck.joint is not None
    if step.procedure is Procedure.EXPLICIT:
        yield f"*Output, field, number interval={step.field_intervals}"
    else:
        yield "*Output, field"
    yield keyword("Node Output")
    yield "U"
    yield keyword("Element Output")
    yield "S"
    if contact:
        yield "** CSTRESS: CPRESS and the frictional shear stresses."
        yield keyword("Contact Output")
        yield "CSTRESS"
    if step.procedure is Procedure.EXPLICIT:
        yield f"*Output, history, time interval={real(step.end_time / step.history_intervals)}"
    else:
        yield "*Output, history"
    yield keyword("Energy Output")
    yield ", ".join(ENERGIES)
