"""The explicit problem of deformable blocks and the times of its run, stated once.

Times that nobody gives are those that the lowest excited frequency recommends. Of single bodies
no static state is expected: nothing is recommended, and the ramp takes half of the run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fem.assembly.deformable import ALL_THE_WAY, DeformableAssembly
from fem.assembly.statement import Motion
from fem.assembly.symmetry import Orbits, largest_cyclic_orbits, require_sector
from fem.contact.surfaces import refuse_overlap
from fem.explicit.setup.assembly import (
    COUNTED_PRESSURE,
    ExplicitAssembly,
    counted_stiffness,
    explicit_assembly,
)
from fem.explicit.setup.quasi_static import (
    FRACTION_WHILE_LOADING,
    RecommendedTimes,
    recommended_times,
)
from fem.problem.effects import Effects
from fem.problem.loads import SmoothStepAmplitude, TabularAmplitude
from fem.problem.time_step import TimeStepError, scale_masses
from geometry.mesh import FloatArray

#: Contact pressures that the critical time step counts in, one after the other [MPa].
_COUNTED_PRESSURES = tuple(COUNTED_PRESSURE * 4.0**k for k in range(6))

#: Gaps beyond this part of the size of a block are no rounding of single precision.
_APART = 1e-6


@dataclass(frozen=True)
class ExplicitStatement:
    """The explicit problem of an assembly and the times of its run."""

    assembly: ExplicitAssembly
    """Representative blocks with loads, effects and contact."""
    recommended: RecommendedTimes | None
    """Times recommended by the lowest excited frequency; None for single bodies."""
    ramp_time: float
    """Duration of the smooth step of the loads [s]."""
    end_time: float
    """Latest end of the run [s]."""
    counted_pressure: float
    """Pressure whose contact stiffness the critical time step counts in where no cap is
    below it [MPa]."""

    velocities: tuple[FloatArray, ...] | None = None
    """Of the model's groups at time 0, (n_copies, n_nodes, 3) [mm/s]; None: at rest."""
    settled_after: float = 0.0
    """When loads and supports have arrived: a static state may be found from then on [s]."""

    def more_counted(self) -> float | None:
        """Next contact pressure to count in [MPa]; None where more of it counts no more stiffness.

        A run whose contact outgrows its time step starts again with it.
        """
        law = self.assembly.deformable.contact.law
        now = counted_stiffness(law, self.counted_pressure)
        more = (p for p in _COUNTED_PRESSURES if p > self.counted_pressure)
        return next((p for p in more if counted_stiffness(law, p) > now), None)


def explicit_statement(
    deformable: DeformableAssembly,
    *,
    effects: Effects,
    symmetry: Literal["auto", "none", "sector"] = "auto",
    ramp_time: float | None = None,
    end_time: float | None = None,
    mass_scaling: float | None = None,
    counted_pressure: float = COUNTED_PRESSURE,
    motion: Motion | None = None,
) -> ExplicitStatement:
    """State the explicit problem of an assembly.

    Parameters
    ----------
    deformable
        Blocks, loads, supports, contact.
    effects
        Damping and rotation.
    symmetry
        ``none``: every block is computed; ``sector``: it must be possible that one block of each
        layer stands for all; else that is done where it is exact.
    ramp_time, end_time
        [s]; None: recommended. The load stays as long after another ramp.
    mass_scaling
        Step that every element is to allow, over the shortest; None: absent.
    counted_pressure
        Pressure whose contact stiffness the critical time step counts in [MPa].
    motion
        Of every block at time 0; None: at rest.

    Raises
    ------
    SymmetryError
        A sector that is none.
    TimeStepError
        Single bodies without an end.
    ContactError, EffectError, FrictionError, ModelError, TimeStepError
        If the model, a load or an option is not valid for an explicit run.
    """
    if mass_scaling is not None:
        deformable = replace(deformable, model=scale_masses(deformable.model, mass_scaling))
    whole = symmetry == "none" or not deformable.meets
    orbits = None if whole else largest_cyclic_orbits(deformable)
    if symmetry == "sector":
        require_sector(deformable)
    times, ramp, end = _times(deformable, orbits, effects, ramp_time, end_time)
    moved = _end_of_motion(deformable, ramp)
    if end_time is None:
        end += max(moved - ramp, 0.0)
    effects = _loading_slowly(effects, deformable, ramp)
    # What presses before any load acts is counted too.
    before = -deformable.surfaces.clearance
    at_start = max(float(law.pressure(before)) for law in deformable.contact.law.members)
    counted_pressure = max(counted_pressure, 2.0 * at_start)
    stated = explicit_assembly(
        deformable,
        orbits=orbits,
        effects=effects,
        amplitude=SmoothStepAmplitude(ramp) if ramp > 0 else None,
        counted_pressure=counted_pressure,
    )
    velocities = None if motion is None else motion.velocities(stated.model)
    return ExplicitStatement(
        stated, times, ramp, end, counted_pressure, velocities, settled_after=max(ramp, moved)
    )


def _end_of_motion(deformable: DeformableAssembly, ramp: float) -> float:
    """When supports that move have arrived [s]; 0 without any."""
    moving = [s.amplitude for s in deformable.model.supports if s.displacement.any()]
    if ramp <= 0.0 and any(share is ALL_THE_WAY for share in moving):
        raise TimeStepError(
            "fem.ramp_time: got 0 with a support that moves; expected the time of its smooth "
            "step in seconds, or a table of its motion"
        )
    ends = [s.times[-1] for s in moving if isinstance(s, TabularAmplitude) and s is not ALL_THE_WAY]
    return max(ends, default=0.0)


def _loading_slowly(effects: Effects, deformable: DeformableAssembly, ramp: float) -> Effects:
    """Less adaptive damping while the load grows, where friction remembers what drags."""
    adaptive = effects.adaptive_mass_damping
    if adaptive is None or deformable.contact.friction is None:
        return effects
    slow = replace(adaptive, loading_time=ramp, fraction_while_loading=FRACTION_WHILE_LOADING)
    return replace(effects, adaptive_mass_damping=slow)


def _times(
    deformable: DeformableAssembly,
    orbits: Orbits | None,
    effects: Effects,
    ramp_time: float | None,
    end_time: float | None,
) -> tuple[RecommendedTimes | None, float, float]:
    """Times that are recommended, where any are; ramp and end of the run [s]."""
    if not deformable.meets:
        if end_time is None:
            raise TimeStepError(
                "fem.end_time is missing: an explicit run of single bodies needs its end in seconds"
            )
        return None, 0.5 * end_time if ramp_time is None else ramp_time, end_time
    plain = explicit_assembly(deformable, orbits=orbits, effects=effects)
    if plain.sliding is not None:
        start = plain.sliding.at_start
        reach = deformable.contact.law.allowed_overclosure(deformable.surfaces.clearance)
        refuse_overlap(start.block_m, start.block_s, start.deepest, reach)
    closing = _apart(deformable, plain)
    damped = effects.adaptive_mass_damping is not None
    times = recommended_times(plain.model, damped=damped, closing=closing)
    ramp = times.ramp_time if ramp_time is None else ramp_time
    return times, ramp, ramp + times.end_time - times.ramp_time if end_time is None else end_time


def _apart(deformable: DeformableAssembly, plain: ExplicitAssembly) -> bool:
    """Whether two blocks that face each other are apart before any load acts.

    A clearance, a spacing or the placement of the blocks makes the gap. With a search, a free block
    that faces nothing is apart as well.
    """
    if plain.sliding is None:
        state = deformable.surfaces
        block_m, block_s, gaps = state.block_m, state.block_s, state.initial_gaps.min(axis=1)
    else:
        start = plain.sliding.at_start
        block_m, block_s, gaps = start.block_m, start.block_s, -start.deepest
        moving = [s.block for s in plain.sliding.surfaces if s.group >= 0]
        if not np.isin(moving, np.concatenate([block_m, block_s])).all():
            return True
    pairs = np.column_stack([np.minimum(block_m, block_s), np.maximum(block_m, block_s)])
    _, joint = np.unique(pairs, axis=0, return_inverse=True)
    smallest = np.full(joint.max(initial=-1) + 1, np.inf)
    np.minimum.at(smallest, joint.ravel(), gaps)
    return bool((smallest > _APART * deformable.assembly.characteristic_length).any())
