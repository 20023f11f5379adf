"""Problems for the coverage of error bars: drawn and chosen before any bar was computed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import meshio
import numpy as np

from fem import CoulombFriction, ExponentialLaw, LinearPenalty, Material, Problem
from fem.accuracy.ladder import LADDER, Rung
from fem.element.lagrange_mesh import LagrangeMesh, with_degree
from geometry import (
    Assembly,
    Block,
    BrickStack,
    ColumnBox,
    HexagonBlock,
    HexMesh,
    Load,
    LoadCase,
    OsteomorphicWall,
    PlanarSineWall,
    PressureLoad,
    RefusedError,
    SineBlock,
    TractionLoad,
    beam,
    box_column,
    pillar,
    pipe,
    read_blocks,
    shaft,
    tube,
    tunnel,
)
from geometry.files.hexahedral_solids import file_blocks
from geometry.files.quadratic import NATURAL
from geometry.mesh import boundary_quads
from tests.verification.concentric import Shells

SEED = 29
#: Of twelve tubes whose shifts are any, four of them with friction.
SEED_OF_TWELVE = 20261127
CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)
STEEL = Material(density=7.85e-9, young_modulus=210e3, poisson_ratio=0.3)
WITHOUT_CONTRACTION = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.0)
WEIGHT = (0.0, 0.0, -9810.0)
#: Load pressure of all problems [MPa].
PRESSURE = 0.01
#: Number of the tube, its load and what it has beyond a load.
TUBES: tuple[tuple[str, Load | None, dict[str, float]], ...] = (
    ("pipe", pipe(PRESSURE), {}),
    ("tunnel", tunnel(PRESSURE), {}),
    ("pillar", pillar(PRESSURE), {}),
    ("shaft", shaft(PRESSURE), {}),
    ("weight", None, {}),
    ("beam", beam(PRESSURE), {}),
    ("pipe, friction", pipe(PRESSURE), {"friction": 0.3}),
    ("tunnel, clearance", tunnel(PRESSURE), {"clearance": 0.002}),
    ("pipe, spacing", pipe(PRESSURE), {"spacing": 0.005}),
    ("pillar, friction", pillar(PRESSURE), {"friction": 0.3}),
    ("tunnel", tunnel(PRESSURE), {}),
    ("pipe", pipe(PRESSURE), {}),
    ("shaft", shaft(PRESSURE), {}),
    ("beam", beam(PRESSURE), {}),
)

#: The same of `twelve_tubes`.
TWELVE: tuple[tuple[str, Load, dict[str, float]], ...] = (
    ("pipe", pipe(PRESSURE), {}),
    ("tunnel", tunnel(PRESSURE), {}),
    ("pipe, friction", pipe(PRESSURE), {"friction": 0.2}),
    ("shaft", shaft(PRESSURE), {}),
    ("pillar", pillar(PRESSURE), {}),
    ("tunnel, friction", tunnel(PRESSURE), {"friction": 0.5}),
    ("pipe, clearance", pipe(PRESSURE), {"clearance": 0.02}),
    ("tunnel", tunnel(PRESSURE), {}),
    ("shaft, friction", shaft(PRESSURE), {"friction": 0.3}),
    ("pipe", pipe(PRESSURE), {}),
    ("shaft", shaft(PRESSURE), {}),
    ("pillar, friction", pillar(PRESSURE), {"friction": 0.3}),
)


#: Mesh of references: elements of degree five, shorter towards the edges than those of any answer.
FINER = Rung(5, 18, 3, 6, 12.0, 300.0)
#: The same of answers on the last two meshes, which have more elements along.
BEYOND = Rung(5, 30, 3, 8, 12.0, 300.0)
#: The same where that takes minutes: those of stresses at edges, beyond the mesh of the answer.
FOURTH, FIFTH, LAST = LADDER[3:]
#: The same of own hexahedra: two parts an edge, of a degree whose nodes are closer than those of
#: the answer's single part.
OWN = Rung(4, 1, 2, 1, 1.0, 1.0)

#: Where those take minutes: finer than four meshes of the default in every direction.
NEAR = Rung(5, 18, 2, 6, 8.0, 80.0)
#: Where friction takes minutes.
ROUGH = Rung(4, 16, 2, 4, 6.0, 40.0)
THIRD = Rung(4, 16, 1, 4, 1.0, 40.0)
OWN_ROUGH = Rung(3, 1, 2, 1, 1.0, 1.0)

#: How many meshes of the default a reference is finer than, and the one beyond it.
FINER_THAN = {
    THIRD: (2, ROUGH),
    ROUGH: (3, NEAR),
    FOURTH: (3, NEAR),
    NEAR: (4, BEYOND),
    FIFTH: (4, BEYOND),
    FINER: (4, BEYOND),
    LAST: (5, BEYOND),
}

#: Tubes whose references take minutes on `FINER`: many blocks, a clearance, no symmetry, friction.
LONG_TUBES = {3: FOURTH, 6: FOURTH, 7: THIRD, 8: FOURTH, 10: THIRD, 14: FOURTH}
#: Tubes of one layer where the drawn ones take more than the limit of time.
LOW_TUBES = (10, 14)


#: Lamé's closed forms: the contact law of the paper with a load, a linear one with a press fit.
SHELLS = {
    "rings, inner pressure": Shells(
        (90.0, 130.0, 180.0), CONCRETE, ExponentialLaw(), 50.0, inner_pressure=1.0
    ),
    "rings, press fit": Shells(
        (10.0, 20.0, 30.0), STEEL, LinearPenalty(1e5), 4.0, interference=0.0025
    ),
    "spherical shells, inner pressure": Shells(
        (90.0, 130.0, 180.0), CONCRETE, ExponentialLaw(), 0.5, spherical=True, inner_pressure=1.0
    ),
}


@dataclass(frozen=True)
class Case:
    """A problem, and what judges its error bars."""

    name: str
    problem: Callable[[], Problem]
    reference: str
    """``finer``: a finer mesh of high degree; ``closed form``."""
    exact: Callable[[], dict[str, float]] = dict
    """Values of the closed form."""
    finer: Rung = FINER
    """Mesh of the reference."""


def drawn(
    rng: np.random.Generator, *, any_shift: bool = False
) -> tuple[SineBlock, int, tuple[int, int, int]]:
    """Draw a tube: block, layers and the mesh whose facets define means; redrawn until it fits."""
    while True:
        waves, n = int(rng.integers(1, 6)), int(rng.integers(3, 9))
        radius, thickness = rng.uniform(80.0, 200.0), rng.uniform(20.0, 60.0)
        height, share = rng.uniform(80.0, 250.0), rng.uniform(0.03, 0.12)
        layers = int(rng.integers(1, 4))
        shift = float(rng.uniform(0.0, 1.0) if any_shift else rng.choice([0.0, 0.5]))
        try:
            block = SineBlock(
                height=height,
                amplitude=share * height,
                frequency=0.5 * waves,
                shift=shift,
                blocks_per_layer=n,
                inner_radius=radius,
                thickness=thickness,
            )
            mesh = (4 * waves * max(1, round(4 / waves)), 2, 4)
            tube(block, layers=layers, mesh=mesh)
        except RefusedError:
            continue
        return block, layers, mesh


def tubes() -> list[Case]:
    """Random Sine and Cosine tubes under every load."""
    rng, found = np.random.default_rng(SEED), []
    for number, (words, load, more) in enumerate(TUBES, 1):
        block, layers, mesh = drawn(rng)
        layers = 1 if number in LOW_TUBES else layers

        def problem(block=block, layers=layers, mesh=mesh, load=load, more=more) -> Problem:
            blocks = tube(block, layers=layers, mesh=mesh)
            if load is None:
                return Problem(blocks, pipe(0.0), CONCRETE, gravity=WEIGHT, **more)
            return Problem(blocks, load, CONCRETE, **more)

        finer = LONG_TUBES.get(number, FINER)
        found.append(Case(f"tube {number}: {words}", problem, "finer", finer=finer))
    return found


def twelve_tubes() -> list[Case]:
    """Random tubes of one layer."""
    rng, found = np.random.default_rng(SEED_OF_TWELVE), []
    for number, (words, load, more) in enumerate(TWELVE, 1):
        block, _, mesh = drawn(rng, any_shift=True)

        def problem(block=block, mesh=mesh, load=load, more=more) -> Problem:
            return Problem(tube(block, layers=1, mesh=mesh), load, CONCRETE, **more)

        finer = THIRD if "friction" in more else NEAR
        found.append(Case(f"drawn tube {number}: {words}", problem, "finer", finer=finer))
    return found


def hexagons(load: Load, **more: float) -> Problem:
    """A tube of hexagon blocks."""
    block = HexagonBlock(blocks_per_layer=6, inner_radius=130.0, thickness=45.0)
    return Problem(tube(block, layers=1, mesh=(4, 2)), load, CONCRETE, **more)


def planar_wall(**more: float) -> Problem:
    """Two by two planar Sine Blocks under pressure."""
    block = (160.0, 50.0, 150.0, 12.0)
    wall = PlanarSineWall(*block, 1.0, 0.5, divisions=(8, 2, 4), columns=2, layers=2).build()
    return Problem(wall, pipe(PRESSURE), CONCRETE, **more)


def osteomorphic(columns: int, **more: float) -> Problem:
    """Osteomorphic blocks, as many rows as columns, under pressure."""
    block = (180.0, 90.0, 70.0, 8.0)
    wall = OsteomorphicWall(*block, divisions=(8, 4, 4), columns=columns, layers=columns).build()
    return Problem(wall, pipe(PRESSURE), CONCRETE, **more)


def pressed_bricks() -> Problem:
    """A stack of bricks under axial pressure."""
    stack = BrickStack((180.0, 90.0, 70.0), (2, 2, 2), columns=1, layers=3).build()
    return Problem(stack, pillar(PRESSURE), CONCRETE)


def exact_bricks() -> dict[str, float]:
    """The pressure that acts is that of every joint, and of the stress."""
    pressures = dict.fromkeys(("p_eff", "p_max", "p_max_facet", "p_max_point"), PRESSURE)
    return pressures | {"sigma_3_min": -PRESSURE, "mises_max": PRESSURE}


#: Boxes of a column, the lowest held, and their height [mm].
N_BOXES, BOX_HEIGHT = 4, 60.0


def heavy_boxes(*, own: bool = False) -> Problem:
    """A column of boxes under its weight; as a family, or from a file with skewed hexahedra."""
    column = box_column([ColumnBox((100.0, 80.0, BOX_HEIGHT), (2, 2, 2))] * N_BOXES)
    if own:
        (shape,) = column.shapes
        nodes = shape.mesh.nodes.copy()
        inside = np.setdiff1d(np.arange(len(nodes)), boundary_quads(shape.mesh))
        nodes[inside] += (7.0, -5.0, 6.0)
        skewed = replace(shape, mesh=HexMesh(nodes, shape.mesh.elements))
        with TemporaryDirectory() as folder:
            column = replace(column, shapes=(_through_a_file(Path(folder), skewed, 8),))
    load = LoadCase(column, "weight", (), column.fixed)
    return Problem(column, load, WITHOUT_CONTRACTION, gravity=WEIGHT)


def exact_boxes() -> dict[str, float]:
    """Without lateral contraction a bar in one direction; joints close by the law."""
    problem = heavy_boxes()
    weight = -WEIGHT[2] * problem.material.density
    pressures = weight * BOX_HEIGHT * np.arange(1, N_BOXES)
    height = (N_BOXES - 1) * BOX_HEIGHT
    shortened = 0.5 * weight * height**2 / problem.material.young_modulus
    closed = float(problem.contact_law.overclosure(pressures).sum())
    largest = dict.fromkeys(("p_max_facet", "p_max_point"), float(pressures[-1]))
    return largest | {
        "max_displacement": closed + shortened,
        "p_max": float(pressures.mean()),
    }


#: Tractions on the upper box of two: pressed on, and pushed sideways by less than friction holds.
PRESSED, PUSHED, FRICTION = 0.02, 0.006, 0.5


def pushed_box() -> Problem:
    """A box on a held one, pressed on and pushed sideways; its ends carry the conjugate shear."""
    column = box_column([ColumnBox((100.0, 80.0, BOX_HEIGHT), (2, 2, 2))] * 2)
    box = np.array([1])
    push, up = PUSHED * np.eye(3)[[0, 2]]
    faces = (
        PressureLoad(box, "z+", PRESSED),
        TractionLoad(box, "z+", push),
        TractionLoad(box, "x+", up),
        TractionLoad(box, "x-", -up),
    )
    load = LoadCase(column, "pushed sideways", faces, column.fixed)
    return Problem(column, load, WITHOUT_CONTRACTION, friction=FRICTION)


def exact_push() -> dict[str, float]:
    """Uniform pressure and shear: the box shortens and leans, the joint closes and sticks."""
    problem = pushed_box()
    modulus = problem.material.young_modulus
    length = problem.blocks.characteristic_length
    slip = PUSHED / CoulombFriction(FRICTION).stick(modulus, length)
    closed = float(problem.contact_law.overclosure(np.array([PRESSED]))[0])
    moved = (
        slip + 2.0 * PUSHED / modulus * BOX_HEIGHT,
        closed + PRESSED / modulus * BOX_HEIGHT,
    )
    radius = float(np.hypot(0.5 * PRESSED, PUSHED))
    return dict.fromkeys(("p_eff", "p_max", "p_max_facet", "p_max_point"), PRESSED) | {
        "max_displacement": float(np.hypot(*moved)),
        "sigma_1_max": radius - 0.5 * PRESSED,
        "sigma_1_averaged": radius - 0.5 * PRESSED,
        "sigma_3_min": -radius - 0.5 * PRESSED,
        "mises_max": float(np.hypot(PRESSED, np.sqrt(3.0) * PUSHED)),
    }


def own_planar_wall(**more: Any) -> Problem:
    """One planar Sine Block between held ones, each read from a file of four curved hexahedra."""
    block = (120.0, 60.0, 60.0, 7.0)
    return _own(
        PlanarSineWall(*block, 1.0, 0.5, divisions=(4, 1, 1), columns=1, layers=1).build(),
        27,
        **more,
    )


def own_wall(nodes: int, **more: Any) -> Problem:
    """One interlocking block between held ones, each read from a file of 8 or 27 nodes."""
    block = (120.0, 60.0, 60.0, 7.0)
    return _own(
        OsteomorphicWall(*block, divisions=(4, 2, 2), columns=1, layers=1).build(), nodes, **more
    )


def _own(wall: Assembly, nodes: int, **more: Any) -> Problem:
    """A wall whose blocks were read from files, under a force aslant."""
    with TemporaryDirectory() as folder:
        shapes = tuple(_through_a_file(Path(folder), shape, nodes) for shape in wall.shapes)
    wall = replace(wall, shapes=shapes)
    load = LoadCase(wall, "weight", (), wall.fixed)
    return Problem(wall, load, CONCRETE, gravity=(0.0, 1e6, -1e6), **more)


def _through_a_file(folder: Path, shape: Block, count: int) -> Block:
    """A block as its hexahedra of 8 or 27 nodes give it back."""
    points, members = shape.mesh.nodes, shape.mesh.elements
    if count == 27:
        mesh = with_degree(shape, 2).mesh
        assert isinstance(mesh, LagrangeMesh)
        columns = np.rint(NATURAL + 1.0).astype(np.int64) @ np.array([9, 3, 1])
        points, members = mesh.nodes, mesh.members[:, columns]
    path = folder / f"{shape.name}-{count}.vtu"
    kind = "hexahedron" if count == 8 else f"hexahedron{count}"
    meshio.write(path, meshio.Mesh(points, [(kind, members)]))
    (block,) = file_blocks(path, read_blocks(path), units="mm", divisions=1)
    return block


def cases() -> list[Case]:
    """All of them: the first, third, … were used to choose the rule, the others judge it."""
    return [
        *tubes(),
        Case("hexagon tube: pipe", lambda: hexagons(pipe(PRESSURE)), "finer", finer=LAST),
        Case(
            "hexagon tube: tunnel, friction",
            lambda: hexagons(tunnel(PRESSURE), friction=0.3),
            "finer",
            finer=NEAR,
        ),
        Case("planar Sine wall", planar_wall, "finer", finer=FOURTH),
        Case("osteomorphic wall", lambda: osteomorphic(2), "finer", finer=FOURTH),
        Case(
            "osteomorphic wall of one block, friction",
            lambda: osteomorphic(1, friction=0.3),
            "finer",
            finer=THIRD,
        ),
        Case("pressed bricks", pressed_bricks, "closed form", exact_bricks),
        Case("heavy boxes", heavy_boxes, "closed form", exact_boxes),
        Case(
            "heavy boxes, own skewed hexahedra",
            lambda: heavy_boxes(own=True),
            "closed form",
            exact_boxes,
        ),
        Case("own hexahedra of 8 nodes", lambda: own_wall(8), "finer", finer=OWN),
        Case(
            "own hexahedra of 27 nodes, friction",
            lambda: own_planar_wall(friction=0.3),
            "finer",
            finer=OWN,
        ),
        Case(
            "own hexahedra of 27 nodes, degree 2",
            lambda: own_wall(27, degree=2),
            "finer",
            finer=OWN_ROUGH,
        ),
        *(
            Case(name, shells.problem, "closed form", shells.exact)
            for name, shells in SHELLS.items()
        ),
    ]
