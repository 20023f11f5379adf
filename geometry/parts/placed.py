"""Placed copies of shapes: what rigid analysis needs of blocks, whatever they are made of."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from geometry.errors import RefusedError
from geometry.mesh import BoolArray, FloatArray, IntArray, ReadOnlyArrays

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

    @abstractmethod
    def only(self, there: BoolArray) -> PlacedBlocks[AnyShape]:
        """The same blocks, some there, (n_blocks,); others count as fixed and touch nothing."""


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
        hint = 'if yours are in metres, multiply by 1000 (own meshes: units = "m")'
        if length > LARGEST_BLOCK:
            hint = 'if a file in millimetres states metres, write units = "mm" or scale it by 0.001'
        raise AssemblyError(
            f"{assembly.name}: a block measures {length:.3g} mm (∛ volume); expected lengths in "
            f"millimetres, blocks from {SMALLEST_BLOCK:g} to {LARGEST_BLOCK:g} mm: {hint}"
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
    """Direction that the face of block m faces, (3,)."""

    def __str__(self) -> str:
        """Name the blocks, the face, and the area that matches."""
        return (
            f"the meshes of blocks {self.block_m} and {self.block_s} do not match: facets meet "
            f"corner on corner on {self.matched:.4g} of the {self.touching:.4g} mm² on which the "
            f"blocks touch (face of block {self.block_m} that faces along "
            f"{np.round(self.toward, 3).tolist()})"
        )
