"""What a state of curved blocks says of contact: peaks of pressure, means over facets.

Pressures are the law at points of a grid of every facet, its edges included; stresses are sampled
by `fem.element.lagrange_stress`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem.contact.law import ContactLaw
from fem.element.lagrange import gauss_line, tensor_points
from fem.element.lagrange_stress import PointValue
from fem.static.lagrange_block import FACES, outward_points, windows
from fem.static.lagrange_tube import CONTACT_FACES, LayeredJoints, TubeState, joints_of
from geometry.mesh import FloatArray, IntArray

#: Points across a facet's edge at which its peak of pressure is looked for, ends included.
_LOOKS = 9


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
