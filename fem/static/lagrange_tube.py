"""Static state of a tube of curved blocks of high degree, in the forces of its contact points.

One block of each layer stands for its layer: loads and supports are the same for all. A layer is
turned by whole waves against the one below, so points of joints meet point on point, the blocks
beside each other too. Between reference normals the overclosure of a point is the sum of the
outward displacements of its two sides,

    x = Σ ν · u = -A q + H + M α - clearance,      Mᵀ q = Rᵀ f,

with A, H and M summed from the blocks that meet (`fem.static.lagrange_block`). The law is
linearised in pressure as in `fem.static.solve`: after a solution each point that presses is
linearised where the law has that pressure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from fem.contact.law import ContactLaw
from fem.element.lagrange import gauss_line, tensor_points
from fem.element.stress import principal_stress
from fem.static.lagrange_block import SeenBlock
from fem.static.solve import StaticError
from geometry.mesh import FloatArray, IntArray

#: Holding springs of the blocks at first, over the tangent stiffness of their contacts, …
_FIRST_HOLDING = 0.25
#: … how they fade, and when they are gone.
_FADING = 0.1
_LEAST_HOLDING = 1e-9
#: Stiffness of open points over that at first touch below which they are left out.
_LEAST_STIFFNESS = 1e-12
#: Points across a facet's edge at which its peak of pressure is looked for, ends included.
_LOOKS = 9


@dataclass(frozen=True)
class LayeredJoints:
    """Which points of which layers meet."""

    n_layers: int
    """Free layers L; below and above them is a rigid frame."""
    turned: tuple[int, ...]
    """Elements by which each layer from the second on is turned against the one below."""


@dataclass(frozen=True)
class Side:
    """One side of the points of a joint."""

    layer: int
    """Which block."""
    face: str
    """Which of its faces."""
    order: IntArray
    """Point of that face at each point of the joint, (n,)."""


@dataclass(frozen=True)
class TubeState:
    """A static state of a layered tube."""

    block: SeenBlock
    """The block of every layer."""
    pressures: FloatArray
    """At the quadrature points of all joints, (n_points,) [MPa]."""
    weights: FloatArray
    """Areas of those points, (n_points,) [mm²]."""
    displacements: FloatArray
    """Of all nodes of the block of each layer, in its own frame, (n_layers, n_nodes, 3) [mm]."""
    iterations: int
    """Linear problems solved."""
    residual: float
    """Norm of the contact forces that the law does not have, over that of all [-]."""
    joints: tuple[tuple[Side, ...], ...]
    """Sides of each joint: one against the frame, else two."""


def joints_of(
    block: SeenBlock, layered: LayeredJoints, per_quad: int
) -> tuple[tuple[Side, ...], ...]:
    """Joints of one sector from the bottom up, then those beside each other.

    Parameters
    ----------
    block
        Of every layer.
    layered
        How layers are turned.
    per_quad
        Points of a quad.
    """
    n_1, n_2, n_3 = block.lattice.counts
    flat = np.arange(n_1 * n_2 * per_quad, dtype=np.int64)
    grid = flat.reshape(n_1, n_2, per_quad)
    found: list[tuple[Side, ...]] = [(Side(0, "bottom", flat),)]
    for layer, turned in enumerate(layered.turned):
        # A point at u of the block below lies at u - turn of the block above.
        above = np.roll(grid, turned, axis=1).ravel()
        found.append((Side(layer, "top", flat), Side(layer + 1, "bottom", above)))
    found.append((Side(layered.n_layers - 1, "top", flat),))
    beside = np.arange(n_1 * n_3 * per_quad, dtype=np.int64)
    for layer in range(layered.n_layers):
        found.append((Side(layer, "right", beside), Side(layer, "left", beside)))
    return tuple(found)


@dataclass(frozen=True)
class _Problem:
    """The contact problem of all joints of one sector."""

    flexibility: FloatArray
    """A, (n, n) [mm/N]."""
    response: FloatArray
    """H, (n,) [mm]."""
    motions: FloatArray
    """M, (n, 6 L)."""
    loads: FloatArray
    """Rᵀ f, (6 L,)."""
    weights: FloatArray
    """Areas, (n,) [mm²]."""
    clearance: float
    """[mm]"""
    law: ContactLaw
    """Pressure of an overclosure."""

    def overclosure(self, forces: FloatArray, motion: FloatArray) -> FloatArray:
        """Overclosures of all points, (n,) [mm]."""
        found: FloatArray = (
            self.response + self.motions @ motion - self.flexibility @ forces - self.clearance
        )
        return found


def _state_problem(
    block: SeenBlock,
    joints: tuple[tuple[Side, ...], ...],
    force: FloatArray,
    *,
    n_layers: int,
    law: ContactLaw,
    clearance: float,
) -> tuple[_Problem, FloatArray]:
    on_contact, reduced = block.condensed.condense_forces(force[None])
    response = block.outward @ (block.inverse @ on_contact[0])
    sizes = [len(sides[0].order) for sides in joints]
    ends = np.cumsum([0, *sizes])
    n = int(ends[-1])
    flexibility = np.zeros((n, n))
    total, motions = np.zeros(n), np.zeros((n, 6 * n_layers))
    weights = np.zeros(n)
    mine: list[list[tuple[slice, IntArray]]] = [[] for _ in range(n_layers)]
    for number, sides in enumerate(joints):
        here = slice(int(ends[number]), int(ends[number + 1]))
        for side in sides:
            local = block.start[side.face].start + side.order
            mine[side.layer].append((here, local))
            total[here] += response[local]
            motions[here, 6 * side.layer : 6 * side.layer + 6] += block.motions[local]
            weights[here] = block.faces[side.face].weights.ravel()[side.order]
    for parts in mine:
        for here, local in parts:
            for there, other in parts:
                flexibility[here, there] += block.flexibility[np.ix_(local, other)]
    loads = np.tile(block.rigid.T @ on_contact[0], n_layers)
    return _Problem(flexibility, total, motions, loads, weights, clearance, law), reduced


def solve_layered_tube(
    block: SeenBlock,
    layered: LayeredJoints,
    force: FloatArray,
    law: ContactLaw,
    *,
    clearance: float = 0.0,
    tolerance: float = 1e-9,
    max_iterations: int = 80,
) -> TubeState:
    """Find the static state of a tube under the same load on every free block.

    Parameters
    ----------
    block
        Of every layer.
    layered
        How layers meet.
    force
        Loads on the nodes of a block, in its own frame, (n_nodes, 3) [N].
    law
        Contact law.
    clearance
        Added to every gap [mm].
    tolerance
        Residual at which the iteration stops [-].
    max_iterations
        Linear problems at most.

    Raises
    ------
    StaticError
        When no equilibrium is found.
    """
    per_quad = len(next(iter(block.faces.values())).values)
    joints = joints_of(block, layered, per_quad)
    problem, reduced = _state_problem(
        block, joints, force, n_layers=layered.n_layers, law=law, clearance=clearance
    )
    area = float(problem.weights.sum())
    load = float(np.linalg.norm(force, axis=1).sum()) * layered.n_layers
    pressure = max(load / area, float(law.pressure(0.0)), 1e-9 * law.touching_stiffness)
    at = np.full(len(problem.weights), float(law.overclosure(pressure)))
    first = _FIRST_HOLDING * float(law.stiffness(at[0])) * area / layered.n_layers
    holding, residual = first, float("inf")
    overclosure = at
    motion = np.zeros(6 * layered.n_layers)
    forces = np.zeros_like(at)
    iterations = 0
    while iterations < max_iterations:
        iterations += 1
        forces, motion = _linear_problem(problem, at, motion, holding)
        overclosure = problem.overclosure(forces, motion)
        real = problem.weights * law.pressure(overclosure)
        size = max(float(np.linalg.norm(forces)), 1e-300)
        residual = float(np.linalg.norm(real - forces)) / size
        if residual <= tolerance and holding <= _LEAST_HOLDING * first:
            break
        pressing = forces > 0.0
        tangent = law.overclosure(np.where(pressing, forces / problem.weights, 1.0))
        at = np.where(pressing, tangent, overclosure)
        holding = max(_FADING * holding, _LEAST_HOLDING * first)
    else:
        raise StaticError(
            f"no equilibrium after {max_iterations} iterations of curved elements (residual "
            f"{residual:.2g}); expected {tolerance:g}: take fem.degree = 1"
        )
    displacements = _recovered(block, joints, force, forces=forces, motion=motion, reduced=reduced)
    pressures = law.pressure(overclosure)
    return TubeState(block, pressures, problem.weights, displacements, iterations, residual, joints)


def _linear_problem(
    problem: _Problem, at: FloatArray, before: FloatArray, holding: float
) -> tuple[FloatArray, FloatArray]:
    """Forces of all points and motions of all blocks with the law's tangent at ``at``."""
    law = problem.law
    stiffness = law.stiffness(at)
    active = np.flatnonzero(stiffness > _LEAST_STIFFNESS * law.touching_stiffness)
    n, m = len(active), problem.motions.shape[1]
    stiff = stiffness[active]
    matrix = np.zeros((n + m, n + m))
    matrix[:n, :n] = problem.flexibility[np.ix_(active, active)]
    matrix[np.arange(n), np.arange(n)] += 1.0 / (problem.weights[active] * stiff)
    motions = problem.motions[active]
    matrix[:n, n:], matrix[n:, :n] = -motions, -motions.T
    matrix[np.arange(n, n + m), np.arange(n, n + m)] = -holding
    right = np.concatenate(
        [
            problem.response[active]
            - problem.clearance
            - at[active]
            + law.pressure(at[active]) / stiff,
            -problem.loads - holding * before,
        ]
    )
    solved = scipy.linalg.solve(matrix, right, assume_a="sym", check_finite=False)
    forces = np.zeros(len(at))
    forces[active] = solved[:n]
    return forces, solved[n:]


def _recovered(
    block: SeenBlock,
    joints: tuple[tuple[Side, ...], ...],
    force: FloatArray,
    *,
    forces: FloatArray,
    motion: FloatArray,
    reduced: FloatArray,
) -> FloatArray:
    """Displacements of all nodes of the block of each layer."""
    n_layers = len(motion) // 6
    on_contact, _ = block.condensed.condense_forces(force[None])
    pushed = np.zeros((n_layers, block.outward.shape[0]))
    first = 0
    for sides in joints:
        here = slice(first, first + len(sides[0].order))
        for side in sides:
            pushed[side.layer, block.start[side.face].start + side.order] += forces[here]
        first = here.stop
    retained = [
        block.inverse @ (on_contact[0] - block.outward.T @ pushed[layer])
        + block.rigid @ motion[6 * layer : 6 * layer + 6]
        for layer in range(n_layers)
    ]
    return block.condensed.recover(np.stack(retained), np.repeat(reduced, n_layers, axis=1))


# ---------------------------------------------------------------------------------------------
# Measures


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


def largest_point_pressure(state: TubeState, law: ContactLaw, clearance: float = 0.0) -> PointValue:
    """Largest contact pressure on a grid of points of every facet, edges included."""
    block = state.block
    at = tensor_points(block.lattice.element.degree, np.linspace(-1.0, 1.0, _LOOKS), dimension=2)
    points = {name: block.lattice.face_points(name, at) for name in block.faces}
    n_nodes = len(block.lattice.positions)
    outward = {
        name: np.stack([found.outward(n_nodes) @ u.ravel() for u in state.displacements])
        for name, found in points.items()
    }
    layered = LayeredJoints(len(state.displacements), _turns(state))
    best: PointValue | None = None
    for sides in joints_of(block, layered, len(at.values)):
        overclosure = sum(outward[s.face][s.layer][s.order] for s in sides) - clearance
        where = int(np.argmax(overclosure))
        value = float(law.pressure(overclosure[where]))
        if best is None or value > best.value:
            side = sides[0]
            position = points[side.face].positions.reshape(-1, 3)[side.order[where]]
            best = PointValue(value, side.layer + 1, position, side.face)
    assert best is not None
    return best


def _turns(state: TubeState) -> tuple[int, ...]:
    """Elements by which layers are turned, from the joints of quadrature points."""
    n_1, n_2, _ = state.block.lattice.counts
    turns = []
    for sides in state.joints:
        if len(sides) == 2 and sides[0].face == "top":
            first = sides[1].order.reshape(n_1, n_2, -1)[0, :, 0]
            turns.append(int(np.flatnonzero(first == 0)[0]))
    return tuple(turns)


@dataclass(frozen=True)
class SampledStress:
    """Stresses at Gauss points inside the elements of the block of each layer."""

    positions: FloatArray
    """(n_points, 3) [mm]"""
    volumes: FloatArray
    """(n_points,) [mm³]"""
    stress: FloatArray
    """(n_layers, n_points, 6) [MPa]"""

    def extreme(self, component: int) -> PointValue:
        """Largest first (0) or least third (2) principal stress."""
        principal = principal_stress(self.stress)[:, :, component]
        flat = principal.argmax() if component == 0 else principal.argmin()
        layer, point = divmod(int(flat), principal.shape[1])
        value = float(principal[layer, point])
        return PointValue(value, layer + 1, self.positions[point], None)


def sampled_stress(state: TubeState) -> SampledStress:
    """Sample stresses at two Gauss points more than the degree in each direction."""
    lattice = state.block.lattice
    element, nodes = lattice.element, lattice.positions
    at = tensor_points(element.degree, *gauss_line(element.degree + 2))
    positions, volumes = [], []
    stresses: list[list[FloatArray]] = [[] for _ in state.displacements]
    for members in lattice.elements:
        coordinates = nodes[members]
        positions.append(at.values @ coordinates)
        volumes.append(element.gradients(coordinates, at)[1])
        for layer, u in enumerate(state.displacements):
            stresses[layer].append(element.stress(coordinates, u[members], at))
    return SampledStress(
        np.concatenate(positions),
        np.concatenate(volumes),
        np.stack([np.concatenate(s) for s in stresses]),
    )
