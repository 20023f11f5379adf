"""Write a deck for Abaqus: heading, parts and instances, model data, step.

References: Abaqus Keywords Reference Guide; Abaqus Analysis User's Guide, "Contact
pressure-overclosure relationships" and "Distributed loads" (surface tractions).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from fem.decks.deck import (
    ALL,
    CONTACT,
    CYLINDRICAL,
    FRAME,
    GAP,
    HOURGLASS,
    JOINT,
    LOADING,
    Deck,
    Flavour,
)
from fem.decks.faces import ElementFaces, Patches, PatchPair, contact_patches, element_faces
from fem.decks.keywords import (
    element_lines,
    entry_lines,
    keyword,
    label,
    node_lines,
    real,
    reals,
)
from fem.decks.laws import law_heading, law_lines
from fem.decks.loads import component_lines, on_faces, step_load_lines
from fem.decks.placement import placement_rows, rounded
from fem.decks.supports import DeckSupports, spring_lines
from fem.element.hexahedron import ElementType
from fem.method import Explicit
from fem.system.effects import RayleighDamping
from geometry.block import Block
from geometry.loads import CircumferentialLoad
from geometry.mesh import IntArray


def abaqus_lines(deck: Deck) -> Iterator[str]:
    """Lines of a deck with parts and instances, general or standard: see `deck_lines`."""
    paired = deck.flavour is Flavour.STANDARD or deck.problem.clearance != 0.0
    patches = contact_patches(deck) if deck.meets and paired else None
    supports = DeckSupports(deck)
    yield from heading_lines(deck)
    yield "**"
    yield "** Parts: one for each distinct block"
    for number, shape in enumerate(deck.assembly.shapes):
        yield from _part(deck, supports, number, shape, patches)
    yield from _assembly(deck, supports)
    yield from _model(deck, supports)
    if deck.meets and deck.flavour is Flavour.GENERAL:
        yield from _general_contact(deck, patches)
    yield from supports.still_lines()
    if deck.flavour is Flavour.STANDARD and patches is not None:
        yield from pair_lines(deck, patches)
    for number in range(len(deck.stages)):
        yield from _step(deck, supports, number)


# ---------------------------------------------------------------------------------------------
# Heading


def program_version() -> str:
    """Return the version that is written into headings."""
    try:
        return version("tubelock")
    except PackageNotFoundError:
        return "0"


def heading_lines(deck: Deck) -> Iterator[str]:
    """Heading with provenance and what no keyword says; `fem.decks.read.deck` reads it."""
    assembly = deck.assembly
    name = deck.name.encode("ascii", "replace").decode().replace("\n", " ")[:80]
    yield "*Heading"
    yield f"tubelock {program_version()}, scene {name}"
    yield f"flavour: {deck.flavour}"
    yield "units: mm, N, MPa, s, t (density in t/mm3)"
    yield f"axis: {reals(assembly.axis)} through {reals(assembly.origin)}"
    yield f"open faces: {'allowed' if assembly.unmatched_allowed else 'none'}"
    if deck.searched:
        yield "joints: faces that do not match"
    reported = law_heading(deck.problem.contact_law) if deck.meets else None
    if reported is not None:
        yield reported
    yield f"clearance along every normal: {real(deck.problem.clearance)}"
    yield f"spacing of the blocks: {real(deck.problem.spacing)}"
    if deck.problem.spacing != 0.0:
        for block in range(assembly.n_blocks):
            place = reals(assembly.translations[block])
            yield f"place without spacing: {deck.labels[block]} {place}"
    for note in deck.notes:
        yield f"note: {note}"


# ---------------------------------------------------------------------------------------------
# Parts and instances


def _part(
    deck: Deck, supports: DeckSupports, number: int, shape: Block, patches: Patches | None
) -> Iterator[str]:
    mesh = shape.mesh
    yield "**"
    yield f"** {shape.name}: {np.count_nonzero(deck.assembly.shape_of == number)} instances"
    yield keyword("Part", name=label(shape.name))
    yield keyword("Node")
    yield from node_lines(mesh.nodes + 0.0)
    yield keyword("Element", type=deck.element)
    yield from element_lines(mesh.elements)
    yield keyword("Nset", nset=ALL, generate=None)
    yield f"1, {mesh.n_nodes}, 1"
    yield keyword("Elset", elset=ALL, generate=None)
    yield f"1, {mesh.n_elements}, 1"
    faces = {name: element_faces(shape, quads) for name, quads in shape.faces.items()}
    for name, facets in faces.items():
        yield from surface_lines(label(name), facets)
    if shape.contact_faces:
        yield keyword("Surface", type="ELEMENT", name=CONTACT)
        for name in shape.contact_faces:
            yield from _surface_members(label(name), faces[name])
    if patches is not None:
        for patch in patches.of_shape[number]:
            yield from surface_lines(patch.label, faces[patch.face].select(patch.positions))
    held = {s.face for s in supports.sets if deck.assembly.shape_of[s.block] == number}
    for name in (name for name in shape.faces if name in held):
        yield keyword("Nset", nset=f"{label(name)}-NODES")
        yield from entry_lines(np.unique(shape.faces[name]) + 1)
    yield from _section(deck, number)
    yield keyword("End Part")


def surface_lines(
    name: str, faces: ElementFaces, *, prefix: str = "", first_element: int = 1
) -> Iterator[str]:
    """Element sets of a surface, one for each side, and the surface itself."""
    for side in np.unique(faces.sides).tolist():
        yield keyword("Elset", elset=f"{prefix}{name}-S{side + 1}")
        elements = dict.fromkeys((faces.elements[faces.sides == side] + first_element).tolist())
        yield from entry_lines(elements)
    yield keyword("Surface", type="ELEMENT", name=f"{prefix}{name}")
    yield from _surface_members(name, faces, prefix=prefix)


def _surface_members(name: str, faces: ElementFaces, *, prefix: str = "") -> Iterator[str]:
    for side in np.unique(faces.sides).tolist():
        yield f"{prefix}{name}-S{side + 1}, S{side + 1}"


def _is_reduced(deck: Deck) -> bool:
    return deck.problem.element is ElementType.REDUCED


def _section(deck: Deck, number: int) -> Iterator[str]:
    controls = {"controls": HOURGLASS} if _is_reduced(deck) else {}
    name = deck.material_names[deck.materials[number]]
    yield keyword("Solid Section", elset=ALL, material=name, **controls)
    yield ","


def _assembly(deck: Deck, supports: DeckSupports) -> Iterator[str]:
    assembly = deck.assembly
    places = assembly.translations + deck.offsets
    yield "**"
    yield "** Assembly: blocks by layer and position, FRAME the fixed ones, TUBE all others"
    yield keyword("Assembly", name=label(assembly.name))
    for block in range(assembly.n_blocks):
        part = label(assembly.shape(block).name)
        yield keyword("Instance", name=deck.labels[block], part=part)
        for row in placement_rows(assembly.rotations[block], places[block]):
            yield reals(row)
        yield keyword("End Instance")
    for layer in np.unique(assembly.layer).tolist():
        yield keyword("Elset", elset=f"LAYER-{layer:02d}")
        yield from _members(deck, np.flatnonzero(assembly.layer == layer))
    for name, blocks in deck.sets.items():
        for kind in ("Elset", "Nset"):
            yield keyword(kind, **{kind.lower(): name})
            yield from _members(deck, blocks)
    for held in supports.sets:
        if held.nodes is not None:
            yield keyword("Nset", nset=supports.name(held), instance=deck.labels[held.block])
            yield from entry_lines(np.asarray(held.nodes) + 1)
    yield from supports.transform_lines()
    yield from spring_lines(deck, 1)
    loads = [one for problem in deck.stages for one in on_faces(problem.load_case, deck.flavour)]
    if any(isinstance(one, CircumferentialLoad) for one in loads):
        yield keyword("Orientation", name=CYLINDRICAL, system="CYLINDRICAL")
        yield reals([*assembly.origin, *(assembly.origin + assembly.axis)])
    yield keyword("End Assembly")


def _members(deck: Deck, blocks: IntArray) -> Iterator[str]:
    """All elements (or nodes) of some blocks."""
    return entry_lines(f"{deck.labels[block]}.{ALL}" for block in blocks.tolist())


#: Distance of the two points of an axis of rotation: far, so that its direction keeps its digits.
_AXIS_LENGTH = 1000.0


def _model(deck: Deck, supports: DeckSupports) -> Iterator[str]:
    """Material, surface interaction, amplitude and initial motion."""
    yield "**"
    yield "** Material, contact properties and amplitudes"
    if _is_reduced(deck):
        yield "** Stiffness control, as the reduced element of tubelock has."
        yield keyword("Section Controls", name=HOURGLASS, hourglass="STIFFNESS")
        yield "1.0, 1.0, 1.0"
    yield from material_lines(deck)
    if deck.meets:
        law, explicit = deck.problem.contact_law, deck.in_time is not None
        every = (law_lines(one, explicit=explicit) for one in law.members)
        yield from interaction_lines(deck, every)
    if deck.ramp_time:
        yield keyword("Amplitude", name=LOADING, definition="SMOOTH STEP")
        yield reals([0.0, 0.0, deck.ramp_time, 1.0])
    yield from supports.path_lines()
    if deck.problem.motion is not None:
        yield from _initial_motion(deck)


def _general_contact(deck: Deck, patches: Patches | None) -> Iterator[str]:
    """General contact; the patches of a clearance, if there is one."""
    if patches is not None:
        yield "** Gaps along the normals, whatever the coordinates say."
        yield f"*Contact Clearance, name={GAP}, adjust=NO, clearance={real(deck.problem.clearance)}"
    yield "** All outer faces of all blocks may meet."
    yield keyword("Contact")
    yield keyword("Contact Inclusions", ALL_EXTERIOR=None)
    yield keyword("Contact Property Assignment")
    yield f", , {JOINT}"
    if patches is not None:
        yield keyword("Contact Clearance Assignment")
        for pair in patches.pairs:
            yield f"{', '.join(_pair_sides(deck, pair))}, {GAP}"


def _pair_sides(deck: Deck, pair: PatchPair) -> tuple[str, str]:
    """Surfaces of a pair: slave, then master."""
    return (
        deck.of_block(pair.block_s, pair.patch_s),
        deck.of_block(pair.block_m, pair.patch_m),
    )


def material_lines(deck: Deck) -> Iterator[str]:
    """Materials with density, elasticity and Rayleigh damping."""
    rayleigh = deck.effects.rayleigh or RayleighDamping()
    values = {"alpha": rayleigh.mass_proportional, "beta": rayleigh.stiffness_proportional}
    damping = {name: real(value) for name, value in values.items() if value is not None}
    for material, name in deck.material_names.items():
        yield keyword("Material", name=name)
        yield keyword("Density")
        yield f"{real(material.density)},"
        yield keyword("Elastic")
        yield reals([material.young_modulus, material.poisson_ratio])
        if damping:
            yield keyword("Damping", **damping)


def interaction_lines(deck: Deck, laws: Iterable[Iterable[str]]) -> Iterator[str]:
    """Surface interactions, with the lines of each law."""
    law_of = list(map(tuple, laws))
    for (place, friction), name in deck.interactions.items():
        yield keyword("Surface Interaction", name=name)
        yield from law_of[place]
        if friction is None:
            yield "** frictionless"
        elif deck.is_flat:
            yield keyword("Friction")
            yield reals([friction, deck.stick])
        else:
            yield keyword("Friction", shear_traction_slope=real(deck.stick))
            yield f"{real(friction)},"


def _initial_motion(deck: Deck) -> Iterator[str]:
    motion, assembly = deck.problem.motion, deck.assembly
    assert motion is not None
    angular = rounded(motion.angular_velocity)
    spin = float(np.linalg.norm(angular))
    if spin == 0.0:
        yield keyword("Initial Conditions", type="VELOCITY")
        for name in deck.sets:
            yield from component_lines(name, motion.velocity)
        return
    yield keyword("Initial Conditions", type="ROTATING VELOCITY")
    for block in range(assembly.n_blocks):
        centre = deck.nodes(block).mean(axis=0)
        yield f"{deck.of_block(block, ALL)}, {reals([spin, *motion.velocity])}"
        yield reals([*centre, *(centre + _AXIS_LENGTH * angular / spin)])


#: Fields that an explicit step writes, unless the run states its frames, and samples of energies.
_FIELDS, _SAMPLES = 20, 200
ENERGIES = ("ALLAE", "ALLFD", "ALLIE", "ALLKE", "ALLSE", "ALLVD", "ALLWK", "ETOTAL")


def _step(deck: Deck, supports: DeckSupports, number: int) -> Iterator[str]:
    large = deck.stages[number].finite_rotation
    yield "**"
    yield f"** Step of {deck.program}"
    name = f"LOAD-{number + 1}" if number else "LOAD"
    yield keyword("Step", name=name, nlgeom="YES" if large else "NO")
    yield from static_lines(deck, number) if deck.in_time is None else _explicit(deck, deck.in_time)
    yield "**"
    yield "** Loads"
    yield from supports.step_lines(number)
    yield from step_load_lines(deck, supports, number)
    yield from _output(deck)
    yield keyword("End Step")


def static_lines(deck: Deck, number: int) -> Iterator[str]:
    """Procedure of a static step: first increment, end, least and largest increment.

    Friction that remembers the way takes ten increments or more. CalculiX pairs nodes and facets
    anew in each increment, and has no pair where a node slid over a rim: one increment has all.
    """
    end, first = deck.end_time, 1.0 if deck.is_flat and deck.stays_paired else 0.1
    yield keyword("Static")
    yield reals([first * end, end, 1e-6 * end, (0.1 if number else 1.0) * end])


def _explicit(deck: Deck, run: Explicit) -> Iterator[str]:
    viscosity = deck.effects.bulk_viscosity
    if run.time_step is not None:
        yield "*Dynamic, Explicit, direct user control"
        yield reals([run.time_step, deck.end_time])
    else:
        yield f"*Dynamic, Explicit, scale factor={real(run.safety_factor)}"
        yield f", {real(deck.end_time)}"
    yield keyword("Bulk Viscosity")
    if viscosity is None:
        yield "0.0, 0.0"
    else:
        yield reals([viscosity.linear_bulk_viscosity, viscosity.quadratic_bulk_viscosity])


def pair_lines(deck: Deck, patches: Patches) -> Iterator[str]:
    """Contact pairs: slave, then master; a clearance is in the law of CalculiX."""
    for pair in patches.pairs:
        yield _pair_keyword(deck, pair)
        yield ", ".join(_pair_sides(deck, pair))
    if deck.problem.clearance == 0.0 or deck.is_flat:
        return
    yield "** Gaps along the normals, whatever the coordinates say."
    for pair in patches.pairs:
        slave, master = _pair_sides(deck, pair)
        yield f"*Clearance, master={master}, slave={slave}, value={real(deck.problem.clearance)}"


def _pair_keyword(deck: Deck, pair: PatchPair) -> str:
    """Keyword line of a contact pair."""
    name = deck.interaction(pair.block_m, pair.block_s)
    if deck.on_faces or (deck.searched and deck.flavour is Flavour.STANDARD):
        # Nodes on facets of another mesh pass no uniform pressure; surface on surface does.
        return f"*Contact Pair, interaction={name}, type=SURFACE TO SURFACE"
    line = f"*Contact Pair, interaction={name}, type=NODE TO SURFACE"
    return line if deck.problem.finite_sliding else f"{line}, small sliding"


def _output(deck: Deck) -> Iterator[str]:
    run, fields, every = deck.in_time, "", ""
    if run is not None:
        fields = f", number interval={run.frames - 1 if run.frames > 1 else _FIELDS}"
        every = f", time interval={real(deck.end_time / _SAMPLES)}"
    yield "**"
    yield "** Output"
    yield f"*Output, field{fields}"
    yield keyword("Node Output")
    yield "U, RF"
    yield keyword("Element Output")
    yield "S"
    if deck.meets:
        yield "** CSTRESS: CPRESS and CSHEAR. CDISP: COPEN and CSLIP."
        yield keyword("Contact Output")
        yield "CSTRESS, CDISP"
    yield f"*Output, history{every}"
    if FRAME in deck.sets:
        yield keyword("Node Output", nset=FRAME)
        yield "RF1, RF2, RF3"
    if deck.meets and run is None:
        yield "** Resultants of pressure and friction of every contact pair."
        yield keyword("Contact Output")
        yield "CFN, CFS"
    yield keyword("Energy Output")
    yield ", ".join(ENERGIES)
