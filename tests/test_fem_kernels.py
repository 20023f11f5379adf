import numpy as np
import pytest

from fem import kernels, reference
from fem.hexahedron import ElementType, block_stiffness
from fem.layout import BlockRows, aligned_zeros, block_rows, from_lanes, padded_lanes, to_lanes
from tests.fem_problems import CONCRETE, distorted_box

EPS = {np.float64: 2.0**-53, np.float32: 2.0**-24}


@pytest.fixture(scope="module")
def stiffness():
    return block_stiffness(distorted_box((4, 3, 5)), CONCRETE, ElementType.INCOMPATIBLE)


def random_lanes(rows: BlockRows, n_copies: int, dtype, seed: int = 0) -> np.ndarray:
    values = np.random.default_rng(seed).standard_normal((n_copies, rows.n_nodes, 3))
    return to_lanes(values, rows.order, dtype)


def product(rows: BlockRows, u: np.ndarray, *, torque=None, kernel=kernels.stiffness_product):
    force = aligned_zeros(u.shape, u.dtype)
    flat_torque = None if torque is None else torque.ravel()
    kernel(
        rows.chunks,
        rows.pointer,
        rows.column,
        rows.blocks,
        u.ravel(),
        force.ravel(),
        flat_torque,
        u.shape[2],
    )
    return force


def product_bound(rows: BlockRows, u: np.ndarray) -> np.ndarray:
    """|fl(K u) - K u| <= n eps |K| |u| with n = 81 terms; twice, for kernel and reference."""
    absolute = reference.sparse_stiffness(rows)
    absolute.data = np.abs(absolute.data)
    size = np.abs(u).reshape(3 * rows.n_nodes, -1).astype(np.float64)
    return 2 * 81 * EPS[u.dtype.type] * (absolute.astype(np.float64) @ size).reshape(u.shape)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("n_copies", [1, 2, 3, 4, 7, 12, 24, 52, 61])
def test_stiffness_product_is_the_sparse_product(stiffness, n_copies, dtype):
    rows = block_rows(stiffness, dtype)
    u = random_lanes(rows, n_copies, dtype)
    torque = aligned_zeros((len(rows.chunks) - 1, 3, u.shape[2]), dtype)
    force = product(rows, u, torque=torque)
    bound = product_bound(rows, u)
    assert (np.abs(force - reference.stiffness_product(rows, u)) <= bound).all()
    # Sums of 3 n products of u and f: n eps of the sum of magnitudes.
    size = np.abs(u).max() * np.abs(force).max() * 6 * rows.n_nodes
    error = np.abs(torque.sum(axis=0) - reference.torque(u, force)).max()
    assert error <= rows.n_nodes * EPS[dtype] * size


def test_packed_stiffness_is_the_assembled_one_in_another_order(stiffness):
    rows = block_rows(stiffness, np.float64)
    dof = (3 * rows.order[:, None] + np.arange(3)).ravel()
    packed = reference.sparse_stiffness(rows).toarray()
    np.testing.assert_array_equal(packed, stiffness.toarray()[np.ix_(dof, dof)])


def test_copies_do_not_know_how_many_they_are(stiffness):
    # A lane of a vector of any width does the same operations in the same order: same bits.
    rows = block_rows(stiffness, np.float64)
    values = np.random.default_rng(1).standard_normal((52, rows.n_nodes, 3))
    alone = {}
    for n in (2, 3, 8, 20, 52):
        force = product(rows, to_lanes(values[:n], rows.order, np.float64))
        alone[n] = from_lanes(force, rows.row, n)
        np.testing.assert_array_equal(alone[n][:2], alone[2])
    # One copy sums by columns of the blocks: same terms, another order, 81 of them.
    u = to_lanes(values[:1], rows.order, np.float64)
    single = from_lanes(product(rows, u), rows.row, 1)
    bound = from_lanes(product_bound(rows, u), rows.row, 1)
    assert (np.abs(single - alone[2][:1]) <= bound).all()


@pytest.mark.parametrize("n_copies", [1, 12])
def test_threads_do_not_change_a_bit(stiffness, n_copies):
    rows = block_rows(stiffness, np.float64)
    u = random_lanes(rows, n_copies, np.float64)
    parallel = product(rows, u, kernel=kernels.stiffness_product_parallel)
    np.testing.assert_array_equal(product(rows, u), parallel)


def test_lanes_round_trip_and_padding():
    rng = np.random.default_rng(0)
    order = rng.permutation(10)
    row = np.argsort(order)
    values = rng.standard_normal((5, 10, 3))
    lanes = to_lanes(values, order, np.float64)
    assert lanes.shape == (10, 3, 8)
    assert lanes.ctypes.data % 64 == 0
    np.testing.assert_array_equal(from_lanes(lanes, row, 5), values)
    assert [padded_lanes(n, np.float64) for n in (1, 2, 3, 8, 9, 52)] == [1, 2, 4, 8, 16, 56]
    assert [padded_lanes(n, np.float32) for n in (1, 9, 16, 17, 52)] == [1, 16, 16, 32, 64]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_update_is_one_central_difference_step(dtype):
    rng = np.random.default_rng(2)
    n, lanes = 30, 8
    mass = rng.uniform(1.0, 2.0, n).astype(dtype)
    internal, u, v = (rng.standard_normal((n, 3, lanes)).astype(dtype) for _ in range(3))
    applied_row = np.full(n, -1, dtype=np.int32)
    applied_row[5:12] = np.arange(7)
    applied = rng.standard_normal((7, 3, lanes)).astype(dtype)
    gravity = rng.standard_normal((3, lanes)).astype(dtype)
    dt, damping = 0.01, 30.0
    force = -internal.astype(np.float64)
    force[5:12] += applied
    expected = reference.update(
        time_step=dt,
        mass_damping=damping,
        mass=mass.astype(np.float64),
        force=force,
        acceleration=gravity,
        displacement=u,
        velocity=v,
    )
    half = 0.5 * damping * dt
    chunks = np.array([0, 4, 17, 30])
    kinetic, dissipated = np.zeros((3, lanes)), np.ones((3, 2, lanes))
    new_u, new_v = u.copy(), v.copy()
    kernels.update(
        chunks,
        dtype(dt),
        dtype(dt / (1 + half)),
        dtype((1 - half) / (1 + half)),
        mass,
        internal,
        applied_row,
        applied,
        gravity,
        new_u,
        new_v,
        kinetic,
        half,
        dissipated,
    )
    # A handful of roundings of numbers below 10.
    tolerance = 20 * 10 * EPS[dtype]
    np.testing.assert_allclose(new_u, expected[0], rtol=0, atol=tolerance)
    np.testing.assert_allclose(new_v, expected[1], rtol=0, atol=tolerance)
    m = mass.astype(np.float64)[:, None, None]
    sums = (m * v * new_v).sum(axis=(0, 1))
    np.testing.assert_allclose(kinetic.sum(axis=0), 0.5 * sums, rtol=0, atol=90 * tolerance)
    mean = 0.5 * (v + new_v.astype(np.float64))
    loss = dt * damping * (m * mean**2).sum(axis=(0, 1))
    np.testing.assert_allclose(dissipated[:, 0].sum(axis=0), 3 + loss, atol=90 * tolerance)
    after = 0.5 * dt * damping * (m * mean * new_v).sum(axis=(0, 1))
    np.testing.assert_allclose(dissipated[:, 1].sum(axis=0), after, rtol=0, atol=90 * tolerance)


def test_scatter_adds_repeated_indices():
    rng = np.random.default_rng(3)
    target, values = rng.standard_normal(20), rng.standard_normal(50)
    index = rng.integers(0, 20, 50)
    result = target.copy()
    kernels.add_at(result, index, values, 0.5)
    # The same additions in the same order.
    np.testing.assert_array_equal(result, reference.add_at(target, index, values, 0.5))
