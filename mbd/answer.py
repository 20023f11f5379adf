"""The rigid answer in the type that all solvers share."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
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
from geometry.loads import LoadCase
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
from geometry.parts.placed import AnyBlocks
from geometry.polyhedra.bare_contacts import CROSSING_EDGES, STANDING_CORNER
from mbd.analysis import AnalysisError, as_statement, rigid_result
from mbd.options import Rigid, Stages
from mbd.results.result import RigidResult
from mbd.results.rows import rigid_rows
from mbd.system import RigidStatement

if TYPE_CHECKING:
    from geometry.parts.rows import Part
    from geometry.polyhedra.assembly import PolyhedralAssembly
    from mbd.building.stages import StageResults
    from mbd.results.motion import DrivenMotion

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
        `RigidResult`, `parts` what was found beside. Nothing is called equilibrium above a relative
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
    tell, start = progress or (lambda _: None), time.process_time()
    parts = _construction(stated, method, tell)
    built = time.process_time() - start
    result = rigid_result(stated, method, tell)
    seconds = dict(result.cpu_seconds)
    for stage in ("parts", "total") if parts else ():
        seconds[stage] = seconds.get(stage, 0.0) + built
    result = replace(result, parts={**parts, **result.parts}, cpu_seconds=seconds)
    return _answer(stated, result)


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
    tell = progress or (lambda _: None)
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


def _answer(stated: RigidStatement, result: RigidResult) -> Answer:
    """Make the answer of a rigid result."""
    assembly, motion = result.blocks, result.block_motion
    arrays, fields = Lazy(_arrays(assembly)), dict[str, Callable[[], Array]]()
    if motion is not None:
        fields["mechanism"] = lambda: _node_motion(
            assembly, motion, arrays["points"], arrays["block_of_point"]
        )
    moves = cast("DrivenMotion | None", result.parts.get("motion"))
    first = f"; {moves.first}" if moves else ""
    contacts = Lazy(_contacts(result) if result.holds else {})
    return Answer(
        title=f"{assembly.name}: rigid blocks, {result.words}{first}",
        method="rigid",
        measures=known(_measures(result, contacts, stated.compressive_strength)),
        fields=Lazy(fields),
        arrays=arrays,
        contacts=contacts,
        reported=lambda: _report(result),
        details=result,
        problem=stated,
        cut=lambda planes: _sections(result, planes),
        parts={**result.parts, "dimensions": Built(lambda: dimensions(assembly))},
        tabled=rigid_rows,
    )


def _sections(result: RigidResult, cut: Planes) -> SectionForces:
    """Sum the forces of the joints between blocks on both sides of planes."""
    if not result.holds:
        raise SectionError("section: nothing carries the load: there are no forces")
    if getattr(result.blocks, "image_of", None) is not None:
        raise SectionError("section: a periodic cell is a part of a section; cut the tube")
    return sections_through_joints(result.joints, result.blocks.centroids, cut)


def _paper(result: RigidResult) -> Measures | None:
    """The paper's measures, which are means over facets that match."""
    return result.shown_measures if isinstance(result.blocks, Assembly) else None


def _measures(
    result: RigidResult, contacts: Lazy[Array], strength: float | None
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


def _report(result: RigidResult) -> Lazy[Any]:
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
            "equilibrium": {
                "holds": balance.holds,
                "residual": balance.residual,
                "iterations": balance.iterations,
                "status": balance.status,
            },
            "norm": str(result.norm),
            "answer": result.words,
            "carried": holds,
            **({} if paper is None else {"contact": asdict(paper)}),
            "reaction": result.reaction.tolist() if holds else None,
            "joints": result.joints.as_json() if holds else [],
            **forces,
            "units": REPORT_UNITS,
            "rotation_length": result.blocks.characteristic_length,
            "free_blocks": np.flatnonzero(~result.load.fixed).tolist(),
            "n_blocks": result.n_blocks,
            "n_contacts": result.n_contacts,
            "cpu_seconds": result.cpu_seconds,
            **_solids(result),
        }
    )


def _solids(result: RigidResult) -> dict[str, Any]:
    """What solids alone have, whose contacts are points on flat patches."""
    if isinstance(result.blocks, Assembly):
        return {}
    solids = cast("PolyhedralAssembly", result.blocks)
    patches, bare = solids.interfaces.patches, result.bare_contacts

    def largest(values: FloatArray) -> float | None:
        return float(values.max(initial=0.0)) if result.holds else None

    return {
        "interlocked": result.classification.locked,
        "largest_contact_force": largest(result.normal_forces),
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


def _contacts(carried: RigidResult) -> dict[str, Callable[[], Array]]:
    """Facets in the order of the interfaces, of triangulated blocks flat patches."""
    assembly, index = carried.blocks, carried.contact_index
    if isinstance(assembly, Assembly):
        areas = assembly.interfaces.areas[index]
        values: dict[str, Callable[[], Array]] = {
            "pressure": lambda: carried.normal_forces / areas,
            "force": lambda: carried.forces,
        }
        return values | interface_contacts(assembly, index)
    result = cast("PolyhedralAssembly", assembly).interfaces
    patches = result.patches
    if not len(patches.areas):
        return {}
    return {
        "pressure": lambda: result.patch_pressures(index, carried.normal_forces),
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
