"""What a deformable run leaves: fields for ParaView, history, pictures, and its numbers as text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from fem.accuracy.parts import MeshFacets
from fem.measures import contact_on
from fem.system.state import CapAction
from geometry.answer import PAPER, Answer, measure_rows
from geometry.machine.system import write_whole
from geometry.parts.measures import SectionForces
from geometry.parts.rows import Row, number
from validation.output import answer_files
from validation.output.console import RowTable, cpu_row, dimension_rows, part_rows
from validation.output.deformable.fields import FRAMES
from validation.output.files import write_csv
from validation.output.forces import (
    JOINT_FILES,
    SECTION_FILES,
    support_rows,
    write_joints,
    write_sections,
)
from validation.output.outputs import Outputs
from validation.scene.family import RoundScene
from validation.scene.polyhedra import PolyhedralScene
from validation.solving import solve

if TYPE_CHECKING:
    from fem.explicit.output.energy import History
    from fem.explicit.solve import Run
    from fem.system.reactions import PushCurve

#: Measures that answer what is asked first: pressure, tension, displacement.
_FIRST = ("p_max_point", "sigma_1_averaged", "max_displacement")
#: Files of a run.
FILES = (
    *answer_files.FILES,
    "contact_pressures.png",
    "stresses.png",
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
    if outputs.folder is None:
        return
    if answer.details.deformable.meets:
        write_joints(answer.details.joints, outputs, answer.details.deformable.assembly.names)
    sections = answer.parts.get("sections")
    write_sections(sections if isinstance(sections, SectionForces) else None, outputs)
    for file, draw in run_pictures(answer).items():
        outputs.write("picture", file, partial(draw, answer))
    if answer.details.push_curves:
        _write_motions(answer, outputs)
    if answer.details.run is not None:
        _write_history(answer.details.run.history, answer.title, outputs)
    if answer.case.scene.fem.frames > 0:
        outputs.path(FRAMES)
        outputs.say("frames", outputs.path("frames.pvd"))


def run_pictures(answer: Answer) -> dict[str, Callable[[Answer, Path], None]]:
    """Pictures of a state; sections and the view along an axis are those of tubes."""
    from validation.output.pictures import tubes

    pictures: dict[str, Callable[[Answer, Path], None]] = {}
    if answer.details.deformable.meets:
        pictures["contact_pressures.png"] = tubes.draw_contact
    pictures["stresses.png"] = tubes.draw_stresses
    if isinstance(answer.case.scene, RoundScene):
        pictures["sections.png"] = tubes.draw_sections
        pictures["displacement.png"] = tubes.draw_displacement
    return pictures


def _write_motions(answer: Answer, outputs: Outputs) -> None:
    """Write force against displacement of supports that move, next to the rigid limit."""
    from validation.output.pictures.motions import draw_motions

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
    from validation.output.pictures.energies import draw_energies

    def table(path: Path) -> None:
        write_whole(path, lambda partial: partial.write_text(history.csv(), "utf-8"))

    outputs.write("history", "history.csv", table)
    outputs.write("picture", "energies.png", lambda path: draw_energies(history, path, title=title))


def run_table(answer: Answer) -> RowTable:
    """Result of a run, its evidence, and how it was computed."""
    details, parts = answer.details, partial(part_rows, answer)
    measures = {name: m for name, m in answer.measures.items() if name not in PAPER}
    governing = {name: m for name, m in measures.items() if name in _FIRST and m.is_number}
    others = {name: m for name, m in measures.items() if name not in governing}
    first = [Row("verdict", verdict)] if (verdict := _verdict(answer)) else []
    first += measure_rows(governing)
    own = isinstance(answer.case.scene, PolyhedralScene)
    of_supports, rest = _support_rows(answer), measure_rows(others)
    first += [*of_supports, *rest] if own else [*rest, *of_supports]
    first += _motion_rows(answer)
    if measures and not any(m.error is not None for m in answer.measures.values()):
        first.append(Row("error bars", _why_no_bars(answer)))
    first += parts("sections")
    evidence, paper = parts("accuracy"), list[Row]()
    if details.deformable.meets:
        contact, paper = _contact_rows(answer)
        evidence += contact
    beside = list[Row]()
    if details.run is not None:
        beside += _explicit_rows(answer, details.run)
        if details.residual is not None:
            beside.append(Row("force residual", f"{details.residual:.2e}", details.residual))
    beside += parts("notes")
    deformable = details.deformable
    count = len(deformable.deformable_blocks)
    computed = [
        *dimension_rows(answer.report["dimensions"], answer.case.scene.limits),
        Row("assumptions", "; ".join(answer.report["assumptions"])),
        Row("method, element", f"{answer.method}, {deformable.bodies[0].element.words}"),
        Row(
            "blocks, elements, nodes",
            f"{count} deformable, {deformable.n_elements}, {deformable.n_nodes}",
        ),
        *parts("meshes"),
        cpu_row(answer.report["cpu_seconds"]),
    ]
    if paper:
        return RowTable(answer.title, [first, evidence, paper, beside, computed])
    return RowTable(answer.title, [first, [*evidence, *beside], computed])


def _slip_rows(slip: dict[str, float] | None) -> list[Row]:
    """The largest slip, with the remedy where it exceeds the facets of fixed contact pairs."""
    if slip is None:
        return []
    share = slip["largest"] / slip["facet_size"]
    words = f"{slip['largest']:.3g} mm, {share:.2g} of the facet size"
    if share > 1.0:
        words += (
            "\nNOT VALID: the slip exceeds one facet, and the contact pairs are fixed;\n"
            "set effects.finite_sliding = true"
        )
    return [Row("largest slip", words, slip["largest"], "mm")]


def _motion_rows(answer: Answer) -> list[Row]:
    """Motions that are counted as small and are not, and those that nothing determines."""
    rows, share = [], answer.details.large_motion
    if share is not None:
        turns = answer.details.turns_as_small
        small = {
            "effects.finite_sliding = true": not answer.details.deformable.contact.finite_sliding,
            "effects.finite_rotation = true": turns,
            'fem.method = "explicit"': turns and answer.details.run is None,
        }
        missing = " and ".join(word for word, counted in small.items() if counted)
        what = "contacts or rotations" if turns else "contacts"
        words = (
            f"blocks move by {100 * share:.2g} % of their size, but {what} are "
            f"those of small motions: expect errors of this order; set {missing}"
        )
        rows.append(Row("large motion", words, share))
    loose = answer.details.loose_blocks.tolist()
    if loose:
        words = (
            f"{', '.join(map(str, loose))}: no contact holds them in every direction. Pressures "
            "are determined, the positions of these blocks are not"
        )
        rows.append(Row("unrestrained blocks", words))
    return rows


def _support_rows(answer: Answer) -> list[Row]:
    """The force of each support on the blocks, and how far supports moved."""
    words = [_curve_words(curve) for curve in answer.details.push_curves]
    if not answer.details.reached:
        stopped = "the run ended before supports that move arrived: raise fem.end_time"
        words.insert(0, answer.details.evidence.status or stopped)
    motion = [Row("motion", "; ".join(filter(None, words)))] if any(words) else []
    return [*support_rows(answer.report), *motion]


def _curve_words(curve: PushCurve) -> str:
    """After which displacement nothing resists a support that moves; empty where something does."""
    if curve.free_after is None:
        return ""
    return f"nothing resists {curve.name}" + (
        f" after {curve.free_after:.4g} mm" if curve.free_after else ""
    )


def _verdict(answer: Answer) -> str:
    """Whether the state is one of equilibrium; empty for motions that are none."""
    if answer.details.run is None:
        return str(answer.details.evidence.status)
    state = answer.details.quasi_static
    return "" if state is None else state.verdict


def _why_no_bars(answer: Answer) -> str:
    """Why no value has an error bar, and what gives them one."""
    limit = answer.report.get("work", {}).get("stopped_by")
    if limit is not None:
        return f"none: the limit of {limit} ended the run before the meshes that they need"
    if answer.details.run is not None:
        static = answer.case.method.damped(moves=False) == "static"
        return f"none of an explicit run: {'compare, or ' if static else ''}solve on other meshes"
    if not answer.case.method.error_estimate:
        return "none: fem.error_estimate = false"
    return "none of a problem after another"


def _explicit_rows(answer: Answer, result: Run) -> list[Row]:
    """The steps of an explicit run, and how close to static its end is."""
    details = answer.details
    stated, state = result.stated, details.quasi_static
    steps = (
        f"{result.n_steps} to {1e3 * result.time:.4g} ms ({result.status}), "
        f"{result.time_step:.4g} s (critical {result.critical.critical_time_step:.4g} s)"
    )
    rows = [Row("steps, time step", steps, result.time_step, "s")]
    if result.restarts:
        words = (
            f"{result.restarts}: the contact stiffness exceeded the limit of the time step;"
            " the run restarted with a shorter one; set contact.maximum_stiffness or fem.time_step"
        )
        rows.append(Row("restarts", words))
    rate = result.element_updates_per_cpu_second
    rows.append(Row("element updates", f"{rate / 1e6:.3g} million per CPU second", rate, "1/s"))
    if state is not None and stated.recommended is not None:
        loading = (
            f"{1e3 * state.ramp_time:.4g} ms, {1e3 * state.hold_time:.4g} ms "
            f"(lowest excited frequency {stated.recommended.frequency:.3g} Hz)"
        )
        ratio = state.kinetic_over_internal_energy
        moving = f"{state.velocity_norm:.3g} mm/s, {100 * state.settling:.2g} %"
        rows += [
            Row("ramp, hold", loading),
            Row(
                "kinetic / internal energy",
                f"{ratio:.2e} (small is necessary, not sufficient)",
                ratio,
            ),
            Row("rms velocity, remaining displacement", moving, state.velocity_norm, "mm/s"),
        ]
    elif result.energies is not None:
        values = asdict(result.energies).items()
        shown = [
            f"{key.replace('_', ' ')} {number(value)}" for key, value in values if value != 0.0
        ]
        rows.append(Row("energies [N mm]", ", ".join(shown) or "all zero"))
    balance = result.energy_balance
    rows.append(Row("energy balance", f"{balance:.2e}", balance))
    if details.released_at_start is not None:
        words = _start_words(details.released_at_start)
        rows.append(Row("start", words, details.released_at_start))
    return rows


def _contact_rows(answer: Answer) -> tuple[list[Row], list[Row]]:
    """Rows of contact, and the paper's measures of tubes and walls."""
    facets, details = answer.parts.get("facets"), answer.details
    contact = contact_on(details, facets.of if isinstance(facets, MeshFacets) else None)
    search = Row("contact search", answer.report["contact_search"])
    rows = [*part_rows(answer, "facets"), search, *_slip_rows(details.slip)]
    if details.cap is not None:
        rows.append(Row("contact stiffness cap", cap_words(details.cap)))
    depth = contact.mean_overclosure
    words = f"{depth:.4g} mm over the closed contacts"
    rows.append(Row("mean penetration", words, depth, "mm"))
    if isinstance(answer.case.scene, PolyhedralScene):
        return rows, []
    measures = {name: answer.measures[name] for name in PAPER if name in answer.measures}
    pooled, effective = contact.p_eff_pooled, contact.effective_count_percent
    return rows, [
        Row("the paper's measures", "means over facets and blocks"),
        *measure_rows(measures),
        Row("p_eff over all blocks (tables)", f"{number(pooled)} MPa", pooled, "MPa"),
        Row("effective contact elements", f"{effective:.2f} %", effective, "%"),
    ]


def _start_words(share: float) -> str:
    """The work of the contact law before any load acts, and why the energy balance shows it."""
    return (
        f"impulsive: the contact pressure at zero clearance does {share:.3g} times the work of the "
        "loads before these act. The energy balance shows the resulting error in time (it falls "
        "with fem.safety_factor); a static run starts at rest"
    )


def cap_words(cap: CapAction) -> str:
    """Where a maximum stiffness acted, in words."""
    if not cap.points:
        return f"{cap.maximum_stiffness:g} MPa/mm above {cap.pressure:.3g} MPa: reached nowhere"
    return (
        f"{cap.maximum_stiffness:g} MPa/mm above {cap.pressure:.3g} MPa: reached at {cap.points} "
        f"of {cap.pressing_points} closed contact points, {100 * cap.force_share:.3g} % of the "
        "force"
    )
