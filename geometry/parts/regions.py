"""Where something acts: parts of the surfaces of blocks, what holds them, forces on nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from geometry.block import Block
from geometry.errors import RefusedError
from geometry.mesh import BoolArray, FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.placed import AnyBlocks

if TYPE_CHECKING:
    from scipy.spatial import KDTree


#: Distance from a plane or a box that still counts as on it, in block sizes (∛V).
_ON = 1e-6


def _check_vectors(what: str, *vectors: FloatArray) -> None:
    """Reject what are no vectors of three numbers; ∞ is one, NaN is none."""
    for vector in vectors:
        if np.shape(vector) != (3,) or np.isnan(vector).any():
            raise RefusedError(f"{what}: got {np.asarray(vector).tolist()}; expected three numbers")


def _words(vector: FloatArray) -> str:
    """A vector in six digits, far fewer than those of its floats."""
    return f"({', '.join(f'{x + 0.0:.6g}' for x in vector)})"


@dataclass(frozen=True)
class Plane(ReadOnlyArrays):
    """What of a surface lies on a plane."""

    point: FloatArray
    """A point of it, world coordinates, (3,) [mm]."""
    normal: FloatArray
    """(3,), of any length but zero."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_vectors("plane", self.point, self.normal)
        if not self.normal.any():
            raise RefusedError("plane: got the normal [0, 0, 0]; expected a direction")

    def has(self, points: FloatArray, tolerance: float) -> BoolArray:
        """Whether each of some points (..., 3) [mm] lies on it within a distance [mm]."""
        unit = self.normal / np.linalg.norm(self.normal)
        away: FloatArray = np.abs((points - self.point) @ unit)
        return np.asarray(away <= tolerance, dtype=np.bool_)

    def __str__(self) -> str:
        """In words."""
        return f"the plane through {_words(self.point)} normal to {_words(self.normal)}"


@dataclass(frozen=True)
class Box(ReadOnlyArrays):
    """What of a surface lies in a box; a thin one chooses an edge or a point."""

    low: FloatArray
    """Least coordinates, (3,) [mm]."""
    high: FloatArray
    """Largest coordinates, (3,) [mm]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_vectors("box", self.low, self.high)

    def has(self, points: FloatArray, tolerance: float) -> BoolArray:
        """Whether each of some points (..., 3) [mm] lies in it within a distance [mm]."""
        inside = (points >= self.low - tolerance) & (points <= self.high + tolerance)
        return np.asarray(inside.all(axis=-1), dtype=np.bool_)

    def __str__(self) -> str:
        """In words."""
        return f"the box from {_words(self.low)} to {_words(self.high)}"


@dataclass(frozen=True)
class Edges(ReadOnlyArrays):
    """Edges of a block's surface between corners that are at some places, and those corners."""

    places: FloatArray
    """World coordinates, (n, 3) [mm]."""

    @cached_property
    def _tree(self) -> KDTree:
        from scipy.spatial import KDTree

        return KDTree(self.places)

    def has(self, points: FloatArray, tolerance: float) -> BoolArray:
        """Whether each of some points (..., 3) [mm] lies at one within a distance [mm]."""
        return np.isfinite(self._tree.query(points, distance_upper_bound=2.0 * tolerance)[0])

    def __str__(self) -> str:
        """In words."""
        return (
            f"the edges between {len(self.places)} points, the first at {self.places[0].tolist()}"
        )


#: Part of a block: a face by its name, what of the surface lies on a plane or in a box, or edges.
Where: TypeAlias = str | Plane | Box | Edges


def region_quads(assembly: AnyBlocks, block: int, where: Where) -> IntArray:
    """Facets of a block in a region, all corners of each inside; corner nodes, (n, 4).

    Of a triangulated block (n, 3).
    """
    if isinstance(where, str):
        named: IntArray = assembly.shape(block).faces[where]
        return named
    quads = _facets(assembly, block)
    inside = where.has(_nodes(assembly, block), _tolerance(assembly))
    return quads[inside[quads].all(axis=1)]


def region_nodes(assembly: AnyBlocks, block: int, where: Where) -> IntArray:
    """Surface nodes of a block in a region, those between corners too, ascending; (n,)."""
    shape = assembly.shape(block)
    named = isinstance(where, str)
    if isinstance(where, Edges):
        corners = np.flatnonzero(where.has(_nodes(assembly, block), _tolerance(assembly)))
        return _between(assembly, block, corners)
    quads = region_quads(assembly, block, where) if named else _facets(assembly, block)
    nodes = np.unique(shape.mesh.facet_nodes(quads) if isinstance(shape, Block) else quads)
    if isinstance(where, str):
        return nodes
    return nodes[where.has(_nodes(assembly, block)[nodes], _tolerance(assembly))]


def _between(assembly: AnyBlocks, block: int, corners: IntArray) -> IntArray:
    """Corners, and nodes on the edges and facets of the surface all of whose corners they are."""
    shape, outer = assembly.shape(block), _facets(assembly, block)
    inside = np.isin(outer, corners)
    own = [corners]
    if isinstance(shape, Block):
        all_of = shape.mesh.facet_nodes(outer)
        own.append(all_of[inside.all(axis=1)].ravel())
        pairs = np.stack([outer, np.roll(outer, -1, axis=1)], axis=2)
        facet, side = np.nonzero(inside & np.roll(inside, -1, axis=1))
        order = np.lexsort(np.sort(pairs[facet, side], axis=1).T)
        # Two facets share an edge, and its nodes.
        for one, other in facet[order].reshape(-1, 2).tolist():
            own.append(np.intersect1d(all_of[one], all_of[other]))
    return np.unique(np.concatenate(own))


def blocks_with(assembly: AnyBlocks, where: Where) -> IntArray:
    """Blocks with surface nodes in a region, (n,)."""
    return np.array(
        [
            block
            for block in range(assembly.n_blocks)
            if not isinstance(where, str) or where in _names(assembly.shape(block))
            if len(region_nodes(assembly, block, where))
        ],
        dtype=np.int64,
    )


def first_met(assembly: AnyBlocks, block: int, direction: FloatArray) -> Plane:
    """The plane of what a flat punch that comes along a direction touches first of a block."""
    unit = direction / np.linalg.norm(direction)
    nodes = _nodes(assembly, block)
    return Plane(nodes[int(np.argmin(nodes @ unit))], unit)


def _tolerance(assembly: AnyBlocks) -> float:
    return _ON * assembly.characteristic_length


def _nodes(assembly: AnyBlocks, block: int) -> FloatArray:
    return assembly.place(block, local_nodes(assembly, block))


def local_nodes(assembly: AnyBlocks, block: int) -> FloatArray:
    """Nodes of a block, or its vertices, in its own frame, (n, 3) [mm]."""
    shape = assembly.shape(block)
    nodes: FloatArray = shape.mesh.nodes if isinstance(shape, Block) else shape.points
    return nodes


def region_points(assembly: AnyBlocks, block: int, where: Where) -> FloatArray:
    """Surface nodes of a block in a region, world coordinates, (n, 3) [mm]."""
    return _nodes(assembly, block)[region_nodes(assembly, block, where)]


def _facets(assembly: AnyBlocks, block: int) -> IntArray:
    """Corners of all facets of the surface of a block, (n, 4), or of its triangles, (n, 3)."""
    shape = assembly.shape(block)
    facets: IntArray = shape.boundary if isinstance(shape, Block) else shape.triangles
    return facets


def _names(shape: object) -> tuple[str, ...]:
    """Names of the faces of a shape; triangulated ones have none."""
    return tuple(shape.faces) if isinstance(shape, Block) else ()


def region_edges(
    assembly: AnyBlocks, block: int, start: FloatArray, end: FloatArray
) -> tuple[IntArray, IntArray]:
    """Edges of the surface of a block that lie between two points (3,) [mm], each once.

    Returns
    -------
    tuple[IntArray, IntArray]
        Corners of a facet that has the edge, (n, 4), and the corner at which it begins, (n,).
    """
    points, near = _nodes(assembly, block), _tolerance(assembly)
    length = float(np.linalg.norm(end - start))
    way = (end - start) / max(length, 1e-300)
    along = (points - start) @ way
    away = np.linalg.norm(points - start - np.outer(along, way), axis=1)
    on = (away <= near) & (along >= -near) & (along <= length + near)
    outer = _facets(assembly, block)
    pairs = np.stack([outer, np.roll(outer, -1, axis=1)], axis=2)
    facet, first = np.nonzero(on[pairs].all(axis=2))
    _, once = np.unique(np.sort(pairs[facet, first], axis=1), axis=0, return_index=True)
    return outer[facet[once]], first[once]


def check_blocks(
    assembly: AnyBlocks, blocks: IntArray, what: str, error: type[RefusedError]
) -> None:
    """Reject no blocks, and numbers that no block has."""
    given = np.asarray(blocks)
    if not given.size or given.ndim != 1 or not np.issubdtype(given.dtype, np.integer):
        raise error(f"{what}: got blocks {given.tolist()}; expected the number of one at least")
    wrong = given[(given < 0) | (given >= assembly.n_blocks)]
    if wrong.size:
        raise error(
            f"{what}: got block {wrong[0]}, but there are {assembly.n_blocks} blocks, numbered 0 "
            f"to {assembly.n_blocks - 1}"
        )


def check_region(
    assembly: AnyBlocks, blocks: IntArray, where: Where, what: str, error: type[RefusedError]
) -> None:
    """Reject a name that one of some blocks has for no face, and a region without facets."""
    check_blocks(assembly, blocks, what, error)
    if not isinstance(where, str):
        if not any(len(region_quads(assembly, block, where)) for block in blocks.tolist()):
            raise error(
                f"{what}: no facet of the blocks {listed(blocks)} lies on {where}; expected a "
                "region with facets (are coordinates in mm?)"
            )
        return
    for number in np.unique(assembly.shape_of[blocks]):
        shape = assembly.shapes[number]
        if where not in _names(shape):
            block = blocks[assembly.shape_of[blocks] == number][0]
            known = ", ".join(_names(shape))
            raise error(
                f"{what}: block {block} ({shape.name}) has no face {where!r}; "
                + (f"expected one of {known}" if known else "expected a plane or a box")
            )


def listed(blocks: IntArray) -> str:
    """Numbers of blocks, the first six."""
    return ", ".join(map(str, blocks[:6].tolist())) + (", …" if len(blocks) > 6 else "")


@dataclass(frozen=True)
class NodeForces(ReadOnlyArrays):
    """Dead forces on nodes of some blocks, which are named by their places."""

    block: IntArray
    """Block of each force, (n,)."""
    centroids: FloatArray
    """Places of the nodes, world coordinates, (n, 3) [mm]."""
    forces: FloatArray
    """World axes, (n, 3) [N]."""

    @property
    def area_vectors(self) -> FloatArray:
        """A node has none, (n, 3)."""
        return np.zeros_like(self.forces)

    def on_nodes(self, block: int, nodes: FloatArray) -> FloatArray | None:
        """Force on each of the nodes (m, 3) [mm] of a block, world axes, (m, 3) [N]; None: none."""
        mine = np.flatnonzero(self.block == block)
        if not len(mine):
            return None
        forces = np.zeros_like(nodes)
        for row in mine.tolist():
            nearest = int(np.argmin(np.linalg.norm(nodes - self.centroids[row], axis=1)))
            forces[nearest] += self.forces[row]
        return forces


class SupportError(RefusedError):
    """A support that the blocks cannot have."""


#: Name of a support that pushes its block.
PUSH = "push"
#: Part of a motion that may lie across the directions that are held: digits of a scene [-].
_ACROSS = 1e-3


@dataclass(frozen=True)
class HeldFace(ReadOnlyArrays):
    """Part of the surface of a block that is held, moved or on springs while a load acts."""

    block: int
    """Its block, which deforms."""
    face: Where
    """Name of the face, or where on the surface."""
    directions: FloatArray | None = None
    """Unit vectors, world axes, along which it is held, orthogonal to each other, (n, 3); None: in
    all three. A roller is held along its normal."""
    displacement: FloatArray | None = None
    """By which the held components move, (3,) [mm]; None: they stay where they are."""
    path: tuple[tuple[float, float], ...] = ()
    """Times [s] and shares of the displacement, straight between; (): from none to all of it."""
    spring: float | None = None
    """Stiffness of springs per area between the surface and the ground along the directions
    [N/mm³]; None: held fast."""
    name: str = ""
    """In tables of reactions; empty: of the face."""

    def __post_init__(self) -> None:
        super().__post_init__()
        directions = self.directions
        if directions is not None:
            product = directions @ directions.T
            if directions.ndim != 2 or np.abs(product - np.eye(len(directions))).max() > 1e-9:
                raise SupportError(
                    f"support: got directions {directions.tolist()}; expected unit vectors that "
                    "are orthogonal to each other, (n, 3)"
                )
        if self.spring is not None and not (np.isfinite(self.spring) and self.spring > 0.0):
            raise SupportError(
                f"support {self.title}: got springs of {self.spring}; expected a positive "
                "stiffness in N/mm³"
            )
        if self.displacement is not None and not np.isfinite(self.displacement).all():
            raise SupportError(
                f"support {self.title}: got a motion by {self.displacement.tolist()}; expected "
                "three finite mm"
            )
        times = [time for time, _ in self.path]
        late = bool(times) and (times[0] < 0.0 or self.path[0][1] != 0.0)
        if late or len(times) == 1 or times != sorted(set(times)):
            raise SupportError(
                f"support {self.title}: got the path {[list(row) for row in self.path]}; expected "
                "two rows at least, increasing times and a first share of 0"
            )
        self._refuse_free_motion()
        if self.spring is not None and self.displacement is not None:
            raise SupportError(
                "support: got springs that move; expected springs or a motion, one of the two"
            )

    def _refuse_free_motion(self) -> None:
        """Reject a motion across the directions that are held: nothing would come of it."""
        move = self.displacement
        if move is None:
            return
        lost = move - move @ self.axes.T @ self.axes
        if np.abs(lost).max() > _ACROSS * np.abs(move).max():
            raise SupportError(
                f"support {self.title}: got a motion by {move.tolist()} where it is held along "
                f"{self.axes.tolist()} alone: nothing moves it by {lost.round(12).tolist()}; "
                "expected a motion along the directions that are held"
            )

    @property
    def axes(self) -> FloatArray:
        """Directions along which it is held, (n, 3)."""
        return np.eye(3) if self.directions is None else self.directions

    @property
    def moves(self) -> bool:
        """Whether it moves along a direction along which it is held."""
        return self.displacement is not None and bool((self.axes @ self.displacement).any())

    @property
    def is_push(self) -> bool:
        """Whether it moves a block against what holds it, and rigid blocks give its limit."""
        return self.moves and self.name == PUSH

    @property
    def title(self) -> str:
        """Its name, or that of the face."""
        return self.name or str(self.face)

    def check(self, assembly: AnyBlocks) -> None:
        """Reject a region without nodes, and springs without facets."""
        check_blocks(assembly, np.array([self.block]), f"support {self.title}", SupportError)
        if isinstance(self.face, str) or self.spring is not None:
            check_region(assembly, np.array([self.block]), self.face, "support", SupportError)
        elif not len(region_nodes(assembly, self.block, self.face)):
            raise SupportError(
                f"support: no surface node of block {assembly.named(self.block)} lies on "
                f"{self.face}; expected a region with nodes (are coordinates in mm?)"
            )
