"""Contact statics in two pages: the slow plain reference of `fem.solve_static`.

Every block in world axes, no symmetry, no condensation; one sparse factorisation an iteration. Only
the numbering of meshes, the pairs of facets, the cuts of a search and the contact law are those of
the package: elements, loads, gaps, friction and Newton's method are written here once more.

Load f = K u + ∑ w Rᵀ t(x): x is the overclosure of a contact point, with its slips where there is
friction, R = ∂x/∂u.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial, legendre
from scipy.sparse import bsr_array, csc_array, csr_array, eye_array
from scipy.sparse.linalg import splu

from fem import Problem
from fem.contact.search import points_of_search
from fem.system.contact_state import facing_points
from geometry import PressureLoad
from geometry.mesh import CORNERS, BoolArray, FloatArray, IntArray

#: Corners of a facet in natural coordinates, counter-clockwise.
_SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def _line(degree: int, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lagrange polynomials between Lobatto points, values and slopes, (n, degree + 1)."""
    inner = legendre.Legendre.basis(degree).deriv().roots()
    points = np.concatenate([[-1.0], np.sort(inner.real), [1.0]])
    values, slopes = [], []
    for node in points:
        others = points[points != node]
        one = Polynomial.fromroots(others) / np.prod(node - others)
        values.append(one(at))
        slopes.append(one.deriv()(at))
    return np.stack(values, axis=1), np.stack(slopes, axis=1)


def _gauss(degree: int, dimensions: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Functions (p, n), slopes (p, n, dimensions) and weights (p,), last direction fastest.

    Facets of degree 2 and more have a point more in each direction than their elements.
    """
    points, weights = legendre.leggauss(degree + 1 + (dimensions == 2 and degree > 1))
    value, slope = _line(degree, points)

    def product(parts: Sequence[FloatArray]) -> FloatArray:
        result = parts[0]
        for part in parts[1:]:
            rows = result.shape[0] * part.shape[0]
            result = (result[:, None, :, None] * part[None, :, None, :]).reshape(rows, -1)
        return result

    slopes = [
        product([slope if k == j else value for k in range(dimensions)]) for j in range(dimensions)
    ]
    weight = product([weights[:, None]] * dimensions)[:, 0]
    return product([value] * dimensions), np.stack(slopes, axis=2), weight


def _in_order(corners: FloatArray) -> IntArray:
    """Where corners come with the last direction fastest."""
    return np.lexsort(corners.T[::-1])


def _block_stiffness(nodes: FloatArray, members: IntArray, degree: int, material: Any) -> csr_array:
    """Linear elasticity, full integration; (3 n, 3 n) [N/mm]."""
    _, slopes, weights = _gauss(degree, 3)
    if degree == 1:
        members = members[:, _in_order(CORNERS)]
    e, nu = material.young_modulus, material.poisson_ratio
    first, shear = e * nu / (1 + nu) / (1 - 2 * nu), e / 2 / (1 + nu)
    jacobian = np.einsum("pnj,eni->epij", slopes, nodes[members])
    gradient = np.einsum("pnj,epji->epni", slopes, np.linalg.inv(jacobian))
    volume = np.linalg.det(jacobian) * weights
    both = np.einsum("ep,epai,epbj->eaibj", volume, gradient, gradient, optimize=True)
    matrix = first * both + shear * both.transpose(0, 1, 4, 3, 2)
    trace = shear * np.einsum("eaibi->eab", both)
    matrix += trace[:, :, None, :, None] * np.eye(3)[:, None, :]
    rows = (3 * members[:, :, None] + np.arange(3)).reshape(len(members), -1)
    size = rows.shape[1]
    places = np.repeat(rows, size, axis=1).ravel(), np.tile(rows, (1, size)).ravel()
    return csr_array((matrix.ravel(), places), (3 * len(nodes), 3 * len(nodes)))


class Points(NamedTuple):
    """Points of contact, of matched facets or of a search."""

    rows: IntArray
    """Nodes of both facets of each pair, master first, (n_facets, 2 m)."""
    functions: FloatArray
    """Of the nodes in x_s - x_m, (n_facets or 1, p, 2 m)."""
    slopes: FloatArray
    """Of the nodes in the tangents, (n_facets or 1, p, 2, 2 m)."""
    offset: FloatArray
    """x_s - x_m as built, (n_facets, p, 3) [mm]."""
    tangents: FloatArray
    """As built, (n_facets, p, 2, 3) [mm]."""
    sides: FloatArray
    """Directions of slips, (n_facets, p, 2 or 0, 3)."""
    area: FloatArray
    """(n_facets, p) [mm²]"""


class Plain(NamedTuple):
    """Arrays of a problem."""

    first: IntArray
    """First row of the nodes of each block, the last one for what never moves; (n_blocks,)."""
    stiffness: csr_array
    force: FloatArray
    """(n, 3) [N]"""
    held: BoolArray
    """(n, 3)"""
    way: FloatArray
    """Of held components, (n, 3) [mm]."""
    points: Points


class PlainState(NamedTuple):
    """An equilibrium."""

    displacement: FloatArray
    """(n, 3) [mm]"""
    tractions: FloatArray
    """Pressure and friction, (n_facets, p, 1 or 3) [MPa]."""
    anchor: FloatArray
    """Slips at which points would be free of friction, (n_facets, p, 0 or 2) [mm]."""
    at: FloatArray
    residual: float


def plain_arrays(problem: Problem) -> Plain:
    """Numbers of a problem with pressures on named faces, whole blocks fixed and faces held."""
    blocks, load = problem.system.assembly, problem.load_case
    degree, material = problem.degree, problem.materials[0]
    moves = np.flatnonzero(~load.fixed)
    sizes = np.where(
        load.fixed, 0, [len(blocks.shape(b).mesh.nodes) for b in range(len(load.fixed))]
    )
    total = sum(sizes)
    first = np.where(load.fixed, total, np.concatenate([[0], np.cumsum(sizes)[:-1]]))
    places, data = [], []
    for b in moves:
        mesh = blocks.shape(b).mesh
        one = _block_stiffness(
            blocks.place(b, mesh.nodes), mesh.connectivity, degree, material
        ).tocoo()
        places.append(np.stack(one.coords) + 3 * first[b])
        data.append(one.data)
    stiffness = csr_array((np.concatenate(data), tuple(np.hstack(places))), (3 * total, 3 * total))
    values, slopes, weights = _gauss(degree, 2)
    corners = _in_order(_SQUARE)

    def facets(b: int, quads: IntArray) -> tuple[IntArray, FloatArray]:
        mesh = blocks.shape(b).mesh
        nodes = mesh.facet_nodes(quads)
        nodes = nodes[:, corners] if degree == 1 else nodes
        return nodes, blocks.place(b, mesh.nodes)[nodes]

    def tangents(x: FloatArray) -> FloatArray:
        return np.einsum("pnk,fni->fpki", slopes, x)

    force, held, way = np.zeros((total, 3)), np.zeros((total, 3), dtype=bool), np.zeros((total, 3))
    for part in load.faces:
        assert isinstance(part, PressureLoad)
        for b in part.blocks.tolist():
            nodes, x = facets(b, blocks.shape(b).faces[str(part.face)])
            t = tangents(x)
            vector = np.cross(t[:, :, 0], t[:, :, 1]) * weights[:, None]
            share = -part.pressure * np.einsum("pn,fpi->fni", values, vector)
            np.add.at(force, first[b] + nodes, share)
    for support in load.held:
        nodes = np.unique(
            facets(support.block, blocks.shape(support.block).faces[str(support.face)])[0]
        )
        along = np.abs(support.axes).sum(axis=0) > 0.5  # along world axes alone
        held[np.ix_(first[support.block] + nodes, np.flatnonzero(along))] = True
        if support.displacement is not None:
            way[first[support.block] + nodes] = support.displacement * along
    pairs = blocks.interfaces
    rows, ends = [], []
    for k in np.flatnonzero(~(load.fixed[pairs.block_m] & load.fixed[pairs.block_s])):
        sides = ((pairs.block_m[k], pairs.quads_m[k]), (pairs.block_s[k], pairs.quads_s[k]))
        row, x = [], []
        for b, quad in sides:
            (nodes,), (places_of,) = facets(int(b), quad[None])
            row.append(np.full_like(nodes, total) if load.fixed[b] else first[b] + nodes)
            x.append(places_of)
        rows.append(np.concatenate(row))
        ends.append(np.stack(x))
    x_m, x_s = np.moveaxis(np.array(ends), 1, 0)
    t, functions = tangents(0.5 * (x_m + x_s)), np.hstack([-values, values])[None]
    mean = 0.5 * np.concatenate([slopes, slopes], axis=1).transpose(0, 2, 1)[None]
    area = np.linalg.norm(np.cross(t[:, :, 0], t[:, :, 1]), axis=2) * weights
    across = np.cross(np.cross(t[:, :, 0], t[:, :, 1]), t[:, :, 0])
    sides = np.stack([t[:, :, 0], across], axis=2)
    sides /= np.linalg.norm(sides, axis=3, keepdims=True)
    sides = sides if problem.coulomb else sides[:, :, :0]
    points = Points(np.array(rows), functions, mean, values @ (x_s - x_m), t, sides, area)
    return Plain(first, stiffness, force, held, way, points)


def _gaps(points: Points, u: FloatArray, clearance: float) -> tuple[FloatArray, csr_array]:
    """Overclosures and slips, (n_facets, p, 1 or 3) [mm], and their derivatives by u."""
    moved = np.vstack([u, np.zeros(3)])[points.rows]
    way = points.functions @ moved
    d, t = points.offset + way, points.tangents + points.slopes @ moved[:, None]
    normal = np.cross(t[:, :, 0], t[:, :, 1])
    size = np.linalg.norm(normal, axis=2, keepdims=True)
    normal /= size
    gap = (normal * d).sum(axis=2, keepdims=True)
    lean = (d - gap * normal) / size
    functions, slopes = points.functions[..., None], points.slopes[..., None]
    by = -functions * normal[:, :, None, :]
    by = by + slopes[:, :, 0] * np.cross(lean, t[:, :, 1])[:, :, None]
    by = by + slopes[:, :, 1] * np.cross(t[:, :, 0], lean)[:, :, None]
    by_slips = points.functions[:, :, None, :, None] * points.sides[:, :, :, None]
    x = np.concatenate([-gap - clearance, np.einsum("npki,npi->npk", points.sides, way)], axis=2)
    gradient = np.concatenate([by[:, :, None], by_slips], axis=2)
    columns = (3 * points.rows[:, :, None] + np.arange(3)).reshape(len(points.rows), 1, -1)
    columns = np.repeat(columns, x[0].size, axis=1)
    pointer = np.arange(0, columns.size + 1, columns.shape[2])
    shape = (x.size, u.size + 3)
    return x, csr_array((gradient.ravel(), columns.ravel(), pointer), shape)[:, : u.size]


def _tractions(
    problem: Problem, x: FloatArray, *, anchor: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pressure and friction, their derivatives, and anchors after sliding."""
    law, friction = problem.contact_law, problem.coulomb
    t, by = np.zeros_like(x), np.zeros((*x.shape, x.shape[2]))
    t[..., 0], by[..., 0, 0] = law.pressure(x[..., 0]), law.stiffness(x[..., 0])
    if friction is None:
        return t, by, anchor
    k, mu = friction.stick_stiffness, friction.coefficient
    trial, limit = k * (x[..., 1:] - anchor), mu * t[..., 0]
    size = np.linalg.norm(trial, axis=2)
    slides = (size > limit) | (limit == 0.0)
    along = trial / np.maximum(size, 1e-300)[..., None]
    share = np.where(slides, limit / np.maximum(size, 1e-300), 1.0)
    t[..., 1:] = share[..., None] * trial
    across = np.eye(2) - slides[..., None, None] * along[..., :, None] * along[..., None, :]
    by[..., 1:, 1:] = k * share[..., None, None] * across
    by[..., 1:, 0] = np.where(slides[..., None], mu * by[..., 0, 0, None] * along, 0.0)
    return t, by, x[..., 1:] - t[..., 1:] / k


def _share(slope: Callable[[float], float]) -> float:
    """Share of a step at which the work along it ends; 1 unless it rises steeply at its end."""
    if not (slope(0.0) < 0.0 < slope(1.0) and slope(1.0) > -0.2 * slope(0.0)):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if slope(middle) < 0.0 else (low, middle)
    return high


def _equilibrium(
    problem: Problem, arrays: Plain, begin: PlainState, load: float, share: float
) -> PlainState:
    """Newton's method with springs to the iterate before that fade, and a line search."""
    u, at, anchor = begin.displacement, begin.at, begin.anchor
    free, weight = np.flatnonzero(~arrays.held.ravel()), arrays.points.area[..., None]
    x, gradient = _gaps(arrays.points, u, problem.clearance)
    spring, residual = 1e-3 * arrays.stiffness.diagonal().mean(), np.inf
    force, tractions = load * arrays.force.ravel(), partial(_tractions, problem, anchor=anchor)
    for _ in range(100):
        t, by, _ = tractions(at)
        t = t + np.einsum("npkl,npl->npk", by, x - at)
        slopes = (weight[..., None] * by).reshape(-1, *by.shape[2:])
        inner = csr_array(bsr_array((slopes, np.arange(len(slopes)), np.arange(len(slopes) + 1))))
        matrix = arrays.stiffness + gradient.T @ inner @ gradient + spring * eye_array(u.size)
        step = np.where(arrays.held, share * arrays.way - u, 0.0).ravel()
        out = (
            force - arrays.stiffness @ u.ravel() - gradient.T @ (weight * t).ravel() - matrix @ step
        )
        moves = step.any()
        step[free] = splu(csc_array(matrix[free][:, free]), "MMD_AT_PLUS_A", 0.1).solve(out[free])
        change = (gradient @ step).reshape(x.shape)
        inside, more = arrays.stiffness @ u.ravel() - force, arrays.stiffness @ step

        def slope(
            s: float,
            x: FloatArray = x,
            change: FloatArray = change,
            start: float = inside @ step,
            growth: float = more @ step,
        ) -> float:
            """Work of what is out of balance along the step."""
            return float(
                start + s * growth + (weight * tractions(x + s * change)[0] * change).sum()
            )

        part = 1.0 if moves else _share(slope)
        pressed = (t + np.einsum("npkl,npl->npk", by, change))[..., 0]
        u = u + part * step.reshape(u.shape)
        x, gradient = _gaps(arrays.points, u, problem.clearance)
        at = x.copy()
        if part == 1.0:  # where the law has the pressure of the tangent
            there = problem.contact_law.overclosure(np.maximum(pressed, 0.0))
            at[..., 0] = np.where(pressed > 0.0, there, x[..., 0])
        t, _, slid = tractions(x)
        unbalanced = force - arrays.stiffness @ u.ravel() - gradient.T @ (weight * t).ravel()
        size = max(np.linalg.norm(force), np.linalg.norm(np.delete(unbalanced, free)))
        residual = np.linalg.norm(unbalanced[free]) / max(size, 1e-2 * np.linalg.norm(weight * t))
        if residual < 1e-10:
            break
        spring *= 0.1
    return PlainState(u, t, slid, at, float(residual))


def _rest(problem: Problem, arrays: Plain) -> PlainState:
    """Nothing has moved; contact is linearised at the mean pressure."""
    area, slips = arrays.points.area, arrays.points.sides.shape[2]
    mean = max(np.linalg.norm(arrays.force, axis=1).sum() / area.sum(), 1e-3)
    at = np.zeros((*area.shape, 1 + slips))
    at[..., 0] = problem.contact_law.overclosure(np.array(mean))
    return PlainState(np.zeros_like(arrays.force), at, at[..., 1:], at, np.inf)


def plain_path(problem: Problem, path: Sequence[tuple[float, float]]) -> PlainState:
    """Equilibrium at the end of a path of load factors and shares of the ways of supports."""
    arrays = plain_arrays(problem)
    state = _rest(problem, arrays)
    for load, share in path:
        state = _equilibrium(problem, arrays, state, load, share)
    return state


def plain_searched(problem: Problem) -> PlainState:
    """Equilibrium under the whole load at once on the points that a search finds there."""
    arrays, deformable = plain_arrays(problem), problem.system
    search, state = facing_points(deformable.computed), _rest(problem, arrays)
    for _ in range(40):
        found = points_of_search(search, problem.clearance)
        rows = [
            np.where(
                problem.load_case.fixed[of, None], len(arrays.force), quads + arrays.first[of, None]
            )
            for of, quads in ((found.block_m, found.quads_m), (found.block_s, found.quads_s))
        ]
        sides = found.sides if problem.coulomb else found.sides[:, :, :0]
        points = Points(
            np.hstack(rows),
            found.functions,
            found.slopes,
            found.offsets,
            found.tangents,
            sides,
            found.weights,
        )
        there, before = arrays._replace(points=points), state.displacement
        begin = _rest(problem, there)
        if np.isfinite(state.residual):
            at = _gaps(points, before, problem.clearance)[0]
            begin = begin._replace(displacement=before, at=at)
        state = _equilibrium(problem, there, begin, 1.0, 1.0)
        moved = np.abs(state.displacement - before).max()
        if moved <= 1e-8 * np.abs(state.displacement).max():
            break
        world: list[list[FloatArray]] = [[] for _ in deformable.bodies]
        of_blocks = iter(displacements(problem, state))
        for group in deformable.body_number[deformable.body_number >= 0]:
            world[group].append(next(of_blocks))
        search.displace(tuple(np.stack(of) for of in world))
        search.search()
    return state


def displacements(problem: Problem, state: PlainState) -> list[FloatArray]:
    """Of the nodes of every block that deforms, (n_nodes, 3) [mm]."""
    first, moves = plain_arrays(problem).first, np.flatnonzero(~problem.load_case.fixed)
    ends = [*first[moves][1:], len(state.displacement)]
    return [state.displacement[a:b] for a, b in zip(first[moves], ends, strict=True)]
