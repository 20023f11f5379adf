"""Two boxes, pressed and sheared."""

from __future__ import annotations

import numpy as np

from fem import (
    LinearPenalty,
    Material,
    Problem,
)
from geometry.families.boxes import ColumnBox, box_column
from geometry.loads import LoadCase, PressureLoad, TractionLoad

AREA = 100.0 * 80.0


PRESSURE, SHEAR = 0.5, 0.05


STIFF, STICK = 200.0, 40.0


SIZES = ((100.0, 80.0, 50.0), (100.0, 80.0, 30.0))


def boxes(*, poisson=0.0, lower=(2, 2, 2), upper=(2, 2, 2), shear=0.0, **options) -> Problem:
    """A box on another one, pressed and pulled along x on its top."""
    found = box_column([ColumnBox(s, d) for s, d in zip(SIZES, (lower, upper), strict=True)])
    faces = [PressureLoad(np.array([1]), "z+", PRESSURE)]
    if shear:
        faces.append(TractionLoad(np.array([1]), "z+", np.array([shear, 0.0, 0.0])))
    load = LoadCase(found, "pressed", tuple(faces), found.fixed.copy())
    material = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=poisson)
    return Problem(found, load, material, law=LinearPenalty(STIFF), **options)
