"""The rigid answer in the type that all solvers share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

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
from geometry.assembly import AnyBlocks, Assembly
from geometry.balance import Imbalance, Reactions, imbalance, of_fixed_blocks, together
from geometry.errors import RefusedError
from geometry.loads import LoadCase
from geometry.measures import (
    JointResultants,
    Measures,
    Planes,
    SectionError,
    SectionForces,
    first_largest,
    joint_resultants,
    sections_through_joints,
)
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.dimensions import dimensions
from mbd.analysis import RigidResult, RigidStatement, check_types, rigid_result
from mbd.contact_jacobian import block_wrenches, contact_wrenches
from mbd.mechanism import Classification, Mechanism, SelfStress
from mbd.options import Norm, Solver
from mbd.supports import support_wrenches

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly

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

Option = TypeVar("Option", Norm, Solver)


def analyse(
    assembly: AnyBlocks | RigidStatement,
    load: LoadCase | None = None,
    *,
    norm: Norm | str | None = None,
    solver: Solver | str = Solver.NEWTON,
) -> Answer:
    """Classify rigid blocks without friction and solve for their contact forces (Algorithm 1).

    Parameters
    ----------
    assembly
        Blocks and conforming interfaces; or a whole statement such as `fem.Problem`, which has its
        load.
    load
        Tractions and supports of blocks that come without.
    norm
        What the contact forces minimise: ``pressure`` or ``force``; None: the default of
        `mbd.rigid_result`.
    solver
        ``newton`` (ours) or ``clarabel``.

    Returns
    -------
    Answer
        Its title says the class and whether the load is carried; `details` is the `RigidResult`.
        Where the load is not carried there are no measures and no pressures, for nothing balances
        it; the field ``mechanism`` is then the first-order motion, largest 1 [-].

    Raises
    ------
    RefusedError
        What rigid blocks do not have, such as gaps.
    """
    check_types(assembly, load)
    if load is None:
        statement = cast("RigidStatement", assembly)
        return analyse(statement.blocks, statement.rigid_load, norm=norm, solver=solver)
    blocks = cast("AnyBlocks", assembly)
    chosen = {} if norm is None else {"norm": _named(Norm, "norm", norm)}
    result = rigid_result(blocks, load, solver=_named(Solver, "solver", solver), **chosen)
    return answer_of(blocks, load, result)


class OptionError(RefusedError):
    """An option that the rigid analysis does not have."""


def _named(kind: type[Option], name: str, value: Option | str) -> Option:
    """Option of a name; one that is an option already stays."""
    try:
        return kind(value)
    except ValueError:
        known = ", ".join(repr(str(option)) for option in kind)
        raise OptionError(f"{name}: got {value!r}; expected {known}") from None


class Stated(NamedTuple):
    """What was analysed: a `RigidStatement`."""

    blocks: AnyBlocks
    rigid_load: LoadCase


@dataclass(frozen=True)
class Carried:
    """Contact forces that an answer shows, and whether they balance the load."""

    holds: bool
    forces: FloatArray
    """On block s of each contact, zero where nothing holds; (n_contacts, 3) [N]."""
    normal_forces: FloatArray
    """Part along the normals, (n_contacts,) [N]."""
    measures: Measures | None
    """The paper's measures of the pressures; None where nothing holds or no joint presses."""
    words: str
    """The answer as a headline says it."""
    mechanism: FloatArray | None
    """What the load drives, (n_rows,), where it is not carried."""
    friction: float | None = None
    """Coefficient [-]; None without friction."""
    by_load: bool = True
    """Whether the load itself presses the joints; else forces and pressures are those of some
    state that was pressed beforehand, and not shown."""
    counted: BoolArray | None = None
    """Contacts at which forces may act, (n_contacts,); None: all."""

    @property
    def shown(self) -> bool:
        """Whether the forces are those of the load."""
        return self.holds and self.by_load

    def joints(self, assembly: AnyBlocks, index: IntArray) -> JointResultants:
        """Resultants between each two blocks of contacts at places ``index`` (n_contacts,)."""
        kept = slice(None) if self.counted is None else self.counted
        return joints_of(assembly, index[kept], self.forces[kept])


def without_friction(assembly: AnyBlocks, result: RigidResult) -> Carried:
    """Contact forces of a rigid result."""
    found = result.equilibrium
    normal_forces = result.contact_forces * found.holds
    forces = normal_forces[:, None] * assembly.interfaces.normals[result.contact_index]
    return Carried(
        holds=found.holds,
        forces=forces,
        normal_forces=normal_forces,
        measures=result.measures if normal_forces.any() else None,
        words=str(result.mechanism),
        mechanism=found.mechanism,
    )


def answer_of(
    assembly: AnyBlocks,
    load: LoadCase,
    result: RigidResult,
    *,
    carried: Carried | None = None,
    beside: Callable[[], dict[str, Any]] | None = None,
) -> Answer:
    """Make the answer of a rigid result.

    Parameters
    ----------
    assembly, load
        What was analysed.
    result
        Its class and its forces without friction.
    carried
        The forces that are shown; None: those without friction.
    beside
        More of the report, as plain data; it is asked when the report is read.
    """
    shown = without_friction(assembly, result) if carried is None else carried
    points, cells, block = _points(assembly)
    n_blocks = assembly.n_blocks
    layer = assembly.layer if isinstance(assembly, Assembly) else np.zeros(n_blocks, np.int64)
    motion = block_motion(assembly, load, result, shown)
    fields: dict[str, Callable[[], Array]] = {}
    if motion is not None:
        moving = motion
        fields["mechanism"] = lambda: _node_motion(assembly, moving, points, block)
    verdict = "carries the load" if shown.holds else "does not carry the load"
    if shown.holds and not shown.by_load:
        verdict += " only if pressed beforehand"
    if shown.friction is not None:
        verdict += f" with friction μ = {shown.friction:g}"
    found = _Found(assembly, load, result, shown)
    return Answer(
        title=f"{assembly.name}: rigid, {result.mechanism}, {verdict}",
        method="rigid",
        measures=known(found.measures()),
        fields=Lazy(fields),
        points=points,
        cells=cells,
        block_of_point=block,
        layer_of_point=layer[block],
        contacts=found.contacts,
        reported=lambda: found.report() | ({} if beside is None else beside()),
        details=result,
        problem=Stated(assembly, load),
        cut=found.sections,
    )


@dataclass(frozen=True)
class _Found:
    """What follows from the contact forces that are shown."""

    assembly: AnyBlocks
    load: LoadCase
    result: RigidResult
    carried: Carried

    @cached_property
    def contacts(self) -> Contacts:
        """`Answer.contacts`; nothing where nothing balances the load."""
        index = self.result.contact_index
        makers = _contacts(self.assembly, index, self.carried) if self.carried.shown else {}
        return Contacts(Lazy(makers))

    @cached_property
    def joints(self) -> JointResultants:
        return self.carried.joints(self.assembly, self.result.contact_index)

    @cached_property
    def loads(self) -> FloatArray:
        """Force and moment of the loads about each mass centroid, (n_blocks, 6) [N, N mm]."""
        return block_wrenches(self.assembly, self.load)

    @cached_property
    def supports(self) -> tuple[Reactions, FloatArray]:
        """Supports by name, and what they do to each block: `support_wrenches`."""
        index, forces = self.result.contact_index, self.carried.forces
        on_blocks = contact_wrenches(self.assembly, index, forces) if self.load.held else 0.0
        return support_wrenches(self.assembly, self.load, self.loads + on_blocks)

    @cached_property
    def reactions(self) -> dict[str, dict[str, Any]]:
        """Resultants of supports and fixed blocks by name."""
        fixed = of_fixed_blocks(self.assembly, self.joints, np.flatnonzero(self.load.fixed))
        return together(self.supports[0], fixed).as_json()

    def _balance(self) -> dict[str, Any]:
        reactions = {"reactions": self.reactions} if self.reactions else {}
        return {"imbalance": self.imbalance.as_json(), **reactions}

    @cached_property
    def imbalance(self) -> Imbalance:
        """What joints, loads and supports leave on a free block."""
        own = self.assembly.originals == np.arange(self.assembly.n_blocks)
        free, others = np.flatnonzero(own & ~self.load.fixed), self.loads + self.supports[1]
        return imbalance(
            self.assembly,
            self.joints,
            loads=self.loads[:, :3],
            others=others,
            centres=self.assembly.centroids,
            free=free,
        )

    @cached_property
    def reaction(self) -> FloatArray:
        """Force of held blocks and supports on the rest, against load and weight, (3,) [N]."""
        result, index, held = self.assembly.interfaces, self.result.contact_index, self.load.fixed
        sign = held[result.block_m[index]].astype(float) - held[result.block_s[index]].astype(float)
        total = (sign[:, None] * self.carried.forces).sum(axis=0)
        return np.asarray(total + self.supports[0].forces.sum(axis=0))

    def sections(self, cut: Planes) -> SectionForces:
        """Sum the forces of the joints between blocks on both sides of planes."""
        if not self.carried.shown:
            raise SectionError("section: nothing carries the load by itself: there are no forces")
        if getattr(self.assembly, "image_of", None) is not None:
            raise SectionError("section: a periodic cell is a part of a section; cut the tube")
        return sections_through_joints(self.joints, self.assembly.centroids, cut)

    @property
    def paper(self) -> Measures | None:
        """The paper's measures, which are means over facets that match."""
        return self.carried.measures if isinstance(self.assembly, Assembly) else None

    def measures(self) -> dict[str, Measure]:
        """Pressures, joint forces and reaction; none where the load brings none about."""
        pressed = self.carried.forces.any()
        if not self.carried.shown or not (pressed or self.reaction.any()):
            return {}
        result: dict[str, Measure] = {}
        if self.contacts and pressed:
            result["p_max_facet"] = largest_facet_mean(self.assembly, self.contacts)
        if self.paper is not None:
            result["p_max"] = Measure(self.paper.p_max, "MPa")
            result["p_eff"] = Measure(self.paper.p_eff, "MPa")
        result |= _joint_extremes(self.assembly, self.joints)
        return result | {"total_reaction": Measure(float(np.linalg.norm(self.reaction)), "N")}

    def report(self) -> dict[str, Any]:
        """What the analysis says of itself, as plain data."""
        result, balance, holds = self.result, self.result.equilibrium, self.carried.holds
        return {
            "mechanism": str(result.mechanism),
            "mechanism_as_supported": str(result.supported_classification.mechanism),
            "certificate": certificate_report(result.classification),
            "equilibrium": {
                "holds": balance.holds,
                "residual": balance.residual,
                "iterations": balance.iterations,
                "status": balance.status,
            },
            "norm": str(result.norm),
            "answer": self.carried.words,
            "carried": holds,
            **({} if self.paper is None else {"contact": asdict(self.paper)}),
            "reaction": self.reaction.tolist() if holds else None,
            "joints": self.joints.as_json() if self.carried.shown else [],
            **(self._balance() if self.carried.shown else {}),
            "units": REPORT_UNITS,
            "rotation_length": self.assembly.characteristic_length,
            "free_blocks": np.flatnonzero(~self.load.fixed).tolist(),
            "n_blocks": result.n_blocks,
            "n_contacts": result.n_contacts,
            "dimensions": dimensions(self.assembly).as_json(),
            "cpu_seconds": result.cpu_seconds,
        }


def _joint_extremes(assembly: AnyBlocks, joints: JointResultants) -> dict[str, Measure]:
    """Least and largest normal force between two blocks; nothing where none touch."""
    if not len(joints.block_m):
        return {}
    force, result = joints.normal_force, {}
    for name, extreme, k in (
        ("least_joint_force", force.min(), first_largest(force.max() - force)),
        ("largest_joint_force", force.max(), first_largest(force)),
    ):
        pair = int(joints.block_m[k]), int(joints.block_s[k])
        where = place(assembly, pair, joints.centroids[k])
        result[name] = Measure(float(extreme), "N", place=where)
    return result


def joints_of(assembly: AnyBlocks, index: IntArray, forces: FloatArray) -> JointResultants:
    """Resultants of forces on block s of some contacts, (n, 3) [N], by pairs of blocks."""
    result, centroids = assembly.interfaces, None
    if not isinstance(assembly, Assembly):
        pairs = np.unique(np.column_stack([result.block_m[index], result.block_s[index]]), axis=0)
        centroids = cast("PolyhedralAssembly", assembly).joint_centroids(pairs)
    return joint_resultants(result, index, forces, centroids)


def _contacts(
    assembly: AnyBlocks, index: IntArray, carried: Carried
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


def _points(assembly: AnyBlocks) -> tuple[FloatArray, IntArray, IntArray]:
    """Nodes of all blocks, their hexahedra or triangles, and the block of each node."""
    points, cells, first = [], [], 0
    for block in range(assembly.n_blocks):
        shape = assembly.shape(block)
        hexahedral = isinstance(assembly, Assembly)
        own = shape.mesh.nodes if hexahedral else shape.points
        points.append(assembly.place(block, own))
        cells.append((shape.mesh.elements if hexahedral else shape.triangles) + first)
        first += len(own)
    owner = np.repeat(np.arange(assembly.n_blocks), [len(p) for p in points])
    return np.concatenate(points), np.concatenate(cells), owner


def block_motion(
    assembly: AnyBlocks, load: LoadCase, result: RigidResult, carried: Carried
) -> FloatArray | None:
    """(δt [mm], δθ [rad]) of each block under the mechanism, (n_blocks, 6).

    None where locked, or where friction holds the blocks. Prefers the mechanism that the load
    drives; blocks held by the certificate's supports stay.
    """
    certificate = result.classification.certificate
    if carried.mechanism is not None:
        return placed_motion(assembly, carried.mechanism, ~load.fixed)
    if carried.friction is not None and carried.holds:
        return None
    if isinstance(certificate, Mechanism):
        return placed_motion(assembly, certificate.virtual_displacement, ~assembly.fixed)
    return None


def placed_motion(assembly: AnyBlocks, motion: FloatArray, free: Array) -> FloatArray:
    """(δt [mm], δθ [rad]) of all blocks, (n_blocks, 6), from rows of a Jacobian of free ones."""
    moving = np.zeros((assembly.n_blocks, 6))
    moving[free] = motion.reshape(-1, 6)
    moving[:, 3:] /= assembly.characteristic_length
    return moving


def _node_motion(
    assembly: AnyBlocks, moving: FloatArray, points: FloatArray, block: IntArray
) -> FloatArray:
    """First-order displacements of nodes, largest 1, (n_points, 3) [-]."""
    arms = points - assembly.centroids[block]
    moved = moving[block, :3] + np.cross(moving[block, 3:], arms)
    return np.asarray(moved / np.linalg.norm(moved, axis=1).max())


def certificate_report(classification: Classification) -> dict[str, Any] | None:
    """Return the proof of the mechanism class as plain data."""
    certificate = classification.certificate
    if isinstance(certificate, SelfStress):
        return {
            "kind": "self-stress",
            "smallest_force": float(certificate.forces.min()),
            "residual": certificate.residual,
            "smallest_singular_value": certificate.smallest_singular_value,
        }
    if isinstance(certificate, Mechanism):
        return {
            "kind": "mechanism",
            "virtual_displacement": certificate.virtual_displacement.tolist(),
            "smallest_gap_rate": certificate.smallest_gap_rate,
            "work": certificate.work,
        }
    return None
