"""Block shapes from files: surfaces and meshes of many formats, STEP through gmsh."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from geometry.errors import unreadable
from geometry.files.mesh_io import read_any_mesh
from geometry.files.named_surfaces import NamedSurface
from geometry.files.readers import OWN_UNITS, READ, read_named
from geometry.files.repair import repaired, turned_alike
from geometry.mesh import (
    HEX_FACES,
    BoolArray,
    FloatArray,
    HexMesh,
    IntArray,
    MeshError,
    check_mesh,
)
from geometry.parts.block_selection import numbers_of
from geometry.polyhedra.near.triangle_search import distinct_rows
from geometry.polyhedra.polygons import surface_of_polygons
from geometry.polyhedra.polyhedron import (
    Polyhedron,
    faults,
    is_closed,
    merge_points,
    turned_outward,
)
from geometry.polyhedra.solids import closed_solids, one_solid

#: Millimetres in each unit a file may be drawn in.
UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}

#: Coordinates from here on are no lengths, and what is smaller is no block [unit of the file].
_LARGEST, _LEAST = 1e30, 1e-20
#: Suffixes of STEP files.
STEP_SUFFIXES = {".step", ".stp"}
#: Suffixes of files that hold no hexahedra.
SURFACES_ALONE = {".obj", *READ}
#: gmsh's number for eight-node hexahedra.
_HEXAHEDRON = 5
#: Faces of solid cells, all counter-clockwise seen from outside where the first one is.
_FACES = {
    "tetra": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    "pyramid": [[0, 3, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
    "wedge": [[0, 2, 1], [3, 4, 5], [0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]],
}
#: Cells that bound no solid, which a mesh file may hold beside those that do.
_BESIDE = {"vertex", "line", "line3"}
#: Cells with nodes between their corners: those that they are with straight edges.
_CORNERS = {
    "hexahedron20": ("hexahedron", 8),
    "hexahedron27": ("hexahedron", 8),
    "quad8": ("quad", 4),
    "quad9": ("quad", 4),
}


def _cells(mesh: Any, path: Path) -> dict[str, IntArray]:
    """Corners of the cells of each kind; polygons under the number of their corners as well."""
    parts: dict[str, list[IntArray]] = {}
    for group in mesh.cells:
        data = np.asarray(group.data, dtype=np.int64)
        if data.size and not 0 <= data.min() <= data.max() < len(mesh.points):
            raise MeshError(
                f"{path}: a {group.type} names point {data.max()} or {data.min()}, "
                f"counted from 0, but there are {len(mesh.points)} points"
            )
        kind, corners = _CORNERS.get(group.type, (group.type, data.shape[1]))
        kind = f"polygon {corners}" if kind == "polygon" else kind
        parts.setdefault(kind, []).append(data[:, :corners])
    cells = {kind: np.concatenate(groups) for kind, groups in parts.items()}
    for kind in cells.keys() & {"hexahedron", *_FACES}:
        extra = len(cells[kind]) - len(distinct_rows(np.sort(cells[kind], axis=1))[0])
        if extra:
            raise MeshError(
                f"{path}: {extra} of {len(cells[kind])} cells ({kind}) are there more than once; "
                "expected each once: remove duplicates in the program that made it"
            )
    known = {"hexahedron", "triangle", "quad", *_FACES, *_BESIDE}
    strange = sorted(k for k in cells if k not in known and not k.startswith("polygon"))
    if strange or not set(cells) - _BESIDE:
        raise MeshError(
            f"{path}: got {', '.join(strange or sorted(cells)) or 'no cells'}; expected triangles, "
            "quadrilaterals or polygons, or tetrahedra, pyramids or wedges without nodes on their "
            "edges, or hexahedra of 8, 20 or 27 nodes"
        )
    return cells


def _surface(mesh: Any, path: Path) -> tuple[FloatArray, IntArray]:
    """Points and boundary triangles of what meshio read, oriented as the file orients its cells."""
    cells = _cells(mesh, path)
    points = np.asarray(mesh.points, dtype=np.float64)
    faces: dict[int, list[IntArray]] = {}
    if "hexahedron" in cells:
        solid = HexMesh(points, cells["hexahedron"])
        check_mesh(solid, path.name)
        faces[4] = [solid.elements[:, HEX_FACES].reshape(-1, 4)]
    for kind in _FACES.keys() & cells.keys():
        for group in _faces_outward(points, cells[kind], _FACES[kind]):
            faces.setdefault(group.shape[1], []).append(group)
    outside = [_outside(np.concatenate(group)) for group in faces.values()]
    solid_cells = {"hexahedron", *_FACES, *_BESIDE}
    shells = [data for kind, data in cells.items() if kind not in solid_cells]
    # A mesh of solid cells may name the faces of their boundary too: the same faces, not more.
    shells = [_others(shell, outside) for shell in shells]
    return surface_of_polygons(str(path), points, [*outside, *shells])


def _faces_outward(
    points: FloatArray, cells: IntArray, corners: list[list[int]]
) -> Iterator[IntArray]:
    """Each face of all cells, turned outward: programs number the corners of wedges both ways."""
    base = points[cells[:, corners[0]]]
    normal = np.cross(base[:, 1] - base[:, 0], base[:, 2] - base[:, 0])
    away = base.mean(axis=1) - points[cells].mean(axis=1)
    outward = np.einsum("ci,ci->c", normal, away) > 0.0
    for face in corners:
        yield np.where(outward[:, None], cells[:, face], cells[:, face[::-1]])


def _outside(faces: IntArray) -> IntArray:
    """Those faces that no second cell shares, in the order of the file."""
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return faces[np.sort(first[count == 1])]


def _others(shell: IntArray, outside: list[IntArray]) -> IntArray:
    """Those faces that are not among the boundary of solid cells, whichever way they turn."""
    known = [np.sort(faces, axis=1) for faces in outside if faces.shape[1] == shell.shape[1]]
    if not known:
        return shell
    n_known = sum(map(len, known))
    rows = np.concatenate([*known, np.sort(shell, axis=1)])
    _, same = np.unique(rows, axis=0, return_inverse=True)
    return shell[~np.isin(same.ravel()[n_known:], same.ravel()[:n_known])]


def _read_meshio(path: Path) -> tuple[FloatArray, IntArray, bool]:
    """Points, triangles, and whether nodes between corners were left out."""
    mesh = read_any_mesh(path)
    points = np.asarray(mesh.points, dtype=np.float64)
    if not points.size:
        raise MeshError(f"{path}: got no points; expected a surface: the file may be cut short")
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"{path}: expected points in space, got an array {points.shape}")
    _check_finite(path, points)
    return *_surface(mesh, path), any(cells.type in _CORNERS for cells in mesh.cells)


def _check_finite(path: Path, points: FloatArray, name: str = "") -> None:
    # Volumes are cubes of lengths, inertias their fifth powers: both must be numbers.
    where = f"{path}: {name}" if name else str(path)
    size = float(np.ptp(points, axis=0).max(initial=0.0)) if len(points) else 1.0
    if 0.0 < size < _LEAST:
        raise MeshError(
            f"{where}: all vertices lie within {size:.3g} units; expected a solid of {_LEAST:g} "
            "units or more"
        )
    if not (np.abs(points) < _LARGEST).all():
        raise MeshError(
            f"{where}: a vertex is not finite, or lies {_LARGEST:g} units away or more; expected "
            "finite coordinates"
        )


@contextmanager
def gmsh_session(name: str) -> Iterator[Any]:
    """Open gmsh and close it again; messages name what it meshes.

    Raises
    ------
    MeshError
        Where it cannot be loaded.
    """
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise MeshError(
            f"{name}: needs gmsh, which cannot be loaded here ({error}); install its system "
            "libraries (libGLU), or give a mesh of hexahedra, .vtu or .inp"
        ) from None
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        yield gmsh
    finally:
        gmsh.finalize()


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, list[int]]]:
    """A STEP file in gmsh, and its solids."""
    why = unreadable(path)
    if why is not None:
        raise MeshError(f"{path}: {why}; expected a STEP file")
    with gmsh_session(str(path)) as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        try:
            gmsh.model.occ.importShapes(str(path))
            gmsh.model.occ.synchronize()
        except Exception as error:  # gmsh raises bare exceptions
            raise MeshError(f"{path}: cannot be read as STEP ({error})") from None
        volumes = [tag for _, tag in gmsh.model.getEntities(3)]
        if not volumes:
            raise MeshError(f"{path}: holds no solid; expected at least one closed volume")
        yield gmsh, volumes


def _drawn(path: Path) -> bytes:
    """The solids of a STEP file as a BREP file; curved faces that coincide are one face.

    Facets of two meshes of one curved face would lie in each other.
    """
    with _opened(path) as (gmsh, volumes), TemporaryDirectory() as folder:
        if len(volumes) > 1 and _any_curved(gmsh) and not _share_faces(gmsh, volumes):
            gmsh.clear()
            gmsh.model.occ.importShapes(str(path))
            gmsh.model.occ.synchronize()
        copy = Path(folder) / "solids.brep"
        gmsh.write(str(copy))
        return copy.read_bytes()


def _any_curved(gmsh: Any) -> bool:
    return any(gmsh.model.getType(*face) != "Plane" for face in gmsh.model.getEntities(2))


def _share_faces(gmsh: Any, volumes: list[int]) -> bool:
    """Divide faces of solids along each other's edges; False: it fails, as where they overlap."""
    solids = [(3, volume) for volume in volumes]
    try:
        _, parts = gmsh.model.occ.fragment(solids[:1], solids[1:])
        gmsh.model.occ.synchronize()
    except Exception:  # gmsh raises bare exceptions for faces that it cannot divide
        return False
    return bool(parts == [[solid] for solid in solids])


@contextmanager
def _solids_in(drawn: bytes, path: Path) -> Iterator[tuple[Any, list[int]]]:
    """The solids of a BREP file in gmsh: faces have the same numbers each time."""
    with gmsh_session(str(path)) as gmsh, TemporaryDirectory() as folder:
        copy = Path(folder) / "solids.brep"
        copy.write_bytes(drawn)
        gmsh.model.occ.importShapes(str(copy))
        gmsh.model.occ.synchronize()
        yield gmsh, [tag for _, tag in gmsh.model.getEntities(3)]


def _nodes(gmsh: Any) -> tuple[FloatArray, IntArray]:
    """Nodes of the mesh, (n, 3) [mm], and the place of each by gmsh's number."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    place = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    place[tags.astype(np.int64)] = np.arange(len(tags))
    return np.asarray(coordinates, dtype=np.float64).reshape(-1, 3), place


@dataclass(frozen=True)
class StepFaces:
    """Faces of a STEP file that the triangles of a block are on."""

    path: Path
    drawn: bytes
    """Its solids, as a BREP file."""
    faces: IntArray
    """gmsh's number of the face of each triangle, 0 for flat ones; (n_triangles,)."""
    extent: tuple[float, FloatArray]
    """Volume [mm³] and centroid (3,) [mm] of the solid."""
    outward: FloatArray
    """Normals of the triangles, (n_triangles, 3)."""

    def curved(self, triangles: IntArray) -> BoolArray:
        """Whether triangles (n,) are of curved faces, (n,)."""
        return self.faces[triangles] > 0

    def together(self, triangles: IntArray) -> BoolArray:
        """Whether the two triangles of each row (n, 2) are of one curved face, (n,)."""
        one, other = self.faces[triangles].T
        return (one == other) & (one > 0)

    def on(self, points: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points on curved faces, and outward normals, as in `CurvedFaces`."""
        places, normals = points.copy(), self.outward[triangles].copy()
        if not len(triangles):
            return places, normals
        with _solids_in(self.drawn, self.path) as (gmsh, _):
            for face in np.unique(self.faces[triangles]).tolist():
                mine = self.faces[triangles] == face
                near, at = gmsh.model.getClosestPoint(2, face, points[mine].ravel())
                normal = np.reshape(gmsh.model.getNormal(face, at), (-1, 3))
                along = np.einsum("ni,ni->n", normal, normals[mine])
                places[mine] = np.reshape(near, (-1, 3))
                normals[mine] = normal * np.sign(along)[:, None]
        return places, normals


def _read_step(
    drawn: bytes, path: Path, element_size: float | None
) -> list[tuple[FloatArray, IntArray, IntArray, tuple[float, FloatArray]]]:
    """Points and triangles of the boundary of each solid of a STEP file, curved faces, extent."""
    with _solids_in(drawn, path) as (gmsh, volumes):
        if element_size is not None:
            gmsh.option.setNumber("Mesh.MeshSizeMax", element_size)
        gmsh.model.mesh.generate(2)
        points, place = _nodes(gmsh)
        solids = []
        for tag in volumes:
            parts, faces = [], []
            for _, face in gmsh.model.getBoundary([(3, tag)], oriented=False):
                _, nodes = gmsh.model.mesh.getElementsByType(2, face)
                parts.append(place[nodes.astype(np.int64)].reshape(-1, 3))
                number = 0 if gmsh.model.getType(2, face) == "Plane" else face
                faces.append(np.full(len(parts[-1]), number))
            every, of = np.concatenate(parts), np.concatenate(faces)
            merged, triangles = merge_points(points, one_solid(points, turned_alike(every)))
            # Parts of a solid are put in order, and triangles without area dropped.
            _, nearest = cKDTree(points[every].mean(axis=1)).query(merged[triangles].mean(axis=1))
            volume = float(gmsh.model.occ.getMass(3, tag))
            middle = np.array(gmsh.model.occ.getCenterOfMass(3, tag))
            solids.append((merged, triangles, of[nearest], (volume, middle)))
        return solids


@dataclass(frozen=True)
class _Solid:
    """One closed surface, or what should be one."""

    name: str
    """In messages."""
    points: FloatArray
    """[mm]"""
    triangles: IntArray
    given_name: str = ""
    held: bool = False
    repairs: tuple[str, ...] = ()
    fault: str = ""
    """Why its surface could not be taken apart into solids; empty where it could."""
    source: tuple[Path, str] | None = None
    """File and its unit, as in `Polyhedron`."""
    step: tuple[Path, bytes, IntArray, tuple[float, FloatArray]] | None = None
    """STEP file, its solids, the faces of the triangles and the extent as in `StepFaces`."""
    unrepaired: tuple[Path, NamedSurface, FloatArray, IntArray] | None = None
    """Surface that it is a part of, which can be mended; None: it was mended, or is of a STEP
    file."""

    def faults(self, block: Polyhedron) -> list[str]:
        """All that keeps it from being a block, and whether `repair` mends it."""
        words = [self.fault] if self.fault else [*faults(block)]
        if words and self.unrepaired is not None:
            mended = _solids_of(*self.unrepaired, repair=True)
            if not any(solid.faults(solid.block()) for solid in mended):
                words[0] += ", or set repair = true"
        return words

    def block(self, *, straightened: bool = False) -> Polyhedron:
        """As a block, not checked."""
        block = turned_outward(
            self.name,
            self.points,
            self.triangles,
            straightened=straightened,
            given_name=self.given_name,
            held=self.held,
            repairs=self.repairs,
            source=self.source,
        )
        if self.step is None or not self.step[2].any():
            return block
        return replace(block, exact=StepFaces(*self.step, block.normals))

    def checked(self, *, straightened: bool = False) -> Polyhedron:
        """As a block.

        Raises
        ------
        MeshError
            When it bounds no solid.
        """
        block = self.block(straightened=straightened)
        words = self.faults(block)
        if words:
            raise MeshError(f"{self.name}: {words[0]}")
        return block


def read_blocks(
    path: str | Path,
    *,
    units: str = "mm",
    element_size: float | None = None,
    repair: bool = False,
    leave_out: Sequence[int | str] = (),
) -> list[Polyhedron]:
    """Read the solids of a file: each closed surface is one block shape.

    Objects and groups that are closed by themselves are taken one by one and keep their names; one
    solid without a name has that of its file.
    Solids that touch along faces, edges or corners are told apart, and cavities belong to the
    solid round them; see `closed_solids`.

    Parameters
    ----------
    path
        .stl, .obj, .ply, .off, .vtu, .inp, … (meshio), .step, .stp (gmsh), .json (compas), .glb,
        .gltf, .3mf (trimesh) or .3dm (rhino3dm).
    units
        Unit of the file: mm, cm, m or inch. STEP, glTF, 3MF and 3DM files name theirs and are read
        in mm.
    element_size
        Largest triangle on curved STEP faces [mm].
    repair
        Whether to mend surfaces as `geometry.files.repair.repaired` does.
    leave_out
        Solids that are not wanted, faulty ones too: numbers in the file, or names.

    Raises
    ------
    MeshError
        When the file cannot be read, or its surface bounds no solid.
    AssemblyError
        For a number or a name to leave out that no solid has.
    """
    if not isinstance(repair, bool):
        raise MeshError(f"repair: got {repair!r}; expected True or False")
    solids, straightened = _solids(Path(path), units, element_size, repair=repair)
    names = [solid.given_name for solid in solids]
    out = {k for one in leave_out for k in numbers_of("parts.leave_out", one, names)}
    if len(out) == len(solids):
        raise MeshError(f"{path}: parts.leave_out names all {len(solids)} solids; expected some")
    kept = [k for k in range(len(solids)) if k not in out]
    return [_checked(solids, k, straightened=straightened) for k in kept]


def _checked(solids: Sequence[_Solid], k: int, *, straightened: bool) -> Polyhedron:
    """One of the solids of a file as a block, checked; where it is faulty, how to go on without."""
    without = f"; or leave it out: parts.leave_out = [{k}] (`tubelock check` lists all faults)"
    try:
        return solids[k].checked(straightened=straightened)
    except MeshError as error:
        raise MeshError(f"{error}{without if len(solids) > 1 else ''}") from None


def surface_blocks(
    place: str, surface: NamedSurface, *, scale: float, repair: bool
) -> list[Polyhedron]:
    """Blocks of a surface: one for each closed part of it, as `read_blocks` makes them.

    Parameters
    ----------
    place
        What messages call it where it has no name.
    surface
        Its points in any unit.
    scale
        Millimetres in that unit.
    repair
        Whether to mend it as `geometry.files.repair.repaired` does.

    Raises
    ------
    MeshError
        When it bounds no solid.
    """
    _check_finite(Path(place), surface.points, surface.name)
    points, triangles = merge_points(*_triangulated(Path(place), [surface])[0])
    solids = _solids_of(Path(place), surface, scale * points, triangles, repair=repair)
    return [solid.checked() for solid in solids]


def diagnosed_blocks(
    path: Path, *, units: str = "mm", element_size: float | None = None, repair: bool = False
) -> list[tuple[Polyhedron, list[str]]]:
    """Read the surfaces of a file as `read_blocks`, and list all that is wrong with each of them.

    Raises
    ------
    MeshError
        When the file cannot be read.
    """
    solids, _ = _solids(path, units, element_size, repair=repair)
    return [(block, solid.faults(block)) for solid in solids for block in [solid.block()]]


def _solids(
    path: Path, units: str, element_size: float | None, *, repair: bool
) -> tuple[list[_Solid], bool]:
    """Surfaces of all solids of a file, and whether nodes between corners were left out."""
    scale = millimetres(units)
    suffix = path.suffix.lower()
    if suffix in STEP_SUFFIXES:
        drawn = _drawn(path)
        result = _read_step(drawn, path, element_size)
        several = len(result) > 1
        return [
            _Solid(
                f"{path.name}{f' part {k}' if several else ''}",
                points,
                triangles,
                "" if several else path.stem,
                source=(path, units),
                step=(path, drawn, faces, extent),
            )
            for k, (points, triangles, faces, extent) in enumerate(result)
        ], False
    straightened = False
    surfaces = _named_surfaces(path, suffix)
    if surfaces:
        for surface in surfaces:
            _check_finite(path, surface.points, surface.name)
        parts = _closed_or_whole(path, surfaces)
    else:
        points, triangles, straightened = _read_meshio(path)
        parts = [(NamedSurface("", points, ()), *merge_points(points, triangles))]
    scale = 1.0 if suffix in OWN_UNITS else scale
    solids: list[_Solid] = []
    for surface, points, triangles in parts:
        solids += _solids_of(path, surface, scale * points, triangles, repair=repair)
    several = len(solids) > 1
    return [
        replace(
            solid,
            name=solid.name if solid.given_name or not several else f"{path.name} part {k}",
            given_name=solid.given_name if several else solid.given_name or path.stem,
            source=(path, units),
        )
        for k, solid in enumerate(solids)
    ], straightened


def millimetres(units: str) -> float:
    """Millimetres in a unit."""
    if units not in UNITS:
        raise MeshError(f"units: got {units!r}; expected one of {', '.join(UNITS)}")
    return UNITS[units]


def _named_surfaces(path: Path, suffix: str) -> list[NamedSurface]:
    """Surfaces of a format that names them; none of others."""
    if suffix == ".obj":
        from geometry.files.formats.obj import read_obj

        return read_obj(path)
    if suffix == ".stl" and unreadable(path) is None:
        from geometry.files.formats.stl import is_text, read_stl_text

        return read_stl_text(path) if is_text(path) else []
    return read_named(path) if suffix in READ else []


_Part = tuple[NamedSurface, FloatArray, IntArray]


def _closed_or_whole(path: Path, surfaces: list[NamedSurface]) -> list[_Part]:
    """Objects with their merged points and triangles; all as one where most of them are open.

    Programs also group the faces of one solid, by material or by side.
    """
    parts = [
        (surface, *merge_points(points, triangles))
        for surface, (points, triangles) in zip(
            surfaces, _triangulated(path, surfaces), strict=True
        )
    ]
    closed = sum(is_closed(triangles) for _, _, triangles in parts)
    if len(parts) == 1 or 2 * closed >= len(parts):
        return parts
    shift = np.cumsum([0, *(len(points) for _, points, _ in parts)])
    points = np.concatenate([points for _, points, _ in parts])
    triangles = np.concatenate([t + k for (_, _, t), k in zip(parts, shift[:-1], strict=True)])
    return [(NamedSurface("", points, ()), *merge_points(points, triangles))]


def _triangulated(path: Path, surfaces: list[NamedSurface]) -> list[tuple[FloatArray, IntArray]]:
    """Points and triangles of each surface, all cut at once."""
    shift = np.cumsum([0, *(len(surface.points) for surface in surfaces)])
    groups: dict[int, list[IntArray]] = {}
    for surface, first in zip(surfaces, shift[:-1].tolist(), strict=True):
        for group in surface.faces:
            groups.setdefault(group.shape[1], []).append(group + first)
    try:
        points, triangles = surface_of_polygons(
            str(path),
            np.concatenate([surface.points for surface in surfaces]),
            [np.concatenate(group) for group in groups.values()],
        )
    except MeshError:  # once more, one by one: the message names which of them it is
        return [
            surface_of_polygons(
                ": ".join(filter(None, [str(path), one.name])), one.points, one.faces
            )
            for one in surfaces
        ]
    # Each triangle begins with a corner that the file gives.
    of = np.searchsorted(shift, triangles[:, 0], side="right") - 1
    order = np.argsort(of, kind="stable")
    cuts = np.searchsorted(of[order], np.arange(1, len(surfaces)))
    parts = []
    for triangles_of_one in np.split(triangles[order], cuts):
        used, place = np.unique(triangles_of_one, return_inverse=True)
        parts.append((points[used], place.reshape(-1, 3)))
    return parts


def _solids_of(
    path: Path, surface: NamedSurface, points: FloatArray, triangles: IntArray, *, repair: bool
) -> list[_Solid]:
    """Solids of one surface; one with its fault where it cannot be taken apart."""
    name = f"{path.name}: {surface.name}" if surface.name else path.name
    unrepaired = None if repair else (path, surface, points, triangles)
    repairs: tuple[str, ...] = ()
    if repair:
        points, triangles, repairs = repaired(points, triangles)
    whole = _Solid(
        name, points, triangles, surface.name, surface.held, repairs, unrepaired=unrepaired
    )
    try:
        solids = closed_solids(name, points, triangles)
    except MeshError as error:
        return [replace(whole, fault=str(error).removeprefix(f"{name}: "))]
    if len(solids) == 1:
        return [replace(whole, triangles=solids[0])]
    return [
        replace(
            whole,
            name=f"{name} part {k}",
            given_name=f"{surface.name} part {k}" if surface.name else "",
            triangles=part,
        )
        for k, part in enumerate(solids)
    ]


def _has_sides(gmsh: Any, face: int) -> bool:
    """Whether a face has three or four sides; gmsh crashes on a seam, as of a ball or a torus."""
    curves = [curve for _, curve in gmsh.model.getBoundary([(2, face)], combined=False)]
    return len({abs(curve) for curve in curves}) == len(curves) in {3, 4}


def _made_of_hexahedra(gmsh: Any, divisions: int) -> bool:
    """Try a transfinite mesh of the current model."""
    if not all(_has_sides(gmsh, face) for _, face in gmsh.model.getEntities(2)):
        return False
    try:
        gmsh.model.mesh.setTransfiniteAutomatic()
        for _, curve in gmsh.model.getEntities(1):
            gmsh.model.mesh.setTransfiniteCurve(curve, divisions + 1)
        gmsh.option.setNumber("Mesh.RecombineAll", 1)
        gmsh.model.mesh.generate(3)
    except Exception:  # gmsh raises bare exceptions for faces that have no such mesh
        return False
    return {int(kind) for kind in gmsh.model.mesh.getElements(3)[0]} == {_HEXAHEDRON}


def hexahedra_in(gmsh: Any, volume: int) -> HexMesh:
    """Hexahedra of a volume of the current model."""
    points, place = _nodes(gmsh)
    _, nodes = gmsh.model.mesh.getElementsByType(_HEXAHEDRON, volume)
    used, corner = np.unique(place[nodes.astype(np.int64)], return_inverse=True)
    return HexMesh(points[used], corner.reshape(-1, 8).astype(np.int64))


def step_hexahedra(path: Path, *, divisions: int = 4) -> list[HexMesh]:
    """Hexahedra of each solid of a STEP file, made by gmsh, ``divisions`` along each edge.

    gmsh makes them where every face of all solids has three or four sides (transfinite meshing);
    none for other files.

    Raises
    ------
    MeshError
        A file that cannot be read, or hexahedra that cannot be used.
    """
    with _opened(path) as (gmsh, volumes):
        if not _made_of_hexahedra(gmsh, divisions):
            return []
        meshes = [hexahedra_in(gmsh, volume) for volume in volumes]
    for mesh in meshes:
        check_mesh(mesh, path.name)
    return meshes
