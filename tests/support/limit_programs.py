"""Arches and domes by linear programs of their own: nothing of the packages is used.

Voussoirs in a plane press at the two ends of each joint, with one shear force up to μ times their
sum. A lune of a dome is such an arch in the plane of its middle, whose corners the two lunes beside
it press, without shear, as the planes between lunes are planes of symmetry. Radius and specific
weight are one.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]


class Joint(NamedTuple):
    """Two ends, the voussoirs that meet there, -1 for the ground, and the normal to the second."""

    first: int
    second: int
    ends: tuple[Array, Array]
    normal: Array


class Lune(NamedTuple):
    """Weights and centroids of voussoirs, their joints, and the corners that neighbours press."""

    weights: list[tuple[float, Array]]
    joints: list[Joint]
    sides: list[tuple[int, Array]]


def _ring(radius: float, angle: Any) -> Array:
    """Points at angles from the crown, in the plane."""
    return np.column_stack([radius * np.sin(angle), radius * np.cos(angle)])


def arch(thickness: float, voussoirs: int, *, embrace: float = 180.0, pieces: int = 1) -> Lune:
    """A circular arch of voussoirs with so many flat pieces inside and outside."""
    angles = np.radians(np.linspace(-embrace / 2, embrace / 2, voussoirs + 1))
    radii = (1.0 - thickness / 2, 1.0 + thickness / 2)
    weights, joints = [], []
    for a, b in pairwise(angles):
        along = np.linspace(a, b, pieces + 1)
        points = np.concatenate([_ring(radii[0], along), _ring(radii[1], along[::-1])])
        x, y = points.T
        cross = np.roll(x, -1) * y - x * np.roll(y, -1)
        middle = ((points + np.roll(points, -1, axis=0)) * cross[:, None]).sum(axis=0)
        weights.append((float(abs(cross.sum())) / 2.0, middle / (3.0 * cross.sum())))
    for k, angle in enumerate(angles):
        ends = tuple(_ring(r, [angle])[0] for r in radii)
        along = np.array([np.cos(angle), -np.sin(angle)])
        second = k if k < voussoirs else -1
        joints.append(Joint(k - 1, second, (ends[0], ends[1]), along))
    return Lune(weights, joints, [])


def lune(thickness: float, lunes: int, courses: int) -> Lune:
    """One of some lunes of a hemisphere, of voussoirs with flat faces and corners on spheres."""
    half = np.pi / lunes
    angles = np.linspace(0.0, np.pi / 2, courses + 1)
    radii = (1.0 - thickness / 2, 1.0 + thickness / 2)
    weights, joints, sides = [], [], []
    for k, (a, b) in enumerate(pairwise(angles)):
        flat = np.concatenate([_ring(r, [a, b]) for r in radii])
        x, z = flat.T
        points = np.concatenate(
            [np.column_stack([x * np.cos(half), way * x * np.sin(half), z]) for way in (-1, 1)]
        )
        points = np.unique(points.round(12), axis=0)  # one line at the crown
        inside, sides_of = points.mean(axis=0), points[ConvexHull(points).simplices]
        volumes = np.abs(np.linalg.det(sides_of - inside)) / 6.0
        middle = volumes @ (3.0 * sides_of.mean(axis=1) + inside) / (4.0 * volumes.sum())
        weights.append((float(volumes.sum()), middle[[0, 2]]))
        sides += [(k, corner * [np.cos(half), 1.0]) for corner in flat]
    for k, angle in enumerate(angles[1:], 1):
        ends = tuple(_ring(r, [angle])[0] * [np.cos(half), 1.0] for r in radii)
        along = ends[1] - ends[0]
        normal = np.array([along[1], -along[0]]) / np.linalg.norm(along)
        second = k if k < courses else -1
        joints.append(Joint(k - 1, second, (ends[0], ends[1]), normal))
    return Lune(weights, joints, sides)


def _program(stated: Lune, friction: float, live: Array | None) -> Any:
    n = len(stated.weights)
    columns: list[Array] = []

    def add(point: Array, *forces: tuple[int, Array]) -> int:
        column = np.zeros((n, 3))
        for block, force in forces:
            if block >= 0:
                arm = point - stated.weights[block][1]
                column[block] += [*force, arm[0] * force[1] - arm[1] * force[0]]
        columns.append(column.ravel())
        return len(columns) - 1

    limits, free = [], []
    for first, second, ends, normal in stated.joints:
        pressed = [add(end, (first, -normal), (second, normal)) for end in ends]
        across = np.array([-normal[1], normal[0]])
        shear = add(ends[0], (first, -across), (second, across))
        free.append(shear)
        limits += [({shear: way} | dict.fromkeys(pressed, -friction)) for way in (-1.0, 1.0)]
    for block, corner in stated.sides:
        add(corner, (block, np.array([1.0, 0.0])))
    if live is not None:
        columns.append(live)
    bounds = np.array([[0.0, np.inf]] * len(columns))
    bounds[free, 0] = -np.inf
    above = np.zeros((len(limits), len(columns)))
    for row, entries in enumerate(limits):
        above[row, list(entries)] = list(entries.values())
    down = np.concatenate([[0.0, -weight, 0.0] for weight, _ in stated.weights])
    cost = np.zeros(len(columns))
    cost[-1] = 0.0 if live is None else -1.0
    return linprog(
        cost,
        A_eq=np.array(columns).T,
        b_eq=-down,
        A_ub=above,
        b_ub=np.zeros(len(above)),
        bounds=bounds,
        method="highs",
    )


def stands(stated: Lune, friction: float) -> bool:
    """Whether forces carry the weight."""
    return bool(_program(stated, friction, None).status == 0)


def sideways(stated: Lune, friction: float) -> float:
    """Largest acceleration sideways that is carried on top of the weight [g]."""
    live = np.concatenate([[weight, 0.0, 0.0] for weight, _ in stated.weights])
    return float(_program(stated, friction, live).x[-1])


def least(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Least thickness that stands, by bisection to 1e-6; nan where none up to ``high`` does."""
    if not holds(high):
        return np.nan
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
