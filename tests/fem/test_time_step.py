import math

import numpy as np
import pytest
from scipy.linalg import eigh

from fem import ElementType
from fem.system.body import placed_body
from fem.system.effects import BulkViscosity, Effects, RayleighDamping
from fem.system.time_step import (
    body_critical_time_step,
    critical_time_step,
    damping_matrix,
    stable_step_of_mode,
)
from geometry.block import box_block
from tests.support.fem_problems import CONCRETE, distorted_box

pytestmark = pytest.mark.quick


def dense_frequency(body) -> float:
    mass = np.diag(np.repeat(body.lumped_mass, 3))
    return math.sqrt(eigh(body.stiffness.toarray(), mass, eigvals_only=True)[-1])


@pytest.mark.parametrize("element", list(ElementType))
def test_lanczos_finds_the_largest_frequency_from_above(element):
    # The residual is added: never below, and Lanczos to 1e-6 is that close.
    body = placed_body(distorted_box((3, 3, 2)), CONCRETE, element=element)
    exact = dense_frequency(body)
    found = critical_time_step([body], Effects())
    assert exact <= found.max_frequency * (1 + 1e-12)
    assert found.max_frequency == pytest.approx(exact, rel=1e-5)
    assert found.critical_time_step == found.undamped == pytest.approx(2 / exact, rel=1e-5)


def test_damped_step_of_one_mode_is_belytschkos():
    omega, ratio = 3.0, 0.4
    expected = 2.0 / omega * (math.sqrt(1.0 + ratio**2) - ratio)
    assert stable_step_of_mode(omega**2, 2.0 * ratio * omega) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("beta", [1e-9, 1e-7, 1e-6])
def test_stiffness_damping_shrinks_the_step_by_belytschkos_factor(beta):
    # All modes share ξ = β ω / 2, so the highest one governs.
    body = placed_body(distorted_box((3, 3, 2)), CONCRETE)
    damped = body_critical_time_step(body, Effects(RayleighDamping(None, beta)))
    omega = dense_frequency(body)
    ratio = 0.5 * beta * omega
    expected = 2.0 / omega * (math.sqrt(1.0 + ratio**2) - ratio)
    assert damped.critical_time_step == pytest.approx(expected, rel=2e-5)


def test_mass_damping_leaves_the_step_as_it_is():
    body = placed_body(distorted_box((3, 3, 2)), CONCRETE)
    plain = body_critical_time_step(body, Effects())
    damped = body_critical_time_step(body, Effects(RayleighDamping(1e6)))
    assert damped.critical_time_step == plain.critical_time_step


def test_mixed_damping_is_the_worst_of_all_modes():
    # The smallest Δt at which Δt² K + 2 Δt C reaches 4 M, by dense eigenvalues.
    body = placed_body(distorted_box((2, 2, 2)), CONCRETE)
    effects = Effects(RayleighDamping(None, 3e-8), BulkViscosity(0.3, 1.2))
    found = body_critical_time_step(body, effects).critical_time_step
    mass = np.diag(np.repeat(body.lumped_mass, 3))
    damping = damping_matrix(body, effects).toarray()
    stiffness = body.stiffness.toarray()
    largest = eigh(found**2 * stiffness + 2 * found * damping, mass, eigvals_only=True)[-1]
    assert largest <= 4.0 * (1 + 1e-9)
    assert largest == pytest.approx(4.0, rel=1e-4)


def test_extra_stiffness_counts_as_springs_to_ground():
    body = placed_body(box_block((10.0,) * 3, (2,) * 3).mesh, CONCRETE)
    stiff = np.zeros(body.n_nodes)
    stiff[:5] = 1e7
    found = body_critical_time_step(body, Effects(), extra_stiffness=stiff)
    mass = np.diag(np.repeat(body.lumped_mass, 3))
    spring = np.diag(np.repeat(stiff, 3))
    exact = eigh(body.stiffness.toarray() + spring, mass, eigvals_only=True)[-1]
    assert found.critical_time_step == pytest.approx(2 / math.sqrt(exact), rel=1e-5)


def test_the_smallest_step_of_all_groups_governs_and_l_over_c_is_reported():
    coarse = placed_body(box_block((10.0,) * 3, (2,) * 3).mesh, CONCRETE, name="coarse")
    fine = placed_body(box_block((10.0,) * 3, (4,) * 3).mesh, CONCRETE, name="fine")
    found = critical_time_step([coarse, fine], Effects())
    assert found.body == "fine"
    expected = 2.5 / CONCRETE.dilatational_wave_speed
    assert found.element_estimate == pytest.approx(expected, rel=1e-12)
