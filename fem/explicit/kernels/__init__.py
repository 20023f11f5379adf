"""The compiled loops of the explicit solver.

Arrays are [row][component][copy] (`fem.explicit.kernels.layout`), copies are SIMD lanes. Every
kernel has a plain twin in `fem.explicit.kernels.reference`, with which the tests compare it.

An argument that is None removes its branch when the kernel is compiled: an effect that is off
is not in the machine code. Rows are worked in fixed chunks and each chunk writes its own rows
and its own partial sums, so one and two threads give the same bits.

Loops over chunks are compiled twice from one source (`fem.explicit.kernels.forms`), for one thread
and for several; those of `motion` and `stiffness` are written out, for `validation.effects.proof`
reads their source.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fem.explicit.kernels import damping, frame, viscosity
from fem.explicit.kernels.frame import fit_frames
from fem.explicit.kernels.motion import (
    dot_lanes,
    enforce,
    update,
    update_parallel,
    viscous_power,
)
from fem.explicit.kernels.runs import add_at, dot_at, hold
from fem.explicit.kernels.stiffness import (
    stiffness_product,
    stiffness_product_parallel,
)

__all__ = [
    "PARALLEL",
    "SERIAL",
    "KernelSet",
    "add_at",
    "add_stiffness_damping",
    "add_stiffness_damping_parallel",
    "add_viscous_force",
    "add_viscous_force_parallel",
    "block_frame_displacement",
    "block_frame_displacement_parallel",
    "displacement_moments",
    "displacement_moments_parallel",
    "dot_at",
    "dot_lanes",
    "enforce",
    "fit_frames",
    "hold",
    "placement_frame_force",
    "placement_frame_force_parallel",
    "stiffness_product",
    "stiffness_product_parallel",
    "update",
    "update_parallel",
    "viscous_power",
    "viscous_pressure",
    "viscous_pressure_parallel",
]

add_stiffness_damping, add_stiffness_damping_parallel = damping.add_stiffness_damping
add_viscous_force, add_viscous_force_parallel = viscosity.add_viscous_force
viscous_pressure, viscous_pressure_parallel = viscosity.viscous_pressure
displacement_moments, displacement_moments_parallel = frame.displacement_moments
block_frame_displacement, block_frame_displacement_parallel = frame.block_frame_displacement
placement_frame_force, placement_frame_force_parallel = frame.placement_frame_force


@dataclass(frozen=True)
class KernelSet:
    """The kernels that share rows among threads, in one of their two forms."""

    stiffness_product: Callable[..., None]
    update: Callable[..., None]
    viscous_pressure: Callable[..., None]
    add_viscous_force: Callable[..., None]
    add_stiffness_damping: Callable[..., None]
    displacement_moments: Callable[..., None]
    block_frame_displacement: Callable[..., None]
    placement_frame_force: Callable[..., None]


SERIAL = KernelSet(
    stiffness_product=stiffness_product,
    update=update,
    viscous_pressure=viscous_pressure,
    add_viscous_force=add_viscous_force,
    add_stiffness_damping=add_stiffness_damping,
    displacement_moments=displacement_moments,
    block_frame_displacement=block_frame_displacement,
    placement_frame_force=placement_frame_force,
)
PARALLEL = KernelSet(
    stiffness_product=stiffness_product_parallel,
    update=update_parallel,
    viscous_pressure=viscous_pressure_parallel,
    add_viscous_force=add_viscous_force_parallel,
    add_stiffness_damping=add_stiffness_damping_parallel,
    displacement_moments=displacement_moments_parallel,
    block_frame_displacement=block_frame_displacement_parallel,
    placement_frame_force=placement_frame_force_parallel,
)
