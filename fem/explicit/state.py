"""What evolves in an explicit run."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from fem.contact.search import SearchedPoints
from fem.explicit.block_frame import BlockFrame, block_frame, start_frames
from fem.explicit.body import LaneBody
from fem.explicit.kernels import KernelSet
from fem.explicit.kernels.layout import LaneArray, aligned_zeros, from_lanes, to_lanes
from fem.explicit.timed import TimedSystem
from fem.system.effects import Effects
from geometry.errors import RefusedError
from geometry.mesh import FloatArray


class StateError(RefusedError):
    """An initial state that does not fit the model."""


@dataclass
class ForceWork:
    """Work of a force, summed step by step with the mean of the two half-step velocities."""

    total: float = 0.0
    """Up to the half step after the last force [N mm]."""
    latest_before: float = 0.0
    """The part of the last step before the time of the force [N mm]."""
    latest_after: float = 0.0
    """The part of the last step after it [N mm]."""

    def add(self, before: float, after: float) -> None:
        """Add the work of one step, in its halves before and after the time of the force."""
        self.total += before + after
        self.latest_before = before
        self.latest_after = after

    @property
    def now(self) -> float:
        """Work up to the time of the last force [N mm]."""
        return self.total - self.latest_after


@dataclass
class ViscousState:
    """Volumetric strain and viscous stress of the elements."""

    strain: LaneArray
    """(n_elements, lanes)"""
    stress: LaneArray
    """Volume times viscous stress, (n_elements, lanes) [N mm]."""
    dissipated: FloatArray
    """(n_chunks, lanes) [N mm]"""


@dataclass
class ElasticForceBefore:
    """What stiffness-proportional damping needs when `update` makes its force in passing."""

    force: LaneArray
    """K u of the last step, (n_rows, 3, lanes) [N]."""
    work: FloatArray
    """See `fem.explicit.kernels.motion.update`, (n_chunks, 2, lanes), per unit of time step."""
    support_loss: ForceWork
    """Correction of the dissipation at supported nodes."""


@dataclass
class StiffnessDampingState:
    """Elastic forces of the last step, from which β K v follows, where more is added to K u."""

    elastic: LaneArray
    """K u of the last step, (n_rows, 3, lanes) [N]."""
    viscous: LaneArray
    """Damping force of the last step, (n_rows, 3, lanes) [N]."""
    dissipated: FloatArray
    """(n_chunks, lanes) [N mm] with block frames, else per unit of time step."""


@dataclass
class LoadState:
    """Loads of the last step, cached."""

    factor: FloatArray
    """Amplitudes that the applied force holds, (n_loads,); NaN: none yet."""
    power: FloatArray
    """Power at amplitude one and the velocity of the state, (n_loads,) [N mm/s]; NaN: not yet."""


@dataclass
class BodyState:
    """Arrays of one group, placement frame, (n_rows, 3, lanes)."""

    displacement: LaneArray
    """At the time of the state [mm]."""
    velocity: LaneArray
    """Half a step earlier [mm/s]."""
    internal_force: LaneArray
    """Of the last step [N], in the block frame where there is one; without the damping force where
    there is `elastic_before`."""
    applied_force: LaneArray | None
    """Loads and contact of the last step, (n_applied, 3, lanes) [N]."""
    loads: LoadState | None
    """Where there are loads."""
    momentum: LaneArray | None
    """With a gravity that changes in time: of every copy at the velocity of the state, (3 lanes,)
    [N s]; NaN: not yet."""
    kinetic: FloatArray
    """Partial sums of the kinetic energy at the last sample, (n_chunks, lanes) [N mm]."""
    strain_energy: FloatArray
    """At the last sample, (lanes,) [N mm]."""
    frame: BlockFrame | None
    """Block frames, with finite rotation."""
    viscous: ViscousState | None
    """With bulk viscosity."""
    stiffness_damping: StiffnessDampingState | None
    """With stiffness-proportional damping and block frames or bulk viscosity."""
    elastic_before: ElasticForceBefore | None
    """With stiffness-proportional damping and neither."""
    mass_damping_work: FloatArray | None
    """With mass-proportional damping, (n_chunks, 2, lanes): see `update`."""
    remembered: FloatArray | None
    """With adaptive damping: displacement and restoring force, (2, n_rows, 3, lanes)."""
    external_work: ForceWork = field(default_factory=ForceWork)
    """Of the loads."""
    support_work: ForceWork = field(default_factory=ForceWork)
    """Of moving supports."""
    support_loss: ForceWork = field(default_factory=ForceWork)
    """Correction of the mass-damping dissipation at supported nodes."""

    @property
    def local_displacement(self) -> LaneArray:
        """Displacement that strains the block: in its frame, or the displacement itself."""
        return self.displacement if self.frame is None else self.frame.local


class Interaction(ABC):
    """Forces between blocks (contact), one more term of the step; has arrays of its own."""

    @abstractmethod
    def add_force(self, loop: Loop) -> None:
        """Add forces of the current positions to the applied forces of the bodies."""

    def touched_points(self) -> float:
        """Points of contact, counted as `geometry.machine.work.Operation.TOUCH`."""
        return 0.0

    def energy(self) -> float:
        """Energy stored at the last force evaluation [N mm]."""
        return 0.0

    def dissipation(self) -> float:
        """Energy dissipated up to the last force evaluation [N mm]."""
        return 0.0

    def contact(self, moved: FloatArray) -> tuple[SearchedPoints | None, FloatArray | None]:  # noqa: ARG002 - most have none
        """Points that a search found, and friction on block s, of the last force evaluation.

        At ``moved``, displacements of the nodes of the system, (n_nodes, 3) [mm]. Friction is that
        of all points, world axes, (n_facets, n_points, 3) [MPa]; None: absent.
        """
        return None, None

    def fault(self, loop: Loop) -> str | None:  # noqa: ARG002 - most have none
        """What makes the run unstable and what to do, where the time step is too large; or None."""
        return None

    def arrays(self) -> dict[str, LaneArray]:
        """Arrays that evolve and must be in a checkpoint, by name; written in place."""
        return {}


@dataclass
class Loop:
    """What is stepped: constants, the arrays that change, and where they are in time."""

    stated: TimedSystem
    """What is computed."""
    bodies: tuple[LaneBody, ...]
    """Its groups in lanes, each with its state."""
    time_step: float
    """[s]"""
    kernels: KernelSet
    """Serial or parallel loops."""
    interactions: tuple[Interaction, ...] = ()
    """Contact; empty when blocks do not meet."""
    step: int = 0
    """Steps done."""
    mass_damping: float | None = None
    """Current mass-proportional coefficient [1/s]."""

    @property
    def time(self) -> float:
        """Time of the displacements [s]."""
        return self.step * self.time_step


def initial_body_state(
    body: LaneBody,
    effects: Effects,
    displacement: FloatArray | None = None,
    velocity: FloatArray | None = None,
) -> BodyState:
    """State of one group at time 0, before the first force; effects say which arrays are needed.

    Displacement and velocity are world components, (n_copies, n_nodes, 3) [mm], [mm/s]; None: zero.
    """
    shape = (body.n_rows, 3, body.lanes)
    n_chunks = len(body.rows.chunks) - 1
    damped = effects.stiffness_damping is not None
    alone = not effects.finite_rotation and body.viscosity is None
    mass_damped = effects.mass_damping is not None or effects.adaptive_mass_damping is not None
    state = BodyState(
        displacement=_placement_lanes(body, displacement, "displacement"),
        velocity=_placement_lanes(body, velocity, "velocity"),
        internal_force=aligned_zeros(shape),
        applied_force=None
        if body.applied_row is None
        else aligned_zeros((body.n_applied, 3, body.lanes)),
        loads=LoadState(*np.full((2, len(body.loads)), np.nan)) if body.loads else None,
        momentum=None
        if body.acceleration is None or effects.gravity_amplitude is None
        else np.full(3 * body.lanes, np.nan),
        kinetic=np.zeros((n_chunks, body.lanes)),
        strain_energy=np.zeros(body.lanes),
        frame=block_frame(body, keep_increment=damped) if effects.finite_rotation else None,
        viscous=_viscous_state(body),
        stiffness_damping=_stiffness_damping_state(body) if damped and not alone else None,
        elastic_before=_elastic_force_before(body) if damped and alone else None,
        mass_damping_work=np.zeros((n_chunks, 2, body.lanes)) if mass_damped else None,
        remembered=None
        if effects.adaptive_mass_damping is None
        else np.zeros((2, body.n_rows, 3, body.lanes)),
    )
    if state.frame is not None:
        start_frames(state.frame, state.displacement, body)
    return state


def _placement_lanes(body: LaneBody, world: FloatArray | None, name: str) -> LaneArray:
    shape = (body.n_copies, body.group.n_nodes, 3)
    if world is None:
        return aligned_zeros((body.n_rows, 3, body.lanes))
    if world.shape != shape or not np.isfinite(world).all():
        raise StateError(
            f"initial {name} of {body.group.name}: got shape {world.shape}, expected {shape} "
            "finite numbers (n_copies, n_nodes, 3)"
        )
    local = np.einsum("cij,cni->cnj", body.group.rotations, world)
    return to_lanes(local, body.rows.order)


def _viscous_state(body: LaneBody) -> ViscousState | None:
    if body.viscosity is None:
        return None
    n_chunks = len(body.viscosity.element_chunks) - 1
    elements = (body.group.mesh.n_elements, body.lanes)
    return ViscousState(
        strain=aligned_zeros(elements),
        stress=aligned_zeros(elements),
        dissipated=np.zeros((n_chunks, body.lanes)),
    )


def _elastic_force_before(body: LaneBody) -> ElasticForceBefore:
    n_chunks = len(body.rows.chunks) - 1
    return ElasticForceBefore(
        force=aligned_zeros((body.n_rows, 3, body.lanes)),
        work=np.zeros((n_chunks, 2, body.lanes)),
        support_loss=ForceWork(),
    )


def _stiffness_damping_state(body: LaneBody) -> StiffnessDampingState:
    shape = (body.n_rows, 3, body.lanes)
    return StiffnessDampingState(
        elastic=aligned_zeros(shape),
        viscous=aligned_zeros(shape),
        dissipated=np.zeros((len(body.rows.chunks) - 1, body.lanes)),
    )


def world_vectors(body: LaneBody, lanes: LaneArray) -> FloatArray:
    """Placement-frame lanes (n_rows, 3, lanes) as world vectors, (n_copies, n_nodes, 3)."""
    local = from_lanes(lanes, body.rows.row, body.n_copies)
    return np.einsum("cij,cnj->cni", body.group.rotations, local)
