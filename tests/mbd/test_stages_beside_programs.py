"""Stages of an arch, a flat vault, a barrel and a dome beside linear programs of the tests' own.

Programs take pyramids of many sides, on the cone of friction and round it: the least propping lies
between. Larger ones are in `make thorough`.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest

from fem import CoulombFriction, Problem, concrete
from geometry import convex_polyhedron
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import polyhedral_assembly
from mbd import stages
from mbd.building.stages import StageResults, Stands
from mbd.options import Along, Stages
from tests.support.dome import voussoirs
from tests.support.drawn_blocks import abeille, arch
from tests.support.spatial_program import Spatial

#: Gravity times density of concrete [N/mm³].
WEIGHT = 9810.0 * concrete.density
NONE = 1e-6


class Built(NamedTuple):
    """Corners of blocks by name, which are fixed, and which each stage places."""

    blocks: dict[str, FloatArray]
    fixed: list[str]
    order: list[list[str]]


def panel(n: int) -> Built:
    """Abeille's flat vault in a fixed ring, row after row."""
    drawn, ring = abeille(n)
    rows = [[f"block {i} {j}" for j in range(1, n + 1)] for i in range(1, n + 1)]
    return Built({name: points for name, (points, _) in drawn.items()}, ring, rows)


def barrel(courses: int, whole: int) -> Built:
    """Courses of whole blocks in running bond, from both sides up."""
    angles, radii = np.linspace(0.0, np.pi, courses + 1), (925.0, 1075.0)
    blocks, rows = dict[str, FloatArray](), list[list[str]]()
    for course, ends in enumerate(pairwise(angles)):
        cuts = np.arange(whole + 1.0)
        if course % 2:
            cuts = np.array([0.0, *(np.arange(whole) + 0.5), whole])
        row = {
            f"v{course} {start:g}": np.array(
                [
                    (r * np.cos(a), 300.0 * y, r * np.sin(a))
                    for r in radii
                    for a in ends
                    for y in (start, end)
                ]
            )
            for start, end in pairwise(cuts.tolist())
        }
        blocks |= row
        rows.append(list(row))
    for name, side in (("right", 1.0), ("left", -1.0)):
        corners = [(side * r, y, z) for r in radii for y in (0.0, 300.0 * whole) for z in (-200, 0)]
        blocks[name] = np.array(corners)
    half = courses // 2
    order = [[*rows[k], *rows[courses - 1 - k]] for k in range(half)]
    return Built(blocks, ["right", "left"], [*order, rows[half]])


def dome(sectors: int, rings: int, split: int) -> Built:
    """Rings from below, each in one stage, of one of them a block before the others; and a cap."""
    shapes = voussoirs(150.0, sectors, np.linspace(6.0, 90.0, rings + 1), cap=True)
    order = []
    for ring in range(rings - 1, -1, -1):
        names = [f"ring{ring}_{q}" for q in range(sectors)]
        order += [names[:1], names[1:]] if rings - 1 - ring == split else [names]
    fixed = [name for name in shapes if name.startswith("base")]
    return Built({n: shape.points for n, shape in shapes.items()}, fixed, [*order, ["cap"]])


def judged(built: Built, friction: float, along: Along) -> StageResults:
    """Stages of the same corners as solids of ours."""
    placed = [
        (convex_polyhedron(name, points), np.eye(3), np.zeros(3))
        for name, points in built.blocks.items()
    ]
    fixed = np.array([name in built.fixed for name in built.blocks])
    blocks = polyhedral_assembly("own", placed, fixed, names=tuple(built.blocks))
    gravity = (0.0, 0.0, -9810.0)
    problem = Problem(blocks, None, concrete, friction=CoulombFriction(friction), gravity=gravity)
    order = tuple(tuple(map(str, names)) for names in built.order)
    return stages(problem, Stages(order=order, along=along))


def propped(
    built: Built,
    friction: float,
    along: Along,
    *,
    sides: int = 16,
    exact: bool = False,
    every: int = 1,
) -> list[int]:
    """Compare each stage, or every so many, with two programs; returns those that need props.

    ``exact``: pyramids on the cone have its forces.
    """
    own, there, result = Spatial(built.blocks, built.fixed), list[str](), []
    for stage, new in zip(judged(built, friction, along), built.order, strict=True):
        there += new
        weight = WEIGHT * sum(own.volumes[own.names.index(name)] for name in there)
        assert -stage.weight[2] == pytest.approx(weight, rel=1e-9)
        if stage.stands is Stands.PROPS:
            result.append(stage.number)
        elif stage.number % every:
            continue
        least, most = (
            WEIGHT * own.least_propping(there, friction, along=along, sides=sides, outer=outer)
            for outer in (True, False)
        )
        if stage.stands is Stands.FALLS:
            assert most == np.inf
            continue
        assert least - NONE * weight <= stage.propping <= most + NONE * weight
        assert not exact or stage.propping == pytest.approx(most, abs=NONE * weight)
        needs = stage.stands is Stands.PROPS
        assert needs >= (least > NONE * weight)
        assert needs <= (most > NONE * weight)
    return result


@pytest.mark.quick
@pytest.mark.parametrize("along", list(Along))
def test_an_arch_of_eleven_voussoirs_needs_props_until_its_keystone(along: Along) -> None:
    """Of forces in a plane pyramids with an edge in it leave nothing out."""
    names = [f"V{k:02d}" for k in range(1, 12)]
    order = [[names[k], names[10 - k]] for k in range(5)]
    drawn = {name: points for name, (points, _) in arch(11).items()}
    built = Built(drawn, ["S_left", "S_right"], [*order, [names[5]]])
    assert propped(built, 0.7, along, exact=True) == [3, 4, 5]


@pytest.mark.quick
def test_a_flat_vault_needs_props_until_its_last_row() -> None:
    assert propped(panel(2), 0.1, Along.UP) == [1]


@pytest.mark.quick
def test_a_barrel_needs_its_centering_until_it_is_closed() -> None:
    assert propped(barrel(7, 1), 0.7, Along.NORMAL) == [2, 3]


@pytest.mark.quick
def test_a_block_of_a_ring_of_a_dome_needs_centering_and_a_whole_one_none() -> None:
    assert propped(dome(5, 3, split=2), 0.6, Along.NORMAL) == [3]


@pytest.mark.thorough
def test_a_larger_flat_vault_needs_props_as_programs_say() -> None:
    assert propped(panel(5), 0.1, Along.UP) == [1, 2, 3, 4]


@pytest.mark.thorough
def test_a_barrel_of_82_blocks_needs_centering_as_programs_say() -> None:
    built = barrel(15, 5)
    assert len(built.blocks) - len(built.fixed) == 82
    assert propped(built, 0.7, Along.NORMAL) == [4, 5, 6, 7]


@pytest.mark.thorough
def test_a_dome_of_305_blocks_rises_ring_by_ring_as_programs_say() -> None:
    built = dome(16, 19, split=12)
    assert len(built.blocks) - len(built.fixed) == 305
    assert propped(built, 0.6, Along.NORMAL, sides=8, every=7) == [13]
