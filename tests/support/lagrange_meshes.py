"""Block shapes of every family, and their meshes of any degree."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial import cKDTree

from fem.decks.meshes import serendipity_block
from fem.element.lagrange_mesh import LagrangeMesh, with_degree
from geometry import HexagonBlock
from geometry.block import Block
from geometry.families.hexagon_block import (
    HexagonBlockDivisions,
    bottom_hexagon_frame,
    hexagon_block,
)
from geometry.families.planar_wall import OsteomorphicWall
from geometry.families.sine_block import SineBlockDivisions, sine_block
from geometry.mesh import FloatArray
from tests.support.blocks import tsb

HEXAGON = HexagonBlock(blocks_per_layer=4, inner_radius=120.0, thickness=40.0)


WALL = OsteomorphicWall(100.0, 40.0, 60.0, 8.0, divisions=(4, 2, 2), columns=1, layers=1).build()


def sine(divisions: tuple[int, int, int] = (12, 1, 2)) -> Block:
    return sine_block(tsb(), SineBlockDivisions(*divisions))


CURVED = {
    "sine": sine(),
    "hexagon": hexagon_block(HEXAGON, HexagonBlockDivisions(2, 1)),
    "half hexagon": bottom_hexagon_frame(HEXAGON, HexagonBlockDivisions(2, 1)),
    "osteomorphic": WALL.shapes[0],
}


def relative(value: FloatArray, expected: FloatArray) -> float:
    return float(np.abs(value - expected).max() / np.abs(expected).max())


def from_twenty(block: Block) -> tuple[Block, FloatArray]:
    """Block of 20-node hexahedra, and the displacements of 27 nodes that theirs make, (27n, 20n).

    The middle of a face follows its corners by -1/4 and its middles by 1/2, that of an element its
    corners by -1/4 and the middles of its edges by 1/4: the functions of the 20-node element.
    """
    twenty, mesh = serendipity_block(block), with_degree(block, 2).mesh
    assert isinstance(mesh, LagrangeMesh)
    tree = cKDTree(twenty.mesh.nodes)
    follow = np.zeros((mesh.n_nodes, twenty.mesh.n_nodes))
    for members, theirs in zip(mesh.members, twenty.mesh.connectivity, strict=True):
        grid = members.reshape(3, 3, 3)
        for place in np.ndindex(3, 3, 3):
            inside = [axis for axis in range(3) if place[axis] == 1]
            node = grid[place]
            follow[node] = 0.0
            if len(inside) <= 1:
                follow[node, tree.query(mesh.nodes[node])[1]] = 1.0
                continue
            for shift in itertools.product((-1, 0, 1), repeat=len(inside)):
                zeros = shift.count(0)
                if zeros > 1:
                    continue
                near = np.array(place)
                near[inside] += shift
                share = -0.25 if zeros == 0 else 0.5 if len(inside) == 2 else 0.25
                follow[node, tree.query(mesh.nodes[grid[tuple(near)]])[1]] += share
        assert set(theirs) >= set(np.flatnonzero(follow[members].any(axis=0)))
    return twenty, follow
