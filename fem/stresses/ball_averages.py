"""Stresses averaged over the parts of balls that lie in a block.

An average is a mean over cells: places with a volume and a stress. Those of elements of degree 1
are their integration points, or whole elements where these are small against the ball. Stresses are
known nowhere else there, so balls lie around centres of elements alone.

Elements of higher degree are cut into cells, those on the edge of a ball count in part: first
everywhere, then where averages are largest at closer and closer places, surfaces included, and with
smaller and smaller cells; the last ones are extrapolated to vanishing cells. In blocks with too
many balls of that size larger balls are averaged first, and smaller ones only where those have the
most tension.

Fourteen numbers are tuned, because the smallest cells at the closest places would take thousands
of times as long everywhere. Nine decide the value: two sizes of cells, three distances of centres
and four shares of the largest average that a place needs to be looked at more closely. Five limit
work and memory.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from fem.element.functions import line_basis
from fem.element.hexahedron import point_volumes
from fem.element.kinds import integration_points
from fem.element.lagrange import Lagrange, adjugates
from fem.element.material import Material, largest_tension, principal_stress, stress_of_gradient
from fem.system.body import Body
from geometry.machine.work import Operation, count
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.measures import first_largest

#: Size of cells over the radius of a ball.
_CELL = 0.3
#: The same of the cells of the first look, whose centres are a radius apart.
_ROUGH = 0.5
#: Distances of the centres of balls after that over their radius: looked at with the same cells,
#: with small ones, and with cells of half of that size as well, …
_CENTRES = (0.5, 0.25, 0.12)
#: … where averages before are these parts of the largest one.
_FAIR, _GOOD, _BETTER, _BEST = 0.6, 0.9, 0.96, 0.995
#: Centres that are looked at more closely, at most: in a bar in tension all have the largest one.
_MOST = 500
#: Places are first looked for this many times as far apart.
_STEPS = 4
#: Cells of the first look, at most. Where balls are so
#: small that there would be more, larger ones are averaged first; this many of those are kept.
_MOST_CELLS, _FEW = 400_000, 200
#: Points of an element among which those near some places are looked for one by one.
_MOST_POINTS = 10_000


@dataclass(frozen=True)
class MovedBodies:
    """Congruent bodies of curved elements, each in its own frame."""

    element: Lagrange
    material: Material
    positions: FloatArray
    """Nodes, (n_nodes, 3) [mm]."""
    elements: IntArray
    """Nodes of each element, (n_elements, (degree + 1)³)."""
    displacements: FloatArray
    """Of the nodes of every body, (n_bodies, n_nodes, 3) [mm]."""


def moved_bodies(body: Body, local: FloatArray) -> MovedBodies:
    """Copies of a body with elements of a degree above 1.

    Displacements are those in block frames, (n_copies, n_nodes, 3) [mm].
    """
    mesh, element = body.mesh, Lagrange(body.mesh.degree)
    return MovedBodies(element, body.material, mesh.nodes, mesh.connectivity, local)


@dataclass(frozen=True)
class PointValue:
    """A value and its place in one of some congruent bodies."""

    value: float
    """[MPa] or [mm]."""
    layer: int
    """Number of the body, from 1: of a tube's layers the lowest free one."""
    position: FloatArray
    """In the body's own position, (3,) [mm]."""


def averaged_tension(bodies: MovedBodies, radius: float) -> tuple[PointValue, PointValue]:
    """Largest σ₁ of the stress averaged over the part of a ball [mm] that lies in a block.

    Returns
    -------
    tuple[PointValue, PointValue]
        At the centre of that ball, and the largest at a point of those that are averaged. Near a
        surface they lie closer to it than the Gauss points of a large element.
    """
    nodes = bodies.positions[bodies.elements]
    middles = nodes.mean(axis=1)
    reach = np.linalg.norm(nodes - middles[:, None], axis=2).max(axis=1)

    def near(centres: FloatArray, distance: float) -> IntArray:
        apart = np.linalg.norm(middles[:, None] - centres[None], axis=2).min(axis=1)
        return np.flatnonzero(apart <= reach + distance * radius)

    def cells(centres: FloatArray, size: float, spread: float) -> _Cells:
        """Of balls that lie a part of the radius from these at most."""
        within = 1.0 + spread + 0.5 * size
        return _cells(bodies, near(centres, within), size * radius, (centres, within * radius))

    def between(centres: FloatArray, spread: float, spacing: float) -> FloatArray:
        within = spread * radius
        return _points_between(bodies, near(centres, spread), spacing * radius, (centres, within))

    radii = [radius]
    every = np.arange(len(nodes))
    while np.prod(_counts(bodies, every, _ROUGH * radii[-1]), axis=1).sum() > _MOST_CELLS:
        radii.append(2.0 * radii[-1])
    rough = _cells(bodies, every, _ROUGH * radii[-1])
    places = rough.positions[one_of_each_cube(rough.positions, radii[-1])]
    for wide, narrow in pairwise(reversed(radii)):
        centres = _largest(places, _tension(rough, places, wide, _ROUGH), _FAIR, _FEW)
        within = wide + 3.0 * narrow  # balls and centres that are looked at after them included
        rough = _cells(bodies, near(centres, within / radius), _ROUGH * narrow, (centres, within))
        inside = rough.positions[
            np.isfinite(cKDTree(centres).query(rough.positions, distance_upper_bound=wide)[0])
        ]
        places = inside[one_of_each_cube(inside, narrow)]
    most = len(places) if len(radii) == 1 else _MOST
    fair = _largest(places, _tension(rough, places, radius, _ROUGH), _FAIR, most)
    places = between(fair, 1.0, _CENTRES[0])
    good = _largest(places, _tension(rough, places, radius, _ROUGH), _GOOD)
    coarse = cells(good, _CELL, sum(_CENTRES))
    places = between(good, _CENTRES[0], _CENTRES[1])
    better = _largest(places, _tension(coarse, places, radius, _CELL), _BETTER)
    fine = cells(better, 0.5 * _CELL, _CENTRES[1])

    def extrapolated(centres: FloatArray) -> FloatArray:
        """With errors that go like the square of the size of cells."""
        finer = _tension(fine, centres, radius, 0.5 * _CELL)
        return finer + (finer - _tension(coarse, centres, radius, _CELL)) / 3.0

    best = _largest(better, extrapolated(better), _BEST)
    places = between(best, _CENTRES[1], _CENTRES[2])
    result = extrapolated(places)
    return _largest_at(result, places), _largest_at(largest_tension(fine.stress).T, fine.positions)


def _largest_at(values: FloatArray, positions: FloatArray) -> PointValue:
    """The largest of values (n_bodies, n) at positions (n, 3)."""
    layer, which = np.unravel_index(first_largest(values), values.shape)
    return PointValue(float(values.max()), int(layer) + 1, positions[which])


def _largest(
    places: FloatArray, tension: FloatArray, share: float, at_most: int = _MOST
) -> FloatArray:
    """Places (n, 3) at which a body has this share of the largest tension (n_bodies, n) or more.

    Of more than ``at_most`` the largest, of equal ones the first.
    """
    of_all = tension.max(axis=0)
    most = float(of_all.max())
    falls = (most - of_all) / (abs(most) or 1.0)
    order = np.argsort(np.round(falls, 6), kind="stable")[:at_most]
    return places[np.sort(order[falls[order] <= 1.0 - share])]


def _points_between(
    bodies: MovedBodies, elements: IntArray, size: float, near: tuple[FloatArray, float]
) -> FloatArray:
    """Points of elements, their surfaces included, a distance at most apart near some places.

    A ball reaches its largest mean on the surface of a block, where half of it lies outside.

    Returns
    -------
    FloatArray
        (n, 3) [mm]
    """
    tree, within = cKDTree(near[0]), near[1]
    steps = _counts(bodies, elements, _STEPS * size)
    result = []
    for element, counts in zip(elements[:, None], steps, strict=True):
        lines = [np.linspace(-1.0, 1.0, n + 1) for n in counts]
        for box in _boxes(bodies, element, lines, tree, within + _STEPS * size):
            lines = [_finer(line, 2.0 / n) for line, n in zip(box, counts, strict=True)]
            points = _grid(bodies, element, lines)
            result.append(points[_near(points, tree, within)])
    return np.unique(np.round(np.concatenate(result), 6), axis=0)


def _finer(line: FloatArray, step: float) -> FloatArray:
    """Points of a line that goes on for a step at both ends, each step in parts."""
    start, end = max(line[0] - step, -1.0), min(line[-1] + step, 1.0)
    return np.linspace(start, end, 1 + int(np.ceil((end - start) * _STEPS / step - 1e-9)))


def _counts(bodies: MovedBodies, elements: IntArray, size: float) -> IntArray:
    """Into how many parts of a size at most elements are cut in each direction, (n, 3)."""
    line = bodies.element.degree + 1
    nodes = bodies.positions[bodies.elements[elements]].reshape(-1, line, line, line, 3)
    counts = np.ones((len(elements), 3), dtype=np.int64)
    for axis in range(3):
        lengths = np.linalg.norm(np.diff(nodes, axis=axis + 1), axis=4).sum(axis=axis + 1)
        counts[:, axis] = np.ceil(lengths.max(axis=(1, 2)) / size)
    return counts


@dataclass(frozen=True)
class _Cells:
    """Stresses at the middles of cells."""

    positions: FloatArray
    """(n, 3) [mm]"""
    volumes: FloatArray
    """(n,) [mm³]"""
    stress: FloatArray
    """(n, n_bodies, 6) [MPa]"""

    @cached_property
    def tree(self) -> cKDTree:
        """Of the positions; unbalanced: made in half the time."""
        return cKDTree(self.positions, balanced_tree=False)


def _cells(
    bodies: MovedBodies,
    elements: IntArray,
    size: float,
    near: tuple[FloatArray, float] | None = None,
) -> _Cells:
    """Cut elements into cells of a size at most [mm], boxes of them near some places if given."""
    counts = _counts(bodies, elements, size)
    places, within = (None, 0.0) if near is None else (cKDTree(near[0]), near[1])
    result = []
    for alike in np.unique(counts, axis=0):
        lines = [(2.0 * np.arange(n) + 1.0) / n - 1.0 for n in alike.tolist()]
        volume = 8.0 / float(np.prod(alike))
        same = elements[(counts == alike).all(axis=1)]
        if places is None:
            result.append(_on_grid(bodies, same, lines, volume))
            continue
        for element in same[:, None]:
            for kept in _boxes(bodies, element, lines, places, within):
                result.append(_on_grid(bodies, element, kept, volume))
    return _Cells(
        np.concatenate([f.positions for f in result]),
        np.concatenate([f.volumes for f in result]),
        np.concatenate([f.stress for f in result]),
    )


def _boxes(
    bodies: MovedBodies,
    element: IntArray,
    lines: list[FloatArray],
    places: cKDTree,
    within: float,
) -> Iterator[list[FloatArray]]:
    """Parts of lines between which the points of an element near some places lie.

    Boxes of many points are halved, and dropped where they lie apart from all places.
    """
    if np.prod([len(line) for line in lines], dtype=np.float64) > _MOST_POINTS:
        some = _grid(bodies, element, [line[[0, len(line) // 2, -1]] for line in lines])
        reach = np.linalg.norm(some - some[1, 1, 1], axis=-1).max()
        if places.query(some[1, 1, 1])[0] <= within + reach:
            halves = (np.array_split(line, min(2, len(line))) for line in lines)
            for parts in product(*halves):
                yield from _boxes(bodies, element, list(parts), places, within)
        return
    close = _near(_grid(bodies, element, lines), places, within)
    if not close.any():
        return
    kept = []
    for axis, line in enumerate(lines):
        there = np.flatnonzero(close.any(axis=tuple({0, 1, 2} - {axis})))
        kept.append(line[there[0] : there[-1] + 1])
    yield kept


def _each(n: int, step: int) -> IntArray:
    """Every so many of n numbers from 0, and the last one."""
    return np.unique(np.append(np.arange(0, n, step), n - 1))


def _grid(bodies: MovedBodies, element: IntArray, lines: list[FloatArray]) -> FloatArray:
    """Points of an element (1,) at a grid, (n_1, n_2, n_3, 3) [mm]."""
    points = _contracted(bodies, lines, bodies.positions[bodies.elements[element]])
    return points.reshape(*(len(line) for line in lines), 3)


def _gaps(grid: FloatArray) -> float:
    """Largest distance of neighbours in a grid, summed over its directions [mm]."""
    gaps = (np.linalg.norm(np.diff(grid, axis=axis), axis=-1) for axis in range(3))
    return sum(float(gap.max(initial=0.0)) for gap in gaps)


def _near(grid: FloatArray, places: cKDTree, within: float) -> BoolArray:
    """Points of a grid (n_1, n_2, n_3, 3) near some places, (n_1, n_2, n_3).

    First those in the box of all places; of many points first some, then those between them.
    """
    box = zip(np.moveaxis(grid, 3, 0), places.mins - within, places.maxes + within, strict=True)
    may = np.logical_and.reduce([(low <= x) & (x <= high) for x, low, high in box])
    if may.size > _MOST_POINTS:
        picked = [_each(n, _STEPS) for n in may.shape]
        some = grid[np.ix_(*picked)]
        may = _near(some, places, within + _gaps(some))
        for axis, (at, n) in enumerate(zip(picked, grid.shape, strict=False)):
            may = np.repeat(may, np.diff(at, append=n), axis=axis)
    may[may] = np.isfinite(places.query(grid[may], distance_upper_bound=within)[0])
    return may


def _on_grid(
    bodies: MovedBodies, elements: IntArray, lines: list[FloatArray], volume: float
) -> _Cells:
    """Stresses of elements at a tensor grid of points, direction by direction."""
    members = bodies.elements[elements]
    nodes = bodies.positions[members]
    moved = np.moveaxis(bodies.displacements[:, members], 0, 2).reshape(*members.shape, -1)
    fields = np.concatenate([nodes, moved], axis=2)
    n_bodies = len(bodies.displacements)
    slopes = np.stack([_contracted(bodies, lines, fields, axis) for axis in range(3)], axis=-1)
    slopes = slopes.reshape(-1, 3 * (1 + n_bodies), 3)
    count(Operation.ELEMENT, 9.0 * slopes.size)
    jacobian = np.ascontiguousarray(np.moveaxis(slopes[:, :3], 0, 2))
    (adjugate,), (determinant,) = adjugates(jacobian[None])
    gradient = slopes[:, 3:] @ np.moveaxis(adjugate / determinant, 2, 0)
    return _Cells(
        _contracted(bodies, lines, nodes).reshape(-1, 3),
        determinant * volume,
        stress_of_gradient(gradient.reshape(-1, n_bodies, 3, 3), bodies.material),
    )


def _contracted(
    bodies: MovedBodies, lines: list[FloatArray], values: FloatArray, slope: int | None = None
) -> FloatArray:
    """Values of elements' nodes (n, n_functions, m) at a grid, (n, n_points, m), or a slope."""
    degree = bodies.element.degree
    n, _, m = values.shape
    first, second, third = (
        line_basis(degree, line)[axis == slope] for axis, line in enumerate(lines)
    )
    size = degree + 1
    result = third @ values.reshape(n, size, size, size, m)
    result = second @ result.reshape(n, size, size, -1)
    result = first @ result.reshape(n, size, -1)
    return np.asarray(result.reshape(n, -1, m))


def _tension(cells: _Cells, centres: FloatArray, radius: float, size: float) -> FloatArray:
    """σ₁ of means over balls, (n_bodies, n_centres); cells on the edge of a ball count in part."""
    ramp = size * radius
    near = cKDTree(centres).sparse_distance_matrix(
        cells.tree, radius + 0.5 * ramp, output_type="ndarray"
    )
    members = near["j"]
    share = cells.volumes[members] * np.clip((radius - near["v"]) / ramp + 0.5, 0.0, 1.0)
    return principal_stress(_means(cells, (near["i"], members), share, len(centres)))[..., 0].T


def _means(
    cells: _Cells, pairs: tuple[IntArray, IntArray], share: FloatArray, n_balls: int
) -> FloatArray:
    """Means over balls, (n_balls, n_bodies, 6) [MPa].

    From pairs of a ball and a cell (n,) each, and the volume of that cell in that ball (n,) [mm³].
    """
    n_bodies = cells.stress.shape[1]
    count(Operation.ELEMENT, 9.0 * len(share) * (1 + n_bodies))
    # As it is: sorting it by rows takes longer than the products.
    weights = coo_array((share, pairs), (n_balls, len(cells.positions)))
    total = np.bincount(pairs[0], share, minlength=n_balls)[:, None]
    means = (weights @ cells.stress.reshape(-1, 6 * n_bodies)) / total
    return means.reshape(n_balls, n_bodies, 6)


def one_of_each_cube(points: FloatArray, spacing: float) -> IntArray:
    """One point of each cube of that size, the first along x, y and z, (n,)."""
    steps = (points - points.min(axis=0)) / spacing
    order = np.lexsort(np.round(steps.T[::-1], 6))
    cells = np.floor(steps[order] + 1e-6).astype(np.int64)
    numbers = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    return np.sort(order[np.unique(numbers, return_index=True)[1]])


# ---------------------------------------------------------------------------------------------
# Elements of degree 1


def means_at_elements(
    body: Body, stress: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray]:
    """Means over balls around centres of elements of degree 1.

    Centres are as far apart as those of the second look, or an element's size. Cells are the
    integration points, or whole elements where these are small against the balls.

    Parameters
    ----------
    body
        The block.
    stress
        At its integration points, (n_copies, n_points, 6) [MPa].
    radius
        Of the balls [mm]; a ball always holds the points of the element in its middle.

    Returns
    -------
    FloatArray
        Centres in the block's own position, (n_balls, 3) [mm].
    FloatArray
        (n_copies, n_balls, 6) [MPa]
    """
    mesh, points = body.mesh, integration_points(body.mesh, body.element)
    each = len(points) // mesh.n_elements
    volumes = point_volumes(mesh.nodes[mesh.elements])
    sizes = volumes.sum(axis=1)
    centroids, spacing = points.reshape(-1, each, 3).mean(axis=1), _CENTRES[1] * radius
    if each > 1 and np.cbrt(sizes.mean()) < spacing:
        shares = (volumes / sizes[:, None])[:, None]
        stress = (shares @ stress.reshape(len(stress), -1, each, 6))[:, :, 0]
        each = 1
    at = (centroids, sizes) if each == 1 else (points, volumes.ravel())
    cells = _Cells(*at, np.swapaxes(stress, 0, 1))
    kept = one_of_each_cube(centroids, spacing)
    near = cKDTree(centroids[kept]).sparse_distance_matrix(
        cells.tree, radius, output_type="ndarray"
    )
    others = near[near["j"] // each != kept[near["i"]]]
    balls = np.append(others["i"], np.repeat(np.arange(len(kept)), each))
    members = np.append(others["j"], each * kept[:, None] + np.arange(each))
    means = _means(cells, (balls, members), cells.volumes[members], len(kept))
    return centroids[kept], np.swapaxes(means, 0, 1)
