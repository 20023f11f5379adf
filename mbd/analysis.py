"""Algorithm 1 of the paper: is it locked, does it carry the load, with which pressures."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np

from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.loads import LoadCase
from geometry.machine.system import one_thread_of_blas
from geometry.machine.work import budget, clock, require_memory
from geometry.parts.placed import AnyBlocks, PlacedBlocks
from geometry.parts.rows import Notes, Part, Row
from mbd.contacts.jacobian import contact_jacobian
from mbd.frictionless.mechanism import (
    MANY_BLOCKS,
    classify,
)
from mbd.options import Rigid
from mbd.results.result import RigidResult
from mbd.results.verdict import EdgesAndCorners
from mbd.system import RigidStatement, RigidSystem, Stated

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
    if method.collapse or method.sliding or stated.coulomb is not None:
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


def _result(problem: RigidStatement, method: Rigid, tell: Callable[[str], None]) -> RigidResult:
    whole, case, weight = problem.rigid_blocks, problem.rigid_load, problem.rigid_weight
    if not whole.interfaces.n_contacts:
        raise AnalysisError(
            "analyse: no two of the blocks touch, and rigid blocks have forces in their joints "
            "alone; expected blocks that meet, or solve_static for single bodies"
        )
    held = tuple(support for support in case.held if not support.is_push)
    stated = Stated(whole, replace(case, held=held), weight, problem.coulomb)
    faces = whole
    if not isinstance(whole, Assembly):
        faces = cast("PolyhedralAssembly", whole).bearing()
    system = RigidSystem(stated.on(faces), method, tell)
    result = _judged(system)
    start = time.process_time()
    parts = dict(result.parts)
    smooth, locked = result.equilibrium, result.supported_classification.locked
    if system.coulomb is None and smooth.holds and not locked:
        from mbd.limits.pushes import Pushes

        parts = {"pushes": Pushes(system), **parts}
    if len(held) < len(case.held):
        pushed = Stated(whole, case, weight, problem.coulomb).on(faces)
        parts["push_limit"] = _push(RigidSystem(pushed, method))
    if faces is not whole:
        tell("what edges and corners would add")
        parts["edges_and_corners"] = _edges(stated, result, method)
        index = np.flatnonzero(cast("PolyhedralAssembly", whole).interfaces.bears)
        result = replace(result, blocks=whole, contact_index=index[result.contact_index])
    if problem.interference:
        words = (
            f"{problem.interference:g} mm: not counted by rigid blocks; `tubelock fem` computes "
            "its forces"
        )
        parts["interference"] = Notes([Row("interference fit", words, group="verdict")])
    if result.moving is not None:
        from mbd.results.motion import motion_of_blocks, placed_motion

        motion = placed_motion(whole, result.moving, ~result.load.fixed)
        proved = result.verdict.holds is False
        parts["motion"] = motion_of_blocks(whole, motion, weight, proved=proved)
    return replace(result, parts=parts, cpu_seconds=_later(result, start))


def _later(result: RigidResult, start: float) -> dict[str, float]:
    """Times of a result with what is found beside it since a CPU time."""
    spent = time.process_time() - start
    seconds = result.cpu_seconds
    return seconds | {stage: seconds.get(stage, 0.0) + spent for stage in (BESIDE, "total")}


def _judged(system: RigidSystem) -> RigidResult:
    """Analyse blocks that touch at some of the contacts of a statement."""
    system.tell(f"{int((~system.load.fixed).sum())} free blocks: equilibrium and mechanisms")
    result = frictionless_result(system)
    start = time.process_time()
    parts: dict[str, Part] = {}
    if system.coulomb is not None or system.method.asks_more:
        from mbd.results.parts import parts_of

        parts = parts_of(system)
    return replace(result, parts=parts, cpu_seconds=_later(result, start))


def _edges(stated: Stated, faces: RigidResult, method: Rigid) -> EdgesAndCorners:
    """Judge the same blocks on all contacts, edges and corners included."""
    whole = cast("PolyhedralAssembly", stated.rigid_blocks)
    without = int((~whole.interfaces.bears).sum())
    both = faces
    # What no motion leaves cannot move with more contacts either.
    if not (faces.classification.locked and faces.supported_classification.locked):
        asked = replace(method, sliding=False, ranges=False, margin=False)
        both = _judged(RigidSystem(stated, asked))
    factors = None
    if method.collapse:
        factors = _factor(faces), _factor(both)
    return EdgesAndCorners(without, faces.verdict, both.verdict, factors, both.classification)


def _factor(result: RigidResult) -> float:
    return cast("CollapseLoad", result.parts["collapse"]).factor


def _push(system: RigidSystem) -> Push:
    """Limit of the support that pushes a block."""
    from mbd.limits.pushes import Push, push_limit

    friction = 0.0 if system.coulomb is None else system.coulomb.coefficient
    try:
        return Push(friction, push_limit(system))
    except RefusedError as error:
        return Push(friction, f"none: {error}")


def frictionless_result(system: RigidSystem) -> RigidResult:
    """Classify an assembly and solve for its contact forces (Algorithm 1)."""
    seconds: dict[str, float] = {}
    clock = time.process_time()

    def lap(stage: str) -> None:
        nonlocal clock
        now = time.process_time()
        seconds[stage] = now - clock
        clock = now

    assembly, load = system.blocks, system.load
    _ = assembly.interfaces  # found once and kept: timed as a stage of its own
    lap("interfaces")
    contacts, force = system.contacts, system.force
    lap("jacobian")
    balance = system.frictionless
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
        norm=system.method.norm,
        cpu_seconds=seconds,
        blocks=assembly,
        load=load,
    )
