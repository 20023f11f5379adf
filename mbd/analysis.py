"""Algorithm 1 of the paper: is it locked, does it carry the load, with which pressures."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol, cast

from geometry.assembly import AnyBlocks, PlacedBlocks
from geometry.errors import RefusedError
from geometry.loads import LoadCase
from geometry.measures import BlockMeasures, Measures, facet_measures
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays
from mbd.contact_jacobian import contact_jacobian, generalized_force
from mbd.equilibrium import Equilibrium, column_weights, equilibrium
from mbd.mechanism import MANY_BLOCKS, Classification, MechanismClass, classify
from mbd.options import Norm, Solver


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
    """CPU time of each stage: interfaces, jacobian, mechanism, equilibrium, measures [s]."""

    @property
    def mechanism(self) -> MechanismClass:
        """Class with every frame block held."""
        return self.classification.mechanism

    @property
    def n_contacts(self) -> int:
        """Contacts that touch at least one free block."""
        return len(self.contact_forces)


class RigidStatement(Protocol):
    """A statement of a problem, such as `fem.Problem`, of which rigid blocks read two things."""

    @property
    def blocks(self) -> AnyBlocks:
        """The assembly of blocks."""

    @property
    def rigid_load(self) -> LoadCase:
        """Loads and supports, weight included."""


class AnalysisError(RefusedError):
    """An argument of the wrong type; the message names it and what is expected."""


def check_types(assembly: object, load: object) -> None:
    """Reject what is neither blocks with a load case nor a statement of both."""
    blocks = isinstance(assembly, PlacedBlocks)
    if load is None and (blocks or getattr(type(assembly), "rigid_load", None) is None):
        got = "blocks without a load case" if blocks else f"a {type(assembly).__name__}"
        raise AnalysisError(
            f"analyse: got {got}; expected a Problem, or blocks and a load case: "
            "analyse(blocks, pipe(0.01).on(blocks))"
        )
    if load is not None and not (blocks and isinstance(load, LoadCase)):
        raise AnalysisError(
            f"analyse: got a {type(assembly).__name__} and a {type(load).__name__}; expected "
            "blocks and a load case: analyse(blocks, pipe(0.01).on(blocks))"
        )


def rigid_result(
    assembly: AnyBlocks | RigidStatement,
    load: LoadCase | None = None,
    *,
    norm: Norm = Norm.PRESSURE,
    solver: Solver = Solver.NEWTON,
) -> RigidResult:
    """Classify an assembly and solve for its contact forces (Algorithm 1).

    Parameters
    ----------
    assembly
        Blocks and conforming interfaces; or a whole statement, which has its load.
    load
        Tractions and supports of blocks that come without.
    norm
        What the contact forces minimise: ``pressure``, which does not depend on the mesh, or
        ``force``, as the paper prints it.
    solver
        ``newton`` (ours) or ``clarabel``.

    Returns
    -------
    RigidResult
        `RigidResult.equilibrium` says whether the load is carried; nothing is called
        equilibrium above a relative residual of 1e-6.

    Raises
    ------
    AnalysisError
        Blocks of which no two touch, or arguments of another type.
    """
    check_types(assembly, load)
    if load is None:
        statement = cast("RigidStatement", assembly)
        return rigid_result(statement.blocks, statement.rigid_load, norm=norm, solver=solver)
    assembly = cast("AnyBlocks", assembly)
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
    force = generalized_force(assembly, load, contacts.free_blocks, contacts.length)
    lap("jacobian")
    weights = column_weights(norm, contacts.areas)
    balance = equilibrium(contacts.jacobian, force, solver=solver, weights=weights)
    pressures = balance.forces / contacts.areas
    lap("equilibrium")
    many = len(contacts.free_blocks) > MANY_BLOCKS
    supported = framed = classify(contacts.jacobian, force, balance if many else None)
    if (load.fixed != assembly.fixed).any():
        held = contact_jacobian(assembly, supports=load.held)
        pushed = generalized_force(assembly, load, held.free_blocks, held.length)
        framed = classify(held.jacobian, pushed)
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
    )
