"""Meshes in and out: `.vtu` for ParaView; others, such as `.inp`, through meshio."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from geometry.errors import unreadable
from geometry.files.vtu import as_grid, write_vtu
from geometry.machine.system import cpu_limit, write_whole
from geometry.mesh import FloatArray, HexMesh, IntArray, MeshError

#: Lines of a deck that turn and move a part, and that read another file.
_INSTANCE = re.compile(rb"^\s*\*instance\b", re.IGNORECASE | re.MULTILINE)
_INCLUDE = re.compile(rb"^\s*\*include\b", re.IGNORECASE | re.MULTILINE)
#: Its type of elements.
_ELEMENT_TYPE = re.compile(r"^\s*\*element\b.*?\btype\s*=\s*(\w+)", re.IGNORECASE | re.MULTILINE)


#: Hexahedra that files hold, by meshio's names.
HEXAHEDRA = {"hexahedron", "hexahedron20", "hexahedron27"}
#: CPU time that reading a mesh may take [s], and beyond it the slowest that files are read [B/s].
_READ_SECONDS, _READ_SPEED = 5.0, 2e5


#: VTK's numbers of the cells that meshio names so.
_VTK_KINDS = {"vertex": 1, "triangle": 5, "quad": 9, "hexahedron": 12, "lagrange hexahedron": 72}
_Data = Mapping[str, npt.NDArray[Any]]


def write_cells(
    path: Path,
    points: FloatArray,
    kind: str,
    cells: IntArray,
    *,
    point_data: _Data | None = None,
    cell_data: _Data | None = None,
) -> None:
    """Write cells of one kind, the whole file or none of it.

    Parameters
    ----------
    path
        Its suffix says the format (`.vtu`, `.inp`, `.stl`, …).
    points
        (n_points, 3) [mm].
    kind
        ``vertex``, ``triangle``, ``quad`` or ``hexahedron``.
    cells
        Points of each cell, (n_cells, n_corners).
    point_data, cell_data
        Arrays with one row per point, and per cell.
    """
    data: dict[str, Any] = {"point_data": point_data or {}, "cell_data": cell_data or {}}
    if path.suffix.lower() == ".vtu":
        grid = as_grid(points, _VTK_KINDS[kind], cells, **data)
        write_whole(path, lambda partial: write_vtu(partial, grid))
        return
    import meshio

    data["cell_data"] = {name: [values] for name, values in data["cell_data"].items()}
    mesh = meshio.Mesh(points, [(kind, cells)], **data)
    write_whole(path, lambda partial: meshio.write(partial, mesh))


def write_hex_mesh(
    path: Path,
    mesh: HexMesh,
    *,
    point_data: _Data | None = None,
    cell_data: _Data | None = None,
) -> None:
    """Write hexahedra; the format follows the suffix (`.vtu`, `.inp`, …).

    Data are arrays with one row per node, and per element.
    """
    kind, cells = "hexahedron", mesh.elements
    write_cells(path, mesh.nodes, kind, cells, point_data=point_data, cell_data=cell_data)


def write_lagrange_cells(
    path: Path,
    positions: FloatArray,
    places: IntArray,
    point_data: _Data,
    cell_data: _Data,
) -> None:
    """Write curved hexahedra of any degree as Lagrange cells, each with nodes of its own.

    Parameters
    ----------
    path
        File to write, `.vtu`.
    positions
        Equidistant nodes, (n_cells, n_points, 3) [mm].
    places
        Place of each of these in the three directions, from 0, (n_points, 3).
    point_data, cell_data
        Arrays with one row per node, cell after cell, and per cell.
    """
    from vtkmodules.vtkCommonDataModel import vtkHigherOrderHexahedron

    n_cells, n_points, _ = positions.shape
    degree = int(places.max())
    order = [degree, degree, degree, n_points]
    numbered = vtkHigherOrderHexahedron.PointIndexFromIJK
    number = [numbered(int(i), int(j), int(k), order) for i, j, k in places]
    cells = np.empty((n_cells, n_points), dtype=np.int64)
    cells[:, number] = np.arange(n_cells * n_points).reshape(n_cells, n_points)
    kind, nodes = "lagrange hexahedron", positions.reshape(-1, 3)
    write_cells(path, nodes, kind, cells, point_data=point_data, cell_data=cell_data)


@contextmanager
def _as_meshio_reads(path: Path) -> Iterator[Path]:
    """Yield the file, or a copy of a PLY whose faces list ``vertex_index``, as some write."""
    head, end, rest = b"", b"end_header", b""
    if path.suffix.lower() == ".ply":
        head, end, rest = path.read_bytes().partition(end)
    renamed = re.sub(rb"(property list \S+ \S+ )vertex_index(?=\s)", rb"\1vertex_indices", head)
    if renamed == head:
        yield path
        return
    with TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        copy.write_bytes(renamed + end + rest)
        yield copy


def read_any_mesh(path: Path) -> Any:
    """Read a mesh file of any kind that meshio knows.

    Raises
    ------
    MeshError
        When it cannot be read.
    """
    import meshio

    why = unreadable(path)
    if why is not None:
        raise MeshError(f"{path}: {why}; expected a mesh file")
    text = path.read_bytes() if path.suffix.lower() == ".inp" else b""
    if _INSTANCE.search(text):
        raise MeshError(
            f"{path}: places parts by *Instance, which a reader of meshes drops; expected a mesh "
            "alone, its nodes where they are meant"
        )
    if _INCLUDE.search(text):
        raise MeshError(
            f"{path}: *Include of another file, of any folder; expected a mesh in one file"
        )
    try:
        # meshio probes whether an STL file is binary, and prints before it gives up; some of its
        # readers look for ever for what a file that was cut short does not hold.
        with (
            cpu_limit(
                _READ_SECONDS + path.stat().st_size / _READ_SPEED,
                "it does not come to an end: is the file cut short?",
            ),
            np.errstate(all="ignore"),
            redirect_stdout(StringIO()),
            redirect_stderr(StringIO()),
            _as_meshio_reads(path) as file,
        ):
            return meshio.read(file)
    # Bytes that are no such file raise what they like, a missing reader and SystemExit too.
    except (Exception, SystemExit) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        known = ("1", "0")  # statuses of meshio's exits
        words = "not in the format of its extension" if reason in known else reason
        words = _unknown_elements(path) or words
        raise MeshError(f"{path}: cannot be read as a mesh ({words})") from None


def _unknown_elements(path: Path) -> str | None:
    """Name the element types of an Abaqus file that are not supported; None for other files."""
    if path.suffix.lower() != ".inp":
        return None
    from meshio.abaqus._abaqus import abaqus_to_meshio_type

    types = _ELEMENT_TYPE.findall(path.read_text("utf-8", errors="replace"))
    unknown = [kind for kind in dict.fromkeys(types) if kind.upper() not in abaqus_to_meshio_type]
    if not unknown:
        return None
    return (
        f"element type {', '.join(unknown)}; expected C3D8 or C3D20 in INP, or VTU for hexahedra "
        "of 27 nodes"
    )


def hexahedra_of(mesh: Any, path: Path) -> tuple[HexMesh, IntArray]:
    """Hexahedra of what meshio read: corners as a mesh, and all nodes, (n, 8, 20 or 27).

    Raises
    ------
    MeshError
        Other solid cells, or hexahedra of two kinds.
    """
    cells = [group for group in mesh.cells if group.dim == 3]
    kinds = {group.type for group in cells}
    if len(kinds) != 1 or not kinds <= HEXAHEDRA:
        types = ", ".join(sorted({group.type for group in mesh.cells})) or "no cells"
        raise MeshError(f"{path}: got {types}; expected hexahedra of one kind: 8, 20 or 27 nodes")
    members = np.concatenate([group.data for group in cells]).astype(np.int64)
    nodes = np.ascontiguousarray(mesh.points, dtype=np.float64)
    return HexMesh(nodes, np.ascontiguousarray(members[:, :8])), members
