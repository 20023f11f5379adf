"""Hexahedral meshes and quadrilateral surfaces as frozen arrays.

Conventions (they hold everywhere in tubelock): lengths in mm, arrays of points are (n, 3),
the eight corners of a hexahedron are numbered as VTK and Abaqus C3D8 number them (bottom
face counter-clockwise seen from above, then the top face), the four corners of a boundary
quadrilateral run counter-clockwise seen from outside, so that its normal points outward.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import numpy.typing as npt

from geometry.errors import RefusedError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

#: Natural coordinates (r, s, t) of the eight corners, VTK order; (8, 3).
CORNERS: FloatArray = np.array(
    [
        [-1, -1, -1],
        [1, -1, -1],
        [1, 1, -1],
        [-1, 1, -1],
        [-1, -1, 1],
        [1, -1, 1],
        [1, 1, 1],
        [-1, 1, 1],
    ],
    dtype=np.float64,
)

#: The same corners in [0, 1]³, whole numbers.
CUBE: IntArray = ((CORNERS + 1) / 2).astype(np.int64)

#: Local corner numbers of the six faces, counter-clockwise seen from outside; (6, 4).
HEX_FACES: IntArray = np.array(
    [
        [0, 3, 2, 1],
        [4, 5, 6, 7],
        [0, 1, 5, 4],
        [1, 2, 6, 5],
        [2, 3, 7, 6],
        [3, 0, 4, 7],
    ],
    dtype=np.int64,
)

#: Corners of six tetrahedra round the diagonal from corner 0 to 6 that fill a hexahedron; (6, 4).
HEX_TETRAHEDRA: IntArray = np.array(
    [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]],
    dtype=np.int64,
)

#: Local corner numbers of the twelve edges, in the order in which C3D20 and VTK number their
#: middles; (12, 2).
HEX_EDGES: IntArray = np.array(
    [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]]
)


#: Corners joined to each corner by an edge, right-handed: their triple product is positive.
_NEIGHBOURS = (
    (1, 3, 4),
    (2, 0, 5),
    (3, 1, 6),
    (0, 2, 7),
    (7, 5, 0),
    (4, 6, 1),
    (5, 7, 2),
    (6, 4, 3),
)


#: Elements of which numbers at all points stay in the cache: several times as fast as all at once.
_IN_CACHE = 1024
#: Volumes of larger bodies overflow [mm].
LARGEST_COORDINATE = 1e100


def read_only(value: Any) -> Any:
    """Read-only view of an array, or of the arrays in a tuple or a dictionary; else the value."""
    if isinstance(value, np.ndarray):
        view = value.view()
        view.flags.writeable = False
        return view
    if type(value) is tuple:
        return tuple(read_only(part) for part in value)
    return {k: read_only(v) for k, v in value.items()} if type(value) is dict else value


class ReadOnlyArrays:
    """Base of frozen dataclasses: arrays that they hold, or compute once, are read-only.

    Lists and tuples in the place of an array become one.
    """

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        for part in vars(cls).values():
            if isinstance(part, cached_property):
                part.func = partial(_computed, part.func)

    def __post_init__(self) -> None:
        given = vars(self)
        annotations: Any = getattr(self, "__dataclass_fields__")  # noqa: B009
        for name, value in given.items():
            if isinstance(value, list | tuple):
                kind = _ARRAYS.fullmatch(str(annotations[name].type))
                given[name] = value if kind is None else _as_array(name, value, kind[1])
        self.__setstate__(given)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Unpickled arrays would be writable."""
        vars(self).update({name: read_only(value) for name, value in state.items()})


#: Annotation of a field that is an array.
_ARRAYS = re.compile(r"(Float|Int|Bool)Array(?: \| None)?")


def _as_array(name: str, value: Any, kind: str) -> npt.NDArray[Any]:
    """Array of a list; truth values stay what they are, for whoever checks them."""
    try:
        given = np.array(value)
        if kind == "Bool":
            return given
        target: Any = np.float64 if kind == "Float" else np.int64
        return given.astype(target, casting="same_kind" if given.size else "unsafe")
    except (ValueError, TypeError):
        raise RefusedError(f"{name}: got {value!r}; expected an array of numbers") from None


def _computed(function: Callable[[Any], Any], instance: Any) -> Any:
    return read_only(function(instance))


class MeshError(RefusedError):
    """A mesh that cannot be used: the message names the element and what is wrong with it."""


@dataclass(frozen=True)
class HexMesh(ReadOnlyArrays):
    """Eight-node hexahedra of one body."""

    nodes: FloatArray
    """Coordinates, (n_nodes, 3) [mm]."""
    elements: IntArray
    """Corner nodes of each hexahedron in VTK order, (n_elements, 8)."""

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.nodes)

    @property
    def n_elements(self) -> int:
        """Number of hexahedra."""
        return len(self.elements)

    @property
    def degree(self) -> int:
        """Degree of the polynomials on each hexahedron."""
        return 1

    @property
    def connectivity(self) -> IntArray:
        """All nodes of each hexahedron: here its corners."""
        return self.elements

    def facet_nodes(self, quads: IntArray) -> IntArray:
        """All nodes of facets from their corners (n, 4): here the corners."""
        return quads

    def face_elements(self, quads: IntArray) -> IntArray:
        """One hexahedron that has each of some faces (n, 4), (n,)."""
        keys, elements = self._faces
        return elements[np.searchsorted(keys, self._face_keys(quads))]

    @cached_property
    def _faces(self) -> tuple[npt.NDArray[Any], IntArray]:
        """Keys of the faces, sorted, and a hexahedron that has each."""
        keys = self._face_keys(self.elements[:, HEX_FACES].reshape(-1, 4))
        unique, first = np.unique(keys, return_index=True)
        return unique, first // len(HEX_FACES)

    def _face_keys(self, quads: IntArray) -> npt.NDArray[Any]:
        return row_keys(np.sort(quads, axis=1), int(self.elements.max(initial=0)) + 1)

    def extent(self) -> tuple[float, FloatArray]:
        """Volume [mm³] and centroid (3,) [mm]."""
        return volume_and_centroid(self)


@dataclass(frozen=True)
class QuadSurface(ReadOnlyArrays):
    """Quadrilateral facets over a set of nodes; the facets may be warped (bilinear patches).

    Triangles, three corners each, work as well.
    """

    nodes: FloatArray
    """Coordinates, (n_nodes, 3) [mm]."""
    quads: IntArray
    """Corner nodes of each facet, counter-clockwise seen from outside, (n_facets, 4)."""

    @property
    def n_facets(self) -> int:
        """Number of facets."""
        return len(self.quads)

    @cached_property
    def centroids(self) -> FloatArray:
        """Mean of the corners, the image of the natural origin; (n_facets, 3) [mm]."""
        mean: FloatArray = self.nodes[self.quads].mean(axis=1)
        return mean

    @cached_property
    def area_vectors(self) -> FloatArray:
        """Exact vector area of the bilinear patch: half the cross product of its diagonals.

        (n_facets, 3) [mm²]. The vector areas of a closed surface sum to zero, whatever the
        warp, so a uniform pressure on a closed surface has no resultant.
        """
        p = self.nodes[self.quads]
        return 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, -1] - p[:, 1])

    @cached_property
    def areas(self) -> FloatArray:
        """Magnitude of the vector area, (n_facets,) [mm²]."""
        return np.linalg.norm(self.area_vectors, axis=1)

    @cached_property
    def normals(self) -> FloatArray:
        """Unit outward normals, (n_facets, 3)."""
        return self.area_vectors / self.areas[:, None]


def shape_gradients(natural: FloatArray) -> FloatArray:
    """Gradients of the trilinear shape functions in [-1, 1]³, (n_points, 3) to (n_points, 8, 3).

    N_a = (1 + r r_a)(1 + s s_a)(1 + t t_a) / 8.
    """
    factor = 1.0 + natural[:, None, :] * CORNERS[None, :, :]
    gradient = np.empty((len(natural), 8, 3))
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        gradient[:, :, axis] = CORNERS[:, axis] * factor[:, :, b] * factor[:, :, c] / 8.0
    return gradient


def shape_values(natural: FloatArray) -> FloatArray:
    """Trilinear shape functions at ``natural`` (n_points, 3): (n_points, 8)."""
    return np.prod(1.0 + natural[:, None, :] * CORNERS[None, :, :], axis=2) / 8.0


def gauss_points(order: int = 2) -> tuple[FloatArray, FloatArray]:
    """Tensor Gauss rule on [-1, 1]³: points (order³, 3) and weights (order³,)."""
    x, w = np.polynomial.legendre.leggauss(order)
    weights = (w[:, None, None] * w[None, :, None] * w[None, None, :]).ravel()
    return grid_points(x, x, x), weights


def jacobians(mesh: HexMesh, natural: FloatArray) -> FloatArray:
    """Determinants of dx/d(r, s, t): (n_elements, n_points) [mm³]."""
    gradient, corners = shape_gradients(natural), _corners(mesh)
    result = np.empty((mesh.n_elements, len(natural)))
    for first in range(0, mesh.n_elements, _IN_CACHE):
        few = corners[:, :, first : first + _IN_CACHE]
        (a, b, c), (d, e, f), (g, h, k) = (gradient[:, :, j] @ few for j in range(3))
        # As a triple product: several times faster than n small factorisations.
        result[first : first + _IN_CACHE] = (
            a * (e * k - f * h) + b * (f * g - d * k) + c * (d * h - e * g)
        ).T
    return result


def _corners(mesh: HexMesh) -> FloatArray:
    """Coordinates of the corners of every element, (3, 8, n_elements)."""
    return np.ascontiguousarray(mesh.nodes.T).take(mesh.elements.T, axis=1)


def corner_jacobians(mesh: HexMesh) -> FloatArray:
    """Jacobian determinants at the corners, (n_elements, 8); all positive in a valid mesh.

    There they are an eighth of the triple product of the three edges that meet.
    """
    corners = _corners(mesh)
    jacobians = np.empty((mesh.n_elements, 8))
    for corner, (i, j, k) in enumerate(_NEIGHBOURS):
        (a, d, g), (b, e, h), (c, f, w) = (corners[:, n] - corners[:, corner] for n in (i, j, k))
        jacobians[:, corner] = (
            a * (e * w - h * f) - b * (d * w - g * f) + c * (d * h - g * e)
        ) / 8.0
    return jacobians


def check_mesh(mesh: HexMesh, name: str = "mesh") -> None:
    """Reject what no solver here can use."""
    if mesh.n_elements == 0:
        raise MeshError(f"{name}: got no hexahedra; expected at least one")
    finite = np.isfinite(mesh.nodes).all(axis=1)
    if not finite.all():
        bad = int(np.flatnonzero(~finite)[0])
        raise MeshError(
            f"{name}: node {bad} has coordinates {mesh.nodes[bad].tolist()}; "
            f"expected finite numbers ({int((~finite).sum())} such nodes)"
        )
    if mesh.elements.min() < 0 or mesh.elements.max() >= mesh.n_nodes:
        raise MeshError(
            f"{name}: an element names node {int(mesh.elements.max())}, "
            f"but there are only {mesh.n_nodes} nodes (numbered from 0)"
        )
    largest = float(np.abs(mesh.nodes).max())
    if largest > LARGEST_COORDINATE:
        raise MeshError(
            f"{name}: got coordinates up to {largest:.3g} mm; expected at most "
            f"{LARGEST_COORDINATE:.0g} mm, whose cubes are still numbers"
        )
    worst = corner_jacobians(mesh).min(axis=1)
    bad_elements = np.flatnonzero(worst <= 0.0)
    if bad_elements.size:
        deepest = int(np.argmin(worst))
        raise MeshError(
            f"{name}: {bad_elements.size} of {mesh.n_elements} hexahedra are inverted or flat at a "
            f"corner, first element {int(bad_elements[0])}, worst element {deepest} (Jacobian "
            f"{worst[deepest]:.3g} mm³); expected positive Jacobians in VTK corner order"
        )


def volume_and_centroid(mesh: HexMesh) -> tuple[float, FloatArray]:
    """Volume [mm³] and centroid (3,) [mm] of the meshed body.

    The integrands x_i det J of a trilinear hexahedron have degree at most 3 in each natural
    coordinate, so two Gauss points in each direction are exact.
    """
    points, weights = gauss_points(2)
    dv = (jacobians(mesh, points) * weights).T
    x = shape_values(points) @ _corners(mesh)
    volume = float(dv.sum())
    # About a point of the body, not the origin: no cancellation far away from it.
    inside = mesh.nodes[0]
    centroid: FloatArray = inside + np.einsum("ipe,pe->i", x - inside[:, None, None], dv) / volume
    return volume, centroid


def boundary_quads(mesh: HexMesh) -> IntArray:
    """Facets that belong to one hexahedron only, oriented outward; (n_facets, 4)."""
    quads = mesh.elements[:, HEX_FACES].reshape(-1, 4)
    keys = row_keys(np.sort(quads, axis=1))
    order = np.argsort(keys, kind="stable")
    same = keys[order[1:]] == keys[order[:-1]]
    alone = ~(np.append(same, False) | np.append(False, same))
    return quads[np.sort(order[alone])]


def grid_points(*lines: FloatArray) -> FloatArray:
    """Points of a grid of lines, the last one fastest, (n_points, n_lines)."""
    return np.column_stack([line.ravel() for line in np.meshgrid(*lines, indexing="ij")])


def structured_hexahedra(n_u: int, n_v: int, n_w: int) -> IntArray:
    """Connectivity of an n_u × n_v × n_w grid whose nodes are numbered u slowest, w fastest.

    Corners in VTK order for a right-handed (u, v, w); (n_u n_v n_w, 8).
    """
    i, j, k = (index.ravel() for index in np.indices((n_u, n_v, n_w)))

    def node(du: int, dv: int, dw: int) -> IntArray:
        return ((i + du) * (n_v + 1) + (j + dv)) * (n_w + 1) + (k + dw)

    return np.column_stack([node(*corner) for corner in CUBE.tolist()])


def structured_quads(n: int) -> IntArray:
    """Quadrilaterals of an n × n grid whose points are numbered second direction fastest, (n², 4).

    Corners turn from the first direction towards the second.
    """
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).reshape(-1, 1)
    return corner + np.array([0, n + 1, n + 2, 1])


def grid_faces(n_u: int, n_v: int, n_w: int) -> dict[str, IntArray]:
    """Boundary facets of the structured grid by name: u-, u+, v-, v+, w-, w+; each (n, 4).

    Oriented outward for a right-handed (u, v, w).
    """
    elements = structured_hexahedra(n_u, n_v, n_w).reshape(n_u, n_v, n_w, 8)
    side = {
        "u-": (elements[0], 5),
        "u+": (elements[-1], 3),
        "v-": (elements[:, 0], 2),
        "v+": (elements[:, -1], 4),
        "w-": (elements[:, :, 0], 0),
        "w+": (elements[:, :, -1], 1),
    }
    return {name: cells.reshape(-1, 8)[:, HEX_FACES[face]] for name, (cells, face) in side.items()}


def cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Cross products of vectors (..., 3): those of `numpy.cross` in a fraction of its time."""
    result = np.empty(np.broadcast_shapes(first.shape, second.shape))
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        products = first[..., j] * second[..., k], first[..., k] * second[..., j]
        np.subtract(*products, out=result[..., i])
    return result


def lengths(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors, (..., 3) to (...): `numpy.linalg.norm` takes three times as long."""
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))


def cross_matrix(vectors: FloatArray) -> FloatArray:
    """[v]× with [v]× w = v × w, (..., 3) to (..., 3, 3)."""
    return -cross(vectors[..., None, :], np.eye(3))


def row_keys(rows: IntArray, size: int = 0) -> npt.NDArray[Any]:
    """One value for each row of whole numbers from 0, which can be sorted, (n,).

    Keys are the same in all rows of numbers below a size that is given.

    Whole numbers where these suffice: bytes take ten times as long to sort.
    """
    size, width = size or int(rows.max(initial=0)) + 1, rows.shape[1]
    if size**width <= np.iinfo(np.int64).max:
        return rows @ size ** np.arange(width, dtype=np.int64)[::-1]
    packed = np.ascontiguousarray(rows, dtype=np.int64).view(np.dtype((np.void, 8 * width)))
    return packed.ravel()


def along_curve(points: FloatArray) -> IntArray:
    """Order of points along a Morton curve: what is near in it is mostly near in space."""
    low = points.min(axis=0)
    size = float((points.max(axis=0) - low).max())
    cells = ((points - low) * (1023.0 / size if size > 0.0 else 0.0)).astype(np.int64)
    # Two zeros between each two of the ten bits.
    for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
        cells = (cells | cells << shift) & mask
    return np.argsort(cells @ np.array([1, 2, 4]), kind="stable")


def run_starts(*keys: IntArray) -> IntArray:
    """First position of each run of equal keys, and the total."""
    n = len(keys[0])
    if not n:
        return np.zeros(1, dtype=np.int64)
    change = np.zeros(n - 1, dtype=bool)
    for key in keys:
        change |= np.diff(key) != 0
    return np.concatenate([[0], np.flatnonzero(change) + 1, [n]])


def connected_parts(n: int, one: IntArray, other: IntArray) -> IntArray:
    """Number of the part that each of n things is in, (n,), where pairs of them hang together."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(one)), (one, other)), shape=(n, n))
    return connected_components(graph, directed=False)[1].astype(np.int64)
