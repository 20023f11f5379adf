"""What a scene may ask of the rigid answer beyond the paper: friction, collapse load, margin."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from geometry.assembly import AnyBlocks, Assembly
from geometry.loads import LoadCase
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.pairs import OfPairs, pair_values
from mbd import contact_jacobian
from mbd.contact_jacobian import Contacts
from mbd.equilibrium import column_weights, equilibrium
from mbd.force_range import ForceRanges, PlaneProblem, force_ranges, plane_problem
from mbd.friction import (
    CollapseLoad,
    FrictionalContacts,
    FrictionalEquilibrium,
    FrictionError,
    collapse_load,
    frictional_contacts,
    frictional_equilibrium,
)
from mbd.margin import Margin, interlocking_margin
from mbd.sliding_collapse import SlidingCollapse, sliding_collapse
from mbd.squeeze import Squeeze, squeeze
from validation.errors import named
from validation.run.rigid.sliding_state import SlidingState, sliding_state
from validation.run.stages import tell
from validation.scene.sections import RigidSection

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly


@dataclass(frozen=True)
class Further:
    """Answers that were asked for; the others are None."""

    friction: FrictionalEquilibrium | None
    collapse: CollapseLoad | None
    margin: Margin | None
    free_blocks: IntArray
    """Block number of each position among the free blocks."""
    cpu_seconds: float
    sliding: SlidingCollapse | None = None
    ranges: ForceRanges | None = None
    friction_forces: FloatArray | None = None
    """Forces on block s that carry the load with friction, at all contacts of free blocks; None
    where none do; (n_contacts, 3)."""
    squeeze: Squeeze | None = None
    """Whether friction that carries the load is pressed by it."""
    sliding_state: SlidingState | None = None
    """Forces and motion of `sliding`, for a check by another program."""
    interference: float = 0.0
    """By which the scene prescribes that joints are squeezed [mm]; 0: it does not."""
    counted: BoolArray | None = None
    """Contacts of free blocks at which friction counts, (n_contacts,); None: all."""
    bare: WithEdges | None = None
    """What edges and corners would add; None where every contact bears, or without friction."""

    @property
    def held_by_squeeze(self) -> bool:
        """Whether friction carries the load only where joints are pressed beforehand."""
        return self.squeeze is not None and self.squeeze.needed is True

    def friction_words(self, named: Callable[[int], str], given: str) -> str:
        """Whether the load is carried with the friction ``given``, blocks by their names."""
        assert self.friction is not None
        if self.squeeze is not None:
            words = self.squeeze.words(named)
        else:
            words = "not carried" if self.friction.mechanism is not None else "not decided"
        words += f"{',' if ':' in words else ''} with friction {given}"
        if not (self.held_by_squeeze and self.interference):
            return words
        return (
            f"{words}. The scene presses them: contact.clearance = {-self.interference:g} mm; "
            "`tubelock fem` computes the forces of deformable blocks"
        )


@dataclass(frozen=True)
class WithEdges:
    """The same questions where edges and corners count that meet edges and corners."""

    n_contacts: int
    """Contacts that were left out."""
    holds: bool | None
    """Whether the load could be carried with them; None: not certain."""
    factor: float | None
    """Load factor at collapse with them; None where it is not asked, or nothing is carried."""


def further_answers(
    assembly: AnyBlocks,
    load: LoadCase,
    wrenches: tuple[FloatArray, FloatArray],
    section: RigidSection,
    of_pairs: OfPairs = (),
    *,
    frictionless: bool = False,
) -> Further | None:
    """Compute what ``[rigid]`` asks for; None where it asks for nothing more.

    The load case says what is held; wrenches are dead and live load of each block, (n_blocks, 6)
    each [N, N mm]. Some pairs of blocks have their own friction. ``frictionless`` says that the
    load is carried without friction: forces that balance it are admissible whatever the limits of
    friction, so no joint needs a squeeze beforehand.
    """
    requested = (section.collapse, section.sliding, section.ranges, section.margin)
    if section.friction is None and not any(requested):
        return None
    start = time.process_time()
    whole, rubbing, counted = assembly, section.friction is not None, None
    if rubbing and not isinstance(assembly, Assembly):
        # Friction counts where contacts have an area, or lie in the interior of a face.
        bodies = cast("PolyhedralAssembly", assembly)
        assembly = bodies.bearing()
        if assembly is not whole:
            counted, frictionless = _counted(bodies, load), False
    contacts = contact_jacobian(assembly, load.fixed, load.held)
    dead, live = (_generalized(contacts, wrench) for wrench in wrenches)
    friction = collapse = sliding = margin = forces = state = pressed = bare = None
    weights = column_weights(section.norm, contacts.areas)
    with named("rigid"):
        frictional = _frictional(assembly, contacts, section, of_pairs)
        if rubbing:
            tell("equilibrium with friction")
            friction = frictional_equilibrium(frictional, dead + live, weights=weights)
            if friction.holds:
                normals = assembly.interfaces.normals[contacts.index]
                forces = frictional.world(friction.forces, normals)
                if counted is not None:
                    given, forces = forces, np.zeros((len(counted), 3))
                    forces[counted] = given
                pressed = Squeeze(needed=False, programs=0)
                if not frictionless:
                    tell("whether the load presses the joints that need friction")
                    pressed = squeeze(
                        contacts,
                        frictional,
                        dead + live,
                        friction.forces,
                        weights=weights,
                        progress=_telling("whether the load presses the joints"),
                    )
        if section.collapse:
            tell("load factor at collapse")
            collapse = collapse_load(frictional, dead, live)
        if section.sliding:
            tell("collapse by sliding without dilation")
            sliding, state = _sliding(assembly, contacts, frictional, (dead, live), wrenches)
        if counted is not None and not counted.all():
            tell("what edges and corners would add")
            bare = _with_edges(bodies, load, wrenches, section, of_pairs)
    if section.margin:
        every = contact_jacobian(whole, load.fixed, load.held)
        margin = interlocking_margin(
            every.jacobian, every.areas, progress=_telling("unit loads of the margin")
        )
    with_friction = None if friction is None else (frictional, friction)
    # Without a limit the answer rests on friction that jams: how far forces are unknown decides.
    jams = collapse is not None and bool(np.isinf(collapse.factor))
    ranges = None
    if (section.ranges or jams) and (friction is None or friction.holds):
        ranges = _ranges(assembly, contacts, with_friction, dead + live, section)
    return Further(
        friction=friction,
        collapse=collapse,
        margin=margin,
        free_blocks=contacts.free_blocks,
        cpu_seconds=time.process_time() - start,
        sliding=sliding,
        ranges=ranges,
        friction_forces=forces,
        squeeze=pressed,
        sliding_state=state,
        counted=counted,
        bare=bare,
    )


def _frictional(
    assembly: AnyBlocks, contacts: Contacts, section: RigidSection, of_pairs: OfPairs
) -> FrictionalContacts:
    """Contacts with the friction of the scene, 0 where it has none."""
    given = pair_values(section.friction or 0.0, of_pairs, contacts.block_m, contacts.block_s)
    return frictional_contacts(assembly, contacts, given, section.friction_law)


def _counted(whole: PolyhedralAssembly, load: LoadCase) -> BoolArray:
    """Which contacts of free blocks bear, (n,)."""
    found = whole.interfaces
    return found.bears[~(load.fixed[found.block_m] & load.fixed[found.block_s])]


def _with_edges(
    whole: PolyhedralAssembly,
    load: LoadCase,
    wrenches: tuple[FloatArray, FloatArray],
    section: RigidSection,
    of_pairs: OfPairs,
) -> WithEdges:
    """Whether friction would carry the load, and up to which factor, if all contacts counted."""
    contacts = contact_jacobian(whole, load.fixed, load.held)
    dead, live = (_generalized(contacts, wrench) for wrench in wrenches)
    frictional = _frictional(whole, contacts, section, of_pairs)
    answer = frictional_equilibrium(frictional, dead + live)
    holds = True if answer.holds else None if answer.mechanism is None else False
    factor = collapse_load(frictional, dead, live).factor if section.collapse else None
    left_out = int((~whole.interfaces.bears[contacts.index]).sum())
    return WithEdges(left_out, holds, factor)


def _sliding(
    assembly: AnyBlocks,
    contacts: Contacts,
    frictional: FrictionalContacts,
    loads: tuple[FloatArray, FloatArray],
    wrenches: tuple[FloatArray, FloatArray],
) -> tuple[SlidingCollapse, SlidingState | None]:
    """Collapse by sliding without dilation, in the plane where the problem is plane."""
    plane, progress = _plane(assembly, contacts, frictional, loads), _telling("sliding collapse")
    if plane is None:
        result = sliding_collapse(frictional, *loads, progress=progress)
    else:
        flat = [plane.load(load) for load in loads]
        result = sliding_collapse(plane.contacts, *flat, progress=progress)
        if result.mechanism is not None:
            rows = np.zeros(len(loads[0]))
            rows[plane.rows] = result.mechanism
            result = replace(result, mechanism=rows)
    state = sliding_state(
        assembly, contacts, result, frictional=frictional, plane=plane, wrenches=wrenches
    )
    return result, state


def _plane(
    assembly: AnyBlocks,
    contacts: Contacts,
    frictional: FrictionalContacts,
    loads: tuple[FloatArray, ...],
) -> PlaneProblem | None:
    """Return the problem in the plane in which blocks and loads lie; None where there is none."""
    for axis in range(3):
        try:
            plane = plane_problem(assembly, contacts, frictional, axis)
            for load in loads:
                plane.load(load)
        except FrictionError:
            continue
        return plane
    return None


def _ranges(
    assembly: AnyBlocks,
    contacts: Contacts,
    friction: tuple[FrictionalContacts, FrictionalEquilibrium] | None,
    load: FloatArray,
    section: RigidSection,
) -> ForceRanges | None:
    """Ranges of the joints' forces, where forces balance the load."""
    if friction is not None:
        frictional, carried_by = friction
        plane = _plane(assembly, contacts, frictional, (load,))
        shown = carried_by.forces[:, 0]
        return force_ranges(
            contacts, load, shown, frictional=frictional, plane=plane, progress=_tell_joints
        )
    weights = column_weights(section.norm, contacts.areas)
    smallest = equilibrium(contacts.jacobian, load, solver=section.solver, weights=weights)
    if not smallest.holds:
        return None
    return force_ranges(contacts, load, smallest.forces, progress=_tell_joints)


def _telling(what: str) -> Callable[[int], None]:
    return lambda programs: tell(f"{what}: {programs} programs solved")


def _tell_joints(done: int, joints: int) -> None:
    tell(f"range of the forces of joints: {done} of {joints}")


def _generalized(contacts: Contacts, wrench: FloatArray) -> FloatArray:
    scaled = wrench[contacts.free_blocks]
    scaled[:, 3:] /= contacts.length
    return contacts.jacobian.admissible(scaled.ravel())


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _rows(motion: FloatArray | None) -> list[list[float]] | None:
    """Motion of each block, where there is one."""
    return None if motion is None else motion.reshape(-1, 6).tolist()


def further_json(further: Further | None) -> dict[str, Any]:
    """Answers as plain data, with the keys of what was asked for."""
    data: dict[str, Any] = {}
    if further is None:
        return data
    if further.friction is not None:
        f = further.friction
        data["friction"] = {
            "holds": f.holds,
            "residual": f.residual,
            "largest_normal_force": float(f.forces[:, 0].max(initial=0.0)) if f.holds else None,
            "mechanism": _rows(f.mechanism),
            "work": f.work,
            "smallest_contact_work": f.smallest_contact_work,
            "status": f.status,
        }
    if further.squeeze is not None:
        data["friction"]["squeeze"] = _squeeze_json(further.squeeze)
    if further.bare is not None:
        factor = further.bare.factor
        data["with_edges_and_corners"] = {
            "n_contacts": further.bare.n_contacts,
            "holds": further.bare.holds,
            "collapse_factor": None if factor is None else _finite(factor),
        }
    if further.collapse is not None:
        c = further.collapse
        data["collapse"] = {
            "factor": _finite(c.factor),
            "upper_bound": _finite(c.upper_bound),
            "never": bool(np.isinf(c.factor)),
            "certified": c.certified,
            "residual": c.residual,
            "smallest_contact_work": c.smallest_contact_work,
            "mechanism": _rows(c.mechanism),
            "status": c.status,
        }
    if further.sliding is not None:
        data["sliding"] = _sliding_json(further.sliding)
        if further.sliding_state is not None:
            data["sliding"] |= further.sliding_state.as_json()
    if further.ranges is not None:
        data["ranges"] = _ranges_json(further.ranges)
    if further.margin is not None:
        m = further.margin
        data["margin"] = {
            "interlocked": m.interlocked,
            "bearing_area": m.bearing_area,
            "unasked": m.unasked,
            "block": int(further.free_blocks[m.block]),
            "load": m.load,
        }
    return data


def _squeeze_json(found: Squeeze) -> dict[str, Any]:
    blocks = None if found.blocks is None else list(found.blocks)
    least = found.least if found.needed else None
    return {"needed": found.needed, "blocks": blocks, "least": least, "programs": found.programs}


def _sliding_json(found: SlidingCollapse) -> dict[str, Any]:
    check = None if found.check is None else asdict(found.check)
    return {
        "factor": _finite(found.factor),
        "associated_factor": _finite(found.associated),
        "certified": found.certified,
        "check": check,
        "mechanism": _rows(found.mechanism),
        "status": found.status,
    }


def _ranges_json(ranges: ForceRanges) -> dict[str, Any]:
    joints = [
        {
            "blocks": [int(ranges.block_m[k]), int(ranges.block_s[k])],
            "least": _finite(float(ranges.least[k])),
            "least_norm": float(ranges.shown[k]),
            "largest": _finite(float(ranges.largest[k])),
            "unbounded": bool(ranges.unbounded[k]),
        }
        for k in range(len(ranges.least))
    ]
    return {
        "joints": joints,
        "undetermined": int(ranges.undetermined.sum()),
        "unanswered": ranges.unanswered,
        "unbounded": int(ranges.unbounded.sum()),
    }
