"""CalculiX against tubelock: needs ``ccx``, one row the converter abq2ccx too.

The same deck data are computed twice: by CalculiX from the text of the deck, and by the solvers
of this package from the model that the deck makes.
"""

from __future__ import annotations

import importlib.util
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from fem import ElementType, Explicit, ExponentialLaw, Problem, concrete
from fem.decks.deck import Deck, Flavour
from fem.decks.faces import half_facet_angle
from fem.decks.problem import problem_deck, write_deck_file
from fem.explicit.setup.timed_system import timed_system
from fem.explicit.solve import run_explicit
from fem.state import State
from fem.static.solve import static_state
from geometry import Assembly, Block, PressureLoad, box_block
from geometry.families.sine_block import TSB1, SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.loads import LoadCase, pipe
from geometry.parts.regions import HeldFace
from tests.support.ccx import CalculixResult, calculix_available, run_calculix


@dataclass(frozen=True)
class CheckRow:
    """One number from both programs."""

    case: str
    quantity: str
    calculix: float
    ours: float
    relative_difference: float
    tolerance: float
    """Largest difference that the two methods allow, derived where the case is defined."""
    calculix_cpu_seconds: float
    our_cpu_seconds: float

    @property
    def agrees(self) -> bool:
        """Whether the difference is within the tolerance."""
        return self.relative_difference <= self.tolerance


# ---------------------------------------------------------------------------------------------
# Cases


def _upright(name: str, shape: Block, *heights: float) -> Assembly:
    """Copies of a block over each other, none of them held."""
    n = len(heights)
    return Assembly(
        name=name,
        shapes=(shape,),
        shape_of=np.zeros(n, dtype=np.int64),
        rotations=np.tile(np.eye(3), (n, 1, 1)),
        translations=np.array([[0.0, 0.0, height] for height in heights]),
        layer=np.arange(n),
        fixed=np.zeros(n, dtype=np.bool_),
        unmatched_allowed=True,
    )


def column_problem(upper: Block | None = None) -> Problem:
    """Two boxes one on the other under 0.01 MPa, held so that the state is uniform."""
    box = box_block((20.0, 20.0, 30.0), (2, 2, 3), contact_faces=("z-", "z+"))
    blocks = _upright("column", box, 0.0, 30.0)
    if upper is not None:
        blocks = replace(blocks, shapes=(box, upper), shape_of=np.arange(2))
    held = [HeldFace(0, "z-", np.eye(3)[2:])]
    for block in (0, 1):
        held += [HeldFace(block, face, np.eye(3)[[k]]) for k, face in enumerate(("x-", "y-"))]
    loads = (PressureLoad(np.array([1]), "z+", 0.01),)
    load = LoadCase(blocks, "column", loads, blocks.fixed, held=tuple(held))
    return Problem(blocks, load, concrete)


def column_deck(flavour: Flavour = Flavour.CALCULIX) -> Deck:
    """The column."""
    return problem_deck(column_problem(), flavour)


def crossing_deck(flavour: Flavour = Flavour.CALCULIX) -> Deck:
    """The column with 3 × 3 facets on 2 × 2."""
    upper = box_block((20.0, 20.0, 30.0), (3, 3, 3), name="upper", contact_faces=("z-", "z+"))
    return problem_deck(column_problem(upper), flavour, name="crossing")


def tube_problem(divisions: SineBlockDivisions) -> Problem:
    """One free layer of TSB(200, 20, 0.5, 0, 4, 120, 40) under internal pressure.

    One wave per block, and a tenth of the paper's c0: on coarse meshes CalculiX takes other
    normals than we do, and it loses nodes that slide over a rim by 1e-3 of a facet.
    """
    blocks = SineTube(replace(TSB1, frequency=0.5), divisions, 1).build()
    return Problem(blocks, pipe(0.01), concrete, law=ExponentialLaw(1e-4, 1e-4, 1e7))


def tube_deck(divisions: SineBlockDivisions, flavour: Flavour = Flavour.CALCULIX) -> Deck:
    """The tube."""
    return problem_deck(tube_problem(divisions), flavour, name="tube")


#: The wave of the bar runs 40 of 100 mm.
BAR_RUN = Explicit(end_time=1.0e-5, ramp_time=0.0, time_step=2.0e-8, damping="none")


def bar_problem() -> Problem:
    """A bar clamped at one end, pressed at the other at once."""
    bar = _upright("bar", box_block((100.0, 10.0, 10.0), (10, 1, 1)), 0.0)
    loads = (PressureLoad(np.array([0]), "x+", 1.0),)
    load = LoadCase(bar, "bar", loads, bar.fixed, held=(HeldFace(0, "x-"),))
    return Problem(bar, load, concrete, element=ElementType.FULL)


def bar_deck() -> Deck:
    """The bar."""
    return problem_deck(bar_problem(), Flavour.CALCULIX, BAR_RUN)


# ---------------------------------------------------------------------------------------------
# Rows


def calculix_of(deck: Deck, folder: Path) -> CalculixResult:
    """Write a deck into a folder and run CalculiX on it."""
    path = folder / f"{deck.name}.inp"
    write_deck_file(path, deck)
    return run_calculix(path)


def calculix_through_converter(deck: Deck, folder: Path) -> CalculixResult:
    """Write the instance deck, let abq2ccx convert it, and run CalculiX on the outcome."""
    import abq2ccx

    source, target = folder / f"{deck.name}.inp", folder / f"{deck.name}-converted.inp"
    write_deck_file(source, problem_deck(deck.problem, Flavour.STANDARD, name=deck.name))
    text = abq2ccx.convert_file(str(source)).text
    n_nodes = sum(deck.assembly.shape(b).mesh.n_nodes for b in range(deck.assembly.n_blocks))
    every = f"*NSET, NSET=PRINTED, GENERATE\n1, {n_nodes}, 1\n"
    request = "*NODE PRINT, NSET=PRINTED\nU\n*CONTACT PRINT\nCSTR\n"
    step, end = text.upper().index("\n*STEP") + 1, text.upper().rindex("*END STEP")
    target.write_text(text[:step] + every + text[step:end] + request + text[end:], "utf-8")
    return run_calculix(target)


def flat_displacements(deck: Deck, result: State) -> np.ndarray:
    """Our displacements in the node order of a flat deck, (n_nodes, 3) [mm]."""
    deformable = deck.problem.system
    parts = []
    for block in range(deck.assembly.n_blocks):
        group, copy = int(deformable.body_number[block]), int(deformable.copy_of[block])
        still = np.zeros_like(deck.assembly.shape(block).mesh.nodes)
        parts.append(still if group < 0 else result.displacements[group][copy])
    return np.concatenate(parts)


def slave_force(deck: Deck, result: CalculixResult, face: str, block: int) -> float:
    """Force on a slave face, Σ p A with A a quarter of the facets at each node [N]."""
    shape = deck.assembly.shape(block)
    surface = shape.surface(face)
    area = np.zeros(shape.mesh.n_nodes)
    np.add.at(area, surface.quads.ravel(), np.repeat(surface.areas / 4.0, 4))
    first = sum(deck.assembly.shape(b).mesh.n_nodes for b in range(block))
    return float((result.pressures * area[result.slave_nodes - first]).sum())


def _row(
    case: str, quantity: str, pair: tuple[float, float], tolerance: float, cpu: tuple[float, float]
) -> CheckRow:
    theirs, ours = pair
    return CheckRow(case, quantity, theirs, ours, abs(theirs / ours - 1.0), tolerance, *cpu)


def _column_rows(
    case: str, theirs: CalculixResult, deck: Deck, allowed: float = 1e-3
) -> list[CheckRow]:
    """Uniform state: only the table of the law differs, which allows 0.1 %."""
    ours = static_state(deck.problem.system)
    cpu = theirs.cpu_seconds, ours.evidence.cpu_seconds["total"]
    moved = (
        float(theirs.displacements[:, 2].min()),
        float(flat_displacements(deck, ours)[:, 2].min()),
    )
    weights = ours.points.weights
    force = slave_force(deck, theirs, "z-", 1), float((weights * ours.pressures).sum())
    return [
        _row(case, "displacement of the top [mm]", moved, allowed, cpu),
        _row(case, "contact force [N]", force, allowed, cpu),
    ]


def column_rows(folder: Path) -> list[CheckRow]:
    """The two-block column from the flat deck."""
    deck = column_deck()
    return _column_rows("column", calculix_of(deck, folder), deck)


def crossing_rows(folder: Path) -> list[CheckRow]:
    """The column whose facets do not match.

    Nodes press on facets of another mesh: the pressure varies by what a facet of edge h yields
    under it, p h / E = 3e-6 mm, a thousandth of the overclosure of 2.8e-3 mm that it comes from.
    """
    deck = crossing_deck()
    return _column_rows("column, 3 × 3 facets on 2 × 2", calculix_of(deck, folder), deck, 2e-3)


def converted_column_rows(folder: Path) -> list[CheckRow]:
    """The two-block column from the instance deck through abq2ccx."""
    deck = column_deck()
    theirs = calculix_through_converter(deck, folder)
    return _column_rows("column through abq2ccx", theirs, deck)


def tube_rows(folder: Path, divisions: SineBlockDivisions) -> list[CheckRow]:
    """One layer of the tube; tolerance: half the angle between neighbouring facets.

    CalculiX presses at nodes along the normal of one facet of the other surface, we press at
    Gauss points along the normal of the point. At a node the two normals differ by half the
    angle between neighbouring facets at most, so the forces differ by that fraction of their
    size, and with them displacements.
    """
    deck = tube_deck(divisions)
    theirs = calculix_of(deck, folder)
    deformable = deck.problem.system
    ours = static_state(deformable)
    angle = half_facet_angle(deck.assembly.shape(4), "top")
    cpu = theirs.cpu_seconds, ours.evidence.cpu_seconds["total"]
    mine = flat_displacements(deck, ours)
    largest = (
        float(np.linalg.norm(theirs.displacements, axis=1).max()),
        float(np.linalg.norm(mine, axis=1).max()),
    )
    surfaces = deformable.surfaces
    push = (surfaces.weights * ours.pressures)[:, :, None] * surfaces.normals
    below = deck.assembly.layer[surfaces.block_m] == 0
    axial = float(push[below].sum(axis=(0, 1))[2])
    frame = sum(float(theirs.reactions[f"FRAME-BOTTOM-B0{k}_ALL"][2]) for k in range(1, 5))
    case = f"tube, {divisions.around} x {divisions.radial} x {divisions.axial}"
    return [
        _row(case, "largest displacement [mm]", largest, angle, cpu),
        _row(case, "axial force on the frame [N]", (frame, axial), angle, cpu),
    ]


def bar_rows(folder: Path) -> list[CheckRow]:
    """The bar in explicit dynamics.

    CalculiX integrates by a predictor-corrector scheme of second order: with 500 steps where the
    stable limit would need 5, both schemes agree beyond the seven digits it prints.
    """
    deck = bar_deck()
    theirs = calculix_of(deck, folder)
    start, end = time.process_time(), BAR_RUN.end_time
    stated = timed_system(deck.problem.system, ramp_time=0.0, end_time=end)
    ours = run_explicit(stated, BAR_RUN)
    cpu = theirs.cpu_seconds, time.process_time() - start
    moved = float(theirs.displacements[:, 0].min()), float(ours.displacements[0][0][:, 0].min())
    return [_row("bar, explicit", "displacement of the end [mm]", moved, 5e-7, cpu)]


def converter_available() -> bool:
    """Whether abq2ccx is installed."""
    return importlib.util.find_spec("abq2ccx") is not None


def rows() -> Iterator[dict[str, object]]:
    """Every comparison; none where CalculiX is not installed."""
    if not calculix_available():
        return
    makers = [column_rows, crossing_rows]
    if converter_available():
        makers.append(converted_column_rows)
    for divisions in (SineBlockDivisions(12, 2, 2), SineBlockDivisions(24, 2, 3)):
        makers.append(partial(tube_rows, divisions=divisions))
    for make in [*makers, bar_rows]:
        with tempfile.TemporaryDirectory() as folder:
            yield from map(asdict, make(Path(folder)))
