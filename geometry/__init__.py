"""What is built, supported and loaded: meshes, blocks, assemblies, load cases; and answers.

What most need::

    from geometry import SineBlock, pipe, tube

    blocks = tube(
        SineBlock(height=200, amplitude=20, frequency=1.5, blocks_per_layer=4,
                  inner_radius=120, thickness=40),
        layers=2, mesh=(24, 2, 4),
    )

| | |
|---|---|
| `SineBlock`, `HexagonBlock` | parameters of a block of a tube |
| `tube` | layers of such blocks between two frames |
| `Assembly.from_blocks` | blocks of any shape: solids, trimesh, pyvista, compas, arrays |
| `read_blocks` | blocks of a file: STL, OBJ, STEP and more |
| `convex_polyhedron`, `Polyhedron` | a block of flat faces |
| `PolyhedralAssembly` | such blocks, placed, with their contacts |
| `DetectionOptions` | what counts as contact of such blocks |
| `Assembly` | any blocks with hexahedra, placed by rigid motions |
| `PlanarSineWall`, `OsteomorphicWall`, `BrickStack` | walls of hexahedra, by `.build()` |
| `SeparateBoxes`, `box_column` of `ColumnBox` | boxes apart and on each other |
| `Indenter` | a roller or a ball on a plane body |
| `TetrahedraLayer`, `OctahedraLayer`, `CubesLayer`, `VersatilePanel` | planar layers in a ring |
| `RunningBondWall`, `CircularArch`, `VoxelPuzzle` | masonry and puzzles |
| `pipe`, `tunnel`, `pillar`, `beam`, `shaft` | the load cases of a tube, from a pressure in MPa |
| `Load` | a load before it is put on blocks |
| `LoadCase` | loads on faces and edges of any blocks, and what is held while they act |
| `PressureLoad`, `TractionLoad`, `LineLoad` | such loads |
| `HeldFace` | a face that is held, moved or on springs |
| `Box`, `Plane` | parts of surfaces by their place |
| `box_block`, `Block` of a `HexMesh` | a box, any block of hexahedra |
| `Answer`, `Measure` | what a solver returns, and one number of it |
| `effective_facets` | which facets carry, of their pressures |
| `RefusedError` | what is wrong with an input, in one line: every error of the packages is one |
| `contact_mesh` | contact facets of an assembly as a pyvista mesh |
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from geometry.answer import Answer, Measure
    from geometry.assembly import Assembly, contact_mesh
    from geometry.block import Block, box_block
    from geometry.errors import RefusedError
    from geometry.families.boxes import BrickStack, ColumnBox, SeparateBoxes, box_column
    from geometry.families.hexagon_block import HexagonBlock
    from geometry.families.indenter import Indenter
    from geometry.families.masonry import CircularArch, RunningBondWall
    from geometry.families.planar_wall import OsteomorphicWall, PlanarSineWall
    from geometry.families.platonic_layers import CubesLayer, OctahedraLayer, TetrahedraLayer
    from geometry.families.sine_block import SineBlock
    from geometry.families.tube import tube
    from geometry.families.versatile_panel import VersatilePanel
    from geometry.families.voxels import VoxelPuzzle
    from geometry.files.block_files import read_blocks
    from geometry.loads import (
        LineLoad,
        Load,
        LoadCase,
        PressureLoad,
        TractionLoad,
        beam,
        pillar,
        pipe,
        shaft,
        tunnel,
    )
    from geometry.mesh import HexMesh
    from geometry.parts.measures import effective_facets
    from geometry.parts.regions import Box, HeldFace, Plane
    from geometry.polyhedra.assembly import PolyhedralAssembly
    from geometry.polyhedra.options import DetectionOptions
    from geometry.polyhedra.polyhedron import Polyhedron, convex_polyhedron

__all__ = [
    "Answer",
    "Assembly",
    "Block",
    "Box",
    "BrickStack",
    "CircularArch",
    "ColumnBox",
    "CubesLayer",
    "DetectionOptions",
    "HeldFace",
    "HexMesh",
    "HexagonBlock",
    "Indenter",
    "LineLoad",
    "Load",
    "LoadCase",
    "Measure",
    "OctahedraLayer",
    "OsteomorphicWall",
    "PlanarSineWall",
    "Plane",
    "PolyhedralAssembly",
    "Polyhedron",
    "PressureLoad",
    "RefusedError",
    "RunningBondWall",
    "SeparateBoxes",
    "SineBlock",
    "TetrahedraLayer",
    "TractionLoad",
    "VersatilePanel",
    "VoxelPuzzle",
    "beam",
    "box_block",
    "box_column",
    "contact_mesh",
    "convex_polyhedron",
    "effective_facets",
    "pillar",
    "pipe",
    "read_blocks",
    "shaft",
    "tube",
    "tunnel",
]

#: Where each name comes from: imported when it is asked for, for commands start sooner without.
_PLACES = {
    "Answer": "geometry.answer",
    "Assembly": "geometry.assembly",
    "Block": "geometry.block",
    "Box": "geometry.parts.regions",
    "BrickStack": "geometry.families.boxes",
    "CircularArch": "geometry.families.masonry",
    "ColumnBox": "geometry.families.boxes",
    "CubesLayer": "geometry.families.platonic_layers",
    "DetectionOptions": "geometry.polyhedra.options",
    "HeldFace": "geometry.parts.regions",
    "HexMesh": "geometry.mesh",
    "HexagonBlock": "geometry.families.hexagon_block",
    "Indenter": "geometry.families.indenter",
    "LineLoad": "geometry.loads",
    "Load": "geometry.loads",
    "LoadCase": "geometry.loads",
    "Measure": "geometry.answer",
    "OctahedraLayer": "geometry.families.platonic_layers",
    "OsteomorphicWall": "geometry.families.planar_wall",
    "PlanarSineWall": "geometry.families.planar_wall",
    "Plane": "geometry.parts.regions",
    "PolyhedralAssembly": "geometry.polyhedra.assembly",
    "Polyhedron": "geometry.polyhedra.polyhedron",
    "PressureLoad": "geometry.loads",
    "RefusedError": "geometry.errors",
    "RunningBondWall": "geometry.families.masonry",
    "SeparateBoxes": "geometry.families.boxes",
    "SineBlock": "geometry.families.sine_block",
    "TetrahedraLayer": "geometry.families.platonic_layers",
    "TractionLoad": "geometry.loads",
    "VersatilePanel": "geometry.families.versatile_panel",
    "VoxelPuzzle": "geometry.families.voxels",
    "beam": "geometry.loads",
    "box_block": "geometry.block",
    "box_column": "geometry.families.boxes",
    "contact_mesh": "geometry.assembly",
    "convex_polyhedron": "geometry.polyhedra.polyhedron",
    "effective_facets": "geometry.parts.measures",
    "pillar": "geometry.loads",
    "pipe": "geometry.loads",
    "read_blocks": "geometry.files.block_files",
    "shaft": "geometry.loads",
    "tube": "geometry.families.tube",
    "tunnel": "geometry.loads",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'geometry' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return __all__
