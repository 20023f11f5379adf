"""Which internal force an explicit run computes."""

from __future__ import annotations

from enum import Enum


class Formulation(Enum):
    """Where the internal force of the explicit solver comes from."""

    SHARED_STIFFNESS = "shared stiffness"
    """One sparse stiffness per block shape, in the frame of the block."""
    RATE_FORM = "rate form"
    """Every element by itself, as Abaqus/Explicit's C3D8R does (`fem.explicit.rate_form`): the slow
    like-for-like; reduced elements, finite rotations of elements, double precision."""
