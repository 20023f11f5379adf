"""Solids in files: told apart where they touch, nothing lost or counted twice."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from geometry.families.masonry import CircularArch
from geometry.files import mesh_io
from geometry.files.block_files import read_blocks
from geometry.files.formats.obj import read_obj
from geometry.mesh import FloatArray, IntArray, MeshError
from geometry.polyhedra.polygons import surface_of_polygons
from geometry.polyhedra.polyhedron import convex_polyhedron, polyhedron
from geometry.polyhedra.solids import one_solid

pytestmark = pytest.mark.quick

#: Outline of an L of 500 mm², counter-clockwise.
L_OUTLINE = np.array([[0, 0], [30, 0], [30, 10], [10, 10], [10, 30], [0, 30]], dtype=float)
SIDE = 10.0


def cube(*at: float) -> tuple[FloatArray, IntArray]:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    shape = convex_polyhedron("cube", SIDE * (corners + np.array(at)))
    return shape.points, shape.triangles


def soup(*parts: tuple[FloatArray, IntArray]) -> meshio.Mesh:
    first = np.cumsum([0, *(len(p) for p, _ in parts[:-1])])
    triangles = np.concatenate([t + k for (_, t), k in zip(parts, first, strict=True)])
    return meshio.Mesh(np.concatenate([p for p, _ in parts]), [("triangle", triangles)])


def volumes(path: Path) -> list[float]:
    return sorted(block.volume for block in read_blocks(path))


def turned(part: tuple[FloatArray, IntArray]) -> tuple[FloatArray, IntArray]:
    """Inside out."""
    return part[0], part[1][:, ::-1]


@pytest.mark.parametrize(
    "shift",
    [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0.5, 0)],
    ids=["face", "edge", "corner", "half a face"],
)
def test_solids_that_touch_in_one_file_are_two_blocks(tmp_path: Path, shift) -> None:
    """Welded before: one block of twice the volume, and nothing left to move."""
    for name, parts in (
        ("both", (cube(0, 0, 0), cube(*shift))),
        ("inside out", (turned(cube(0, 0, 0)), turned(cube(*shift)))),
    ):
        meshio.write(tmp_path / f"{name}.stl", soup(*parts))
        assert volumes(tmp_path / f"{name}.stl") == pytest.approx([SIDE**3] * 2, rel=1e-5)


def test_a_block_that_touches_itself_is_one_block(tmp_path: Path) -> None:
    """Two cubes that meet in one edge only stand on a common layer of four."""
    grid = np.indices((3, 3, 3)).reshape(3, -1).T * SIDE
    number = np.arange(27).reshape(3, 3, 3)

    def cell(i: int, j: int, k: int) -> list[int]:
        n = number[i : i + 2, j : j + 2, k : k + 2]
        return [n[a] for a in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))] + [
            n[a] for a in ((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
        ]

    # Below a full layer; above two cubes that meet in one edge only.
    cells = [cell(i, j, 0) for i in (0, 1) for j in (0, 1)] + [cell(0, 0, 1), cell(1, 1, 1)]
    mesh = meshio.Mesh(grid.astype(float), [("hexahedron", np.array(cells))])
    meshio.write(tmp_path / "steps.vtu", mesh)
    assert volumes(tmp_path / "steps.vtu") == pytest.approx([6 * SIDE**3])


def test_an_arch_in_one_file_is_as_many_voussoirs(tmp_path: Path) -> None:
    arch = CircularArch(1000.0, 200.0, 100.0, 9, embrace=180.0).build()
    parts = [
        (arch.shape(b).points @ arch.rotations[b].T + arch.translations[b], arch.shape(b).triangles)
        for b in range(arch.n_blocks)
    ]
    meshio.write(tmp_path / "arch.stl", soup(*parts))
    # Single precision of coordinates up to 1100 mm on blocks of 100 mm.
    assert volumes(tmp_path / "arch.stl") == pytest.approx(sorted(arch.volumes), rel=1e-5)


def test_triangles_that_are_there_twice_are_refused(tmp_path: Path) -> None:
    """The cube had 16 000 for 8 000 mm³, and twice the weight."""
    meshio.write(tmp_path / "twice.stl", soup(cube(0, 0, 0), cube(0, 0, 0)))
    with pytest.raises(MeshError, match="12 triangles are there more than once"):
        read_blocks(tmp_path / "twice.stl")
    points, triangles = cube(0, 0, 0)
    with pytest.raises(MeshError, match="more than once"):
        polyhedron("twice", points, np.concatenate([triangles, triangles]))


def test_coincident_solids_with_other_diagonals_are_refused(tmp_path: Path) -> None:
    points, triangles = cube(0, 0, 0)
    mirrored = points[:, [1, 0, 2]], triangles[:, ::-1]
    meshio.write(tmp_path / "twice.stl", soup((points, triangles), mirrored))
    with pytest.raises(MeshError, match=r"lie on each other|more than once"):
        read_blocks(tmp_path / "twice.stl")


# ---------------------------------------------------------------------------------------------
# Faces of any shape


def prism(outline: FloatArray) -> str:
    """OBJ of a prism with polygons as lids."""
    n = len(outline)
    lines = [f"v {x} {y} {z}" for z in (0, 20) for x, y in outline]
    lines.append("f " + " ".join(str(k) for k in range(n, 0, -1)))
    lines.append("f " + " ".join(str(k) for k in range(n + 1, 2 * n + 1)))
    lines += [f"f {k + 1} {(k + 1) % n + 1} {(k + 1) % n + n + 1} {k + n + 1}" for k in range(n)]
    return "\n".join(lines)


@pytest.mark.parametrize("first", range(6))
def test_a_concave_face_is_cut_inside_itself(tmp_path: Path, first: int) -> None:
    """Fanned from the first corner, triangles lay outside the L wherever that corner is."""
    (tmp_path / "L.obj").write_text(prism(np.roll(L_OUTLINE, first, axis=0)))
    (block,) = read_blocks(tmp_path / "L.obj")
    assert block.volume == pytest.approx(500.0 * 20.0)
    below = block.areas[block.normals[:, 2] < -0.5]
    assert below.sum() == pytest.approx(500.0)


def outline_area(outline: FloatArray) -> float:
    x, y = outline.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_triangles_cover_a_polygon_once(offset: float) -> None:
    """Their areas add up to that of the outline only if none lies outside or on another."""
    angle = np.linspace(0.0, 2 * np.pi, 20, endpoint=False)
    radius = np.where(np.arange(20) % 2, 4.0, 10.0)
    star = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    halves = 0.5 * (L_OUTLINE + np.roll(L_OUTLINE, -1, axis=0))
    with_middles = np.stack([L_OUTLINE, halves], axis=1).reshape(-1, 2)
    for outline in (L_OUTLINE, star, with_middles):
        points = np.column_stack([outline, np.zeros(len(outline))]) + offset
        for turn in (1, -1):
            corners = np.arange(len(outline))[None, ::turn]
            nodes, triangles = surface_of_polygons("face", points, [corners])
            p = nodes[triangles]
            area = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
            # Coordinates are rounded to 1e-16 of the offset, lengths are about 10.
            assert area.sum() == pytest.approx(outline_area(outline), rel=1e-8)
            assert area.min() > 0.0


def test_faces_that_cross_themselves_are_refused() -> None:
    angle = np.radians([0, 144, 288, 72, 216])
    points = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(5)])
    with pytest.raises(MeshError, match="crosses or touches itself"):
        surface_of_polygons("pentagram", points, [np.arange(5)[None]])


def test_triangles_folded_on_each_other_are_refused(tmp_path: Path) -> None:
    """As another program writes an L whose lids it fanned from the wrong corner."""
    n = len(L_OUTLINE)
    text = prism(L_OUTLINE).splitlines()
    walls = [line for line in text if line.startswith("v") or len(line.split()) == 5]
    lids = [f"f {n} {k + 1} {k}" for k in range(1, n - 1)]
    lids += [f"f {2 * n} {n + k} {n + k + 1}" for k in range(1, n - 1)]
    (tmp_path / "fanned.obj").write_text("\n".join(walls + lids))
    with pytest.raises(MeshError, match="folded back on itself"):
        read_blocks(tmp_path / "fanned.obj")


def test_obj_as_a_modelling_program_writes_it(tmp_path: Path) -> None:
    """Texture coordinates, normals, backward indices, colours, groups, continued lines."""
    points, triangles = cube(0, 0, 0)
    vertices = [f"v {x} {y} {z} 0.5 0.5 0.5" for x, y, z in points]
    forward = [f"f {a + 1}/1/1 {b + 1}//1 {c + 1}/2" for a, b, c in triangles]
    backward = [f"f {a - 8} {b - 8} \\\n {c - 8}" for a, b, c in triangles]
    start = ["# exported", "mtllib a.mtl", "o Cube", "vt 0.0 1.0", "vn 0 0 1"]
    beside = ["s off", "usemtl grey", "g side", "l 1 2", ""]
    for faces in (forward, backward):
        (tmp_path / "cube.obj").write_text("\n".join([*start, *vertices, *beside, *faces]))
        assert volumes(tmp_path / "cube.obj") == pytest.approx([SIDE**3])


def test_an_obj_says_the_same_however_it_is_written(tmp_path: Path) -> None:
    points = np.random.default_rng(0).standard_normal((9, 3)) * 10.0 ** np.arange(-4, 5)[:, None]
    faces = np.random.default_rng(1).integers(1, 10, (7, 4))
    vertices = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    ways = {
        "plain": ("f {} {} {} {}", faces),
        "remarked": ("# a face\nf {} {} {} {} # with words behind", faces),
        "slashed": ("f {}/1 {}//2 {}/1/2 {}", faces),
        "indented": ("\tf {} {} {} {}", faces),
        "backward": ("f {} {} {} {}", faces - 10),
    }
    for name, (line, corners) in ways.items():
        lines = [*vertices, *(line.format(*row) for row in corners.tolist())]
        (tmp_path / f"{name}.obj").write_text("\n".join(lines))
        (surface,) = read_obj(tmp_path / f"{name}.obj")
        found, (group,) = surface.points, surface.faces
        np.testing.assert_array_equal(found, points)
        np.testing.assert_array_equal(group, faces - 1)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("f 1 2 99", "names point 99"),
        ("f 1 2 -99", "line 9: .*no point -99"),
        ("f 1 0 2", "line 9: .*no point 0"),
        ("f 1 2", "line 9: .*fewer than three corners"),
        ("v 1 2", "line 9: .*not enough values"),
        ("f a b c", "line 9: .*invalid literal"),
        ("", "no faces"),
    ],
)
def test_bad_lines_of_an_obj_are_named(tmp_path: Path, line: str, words: str) -> None:
    points, _ = cube(0, 0, 0)
    (tmp_path / "bad.obj").write_text("\n".join([*(f"v {x} {y} {z}" for x, y, z in points), line]))
    with pytest.raises(MeshError, match=words):
        read_blocks(tmp_path / "bad.obj")


# ---------------------------------------------------------------------------------------------
# Cells of several kinds

#: The unit cube of VTK, and six tetrahedra, two wedges, or three pyramids that fill it.
CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float
)
FILLINGS = {
    "hexahedron": [[0, 1, 2, 3, 4, 5, 6, 7]],
    "tetra": [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]],
    "wedge": [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]],
    "pyramid": [[0, 1, 2, 3, 6], [0, 3, 7, 4, 6], [0, 4, 5, 1, 6]],
}


@pytest.mark.parametrize("turned_round", [False, True])
def test_no_kind_of_cell_is_lost(tmp_path: Path, turned_round: bool) -> None:
    """One cube of each kind: the file gave the hexahedron alone."""
    cells, points = [], []
    for place, (kind, filling) in enumerate(FILLINGS.items()):
        corners = np.array(filling) + 8 * place
        if turned_round and kind == "wedge":
            corners = corners[:, [3, 4, 5, 0, 1, 2]]
        cells.append((kind, corners))
        points.append(SIDE * CUBE + np.array([3.0 * SIDE * place, 0, 0]))
    far = [3.0 * SIDE * len(FILLINGS), 0, 0]
    shell, triangles = cube(0, 0, 0)
    cells.append(("triangle", triangles + 8 * len(FILLINGS)))
    points.append(shell + np.array(far))
    mesh = meshio.Mesh(np.concatenate(points), cells)
    meshio.write(tmp_path / "all.vtu", mesh)
    assert volumes(tmp_path / "all.vtu") == pytest.approx([SIDE**3] * 5)
    with pytest.raises(MeshError, match="expected hexahedra of one kind"):
        mesh_io.hexahedra_of(mesh_io.read_any_mesh(tmp_path / "all.vtu"), tmp_path / "all.vtu")


def test_boundary_faces_named_beside_the_cells_count_once(tmp_path: Path) -> None:
    """As mesh programs write them, to carry names of sides."""
    quads = [[0, 3, 2, 1], [4, 5, 6, 7]]
    cells = [("hexahedron", np.array(FILLINGS["hexahedron"])), ("quad", np.array(quads))]
    meshio.write(tmp_path / "named.vtu", meshio.Mesh(SIDE * CUBE, cells))
    assert volumes(tmp_path / "named.vtu") == pytest.approx([SIDE**3])


def test_cells_that_are_not_known_are_named(tmp_path: Path) -> None:
    points = np.concatenate([CUBE, CUBE[:2] + 0.5])
    cells = [("tetra10", np.arange(10)[None]), ("hexahedron", np.array(FILLINGS["hexahedron"]))]
    meshio.write(tmp_path / "second.vtu", meshio.Mesh(points, cells))
    with pytest.raises(MeshError, match="got tetra10; expected"):
        read_blocks(tmp_path / "second.vtu")


CORNERS = 10.0 * np.array(
    [[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=np.float64
)


def test_cells_that_are_there_twice_are_refused(tmp_path: Path) -> None:
    """Their faces cancel each other: the file had held no block at all."""
    file = tmp_path / "twice.vtu"
    meshio.write(file, meshio.Mesh(CORNERS, [("hexahedron", np.array([np.arange(8)] * 2))]))
    with pytest.raises(MeshError, match=r"1 of 2 cells \(hexahedron\) are there more than once"):
        read_blocks(file)


@pytest.mark.parametrize("point", [-8, 99])
def test_faces_that_name_no_point_are_refused(tmp_path: Path, point: int) -> None:
    """Also counted back: -8 had been taken for the last but seven."""
    head = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n"
    head += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
    (tmp_path / "a.ply").write_text(f"{head}{rows}4 0 1 2 {point}\n")
    with pytest.raises(MeshError, match=rf"names point.*{point}"):
        read_blocks(tmp_path / "a.ply")


def test_reading_a_file_that_is_cut_short_ends(tmp_path: Path, monkeypatch) -> None:
    """A reader of ours looks for ever for the bracket that closes a section."""
    monkeypatch.setattr(mesh_io, "_READ_SECONDS", 0.5)
    meshio.ansys.write(tmp_path / "a.msh", meshio.Mesh(CORNERS, [("hexahedron", [[*range(8)]])]))
    whole = (tmp_path / "a.msh").read_bytes()
    assert len(read_blocks(tmp_path / "a.msh")) == 1
    (tmp_path / "a.msh").write_bytes(whole[: whole.rindex(b")") - 12])
    with pytest.raises(MeshError, match="cannot be read as a mesh"):
        read_blocks(tmp_path / "a.msh")


def test_a_deck_that_moves_its_parts_is_no_mesh(tmp_path: Path) -> None:
    rows = "".join(f"{k + 1}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(CORNERS))
    text = f"*NODE\n{rows}*ELEMENT, TYPE=C3D8\n1, 1, 2, 3, 4, 5, 6, 7, 8\n"
    (tmp_path / "a.inp").write_text(text)
    assert len(read_blocks(tmp_path / "a.inp")) == 1
    (tmp_path / "b.inp").write_text(
        f"{text}*Instance, name=I, part=P\n50., 0., 0.\n*End Instance\n"
    )
    with pytest.raises(MeshError, match=r"places parts by \*Instance"):
        read_blocks(tmp_path / "b.inp")


def scaled(part: tuple[FloatArray, IntArray], size: float, at: float):
    """A smaller copy of the unit cube's surface, moved along the diagonal."""
    return size * part[0] + at * SIDE, part[1]


@pytest.mark.parametrize("inside_out", [False, True])
def test_a_surface_inside_another_turned_the_other_way_is_a_cavity(
    tmp_path: Path, inside_out: bool
) -> None:
    """A hollow cube with a cube in its cavity, and one beside it: refused as overlapping before."""
    outer, void, island = cube(0, 0, 0), scaled(cube(0, 0, 0), 0.5, 0.25), (0.25, 0.375)
    parts = [outer, turned(void), scaled(cube(0, 0, 0), *island), cube(2, 0, 0)]
    parts = [turned(part) for part in parts] if inside_out else parts
    meshio.write(tmp_path / "a.stl", soup(*parts))
    expected = [SIDE**3 / 64, SIDE**3 * 7 / 8, SIDE**3]
    assert volumes(tmp_path / "a.stl") == pytest.approx(expected, rel=1e-5)
    hollow = max(read_blocks(tmp_path / "a.stl"), key=lambda b: (len(b.triangles), b.volume))
    assert hollow.centroid == pytest.approx([SIDE / 2] * 3, rel=1e-5)


def test_the_surfaces_of_one_solid_may_be_turned_anyhow() -> None:
    """CAD programs turn the faces of a cavity as they like: the volume is the matter's."""
    outer, void = cube(0, 0, 0), scaled(cube(0, 0, 0), 0.5, 0.25)
    for inner in (void, turned(void)):
        mesh = soup(outer, inner)
        shape = polyhedron("hollow", mesh.points, one_solid(mesh.points, mesh.cells[0].data))
        assert shape.volume == pytest.approx(SIDE**3 * 7 / 8, rel=1e-12)


@pytest.mark.parametrize("word", ["vertex_index", "vertex_indices"])
def test_faces_of_a_ply_have_two_names(tmp_path: Path, word: str) -> None:
    points, triangles = cube(0, 0, 0)
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(triangles)}\nproperty list uchar int {word}\n"
        "end_header\n"
    )
    rows = [" ".join(map(str, p)) for p in points.tolist()]
    rows += [f"3 {a} {b} {c}" for a, b, c in triangles.tolist()]
    (tmp_path / "a.PLY").write_text(head + "\n".join(rows) + "\n")
    assert volumes(tmp_path / "a.PLY") == pytest.approx([SIDE**3], rel=1e-6)
