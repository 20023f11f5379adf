"""Consistent nodal forces of pressures, tractions and body forces, and their amplitudes.

Facets are quadrilaterals, counter-clockwise seen from outside, named by all their nodes
(`geometry.mesh.HexMesh.facet_nodes`). Coordinates are
(n_nodes, 3) or, for copies of one block, (n_copies, n_nodes, 3): pass the current ones for a
load that follows the surface, the reference ones for a dead load.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from fem.element.facet import FACET_CORNERS, basis_of, facet_area_vectors, facet_functions
from fem.element.functions import gauss_line
from geometry.errors import RefusedError
from geometry.mesh import FloatArray, HexMesh, IntArray, ReadOnlyArrays

Amplitude = Callable[[float], float]
"""Factor of a load or a displacement as a function of time [s]."""


class LoadError(RefusedError):
    """A load that cannot be applied: got, expected, what to do."""


@dataclass(frozen=True)
class ForceRows(ReadOnlyArrays):
    """Forces on nodes, amplitude(t) · force, in the frames of their blocks.

    Raises
    ------
    LoadError
        A force that is not finite.
    """

    block: IntArray
    """Block of each, (n,)."""
    node: IntArray
    """Node in the mesh of the block, (n,)."""
    force: FloatArray
    """(n, 3) [N] at amplitude one."""
    amplitude: Amplitude | None = None
    """None: constant in time from the first step on."""
    follows_block: bool = False
    """Whether the forces turn with the frame of their block (needs finite rotation)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.isfinite(self.force).all():
            raise LoadError("load: got a force that is not finite")

    def on(self, first: IntArray) -> tuple[IntArray, FloatArray]:
        """Nodes and forces of a solver that gives blocks a first node (n_blocks,), -1 to others.

        (n,) and (n, 3) [N].
        """
        mine = first[self.block] >= 0
        return (first[self.block] + self.node)[mine], self.force[mine]


def scatter_to_nodes(corner_forces: FloatArray, quads: IntArray, n_nodes: int) -> FloatArray:
    """Sum forces on nodes of facets (..., n_facets, m, 3) at the nodes, (..., n_nodes, 3)."""
    lead = corner_forces.shape[:-3]
    corners = np.arange(quads.size)
    gather = csr_array((np.ones(quads.size), (quads.ravel(), corners)), (n_nodes, quads.size))
    columns = np.moveaxis(corner_forces.reshape(-1, quads.size, 3), 0, 1).reshape(quads.size, -1)
    forces = np.asarray(gather @ columns, dtype=np.float64).reshape(n_nodes, -1, 3)
    return np.ascontiguousarray(np.moveaxis(forces, 0, 1)).reshape(*lead, n_nodes, 3)


def pressure_forces(nodes: FloatArray, quads: IntArray, pressure: float | FloatArray) -> FloatArray:
    """Consistent nodal forces of a pressure, f_a = -∫ p N_a n dA.

    The rule is exact, so the total is -p times the vector area, and zero on a closed surface.

    Parameters
    ----------
    nodes
        (n_nodes, 3) or (n_copies, n_nodes, 3) [mm].
    quads
        Loaded facets, (n_facets, n_nodes of one), counter-clockwise seen from outside.
    pressure
        Positive pushes inward; one number or (n_facets,) [MPa].

    Returns
    -------
    FloatArray
        (n_nodes, 3) or (n_copies, n_nodes, 3) [N].

    Raises
    ------
    LoadError
        Pressure not finite, or neither one number nor one per facet.
    """
    value = _checked(pressure, "pressure", (), (len(quads),))
    area = facet_area_vectors(nodes, quads)
    corner = -np.einsum("f,pa,...fpi->...fai", value, basis_of(quads).values, area)
    return scatter_to_nodes(corner, quads, nodes.shape[-2])


def traction_forces(nodes: FloatArray, quads: IntArray, traction: FloatArray) -> FloatArray:
    """Consistent nodal forces of a traction, f_a = ∫ t N_a dA.

    On planar facets the total is t times the area; on warped ones the area is that of the
    points of integration.

    Parameters
    ----------
    nodes
        (n_nodes, 3) or (n_copies, n_nodes, 3) [mm].
    quads
        Loaded facets, (n_facets, n_nodes of one).
    traction
        One vector (3,), or one at each of `facet_points`, (n_facets, n_points, 3) [MPa].

    Returns
    -------
    FloatArray
        (n_nodes, 3) or (n_copies, n_nodes, 3) [N].

    Raises
    ------
    LoadError
        Traction not finite, or neither one vector nor one at each point.
    """
    values = basis_of(quads).values
    value = _checked(traction, "traction", (3,), (len(quads), len(values), 3))
    area = np.linalg.norm(facet_area_vectors(nodes, quads), axis=-1)
    corner = np.einsum("fpi,pa,...fp->...fai", value, values, area)
    return scatter_to_nodes(corner, quads, nodes.shape[-2])


def edge_forces(
    nodes: FloatArray, corners: IntArray, side: IntArray, mesh: HexMesh, force: FloatArray
) -> FloatArray:
    """Consistent nodal forces of a force per length along edges of facets, f_a = ∫ q N_a ds.

    Parameters
    ----------
    nodes
        (n_nodes, 3) [mm].
    corners, side
        Corners of a facet that has each edge, (n, 4), and the one at which it begins, (n,).
    mesh
        Of the block: which nodes lie between corners.
    force
        (3,) [N/mm].

    Returns
    -------
    FloatArray
        (n_nodes, 3) [N].
    """
    quads = mesh.facet_nodes(corners)
    result = np.zeros_like(nodes)
    line, weights = gauss_line(math.isqrt(quads.shape[1]))
    for first in range(4):
        begin, end = FACET_CORNERS[first], FACET_CORNERS[(first + 1) % 4]
        way = 0.5 * (end - begin)
        values, slopes = facet_functions(0.5 * (begin + end) + np.outer(line, way), quads.shape[1])
        mine = quads[side == first]
        tangent = np.einsum("pak,k,fai->fpi", slopes, way, nodes[mine])
        length = np.linalg.norm(tangent, axis=2) * weights
        np.add.at(result, mine, np.einsum("fp,pa,i->fai", length, values, force))
    return result


def facet_points(nodes: FloatArray, quads: IntArray) -> FloatArray:
    """Points of integration of facets, (n_facets, n_points, 3) [mm]."""
    points: FloatArray = basis_of(quads).values @ nodes[quads]
    return points


def _checked(
    value: float | FloatArray, name: str, one: tuple[int, ...], each: tuple[int, ...]
) -> FloatArray:
    """Broadcast one value of a load to all, rejecting what is not finite or does not fit."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape not in (one, each):
        raise LoadError(f"{name}: got shape {array.shape}; expected {one} or {each}")
    if not np.isfinite(array).all():
        raise LoadError(f"{name}: got a value that is not finite; expected finite values in MPa")
    return np.broadcast_to(array, each)


@dataclass(frozen=True)
class SmoothStepAmplitude:
    """Abaqus' smooth step: xi³ (10 - 15 xi + 6 xi²), flat in slope and curvature at both ends."""

    duration: float
    """[s]"""
    start: float = 0.0
    """[s]"""

    def __post_init__(self) -> None:
        good = math.isfinite(self.duration) and self.duration > 0.0 and math.isfinite(self.start)
        if not good:
            raise LoadError(
                f"amplitude: got duration = {self.duration} s from {self.start} s; expected a "
                "positive duration (for a load at once give no amplitude)"
            )

    def __call__(self, time: float) -> float:
        """Return the factor at ``time`` [s]."""
        xi = min(max((time - self.start) / self.duration, 0.0), 1.0)
        return xi**3 * (10.0 - 15.0 * xi + 6.0 * xi**2)


@dataclass(frozen=True)
class TabularAmplitude:
    """Linear between the points of a table, constant outside it: ramps, cycles."""

    times: tuple[float, ...]
    """Strictly increasing [s]."""
    values: tuple[float, ...]
    """[-]"""

    def __post_init__(self) -> None:
        if len(self.times) != len(self.values) or not self.times:
            raise LoadError(
                f"amplitude: got {len(self.times)} times and {len(self.values)} values; "
                "expected as many of each, at least one"
            )
        if not np.isfinite([*self.times, *self.values]).all():
            raise LoadError("amplitude: the table has a value that is not finite")
        if (np.diff(self.times) <= 0.0).any():
            raise LoadError(f"amplitude: got times {self.times}; expected strictly increasing ones")

    def __call__(self, time: float) -> float:
        """Return the factor at ``time`` [s]."""
        return float(np.interp(time, self.times, self.values))


#: Share of the displacement of a support without a table: static steps take equal parts of it, and
#: explicit runs the smooth step of their loads.
ALL_THE_WAY = TabularAmplitude((0.0, 1.0), (0.0, 1.0))


def wrench_forces(
    points: FloatArray, shares: FloatArray, force: FloatArray, moment: FloatArray
) -> FloatArray:
    """Spread a force and a moment over a body like the inertia of a rigid acceleration.

    f_i = m_i (F / M + α × r_i), with r_i from the centroid of the masses and α by the moment about
    it: statically equivalent to the force and the moment about the origin of the points.

    Parameters
    ----------
    points
        Nodes, (n, 3) [mm].
    shares
        Their masses, in any unit, (n,).
    force, moment
        (3,) [N] and (3,) [N mm], the moment about the origin.

    Returns
    -------
    FloatArray
        (n, 3) [N].
    """
    weight = shares / shares.sum()
    centroid = weight @ points
    arm = points - centroid
    second = np.einsum("n,ni,nj->ij", weight, arm, arm)
    couple = moment - np.cross(centroid, force)
    angular = np.linalg.solve(np.trace(second) * np.eye(3) - second, couple)
    return weight[:, None] * (force + np.cross(angular, arm))
