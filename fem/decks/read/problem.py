"""The problem that a deck describes: blocks, contact, supports and loads."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from scipy.spatial import KDTree

from fem.assembly.statement import Motion, Problem
from fem.contact.friction import CoulombFriction
from fem.contact.law import ContactLaw
from fem.contact.pair_laws import PairLaws
from fem.decks.keywords import DeckError
from fem.decks.read.actions import Actions, held_blocks, orientation_of, read_actions
from fem.decks.read.bodies import CONTACT, Blocks, Body, body_of
from fem.decks.read.cards import Card
from fem.decks.read.elements import KINDS, VOLUMES
from fem.decks.read.mesh import Part, Places
from fem.decks.read.model import Interaction, MaterialLines, ModelLines, Step, friction_of, law_of
from fem.decks.read.words import Dialect
from fem.element.hexahedron import ElementType
from geometry.assembly import Assembly, UnmatchedJoint
from geometry.loads import LoadCase
from geometry.mesh import FloatArray, IntArray
from geometry.polyhedra.assembly import as_polyhedral, contact_distance, unmatched_joints

#: Surfaces without a contact pair that are closer than this, in edges of their facets, could touch.
_NEAR = 0.5
#: Gravity of blocks that differs by less is the same.
_SAME = 1e-9


@dataclass(frozen=True)
class Built:
    """A problem and what beside it an explicit run needs."""

    problem: Problem
    ramp_time: float | None
    """Smooth step of the loads of an explicit run [s]; None: it names no load."""


def build_problem(name: str, places: Places, model: ModelLines, steps: tuple[Step, ...]) -> Built:
    """State the problem of a deck.

    Raises
    ------
    RefusedError
        Naming the line of what is not covered.
    """
    if len(steps) > 1:
        raise DeckError(
            f"{steps[1].card.at()}: a second *Step is not covered; expected one step from rest"
        )
    step = steps[0]
    blocks = Blocks(places, _bodies(places, name))
    contact = _read_contact(model, step, blocks)
    actions = read_actions(blocks, model, step)
    fixed, held = held_blocks(actions)
    axis, origin = orientation_of(actions)
    assembly = blocks.assembly(name, fixed, axis, origin)
    surfaces = as_polyhedral(assembly)
    if contact.pairs or contact.everywhere:
        assembly = replace(assembly, layer=contact_distance(surfaces))
        _check_unpaired(blocks, contact, assembly)
    load = LoadCase(
        assembly,
        "deck",
        tuple(actions.faces),
        assembly.fixed,
        held=tuple(held),
        nodes=actions.nodes,
        body_wrenches=_body_forces(actions, assembly),
    )
    kinds = {i.part.kind for i in places.instances if i.part.volumes}
    degree, element = _element(kinds, model)
    if degree > 1 and step.explicit:
        raise DeckError(
            f"{step.procedure.at()}: explicit steps have elements of degree 1; expected elements "
            "of eight nodes, or *Static"
        )
    materials = [_material(model, blocks, b) for b in range(assembly.n_blocks)]
    _check_densities(model, step)
    joints, sliding = {}, False
    if contact.pairs or contact.everywhere:
        sliding = contact.slides(assembly, unmatched_joints(assembly, surfaces))
        joints = contact.joints(model, _facet_size(assembly))
        if not sliding and not contact.small_sliding:
            model.note("contact: facets match and stay paired (small sliding)")
    problem = Problem(
        assembly,
        load,
        tuple(material.built() for material in materials),
        element=element,
        degree=degree,
        **joints,  # type: ignore[arg-type]
        clearance=contact.clearance,
        finite_sliding=sliding,
        finite_rotation=step.large_rotations,
        gravity=_gravity(actions, assembly.n_blocks),
        motion=_motion(model, blocks),
    )
    _check_order(step, problem)
    return Built(problem, actions.ramp_time)


def _material(model: ModelLines, blocks: Blocks, block: int) -> MaterialLines:
    """Material of a block."""
    part, name = blocks.instance(block).part, blocks.solid(block).material
    if name not in model.materials:
        card = next(card for card in part.sections if card.parameter("MATERIAL") == name)
        raise DeckError(
            f"{card.at()}: got material {name}, which is not defined; expected one of "
            f"{', '.join(model.materials) or 'those of *Material'}"
        )
    return model.materials[name]


def _check_densities(model: ModelLines, step: Step) -> None:
    """Reject explicit steps of materials without a density; static answers do not depend on it."""
    without = [stated for stated in model.materials.values() if stated.density is None]
    if without and step.explicit:
        raise DeckError(f"{without[0].card.at()}: explicit steps need *Density; expected one")
    if without:
        model.note("material: no density is stated, and the static answer depends on none")


def _check_order(step: Step, problem: Problem) -> None:
    """Reject friction where loads and motions act together: here loads act before motions."""
    load = problem.load_case
    moves = any(held.moves for held in load.held)
    loads = len(load.block) or load.body_wrenches is not None or problem.gravity is not None
    if moves and loads and problem.coulomb is not None:
        raise DeckError(
            f"{step.card.at()}: the step loads and moves blocks at once, with friction; here loads "
            "act before motions, which is another problem: expected loads or motions"
        )


# ---------------------------------------------------------------------------------------------
# Blocks


def _bodies(places: Places, path: str) -> list[Body]:
    result: dict[int, Body] = {}
    for instance in places.instances:
        part = instance.part
        if id(part) not in result:
            if not part.volumes:
                raise DeckError(
                    f"part {part.name or 'of the deck'}: no elements with volume; expected "
                    f"{', '.join(VOLUMES)}"
                )
            result[id(part)] = body_of(part, _sections(part), path)
    return [result[id(instance.part)] for instance in places.instances]


def _sections(part: Part) -> list[str]:
    """Material of each element of a part."""
    materials = [""] * len(part.volumes)
    for card in part.sections:
        name = card.parameter("ELSET")
        if name not in part.element_sets:
            raise DeckError(
                f"{card.at()}: got elset {name}, which is not defined; expected one of "
                f"{', '.join(list(part.element_sets)[:6]) or 'the sets of elements'}"
            )
        for label in part.element_sets[name]:
            if label in part.element_index:
                materials[part.element_index[label]] = card.parameter("MATERIAL")
    if "" in materials:
        number = list(part.element_index)[materials.index("")]
        raise DeckError(
            f"{part.kind_at}: element {number} has no *Solid Section; expected one for each element"
        )
    return materials


def _element(kinds: set[str], model: ModelLines) -> tuple[int, ElementType]:
    """Degree and hexahedron of the elements of a deck."""
    if len(kinds) > 1:
        raise DeckError(f"elements of the types {', '.join(sorted(kinds))}; expected one type")
    kind = kinds.pop()
    if VOLUMES[kind] in {4, 10}:
        model.note(f"elements: each {kind} is split into four hexahedra (incompatible modes)")
        return 1, ElementType.INCOMPATIBLE
    if VOLUMES[kind] > 8:
        if kind == "C3D20R":
            model.note("elements: C3D20R are integrated fully")
        return 2, ElementType.INCOMPATIBLE
    if kind == "C3D8":
        abaqus = model.dialect is Dialect.ABAQUS
        return 1, ElementType.B_BAR if abaqus else ElementType.FULL
    return 1, KINDS[kind]


def _facet_size(assembly: Assembly) -> float:
    """Mean edge of the facets in contact [mm]."""
    areas = [s.surface(CONTACT).areas for s in assembly.shapes if CONTACT in s.faces]
    return float(np.sqrt(np.concatenate(areas).mean()))


# ---------------------------------------------------------------------------------------------
# Contact


@dataclass
class _Contact:
    """Which blocks can meet, and by which interaction."""

    pairs: dict[tuple[int, int], Interaction] = field(default_factory=dict)
    everywhere: Interaction | None = None
    """Of all surfaces."""
    clearance: float = 0.0
    small_sliding: bool = False

    def slides(self, assembly: Assembly, unmatched: tuple[UnmatchedJoint, ...]) -> bool:
        """Whether points are searched: facets of blocks that can meet do not match."""
        fixed = assembly.fixed
        return not assembly.interfaces.n_contacts or any(
            (self.everywhere is not None or (joint.block_m, joint.block_s) in self.pairs)
            and not (fixed[joint.block_m] and fixed[joint.block_s])
            for joint in unmatched
        )

    def joints(self, model: ModelLines, size: float) -> dict[str, object]:
        """Law and friction of a problem."""
        default = self.everywhere or next(iter(self.pairs.values()))
        law, (friction, stick) = law_of(model, default, size), friction_of(model, default)
        laws: list[tuple[int, int, ContactLaw]] = []
        frictions: list[tuple[int, int, float]] = []
        for (a, b), stated in self.pairs.items():
            if stated is default:
                continue
            other, (coefficient, slope) = law_of(model, stated, size), friction_of(model, stated)
            if slope not in {None, stick}:
                raise DeckError(
                    f"{stated.card.at()}: interactions have several stick slopes; expected one"
                )
            if other != law:
                laws.append((a, b, other))
            if coefficient != friction:
                frictions.append((a, b, coefficient))
        coulomb = None
        if friction or frictions:
            constants = {} if stick is None else {"stick_stiffness": stick}
            coulomb = CoulombFriction(friction, of_pairs=tuple(frictions), **constants)
        return {"law": PairLaws(law, tuple(laws)) if laws else law, "friction": coulomb}


def _read_contact(model: ModelLines, step: Step, blocks: Blocks) -> _Contact:
    contact = _Contact()
    clearances: set[float] = set()
    for card in [*model.other, *step.cards]:
        if card.keyword == "CONTACT PAIR":
            _pairs(contact, model, blocks, card)
        elif card.keyword == "CONTACT":
            _general(model, card)
        elif card.keyword == "CONTACT INCLUSIONS":
            _inclusions(blocks, card)
        elif card.keyword == "CONTACT PROPERTY ASSIGNMENT":
            _properties(contact, model, blocks, card)
        elif card.keyword == "CLEARANCE":
            clearances.add(card.number(card.line, card.parameter("VALUE")))
        elif card.keyword == "CONTACT CLEARANCE":
            clearances.add(card.number(card.line, card.parameter("CLEARANCE")))
    if len(clearances) > 1:
        raise DeckError(f"*Clearance: got {sorted(clearances)}; expected one value for all pairs")
    contact.clearance = clearances.pop() if clearances else 0.0
    return contact


def _general(model: ModelLines, card: Card) -> None:
    if model.dialect is Dialect.CALCULIX:
        raise DeckError(
            f"{card.at()}: CalculiX ignores *Contact; expected *Contact Pair, or --dialect abaqus"
        )


def _inclusions(blocks: Blocks, card: Card) -> None:
    if "ALL EXTERIOR" not in card.parameters and card.data:
        raise DeckError(
            f"{card.at()}: *Contact Inclusions of some surfaces is not covered; expected ALL "
            "EXTERIOR, or *Contact Pair"
        )
    for block in range(len(blocks.owners)):
        blocks.add_face(block, CONTACT, np.arange(len(blocks.solid(block).outer)))


def _interaction(model: ModelLines, card: Card, line: int, name: str) -> Interaction:
    if name not in model.interactions:
        raise DeckError(
            f"{card.at(line)}: got interaction {name or 'none'}; expected one of "
            f"{', '.join(model.interactions) or 'those of *Surface Interaction'}"
        )
    return model.interactions[name]


def _properties(contact: _Contact, model: ModelLines, blocks: Blocks, card: Card) -> None:
    for line, row in card.rows():
        name = row[2].strip('"').upper() if len(row) == 3 else ""
        stated = _interaction(model, card, line, name)
        if not row[0] and not row[1]:
            contact.everywhere = stated
            continue
        ends = [blocks.surface(card, line, text) for text in row[:2]]
        _join(contact, stated, *ends)


def _join(contact: _Contact, stated: Interaction, *ends: dict[int, IntArray]) -> None:
    for a in ends[0]:
        for b in ends[1]:
            if a != b:
                contact.pairs[min(a, b), max(a, b)] = stated


#: Contact of pairs whose pressure is a function of the overclosure; other types are read as these.
_PENALTY = {"", "NODE TO SURFACE", "SURFACE TO SURFACE"}


def _pairs(contact: _Contact, model: ModelLines, blocks: Blocks, card: Card) -> None:
    kind = card.option("TYPE")
    if kind not in _PENALTY:
        raise DeckError(
            f"{card.at()}: *Contact Pair of type {kind} is not covered; expected surface to "
            "surface or node to surface"
        )
    if card.option("ADJUST") not in {"", "NO"} and card.number(
        card.line, card.parameters["ADJUST"]
    ):
        raise DeckError(
            f"{card.at()}: adjust={card.option('ADJUST')} moves nodes, which is not covered; "
            "expected nodes at their places, or adjust=0.0"
        )
    stated = _interaction(model, card, card.line, card.option("INTERACTION"))
    contact.small_sliding |= "SMALL SLIDING" in card.parameters
    for line, row in card.rows():
        if len(row) < 2 or not row[1]:
            raise DeckError(
                f"{card.at(line)}: got {', '.join(row)}; expected two surfaces, "
                "self-contact is not covered"
            )
        ends = [blocks.surface(card, line, text) for text in row[:2]]
        if ends[0].keys() == ends[1].keys() and len(ends[0]) == 1:
            raise DeckError(
                f"{card.at(line)}: both surfaces are of one block; expected two blocks, "
                "self-contact is not covered"
            )
        for end in ends:
            for block, rows in end.items():
                blocks.add_face(block, CONTACT, rows)
        _join(contact, stated, *ends)


def _check_unpaired(blocks: Blocks, contact: _Contact, assembly: Assembly) -> None:
    """Reject surfaces that could touch and have no contact pair: here they would press."""
    if contact.everywhere is not None:
        return
    size = _facet_size(assembly)
    trees = {}
    for block in range(assembly.n_blocks):
        shape = assembly.shape(block)
        if CONTACT in shape.faces:
            nodes = np.unique(shape.faces[CONTACT])
            trees[block] = KDTree(assembly.nodes(block)[nodes])
    for (a, one), (b, other) in combinations(trees.items(), 2):
        if (a, b) in contact.pairs or (assembly.fixed[a] and assembly.fixed[b]):
            continue
        if one.sparse_distance_matrix(other, _NEAR * size).nnz:
            raise DeckError(
                f"{assembly.name}: surfaces of {blocks.name(a)} and {blocks.name(b)} touch or "
                "nearly so, and no *Contact Pair has both; expected one, or surfaces that are "
                "apart"
            )


# ---------------------------------------------------------------------------------------------
# Forces on blocks, motion


def _gravity(actions: Actions, n_blocks: int) -> FloatArray | None:
    if not actions.gravity:
        return None
    values = np.array([actions.gravity.get(b, np.zeros(3)) for b in range(n_blocks)])
    without = [m for m in actions.model.materials.values() if m.density is None]
    if without:
        raise DeckError(f"{without[0].card.at()}: gravity needs *Density; expected one")
    if np.abs(values - values[0]).max() > _SAME * np.abs(values).max():
        raise DeckError(
            f"{actions.gravity_at}: gravity differs from block to block; expected it on all"
        )
    return values[0]


def _body_forces(actions: Actions, assembly: Assembly) -> FloatArray | None:
    if not actions.bodies:
        return None
    wrenches = np.zeros((assembly.n_blocks, 6))
    for block, density in actions.bodies.items():
        wrenches[block, :3] = density * assembly.shape(block).volume
    return wrenches


def _motion(model: ModelLines, blocks: Blocks) -> Motion | None:
    """Motion of all blocks at time 0."""
    moving: dict[int, FloatArray] = {}
    at = ""
    for card in model.other:
        if card.keyword != "INITIAL CONDITIONS":
            continue
        at = card.at()
        if card.option("TYPE") != "VELOCITY":
            raise DeckError(
                f"{at}: *Initial Conditions of type {card.option('TYPE')} is not covered; expected "
                "velocities"
            )
        for line, row in card.rows():
            component = card.whole(line, row[1]) if len(row) > 2 else 0
            if component not in {1, 2, 3}:
                raise DeckError(f"{card.at(line)}: expected a set, a component and a velocity")
            value = card.number(line, row[2])
            for block in blocks.located(blocks.places.members(card, line, row[0], nodes=True)):
                moving.setdefault(block, np.zeros(3))[component - 1] = value
    if not moving:
        return None
    values = [moving.get(block, np.zeros(3)) for block in range(len(blocks.owners))]
    if any((value != values[0]).any() for value in values):
        raise DeckError(f"{at}: blocks move at several velocities; expected one for all")
    return Motion(values[0], np.zeros(3))
