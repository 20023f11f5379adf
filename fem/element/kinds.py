"""What every element answers, and sums over the elements of a block.

`hexahedron.ElementType` are the four of degree 1, `lagrange.Lagrange` those of any degree. Nodes of
an element are those of `HexMesh.connectivity`, degrees of freedom 3 · node + component.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy.sparse import bsr_array, csr_array

from fem.element.hexahedron import ElementType, chunks, in_cache
from fem.element.lagrange import Lagrange
from fem.element.material import DisplacementShapeError, Material
from geometry.mesh import FloatArray, HexMesh, IntArray, check_mesh

#: Pairs of nodes of elements that are summed at once: bounds the memory of an assembly to 40 MB.
_PAIRS = 1 << 17


class Element(Protocol):
    """Isoparametric element: m of them have nodes (m, n, 3) [mm]."""

    @property
    def degree(self) -> int:
        """Of the polynomials."""

    @property
    def words(self) -> str:
        """Name in tables."""

    @property
    def nodes(self) -> FloatArray:
        """Natural coordinates of the nodes, (n, 3)."""

    def face_nodes(self, corners: IntArray) -> IntArray:
        """Nodes of faces by their corners as `geometry.mesh.CORNERS`, (n_faces, 4) to (n_faces, m).

        In the order of facets (`fem.element.functions.facet_values`).
        """

    @property
    def hourglass(self) -> Callable[[FloatArray, Material], FloatArray] | None:
        """The part of `stiffness` that controls hourglass modes; None: there is none."""

    def stiffness(self, coordinates: FloatArray, material: Material) -> FloatArray:
        """(m, 3 n, 3 n) [N/mm], symmetric to the bit; MeshError of an element that folds."""

    def mass(self, coordinates: FloatArray, density: float) -> FloatArray:
        """Row sums ρ ∫ N_a dV, (m, n) [t]."""

    @property
    def points(self) -> FloatArray:
        """Natural coordinates of the points at which stresses are sampled, (n_points, 3)."""

    def values(self, natural: FloatArray) -> FloatArray:
        """Functions at natural coordinates, (n_points, 3) to (n_points, n)."""

    def stress(
        self, coordinates: FloatArray, material: Material, displacement: FloatArray
    ) -> FloatArray:
        """At `points`, (n_bodies, m, n_points, 6) [MPa].

        From displacements of some bodies (n_bodies, m, n, 3) [mm]; components as in `material`.
        """

    def nodal_stress(
        self, coordinates: FloatArray, material: Material, displacement: FloatArray
    ) -> FloatArray:
        """The same at the nodes of each element, (n_bodies, m, n, 6) [MPa]."""


def element_of(mesh: HexMesh, hexahedron: ElementType = ElementType.INCOMPATIBLE) -> Element:
    """Element of a mesh: of degree 1 the hexahedron that is chosen."""
    return hexahedron if mesh.degree == 1 else Lagrange(mesh.degree)


def block_stiffness(mesh: HexMesh, material: Material, element: Element) -> bsr_array:
    """Assemble the stiffness of one block, which is checked here.

    Returns
    -------
    bsr_array
        (3 n_nodes, 3 n_nodes) [N/mm] in 3 × 3 node blocks, columns sorted, symmetric to the
        bit; degrees of freedom 3 · node + component. ``.tocsr()`` where rows are wanted.

    Raises
    ------
    MeshError
        See `geometry.mesh.check_mesh`; an element that folds.
    """
    check_mesh(mesh)
    return _assembled(mesh, lambda part: element.stiffness(part, material))


def block_hourglass_stiffness(
    mesh: HexMesh, material: Material, element: Element
) -> bsr_array | None:
    """Assemble the hourglass part of the stiffness; None where an element has none.

    ½ uᵀ K u is the hourglass energy of a block; (3 n_nodes, 3 n_nodes) [N/mm].
    """
    hourglass = element.hourglass
    return hourglass and _assembled(mesh, lambda part: hourglass(part, material))


def _assembled(mesh: HexMesh, of_elements: Callable[[FloatArray], FloatArray]) -> bsr_array:
    """Sum matrices (m, 3 n, 3 n) of elements (m, n, 3) chunk by chunk, columns sorted."""
    members = mesh.connectivity
    key = (members[:, :, None] * mesh.n_nodes + members[:, None, :]).ravel()
    pairs, position = np.unique(key, return_inverse=True)
    row, column = np.divmod(pairs, mesh.n_nodes)
    position, n = position.reshape(len(members), -1), members.shape[1]
    data = np.zeros((len(pairs), 9))
    # Each chunk goes over all pairs of nodes: it has a quarter as many of them or more.
    for part in chunks(len(members), math.ceil(max(_PAIRS, len(pairs) / 4) / n**2)):
        matrices = of_elements(mesh.nodes[members[part]])
        blocks = matrices.reshape(-1, n, 3, n, 3).swapaxes(2, 3).reshape(-1, 9)
        where = position[part].ravel()
        for k in range(9):
            data[:, k] += np.bincount(where, blocks[:, k], minlength=len(pairs))
    # 32-bit indices: half the index traffic in every product.
    pointer = np.searchsorted(row, np.arange(mesh.n_nodes + 1)).astype(np.int32)
    shape = (3 * mesh.n_nodes, 3 * mesh.n_nodes)
    return bsr_array((data.reshape(-1, 3, 3), column.astype(np.int32), pointer), shape=shape)


def block_lumped_mass(mesh: HexMesh, density: float) -> FloatArray:
    """Row-sum mass of the nodes of one block: (n_nodes,) [t]; sums to the mass of the mesh."""
    element, total = element_of(mesh), np.zeros(mesh.n_nodes)
    for members in in_cache(mesh):
        np.add.at(total, members, element.mass(mesh.nodes[members], density))
    return total


def block_internal_force(mesh: HexMesh, material: Material, displacement: FloatArray) -> FloatArray:
    """K u of copies of one block of degree n, (n_copies, n_nodes, 3) [mm] to [N]; without K.

    Raises
    ------
    MeshError
        An element that folds.
    """
    element, result = Lagrange(mesh.degree), np.zeros_like(displacement)
    for members in in_cache(mesh):
        forces = element.internal_force(mesh.nodes[members], material, displacement[:, members])
        # Sums of rows, which `numpy.add.at` takes ten times as long for.
        shape = (mesh.n_nodes, members.size)
        to = csr_array((np.ones(members.size), (members.ravel(), np.arange(members.size))), shape)
        for total, force in zip(result, forces, strict=True):
            total[:] += to @ force.reshape(-1, 3)
    return result


def integration_points(mesh: HexMesh, element: Element) -> FloatArray:
    """Positions of the points of all elements, (n_elements · n_points, 3) [mm]."""
    points: FloatArray = element.values(element.points) @ mesh.nodes[mesh.connectivity]
    return points.reshape(-1, 3)


def point_stress(
    mesh: HexMesh, material: Material, element: Element, displacement: FloatArray
) -> FloatArray:
    """Stress at `integration_points` of copies of a block, (n_copies, n_points, 6) [MPa].

    From displacements (n_copies, n_nodes, 3) [mm] computed with that element, in the same axes.

    Raises
    ------
    DisplacementShapeError
        The displacement is not the mesh's.
    """
    _check_displacement(mesh, displacement)
    parts = [
        element.stress(mesh.nodes[members], material, displacement[:, members])
        for members in in_cache(mesh)
    ]
    return np.concatenate(parts, axis=1).reshape(len(displacement), -1, 6)


def nodal_stress(
    mesh: HexMesh, material: Material, element: Element, displacement: FloatArray
) -> FloatArray:
    """Stress at the nodes of copies of a block, (n_copies, n_nodes, 6) [MPa]; see `point_stress`.

    At each node the mean over the elements **of the same block**, with their volumes as weights. It
    reproduces any constant stress exactly; of elements of degree 1 its error falls with h² inside a
    block, on the surface with h. Blocks never share an average, for stress may jump between them.
    """
    _check_displacement(mesh, displacement)
    result, total = np.zeros((len(displacement), mesh.n_nodes, 6)), np.zeros(mesh.n_nodes)
    for members in in_cache(mesh):
        coordinates, columns = mesh.nodes[members], np.arange(members.size)
        stress = element.nodal_stress(coordinates, material, displacement[:, members])
        volume = np.repeat(element.mass(coordinates, 1.0).sum(axis=1), members.shape[1])
        shape = (mesh.n_nodes, members.size)
        sums = csr_array((volume, (members.ravel(), columns)), shape)
        total += sums.sum(axis=1)
        for copy, values in enumerate(stress):
            result[copy] += sums @ values.reshape(-1, 6)
    return result / total[:, None]


def _check_displacement(mesh: HexMesh, displacement: FloatArray) -> None:
    if displacement.shape[1:] != (mesh.n_nodes, 3):
        raise DisplacementShapeError(
            f"displacement: got shape {displacement.shape}; expected (n_copies, {mesh.n_nodes}, 3)"
        )
