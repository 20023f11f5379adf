"""Meshes from coarse to fine on which a static problem is solved until its error bars are narrow.

Pressures and tension have their peaks at the upper and lower faces, so elements shorten towards
these and towards the outer face; along a block they are equal, with lines at the joints of the
neighbours.

Displacements, means over facets and averaged tension are integrals: they gain more with the degree
of few large elements. Where nothing else is requested, that ladder is taken. A peak of pressure
gains most with elements along and across a joint, a stress at an edge with those towards it: it has
a ladder of its own.

An error bar compares meshes by their fineness (`fem.accuracy.errors`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from fem.problem import Problem
from geometry.assembly import Assembly
from geometry.block import ANY_DIRECTION, Block, Charts, repeated
from geometry.loads import LoadCase
from geometry.mesh import FloatArray
from geometry.parts.placed import AssemblyError
from geometry.refinement import charts_of, with_lines

#: Measures that gain with the degree.
INTEGRALS = frozenset({"max_displacement", "p_eff", "sigma_1_averaged"})
#: Stresses inside elements, which have their peaks at edges and no bound there in the limit.
AT_EDGES = ("sigma_1_max", "sigma_3_min", "mises_max")
#: Means over facets, whose errors fall fastest.
OF_FACETS = frozenset({"p_eff", "p_max", "p_max_facet"})
#: Elements along a wave at least.
_LEAST_PER_WAVE = 4
#: Parts round a block whose outline is a hexagon.
_KITES = 6


@dataclass(frozen=True)
class Rung:
    """Elements of one block of TSB1's proportions."""

    degree: int
    along: int
    """Elements along a course of blocks."""
    across: int
    """Elements through the wall."""
    upward: int
    across_grading: float
    """Elements at the inner over those at the outer face."""
    upward_grading: float
    """Elements in the middle over those at the upper and lower faces, in the limit of many."""

    def lines(self, charts: Charts) -> dict[str, FloatArray]:
        """Ends of the elements of one part of each direction of a block, 0 to 1."""
        parts = dict(zip(charts.directions, charts.parts, strict=True))
        if len(charts.elements) > 1:
            along = max(2, self.along // _KITES)
        else:
            # Waves across share the elements of those along.
            each = parts.get("along", 1) * parts.get("across", 1)
            along = max(_LEAST_PER_WAVE if each > 1 else 1, -(-self.along // each))
        result = {
            "along": np.linspace(0.0, 1.0, along + 1),
            "across": graded_to_one_end(self.across, self.across_grading),
            "upward": graded_to_both_ends(self.upward, self.upward_grading),
        }
        other = np.linspace(0.0, 1.0, max(1, self.across) + 1)
        return {name: result.get(name, other) for name in parts}


#: Meshes from coarse to fine.
Ladder: TypeAlias = tuple[Rung, ...]


def fineness(problem: Problem, direction: str | None = None) -> float:
    """Squared degree over the mean length of the shortest elements of a block along its lines.

    Of one direction where one is named and the block has it.
    """
    charts = charts_of(problem.blocks.shapes[0])
    lines = dict(zip(charts.directions, charts.lines, strict=True))
    if direction in lines and len(charts.elements) == 1:
        return float(problem.degree**2 / np.diff(lines[direction]).min())
    shortest = [np.diff(line).min() for line in charts.lines]
    return float(problem.degree**2 / np.cbrt(np.prod(shortest) / len(charts.elements)))


#: Share of the extent of a face that coarse meshes keep at least; rounding of an extent.
_LEAST_EXTENT, _SAME = 0.5, 1e-9
#: Large elements of growing degree, then more of them towards the edges: for stresses there.
_FIRST = tuple(Rung(degree, 12, 1, 4, 1.0, 20.0) for degree in (2, 3, 4))
LADDER: Ladder = (
    *_FIRST,
    Rung(4, 18, 2, 6, 4.0, 40.0),
    Rung(4, 24, 3, 6, 6.0, 80.0),
    Rung(5, 24, 3, 6, 8.0, 150.0),
)
#: For the default and for pressures: each mesh is finer than the one before in all directions, by
#: the degree, elements or their grading, so that its changes contain the errors of all of them.
PRESSURES: Ladder = (
    *_FIRST[:2],
    Rung(4, 16, 1, 6, 1.0, 40.0),
    Rung(5, 16, 1, 6, 1.0, 40.0),
    Rung(5, 20, 2, 6, 6.0, 80.0),
    Rung(5, 24, 3, 6, 8.0, 150.0),
)
#: For integrals and means over facets.
DEGREES: Ladder = (
    *_FIRST,
    Rung(5, 18, 1, 4, 1.0, 40.0),
    Rung(5, 18, 2, 4, 4.0, 40.0),
    Rung(5, 24, 3, 6, 8.0, 150.0),
)
#: For a pressure at a point that is requested closely: the same elements of growing degree, two
#: through the wall. Few of them there hide more of a peak than the degree brings.
PEAKS: Ladder = (
    _FIRST[0],
    *(Rung(degree, 18, 2, 6, 6.0, 80.0) for degree in (3, 4, 5)),
    Rung(5, 24, 3, 6, 8.0, 150.0),
)
#: Below this relative error bar [-] it is.
_CLOSELY = 0.02


def ladder_for(targets: Mapping[str, float], problem: Problem | None = None) -> Ladder:
    """Ladder that serves relative error bars of some measures best, of a problem where it is known.

    Hexahedra without a grid are first solved with degree 1: they are many, and cost more with
    every degree than those of a grid.
    """
    requested = frozenset(targets)
    result = LADDER if requested & set(AT_EDGES) else PRESSURES
    if requested <= INTEGRALS | OF_FACETS:
        result = DEGREES
    elif result is PRESSURES and targets.get("p_max_point", 1.0) < _CLOSELY:
        result = PEAKS
    if problem is not None and any(shape.charts is None for shape in problem.blocks.shapes):
        return (replace(result[0], degree=1), *result)
    return result


def graded_to_one_end(n: int, grading: float) -> FloatArray:
    """Ends of n elements on [0, 1], those at 0 longer than those at 1 by the grading."""
    equal = np.linspace(0.0, 1.0, n + 1)
    if grading == 1.0:
        return equal
    rate = np.log(grading)
    graded: FloatArray = np.expm1(-rate * equal) / np.expm1(-rate)
    graded[-1] = 1.0
    return graded


def graded_to_both_ends(n: int, grading: float) -> FloatArray:
    """Ends of n elements on [0, 1], by a hyperbolic tangent; its slopes' ratio is the grading."""
    if grading == 1.0:
        return np.linspace(0.0, 1.0, n + 1)
    x = np.arccosh(np.sqrt(grading)) * np.linspace(-1.0, 1.0, n + 1)
    result: FloatArray = 0.5 * (np.tanh(x) / np.tanh(x[-1]) + 1.0)
    return result


# ---------------------------------------------------------------------------------------------
# Problems on other meshes


def on_mesh(problem: Problem, shapes: tuple[Block, ...], degree: int) -> Problem:
    """State a problem on other meshes of its shapes, with elements of a degree."""
    blocks = replace(problem.blocks, shapes=shapes)
    load = problem.load
    if isinstance(load, LoadCase):
        load = load.on_mesh(blocks)
    return replace(problem, blocks=blocks, load=load, degree=degree, check_blocks=False)


def on_rung(problem: Problem, rung: Rung) -> Problem:
    """State a problem on the mesh of a rung.

    Where blocks of families would not meet facet on facet on its lines, as boxes of different
    sizes, or loads lie on parts of faces, every hexahedron of the stated mesh is split instead.

    Raises
    ------
    AssemblyError, MeshError
        Blocks that such meshes do not suit.
    """
    if problem.load_case.on_regions:
        return split(problem, max(1, rung.across), rung.degree)
    shapes = problem.blocks.shapes
    anew = tuple(with_lines(shape, rung.lines(charts_of(shape))) for shape in shapes)
    result = on_mesh(problem, anew, rung.degree)
    if problem.searches or _meets_alike(problem.blocks, result.blocks):
        return result
    return split(problem, max(1, rung.across), rung.degree)


def split(problem: Problem, parts: int, degree: int) -> Problem:
    """State a problem with every hexahedron cut into so many parts along each edge."""
    line = np.linspace(0.0, 1.0, parts + 1)
    shapes = tuple(
        with_lines(replace(shape, charts=None), {ANY_DIRECTION: line})
        for shape in problem.blocks.shapes
    )
    return on_mesh(problem, shapes, degree)


def _meets_alike(blocks: Assembly, meshed: Assembly) -> bool:
    """Whether blocks meet the same neighbours with another mesh."""
    try:
        result = meshed.interfaces
    except AssemblyError:
        return False
    pairs = [
        set(zip(i.block_m[i.pair_start[:-1]], i.block_s[i.pair_start[:-1]], strict=True))
        for i in (blocks.interfaces, result)
    ]
    return pairs[0] == pairs[1]


def coarser(problem: Problem, share: float) -> Problem | None:
    """State a problem with about that share of the elements along every edge; above 1: a finer one.

    None where it has as many: hexahedra without a family are not joined; and where there are
    too few for the waves of the faces that meet. Contact is searched where
    facets of the coarser meshes do not match.
    """
    shapes = tuple(_with_share(shape, share) for shape in problem.blocks.shapes)
    counts = [
        (new.mesh.n_elements, old.mesh.n_elements)
        for new, old in zip(shapes, problem.blocks.shapes, strict=True)
    ]
    lost = any(map(_flattened, shapes, problem.blocks.shapes))
    if lost or all(new == old for new, old in counts):
        return None
    result = on_mesh(problem, shapes, problem.degree)
    if problem.searches or _meets_alike(problem.blocks, result.blocks):
        return result
    return replace(result, finite_sliding=True)


def _flattened(coarse: Block, block: Block) -> bool:
    """Whether a coarse mesh misses the waves of a block: half of the extent of a joint face."""
    for face in block.contact_faces:
        extent, left = (np.ptp(b.mesh.nodes[b.faces[face]], axis=(0, 1)) for b in (block, coarse))
        if (left < _LEAST_EXTENT * extent - _SAME * extent.max()).any():
            return True
    return False


def _with_share(block: Block, share: float) -> Block:
    charts = block.charts
    if charts is None:
        if block.divided is None:
            return block
        divisions = round(np.cbrt(block.mesh.n_elements))
        return block.divided(max(1, math.ceil(share * divisions - 0.5)))
    first, second, third = (
        _fewer(line, parts, share) for line, parts in zip(charts.lines, charts.parts, strict=True)
    )
    fewer: Block = charts.build((first, second, third))
    return fewer


def _fewer(line: FloatArray, parts: int, share: float) -> FloatArray:
    """Line of equal parts with about a share of its elements, graded alike; waves keep two."""
    if (len(line) - 1) % parts:  # stated without the ends of its parts
        parts = 1
    per_part = (len(line) - 1) // parts
    n = max(min(per_part, 2) if parts > 1 else 1, round(share * per_part))
    own = line[: per_part + 1] * parts
    places = np.linspace(0.0, float(per_part), n + 1)
    return repeated(np.interp(places, np.arange(per_part + 1.0), own), parts)
