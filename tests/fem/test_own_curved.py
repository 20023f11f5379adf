"""Own hexahedra of 20 or 27 nodes: curved blocks with elements of degree two and more."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import meshio
import numpy as np
import pytest

from fem import Material, Problem, Static, solve_static
from fem.answer.pressures import contact_measures
from fem.element.lagrange import LagrangeMesh, with_degree
from geometry import Block, LoadCase, read_blocks
from geometry.files.hexahedral_solids import file_blocks
from geometry.files.quadratic import NATURAL
from geometry.mesh import CORNERS, MeshError, grid_points
from tests.support.answers import on_its_mesh
from tests.support.commands import answered
from tests.support.lagrange_meshes import CURVED, WALL
from tests.support.own_blocks import own_scene

GRAVITY = "[effects]\ngravity = [0.0, 1e6, -1e6]\n"


def twenty_seven(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of a block's elements of degree two, and those of each in VTK's order."""
    mesh = with_degree(block, 2).mesh
    assert isinstance(mesh, LagrangeMesh)
    columns = np.rint(NATURAL + 1.0).astype(np.int64) @ np.array([9, 3, 1])
    return mesh.nodes, mesh.members[:, columns]


def write(path: Path, nodes: np.ndarray, members: np.ndarray) -> None:
    meshio.write(path, meshio.Mesh(nodes, [(f"hexahedron{members.shape[1]}", members)]))


def read(path: Path) -> Block:
    (block,) = file_blocks(path, read_blocks(path), units="mm", divisions=1)
    return block


@pytest.mark.parametrize("name", CURVED)
def test_a_file_of_the_nodes_of_a_family_is_its_quadratic_block(name: str, tmp_path: Path) -> None:
    """The same nodes; where the degree is higher the same quadratic map, which is in its span."""
    block = CURVED[name]
    write(tmp_path / "27.vtu", *twenty_seven(block))
    own, exact = with_degree(read(tmp_path / "27.vtu"), 2).mesh, with_degree(block, 2).mesh
    corners = np.sort(own.elements[:, 0])
    assert len(corners) == block.mesh.n_elements
    scale = np.abs(exact.nodes).max()
    order, theirs = np.lexsort(own.nodes.round(6).T), np.lexsort(exact.nodes.round(6).T)
    np.testing.assert_allclose(own.nodes[order], exact.nodes[theirs], atol=1e-14 * scale)
    quartic = with_degree(read(tmp_path / "27.vtu"), 4)
    assert quartic.volume == pytest.approx(with_degree(block, 2).volume, rel=1e-12)


def test_own_files_of_a_family_give_its_answer(tmp_path: Path) -> None:
    """A wall under a weight aslant: the same equations, solved to 1e-8 of the forces."""
    parts = []
    order = np.argsort(WALL.shape_of, kind="stable")
    for number, shape in enumerate(WALL.shapes):
        write(tmp_path / f"{number}.vtu", *twenty_seven(shape))
        places = ", ".join(
            f"{{at = {WALL.translations[b].tolist()}, fixed = {str(bool(WALL.fixed[b])).lower()}}}"
            for b in order[WALL.shape_of[order] == number]
        )
        parts.append(f'[[parts]]\nfile = "{number}.vtu"\nplaces = [{places}]\n')
    scene = own_scene(tmp_path, f"{GRAVITY}{''.join(parts)}", load="")
    run = on_its_mesh(scene.changed({"fem.degree": 2}), method="static")
    material = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.0)
    load = LoadCase(WALL, "weight", (), WALL.fixed)
    problem = Problem(WALL, load, material, degree=2, gravity=[0.0, 1e6, -1e6])
    family = solve_static(problem, Static(error_estimate=False))
    assert run.details.contact_state.n_facets == len(family.contacts["pressure"])
    assert run["max_displacement"].value == pytest.approx(family["u"].value, rel=1e-6)
    ours, theirs = (
        np.sort(run.details.contact_state.pressures),
        np.sort(family.contacts["pressure"]),
    )
    np.testing.assert_allclose(ours, theirs, atol=1e-6 * theirs.max())
    assert "edges" not in run.as_dict().get("notes", {})


ANGLE, RADII, HEIGHT, PIECES = 1.2, (300.0, 400.0), 80.0, 3


def ring(tmp_path: Path, n_nodes: int = 20) -> Path:
    """Sector of a ring whose nodes stand on its circles, 20 or 27 in each element."""
    path = tmp_path / f"ring{n_nodes}.vtu"
    write(path, *(values for values in ring_nodes(n_nodes)))
    return path


def ring_nodes(n_nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Every second node of a grid is a corner."""
    lines = [np.linspace(*RADII, 5), np.linspace(0.0, ANGLE, 2 * PIECES + 1), [0.0, 40.0, HEIGHT]]
    r, angle, z = grid_points(*map(np.asarray, lines)).T
    nodes = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    shape = tuple(map(len, lines))
    first = 2 * np.array(list(np.ndindex(2, PIECES, 1)))
    members = [
        np.ravel_multi_index(tuple((start + np.rint(NATURAL).astype(int) + 1).T), shape)
        for start in first
    ]
    return nodes, np.array(members)[:, :n_nodes]


@pytest.mark.parametrize("n_nodes", [20, 27])
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_curved_block_weighs_what_lies_within_its_arcs(
    n_nodes: int, degree: int, tmp_path: Path
) -> None:
    """A parabola through three points of a circle, c and s the cosine and sine of α/2.

    q = (1 - (1 - c) ξ², s ξ) has ∫ q × q' dξ = 2 s (4 - c) / 3 in place of α; a chord 2 s c. The
    middle of a face of 20 nodes lies elsewhere, on the same boundary. Forces balance to 1e-8.
    """
    ring(tmp_path, n_nodes)
    parts = f"""
[[parts]]
file = "ring{n_nodes}.vtu"
places = [{{at = [0, 0, 0]}}, {{at = [0, 0, -{HEIGHT}], fixed = true}}]
"""
    run = on_its_mesh(own_scene(tmp_path, parts).changed({"fem.degree": degree}), method="static")
    s, c = np.sin(0.5 * ANGLE / PIECES), np.cos(0.5 * ANGLE / PIECES)
    angle = 2.0 * s * (c if degree == 1 else (4.0 - c) / 3.0)
    volume = PIECES * angle * 0.5 * (RADII[1] ** 2 - RADII[0] ** 2) * HEIGHT
    assert contact_measures(run.details).force == pytest.approx(2.4e-9 * 9810.0 * volume, rel=1e-7)
    assert ("edges" in run.as_dict().get("notes", {})) == (degree == 1)


def test_rigid_answers_say_that_edges_are_straight(tmp_path: Path) -> None:
    ring(tmp_path)
    (tmp_path / "own.toml").write_text(
        '[block]\ntype = "mesh"\n[effects]\ngravity = [0, 0, -9810]\n'
        '[[parts]]\nfile = "ring20.vtu"\n'
        f"places = [{{at = [0, 0, 0]}}, {{at = [0, 0, -{HEIGHT}], fixed = true}}]\n"
    )
    data, out = answered("mbd", str(tmp_path / "own.toml"))
    assert "straight between corners" in out
    assert "straight" in data["notes"]["edges"]


def bulged(nodes: np.ndarray, members: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The middle of an edge is pushed past its other end."""
    moved = nodes.copy()
    moved[members[0, 8]] += 0.9 * (nodes[members[0, 1]] - nodes[members[0, 0]])
    return moved, members


def turned(nodes: np.ndarray, members: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As programs write that number the edges upwards before those above."""
    return nodes, members[:, [*range(12), *range(16, 20), *range(12, 16)]]


def torn(nodes: np.ndarray, members: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two elements have one edge, each its own middle of it."""
    shared = np.intersect1d(members[0, 8:], members[1, 8:])[:1]
    own = members.copy()
    own[0, members[0] == shared] = len(nodes)
    return np.concatenate([nodes, nodes[shared] + 0.1]), own


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (bulged, r"1 of 6 curved hexahedra fold, worst element 0 .*its node 8 does not stand"),
        (turned, r"6 of 6 curved hexahedra fold.*expected the order of VTK and Abaqus"),
        (torn, r"elements 0 and 1 .*share the corners of an edge, but its middles lie 0\.173 mm"),
    ],
)
def test_nodes_that_make_no_element_are_named(spoil, text: str, tmp_path: Path) -> None:
    write(tmp_path / "a.vtu", *spoil(*ring_nodes(20)))
    with pytest.raises(MeshError, match=text) as found:
        read(tmp_path / "a.vtu")
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(("share", "folds"), [(0.45, False), (1.2, True)])
def test_a_fold_inside_an_element_is_found_though_no_corner_sees_it(
    share: float, folds: bool, tmp_path: Path
) -> None:
    """A centre moved by a share of the half length leaves faces, edges and corners as they are.

    Along that line x becomes x + share · (1 - x²), which turns back where share is above ½.
    """
    nodes, members = ring_nodes(27)
    corners = nodes[members[0, :8]]
    across = corners[CORNERS[:, 0] > 0].mean(axis=0) - corners[CORNERS[:, 0] < 0].mean(axis=0)
    nodes[members[0, 26]] += 0.5 * share * across
    write(tmp_path / "a.vtu", nodes, members)
    refused = pytest.raises(MeshError, match="1 of 6 curved hexahedra fold, worst element 0")
    with refused if folds else nullcontext():
        read(tmp_path / "a.vtu")


def test_hexahedra_of_two_kinds_are_refused(tmp_path: Path) -> None:
    nodes, members = ring_nodes(27)
    cells = [("hexahedron20", members[:3, :20]), ("hexahedron27", members[3:])]
    meshio.write(tmp_path / "a.vtu", meshio.Mesh(nodes, cells))
    with pytest.raises(MeshError, match="got hexahedron20, hexahedron27; expected"):
        read(tmp_path / "a.vtu")
