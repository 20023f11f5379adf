"""A cantilever with every effect."""

from __future__ import annotations

import numpy as np

from fem.explicit.timed import TimedSystem
from fem.system.body import placed_body
from fem.system.effects import (
    AdaptiveMassDamping,
    BulkViscosity,
    Effects,
    RayleighDamping,
)
from fem.system.rows import SmoothStepAmplitude
from geometry.block import box_block
from tests.support.fem_problems import CONCRETE
from tests.support.lone_bodies import fixed_nodes, lone_bodies, nodal_load

MESH = box_block((40.0, 8.0, 8.0), (6, 2, 2)).mesh


HELD = np.flatnonzero(MESH.nodes[:, 0] == 0.0)


def cantilever(
    effects: Effects | None = None, *, ramp: float = 2e-4, n_copies: int = 2
) -> TimedSystem:
    group = placed_body(MESH, CONCRETE, translations=np.zeros((n_copies, 3)))
    force = np.zeros((group.n_nodes, 3))
    force[np.flatnonzero(MESH.nodes[:, 0] == 40.0), 2] = 0.5
    copies = np.arange(n_copies)
    return lone_bodies(
        (group,),
        supports=(fixed_nodes(0, HELD, copies=copies),),
        loads=(nodal_load(0, force, copies=copies, amplitude=SmoothStepAmplitude(ramp)),),
        effects=effects or Effects(),
    )


EVERYTHING = Effects(
    rayleigh=RayleighDamping(stiffness_proportional=1e-8),
    bulk_viscosity=BulkViscosity(),
    finite_rotation=True,
    gravity=np.array([0.0, 0.0, -9810.0]),
    adaptive_mass_damping=AdaptiveMassDamping(),
)
