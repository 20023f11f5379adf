"""Small loads beside one that contact forces balance: what is proved, and what is not."""

import numpy as np
import pytest

from mbd.frictionless.equilibrium import carried_beside
from tests.support.matrix_jacobian import as_jacobian

pytestmark = pytest.mark.quick


def pressed(seed: int, rows: int = 6, columns: int = 14):
    """Contacts that all press: G and λ >= 1."""
    rng = np.random.default_rng(seed)
    matrix = rng.standard_normal((rows, columns))
    return as_jacobian(matrix), matrix, 1.0 + rng.random(columns)


@pytest.mark.parametrize("seed", range(5))
def test_loads_are_proved_until_the_first_contact_lets_go(seed: int) -> None:
    """Forces λ (1 - Gᵀ K⁻¹ f), K = G λ Gᵀ, balance f too: proved exactly while none is negative."""
    jacobian, matrix, forces = pressed(seed)
    loads = np.random.default_rng(seed + 100).standard_normal((8, len(matrix)))
    drop = np.linalg.solve((matrix * forces) @ matrix.T, loads.T).T @ matrix
    limit = loads / drop.max(axis=1, keepdims=True)
    assert carried_beside(jacobian, forces, 0.999 * limit, 1e-9).all()
    assert not carried_beside(jacobian, forces, 1.001 * limit, 1e-9).any()


def test_a_load_that_contacts_cannot_balance_is_not_proved() -> None:
    """No contact acts along the last row: loads with a part along it are not carried."""
    _, matrix, forces = pressed(1)
    matrix[-1] = 0.0
    jacobian = as_jacobian(matrix)
    loads = 1e-3 * np.eye(len(matrix))
    proved = carried_beside(jacobian, forces, loads, 1e-9)
    assert proved.tolist() == [True] * (len(matrix) - 1) + [False]


def test_nothing_is_proved_without_forces() -> None:
    """Forces grow in proportion to themselves: from none follows none."""
    jacobian, matrix, forces = pressed(2)
    assert not carried_beside(jacobian, 0.0 * forces, 1e-3 * np.eye(len(matrix)), 1e-9).any()
