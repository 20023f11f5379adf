"""Periodic cells in explicit runs: what keeps the cell as a whole where it is."""

from __future__ import annotations

import numpy as np

from fem.explicit.body import LaneBody
from fem.explicit.kernels.layout import to_lanes
from fem.explicit.step import Interaction, Loop, placed_internal_force
from fem.explicit.timed import TimedSystem
from fem.system.loose import unresisted_motions
from geometry.mesh import FloatArray, IntArray


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

    def by_group(motions: FloatArray) -> tuple[FloatArray, ...]:
        slots = [system.slot_of[mine] for mine in stated.blocks]
        return tuple(
            np.stack([motions[:, system.nodes_of(int(slot))] for slot in body], axis=1)
            for body in slots
        )

    return by_group(everywhere.motions), by_group(at_contacts.motions)
