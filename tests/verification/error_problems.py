"""Problems for the coverage of error bars: drawn and chosen before any bar was computed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import meshio
import numpy as np

from fem import CoulombFriction, ExponentialLaw, LinearPenalty, Material, Problem
from fem.accuracy.ladder import Rung
from fem.element.lagrange import LagrangeMesh, with_degree
from geometry import (
    Assembly,
    Block,
    BrickStack,
    ColumnBox,
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

#: Each drawn problem has a seed of its own, from the first on.
FIRST_SEED = 20261201
CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)
STEEL = Material(density=7.85e-9, young_modulus=210e3, poisson_ratio=0.3)
WITHOUT_CONTRACTION = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.0)
WEIGHT = (0.0, 0.0, -9810.0)
#: Load pressure of all problems [MPa].
PRESSURE = 0.01
#: Loads of the twenty tubes in turn, and of the next: what they have beyond a load.
LOADS = (pipe, tunnel, shaft, pillar, beam)
N_TUBES = 20
BEYOND_A_LOAD: tuple[tuple[Callable[[float], Load], dict[str, float]], ...] = (
    (pipe, {"friction": 0.3}),
    (tunnel, {"friction": 0.5}),
    (shaft, {"friction": 0.2}),
    (pipe, {"clearance": 0.01}),
    (tunnel, {"spacing": 0.005}),
)

#: Meshes of references: elements of degree five, shorter towards the edges than those of the
#: answer; the last of answers on five meshes.
NEAR = Rung(5, 18, 2, 6, 8.0, 80.0)
BEYOND = Rung(5, 30, 3, 8, 12.0, 300.0)
#: The same where friction or a gap takes minutes.
ROUGH = Rung(4, 16, 2, 4, 6.0, 40.0)
#: Of own hexahedra: two parts an edge, of a degree whose nodes are closer than those of the
#: answer's single part.
OWN = Rung(4, 1, 2, 1, 1.0, 1.0)
#: Of boxes whose edges lie inside elements: more elements, not more degree.
BOXES = Rung(2, 14, 5, 4, 1.0, 1.0)
#: Meshes of an answer from which on its reference is another one.
FINER_FROM = {NEAR: (5, BEYOND), ROUGH: (4, NEAR)}


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
    finer: Rung | None = None
    """Mesh of the reference; None: a closed form."""
    exact: Callable[[], dict[str, float]] = dict
    """Values of the closed form."""


def drawn_tube(rng: np.random.Generator, *, layers: int) -> Assembly:
    """Draw a tube, with the mesh whose facets define means; redrawn until it fits."""
    while True:
        waves, n = int(rng.integers(1, 6)), int(rng.integers(3, 9))
        radius, thickness = rng.uniform(80.0, 200.0), rng.uniform(20.0, 60.0)
        height, share = rng.uniform(80.0, 250.0), rng.uniform(0.03, 0.12)
        try:
            block = SineBlock(
                height=height,
                amplitude=share * height,
                frequency=0.5 * waves,
                shift=float(rng.uniform(0.0, 1.0)),
                blocks_per_layer=n,
                inner_radius=radius,
                thickness=thickness,
            )
            return tube(block, layers=layers, mesh=(4 * waves * max(1, round(4 / waves)), 2, 4))
        except RefusedError:
            continue


def drawn() -> list[Case]:
    """Twenty tubes, three with friction, two with gaps, six of blocks from files or boxes."""
    result = list[Case]()
    loads = [(LOADS[k % len(LOADS)], {}) for k in range(N_TUBES)]
    for k, (load, more) in enumerate((*loads, *BEYOND_A_LOAD)):
        layers = 1 + k % 2 if k < N_TUBES else 1
        words = ", ".join((load(PRESSURE).case.name, *more))

        def problem(
            seed: int = FIRST_SEED + k,
            layers: int = layers,
            load: Callable[[float], Load] = load,
            more: Mapping[str, float] = more,
        ) -> Problem:
            blocks = drawn_tube(np.random.default_rng(seed), layers=layers)
            return Problem(blocks, load(PRESSURE), CONCRETE, **more)

        finer = ROUGH if more else NEAR
        result.append(Case(f"tube {k + 1}: {words}, {layers} layers", problem, finer))
    seed = FIRST_SEED + len(result)
    return [
        *result,
        Case("own hexahedra of 8 nodes", partial(own_wall, seed), OWN),
        Case("own hexahedra of 27 nodes", partial(own_planar_wall, seed + 1), OWN),
        Case(
            "own hexahedra of 27 nodes, friction",
            partial(own_planar_wall, seed + 2, friction=0.3),
            OWN,
        ),
        Case("own hexahedra of 8 nodes, other size", partial(own_wall, seed + 3), OWN),
        Case("stacked boxes", partial(stacked_boxes, seed + 4), BOXES),
        Case("stacked boxes, other size", partial(stacked_boxes, seed + 5), BOXES),
    ]


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


def stacked_boxes(seed: int) -> Problem:
    """Three boxes of any size under a pressure: contact is searched."""
    sizes = np.random.default_rng(seed).uniform((60.0, 60.0, 30.0), (110.0, 110.0, 70.0), (3, 3))
    column = box_column([ColumnBox(tuple(size), (4, 4, 2)) for size in sizes.tolist()])
    load = LoadCase(column, "pressed", (PressureLoad(np.array([2]), "z+", 0.5),), column.fixed)
    return Problem(column, load, CONCRETE)


def own_planar_wall(seed: int, **more: Any) -> Problem:
    """One planar Sine Block between held ones, each read from a file of four curved hexahedra."""
    wall = PlanarSineWall(*_drawn_block(seed), 1.0, 0.5, divisions=(4, 1, 1), columns=1, layers=1)
    return _own(wall.build(), 27, **more)


def own_wall(seed: int) -> Problem:
    """One interlocking block between held ones, each read from a file of hexahedra."""
    wall = OsteomorphicWall(*_drawn_block(seed), divisions=(4, 2, 2), columns=1, layers=1)
    return _own(wall.build(), 8)


def _drawn_block(seed: int) -> tuple[float, float, float, float]:
    """Length, thickness, height and amplitude of a block [mm]."""
    rng = np.random.default_rng(seed)
    length, thickness, height = rng.uniform((90.0, 45.0, 45.0), (160.0, 80.0, 80.0)).tolist()
    return length, thickness, height, float(rng.uniform(0.06, 0.12)) * height


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
    """All of them."""
    return [
        *drawn(),
        Case("pressed bricks", pressed_bricks, exact=exact_bricks),
        Case("heavy boxes", heavy_boxes, exact=exact_boxes),
        Case(
            "heavy boxes, own skewed hexahedra", partial(heavy_boxes, own=True), exact=exact_boxes
        ),
        *(Case(name, shells.problem, exact=shells.exact) for name, shells in SHELLS.items()),
    ]
