"""The problem that a deck describes: blocks, contact, supports and loads."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from scipy.spatial import KDTree

from fem.contact.friction import CoulombFriction
from fem.contact.law import ContactLaw
from fem.contact.pair_laws import PairLaws
from fem.decks.keywords import DeckError
from fem.decks.read.actions import Actions, fixed_blocks, held_faces, read_supports
from fem.decks.read.bodies import CONTACT, Blocks, Body, body_of
from fem.decks.read.cards import Card
from fem.decks.read.elements import KINDS, VOLUMES
from fem.decks.read.loads import body_wrenches, gravity_of, orientation_of, read_loads
from fem.decks.read.mesh import Part, Places
from fem.decks.read.model import (
    Interaction,
    MaterialLines,
    ModelLines,
    Step,
    friction_of,
    law_of,
    path_of,
    turning_times,
)
from fem.decks.read.words import Dialect
from fem.element.hexahedron import ElementType
from fem.problem import Problem, before_motion
from fem.system.time_step import characteristic_time_step
from geometry.assembly import Assembly, UnmatchedJoint
from geometry.loads import LoadCase
from geometry.mesh import IntArray
from geometry.parts.supports import HeldFace
from geometry.polyhedra.assembly import (
    PolyhedralAssembly,
    as_polyhedral,
    contact_distance,
    unmatched_joints,
)

#: Surfaces without a contact pair that are closer than this, in edges of their facets, could touch.
_NEAR = 0.5
#: The same in ∛V of the smallest block: no other block has room between.
_THIN = 0.25
#: Distance of the centres of such facets at most, in edges: those that meet along an edge alone are
#: farther apart.
_ASIDE = 0.75
#: Cosine of the angle between facets that face each other, at least.
_FACING = 0.7
#: Tetrahedra of ten nodes up to which their hexahedra are of degree 2: more take gigabytes.
_TETRAHEDRA = 2000


@dataclass(frozen=True)
class Built:
    """A problem and what beside it an explicit run needs."""

    problem: Problem
    blocks: Blocks
    """Where the nodes and elements of the deck are in its blocks."""
    ramp_time: float | None
    """Smooth step of the loads of an explicit run [s]; None: it names no load."""


def build_problem(name: str, places: Places, model: ModelLines, steps: tuple[Step, ...]) -> Built:
    """State the problem of a deck.

    Raises
    ------
    RefusedError
        Naming the line of what is not covered.
    """
    _check_steps(steps)
    _check_initial(model)
    step = steps[-1]
    blocks = Blocks(places, _bodies(places, name))
    contact = _read_contact(model, steps, blocks)
    rough = not step.explicit and contact.is_rough(model)
    ends = _stage_ends(model, steps) if rough else [(len(steps), None)]
    stages = [Actions(blocks, model, steps[:count], time) for count, time in ends]
    for actions in stages:
        read_supports(actions)
        read_loads(actions)
    actions = stages[-1]
    fixed = set.intersection(*map(fixed_blocks, stages))
    held = [tuple(held_faces(stage, fixed)) for stage in stages]
    assembly = blocks.assembly(name, sorted(fixed), *orientation_of(actions))
    surfaces = as_polyhedral(assembly)
    if contact.pairs or contact.everywhere:
        assembly = replace(assembly, layer=contact_distance(surfaces))
        _check_unpaired(blocks, contact, assembly)
        _note_unpaired(model, blocks, contact, surfaces, assembly)
    materials = [_material(model, blocks, b).built() for b in range(assembly.n_blocks)]
    _check_densities(model, step)
    densities = np.array([material.density for material in materials])
    gravity = [gravity_of(stage, assembly.free_blocks, densities) for stage in stages]
    cases = [_load_case(assembly, *one) for one in zip(stages, held, strict=True)]
    degree, element = _element(places, model, step)
    if degree > 1 and step.explicit:
        raise DeckError(
            f"{step.procedure.at()}: explicit steps have elements of degree 1; expected elements "
            "of eight nodes, or *Static"
        )
    joints, sliding = {}, False
    if contact.pairs or contact.everywhere:
        unmatched = contact.unmatched(assembly, unmatched_joints(assembly, surfaces))
        assembly = replace(assembly, unmatched=unmatched)
        sliding = bool(unmatched) or not assembly.interfaces.n_contacts
        joints = contact.joints(model, _facet_size(assembly))
        if not sliding and not contact.small_sliding:
            model.note("contact: facets match and stay paired (small sliding)")
    problem = Problem(
        assembly,
        cases[0],
        tuple(materials),
        element=element,
        degree=degree,
        **joints,  # type: ignore[arg-type]
        clearance=contact.clearance,
        finite_sliding=sliding and not (contact.small_sliding and assembly.unmatched),
        finite_rotation=_turns(model, step, cases, meets=bool(joints)),
        gravity=gravity[0],
    )
    if rough:
        problem = replace(problem, after=before_motion(problem, loaded=False))
    for case, own in zip(cases[1:], gravity[1:], strict=True):
        problem = replace(problem, load=case, gravity=own, after=problem)
    _note_steps(model, steps, problem)
    _check_minimum(model, step, problem)
    return Built(problem, blocks, actions.ramp_time)


def _load_case(assembly: Assembly, actions: Actions, held: tuple[HeldFace, ...]) -> LoadCase:
    return LoadCase(
        assembly,
        "deck",
        tuple(actions.faces),
        assembly.fixed,
        held=held,
        nodes=actions.nodes,
        body_wrenches=body_wrenches(actions, assembly),
    )


def _turns(model: ModelLines, step: Step, cases: list[LoadCase], *, meets: bool) -> bool:
    """Whether rotations of blocks are finite: in static steps with contact, supports that stay."""
    if not step.large_rotations or step.explicit:
        return step.large_rotations
    why = ""
    if not meets:
        why = "without contact"
    elif any(one.moves for case in cases for one in case.held):
        why = "with supports that move"
    elif len(cases) > 1:
        why = "of several stages with friction"
    if why:
        model.note(f"nlgeom: static answers {why} are linear in rotations, too")
    return not why


def _check_steps(steps: tuple[Step, ...]) -> None:
    """Reject explicit steps beside others, and lines that are no times."""
    for step in steps:
        step.procedure.numbers()
        if step.explicit and len(steps) > 1:
            raise DeckError(
                f"{step.card.at()}: a step of explicit dynamics beside {len(steps) - 1} others is "
                "not covered; expected one explicit step, or static ones"
            )


def _check_initial(model: ModelLines) -> None:
    """Reject start velocities and temperatures that strain; others have no influence."""
    cards = {card.keyword: card for card in reversed(model.other)}
    for card in (card for card in model.other if card.keyword == "INITIAL CONDITIONS"):
        kind = card.option("TYPE")
        if kind != "TEMPERATURE" or "EXPANSION" in cards:
            raise DeckError(
                f"{card.at()}: *Initial Conditions of type {kind or 'none'} is not covered"
                + (" beside *Expansion" if kind == "TEMPERATURE" else "")
                + "; expected none, or temperatures of materials that do not expand"
            )
        model.note("material: temperatures have no influence, no material expands")


#: Share of the least time step of an element that CalculiX takes for stable without scaling.
_STABLE = 0.5


def _check_minimum(model: ModelLines, step: Step, problem: Problem) -> None:
    """Reject a minimum increment for which CalculiX scales masses."""
    rows = list(step.procedure.rows())
    row = rows[0][1] if rows and step.explicit and model.dialect is Dialect.CALCULIX else []
    if len(row) < 3 or not row[2] or "DIRECT" in step.procedure.parameters:
        return
    blocks, materials = problem.blocks, problem.materials
    least = min(
        characteristic_time_step(blocks.shape(b).mesh, materials[b], linear_bulk_viscosity=0.0)
        for b in np.flatnonzero(problem.deforming).tolist()
    )
    minimum = step.procedure.number(rows[0][0], row[2])
    if minimum > _STABLE * least:
        raise DeckError(
            f"{step.procedure.at(rows[0][0])}: for a minimum increment of {minimum:g} s CalculiX "
            f"scales masses where elements allow less ({least:.2g} s here), in a way that is not "
            "covered; expected a shorter one, or none"
        )


#: Cards whose values change in a step.
_CHANGING = {"BOUNDARY", "CLOAD", "DLOAD", "DSLOAD"}


def _stage_ends(model: ModelLines, steps: tuple[Step, ...]) -> list[tuple[int, float | None]]:
    """Steps up to each stage, and its end in the last of them: between them all is straight.

    Friction remembers the way: stages end with the steps and where the way bends or turns back.
    """
    result: list[tuple[int, float | None]] = []
    for number, step in enumerate(steps):
        cards = [card for card in step.cards if card.keyword in _CHANGING]
        paths = [path for card in cards if (path := path_of(model, card)) is not None]
        acting = {card.option("AMPLITUDE") for card in cards if _acts(card)}
        # What follows one amplitude together stays on a line, and turns back where that does.
        bends = [turning_times(path) if len(acting) == 1 else path[:, 0] for path in paths]
        times = {time for of in bends for time in of.tolist() if 0 < time < step.duration}
        times |= {0.0 for path in paths if np.interp(0.0, *path.T)}
        if sum(map(_acts, cards)) == 1 and not any(np.ptp(path[:, 1]) for path in paths):
            times = set()  # one load, which acts at once
        straight = [card for card in cards if not card.option("AMPLITUDE") and _acts(card)]
        if times and straight:
            raise DeckError(
                f"{straight[0].at()}: {straight[0].title} without an amplitude beside one that "
                "bends, in a step with friction, is not covered; expected amplitudes on both"
            )
        if number and any(card.keyword.startswith("CONTACT PAIR") for card in step.cards):
            raise DeckError(
                f"{step.card.at()}: a contact pair of a later step with friction is not covered; "
                "expected it before the first step"
            )
        result += [(number + 1, time) for time in sorted({*times, step.duration})]
    return result


def _acts(card: Card) -> bool:
    """Whether a card has loads, or supports that move."""
    if card.keyword != "BOUNDARY":
        return True
    return any(len(row) > 3 and card.number(line, row[3] or "0") for line, row in card.rows())


def _note_steps(model: ModelLines, steps: tuple[Step, ...], problem: Problem) -> None:
    """Name what the answer is of; reject amplitudes in total time."""
    if len(steps) > 1 and model.total_time:
        raise DeckError(
            f"{model.total_time[0].at()}: an amplitude in total time in a deck of several steps "
            "is not covered; expected step time"
        )
    if problem.after is not None:
        model.note(
            f"steps: the load path in {len(problem.stages)} stages, each from the state and "
            "the slips of the one before"
        )
    elif len(steps) > 1:
        model.note(
            f"steps: the state at the end of step {len(steps)}; without friction it does not "
            "depend on the load path"
        )


def _material(model: ModelLines, blocks: Blocks, block: int) -> MaterialLines:
    """Material of a block, by its section."""
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


def _element(places: Places, model: ModelLines, step: Step) -> tuple[int, ElementType]:
    """Degree and hexahedron of the elements of a deck."""
    parts = [one.part for one in places.instances if one.part.volumes]
    kinds = {part.kind for part in parts}
    if len(kinds) > 1:
        raise DeckError(f"elements of the types {', '.join(sorted(kinds))}; expected one type")
    kind = kinds.pop()
    if VOLUMES[kind] in {4, 10}:
        few = sum(len(part.volumes) for part in parts) <= _TETRAHEDRA
        degree = 2 if VOLUMES[kind] == 10 and few and not step.explicit else 1
        how = "of degree 2" if degree == 2 else "with incompatible modes, stiffer in bending"
        model.note(f"elements: each {kind} is split into four hexahedra {how}")
        return degree, ElementType.INCOMPATIBLE
    if VOLUMES[kind] > 8:
        if kind == "C3D20R":
            model.note(
                "elements: C3D20R are integrated fully, stiffer where curved or thin ones bend, by "
                "13 % in MacNeal's curved beam"
            )
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
    surfaces: set[frozenset[str]] = field(default_factory=set)
    """Names of the two surfaces of each pair."""

    def unmatched(
        self, assembly: Assembly, every: tuple[UnmatchedJoint, ...]
    ) -> tuple[UnmatchedJoint, ...]:
        """Those joints whose facets do not match that are of blocks that can meet."""
        fixed = assembly.fixed
        return tuple(
            joint
            for joint in every
            if self.everywhere is not None or (joint.block_m, joint.block_s) in self.pairs
            if not (fixed[joint.block_m] and fixed[joint.block_s])
        )

    def is_rough(self, model: ModelLines) -> bool:
        """Whether any joint has friction."""
        stated = [*self.pairs.values(), *([self.everywhere] if self.everywhere else [])]
        return any(friction_of(model, one)[0] for one in stated)

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


def _read_contact(model: ModelLines, steps: tuple[Step, ...], blocks: Blocks) -> _Contact:
    contact = _Contact()
    clearances: set[float] = set()
    for card in [*model.other, *(card for step in steps for card in step.cards)]:
        if card.keyword == "CONTACT PAIR":
            _pairs(contact, model, blocks, card)
        elif card.keyword == "CONTACT":
            _general(model, card)
        elif card.keyword == "CONTACT INCLUSIONS":
            _inclusions(blocks, card)
        elif card.keyword == "CONTACT PROPERTY ASSIGNMENT":
            _properties(contact, model, blocks, card)
        elif card.keyword == "CONTACT INTERFERENCE":
            _check_interference(card, steps, rough=contact.is_rough(model))
        elif card.keyword == "CLEARANCE":
            clearances.add(card.number(card.line, card.parameter("VALUE")))
        elif card.keyword == "CONTACT CLEARANCE":
            clearances.add(card.number(card.line, card.parameter("CLEARANCE")))
    if len(clearances) > 1:
        raise DeckError(f"*Clearance: got {sorted(clearances)}; expected one value for all pairs")
    contact.clearance = clearances.pop() if clearances else 0.0
    return contact


def _check_interference(card: Card, steps: tuple[Step, ...], *, rough: bool) -> None:
    """Reject what does not leave the state of the whole overlap, resolved before all else."""
    first = steps[0].cards if card in steps[0].cards else []
    beside = [one for one in first if one.keyword in _CHANGING and _acts(one)]
    if "SHRINK" not in card.parameters or not first or (beside and rough):
        raise DeckError(
            f"{card.at()}: an overlap is removed by *Contact Interference, shrink of the first "
            "step alone, with friction before loads and motions; expected these, or none"
        )


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
    if not card.data:
        raise DeckError(f"{card.at()}: *Contact Pair has no surfaces; expected two in a line")
    for line, row in card.rows():
        if len(row) < 2 or not row[1]:
            raise DeckError(
                f"{card.at(line)}: got {', '.join(row)}; expected two surfaces, "
                "self-contact is not covered"
            )
        ends = [blocks.surface(card, line, text) for text in row[:2]]
        _check_new(contact, stated, card.at(line), row, ends)
        if ends[0].keys() == ends[1].keys() and len(ends[0]) == 1:
            raise DeckError(
                f"{card.at(line)}: both surfaces are of one block; expected two blocks, "
                "self-contact is not covered"
            )
        for end in ends:
            for block, rows in end.items():
                blocks.add_face(block, CONTACT, rows)
        _join(contact, stated, *ends)


def _check_new(
    contact: _Contact, stated: Interaction, at: str, row: list[str], ends: list[dict[int, IntArray]]
) -> None:
    """Reject a pair of surfaces that is there already, and a second interaction of two blocks."""
    names = frozenset(text.upper() for text in row[:2])
    if names in contact.surfaces:
        raise DeckError(f"{at}: the pair {', '.join(row[:2])} is there twice; expected it once")
    contact.surfaces.add(names)
    blocks = {(min(a, b), max(a, b)) for a in ends[0] for b in ends[1]}
    if any(contact.pairs.get(pair, stated) is not stated for pair in blocks):
        raise DeckError(
            f"{at}: two blocks meet by several interactions; expected one for all their surfaces"
        )


def _check_unpaired(blocks: Blocks, contact: _Contact, assembly: Assembly) -> None:
    """Reject surfaces that face each other and have no contact pair: here they would press."""
    if contact.everywhere is not None:
        return
    size = _facet_size(assembly)
    reach = min(_NEAR * size, _THIN * float(np.cbrt(assembly.volumes.min())))
    near = {}
    for block in range(assembly.n_blocks):
        shape = assembly.shape(block)
        if CONTACT in shape.faces:
            corners = assembly.nodes(block)[shape.faces[CONTACT]]
            normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            near[block] = KDTree(corners.mean(axis=1)), normals
    for (a, (one, normal)), (b, (other, opposite)) in combinations(near.items(), 2):
        if (a, b) in contact.pairs or (assembly.fixed[a] and assembly.fixed[b]):
            continue
        close = one.query_ball_tree(other, _ASIDE * size)
        close_by = [(k, of) for k, there in enumerate(close) for of in there]
        pairs = np.array(close_by, dtype=np.int64).reshape(-1, 2)
        along, against = normal[pairs[:, 0]], opposite[pairs[:, 1]]
        apart = np.abs(((other.data[pairs[:, 1]] - one.data[pairs[:, 0]]) * along).sum(axis=1))
        if ((along * against).sum(axis=1) < -_FACING)[apart <= reach].any():
            raise DeckError(
                f"{assembly.name}: surfaces of {blocks.name(a)} and {blocks.name(b)} face each "
                "other, touch or nearly so, and no *Contact Pair has both; expected one, or "
                "surfaces that are apart"
            )


def _note_unpaired(
    model: ModelLines,
    blocks: Blocks,
    contact: _Contact,
    surfaces: PolyhedralAssembly,
    assembly: Assembly,
) -> None:
    """Name blocks that touch outside all contact pairs: there they pass through each other."""
    patches = surfaces.interfaces.patches
    for m, s in np.unique(np.column_stack([patches.block_m, patches.block_s]), axis=0).tolist():
        pair = min(m, s), max(m, s)
        if contact.everywhere or pair in contact.pairs or assembly.fixed[[m, s]].all():
            continue
        model.note(
            f"contact: {blocks.name(m)} and {blocks.name(s)} touch and no *Contact Pair has both: "
            "they do not press on each other"
        )
