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
    from geometry.assembly import Assembly
    from geometry.block import Block, box_block
    from geometry.errors import RefusedError
    from geometry.families.boxes import BrickStack, ColumnBox, SeparateBoxes, box_column
    from geometry.families.hexagon_block import HexagonBlockParameters as HexagonBlock
    from geometry.families.indenter import Indenter
    from geometry.families.masonry import CircularArch, RunningBondWall
    from geometry.families.planar_wall import OsteomorphicWall, PlanarSineWall
    from geometry.families.platonic_layers import CubesLayer, OctahedraLayer, TetrahedraLayer
    from geometry.families.sine_block import SineBlockParameters as SineBlock
    from geometry.families.tube import tube
    from geometry.families.versatile_panel import VersatilePanel
    from geometry.families.voxels import VoxelPuzzle
    from geometry.files.block_files import read_blocks
    from geometry.files.mesh_io import contact_mesh
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
    from geometry.parts.regions import Box, Plane
    from geometry.parts.supports import HeldFace
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
    "Answer": ("geometry.answer", "Answer"),
    "Assembly": ("geometry.assembly", "Assembly"),
    "Block": ("geometry.block", "Block"),
    "Box": ("geometry.parts.regions", "Box"),
    "BrickStack": ("geometry.families.boxes", "BrickStack"),
    "CircularArch": ("geometry.families.masonry", "CircularArch"),
    "ColumnBox": ("geometry.families.boxes", "ColumnBox"),
    "CubesLayer": ("geometry.families.platonic_layers", "CubesLayer"),
    "DetectionOptions": ("geometry.polyhedra.options", "DetectionOptions"),
    "HeldFace": ("geometry.parts.supports", "HeldFace"),
    "HexMesh": ("geometry.mesh", "HexMesh"),
    "HexagonBlock": ("geometry.families.hexagon_block", "HexagonBlockParameters"),
    "Indenter": ("geometry.families.indenter", "Indenter"),
    "LineLoad": ("geometry.loads", "LineLoad"),
    "Load": ("geometry.loads", "Load"),
    "LoadCase": ("geometry.loads", "LoadCase"),
    "Measure": ("geometry.answer", "Measure"),
    "OctahedraLayer": ("geometry.families.platonic_layers", "OctahedraLayer"),
    "OsteomorphicWall": ("geometry.families.planar_wall", "OsteomorphicWall"),
    "PlanarSineWall": ("geometry.families.planar_wall", "PlanarSineWall"),
    "Plane": ("geometry.parts.regions", "Plane"),
    "PolyhedralAssembly": ("geometry.polyhedra.assembly", "PolyhedralAssembly"),
    "Polyhedron": ("geometry.polyhedra.polyhedron", "Polyhedron"),
    "PressureLoad": ("geometry.loads", "PressureLoad"),
    "RefusedError": ("geometry.errors", "RefusedError"),
    "RunningBondWall": ("geometry.families.masonry", "RunningBondWall"),
    "SeparateBoxes": ("geometry.families.boxes", "SeparateBoxes"),
    "SineBlock": ("geometry.families.sine_block", "SineBlockParameters"),
    "TetrahedraLayer": ("geometry.families.platonic_layers", "TetrahedraLayer"),
    "TractionLoad": ("geometry.loads", "TractionLoad"),
    "VersatilePanel": ("geometry.families.versatile_panel", "VersatilePanel"),
    "VoxelPuzzle": ("geometry.families.voxels", "VoxelPuzzle"),
    "beam": ("geometry.loads", "beam"),
    "box_block": ("geometry.block", "box_block"),
    "box_column": ("geometry.families.boxes", "box_column"),
    "contact_mesh": ("geometry.files.mesh_io", "contact_mesh"),
    "convex_polyhedron": ("geometry.polyhedra.polyhedron", "convex_polyhedron"),
    "effective_facets": ("geometry.parts.measures", "effective_facets"),
    "pillar": ("geometry.loads", "pillar"),
    "pipe": ("geometry.loads", "pipe"),
    "read_blocks": ("geometry.files.block_files", "read_blocks"),
    "shaft": ("geometry.loads", "shaft"),
    "tube": ("geometry.families.tube", "tube"),
    "tunnel": ("geometry.loads", "tunnel"),
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'geometry' has no attribute {name!r}")
    module, there = _PLACES[name]
    return getattr(import_module(module), there)


def __dir__() -> list[str]:
    return __all__
