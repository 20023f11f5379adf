"""Blocks as placed copies of few shapes, whatever they are made of: what rigid analysis needs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from geometry.errors import RefusedError
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Blocks smaller or larger than this (∛V) are drawn in other units than millimetres [mm].
SMALLEST_BLOCK, LARGEST_BLOCK = 1.0, 1e5


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
class PlacedBlocks(ABC, Generic[AnyShape]):
    """Blocks as placed copies of shapes, x = rotation @ X + translation, some of them fixed."""

    name: str
    """What reports and decks call it."""
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

    @property
    def n_blocks(self) -> int:
        """Number of blocks, the frame included."""
        return len(self.shape_of)

    @property
    def free_blocks(self) -> IntArray:
        """Numbers of the blocks outside the frame, (n_free,)."""
        return np.flatnonzero(~self.fixed)

    def shape(self, block: int) -> AnyShape:
        """Return the shape of one block."""
        return self.shapes[int(self.shape_of[block])]

    def place(self, block: int, points: FloatArray) -> FloatArray:
        """World coordinates of points given in a block's reference position, (n, 3) [mm]."""
        return points @ self.rotations[block].T + self.translations[block]

    @cached_property
    def centroids(self) -> FloatArray:
        """Mass centroid of each block in world coordinates, (n_blocks, 3) [mm]."""
        local = np.array([shape.centroid for shape in self.shapes])
        turned = np.einsum("bij,bj->bi", self.rotations, local[self.shape_of])
        return turned + self.translations

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


def check_size(assembly: AnyBlocks) -> None:
    """Refuse sizes that say that the lengths are not in millimetres.

    Raises
    ------
    AssemblyError
        For blocks outside 1 mm … 100 m.
    """
    length = assembly.characteristic_length
    if not SMALLEST_BLOCK <= length <= LARGEST_BLOCK:
        raise AssemblyError(
            f"{assembly.name}: a block measures {length:.3g} mm (∛ volume); expected lengths in "
            f"millimetres, blocks from {SMALLEST_BLOCK:g} to {LARGEST_BLOCK:g} mm: if yours are in "
            'metres, multiply by 1000 (own meshes: block.units = "m")'
        )
