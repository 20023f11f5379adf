"""The exact sector model: blocks that a symmetry makes equal are computed once.

A rotation about the tube axis that maps every block onto a congruent one, and the loads and
supports with it, makes the displacements of those blocks equal in their own frames. One
representative per orbit carries the unknowns; of the contacts, one per orbit is integrated.
Nothing is approximated: the sector gives the digits of the whole at 1/order of the cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fem.assembly.deformable import DeformableAssembly
from geometry.errors import RefusedError
from geometry.mesh import FloatArray, IntArray, cross_matrix

#: Relative deviation of placements (in block sizes), rotations and loads that still counts as
#: symmetric: far above rounding, far below any clearance.
_TOLERANCE = 1e-9


class SymmetryError(RefusedError):
    """A symmetry that the model does not have: what breaks it."""


@dataclass(frozen=True)
class Orbits:
    """Which blocks are equal, and one contact facet of each kind."""

    order: int
    """Number of copies of the sector; 1: no symmetry used."""
    representative: IntArray
    """Block that stands for each block, (n_blocks,)."""
    facets: IntArray
    """Positions in the deformable assembly's surfaces of the facets to integrate, (n,)."""
    point_of: IntArray
    """Which point of those facets (n_points · position + point) stands for each point of the
    surfaces, (n_facets, n_points)."""


def no_symmetry(deformable: DeformableAssembly) -> Orbits:
    """Every block stands for itself (and for its periodic images)."""
    n, per_facet = deformable.surfaces.weights.shape
    blocks = deformable.assembly.originals
    return Orbits(1, blocks, np.arange(n), np.arange(n * per_facet).reshape(n, per_facet))


def cyclic_orbits(deformable: DeformableAssembly, order: int) -> Orbits:
    """Orbits under rotation by 2π / order about the tube axis.

    Raises
    ------
    SymmetryError
        When the rotation does not map blocks, loads and supports onto themselves.
    """
    if order < 1:
        raise SymmetryError(f"symmetry: got order {order}, expected at least 1")
    if order == 1:
        return no_symmetry(deformable)
    image = _images(deformable, order)
    _check_loads(deformable, image, order)
    representative = _smallest(deformable, image, order)
    facets, point_of = _facet_orbits(deformable, representative)
    return Orbits(order, representative, facets, point_of)


def representatives(deformable: DeformableAssembly, order: int) -> IntArray:
    """Block that stands for each block after turns by 2π / order, (n_blocks,).

    Raises
    ------
    SymmetryError
        When the turn does not map blocks onto each other.
    """
    if order == 1:
        return deformable.assembly.originals
    return _smallest(deformable, _images(deformable, order), order)


def _smallest(deformable: DeformableAssembly, image: IntArray, order: int) -> IntArray:
    """Smallest number of the blocks onto which each is mapped, from the image of each."""
    representative = np.arange(len(image), dtype=np.int64)
    for _ in range(order):
        np.minimum(representative, representative[image], out=representative)
    # A turn and a shift along the axis commute: an image is equal to its original.
    return representative[deformable.assembly.originals]


def largest_cyclic_orbits(deformable: DeformableAssembly) -> Orbits:
    """Orbits of the largest cyclic symmetry the model has; order 1 when it has none."""
    counts = np.bincount(deformable.assembly.layer)
    common = int(np.gcd.reduce(counts[counts > 0]))
    for order in range(common, 1, -1):
        if common % order == 0:
            try:
                return cyclic_orbits(deformable, order)
            except SymmetryError:
                continue
    return no_symmetry(deformable)


def axis_rotation(axis: FloatArray, angle: float) -> FloatArray:
    """Rotation by an angle [rad] about a unit axis, (3, 3) (Rodrigues)."""
    cross = cross_matrix(axis)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def _images(deformable: DeformableAssembly, order: int) -> IntArray:
    """Block onto which the rotation maps each block, (n_blocks,)."""
    assembly = deformable.assembly
    turn = axis_rotation(assembly.axis, 2.0 * np.pi / order)
    place = assembly.translations + deformable.offsets - assembly.origin
    centroid = assembly.centroids + deformable.offsets - assembly.origin
    distance, image = cKDTree(centroid).query(centroid @ turn.T)
    away = np.abs(place @ turn.T - place[image]).max(axis=1)
    tilt = np.abs(turn @ assembly.rotations - assembly.rotations[image]).max(axis=(1, 2))
    size = assembly.characteristic_length
    bad = (distance > _TOLERANCE * size) | (away > _TOLERANCE * size) | (tilt > _TOLERANCE)
    bad |= assembly.shape_of != assembly.shape_of[image]
    bad |= deformable.group_of != deformable.group_of[image]
    if bad.any():
        raise SymmetryError(
            f"symmetry: a turn by 1/{order} does not map block {int(np.flatnonzero(bad)[0])} onto "
            "a congruent block; expected an order that divides the number of blocks in a layer"
        )
    return np.asarray(image, dtype=np.int64)


def _check_loads(deformable: DeformableAssembly, image: IntArray, order: int) -> None:
    forces = local_forces(deformable)
    largest = max((float(np.abs(f).max()) for f in forces), default=0.0)
    held = _held_components(deformable)
    for block in deformable.deformable_blocks:
        other = int(image[block])
        group = int(deformable.group_of[block])
        a, b = int(deformable.copy_of[block]), int(deformable.copy_of[other])
        difference = float(np.abs(forces[group][a] - forces[group][b]).max())
        if difference > _TOLERANCE * largest:
            raise SymmetryError(
                f"symmetry: the loads of blocks {int(block)} and {other} differ by "
                f"{difference:.3g} N in their own frames, so a turn by 1/{order} is no symmetry; "
                "expected a load that repeats, or symmetry off"
            )
        if not np.allclose(held[group][a], held[group][b], rtol=0.0, atol=_TOLERANCE):
            raise SymmetryError(
                f"symmetry: blocks {int(block)} and {other} have different supports, so a rotation "
                f"by 1/{order} is no symmetry; expected supports that repeat, or symmetry off"
            )


def local_forces(deformable: DeformableAssembly) -> list[FloatArray]:
    """Nodal loads of each group in block frames, weight too, each (n_copies, n_nodes, 3) [N]."""
    model = deformable.model
    forces = [np.zeros((g.n_copies, g.n_nodes, 3)) for g in model.groups]
    if deformable.gravity is not None:
        for number, group in enumerate(model.groups):
            local = deformable.gravity @ group.rotations
            forces[number] += group.lumped_mass[:, None] * local[:, None]
    for load in model.loads:
        rotation = model.groups[load.group].rotations[load.copies]
        local = np.einsum("nij,ni->nj", rotation, load.forces)
        np.add.at(forces[load.group], (load.copies, load.nodes), local)
    return forces


def _held_components(deformable: DeformableAssembly) -> list[FloatArray]:
    """Projector on the held directions and prescribed value of each node, in block frames.

    Each (n_copies, n_nodes, 4, 3); two copies with equal arrays are held alike.
    """
    model = deformable.model
    held = [np.zeros((g.n_copies, g.n_nodes, 4, 3)) for g in model.groups]
    for support in model.supports:
        rotation = model.groups[support.group].rotations[support.copies]
        local = np.einsum("nij,ni->nj", rotation, support.directions)
        where = (support.copies, support.nodes)
        np.add.at(held[support.group][:, :, :3], where, local[:, :, None] * local[:, None, :])
        np.add.at(held[support.group][:, :, 3], where, support.displacement[:, None] * local)
    return held


def _facet_orbits(
    deformable: DeformableAssembly, representative: IntArray
) -> tuple[IntArray, IntArray]:
    """One facet of each orbit, and for every point which one stands for it.

    A facet of a block meets exactly one other facet, so the two (representative, facet number)
    of a contact, unordered, name its orbit.
    """
    surfaces, basis = deformable.surfaces, deformable.surfaces.basis
    found = deformable.assembly.interfaces
    width = int(deformable.assembly.eligible_facets().max()) + 1
    end_m = representative[surfaces.block_m] * width + found.facet_m[surfaces.facet]
    end_s = representative[surfaces.block_s] * width + found.facet_s[surfaces.facet]
    key = np.column_stack([np.minimum(end_m, end_s), np.maximum(end_m, end_s)])
    _, first, which = np.unique(key, axis=0, return_index=True, return_inverse=True)
    facets = np.sort(first).astype(np.int64)
    position = np.searchsorted(facets, first)[which.ravel()]
    # Points go with corners. Where master and opposing block have changed places, the image's
    # corners are those of the representative's opposing facet, in another order.
    same = end_m == end_m[facets[position]]
    stands = facets[position]
    quads_m, quads_s = (q[:, basis.corners] for q in (surfaces.quads_m, surfaces.quads_s))
    corners = np.where(same[:, None], quads_m[stands], quads_s[stands])
    match = quads_m[:, :, None] == corners[:, None, :]
    if not (match.sum(axis=2) == 1).all():
        raise SymmetryError("symmetry: facets of one orbit have different corners")
    point_of: IntArray = basis.n_points * position[:, None]
    return facets, point_of + basis.points_after(match.argmax(axis=2))
