"""What evolves in an explicit run."""

from __future__ import annotations

from dataclasses import dataclass, field

from fem.explicit.kernels.layout import LaneArray
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
    """(n_chunks, ≥ lanes) [N mm]"""


@dataclass
class ElasticForceBefore:
    """What stiffness-proportional damping needs when `update` makes its force in passing."""

    force: LaneArray
    """K u of the last step, (n_rows, 3, lanes) [N]."""
    work: FloatArray
    """See `fem.explicit.kernels.motion.update`, (n_chunks, 2, ≥ lanes), per unit of time step."""
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
    """Loads of the last step."""

    force: LaneArray
    """(n_applied, 3, lanes) [N]"""
    factor: FloatArray
    """Amplitudes that it has, (n_loads,); NaN: none yet."""
    work: FloatArray
    """(n_chunks, 2, ≥ lanes): see `fem.explicit.kernels.motion.update`."""


@dataclass
class BlockFrame:
    """Frames of all copies and the displacement seen from them; evolves."""

    quaternion: FloatArray
    """Rotation of each copy relative to its placement (w, x, y, z), (lanes, 4)."""
    placing: LaneArray
    """Q - 1, then ψ [mm/s² per mm], (4, 3, lanes)."""
    mean: LaneArray
    """Displacement of the mass centroid, (3, lanes) [mm]."""
    compliance: FloatArray
    """(tr S · 1 - S)⁻¹, (3, 3, lanes)."""
    local: LaneArray
    """u', (n_rows, 3, lanes) [mm]."""
    increment: LaneArray | None
    """Change of u' in the last step, kept where an effect needs it."""
    torque: LaneArray
    """Partial sums of u' × f, (n_chunks, 3, lanes)."""
    moment: LaneArray
    """Partial sums of the fit, (n_chunks, 12, lanes)."""

    @property
    def turn(self) -> LaneArray:
        """Q - 1, (3, 3, lanes)."""
        return self.placing[:3]


@dataclass
class BodyState:
    """Arrays of one body, placement frame, (n_rows, 3, lanes)."""

    displacement: LaneArray
    """At the time of the state [mm]."""
    velocity: LaneArray
    """Half a step earlier [mm/s]."""
    internal_force: LaneArray
    """Of the last step [N], in the block frame where there is one; without the damping force where
    there is `elastic_before`."""
    applied_force: LaneArray | None
    """Loads and contact of the last step, (n_applied, 3, lanes) [N]; where only loads act, the
    array of `loads`."""
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
    """With mass-proportional damping, (n_chunks, 2, ≥ lanes): see `update`."""
    remembered: FloatArray | None
    """With adaptive damping: displacement and restoring force, (2, n_rows, 3, lanes)."""
    external_work: ForceWork = field(default_factory=ForceWork)
    """Of gravity that changes in time; correction of the work of loads at supported nodes."""
    support_work: ForceWork = field(default_factory=ForceWork)
    """Of moving supports."""
    support_loss: ForceWork = field(default_factory=ForceWork)
    """Correction of the mass-damping dissipation at supported nodes."""

    @property
    def local_displacement(self) -> LaneArray:
        """Displacement that strains the block: in its frame, or the displacement itself."""
        return self.displacement if self.frame is None else self.frame.local
