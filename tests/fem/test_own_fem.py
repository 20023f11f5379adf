"""Deformable blocks that make no Sine tube: columns, walls, hexagons and your own blocks."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import permutations, product
from pathlib import Path

import meshio
import numpy as np
import pytest

from fem import LinearPenalty, Material, Problem, concrete, solve_static
from fem.answer.pressures import contact_measures
from fem.contact.search import closest_points
from fem.decks.deck import Flavour
from fem.decks.problem import deck_lines, problem_deck
from fem.dynamics import stated_run
from fem.static.solve import static_state
from fem.system.contact_state import facing_points
from fem.system.rows import wrench_forces
from geometry import (
    Assembly,
    ColumnBox,
    HexMesh,
    LoadCase,
    Polyhedron,
    box_block,
    box_column,
    read_blocks,
)
from geometry.families.masonry import box
from geometry.files.block_files import step_hexahedra
from geometry.files.hexahedral_solids import (
    connected_solids,
    file_blocks,
    hexahedral_block,
    six_sided_hexahedra,
    split_tetrahedra,
)
from geometry.files.mesh_io import write_hex_mesh
from geometry.polyhedra.polyhedron import polyhedron_from_quads
from tests.support.answers import PLAIN, both_kinds, on_its_mesh
from tests.support.own_blocks import (
    QUADS,
    brick_corners,
    column,
    own_scene,
    write_stl,
)
from tests.support.printed import printed
from validation import Case, InputError, load_case, solve

# ---------------------------------------------------------------------------------------------
# A column of boxes


def test_joints_of_a_static_column_that_do_not_match_are_found() -> None:
    """Both joints of a box with other facets than its neighbours; none where all are alike."""
    small = ColumnBox((50.0, 40.0, 50.0), (2, 2, 1))
    wide = ColumnBox((100.0, 80.0, 50.0), (4, 4, 1))
    matching = box_column([wide, small, wide])
    assert matching.unmatched == ()
    # Two joints of 50 × 40 mm², on facets of 25 × 20 mm².
    assert matching.interfaces.areas.sum() == pytest.approx(4000.0, rel=1e-12)
    scene = column(0.5).keys
    scene["block"]["boxes"][1]["divisions"] = [4, 2, 1]
    crossing = load_case(scene).problem.system
    assert len(crossing.assembly.unmatched or ()) == 2


def test_the_deck_of_a_column_holds_its_bottom_face() -> None:
    lines = list(deck_lines(problem_deck(column(0.5).problem, Flavour.CALCULIX)))
    held = lines[lines.index("*Boundary") + 1 : lines.index("** Step of CalculiX") - 1]
    assert [line.split("_")[1] for line in held] == ["Z-MIN-NODES, 1, 3"]


# ---------------------------------------------------------------------------------------------
# Families


def test_one_sector_of_a_hexagon_tube_gives_the_whole() -> None:
    small = ("assembly.layers=1", "mesh.edge=4", "mesh.radial=2")
    whole, sector = (
        on_its_mesh("thb0-tunnel", (*small, f"fem.symmetry='{which}'"), method="static")
        for which in ("none", "sector")
    )
    assert sector.details.system.orbits.order == 4
    # Both stop at a residual of 1e-8 of the load; the tube's softest motion amplifies it tenfold.
    for a, b in zip(whole.details.displacements, sector.details.displacements, strict=True):
        np.testing.assert_allclose(b, a, atol=1e-6 * np.abs(a).max())


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(
    ("name", "divisions", "area"),
    [("planar-sine", "[12,2,2]", 190.0 * 200.0), ("osteomorphic", "[8,2,2]", 200.0 * 80.0)],
)
def test_the_frame_of_a_wall_carries_the_load(
    name: str, divisions: str, area: float, degree: int
) -> None:
    small = ("assembly.layers=1", "assembly.columns=1", f"mesh.divisions={divisions}")
    run = on_its_mesh(name, (*small, f"fem.degree={degree}"), method="static")
    found = run.details.contact_state
    # One free block: what its facets push the frame with, towards +y, is pressure times area.
    sign = np.where(run.details.whole.body_number[found.block_m] >= 0, 1.0, -1.0)
    total = (sign[found.facet][:, None] * found.point_forces).sum(axis=0)
    # The residual is 1e-8 of the load.
    assert total[1] == pytest.approx(0.01 * area, rel=1e-7)
    assert np.abs(total[[0, 2]]).max() < 1e-7 * 0.01 * area


@pytest.mark.slow
def test_a_wall_is_compared_and_drawn(tubelock, tmp_path: Path) -> None:
    small = [
        *("--set", "assembly.layers=1", "--set", "assembly.columns=1"),
        *("--set", "mesh.divisions=[8,2,2]", "--set", "fem.mesh=scene"),
        *("--set", "fem.error_estimate=false"),
    ]
    folder = tmp_path / "wall"
    status, out, _ = tubelock("compare", "osteomorphic", *small, "--no-explicit", "-o", str(folder))
    assert status == 0
    assert "all joints" in out
    assert (folder / "comparison.png").stat().st_size > 10_000
    data = json.loads((folder / "comparison.json").read_text("utf-8"))
    assert {"answers", "agreement", "conclusion", "provenance"} <= set(data)
    assert data["conclusion"] in (folder / "comparison.txt").read_text("utf-8")
    status, out, _ = tubelock("fem", "osteomorphic", *small, "-o", str(folder))
    assert status == 0
    assert {p.name for p in folder.glob("*.png")} >= {"stresses.png", "contact_pressures.png"}


# ---------------------------------------------------------------------------------------------
# Your own blocks


def wedge() -> Polyhedron:
    """Voussoir of 60° between radii 400 and 500 mm, 100 mm deep."""
    angles = np.radians([60, 0, 0, 60])
    radius = np.array([400, 400, 500, 500])
    section = np.column_stack([radius * np.cos(angles), np.zeros(4), radius * np.sin(angles)])
    corners = np.concatenate([section, section + np.array([0.0, 100.0, 0.0])])
    return polyhedron_from_quads("wedge", corners, QUADS)


@pytest.mark.parametrize(
    ("gap", "clearance", "sliding", "periods"),
    [
        *((0.0, 0.0, False, 16), (0.0, 0.0, True, 16), (0.3, 0.0, False, 64)),
        *((0.3, 0.0, True, 64), (0.0, 0.3, False, 64)),
    ],
)
def test_friction_loads_as_slowly_whatever_made_the_gap(
    tmp_path: Path, gap: float, clearance: float, sliding: bool, periods: int
) -> None:
    """Blocks fly through a gap and slide where they land, whether it is placed or a clearance."""
    write_hex_mesh(tmp_path / "brick.inp", box_block((100.0, 80.0, 50.0), (2, 2, 1)).mesh)
    places = f"[{{at = [0, 0, 0], fixed = true}}, {{at = [0, 0, {50.0 + gap}]}}]"
    scene = own_scene(
        tmp_path,
        f'[[parts]]\nfile = "brick.inp"\nplaces = {places}\n',
        load="[effects]\ngravity = [0, 0, -9810]\n[effects.friction]\ncoefficient = 0.5\n",
    ).changed(
        {
            "fem.method": "explicit",
            "detection.tolerance": 0.5,
            "contact.clearance": clearance,
            "effects.finite_sliding": sliding,
        }
    )
    stated = stated_run(scene.problem, scene.method)
    assert stated.times.recommended is not None
    assert stated.times.ramp * stated.times.recommended.frequency == pytest.approx(
        periods, rel=1e-12
    )


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("friction", [True, False])
def test_joint_forces_that_leave_friction_out_are_named_so(tmp_path: Path, friction: bool) -> None:
    """2 N sideways are the shear force of the joint, which friction carries."""
    write_hex_mesh(tmp_path / "brick.inp", box_block((100.0, 80.0, 50.0), (2, 2, 1)).mesh)
    places = "[{at = [0, 0, 0], fixed = true}, {at = [0, 0, 50]}]"
    load = "[effects]\ngravity = [0, 0, -9810]\n"
    if friction:
        load += "[[loads]]\nblocks = [1]\nforce = [2.0, 0.0, 0.0]\n"
        load += "[effects.friction]\ncoefficient = 0.5\n"
    parts = f'[[parts]]\nfile = "brick.inp"\nplaces = {places}\n'
    case = own_scene(tmp_path, parts, load=load)
    run = on_its_mesh(case, method="static")
    (joint,) = run.as_dict()["joints"]
    weight, push = 2.4e-9 * 400_000.0 * 9810.0, 2.0 if friction else 0.0
    assert joint["normal_force"] == pytest.approx(weight, rel=1e-5)
    assert joint["shear_force"] == pytest.approx(push, abs=1e-5 * weight)
    printed(case, tmp_path, "--fields", "-o", str(tmp_path / "out"))
    head = (tmp_path / "out" / "joints.csv").read_text("utf-8").splitlines()[0].split(",")
    assert "shear_force_N" in head
    assert "force" in meshio.read(tmp_path / "out" / "joints.vtu").point_data


def test_an_arch_of_own_wedges(tmp_path: Path) -> None:
    write_stl(tmp_path / "wedge.stl", wedge())
    parts = """
[[parts]]
file = "wedge.stl"
places = [{axis = [0, 1, 0], angle = 0, fixed = true}, {axis = [0, 1, 0], angle = -60},
          {axis = [0, 1, 0], angle = -120, fixed = true}]
"""
    *rigid, static = both_kinds(own_scene(tmp_path, parts))
    weight = 2.4e-9 * wedge().volume * 9810.0
    # Each joint leans by 60°, so its normal force is W / (2 cos 60°). The normals turn by the
    # displacement over a facet's size, 25 mm.
    turned = static.details.largest_displacement / 25.0
    assert contact_measures(static.details).force == pytest.approx(2 * weight, rel=turned)
    assert len(rigid) == 2
    for run in rigid:
        contacts = run.contacts
        pressed = contacts["pressure"] @ contacts["area"]
        assert pressed == pytest.approx(2 * weight, rel=1e-6)


def test_a_prism_of_tetrahedra_weighs_on_its_joint(tmp_path: Path) -> None:
    """Five sides have no grid: gmsh fills the prism, whose lower side meets part of a face."""
    write_stl(tmp_path / "brick.stl", polyhedron_from_quads("brick", brick_corners(), QUADS))
    p = 0.5 * brick_corners()[[0, 1, 3, 4, 5, 7]] + np.array([20.0, 15.0, 0.0])
    faces = [[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]]
    write_stl(tmp_path / "prism.stl", Polyhedron("prism", p, np.array(faces)))
    parts = '[[parts]]\nfile = "brick.stl"\nfixed = true\n[[parts]]\nfile = "{}"\n'
    parts += "places = [{{at = [0, 0, 50]}}]\n"
    scene = own_scene(tmp_path, parts.format("prism.stl"))
    run = on_its_mesh(scene.changed({"mesh.size": 100.0, "mesh.divisions": 1}), method="static")
    # Half of an eighth of a box; the residual is 1e-8 of the load.
    assert contact_measures(run.details).force == pytest.approx(
        2.4e-9 * 25_000.0 * 9810.0, rel=1e-7
    )
    assert "four hexahedra" in run.report["notes"]["tetrahedra"]
    assert "degree 2" in run.title


@pytest.mark.slow
def test_two_cubes_of_tetrahedra_press_evenly() -> None:
    """The meshes do not match; without lateral strain the pressure is ρ g h everywhere."""
    cube = box((100.0, 100.0, 100.0))
    fine, coarse = (
        replace(hexahedral_block("cube", split_tetrahedra(cube, size)), tetrahedra=size)
        for size in (100.0, 140.0)
    )
    places = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 100.0]])
    assembly = Assembly(
        name="cubes",
        shapes=(fine, coarse),
        shape_of=np.arange(2),
        rotations=np.stack([np.eye(3)] * 2),
        translations=places,
        layer=np.arange(2),
        fixed=np.array([True, False]),
        unmatched_allowed=True,
    )
    problem = Problem(
        assembly,
        LoadCase(assembly, "weight", (), assembly.fixed.copy()),
        Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.0),
        degree=2,
        law=LinearPenalty(100.0),
        finite_sliding=True,
        gravity=(0.0, 0.0, -9810.0),
    )
    state = solve_static(problem, PLAIN).details.contact_state
    pressing = state.point_areas > 1e-6 * state.point_areas.max()
    np.testing.assert_allclose(state.point_pressures[pressing], 2.4e-9 * 9810.0 * 100.0, rtol=1e-3)


def write_panel(path: Path, n: int) -> list[int]:
    """Truncated tetrahedra of 100 × 100 × 60 mm at 25°, n × n in a ring; numbers of the ring."""
    lean, lines, ring = 30.0 * np.tan(np.radians(25.0)), [], []
    for j, i in np.ndindex(n + 2, n + 2):
        if {0, n + 1} >= {i, j}:
            continue  # corners of the ring touch no free block
        first, sign = len(lines) // 14, 1 if (i + j) % 2 == 0 else -1
        for z in (-1, 1):
            a, b = 50.0 + sign * z * lean, 50.0 - sign * z * lean
            for x, y in ((-a, -b), (a, -b), (a, b), (-a, b)):
                lines.append(f"v {100 * i + x:.12f} {100 * j + y:.12f} {30.0 * z}")
        lines += ["f " + " ".join(str(8 * first + 1 + v) for v in quad) for quad in QUADS.tolist()]
        if {i, j} & {0, n + 1}:
            ring.append(first)
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return ring


def panel_scene(folder: Path, n: int, friction: float) -> Case:
    ring = write_panel(folder / "panel.obj", n)
    load = f"[assembly]\nfixed = {ring}\n[effects]\ngravity = [0, 0, -9810]\n"
    load += f"[effects.friction]\ncoefficient = {friction}\n"
    scene = own_scene(folder, '[[parts]]\nfile = "panel.obj"\n', load=load)
    return scene.changed({"mesh.divisions": 2, "fem.load_steps": 1})


def test_a_panel_of_truncated_tetrahedra_is_held_by_friction(tmp_path: Path) -> None:
    """Limits of friction that lag behind the pressures drive each other away (250 s, no answer).

    So does a first iteration without friction, which lets the blocks fall.
    """
    scene = panel_scene(tmp_path, 2, 0.6)
    run = on_its_mesh(scene, method="static")
    assert run.details.run is None
    # Newton's method with the whole tangent; by frozen limits no number of iterations was enough.
    assert run.details.evidence.converged
    assert "touch along an edge or at a point alone" in run.report["notes"]["edge contacts"]
    # Forces of all free blocks balance, so the ring carries their weight.
    assert run.details.evidence.residual <= 1e-8


@pytest.mark.parametrize(
    ("family", "size", "friction"),
    [
        ("tetrahedra", ("assembly.rows=2", "assembly.columns=2"), 0.6),
        ("cubes", ("assembly.rings=1", "effects.gravity=[0,0,-9810]"), 0.3),
        ("octahedra", ("assembly.rings=1", "effects.gravity=[0,0,-9810]"), 0.3),
    ],
)
def test_built_in_panels_stand_under_their_weight(
    family: str, size: tuple[str, ...], friction: float
) -> None:
    """Blocks that gmsh fills or a grid does, whose faces meet in part and whose edges cross: forces
    of all free blocks balance."""
    stated = (f"effects.friction.coefficient={friction}", "fem.degree=1", "fem.load_steps=1")
    found = on_its_mesh(family, (*size, *stated), method="static").details
    assert found is not None
    assert found.evidence.converged
    assert found.residual <= 1e-8


def test_faces_that_slide_on_each_other_press_nowhere(tmp_path: Path) -> None:
    """All four blocks of a panel sink along their faces: those stay in contact, to rounding of the
    file. Edges that cross lay in each other by 0.024 mm, where the law knows no bound."""
    deformable = panel_scene(tmp_path, 2, 0.3).problem.system
    lean, sunk = np.tan(np.radians(25.0)), 0.057
    along = np.array([[1, -1, 0], [1, 1, 0], [-1, -1, 0], [-1, 1, 0]]) * lean - [0.0, 0.0, 1.0]
    moved = [
        np.broadcast_to(sunk * way, (1, group.n_nodes, 3))
        for way, group in zip(along, deformable.bodies, strict=True)
    ]
    facing = facing_points(deformable.computed, tuple(moved))
    corners, found = facing.position[facing.quads], facing.now
    points = np.einsum("na,nai->ni", found.shapes, corners[found.slave])
    _, gap, _ = closest_points(corners[found.facet], points, found.xi)
    assert np.abs(gap).max() < 1e-9


def test_little_friction_holds_a_panel_by_a_squeeze_alone(tmp_path: Path) -> None:
    """Rigid blocks are in equilibrium, as their joints can press each other; from rest the four
    slide down their faces together, in explicit runs as well. `mbd` and `fem` name one
    force, of one of joints that are alike: both count the contacts that have an area."""
    scene = panel_scene(tmp_path, 2, 0.3)
    with pytest.raises(InputError, match="carried if pressed beforehand") as error:
        on_its_mesh(scene, method="static")
    rough = load_case(tmp_path / "own.toml", ["effects.friction=0.3"], method="rigid")
    rigid = solve(rough).as_dict()
    verdict, _, joint = rigid["answer"].partition(":")
    assert verdict == "carried if pressed beforehand (a hint, not proved)"
    assert joint.partition(" between")[0] in str(error.value)


def test_six_flat_sides_become_hexahedra() -> None:
    solid = wedge()
    mesh = six_sided_hexahedra(solid, 3)
    assert mesh is not None
    # Flat sides: the grid fills the solid up to rounding.
    volume = solid.volume
    assert mesh.n_elements == 27
    assert mesh.extent()[0] == pytest.approx(volume, rel=1e-12)
    # A tetrahedron has four sides of three corners.
    cut = Polyhedron("tetra", np.eye(4, 3), np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]))
    assert six_sided_hexahedra(cut, 3) is None


def test_gmsh_fills_a_solid_alike_wherever_it_stands() -> None:
    """Rounding of places decided which tetrahedra there were, and friction how many iterations."""
    turns = 0.3 + np.arange(5) * 2.0 * np.pi / 5.0
    ring = 40.0 * np.column_stack([np.cos(turns), np.sin(turns)])
    points = np.vstack([np.column_stack([ring, np.full(5, z)]) for z in (0.0, 30.0)])
    faces = [[4, 3, 2, 1, 0], [5, 6, 7, 8, 9]]
    faces += [[k, (k + 1) % 5, 5 + (k + 1) % 5, 5 + k] for k in range(5)]
    meshes = []
    for way in ([0.0, 0.0, 0.0], [1.0, -2.0, 3.0], [1000.1, -2000.2, 3000.3]):
        stack = [(points + way, faces), (points + way + [3.0, 2.0, 30.0], faces)]
        solids = Assembly.from_blocks(stack, fixed=[0])
        meshed = Problem(solids, None, concrete, gravity=(0.0, 0.0, -9810.0)).meshed.blocks
        meshes.append([(shape.mesh.elements, shape.mesh.nodes - way) for shape in meshed.shapes])
    for other in meshes[1:]:
        for (elements, nodes), (known, there) in zip(other, meshes[0], strict=True):
            assert np.array_equal(elements, known)
            # Rounding of places, of 1e-12 mm at most.
            assert np.abs(nodes - there).max() < 1e-11


def test_solids_of_one_file_are_told_apart() -> None:
    box = box_block((1.0, 1.0, 1.0), (2, 1, 1)).mesh
    both = HexMesh(
        np.concatenate([box.nodes, box.nodes + np.array([0.0, 0.0, 5.0])]),
        np.concatenate([box.elements, box.elements + box.n_nodes]),
    )
    first, second = connected_solids(Path("both.vtu"), both, both.elements)
    np.testing.assert_array_equal(first.mesh.nodes, box.nodes)
    np.testing.assert_array_equal(second.mesh.elements, box.elements)


def test_step_solids_are_meshed_each(tmp_path: Path) -> None:
    gmsh = pytest.importorskip("gmsh", exc_type=(ImportError, OSError))
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addBox(0, 0, 0, 10, 20, 30)
    gmsh.model.occ.addBox(50, 0, 0, 10, 20, 60)
    gmsh.model.occ.synchronize()
    gmsh.write(str(tmp_path / "two.step"))
    gmsh.finalize()
    meshes = step_hexahedra(tmp_path / "two.step", divisions=2)
    assert [m.n_elements for m in meshes] == [8, 8]
    # STEP keeps about 15 digits.
    assert [m.extent()[0] for m in meshes] == pytest.approx([6e3, 12e3], rel=1e-9)


def test_what_facets_leave_out_of_a_cylinder_is_said(tmp_path: Path) -> None:
    """Beside its exact volume π r² h, in a row of both methods."""
    gmsh = pytest.importorskip("gmsh", exc_type=(ImportError, OSError))
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addBox(-50, -50, 0, 100, 100, 20)
    gmsh.model.occ.addCylinder(0, 0, 20, 0, 0, 40, 30)
    gmsh.model.occ.synchronize()
    gmsh.write(str(tmp_path / "cylinder.step"))
    gmsh.finalize()
    scene = own_scene(tmp_path, '[[parts]]\nfile = "cylinder.step"\n')
    scene = scene.changed({"assembly.fixed": [0]})
    facets = replace(read_blocks(tmp_path / "cylinder.step")[1], exact=None).volume
    less = f"{100.0 * (1.0 - facets / (np.pi * 30.0**2 * 40.0)):.2g} % less"
    stated = load_case(tmp_path / "own.toml", ["assembly.fixed=[0]"], method="rigid")
    rigid = solve(stated).report["notes"]["curved faces"]
    assert less in rigid
    assert "volume and weight are exact" in rigid
    # Tetrahedra keep the facets.
    static = on_its_mesh(scene, method="static").report["notes"]["curved faces"]
    assert less in static
    assert "so is their weight" in static


def test_a_wrench_is_spread_without_changing_it() -> None:
    """The moment is that about the origin of the points."""
    rng = np.random.default_rng(3)
    points, shares = rng.standard_normal((20, 3)), rng.uniform(0.5, 1.0, 20)
    force, moment = rng.standard_normal(3), rng.standard_normal(3)
    forces = wrench_forces(points, shares, force, moment)
    # Sums of twenty numbers of order one.
    np.testing.assert_allclose(forces.sum(axis=0), force, atol=1e-13)
    np.testing.assert_allclose(np.cross(points, forces).sum(axis=0), moment, atol=1e-12)


def test_a_cube_on_its_edge_is_a_rigid_answer_and_no_deformable_one(tubelock, tmp_path) -> None:
    """Contacts without any area: a traceback of the report before, and of fem another reason."""
    for name, shape in (("floor", box((400.0, 400.0, 50.0))), ("cube", box((100.0,) * 3))):
        mesh = meshio.Mesh(shape.points, [("triangle", shape.triangles)])
        meshio.write(tmp_path / f"{name}.stl", mesh)
    (tmp_path / "edge.toml").write_text(
        '[block]\ntype = "mesh"\n[effects]\ngravity = [0, 0, -9810.0]\n[material]\n'
        "density = 2.4e-9\nyoung_modulus = 33000.0\npoisson_ratio = 0.2\n[contact]\n[fem]\n"
        'method = "static"\n[[parts]]\nfile = "floor.stl"\nfixed = true\n'
        '[[parts.places]]\nat = [-200.0, -200.0, -50.0]\n[[parts]]\nfile = "cube.stl"\n'
        "[[parts.places]]\naxis = [0.0, 1.0, 0.0]\nangle = -45.0\n"
    )
    status, out, _ = tubelock("mbd", "edge.toml", "-o", "here")
    assert status == 0
    assert "edges and points have no area" in out
    status, _, err = tubelock("fem", "edge.toml", "-o", "there")
    assert status == 2
    assert "touch along edges and at points alone, and edges and points carry nothing" in err


# ---------------------------------------------------------------------------------------------
# Hexahedra split from tetrahedra


def hexahedra_of_tetrahedra(size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A box as six tetrahedra about its diagonal, each split into four hexahedra."""
    corners = np.array(list(product((0.0, 1.0), repeat=3))) * size
    numbers: dict[tuple[int, ...], int] = {}
    nodes, cells = [], []

    def middle(*members: int) -> int:
        key = tuple(sorted(members))
        if key not in numbers:
            numbers[key] = len(nodes)
            nodes.append(corners[list(key)].mean(axis=0))
        return numbers[key]

    for axes in permutations((4, 2, 1)):
        tetrahedron = [int(n) for n in np.cumsum((0, *axes))]
        for tip in tetrahedron:
            a, b, c = (n for n in tetrahedron if n != tip)
            if np.linalg.det(corners[[a, b, c]] - corners[tip]) < 0.0:
                a, b = b, a
            below = (middle(tip), middle(tip, a), middle(tip, a, b), middle(tip, b))
            above = (middle(tip, c), middle(tip, a, c), middle(tip, a, b, c), middle(tip, b, c))
            cells.append((*below, *above))
    return np.array(nodes), np.array(cells)


@pytest.mark.parametrize(("degree", "accuracy"), [(1, 1e-3), (2, 1e-6)])
def test_hexahedra_split_from_tetrahedra_have_the_right_pressure(
    tmp_path: Path, degree: int, accuracy: float
) -> None:
    """A column under its weight, held sideways by friction; scaled Jacobians go down to 0.27.

    Without lateral contraction the pressure of each joint is the weight above. A linear pressure of
    a trilinear mesh is exact but for the facets, which bend within the law's 1e-4 of an edge.
    """
    size = np.array([100.0, 80.0, 60.0])
    nodes, cells = hexahedra_of_tetrahedra(size)
    path = tmp_path / "block.vtu"
    meshio.write(path, meshio.Mesh(nodes, [("hexahedron", cells)]))
    (shape,) = file_blocks(path, read_blocks(path), units="mm", divisions=1)
    boxes = box_column([ColumnBox((100.0, 80.0, 60.0), (1, 1, 1))] * 3)
    column = replace(boxes, shapes=(shape,))
    load = LoadCase(column, "weight", (), column.fixed)
    material = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.0)
    gravity = (0.0, 0.0, -9810.0)
    stated = Problem(column, load, material, gravity=gravity, friction=0.3, degree=degree)
    found = static_state(stated.system)
    assert found.contact_state.pressures.max() == pytest.approx(
        2 * 2.4e-9 * 9810.0 * size[2], rel=accuracy
    )


def test_a_ring_and_its_core_keep_their_own_hexahedra(tmp_path: Path) -> None:
    """Both have one centre, by which hexahedra were assigned: the core came twice."""
    squares = np.array([(i, j, 1.0) for j in range(4) for i in range(4)]) * [10.0, 10.0, 20.0]
    first = np.array([4 * j + i for j in range(3) for i in range(3)])
    cells = first[:, None] + [0, 1, 5, 4]
    core = squares[cells[4]]
    points = np.concatenate([squares * [1, 1, 0], squares, core * [1, 1, 0], core])
    ring = np.hstack([cells, cells + 16])[np.arange(9) != 4]
    elements = [*ring.tolist(), list(range(32, 40))]
    meshio.write(tmp_path / "two.vtu", meshio.Mesh(points, [("hexahedron", elements)]))
    solids = read_blocks(tmp_path / "two.vtu")
    blocks = file_blocks(tmp_path / "two.vtu", solids, units="mm", divisions=1)
    assert sorted(block.mesh.n_elements for block in blocks) == [1, 8]
    for block, solid in zip(blocks, solids, strict=True):
        assert block.volume == pytest.approx(solid.volume, rel=1e-12)


def test_the_contact_area_has_joints_that_match_and_such_as_do_not() -> None:
    """Only matching joints of a column were counted, 8000 of 16 000 mm²; pressed, all are closed.

    The blocks move by 10⁻³ of an element: areas of the placed facets change by less.
    """
    scene = column(0.5).keys
    scene["block"]["boxes"][2] = {"size": [100.0, 80.0, 50.0], "divisions": [2, 3, 1]}
    answer = on_its_mesh(scene)
    assert answer.report["dimensions"]["contact_area"] == pytest.approx(16e3, rel=1e-3)
