"""Write a deck for CalculiX: flat, with other words for what its input has none for.

What was measured of CalculiX 2.20 and shapes this module: no parts and instances; its
EXPONENTIAL contact law is another one, so the law goes in as a table of at most 200 points with
NODE TO SURFACE pairs, and beyond the table the pressure stays constant; SMOOTH STEP, *CONTACT
and *BULK VISCOSITY are ignored without a word; ENCASTRE and TRVEC are fatal; explicit dynamics
takes no stiffness-proportional damping and gets C3D8I wrong.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fem.contact.law import ContactLaw
from fem.decks.abaqus import (
    heading_lines,
    interaction_lines,
    material_lines,
    pair_lines,
    static_lines,
    surface_lines,
)
from fem.decks.deck import EVERY_ELEMENT, EVERY_NODE, FRAME, LOADING, MATERIAL, Deck
from fem.decks.faces import ElementFaces, Patches, contact_patches, element_faces
from fem.decks.keywords import (
    DeckError,
    element_lines,
    entry_lines,
    keyword,
    label,
    node_lines,
    reals,
    table_lines,
)
from fem.decks.laws import law_lines, law_table
from fem.decks.loads import nodal_lines, on_faces, step_load_lines
from fem.decks.supports import DeckSupports, spring_lines
from fem.element.hexahedron import ElementType
from fem.system.rows import SmoothStepAmplitude
from geometry.mesh import IntArray

#: Samples of the smooth step; linear between them it is off by less than 1e-4 of the load.
_AMPLITUDE_POINTS = 101


#: Residual and correction at which an increment has converged, relative (defaults 0.005, 0.01).
_CONVERGENCE = (1.0e-6, 1.0e-4)


def calculix_lines(deck: Deck) -> Iterator[str]:
    """Lines of a flat deck for CalculiX: see `fem.decks.problem.deck_lines`."""
    patches = contact_patches(deck) if deck.meets else None
    supports = DeckSupports(deck)
    yield from heading_lines(deck)
    yield from _mesh(deck)
    yield from _held_sets(deck, supports)
    yield from _surfaces(deck, patches)
    yield "**"
    yield "** Material"
    yield from _material(deck)
    if patches is not None:
        laws = (_law(deck, law) for law in deck.problem.contact_law.members)
        yield from interaction_lines(deck, laws)
        yield from pair_lines(deck, patches)
    yield from _model_data(deck, supports)
    for number in range(len(deck.stages)):
        yield from _step(deck, supports, number)


def check_calculix(deck: Deck) -> None:
    """Refuse what CalculiX cannot express or computes wrongly.

    Raises
    ------
    DeckError
        By name.
    """
    explicit, rayleigh = deck.in_time is not None, deck.effects.rayleigh
    if deck.meets and explicit:
        raise DeckError(
            "fem.method: CalculiX's explicit dynamics has no contact law but a linear penalty; "
            "expected a static step where blocks meet"
        )
    if deck.problem.clearance < 0.0:
        _check_interference(deck)
    if explicit and rayleigh is not None and rayleigh.stiffness_proportional:
        raise DeckError(
            f"effects.rayleigh.stiffness_proportional: got {rayleigh.stiffness_proportional}; "
            "CalculiX's explicit dynamics takes none: remove it or choose fem.method=static"
        )
    if explicit and deck.problem.element is ElementType.INCOMPATIBLE:
        raise DeckError(
            "fem.element: CalculiX's explicit dynamics computes C3D8I wrongly (deflections 2.4 "
            "times too large); expected full or reduced"
        )


#: Distance over the root of a node's area beyond which CalculiX has no spring.
_REACH = 1.0e-3


def _check_interference(deck: Deck) -> None:
    """Refuse an interference beyond which CalculiX loses the springs that are to press."""
    shapes = deck.assembly.shapes
    areas = [s.surface(face).areas.min() for s in shapes for face in s.contact_faces]
    reach = _REACH * 0.5 * float(np.sqrt(min(areas)))
    if -deck.problem.clearance > reach:
        raise DeckError(
            f"contact.clearance: got {deck.problem.clearance:g} mm; CalculiX loses nodes that are "
            f"apart by more than {reach:.2g} mm on this mesh, and solves another problem without a "
            "warning: expected --flavour standard, or a smaller interference"
        )


# ---------------------------------------------------------------------------------------------
# Model data


def _material(deck: Deck) -> Iterator[str]:
    yield from material_lines(deck)
    names, assembly = deck.material_names, deck.assembly
    if len(names) == 1:
        yield keyword("Solid Section", elset=EVERY_ELEMENT, material=MATERIAL)
        return
    for material, name in names.items():
        mine = [deck.materials[k] == material for k in assembly.shape_of.tolist()]
        yield keyword("Elset", elset=f"{name}-ELEMENTS")
        yield from entry_lines(deck.labels[block] for block in np.flatnonzero(mine).tolist())
        yield keyword("Solid Section", elset=f"{name}-ELEMENTS", material=name)


def _law(deck: Deck, law: ContactLaw) -> Iterator[str]:
    if deck.on_faces:
        yield from law_lines(law, explicit=False)
        return
    yield "*Surface Behavior, pressure-overclosure=TABULAR"
    for row in law_table(law, deck.problem.clearance).tolist():
        yield reals(row)


def _model_data(deck: Deck, supports: DeckSupports) -> Iterator[str]:
    motion = deck.problem.motion
    if deck.ramp_time:
        yield keyword("Amplitude", name=LOADING)
        times = np.linspace(0.0, deck.ramp_time, _AMPLITUDE_POINTS).tolist()
        smooth = SmoothStepAmplitude(deck.ramp_time)
        yield from table_lines((time, smooth(time)) for time in times)
    yield from supports.path_lines()
    yield from spring_lines(deck, deck.first_element[-1] + 1)
    if motion is not None:
        yield keyword("Initial Conditions", type="VELOCITY")
        for block in range(deck.assembly.n_blocks):
            nodes = deck.nodes(block)
            spin = np.cross(motion.angular_velocity, nodes - nodes.mean(axis=0))
            yield from nodal_lines(deck, block, motion.velocity + spin)
    yield from supports.transform_lines()
    yield from supports.still_lines()


# ---------------------------------------------------------------------------------------------
# Step


def _step(deck: Deck, supports: DeckSupports, number: int) -> Iterator[str]:
    run = deck.in_time
    large: dict[str, str | None] = {"nlgeom": None} if deck.stages[number].finite_rotation else {}
    yield "**"
    yield f"** Step of {deck.program}"
    yield keyword("Step", **large, inc="1000000")
    if run is None:
        yield from static_lines(deck, number)
        yield keyword("Controls", parameters="FIELD")
        yield reals(_CONVERGENCE)
    else:
        assert run.time_step is not None
        # Without the last two numbers CalculiX takes steps of zero and never ends.
        yield "*Dynamic, direct, explicit, alpha=0.0"
        yield reals([run.time_step, deck.end_time, run.time_step, run.time_step])
    yield from supports.step_lines(number)
    yield from step_load_lines(deck, supports, number)
    yield from _output(deck, supports, number)
    yield keyword("End Step")


def _output(deck: Deck, supports: DeckSupports, number: int) -> Iterator[str]:
    yield keyword("Node File", frequency="999999")
    yield "U"
    yield keyword("El File", frequency="999999")
    yield "S"
    world = {"global_": "YES"} if supports.leaning else {}
    yield keyword("Node Print", nset=EVERY_NODE, frequency="999999", **world)
    yield "U"
    for held in supports.stages[number]:
        yield keyword("Node Print", nset=supports.name(held), totals="ONLY", frequency="999999")
        yield "RF"
    if deck.meets:
        yield keyword("Contact File", frequency="999999")
        yield "CDIS, CSTR"
        yield keyword("Contact Print", frequency="999999")
        yield "CSTR"


def _mesh(deck: Deck) -> Iterator[str]:
    """Nodes of all blocks in world coordinates, elements block by block, sets of blocks."""
    assembly = deck.assembly
    yield keyword("Node", nset=EVERY_NODE)
    for block, first in enumerate(deck.first_node[:-1]):
        yield from node_lines(deck.nodes(block) + 0.0, first + 1)
    for block, (node, element) in enumerate(
        zip(deck.first_node[:-1], deck.first_element, strict=False)
    ):
        shape = assembly.shape(block)
        yield keyword("Element", type=deck.element, elset=deck.labels[block])
        yield from element_lines(shape.mesh.elements, element + 1, node + 1)
    yield keyword("Elset", elset=EVERY_ELEMENT, generate=None)
    yield f"1, {deck.first_element[-1]}, 1"
    for layer in np.unique(assembly.layer).tolist():
        yield from _block_set(deck, f"LAYER-{layer:02d}", np.flatnonzero(assembly.layer == layer))
    for name, blocks in deck.sets.items():
        yield from _block_set(deck, name, blocks)


def _block_set(deck: Deck, name: str, chosen: IntArray) -> Iterator[str]:
    """Elements of some blocks: a range where the blocks follow each other, else a set of sets.

    Ranges are what every reader understands.
    """
    blocks = chosen.tolist()
    if blocks == list(range(blocks[0], blocks[-1] + 1)):
        yield keyword("Elset", elset=name, generate=None)
        yield f"{deck.first_element[blocks[0]] + 1}, {deck.first_element[blocks[-1] + 1]}, 1"
    else:
        yield keyword("Elset", elset=name)
        yield from entry_lines(deck.labels[block] for block in blocks)


def _held_sets(deck: Deck, supports: DeckSupports) -> Iterator[str]:
    """Sets of held nodes, those of all fixed blocks together too."""
    for held in supports.sets:
        first, end = deck.first_node[held.block : held.block + 2]
        name = supports.name(held)
        if held.whole:
            yield keyword("Nset", nset=name, generate=None)
            yield f"{first + 1}, {end}, 1"
            continue
        yield keyword("Nset", nset=name)
        shape = deck.assembly.shape(held.block)
        nodes = held.nodes if held.face is None else np.unique(shape.faces[held.face])
        yield from entry_lines(np.asarray(nodes) + first + 1)
    if supports.hold_frame:
        yield keyword("Nset", nset=FRAME)
        whole = (held for held in supports.stages[-1] if held.whole)
        yield from entry_lines(map(supports.name, whole))


def _surfaces(deck: Deck, patches: Patches | None) -> Iterator[str]:
    """Surfaces that pressures and contact pairs name."""
    known = [_shape_surfaces(deck, number, patches) for number in range(len(deck.assembly.shapes))]
    needed = {
        (block, label(str(load.face)))
        for problem in deck.stages
        for load in on_faces(problem.load_case, deck.flavour)
        for block in load.blocks.tolist()
    }
    for pair in () if patches is None else patches.pairs:
        needed |= {(pair.block_m, pair.patch_m), (pair.block_s, pair.patch_s)}
    for block, shape in enumerate(deck.assembly.shape_of.tolist()):
        for name, faces in known[shape].items():
            if (block, name) in needed:
                prefix, first = deck.of_block(block, ""), deck.first_element[block] + 1
                yield from surface_lines(name, faces, prefix=prefix, first_element=first)


def _shape_surfaces(deck: Deck, number: int, patches: Patches | None) -> dict[str, ElementFaces]:
    """All surfaces that blocks of one shape can have."""
    shape = deck.assembly.shapes[number]
    whole = {name: element_faces(shape, quads) for name, quads in shape.faces.items()}
    surfaces = {label(name): faces for name, faces in whole.items()}
    for patch in () if patches is None else patches.of_shape[number]:
        surfaces[patch.label] = whole[patch.face].select(patch.positions)
    return surfaces
