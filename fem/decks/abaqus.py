"""Write a deck for Abaqus: heading, parts and instances, model data, step.

References: Abaqus Keywords Reference Guide; Abaqus Analysis User's Guide, "Contact
pressure-overclosure relationships" and "Distributed loads" (surface tractions).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import partial
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from fem.decks.faces import ElementFaces, Patches, PatchPair, contact_patches, element_faces
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
from fem.decks.laws import law_heading, law_lines
from fem.decks.placement import placement_rows, rounded
from fem.decks.statement import (
    ALL,
    CONTACT,
    CYLINDRICAL,
    ELEMENT_NAMES,
    FRAME,
    GAP,
    HOURGLASS,
    JOINT,
    LOADING,
    BodyForceLoad,
    Deck,
    DeckLoad,
    Flavour,
    Hold,
    NodalForceLoad,
    Procedure,
    block_label,
    check_deck,
    element_name,
    named_face,
)
from fem.decks.supports import (
    held_lines,
    in_own_axes,
    node_entries,
    path_lines,
    region_sets,
    spring_lines,
    step_support_lines,
    transform_lines,
)
from fem.element.hexahedron import ElementType
from geometry.block import Block
from geometry.loads import CircumferentialLoad, PressureLoad, TractionLoad
from geometry.mesh import FloatArray, IntArray


def abaqus_lines(deck: Deck) -> Iterator[str]:
    """Lines of a deck with parts and instances, general or standard: see `deck_lines`."""
    check_abaqus(deck)
    patches = contact_patches(deck) if _has_patches(deck) else None
    yield from heading_lines(deck)
    yield "**"
    yield "** Parts: one for each distinct block"
    for number, shape in enumerate(deck.assembly.shapes):
        yield from _part(deck, number, shape, patches)
    yield from _assembly(deck)
    yield from model_lines(deck)
    if deck.joint is not None and deck.flavour is Flavour.GENERAL:
        yield from _general_contact(deck, patches)
    yield from boundary_lines(deck)
    yield from step_lines(deck, patches if deck.flavour is Flavour.STANDARD else None)


def check_abaqus(deck: Deck) -> None:
    """Refuse what Abaqus cannot express.

    Raises
    ------
    DeckError
        By name.
    """
    check_deck(deck)
    if deck.joint is not None and deck.joint.has_pairs and deck.flavour is Flavour.GENERAL:
        raise DeckError(
            "contact.pairs: general contact has one friction and one law here; remove them, or "
            "choose --flavour standard or calculix"
        )
    small = deck.joint is not None and not (deck.joint.finite_sliding or deck.searched)
    if deck.clearance != 0.0 and deck.flavour is Flavour.STANDARD and not small:
        raise DeckError(
            f"contact.clearance: got {deck.clearance:g} mm, which contact pairs take in small "
            "sliding alone (*Clearance), and these blocks slide freely; expected --flavour general "
            "or calculix, or contact.spacing"
        )


def _has_patches(deck: Deck) -> bool:
    paired = deck.flavour is Flavour.STANDARD or deck.clearance != 0.0
    return deck.joint is not None and paired


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
    reported = None if deck.joint is None else law_heading(deck.joint.law)
    if reported is not None:
        yield reported
    yield f"clearance along every normal: {real(deck.clearance)}"
    yield f"spacing of the blocks: {real(deck.spacing)}"
    if deck.spacing != 0.0:
        for block in range(assembly.n_blocks):
            place = reals(assembly.translations[block])
            yield f"place without spacing: {block_label(deck, block)} {place}"
    for note in deck.notes:
        yield f"note: {note}"


# ---------------------------------------------------------------------------------------------
# Parts and instances


def _part(deck: Deck, number: int, shape: Block, patches: Patches | None) -> Iterator[str]:
    mesh = shape.mesh
    yield "**"
    yield f"** {shape.name}: {np.count_nonzero(deck.assembly.shape_of == number)} instances"
    yield keyword("Part", name=label(shape.name))
    yield keyword("Node")
    yield from node_lines(mesh.nodes[: mesh.n_nodes] + 0.0)
    yield keyword("Element", type=element_name(deck, ELEMENT_NAMES, shape))
    yield from element_lines(mesh.connectivity)
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
    for name in _held_faces(deck, number):
        yield keyword("Nset", nset=f"{label(name)}-NODES")
        yield from node_entries(np.unique(mesh.facet_nodes(shape.faces[name])))
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


def _held_faces(deck: Deck, number: int) -> list[str]:
    """Faces of a shape whose nodes are held on some block, in the order of the shape's faces."""
    held = {h.face for h in deck.every_hold if int(deck.assembly.shape_of[h.block]) == number}
    return [name for name in deck.assembly.shapes[number].faces if name in held]


def _section(deck: Deck, number: int) -> Iterator[str]:
    reduced = deck.element is ElementType.REDUCED
    controls = {"controls": HOURGLASS} if reduced else {}
    name = deck.material_names[deck.materials[number]]
    yield keyword("Solid Section", elset=ALL, material=name, **controls)
    yield ","


def _assembly(deck: Deck) -> Iterator[str]:
    assembly = deck.assembly
    places = assembly.translations + deck.offsets
    yield "**"
    yield "** Assembly: blocks by layer and position, FRAME the fixed ones, TUBE all others"
    yield keyword("Assembly", name=label(assembly.name))
    for block in range(assembly.n_blocks):
        part = label(assembly.shape(block).name)
        yield keyword("Instance", name=block_label(deck, block), part=part)
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
    for name, hold in region_sets(deck).items():
        yield keyword("Nset", nset=name, instance=block_label(deck, hold.block))
        yield from node_entries(hold.nodes or ())
    yield from transform_lines(deck, lambda hold: hold.region)
    yield from spring_lines(
        deck.springs, 1, lambda block, node: f"{block_label(deck, block)}.{node + 1}"
    )
    if any(isinstance(load, CircumferentialLoad) for load in deck.every_load):
        yield keyword("Orientation", name=CYLINDRICAL, system="CYLINDRICAL")
        yield reals([*assembly.origin, *(assembly.origin + assembly.axis)])
    yield keyword("End Assembly")


def _members(deck: Deck, blocks: IntArray) -> Iterator[str]:
    """All elements (or nodes) of some blocks."""
    return entry_lines(f"{block_label(deck, block)}.{ALL}" for block in blocks.tolist())


#: Distance of the two points of an axis of rotation: far, so that its direction keeps its digits.
_AXIS_LENGTH = 1000.0


def model_lines(deck: Deck) -> Iterator[str]:
    """Material, surface interaction, amplitude and initial motion."""
    yield "**"
    yield "** Material, contact properties and amplitudes"
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
    yield from path_lines(deck)
    if deck.motion is not None:
        yield from _initial_motion(deck)


def _general_contact(deck: Deck, patches: Patches | None) -> Iterator[str]:
    """General contact; the patches of a clearance, if there is one."""
    if patches is not None:
        yield "** Gaps along the normals, whatever the coordinates say."
        yield f"*Contact Clearance, name={GAP}, adjust=NO, clearance={real(deck.clearance)}"
    yield "** All outer faces of all blocks may meet."
    yield keyword("Contact")
    yield keyword("Contact Inclusions", ALL_EXTERIOR=None)
    yield keyword("Contact Property Assignment")
    yield f", , {JOINT}"
    if patches is not None:
        yield keyword("Contact Clearance Assignment")
        for pair in patches.pairs:
            yield f"{', '.join(_sides(deck, pair))}, {GAP}"


def _sides(deck: Deck, pair: PatchPair) -> tuple[str, str]:
    """Surfaces of a pair: slave, then master."""
    return (
        f"{block_label(deck, pair.block_s)}.{pair.patch_s}",
        f"{block_label(deck, pair.block_m)}.{pair.patch_m}",
    )


def material_lines(deck: Deck) -> Iterator[str]:
    """Materials with density, elasticity and Rayleigh damping."""
    rayleigh = deck.effects.rayleigh
    values = (
        {}
        if rayleigh is None
        else {
            "alpha": rayleigh.mass_proportional,
            "beta": rayleigh.stiffness_proportional,
        }
    )
    damping = {name: real(value) for name, value in values.items() if value is not None}
    for material, name in deck.material_names.items():
        yield keyword("Material", name=name)
        yield keyword("Density")
        yield f"{real(material.density)},"
        yield keyword("Elastic")
        yield reals([material.young_modulus, material.poisson_ratio])
        if damping:
            yield keyword("Damping", **damping)


def _interaction(deck: Deck) -> Iterator[str]:
    joint = deck.joint
    assert joint is not None
    slope = {}
    if joint.stick_stiffness is not None:
        slope = {"shear_traction_slope": real(joint.stick_stiffness)}
    for (law, friction), name in joint.interactions.items():
        yield keyword("Surface Interaction", name=name)
        yield from law_lines(
            joint.law.members[law], explicit=deck.step.procedure is Procedure.EXPLICIT
        )
        if friction is None:
            yield "** frictionless"
        else:
            yield keyword("Friction", **slope)
            yield f"{real(friction)},"


def _initial_motion(deck: Deck) -> Iterator[str]:
    motion, assembly = deck.motion, deck.assembly
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
        centre = (assembly.nodes(block) + deck.offsets[block]).mean(axis=0)
        target = f"{block_label(deck, block)}.{ALL}"
        yield f"{target}, {reals([spin, *motion.velocity])}"
        yield reals([*centre, *(centre + _AXIS_LENGTH * angular / spin)])


def boundary_lines(deck: Deck) -> Iterator[str]:
    """Supports that stay."""
    yield from held_lines(deck, lambda hold: _held_set(deck, hold))


def _held_set(deck: Deck, hold: Hold) -> str:
    if hold.nodes is not None:
        return hold.region
    nodes = ALL if hold.face is None else f"{label(hold.face)}-NODES"
    return f"{block_label(deck, hold.block)}.{nodes}"


ENERGIES = ("ALLAE", "ALLFD", "ALLIE", "ALLKE", "ALLSE", "ALLVD", "ALLWK", "ETOTAL")


def step_lines(deck: Deck, patches: Patches | None) -> Iterator[str]:
    """Write the steps, and before them the contact pairs, which are model data."""
    if patches is not None:
        yield from _contact_pairs(deck, patches)
    for number, stage in enumerate(deck.stages, start=1):
        yield from _one_step(stage, "LOAD" if number == 1 else f"LOAD-{number}")


def _one_step(deck: Deck, name: str) -> Iterator[str]:
    step = deck.step
    yield "**"
    yield f"** Step of {deck.program}"
    yield keyword("Step", name=name, nlgeom="YES" if step.large_rotations else "NO")
    if step.procedure is Procedure.STATIC:
        yield from static_lines(deck)
    else:
        yield from _explicit(deck)
    yield "**"
    yield "** Loads"
    yield from step_support_lines(deck, lambda hold: _held_set(deck, hold))
    yield from load_lines(deck, partial(_load, deck), list(deck.sets))
    yield from _output(deck)
    yield keyword("End Step")


def static_lines(deck: Deck) -> Iterator[str]:
    """Procedure of a static step: first increment, end, least and largest increment.

    Friction that remembers the way takes ten increments or more.
    """
    end = deck.step.end_time
    yield keyword("Static")
    yield reals([0.1 * end, end, 1e-6 * end, (0.1 if deck.before is not None else 1.0) * end])


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
    if step.scaled_time_step is not None:
        yield f"*Fixed Mass Scaling, type=BELOW MIN, dt={real(step.scaled_time_step)}"
    yield keyword("Bulk Viscosity")
    if viscosity is None:
        yield "0.0, 0.0"
    else:
        yield reals([viscosity.linear_bulk_viscosity, viscosity.quadratic_bulk_viscosity])


def _contact_pairs(deck: Deck, patches: Patches) -> Iterator[str]:
    """Contact pairs: slave, then master."""
    for pair in patches.pairs:
        yield pair_keyword(deck, pair)
        yield ", ".join(_sides(deck, pair))
    if deck.clearance == 0.0:
        return
    yield "** Gaps along the normals, whatever the coordinates say."
    for pair in patches.pairs:
        slave, master = _sides(deck, pair)
        yield f"*Clearance, master={master}, slave={slave}, value={real(deck.clearance)}"


def pair_keyword(deck: Deck, pair: PatchPair) -> str:
    """Keyword line of a contact pair."""
    assert deck.joint is not None
    name = deck.joint.interaction(pair.block_m, pair.block_s)
    if deck.joint.face_to_face or (deck.searched and deck.flavour is Flavour.STANDARD):
        # Nodes on facets of another mesh pass no uniform pressure; surface on surface does.
        return f"*Contact Pair, interaction={name}, type=SURFACE TO SURFACE"
    line = f"*Contact Pair, interaction={name}, type=NODE TO SURFACE"
    return line if deck.joint.finite_sliding else f"{line}, small sliding"


def amplitude_parameter(deck: Deck) -> dict[str, str | None]:
    """Parameter that names the amplitude of the loads, if there is one."""
    return {"amplitude": LOADING} if deck.step.ramp_time > 0.0 and deck.before is None else {}


def load_lines(
    deck: Deck, lines_of: Callable[[DeckLoad], Iterator[str]], elements: list[str]
) -> Iterator[str]:
    """Loads of a step that differ from those of the step before, gravity on sets of elements."""
    before, gravity = deck.before, deck.effects.gravity
    every = [line for load in deck.loads for line in lines_of(load)]
    if gravity is not None:
        every += gravity_lines(gravity, elements)
    if before is None:
        yield from every
        return
    first = before.effects.gravity
    alike = len(before.loads) == len(deck.loads) and all(map(same_load, before.loads, deck.loads))
    if alike and np.array_equal(
        first if first is not None else 0, 0 if gravity is None else gravity
    ):
        return
    old = [line for load in before.loads for line in lines_of(load)]
    old += gravity_lines(first, elements) if first is not None else []
    yield from every
    yield from _taken_back(old, {_target(line) for line in every})


def _taken_back(old: list[str], stated: set[tuple[str, ...]]) -> Iterator[str]:
    """Loads that are not stated anew, as zero: CalculiX keeps body forces with op=NEW."""
    card = ""
    for line in old:
        if line.startswith("*"):
            card = line
        elif _target(line) not in stated:
            what, kind, _, *along = line.split(", ")
            yield from (card, ", ".join([what, kind, "0.0", *along]))


def _target(line: str) -> tuple[str, ...]:
    """What a line of a load acts on, without its value."""
    return tuple(line.split(", ")[:2])


def same_load(one: DeckLoad, other: DeckLoad) -> bool:
    """Whether two loads are the same."""
    return type(one) is type(other) and all(
        np.array_equal(getattr(one, part.name), getattr(other, part.name)) for part in fields(one)
    )


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
    return [
        f"{block_label(deck, block)}.{label(named_face(load.face))}"
        for block in load.blocks.tolist()
    ]


def _components(start: str, vector: FloatArray) -> Iterator[str]:
    """Magnitude and direction of each component of a vector: exact, unlike those of the whole."""
    for direction, value in zip(np.eye(3), vector.tolist(), strict=True):
        if value != 0.0:
            yield f"{start}, {real(value)}, {reals(direction)}"


def _nodal_forces(deck: Deck, load: NodalForceLoad) -> Iterator[str]:
    for block, node, force in zip(
        load.blocks.tolist(), load.nodes.tolist(), load.forces, strict=True
    ):
        (own,) = in_own_axes(deck, block, {node: force}).values()
        yield from component_lines(f"{block_label(deck, block)}.{node + 1}", own)


def component_lines(target: str, vector: FloatArray) -> Iterator[str]:
    """Number and value of each component of a vector on nodes, zeros left out."""
    for component, value in enumerate(vector.tolist(), start=1):
        if value != 0.0:
            yield f"{target}, {component}, {real(value)}"


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
    step, contact = deck.step, deck.joint is not None
    explicit = step.procedure is Procedure.EXPLICIT
    yield "**"
    yield "** Output"
    yield (
        f"*Output, field, number interval={step.field_intervals}" if explicit else "*Output, field"
    )
    yield keyword("Node Output")
    yield "U, RF"
    yield keyword("Element Output")
    yield "S"
    if contact:
        yield "** CSTRESS: CPRESS and CSHEAR. CDISP: COPEN and CSLIP."
        yield keyword("Contact Output")
        yield "CSTRESS, CDISP"
    every = f", time interval={real(step.end_time / step.history_intervals)}" if explicit else ""
    yield f"*Output, history{every}"
    if FRAME in deck.sets:
        yield keyword("Node Output", nset=FRAME)
        yield "RF1, RF2, RF3"
    if contact and not explicit:
        yield "** Resultants of pressure and friction of every contact pair."
        yield keyword("Contact Output")
        yield "CFN, CFS"
    yield keyword("Energy Output")
    yield ", ".join(ENERGIES)
