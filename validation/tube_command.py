"""`tubelock fem` on a tube: checks, progress, checkpoint, files and text around a run."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from fem.deformable_assembly import DeformableAssembly
from fem.explicit import ExplicitResult, Frame
from geometry.mesh import FloatArray, QuadSurface
from geometry.mesh_io import write_hex_mesh, write_surface
from validation.auto_effects import EffectsDecision, decide_effects, decision_table
from validation.cell_error import cell_table, offer_words, offered_cell, probed_cell_error
from validation.fem_box import peak_memory_mb
from validation.fem_command import CHECKPOINT, check_finished, progress_bar, refuse_resume
from validation.fem_files import (
    FrameWriter,
    draw_energies,
    field_data,
    groups_mesh,
    point_data,
)
from validation.files import output_folder, prepare_json, write_json, write_whole
from validation.periodic_cell import is_cell
from validation.scene import DeformableScene
from validation.scene_fem import Method
from validation.tube_explicit import (
    ExplicitStatement,
    explicit_statement,
    run_tube_explicit,
)
from validation.tube_fem import TubeRun, build_deformable, fem_section, tube_json


def run_fem_tube(
    name: str,
    scene: DeformableScene,
    *,
    json: str | None,
    output: Path | None,
    resume: Path | None,
    console: Console,
) -> None:
    """Solve a tube and write what the command promises.

    Raises
    ------
    InputError
        For a scene that cannot be solved.
    KeyboardInterrupt
        After an interrupted run has said how to go on.
    """
    scene, decision = decided(scene, name, console)
    fem = fem_section(scene, name)
    if fem.method is Method.STATIC:
        refuse_resume(resume)
    start = time.process_time()
    deformable = build_deformable(scene, name)
    statement = None
    if fem.method is Method.EXPLICIT:
        statement = explicit_statement(scene, name, deformable)
    built = time.process_time() - start
    error = None
    if is_cell(scene):
        error = probed_cell_error(scene, name)
        console.print(cell_table(name, error))
    prepare_json(json)
    folder = Path("out") / f"{name}-fem" if output is None and json is None else output
    with output_folder(folder):
        run, result = _solve(
            name, scene, deformable, statement, folder=folder, resume=resume, console=console
        )
        seconds = run.cpu_seconds
        added = {"build": seconds["build"] + built, "total": seconds["total"] + built}
        run = replace(run, cpu_seconds=seconds | added)
        if decision is not None:
            run = replace(run, solver=run.solver | {"effects_decision": decision.as_json()})
        if error is not None:
            run = replace(run, solver=run.solver | {"periodic_cell": error.as_json()})
        print_tube(run, console)
        if folder is not None:
            for words, path in write_tube_files(run, result, folder):
                console.print(f"{words:9} {path}")
            (folder / CHECKPOINT).unlink(missing_ok=True)
        write_json(json, tube_json(run, peak_memory_mb()))


def decided(
    scene: DeformableScene, name: str, console: Console
) -> tuple[DeformableScene, EffectsDecision | None]:
    """Scene with the effects that matter, and the decision, where it asks for one; printed.

    Raises
    ------
    InputError
        A probe that has no solution.
    """
    if scene.effects.auto is None:
        return scene, None
    with console.status(f"{name}: which effects matter") as status:
        scene, decision = decide_effects(
            scene, name, told=lambda what: status.update(f"{name}: {what}")
        )
    console.print(decision_table(name, decision))
    offer = offered_cell(scene, name)
    if offer is not None:
        console.print(offer_words(offer))
    return scene, decision


def _add_slip(table: Table, slip: dict[str, float] | None) -> None:
    """Add the largest slip, with what to do where facets that stay paired have left each other."""
    if slip is None:
        return
    share = slip["largest"] / slip["facet_size"]
    words = f"{slip['largest']:.3g} mm, {share:.2g} of the size of its facet"
    if share > 1.0:
        words += (
            "\nNOT VALID: facets stay paired as built, but blocks slide by more than one;\n"
            'set effects.finite_sliding = true and fem.method = "explicit"'
        )
    table.add_row("largest slip", words)


def _solve(
    name: str,
    scene: DeformableScene,
    deformable: DeformableAssembly,
    statement: ExplicitStatement | None,
    *,
    folder: Path | None,
    resume: Path | None,
    console: Console,
) -> tuple[TubeRun, ExplicitResult | None]:
    """Solve by the scene's method; an interrupted run says how to go on."""
    fem = fem_section(scene, name)
    if fem.method is Method.STATIC:
        from validation.tube_static import run_tube_static

        with console.status(f"{name}: static Newton"):
            return run_tube_static(name, scene, deformable=deformable), None
    checkpoint = None if folder is None else folder / CHECKPOINT
    writer = None
    if folder is not None and fem.frames > 0:
        finite = scene.effects.finite_rotation
        writer = FrameWriter(folder, deformable.model.groups, finite_rotation=finite)

    def frame(time: float, number: int, displacements: tuple[FloatArray, ...]) -> None:
        assert writer is not None
        writer(Frame(number, time, displacements))

    with progress_bar() as progress:
        run, result = run_tube_explicit(
            name,
            scene,
            deformable=deformable,
            statement=statement,
            progress=progress,
            on_frame=None if writer is None else frame,
            checkpoint=checkpoint,
            resume=resume,
        )
    check_finished(result, checkpoint, console)
    return run, result


def write_tube_files(
    run: TubeRun, result: ExplicitResult | None, folder: Path
) -> list[tuple[str, Path]]:
    """Write fields, contact pressures, history and pictures; returns what each file is."""
    groups = run.deformable.model.groups
    fields = folder / "fields.vtu"
    finite = run.scene.effects.finite_rotation
    data = field_data(groups, run.displacements, finite_rotation=finite)
    points = point_data(groups, run.displacements, finite_rotation=finite)
    write_hex_mesh(fields, groups_mesh(groups), point_data=data, cell_data=points)
    contact = folder / "contact_pressures.vtu"
    found = run.contact_state
    quads = np.arange(4 * found.n_facets).reshape(-1, 4)
    write_surface(
        contact,
        QuadSurface(found.corners.reshape(-1, 3), quads),
        {
            "contact_pressure": found.pressures,
            "area": found.areas,
            "block_m": found.block_m.astype(np.int32),
            "block_s": found.block_s.astype(np.int32),
        },
    )
    written = [("fields", fields), ("pressures", contact)]
    for file, draw in _pictures(run).items():
        draw(run, folder / file)
        written.append(("picture", folder / file))
    if result is not None:
        history, energies = folder / "history.csv", folder / "energies.png"
        write_whole(history, lambda path: path.write_text(result.history.csv(), "utf-8"))
        draw_energies(result.history, energies, title=run.name)
        written += [("history", history), ("picture", energies)]
        if (folder / "frames.pvd").exists():
            written.append(("frames", folder / "frames.pvd"))
    return written


def _pictures(run: TubeRun) -> dict[str, Callable[[TubeRun, Path], None]]:
    """Pictures of a run: those of the paper for a tube, surfaces and joints for other blocks."""
    from validation import block_pictures, tube_pictures

    if not run.is_tube:
        return {
            "contact_pressures.png": block_pictures.draw_block_contact,
            "stresses.png": block_pictures.draw_block_stresses,
        }
    return {
        "contact_pressures.png": tube_pictures.draw_contact,
        "stresses.png": tube_pictures.draw_stresses,
        "sections.png": tube_pictures.draw_sections,
        "displacement.png": tube_pictures.draw_displacement,
    }


def print_tube(run: TubeRun, console: Console) -> None:
    """Print the numbers of a tube run."""
    data = tube_json(run, peak_memory_mb())
    table = Table(title=run.title, show_header=False, title_justify="left")
    table.add_column()
    table.add_column()
    element = run.deformable.model.groups[0].element.value
    table.add_row("method, element", f"{run.method}, {element}")
    table.add_row(
        "blocks, elements, nodes",
        f"{data['n_blocks']} deformable, {data['n_elements']}, {data['n_nodes']}",
    )
    if run.method is Method.EXPLICIT:
        rate = data["element_updates_per_cpu_second"] / 1e6
        table.add_row(
            "steps, time step",
            f"{data['n_steps']} to {1e3 * data['time']:.4g} ms ({data['status']}), "
            f"{data['time_step']:.4g} s (critical {data['critical_time_step']:.4g} s)",
        )
        if run.scene.fem is not None and run.scene.fem.mass_scaling is not None:
            share = 100 * data["added_mass"]
            table.add_row("mass scaling", f"{share:.3g} % more mass; it does not change the end")
        table.add_row("element updates", f"{rate:.3g} million per CPU second")
        state = data["quasi_static"]
        table.add_row(
            "ramp, hold",
            f"{1e3 * state['ramp_time']:.4g} ms, {1e3 * state['hold_time']:.4g} ms "
            f"(lowest excited frequency {data['recommended']['frequency']:.3g} Hz)",
        )
        table.add_row(
            "kinetic / internal energy",
            f"{state['kinetic_over_internal_energy']:.2e} (small is necessary, not sufficient)",
        )
        table.add_row(
            "velocity (rms), way to go",
            f"{state['velocity_norm']:.3g} mm/s, {100 * state['settling']:.2g} %",
        )
        table.add_row("verdict", state["verdict"])
        table.add_row("energy balance", f"{data['energy_balance']:.2e}")
    else:
        table.add_row("Newton iterations", f"{data['newton_iterations']}")
    if data["residual"] is not None:
        table.add_row("force residual", f"{data['residual']:.2e}")
    table.add_row("largest displacement", f"{data['max_displacement']:.6g} mm")
    stress = data["principal_stress"]
    table.add_row("principal stress", f"{stress['max']:.5g} … {stress['min']:.5g} MPa")
    contact = data["contact"]
    table.add_row("contact search", data["contact_search"])
    _add_slip(table, data["slip"])
    table.add_row("p_eff", f"{contact['p_eff']:.5g} MPa mean of the effective elements")
    table.add_row(
        "p_max",
        f"{contact['p_max_face']:.5g} MPa mean of block maxima (facets), "
        f"{contact['p_max_point']:.5g} MPa at a point",
    )
    table.add_row("effective contact elements", f"{contact['effective_count_percent']:.2f} %")
    table.add_row("mean overclosure", f"{contact['mean_overclosure']:.4g} mm where surfaces press")
    seconds = ", ".join(f"{k} {v:.3f}" for k, v in data["cpu_seconds"].items())
    table.add_row("CPU seconds", seconds)
    table.add_row("peak memory", f"{data['peak_memory_mb']:.0f} MB")
    console.print(table)
