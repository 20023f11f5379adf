"""Mass scaling: the step it promises, on the elements that need it, and nothing else."""

import numpy as np
import pytest

from fem import ElementType, Explicit, Material
from fem.system.body import ModelError, placed_body
from fem.system.effects import EffectError
from fem.system.time_step import (
    added_mass_share,
    element_frequencies,
    scale_masses,
)
from geometry.block import box_block
from geometry.mesh import HexMesh
from tests.support.lone_bodies import lone_bodies

pytestmark = pytest.mark.quick

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)


def bar(thin=0.2, element=ElementType.INCOMPATIBLE):
    """Ten cubes in a row, the last one thinner."""
    mesh = box_block((10.0, 1.0, 1.0), (10, 1, 1)).mesh
    nodes = mesh.nodes.copy()
    nodes[:, 0] = np.interp(nodes[:, 0], [0.0, 9.0, 10.0], [0.0, 9.0, 9.0 + thin])
    return lone_bodies((placed_body(HexMesh(nodes, mesh.elements), CONCRETE, element=element),))


@pytest.mark.parametrize("element", list(ElementType))
@pytest.mark.parametrize("factor", [1.0, 2.0, 4.0])
def test_the_step_is_at_least_the_factor_times_the_bound(element, factor):
    """Every element keeps the bound, so the assembled block does (Irons and Treharne 1971)."""
    model = bar(element=element)
    group = model.bodies[0]
    bound = 2.0 / element_frequencies(group.mesh, group.material, element).max()
    scaled = lone_bodies(scale_masses(model.bodies, factor))
    assert scaled.critical.critical_time_step >= factor * bound * (1.0 - 1e-9)


def test_only_elements_below_the_step_get_mass():
    """A cube is 5 times as long as the thin one: a factor of 2 concerns the thin one alone."""
    (body,) = bar().bodies
    (scaled,) = scale_masses([body], 2.0)
    heavier = scaled.lumped_mass > body.lumped_mass
    assert heavier.tolist() == (body.mesh.nodes[:, 0] >= 9.0).tolist()
    added = scaled.lumped_mass.sum() - body.lumped_mass.sum()
    assert scaled.added_mass.sum() == pytest.approx(added, rel=1e-12)
    assert added_mass_share([scaled]) == pytest.approx(added / body.lumped_mass.sum(), rel=1e-12)
    assert scaled.stiffness is body.stiffness


def test_one_adds_nothing():
    (body,) = bar().bodies
    (same,) = scale_masses([body], 1.0)
    assert np.array_equal(same.lumped_mass, body.lumped_mass)
    assert added_mass_share([same]) == 0.0


@pytest.mark.parametrize("factor", [0.5, np.inf, np.nan])
def test_factors_that_make_no_sense_are_refused(factor):
    with pytest.raises(ModelError, match="at least 1"):
        scale_masses(bar().bodies, factor)


def test_added_mass_must_not_weigh():
    with pytest.raises(EffectError, match="weigh"):
        Explicit(mass_scaling=2.0).effects(gravity=np.array([0.0, 0.0, -9810.0]))
