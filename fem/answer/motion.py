"""How far blocks of a state move: displacements, turns, slips, and blocks that nothing holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fem.state import State, once
from fem.system.contact_state import corner_displacements
from fem.system.loose import loose_blocks
from geometry.mesh import FloatArray, IntArray

if TYPE_CHECKING:
    from fem.explicit.setup.quasi_static import QuasiStaticReport

#: Blocks move far where their displacement is this share of their size: relative errors of a
#: geometry that stays as built are as large.
_FAR = 0.05
#: Of sums of time steps [-].
_ROUND_OFF = 1e-9


def largest_turn(state: State) -> float:
    """Largest angle by which a block turns, of the nearest rigid motion [rad]."""
    largest = 0.0
    for body, moved in zip(state.whole.bodies, state.displacements, strict=True):
        arm = body.mesh.nodes - body.mesh.nodes.mean(axis=0)
        gradients = np.einsum("cni,nj->cij", moved, np.linalg.pinv(arm).T)
        spins = 0.5 * (gradients - gradients.transpose(0, 2, 1))
        turns = np.linalg.norm(spins, axis=(1, 2)) / np.sqrt(2.0)
        largest = max(largest, float(turns.max(initial=0.0)))
    return largest


def turns_as_small(state: State) -> bool:
    """Whether a block turns by an angle that is not small, and it is counted as if it were."""
    return not state.finite_rotation and largest_turn(state) > _FAR


def large_motion(state: State) -> float | None:
    """Largest displacement over the size of blocks that meet [-]; None where it is small.

    None as well where it is counted as it is: with finite sliding, and with finite rotation or
    of blocks that hardly turn.
    """
    whole = state.whole
    if not whole.meets or (whole.contact.finite_sliding and not turns_as_small(state)):
        return None
    share = state.largest_displacement / whole.assembly.characteristic_length
    return share if share > _FAR else None


def slip(state: State) -> dict[str, float] | None:
    """Largest slip between facets that press and the size of its facet [mm].

    None where facets are searched. Facets that stay paired as built give no answer beyond a
    slip of one facet.
    """
    whole, contact = state.whole, state.contact_state
    if whole.contact.finite_sliding or not contact.n_facets:
        return None
    surfaces, pressing = whole.surfaces, contact.pressures > 0.0
    on_m, on_s = np.split(corner_displacements(whole, state.displacements), 2, axis=1)
    jump: FloatArray = on_s - on_m
    normal = surfaces.normals.mean(axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    along = np.einsum("fai,fi->fa", jump, normal)
    slips = np.linalg.norm(jump - along[:, :, None] * normal[:, None], axis=2).max(axis=1)
    size = np.sqrt(surfaces.areas)
    worst = int(np.argmax(np.where(pressing, slips / size, 0.0)))
    largest = float(slips[worst]) if pressing.any() else 0.0
    return {"largest": largest, "facet_size": float(size[worst])}


def unrestrained_blocks(state: State) -> IntArray:
    """Blocks that no pressing contact holds in every direction, (n,).

    Pressures are determined, the places of these blocks are not. Not judged: friction, and
    explicit runs with searched facets or to another end than the static state.
    """
    contact = state.whole.contact
    if state.run is None:
        return state.evidence.loose_blocks
    stated = state.run.stated
    if stated.times.recommended is None or contact.friction is not None or contact.finite_sliding:
        return np.zeros(0, dtype=np.int64)
    everyone = np.arange(state.whole.assembly.n_blocks)
    where = state.whole, state.displacements
    return loose_blocks(*where, state.pressures, state.points, everyone)


def reached(state: State) -> bool:
    """Whether supports that move have arrived where they are prescribed."""
    if state.run is None:
        return state.evidence.stopped is None
    arrival = state.run.stated.times.settled if state.whole.supports.tables else 0.0
    return state.run.time >= (1.0 - _ROUND_OFF) * arrival


@once
def quasi_static(state: State) -> QuasiStaticReport | None:
    """How static the end of an explicit run is; None where nothing recommends a frequency."""
    if state.run is None:
        return None
    # Loaded here: it brings the compiler along, which static runs do without.
    from fem.explicit.setup.quasi_static import quasi_static_report

    return quasi_static_report(state)
