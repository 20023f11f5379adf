"""Blocks of any degree, straight and curved."""

from __future__ import annotations

import numpy as np

from fem import Material, Problem
from geometry.block import Block
from geometry.families.sine_block import TSB1, SineBlockDivisions, sine_block
from geometry.refinement import charts_of
from validation import load_case

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)


def block(counts: tuple[int, int, int] = (6, 1, 2)) -> Block:
    """TSB1 with so many equal elements around, across and along."""
    charts = charts_of(sine_block(TSB1, SineBlockDivisions(12, 1, 2)))
    names = ("along", "across", "upward")
    lines = {k: np.linspace(0.0, 1.0, n + 1) for k, n in zip(names, counts, strict=True)}
    first, second, third = (lines[name] for name in charts.directions)
    return charts.build((first, second, third))


def curved(degree: int, layers: int = 1, *settings: str, case: str = "pipe") -> Problem:
    mesh = ("mesh.around=12", "mesh.radial=2", "mesh.axial=4", f"assembly.layers={layers}")
    return load_case(f"tsb1-{case}", (*mesh, f"fem.degree={degree}", *settings)).problem
