"""Meshes of the ladders: lines that fit blocks, coarser ones."""

from __future__ import annotations

import numpy as np
import pytest

from fem import LinearPenalty, Problem, concrete
from fem.accuracy.converge import TARGETS
from fem.accuracy.ladder import (
    DEGREES,
    LADDER,
    PEAKS,
    PRESSURES,
    Rung,
    coarser,
    ladder_for,
    on_rung,
)
from geometry import Indenter, pipe
from geometry.families.boxes import ColumnBox, box_column
from geometry.families.planar_wall import OsteomorphicWall
from geometry.loads import face_pressure
from geometry.mesh import FloatArray, volume_and_centroid
from geometry.refinement import charts_of
from tests.support.stated import stated

pytestmark = pytest.mark.quick

RUNGS = [*LADDER, *DEGREES, *PEAKS]


def tube() -> Problem:
    return stated("tsb1-pipe", "assembly.layers=1", *("mesh.around=12", "mesh.axial=4"))


def boxes(*divisions: tuple[int, int, int]) -> Problem:
    """Boxes on each other, every second one of half the width and depth."""
    sizes = [(100.0, 80.0, 50.0) if k % 2 == 0 else (50.0, 40.0, 50.0) for k in range(3)]
    column = box_column([ColumnBox(s, d) for s, d in zip(sizes, divisions, strict=True)])
    load = face_pressure(column, np.array([2]), "z+", 0.5)
    return Problem(column, load, concrete, law=LinearPenalty(1e3))


@pytest.mark.parametrize("ladder", [PRESSURES, LADDER, DEGREES, PEAKS])
def test_every_mesh_has_more_unknowns_than_the_one_before(ladder) -> None:  # type: ignore[no-untyped-def]
    sizes = [r.along * r.across * r.upward * r.degree**3 for r in ladder]
    assert sizes == sorted(set(sizes))


@pytest.mark.parametrize("rung", RUNGS)
def test_lines_of_a_rung_fill_every_part_of_a_block_once(rung: Rung) -> None:
    charts = charts_of(tube().blocks.shapes[0])
    counts = {"along": rung.along, "across": rung.across, "upward": rung.upward}
    lines = rung.lines(charts)
    for name, parts in zip(charts.directions, charts.parts, strict=True):
        line = lines[name]
        assert (line[0], line[-1]) == (0.0, 1.0)
        assert (np.diff(line) > 0.0).all()
        assert parts * (len(line) - 1) == counts[name]


@pytest.mark.parametrize("rung", RUNGS)
def test_lines_of_an_indenter_go_from_end_to_end(rung: Rung) -> None:
    """Its directions are alike: each has as many elements as a wall has across."""
    charts = charts_of(Indenter("ball", 100.0, 5.0, 3).build().shapes[0])
    for line in rung.lines(charts).values():
        np.testing.assert_allclose(line, np.linspace(0.0, 1.0, rung.across + 1), atol=1e-15)


def volumes(problem: Problem) -> FloatArray:
    return np.array([volume_and_centroid(shape.mesh)[0] for shape in problem.blocks.shapes])


def test_tubes_have_the_elements_of_a_rung_and_boxes_that_would_not_match_are_split() -> None:
    rung = LADDER[3]
    fine = on_rung(tube(), rung)
    assert fine.degree == rung.degree
    assert {shape.mesh.n_elements for shape in fine.blocks.shapes} == {18 * 2 * 6}
    stack = boxes((4, 4, 1), (2, 2, 1), (4, 4, 1))
    split = on_rung(stack, rung)
    for old, new in zip(stack.blocks.shapes, split.blocks.shapes, strict=True):
        assert new.mesh.n_elements == rung.across**3 * old.mesh.n_elements
    np.testing.assert_allclose(volumes(split), volumes(stack), rtol=1e-12)
    # Facets of the two joints of 50 × 40 mm² match on them.
    assert split.blocks.interfaces.areas.sum() == pytest.approx(4000.0, rel=1e-12)


def test_a_coarser_mesh_has_every_second_line() -> None:
    fine = boxes((8, 8, 2), (4, 4, 2), (8, 8, 2))
    coarse = coarser(fine, 0.5)
    assert coarse is not None
    for old, new in zip(fine.blocks.shapes, coarse.blocks.shapes, strict=True):
        for before, after in zip(charts_of(old).lines, charts_of(new).lines, strict=True):
            np.testing.assert_allclose(after, before[::2], rtol=0, atol=1e-15)
    np.testing.assert_allclose(volumes(coarse), volumes(fine), rtol=1e-12)
    assert coarser(boxes((1, 1, 1), (1, 1, 1), (1, 1, 1)), 0.5) is None


def test_requests_choose_the_ladder() -> None:
    """Stresses at a point need elements towards edges; integrals and facet means the degree."""
    assert ladder_for(dict.fromkeys(["max_displacement", "p_eff", "p_max"], 0.01)) is DEGREES
    assert ladder_for(TARGETS) is PRESSURES
    assert ladder_for({"p_max_point": 0.03}) is PRESSURES
    assert ladder_for({"p_max_point": 0.01, "p_eff": 0.01}) is PEAKS
    assert ladder_for({"p_max_point": 0.01, "sigma_1_max": 0.05}) is LADDER


def test_osteomorphic_blocks_are_refined_across_their_waves() -> None:
    """They have a wave along and half a one across: the crest is a line of every mesh."""
    wall = OsteomorphicWall(
        200.0, 100.0, 80.0, 10.0, divisions=(4, 3, 2), columns=1, layers=1
    ).build()
    problem = Problem(wall, pipe(0.01), concrete)
    for rung in PRESSURES:
        charts = charts_of(on_rung(problem, rung).blocks.shapes[0])
        assert 0.5 in charts.lines[charts.directions.index("across")]
        assert charts.counts[1] == 2 * rung.across
    # A stated mesh without that line has coarser ones all the same.
    coarse = coarser(problem, 0.5)
    assert coarse is not None
    np.testing.assert_allclose(volumes(coarse), volumes(problem), rtol=0.1)
