"""Assemblies of triangulated blocks: rigid only, contacts found without matching nodes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from geometry.block import Block
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.placed import AssemblyError, PlacedBlocks
from geometry.polyhedra.facet_contact import PatchContacts, find_contacts
from geometry.polyhedra.options import DetectionOptions
from geometry.polyhedra.placed_shapes import PlacedShapes
from geometry.polyhedra.polyhedron import Polyhedron, polyhedron_from_block

#: Default contact tolerance in block lengths ∛V.
_RELATIVE_TOLERANCE = 1e-4


@dataclass(frozen=True, kw_only=True)
class PolyhedralAssembly(PlacedBlocks[Polyhedron]):
    """Triangulated blocks whose contacts are found without matching nodes."""

    detection: DetectionOptions = field(default_factory=DetectionOptions)
    """Tolerances of contact detection."""

    def __repr__(self) -> str:
        """Name and size: arrays are not printed."""
        return f"<{self.name}: {self.n_blocks} blocks, {len(self.free_blocks)} of them free>"

    def points(self, block: int) -> FloatArray:
        """World coordinates of a block's vertices, (n_points, 3) [mm]."""
        return self.place(block, self.shape(block).points)

    @property
    def tolerance(self) -> float:
        """Largest gap or overlap of touching facets [mm]."""
        if self.detection.tolerance is not None:
            return self.detection.tolerance
        return _RELATIVE_TOLERANCE * self.characteristic_length

    @cached_property
    def interfaces(self) -> PatchContacts:
        """Contacts between blocks, found once."""
        return self.contacts_within(self.tolerance)

    def placed(self, tolerance: float) -> PlacedShapes:
        """Triangles where they stand, for searches within a tolerance [mm]."""
        return PlacedShapes(self, tolerance)

    def contacts_within(self, tolerance: float) -> PatchContacts:
        """Contacts found with another tolerance [mm]."""
        found = self.detection
        return find_contacts(self.placed(tolerance), angle=found.angle, placement=found.points)

    def with_faces_alone(self) -> PolyhedralAssembly:
        """The same blocks, which touch where contacts have an area and nowhere else."""
        return self._touching(self.interfaces.on_areas)

    def bearing(self) -> PolyhedralAssembly:
        """The same blocks, which touch where friction counts and nowhere else."""
        return self._touching(self.interfaces.bears)

    def only(self, there: BoolArray) -> PolyhedralAssembly:
        """The same blocks, some there, (n_blocks,); others count as fixed and touch nothing."""
        found = self.interfaces
        return self._touching(there[found.block_m] & there[found.block_s], self.fixed | ~there)

    def _touching(self, contacts: BoolArray, fixed: BoolArray | None = None) -> PolyhedralAssembly:
        if contacts.all() and fixed is None:
            return self
        return _WithSomeContacts(
            **self.as_placed | ({} if fixed is None else {"fixed": fixed}),
            shapes=self.shapes,
            detection=self.detection,
            found=self.interfaces.some(contacts),
        )

    def joint_centroids(self, pairs: IntArray) -> FloatArray:
        """Centroid of the contact area of each of some pairs of blocks, sorted, (n, 3) [mm].

        Pairs (n, 2) that only touch at points get the mean of those.
        """
        result, n = self.interfaces, self.n_blocks
        middles, areas, patch = result.polygons.triangle_areas
        keys = pairs[:, 0] * n + pairs[:, 1]
        of_area = result.patches.block_m[patch] * n + result.patches.block_s[patch]
        bare = result.patch < 0
        of_point = (result.block_m * n + result.block_s)[bare]
        only = ~np.isin(of_point, of_area)
        key = np.concatenate([of_area, of_point[only]])
        points = np.concatenate([middles, result.centroids[bare][only]])
        weight = np.concatenate([areas, np.ones(int(only.sum()))])
        known = np.isin(key, keys)
        row = np.searchsorted(keys, key[known])
        total = np.zeros((len(keys), 3))
        np.add.at(total, row, weight[known, None] * points[known])
        return total / np.bincount(row, weights=weight[known], minlength=len(keys))[:, None]

    def eligible_facets(self) -> IntArray:
        """Contact points of each block, (n_blocks,)."""
        interfaces, n = self.interfaces, self.n_blocks
        return np.bincount(interfaces.block_m, minlength=n) + np.bincount(
            interfaces.block_s, minlength=n
        )

    def eligible_areas(self) -> FloatArray:
        """Contact area of each block, (n_blocks,) [mm²]."""
        interfaces, areas = self.interfaces, np.zeros(self.n_blocks)
        np.add.at(areas, interfaces.block_m, interfaces.areas)
        np.add.at(areas, interfaces.block_s, interfaces.areas)
        return areas


@dataclass(frozen=True, kw_only=True)
class _WithSomeContacts(PolyhedralAssembly):
    """Blocks that touch at some of the places found."""

    found: PatchContacts

    @cached_property
    def interfaces(self) -> PatchContacts:
        return self.found


def polyhedral_assembly(
    name: str,
    blocks: list[tuple[Polyhedron, FloatArray, FloatArray]],
    fixed: BoolArray,
    detection: DetectionOptions | None = None,
    names: tuple[str, ...] = (),
    *,
    supported: bool = False,
) -> PolyhedralAssembly:
    """Assemble blocks given as (shape, rotation, translation); equal shapes are shared.

    ``supported``: parts of free blocks are held, so no block need be fixed.

    Raises
    ------
    AssemblyError
        When nothing is free, or nothing is fixed.
    """
    if not blocks:
        raise AssemblyError(f"{name}: got no blocks; expected at least two")
    if not (fixed.any() or supported):
        raise AssemblyError(
            f"{name}: no block is fixed; without a frame every assembly moves away as a whole: "
            "name fixed blocks, or state supports"
        )
    if fixed.all():
        raise AssemblyError(f"{name}: all {len(blocks)} blocks are fixed; leave some free")
    shapes: list[Polyhedron] = []
    shape_of = []
    for shape, _, _ in blocks:
        known = next((i for i, other in enumerate(shapes) if other is shape), None)
        if known is None:
            known = len(shapes)
            shapes.append(shape)
        shape_of.append(known)
    return PolyhedralAssembly(
        name=name,
        shapes=tuple(shapes),
        shape_of=np.array(shape_of, dtype=np.int64),
        rotations=np.array([rotation for _, rotation, _ in blocks], dtype=np.float64),
        translations=np.array([shift for _, _, shift in blocks], dtype=np.float64),
        fixed=fixed,
        names=names,
        detection=detection or DetectionOptions(),
    )


def as_polyhedral(
    assembly: PlacedBlocks[Block], detection: DetectionOptions | None = None
) -> PolyhedralAssembly:
    """Return a hexahedral assembly as triangulated blocks whose contacts are to be detected."""
    return PolyhedralAssembly(
        **assembly.as_placed,
        shapes=tuple(polyhedron_from_block(shape) for shape in assembly.shapes),
        detection=detection or DetectionOptions(),
    )


def bare_joints(surfaces: PolyhedralAssembly) -> list[tuple[int, int]]:
    """Pairs of blocks that touch along edges or at points alone."""
    result = surfaces.interfaces
    pairs = np.sort(np.column_stack([result.block_m, result.block_s]), axis=1)
    key = pairs[:, 0] * surfaces.n_blocks + pairs[:, 1]
    bare = np.unique(pairs[~np.isin(key, key[result.patch >= 0])], axis=0)
    return [(m, s) for m, s in bare.tolist()]


def contact_distance(assembly: PolyhedralAssembly) -> IntArray:
    """Least number of joints between each block and a held one, (n_blocks,).

    Blocks that no chain of joints connects to a held one get the number after the largest.
    """
    patches, n = assembly.interfaces.patches, assembly.n_blocks
    ends = np.unique(np.column_stack([patches.block_m, patches.block_s]), axis=0).T
    graph = coo_array((np.ones(len(ends[0])), (ends[0], ends[1])), shape=(n, n)).tocsr()
    distance = dijkstra(
        graph,
        directed=False,
        indices=np.flatnonzero(assembly.fixed) if assembly.fixed.any() else [0],
        unweighted=True,
        min_only=True,
    )
    reached = np.isfinite(distance)
    last = distance[reached].max() + 1
    return np.where(reached, distance, last).astype(np.int64)
