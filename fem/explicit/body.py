"""The model as the explicit loop wants it: constant arrays of one body, copies in lanes.

Displacements, velocities and forces of the loop are components in the *placement frame* of
each copy (the axes of the reference block, turned by its placement), so congruent copies
share one stiffness. World vectors are R times these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fem.element.hexahedron import gauss_gradients, mean_gradients
from fem.explicit.kernels.layout import (
    BlockRows,
    LaneArray,
    Runs,
    block_rows,
    equal_work,
    from_lanes,
    padded_lanes,
    runs,
)
from fem.explicit.state import BodyState
from fem.explicit.timed import TimedSystem
from fem.system.body import Body
from fem.system.effects import BulkViscosity
from fem.system.rows import Amplitude, ForceRows
from fem.system.time_step import characteristic_length
from geometry.mesh import FloatArray, IntArray


@dataclass(frozen=True)
class ElementViscosity:
    """Constant data of the bulk viscosity of one reference block, as Abaqus/Explicit has it.

    With the volumetric strain rate ε̇ of an element (gradients averaged over its volume), its
    length L (`fem.system.time_step.characteristic_length`), density ρ and dilatational wave
    speed c, the viscous mean stress is

        q = b₁ ρ c L ε̇ + ρ (b₂ L)² |ε̇| min(0, ε̇),

    Abaqus Theory Manual, "Explicit dynamic analysis". Nodal forces are V q times the averaged
    gradients. Differences from C3D8R: reference gradients in the block frame, ε̇ the backward
    difference of the strain, which is the rate at the half step.
    """

    element_rows: npt.NDArray[np.int32]
    """Solver rows of the corners, (n_elements, 8)."""
    gradient: LaneArray
    """Volume-averaged shape gradients, (n_elements, 8, 3) [1/mm]."""
    linear: LaneArray
    """V b₁ ρ c L, (n_elements,) [N mm s]."""
    quadratic: LaneArray
    """V ρ (b₂ L)², (n_elements,) [N mm s²]."""
    element_chunks: IntArray
    """Even pieces of the elements."""
    pointer: IntArray
    """First corner of each row, (n_rows + 1,)."""
    corner: npt.NDArray[np.int32]
    """8 · element + corner for every corner at a row, (8 n_elements,)."""


def element_viscosity(body: Body, row: IntArray, coefficients: BulkViscosity) -> ElementViscosity:
    """Gather gradients and coefficients of a reference block; ``row`` is that of each mesh node."""
    mesh, material = body.mesh, body.material
    mean, volume = mean_gradients(*gauss_gradients(mesh.nodes[mesh.elements]))
    length = characteristic_length(mesh.nodes[mesh.elements])
    b1, b2 = coefficients.linear_bulk_viscosity, coefficients.quadratic_bulk_viscosity
    rho, c = material.density, material.dilatational_wave_speed
    element_rows = row[mesh.elements].astype(np.int32)
    corner = np.argsort(element_rows.ravel(), kind="stable").astype(np.int32)
    pointer = np.searchsorted(element_rows.ravel()[corner], np.arange(mesh.n_nodes + 1))
    return ElementViscosity(
        element_rows=element_rows,
        gradient=mean,
        linear=volume * b1 * rho * c * length,
        quadratic=volume * rho * (b2 * length) ** 2,
        element_chunks=equal_work(np.arange(mesh.n_elements + 1)),
        pointer=pointer.astype(np.int64),
        corner=corner,
    )


@dataclass(frozen=True)
class FollowingForces:
    """Forces that turn with the frame of their block."""

    forces: FloatArray
    """Placement-frame forces at a block that has not turned, (n, 3) [N]."""
    copies: IntArray
    """Block of each, (n,)."""
    order: IntArray
    """Which of the 3 n components each entry of the load is, (3 n,)."""


@dataclass(frozen=True)
class BodyLoad:
    """One nodal load, scattered into flat arrays."""

    amplitude: Amplitude | None
    """Factor in time; None: one."""
    applied: Runs
    """Positions in the flat applied force."""
    values: FloatArray
    """Placement-frame forces, (3 n,) [N]."""
    following: FollowingForces | None
    """What `values` are to be made of when they follow the block frame."""


@dataclass(frozen=True)
class HeldLanes:
    """Prescribed displacement components of one body: `fem.system.rows.Held` in lanes.

    Those along the axes of the placement frame that stay zero are ``still``; all others move or lie
    across these axes.
    """

    still: Runs
    """Flat positions of those that stay zero."""
    still_mass: FloatArray
    """Of their nodes, (n_still,) [t]."""
    base: IntArray
    """Flat position of the x component of the node of each other one, (n,)."""
    direction: FloatArray
    """Unit vectors in the placement frame, orthonormal at each node, (n, 3)."""
    ways: FloatArray
    """Displacement by each table, then what none moves, (n, n_tables + 1) [mm]."""
    tables: tuple[Amplitude, ...]
    """Share of their way as functions of time [s]."""
    mass: FloatArray
    """Of the node, (n,) [t]."""

    def prescribed(self, time: float) -> FloatArray:
        """Return the prescribed displacement components, (n,) [mm]; at rest before time 0."""
        shares = [table(max(time, 0.0)) for table in self.tables]
        return self.ways @ np.array([*shares, 1.0])


@dataclass
class LaneBody:
    """A body inside the explicit loop, its copies in lanes: constants, and what changes."""

    body: Body
    """As it was stated."""
    rows: BlockRows
    """Stiffness in the solver's node order."""
    hourglass: BlockRows | None
    """Hourglass part of it, for its energy."""
    lanes: int
    """Padded number of copies."""
    mass: LaneArray
    """Lumped mass of the rows, (n_rows,) [t]."""
    reference: LaneArray
    """Rows' reference positions relative to the mass centroid, (n_rows, 3) [mm]."""
    applied_row: npt.NDArray[np.int32] | None
    """Row of the applied force that acts on each row, -1 where none, (n_rows,); None: nothing
    is ever applied."""
    n_applied: int
    """Rows of the applied force."""
    loads: tuple[BodyLoad, ...]
    """Loads on this body."""
    loaded: IntArray
    """Rows that they act on, and those of the applied force there, (2, n)."""
    held: HeldLanes | None
    """Prescribed components; None: none."""
    acceleration: LaneArray | None
    """Gravity in the placement frames, (3, lanes) [mm/s²]."""
    viscosity: ElementViscosity | None
    """Bulk viscosity data."""
    now: BodyState = field(init=False)
    """What changes from step to step."""
    moves: dict[bool, Callable[..., None]] = field(default_factory=dict)
    """Machine code of `fem.explicit.kernels.motion.update`, without and with a sample."""

    @cached_property
    def total_mass(self) -> float:
        """Mass of one copy [t]."""
        return float(self.mass.sum())

    @cached_property
    def supported(self) -> IntArray:
        """Flat positions of all components of nodes that are held or moved, (n,)."""
        if self.held is None:
            return np.empty(0, np.int64)
        moved = self.held.base[:, None] + self.lanes * np.arange(3)
        return np.union1d(self.held.still.index, moved)

    @cached_property
    def held_loads(self) -> IntArray:
        """What `loaded` holds, of the rows with supports alone, (2, n)."""
        return self.loaded[:, np.isin(self.loaded[0], self.supported // (3 * self.lanes))]

    @cached_property
    def second_moment(self) -> FloatArray:
        """Σ m X Xᵀ about the mass centroid, (3, 3) [t mm²]."""
        return (self.mass[:, None] * self.reference).T @ self.reference

    @property
    def n_copies(self) -> int:
        """Number of copies that exist; the other lanes are padding."""
        return self.body.n_copies

    @property
    def constant_bytes(self) -> int:
        """Memory of stiffness, mass and connectivity."""
        rows = [r for r in (self.rows, self.hourglass) if r is not None]
        arrays = [a for r in rows for a in (r.blocks, r.column, r.pointer, r.order, r.row)]
        arrays += [r.shared for r in rows if r.shared is not None]
        arrays += [self.mass, self.reference]
        if self.viscosity is not None:
            v = self.viscosity
            arrays += [v.element_rows, v.gradient, v.linear, v.quadratic, v.pointer, v.corner]
        return sum(a.nbytes for a in arrays)

    @property
    def n_rows(self) -> int:
        """Nodes of one copy."""
        return self.rows.n_nodes


def make_body(stated: TimedSystem, number: int, touched_nodes: IntArray | None) -> LaneBody:
    """Prepare body ``number`` of a run.

    ``touched_nodes`` are further nodes on which forces will be applied (contact); None: none.
    """
    body, effects = stated.bodies[number], stated.effects
    lanes = padded_lanes(body.n_copies)
    rows = block_rows(body.stiffness, lanes=lanes)
    rows_of = [(load, *load.on(stated.starts(number))) for load in stated.system.whole.forces]
    loads = [of for of in rows_of if len(of[1])]
    none = np.empty(0, np.int64)
    nodes = [row % body.n_nodes for _, row, _ in loads]
    touched = np.unique(np.concatenate([none if touched_nodes is None else touched_nodes, *nodes]))
    applied = _applied_rows(rows, touched)
    loaded = np.unique(rows.row[np.concatenate([none, *nodes])])
    centroid = body.lumped_mass @ body.mesh.nodes / body.lumped_mass.sum()
    hourglass = body.hourglass_stiffness
    viscosity = effects.bulk_viscosity
    return LaneBody(
        body=body,
        rows=rows,
        hourglass=None if hourglass is None else block_rows(hourglass, lanes=lanes),
        lanes=lanes,
        mass=body.lumped_mass[rows.order],
        reference=body.mesh.nodes[rows.order] - centroid,
        applied_row=applied if len(touched) else None,
        n_applied=len(touched),
        loads=tuple(_body_load(body, rows, applied, lanes, of) for of in loads),
        loaded=np.stack([loaded, applied[loaded]]),
        held=_held_lanes(stated, number, rows, lanes),
        acceleration=_lane_gravity(body, effects.gravity, lanes),
        viscosity=None if viscosity is None else element_viscosity(body, rows.row, viscosity),
    )


def _applied_rows(rows: BlockRows, nodes: IntArray) -> npt.NDArray[np.int32]:
    """Number the touched rows in the order of the rows; (n_rows,), -1 elsewhere."""
    applied = np.full(rows.n_nodes, -1, dtype=np.int32)
    applied[np.sort(rows.row[nodes])] = np.arange(len(nodes), dtype=np.int32)
    return applied


def _body_load(
    body: Body,
    rows: BlockRows,
    applied: npt.NDArray[np.int32],
    lanes: int,
    of: tuple[ForceRows, IntArray, FloatArray],
) -> BodyLoad:
    """``of``: a load, its nodes in the loop and the forces on them."""
    load, numbers, force = of
    copies, nodes = np.divmod(numbers, body.n_nodes)
    first = applied[rows.row[nodes]].astype(np.int64) * 3 * lanes + copies
    found, order = runs((first[:, None] + lanes * np.arange(3)).ravel())
    return BodyLoad(
        amplitude=load.amplitude,
        applied=found,
        values=force.ravel()[order],
        following=FollowingForces(force, copies, order) if load.follows_block else None,
    )


def _lane_gravity(body: Body, gravity: FloatArray | None, lanes: int) -> LaneArray | None:
    if gravity is None:
        return None
    local = np.zeros((3, lanes))
    local[:, : body.n_copies] = np.einsum("cij,i->jc", body.rotations, gravity)
    return local


def _held_lanes(stated: TimedSystem, number: int, rows: BlockRows, lanes: int) -> HeldLanes | None:
    """Supports of one body; None: none."""
    body, held = stated.bodies[number], stated.system.whole.supports.on(stated.starts(number))
    node, axis = np.nonzero(held.held)
    if not len(node):
        return None
    copies, nodes = np.divmod(held.nodes[node], body.n_nodes)
    direction = held.axes[node, :, axis]
    ways = np.einsum("nti,ni->nt", held.ways[node], direction)
    base, mass = rows.row[nodes] * (3 * lanes) + copies, body.lumped_mass[nodes]
    along = np.abs(direction)
    still = (along.max(axis=1) == 1.0) & ~ways.any(axis=1)
    positions, order = runs((base + lanes * along.argmax(axis=1))[still])
    return HeldLanes(
        still=positions,
        still_mass=mass[still][order],
        base=base[~still],
        direction=np.ascontiguousarray(direction[~still]),
        ways=ways[~still],
        tables=held.tables,
        mass=mass[~still],
    )


def world_vectors(body: LaneBody, lanes: LaneArray) -> FloatArray:
    """Placement-frame lanes (n_rows, 3, lanes) as world vectors, (n_copies, n_nodes, 3)."""
    local = from_lanes(lanes, body.rows.row, body.n_copies)
    return np.einsum("cij,cnj->cni", body.body.rotations, local)
