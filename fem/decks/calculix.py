"""Write a deck for CalculiX: flat, with other words for what its input has none for.

What was measured of CalculiX 2.20 and shapes this module: no parts and instances; its
EXPONENTIAL contact law is another one, so the law goes in as a table of at most 200 points with
NODE TO SURFACE pairs, and beyond the table the pressure stays constant; SMOOTH STEP, *CONTACT
and *BULK VISCOSITY are ignored without a word; ENCASTRE and TRVEC are fatal; explicit dynamics
takes no stiffness-proportional damping and gets C3D8I wrong.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import accumulate

import numpy as np

from fem.contact.law import ContactLaw
from fem.decks.abaqus import (
    amplitude_parameter,
    component_lines,
    heading_lines,
    load_lines,
    material_lines,
    pair_keyword,
    static_lines,
    surface_lines,
)
from fem.decks.faces import ElementFaces, Patches, contact_patches, element_faces
from fem.decks.keywords import (
    DeckError,
    element_lines,
    entry_lines,
    keyword,
    label,
    node_lines,
    real,
    reals,
)
from fem.decks.laws import law_lines, law_table
from fem.decks.model import block_nodes, nodal_forces
from fem.decks.statement import (
    FRAME,
    LOADING,
    MATERIAL,
    Deck,
    DeckLoad,
    Hold,
    Procedure,
    block_label,
    check_deck,
    element_name,
    named_face,
)
from fem.decks.supports import (
    held_lines,
    holds_frame,
    in_own_axes,
    node_entries,
    path_lines,
    spring_lines,
    step_support_lines,
    transform_lines,
)
from fem.element.hexahedron import ELEMENTS, ElementType
from fem.system.forces import SmoothStepAmplitude
from geometry.loads import PressureLoad
from geometry.mesh import BoolArray, FloatArray

#: Samples of the smooth step; linear between them it is off by less than 1e-4 of the load.
_AMPLITUDE_POINTS = 101


#: Residual and correction at which an increment has converged, relative (defaults 0.005, 0.01).
_CONVERGENCE = (1.0e-6, 1.0e-4)


def calculix_lines(deck: Deck) -> Iterator[str]:
    """Lines of a flat deck for CalculiX: see `fem.decks.write.deck_lines`."""
    check_calculix(deck)
    starts = Starts(deck)
    patches = None if deck.joint is None else contact_patches(deck)
    yield from heading_lines(deck)
    yield from mesh_lines(deck, starts)
    yield from held_set_lines(deck, starts)
    yield from flat_surface_lines(deck, starts, patches)
    yield "**"
    yield "** Material"
    yield from _material(deck)
    if patches is not None:
        yield from _contact(deck, patches)
    yield from _model_data(deck, starts)
    for stage in deck.stages:
        yield from _step(stage, starts)


def check_calculix(deck: Deck) -> None:
    """Refuse what CalculiX cannot express or computes wrongly.

    Raises
    ------
    DeckError
        By name.
    """
    check_deck(deck, CALCULIX_ELEMENTS)
    explicit = deck.step.procedure is Procedure.EXPLICIT
    rayleigh, joint = deck.effects.rayleigh, deck.joint
    if joint is not None and explicit:
        raise DeckError(
            "fem.method: CalculiX's explicit dynamics has no contact law but a linear penalty; "
            "expected a static step where blocks meet"
        )
    if deck.clearance < 0.0:
        _check_interference(deck)
    if explicit and rayleigh is not None and rayleigh.stiffness_proportional:
        raise DeckError(
            f"effects.rayleigh.stiffness_proportional: got {rayleigh.stiffness_proportional}; "
            "CalculiX's explicit dynamics takes none: remove it or choose fem.method=static"
        )
    if explicit and deck.element is ElementType.INCOMPATIBLE:
        raise DeckError(
            "fem.element: CalculiX's explicit dynamics computes C3D8I wrongly (deflections 2.4 "
            "times too large); expected full or reduced"
        )
    if explicit and deck.step.time_step is None:
        raise DeckError("fem.time_step is missing: CalculiX needs it for explicit dynamics [s]")


#: Distance over the root of a node's area beyond which CalculiX has no spring.
_REACH = 1.0e-3


def _check_interference(deck: Deck) -> None:
    """Refuse an interference beyond which CalculiX loses the springs that are to press."""
    shapes = deck.assembly.shapes
    areas = [s.surface(face).areas.min() for s in shapes for face in s.contact_faces]
    reach = _REACH * 0.5 * float(np.sqrt(min(areas)))
    if -deck.clearance > reach:
        raise DeckError(
            f"contact.clearance: got {deck.clearance:g} mm; CalculiX loses nodes that are apart by "
            f"more than {reach:.2g} mm on this mesh, and solves another problem without a warning: "
            "expected --flavour standard, or a smaller interference"
        )


# ---------------------------------------------------------------------------------------------
# Model data


def _material(deck: Deck) -> Iterator[str]:
    for line in material_lines(deck):
        if deck.step.procedure is Procedure.EXPLICIT or not line.startswith("*Damping"):
            yield line
    names, assembly = deck.material_names, deck.assembly
    if len(names) == 1:
        yield keyword("Solid Section", elset=EVERY_ELEMENT, material=MATERIAL)
        return
    for material, name in names.items():
        mine = [deck.materials[k] == material for k in assembly.shape_of.tolist()]
        yield keyword("Elset", elset=f"{name}-ELEMENTS")
        yield from entry_lines(block_label(deck, block) for block in np.flatnonzero(mine).tolist())
        yield keyword("Solid Section", elset=f"{name}-ELEMENTS", material=name)


def _contact(deck: Deck, patches: Patches) -> Iterator[str]:
    joint = deck.joint
    assert joint is not None
    for (law, friction), name in joint.interactions.items():
        yield keyword("Surface Interaction", name=name)
        yield from _law(deck, joint.law.members[law])
        if friction is None:
            yield "** frictionless"
        else:
            assert joint.stick_stiffness is not None
            yield keyword("Friction")
            yield reals([friction, joint.stick_stiffness])
    for pair in patches.pairs:
        yield pair_keyword(deck, pair)
        yield (
            f"{block_label(deck, pair.block_s)}_{pair.patch_s}, "
            f"{block_label(deck, pair.block_m)}_{pair.patch_m}"
        )


def _law(deck: Deck, law: ContactLaw) -> Iterator[str]:
    assert deck.joint is not None
    if deck.joint.face_to_face:
        yield from law_lines(law, explicit=False)
        return
    yield "*Surface Behavior, pressure-overclosure=TABULAR"
    for row in law_table(law, deck.clearance).tolist():
        yield reals(row)


def _model_data(deck: Deck, starts: Starts) -> Iterator[str]:
    if deck.step.ramp_time > 0.0:
        yield keyword("Amplitude", name=LOADING)
        yield from _sampled_amplitude(deck.step.ramp_time)
    yield from path_lines(deck)
    yield from spring_lines(
        deck.springs, starts.element[-1] + 1, lambda block, k: f"{starts.node[block] + k + 1}"
    )
    if deck.motion is not None:
        yield keyword("Initial Conditions", type="VELOCITY")
        for block in range(deck.assembly.n_blocks):
            nodes = block_nodes(deck, block)
            spin = np.cross(deck.motion.angular_velocity, nodes - nodes.mean(axis=0))
            yield from _nodal_lines(deck.motion.velocity + spin, starts.node[block])
    yield from transform_lines(deck, lambda hold: held_name(deck, hold))
    yield from held_lines(deck, lambda hold: held_name(deck, hold))


def _sampled_amplitude(duration: float) -> Iterator[str]:
    smooth = SmoothStepAmplitude(duration)
    times = np.linspace(0.0, duration, _AMPLITUDE_POINTS).tolist()
    pairs = [number for time in times for number in (time, smooth(time))]
    for first in range(0, len(pairs), 8):
        yield reals(pairs[first : first + 8])


def _nodal_lines(values: FloatArray, start: int) -> Iterator[str]:
    """Node, component and value, zeros left out."""
    for node, row in enumerate(values, start=start + 1):
        yield from component_lines(str(node), row)


# ---------------------------------------------------------------------------------------------
# Step


def _step(deck: Deck, starts: Starts) -> Iterator[str]:
    step = deck.step
    yield "**"
    yield f"** Step of {deck.program}"
    geometry: dict[str, str | None] = {"nlgeom": None} if step.large_rotations else {}
    yield keyword("Step", **geometry, inc="1000000")
    if step.procedure is Procedure.STATIC:
        yield from static_lines(deck)
        yield keyword("Controls", parameters="FIELD")
        yield reals(_CONVERGENCE)
    else:
        assert step.time_step is not None
        # Without the last two numbers CalculiX takes steps of zero and never ends.
        yield "*Dynamic, direct, explicit, alpha=0.0"
        yield reals([step.time_step, step.end_time, step.time_step, step.time_step])
    yield from step_support_lines(deck, lambda hold: held_name(deck, hold))
    yield from load_lines(deck, partial(_load, deck, starts), [EVERY_ELEMENT])
    yield from _output(deck)
    yield keyword("End Step")


def _load(deck: Deck, starts: Starts, load: DeckLoad) -> Iterator[str]:
    amplitude = amplitude_parameter(deck)
    if isinstance(load, PressureLoad):
        yield keyword("Dsload", **amplitude)
        face = label(named_face(load.face))
        for block in load.blocks.tolist():
            yield f"{block_label(deck, block)}_{face}, P, {real(load.pressure)}"
        return
    yield keyword("Cload", **amplitude)
    for block in np.unique(load.blocks).tolist():
        forces = dict(enumerate(nodal_forces(deck, load, block)))
        for node, force in in_own_axes(deck, block, forces).items():
            yield from component_lines(str(starts.node[block] + node + 1), force)


def _output(deck: Deck) -> Iterator[str]:
    yield keyword("Node File", frequency="999999")
    yield "U"
    yield keyword("El File", frequency="999999")
    yield "S"
    world = {"global_": "YES"} if deck.leaning else {}
    yield keyword("Node Print", nset=EVERY_NODE, frequency="999999", **world)
    yield "U"
    for name in dict.fromkeys(held_name(deck, hold) for hold in deck.holds):
        yield keyword("Node Print", nset=name, totals="ONLY", frequency="999999")
        yield "RF"
    if deck.joint is not None:
        yield keyword("Contact File", frequency="999999")
        yield "CDIS, CSTR"
        yield keyword("Contact Print", frequency="999999")
        yield "CSTR"


#: CalculiX' name of each element that has one.
CALCULIX_ELEMENTS = {kind: found.calculix for kind, found in ELEMENTS.items() if found.calculix}


EVERY_NODE = "NALL"
EVERY_ELEMENT = "EALL"


class Starts:
    """First node and element of each block in the flat numbering, from 0."""

    def __init__(self, deck: Deck) -> None:
        shapes = [deck.assembly.shape(b).mesh for b in range(deck.assembly.n_blocks)]
        self.node = [0, *accumulate(mesh.n_nodes for mesh in shapes)]
        self.element = [0, *accumulate(mesh.n_elements for mesh in shapes)]


def mesh_lines(deck: Deck, starts: Starts) -> Iterator[str]:
    """Nodes of all blocks in world coordinates, elements block by block, sets of blocks."""
    assembly = deck.assembly
    yield keyword("Node", nset=EVERY_NODE)
    for block in range(assembly.n_blocks):
        nodes = block_nodes(deck, block)[: assembly.shape(block).mesh.n_nodes]
        yield from node_lines(nodes + 0.0, starts.node[block] + 1)
    for block in range(assembly.n_blocks):
        name = block_label(deck, block)
        shape = assembly.shape(block)
        kind = element_name(deck, CALCULIX_ELEMENTS, shape)
        yield keyword("Element", type=kind, elset=name)
        first = starts.element[block] + 1, starts.node[block] + 1
        yield from element_lines(shape.mesh.connectivity, *first)
    yield keyword("Elset", elset=EVERY_ELEMENT, generate=None)
    yield f"1, {starts.element[-1]}, 1"
    for layer in np.unique(assembly.layer).tolist():
        yield from _block_set(deck, f"LAYER-{layer:02d}", assembly.layer == layer, starts)
    for name, blocks in deck.sets.items():
        chosen = np.isin(np.arange(assembly.n_blocks), blocks)
        yield from _block_set(deck, name, chosen, starts)


def _block_set(deck: Deck, name: str, chosen: BoolArray, starts: Starts) -> Iterator[str]:
    """Elements of some blocks: a range where the blocks follow each other, else a set of sets.

    Ranges are what every reader understands.
    """
    blocks = np.flatnonzero(chosen).tolist()
    if blocks == list(range(blocks[0], blocks[-1] + 1)):
        yield keyword("Elset", elset=name, generate=None)
        yield f"{starts.element[blocks[0]] + 1}, {starts.element[blocks[-1] + 1]}, 1"
    else:
        yield keyword("Elset", elset=name)
        yield from entry_lines(block_label(deck, block) for block in blocks)


def held_name(deck: Deck, hold: Hold) -> str:
    """Name of the set of nodes that a support holds."""
    nodes = "ALL" if hold.face is None else f"{label(hold.face)}-NODES"
    if hold.nodes is not None:
        nodes = hold.region
    return f"{block_label(deck, hold.block)}_{nodes}"


def held_set_lines(deck: Deck, starts: Starts) -> Iterator[str]:
    """Sets of held nodes, those of all fixed blocks together too."""
    for name, hold in {held_name(deck, hold): hold for hold in deck.every_hold}.items():
        first, end = starts.node[hold.block], starts.node[hold.block + 1]
        if hold.nodes is not None:
            yield keyword("Nset", nset=name)
            yield from node_entries(np.array(hold.nodes) + first)
        elif hold.face is None:
            yield keyword("Nset", nset=name, generate=None)
            yield f"{first + 1}, {end}, 1"
        else:
            yield keyword("Nset", nset=name)
            shape = deck.assembly.shape(hold.block)
            held = shape.mesh.facet_nodes(shape.faces[hold.face])
            yield from entry_lines(np.unique(held) + first + 1)
    if holds_frame(deck):
        yield keyword("Nset", nset=FRAME)
        yield from entry_lines(held_name(deck, hold) for hold in deck.holds if hold.whole)


def flat_surface_lines(deck: Deck, starts: Starts, patches: Patches | None) -> Iterator[str]:
    """Surfaces that pressures and contact pairs name."""
    assembly = deck.assembly
    known = [_shape_surfaces(deck, number, patches) for number in range(len(assembly.shapes))]
    for block, needed in enumerate(_needed_surfaces(deck, patches)):
        for name, faces in known[int(assembly.shape_of[block])].items():
            if name in needed:
                yield from surface_lines(
                    name,
                    faces,
                    prefix=f"{block_label(deck, block)}_",
                    first_element=starts.element[block] + 1,
                )


def _shape_surfaces(deck: Deck, number: int, patches: Patches | None) -> dict[str, ElementFaces]:
    """All surfaces that blocks of one shape can have."""
    shape = deck.assembly.shapes[number]
    whole = {name: element_faces(shape, quads) for name, quads in shape.faces.items()}
    surfaces = {label(name): faces for name, faces in whole.items()}
    for patch in () if patches is None else patches.of_shape[number]:
        surfaces[patch.label] = whole[patch.face].select(patch.positions)
    return surfaces


def _needed_surfaces(deck: Deck, patches: Patches | None) -> list[set[str]]:
    """Labels of the surfaces of each block that the deck names."""
    needed: list[set[str]] = [set() for _ in range(deck.assembly.n_blocks)]
    for load in deck.every_load:
        if isinstance(load, PressureLoad):
            for block in load.blocks.tolist():
                needed[block].add(label(named_face(load.face)))
    for pair in () if patches is None else patches.pairs:
        needed[pair.block_m].add(pair.patch_m)
        needed[pair.block_s].add(pair.patch_s)
    return needed
