"""From ``[effects]`` and ``[fem] damping`` to what the solver runs; what is not named is absent."""

from __future__ import annotations

import numpy as np

from fem.problem.effects import AdaptiveMassDamping, BulkViscosity, Effects, RayleighDamping
from validation.errors import InputError
from validation.scene.deformable import Damping, EffectsSection, FemSection

#: The paper's damping of its Abaqus runs (Table material_parameters): α [1/s] and β [s].
PAPER_RAYLEIGH = RayleighDamping(mass_proportional=2.0, stiffness_proportional=1.0e-8)


def build_effects(section: EffectsSection, fem: FemSection) -> Effects:
    """Effects of a run.

    Raises
    ------
    RefusedError
        For effects that exclude each other.
    """
    if fem.mass_scaling is not None and section.gravity is not None:
        raise InputError(
            f"fem.mass_scaling: got {fem.mass_scaling:g} beside effects.gravity; added mass would "
            "weigh: expected one of the two"
        )
    given, bulk = section.rayleigh, section.bulk_viscosity
    rayleigh = None if given is None else RayleighDamping(**given.model_dump())
    viscosity = None if bulk is None else BulkViscosity(**bulk.model_dump())
    if fem.damping is Damping.PAPER:
        rayleigh, viscosity = rayleigh or PAPER_RAYLEIGH, viscosity or BulkViscosity()
    adaptive = AdaptiveMassDamping() if fem.damping is Damping.STATIC else None
    gravity = None if section.gravity is None else np.array(section.gravity)
    return Effects(
        rayleigh=rayleigh,
        bulk_viscosity=viscosity,
        finite_rotation=section.finite_rotation,
        gravity=gravity,
        adaptive_mass_damping=adaptive,
    )
