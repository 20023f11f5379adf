"""Blocks whose contacts are facets that face each other, whether or not they match.

Rigid blocks touch where a search of deformable ones finds facets of the finer of two surfaces in
front of the other, before any displacement: each with the part of its area that faces one block.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from fem.contact.search import FacingPoints, points_of_search
from fem.system.contact_state import ContactState, block_surface, facets_that_fit, searched_state
from geometry.assembly import Assembly
from geometry.interface import Interfaces
from geometry.mesh import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True)
class FacingBlocks(Assembly):
    """An assembly whose interfaces a search found.

    Block m of an interface is the one whose facet it is. Fields of the facets of block s are -1: no
    single facet of it is the partner.
    """

    @cached_property
    def found(self) -> ContactState:
        """Facets that face a block, before any displacement; pressures in it mean nothing."""
        still = np.zeros(3)
        surfaces = tuple(
            block_surface(self, block, still)
            for block in range(self.n_blocks)
            if len(self.shape(block).contact_quads)
        )
        found = points_of_search(FacingPoints(surfaces, reach=0.0), 0.0)
        return searched_state(found, np.zeros_like(found.corners), None)

    @cached_property
    def interfaces(self) -> Interfaces:
        """Facets that face a block, sorted by block pair."""
        result = self.found
        facet = _positions(result)
        quads = np.empty((result.n_facets, 4), dtype=np.int64)
        for block in np.unique(result.block_s).tolist():
            mine = result.block_s == block
            quads[mine] = self.shape(block).contact_quads[facet[mine]]
        change = (np.diff(result.block_m) != 0) | (np.diff(result.block_s) != 0)
        start = np.concatenate([[0], np.flatnonzero(change) + 1, [result.n_facets]])
        start = np.unique(start).astype(np.int64)
        n_pairs = len(start) - 1
        return Interfaces(
            block_m=result.block_s,
            block_s=result.block_m,
            quads_m=quads,
            quads_s=np.full_like(quads, -1),
            facet_m=facet,
            facet_s=np.full_like(facet, -1),
            centroids=_centres(result),
            normals=-result.mean_normals,
            areas=result.areas,
            pair_start=start,
            pair_class=np.arange(n_pairs),
            pair_rotations=np.tile(np.eye(3), (n_pairs, 1, 1)),
        )

    def eligible_facets(self) -> IntArray:
        """How many of the facets that were found cover the contact faces of each block."""
        return np.rint(facets_that_fit(self, self.found)).astype(np.int64)


def facing_blocks(assembly: Assembly) -> FacingBlocks:
    """Return the same blocks with contacts that a search finds."""
    return FacingBlocks(**{part.name: getattr(assembly, part.name) for part in fields(assembly)})


def _positions(state: ContactState) -> IntArray:
    """Position of each facet in the contact facets of its block, (n_facets,)."""
    assert state.position_s is not None
    return state.position_s


def _centres(state: ContactState) -> FloatArray:
    """Centroids of the parts of facets that face their block, (n_facets, 3) [mm]."""
    total = np.zeros((state.n_facets, 3))
    np.add.at(total, state.facet, state.point_areas[:, None] * state.positions)
    return total / state.areas[:, None]
