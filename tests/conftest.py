"""Tiny named problems, shared by the tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.assembly import Assembly
from geometry.families.boxes import brick_stack
from geometry.families.sine_block import TSB1, SineBlockDivisions, SineBlockParameters
from geometry.families.tube import sine_tube


def tsb(shift: float = 0.0, **changes: float) -> SineBlockParameters:
    """TSB1 of the paper (TSB2 with shift 0.5), with changes."""
    return replace(TSB1, shift=shift, **changes)  # type: ignore[arg-type]


@pytest.fixture(scope="session")
def small_tube() -> Assembly:
    """TSB1 with three layers, a coarse mesh."""
    return sine_tube(tsb(), SineBlockDivisions(24, 3, 6), 3)


@pytest.fixture(scope="session")
def plain_ring() -> Assembly:
    """One free layer of four plain cylindrical bricks (amplitude 0)."""
    return sine_tube(tsb(amplitude=0.0), SineBlockDivisions(12, 4, 4), 1)


@pytest.fixture(scope="session")
def two_bricks() -> Assembly:
    """Two bricks, one on the other, between fixed bricks."""
    return brick_stack((100.0, 60.0, 50.0), (4, 3, 2), columns=1, layers=2)


def random_rotation(seed: int) -> np.ndarray:
    """Rotation matrix, (3, 3)."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return q * np.sign(np.linalg.det(q))
