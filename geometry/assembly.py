"""Assemblies: copies of a few block shapes, placed by rigid motions, some of them fixed.

`PlacedBlocks` is what rigid analysis needs of blocks, whatever they are made of.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic, Literal, Protocol, TypeVar

import numpy as np

from geometry.block import Block
from geometry.errors import RefusedError
from geometry.interface import Interfaces, match_facets
from geometry.mesh import BoolArray, FloatArray, IntArray, ReadOnlyArrays

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly
    from geometry.polyhedra.options import DetectionOptions

#: Blocks smaller or larger than this (∛V) are drawn in other units than millimetres [mm].
SMALLEST_BLOCK, LARGEST_BLOCK = 1.0, 1e5


#: Kinds of numbers, as people call them.
_KINDS: dict[type, str] = {np.integer: "integers", np.floating: "floats", np.bool_: "True or False"}


class AssemblyError(RefusedError):
    """An assembly that cannot be built as asked."""


class ContactSet(Protocol):
    """Contact points, sorted by block pair (m, s)."""

    @property
    def block_m(self) -> IntArray:
        """Master block, (n_contacts,)."""

    @property
    def block_s(self) -> IntArray:
        """Opposing block, (n_contacts,)."""

    @property
    def centroids(self) -> FloatArray:
        """Contact points in world coordinates, (n_contacts, 3) [mm]."""

    @property
    def normals(self) -> FloatArray:
        """Unit normal from block m to block s, (n_contacts, 3)."""

    @property
    def areas(self) -> FloatArray:
        """Area that each contact stands for, (n_contacts,) [mm²]."""

    @property
    def n_contacts(self) -> int:
        """Number of contacts."""


class Shape(Protocol):
    """A solid in its own reference position."""

    @property
    def volume(self) -> float:
        """Volume [mm³]."""

    @property
    def centroid(self) -> FloatArray:
        """Of its mass, (3,) [mm]."""


AnyShape = TypeVar("AnyShape", bound=Shape)


@dataclass(frozen=True, kw_only=True)
class PlacedBlocks(ReadOnlyArrays, ABC, Generic[AnyShape]):
    """Blocks as placed copies of shapes, x = rotation @ X + translation, some of them fixed."""

    name: str
    """Name in reports and decks."""
    shapes: tuple[AnyShape, ...]
    """Distinct block shapes."""
    shape_of: IntArray
    """Shape of each block, (n_blocks,)."""
    rotations: FloatArray
    """Rigid rotation of each block, (n_blocks, 3, 3)."""
    translations: FloatArray
    """Rigid translation of each block, (n_blocks, 3) [mm]."""
    fixed: BoolArray
    """Whether the block belongs to the frame or is the image of another one, (n_blocks,)."""
    names: tuple[str, ...] = ()
    """Name that its file gives each block, empty without one; () where no file does."""
    parts: tuple[int, ...] = ()
    """Which file each block comes from, in the order of the statement; () where none does."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_shapes()
        for what, unit in (("rotations", ""), ("translations", " in mm")):
            values = getattr(self, what)
            wrong = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
            if wrong.any():
                block = int(np.argmax(wrong))
                raise AssemblyError(
                    f"{self.name}: {what} of block {block}: got {values[block].tolist()}, expected "
                    f"finite numbers{unit}"
                )

    def _check_shapes(self) -> None:
        """Reject arrays that do not say where each block is and which of them are fixed."""
        n = len(self.shape_of)
        for what, kind, shape in (
            ("shape_of", np.integer, (n,)),
            ("rotations", np.floating, (n, 3, 3)),
            ("translations", np.floating, (n, 3)),
            ("fixed", np.bool_, (n,)),
        ):
            values = np.asarray(getattr(self, what))
            if values.shape != shape or not np.issubdtype(values.dtype, kind):
                raise AssemblyError(
                    f"{self.name}: {what}: got {values.dtype} of shape {values.shape}; expected "
                    f"{_KINDS[kind]} of shape {shape}, one row for each of {n} blocks"
                )

    @cached_property
    def kept(self) -> dict[Any, Any]:
        """What analyses compute of the blocks alone and use again, by keys of their own."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the blocks without it."""
        return {name: value for name, value in vars(self).items() if name != "kept"}

    @property
    def as_placed(self) -> dict[str, Any]:
        """Fields of the same blocks of other shapes, by name."""
        names = (field.name for field in fields(PlacedBlocks) if field.name != "shapes")
        return {name: getattr(self, name) for name in names}

    @property
    def n_blocks(self) -> int:
        """Number of blocks, the frame included."""
        return len(self.shape_of)

    @property
    def free_blocks(self) -> IntArray:
        """Numbers of the blocks outside the frame, (n_free,)."""
        return np.flatnonzero(~self.fixed)

    @cached_property
    def originals(self) -> IntArray:
        """Block that each block is or is the image of, (n_blocks,)."""
        return np.arange(self.n_blocks)

    def named(self, block: int) -> str:
        """Number of a block, with its name if it has one."""
        name = self.names[block] if self.names else ""
        return f"{block} ({name})" if name else str(block)

    def shape(self, block: int) -> AnyShape:
        """Return the shape of one block."""
        return self.shapes[int(self.shape_of[block])]

    def place(self, block: int, points: FloatArray) -> FloatArray:
        """World coordinates of points given in a block's reference position, (n, 3) [mm]."""
        return points @ self.rotations[block].T + self.translations[block]

    def place_each(self, points: FloatArray) -> FloatArray:
        """World coordinates of one point of each shape (n_shapes, 3), block by block [mm]."""
        turned = np.einsum("bij,bj->bi", self.rotations, points[self.shape_of])
        return turned + self.translations

    @cached_property
    def centroids(self) -> FloatArray:
        """Mass centroid of each block in world coordinates, (n_blocks, 3) [mm]."""
        return self.place_each(np.array([shape.centroid for shape in self.shapes]))

    @cached_property
    def volumes(self) -> FloatArray:
        """Volume of each block, (n_blocks,) [mm³]."""
        local = np.array([shape.volume for shape in self.shapes])
        return local[self.shape_of]

    @cached_property
    def characteristic_length(self) -> float:
        """Length that makes moments comparable to forces: ∛(mean block volume) [mm]."""
        return float(np.cbrt(self.volumes.mean()))

    @property
    @abstractmethod
    def interfaces(self) -> ContactSet:
        """Contacts between blocks."""

    @abstractmethod
    def eligible_facets(self) -> IntArray:
        """Contacts that each block could have, (n_blocks,)."""

    @abstractmethod
    def eligible_areas(self) -> FloatArray:
        """Their total area, (n_blocks,) [mm²]."""


#: Blocks of any shape.
AnyBlocks = PlacedBlocks[Any]


def require_size(size: tuple[float, float, float]) -> None:
    """Reject a box that has no volume [mm]."""
    if not (np.isfinite(size).all() and min(size) > 0):
        raise AssemblyError(f"size: got {list(size)}, expected three positive lengths in mm")


def check_size(assembly: AnyBlocks) -> None:
    """Reject sizes that say that the lengths are not in millimetres."""
    length = assembly.characteristic_length
    if not SMALLEST_BLOCK <= length <= LARGEST_BLOCK:
        raise AssemblyError(
            f"{assembly.name}: a block measures {length:.3g} mm (∛ volume); expected lengths in "
            f"millimetres, blocks from {SMALLEST_BLOCK:g} to {LARGEST_BLOCK:g} mm: if yours are in "
            'metres, multiply by 1000 (own meshes: units = "m")'
        )


@dataclass(frozen=True)
class UnmatchedJoint:
    """Two blocks that touch where their facets do not all match."""

    block_m: int
    """One block."""
    block_s: int
    """The other one."""
    touching: float
    """Area on which they touch [mm²]."""
    matched: float
    """Area of it on which facets match corner on corner [mm²]."""
    toward: FloatArray
    """Direction in which the face of block m looks, (3,)."""

    def __str__(self) -> str:
        """Name the blocks, the face, and the area that matches."""
        return (
            f"the meshes of blocks {self.block_m} and {self.block_s} do not match: facets meet "
            f"corner on corner on {self.matched:.4g} of the {self.touching:.4g} mm² on which the "
            f"blocks touch (face of block {self.block_m} that looks along "
            f"{np.round(self.toward, 3).tolist()})"
        )


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
