"""The benchmark of the explicit solver on a block small enough for a test."""

import numpy as np
import pytest

from tests.benchmarks import explicit
from tests.benchmarks.kernels import kernel_rows
from tests.benchmarks.roofline import Roofline
from tests.support.lone_bodies import lone_bodies


def test_rows_and_table_on_a_tiny_block():
    group = explicit.benchmark_group((3, 2, 2), 2)
    row = explicit.row(group, 1e-7, 1)
    assert row.elements == 12
    assert row.copies == 2
    # A step contains the internal force.
    assert 0.0 < row.whole_step < row.internal_force
    # At least displacement, velocity and internal force of three components.
    assert row.bytes_per_node > 3 * 3 * 8
    peers = explicit.peers(group)
    assert min(peers.values()) > 0.0
    limits = Roofline(1.0, 2.0, 3.0)

    def prepared(effects):
        return explicit.ready(lone_bodies((group,), effects=effects), 1e-8)

    kernels = kernel_rows(group, limits, prepared)
    assert all(kernel.nanoseconds > 0.0 for kernel in kernels)
    product, update, *_, rotating = kernels
    assert update.flops < product.flops < rotating.flops
    text = explicit.table(
        {
            "roofline": vars(limits),
            "internal_force_limit": explicit.internal_force_limit(group, limits),
            "rows": [vars(row)],
            "kernels": [vars(kernel) for kernel in kernels],
            "effects_added_percent": {"gravity": 1.0},
            "peers": peers,
            "peak_memory_mb": 1.0,
        }
    )
    assert "gravity: +1.0 %" in text
    assert all(kernel.kernel in text for kernel in kernels)


def test_operations_are_counted_from_the_assembled_stiffness():
    # 18 operations for each 3 × 3 block, (3 n + 1) blocks along each edge of a grid.
    group = explicit.benchmark_group((3, 2, 2), 1)
    assert explicit.flops_per_element(group) == pytest.approx(18.0 * 10 * 7 * 7 / 12)


def test_the_plain_force_of_the_benchmark_is_the_same_force():
    group = explicit.benchmark_group((3, 2, 2), 3)
    system, state = explicit.ready(explicit.loaded_model(group), 1e-7)
    body, now = system.bodies[0], state.bodies[0]
    explicit.stiffness_force(body, now.displacement, now.internal_force, system.kernels)
    u = now.displacement[body.rows.row, :, 0].ravel()
    expected = group.stiffness @ u
    found = now.internal_force[body.rows.row, :, 0].ravel()
    # 81 products of each row, and the same in the reference.
    bound = 2 * 81 * 2.0**-53 * (abs(group.stiffness.tocsr()) @ np.abs(u))
    assert (np.abs(found - expected) <= bound).all()
