"""What a state of curved blocks says: peaks, tension averaged over a ball, means over facets.

Pressures are the law at points of a grid of every facet, its edges included. Stresses are sampled
inside elements, first everywhere, then closely where they are largest. Averages over balls are
taken where averages over coarse samples are largest, from cells small against the ball; cells on
its edge count in part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from fem.contact.law import ContactLaw
from fem.element.lagrange import TensorPoints, gauss_line, line_points, tensor_points
from fem.element.stress import principal_stress, stress_of_gradient
from fem.static.lagrange_block import FACES, outward_points, windows
from fem.static.lagrange_tube import CONTACT_FACES, LayeredJoints, TubeState, joints_of
from geometry.mesh import FloatArray, IntArray

#: Points across a facet's edge at which its peak of pressure is looked for, ends included.
_LOOKS = 9
#: Size of cells over the radius of a ball.
_CELL = 0.2
#: The same of the cells of the first look, whose centres are a radius apart.
_ROUGH = 0.5
#: Distance of the centres of balls over their radius.
_CENTRES = 0.25
#: Averages of the first look that are this part of the largest are made again.
_NEAR_AVERAGE = 0.85


@dataclass(frozen=True)
class PointValue:
    """A value and its place in a block of the sector."""

    value: float
    """[MPa] or [mm]."""
    layer: int
    """From 1, the lowest free one."""
    position: FloatArray
    """In the block's own position, (3,) [mm]."""
    face: str | None
    """Face that it lies on; None inside."""


# ---------------------------------------------------------------------------------------------
# Contact


@dataclass(frozen=True)
class FaceField:
    """Points on the contact faces of the blocks, and how far they move outwards."""

    counts: tuple[int, int, int]
    """Facets in each direction of a block."""
    per_quad: int
    """Points of a facet."""
    positions: dict[str, FloatArray]
    """In the block's own position, (n_points, 3) [mm]."""
    weights: dict[str, FloatArray]
    """Areas, (n_points,) [mm²]."""
    outward: dict[str, FloatArray]
    """Of the block of every layer, (n_layers, n_points) [mm]."""


Lines = tuple[FloatArray, FloatArray, FloatArray]


def face_field(
    state: TubeState, lines: Lines, x: FloatArray, weights: FloatArray | None = None
) -> FaceField:
    """Evaluate a state at the points ``x`` of a line, tensor products, of facets between lines."""
    lattice = state.lattice
    degree = lattice.element.degree
    at = tensor_points(degree, x, weights, dimension=2)
    between = [lattice.element.nodes_between(line) for line in lines]
    positions, areas, outward = {}, {}, {}
    for name in CONTACT_FACES:
        direction, end = FACES[name]
        places = list(between)
        places[direction] = lines[direction][[-end]]
        grid = lattice.shape(*np.meshgrid(*places, indexing="ij"))
        counts = tuple(len(line) - 1 for k, line in enumerate(lines) if k != direction)
        shape = tuple(len(place) for k, place in enumerate(places) if k != direction)
        quads = windows(np.arange(int(np.prod(shape))).reshape(shape), counts, degree)
        found, normals, area = outward_points(grid.reshape(-1, 3)[quads], name, at)
        positions[name], areas[name] = found.reshape(-1, 3), (area * at.weights).ravel()
        u = np.stack(
            [
                lattice.at(u, (places[0], places[1], places[2])).reshape(-1, 3)[quads]
                for u in state.displacements
            ]
        )
        moved = np.einsum("pa,lqai,qpi->lqp", at.values, u, normals, optimize=True)
        outward[name] = moved.reshape(len(u), -1)
    n_1, n_2, n_3 = (len(line) - 1 for line in lines)
    if state.layered.halved:
        outward = _unfolded(outward, (n_1, n_2, n_3), len(x))
    return FaceField((n_1, n_2, n_3), len(x) ** 2, positions, areas, outward)


def _unfolded(
    outward: dict[str, FloatArray], counts: tuple[int, int, int], n: int
) -> dict[str, FloatArray]:
    """Add the upper half of the layers: the lower one, turned by π about the middle."""
    image = {"bottom": "top", "top": "bottom", "left": "right", "right": "left"}
    found = {}
    for name, other in image.items():
        along = counts[1] if name in ("bottom", "top") else counts[2]
        grid = outward[other].reshape(-1, counts[0], along, n, n)
        upper = grid[::-1, :, ::-1, :, ::-1].reshape(len(outward[name]), -1)
        found[name] = np.concatenate([outward[name], upper])
    return found


def joint_pressures(
    state: TubeState, field: FaceField, law: ContactLaw, clearance: float
) -> list[tuple[tuple[int, int], str, IntArray, FloatArray]]:
    """Pressures of every joint.

    Returns
    -------
    list
        Layers that meet, from 0, -1 for a frame; face of the first of them, its points, and their
        pressures [MPa].
    """
    layered = state.layered
    own = state.lattice.counts[1]
    turned = tuple(t * field.counts[1] // own for t in layered.turned)
    whole = LayeredJoints(layered.n_layers, turned)
    found = []
    for joint in joints_of(field.counts, whole, field.per_quad):
        overclosure = sum(field.outward[s.face][s.layer][s.order] for s in joint.sides) - clearance
        first, last = joint.sides[0], joint.sides[-1]
        pair = (first.layer, last.layer if len(joint.sides) > 1 else -1)
        found.append((pair, first.face, first.order, law.pressure(overclosure)))
    return found


def largest_point_pressure(state: TubeState, law: ContactLaw, clearance: float = 0.0) -> PointValue:
    """Largest contact pressure on a grid of points of every facet, edges included."""
    field = face_field(state, state.lattice.lines, np.linspace(-1.0, 1.0, _LOOKS))
    best = PointValue(-1.0, 0, np.zeros(3), None)
    for (layer, _), face, points, pressures in joint_pressures(state, field, law, clearance):
        where = int(np.argmax(pressures))
        if pressures[where] > best.value * (1.0 + 1e-9):
            position = field.positions[face][points[where]]
            best = PointValue(float(pressures[where]), layer + 1, position, face)
    return best


@dataclass(frozen=True)
class FacetMeans:
    """Mean pressures of the facets of all joints."""

    layers: IntArray
    """Layers that meet, from 0, -1 for a frame, (n, 2)."""
    pressures: FloatArray
    """(n,) [MPa]"""
    areas: FloatArray
    """(n,) [mm²]"""


def facet_means(state: TubeState, lines: Lines, law: ContactLaw, clearance: float) -> FacetMeans:
    """Mean pressures of facets between lines: what the paper's measures are made of."""
    field = face_field(state, lines, *gauss_line(3))
    layers, pressures, areas = [], [], []
    for pair, face, points, found in joint_pressures(state, field, law, clearance):
        weights = field.weights[face][points].reshape(-1, field.per_quad)
        area = weights.sum(axis=1)
        pressures.append((weights * found.reshape(weights.shape)).sum(axis=1) / area)
        areas.append(area)
        layers.append(np.tile(pair, (len(area), 1)))
    return FacetMeans(np.concatenate(layers), np.concatenate(pressures), np.concatenate(areas))


# ---------------------------------------------------------------------------------------------
# Stresses


@dataclass(frozen=True)
class SampledStress:
    """Stresses at points inside some elements of the block of each layer."""

    positions: FloatArray
    """(n_elements, n_points, 3) [mm]"""
    volumes: FloatArray
    """(n_elements, n_points) [mm³]"""
    stress: FloatArray
    """(n_layers, n_elements, n_points, 6) [MPa]"""

    def extreme(self, component: int) -> PointValue:
        """Largest first (0) or least third (2) principal stress."""
        principal = principal_stress(self.stress)[..., component]
        flat = int(principal.argmax() if component == 0 else principal.argmin())
        layer, element, point = np.unravel_index(flat, principal.shape)
        value = float(principal[layer, element, point])
        return PointValue(value, int(layer) + 1, self.positions[element, point], None)


def sampled_stress(state: TubeState, elements: IntArray, at: TensorPoints) -> SampledStress:
    """Stresses of some elements at points of each."""
    lattice = state.lattice
    element, members = lattice.element, lattice.elements[elements]
    nodes = lattice.positions[members]
    jacobian = np.einsum("eai,pak->epik", nodes, at.slopes, optimize=True)
    inverse = np.linalg.inv(jacobian)
    moved = state.displacements[:, members]
    slopes = np.einsum("leai,pak->lepik", moved, at.slopes, optimize=True)
    return SampledStress(
        np.einsum("pa,eai->epi", at.values, nodes, optimize=True),
        np.linalg.det(jacobian) * at.weights,
        stress_of_gradient(slopes @ inverse, element.material),
    )


def everywhere(state: TubeState) -> SampledStress:
    """Stresses of all elements at two Gauss points more than the degree in each direction.

    Nearer to the corners of an element a polynomial of a high degree overshoots.
    """
    degree = state.lattice.element.degree
    at = tensor_points(degree, *gauss_line(degree + 2))
    return sampled_stress(state, np.arange(len(state.lattice.elements)), at)


def averaged_tension(state: TubeState, radius: float) -> PointValue:
    """Largest σ₁ of the stress averaged over the part of a ball that lies in a block.

    Parameters
    ----------
    state
        The state.
    radius
        Of the ball [mm].
    """
    lattice = state.lattice
    nodes = lattice.positions[lattice.elements]
    middles = nodes.mean(axis=1)
    reach = np.linalg.norm(nodes - middles[:, None], axis=2).max(axis=1)
    rough = _cells(state, np.arange(len(nodes)), _ROUGH * radius)
    centres = rough.positions[_apart(rough.positions, radius)]
    tension = _tension(rough, centres, radius, _ROUGH).max(axis=0)
    centres = centres[tension >= _NEAR_AVERAGE * tension.max()]
    distance = np.linalg.norm(middles[:, None] - centres[None], axis=2).min(axis=1)
    near = np.flatnonzero(distance <= reach + (2.0 + _CELL) * radius)
    cells = _cells(state, near, _CELL * radius)
    candidates = _points_between(state, near, _CENTRES * radius)
    candidates = candidates[cKDTree(centres).query(candidates)[0] <= radius]
    found = _tension(cells, candidates, radius, _CELL)
    layer, which = np.unravel_index(int(found.argmax()), found.shape)
    return PointValue(float(found[layer, which]), int(layer) + 1, candidates[which], None)


def _points_between(state: TubeState, elements: IntArray, size: float) -> FloatArray:
    """Points of elements, their surfaces included, a distance at most apart, (n, 3) [mm].

    A ball reaches its largest mean on the surface of a block, where half of it lies outside.
    """
    lattice = state.lattice
    degree = lattice.element.degree
    counts = _counts(state, elements, size)
    found = []
    for alike in np.unique(counts, axis=0):
        lines = [np.linspace(-1.0, 1.0, n + 1) for n in alike.tolist()]
        values = line_points(degree, lines, [np.zeros(len(x)) for x in lines]).values
        members = lattice.elements[elements[(counts == alike).all(axis=1)]]
        points = np.einsum("pa,eai->epi", values, lattice.positions[members], optimize=True)
        found.append(points.reshape(-1, 3))
    return np.unique(np.round(np.concatenate(found), 6), axis=0)


def _counts(state: TubeState, elements: IntArray, size: float) -> IntArray:
    """Into how many parts of a size at most elements are cut in each direction, (n, 3)."""
    lattice = state.lattice
    line = lattice.element.degree + 1
    nodes = lattice.positions[lattice.elements[elements]].reshape(-1, line, line, line, 3)
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
    """(n_layers, n, 6) [MPa]"""


def _cells(state: TubeState, elements: IntArray, size: float) -> _Cells:
    """Cut elements into cells of a size at most [mm]."""
    degree = state.lattice.element.degree
    counts = _counts(state, elements, size)
    found = []
    for alike in np.unique(counts, axis=0):
        lines = [(2.0 * np.arange(n) + 1.0) / n - 1.0 for n in alike.tolist()]
        at = line_points(degree, lines, [np.full(len(x), 2.0 / len(x)) for x in lines])
        found.append(sampled_stress(state, elements[(counts == alike).all(axis=1)], at))
    return _Cells(
        np.concatenate([f.positions.reshape(-1, 3) for f in found]),
        np.concatenate([f.volumes.ravel() for f in found]),
        np.concatenate([f.stress.reshape(len(f.stress), -1, 6) for f in found], axis=1),
    )


def _tension(cells: _Cells, centres: FloatArray, radius: float, size: float) -> FloatArray:
    """σ₁ of means over balls, (n_layers, n_centres); cells on the edge of a ball count in part."""
    ramp = size * radius
    near = cKDTree(cells.positions).query_ball_point(centres, radius + 0.5 * ramp)
    inside = [np.asarray(n, dtype=np.int64) for n in near]
    sizes = [len(n) for n in inside]
    rows = np.repeat(np.arange(len(centres)), sizes)
    members = np.concatenate(inside)
    distance = np.linalg.norm(cells.positions[members] - centres[rows], axis=1)
    share = cells.volumes[members] * np.clip((radius - distance) / ramp + 0.5, 0.0, 1.0)
    weights = csr_array(
        (share, members, np.cumsum([0, *sizes])), (len(centres), len(cells.positions))
    )
    total = np.asarray(weights.sum(axis=1)).ravel()[:, None]
    means = np.stack([(weights @ layer) / total for layer in cells.stress])
    return principal_stress(means)[..., 0]


def _apart(points: FloatArray, spacing: float) -> IntArray:
    """One point of each cube of that size, (n,)."""
    cells = np.floor((points - points.min(axis=0)) / spacing).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return np.sort(first)
