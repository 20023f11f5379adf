"""The rate form as the internal force of a run, beside the shared stiffness."""

import numpy as np
import pytest

from fem.element.hexahedron import ElementType
from fem.explicit.solve import solve
from fem.explicit.state import StateError
from fem.problem.effects import BulkViscosity, Effects, RayleighDamping
from fem.problem.formulation import Formulation
from fem.problem.loads import SmoothStepAmplitude
from fem.problem.model import Model, ModelError, block_group, fixed_nodes, nodal_load
from geometry.block import box_block
from tests.fem_problems import CONCRETE

MESH = box_block((40.0, 8.0, 8.0), (8, 3, 3)).mesh


def cantilever(formulation: Formulation, effects: Effects | None = None, *, force=0.05) -> Model:
    group = block_group(MESH, CONCRETE, element=ElementType.REDUCED)
    end = np.flatnonzero(MESH.nodes[:, 0] == 40.0)
    forces = np.zeros((group.n_nodes, 3))
    forces[end, 2] = force
    return Model(
        (group,),
        supports=(fixed_nodes(0, np.flatnonzero(MESH.nodes[:, 0] == 0.0)),),
        loads=(nodal_load(0, forces, amplitude=SmoothStepAmplitude(1e-4)),),
        effects=effects or Effects(),
        formulation=formulation,
    )


@pytest.mark.parametrize(
    "effects",
    [Effects(), Effects(RayleighDamping(100.0, 1e-8), BulkViscosity())],
    ids=["elastic", "damped"],
)
def test_rate_form_agrees_with_the_shared_stiffness_in_small_motions(effects):
    # Rotations and strains are below 1e-4 here, and so is what separates the two.
    shared, rate = (
        solve(cantilever(f, effects), end_time=1.2e-4)
        for f in (Formulation.SHARED_STIFFNESS, Formulation.RATE_FORM)
    )
    size = np.abs(shared.displacements[0]).max()
    assert size / 40.0 < 1e-4
    np.testing.assert_allclose(rate.displacements[0], shared.displacements[0], atol=1e-3 * size)
    for name in ("strain_energy", "hourglass_energy", "external_work"):
        expected = getattr(shared.energies, name)
        assert getattr(rate.energies, name) == pytest.approx(expected, rel=5e-3)
    assert rate.energy_balance < 1e-3
    assert (rate.energies.bulk_viscosity_dissipation > 0.0) == (effects.bulk_viscosity is not None)


def test_rate_form_refuses_what_it_cannot_do():
    with pytest.raises(ModelError, match="expects 'reduced'"):
        Model((block_group(MESH, CONCRETE),), formulation=Formulation.RATE_FORM)
    model = cantilever(Formulation.RATE_FORM)
    with pytest.raises(StateError, match="float64"):
        solve(model, end_time=1e-5, precision="float32")
    with pytest.raises(StateError, match="stress-free"):
        solve(model, end_time=1e-5, displacements=[np.ones((1, len(MESH.nodes), 3))])
