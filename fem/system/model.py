"""Loads and supports at nodes of bodies, and forces between bodies.

Everything here is constant; what evolves is `fem.explicit.state.Lanes`. World axes, mm, N, t, s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from fem.system.body import Body, ModelError
from geometry.mesh import FloatArray, IntArray

Amplitude = Callable[[float], float]
"""Factor of a load or a displacement as a function of time [s]."""


@dataclass(frozen=True)
class Support:
    """Prescribed displacement components of nodes of one group, in world axes.

    Entry k prescribes n_k · u = amplitude(t) · displacement_k at node ``nodes[k]`` of copy
    ``copies[k]``; the directions n_k of one node are orthonormal.
    """

    group: int
    """Number of the group in the model."""
    copies: IntArray
    """(n,)"""
    nodes: IntArray
    """(n,)"""
    directions: FloatArray
    """Unit vectors in world axes, (n, 3)."""
    displacement: FloatArray
    """(n,) [mm] at amplitude one."""
    amplitude: Amplitude | None = None
    """None: constant in time."""
    name: str = "support"
    """In tables of reactions; entries of one name are one support."""


def fixed_nodes(
    group: int,
    nodes: IntArray,
    *,
    copies: Sequence[int] | IntArray = (0,),
    components: tuple[int, ...] = (0, 1, 2),
    displacement: FloatArray | None = None,
    amplitude: Amplitude | None = None,
    name: str = "support",
) -> Support:
    """Hold, or move along a world vector, the same nodes in every one of ``copies``.

    Parameters
    ----------
    group
        Number of the group.
    nodes
        Node numbers in the reference mesh, (n,).
    copies
        Copies that are held.
    components
        World components that are prescribed; the others are free.
    displacement
        (3,) [mm]; None holds the nodes where they are.
    amplitude
        Factor of the displacement in time.
    name
        In tables of reactions.
    """
    where = [
        a.ravel()
        for a in np.meshgrid(np.asarray(copies), np.asarray(nodes), components, indexing="ij")
    ]
    value = np.zeros(3) if displacement is None else np.asarray(displacement, dtype=np.float64)
    return Support(
        group=group,
        copies=where[0].astype(np.int64),
        nodes=where[1].astype(np.int64),
        directions=np.eye(3)[where[2]],
        displacement=value[where[2]],
        amplitude=amplitude,
        name=name,
    )


@dataclass(frozen=True)
class NodalLoad:
    """Forces on nodes of one group, amplitude(t) · forces, in world axes."""

    group: int
    """Number of the group in the model."""
    copies: IntArray
    """(n,)"""
    nodes: IntArray
    """(n,)"""
    forces: FloatArray
    """(n, 3) [N] at amplitude one."""
    amplitude: Amplitude | None = None
    """None: constant in time from the first step on."""
    follows_block: bool = False
    """Whether the forces turn with the frame of their block (needs finite rotation)."""


def nodal_load(
    group: int,
    forces: FloatArray,
    *,
    copies: Sequence[int] | IntArray = (0,),
    amplitude: Amplitude | None = None,
    follows_block: bool = False,
) -> NodalLoad:
    """Load the same nodes of every one of ``copies`` by dense nodal forces; see `NodalLoad`.

    Forces are (n_nodes, 3) on each copy, or (n_copies, n_nodes, 3), world axes [N]; zero rows are
    dropped.
    """
    copies = np.asarray(copies, dtype=np.int64)
    dense = np.broadcast_to(forces, (len(copies), *np.shape(forces)[-2:]))
    k, node = np.nonzero(np.any(dense != 0.0, axis=2))
    return NodalLoad(
        group, copies[k], node.astype(np.int64), dense[k, node], amplitude, follows_block
    )


class InteractionModel(Protocol):
    """Statement of forces between blocks, such as contact; frozen."""

    def touched_nodes(self, group: int) -> IntArray:
        """Nodes of the group's mesh on which forces may act, (n,)."""

    def nodal_stiffness(self, group: int) -> FloatArray | None:
        """Stiffness to count on each node for the critical time step, (n_nodes,) [N/mm]."""

    def bind(self, bodies: Any) -> Any:
        """Prepare the force for the loop: a `fem.explicit.step.Interaction` of its bodies."""


def check_statement(
    bodies: Sequence[Body], supports: Sequence[Support], loads: Sequence[NodalLoad]
) -> None:
    """Reject supports and loads that bodies do not have."""
    for k, support in enumerate(supports):
        _check_entries(bodies, f"support {k}", support)
        _check_support(k, support)
    for k, load in enumerate(loads):
        _check_entries(bodies, f"load {k}", load)
        if not np.isfinite(load.forces).all():
            raise ModelError(f"load {k}: got a force that is not finite")
    if any(load.follows_block for load in loads):
        refuse_turning_springs(bodies)


def refuse_turning_springs(groups: Sequence[Body]) -> None:
    """Reject springs of blocks that may turn by any angle."""
    if any(group.springs is not None for group in groups):
        raise ModelError(
            "springs: got blocks that may turn by any angle, which springs to the ground do not "
            "follow; expected small rotations (finite_rotation off, pressures that do not turn "
            "with their block)"
        )


def _check_entries(bodies: Sequence[Body], what: str, entries: Support | NodalLoad) -> None:
    if not 0 <= entries.group < len(bodies):
        raise ModelError(f"{what}: got group {entries.group}, expected 0 to {len(bodies) - 1}")
    body = bodies[entries.group]
    for name, of, end in (
        ("copy", entries.copies, body.n_copies),
        ("node", entries.nodes, body.n_nodes),
    ):
        if len(of) and not (of.min() >= 0 and of.max() < end):
            raise ModelError(
                f"{what}: got {name} {int(of.min())} to {int(of.max())}, expected "
                f"0 to {end - 1} of {body.name}"
            )


def _check_support(k: int, support: Support) -> None:
    if not (np.isfinite(support.displacement).all() and np.isfinite(support.directions).all()):
        raise ModelError(f"support {k}: got a displacement or direction that is not finite")
    start = 0.0 if support.amplitude is None else support.amplitude(0.0)
    if support.displacement.any() and (support.amplitude is None or abs(start) > 1e-12):
        raise ModelError(
            f"support {k}: the prescribed displacement jumps at time 0; expected an amplitude "
            "that starts from zero, such as a smooth step"
        )
