"""Algorithm 1 of the paper: is it locked, does it carry the load, with which pressures."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.loads import LoadCase
from geometry.machine.system import one_thread_of_blas
from geometry.machine.work import budget, clock, require_memory
from geometry.mesh import FloatArray
from geometry.parts.pairs import OfPairs
from geometry.parts.placed import AnyBlocks, PlacedBlocks
from geometry.parts.rows import Notes, Part, Row
from mbd.contacts.jacobian import RigidContacts, contact_jacobian
from mbd.frictionless.equilibrium import Equilibrium, column_weights, equilibrium
from mbd.frictionless.mechanism import (
    MANY_BLOCKS,
    classify,
)
from mbd.options import Norm, Rigid, Solver
from mbd.results.result import RigidResult
from mbd.results.verdict import EdgesAndCorners

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly
    from mbd.friction.equilibrium import CollapseLoad
    from mbd.limits.pushes import Push


#: Memory of a contact of a tube with its loads, as measured: without friction …
_CONTACT_BYTES = 550.0
#: … with linear programs …
_PROGRAM_BYTES = 2200.0
#: … and with cone programs.
_CONE_BYTES = 7600.0
#: Stage of all that is found beside the equilibrium without friction.
BESIDE = "friction and limits"


class JointFriction(Protocol):
    """Friction of all joints, such as `fem.CoulombFriction`."""

    @property
    def coefficient(self) -> float:
        """Coefficient μ [-]."""

    @property
    def of_pairs(self) -> OfPairs:
        """That of some pairs of blocks."""


class RigidStatement(Protocol):
    """A statement of a problem, such as `fem.Problem`, as far as rigid blocks read it."""

    @property
    def rigid_blocks(self) -> AnyBlocks:
        """The assembly of blocks, on the contacts of rigid ones."""

    @property
    def rigid_load(self) -> LoadCase:
        """Loads and supports without the weight."""

    @property
    def rigid_weight(self) -> FloatArray | None:
        """Weight of each block about its mass centroid, (n_blocks, 6) [N, N mm]; None: none."""

    @property
    def coulomb(self) -> JointFriction | None:
        """Friction; None: frictionless."""

    @property
    def interference(self) -> float:
        """By which joints are squeezed before any load acts [mm]."""

    @property
    def compressive_strength(self) -> float | None:
        """Of all blocks [MPa]; None: not stated."""


@dataclass(frozen=True)
class Stated:
    """Blocks and a load without more: a `RigidStatement`."""

    rigid_blocks: AnyBlocks
    rigid_load: LoadCase
    rigid_weight: FloatArray | None = None
    coulomb: JointFriction | None = None
    interference: float = 0.0
    compressive_strength: float | None = None

    @property
    def blocks(self) -> AnyBlocks:
        """The assembly."""
        return self.rigid_blocks


class AnalysisError(RefusedError):
    """An argument of the wrong type; the message names it and what is expected."""


def as_statement(problem: object, load: object) -> RigidStatement:
    """Return what is to be analysed; what is no statement and no blocks with a load is rejected."""
    blocks = isinstance(problem, PlacedBlocks)
    stated = isinstance(problem, Stated) or hasattr(type(problem), "rigid_load")
    if load is None and (blocks or not stated):
        got = "blocks without a load case" if blocks else f"a {type(problem).__name__}"
        raise AnalysisError(
            f"analyse: got {got}; expected a Problem, or blocks and a load case: "
            "analyse(blocks, load=pipe(0.01).on(blocks))"
        )
    if load is None:
        return cast("RigidStatement", problem)
    if not (blocks and isinstance(load, LoadCase)):
        raise AnalysisError(
            f"analyse: got a {type(problem).__name__} and a {type(load).__name__}; expected "
            "blocks and a load case: analyse(blocks, load=pipe(0.01).on(blocks))"
        )
    return Stated(cast("AnyBlocks", problem), load)


@one_thread_of_blas()
def rigid_result(stated: RigidStatement, method: Rigid, tell: Callable[[str], None]) -> RigidResult:
    """Classify rigid blocks, solve for their contact forces, and find what a method asks beside.

    ``tell`` is called with what is being found; errors are those of `mbd.analyse`.
    """
    with budget(method.max_work, clock(method.max_seconds), method.max_memory) as spent:
        _require_memory(stated, method)
        result = _result(stated, method, tell)
    return replace(result, parts={**result.parts, "work": spent})


def _require_memory(stated: RigidStatement, method: Rigid) -> None:
    """Reject what takes more memory than allowed, before contacts of hexahedra are looked for."""
    blocks, each = stated.rigid_blocks, _CONTACT_BYTES
    if method.ranges or method.margin:
        each = _PROGRAM_BYTES
    if method.collapse or method.sliding or rubbing(stated.coulomb) is not None:
        each = _CONE_BYTES
    if isinstance(blocks, Assembly):
        n = int(blocks.eligible_facets().sum()) // 2
    else:
        n = blocks.interfaces.n_contacts
    require_memory(
        f"{n} contact points of rigid blocks",
        each * n,
        "a coarser mesh, fewer blocks or a higher limit",
    )


def _result(stated: RigidStatement, method: Rigid, tell: Callable[[str], None]) -> RigidResult:
    whole, live_case, weight = stated.rigid_blocks, stated.rigid_load, stated.rigid_weight
    pushed = live_case
    if any(support.is_push for support in live_case.held):
        held = tuple(support for support in live_case.held if not support.is_push)
        live_case = replace(live_case, held=held)
    if not whole.interfaces.n_contacts:
        raise AnalysisError(
            "analyse: no two of the blocks touch, and rigid blocks have forces in their joints "
            "alone; expected blocks that meet, or solve_static for single bodies"
        )
    coulomb = rubbing(stated.coulomb)
    interference = stated.interference
    stated = Stated(whole, live_case, weight, coulomb)
    faces = whole
    if not isinstance(whole, Assembly):
        faces = cast("PolyhedralAssembly", whole).bearing()
    result = _judged(stated, faces, method, tell)
    start = time.process_time()
    parts, verdict, balance = dict(result.parts), result.verdict, result.equilibrium
    if coulomb is None and balance.holds and not result.supported_classification.locked:
        from mbd.limits.pushes import Pushes

        dead, live = np.any(weight if weight is not None else 0.0), np.any(live_case.wrenches)
        alone = bool(dead) and not live
        parts = {"pushes": Pushes(faces, result.load, result.norm, balance, alone), **parts}
    if pushed is not live_case:
        parts["push_limit"] = _push(faces, pushed.with_wrenches(weight), coulomb)
    if faces is not whole:
        tell("what edges and corners would add")
        parts["edges_and_corners"] = _edges(stated, result, method)
        index = np.flatnonzero(cast("PolyhedralAssembly", whole).interfaces.bears)
        result = replace(result, blocks=whole, contact_index=index[result.contact_index])
    if interference:
        words = (
            f"{interference:g} mm: not counted by rigid blocks; `tubelock fem` computes its forces"
        )
        parts["interference"] = Notes([Row("interference fit", words, group="verdict")])
    moving = result.moving
    if moving is not None:
        from mbd.results.motion import motion_of_blocks, placed_motion

        motion = placed_motion(whole, moving, ~result.load.fixed)
        proved = verdict.holds is False
        parts["motion"] = motion_of_blocks(whole, motion, weight, proved=proved)
    spent = time.process_time() - start
    seconds = dict(result.cpu_seconds)
    for stage in (BESIDE, "total"):
        seconds[stage] += spent
    return replace(result, parts=parts, cpu_seconds=seconds)


def rubbing(coulomb: JointFriction | None) -> JointFriction | None:
    """Friction of a statement; none where all its coefficients are zero."""
    if coulomb is None or coulomb.coefficient or any(pair[2] for pair in coulomb.of_pairs):
        return coulomb
    return None


def _judged(
    stated: RigidStatement, blocks: AnyBlocks, method: Rigid, tell: Callable[[str], None]
) -> RigidResult:
    """Analyse blocks that touch at some of the contacts of a statement."""
    dead = stated.rigid_weight
    load = stated.rigid_load.with_wrenches(dead)
    load = load if blocks is load.assembly else replace(load, assembly=blocks)
    tell(f"{int((~load.fixed).sum())} free blocks: equilibrium and mechanisms")
    result = frictionless_result(blocks, load, method.norm, method.solver)
    start, coulomb = time.process_time(), stated.coulomb
    parts: dict[str, Part] = {}
    if coulomb is not None or method.asks_more:
        from mbd.results.parts import Question, parts_of

        nothing = np.zeros((blocks.n_blocks, 6))
        asked = Question(
            blocks=blocks,
            load=load,
            wrenches=(nothing if dead is None else dead, stated.rigid_load.wrenches),
            method=method,
            friction=None if coulomb is None else coulomb.coefficient,
            of_pairs=() if coulomb is None else coulomb.of_pairs,
            smooth=result.equilibrium,
            frictionless=result.classification,
            tell=tell,
        )
        parts = parts_of(asked)
    spent = time.process_time() - start
    seconds = result.cpu_seconds | {BESIDE: spent}
    seconds["total"] += spent
    return replace(result, parts=parts, cpu_seconds=seconds)


def _edges(stated: RigidStatement, faces: RigidResult, method: Rigid) -> EdgesAndCorners:
    """Judge the same blocks on all contacts, edges and corners included."""
    whole = cast("PolyhedralAssembly", stated.rigid_blocks)
    without = int((~whole.interfaces.bears).sum())
    both = faces
    # What no motion leaves cannot move with more contacts either.
    if not (faces.classification.locked and faces.supported_classification.locked):
        asked = replace(method, sliding=False, ranges=False, margin=False)
        both = _judged(stated, whole, asked, lambda _: None)
    factors = None
    if method.collapse:
        factors = _factor(faces), _factor(both)
    return EdgesAndCorners(without, faces.verdict, both.verdict, factors, both.classification)


def _factor(result: RigidResult) -> float:
    return cast("CollapseLoad", result.parts["collapse"]).factor


def _push(faces: AnyBlocks, load: LoadCase, coulomb: JointFriction | None) -> Push:
    """Limit of the support that pushes a block."""
    from mbd.limits.pushes import Push, push_limit

    friction, of_pairs = (0.0, ()) if coulomb is None else (coulomb.coefficient, coulomb.of_pairs)
    try:
        return Push(friction, push_limit(faces, replace(load, assembly=faces), friction, of_pairs))
    except RefusedError as error:
        return Push(friction, f"none: {error}")


def _settled(
    found: Equilibrium,
    blocks: AnyBlocks,
    contacts: RigidContacts,
    load: FloatArray,
    weights: FloatArray,
) -> Equilibrium:
    """Decide by a growing load where neither forces nor a mechanism are proved."""
    from mbd.friction.equilibrium import frictional_contacts
    from mbd.friction.loading import settled

    smooth = frictional_contacts(blocks, contacts, 0.0)
    rests = settled(found.with_tangents, smooth, load, weights)
    return replace(rests, forces=rests.forces[:, 0])


def frictionless_result(
    assembly: AnyBlocks, load: LoadCase, norm: Norm, solver: Solver
) -> RigidResult:
    """Classify an assembly and solve for its contact forces (Algorithm 1)."""
    seconds: dict[str, float] = {}
    clock = time.process_time()

    def lap(stage: str) -> None:
        nonlocal clock
        now = time.process_time()
        seconds[stage] = now - clock
        clock = now

    _ = assembly.interfaces  # found once and kept: timed as a stage of its own
    lap("interfaces")
    contacts = contact_jacobian(assembly, load.fixed, load.held)
    force = contacts.rows(load.wrenches)
    lap("jacobian")
    weights = column_weights(norm, contacts.areas)
    balance = equilibrium(contacts.jacobian, force, solver=solver, weights=weights)
    if not balance.decided:
        balance = _settled(balance, assembly, contacts, force, weights)
    lap("equilibrium")
    many = len(contacts.free_blocks) > MANY_BLOCKS
    supported = framed = classify(contacts.jacobian, force, balance if many else None)
    if (load.fixed != assembly.fixed).any():
        held = contact_jacobian(assembly, supports=load.held)
        framed = classify(held.jacobian, held.rows(load.wrenches))
    lap("mechanism")
    seconds["total"] = sum(seconds.values())
    return RigidResult(
        classification=framed,
        supported_classification=supported,
        equilibrium=balance,
        contact_index=contacts.index,
        norm=norm,
        cpu_seconds=seconds,
        blocks=assembly,
        load=load,
    )
