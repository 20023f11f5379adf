"""Families of triangulated blocks with known verdicts."""

from __future__ import annotations

from validation.scene.family import family
from validation.scene.keys.quantities import SIZE
from validation.scene.polyhedra import PolyhedralScene

for _kind, _shape, _assembly in (
    ("tetrahedra", "platonic_layers:TetrahedraLayer", "columns rows freed"),
    ("octahedra", "platonic_layers:OctahedraLayer", "rings"),
    ("cubes", "platonic_layers:CubesLayer", "rings"),
    ("versatile", "versatile_panel:VersatilePanel", "columns rows"),
    ("wall", "masonry:RunningBondWall", "columns rows"),
    ("arch", "masonry:CircularArch", "voussoirs embrace"),
    ("voxels", "voxels:VoxelPuzzle", "fixed"),
):
    _place = f"geometry.families.{_shape}"
    family(PolyhedralScene, _kind, _place, assembly=_assembly, about={"size": SIZE})
