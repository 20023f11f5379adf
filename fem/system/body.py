"""Congruent copies of one meshed block, with the matrices that all of them share, and its springs.

Springs between the surface of a block and the ground are beds of stiffness per area, at nodes.

World axes, mm, N, t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from scipy.sparse import bsr_array, coo_array

from fem.element.functions import basis_of, facet_area_vectors
from fem.element.kinds import (
    Element,
    block_hourglass_stiffness,
    block_internal_force,
    block_lumped_mass,
    block_stiffness,
    element_of,
    nodal_stress,
    point_stress,
)
from fem.element.material import Material
from geometry.block import facet_elements
from geometry.errors import RefusedError
from geometry.mesh import FloatArray, HexMesh, IntArray, ReadOnlyArrays


class ModelError(RefusedError):
    """A model no solver can use: the message says what was got, what was expected."""


def refuse_turning_springs(bodies: Sequence[Body]) -> None:
    """Reject springs of blocks that may turn by any angle."""
    if any(body.springs is not None for body in bodies):
        raise ModelError(
            "springs: got blocks that may turn by any angle, which springs to the ground do not "
            "follow; expected small rotations (finite_rotation off, pressures that do not turn "
            "with their block)"
        )


@dataclass(frozen=True)
class Springs(ReadOnlyArrays):
    """Springs on facets of a block, as stiffness of the elements that have these facets.

    A spring at a node is one on a facet that has the node.
    """

    element: IntArray
    """Element of each facet, (n,)."""
    nodes: IntArray
    """Nodes of each facet, (n, m)."""
    places: IntArray
    """Which nodes of the element these are, (n, m)."""
    matrices: FloatArray
    """Block frame, (n, 3 m, 3 m) [N/mm]."""
    n_nodes: int
    """Nodes of the block."""
    names: tuple[str, ...] = ()
    """Name of the bed of each facet, (n,)."""

    def added(self, some: IntArray, matrices: FloatArray) -> FloatArray:
        """Stiffness matrices of some elements (k,) with their springs, (k, 3 n, 3 n) [N/mm]."""
        total = matrices.copy()
        for facet in np.flatnonzero(np.isin(self.element, some)).tolist():
            dofs = (3 * self.places[facet][:, None] + np.arange(3)).ravel()
            (number,) = np.flatnonzero(some == self.element[facet])
            total[number][np.ix_(dofs, dofs)] += self.matrices[facet]
        return total

    @cached_property
    def stiffness(self) -> bsr_array:
        """Of all springs, (3 n_nodes, 3 n_nodes) [N/mm]."""
        dofs = (3 * self.nodes[:, :, None] + np.arange(3)).reshape(len(self.nodes), -1)
        rows = np.repeat(dofs, dofs.shape[1], axis=1)
        columns = np.tile(dofs, (1, dofs.shape[1]))
        size = 3 * self.n_nodes
        entries = (self.matrices.ravel(), (rows.ravel(), columns.ravel()))
        return bsr_array(coo_array(entries, (size, size)).tocsr(), blocksize=(3, 3))

    def forces(self, displacement: FloatArray) -> FloatArray:
        """Forces on the nodes of each facet at displacements (n_nodes, 3) [mm], frame of the block.

        (n, m, 3) [N]
        """
        moved = displacement[self.nodes].reshape(len(self.nodes), -1)
        result = -np.einsum("fij,fj->fi", self.matrices, moved)
        return np.asarray(result.reshape(*self.nodes.shape, 3))


#: Name of the springs, corners of facets (n, 4), stiffness per area, directions (k, 3).
Bed: TypeAlias = tuple[str, IntArray, float, FloatArray]


def springs_on(mesh: HexMesh, beds: Sequence[Bed]) -> Springs | None:
    """Consistent stiffness of beds of springs, ∫ k N_a N_b d dᵀ dA.

    None without any.

    Parameters
    ----------
    mesh
        Of the block.
    beds
        Name, corners of facets (n, 4), stiffness per area [N/mm³] and unit directions in the
        block's frame (k, 3) of each.
    """
    if not beds:
        return None
    element, nodes, places, matrices = [], [], [], []
    names: list[str] = []
    for name, corners, stiffness, directions in beds:
        names += [name] * len(corners)
        quads = mesh.facet_nodes(corners)
        area = np.linalg.norm(facet_area_vectors(mesh.nodes, quads), axis=-1)
        values = basis_of(quads).values
        product = stiffness * np.einsum("fp,pa,pb->fab", area, values, values)
        blocks = np.einsum("fab,ij->faibj", product, directions.T @ directions)
        size = 3 * quads.shape[1]
        of, _ = facet_elements(mesh, corners)
        element.append(of)
        nodes.append(quads)
        places.append((mesh.connectivity[of][:, None, :] == quads[:, :, None]).argmax(axis=2))
        matrices.append(blocks.reshape(-1, size, size))
    return Springs(
        element=np.concatenate(element),
        nodes=np.concatenate(nodes),
        places=np.concatenate(places),
        matrices=np.concatenate(matrices),
        n_nodes=mesh.n_nodes,
        names=tuple(names),
    )


@dataclass(frozen=True)
class Body(ReadOnlyArrays):
    """A meshed block and its copies, x = rotation @ X + translation.

    Matrices are those of one copy in its reference position, assembled at first use.

    Raises
    ------
    ModelError
        An unusable mesh or placement.
    """

    mesh: HexMesh
    """Reference block [mm]."""
    material: Material
    """Elastic constants and density."""
    element: Element
    rotations: FloatArray
    """Rigid placement of each copy, (n_copies, 3, 3)."""
    translations: FloatArray
    """(n_copies, 3) [mm]."""
    springs: Springs | None = None
    """Between the surface of each copy and the ground; None: none."""
    name: str = "block"
    """Name in messages; a copy is ``name[k]``."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check(self)

    def with_same_stiffness(self, **changes: Any) -> Body:
        """The body with other copies; the assembled stiffness is shared."""
        result = replace(self, **changes)
        shared = "stiffness", "hourglass_stiffness"
        vars(result).update({name: getattr(self, name) for name in shared})
        return result

    @property
    def n_copies(self) -> int:
        """Number of copies."""
        return len(self.rotations)

    @property
    def n_nodes(self) -> int:
        """Nodes of one copy."""
        return self.mesh.n_nodes

    @cached_property
    def lumped_mass(self) -> FloatArray:
        """(n_nodes,) [t]."""
        return block_lumped_mass(self.mesh, self.material.density)

    @cached_property
    def stiffness(self) -> bsr_array:
        """Springs included, (3 n_nodes, 3 n_nodes) [N/mm]."""
        result = block_stiffness(self.mesh, self.material, self.element)
        if self.springs is None:
            return result
        return bsr_array((result + self.springs.stiffness).tocsr(), blocksize=(3, 3))

    @cached_property
    def hourglass_stiffness(self) -> bsr_array | None:
        """The part of `stiffness` that controls hourglass modes; None where there are none."""
        return block_hourglass_stiffness(self.mesh, self.material, self.element)

    def element_stiffness(self, some: IntArray, *, springs: bool = True) -> FloatArray:
        """Stiffness matrices of some elements (m,), (m, 3 n, 3 n) [N/mm]."""
        coordinates = self.mesh.nodes[self.mesh.connectivity[some]]
        result = self.element.stiffness(coordinates, self.material)
        return self.springs.added(some, result) if self.springs and springs else result

    def internal_force(self, displacement: FloatArray) -> FloatArray:
        """K u of copies, springs included, (n_copies, n_nodes, 3) [mm] to the same [N]."""
        flat = displacement.reshape(len(displacement), -1).T
        if self.element.degree == 1:
            return np.asarray((self.stiffness @ flat).T.reshape(displacement.shape))
        force = block_internal_force(self.mesh, self.material, displacement)
        if self.springs is not None:
            force += (self.springs.stiffness @ flat).T.reshape(displacement.shape)
        return force

    def point_stress(self, local: FloatArray) -> FloatArray:
        """Stress at the points of the elements, (n_copies, n_points, 6) [MPa].

        From displacements in the axes of the reference block, (n_copies, n_nodes, 3) [mm].
        """
        return point_stress(self.mesh, self.material, self.element, local)

    def nodal_stress(self, local: FloatArray) -> FloatArray:
        """The same at the nodes, (n_copies, n_nodes, 6) [MPa]."""
        return nodal_stress(self.mesh, self.material, self.element, local)

    def reference_positions(self) -> FloatArray:
        """Undeformed nodes of all copies in world axes, (n_copies, n_nodes, 3) [mm]."""
        turned = self.mesh.nodes @ self.rotations.transpose(0, 2, 1)
        return turned + self.translations[:, None]


def placed_body(
    mesh: HexMesh,
    material: Material,
    *,
    element: Element | None = None,
    rotations: FloatArray | None = None,
    translations: FloatArray | None = None,
    springs: Springs | None = None,
    name: str = "block",
) -> Body:
    """Place copies of a block.

    ``element`` is that of the mesh; None: `fem.element.kinds.element_of`. Copies are placed by
    rotations (n_copies, 3, 3) and translations (n_copies, 3) [mm]; by default one copy is in its
    reference position.

    Raises
    ------
    MeshError, ModelError
        An unusable mesh or placement.
    """
    if rotations is None:
        count = 1 if translations is None else len(translations)
        rotations = np.tile(np.eye(3), (count, 1, 1))
    if translations is None:
        translations = np.zeros((len(rotations), 3))
    return Body(
        mesh=mesh,
        material=material,
        element=element_of(mesh) if element is None else element,
        rotations=rotations,
        translations=translations,
        springs=springs,
        name=name,
    )


def _check(body: Body) -> None:
    copies = len(body.rotations)
    if copies == 0 or body.rotations.shape != (copies, 3, 3):
        raise ModelError(
            f"{body.name}: got rotations of shape {body.rotations.shape}, "
            "expected (n_copies, 3, 3) with at least one copy"
        )
    if body.translations.shape != (copies, 3) or not np.isfinite(body.translations).all():
        raise ModelError(
            f"{body.name}: got translations of shape {body.translations.shape}, "
            f"expected {(copies, 3)} finite numbers"
        )
    product = np.einsum("cij,ckj->cik", body.rotations, body.rotations)
    proper = np.abs(product - np.eye(3)).max(axis=(1, 2)) < 1e-9
    proper &= np.linalg.det(body.rotations) > 0.0
    if not proper.all():
        bad = int(np.flatnonzero(~proper)[0])
        raise ModelError(f"{body.name}[{bad}]: placement is not a rotation (R Rᵀ = 1, det R = 1)")
    if not (body.lumped_mass > 0.0).all():
        bad = int(np.flatnonzero(~(body.lumped_mass > 0.0))[0])
        raise ModelError(
            f"{body.name}: node {bad} has mass {body.lumped_mass[bad]} t; expected positive "
            "masses (every node belongs to an element, and elements are less distorted)"
        )


def rigid_motions(arms: FloatArray) -> FloatArray:
    """Unit translations and turns of points about an origin, (n, 3, 6).

    ``arms`` are the points from the origin, (n, 3), over a length that makes all six of order one.
    """
    motions = np.zeros((len(arms), 3, 6))
    for axis in range(3):
        motions[:, axis, axis] = 1.0
        motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms)
    return motions
