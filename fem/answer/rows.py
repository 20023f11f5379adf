"""Rows of the table of a static or explicit answer: verdict, measures, evidence, model, time."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from fem.answer.forces import push_curves_of, released_at_start
from fem.answer.measures import (
    contact_on,
    large_motion,
    quasi_static,
    reached,
    slip,
    turned_within,
    turns_as_small,
    unrestrained_blocks,
)
from fem.answer.pressures import CapAction, ContactMeasures, cap_action
from fem.state import State
from geometry.answer import PAPER, Answer, measure_rows
from geometry.assembly import Assembly
from geometry.machine.work import LIMITS
from geometry.mesh import FloatArray
from geometry.parts.balance import balance_rows, reaction_rows
from geometry.parts.dimensions import has_faces
from geometry.parts.rows import Row, grouped, number

if TYPE_CHECKING:
    from fem.explicit.run import Run
    from fem.system.reactions import PushCurve

#: Measures that answer what is asked first: pressure, tension, displacement.
_FIRST = ("p_max_point", "sigma_1_averaged", "max_displacement")


def state_rows(answer: Answer, facets: tuple[Assembly, FloatArray] | None = None) -> list[Row]:
    """Rows of a static or explicit answer but those of its parts.

    ``facets`` are those of another mesh over which pressures are averaged, as in `answer_of`.
    """
    state: State = answer.details
    system, run = state.whole, state.run
    named = any(map(has_faces, system.assembly.shapes))  # blocks of files and masonry have none
    measures = {name: m for name, m in answer.measures.items() if name not in PAPER}
    first = {name: m for name, m in measures.items() if name in _FIRST and m.is_number}
    others = measure_rows({name: m for name, m in measures.items() if name not in first})
    of_supports = reaction_rows(answer.report.get("reactions", {})) + _curve_rows(state)
    evidence, paper = _bar_rows(answer), list[Row]()
    if system.meets:
        contact = contact_on(state, facets)
        evidence += _contact_rows(answer, contact)
        paper = _paper_rows(answer, contact) if named else []
    evidence += balance_rows(answer.report)
    if run is not None:
        evidence += _run_rows(state, run)
    return grouped(
        verdict=_verdict_rows(state),
        measures=[
            *measure_rows(first),
            *([*others, *of_supports] if named else [*of_supports, *others]),
            *paper,
        ],
        evidence=evidence,
        model=_model_rows(answer),
        time=[] if run is None else _rate_rows(run),
    )


def _verdict_rows(state: State) -> list[Row]:
    """Whether the state is one of equilibrium, and what is not what it is taken for."""
    at_rest = quasi_static(state)
    verdict = "" if at_rest is None else at_rest.verdict
    if state.run is None:
        verdict = str(state.evidence.status)
    rows, share = [Row("verdict", verdict)] if verdict else [], large_motion(state)
    if share is not None:
        turns = turns_as_small(state)
        small = {
            "effects.finite_sliding = true": not state.whole.contact.finite_sliding,
            "effects.finite_rotation = true": turns,
            'fem.method = "explicit"': turns and state.run is None,
        }
        missing = " and ".join(word for word, counted in small.items() if counted)
        what = "contacts or rotations" if turns else "contacts"
        words = (
            f"blocks move by {100 * share:.2g} % of their size, but {what} are "
            f"those of small motions: expect errors of this order; set {missing}"
        )
        rows.append(Row("large motion", words, share))
    if (turn := turned_within(state)) is not None:
        words = (
            f"elements turn by up to {turn:.2g} rad against their block, and whole blocks alone "
            "turn without strain: displacements and stresses are wrong for blocks that bend so far"
        )
        rows.append(Row("large rotation within a block", words, turn, "rad"))
    if loose := unrestrained_blocks(state).tolist():
        words = (
            f"{', '.join(map(str, loose))}: no contact holds them in every direction. Pressures "
            "are determined, the positions of these blocks are not"
        )
        rows.append(Row("unrestrained blocks", words))
    return rows


def _curve_rows(state: State) -> list[Row]:
    """How far supports moved, and where nothing resists them."""
    words = [_curve_words(curve) for curve in push_curves_of(state)]
    if not reached(state):
        stopped = "the run ended before supports that move arrived: raise fem.end_time"
        words.insert(0, state.evidence.status or stopped)
    return [Row("motion", "; ".join(filter(None, words)))] if any(words) else []


def _curve_words(curve: PushCurve) -> str:
    """After which displacement nothing resists a support that moves; empty where something does."""
    if curve.free_after is None:
        return ""
    after = f" after {curve.free_after:.4g} mm" if curve.free_after else ""
    return f"nothing resists {curve.name}{after}"


def _paper_rows(answer: Answer, contact: ContactMeasures) -> list[Row]:
    """The paper's means over facets and blocks."""
    pooled, effective = contact.p_eff_pooled, contact.effective_count_percent
    return [
        Row("the paper's measures", "means over facets and blocks"),
        *measure_rows({name: answer.measures[name] for name in PAPER if name in answer.measures}),
        Row("p_eff over all blocks (tables)", f"{number(pooled)} MPa", pooled, "MPa"),
        Row("effective contact elements", f"{effective:.2f} %", effective, "%"),
    ]


def _bar_rows(answer: Answer) -> list[Row]:
    """Why no value has an error bar, where none has one and no part says why."""
    notes = answer.parts.get("notes")
    said = notes is not None and any(row.title == "error bars" for row in notes.rows)
    if said or not answer.measures or any(m.error is not None for m in answer.measures.values()):
        return []
    limit, state = answer.report.get("work", {}).get("stopped_by"), answer.details
    why = "none of a problem after another"
    if limit is not None:
        why = f"none: {LIMITS[limit]} ended the run before the meshes that they need"
    elif state.run is not None:
        static = "" if quasi_static(state) is None else "compare, or "
        why = f"none of an explicit run: {static}solve on other meshes"
    return [Row("error bars", why)]


def _contact_rows(answer: Answer, contact: ContactMeasures) -> list[Row]:
    """How contact was found, the largest slip, and how deep blocks press into each other."""
    state: State = answer.details
    rows, found = [Row("contact search", answer.report["contact_search"])], slip(state)
    if found is not None:
        share = found["largest"] / found["facet_size"]
        words = f"{found['largest']:.3g} mm, {share:.2g} of the facet size"
        if share > 1.0:
            words += (
                "\nNOT VALID: the slip exceeds one facet, and the contact pairs are fixed;\n"
                "set effects.finite_sliding = true"
            )
        rows.append(Row("largest slip", words, found["largest"], "mm"))
    if (cap := cap_action(state)) is not None:
        rows.append(Row("contact stiffness cap", cap_words(cap)))
    depth = contact.mean_overclosure
    words = f"{depth:.4g} mm over the closed contacts"
    return [*rows, Row("mean penetration", words, depth, "mm")]


def cap_words(cap: CapAction) -> str:
    """Where a maximum stiffness acted, in words."""
    words = f"{cap.maximum_stiffness:g} MPa/mm above {cap.pressure:.3g} MPa: reached "
    if not cap.points:
        return f"{words}nowhere"
    return (
        f"{words}at {cap.points} of {cap.pressing_points} closed contact points, "
        f"{100 * cap.force_share:.3g} % of the force"
    )


def _run_rows(state: State, run: Run) -> list[Row]:
    """The steps of an explicit run, and how close to static its end is."""
    stated, at_rest = run.stated, quasi_static(state)
    steps = (
        f"{run.n_steps} to {1e3 * run.time:.4g} ms ({run.status}), "
        f"{run.time_step:.4g} s (critical {run.critical.critical_time_step:.4g} s)"
    )
    rows = [Row("steps, time step", steps, run.time_step, "s")]
    if run.restarts:
        words = (
            f"{run.restarts}: the contact stiffness exceeded the limit of the time step;"
            " the run restarted with a shorter one; set contact.maximum_stiffness or fem.time_step"
        )
        rows.append(Row("restarts", words))
    if at_rest is not None and stated.times.recommended is not None:
        loading = (
            f"{1e3 * at_rest.ramp_time:.4g} ms, {1e3 * at_rest.hold_time:.4g} ms "
            f"(lowest excited frequency {stated.times.recommended.frequency:.3g} Hz)"
        )
        ratio = at_rest.kinetic_over_internal_energy
        moving = f"{at_rest.velocity_norm:.3g} mm/s, {100 * at_rest.settling:.2g} %"
        rows += [
            Row("ramp, hold", loading),
            Row(
                "kinetic / internal energy",
                f"{ratio:.2e} (small is necessary, not sufficient)",
                ratio,
            ),
            Row("rms velocity, remaining displacement", moving, at_rest.velocity_norm, "mm/s"),
        ]
    elif run.energies is not None:
        values = asdict(run.energies).items()
        shown = [f"{key.replace('_', ' ')} {number(value)}" for key, value in values if value]
        rows.append(Row("energies [N mm]", ", ".join(shown) or "all zero"))
    rows.append(Row("energy balance", f"{run.energy_balance:.2e}", run.energy_balance))
    if (share := released_at_start(state)) is not None:
        words = (
            f"impulsive: the contact pressure at zero clearance does {share:.3g} times the work of "
            "the loads before these act. The energy balance shows the resulting error in time (it "
            "falls with fem.safety_factor); a static run starts at rest"
        )
        rows.append(Row("start", words, share))
    if (residual := state.residual) is not None:
        rows.append(Row("force residual", f"{residual:.2e}", residual))
    return rows


def _rate_rows(run: Run) -> list[Row]:
    """How fast an explicit run was."""
    rate = run.cost.element_updates_per_cpu_second
    return [Row("element updates", f"{rate / 1e6:.3g} million per CPU second", rate, "1/s")]


def _model_rows(answer: Answer) -> list[Row]:
    """What is taken for granted, elements and their number."""
    system = answer.details.whole
    count = len(system.deformable_blocks)
    return [
        Row("assumptions", "; ".join(answer.report["assumptions"])),
        Row("method, element", f"{answer.method}, {system.bodies[0].element.words}"),
        Row(
            "blocks, elements, nodes",
            f"{count} deformable, {system.n_elements}, {system.n_nodes}",
        ),
    ]
