import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fem import ElementType, Material
from fem.element.kinds import block_stiffness
from fem.explicit import kernels
from fem.explicit.body import element_viscosity
from fem.explicit.kernels import (
    PARALLEL,
    SERIAL,
    Applied,
    Damper,
    Drag,
    Loads,
    MovingRows,
    Placing,
    widths,
)
from fem.explicit.kernels.layout import (
    BlockRows,
    aligned_zeros,
    block_rows,
    from_lanes,
    padded_lanes,
    runs,
    to_lanes,
)
from fem.system.body import placed_body
from fem.system.effects import BulkViscosity
from tests.support import reference_kernels as reference
from tests.support.fem_problems import CONCRETE, distorted_box

pytestmark = pytest.mark.quick

EPS = 2.0**-53


@pytest.fixture(scope="module")
def stiffness():
    return block_stiffness(distorted_box((4, 3, 5)), CONCRETE, ElementType.INCOMPATIBLE)


def random_lanes(rows: BlockRows, n_copies: int, seed: int = 0) -> np.ndarray:
    values = np.random.default_rng(seed).standard_normal((n_copies, rows.n_nodes, 3))
    return to_lanes(values, rows.order)


def product(rows: BlockRows, u: np.ndarray, *, torque=None, kernel=SERIAL.stiffness_product):
    force = aligned_zeros(u.shape)
    flat_torque = None if torque is None else torque.ravel()
    kernel(
        *rows.packed,
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
    size = np.abs(u).reshape(3 * rows.n_nodes, -1)
    return 2 * 81 * EPS * (absolute @ size).reshape(u.shape)


@pytest.mark.parametrize("n_copies", [1, 2, 3, 4, 7, 12, 24, 52, 61])
@pytest.mark.parametrize("half", [False, True])
def test_stiffness_product_is_the_sparse_product(stiffness, n_copies, half):
    rows = block_rows(stiffness, lanes=padded_lanes(n_copies), half=half)
    u = random_lanes(rows, n_copies)
    torque = aligned_zeros((len(rows.chunks) - 1, 3, u.shape[2]))
    force = product(rows, u, torque=torque)
    bound = product_bound(rows, u)
    assert (np.abs(force - reference.stiffness_product(rows, u)) <= bound).all()
    # Sums of 2 n products of u and f by each side: 4 n eps of the sum of their magnitudes.
    size = 4 * rows.n_nodes * EPS * reference.torque_magnitude(u, force)
    assert (np.abs(torque.sum(axis=0) - reference.torque(u, force)) <= size).all()


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("lanes", [1, 2])
def test_packed_stiffness_is_the_assembled_one_in_another_order(stiffness, half, lanes):
    rows = block_rows(stiffness, lanes=lanes, half=half)
    dof = (3 * rows.order[:, None] + np.arange(3)).ravel()
    packed = reference.sparse_stiffness(rows).toarray()
    np.testing.assert_array_equal(packed, stiffness.toarray()[np.ix_(dof, dof)])


def test_copies_do_not_know_how_many_they_are(stiffness):
    # A lane of a vector of any width does the same operations in the same order: same bits.
    # Half rows and whole ones sum over the neighbours in the same order.
    rows = block_rows(stiffness, lanes=1)
    values = np.random.default_rng(1).standard_normal((52, rows.n_nodes, 3))
    alone = {}
    for n in (2, 3, 8, 12, 20, 52):
        for half in (False, True):
            rows = block_rows(stiffness, lanes=2, half=half)
            force = product(rows, to_lanes(values[:n], rows.order))
            alone[n] = from_lanes(force, rows.row, n)
            np.testing.assert_array_equal(alone[n][:2], alone[2][:2])
    # One copy sums by columns of the blocks: same terms, another order, 81 of them.
    rows = block_rows(stiffness, lanes=1)
    u = to_lanes(values[:1], rows.order)
    single = from_lanes(product(rows, u), rows.row, 1)
    bound = from_lanes(product_bound(rows, u), rows.row, 1)
    assert (np.abs(single - alone[2][:1]) <= bound).all()


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("n_copies", [1, 12])
def test_threads_do_not_change_a_bit(stiffness, n_copies, half):
    lanes = padded_lanes(n_copies)
    rows = block_rows(stiffness, lanes=lanes, half=half)
    u = random_lanes(rows, n_copies)
    parallel = product(rows, u, kernel=PARALLEL.stiffness_product)
    np.testing.assert_array_equal(product(rows, u), parallel)


def test_lanes_round_trip_and_padding():
    rng = np.random.default_rng(0)
    order = rng.permutation(10)
    row = np.argsort(order)
    values = rng.standard_normal((5, 10, 3))
    lanes = to_lanes(values, order)
    assert lanes.shape == (10, 3, 8)
    assert lanes.ctypes.data % 64 == 0
    np.testing.assert_array_equal(from_lanes(lanes, row, 5), values)
    assert [padded_lanes(n) for n in (1, 2, 3, 8, 9, 52)] == [1, 2, 4, 8, 12, 52]


def test_update_is_one_central_difference_step():
    rng = np.random.default_rng(2)
    n, lanes = 30, 8
    mass = rng.uniform(1.0, 2.0, n)
    internal, old, u, v = (rng.standard_normal((n, 3, lanes)) for _ in range(4))
    applied_row = np.full(n, -1, dtype=np.int32)
    applied_row[5:12] = np.arange(7)
    applied, load = rng.standard_normal((2, 7, 3, lanes))
    gravity = rng.standard_normal((3, lanes))
    dt, damping, ratio = 0.01, 30.0, 0.3
    viscous = ratio * (internal - old)
    force = -internal - viscous
    force[5:12] += applied
    expected = reference.update(
        time_step=dt,
        mass_damping=damping,
        mass=mass,
        force=force,
        acceleration=gravity,
        displacement=u,
        velocity=v,
    )
    half = 0.5 * damping * dt
    chunks = np.array([0, 4, 17, 30])
    kinetic, (dissipated, work, pushed) = np.zeros((3, lanes)), np.ones((3, 3, 2, lanes))
    new_u, new_v = u.copy(), v.copy()
    SERIAL.update(
        lanes,
        *widths(lanes),
        chunks,
        MovingRows(mass, internal.ravel(), new_u.ravel(), new_v.ravel(), dt, dt / (1 + half)),
        kinetic.ravel(),
        Drag((1 - half) / (1 + half), half, dissipated.ravel()),
        Damper(ratio, old.ravel(), work.ravel()),
        None,
        Applied(applied_row, applied.ravel()),
        Loads(load.ravel(), pushed.ravel()),
        gravity.ravel(),
    )
    # A handful of roundings of numbers below 10.
    tolerance = 20 * 10 * EPS
    np.testing.assert_allclose(new_u, expected[0], rtol=0, atol=tolerance)
    np.testing.assert_allclose(new_v, expected[1], rtol=0, atol=tolerance)
    m = mass[:, None, None]
    sums = (m * v * new_v).sum(axis=(0, 1))
    np.testing.assert_allclose(kinetic.sum(axis=0), 0.5 * sums, rtol=0, atol=90 * tolerance)
    mean = 0.5 * (v + new_v)
    loss = dt * damping * (m * mean**2).sum(axis=(0, 1))
    np.testing.assert_allclose(dissipated[:, 0].sum(axis=0), 3 + loss, atol=90 * tolerance)
    after = 0.5 * dt * damping * (m * mean * new_v).sum(axis=(0, 1))
    np.testing.assert_allclose(dissipated[:, 1].sum(axis=0), after, rtol=0, atol=90 * tolerance)
    done = (viscous * mean).sum(axis=(0, 1))
    np.testing.assert_allclose(work[:, 0].sum(axis=0), 3 + done, rtol=0, atol=90 * tolerance)
    after = 0.5 * (viscous * new_v).sum(axis=(0, 1))
    np.testing.assert_allclose(work[:, 1].sum(axis=0), after, rtol=0, atol=90 * tolerance)
    done = dt * (load * mean[5:12]).sum(axis=(0, 1))
    np.testing.assert_allclose(pushed[:, 0].sum(axis=0), 3 + done, rtol=0, atol=90 * tolerance)
    after = 0.5 * dt * (load * new_v[5:12]).sum(axis=(0, 1))
    np.testing.assert_allclose(pushed[:, 1].sum(axis=0), after, rtol=0, atol=90 * tolerance)


def scattered(rng: np.random.Generator) -> np.ndarray:
    """Positions below 60 in no order: neighbours by the dozen, gaps and repeats."""
    return rng.permutation(np.concatenate([np.arange(3, 32), rng.integers(30, 60, 40)]))


def test_runs_hold_every_position_once_and_in_order():
    index = scattered(np.random.default_rng(3))
    found, order = runs(index)
    np.testing.assert_array_equal(found.index, np.sort(index))
    np.testing.assert_array_equal(index[order], found.index)
    # A run of neighbours is one run: loops over it are long.
    assert np.diff(found.pointer).max() >= 29 - 2
    none, order = runs(np.empty(0, np.int64))
    assert len(none.start) == len(order) == len(none.index) == 0


def test_scatter_adds_repeated_indices():
    rng = np.random.default_rng(3)
    index = scattered(rng)
    target = rng.standard_normal(60)
    values = rng.standard_normal(len(index))
    found, order = runs(index)
    result = target.copy()
    kernels.add_at(result, found.start, found.pointer, values[order], 0.5)
    # The same additions in the same order: repeats of a position keep theirs.
    np.testing.assert_array_equal(result, reference.add_at(target, index, values, 0.5))


@pytest.mark.parametrize("size", [3, 6, 12, 24])
def test_a_sum_over_rows_is_that_of_numpy(size):
    rng = np.random.default_rng(5)
    a, b = rng.standard_normal((2, 40, size))
    row_a, row_b = rng.permutation(40)[:17], rng.permutation(40)[:17]
    total = kernels.dot_rows(a.ravel(), row_a, b.ravel(), row_b, size)
    products = a[row_a] * b[row_b]
    # A sum of n products in any order: n roundings of at most the sum of the sizes.
    rounding = 2 * products.size * 2**-53 * np.abs(products).sum()
    assert abs(total - products.sum()) <= rounding


def test_held_components_are_put_back_and_their_damping_is_given():
    rng = np.random.default_rng(4)
    index = np.unique(scattered(rng))
    found, order = runs(index)
    np.testing.assert_array_equal(order, np.arange(len(index)))
    u, v, mass = rng.standard_normal(60), rng.standard_normal(60), rng.uniform(1, 2, len(index))
    others = np.setdiff1d(np.arange(60), index)
    free = u[others].copy(), v[others].copy()
    lost = -0.5 * 0.3 * mass @ v[index] ** 2
    given = kernels.hold(found.start, found.pointer, mass, 0.3, u, v)
    assert abs(given - lost) <= 4 * len(index) * 2**-53 * abs(lost)
    assert not u[index].any()
    assert not v[index].any()
    np.testing.assert_array_equal((u[others], v[others]), free)


@pytest.mark.parametrize("n_copies", [1, 2, 3, 20])
def test_effects_are_their_plain_statements(n_copies):
    # Sums of at most a few hundred products of numbers below 10, each rounded once or twice.
    tolerance = 300 * 100 * EPS
    group = placed_body(
        distorted_box((4, 3, 2)), Material(density=1.0, young_modulus=1.0, poisson_ratio=0.3)
    )
    rows = block_rows(group.stiffness, lanes=padded_lanes(n_copies))
    data = element_viscosity(group, rows.row, BulkViscosity(0.5, 0.7))
    chunks, n = rows.chunks, len(rows.chunks) - 1
    u, f, old, lag, step = (random_lanes(rows, n_copies, seed) for seed in range(5))
    lanes, rng = u.shape[2], np.random.default_rng(9)

    strain, stress = (rng.standard_normal((group.mesh.n_elements, lanes)) for _ in range(2))
    expected = reference.viscous_pressure(
        data, per_step=2.0, displacement=u, strain=strain, stress=stress
    )
    lost = np.zeros((len(data.element_chunks) - 1, lanes))
    SERIAL.viscous_pressure(
        lanes,
        data.element_chunks,
        data.element_rows.ravel(),
        data.gradient.ravel(),
        data.linear,
        data.quadratic,
        2.0,
        u.ravel(),
        strain.ravel(),
        stress.ravel(),
        lost.ravel(),
    )
    for found, value in zip((strain, stress, lost.sum(axis=0)), expected, strict=True):
        np.testing.assert_allclose(found, value, rtol=0, atol=tolerance)

    force, torque = f.copy(), aligned_zeros((n, 3, lanes))
    added = reference.viscous_force(data, stress, rows.n_nodes)
    viscous = data.pointer, data.corner, data.gradient.ravel(), stress.ravel()
    SERIAL.add_viscous_force(lanes, chunks, u.ravel(), force.ravel(), torque.ravel(), *viscous)
    np.testing.assert_allclose(force, f + added, rtol=0, atol=tolerance)
    moment = reference.torque(u, added)
    np.testing.assert_allclose(torque.sum(axis=0), moment, rtol=0, atol=10 * tolerance)

    new, work = reference.stiffness_damping(0.3, f, old, lag, step)
    force, elastic, viscous = f.copy(), old.copy(), lag.copy()
    torque[:] = 0.0
    lost = np.zeros((n, lanes))
    SERIAL.add_stiffness_damping(
        lanes,
        chunks,
        0.3,
        u.ravel(),
        step.ravel(),
        elastic.ravel(),
        viscous.ravel(),
        force.ravel(),
        torque.ravel(),
        lost.ravel(),
    )
    np.testing.assert_array_equal(elastic, f)
    np.testing.assert_allclose(viscous, new, rtol=0, atol=tolerance)
    np.testing.assert_allclose(force, f + new, rtol=0, atol=tolerance)
    np.testing.assert_allclose(lost.sum(axis=0), work, rtol=0, atol=tolerance)
    moment = reference.torque(u, new)
    np.testing.assert_allclose(torque.sum(axis=0), moment, rtol=0, atol=tolerance)


@pytest.mark.parametrize("n_copies", [1, 2, 3, 20])
def test_block_frames_are_their_plain_statements(n_copies):
    tolerance = 300 * 100 * EPS
    mesh = distorted_box((4, 3, 2))
    group = placed_body(mesh, CONCRETE)
    rows = block_rows(group.stiffness, lanes=padded_lanes(n_copies))
    u, f, before = (random_lanes(rows, n_copies, seed) for seed in range(3))
    lanes, rng = u.shape[2], np.random.default_rng(9)
    mass = rng.uniform(0.5, 1.5, rows.n_nodes)
    x = mesh.nodes[rows.order]
    rotation = Rotation.random(lanes, rng=rng).as_matrix().transpose(1, 2, 0)
    turn = np.ascontiguousarray(rotation - np.eye(3)[:, :, None])
    mean, spin = (rng.standard_normal((3, lanes)) for _ in range(2))

    moment = aligned_zeros((len(rows.chunks) - 1, 12, lanes))
    SERIAL.displacement_moments(rows.chunks, mass, x, u.ravel(), moment.ravel(), lanes)
    expected = reference.displacement_moments(mass, x, u)
    np.testing.assert_allclose(moment.sum(axis=0), expected, rtol=0, atol=tolerance)

    local, increment = before.copy(), np.empty_like(before)
    SERIAL.block_frame_displacement(
        rows.chunks,
        turn.ravel(),
        mean.ravel(),
        x,
        u.ravel(),
        local.ravel(),
        increment.ravel(),
        lanes,
    )
    expected = reference.block_frame_displacement(rotation, mean, x, u)
    np.testing.assert_allclose(local, expected, rtol=0, atol=tolerance)
    np.testing.assert_allclose(increment, expected - before, rtol=0, atol=tolerance)

    placing, force = np.concatenate([turn, spin[None]]), np.empty_like(f)
    kernels.place_force(placing.ravel(), mass, x, f.ravel(), force.ravel(), lanes)
    expected = reference.place_force(rotation, spin, mass, x, f)
    np.testing.assert_allclose(force, expected, rtol=0, atol=tolerance)

    # The motion turns the force in passing, with the same operations.
    def velocity(inner, turned):
        moved, v = np.zeros_like(f), np.zeros_like(f)
        motion = MovingRows(mass, inner.ravel(), moved.ravel(), v.ravel(), 1.0, 1.0)
        effects = (None, None, None, turned, None, None, None)
        SERIAL.update(lanes, *widths(lanes), rows.chunks, motion, *effects)
        return v

    turned = Placing(placing.ravel(), x)
    np.testing.assert_array_equal(velocity(f, turned), velocity(force, None))
