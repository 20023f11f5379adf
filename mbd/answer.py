"""The rigid answer in the type that all solvers share."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from geometry.answer import (
    Answer,
    Array,
    Contacts,
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
from geometry.parts.balance import Imbalance, Reactions, imbalance, of_fixed_blocks, together
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
from mbd.analysis import AnalysisError, RigidResult, RigidStatement, as_statement, rigid_result
from mbd.contacts.jacobian import contact_wrenches
from mbd.contacts.supports import support_wrenches
from mbd.frictionless.mechanism import Mechanism
from mbd.options import Rigid, Stages
from mbd.results.motion import placed_motion
from mbd.results.rows import rigid_rows

if TYPE_CHECKING:
    from geometry.parts.rows import Part
    from geometry.polyhedra.assembly import PolyhedralAssembly
    from mbd.building.stages import StageResults
    from mbd.results.motion import Motion

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
    assembly, load = result.blocks, result.load
    arrays = Lazy(_arrays(assembly))
    motion = block_motion(result)
    fields: dict[str, Callable[[], Array]] = {}
    if motion is not None:
        moving = motion
        fields["mechanism"] = lambda: _node_motion(
            assembly, moving, arrays["points"], arrays["block_of_point"]
        )
    moves = result.parts.get("motion")
    first = f"; {cast('Motion', moves).first}" if moves else ""
    found = _Found(assembly, load, result)
    measures = found.measures()
    measures |= _crushing(stated.compressive_strength, measures)
    return Answer(
        title=f"{assembly.name}: rigid blocks, {result.words}{first}",
        method="rigid",
        measures=known(measures),
        fields=Lazy(fields),
        arrays=arrays,
        contacts=found.contacts,
        reported=found.report,
        details=result,
        problem=stated,
        cut=found.sections,
        parts={**result.parts, "dimensions": Built(lambda: dimensions(assembly))},
        tabled=rigid_rows,
    )


def _crushing(strength: float | None, measures: dict[str, Measure]) -> dict[str, Measure]:
    """Factor of all loads at which the largest mean pressure of a facet is the strength [MPa].

    Rigid contact forces are proportional to the loads. Nothing without a strength.
    """
    peak = measures.get("p_max_facet")
    if strength is None or peak is None or peak.place is None or not peak.value > 0.0:
        return {}
    place = {**peak.place, "stress": "p_max_facet"}
    return {"crushing_factor": Measure(strength / peak.value, "times the load", place=place)}


@dataclass(frozen=True)
class _Found:
    """What follows from the contact forces that are shown."""

    assembly: AnyBlocks
    load: LoadCase
    result: RigidResult

    @cached_property
    def contacts(self) -> Contacts:
        """`Answer.contacts`; nothing where nothing balances the load."""
        index = self.result.contact_index
        makers = _contacts(self.assembly, index, self.result) if self.result.holds else {}
        return Contacts(Lazy(makers))

    @cached_property
    def supports(self) -> tuple[Reactions, FloatArray]:
        """Supports by name, and what they do to each block: `support_wrenches`."""
        index, forces = self.result.contact_index, self.result.forces
        on_blocks = contact_wrenches(self.assembly, index, forces) if self.load.held else 0.0
        return support_wrenches(self.assembly, self.load, self.load.wrenches + on_blocks)

    @cached_property
    def reactions(self) -> dict[str, dict[str, Any]]:
        """Resultants of supports and fixed blocks by name."""
        return self.held.as_json()

    @cached_property
    def held(self) -> Reactions:
        """Supports, and fixed blocks less what their supports take."""
        fixed, others = np.flatnonzero(self.load.fixed), self.load.wrenches + self.supports[1]
        joints = of_fixed_blocks(self.assembly, self.result.joints, fixed, others)
        return together(self.supports[0], joints)

    def _balance(self) -> dict[str, Any]:
        reactions = {"reactions": self.reactions} if self.reactions else {}
        return {"imbalance": self.imbalance.as_json(), **reactions}

    @cached_property
    def imbalance(self) -> Imbalance:
        """What joints, loads and supports leave on a free block."""
        own = self.assembly.originals == np.arange(self.assembly.n_blocks)
        free, others = np.flatnonzero(own & ~self.load.fixed), self.load.wrenches + self.supports[1]
        return imbalance(
            self.assembly,
            self.result.joints,
            acting=self.load.acting,
            others=others,
            centres=self.assembly.centroids,
            free=free,
        )

    @property
    def reaction(self) -> FloatArray:
        """Force of fixed blocks and supports, against all loads and weight, (3,) [N]."""
        return self.held.forces.sum(axis=0)

    def sections(self, cut: Planes) -> SectionForces:
        """Sum the forces of the joints between blocks on both sides of planes."""
        if not self.result.holds:
            raise SectionError("section: nothing carries the load: there are no forces")
        if getattr(self.assembly, "image_of", None) is not None:
            raise SectionError("section: a periodic cell is a part of a section; cut the tube")
        return sections_through_joints(self.result.joints, self.assembly.centroids, cut)

    @property
    def paper(self) -> Measures | None:
        """The paper's measures, which are means over facets that match."""
        return self.result.shown_measures if isinstance(self.assembly, Assembly) else None

    def measures(self) -> dict[str, Measure]:
        """Pressures, joint forces and reaction; none where nothing balances the load."""
        pressed = self.result.forces.any()
        if not self.result.holds or not (pressed or self.reaction.any()):
            return {}
        result: dict[str, Measure] = {}
        if self.contacts and pressed:
            result["p_max_facet"] = largest_facet_mean(self.assembly, self.contacts)
        if self.paper is not None:
            result["p_max"] = Measure(self.paper.p_max, "MPa")
            result["p_eff"] = Measure(self.paper.p_eff, "MPa")
        result |= _joint_extremes(self.assembly, self.result.joints)
        return result | {"total_reaction": Measure(float(np.linalg.norm(self.reaction)), "N")}

    def report(self) -> Lazy[Any]:
        """What the analysis says of itself, as plain data."""
        result, balance, holds = self.result, self.result.equilibrium, self.result.holds
        evidence = {
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
            **({} if self.paper is None else {"contact": asdict(self.paper)}),
            "reaction": self.reaction.tolist() if holds else None,
            "joints": self.result.joints.as_json() if self.result.holds else [],
            **(self._balance() if self.result.holds else {}),
            "units": REPORT_UNITS,
            "rotation_length": self.assembly.characteristic_length,
            "free_blocks": np.flatnonzero(~self.load.fixed).tolist(),
            "n_blocks": result.n_blocks,
            "n_contacts": result.n_contacts,
            "cpu_seconds": result.cpu_seconds,
            **self._solids(),
        }
        return known(evidence)

    def _solids(self) -> dict[str, Any]:
        """What solids alone have, whose contacts are points on flat patches."""
        if isinstance(self.assembly, Assembly):
            return {}
        solids, result = cast("PolyhedralAssembly", self.assembly), self.result
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


def _contacts(
    assembly: AnyBlocks, index: IntArray, carried: RigidResult
) -> dict[str, Callable[[], Array]]:
    """Facets in the order of the interfaces, of triangulated blocks flat patches."""
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


def block_motion(result: RigidResult) -> FloatArray | None:
    """(δt [mm], δθ [rad]) of each block under the mechanism, (n_blocks, 6).

    None where locked, or where friction holds the blocks. Prefers how the load moves them; blocks
    held by the certificate's supports stay.
    """
    certificate, blocks = result.classification.certificate, result.blocks
    if result.moving is not None:
        return placed_motion(blocks, result.moving, ~result.load.fixed)
    if result.friction is not None and result.holds:
        return None
    if isinstance(certificate, Mechanism):
        return placed_motion(blocks, certificate.virtual_displacement, ~blocks.fixed)
    return None


def _node_motion(
    assembly: AnyBlocks, moving: FloatArray, points: FloatArray, block: IntArray
) -> FloatArray:
    """First-order displacements of nodes, largest 1, (n_points, 3) [-]."""
    arms = points - assembly.centroids[block]
    moved = moving[block, :3] + np.cross(moving[block, 3:], arms)
    return np.asarray(moved / np.linalg.norm(moved, axis=1).max())
