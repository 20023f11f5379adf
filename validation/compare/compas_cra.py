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
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from geometry.families.masonry import circular_arch, running_bond_wall
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly
from mbd import classify, contact_jacobian
from mbd.friction import frictional_contacts, frictional_equilibrium
from validation.compare.closed_forms import body_force
from validation.errors import run_command
from validation.output.console import listing
from validation.output.files import prepare_picture

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
    program: str
    n_blocks: int
    n_contacts: int
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
    n_blocks, n_contacts = len(assembly.free_blocks), len(contacts.areas)
    stands = found.holds if found.holds or found.mechanism is not None else None
    proof = f"residual {found.residual:.0e}" if found.holds else "mechanism certified"
    return [
        Answer(
            problem.name,
            "tubelock, friction cone",
            n_blocks,
            n_contacts,
            stands,
            detected - start,
            solved - detected,
            proof,
        ),
        Answer(
            problem.name,
            "tubelock, frictionless class",
            n_blocks,
            n_contacts,
            None,
            0.0,
            classified - solved,
            str(mechanism),
        ),
    ]


def _faces(assembly: PolyhedralAssembly, block: int) -> tuple[FloatArray, list[list[int]]]:
    """Vertices [m] and planar polygons of a convex block."""
    shape = assembly.shape(block)
    points = assembly.points(block) / 1000.0
    faces = []
    for plane in np.unique(shape.plane_of):
        triangles = shape.triangles[shape.plane_of == plane]
        corners = np.unique(triangles)
        normal = shape.normals[shape.plane_of == plane][0]
        local = shape.points[corners] - shape.points[corners].mean(axis=0)
        u = local[0] / np.linalg.norm(local[0])
        angle = np.arctan2(local @ np.cross(normal, u), local @ u)
        faces.append(corners[np.argsort(angle)].tolist())
    return points, faces


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
                f"compas_cra, {solver}",
                len(assembly.free_blocks),
                _n_contacts(peer),
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


def _n_contacts(peer: Any) -> int:
    return sum(len(interface.points) for interface in _interfaces(peer))


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


def print_answers(answers: list[Answer], console: Console) -> None:
    """Print a table of verdicts and CPU times."""
    heads = ("problem", "theory", "program", "blocks, contacts", "stands")
    title = "Walls and arches under their weight"
    table = listing(title, *heads, "detect [s]", "solve [s]", "note")
    theory = {problem.name: problem.stands for problem in problems()}
    words = {True: "yes", False: "no", None: "–"}
    for a in answers:
        table.add_row(
            a.problem,
            words[theory[a.problem]],
            a.program,
            f"{a.n_blocks}, {a.n_contacts}",
            words[a.stands],
            f"{a.detection_seconds:.3f}",
            f"{a.solve_seconds:.3f}",
            a.note,
        )
    console.print(table)


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


def main(
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.png", help="Picture of times.")
    ] = None,
) -> None:
    """Compare with compas_cra."""
    if output is not None:
        prepare_picture(output)
    console = Console(width=150)
    installed = importlib.util.find_spec("compas_cra") is not None
    if not installed:
        console.print("compas_cra is not installed (pip install compas_cra): ours alone")
    answers = compare(with_peer=installed)
    print_answers(answers, console)
    if output is not None:
        draw_times(answers, output)
        console.print(f"picture   {output}")


if __name__ == "__main__":
    run_command(lambda: typer.run(main))
