"""Blocks of the paper, and rotations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geometry import SineBlock
from geometry.families.sine_block import TSB1


def tsb(shift: float = 0.0, **changes: float) -> SineBlock:
    """TSB1 of the paper (TSB2 with shift 0.5), with changes."""
    return replace(TSB1, shift=shift, **changes)  # type: ignore[arg-type]


def random_rotation(seed: int) -> np.ndarray:
    """Rotation matrix, (3, 3)."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return q * np.sign(np.linalg.det(q))
