"""What a deformable run leaves: fields for ParaView, history, pictures, and its numbers as text."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from fem.accuracy.parts import MeshFacets, StaticReference
from fem.measures import contact_on
from fem.system.state import CapAction
from fem.system.time_step import added_mass_share
from geometry.answer import PAPER, Answer, Measure, measure_rows
from geometry.machine.system import write_whole
from geometry.parts.measures import SectionForces
from validation.output import answer_files
from validation.output.console import add_dimensions, cpu_words, listing, two_columns
from validation.output.deformable.cell import cell_table
from validation.output.deformable.fields import FRAMES
from validation.output.files import write_csv
from validation.output.forces import (
    JOINT_FILES,
    SECTION_FILES,
    add_reactions,
    write_joints,
    write_sections,
)
from validation.output.outputs import Outputs
from validation.output.pictures import tubes
from validation.output.pictures.directions import draw_directions
from validation.output.pictures.energies import draw_energies
from validation.output.pictures.motions import draw_motions
from validation.run.cell import CellError
from validation.scene.family import RoundScene
from validation.scene.polyhedra import PolyhedralScene
from validation.solving import solve

if TYPE_CHECKING:
    from fem.explicit.output.energy import History
    from fem.explicit.solve import ExplicitResult
    from fem.system.reactions import PushCurve

#: Measures that answer what is asked first: pressure, tension, displacement.
_FIRST = ("p_max_point", "sigma_1_averaged", "max_displacement")
#: Files of a run.
FILES = (
    *answer_files.FILES,
    "contact_pressures.png",
    "stresses.png",
    "principal_stresses.png",
    "sections.png",
    "displacement.png",
    *JOINT_FILES,
    *SECTION_FILES,
    "motions.csv",
    "motions.png",
    "history.csv",
    "energies.png",
    FRAMES,
    "frames.pvd",
)


def write_run_files(answer: Answer, outputs: Outputs) -> None:
    """Write joints, pictures and history beside the answer; nothing without a folder."""
    if answer.details.deformable.meets:
        write_joints(answer.details.joints, outputs, answer.details.deformable.assembly.names)
    sections = answer.parts.get("sections")
    write_sections(sections if isinstance(sections, SectionForces) else None, outputs)
    for file, draw in run_pictures(answer).items():
        outputs.write("picture", file, partial(draw, answer))
    if answer.details.push_curves:
        _write_motions(answer, outputs)
    if answer.details.explicit is not None:
        _write_history(answer.details.explicit.history, answer.title, outputs)
    if answer.case.scene.fem.frames > 0 and outputs.folder is not None:
        outputs.path(FRAMES)
        outputs.say("frames", outputs.path("frames.pvd"))


def run_pictures(answer: Answer) -> dict[str, Callable[[Answer, Path], None]]:
    """Pictures of a state; sections and the view along an axis are those of tubes."""
    pictures: dict[str, Callable[[Answer, Path], None]] = {}
    if answer.details.deformable.meets:
        pictures["contact_pressures.png"] = tubes.draw_contact
    pictures["stresses.png"] = tubes.draw_stresses
    if answer.case.scene.pictures.arrows:
        pictures["principal_stresses.png"] = draw_directions
    if isinstance(answer.case.scene, RoundScene):
        pictures["sections.png"] = tubes.draw_sections
        pictures["displacement.png"] = tubes.draw_displacement
    return pictures


def _write_motions(answer: Answer, outputs: Outputs) -> None:
    """Write force against displacement of supports that move, next to the rigid limit."""
    curves, limit = answer.details.push_curves, _rigid_limit(answer)
    rows = [
        (curve.name, *row)
        for curve in curves
        for row in zip(curve.times, curve.displacements, curve.forces, strict=True)
    ]
    heads = ("support", "time_s", "displacement_mm", "force_N")
    outputs.write("motions", "motions.csv", lambda path: write_csv(path, heads, rows))
    outputs.write(
        "picture",
        "motions.png",
        lambda path: draw_motions(curves, path, title=answer.title, limit=limit),
    )


def _rigid_limit(answer: Answer) -> float | None:
    """Limit of the push of a scene with associated friction [N]; None where there is none."""
    if answer.case.scene.push is None:
        return None
    push = solve(answer.case.with_method("rigid")).parts["push_limit"]
    return push.associated  # type: ignore[attr-defined]


def _write_history(history: History, title: str, outputs: Outputs) -> None:
    """Write energies over time as table and picture."""

    def table(path: Path) -> None:
        write_whole(path, lambda partial: partial.write_text(history.csv(), "utf-8"))

    outputs.write("history", "history.csv", table)
    outputs.write("picture", "energies.png", lambda path: draw_energies(history, path, title=title))


def _add_slip(table: Table, slip: dict[str, float] | None) -> None:
    """Add the largest slip, with the remedy where it exceeds the facets of fixed contact pairs."""
    if slip is None:
        return
    share = slip["largest"] / slip["facet_size"]
    words = f"{slip['largest']:.3g} mm, {share:.2g} of the facet size"
    if share > 1.0:
        words += (
            "\nNOT VALID: the slip exceeds one facet, and the contact pairs are fixed;\n"
            "set effects.finite_sliding = true"
        )
    table.add_row("largest slip", words)


def _add_motion(table: Table, answer: Answer) -> None:
    """Add motions that are counted as small and are not, and those that nothing determines."""
    share = answer.details.large_motion
    if share is not None:
        small = {
            "finite_sliding": not answer.details.deformable.contact.finite_sliding,
            "finite_rotation": answer.details.turns_as_small,
        }
        missing = " and ".join(
            f"effects.{name} = true" for name, counted in small.items() if counted
        )
        what = "contacts" if not answer.details.turns_as_small else "contacts or rotations"
        table.add_row(
            "large motion",
            f"blocks move by {100 * share:.2g} % of their size, but {what} are "
            f"those of small motions: expect errors of this order; set {missing}",
        )
    loose = answer.details.loose_blocks.tolist()
    if loose:
        table.add_row(
            "unrestrained blocks",
            f"{', '.join(map(str, loose))}: no contact holds them in every direction. Pressures "
            "are determined, the positions of these blocks are not",
        )


def _add_supports(table: Table, answer: Answer) -> None:
    """Add the force of each support on the blocks, and how far supports moved."""
    static = answer.details.static
    add_reactions(table, answer.report)
    words = [_curve_words(curve) for curve in answer.details.push_curves]
    if not answer.details.reached:
        stopped = "the run ended before supports that move arrived: raise fem.end_time"
        words.insert(0, stopped if static is None else static.status)
    if any(words):
        table.add_row("motion", "; ".join(filter(None, words)))


def _curve_words(curve: PushCurve) -> str:
    """After which displacement nothing resists a support that moves; empty where something does."""
    if curve.free_after is None:
        return ""
    return f"nothing resists {curve.name}" + (
        f" after {curve.free_after:.4g} mm" if curve.free_after else ""
    )


def print_run(answer: Answer, console: Console) -> None:
    """Print the result of a run, its evidence, and how it was computed."""
    table = two_columns(answer.title)
    if verdict := _verdict(answer):
        table.add_row("verdict", verdict)
    measures = {name: m for name, m in answer.measures.items() if name not in PAPER}
    governing = {name: m for name, m in measures.items() if name in _FIRST and m.is_number}
    others = {name: m for name, m in measures.items() if name not in governing}
    own = isinstance(answer.case.scene, PolyhedralScene)
    add_measures(table, governing)
    if own:
        _add_supports(table, answer)
    add_measures(table, others)
    if not own:
        _add_supports(table, answer)
    _add_motion(table, answer)
    if measures and not any(m.error is not None for m in answer.measures.values()):
        table.add_row("error bars", _why_no_bars(answer))
    _add_part(table, answer, "sections")
    table.add_section()
    _add_part(table, answer, "accuracy")
    if answer.details.deformable.meets:
        _add_contact(table, answer)
    if answer.details.explicit is not None:
        _add_explicit(table, answer, answer.details.explicit)
    if answer.details.explicit is not None and answer.details.residual is not None:
        table.add_row("force residual", f"{answer.details.residual:.2e}")
    _add_part(table, answer, "notes")
    deformable = answer.details.deformable
    model = deformable.model
    table.add_section()
    add_dimensions(table, answer.report["dimensions"], answer.case.scene.limits)
    table.add_row("assumptions", "; ".join(answer.report["assumptions"]))
    table.add_row("method, element", f"{answer.method}, {model.groups[0].element.words}")
    table.add_row(
        "blocks, elements, nodes",
        f"{len(deformable.deformable_blocks)} deformable, {model.n_elements}, {model.n_nodes}",
    )
    _add_part(table, answer, "meshes")
    table.add_row("CPU seconds", cpu_words(answer.report["cpu_seconds"]))
    console.print(table)
    cell = answer.parts.get("periodic_cell")
    if isinstance(cell, CellError):
        console.print(cell_table(cell.name, cell.found))
    reference = answer.parts.get("static_reference")
    if isinstance(reference, StaticReference):
        _print_reference(answer, reference, console)


def _verdict(answer: Answer) -> str:
    """Whether the state is one of equilibrium; empty for motions that are none."""
    if answer.details.static is not None:
        return str(answer.details.static.status)
    state = answer.details.quasi_static
    return "" if state is None or answer.details.statement.recommended is None else state.verdict


def _why_no_bars(answer: Answer) -> str:
    """Why no value has an error bar, and what gives them one."""
    limit = answer.report.get("work", {}).get("stopped_by")
    if limit is not None:
        return f"none: the limit of {limit} ended the run before the meshes that they need"
    if not answer.case.method.error_estimate:
        return "none: fem.error_estimate = false"
    return "none of this kind of run"


def _add_part(table: Table, answer: Answer, name: str) -> None:
    """Add the rows of a part; nothing where the answer has none of that name."""
    part = answer.parts.get(name)
    for title, words in () if part is None else part.rows:
        table.add_row(title, words)


def _print_reference(answer: Answer, found: StaticReference, console: Console) -> None:
    """Print each value of an explicit run beside the converged one, and the two kinds of error."""
    if found.why_not:
        console.print(f"no converged static state to compare with: {found.why_not}")
        return
    heads = ("this mesh", "converged static state", "discretisation error")
    table = listing(
        f"{answer.case.name}: this mesh and the converged static state", "", numbers=heads
    )
    for row in found.compared:
        table.add_row(*row)
    console.print(table)
    state = answer.details.quasi_static
    left = "" if state is None else f", remaining displacement {100 * state.settling:.2g} %"
    console.print(
        "distance to the static state of this mesh: force residual "
        f"{answer.details.residual or 0.0:.1e}{left}"
    )


def _add_explicit(table: Table, answer: Answer, result: ExplicitResult) -> None:
    """Print the steps of an explicit run, and how close to static its end is."""
    stated, state = answer.details.statement, answer.details.quasi_static
    assert stated is not None
    table.add_row(
        "steps, time step",
        f"{result.n_steps} to {1e3 * result.time:.4g} ms ({result.status}), "
        f"{result.time_step:.4g} s (critical {result.critical.critical_time_step:.4g} s)",
    )
    if answer.details.restarts:
        table.add_row(
            "restarts",
            f"{answer.details.restarts}: the contact stiffness exceeded the limit of the time step;"
            " the run restarted with a shorter one; set contact.maximum_stiffness or fem.time_step",
        )
    if answer.case.scene.fem.mass_scaling is not None:
        share = 100 * added_mass_share(stated.model)
        table.add_row(
            "mass scaling", f"{share:.3g} % more mass; the static state does not depend on it"
        )
    rate = result.element_updates_per_cpu_second / 1e6
    table.add_row("element updates", f"{rate:.3g} million per CPU second")
    if state is not None and stated.recommended is not None:
        table.add_row(
            "ramp, hold",
            f"{1e3 * state.ramp_time:.4g} ms, {1e3 * state.hold_time:.4g} ms "
            f"(lowest excited frequency {stated.recommended.frequency:.3g} Hz)",
        )
        table.add_row(
            "kinetic / internal energy",
            f"{state.kinetic_over_internal_energy:.2e} (small is necessary, not sufficient)",
        )
        table.add_row(
            "rms velocity, remaining displacement",
            f"{state.velocity_norm:.3g} mm/s, {100 * state.settling:.2g} %",
        )
    elif result.energies is not None:
        values = asdict(result.energies).items()
        shown = [f"{key.replace('_', ' ')} {value:.5g}" for key, value in values if value != 0.0]
        table.add_row("energies [N mm]", ", ".join(shown) or "all zero")
    table.add_row("energy balance", f"{result.energy_balance:.2e}")
    if answer.details.released_at_start is not None:
        table.add_row("start", _start_words(answer.details.released_at_start))


def _add_contact(table: Table, answer: Answer) -> None:
    """Print the rows of contact."""
    facets = answer.parts.get("facets")
    _add_part(table, answer, "facets")
    table.add_row("contact search", answer.report["contact_search"])
    _add_part(table, answer, "friction")
    _add_slip(table, answer.details.slip)
    contact = contact_on(answer.details, facets.of if isinstance(facets, MeshFacets) else None)
    if answer.details.cap is not None:
        table.add_row("contact stiffness cap", cap_words(answer.details.cap))
    overclosure = contact.mean_overclosure
    table.add_row("mean penetration", f"{overclosure:.4g} mm over the closed contacts")
    if not isinstance(answer.case.scene, PolyhedralScene):
        table.add_section()
        table.add_row("the paper's measures", "means over facets and blocks")
        measures = answer.measures
        add_measures(table, {name: measures[name] for name in PAPER if name in measures})
        table.add_row("p_eff over all blocks (tables)", f"{contact.p_eff_pooled:.5g} MPa")
        table.add_row("effective contact elements", f"{contact.effective_count_percent:.2f} %")
        table.add_section()


def _start_words(share: float) -> str:
    """The work of the contact law before any load acts, and why the energy balance shows it."""
    return (
        f"impulsive: the contact pressure at zero clearance does {share:.3g} times the work of the "
        "loads before these act. The energy balance shows the resulting error in time (it falls "
        "with fem.safety_factor); a static run starts at rest"
    )


def add_measures(table: Table, found: Mapping[str, Measure]) -> None:
    """Print each measure with its error and its place."""
    for title, words in measure_rows(found):
        table.add_row(title, words)


def cap_words(cap: CapAction) -> str:
    """Where a maximum stiffness acted, in words."""
    if not cap.points:
        return f"{cap.maximum_stiffness:g} MPa/mm above {cap.pressure:.3g} MPa: reached nowhere"
    return (
        f"{cap.maximum_stiffness:g} MPa/mm above {cap.pressure:.3g} MPa: reached at {cap.points} "
        f"of {cap.pressing_points} closed contact points, {100 * cap.force_share:.3g} % of the "
        "force"
    )
