"""Assemblies: copies of a few block shapes, placed by rigid motions, some of them fixed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from geometry.block import Block
from geometry.interface import Interfaces, match_facets
from geometry.mesh import FloatArray, IntArray
from geometry.placed_blocks import AssemblyError, PlacedBlocks


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
    image_of: IntArray | None = None
    """Block whose translated image each block is, itself where it is none, (n_blocks,): what a
    periodic cell meets at its end. None: no images."""

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

    def inertia(self, block: int, density: float) -> FloatArray:
        """Inertia tensor about the block's centroid in world axes, (3, 3) [t mm²]."""
        rotation = self.rotations[block]
        inertia: FloatArray = (
            density * rotation @ self.shape(block).mass_properties.inertia @ rotation.T
        )
        return inertia

    @cached_property
    def interfaces(self) -> Interfaces:
        """Conforming contact facets between blocks, found once.

        Raises
        ------
        AssemblyError
            When facets of free blocks that should meet a neighbour meet none.
        """
        found = match_facets(self.shapes, self.shape_of, self.rotations, self.translations)
        if not self.unmatched_allowed:
            self._check_partners(found)
        return found

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
        image_of=None if assembly.image_of is None else number[assembly.image_of[order]],
    )
