"""Fields of a state of curved blocks: every layer, at any places of its block."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

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
    return replace(state, layered=layered, displacements=every_layer(state))


@dataclass(frozen=True)
class GridFields:
    """A state on a grid of parameters of the block of each layer, last direction fastest."""

    state: TubeState
    places: Lines
    """Parameters in each direction."""

    @cached_property
    def displacement(self) -> FloatArray:
        """In the block's own frame, (n_layers, n_points, 3) [mm]."""
        lattice = self.state.lattice
        moved = every_layer(self.state)
        return np.stack([lattice.at(u, self.places).reshape(-1, 3) for u in moved])

    @cached_property
    def principal(self) -> FloatArray:
        """σ₁ ≥ σ₂ ≥ σ₃, (n_layers, n_points, 3) [MPa]; where elements meet, in the second one."""
        lattice, places = self.state.lattice, self.places
        inverse = np.linalg.inv(_slopes(lattice, lattice.positions, places))
        moved = every_layer(self.state)
        gradient = np.stack([_slopes(lattice, u, places) for u in moved]) @ inverse
        return principal_stress(stress_of_gradient(gradient, lattice.element.material))


def _slopes(lattice: Lattice, values: FloatArray, places: Lines) -> FloatArray:
    """Derivatives of vectors by the parameters, (n_points, 3, 3)."""
    found = [lattice.at(values, places, slope=axis).reshape(-1, 3) for axis in range(3)]
    return np.stack(found, axis=-1)


def lagrange_cells(state: TubeState) -> LagrangeCells:
    """Evaluate every element of a state at equidistant nodes: what was computed, jumps included."""
    return cells_of(whole(state).bodies)
