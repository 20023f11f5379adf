"""What rigid-block analysis needs of an assembly, whatever its blocks are made of."""

from __future__ import annotations

from typing import Protocol

from geometry.assembly import BoolArray
from geometry.mesh import FloatArray, IntArray


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


class ContactAssembly(Protocol):
    """Placed blocks, some of them fixed, and the contacts between them."""

    @property
    def name(self) -> str:
        """What reports call it."""

    @property
    def fixed(self) -> BoolArray:
        """Whether the block belongs to the frame, (n_blocks,)."""

    @property
    def n_blocks(self) -> int:
        """Number of blocks, the frame included."""

    @property
    def free_blocks(self) -> IntArray:
        """Numbers of the blocks outside the frame, (n_free,)."""

    @property
    def centroids(self) -> FloatArray:
        """Mass centroid of each block, (n_blocks, 3) [mm]."""

    @property
    def volumes(self) -> FloatArray:
        """Volume of each block, (n_blocks,) [mm³]."""

    @property
    def characteristic_length(self) -> float:
        """Length that makes moments comparable to forces [mm]."""

    @property
    def interfaces(self) -> ContactSet:
        """Contacts between blocks."""

    def eligible_facets(self) -> IntArray:
        """Contacts that each block could have, (n_blocks,)."""

    def eligible_areas(self) -> FloatArray:
        """Their total area, (n_blocks,) [mm²]."""
