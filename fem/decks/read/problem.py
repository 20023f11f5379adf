"""The problem that a deck describes: blocks, contact, supports and loads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.decks.keywords import DeckError
from fem.decks.read.actions import Actions, read_supports
from fem.decks.read.blocks import Blocks
from fem.decks.read.cards import Card
from fem.decks.read.contact import DeckContact
from fem.decks.read.elements import KINDS, VOLUMES
from fem.decks.read.loads import (
    body_wrenches,
    gravity_of,
    node_forces,
    orientation_of,
    read_loads,
)
from fem.decks.read.mesh import DeckPart
from fem.decks.read.model import ModelLines, Step, material_of, path_of, turning_times
from fem.decks.read.words import Dialect
from fem.element.hexahedron import ElementType
from fem.element.material import Material
from fem.problem import Problem, before_motion
from geometry.assembly import Assembly
from geometry.loads import LoadCase
from geometry.polyhedra.assembly import as_polyhedral, contact_distance
from geometry.polyhedra.near_joints import unmatched_joints

#: Tetrahedra of ten nodes up to which their hexahedra are of degree 2: more take gigabytes.
_TETRAHEDRA = 2000


def build_problem(
    name: str, blocks: Blocks, model: ModelLines, steps: tuple[Step, ...]
) -> tuple[Problem, float | None]:
    """State the problem of a deck.

    Beside it is the smooth step of the loads of an explicit run [s]; None: it names no load.

    Raises
    ------
    RefusedError
        Naming the line of what is not covered.
    """
    _check_steps(model, steps)
    step = steps[-1]
    contact = DeckContact(model, blocks)
    contact.read(steps)
    rough = not step.explicit and contact.is_rough
    ends = _stage_ends(model, steps) if rough else [(len(steps), step.duration)]
    at_end = not step.explicit and (rough or len(steps) > 1)
    stages = [Actions(blocks, model, steps[:count], time, at_end) for count, time in ends]
    for actions in stages:
        read_supports(actions)
        read_loads(actions)
    actions = stages[-1]
    fixed = sorted(set.intersection(*(set(stage.fixed) for stage in stages)))
    assembly = blocks.assembly(name, fixed, *orientation_of(actions))
    joints, sliding = {}, False
    if contact.stated:
        surfaces, size = as_polyhedral(assembly), _facet_size(assembly)
        contact.check_unpaired(assembly, surfaces, size)
        unmatched = contact.unmatched(assembly, unmatched_joints(assembly, surfaces))
        assembly = replace(assembly, layer=contact_distance(surfaces), unmatched=unmatched)
        sliding = bool(unmatched) or not assembly.interfaces.n_contacts
        joints = contact.joints(size)
        if not sliding and not contact.small_sliding:
            model.note("contact: facets match and stay paired (small sliding)")
    materials = _materials(model, blocks, step)
    densities = np.array([material.density for material in materials])
    gravity = [gravity_of(stage, assembly.free_blocks, densities) for stage in stages]
    cases = [_load_case(assembly, stage) for stage in stages]
    degree, element = _element(blocks, model, step)
    problem = Problem(
        assembly,
        cases[0],
        materials,
        element=element,
        degree=degree,
        **joints,  # type: ignore[arg-type]
        clearance=contact.clearance,
        finite_sliding=sliding and not (contact.small_sliding and assembly.unmatched),
        finite_rotation=step.turns,
        gravity=gravity[0],
    )
    if rough:
        problem = replace(problem, after=before_motion(problem, loaded=False))
    for case, own in zip(cases[1:], gravity[1:], strict=True):
        problem = replace(problem, load=case, gravity=own, after=problem)
    if step.large_rotations and not step.turns:
        model.note("nlgeom: static answers are linear in rotations")
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
    return problem, actions.ramp_time


def _load_case(assembly: Assembly, actions: Actions) -> LoadCase:
    return LoadCase(
        assembly,
        "deck",
        tuple(actions.faces),
        assembly.fixed,
        held=tuple(held for held in actions.held if not assembly.fixed[held.block]),
        nodes=node_forces(actions),
        body_wrenches=body_wrenches(actions, assembly),
    )


def _check_steps(model: ModelLines, steps: tuple[Step, ...]) -> None:
    """Reject explicit steps beside others, and lines that are no times."""
    for step in steps:
        step.procedure.numbers()
        if step.explicit and len(steps) > 1:
            raise step.card.unread(f"an explicit step beside {len(steps) - 1} others")
        scaled = step.explicit and step.times[2] and "DIRECT" not in step.procedure.parameters
        if scaled and model.dialect is Dialect.CALCULIX:
            raise step.procedure.unread("a least increment, for which masses are scaled,")


#: Cards whose values change in a step.
_CHANGING = {"BOUNDARY", "CLOAD", "DLOAD", "DSLOAD"}


def _stage_ends(model: ModelLines, steps: tuple[Step, ...]) -> list[tuple[int, float]]:
    """Steps up to each stage, and its end in the last of them: between them all is straight.

    Friction remembers the way: stages end with the steps and where the way bends or turns back.
    """
    result: list[tuple[int, float]] = []
    for number, step in enumerate(steps, start=1):
        cards = [card for card in step.cards if card.keyword in _CHANGING and _acts(card)]
        paths = [path for card in cards if (path := path_of(model, card)) is not None]
        # What follows one amplitude together stays on a line, and turns back where that does.
        one = len({card.option("AMPLITUDE") for card in cards}) == 1
        bends = [turning_times(path) if one else path[:, 0] for path in paths]
        times = {time for of in bends for time in of.tolist() if 0.0 < time < step.duration}
        at_once = len(cards) == 1 and paths and not np.ptp(paths[0][:, 1])
        if any(np.interp(0.0, *path.T) for path in paths) and not at_once:
            times.add(0.0)
        if times and len(paths) < len(cards):
            raise step.card.unread("with friction, and amplitudes that bend beside loads without,")
        if number > 1 and any(card.keyword == "CONTACT PAIR" for card in step.cards):
            raise step.card.unread("with friction, and a contact pair of its own,")
        result += [(number, time) for time in sorted({*times, step.duration})]
    return result


def _acts(card: Card) -> bool:
    """Whether a card has loads, or supports that move."""
    if card.keyword != "BOUNDARY":
        return True
    return any(len(row) > 3 and card.number(line, row[3] or "0") for line, row in card.rows())


def _materials(model: ModelLines, blocks: Blocks, step: Step) -> tuple[Material, ...]:
    """Material of each block; that of static steps may lack a density, which no answer needs."""
    without = [stated for stated in model.materials.values() if "DENSITY" not in stated.parts]
    if without and step.explicit:
        raise without[0].card.wrong("no *Density beside an explicit step", "one")
    if without:
        model.note("material: no density is stated, and the static answer depends on none")
    return tuple(_material(model, one.part) for one in blocks.instances)


def _material(model: ModelLines, part: DeckPart) -> Material:
    """Material of the sections of all elements of a part."""
    cards = [part.section_of.get(label) for label in part.element_index]
    names = {"none" if card is None else card.parameter("MATERIAL") for card in cards}
    if cards[0] is None or len(names) > 1:
        raise DeckError(
            f"{part.kind_at}: *Element: got elements of the materials {', '.join(sorted(names))} "
            "that are connected; expected a *Solid Section of one for all"
        )
    return material_of(model.of("MATERIAL", names.pop(), cards[0]))


def _element(blocks: Blocks, model: ModelLines, step: Step) -> tuple[int, ElementType]:
    """Degree and hexahedron of the elements of a deck."""
    kinds = {one.part.kind: one.part.kind_at for one in blocks.instances}
    kind, nodes = next(iter(kinds)), VOLUMES[next(iter(kinds))]
    if len(kinds) > 1:
        raise DeckError(
            f"{list(kinds.values())[1]}: got elements of the types "
            f"{', '.join(sorted(kinds))}; expected one type"
        )
    if nodes > 10 and step.explicit:
        raise step.procedure.unread(f"with elements of {nodes} nodes")
    if nodes in {4, 10}:
        few = sum(len(one.part.volumes) for one in blocks.instances) <= _TETRAHEDRA
        degree = 2 if nodes == 10 and few and not step.explicit else 1
        how = "of degree 2" if degree == 2 else "with incompatible modes, stiffer in bending"
        model.note(f"elements: each {kind} is split into four hexahedra {how}")
        return degree, ElementType.INCOMPATIBLE
    if kind == "C3D20R":
        model.note(
            "elements: C3D20R are integrated fully, stiffer where curved or thin ones bend, by "
            "13 % in MacNeal's curved beam"
        )
    if kind == "C3D8" and model.dialect is Dialect.ABAQUS:
        return 1, ElementType.B_BAR
    return 2 if nodes > 8 else 1, KINDS.get(kind, ElementType.INCOMPATIBLE)


def _facet_size(assembly: Assembly) -> float:
    """Mean edge of the facets in contact [mm]."""
    areas = [s.surface(face).areas for s in assembly.shapes for face in s.contact_faces]
    return float(np.sqrt(np.concatenate(areas).mean()))
