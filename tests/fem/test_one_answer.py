"""One answer to one problem: whichever solver finds it, and whatever a command asks besides."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fem import Problem, concrete, solve_static
from fem.accuracy.ladder import coarser, split
from fem.accuracy.ladder import on_mesh as on_degree
from fem.accuracy.transfer import interpolation, node_places, pressures_on_facets, transferred
from fem.answer.forces import internal_forces
from fem.element.lagrange import with_degree
from fem.static import problem as static_problem
from fem.static.linear_step.grid import grid_blocks
from fem.static.linear_step.grid_block import PointFlexibility
from fem.static.solve import StaticMethod, StaticOptions
from fem.system.sector import largest_sector
from geometry import (
    Block,
    OsteomorphicWall,
    beam,
    box_block,
    pillar,
    pipe,
    shaft,
    tube,
    tunnel,
)
from geometry.block import unit_lines
from geometry.families.hexagon_block import HexagonBlockDivisions, hexagon_block
from geometry.refinement import charts_of, with_lines
from tests.support.answers import PLAIN, by_options
from tests.support.blocks import tsb
from tests.support.coarse_tubes import coarse, ring
from tests.support.commands import ANSWER_FILES, answered, set_words
from tests.support.lagrange_meshes import HEXAGON, WALL, sine
from tests.support.views import View, seen, seen_load
from validation import read_answer

TUBE = ring(1, (12, 1, 2))
TOWER = ring(2, (12, 1, 2))
#: Half a turn takes facets between its layers onto themselves.
IMAGES = tube(tsb(frequency=1), layers=2, mesh=(6, 1, 2))
FOUR = OsteomorphicWall(100.0, 40.0, 60.0, 8.0, divisions=(4, 2, 2), columns=2, layers=2).build()
#: With fewer elements, for those of degree 3, which follow half a wave.
FEWER = (
    (TUBE, tube(tsb(frequency=1), layers=1, mesh=(6, 1, 1))),
    (TOWER, ring(2, (12, 1, 1))),
    (
        FOUR,
        OsteomorphicWall(100.0, 40.0, 60.0, 8.0, divisions=(4, 2, 1), columns=2, layers=2).build(),
    ),
)
PROBLEMS = {
    "pipe": Problem(TOWER, pipe(0.01), concrete),
    "own images": Problem(IMAGES, pipe(0.01), concrete),
    "tunnel": Problem(TUBE, tunnel(0.01), concrete),
    "shaft": Problem(TUBE, shaft(0.01), concrete),
    "beam": Problem(TUBE, beam(0.01), concrete),
    "pillar": Problem(TUBE, pillar(0.01), concrete),
    "clearance": Problem(TUBE, pipe(0.01), concrete, clearance=0.01),
    "spacing": Problem(TUBE, tunnel(0.01), concrete, spacing=0.002),
    "wall": Problem(FOUR, pipe(0.01), concrete),
    "weight along the axis": Problem(TOWER, pipe(0.01), concrete, gravity=[0.0, 0.0, -9810.0]),
    "weight across the axis": Problem(TUBE, tunnel(0.01), concrete, gravity=[-9810.0, 0.0, 0.0]),
}


def apart(value: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(value - expected).max() / np.abs(expected).max())


#: Of each kind of blocks one load with elements of degree 3 too: loads take any degree alike.
CUBIC = ("pipe", "shaft", "wall", "weight across the axis")


@pytest.mark.parametrize(
    ("name", "degree"), [*((name, 2) for name in PROBLEMS), *((name, 3) for name in CUBIC)]
)
def test_two_solvers_find_one_state(
    name: str, degree: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In contact forces, and in displacements by one sparse matrix, which knows nothing of columns.

    Both stop at 1e-10 of the forces; the softest motions give way some hundred times more.
    """
    problem = replace(PROBLEMS[name], degree=degree)
    for blocks, fewer in FEWER if degree == 3 else ():
        if problem.blocks is blocks:
            problem = replace(problem, blocks=fewer)
    assert grid_blocks(problem.system) is not None
    options = StaticOptions(method=StaticMethod.SPARSE, tolerance=1e-10)
    oracle = by_options(problem, options)

    def no_other(*_: object, **__: object) -> None:
        raise AssertionError("the state was not found in contact forces")

    for step in ("SparseStep", "CondensedStep"):
        monkeypatch.setattr(static_problem, step, no_other)
    options = StaticOptions(tolerance=1e-10)
    found = by_options(problem, options)
    assert apart(found.fields["displacement"], oracle.fields["displacement"]) < 1e-7
    assert apart(found.contacts["pressure"], oracle.contacts["pressure"]) < 1e-7
    assert set(found.measures) == set(oracle.measures)
    for key, measure in oracle.measures.items():
        assert found.measures[key].value == pytest.approx(measure.value, rel=1e-7), key
        assert found.measures[key].resolved == measure.resolved


@pytest.mark.parametrize(
    ("name", "share"),
    [("pipe", 0.5), ("own images", 0.5), ("wall", 0.5), ("weight along the axis", 1.0)],
)
def test_blocks_that_a_half_turn_maps_onto_others_are_not_computed(name: str, share: float) -> None:
    """Facets that it takes onto themselves count half; a weight along the axis breaks it.

    However the model stands: blocks of a wall that was turned were all computed.
    """
    stated = PROBLEMS[name]
    for view in (View("as stated"), View("turned", angle=0.7)):
        blocks = seen(stated.blocks, view)
        weight = None if stated.gravity is None else view.turn @ np.array(stated.gravity)
        load = seen_load(stated.load_case, blocks, view)
        deformable = replace(stated, blocks=blocks, load=load, gravity=weight, degree=2).system
        moving = deformable.deformable_blocks
        orbits, half = (largest_sector(deformable, half_turn=on).orbits for on in (False, True))
        one, all_layers = (len(np.unique(o.representative[moving])) for o in (half, orbits))
        assert one == share * all_layers
        facets = float(np.broadcast_to(half.share, (len(half.facets), 1)).sum())
        assert facets == share * len(orbits.facets)


def test_a_block_is_condensed_on_no_point_too() -> None:
    """As where all contact is soft at a start: points that are asked for later are added."""
    grids = grid_blocks(replace(PROBLEMS["pipe"], degree=2).system)
    assert grids is not None
    points = np.array([0, 7, 100])
    grown = PointFlexibility(grids[0], points[:0])
    grown.include(points)
    expected = PointFlexibility(grids[0], points).between(points, points)
    one = grown.between(points, points)
    np.testing.assert_allclose(one, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


# ---------------------------------------------------------------------------------------------
# Commands

MESH = coarse(1, 4, 2)


def measured(*given: str, more: tuple[str, ...] = ()) -> dict[str, Any]:
    found: dict[str, Any]
    found = answered("fem", "tsb1-pipe", *set_words((*MESH, *given)), *more)[0]["measures"]
    return found


def agree(found: dict[str, Any], expected: dict[str, Any]) -> None:
    """Values by two iterations to 1e-8 of the forces; error bars are differences of such values."""
    assert found.keys() == expected.keys()
    for name, measure in expected.items():
        assert found[name]["value"] == pytest.approx(measure["value"], rel=1e-7), name
        if "remark" in measure:
            assert found[name]["remark"] == measure["remark"]
            continue
        assert measure["error"] > 0.0
        assert found[name]["error"] == pytest.approx(measure["error"], rel=1e-5), name


#: What changes neither the problem nor its mesh.
SAME = (
    ("fem.symmetry='none'",),
    (
        *("effects.gravity=[0.0, 0.0, 0.0]", "contact.spacing=0.0"),
        *("effects.rayleigh.mass_proportional=2.0", "effects.bulk_viscosity={}"),
    ),
)


@pytest.mark.usefixtures("undrawn")
def test_frames_and_files_change_no_number(tubelock) -> None:
    """Issue 28: with two frames the same command gave other measures and other error bars."""
    curved = ("fem.degree=2", "mesh.axial=2")
    expected = measured(*curved)
    found = measured(*curved, "fem.frames=2", more=("-o", "out", "--fields"))
    agree(found, expected)
    assert {*ANSWER_FILES, "joints.csv"} <= {path.name for path in Path("out").iterdir()}
    assert read_answer("out").as_dict()["measures"] == found


@pytest.mark.slow
def test_effects_that_vanish_change_no_number(tubelock) -> None:
    small = ("fem.degree=2", "assembly.layers=1", "mesh.axial=2")
    expected = measured(*small)
    for settings_ in SAME:
        agree(measured(*small, *settings_), expected)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_frames_change_no_number_with_friction(tubelock) -> None:
    """The way to the load counts with friction; states on it that are kept do not."""
    rough = ("fem.degree=2", "effects.friction.coefficient=0.3", "fem.load_steps=2")
    small = (*rough, "assembly.layers=1", "mesh.axial=2")
    expected = measured(*small)
    agree(measured(*small, "fem.frames=3", more=("-o", "out")), expected)


@pytest.mark.usefixtures("undrawn")
def test_frames_change_no_number_where_meshes_are_refined(tubelock) -> None:
    request = ("--accuracy", "u=20%")
    expected = measured(more=request)
    agree(measured("fem.frames=2", more=(*request, "-o", "out")), expected)


# ---------------------------------------------------------------------------------------------
# Other meshes of the same blocks

BLOCKS: dict[str, Block] = {
    "sine": sine(),
    "hexagon": hexagon_block(HEXAGON, HexagonBlockDivisions(2, 1)),
    "osteomorphic": WALL.shapes[0],
    "own": replace(box_block((60.0, 40.0, 50.0), (2, 1, 3)), charts=None),
}
line = st.lists(st.floats(0.1, 1.0), min_size=1, max_size=3)


def meshed_anew(block: Block, sizes: list[list[float]]) -> Block:
    """With elements of such sizes in every part of each direction."""
    names = list(dict.fromkeys(charts_of(block).directions))
    ends = unit_lines(*(np.concatenate([[0.0], np.cumsum(s)]) for s in sizes))
    if names == ["any"]:
        return charts_of(block).build(ends)
    return with_lines(block, dict(zip(names, ends, strict=False)))


@pytest.mark.parametrize("name", BLOCKS)
def test_a_block_on_its_own_lines_is_itself(name: str) -> None:
    block = BLOCKS[name]
    charts = charts_of(block)
    again = charts.build(charts.lines)
    size = np.ptp(block.mesh.nodes, axis=0).max()
    order = np.argsort(np.lexsort(np.round(block.mesh.nodes / size, 9).T))
    other = np.argsort(np.lexsort(np.round(again.mesh.nodes / size, 9).T))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    theirs = place[other]  # number in the block of each node of the other
    np.testing.assert_allclose(again.mesh.nodes, block.mesh.nodes[theirs], atol=1e-12 * size)
    np.testing.assert_array_equal(theirs[again.mesh.elements], block.mesh.elements)
    assert again.faces.keys() == block.faces.keys()
    for face, quads in block.faces.items():
        np.testing.assert_array_equal(theirs[again.faces[face]], quads)


@pytest.mark.parametrize("name", BLOCKS)
@given(sizes=st.tuples(line, line, line), degree=st.integers(1, 3), seed=st.integers(0, 99))
@settings(max_examples=10, deadline=None)
def test_transfer_reproduces_polynomials_of_the_degree(
    name: str, sizes: tuple[list[float], ...], degree: int, seed: int
) -> None:
    """Of the parameters of a chart, which both meshes share, in each direction.

    Values of size one, and elements of a twentieth of a chart: slopes of twenty.
    """
    block = BLOCKS[name]
    fine = meshed_anew(block, list(sizes))
    power = np.random.default_rng(seed).integers(0, degree + 1, 3)
    source, target = with_degree(block, degree), with_degree(fine, degree)
    here, there = node_places(source), node_places(target)
    values = (here.parameters**power).prod(axis=1)
    if len(charts_of(block).elements) > 1:
        # Nodes between charts have parameters in each: what is constant is continuous there.
        values = np.ones_like(values)
        power[:] = 0
    found = interpolation(source, there) @ values
    np.testing.assert_allclose(found, (there.parameters**power).prod(axis=1), atol=1e-12)


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.parametrize("degree", [1, 3])
def test_transfer_reproduces_positions(name: str, degree: int) -> None:
    """Of a mesh on itself whatever its shape, and on any finer one of straight hexahedra."""
    block = BLOCKS[name]
    source = with_degree(block, degree)
    nodes = source.mesh.nodes
    kept = interpolation(source, node_places(source)) @ nodes
    np.testing.assert_allclose(kept, nodes, atol=1e-12 * np.abs(nodes).max())
    if name == "own":
        fine = with_degree(meshed_anew(block, [[1.0, 2.0], [1.0], [3.0, 1.0, 1.0]]), degree)
        moved = interpolation(source, node_places(fine)) @ nodes
        np.testing.assert_allclose(moved, fine.mesh.nodes, atol=1e-12 * np.abs(nodes).max())


@pytest.mark.parametrize("name", BLOCKS)
@given(sizes=st.tuples(line, line, line))
@settings(max_examples=10, deadline=None)
def test_a_block_meshed_anew_keeps_its_volume(name: str, sizes: tuple[list[float], ...]) -> None:
    """Elements of degree 4 follow half a wave of a sine to 1e-4; straight ones are exact."""
    block = BLOCKS[name]
    anew = meshed_anew(block, list(sizes))
    exact = with_degree(block, 4).volume
    tolerance = 1e-12 if name == "own" else 1e-4
    assert with_degree(anew, 4).volume == pytest.approx(exact, rel=tolerance)
    for face, quads in block.faces.items():
        assert len(anew.faces[face]) > 0 or not len(quads)


@pytest.mark.parametrize("degree", [1, 2, 4])
def test_means_over_the_facets_of_its_own_mesh_are_those_of_the_run(degree: int) -> None:
    """On a facet the polynomials are those of its elements, whatever their degree."""
    problem = replace(PROBLEMS["tunnel"], degree=degree)
    found = solve_static(problem, PLAIN).details
    state = found.contact_state
    means = pressures_on_facets(problem.blocks, found.whole, found.displacements)
    # Rounding of gaps is a share of the length in which the law grows by e, whatever the pressure.
    tiny = 1e-12 * state.pressures.max()
    np.testing.assert_allclose(means[state.interface], state.pressures, rtol=1e-9, atol=tiny)


def test_internal_forces_of_alike_blocks_are_those_of_each_block() -> None:
    """Those of one block, turned, and K u of each; displacements are rounded to some 1e-16.

    Of sums of a few hundred products with K: 1e-13 of |K| times the largest displacement.
    """
    found = solve_static(replace(PROBLEMS["tunnel"], degree=2), PLAIN).details
    assert found.system.n_slots < len(found.whole.deformable_blocks)
    (body,), (u,), (forces,) = found.whole.bodies, found.displacements, internal_forces(found)
    each = (body.stiffness @ (u @ body.rotations).reshape(len(u), -1).T).T.reshape(u.shape)
    expected = each @ body.rotations.transpose(0, 2, 1)
    most = abs(body.stiffness).sum(axis=1).max() * np.abs(u).max()
    np.testing.assert_allclose(forces, expected, rtol=0, atol=1e-13 * most)


def test_facets_larger_than_elements_carry_what_the_elements_carry() -> None:
    """Each hexahedron is cut into eight: a facet's mean is that of the four facets on it.

    Facets and parts have the same bilinear shape and the same points of integration.
    """
    wall = OsteomorphicWall(100.0, 40.0, 60.0, 8.0, divisions=(4, 2, 2), columns=1, layers=1)
    blocks = wall.build()
    fine = split(Problem(blocks, pipe(0.01), concrete), 2, 2)
    found = solve_static(fine, PLAIN).details
    state = found.contact_state
    hexahedra = replace(
        blocks, shapes=tuple(replace(shape, charts=None) for shape in blocks.shapes)
    )
    means = pressures_on_facets(hexahedra, found.whole, found.displacements)
    joints = blocks.interfaces
    for start, end in pairwise(joints.pair_start.tolist()):
        m, s = joints.block_m[start], joints.block_s[start]
        parts = np.flatnonzero((state.block_m == m) & (state.block_s == s))
        if not len(parts):  # both blocks are fixed
            continue
        apart = state.centroids[parts, None] - joints.centroids[start:end]
        facet = np.linalg.norm(apart, axis=2).argmin(axis=1)
        area = np.bincount(facet, state.areas[parts])
        mean = np.bincount(facet, (state.pressures * state.areas)[parts]) / area
        assert means[start:end] == pytest.approx(mean, rel=1e-6, abs=1e-9 * mean.max())


def test_a_state_on_its_own_mesh_is_itself() -> None:
    problem = replace(PROBLEMS["tunnel"], degree=2)
    found = solve_static(problem, PLAIN).details
    again = on_degree(problem, problem.blocks.shapes, 2).system
    moved = transferred(found.displacements, found.whole, again)
    for one, other in zip(moved, found.displacements, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12 * np.abs(other).max())


def test_a_coarser_mesh_has_fewer_elements_on_the_same_blocks() -> None:
    problem = PROBLEMS["wall"]
    half = coarser(problem, 0.5)
    assert half is not None
    assert 4 * half.blocks.shapes[0].mesh.n_elements <= 3 * problem.blocks.shapes[0].mesh.n_elements
    assert half.blocks.n_blocks == problem.blocks.n_blocks
    # Half of this tube's elements would have every node at a zero of the wave.
    assert coarser(PROBLEMS["pipe"], 0.5) is None
    assert coarser(half, 1e-9) is None or coarser(half, 1e-9).blocks is not None  # type: ignore[union-attr]
