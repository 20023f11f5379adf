"""Algorithm 1 of the paper: is it locked, does it carry the load, with which pressures."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from geometry.assembly import AnyBlocks, Assembly, PlacedBlocks
from geometry.errors import RefusedError
from geometry.loads import LoadCase
from geometry.machine.system import one_thread_of_blas
from geometry.machine.work import budget, clock
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.measures import (
    BlockMeasures,
    JointResultants,
    Measures,
    facet_measures,
    joint_resultants,
)
from geometry.parts.pairs import OfPairs
from geometry.parts.rows import Part
from geometry.polyhedra.bare_contacts import CROSSING_EDGES, STANDING_CORNER
from mbd.contact_jacobian import contact_jacobian
from mbd.equilibrium import Equilibrium, column_weights, equilibrium
from mbd.mechanism import (
    MANY_BLOCKS,
    Classification,
    Mechanism,
    MechanismClass,
    classify,
    classify_opposed,
    judged,
)
from mbd.options import Norm, Rigid, Solver

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly
    from mbd.parts import Friction
    from mbd.pushes import Push


@dataclass(frozen=True)
class RigidResult(ReadOnlyArrays):
    """Everything the rigid-block analysis of one assembly under one load found."""

    classification: Classification
    """Class with every frame block held, as the paper classifies, with its certificate."""
    supported_classification: Classification
    """Class with the supports of the load case; differs only where it releases a frame."""
    equilibrium: Equilibrium
    """Contact forces, residual, load-activated mechanism if there is one, status."""
    measures: Measures | None
    """The paper's measures; None where there is no equilibrium."""
    per_block: BlockMeasures | None
    """The same for each free block, in the order of `measured_blocks`."""
    measured_blocks: IntArray
    """Blocks that the measures average over: all outside the frame; (n,)."""
    contact_index: IntArray
    """Position of each contact in the assembly's interfaces, (n_contacts,)."""
    contact_forces: FloatArray
    """λ >= 0, (n_contacts,) [N]."""
    contact_pressures: FloatArray
    """λ / A, (n_contacts,) [MPa]."""
    norm: Norm
    """What the contact forces minimise."""
    n_blocks: int
    """Blocks free to move under the load."""
    cpu_seconds: dict[str, float]
    """CPU time of each stage: interfaces, jacobian, mechanism, equilibrium, measures, parts [s]."""
    blocks: AnyBlocks = field(repr=False)
    """What was analysed …"""
    load: LoadCase = field(repr=False)
    """… under which loads and supports, weight included."""
    parts: Mapping[str, Part] = field(default_factory=dict)
    """What was found beside, by name."""

    @property
    def mechanism(self) -> MechanismClass:
        """Class with every frame block held."""
        return self.classification.mechanism

    @property
    def n_contacts(self) -> int:
        """Contacts that touch at least one free block."""
        return len(self.contact_forces)

    @property
    def friction(self) -> Friction | None:
        """What friction adds; None without it."""
        return cast("Friction | None", self.parts.get("friction"))

    @property
    def holds(self) -> bool:
        """Whether forces balance the load: with friction, where there is some."""
        return self.equilibrium.holds if self.friction is None else self.friction.holds

    @property
    def of_load(self) -> bool:
        """Whether the load itself brings forces about that balance it, as far as is known."""
        return self.holds and not (self.friction is not None and self.friction.needs_squeeze)

    @property
    def words(self) -> str:
        """The answer as a headline says it."""
        return str(self.mechanism) if self.friction is None else self.friction.words

    @property
    def driven(self) -> FloatArray | None:
        """What the load drives, (n_rows,), where it is not carried."""
        found = self.equilibrium if self.friction is None else self.friction.equilibrium
        return found.mechanism

    @cached_property
    def forces(self) -> FloatArray:
        """On block s of each contact, zero where nothing holds; (n_contacts, 3) [N]."""
        if self.friction is not None:
            given = self.friction.forces
            return np.zeros((self.n_contacts, 3)) if given is None else given
        normals = self.blocks.interfaces.normals[self.contact_index]
        return (self.contact_forces * self.holds)[:, None] * normals

    @cached_property
    def normal_forces(self) -> FloatArray:
        """Part of `forces` along the normals, (n_contacts,) [N]."""
        if self.friction is None:
            return self.contact_forces * self.holds
        normals = self.blocks.interfaces.normals[self.contact_index]
        return np.asarray(np.maximum(np.einsum("ni,ni->n", self.forces, normals), 0.0))

    @cached_property
    def shown_measures(self) -> Measures | None:
        """The paper's measures of `normal_forces`; None where no joint presses."""
        if not self.holds or not self.normal_forces.any():
            return None
        if self.friction is None:
            return self.measures
        pressures = self.normal_forces / self.blocks.interfaces.areas[self.contact_index]
        return facet_measures(self.blocks, self.contact_index, pressures)[1]

    @cached_property
    def joints(self) -> JointResultants:
        """Resultants of the forces between each two blocks."""
        counted = None if self.friction is None else self.friction.counted
        kept = slice(None) if counted is None else counted
        index, found, centroids = self.contact_index[kept], self.blocks.interfaces, None
        if not isinstance(self.blocks, Assembly):
            pairs = np.unique(np.column_stack([found.block_m[index], found.block_s[index]]), axis=0)
            centroids = cast("PolyhedralAssembly", self.blocks).joint_centroids(pairs)
        return joint_resultants(found, index, self.forces[kept], centroids)

    @cached_property
    def patch_pressures(self) -> FloatArray:
        """Mean pressure of each flat patch, of elements each facet; 0: nothing; (n,) [MPa]."""
        if isinstance(self.blocks, Assembly):
            pressures = np.zeros(self.blocks.interfaces.n_contacts)
            pressures[self.contact_index] = self.normal_forces
            return pressures / self.blocks.interfaces.areas
        found = cast("PolyhedralAssembly", self.blocks).interfaces
        return found.patch_pressures(self.contact_index, self.normal_forces)

    @property
    def bare_contacts(self) -> dict[int, int]:
        """Number of contacts without area of each kind; of solids alone."""
        if isinstance(self.blocks, Assembly):
            return {}
        patch = cast("PolyhedralAssembly", self.blocks).interfaces.patch
        return {kind: int((patch == kind).sum()) for kind in (CROSSING_EDGES, STANDING_CORNER)}


class Coulomb(Protocol):
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
    def coulomb(self) -> Coulomb | None:
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
    coulomb: Coulomb | None = None
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
    with budget(method.max_work, clock(method.max_seconds)) as spent:
        result = _result(stated, method, tell)
    return replace(result, parts={**result.parts, "work": spent})


def _result(stated: RigidStatement, method: Rigid, tell: Callable[[str], None]) -> RigidResult:
    blocks, live_case, weight = stated.rigid_blocks, stated.rigid_load, stated.rigid_weight
    pushed = live_case
    if any(support.is_push for support in live_case.held):
        held = tuple(support for support in live_case.held if not support.is_push)
        live_case = replace(live_case, held=held)
    whole = live_case.with_wrenches(weight)
    tell(f"{int((~whole.fixed).sum())} free blocks: equilibrium and mechanisms")
    result = frictionless_result(blocks, whole, method.norm, method.solver)
    start = time.process_time()
    dead = np.zeros((blocks.n_blocks, 6)) if weight is None else weight
    live = live_case.wrenches
    coulomb = stated.coulomb
    parts: dict[str, Part] = {}
    if coulomb is not None or method.asks_more:
        from mbd.parts import Question

        parts = Question(
            whole=blocks,
            load=whole,
            wrenches=(dead, live),
            method=method,
            friction=None if coulomb is None else coulomb.coefficient,
            of_pairs=() if coulomb is None else coulomb.of_pairs,
            interference=stated.interference,
            carried=result.equilibrium.holds,
            frictionless=str(result.mechanism),
            tell=tell,
        ).parts()
    balance = result.equilibrium
    if coulomb is None and balance.holds and not result.supported_classification.locked:
        from mbd.pushes import Pushes

        alone = bool(np.any(dead)) and not np.any(live)
        parts = {"pushes": Pushes(blocks, whole, result.norm, balance, alone), **parts}
    if pushed is not live_case:
        parts["push_limit"] = _push(blocks, pushed.with_wrenches(weight), coulomb)
    if sum(result.bare_contacts.values()):
        from mbd.parts import ByFaces

        tell("class by faces alone")
        parts["by_faces_alone"] = ByFaces(class_by_faces(result))
    spent = time.process_time() - start
    seconds = result.cpu_seconds | {"parts": spent}
    seconds["total"] += spent
    return replace(result, parts=parts, cpu_seconds=seconds)


def _push(blocks: AnyBlocks, load: LoadCase, coulomb: Coulomb | None) -> Push:
    """Limit of the support that pushes a block, by contacts with an area alone.

    They are those of deformable blocks: edges and corners carry nothing.
    """
    from mbd.pushes import Push, push_limit

    faces = blocks
    if not isinstance(blocks, Assembly):
        faces = cast("PolyhedralAssembly", blocks).with_faces_alone()
    friction, of_pairs = (0.0, ()) if coulomb is None else (coulomb.coefficient, coulomb.of_pairs)
    try:
        return Push(friction, push_limit(faces, replace(load, assembly=faces), friction, of_pairs))
    except RefusedError as error:
        return Push(friction, f"none: {error}")


def class_by_faces(result: RigidResult) -> Classification:
    """Mechanism class where solids press on each other's faces alone, all held blocks fixed.

    Edges that cross and corners that stand have no area: a chamfer removes them, and no finite
    pressure acts there. A motion that opens or leaves all contacts does so with fewer of them.
    """
    full, load = result.classification, result.load
    if full.mechanism is MechanismClass.ACTIVATED:
        return full
    bare = cast("PolyhedralAssembly", result.blocks).with_faces_alone()
    contacts = contact_jacobian(bare, supports=load.held)
    force = contacts.rows(load.wrenches)
    if full.mechanism is MechanismClass.SUPPRESSED and isinstance(full.certificate, Mechanism):
        opposed = full.certificate.virtual_displacement.ravel()
        same = bool((load.fixed == bare.fixed).all())
        start = result.equilibrium.multiplier if same else None
        weights = column_weights(result.norm, contacts.areas) if same else None
        driven = judged(contacts.jacobian, force, weights=weights, start=start)
        return classify_opposed(contacts.jacobian, force, opposed, driven)
    return classify(contacts.jacobian, force)


def frictionless_result(
    assembly: AnyBlocks, load: LoadCase, norm: Norm, solver: Solver
) -> RigidResult:
    """Classify an assembly and solve for its contact forces (Algorithm 1)."""
    if not assembly.interfaces.n_contacts:
        raise AnalysisError(
            "analyse: no two of the blocks touch, and rigid blocks have forces in their joints "
            "alone; expected blocks that meet, or solve_static for single bodies"
        )
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
    pressures = balance.forces / contacts.areas
    lap("equilibrium")
    many = len(contacts.free_blocks) > MANY_BLOCKS
    supported = framed = classify(contacts.jacobian, force, balance if many else None)
    if (load.fixed != assembly.fixed).any():
        held = contact_jacobian(assembly, supports=load.held)
        framed = classify(held.jacobian, held.rows(load.wrenches))
    lap("mechanism")
    per_block, overall = None, None
    if balance.holds:
        per_block, overall = facet_measures(assembly, contacts.index, pressures)
    lap("measures")
    seconds["total"] = sum(seconds.values())
    return RigidResult(
        classification=framed,
        supported_classification=supported,
        equilibrium=balance,
        measures=overall,
        per_block=per_block,
        measured_blocks=assembly.free_blocks,
        contact_index=contacts.index,
        contact_forces=balance.forces,
        contact_pressures=pressures,
        norm=norm,
        n_blocks=len(contacts.free_blocks),
        cpu_seconds=seconds,
        blocks=assembly,
        load=load,
    )
