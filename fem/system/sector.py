"""The exact sector model: blocks that a symmetry makes equal are computed once.

A rotation about the tube axis that maps every block onto a congruent one, and the loads and
supports with it, makes the displacements of those blocks equal in their own frames. One
representative per orbit carries the unknowns; of the contacts, one per orbit is integrated.
Nothing is approximated: the sector gives the digits of the whole at 1/order of the cost.

A half turn about a radius through the middle of a tube, where it is a symmetry as well, halves the
layers (`largest_sector`): it turns blocks over, each onto itself but for its place.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from fem.contact.pair_laws import PairLaws
from fem.contact.search import SearchedPoints
from fem.system.loose import unresisted_motions
from fem.system.system import Orbits, Sector, System, TurnedOver
from geometry.block import Block
from geometry.errors import RefusedError
from geometry.mesh import BoolArray, FloatArray, IntArray, cross_matrix

#: Relative deviation of placements (in block sizes), rotations and loads that still counts as
#: symmetric: far above rounding, far below any clearance.
_TOLERANCE = 1e-9
#: Relative deviation of principal axes of places, and of their moments: far above rounding.
_PRINCIPAL = 1e-6


class SymmetryError(RefusedError):
    """A symmetry that the model does not have: what breaks it."""


def cyclic_sector(system: System, order: int) -> Sector:
    """Sector of a rotation by 2π / order about the tube axis."""
    if order < 1:
        raise SymmetryError(f"symmetry: got order {order}, expected at least 1")
    every = system.computed
    if order == 1:
        return every
    image = _images(system, order)
    alike = {"loads": every.loads[-1]}
    if len(every.held.nodes):
        alike["supports"] = _held_components(every)
    for what, values in alike.items():
        block = _unlike(every, values, image)
        if block is not None:
            raise SymmetryError(
                f"symmetry: the {what} of blocks {block} and {image[block]} differ in their own "
                f"frames, so a turn by 1/{order} is no symmetry; expected {what} that repeat, or "
                "symmetry off"
            )
    if not _same_joints(system, image):
        raise SymmetryError(
            f"symmetry: a turn by 1/{order} does not map pairs of blocks onto others of the same "
            "friction; expected friction that repeats, or symmetry off"
        )
    none = np.empty(0, dtype=np.int64)
    return _with_facets(system, Orbits(order, _smallest(system, image, order), none, none))


def representatives(system: System, order: int) -> IntArray:
    """Block that stands for each block after turns by 2π / order, (n_blocks,).

    Raises
    ------
    SymmetryError
        When the turn does not map blocks onto each other.
    """
    if order == 1:
        return system.assembly.originals
    return _smallest(system, _images(system, order), order)


def _smallest(system: System, image: IntArray, order: int) -> IntArray:
    """Smallest number of the blocks onto which each is mapped, from the image of each."""
    representative = np.arange(len(image), dtype=np.int64)
    for _ in range(order):
        np.minimum(representative, representative[image], out=representative)
    # A turn and a shift along the axis commute: an image is equal to its original.
    return representative[system.assembly.originals]


def largest_sector(system: System, *, half_turn: bool = False) -> Sector:
    """Sector of the largest cyclic symmetry, and of a half turn as well; all blocks without one."""
    counts = np.bincount(system.assembly.layer)
    common, sector = int(np.gcd.reduce(counts[counts > 0])), system.computed
    for order in range(common, 1, -1):
        if common % order == 0:
            with suppress(SymmetryError):
                sector = cyclic_sector(system, order)
                break
    return _with_half_turn(sector) if half_turn else sector


def check_system(system: System, symmetry: str) -> None:
    """Reject a sector that is none, and loads that move a periodic cell as a whole.

    Raises
    ------
    SymmetryError, ModelError
        Saying so.
    """
    if symmetry == "sector":
        require_sector(system)
    unresisted_motions(system.computed)


def require_sector(system: System) -> None:
    """Reject a sector of blocks whose load or supports are not those of one.

    Raises
    ------
    SymmetryError
        Saying so.
    """
    if system.meets and largest_sector(system).orbits.order == 1:
        raise SymmetryError(
            'fem.symmetry: got "sector", but the load or the supports are not the same on every '
            'block of a layer; expected "auto" or "none"'
        )


def searched_in_all_sectors(sector: Sector, surfaces: SearchedPoints) -> SearchedPoints:
    """Points of the whole assembly from those of one sector; their `order` is sector by sector."""
    if sector.orbits.order == 1:
        return replace(surfaces, order=np.arange(surfaces.n_facets))
    assembly, once = sector.whole.assembly, _images(sector.whole, sector.orbits.order)
    image, others = np.arange(assembly.n_blocks), []
    for turn in _turns(sector)[1:]:
        image = once[image]
        others.append(surfaces.turned(turn, assembly.origin, image))
    return surfaces.joined(others)


def vectors_in_all_sectors(
    sector: Sector,
    vectors: FloatArray,
    searched: SearchedPoints | None,
) -> FloatArray:
    """Vectors at the points of the whole assembly, such as friction on block s.

    Parameters
    ----------
    sector
        What is computed of the whole.
    vectors
        At the points that are computed, world axes, (n_facets, n_points, 3).
    searched
        Points of the whole (`searched_in_all_sectors`); None: matched facets.
    """
    if searched is not None:
        turned = [vectors @ turn.T for turn in _turns(sector)]
        return np.concatenate(turned)[searched.order]
    system, orbits = sector.whole, sector.orbits
    surfaces = system.surfaces
    values = vectors.reshape(-1, 3)[orbits.point_of]
    stands = orbits.facets[orbits.point_of[:, 0] // surfaces.basis.n_points]
    frames, swapped = sector.frames.axes, orbits.swapped
    # Alike in the frames of their blocks that deform; where blocks have changed places it acts on
    # the other one.
    on_m = system.body_number[surfaces.block_s[stands]] < 0
    of = np.where(on_m, surfaces.block_m[stands], surfaces.block_s[stands])
    to = frames[np.where(on_m != swapped, surfaces.block_m, surfaces.block_s)]
    turn = to @ frames[of].swapaxes(1, 2)
    sign = np.where(swapped, -1.0, 1.0)
    return np.asarray(np.reshape(sign, (-1, 1, 1)) * (values @ turn.swapaxes(1, 2)))


def _turns(sector: Sector) -> list[FloatArray]:
    """Rotations from the computed sector to each."""
    order = sector.orbits.order
    angles = 2.0 * np.pi * np.arange(order) / order
    return [axis_rotation(sector.whole.assembly.axis, angle) for angle in angles.tolist()]


def axis_rotation(axis: FloatArray, angle: float) -> FloatArray:
    """Rotation by an angle [rad] about a unit axis, (3, 3) (Rodrigues)."""
    cross = cross_matrix(axis)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def _images(system: System, order: int) -> IntArray:
    """Block onto which the rotation maps each block, (n_blocks,)."""
    assembly = system.assembly
    turn = axis_rotation(assembly.axis, 2.0 * np.pi / order)
    image, motion, met = _moved(system, np.arange(assembly.n_blocks), turn, assembly.origin)
    bad = ~met | (np.abs(motion - np.eye(3, 4)).max(axis=(1, 2)) > _TOLERANCE)
    if bad.any():
        raise SymmetryError(
            f"symmetry: a turn by 1/{order} does not map block {int(np.flatnonzero(bad)[0])} onto "
            "a congruent block; expected an order that divides the number of blocks in a layer"
        )
    return image


def _moved(
    system: System, blocks: IntArray, turn: FloatArray, centre: FloatArray
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Where a turn about a centre (3,) [mm] takes some blocks (n,).

    Returns
    -------
    tuple[IntArray, FloatArray, BoolArray]
        The nearest of them, of others themselves, (n_blocks,). How x of a block in its own frame
        comes to turn and shift in that of its image, the shift in block sizes, (n, 3, 4). Whether
        a block of the same kind is there, (n,).
    """
    assembly = system.assembly
    place, centroid = (
        (of + system.offsets - centre)[blocks] for of in (assembly.translations, assembly.centroids)
    )
    distance, nearest = cKDTree(centroid).query(centroid @ turn.T)
    to, image = np.asarray(nearest, dtype=np.int64), np.arange(assembly.n_blocks)
    image[blocks] = blocks[to]
    back = np.swapaxes(assembly.rotations[image[blocks]], 1, 2)
    shift = np.einsum("bij,bj->bi", back, place @ turn.T - place[to])
    shift /= assembly.characteristic_length
    own = back @ turn @ assembly.rotations[blocks]
    kinds = np.stack([assembly.shape_of, system.body_number])
    met = np.asarray(distance) <= _TOLERANCE * assembly.characteristic_length
    met &= (kinds == kinds[:, image]).all(axis=0)[blocks]
    return image, np.concatenate([own, shift[:, :, None]], axis=2), met


def _unlike(
    sector: Sector, values: FloatArray, image: IntArray, over: TurnedOver | None = None
) -> int | None:
    """Block whose values of nodes (n_nodes, …, 3) are not those of its image, turned over or not.

    None where all that are computed are alike.
    """
    tolerance = _TOLERANCE * float(np.abs(values).max())
    for block in sector.blocks.tolist():
        one, two = (values[sector.nodes_of(int(sector.slot_of[b]))] for b in (block, image[block]))
        if over is not None:
            shape = int(sector.whole.assembly.shape_of[block])
            one, two = one @ over.rotations[shape].T, two[over.nodes[shape]]
        if np.abs(one - two).max() > tolerance:
            return int(block)
    return None


def _same_joints(system: System, image: IntArray) -> bool:
    """Whether joints of some friction and law are mapped onto joints of the same."""
    friction, law = system.contact.friction, system.contact.law
    return all(
        {(frozenset((a, b)), value) for a, b, value in of_pairs}
        == {(frozenset(image[[a, b]].tolist()), value) for a, b, value in of_pairs}
        for of_pairs in (
            () if friction is None else friction.of_pairs,
            law.numbers if isinstance(law, PairLaws) else (),
        )
    )


def _held_components(every: Sector) -> FloatArray:
    """Projector on the held directions, and the way by each table, of each node in block frames.

    (n_nodes, 4 + n_tables, 3), what none moves last; blocks with equal arrays are held alike.
    """
    of = every.held
    result = np.zeros((every.n_nodes, 3 + of.ways.shape[1], 3))
    result[of.nodes, :3] = (of.axes * of.held[:, None]) @ of.axes.swapaxes(1, 2)
    result[of.nodes, 3:] = of.ways
    return result


def _with_half_turn(sector: Sector) -> Sector:
    """Sector of blocks without supports that a half turn maps as well, if one does.

    Its axis goes through the middle of all blocks: a radius half way up a tube, or such as the
    normal of a wall. No block may be its own image, turned over.
    """
    system, orbits = sector.whole, sector.orbits
    assembly, moving = system.assembly, system.deformable_blocks
    if len(system.supports.block) or assembly.image_of is not None or not len(moving):
        return sector
    places = (assembly.centroids + system.offsets)[moving]
    centre = places.mean(axis=0)
    first = orbits.representative[moving] == moving
    frame, size = assembly.rotations[moving[0]], assembly.characteristic_length
    for axis in _half_turn_axes(places - centre, first, frame, size):
        result = _turned_over(sector, 2.0 * np.outer(axis, axis) - np.eye(3), centre)
        if result is not None:
            return result
    return sector


def _half_turn_axes(
    places: FloatArray, images: BoolArray, frame: FloatArray, size: float
) -> FloatArray:
    """Unit axes about which a half turn may map places (n, 3) onto each other, (m, 3).

    It brings the first place to one of the images: half way between the two, or where they lie
    opposite each other across. Every such axis is a principal one of all places. Those that are
    alone are looked at too, and the axes of a block: no choice depends on those of the world.
    """
    inertia = places.T @ places
    values, own = np.linalg.eigh(inertia)
    alone = np.abs(values[:, None] - values) + np.eye(3) * values.sum() > _PRINCIPAL * values.sum()
    length = np.linalg.norm(places, axis=1)
    far = images & (np.abs(length - length[0]) <= _TOLERANCE * size)
    sums = places[far] + places[0]
    long = np.linalg.norm(sums, axis=1)
    middles = long > _TOLERANCE * size
    axes = np.concatenate([sums[middles] / long[middles, None], own.T[alone.all(axis=1)], frame.T])
    turned = axes @ inertia
    off = turned - np.einsum("ai,ai->a", turned, axes)[:, None] * axes
    return axes[np.abs(off).max(axis=1, initial=0.0) <= _PRINCIPAL * values.sum()]


def _turned_over(sector: Sector, turn: FloatArray, centre: FloatArray) -> Sector | None:
    """The sector with a half turn about a centre as well; None where it is no symmetry."""
    system, before = sector.whole, sector.orbits.representative
    assembly, moving = system.assembly, system.deformable_blocks
    image, motion, met = _moved(system, moving, turn, centre)
    if not met.all():
        return None
    rotations, nodes, facets = [], [], []
    for number, shape in enumerate(assembly.shapes):
        mine = motion[assembly.shape_of[moving] == number]
        first = mine[0] if len(mine) else np.eye(3, 4)
        shift = assembly.characteristic_length * first[:, 3]
        turned = _onto_itself(shape, first[:, :3], shift)
        if turned is None or np.abs(mine - first).max(initial=0.0) > _TOLERANCE:
            return None
        rotations.append(first[:, :3])
        nodes.append(turned[0])
        facets.append(turned[1])
    if (before[image] == before)[moving].any():
        return None
    over = TurnedOver(before[image] < before, tuple(rotations), tuple(nodes), tuple(facets))
    differs = _unlike(sector, sector.loads[-1], image, over) is not None
    if differs or not _same_joints(system, image):
        return None
    stands = np.minimum(before, before[image])
    half = _with_facets(system, replace(sector.orbits, representative=stands, over=over))
    return half if _same_facets(half) else None


def _onto_itself(
    shape: Block, turn: FloatArray, shift: FloatArray
) -> tuple[IntArray, IntArray] | None:
    """Where a motion takes each node and each contact facet of a shape; None: not onto itself."""
    nodes = shape.mesh.nodes
    most = _TOLERANCE * float(np.ptp(nodes, axis=0).max())
    distance, result = cKDTree(nodes).query(nodes @ turn.T + shift, distance_upper_bound=most)
    if np.max(distance) > most:  # infinite where no node is
        return None
    image = np.asarray(result, dtype=np.int64)
    before = np.sort(shape.contact_quads, axis=1)
    after = np.sort(image[shape.contact_quads], axis=1)
    order, other = np.lexsort(before.T), np.lexsort(after.T)
    if not np.array_equal(before[order], after[other]):
        return None
    facets = np.empty(len(order), dtype=np.int64)
    facets[other] = order
    return image, facets


def _same_facets(sector: Sector) -> bool:
    """Whether every point has the gap and the area of the one that stands for it."""
    surfaces, orbits = sector.whole.surfaces, sector.orbits
    size = sector.whole.assembly.characteristic_length
    for values, unit in ((surfaces.initial_gaps, size), (surfaces.weights, size**2)):
        stands = values[orbits.facets].ravel()[orbits.point_of]
        if np.abs(values - stands).max() > _TOLERANCE * unit:
            return False
    return True


def _with_facets(system: System, orbits: Orbits) -> Sector:
    """Sector of blocks with one facet of each orbit, and for every point which one stands for it.

    A facet of a block meets exactly one other facet, so the two (representative, facet number)
    of a contact, unordered, name its orbit.
    """
    surfaces, basis = system.surfaces, system.surfaces.basis
    result = system.assembly.interfaces
    sides = [
        (surfaces.block_m, result.facet_m[surfaces.facet], surfaces.quads_m),
        (surfaces.block_s, result.facet_s[surfaces.facet], surfaces.quads_s),
    ]
    end_m, end_s = (_ends(system, orbits, *side[:2]) for side in sides)
    key = np.column_stack([np.minimum(end_m, end_s), np.maximum(end_m, end_s)])
    _, first, which = np.unique(key, axis=0, return_index=True, return_inverse=True)
    facets = np.sort(first).astype(np.int64)
    position = np.searchsorted(facets, first)[which.ravel()]
    # Points go with corners. Where master and opposing block have changed places, the image's
    # corners are those of the representative's opposing facet, in another order.
    nodes = Sector(system, orbits).frames.nodes
    quads_m, quads_s = (
        nodes[blocks[:, None], quads[:, basis.corners]] for blocks, _, quads in sides
    )
    rigid = end_m < 0
    end, one = np.where(rigid, end_s, end_m), np.where(rigid[:, None], quads_s, quads_m)
    other = np.where(rigid[:, None], quads_m, quads_s)
    stands = facets[position]
    same = end == end[stands]
    corners = np.where(same[:, None], one[stands], other[stands])
    match = one[:, :, None] == corners[:, None, :]
    if not (match.sum(axis=2) == 1).all():
        raise SymmetryError("symmetry: facets of one orbit have different corners")
    point_of: IntArray = basis.n_points * position[:, None]
    point_of = point_of + basis.points_after(match.argmax(axis=2))
    share = 1.0 if orbits.over is None else np.where(end_m == end_s, 0.5, 1.0)[facets, None]
    swapped = ~same | (rigid != rigid[stands])
    found = replace(orbits, facets=facets, point_of=point_of, swapped=swapped, share=share)
    return Sector(system, found)


def _ends(system: System, orbits: Orbits, blocks: IntArray, facets: IntArray) -> IntArray:
    """Number of a facet of a representative that stands for facets of blocks, (n,).

    Where blocks are turned over, all facets of rigid blocks are -1: their frames may differ.
    """
    width, over = int(system.assembly.eligible_facets().max()) + 1, orbits.over
    if over is None:
        return orbits.representative[blocks] * width + facets
    shapes, own = system.assembly.shape_of[blocks], facets.copy()
    for shape, onto in enumerate(over.facets):
        mine = over.blocks[blocks] & (shapes == shape)
        own[mine] = onto[facets[mine]]
    moving = system.body_number[blocks] >= 0
    return np.where(moving, orbits.representative[blocks] * width + own, -1)
