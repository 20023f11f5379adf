"""Fields of a state of curved blocks: every layer, at any places of its block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem.element.lagrange_stress import LagrangeCells, cells_of
from fem.element.stress import principal_stress, stress_of_gradient
from fem.static.lagrange_block import Lattice
from fem.static.lagrange_peaks import Lines
from fem.static.lagrange_tube import LayeredJoints, TubeState
from geometry.mesh import FloatArray


def every_layer(state: TubeState) -> FloatArray:
    """Displacements of the block of every layer in its own frame, (n_layers, n_nodes, 3) [mm].

    The upper half of a halved tube is the lower one, turned by π about a radius through the middle
    of a block.
    """
    if not state.layered.halved:
        return state.displacements
    lattice = state.lattice
    nodes = lattice.nodes.shape
    inner, outer = lattice.shape(np.array([0.0, 1.0]), np.full(2, 0.5), np.full(2, 0.5))
    axis = (outer - inner) / np.linalg.norm(outer - inner)
    turn = 2.0 * np.outer(axis, axis) - np.eye(3)
    grid = state.displacements.reshape(-1, *nodes)
    upper = (grid[::-1, :, ::-1, ::-1] @ turn).reshape(state.displacements.shape)
    return np.concatenate([state.displacements, upper])


def whole(state: TubeState) -> TubeState:
    """The same state with the block of every layer."""
    if not state.layered.halved:
        return state
    layered = LayeredJoints(state.layered.n_layers, state.layered.turned)
    return TubeState(
        state.lattice,
        layered,
        state.pressures,
        state.weights,
        every_layer(state),
        state.iterations,
        state.residual,
    )


@dataclass(frozen=True)
class GridFields:
    """Fields on a grid of parameters of the block of each layer, last direction fastest."""

    displacement: FloatArray
    """In the block's own frame, (n_layers, n_points, 3) [mm]."""
    principal: FloatArray
    """σ₁ ≥ σ₂ ≥ σ₃, (n_layers, n_points, 3) [MPa]."""


def fields_at(state: TubeState, places: Lines) -> GridFields:
    """Evaluate a state at a grid of parameters; where elements meet, in the second of them."""
    lattice = state.lattice
    moved = every_layer(state)
    jacobian = _slopes(lattice, lattice.positions, places)
    gradient = np.stack([_slopes(lattice, u, places) for u in moved]) @ np.linalg.inv(jacobian)
    return GridFields(
        np.stack([lattice.at(u, places).reshape(-1, 3) for u in moved]),
        principal_stress(stress_of_gradient(gradient, lattice.element.material)),
    )


def _slopes(lattice: Lattice, values: FloatArray, places: Lines) -> FloatArray:
    """Derivatives of vectors by the parameters, (n_points, 3, 3)."""
    found = [lattice.at(values, places, slope=axis).reshape(-1, 3) for axis in range(3)]
    return np.stack(found, axis=-1)


def lagrange_cells(state: TubeState) -> LagrangeCells:
    """Evaluate every element of a state at equidistant nodes: what was computed, jumps included."""
    return cells_of(whole(state).bodies)
