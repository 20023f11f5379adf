"""Mass scaling: longer steps for mass on the elements that allow only short ones.

Every element bounds the critical time step by its highest frequency with its own lumped mass
(Irons and Treharne 1971). Elements that bound it below the step asked for get mass until they
allow it; all others keep theirs. A static state does not depend on mass, and slow motions hardly
notice that of few small elements.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fem.element.hexahedron import chunks, element_lumped_mass
from fem.element.time_step import element_frequencies
from fem.problem.model import BlockGroup, Model, ModelError
from geometry.mesh import FloatArray


def scale_masses(model: Model, factor: float) -> Model:
    """Add mass so that elements allow a longer step.

    Parameters
    ----------
    model
        Without gravity: added mass must not weigh.
    factor
        Step that every element is to allow, over that of the most demanding one [-].

    Raises
    ------
    ModelError
        A factor below one, or gravity.
    """
    if not (math.isfinite(factor) and factor >= 1.0):
        raise ModelError(f"mass_scaling: got {factor}, expected a factor of at least 1")
    if model.effects.gravity is not None:
        raise ModelError(
            "mass_scaling: got gravity beside it; added mass would weigh: expected one of the two"
        )
    frequencies = [element_frequencies(g.mesh, g.material, g.element) for g in model.groups]
    allowed = max(float(f.max()) for f in frequencies) / factor
    return replace(
        model,
        groups=tuple(
            _scaled_group(group, np.maximum(1.0, found / allowed) ** 2)
            for group, found in zip(model.groups, frequencies, strict=True)
        ),
    )


def _scaled_group(group: BlockGroup, factors: FloatArray) -> BlockGroup:
    """Block whose elements have ``factors`` times their mass, (n_elements,)."""
    mesh = group.mesh
    added = np.zeros(mesh.n_nodes)
    for part in chunks(mesh.n_elements):
        nodes = mesh.elements[part]
        mass = element_lumped_mass(mesh.nodes[nodes], group.material.density)
        more = (factors[part] - 1.0)[:, None] * mass
        added += np.bincount(nodes.ravel(), more.ravel(), minlength=mesh.n_nodes)
    return replace(
        group,
        lumped_mass=group.lumped_mass + added,
        added_mass=group.added_mass + float(added.sum()),
    )


def added_mass_share(model: Model) -> float:
    """Mass that scaling added over the mass that was there, all copies [-]."""
    added = sum(g.n_copies * g.added_mass for g in model.groups)
    total = sum(g.n_copies * float(g.lumped_mass.sum()) for g in model.groups)
    return added / (total - added)
