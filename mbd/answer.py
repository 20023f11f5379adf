"""The rigid answer in the type that all solvers share, found by Algorithm 1 of the paper."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import cache
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from geometry.answer import (
    Answer,
    Array,
    Lazy,
    Measure,
    interface_contacts,
    known,
    largest_facet_mean,
    place,
)
from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.loads import LoadCase
from geometry.machine.system import one_thread_of_blas
from geometry.machine.work import Stopwatch, budget, clock, require_memory, timed_stages
from geometry.mesh import FloatArray, IntArray
from geometry.parts.dimensions import Built, dimensions
from geometry.parts.measures import (
    JointResultants,
    Measures,
    Planes,
    SectionError,
    SectionForces,
    first_largest,
    sections_through_joints,
)
from geometry.parts.placed import AnyBlocks, PlacedBlocks
from geometry.parts.regions import HeldFace
from geometry.parts.rows import Notes, Part, Row, plain
from geometry.polyhedra.options import CROSSING_EDGES, STANDING_CORNER
from mbd.contacts.supports import check_supports
from mbd.options import Rigid, Stages
from mbd.results.rows import rigid_rows
from mbd.system import RigidStatement, RigidSystem, Stated, silent

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly
    from mbd.building.stages import StageResults
    from mbd.limits.collapse import CollapseLoad
    from mbd.results.rows import DrivenMotion

#: Memory of a contact of a tube with its loads, as measured: without friction …
_CONTACT_BYTES = 550.0
#: … with linear programs …
_PROGRAM_BYTES = 2200.0
#: … and with cone programs.
_CONE_BYTES = 7600.0
#: Stage of all that is found beside the equilibrium without friction.
_BESIDE = "friction and limits"
#: Forces of joints below this part of the largest are zero to round-off.
_ROUND_OFF = 1e-9
#: Units of numbers in the report.
REPORT_UNITS = {
    "length": "mm",
    "force": "N",
    "moment": "N mm",
    "pressure": "MPa",
    "rotation": "rad",
    "mechanism": "rows of the free blocks: displacement (3), rotation in rad times rotation_length "
    "in mm (3), to any scale",
}


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


def analyse(
    problem: AnyBlocks | RigidStatement,
    method: Rigid | None = None,
    *,
    load: LoadCase | None = None,
    progress: Callable[[str], None] | None = None,
) -> Answer:
    """Classify rigid blocks and solve for their contact forces (Algorithm 1), with friction or not.

    Parameters
    ----------
    problem
        A whole statement such as `fem.Problem`; or blocks, with a ``load``. The class and the
        paper's measures are frictionless; friction of the problem adds its verdict and its forces.
    method
        What the contact forces minimise, and what is found beside: load factors, ranges, margin.
        None: `Rigid()`.
    load
        Tractions and supports of blocks that come without.
    progress
        Called with a line on what is being found.

    Returns
    -------
    Answer
        Its title says whether the load is carried, or that the blocks are locked; `details` is the
        `RigidSystem`, `parts` what was found beside. Nothing is called equilibrium above a relative
        residual of 1e-6. Where the load is not carried there are no measures and no pressures, for
        nothing balances it; the field ``mechanism`` is then the first-order motion,
        largest 1 [-].

    Raises
    ------
    AnalysisError
        Blocks of which no two touch, or arguments of another type.
    RefusedError
        What rigid blocks do not have, such as gaps and supports that move.
    """
    if method is not None and not isinstance(method, Rigid):
        raise AnalysisError(
            f"analyse: got a {type(method).__name__}; expected a method Rigid(...), and a load "
            "case as load="
        )
    stated, method = as_statement(problem, load), method or Rigid()
    tell = progress or silent
    with timed_stages() as watch:
        check(stated, method)
        watch.lap("interfaces")
        parts = _construction(stated, method, tell)
        watch.lap("parts")
        with (
            one_thread_of_blas(),
            budget(method.max_work, clock(method.max_seconds), method.max_memory) as spent,
        ):
            case = stated.rigid_load
            taken = Stated(
                stated.rigid_blocks,
                replace(case, held=_held(case)),
                stated.rigid_weight,
                stated.coulomb,
                stated.interference,
            )
            system = RigidSystem(taken, method, tell)
            parts |= _found(system, case, watch)
    parts["work"] = spent
    return _answer(stated, system, parts, watch.seconds())


def check(problem: RigidStatement, method: Rigid) -> None:
    """Reject what rigid blocks cannot answer, before any force is sought; errors as `analyse`."""
    blocks, case = problem.rigid_blocks, problem.rigid_load
    check_supports(_held(case))
    _ = problem.compressive_strength  # materials of different strengths have none
    grows = method.collapse or method.sliding
    if problem.coulomb is not None or grows:
        from mbd.contacts.friction import check_coefficients
        from mbd.limits.collapse import require_live

        if problem.coulomb is not None:
            pairs = (pair[2] for pair in problem.coulomb.of_pairs)
            check_coefficients(np.array([problem.coulomb.coefficient, *pairs]))
        if grows:
            require_live(case.wrenches[~case.fixed])
    with budget(memory=method.max_memory):
        _require_memory(problem, method)
    if not blocks.interfaces.n_contacts:
        raise AnalysisError(
            "analyse: no two of the blocks touch, and rigid blocks have forces in their joints "
            "alone; expected blocks that meet, or solve_static for single bodies"
        )
    if method.stages is not None:
        from mbd.building.stages import Construction

        Construction(problem, method.stages, method, silent, analyse).check()


def _held(case: LoadCase) -> tuple[HeldFace, ...]:
    """Supports without those that push: their limit is found beside the answer."""
    return tuple(support for support in case.held if not support.is_push)


def stages(
    problem: RigidStatement,
    order: Stages | str | Sequence[Any] = "layers",
    method: Rigid | None = None,
    *,
    progress: Callable[[str], None] | None = None,
) -> StageResults:
    """Judge every stage of the construction of a problem under the weight of what is placed.

    Parameters
    ----------
    problem
        Blocks with gravity, and friction or none.
    order
        `Stages`, or its order alone.
    method
        Norm of the forces, law of friction, and limits: of work for each stage, of CPU time for
        all.
    progress
        Called with a line on what is being found.

    Raises
    ------
    StagesError
        A problem without weight, an order that misses or repeats a block or names none, a block in
        the air where nothing may prop it.
    """
    from mbd.building.stages import Construction

    stated = order if isinstance(order, Stages) else Stages(order=cast("Any", order))
    tell = progress or silent
    return Construction(problem, stated, method or Rigid(), tell, analyse).judged()


def _construction(
    stated: RigidStatement, method: Rigid, tell: Callable[[str], None]
) -> dict[str, Part]:
    """Stages of the construction, and ways out of the blocks, where they are asked."""
    parts: dict[str, Part] = {}
    if method.stages is not None:
        parts["stages"] = stages(stated, method.stages, method, progress=tell)
    if method.take_out:
        from mbd.building.take_out import take_out

        parts["take_out"] = take_out(stated.rigid_blocks, tell)
    return parts


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


def _found(system: RigidSystem, case: LoadCase, watch: Stopwatch) -> dict[str, Part]:
    """Classify rigid blocks, solve for their contact forces, and find what a method asks beside.

    ``case`` has the support that pushes, too.
    """
    method, load, stated = system.method, system.load, system.stated
    parts = _judged(system, watch)
    carried = system.equilibrium.holds and not system.supported_classification.locked
    if system.coulomb is None and carried:
        from mbd.limits.pushes import Pushes

        parts = {"pushes": Pushes(system), **parts}
    if len(load.held) < len(case.held):
        pushed = Stated(system.blocks, case, stated.rigid_weight, system.coulomb)
        parts["push_limit"] = _push(RigidSystem(pushed, method))
    if (both := system.with_edges) is not None:
        from mbd.results.parts import EdgesAndCorners, collapse_of

        system.tell("what edges and corners would add")
        if both is not system:
            _classified(both, watch)
        factors = None
        if method.collapse:
            known = cast("CollapseLoad", parts["collapse"])
            other = known if both is system else collapse_of(both)
            factors = known.factor, other.factor
        parts["edges_and_corners"] = EdgesAndCorners(system, both, factors)
    if stated.interference:
        words = (
            f"{stated.interference:g} mm: not counted by rigid blocks; `tubelock fem` computes "
            "its forces"
        )
        parts["interference"] = Notes([Row("interference fit", words, group="verdict")])
    _ = system.words  # whether joints are pressed beforehand, while work is counted
    if system.moving is not None:
        from mbd.results.rows import driven_motion

        proved = system.verdict.holds is False
        parts["motion"] = driven_motion(system, system.moving, proved=proved)
    watch.lap(_BESIDE)
    return parts


def _classified(system: RigidSystem, watch: Stopwatch) -> None:
    """Classify an assembly and solve for its contact forces without friction (Algorithm 1)."""
    system.tell(f"{system.n_blocks} free blocks: equilibrium and mechanisms")
    # Each is found once and kept: timed as a stage of its own.
    _ = system.touching.interfaces
    watch.lap("interfaces")
    _ = system.force
    watch.lap("jacobian")
    _ = system.equilibrium
    watch.lap("equilibrium")
    _ = system.classification
    watch.lap("mechanism")


def _judged(system: RigidSystem, watch: Stopwatch) -> dict[str, Part]:
    """Classify an assembly, and find friction and limits where they are asked."""
    _classified(system, watch)
    if system.coulomb is None and not system.method.asks_more:
        return {}
    from mbd.results.parts import parts_of

    parts = parts_of(system)
    watch.lap(_BESIDE)
    return parts


def _push(system: RigidSystem) -> Part:
    """Limit of the support that pushes a block, or why there is none."""
    from mbd.limits.pushes import push_limit

    try:
        return push_limit(system)
    except RefusedError as error:
        return Notes([Row("limit of the push", f"none: {error}", group="verdict")])


def _answer(
    stated: RigidStatement,
    system: RigidSystem,
    parts: dict[str, Part],
    seconds: dict[str, float],
) -> Answer:
    """Make the answer of what was found."""
    assembly, motion = system.blocks, system.block_motion
    arrays, fields = Lazy(_arrays(assembly)), dict[str, Callable[[], Array]]()
    if motion is not None:
        fields["mechanism"] = lambda: _node_motion(
            assembly, motion, arrays["points"], arrays["block_of_point"]
        )
    moves = cast("DrivenMotion | None", parts.get("motion"))
    first = f"; {moves.first}" if moves else ""
    contacts = Lazy(_contacts(system) if system.holds else {})
    return Answer(
        title=f"{assembly.name}: rigid blocks, {system.words}{first}",
        method="rigid",
        measures=known(_measures(system, contacts, stated.compressive_strength)),
        fields=Lazy(fields),
        arrays=arrays,
        contacts=contacts,
        reported=cache(lambda: _report(system, seconds)),
        details=system,
        problem=stated,
        cut=lambda planes: _sections(system, planes),
        parts={**parts, "dimensions": Built(lambda: dimensions(assembly))},
        tabled=rigid_rows,
    )


def _sections(result: RigidSystem, cut: Planes) -> SectionForces:
    """Sum the forces of the joints between blocks on both sides of planes."""
    if not result.holds:
        raise SectionError("section: nothing carries the load: there are no forces")
    if getattr(result.blocks, "image_of", None) is not None:
        raise SectionError("section: a periodic cell is a part of a section; cut the tube")
    return sections_through_joints(result.joints, result.blocks.centroids, cut)


def _paper(result: RigidSystem) -> Measures | None:
    """The paper's measures, which are means over facets that match."""
    return result.measures if isinstance(result.blocks, Assembly) else None


def _measures(
    result: RigidSystem, contacts: Lazy[Array], strength: float | None
) -> dict[str, Measure]:
    """Pressures, joint forces and reaction; none where nothing balances the load."""
    pressed, paper = result.forces.any(), _paper(result)
    if not result.holds or not (pressed or result.reaction.any()):
        return {}
    found: dict[str, Measure] = {}
    if contacts and pressed:
        found["p_max_facet"] = largest_facet_mean(result.blocks, contacts)
    if paper is not None:
        found["p_max"] = Measure(paper.p_max, "MPa")
        found["p_eff"] = Measure(paper.p_eff, "MPa")
    found |= _joint_extremes(result.blocks, result.joints)
    found["total_reaction"] = Measure(float(np.linalg.norm(result.reaction)), "N")
    # Rigid contact forces are proportional to the loads: a factor of all of them.
    peak = found.get("p_max_facet")
    if strength is not None and peak is not None and peak.place is not None and peak.value > 0.0:
        where = {**peak.place, "stress": "p_max_facet"}
        factor = Measure(strength / peak.value, "times the load", place=where)
        found["crushing_factor"] = factor
    return found


def _report(result: RigidSystem, seconds: dict[str, float]) -> Lazy[Any]:
    """What the analysis says of itself, as plain data."""
    balance, holds, paper = result.equilibrium, result.holds, _paper(result)
    forces: dict[str, Any] = {}
    if holds:
        forces = {"imbalance": result.imbalance.as_json()}
        if reactions := result.reactions.as_json():
            forces["reactions"] = reactions
    return known(
        {
            "mechanism": str(result.mechanism),
            "mechanism_as_supported": str(result.supported_classification.mechanism),
            "certificate": result.classification.as_json()["certificate"],
            "equilibrium": plain(balance, "holds", "residual", "iterations", "status"),
            "norm": str(result.method.norm),
            "answer": result.words,
            "carried": holds,
            **({} if paper is None else {"contact": asdict(paper)}),
            "reaction": result.reaction.tolist() if holds else None,
            "joints": result.joints.as_json() if holds else [],
            **forces,
            "units": REPORT_UNITS,
            "rotation_length": result.blocks.characteristic_length,
            "free_blocks": np.flatnonzero(~result.load.fixed).tolist(),
            **plain(result, "n_blocks", "n_contacts"),
            "cpu_seconds": seconds,
            **_solids(result),
        }
    )


def _solids(result: RigidSystem) -> dict[str, Any]:
    """What solids alone have, whose contacts are points on flat patches."""
    if isinstance(result.blocks, Assembly):
        return {}
    solids = cast("PolyhedralAssembly", result.blocks)
    patches, bare = solids.interfaces.patches, result.bare_contacts

    def largest(values: FloatArray) -> float | None:
        return float(values.max(initial=0.0)) if result.holds else None

    return {
        "interlocked": result.classification.locked,
        "largest_contact_force": largest(result.contact_forces),
        "largest_patch_pressure": largest(result.patch_pressures),
        "n_patches": len(patches.areas),
        "n_points_without_area": sum(bare.values()),
        "n_crossing_edges": bare[CROSSING_EDGES],
        "n_standing_corners": bare[STANDING_CORNER],
        "contact_area": float(patches.areas.sum()),
        "tolerance": solids.tolerance,
        **({"block_names": list(solids.names)} if solids.names else {}),
    }


def _joint_extremes(assembly: AnyBlocks, joints: JointResultants) -> dict[str, Measure]:
    """Least and largest normal force between two blocks; nothing where none touch."""
    if not len(joints.block_m):
        return {}
    force, result = joints.normal_force, {}
    force = np.where(np.abs(force) > _ROUND_OFF * np.abs(force).max(), force, 0.0)
    for name, extreme, k in (
        ("least_joint_force", force.min(), first_largest(force.max() - force)),
        ("largest_joint_force", force.max(), first_largest(force)),
    ):
        pair = int(joints.block_m[k]), int(joints.block_s[k])
        where = place(assembly, pair, joints.centroids[k])
        result[name] = Measure(float(extreme), "N", place=where)
    return result


def _contacts(carried: RigidSystem) -> dict[str, Callable[[], Array]]:
    """Facets in the order of the interfaces, of triangulated blocks flat patches."""
    assembly, index = carried.blocks, carried.contact_index
    if isinstance(assembly, Assembly):
        areas = assembly.interfaces.areas[index]
        values: dict[str, Callable[[], Array]] = {
            "pressure": lambda: carried.contact_forces / areas,
            "force": lambda: carried.forces,
        }
        return values | interface_contacts(assembly, index)
    result = cast("PolyhedralAssembly", assembly).interfaces
    patches = result.patches
    if not len(patches.areas):
        return {}
    return {
        "pressure": lambda: result.patch_pressures(index, carried.contact_forces),
        "force": lambda: result.of_patches(index, carried.forces),
        "area": lambda: patches.areas,
        "blocks": lambda: np.column_stack([patches.block_m, patches.block_s]),
        "centroid": lambda: result.polygons.patch_centroids,
        "normal": lambda: patches.normals,
    }


def _arrays(assembly: AnyBlocks) -> dict[str, Callable[[], Array]]:
    """Makers of `Answer.arrays`: of nodes of hexahedra or corners of triangles."""
    shapes = [assembly.shape(block) for block in range(assembly.n_blocks)]
    layer = np.zeros(assembly.n_blocks, np.int64)
    if isinstance(assembly, Assembly):
        bodies = [(shape.mesh.nodes, shape.mesh.elements) for shape in shapes]
        layer = assembly.layer
    else:
        bodies = [(shape.points, shape.triangles) for shape in shapes]
    counts = [len(nodes) for nodes, _ in bodies]
    first = np.cumsum(counts) - counts
    return {
        "points": lambda: np.concatenate(
            [assembly.place(block, nodes) for block, (nodes, _) in enumerate(bodies)]
        ),
        "cells": lambda: np.concatenate(
            [own + k for k, (_, own) in zip(first, bodies, strict=True)]
        ),
        "block_of_point": lambda: np.repeat(np.arange(assembly.n_blocks), counts),
        "layer_of_point": lambda: np.repeat(layer, counts),
    }


def _node_motion(
    assembly: AnyBlocks, moving: FloatArray, points: FloatArray, block: IntArray
) -> FloatArray:
    """First-order displacements of nodes, largest 1, (n_points, 3) [-]."""
    arms = points - assembly.centroids[block]
    moved = moving[block, :3] + np.cross(moving[block, 3:], arms)
    return np.asarray(moved / np.linalg.norm(moved, axis=1).max())
