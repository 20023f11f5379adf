"""Own blocks as files, and built-in boxes as scenes."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
from scipy.optimize import brentq

from geometry.mesh import FloatArray
from geometry.polyhedra.polyhedron import Polyhedron
from validation import Case, load_case

SECTIONS = """
[material]
density = 2.4e-9
young_modulus = 33000.0
poisson_ratio = 0.0
[contact]
clearance_at_zero_pressure = 1.0e-3
pressure_at_zero_clearance = 1.0e-4
[fem]
method = "static"
"""


QUADS = np.array(
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
)


def column(pressure: float) -> Case:
    box = {"size": [100.0, 80.0, 50.0], "divisions": [3, 2, 2]}
    other = {"size": [100.0, 80.0, 60.0], "divisions": [3, 2, 1]}
    return load_case(
        {
            "block": {"type": "boxes", "boxes": [box, other, box]},
            "load": {"pressure": pressure},
            "material": {"density": 2.4e-9, "young_modulus": 33e3, "poisson_ratio": 0.0},
            "contact": {"clearance_at_zero_pressure": 1e-3, "pressure_at_zero_clearance": 1e-4},
            "fem": {"method": "static"},
        }
    )


def overclosure(pressure: float) -> float:
    """Invert p0 / (e - 1) (x/c + 1) (exp(x/c + 1) - 1), the law as Abaqus states it."""

    def excess(x: float) -> float:
        y = x / 1e-3 + 1.0
        return float(1e-4 / np.expm1(1.0) * y * np.expm1(y) - pressure)

    return float(brentq(excess, -1e-3, 0.1, xtol=1e-16, rtol=1e-14))


def brick_corners() -> FloatArray:
    base = np.array([[0, 0, 0], [100, 0, 0], [100, 80, 0], [0, 80, 0]], dtype=np.float64)
    return np.concatenate([base, base + np.array([0.0, 0.0, 50.0])])


def write_stl(path: Path, solid: Polyhedron) -> None:
    meshio.write(path, meshio.Mesh(solid.points, [("triangle", solid.triangles)]))


def own_scene(
    folder: Path, parts: str, *, load: str = "[effects]\ngravity = [0, 0, -9810]\n"
) -> Case:
    path = folder / "own.toml"
    path.write_text(f'[block]\ntype = "mesh"\n{parts}\n{load}{SECTIONS}', "utf-8")
    return load_case(path)
