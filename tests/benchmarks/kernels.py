"""What each kernel of the explicit step does for an element, and how near its limit it is.

Operations and bytes are counted, not measured: each array of copies passes once, stiffness and
gradients are shared by all copies. A fused multiply-add is two operations; a division is one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

from fem.explicit.state import Lanes
from fem.explicit.step import (
    ExplicitSystem,
    add_bulk_viscosity,
    add_stiffness_damping,
    advance,
    set_internal_force,
    stiffness_force,
)
from fem.system.body import Body
from fem.system.effects import BulkViscosity, Effects, RayleighDamping
from tests.benchmarks.roofline import Roofline, Work
from tests.benchmarks.stopwatch import best_cpu_seconds

#: Corners of a hexahedron.
_CORNERS = 8


Kernel: TypeAlias = Callable[[ExplicitSystem, Lanes], None]


@dataclass(frozen=True)
class KernelRow:
    """One kernel on one group, one thread."""

    kernel: str
    nanoseconds: float
    """CPU time of an element update [ns]."""
    flops: float
    """Operations of an element update."""
    bytes: float
    """Bytes of an element update."""
    share_of_roofline: float
    """Rate over what the roofline allows [-]."""


def node_work(group: Body, flops: float, streams: float) -> Work:
    """Work on the nodes: operations of a node, and passes of an array (n_nodes, 3)."""
    nodes = group.n_nodes / group.mesh.n_elements
    return Work(flops * nodes, 24.0 * streams * nodes)


def internal_force_work(group: Body) -> Work:
    """Product K u: reads u and writes f, whose lines are read first."""
    blocks = len(group.stiffness.indices) / group.mesh.n_elements
    stiffness = blocks * (9.0 * 8.0 + 4.0) / group.n_copies
    return node_work(group, 0.0, 3.0) + Work(18.0 * blocks, stiffness)


def update_work(group: Body) -> Work:
    """Central difference: reads f, u and v, writes u and v; a division for each node."""
    return node_work(group, 15.0, 5.0)


def _viscosity_work(group: Body) -> Work:
    """Mean gradients on displacements and on stresses; strain and stress of the elements."""
    gradient = Work(2.0 * 3.0 * _CORNERS, 3.0 * _CORNERS * 8.0 / group.n_copies)
    elements = Work(10.0, 5.0 * 8.0)  # strain and stress read and written, stress read again
    return gradient + gradient + elements + node_work(group, 3.0, 3.0)


def _frame_work(group: Body) -> Work:
    """Moments, the view from the frame, the torque of K u, and the way back."""
    moments = node_work(group, 24.0, 1.0)
    view = node_work(group, 24.0, 3.0)
    torque = node_work(group, 12.0, 0.0)
    return moments + view + torque + node_work(group, 30.0, 2.0)


def kernel_rows(
    group: Body,
    machine: Roofline,
    ready: Callable[[Effects], tuple[ExplicitSystem, Lanes]],
) -> list[KernelRow]:
    """Time the kernels of a step, one thread.

    ``ready`` makes a system of the copies and a state after a few steps, for given effects.
    """
    product = internal_force_work(group)
    viscous = Effects(bulk_viscosity=BulkViscosity())
    damped = replace(viscous, rayleigh=RayleighDamping(None, 1e-8))
    rows: tuple[tuple[str, Effects, Kernel, Work], ...] = (
        ("internal force K u", Effects(), _product, product),
        ("central difference", Effects(), _advance, update_work(group)),
        ("bulk viscosity", viscous, _viscosity, _viscosity_work(group)),
        ("stiffness damping beside it", damped, _damping, node_work(group, 21.0, 7.0)),
        (
            "internal force in block frames",
            Effects(finite_rotation=True),
            _rotating_force,
            product + _frame_work(group),
        ),
    )
    return [
        _row(name, partial(run, *ready(on)), count, group, machine) for name, on, run, count in rows
    ]


def _row(
    name: str, work: Callable[[], None], count: Work, group: Body, machine: Roofline
) -> KernelRow:
    seconds = best_cpu_seconds(work, repeats=10) / (group.mesh.n_elements * group.n_copies)
    share = 1e-6 / seconds / count.limit(machine)
    return KernelRow(name, 1e9 * seconds, count.flops, count.bytes, share)


def _product(system: ExplicitSystem, state: Lanes) -> None:
    body, now = system.bodies[0], state.bodies[0]
    stiffness_force(body, now.displacement, now.internal_force, system.kernels)


def _advance(system: ExplicitSystem, state: Lanes) -> None:
    advance(system, system.bodies[0], state.bodies[0], None, None, sample=False)


def _viscosity(system: ExplicitSystem, state: Lanes) -> None:
    now = state.bodies[0]
    add_bulk_viscosity(system, system.bodies[0], now, now.displacement, None)


def _damping(system: ExplicitSystem, state: Lanes) -> None:
    add_stiffness_damping(system, system.bodies[0], state.bodies[0])


def _rotating_force(system: ExplicitSystem, state: Lanes) -> None:
    set_internal_force(system, system.bodies[0], state.bodies[0], sample=False)


def table(rows: list[KernelRow]) -> list[str]:
    """Rows as lines of text."""
    lines = ["", "kernel                          ns/element  flops  bytes  of the roofline"]
    lines += [
        f"{row.kernel:31s} {row.nanoseconds:10.2f} {row.flops:6.0f} {row.bytes:6.0f} "
        f"{100 * row.share_of_roofline:14.0f} %"
        for row in rows
    ]
    return lines
