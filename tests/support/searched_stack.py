"""Two boxes whose meshes do not match."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem import Frames, LinearPenalty, Material
from geometry.families.boxes import ColumnBox, box_column
from geometry.loads import face_pressure
from tests.support.fem_problems import deformable_assembly

STIFF = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.0)


SIZE = (100.0, 80.0, 50.0)


def stack(*divisions, law=None, sizes=None, pressure=0.5, shift=0.0, material=STIFF, **options):
    """Boxes on each other, the upper ones moved aside by ``shift``, pressed on the top."""
    sizes = [SIZE] * len(divisions) if sizes is None else sizes
    found = box_column([ColumnBox(s, d) for s, d in zip(sizes, divisions, strict=True)])
    places = found.translations.copy()
    places[1:, 0] += shift
    found = replace(found, translations=places)
    load = face_pressure(found, np.array([found.n_blocks - 1]), "z+", pressure)
    return deformable_assembly(
        found,
        load,
        material,
        law=LinearPenalty(1e3) if law is None else law,
        frames=Frames.DEFORMABLE,
        finite_sliding=True,
        **options,
    )
