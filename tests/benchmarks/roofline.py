# mypy: disable-error-code="untyped-decorator"
"""What one core of this machine can do: memory bandwidth and multiply-adds, measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from fem.explicit.kernels.lanes import REGISTER_DOUBLES, lane_operations, multiply_add, store
from tests.benchmarks.stopwatch import best_cpu_seconds


@dataclass(frozen=True)
class Roofline:
    """Limits of one core."""

    triad_memory_gb_per_s: float
    """a = b + s c on arrays far beyond the caches, counting two reads and one write."""
    triad_cache_gb_per_s: float
    """The same on arrays of 1 MB each."""
    peak_float64_gflops: float
    """Independent fused multiply-adds in registers, two operations each."""


@dataclass(frozen=True)
class Work:
    """Operations and bytes of an element update, by counting."""

    flops: float
    bytes: float

    def __add__(self, other: Work) -> Work:
        return Work(self.flops + other.flops, self.bytes + other.bytes)

    def limit(self, machine: Roofline) -> float:
        """Million updates per second that the roofline allows."""
        peak = machine.peak_float64_gflops
        return 1e3 * min(peak / self.flops, machine.triad_cache_gb_per_s / self.bytes)


@njit(error_model="numpy")
def _triad(a, b, c, s):  # type: ignore[no-untyped-def]
    for i in range(len(a)):
        a[i] = b[i] + s * c[i]


def _multiply_adds(width: int) -> Callable[..., None]:
    """Make a loop of twelve independent chains of multiply-adds on ``width`` lanes."""
    load, _ = lane_operations(width)

    @njit(error_model="numpy")
    def run(x, w, n):  # type: ignore[no-untyped-def]
        a, b, c, d = load(x, 0), load(x, w), load(x, 2 * w), load(x, 3 * w)
        e, f, g, h = load(x, 4 * w), load(x, 5 * w), load(x, 6 * w), load(x, 7 * w)
        i, j, k, o = load(x, 8 * w), load(x, 9 * w), load(x, 10 * w), load(x, 11 * w)
        m, s = load(x, 12 * w), load(x, 13 * w)
        for _ in range(n):
            a, b, c = multiply_add(m, a, s), multiply_add(m, b, s), multiply_add(m, c, s)
            d, e, f = multiply_add(m, d, s), multiply_add(m, e, s), multiply_add(m, f, s)
            g, h, i = multiply_add(m, g, s), multiply_add(m, h, s), multiply_add(m, i, s)
            j, k, o = multiply_add(m, j, s), multiply_add(m, k, s), multiply_add(m, o, s)
        total = ((a + b) + (c + d)) + ((e + f) + (g + h))
        store(x, 0, total + ((i + j) + (k + o)))

    return run


def _triad_rate(n: int) -> float:
    a, b, c = np.zeros(n), np.ones(n), np.ones(n)
    repeats = max(1, 20_000_000 // n)
    seconds = best_cpu_seconds(lambda: _triad(a, b, c, 0.5), repeats=repeats)
    return 24.0 * n / seconds / 1e9


def _peak(width: int) -> float:
    x = np.full(14 * width, 0.5)
    kernel, n = _multiply_adds(width), 400_000
    seconds = best_cpu_seconds(lambda: kernel(x, width, n))
    return 12.0 * width * 2.0 * n / seconds / 1e9


def roofline() -> Roofline:
    """Measure the limits; about two seconds."""
    return Roofline(
        triad_memory_gb_per_s=_triad_rate(8_000_000),
        triad_cache_gb_per_s=_triad_rate(120_000),
        # As wide as a register: fourteen of them are all that some processors have, nearly.
        peak_float64_gflops=_peak(REGISTER_DOUBLES),
    )
