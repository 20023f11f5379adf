"""Eight-node hexahedra of linear elasticity.

Degrees of freedom are numbered ``3 * corner + component``. A hexahedron is its strain operator B at
points of volume dv: K = Σ dv Bᵀ D B, the stress is D B u, and hourglass control comes in addition.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np

from fem.element.functions import gauss_functions
from fem.element.material import VOIGT, Material
from geometry.machine.work import Operation, count
from geometry.mesh import (
    CORNERS,
    FloatArray,
    HexMesh,
    IntArray,
    MeshError,
    gauss_points,
    shape_gradients,
    shape_values,
)

#: Hourglass stiffness relative to the shear modulus, C = scale · mu · V · B:B on vectors of
#: entries ± 1. The factor is the default that Abaqus documents for first-order solids,
#: r_F G = 0.005 G; how Abaqus normalises the vectors it does not say. With ours, C is that of
#: Flanagan and Belytschko with kappa = 0.12 mu / (lambda + 2 mu), 0.045 at nu = 0.2. The
#: published C3D8R cantilever of *Getting Started with Abaqus* implies a scale 512 times less
#: for Abaqus/Standard (vectors and B:B each with a factor 1/8): see the tests.
HOURGLASS_SCALE = 0.005

#: Hourglass base vectors of Flanagan and Belytschko at the corners: st, tr, rs, rst; (8, 4).
HOURGLASS_VECTORS: FloatArray = np.column_stack(
    [
        CORNERS[:, 1] * CORNERS[:, 2],
        CORNERS[:, 2] * CORNERS[:, 0],
        CORNERS[:, 0] * CORNERS[:, 1],
        CORNERS[:, 0] * CORNERS[:, 1] * CORNERS[:, 2],
    ]
)

#: Corners in VTK order among tensor products.
_VTK = [0, 4, 6, 2, 1, 5, 7, 3]


#: Engineering strain at points of elements from displacements of their corners,
#: (n_elements, n_points, 6, 24) [1/mm], and volumes of the points, (n_elements, n_points) [mm³].
StrainAtPoints = tuple[FloatArray, FloatArray]

#: Elements treated at once: bounds the temporary memory of an assembly to some 40 MB.
_CHUNK = 2048
#: Nodes of elements whose forces or masses are computed at once: what a cache holds.
_NODES = 4000


def chunks(n_elements: int, size: int = _CHUNK) -> Iterator[slice]:
    """Consecutive slices of at most ``size`` elements."""
    for start in range(0, n_elements, size):
        yield slice(start, min(start + size, n_elements))


def in_cache(mesh: HexMesh) -> list[IntArray]:
    """Nodes of some elements after the other."""
    members = mesh.connectivity
    return np.array_split(members, max(1, members.size // _NODES))


def gauss_gradients(coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape function gradients and volumes of the 2 × 2 × 2 Gauss points.

    Parameters
    ----------
    coordinates
        Corners of each element in VTK order, (n_elements, 8, 3) [mm].

    Returns
    -------
    tuple[FloatArray, FloatArray]
        dN_a/dx_i, (n_elements, 8 points, 8 corners, 3) [1/mm]; det J, (n_elements, 8) [mm³].
    """
    natural = gauss_functions(1, 2).slopes[:, _VTK]
    jacobian = np.swapaxes(coordinates, 1, 2)[:, None] @ natural
    volume = np.linalg.det(jacobian)
    if not (volume > 0.0).all():
        bad = int(np.flatnonzero(~(volume > 0.0).all(axis=1))[0])
        raise MeshError(
            f"element {bad}: Jacobian {volume[bad].min():.3g} mm³ at a Gauss point; expected "
            "positive Jacobians (corners in VTK order, no inverted or flat element)"
        )
    return natural @ np.linalg.inv(jacobian), volume


def point_volumes(coordinates: FloatArray) -> FloatArray:
    """Volumes alone of the Gauss points of any number of elements, (n_elements, 8) [mm³]."""
    parts = [gauss_gradients(coordinates[part])[1] for part in chunks(len(coordinates))]
    return np.concatenate(parts)


def mean_gradients(gradients: FloatArray, volume: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Volume average of the shape function gradients (Flanagan and Belytschko's uniform strain).

    The cofactors of the trilinear map have degree two in each natural coordinate, so the
    2 × 2 × 2 rule is exact for any hexahedron.

    Returns
    -------
    tuple[FloatArray, FloatArray]
        (n_elements, 8, 3) [1/mm] and the element volumes (n_elements,) [mm³].
    """
    total = volume.sum(axis=1)
    mean = np.einsum("ep,epai->eai", volume, gradients) / total[:, None, None]
    return mean, total


def incompatible_gradients(coordinates: FloatArray, volume: FloatArray) -> FloatArray:
    """Gradients of the incompatible modes 1 - r², 1 - s², 1 - t² at the Gauss points.

    Taylor, Beresford and Wilson (1976), doi:10.1002/nme.1620100602: the modes are mapped with
    the Jacobian of the centre, scaled by det J0 / det J, so that their strains average to zero
    on any hexahedron and the patch test holds (Simo and Rifai 1990, doi:10.1002/nme.1620290802,
    derive the same from orthogonality to constant stress).

    Returns
    -------
    FloatArray
        (n_elements, 8 points, 3 modes, 3) [1/mm].
    """
    points = gauss_points(2)[0]
    centre = np.swapaxes(coordinates, 1, 2) @ shape_gradients(np.zeros((1, 3)))[0]
    slopes = -2.0 * points[:, :, None] * np.eye(3)
    scale = np.linalg.det(centre)[:, None] / volume
    return scale[:, :, None, None] * (slopes @ np.linalg.inv(centre)[:, None])


def strain_operator(gradients: FloatArray) -> FloatArray:
    """Engineering strain from displacements of corners, 3 · corner + component.

    Gradients of shape functions (..., n, 3) [1/mm] give (..., 6, 3 n) [1/mm].
    """
    n = gradients.shape[-2]
    operator = np.zeros((*gradients.shape[:-2], 6, n, 3))
    for row, (i, j) in enumerate(VOIGT):
        operator[..., row, :, i] = gradients[..., :, j]
        operator[..., row, :, j] = gradients[..., :, i]
    return operator.reshape(*gradients.shape[:-2], 6, 3 * n)


def symmetric(matrices: FloatArray) -> FloatArray:
    """Remove the round-off of a product that is symmetric: (n, m, m)."""
    return 0.5 * (matrices + np.swapaxes(matrices, 1, 2))


def hourglass_shape(coordinates: FloatArray, mean: FloatArray) -> FloatArray:
    """Hourglass shape vectors, orthogonal to every affine displacement; (n_elements, 8, 4).

    gamma = Gamma - B (x · Gamma), Flanagan and Belytschko (1981), doi:10.1002/nme.1620170504,
    with ``mean`` the averaged gradients B (n_elements, 8, 3).
    """
    return HOURGLASS_VECTORS - mean @ (np.swapaxes(coordinates, 1, 2) @ HOURGLASS_VECTORS)


def hourglass_stiffness(coordinates: FloatArray, material: Material) -> FloatArray:
    """Hourglass part of the stiffness of the reduced element, (n_elements, 24, 24) [N/mm].

    K[ai, bj] = delta_ij C sum_m gamma[a, m] gamma[b, m],  C = `HOURGLASS_SCALE` · mu · V · B:B;
    ½ uᵀ K u is the hourglass energy.
    """
    mean, volume = mean_gradients(*gauss_gradients(coordinates))
    shape = hourglass_shape(coordinates, mean)
    coefficient = HOURGLASS_SCALE * material.shear_modulus * volume
    coefficient *= np.einsum("eai,eai->e", mean, mean)
    scalar = symmetric(coefficient[:, None, None] * (shape @ np.swapaxes(shape, 1, 2)))
    return np.einsum("eab,ij->eaibj", scalar, np.eye(3)).reshape(-1, 24, 24)


def _full(coordinates: FloatArray, _: Material) -> StrainAtPoints:
    gradients, volume = gauss_gradients(coordinates)
    return strain_operator(gradients), volume


def _b_bar(coordinates: FloatArray, _: Material) -> StrainAtPoints:
    gradients, volume = gauss_gradients(coordinates)
    operator, mean = strain_operator(gradients), mean_gradients(gradients, volume)[0]
    shift = (mean[:, None] - gradients).reshape(*volume.shape, 24) / 3.0
    operator[:, :, :3] += shift[:, :, None, :]
    return operator, volume


def _incompatible(coordinates: FloatArray, material: Material) -> StrainAtPoints:
    """Amplitudes a of the modes follow from the corners by condensation: K_au u + K_aa a = 0."""
    gradients, volume = gauss_gradients(coordinates)
    operator = strain_operator(gradients)
    modes = strain_operator(incompatible_gradients(coordinates, volume))
    stress = _flat(volume[:, :, None, None] * (material.elasticity_matrix() @ modes))
    forces = np.swapaxes(stress, 1, 2)
    amplitudes = np.linalg.solve(forces @ _flat(modes), forces @ _flat(operator))
    return operator - modes @ amplitudes[:, None], volume


def _uniform(coordinates: FloatArray, _: Material) -> StrainAtPoints:
    mean, total = mean_gradients(*gauss_gradients(coordinates))
    return strain_operator(mean)[:, None], total[:, None]


def _flat(operator: FloatArray) -> FloatArray:
    """Rows of all points after each other, (m, p, 6, n) to (m, 6 p, n)."""
    return operator.reshape(len(operator), -1, operator.shape[3])


def at_corners(values: FloatArray) -> FloatArray:
    """Values at integration points (..., n_points, m) continued to the corners, (..., 8, m).

    By the trilinear polynomials through them, which are products of (1 + 3 x x_p) / 2 for points
    ± 1/√3; one value of an element is constant.
    """
    if values.shape[-2] == 1:
        return np.repeat(values, 8, axis=-2)
    points = gauss_points(2)[0]
    return np.prod(0.5 * (1.0 + 3.0 * CORNERS[:, None] * points), axis=2) @ values


@dataclass(frozen=True, kw_only=True)
class Formulation:
    """What one hexahedron of degree 1 does not share with the others."""

    words: str
    """Its name in tables."""
    strain: Callable[[FloatArray, Material], StrainAtPoints]
    """From corners (n_elements, 8, 3) [mm]; the stiffness follows from it."""
    order: int = 2
    """Integration points in each direction."""
    hourglass: Callable[[FloatArray, Material], FloatArray] | None = None
    """Stiffness that controls hourglass modes, (n_elements, 24, 24) [N/mm]; None: there is none."""
    abaqus: str | None = None
    """Its name in Abaqus, whose C3D8 averages the dilatation; None: it has none there."""
    calculix: str | None = None
    """Its name in CalculiX, whose C3D8 is plain full integration."""


class ElementType(Enum):
    """Choice of the hexahedron of degree 1, named as the field names them."""

    FULL = "full"
    """2 × 2 × 2 Gauss points; locks in bending and near incompressibility."""
    B_BAR = "b-bar"
    """Full integration with the dilatation averaged over the element (Hughes 1980), which is
    what Abaqus calls C3D8: no volumetric locking."""
    INCOMPATIBLE = "incompatible"
    """Nine incompatible modes, condensed (C3D8I): no shear locking, no hourglass."""
    REDUCED = "reduced"
    """Uniform strain with stiffness hourglass control (C3D8R)."""

    @property
    def degree(self) -> int:
        """Of the polynomials."""
        return 1

    @property
    def words(self) -> str:
        """Name in tables."""
        return ELEMENTS[self].words

    @property
    def nodes(self) -> FloatArray:
        """Natural coordinates of the corners, (8, 3)."""
        return CORNERS

    def face_nodes(self, corners: IntArray) -> IntArray:
        """Nodes of faces by their corners, (n, 4): these."""
        return corners

    @property
    def hourglass(self) -> Callable[[FloatArray, Material], FloatArray] | None:
        """The part of `stiffness` that controls hourglass modes; None: there is none."""
        return ELEMENTS[self].hourglass

    @property
    def points(self) -> FloatArray:
        """Natural coordinates of the integration points, (n_points, 3)."""
        return gauss_points(ELEMENTS[self].order)[0]

    def values(self, natural: FloatArray) -> FloatArray:
        """Functions at natural coordinates, (n_points, 3) to (n_points, 8)."""
        return shape_values(natural)

    def stiffness(self, coordinates: FloatArray, material: Material) -> FloatArray:
        """Stiffness of corners (n_elements, 8, 3) [mm] in VTK order, symmetric to the bit.

        Returns
        -------
        FloatArray
            (n_elements, 24, 24) [N/mm], degrees of freedom 3 · corner + component.

        Raises
        ------
        MeshError
            An element that is inverted or flat at a Gauss point.
        """
        count(Operation.ELEMENT, 9.0 * 8.0**3 * len(coordinates))
        parts = [coordinates[part] for part in chunks(len(coordinates))]
        return np.concatenate([self._stiffness(part, material) for part in parts])

    def _stiffness(self, coordinates: FloatArray, material: Material) -> FloatArray:
        strain, volume = self.strain(coordinates, material)
        stress = volume[:, :, None, None] * (material.elasticity_matrix() @ strain)
        result = symmetric(np.swapaxes(_flat(stress), 1, 2) @ _flat(strain))
        return result if self.hourglass is None else result + self.hourglass(coordinates, material)

    def strain(self, coordinates: FloatArray, material: Material) -> StrainAtPoints:
        """Strain at `points` from corner displacements, and volumes."""
        return ELEMENTS[self].strain(coordinates, material)

    def stress(
        self, coordinates: FloatArray, material: Material, displacement: FloatArray
    ) -> FloatArray:
        """Stress at `points` of elements of some bodies, (n_bodies, n_elements, n_points, 6) [MPa].

        Corners are (n_elements, 8, 3) [mm], displacements (n_bodies, n_elements, 8, 3) [mm].
        """
        operator = material.elasticity_matrix() @ self.strain(coordinates, material)[0]
        n_bodies, n_elements, n_points = len(displacement), *operator.shape[:2]
        moved = displacement.reshape(n_bodies, n_elements, 24).transpose(1, 2, 0)
        stress = operator.reshape(n_elements, -1, 24) @ moved
        return stress.transpose(2, 0, 1).reshape(n_bodies, n_elements, n_points, 6)

    def nodal_stress(
        self, coordinates: FloatArray, material: Material, displacement: FloatArray
    ) -> FloatArray:
        """`stress` continued to the corners, (n_bodies, n_elements, 8, 6) [MPa]."""
        return at_corners(self.stress(coordinates, material, displacement))

    def mass(self, coordinates: FloatArray, density: float) -> FloatArray:
        """Row-sum mass of the corners, rho ∫ N_a dV: (n_elements, 8) [t].

        The integrand has degree three in each natural coordinate: the 2 × 2 × 2 rule is exact.
        """
        at = gauss_functions(1, 2)
        jacobian = np.swapaxes(coordinates, 1, 2)[:, None] @ at.slopes[:, _VTK]
        return density * (np.linalg.det(jacobian) * at.weights) @ at.values[:, _VTK]


ELEMENTS = {
    ElementType.FULL: Formulation(
        words="fully integrated hexahedra", strain=_full, calculix="C3D8"
    ),
    ElementType.B_BAR: Formulation(words="C3D8 (B-bar hexahedra)", strain=_b_bar, abaqus="C3D8"),
    ElementType.INCOMPATIBLE: Formulation(
        words="C3D8I (incompatible-mode hexahedra)",
        strain=_incompatible,
        abaqus="C3D8I",
        calculix="C3D8I",
    ),
    ElementType.REDUCED: Formulation(
        words="C3D8R (reduced integration, hourglass control)",
        strain=_uniform,
        order=1,
        hourglass=hourglass_stiffness,
        abaqus="C3D8R",
        calculix="C3D8R",
    ),
}
