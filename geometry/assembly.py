"""Assemblies of blocks with hexahedra in layers, their contact facets, and where they overlap."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from geometry.block import Block
from geometry.interface import (
    ROUGHLY_SAME,
    Interfaces,
    coincident,
    match_facets,
    placements,
)
from geometry.mesh import HEX_TETRAHEDRA, BoolArray, FloatArray, IntArray, QuadSurface
from geometry.parts.placed import AssemblyError, PlacedBlocks, UnmatchedJoint, check_size

if TYPE_CHECKING:
    import pyvista as pv
    from scipy.spatial import cKDTree

    from geometry.polyhedra.assembly import PolyhedralAssembly
    from geometry.polyhedra.options import DetectionOptions
    from geometry.polyhedra.polyhedron import Polyhedron


@dataclass(frozen=True, kw_only=True)
class Assembly(PlacedBlocks[Block]):
    """Blocks with hexahedra in layers, which meet facet on facet."""

    layer: IntArray
    """Layer of each block: 0 the bottom frame, L + 1 the top frame; (n_blocks,)."""
    axis: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    """Unit axis of the tube (through `origin`), (3,)."""
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    """A point on the tube axis, (3,) [mm]."""
    unmatched_allowed: bool = False
    """Whether contact facets of free blocks may face nothing (planar stacks with open sides)."""
    unmatched: tuple[UnmatchedJoint, ...] | None = None
    """Joints where facets do not match corner on corner; None: as `unmatched_joints` finds them."""
    image_of: IntArray | None = None
    """Block whose translated image each block is, itself where it is none, (n_blocks,): what a
    periodic cell meets at its end. None: no images."""
    detection: DetectionOptions | None = None
    """How contacts of the solids were found that the hexahedra fill; None: blocks of a family."""

    @staticmethod
    def from_blocks(
        blocks: Iterable[Any],
        *,
        names: Sequence[str] | None = None,
        fixed: int | str | Iterable[int | str] | None = (),
        units: str = "mm",
        up: Literal["y", "z"] = "z",
        repair: bool = False,
        detection: DetectionOptions | None = None,
    ) -> PolyhedralAssembly:
        """Assemble blocks of any shape, which solvers of deformable blocks fill with hexahedra.

        Parameters
        ----------
        blocks
            Solids as `geometry.read_blocks` and `geometry.convex_polyhedron` make them [mm], or
            closed surfaces: objects with ``vertices`` or ``points`` and ``faces`` (trimesh,
            pyvista), with ``to_vertices_and_faces`` (compas), or pairs of vertices (n, 3) and
            faces, triangles or polygons. Each closed part of a surface is a block; one that faces
            inward is turned.
        names
            Of the blocks; by default those of their file, or none.
        fixed
            Blocks that do not move: their numbers, counted from 0, or names; supports of a file are
            fixed too. None: no other block is, for supports of the load hold parts of free blocks.
        units
            Of the vertices of surfaces: mm, cm, m or inch.
        up
            Axis that points up; y becomes z.
        repair
            Whether to drop triangles of surfaces that are there twice, to turn those that face the
            wrong way and to close flat holes.
        detection
            Tolerances of contact detection.

        Raises
        ------
        MeshError
            What is no block, or a surface that bounds no solid: open, folded, cutting through
            itself.
        AssemblyError
            Names that are there twice, blocks to fix that are not there, nothing fixed or
            everything, blocks of an implausible size, that overlap, or that touch no other.
        """
        # Loaded here: tubes need no contact detection.
        from geometry.files.memory import fixed_among, rotation_to_z, solids_of
        from geometry.polyhedra.assembly import polyhedral_assembly
        from geometry.polyhedra.overlap import check_assembly

        solids, turn = solids_of(blocks, names, units=units, repair=repair), rotation_to_z(up)
        given = tuple(solid.given_name for solid in solids)
        assembly = polyhedral_assembly(
            "own blocks",
            [(solid, turn, np.zeros(3)) for solid in solids],
            fixed_among(solids, fixed),
            detection,
            given if any(given) else (),
            supported=fixed is None,
        )
        check_size(assembly)
        check_assembly(assembly, np.arange(len(solids)) if fixed is None else None)
        return assembly

    def __repr__(self) -> str:
        """Name and size: arrays are not printed."""
        free = self.free_blocks
        elements = sum(self.shape(block).mesh.n_elements for block in free)
        parts = f"{self.n_blocks} blocks, {len(free)} of them free with {elements} elements"
        return f"<{self.name}: {parts}>"

    @cached_property
    def originals(self) -> IntArray:
        """Block that each block is or is the image of, (n_blocks,)."""
        return np.arange(self.n_blocks) if self.image_of is None else self.image_of

    @property
    def n_layers(self) -> int:
        """Number of free layers L."""
        return int(self.layer.max()) - 1

    def nodes(self, block: int) -> FloatArray:
        """World coordinates of a block's mesh nodes, (n_nodes, 3) [mm]."""
        return self.place(block, self.shape(block).mesh.nodes)

    @cached_property
    def interfaces(self) -> Interfaces:
        """Conforming contact facets between blocks, found once.

        Raises
        ------
        AssemblyError
            When facets of free blocks that should meet a neighbour meet none.
        """
        matched = match_facets(self)
        if not self.unmatched_allowed:
            self._check_partners(matched)
        return matched

    def only(self, there: BoolArray) -> Assembly:
        """The same blocks, some there, (n_blocks,); others count as fixed and touch nothing."""
        found = self.interfaces
        first = found.pair_start[:-1]
        pairs = there[found.block_m[first]] & there[found.block_s[first]]
        own = {name: getattr(self, name) for name in ("shapes", "layer", "axis", "origin")}
        return _WithSomeFacets(
            **self.as_placed | {"fixed": self.fixed | ~there},
            **own,
            unmatched_allowed=True,
            unmatched=self.unmatched,
            found=found.some(pairs),
        )

    def eligible_facets(self) -> IntArray:
        """Facets of each block that can meet another block, k_b of the paper; (n_blocks,)."""
        count = np.array([len(shape.contact_quads) for shape in self.shapes])
        return count[self.shape_of]

    def eligible_areas(self) -> FloatArray:
        """Total area of those facets, (n_blocks,) [mm²]."""
        area = np.array(
            [sum(float(s.surface(f).areas.sum()) for f in s.contact_faces) for s in self.shapes]
        )
        return area[self.shape_of]

    def _check_partners(self, found: Interfaces) -> None:
        apart = ~(self.fixed[found.block_m] & self.fixed[found.block_s])
        met = np.bincount(self.originals[found.block_m[apart]], minlength=self.n_blocks)
        met += np.bincount(self.originals[found.block_s[apart]], minlength=self.n_blocks)
        missing = np.where(self.fixed, 0, self.eligible_facets() - met)
        if missing.any():
            block = int(np.argmax(missing))
            raise AssemblyError(
                f"{self.name}: {int(missing.sum())} contact facets of free blocks meet no "
                f"partner (block {block}: {int(missing[block])}); expected conforming meshes: "
                "choose element counts that conform or allow open faces"
            )


def moved(assembly: Assembly, rotation: FloatArray, translation: FloatArray) -> Assembly:
    """Return the whole assembly after the rigid motion x ↦ rotation @ x + translation."""
    return replace(
        assembly,
        rotations=rotation @ assembly.rotations,
        translations=assembly.translations @ rotation.T + translation,
        axis=rotation @ assembly.axis,
        origin=rotation @ assembly.origin + translation,
    )


def renumbered(assembly: Assembly, order: IntArray) -> Assembly:
    """Return the same assembly with block ``order[i]`` renamed i."""
    number = np.argsort(order)
    return replace(
        assembly,
        shape_of=assembly.shape_of[order],
        rotations=assembly.rotations[order],
        translations=assembly.translations[order],
        layer=assembly.layer[order],
        fixed=assembly.fixed[order],
        unmatched=None,
        image_of=None if assembly.image_of is None else number[assembly.image_of[order]],
    )


@dataclass(frozen=True, kw_only=True)
class _WithSomeFacets(Assembly):
    """Blocks that touch at some of the facets found."""

    found: Interfaces

    @cached_property
    def interfaces(self) -> Interfaces:
        return self.found


def spacing_offsets(assembly: Assembly, spacing: float) -> FloatArray:
    """Translations that move touching blocks apart by a spacing [mm], (n_blocks, 3) [mm].

    Layers move apart along the axis by the spacing; a negative one presses blocks into each other.
    Within a layer, blocks move across the axis so that the mean gap between each two neighbours is
    the spacing, with translations of least norm: outward in a ring, sideways in a wall. Frame
    blocks move with their layer, images of a periodic cell as what they are images of.

    Blocks of neighbouring layers thereby slip against each other, so where their common face
    is inclined the gap measured along the normal is less or more than the spacing.
    """
    if not np.isfinite(spacing):
        raise AssemblyError(f"spacing: got {spacing}, expected a finite length in mm")
    if spacing == 0.0:
        return np.zeros((assembly.n_blocks, 3))
    opening = _opening_of_layers(assembly)[assembly.originals]
    return spacing * (np.outer(assembly.layer, assembly.axis) + opening)


def _opening_of_layers(assembly: Assembly) -> FloatArray:
    """Translations across the axis that open neighbours within a layer by one; (n_blocks, 3)."""
    interfaces = assembly.interfaces
    first = interfaces.pair_start[:-1]
    m, s = interfaces.block_m[first], interfaces.block_s[first]
    normal = np.add.reduceat(interfaces.areas[:, None] * interfaces.normals, first, axis=0)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal -= np.outer(normal @ assembly.axis, assembly.axis)
    inside = np.flatnonzero(assembly.layer[m] == assembly.layer[s])
    opening = np.zeros((assembly.n_blocks, 3))
    for layer in np.unique(assembly.layer[m[inside]]):
        pairs = inside[assembly.layer[m[inside]] == layer]
        blocks = np.flatnonzero(assembly.layer == layer)
        rates = np.zeros((len(pairs), len(blocks), 3))
        row = np.arange(len(pairs))
        rates[row, np.searchsorted(blocks, m[pairs])] -= normal[pairs]
        rates[row, np.searchsorted(blocks, s[pairs])] += normal[pairs]
        least = np.linalg.lstsq(rates.reshape(len(pairs), -1), np.ones(len(pairs)), rcond=None)[0]
        opening[blocks] = least.reshape(-1, 3)
    return opening


def matched_area(assembly: Assembly, block_m: int, block_s: int) -> float:
    """Area of the facets of two blocks that coincide corner on corner [mm²].

    Of four triangles round the middle of each, as `polyhedron_from_block` cuts them.
    """
    interfaces = assembly.interfaces
    meets = (interfaces.block_m == block_m) & (interfaces.block_s == block_s)
    corners = assembly.shape(block_m).mesh.nodes[interfaces.quads_m[meets]]
    arms = corners - corners.mean(axis=1, keepdims=True)
    doubled = np.linalg.norm(np.cross(arms, np.roll(arms, -1, axis=1)), axis=2)
    return 0.5 * float(doubled.sum())


def interface_surface(assembly: Assembly, contacts: IntArray | None = None) -> QuadSurface:
    """Contact facets in world coordinates, four nodes of their own each.

    ``contacts`` are positions in `assembly.interfaces`; all by default.
    """
    interfaces = assembly.interfaces
    chosen = np.arange(interfaces.n_contacts) if contacts is None else contacts
    block, quads = interfaces.block_m[chosen], interfaces.quads_m[chosen]
    corners = np.empty((len(chosen), 4, 3))
    for number in np.unique(assembly.shape_of[block]):
        rows = np.flatnonzero(assembly.shape_of[block] == number)
        local = assembly.shapes[number].mesh.nodes[quads[rows]]
        turned = np.einsum("fij,fcj->fci", assembly.rotations[block[rows]], local)
        corners[rows] = turned + assembly.translations[block[rows], None, :]
    return QuadSurface(corners.reshape(-1, 3), np.arange(4 * len(chosen)).reshape(-1, 4))


def contact_mesh(
    assembly: Assembly, contacts: IntArray | None = None, **values: FloatArray
) -> pv.PolyData:
    """Contact facets as a mesh that pyvista draws.

    Parameters
    ----------
    assembly
        Blocks and their interfaces.
    contacts
        Positions in `assembly.interfaces`, such as `mbd.RigidSystem.contact_index`; all by default.
    **values
        One value for each contact, such as ``pressure``, by the name that the mesh gives it.
    """
    import pyvista as pv

    surface = interface_surface(assembly, contacts)
    mesh = pv.PolyData.from_regular_faces(surface.nodes, surface.quads)
    for name, value in values.items():
        mesh.cell_data[name] = value
    return mesh


# ---------------------------------------------------------------------------------------------
# Blocks that share space

#: Points of two meshes that lie closer than this share of a block are one.
_SAME = 1e-9


def check_mesh_overlaps(assembly: Assembly, tolerance: float) -> None:
    """Reject blocks that lie deeper in each other than a tolerance [mm].

    Corners and middles of facets and of elements are looked at. Pairs of equal shapes in equal
    relative positions are looked at once.
    """
    solids = [_Solid(shape) for shape in assembly.shapes]
    boxes = np.array([[corners.min(axis=0), corners.max(axis=0)] for corners in _ends(assembly)])
    low, high = boxes[:, 0] + 0.5 * tolerance, boxes[:, 1] - 0.5 * tolerance
    near = [np.zeros((0, 2), dtype=np.int64)]
    for a in range(assembly.n_blocks - 1):
        later = np.arange(a + 1, assembly.n_blocks)
        share = (low[a] < high[later]).all(axis=1) & (low[later] < high[a]).all(axis=1)
        later = later[share & ~(assembly.fixed[a] & assembly.fixed[later])]
        near.append(np.column_stack([np.full_like(later, a), later]))
    pairs = np.concatenate(near)
    size = float(np.ptp(boxes.reshape(-1, 3), axis=0).max())
    result: list[tuple[float, int, int]] = []
    for way in placements(pairs, assembly, size=size, same=ROUGHLY_SAME):
        one, other = solids[way.shape_m], solids[way.shape_s]
        shift = way.translation[:, None]
        of_b = way.rotation @ other.points + shift
        of_a = way.rotation.T @ (one.points - shift)
        depth = max(one.depth(of_b), other.depth(of_a))
        if depth > tolerance:
            depth = one.overlap(other, (way.rotation, way.translation), tolerance)
        result += [(depth, m, s) for m, s in pairs[way.pairs].tolist()]
    depth, a, b = max(result, default=(0.0, 0, 0))
    if depth > tolerance:
        n = sum(one[0] > tolerance for one in result)
        more = f" ({n} overlapping pairs)" if n > 1 else ""
        raise AssemblyError(
            f"{assembly.name}: blocks {assembly.named(a)} and {assembly.named(b)} overlap by "
            f"{depth:.3g} mm{more}; expected blocks that touch within {tolerance:.3g} mm: move "
            "them apart (to override: check_blocks=False)"
        )


def _ends(assembly: Assembly) -> Iterator[FloatArray]:
    """Nodes of each block on its surface, (n, 3) [mm]."""
    for block in range(assembly.n_blocks):
        shape = assembly.shape(block)
        yield assembly.place(block, shape.mesh.nodes[shape.surface_nodes])


class _Solid:
    """A shape as points, and as hexahedra that points may lie in."""

    def __init__(self, shape: Block) -> None:
        mesh, self._shape = shape.mesh, shape
        # Short axes first: reductions over a short last one are ten times as slow.
        self._corners = mesh.nodes[mesh.elements[:, :8].T]
        middles = mesh.nodes[shape.boundary.T].mean(axis=0)
        surface = np.concatenate([mesh.nodes[shape.surface_nodes], middles])
        centres = self._corners.mean(axis=0)
        self.points = np.concatenate([surface, centres]).T.copy()
        """On the boundary, and the middles of the elements, (3, n) [mm]."""
        self._surface, self._centres = surface, centres
        self._low, self._high = self._corners.min(axis=0), self._corners.max(axis=0)
        self._box = self._low.min(axis=0), self._high.max(axis=0)
        farthest = np.maximum(self._high - centres, centres - self._low)
        self._radius = float(np.linalg.norm(farthest, axis=1).max())

    def depth(self, points: FloatArray) -> float:
        """How deep the deepest of some points (3, n) lies inside [mm]."""
        low, high = self._box
        near = ((points - low[:, None] > 0.0) & (points - high[:, None] < 0.0)).all(axis=0)
        points = points[:, near].T
        if len(points):
            same = coincident(points, self._surface, _SAME * float(np.ptp([low, high])))
            points = points[same == len(self._surface)]
        inside = self._inside(points)
        if not inside.any():
            return 0.0
        from geometry.polyhedra.overlap import SignedDistance

        return float(-SignedDistance(self._polyhedron)(points[inside]).min())

    def overlap(
        self, other: _Solid, motion: tuple[FloatArray, FloatArray], tolerance: float
    ) -> float:
        """Depth of the overlap with a solid that is placed by a motion [mm]."""
        from geometry.polyhedra.overlap import overlap_depth

        return overlap_depth(self._polyhedron, other._polyhedron, motion, tolerance)[0]

    @cached_property
    def _polyhedron(self) -> Polyhedron:
        from geometry.polyhedra.polyhedron import polyhedron_from_block

        return polyhedron_from_block(self._shape)

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self._centres, balanced_tree=False)

    def _inside(self, points: FloatArray) -> BoolArray:
        """Whether points (n, 3) lie in a hexahedron, cut into tetrahedra; (n,)."""
        from scipy.spatial import cKDTree  # takes longer to load than most runs take

        near = cKDTree(points).sparse_distance_matrix(
            self._tree, self._radius, output_type="ndarray"
        )
        point, element = near["i"], near["j"]
        in_box = (points[point] >= self._low[element]) & (points[point] <= self._high[element])
        may = in_box.all(axis=1)
        point, corners = point[may], self._corners[:, element[may]]
        inside = np.zeros(len(points), dtype=np.bool_)
        for tetrahedron in HEX_TETRAHEDRA:
            ends = corners[tetrahedron]
            edges = np.moveaxis(ends[1:] - ends[0], 0, 2)
            solid = np.linalg.det(edges) != 0.0  # flat ones of distorted hexahedra have no inside
            arms = (points[point] - ends[0])[solid, :, None]
            shares = np.linalg.solve(edges[solid], arms)[:, :, 0]
            within = (shares >= 0.0).all(axis=1) & (shares.sum(axis=1) <= 1.0)
            inside[point[solid][within]] = True
        return inside
