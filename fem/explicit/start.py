"""The start of an explicit run: its arrays at time 0."""

from __future__ import annotations

import numba
import numpy as np

from fem.explicit.block_frame import block_frame, start_frames
from fem.explicit.body import LaneBody, make_body
from fem.explicit.contact.paired import FaceContact
from fem.explicit.contact.sliding import SlidingContact
from fem.explicit.damping import applied_forces
from fem.explicit.kernels import PARALLEL, SERIAL
from fem.explicit.kernels.layout import LaneArray, aligned_zeros, sums_of_chunks, to_lanes
from fem.explicit.state import (
    BodyState,
    ElasticForceBefore,
    ForceWork,
    LoadState,
    StateError,
    StiffnessDampingState,
    ViscousState,
)
from fem.explicit.step import (
    Interaction,
    Loop,
    gravity_at,
    placed_internal_force,
    set_applied_force,
    set_internal_force,
)
from fem.explicit.timed import TimedSystem
from fem.system.effects import Effects
from fem.system.loose import unresisted_motions
from geometry.mesh import FloatArray, IntArray


def prepare(stated: TimedSystem, *, time_step: float, threads: int = 1) -> Loop:
    """Make a timed system ready for the loop, at time 0, with a time step [s].

    Velocities are those half a step earlier, v_{-½} = v_0 - ½ Δt a_0. With one thread the serial
    loops run, with more those of shared rows.
    """
    if threads > 1:
        numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    n, effects, system = len(stated.bodies), stated.effects, stated.system
    cell = system.whole.meets and system.whole.assembly.image_of is not None
    held = cell_motions(stated) if cell else None
    touched = [np.flatnonzero(areas) for areas in stated.contact_areas]
    if held is not None:
        touched = [
            np.union1d(nodes, np.flatnonzero(motions.any(axis=(0, 1, 3))))
            for nodes, motions in zip(touched, held[1], strict=True)
        ]
    bodies = tuple(
        make_body(stated, k, touched_nodes=touched[k] if touched else None) for k in range(n)
    )
    contact = SlidingContact if system.whole.contact.finite_sliding else FaceContact
    interactions: list[Interaction] = [contact(stated, bodies)] if system.whole.meets else []
    if held is not None:
        interactions.append(CellHold(*held, bodies))
    loop = Loop(
        stated=stated,
        bodies=bodies,
        # Of NumPy's own scalars numba asks the type at length, at every call.
        time_step=float(time_step),
        kernels=SERIAL if threads == 1 else PARALLEL,
        interactions=tuple(interactions),
        mass_damping=0.0 if effects.adaptive_mass_damping is not None else effects.mass_damping,
    )
    moved = [None] * n if stated.displacements is None else stated.displacements
    moving = [None] * n if stated.velocities is None else stated.velocities
    for body, u, v in zip(bodies, moved, moving, strict=True):
        body.now = initial_body_state(body, effects, u, v, meets=bool(interactions))
        set_internal_force(loop, body, sample=False)
        if body.now.viscous is not None or body.now.stiffness_damping is not None:
            # What dampers keep is the start now: its whole strain is not one step's rate.
            set_internal_force(loop, body, sample=False)
        forget_rates(body.now)
        set_applied_force(loop, body, 0.0)
    for interaction in loop.interactions:
        interaction.add_force(loop)
    for body in bodies:
        body.now.velocity -= 0.5 * time_step * acceleration(loop, body)
        _stop_supported(body)
    return loop


def forget_rates(now: BodyState) -> None:
    """Start rates from zero: no step came before the first evaluation, and nothing is lost yet."""
    if now.elastic_before is not None:
        now.elastic_before.force[:] = now.internal_force
    for damper in (now.stiffness_damping, now.viscous):
        if damper is not None:
            damper.dissipated[:] = 0.0


def acceleration(loop: Loop, body: LaneBody) -> FloatArray:
    """Accelerations of the forces that the state has at time 0, placement frame, as velocities."""
    force = applied_forces(body) - placed_internal_force(body)
    result: FloatArray = force / body.mass[:, None, None]
    falling = None if body.acceleration is None else gravity_at(loop, body, 0.0)
    if falling is not None:
        result += falling
    if loop.mass_damping is not None:
        result -= loop.mass_damping * body.now.velocity
    return result


def _stop_supported(body: LaneBody) -> None:
    """Remove the supported components of the first velocity: supports start from rest."""
    flat, held = body.now.velocity.ravel(), body.held
    if held is None:
        return
    flat[held.still.index] = 0.0
    body.now.displacement.ravel()[held.still.index] = 0.0
    index = held.base[:, None] + body.lanes * np.arange(3)
    for k in range(len(index)):
        n = held.direction[k]
        flat[index[k]] -= n * (n @ flat[index[k]])


def initial_body_state(
    body: LaneBody,
    effects: Effects,
    displacement: FloatArray | None = None,
    velocity: FloatArray | None = None,
    *,
    meets: bool = False,
) -> BodyState:
    """State of one body at time 0, before the first force; effects say which arrays are needed.

    Displacement and velocity are world components, (n_copies, n_nodes, 3) [mm], [mm/s]; None: zero.
    Where it ``meets`` others, loads are kept apart from what is applied.
    """
    shape = (body.n_rows, 3, body.lanes)
    n_chunks = len(body.rows.chunks) - 1
    damped = effects.stiffness_damping is not None
    alone = not effects.finite_rotation and body.viscosity is None
    mass_damped = effects.mass_damping is not None or effects.adaptive_mass_damping is not None
    applied = loads = None
    if body.applied_row is not None:
        applied = aligned_zeros((body.n_applied, 3, body.lanes))
    if applied is not None and body.loads:
        force = np.zeros_like(applied) if meets else applied
        work = sums_of_chunks(n_chunks, 2, body.lanes)
        loads = LoadState(force, np.full(len(body.loads), np.nan), work)
    state = BodyState(
        displacement=_placement_lanes(body, displacement, "displacement"),
        velocity=_placement_lanes(body, velocity, "velocity"),
        internal_force=aligned_zeros(shape),
        applied_force=applied,
        loads=loads,
        momentum=None
        if body.acceleration is None or effects.gravity_amplitude is None
        else np.full(3 * body.lanes, np.nan),
        kinetic=np.zeros((n_chunks, body.lanes)),
        strain_energy=np.zeros(body.lanes),
        frame=block_frame(body, keep_increment=damped) if effects.finite_rotation else None,
        viscous=_viscous_state(body),
        stiffness_damping=_stiffness_damping_state(body) if damped and not alone else None,
        elastic_before=_elastic_force_before(body) if damped and alone else None,
        mass_damping_work=sums_of_chunks(n_chunks, 2, body.lanes) if mass_damped else None,
        remembered=None
        if effects.adaptive_mass_damping is None
        else np.zeros((2, body.n_rows, 3, body.lanes)),
    )
    if state.frame is not None:
        start_frames(state.frame, state.displacement, body)
    return state


def _placement_lanes(body: LaneBody, world: FloatArray | None, name: str) -> LaneArray:
    shape = (body.n_copies, body.body.n_nodes, 3)
    if world is None:
        return aligned_zeros((body.n_rows, 3, body.lanes))
    if world.shape != shape or not np.isfinite(world).all():
        raise StateError(
            f"initial {name} of {body.body.name}: got shape {world.shape}, expected {shape} "
            "finite numbers (n_copies, n_nodes, 3)"
        )
    local = np.einsum("cij,cni->cnj", body.body.rotations, world)
    return to_lanes(local, body.rows.order)


def _viscous_state(body: LaneBody) -> ViscousState | None:
    if body.viscosity is None:
        return None
    n_chunks = len(body.viscosity.element_chunks) - 1
    elements = (body.body.mesh.n_elements, body.lanes)
    return ViscousState(
        strain=aligned_zeros(elements),
        stress=aligned_zeros(elements),
        dissipated=sums_of_chunks(n_chunks, body.lanes),
    )


def _elastic_force_before(body: LaneBody) -> ElasticForceBefore:
    n_chunks = len(body.rows.chunks) - 1
    return ElasticForceBefore(
        force=aligned_zeros((body.n_rows, 3, body.lanes)),
        work=sums_of_chunks(n_chunks, 2, body.lanes),
        support_loss=ForceWork(),
    )


def _stiffness_damping_state(body: LaneBody) -> StiffnessDampingState:
    shape = (body.n_rows, 3, body.lanes)
    return StiffnessDampingState(
        elastic=aligned_zeros(shape),
        viscous=aligned_zeros(shape),
        dissipated=np.zeros((len(body.rows.chunks) - 1, body.lanes)),
    )


class CellHold(Interaction):
    """Forces that prevent motions of a periodic cell as a whole.

    Nothing resists a shift of the cell or a turn about its axis, and forces of second order in the
    displacements push along them for ever (`fem.system.system`). Here the same constraint
    as in the static solver is one more term of the step: forces at the nodes of the contacts, the
    motions themselves, so large that loads, contact and internal forces leave the cell as a whole
    at rest.
    """

    def __init__(
        self,
        motions: tuple[FloatArray, ...],
        at_contacts: tuple[FloatArray, ...],
        bodies: tuple[LaneBody, ...],
    ) -> None:
        """Take what `cell_motions` found to lanes."""
        self._all = [_lanes(m, body) for m, body in zip(motions, bodies, strict=True)]
        forces = [_lanes(f, body) for f, body in zip(at_contacts, bodies, strict=True)]
        work = sum(np.einsum("knil,mnil->km", m, f) for m, f in zip(self._all, forces, strict=True))
        self._inverse = np.linalg.inv(work)
        # Rows of the applied force are numbered in the order of the body's rows.
        touched = [np.flatnonzero(_applied_row(body) >= 0) for body in bodies]
        n = len(work)
        applied = [m[:, rows] for m, rows in zip(self._all, touched, strict=True)]
        self._applied = [m.reshape(n, -1) for m in applied]
        self._forces = [f[:, rows].reshape(n, -1) for f, rows in zip(forces, touched, strict=True)]
        self._all = [m.reshape(n, -1) for m in self._all]

    def add_force(self, loop: Loop) -> None:
        """Take from the applied forces what moves the cell as a whole."""
        share = np.zeros(len(self._inverse))
        for body, applied, every in zip(loop.bodies, self._applied, self._all, strict=True):
            assert body.now.applied_force is not None
            share += applied @ body.now.applied_force.ravel()
            # Without block frames K u balances about the reference positions to round-off.
            if body.now.frame is not None:
                share -= every @ placed_internal_force(body).ravel()
        size = self._inverse @ share
        for forces, body in zip(self._forces, loop.bodies, strict=True):
            now = body.now
            assert now.applied_force is not None
            now.applied_force -= (size @ forces).reshape(now.applied_force.shape)


def _lanes(motions: FloatArray, body: LaneBody) -> FloatArray:
    lanes = [to_lanes(motion, body.rows.order) for motion in motions]
    return np.stack(lanes)


def _applied_row(body: LaneBody) -> IntArray:
    assert body.applied_row is not None
    return body.applied_row.astype(np.int64)


def cell_motions(
    stated: TimedSystem,
) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]] | None:
    """Motions of a periodic cell that nothing holds, and those at the nodes of its contacts.

    Of each body in block frames, (n_motions, n_copies, n_nodes, 3); None for what supports hold.
    """
    system = stated.system
    everywhere = unresisted_motions(system)
    contact = np.isin(np.arange(system.n_nodes), system.points.rows)
    at_contacts = unresisted_motions(system, lambda moved: moved * contact[:, None])
    if everywhere is None or at_contacts is None:
        return None

    def of_bodies(motions: FloatArray) -> tuple[FloatArray, ...]:
        slots = [system.slot_of[mine] for mine in stated.blocks]
        return tuple(
            np.stack([motions[:, system.nodes_of(int(slot))] for slot in body], axis=1)
            for body in slots
        )

    return of_bodies(everywhere.motions), of_bodies(at_contacts.motions)
