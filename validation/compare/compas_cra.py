"""The same walls and arches through compas_cra (Kao et al. 2022): verdicts and times side by side.

``python -m validation.compare.compas_cra`` needs ``pip install compas_cra``; without it ours are
timed alone. compas_cra's contact detection has absolute tolerances, so it gets metres, and its
largest number of neighbours is set to what the assembly has, or it would lose contacts.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from geometry.families.masonry import circular_arch, running_bond_wall
from geometry.files.hexahedral_solids import flat_side
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly
from mbd import classify, contact_jacobian
from mbd.friction import frictional_contacts, frictional_equilibrium
from validation.compare.closed_forms import body_force
from validation.errors import run_command
from validation.output.console import measuring, tabled
from validation.output.files import write_json

#: compas_cra's RBE lets joints pull at a price; a pull above this part of the largest force says
#: that the assembly does not stand.
_TENSION = 1e-4


@dataclass(frozen=True)
class Problem:
    """An assembly under its weight with friction."""

    name: str
    build: Callable[[], PolyhedralAssembly]
    friction: float
    stands: bool
    """What theory says."""


@dataclass(frozen=True)
class Answer:
    """What one program said, and its CPU time."""

    problem: str
    theory: bool
    """Whether it stands, by theory."""
    n_blocks: int
    n_contacts: int
    program: str
    stands: bool | None
    """None where it gave no answer."""
    detection_seconds: float
    solve_seconds: float
    note: str


def problems() -> list[Problem]:
    """Walls that grow, and arches on both sides of the limit t/R = 0.1075."""
    brick = (240.0, 115.0, 71.0)
    rows = [
        Problem(f"wall {n} × {n}", partial(running_bond_wall, brick, n, n), 0.6, True)
        for n in (3, 5, 8, 12, 16)
    ]
    for ratio, stands in ((0.12, True), (0.10, False)):
        arch = partial(circular_arch, 1000.0, 1000.0 * ratio, 300.0, 20, pieces=1)
        rows.append(Problem(f"arch t/R = {ratio}", arch, 1.0, stands))
    return rows


def ours(problem: Problem) -> list[Answer]:
    """Frictionless mechanism class and equilibrium with friction, certified."""
    assembly = problem.build()
    start = time.process_time()
    contacts = contact_jacobian(assembly)
    detected = time.process_time()
    load = body_force(assembly, np.array([0.0, 0.0, -1.0]))
    found = frictional_equilibrium(frictional_contacts(assembly, contacts, problem.friction), load)
    solved = time.process_time()
    mechanism = classify(contacts.jacobian, load).mechanism
    classified = time.process_time()
    said = partial(
        Answer, problem.name, problem.stands, len(assembly.free_blocks), len(contacts.areas)
    )
    stands = found.holds if found.holds or found.mechanism is not None else None
    proof = f"residual {found.residual:.0e}" if found.holds else "mechanism certified"
    return [
        said("tubelock, friction cone", stands, detected - start, solved - detected, proof),
        said("tubelock, frictionless class", None, 0.0, classified - solved, str(mechanism)),
    ]


def _faces(assembly: PolyhedralAssembly, block: int) -> tuple[FloatArray, list[list[int]]]:
    """Vertices [m] and planar polygons of a convex block."""
    shape = assembly.shape(block)
    faces = [flat_side(shape, plane) for plane in np.unique(shape.plane_of).tolist()]
    return assembly.points(block) / 1000.0, faces


def compas_answers(problem: Problem, solvers: tuple[str, ...] = ("rbe", "cra")) -> list[Answer]:
    """Rigid-block equilibrium (rbe) and coupled rigid-block analysis (cra) of compas_cra."""
    from compas_assembly.datastructures import Block
    from compas_cra import equilibrium
    from compas_cra.algorithms import assembly_interfaces_numpy
    from compas_cra.datastructures import CRA_Assembly

    assembly = problem.build()
    answers = []
    for solver in solvers:
        peer = CRA_Assembly()
        for block in range(assembly.n_blocks):
            vertices, faces = _faces(assembly, block)
            peer.add_block(Block.from_vertices_and_faces(vertices.tolist(), faces), node=block)
        peer.set_boundary_conditions(np.flatnonzero(assembly.fixed).tolist())
        start = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):
            assembly_interfaces_numpy(peer, nmax=assembly.n_blocks, tmax=1e-6, amin=1e-6)
        detected = time.process_time()
        stands, note = _solve(getattr(equilibrium, f"{solver}_solve"), peer, problem.friction)
        answers.append(
            Answer(
                problem.name,
                problem.stands,
                len(assembly.free_blocks),
                sum(len(interface.points) for interface in _interfaces(peer)),
                f"compas_cra, {solver}",
                stands,
                detected - start,
                time.process_time() - detected,
                note,
            )
        )
    return answers


def _interfaces(peer: Any) -> list[Any]:
    return [
        interface
        for edge in peer.graph.edges()
        for interface in peer.graph.edge_attribute(edge, "interfaces")
    ]


def _solve(solve: Callable[..., Any], peer: Any, friction: float) -> tuple[bool, str]:
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            solve(peer, mu=friction, density=1.0)
    except ValueError as error:
        return False, str(error)
    forces = [force for interface in _interfaces(peer) for force in interface.forces]
    push = max(abs(force["c_np"]) for force in forces)
    pull = max(abs(force["c_nn"]) for force in forces)
    note = f"solved, largest pull {pull / push:.0e} of the largest push" if pull else "solved"
    return pull <= _TENSION * push, note


def compare(*, with_peer: bool) -> list[Answer]:
    """Every problem through every program."""
    answers = []
    ours(problems()[0])  # compiled loops are loaded before anything is timed
    for problem in problems():
        answers += ours(problem)
        if with_peer:
            answers += compas_answers(problem)
    return answers


_WORDS = {True: "yes", False: "no", None: "–"}
_COLUMNS: dict[str, Callable[[Answer], str]] = {
    "problem": lambda a: a.problem,
    "theory": lambda a: _WORDS[a.theory],
    "program": lambda a: a.program,
    "blocks, contacts": lambda a: f"{a.n_blocks}, {a.n_contacts}",
    "stands": lambda a: _WORDS[a.stands],
    "detect [s]": lambda a: f"{a.detection_seconds:.3f}",
    "solve [s]": lambda a: f"{a.solve_seconds:.3f}",
    "note": lambda a: a.note,
}


def draw_times(answers: list[Answer], path: Path) -> None:
    """Draw CPU time against the number of contact points."""
    from validation.output.pictures.gallery import OF_LINES, save_figure, subplots

    blue, orange, green, vermilion = OF_LINES
    programs = dict.fromkeys(a.program for a in answers)
    colours = dict(zip(programs, (blue, green, orange, vermilion), strict=False))
    figure, axes = subplots(1, 1, size=(8, 5.5))
    for program, colour in colours.items():
        rows = [a for a in answers if a.program == program and a.problem.startswith("wall")]
        x = [a.n_contacts for a in rows]
        axes.loglog(x, [a.solve_seconds for a in rows], "o-", color=colour, label=program)
        if any(a.detection_seconds for a in rows):
            axes.loglog(
                x,
                [a.detection_seconds for a in rows],
                ":",
                color=colour,
                label=f"{program.split(',')[0]}: finding the contacts",
            )
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    axes.legend(unique.values(), unique.keys(), frameon=False, fontsize=9)
    axes.set_xlabel("contact points")
    axes.set_ylabel("CPU time on one core [s]")
    axes.set_title("Brick walls: time against the number of contacts", loc="left", fontsize=12)
    axes.spines[["top", "right"]].set_visible(False)
    save_figure(figure, path)


def main() -> None:
    """Compare with compas_cra."""
    asked, console = measuring(__doc__, 150, picture="picture of times")
    installed = importlib.util.find_spec("compas_cra") is not None
    if not installed:
        console.print("compas_cra is not installed (pip install compas_cra): ours alone")
    answers = compare(with_peer=installed)
    title = "Walls and arches under their weight"
    console.print(tabled(title, answers, _COLUMNS, words=len(_COLUMNS)))
    write_json(asked.json, [asdict(answer) for answer in answers])
    if asked.output is not None:
        draw_times(answers, asked.output)
        console.print(f"picture   {asked.output}")


if __name__ == "__main__":
    run_command(main)
